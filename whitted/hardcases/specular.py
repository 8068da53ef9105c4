"""Rays that are traced through glass and between mirrors: slabs, balls, rainbows, boxes and halls of mirrors."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import optics
from whitted.geometry import plane, sphere
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.reflection import FAMILY, GLASS, LANES, exact
from whitted.sampling.draws import SamplerDraws
from whitted.world import World

REFLECTION, TRANSMISSION = range(2)  # the lobes of glass
FEW = 1 << 10


def estimate(scene, o, d, **parameters):
    """What an integrator of ours finds along rays (``float32`` [3, N]), a dict of ``float64`` arrays."""
    integrator, sampler = mi.load_dict(parameters), mi.load_dict({"type": "independent"})
    sampler.seed(0, o.shape[1])
    world = integrator.world(scene)
    ray = mi.Ray3f(mi.Point3f(o), mi.Vector3f(d))
    found = integrator.estimate(world, ray, SamplerDraws(sampler), integrator.plan(world))
    dr.eval(found)  # in one kernel
    return {name: np.float64(np.array(value)) for name, value in found.items()}


def follow(world, ray, lobes, spawn=None):
    """Follow one lobe at each surface met; return the last ray, which has left, and where nothing was missed.

    ``spawn``: function of ``SurfaceInteraction3f``, ``Ray3f`` and the local direction of the lobe to the next ray.
    """
    spawn = spawn or (lambda si, ray, wo: world.spawn(si, si.to_world(wo)))
    met = mi.Bool(True)
    for lobe in lobes:
        si = world.intersect(ray, mi.Bool(False), mi.Bool(True))
        met &= si.is_valid()
        ray = spawn(si, ray, world.delta_lobes(si, si.is_valid())[lobe][0])
        dr.eval(ray, met)  # so that one kernel serves all surfaces
    return ray, np.array(met)


def glass(index=GLASS):
    """Glass in a vacuum."""
    return {"type": "dielectric", "int_ior": float(index), "ext_ior": 1.0}


def sheet(z, size, turn=0, **rest):
    """A square across the z axis that faces up, or turned by 180 degrees down."""
    T = mi.ScalarTransform4f
    to_world = T().translate([0, 0, float(z)]) @ T().scale([size, size, 1]) @ T().rotate([1, 0, 0], turn)
    return {"type": "rectangle", "to_world": to_world} | rest


def slab(thickness, size):
    """Shapes of a slab of glass under z = 1, and its thickness as rounded."""
    back = np.float32(1 - thickness)
    shapes = {"front": sheet(1, size, bsdf=glass()), "back": sheet(back, size, 180, bsdf=glass())}
    return shapes, 1 - np.float64(back)


def downwards(angle):
    """Unit vectors that lead down at an angle (radians [N]) to the vertical, ``float32`` [3, N]."""
    return np.float32([np.sin(angle), 0 * angle, -np.cos(angle)])


# ---- Glass


@case(
    "31", FAMILY, unit="of the bound", sweep=("radius", (1e-3, 1.0, 100.0)), tolerance=1,
    why="12 u of the direction in each of the frames, over the way left, and two roundings of points",
    source="geometry",
)  # fmt: skip
def ball_of_no_contrast(radius):
    """Where a ray arrives 1000 behind a ball of index 1."""
    scene = mi.load_dict(
        {"type": "scene", "ball": {"type": "sphere", "radius": float(radius), "bsdf": glass(1)}}
    )
    rng = np.random.default_rng(31)
    o = np.float32([*(0.5 * radius * rng.uniform(-1, 1, (2, FEW))), np.full(FEW, 2 * radius)])
    d = downwards(rng.uniform(-0.1, 0.1, FEW))
    errors = []
    for rule in ("bound", "mitsuba"):
        world = World(scene, False, rule)
        ray, met = follow(world, mi.Ray3f(mi.Point3f(o), mi.Vector3f(d)), (TRANSMISSION,) * 2)
        p, v = np.array(ray.o, np.float64), np.array(ray.d, np.float64)
        p, v = p + v * ((-1000 - p[2]) / v[2]), np.float64(d)
        expected = o + v * ((-1000 - np.float64(o[2])) / v[2])
        error = np.linalg.norm(p - expected, axis=0) / (U * (24 * 1000 + 8 * radius))
        errors.append(np.where(met, error, np.inf))
    return Errors(ours=errors[0], reference=errors[1])


@case(
    "34", FAMILY, unit="of the bound", sweep=("thickness", (0.5, 1e-2, 1e-4, 1e-5)), tolerance=1,
    why="two origins beside the surface by 8 u |p| each, three roundings of points, 8 u of the direction inside",
    source="geometry",
)  # fmt: skip
def displacement_by_a_slab(thickness):
    """By how much a slab of glass at a distance of 1 shifts a ray, up to 85 degrees."""
    shapes, exactly = slab(thickness, 1)
    scene = mi.load_dict({"type": "scene"} | shapes)
    angle = np.random.default_rng(34).uniform(0.1, np.radians(85), LANES)
    d = downwards(angle)
    o = np.float32([-0.05 * np.tan(angle), 0 * angle, np.full(LANES, 1.05)])
    v = np.float64(d) / np.linalg.norm(np.float64(d), axis=0)
    sine = np.hypot(v[0], v[1])
    truth = exactly * sine * (1 + v[2] / np.sqrt(np.float64(GLASS) ** 2 - sine**2))

    def textbook_spawn(si, ray, _):
        inside = si.wi.z < 0
        n, eta = (
            dr.mulsign(mi.Vector3f(si.n), si.wi.z),
            dr.select(inside, 1 / mi.Float(GLASS), mi.Float(GLASS)),
        )
        direction = optics.textbook_refract(ray.d, n, eta)
        return mi.Ray3f(si.p + 1e-4 * direction, direction)  # begins a little ahead

    def error(rule, spawn=None):
        ray, met = follow(
            World(scene, False, rule), mi.Ray3f(mi.Point3f(o), mi.Vector3f(d)), (TRANSMISSION,) * 2, spawn
        )
        way = np.array(ray.o, np.float64) - o
        shift = np.linalg.norm(way - v * (way * v).sum(0), axis=0)
        return np.where(met, (shift - truth) / (U * (24 + 8 * thickness)), np.inf)

    return Errors(error("bound"), error("bound", textbook_spawn), error("mitsuba"))


@case(
    "35", FAMILY, unit="of the light", sweep=("angle", (0.0, 30.0, 60.0, 80.0, 85.0)), tolerance=32 * U,
    why="R to 4 u four times in the series, whose terms have 3 roundings each", source="the geometric series",
)  # fmt: skip
def slab_in_a_picture(angle):
    """The light behind a slab of glass, by a tree of depth 64."""
    shapes, _ = slab(0.1, 1e3)
    lamp = sheet(-1, 1e3, emitter={"type": "area", "radiance": 1.0})
    scene = mi.load_dict({"type": "scene", "lamp": lamp} | shapes)
    d = downwards(np.radians(np.random.default_rng(35).uniform(angle - 1, angle, FEW)))
    o = np.float32(np.broadcast_to([[0.1], [0.3], [2.0]], d.shape))
    R, T = exact(np.float64(-d[2]) / np.linalg.norm(np.float64(d), axis=0), GLASS)
    found = estimate(scene, o, d, type="whitted", max_depth=64, min_contribution=0.0)
    return Errors(ours=found["radiance"] - T / (1 + R))


def furnace(**shapes):
    """Shapes in an environment of radiance 1."""
    return mi.load_dict({"type": "scene", "sky": {"type": "constant", "radiance": 1.0}} | shapes)


def glass_ball(depth, cutoff):
    """What a tree finds and gives up in a glass ball in a furnace, and the cosines of incidence."""
    reach = np.linspace(0, 0.999, FEW)
    d = np.float32(np.broadcast_to([[0.0], [0.0], [-1.0]], (3, FEW)))
    o = np.float32([reach, 0 * reach, 0 * reach + 2])
    scene = furnace(ball={"type": "sphere", "bsdf": glass()})
    found = estimate(scene, o, d, type="whitted", max_depth=depth, min_contribution=cutoff)
    return found, np.sqrt(1 - np.longdouble(o[0]) ** 2)


@case(
    "36", FAMILY, unit="of the light", sweep=("depth", (2, 4, 8, 50, 128)), tolerance=16 * U,
    why="R + T is 1 to a rounding, and three more at each surface, of which light meets 1 / (1 - R) < 4",
    source="HallGreenberg1983",
)  # fmt: skip
def glass_ball_in_a_furnace(depth):
    """What a tree of rays in a glass ball finds in a furnace, and what it reports as left out, together."""
    found, _ = glass_ball(depth, 1 / 1024)
    lost = found["dropped_by_depth"] + found["dropped_by_cutoff"]
    return Errors(ours=found["radiance"] + lost - 1, textbook=found["radiance"] - 1)


@case(
    "36", FAMILY, unit="of the bound", sweep=("depth", (2, 4, 8, 16, 50)), tolerance=1,
    why="rays begin beside the surface, up to 25 u nearer to the centre at each: what R changes at cosines that are off"
    " by 25 k u / cos; and R to 8 u, and two products, at each surface",
    source="the geometric series",
)  # fmt: skip
def what_a_tree_leaves_out(depth):
    """The share (1 - R) R^k that a tree reports as left out after k reflections inside a glass ball."""
    found, cos = glass_ball(depth, 0.0)
    k, (R, T) = depth - 2, exact(cos, GLASS)
    off = max(k, 1) * 25 * U / cos
    nearby = [np.abs(exact(np.minimum(cos + sign * off, 1), GLASS)[0] - R) for sign in (-1, 1)]
    truth = T * R**k
    bound = np.maximum(*nearby) * (R**k + k * T * R ** max(k - 1, 0)) + 10 * U * depth * truth + 1e-30
    return Errors(ours=(found["dropped_by_depth"] - truth) / bound)


@case(
    "37", FAMILY, unit="degrees", sweep=("index", (1.331, 1.344)), tolerance=1e-4,
    why="each of three normals is off by 4 u / cos(60 deg), and 5 roundings of directions: 29 u in radians",
    source="Nussenzveig1977",
)  # fmt: skip
def rainbow(index):
    """The angle by which a drop turns the light of the rainbow, pi + 2 i - 4 r."""
    n = np.float64(np.float32(index))
    reach = np.sqrt((4 - n * n) / 3) + np.linspace(-1e-4, 1e-4, FEW)
    turn = np.linalg.qr(np.random.default_rng(37).standard_normal((3, 3)))[0]
    o, d = np.float32(turn[:, 1:2] * reach - 2 * turn[:, :1]), np.float32(turn[:, :1] * np.ones(FEW))
    side = np.cross(np.float64(o), np.float64(d), axis=0)
    reach = np.linalg.norm(side, axis=0) / np.linalg.norm(np.float64(d), axis=0)
    truth = np.pi + 2 * np.arcsin(reach) - 4 * np.arcsin(reach / n)
    scene = mi.load_dict({"type": "scene", "drop": {"type": "sphere", "bsdf": glass(index)}})
    way = TRANSMISSION, REFLECTION, TRANSMISSION

    def error(out):
        a, b = np.float64(d), np.array(out, np.float64)
        return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b, axis=0), axis=0), (a * b).sum(0)) - truth)

    def traced(rule):
        return follow(World(scene, False, rule), mi.Ray3f(mi.Point3f(o), mi.Vector3f(d)), way)[0].d

    return Errors(*map(error, (traced("bound"), _textbook_drop(o, d, index), traced("mitsuba"))))


def _textbook_drop(o, d, index):
    """The direction in which a ray leaves a drop after one reflection inside, by the textbook's forms."""
    o, d, n = mi.Vector3f(o), mi.Vector3f(d), mi.Float(index)
    p = o + d * sphere.textbook_roots(o, d, 0, mi.Float(1))[0]
    d = optics.textbook_refract(d, p, n)
    p = p + d * sphere.textbook_roots(p, d, 0, mi.Float(1))[1]
    d = optics.textbook_reflect(d, -p)
    p = p + d * sphere.textbook_roots(p, d, 0, mi.Float(1))[1]
    return optics.textbook_refract(d, -p, 1 / n)


