"""Lights seen from a point: very small, very near, touched, cut by the horizon; by closed form and by samples.

Samples are taken at fixed points of the unit square, so that nothing here is noise but what is called so. A peak
between the points is missed, as it is by so many samples: then the spread of what has it comes out too small.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.geometry import solidangle
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.lamps import Lamp, gauss, lambert, lattice, receiver, spread, vector
from whitted.lights import polygon

FAMILY = "lights"
RAYS = 1 << 14
POINTS = 256  # to a side of the square that estimates are taken at
UP = (0.0, 0.0, 1.0)
SLANT = np.array([0.36, -0.48, 0.8])  # unit, towards a light that isn't along an axis
# The relative standard deviation of a cosine that is uniform between 0 and 1, as it is by solid angle
UNIFORM = 3**-0.5


def transform():
    """The identity, to be gone on from."""
    return mi.ScalarTransform4f()


def normals_at(cosines, seed):
    """Unit vectors (``float32`` [3, N]) at these cosines to `SLANT`, and their cosines as rounded, ``longdouble``."""
    side = np.cross(SLANT[:, None], np.random.default_rng(seed).standard_normal((3, len(cosines))), axis=0)
    side /= np.linalg.norm(side, axis=0)
    n = np.float32(cosines * SLANT[:, None] + np.sqrt(1 - cosines**2) * side)
    exact = np.longdouble(n)
    return n, (exact * np.longdouble(np.float32(SLANT))[:, None]).sum(0) / np.sqrt((exact**2).sum(0))


# ---- Spheres


def _small_sphere(radius):
    """A sphere along `SLANT`, a receiver's normal, the irradiance, and the squared sine and the cosine."""
    n, cosine = normals_at(np.array([0.9]), seed=48)
    centre = np.longdouble(np.float32(SLANT))
    distance2 = (centre**2).sum()
    sine2, cosine = np.longdouble(np.float32(radius)) ** 2 / distance2, cosine[0] / np.sqrt(distance2)
    lamp = Lamp({"type": "sphere", "center": np.float32(SLANT).tolist(), "radius": radius})
    return lamp, n, np.float64(np.pi * sine2 * cosine), (float(sine2), float(cosine))


@case(
    "48, R1", FAMILY, unit="relative",
    sweep=("radius over distance", (0.3, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5)), tolerance=32 * U,
    why="10 roundings of the squared sine, 7 of each cosine over 0.9, 6 of the rest", source="ShirleyWangZimmerman1996",
)  # fmt: skip
def small_sphere_light(radius):
    """The irradiance from a sphere, which is that of a point whatever its radius, as the mean of samples."""
    lamp, n, E, (sine2, cosine) = _small_sphere(radius)
    omega, cos_cap = solidangle.textbook_sphere(mi.Float(np.float32(sine2)))
    plain = np.array(omega * (1 + cos_cap) / 2, np.float64) * cosine
    u = lattice(POINTS)
    found = (form([0, 0, 0], n, u).mean() for form in (lamp.estimates, lamp.estimates_of_mitsuba))
    stable, reference = (mean / E - 1 for mean in found)
    return Errors(stable, plain / E - 1, reference)


@case(
    "48", FAMILY, unit="relative",
    sweep=("radius over distance", (0.3, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5)), tolerance=32 * U,
    why="none, if samples follow the cosine, but these roundings", source="UrenaGeorgiev2018",
)  # fmt: skip
def noise_of_a_sphere_light(radius):
    """The spread of the samples of a sphere above the horizon."""
    lamp, n, E, _ = _small_sphere(radius)
    forms = lamp.estimates, lamp.estimates_by_area, lamp.estimates_of_mitsuba
    return Errors(*(spread(form([0, 0, 0], n, lattice(POINTS)), E) for form in forms))


def sphere_irradiance(sine, cosine):
    """The textbook form in ``longdouble``; ``sine`` at most 1."""
    sine, cosine = np.broadcast_arrays(np.longdouble(sine), cosine)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine_n = np.sqrt(1 - cosine**2)
        x = np.sqrt(1 / sine**2 - 1)
        y = -x * cosine / sine_n
        q = sine_n * np.sqrt(1 - y * y)
        cut = sine**2 * (cosine * np.arccos(y) - x * q) + np.arctan2(q, x)
    pi = np.arccos(np.longdouble(-1))
    return np.where(np.abs(cosine) < sine, cut, pi * sine**2 * np.maximum(cosine, 0))


