"""Where Mitsuba 3.9.1 is wrong: radiance along one ray in scenes that have a closed form, by it and by us.

Each function returns columns: ``x``, ``truth`` (NumPy, double precision), and one for each integrator. Left out: what
has no closed form, but for the mean of the Cornell box, where a sampler's bias shows against the others.
"""

import whitted  # noqa: I001, first, since it finds LLVM before drjit looks for one

import mitsuba as mi
import numpy as np

from whitted.replicates import box_sensor, replicate, seeds

ALBEDO = 0.5
FOV_DEG = 0.01  # of the one pixel
MITSUBA = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
HEIGHT = 10.0  # of the light behind the blocker


def radiance(things, integrator, origin, direction, spp=16, seed=1, near_clip=1e-2, **options):
    """Return the radiance that comes to ``origin`` against ``direction``; options are the integrator's.

    Args:
        things: dict of shapes and emitters.
        integrator: name.
        origin, direction: [3].
    """
    film = {
        "type": "hdrfilm",
        "width": 1,
        "height": 1,
        "rfilter": {"type": "box"},
        "pixel_format": "luminance",
    }
    film["component_format"] = "float32"
    origin, direction = np.float64(origin), np.float64(direction)
    to_world = mi.ScalarTransform4f().look_at(origin.tolist(), (origin + direction).tolist(), [0, 1, 0])
    sensor = {
        "type": "perspective",
        "to_world": to_world,
        "fov": FOV_DEG,
        "near_clip": near_clip,
        "film": film,
    }
    sensor["sampler"] = {
        "type": "multijitter",
        "sample_count": spp,
    }  # a radiancemeter would begin at an offset
    scene = mi.load_dict({"type": "scene", "sensor": sensor, **things}, optimize=False)
    effects = {"effects": "all"} if integrator == "distribution" else {}
    made = mi.load_dict({"type": integrator} | effects | options)
    return float(np.array(made.render(scene, seed=seed, spp=spp)).ravel()[0])


def plane(z=0.0, half=1.0, centre=(0.0, 0.0), up=True, **rest):
    """Return the dict of a horizontal square."""
    to_world = mi.ScalarTransform4f().translate([*centre, z])
    to_world = to_world if up else to_world @ mi.ScalarTransform4f().rotate([1, 0, 0], 180)
    return {"type": "rectangle", "to_world": to_world @ mi.ScalarTransform4f().scale([half, half, 1])} | rest


def diffuse(albedo=ALBEDO):
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}


def columns(x, truth, names, measure):
    """Return the columns of a table: what each name's measurement gives for each x."""
    found = {name: [measure(name, value) for value in x] for name in names}
    return {"x": [float(value) for value in x], "truth": [float(truth(value)) for value in x]} | found


def small_spheres(spp=1 << 12):
    """A ball light of radius x at distance 1, of equal power: the irradiance is pi x^2 L whatever x."""

    def measure(name, radius):
        light = {"type": "area", "radiance": float(1 / (np.pi * radius**2))}
        things = {
            "floor": plane(bsdf=diffuse()),
            "ball": {"type": "sphere", "center": [0, 0, 1], "radius": float(radius), "emitter": light},
        }
        options = {"emitter_samples": 1, "bsdf_samples": 0} if name == "direct" else {"max_depth": 2}
        return radiance(things, name, [1, 0, 1], [-1, 0, -1], spp, **options)

    return columns(
        np.logspace(-1, -5, 17), lambda radius: ALBEDO / np.pi, ("direct", "path", "distribution"), measure
    )


def gap_at_light(spp=16):
    """A blocker at the distance x before a point light that is 10 above the floor: no light arrives."""

    def measure(name, gap):
        things = {
            "floor": plane(bsdf=diffuse()),
            "blocker": plane(HEIGHT - gap, bsdf=diffuse()),
            "light": {"type": "point", "position": [0, 0, HEIGHT], "intensity": HEIGHT**2 * np.pi / ALBEDO},
        }
        return radiance(things, name, [1, 0, 1], [-1, 0, -1], spp, max_depth=2)

    return columns(np.logspace(0, -5, 21), lambda gap: 0.0, ("path", "distribution"), measure)


def contact(spp=16):
    """The widest gap between a floor and a blocker that lets light pass, at the distance x from the origin: none does.

    It is bisected between 16 units in the last place of the coordinates in float32 and 100.
    """

    def lit(name, at, gap):
        things = {
            "floor": plane(0, 10 + at / 100, (at, 0), bsdf=diffuse()),
            "blocker": plane(gap, 10 + at / 100, (at, 0), bsdf=diffuse()),
            "sun": {"type": "directional", "direction": [0, 0, -1], "irradiance": np.pi / ALBEDO},
        }
        off_diagonal = [at + 0.3, 0.2, gap / 2]  # rays at the edge of two triangles may miss both
        return radiance(things, name, off_diagonal, [0, 0, -1], spp, near_clip=gap / 8, max_depth=2) > 0

    def measure(name, at):
        dark, leaks = 100.0, float(16 * np.spacing(np.float32(max(at, 1))))
        if not lit(name, at, leaks):
            return 0.0
        while dark / leaks > 1.1:
            middle = np.sqrt(dark * leaks)
            dark, leaks = (dark, middle) if lit(name, at, middle) else (middle, leaks)
        return leaks

    return columns([0, 10, 1e3, 1e5], lambda at: 0.0, ("path", "distribution"), measure)


