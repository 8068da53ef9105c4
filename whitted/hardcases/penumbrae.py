"""Light that is kept off: by things at the lamp, in penumbrae and eclipses, by the horizon; and lamps that are touched.

Pictures are of points: a camera looks straight down at the floor z = 0, from just above it, at the middles of pixels.
"""

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.direct import power_heuristic
from whitted.geometry import circle
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.lamps import Lamp, lambert, lattice, receiver, shining
from whitted.lights.primitives import registry_number
from whitted.world import World

FAMILY = "lights"
SMALLEST = float(np.finfo(np.float32).tiny)  # normal number
OURS = {"type": "distribution", "effects": "soft_shadows", "max_depth": 2}
MITSUBA = {"type": "path", "max_depth": 2}


def transform():
    """The identity, to be gone on from."""
    return mi.ScalarTransform4f()


def floor(**things):
    """The dict of a scene with a white floor."""
    bsdf = {"type": "diffuse", "reflectance": 1.0}
    return {
        "type": "scene",
        "floor": {"type": "rectangle", "to_world": transform().scale(8), "bsdf": bsdf},
    } | things


def look_down(x, width, height, pixels=1):
    """The dict of a camera that sees ``width`` of the floor in a row of pixels around (x, 0, 0), from a height."""
    place = transform().look_at([x, 0, height], [x, 0, 0], [0, 1, 0]).scale([width / 2, width / 2, 1])
    film = {"type": "hdrfilm", "width": pixels, "height": 1, "rfilter": {"type": "box"}}
    return {"type": "orthographic", "to_world": place, "film": film, "near_clip": height / 10}


def irradiance(things, integrator, spp):
    """Return the irradiance in each pixel, ``float64`` [W], five standard errors of it, and the ``Render``.

    The error is taken from all pixels together: in one with an edge just beside a cell of the samples' lattice all
    replicates may agree by chance.
    """
    from whitted.passes import render

    found = render(mi.load_dict(things, optimize=False), integrator, spp=spp, replicates=16)
    error = np.sqrt(np.mean(np.square(np.float64(found.standard_error[..., 0]))))
    return np.pi * np.float64(found.mean[0, :, 0]), 5 * np.pi * error, found


def _beyond_noise(things, truth, whole, spp, more=16, plain=None):
    """The `Errors` of pictures in units of five standard errors and 64 u of the light that nothing keeps off.

    By ours, by Mitsuba with ``more`` times as many samples, and of a formula in units of ours.
    """
    bounds, errors = [], []
    for integrator, samples in ((OURS, spp), (MITSUBA, spp * more)):
        E, noise, _ = irradiance(things, integrator, samples)
        bounds.append(noise + 64 * U * whole)
        errors.append((E - truth) / bounds[-1])
    return Errors(errors[0], None if plain is None else (plain - truth) / bounds[0], errors[1])


NOISE = "five standard errors between 16 replicates, and 64 u"


# ---- At the lamp


