"""Rays and spheres: far ones, tiny ones, huge ones, grazed ones, and rays that begin on or inside them."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.geometry import sphere
from whitted.hardcases.arrays import U, vector
from whitted.hardcases.case import Errors, case
from whitted.offsets import Offsets

FAMILY = "spheres"
RAYS = 1 << 15


def aimed(distance, reach, seed=0):
    """Rays from ``distance`` towards points beside the centre of a unit sphere at 0: o, d (``float32`` [3, N])."""
    rng = np.random.default_rng(seed)
    o = rng.standard_normal((3, RAYS))
    o = np.float32(distance * o / np.linalg.norm(o, axis=0))
    side = np.cross(o, rng.standard_normal((3, RAYS)), axis=0)
    target = reach * np.sqrt(rng.random(RAYS)) * side / np.linalg.norm(side, axis=0)
    d = target - np.float64(o)
    return o, np.float32(d / np.linalg.norm(d, axis=0))


def truth(o, d, radius=1.0):
    """The two distances to a sphere at 0 and the closest approach, ``longdouble``; NaN where the line misses."""
    o, d = np.longdouble(o), np.longdouble(d)
    a, b = (d * d).sum(0), -(o * d).sum(0)
    closest = np.sqrt(((o + b / a * d) ** 2).sum(0))
    half = np.sqrt((radius - closest) * (radius + closest) / a)
    return b / a - half, b / a + half, closest


def textbook(o, d, radius=1.0):
    """The distances by the textbook form, ``float64`` [2, N]."""
    return np.float64(sphere.textbook_roots(vector(o), vector(d), 0, mi.Float(radius)))


def ours(o, d, radius=1.0):
    """The distances by ours, likewise."""
    return np.float64(sphere.roots(vector(o), vector(d), 0, mi.Float(radius)))


def mitsuba(o, d, radius=1.0):
    """The first distance by Mitsuba's shape, ``float64`` [N]; infinite where it is missed."""
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere", "radius": float(radius)}})
    return np.float64(scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(np.float32(o)), vector(d))).t)


@case(
    "1", FAMILY, unit="of the bound",
    sweep=("distance", (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)), tolerance=1,
    why="roundings of the distance D: 2 u D, and in the half chord h, 4 u D / h; where the hit is certain",
    source="HainesEtAl2019",
)  # fmt: skip
def far_sphere(distance):
    """The first hit on a sphere of radius 1."""
    o, d = aimed(distance, 0.99)
    near, _, closest = truth(o, d)
    certain = closest < 1 - 4 * U * distance
    half = np.sqrt(np.maximum(1 - closest**2, U))
    bound = np.float64(2 * U * distance + 4 * U * distance / half)
    forms = textbook(o, d)[0], ours(o, d)[0], mitsuba(o, d)
    plain, stable, reference = ((np.abs(found - near) / bound)[certain] for found in forms)
    return Errors(ours=stable, textbook=plain, reference=reference)


@case(
    "1", FAMILY, unit="of the rays",
    sweep=("distance", (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)), tolerance=0,
    why="beyond the roundings of the closest approach the answer is certain", source="HainesEtAl2019",
)  # fmt: skip
def far_sphere_is_hit(distance):
    """Whether a sphere of radius 1 is hit, where it isn't within 4 u D of its rim."""
    o, d = aimed(distance, 1.095)
    _, _, closest = truth(o, d)
    certain = np.abs(closest - 1) > 4 * U * distance
    expected = closest < 1
    forms = np.isfinite(textbook(o, d)[0]), np.isfinite(ours(o, d)[0]), np.isfinite(mitsuba(o, d))
    plain, stable, reference = (np.mean((found != expected)[certain]) for found in forms)
    return Errors(ours=stable, textbook=plain, reference=reference)


@case(
    "2", FAMILY,
    unit="of the bound", sweep=("e", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)), tolerance=1,
    why="4 u D r / h", source="HainesEtAl2019",
)  # fmt: skip
def grazed_sphere(inside):
    """The half chord of a ray that passes inside by a share e of the radius, at distance 10."""
    rng = np.random.default_rng(1)
    o, _ = aimed(10.0, 0.0)
    side = np.cross(o, rng.standard_normal((3, RAYS)), axis=0)
    target = (1 - inside) * side / np.linalg.norm(side, axis=0)
    # Aimed so that the closest approach, not the point in the centre's plane, is at 1 - e
    sine = (1 - inside) / 10.0
    d = target / np.sqrt(1 - sine**2) - np.float64(o)
    d = np.float32(d / np.linalg.norm(d, axis=0))
    near, far, _ = truth(o, d)
    met = np.isfinite(near) & (far - near > 8 * np.sqrt(U * 10))
    half = (far - near) / 2
    bound = 4 * U * 10 / half
    plain, stable = (
        np.abs((found[1] - found[0]) / 2 - half) / bound for found in (textbook(o, d), ours(o, d))
    )
    return Errors(ours=stable[met], textbook=plain[met])


