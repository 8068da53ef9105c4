"""What each technique of `distribution` is worth: its error with and without the technique, at the same kernel seconds.

A technique is taken out by a property where there is one, else by putting a plainer function in its place for the time
of a render. Both sides are rendered in turn, twice each, with 16, 64 and 256 samples per pixel; half the mean squared
difference of the two pictures is the variance. A ratio is that of the side without over the side with, at the shortest
and at the longest time that both have reached.
"""

import whitted  # noqa: I001, first, since it finds LLVM before drjit looks for one

import contextlib
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import mitsuba as mi
import numpy as np
import timing

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the statistics are shared with the comparisons

from combining import squared_error

from whitted import film
from whitted.kernels import timed
from whitted.lights import bounded, tree, warp
from whitted.replicates import box_sensor, replicate, seeds
from whitted.sampling.draws import joint_dimensions
from whitted.stats.curves import Curve, common_cost, ratio_at
from whitted.world import World

SIDE = 256
SPP = (16, 64, 256)
TURNS = 8
ONE_BRANCH = "one specular branch, not all to depth 1"
AUTO = {"light_samples": "auto", "gloss_samples": "auto", "interreflection_samples": "auto"}


@dataclass(frozen=True)
class Ablation:
    """A technique on a scene: ``properties`` of both sides, and ``without`` or ``patches`` of the side without it.

    Patches are pairs of an attribute, as object and name, and what is put there.
    """

    technique: str
    scene: str
    properties: dict = field(default_factory=dict)
    without: dict = field(default_factory=dict)
    patches: tuple = ()


def by_power(bounds, p, n, response=None):
    """The power alone as a light's importance."""
    return mi.Float(bounds[7]) + 0 * p.x


def unknown(self, si, active):
    """No response of a surface to the lights."""
    return


def evenly(cosines):
    """No warp by the cosine."""
    return [mi.Float(1)] * 4


def first_surface(plan):
    """The joint dimensions of the first surface alone."""
    return {
        (effect, node): dimension for (effect, node), dimension in joint_dimensions(plan).items() if not node
    }


ABLATIONS = (
    Ablation("unoccluded light in closed form", "open_floor", without={"closed_form": False}),
    Ablation("no closed form where it doesn't pay", "soft_shadows", without={"closed_form": True}),
    Ablation("near rectangles by solid angle", "wall rectangle", patches=((bounded, "FAR", 0.0),)),
    Ablation("near disks by solid angle", "wall disk", patches=((bounded, "FAR", 0.0),)),
    Ablation("near triangles by solid angle", "wall triangles", patches=((bounded, "FAR", 0.0),)),
    Ablation("far rectangles by area", "soft_shadows", patches=((bounded, "FAR", 1e9),)),
    Ablation(
        "directions warped by the cosine", "wall rectangle", patches=((warp, "corner_weights", evenly),)
    ),
    Ablation(
        "directions warped by the cosine",
        "wall rectangle, metal",
        patches=((warp, "corner_weights", evenly),),
    ),
    Ablation(
        "lights chosen by the tree, not by power", "many lights", patches=((tree, "importance", by_power),)
    ),
    Ablation("few lights chosen by the BSDF", "gloss", patches=((World, "response", unknown),)),
    Ablation("rays and samples of lights, not rays alone", "gloss", without={"direct_light": "rays"}),
    Ablation("rays and samples of lights, not these alone", "gloss", without={"direct_light": "lights"}),
    Ablation("rays alone where samples don't pay", "translucency", without={"direct_light": "both"}),
    Ablation("joint points", "soft_shadows", patches=((film, "joint_dimensions", lambda plan: {}),)),
    Ablation("joint points", "depth_of_field", patches=((film, "joint_dimensions", lambda plan: {}),)),
    Ablation("joint points", "interreflection", patches=((film, "joint_dimensions", lambda plan: {}),)),
    Ablation("joint points", "translucency", patches=((film, "joint_dimensions", lambda plan: {}),)),
    Ablation(
        "second surface in the joint point",
        "interreflection",
        patches=((film, "joint_dimensions", first_surface),),
    ),
    Ablation(
        "second surface in the joint point",
        "translucency",
        patches=((film, "joint_dimensions", first_surface),),
    ),
    Ablation(ONE_BRANCH, "whitted_1980", without={"tree_depth": 1}),
    Ablation(ONE_BRANCH, "mixed_glass", without={"tree_depth": 1}),
    Ablation(ONE_BRANCH, "glass", without={"tree_depth": 1}),
    Ablation(ONE_BRANCH, "match_specular", without={"tree_depth": 1}),
    Ablation("numbers of samples tried out", "soft_shadows", AUTO, without=dict.fromkeys(AUTO, 1)),
    Ablation("numbers of samples tried out", "translucency", AUTO, without=dict.fromkeys(AUTO, 1)),
    Ablation("numbers of samples tried out", "interreflection", AUTO, without=dict.fromkeys(AUTO, 1)),
)


def place(*translation, scale=1.0, turn=None):
    placed = mi.ScalarTransform4f().translate(list(translation))
    if turn:
        placed = placed.rotate(*turn)
    return placed.scale(scale)


def walls(light):
    """A light on a wall that touches the floor, before it a ball that keeps some of it off."""
    emits = {"emitter": {"type": "area", "radiance": 2.0}}
    shapes = {
        "rectangle": {"light": {"type": "rectangle", "to_world": place(0, 0.5, -1, scale=0.5)} | emits},
        "disk": {"light": {"type": "disk", "to_world": place(0, 0.5, -1, scale=0.5)} | emits},
        "triangles": {"light": triangles() | emits},
    }
    ball = {"type": "sphere", "center": [0.2, 0.25, -0.4], "radius": 0.2}
    return shapes[light] | {"ball": ball}