def transparent(spp=1 << 10):
    """A point light behind a pane: 0 null, 1 mask of opacity 1/2, 2 thin glass of index 1.5, at normal incidence."""
    once = (0.5 / 2.5) ** 2
    passed = (1.0, 0.5, (1 - once) / (1 + once))
    panes = (
        {"type": "null"},
        {"type": "mask", "opacity": 0.5, "nested": diffuse()},
        {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0},
    )

    def measure(name, number):
        things = {
            "floor": plane(bsdf=diffuse()),
            "pane": plane(1, 0.3, bsdf=panes[number]),
            "light": {"type": "point", "position": [0, 0, 2], "intensity": 4 * np.pi / ALBEDO},
        }
        return radiance(things, name, [1, 0, 1], [-1, 0, -1], spp, max_depth=3)

    return columns(range(3), lambda number: passed[number], ("path", "volpath", "distribution"), measure)


def blends(spp=1 << 14):
    """A blend of a mirror (reflectance 0.9) and, by the weight x, a grey surface (0.2), under a sky of radiance 1."""

    def measure(name, weight):
        mirror = {
            "type": "conductor",
            "material": "none",
            "specular_reflectance": {"type": "rgb", "value": 0.9},
        }
        blend = {"type": "blendbsdf", "weight": float(weight), "a": mirror, "b": diffuse(0.2)}
        things = {"floor": plane(bsdf=blend), "sky": {"type": "constant", "radiance": 1.0}}
        return radiance(things, name, [1, 0, 1], [-1, 0, -1], spp, max_depth=2)

    return columns(
        np.linspace(0, 1, 9),
        lambda weight: 0.9 * (1 - weight) + 0.2 * weight,
        ("path", "distribution"),
        measure,
    )


def hidden(spp=1 << 10):
    """The top of a ball under a point light, seen through a hidden light at the share x of the way."""
    origin, direction = np.array([3.0, 0.0, 3.0]), np.array([-1.0, 0.0, -1.0])

    def measure(name, share):
        x, _, z = origin + 3 * share * direction
        things = {
            "ball": {"type": "sphere", "center": [0, 0, -1], "radius": 1.0, "bsdf": diffuse()},
            "panel": plane(z, 0.1, (x, 0), emitter={"type": "area", "radiance": 1.0}),
            "light": {"type": "point", "position": [-0.5, 0, 1], "intensity": np.pi / ALBEDO},
        }
        return radiance(things, name, origin, direction, spp, max_depth=2, hide_emitters=True)

    return columns(
        np.linspace(0.2, 0.8, 7), lambda share: 1.25**-1.5, ("path", "volpath", "distribution"), measure
    )


def film_sums(value=0.7123):
    """A sky of one radiance, with x samples in one pass: Mitsuba's film adds them up in float32."""

    def measure(name, spp):
        sky = {"sky": {"type": "constant", "radiance": value}}
        return radiance(sky, name, [0, 0, 0], [0, 0, 1], int(spp), max_depth=1)

    return columns(4.0 ** np.arange(9), lambda spp: np.float32(value), ("path", "distribution"), measure)


def correlations(samples=64, pixels=1 << 12):
    """The largest correlation of two of the first eight numbers that a sampler draws; they are to be independent."""
    found = {}
    for name in (*MITSUBA, "owen_sobol"):
        count = 121 if name == "orthogonal" else samples
        sampler = mi.load_dict({"type": name, "sample_count": count})
        sampler.set_samples_per_wavefront(count)
        sampler.seed(0, count * pixels)
        numbers = np.array([np.array(sampler.next_1d()) for _ in range(8)], np.float64)
        found[name] = float(np.abs(np.triu(np.corrcoef(numbers), 1)).max())
    return found


def cornell_means(side=64, spp=256, replicates=16):
    """The picture's mean of the Cornell box in each replicate, by `path` with each sampler and by `distribution`."""
    scene = whitted.load("cornell_box", width=side, height=side, max_depth=8, integrator="path").mitsuba
    sides = {f"path, {name}": ("path", name) for name in (*MITSUBA, "owen_sobol")}
    sides["distribution"] = ("distribution", "independent")
    found = {}
    for number, (label, (integrator, sampler)) in enumerate(sides.items()):
        made = mi.load_dict({"type": integrator, "max_depth": 8})
        camera = box_sensor(scene.sensors()[0], sampler)
        count = 289 if sampler == "orthogonal" else spp
        chosen = seeds(0, 7919 * number, replicates)
        pictures = (replicate(made, scene, camera, seed, count) for seed in chosen)
        found[label] = [float(picture.mean(dtype=np.float64)) for picture in pictures]
    return found