# ---- Mirrors


REFLECTANCES = (0.9, 0.999, 1.0)
DEEPEST_TREE = 128  # that `whitted` grows


@case(
    "40", FAMILY, unit="relative", sweep=("segments", (50, 1000)), tolerance=lambda segments: segments * U,
    why="a rounding of the sum at each segment; those of the powers are as many, and lower the early ones less",
    source="the geometric series",
)  # fmt: skip
def box_of_mirrors(segments):
    """The radiance in a box of mirrors that shine, of reflectances from 0.9 to 1: (1 - r^k) / (1 - r)."""
    errors = [_error_in_a_box_of_mirrors(reflectance, segments) for reflectance in REFLECTANCES]
    return Errors(*(np.max([np.max(np.abs(one)) for one in form]) for form in zip(*errors, strict=True)))


def _error_in_a_box_of_mirrors(reflectance, segments):
    """The relative errors of ours, the closed sum in single precision, and Mitsuba's."""
    walls = {"type": "cube", "flip_normals": True, "emitter": {"type": "area", "radiance": 1.0}}
    walls["bsdf"] = {"type": "conductor", "material": "none", "specular_reflectance": float(reflectance)}
    scene = mi.load_dict({"type": "scene", "walls": walls, "embree_use_robust_intersections": True})
    d = np.random.default_rng(40).standard_normal((3, FEW))
    d, o = np.float32(d / np.linalg.norm(d, axis=0)), np.zeros((3, FEW), np.float32)
    r = np.float64(np.float32(reflectance))
    truth = (r ** np.arange(segments)).sum()
    limits = {"max_depth": segments, "rr_depth": 2 * segments}
    ours = [estimate(scene, o, d, type="distribution", **limits)["radiance"]]
    if segments <= DEEPEST_TREE:
        tree = estimate(scene, o, d, type="whitted", max_depth=segments, min_contribution=0.0)
        ours.append(tree["radiance"])
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, FEW)
    path = mi.load_dict({"type": "path"} | limits)
    reference = path.sample(scene, sampler, mi.RayDifferential3f(mi.Ray3f(mi.Point3f(o), mi.Vector3f(d))))[0]
    r32 = mi.Float(r)
    textbook = np.array((1 - r32**segments) / (1 - r32))
    return tuple(np.float64(found) / truth - 1 for found in (np.concatenate(ours), textbook, reference))