def triangles():
    """A square light of four triangles."""
    x = [(-0.5, 0), (0.5, 0), (0.5, 1), (-0.5, 1), (0, 0.5)]
    rows = [f"{a} {b} -1" for a, b in x] + [f"3 {k} {(k + 1) % 4} 4" for k in range(4)]
    head = f"ply\nformat ascii 1.0\nelement vertex {len(x)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    file = Path(tempfile.mkdtemp()) / "square.ply"
    file.write_text(head + "\n".join(rows) + "\n")
    return {"type": "ply", "filename": str(file)}


def many():
    """196 small lights over a floor, with powers that differ by up to 100 times."""
    rng = np.random.default_rng(1)
    lights = {}
    for n in range(196):
        x, z = np.divmod(n, 14)
        radiance = float(20 * 10 ** rng.uniform(0, 2))
        lights[f"light{n}"] = {
            "type": "rectangle",
            "to_world": place(0.5 * x - 3.25, 0.6, 0.5 * z - 5, scale=0.02, turn=([1, 0, 0], 90)),
            "emitter": {"type": "area", "radiance": radiance},
        }
    return lights


def load(name):
    """A shipped scene, or one of those made here: (scene, its depth)."""
    if not name.startswith(("wall ", "many ")):
        scene = whitted.load(name, width=SIDE, height=SIDE).mitsuba
        return scene, int(scene.integrator().max_depth)
    things = many() if name == "many lights" else walls(name.removesuffix(", metal").split()[1])
    floor = {"type": "rectangle", "to_world": place(0, 0, 0, scale=8, turn=([1, 0, 0], -90))}
    if name.startswith("wall "):  # no diffuse floor: there the unoccluded light is known
        floor["bsdf"] = {"type": "roughconductor" if "metal" in name else "roughplastic", "alpha": 0.5}
    camera = {
        "type": "perspective",
        "fov": 40,
        "to_world": mi.ScalarTransform4f().look_at([0, 2.5, 4], [0, 0.2, -0.4], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}},
    }
    return mi.load_dict({"type": "scene", "camera": camera, "floor": floor} | things), 2


class Side:
    """A scene as it is rendered with a technique, or without."""

    def __init__(self, scene, sensor, properties, patches):
        self.scene, self.sensor, self.patches = scene, sensor, patches
        self.seconds, self.errors = [], []
        with self.patched():
            made = mi.load_dict({"type": "distribution"} | properties)
            self.integrator = made.fixed(made.plan(made.world(scene), sensor))

    @contextlib.contextmanager
    def patched(self):
        """Put the plainer functions in their places."""
        with contextlib.ExitStack() as stack:
            for target, name, value in self.patches:
                stack.enter_context(mock.patch.object(target, name, value))
            yield

    def render(self, spp, seed):
        """Return a picture and its kernels' seconds."""
        with self.patched():
            return timed(replicate, self.integrator, self.scene, self.sensor, seed, spp)

    def turn(self, number, spp):
        """Render twice; keep the mean time and the variance."""
        (a, t), (b, s) = (self.render(spp, seed) for seed in seeds(3, number, 2))
        self.seconds.append((t + s) / 2)
        self.errors.append(squared_error(a, b) / 2)

    @property
    def curve(self):
        """Its errors over seconds."""
        shape = TURNS, len(SPP)
        return Curve(np.array(SPP), np.reshape(self.seconds, shape), np.reshape(self.errors, shape))


def measure_one(ablation):
    scene, depth = load(ablation.scene)
    sensor = box_sensor(scene.sensors()[0], "independent")
    properties = {"max_depth": depth} | ablation.properties
    sides = (
        Side(scene, sensor, properties, ()),
        Side(scene, sensor, properties | ablation.without, ablation.patches),
    )
    for side in sides:
        side.render(SPP[0], 1)  # compiles
    for number in range(TURNS):
        for spp in SPP:
            for side in sides:
                side.turn(number, spp)
    with_it, without = (side.curve for side in sides)
    shortest = max(side.span[0] for side in (with_it, without))
    early, late = (
        ratio_at(without, with_it, seconds) for seconds in (shortest, common_cost([with_it, without]))
    )
    slower = timing.ratio(with_it.seconds[:, -1], without.seconds[:, -1])
    noise = without.errors[:, -1].mean() / with_it.errors[:, -1].mean()
    print(f"{ablation.technique}, {ablation.scene}: {late.value:.3g}", file=sys.stderr, flush=True)
    return {
        "technique": ablation.technique,
        "scene": ablation.scene,
        "early": [early.value, early.low, early.high],
        "late": [late.value, late.low, late.high],
        "equal_samples": noise,
        "seconds": list(slower),
    }


def measure():
    mi.set_variant("llvm_ad_rgb")
    return {"ablations": [measure_one(ablation) for ablation in ABLATIONS]}


def show(found):
    print(f"{found['machine']}; {SIDE}x{SIDE}, {TURNS} turns; mean squared error without / with\n")
    head = ("technique", "scene", "at the shortest time [95 %]", "at the longest", f"at {SPP[-1]} samples")
    rows = [(*head, "seconds with / without")]
    for row in found["ablations"]:
        early, late = ("{:.3g} [{:.3g}, {:.3g}]".format(*row[when]) for when in ("early", "late"))
        rows.append(
            (
                row["technique"],
                row["scene"],
                early,
                late,
                f"{row['equal_samples']:.3g}",
                f"{row['seconds'][0]:.2f}",
            )
        )
    timing.table(rows)


if __name__ == "__main__":
    timing.main("ablations", measure, show)