@case(
    "49", FAMILY, unit="of pi sin^2",
    sweep=("distance over radius", (1.01, 1.5, 2.0, 1e1, 1e2, 1e3, 1e4)), tolerance=32 * U,
    why="10 u of the squared sine, 5 u of the cosine, 13 u of Dr.Jit's arc tangent", source="Lambert1760",
)  # fmt: skip
def sphere_cut_by_the_horizon(distance):
    """The irradiance from a sphere of which part is below the horizon."""
    share = np.random.default_rng(49).uniform(-0.999, 0.999, RAYS)
    n, cosine = normals_at(share / distance, seed=49)
    centre = np.float32(distance * SLANT)
    exact = np.longdouble(centre)
    length = np.sqrt((exact**2).sum())
    cosine = (np.longdouble(n) * exact[:, None]).sum(0) / length / np.sqrt((np.longdouble(n) ** 2).sum(0))
    truth, whole = sphere_irradiance(1 / length, cosine), np.pi / length**2
    plain = solidangle.textbook_sphere_irradiance(
        mi.Float(np.float32(1 / length)), mi.Float(np.float32(cosine))
    )
    stable = Lamp({"type": "sphere", "center": centre.tolist()}).irradiance([0, 0, 0], n)
    return Errors(*(np.float64((found - truth) / whole) for found in (stable, np.array(plain, np.float64))))


@case(
    "50", FAMILY, unit="relative",
    sweep=("place", (0.0, 0.5, 0.9, 0.99, 0.999)), tolerance=64 * U,
    why="16 u over the cosine, whose reciprocal has a root mean square below 4 at these points",
    source="ShirleyWangZimmerman1996",
)  # fmt: skip
def noise_inside_a_sphere(place):
    """The spread of samples of the irradiance pi at a share of the radius from the middle of a lit sphere."""
    lamp = Lamp({"type": "sphere", "flip_normals": True})
    forms = lamp.estimates, lamp.estimates_by_area, lamp.estimates_of_mitsuba
    return Errors(*(spread(form([0, 0, place], UP, lattice(POINTS)), np.pi) for form in forms))


@case(
    "51", FAMILY, unit="of the bound",
    sweep=("distance from the surface", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 0.0)), tolerance=1,
    why="32 u pi, and what roundings of the distance by 4 u change: the limit goes as its square root",
    source="Lambert1760",
)  # fmt: skip
def touched_sphere_light(height):
    """The irradiance from a sphere at a point that all but touches it, or touches it."""
    cosine = np.random.default_rng(51).uniform(-1, 1, RAYS)
    n = np.float32([np.sqrt(1 - cosine**2), 0 * cosine, cosine])
    exact = np.longdouble(n)
    cosine = exact[2] / np.sqrt((exact**2).sum(0))
    distance = np.longdouble(np.float32(1 + height))
    sines = [np.minimum(1 / (distance * (1 + k * U)), 1) for k in (0, -4, 4)]
    truth, *around = (sphere_irradiance(sine, cosine) for sine in sines)
    bound = 32 * U * np.pi + np.maximum(*(np.abs(other - truth) for other in around))
    stable = Lamp({"type": "sphere", "center": [0, 0, float(distance)]}).irradiance([0, 0, 0], n)
    sine = 1 / mi.Float(np.float32(distance)) * (1 + 2 * U)  # as it may come out of rounding
    plain = np.array(solidangle.textbook_sphere_irradiance(sine, mi.Float(np.float32(cosine))), np.float64)
    return Errors(*(np.float64((found - truth) / bound) for found in (stable, plain)))


# ---- Rectangles and polygons


@case(
    "52", FAMILY, unit="relative",
    sweep=("distance", (1e-1, 1.0, 1e1, 1e2, 1e3, 1e4)), tolerance=32 * U,
    why="13 u of Dr.Jit's arc tangent, 19 u of positive terms: no difference of angles",
    source="VanOosteromStrackee1983",
)  # fmt: skip
def solid_angle_of_a_rectangle(height):
    """The solid angle of a square of side 1, as the mean of one over the density of samples."""
    rng = np.random.default_rng(52)
    p = np.float32([*rng.uniform(-1, 1, (2, 32)), np.full(32, height)])
    sides = [np.longdouble(s) - np.longdouble(p[k]) for k in (0, 1) for s in (-0.5, 0.5)]
    truth = rectangle_solid_angle(*sides, np.longdouble(p[2]))
    plain = solidangle.textbook_rectangle(*(mi.Float(np.float32(x)) for x in sides), mi.Float(p[2]))
    lamp = Lamp({"type": "rectangle", "to_world": transform().scale(0.5)})
    u, weight = gauss(128)
    p, u = np.repeat(p, dr.width(u), axis=1), mi.Point2f(np.tile(np.array(u), p.shape[1]))
    densities = lamp.sample(p, (0, 0, 0), u).pdf, lamp.emitter.sample_direction(receiver(p), u)[0].pdf
    means = ((1 / np.array(pdf, np.float64)).reshape(-1, len(weight)) @ weight for pdf in densities)
    stable, reference = (np.float64(mean / truth - 1) for mean in means)
    return Errors(stable, np.float64(np.array(plain) / truth - 1), reference)