def hall(form, distance, count, o, d, n):
    """The last point and direction of rays between two parallel mirrors at a distance of 1 from 0, ``float64``."""

    def bounce(k, o, d):
        h = dr.mulsign(mi.Float(1), dr.dot(n, d))
        p = o + d * distance(o, d, n, h)
        return k + 1, p, form(d, n)

    state = (mi.UInt32(0), o, d)
    _, o, d = dr.while_loop(state, lambda k, *_: k < count, bounce, label="hall of mirrors")
    return np.float64(np.array(o)), np.float64(np.array(d))


@case(
    "41", FAMILY, unit="of the bound", sweep=("images", (10, 50, 200, 1000)), tolerance=1,
    why="4 u of the way to the image, at each reflection", source="geometry",
)  # fmt: skip
def hall_of_mirrors(images):
    """Where a ray meets the last of k mirrors, in turn one of two parallel ones."""
    rng = np.random.default_rng(41)
    angle = rng.uniform(0.2, 1.0, FEW)
    n = rng.standard_normal((3, FEW))
    n /= np.linalg.norm(n, axis=0)
    along = np.cross(n, rng.standard_normal((3, FEW)), axis=0)
    along /= np.linalg.norm(along, axis=0)
    d, n = np.float32(along * np.sin(angle) + n * np.cos(angle)), np.float32(n)
    o = np.zeros((3, FEW), np.float32)

    # In exact arithmetic: the way along the mirrors goes on, that between them turns back and forth
    D, N = np.longdouble(d), np.longdouble(n)
    square = (N * N).sum(0)
    across = (D * N).sum(0) / square
    time = (2 * images - 1) / (np.abs(across) * square)
    truth = (D - across * N) * time + np.sign(across) * (-1) ** (images - 1) / square * N
    bound = np.float64(4 * U * images * time * np.sqrt((D * D).sum(0)))
    start = mi.Vector3f(o), mi.Vector3f(d), mi.Vector3f(n)
    forms = (optics.reflect, plane.distance), (optics.textbook_reflect, plane.textbook_distance)
    return Errors(*(np.linalg.norm(hall(*form, images, *start)[0] - truth, axis=0) / bound for form in forms))


