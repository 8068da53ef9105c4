"""What watertight intersections cost: kernel seconds with Embree's robust mode over those without, taken in turn.

Scenes are loaded with it unless they say otherwise. `distribution` renders each shipped scene that has meshes or
rectangles, and closest hits are looked up on a mesh of 20,480 triangles, by rays in all directions from its inside.
"""

import whitted  # noqa: I001, first, since it finds LLVM before drjit looks for one

import mitsuba as mi
import numpy as np
import timing

from whitted.hardcases.meshes import icosphere, load_mesh, rays_at_vertices
from whitted.kernels import timed
from whitted.scene import ROBUST, shipped_path

SCENES = ("cornell_box", "whitted_1980", "soft_shadows", "interreflection", "mixed_glass")
SIZE, SPP, TURNS = 256, 16, 15
LEVELS, RAYS = 5, 1 << 21
MODES = ("robust", "default")


def load(name, robust):
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = config.merge_equivalent = config.parallel = False
    state = mi.parser.parse_file(config, str(shipped_path(name)), width=str(SIZE), integrator="distribution")
    state.root.props[ROBUST] = robust
    mi.parser.transform_all(config, state)
    return mi.parser.instantiate(config, state)


def render(scene, seed):
    return np.array(scene.integrator().render(scene, seed=seed, spp=SPP))


def closest(scene, rays):
    return scene.ray_intersect_preliminary(rays).t


def measure():
    whitted.load("cornell_box", width=16)  # sets the variant
    found = {}
    for name in SCENES:
        scenes = {mode: load(name, mode == "robust") for mode in MODES}
        found[name] = in_turn({mode: (render, scene) for mode, scene in scenes.items()})
    vertices, faces = icosphere(LEVELS)
    vertices = np.float32(vertices)
    o, d, _ = rays_at_vertices(vertices, faces, RAYS)
    rays = mi.Ray3f(mi.Point3f(o), mi.Vector3f(d))
    meshes = {mode: load_mesh(vertices, faces, mode == "robust") for mode in MODES}
    found["closest hits"] = in_turn(
        {mode: (lambda s, turn: closest(s, rays), mesh) for mode, mesh in meshes.items()}
    )
    return {"seconds": found}


def in_turn(sides):
    seconds = {mode: [] for mode in sides}
    for turn in range(TURNS + 1):
        for mode, (run, scene) in sides.items():
            seconds[mode].append(timed(run, scene, turn)[1])
    return {mode: taken[1:] for mode, taken in seconds.items()}  # the first compiles


def show(found):
    print(f"{found['machine']}; scenes {SIZE}x{SIZE}, {SPP} samples; medians of {TURNS} turns\n")
    rows = [("", *(f"{mode}, ms" for mode in MODES), "ratio")]
    for name, seconds in found["seconds"].items():
        value, low, high = timing.ratio(seconds["robust"], seconds["default"])
        medians = (f"{1000 * np.median(seconds[mode]):.1f}" for mode in MODES)
        rows.append((name, *medians, f"{value:.2f} [{low:.2f}, {high:.2f}]"))
    timing.table(rows)


if __name__ == "__main__":
    timing.main("robust", measure, show)