def rectangle_solid_angle(x0, x1, y0, y1, z):
    """The sum of the corners' angles, ``longdouble``."""

    def corner(x, y):
        return np.arctan2(x * y, z * np.sqrt(x * x + y * y + z * z))

    return corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)


def _squares(size, tilts, seed):
    """Squares of a side with a corner at distance 1, and normals (``float32`` [3, N]); lists of four corners [3, N].

    Args:
        tilts: where the receivers' normals are, as multiples of ``size`` over their horizon; None: anywhere.
    """
    rng = np.random.default_rng(seed)
    way, normal, n = (x / np.linalg.norm(x, axis=0) for x in rng.standard_normal((3, 3, RAYS)))
    if tilts is not None:
        n -= (n * way).sum(0) * way
        n += size * rng.uniform(*tilts, RAYS) * way
        n /= np.linalg.norm(n, axis=0)
    x = np.cross(normal, way, axis=0)
    x *= size / np.linalg.norm(x, axis=0)
    y = np.cross(normal, x, axis=0)
    return [np.float32(way + a * x + b * y) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32(n)


def _seen(corners, n):
    """The cosine of the receiver's normal to squares, and that of theirs."""
    middle = np.float64(sum(corners)) / 4
    normal = np.cross(np.float64(corners[1] - corners[0]), np.float64(corners[3] - corners[0]), axis=0)
    middle /= np.linalg.norm(middle, axis=0)
    return (middle * n).sum(0), np.abs((middle * normal).sum(0)) / np.linalg.norm(normal, axis=0)


@case(
    "53", FAMILY, unit="of the bound",
    sweep=("size over distance", (1.0, 0.3, 1e-1, 1e-2, 1e-3, 1e-4)), tolerance=1,
    why="16 u over both cosines; of large ones 16 u of the angles that are summed, 13 u the arc tangent's",
    source="Lambert1760",
)  # fmt: skip
def square_light(size):
    """The irradiance from a square in closed form."""
    corners, n = _squares(size, None, seed=53)
    cosine, cosine_there = _seen(corners, n)
    # Neither so flat that the rounding of its corners makes it another one, nor cut by the horizon
    kept = (cosine_there > 0.1) & (np.min([(n * corner).sum(0) for corner in corners], axis=0) > 0.1)
    corners, n = [corner[:, kept] for corner in corners], n[:, kept]
    truth, angles = lambert(corners, n)
    bound = 16 * U / (cosine * cosine_there)[kept] + (16 * U * angles / truth if size > 0.25 else 0)
    return _polygons(corners, n, truth, bound * truth)


@case(
    "58", FAMILY, unit="of the bound",
    sweep=("size over distance", (1.0, 0.3, 1e-1, 1e-2, 1e-3, 1e-4)), tolerance=1,
    why="16 u of what a surface that faces it receives; of large ones 16 u of the angles that are summed, and over the "
    "distance of the nearest point, since corners are rounded to u",
    source="Lambert1760",
)  # fmt: skip
def square_cut_by_the_horizon(size):
    """The irradiance from a square of which part is below the horizon; by the textbook from all of it."""
    corners, n = _squares(size, (-0.7, 0.7), seed=58)
    truth, angles = lambert(corners, n)
    large = 16 * U * angles / np.minimum(_nearest(corners), 1) if size > 0.25 else 0
    return _polygons(corners, n, truth, 16 * U * min(np.pi, size**2) + large)


def _nearest(corners):
    """The distance of squares from 0."""
    o, *sides = (np.float64(corners[0]), *(np.float64(corners[k] - corners[0]) for k in (1, 3)))
    for side in sides:
        o = o + side * np.clip(-(o * side).sum(0) / (side * side).sum(0), 0, 1)
    return np.linalg.norm(o, axis=0)


def _polygons(corners, n, truth, bound):
    seen = [mi.Point3f(corner) for corner in corners]
    stable = polygon.irradiance(seen, mi.Point3f(0), vector(n))
    plain = solidangle.textbook_polygon_irradiance([vector(corner) for corner in corners], vector(n))
    return Errors(*(np.float64((np.array(found) - truth) / bound) for found in (stable, plain)))


def _wall():
    """A light [-1, 1] x [0, 1] in the plane x = 0 that shines towards -x."""
    place = transform().look_at([0, 0, 0.5], [-1, 0, 0.5], UP).scale([1, 0.5, 1])
    return Lamp({"type": "rectangle", "to_world": place})


@case(
    "54", FAMILY, unit="of the bound",
    sweep=("distance", (1e1, 1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5)), tolerance=1,
    why="16 u of the angles that are summed, 13 u the arc tangent's", source="Lambert1760",
)  # fmt: skip
def wall_light_at_the_floor(distance):
    """The irradiance on a floor from a light that stands on it, in closed form."""
    d = np.longdouble(np.float32(distance))
    far = np.hypot(d, 1)
    truth = np.arctan2(1, d) - d / far * np.arctan2(1, far)
    corners = [np.array([[float(d)], [y], [z]]) for y, z in ((-1, 0), (1, 0), (1, 1), (-1, 1))]
    angles = lambert(corners, np.array(UP)[:, None])[1]
    stable = _wall().irradiance([-distance, 0, 0], UP)
    plain = solidangle.textbook_polygon_irradiance([vector(c) for c in corners], vector(UP))
    bound = 16 * U * angles
    return Errors(*(np.float64((np.array(found) - truth) / bound) for found in (stable, plain)))


@case(
    "54, R7", FAMILY, unit="relative",
    sweep=("distance", (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5)), tolerance=UNIFORM,
    why="1/sqrt(3), of the cosine over a quarter of a sphere; by area it grows as 1/d", source="UrenaFajardoKing2013",
)  # fmt: skip
def noise_of_a_wall_light_at_the_floor(distance):
    """The spread of samples of a light that stands on the floor."""
    lamp, p = _wall(), [-distance, 0, 0]
    return _noise(lamp, p, UP, lamp.irradiance(p, UP))


@case(
    "55, R7", FAMILY, unit="relative",
    sweep=("height", (1.0, 1e-1, 1e-2, 1e-3)), tolerance=UNIFORM,
    why="1/sqrt(3), of the cosine over a hemisphere; by area it grows as 1/h", source="UrenaFajardoKing2013",
)  # fmt: skip
def noise_of_a_close_light(height):
    """The spread of samples of a square light of side 2 that is parallel, at a height."""
    lamp = Lamp({"type": "rectangle"})
    p, down = [0, 0, height], [0, 0, -1]
    return _noise(lamp, p, down, lamp.irradiance(p, down))


def _noise(lamp, p, n, E):
    forms = lamp.estimates, lamp.estimates_by_area, lamp.estimates_of_mitsuba
    return Errors(*(spread(form(p, n, lattice(POINTS)), E) for form in forms))


# ---- Disks


@case(
    "59", FAMILY, unit="relative",
    sweep=("x", (0.0, 0.5, 1.0, 3.0, 1e1, 1e2, 1e3, 1e4)), tolerance=32 * U,
    why="some 30 roundings of positive terms", source="Guillen2017",
)  # fmt: skip
def disk_light(x):
    """The irradiance from a disk of radius 1, parallel at height 1, from x beside its axis."""
    at, h = np.longdouble(np.float32(x)), np.longdouble(1)
    total = at**2 + h**2
    # The textbook's difference, as a quotient
    root = np.sqrt((total + 1) ** 2 - 4 * at**2)
    truth = np.arccos(np.longdouble(-1)) * 2 * h**2 / (root * (root + total - 1))
    stable = Lamp({"type": "disk"}).irradiance([x, 0, 1], [0, 0, -1])
    plain = solidangle.textbook_disk_irradiance(mi.Float(x), mi.Float(1), mi.Float(1))
    return Errors(*(np.float64(np.array(found) / truth - 1) for found in (stable, plain)))


@case(
    "59, R7", FAMILY, unit="relative",
    sweep=("height", (1.0, 1e-1, 1e-2, 1e-3, 1e-4)), tolerance=0.6,
    why="1/sqrt(3), of the cosine over a hemisphere, and 8 % of the density", source="Guillen2017",
)  # fmt: skip
def noise_of_a_disk_light(height):
    """The spread of samples of a disk that is parallel, from below its rim."""
    lamp = Lamp({"type": "disk"})
    p, down = [1, 0, height], [0, 0, -1]
    return _noise(lamp, p, down, lamp.irradiance(p, down))