@case(
    "41", FAMILY, unit="relative", sweep=("images", (10, 50, 200, 1000)), tolerance=lambda images: 8 * U * images,
    why="2 u of the axes into which and out of which a direction is turned, and 4 roundings, at each",
    source="geometry",
)  # fmt: skip
def length_of_a_direction(images):
    """By how much a ray's direction gets longer or shorter between two tilted mirrors."""
    T = mi.ScalarTransform4f
    tilt = T().rotate([1, 2, 3], 40)
    mirror = {"type": "conductor", "material": "none"}
    shapes = {
        name: {"type": "rectangle", "bsdf": mirror}
        | {
            "to_world": tilt
            @ T().rotate([1, 0, 0], turn)
            @ T().translate([0, 0, -1])
            @ T().scale([1e4, 1e4, 1])
        }
        for name, turn in (("floor", 0), ("ceiling", 180))
    }
    world = World(mi.load_dict({"type": "scene"} | shapes))
    angle = np.random.default_rng(42).uniform(0.2, 1.0, FEW)
    d = mi.ScalarTransform4f(tilt).matrix
    d = np.float32(np.array(d, np.float64).reshape(4, 4)[:3, :3] @ np.float64(downwards(angle)))
    ray = mi.Ray3f(mi.Point3f(0), mi.Vector3f(d))

    def bounce(k, ray):
        si = world.intersect(ray, mi.Bool(False), mi.Bool(True))
        return k + 1, world.spawn(si, si.to_world(world.delta_lobes(si, si.is_valid())[0][0]))

    _, ray = dr.while_loop((mi.UInt32(0), ray), lambda k, _: k < images, bounce, label="hall of mirrors")
    lengths = np.linalg.norm(np.array(ray.d, np.float64), axis=0), np.linalg.norm(np.float64(d), axis=0)
    return Errors(ours=lengths[0] / lengths[1] - 1)