@case(
    "24, R4", FAMILY, unit="of the rays",
    sweep=("gap", (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5)), tolerance=0,
    why="what is met before the lamp blocks, what is behind it doesn't; 1e-5 is 10 units in the last place of 10",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def occluder_at_the_lamp(gap):
    """Wrong answers of shadow rays to a lamp at distance 10 with a screen at a gap before or behind it."""
    wrong = [], []
    for height, passes in ((10 - gap, False), (10 + gap, True)):
        lamp = shining(
            {"type": "rectangle", "to_world": transform().translate([0, 0, 10]).rotate([1, 0, 0], 180)}
        )
        screen = {"type": "rectangle", "to_world": transform().translate([0, 0, height]).scale(4)}
        scene = mi.load_dict(floor(lamp=lamp, screen=screen), optimize=False)
        x = np.random.default_rng(24).uniform(-1, 1, (2, 1 << 12))
        down = mi.Ray3f(mi.Point3f(np.float32([*x, 0 * x[0] + 1])), mi.Vector3f(0, 0, -1))
        si = scene.ray_intersect(down)
        at = scene.emitters()[0].get_shape().sample_position(0.0, mi.Point2f(np.float32((1 - x) / 2)))
        shape = mi.UInt32(registry_number(scene.emitters()[0].get_shape()))
        ours = World(scene).transmittance(si, at.p, shape, mi.Bool(True)).x > 0
        reference = ~scene.ray_test(si.spawn_ray_to(at.p))
        for found, lit in zip(wrong, (ours, reference), strict=True):
            found.append(np.mean(np.array(lit) != passes))
    return Errors(wrong[0], reference=wrong[1])


@case(
    "51, R5", FAMILY, unit="of the bound",
    sweep=("distance from where they touch", (0.3, 1e-1, 3e-2, 1e-2, 3e-3, 1e-3)), tolerance=1,
    why=NOISE, source="ShirleyWangZimmerman1996",
)  # fmt: skip
def sphere_light_on_the_floor(x):
    """The picture of a floor below a sphere that lies on it."""
    sensor = look_down(x, 1e-5, x * x / 4)
    x = float(np.float32(x))
    truth = np.pi / (1 + x * x) ** 1.5
    things = floor(lamp=shining({"type": "sphere", "center": [0, 0, 1]}), sensor=sensor)
    return _beyond_noise(things, truth, np.pi, 64)


# ---- Edge on, or turned away


def _flat_lights():
    """A rectangle, a parallelogram, which is two triangles, and a disk."""
    skewed = transform()
    skewed = type(skewed)([[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return {"type": "rectangle"}, {"type": "rectangle", "to_world": skewed}, {"type": "disk"}


@case(
    "56, R11", FAMILY, unit="of the radiance",
    sweep=("which", (0.0, 1.0, 2.0)), tolerance=0, why="nothing is seen of it", source="Veach1997",
)  # fmt: skip
def light_seen_edge_on(which):
    """Samples of a light from its plane, weighed against rays of density 1."""
    lamp = Lamp(_flat_lights()[int(which)])
    rng = np.random.default_rng(56)
    p = np.float32([*rng.uniform(-4, 4, (2, 1 << 14)), np.zeros(1 << 14)])
    n = rng.standard_normal((3, 1 << 14))
    n = np.float32(n / np.linalg.norm(n, axis=0))
    u = mi.Point2f(np.float32(rng.random((2, 1 << 14))))
    sample = lamp.sample(p, n, u)
    stable = power_heuristic(sample.pdf, 1) * sample.weight.x, lamp.irradiance(p, n)
    at = lamp.scene.shapes()[0].sample_position(0.0, u)
    v = at.p - mi.Point3f(p)
    pdf = dr.squared_norm(v) / dr.abs(dr.dot(dr.normalize(v), at.n)) * at.pdf
    ds, weight = lamp.emitter.sample_direction(receiver(p), u)
    share = dr.square(ds.pdf) / (dr.square(ds.pdf) + 1)
    share = dr.select(dr.isfinite(share), share, 0)  # as Mitsuba's path does
    plain, reference = dr.square(pdf) / (dr.square(pdf) + 1) / pdf, share * weight.x
    return Errors(np.stack([np.array(one) for one in stable]), np.array(plain), np.array(reference))


@case(
    "57", FAMILY, unit="radiance, or shadow rays",
    sweep=("which", (0.0, 1.0, 2.0)), tolerance=0,
    why="no light comes from it, so that nothing has to be asked", source="CookPorterCarpenter1984",
)  # fmt: skip
def lamp_that_is_turned_away(which):
    """Radiance from lamps behind their lit side or below the horizon, and the shadow rays that it took."""
    up = transform()
    lamp = (
        shining({"type": "rectangle", "to_world": up.translate([0.5, 0, 1])}),
        shining({"type": "sphere", "center": [0.5, 0, -1.5]}),
        {"type": "spot", "to_world": up.translate([0.5, 0, 1]), "intensity": 1.0},
    )[int(which)]
    E, _, found = irradiance(floor(lamp=lamp, sensor=look_down(0, 2.0, 0.1, pixels=16)), OURS, 16)
    return Errors([E.max(), found.rays["shadow"]])


# ---- Points and spots


@case(
    "60", FAMILY, unit="relative",
    sweep=("distance", (1.0, 1e-5, 1e-10, 1e-15, 1e-18, 1e-19, 1e-25)), tolerance=16 * U,
    why="8 roundings of 1/d^2; where d^2 is below 1.2e-38 all is counted as no number, and left out of the picture",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def point_light_that_is_reached(distance):
    """The picture of the foot of a point light; infinite where what is no number gets in, or is lost uncounted."""
    from whitted.passes import render

    sensor = look_down(0, 1e-30, 1)
    foot = _middles(mi.load_dict(floor(sensor=sensor)), 1)[0]
    truth = 1 / np.longdouble(np.float32(distance)) ** 2
    scene = mi.load_dict(
        floor(lamp={"type": "point", "position": [*foot, distance], "intensity": 1.0}, sensor=sensor)
    )
    found = render(scene, OURS, spp=16)
    E = np.pi * np.float64(found.mean[0, 0, 0])
    if 1 / truth < SMALLEST:
        return Errors(0.0 if E == 0 and found.nonfinite == found.spp else np.inf)
    return Errors(np.float64(E / truth - 1))


@case(
    "61", FAMILY, unit="of the bound",
    sweep=("cutoff in degrees", (80.0, 45.0, 10.0, 1.0, 0.1)), tolerance=1,
    why="8 u, and what roundings of the cosine by 4 u change: as the arc cosine, 1 / sin over the width of the edge",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def edge_of_a_spot(cutoff):
    """The intensity of a spot in units in the last place around the cosine at which it ends."""
    end, begin = np.radians([cutoff, 0.75 * cutoff])
    cosine = np.cos(end) + 4 * U * np.random.default_rng(61).uniform(-4, 4, 1 << 12)
    sine = np.sqrt(1 - cosine**2)
    p = np.float32([sine, 0 * sine, cosine])
    lamp = Lamp({"type": "spot", "intensity": 1.0, "cutoff_angle": cutoff, "beam_width": 0.75 * cutoff})
    sample = lamp.sample(p, (0, 0, 0), lattice(64))
    exact = np.longdouble(p)
    angle = np.arctan2(exact[0], exact[2])
    truth = np.clip((end - angle) / (end - begin), 0, 1) / (exact**2).sum(0)
    bound = 8 * U + 4 * U / (np.sin(end) * (end - begin))
    return Errors(np.float64((np.array(sample.weight.x) - truth) / bound))


# ---- Shadows


@case(
    "62", FAMILY, unit="of the bound",
    sweep=("height of the screen", (0.1, 1.0, 1.9)), tolerance=1, why=NOISE, source="Lambert1760",
)  # fmt: skip
def penumbra_of_a_half_plane(height):
    """The irradiance across a penumbra, from what is seen of a square; by the textbook its share of the area."""
    top, half, pixels = 2.0, 0.5, 16
    lamp = shining(
        {
            "type": "rectangle",
            "to_world": transform().translate([0, 0, top]).rotate([1, 0, 0], 180).scale(half),
        }
    )
    screen = {"type": "rectangle", "to_world": transform().translate([4, 0, height]).scale(4)}
    width = 2 * half * height / (top - height)
    things = floor(lamp=lamp, screen=screen, sensor=look_down(0, min(1.2 * width, 6), height / 2, pixels))
    x = _middles(mi.load_dict(things), pixels)[:, 0]
    edge = np.clip(-x * (top - height) / height, -half, half)

    def square(right):
        corners = [(-half - x, -half), (right - x, -half), (right - x, half), (-half - x, half)]
        corners = [np.array([at, 0 * x + y, 0 * x + top]) for at, y in corners]
        return np.float64(lambert(corners, np.array([[0.0], [0.0], [1.0]]) + 0 * x)[0])

    truth, whole = square(edge), square(0 * x + half)
    return _beyond_noise(things, truth, whole, 1024, more=4, plain=(edge + half) / (2 * half) * whole)


def _middles(scene, pixels):
    """Where the middles of the pixels of a row see the floor, x and y, ``float64`` [W, 2]."""
    at = mi.Point2f(np.float32((np.arange(pixels) + 0.5) / pixels), 0.5)
    si = scene.ray_intersect(scene.sensors()[0].sample_ray(0.0, 0.5, at, mi.Point2f(0.5))[0])
    return np.array(si.p, np.float64)[:2].T


@case(
    "63", FAMILY, unit="of the bound",
    sweep=("angular radius", (0.3, 0.1, 0.03, 0.01)), tolerance=1, why=NOISE, source="Lambert1760",
)  # fmt: skip
def eclipse(a):
    """The irradiance from a sphere partly covered by another; by the textbook with flat circles."""
    b, g = a * 2 / 3, a * 5 / 6
    lamp = shining({"type": "sphere", "center": [0, 0, 1], "radius": math.sin(a)})
    moon = np.float32([0.5 * math.sin(g), 0, 0.5 * math.cos(g)])
    moon = {"type": "sphere", "center": moon.tolist(), "radius": 0.5 * math.sin(b)}
    things = floor(lamp=lamp, moon=moon, sensor=look_down(0, 1e-4, 0.1))
    whole = np.pi * math.sin(a) ** 2
    flat = circle.lens_area(*(mi.Float(x) for x in (a, b, g)))[0] / (np.pi * a * a)
    return _beyond_noise(things, whole - _common(a, b, g), whole, 1 << 18, more=1, plain=whole * (1 - flat))


def _common(a, b, g):
    """The projected solid angle of what circles of radii a, around the normal, and b have in common, g apart.

    The integral of n . (r x dr) / 2 along both arcs; [Lambert1760] for polygons.
    """
    x = (math.cos(b) - math.cos(g) * math.cos(a)) / math.sin(g)
    y = math.sqrt(1 - x * x - math.cos(a) ** 2)
    first = math.atan2(y, x)
    second = math.atan2(y, (math.cos(a) - math.cos(g) * math.cos(b)) / math.sin(g))
    arc = second * math.sin(b) ** 2 * math.cos(g) - math.sin(b) * math.cos(b) * math.sin(second) * math.sin(g)
    return first * math.sin(a) ** 2 + arc


@case(
    "64", FAMILY, unit="relative",
    sweep=("e", (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)), tolerance=40 * U,
    why="10 roundings of the angle, thrice in its cube, and 10 more", source="OgitaRumpOishi2005",
)  # fmt: skip
def lens_of_two_circles(e):
    """The area in which two circles of radius 1 overlap, 2 - e apart."""
    d = np.float32(2 - e)
    exact = np.longdouble(d)
    truth = 2 * np.arccos(exact / 2) - exact / 2 * np.sqrt((2 - exact) * (2 + exact))
    forms = circle.lens_area, circle.textbook_lens_area
    return Errors(
        *(np.float64(np.array(form(mi.Float(1), mi.Float(1), mi.Float(d))) / truth - 1) for form in forms)
    )


@case(
    "R13", FAMILY, unit="relative", sweep=("opacity", (0.25, 0.5, 0.75)), tolerance=32 * U,
    why="the straight way is weakened by 1 - opacity; the light's square law, the cosine and a dozen roundings",
    source="the square law",
)  # fmt: skip
def point_light_behind_a_mask(opacity):
    """The radiance of a floor under a point light with a mask between; textbook: shadow rays stop at any surface."""
    from whitted.passes import render

    to_world = mi.ScalarTransform4f().look_at([3, 0, 0.5], [0, 0, 0], [0, 0, 1])
    film = {
        "type": "hdrfilm",
        "width": 1,
        "height": 1,
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    bsdf = {"type": "mask", "opacity": opacity, "nested": {"type": "diffuse"}}
    pane = mi.ScalarTransform4f().translate([0, 0, 1]).scale(0.3)
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "fov": 0.01, "to_world": to_world, "film": film},
            "floor": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.5}},
            "pane": {"type": "rectangle", "to_world": pane, "bsdf": bsdf},
            "light": {"type": "point", "position": [0, 0, 2], "intensity": 3.0},
        },
        optimize=False,
    )
    truth = (1 - np.float64(np.float32(opacity))) * 0.5 / np.pi * 3 / 4

    def error(integrator):
        return np.abs(render(scene, integrator, spp=4).mean / truth - 1).max()

    ours = [error({"type": name, "max_depth": 3}) for name in ("whitted", "distribution")]
    return Errors(max(ours), 1.0, error({"type": "path", "max_depth": 3}))