@case(
    "3", FAMILY, unit="of the bound",
    sweep=("radius", (1e3, 1e4, 1e5, 1e6)), tolerance=1,
    why="4 u (1 + t_far / t): roundings of the far root are as large against the near one", source="HainesEtAl2019",
)  # fmt: skip
def ground_of_a_planet(radius):
    """The ground, a sphere of radius r, below an eye at height 1."""
    pitch = np.radians(np.random.default_rng(2).uniform(5, 80, RAYS))
    d = np.float32([np.cos(pitch), -np.sin(pitch), 0 * pitch])
    o = np.float32(np.broadcast_to([[0.0], [radius + 1], [0.0]], d.shape))
    near, far, _ = truth(o, d, np.longdouble(radius))
    bound = np.float64(4 * U * (near + far))
    forms = textbook(o, d, radius)[0], ours(o, d, radius)[0], mitsuba(o, d, radius)
    plain, stable, reference = (np.abs(found - near) / bound for found in forms)
    return Errors(ours=stable, textbook=plain, reference=reference)


@case(
    "4", FAMILY, unit="of the bound",
    sweep=("radius", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)), tolerance=1,
    why="2 u D + 4 u D r / h, as for a far sphere", source="HainesEtAl2019",
)  # fmt: skip
def tiny_sphere(radius):
    """The first hit on a sphere of radius r at distance 1."""
    o, d = aimed(1 / radius, 0.99)
    o = np.float32(o * np.float64(radius))
    near, _, closest = truth(o, d, np.longdouble(np.float32(radius)))
    met = closest < 0.99 * radius
    bound = np.float64(2 * U + 4 * U / np.sqrt(1 - np.minimum(closest / radius, 0.999) ** 2))
    forms = textbook(o, d, radius)[0], ours(o, d, radius)[0], mitsuba(o, d, radius)
    plain, stable, reference = ((np.abs(found - near) / bound)[met] for found in forms)
    return Errors(ours=stable, textbook=plain, reference=reference)


@case(
    "5", FAMILY, unit="of the rays",
    sweep=("radius", (1e-6, 1e-3, 1.0, 1e3, 1e6)), tolerance=0,
    why="it doesn't; more precision removes no such hit, an offset by the bound of the errors does",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def leaving_a_sphere(radius):
    """Whether a ray that leaves a sphere meets it again."""
    scene, si, out = surface_of_a_ball(radius)
    plain = sphere.textbook_roots(si.p, out, 0, mi.Float(radius))[1] > 0
    stable = scene.ray_test(mi.Ray3f(Offsets(scene).origin(si, out), out))
    reference = scene.ray_test(si.spawn_ray(out))
    return Errors(*(np.mean(np.array(found)) for found in (stable, plain, reference)))


@case(
    "6", FAMILY, unit="of the bound",
    sweep=("radius", (1e-6, 1e-3, 1.0, 1e3, 1e6)), tolerance=1,
    why="48 u r / cos: the origin is moved by 6 (sqrt 3 + 4) u r and an ulp, and o + t d is rounded",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def entering_a_sphere(radius):
    """Where a ray that enters a sphere leaves it."""
    scene, si, out = surface_of_a_ball(radius)
    cosine = np.array(dr.dot(si.n, out), np.float64)
    bound = 48 * U * radius / cosine
    exit_at = np.array(si.p, np.float64) - 2 * radius * cosine * np.array(out, np.float64)

    def error(ray):
        met = scene.ray_intersect_preliminary(ray)
        p = np.array(ray.o + ray.d * met.t, np.float64)
        return np.linalg.norm(p - exit_at, axis=0) / bound

    return Errors(
        ours=error(mi.Ray3f(Offsets(scene).origin(si, -out), -out)), reference=error(si.spawn_ray(-out))
    )


@case(
    "7", FAMILY, unit="relative",
    sweep=("place", (0.999, 0.5, 0.0, -0.5, -0.999)), tolerance=lambda place: 16 * U,
    why="Vieta: t_0 t_1 = C, and 16 roundings", source="HainesEtAl2019",
)  # fmt: skip
def inside_a_sphere(place):
    """Both distances from inside, their product against |o|^2 - r^2."""
    rng = np.random.default_rng(4)
    d = rng.standard_normal((3, RAYS))
    d = np.float32(d / np.linalg.norm(d, axis=0))
    o = np.float32(np.broadcast_to([[0.0], [place], [0.0]], d.shape))
    near, far, _ = truth(o, d)
    return Errors(*(np.abs(found[0] * found[1] / (near * far) - 1) for found in (ours(o, d), textbook(o, d))))


@case(
    "8, R10", FAMILY, unit="radii",
    sweep=("distance", (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)), tolerance=2 * U + 2 * U,
    why="2 u of the radius, and as many of the centre, once the point is put back on the sphere",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def point_on_a_far_sphere(distance):
    """How far a hit lies off a sphere of radius 1."""
    o, d = aimed(distance, 0.9)
    t = mi.Float(np.float32(ours(o, d)[0]))
    p = vector(o) + vector(d) * t
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere"}})
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(o), vector(d)))
    forms = sphere.on_surface(p, mi.Vector3f(0), 1), p, si.p
    return Errors(*(np.linalg.norm(np.array(found, np.float64), axis=0) - 1 for found in forms))


def surface_of_a_ball(radius):
    """A ball around 0, points on it (``SurfaceInteraction3f``), and directions outwards at cosines from 0.01 on."""
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere", "radius": float(radius)}})
    o, d = aimed(4.0, 0.9)
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(np.float32(o * radius)), vector(d)))
    rng = np.random.default_rng(3)
    cosine, phi = rng.uniform(0.01, 1, RAYS), rng.uniform(0, 2 * np.pi, RAYS)
    sine = np.sqrt(1 - cosine**2)
    out = mi.Frame3f(si.n).to_world(vector([sine * np.cos(phi), sine * np.sin(phi), cosine]))
    return scene, si, dr.normalize(out)
