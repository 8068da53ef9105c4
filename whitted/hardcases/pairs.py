"""The textbook forms and the stable ones beside them whose cost and digits are measured."""

import drjit as dr
import numpy as np

from whitted import optics
from whitted.geometry import plane, polygon, sphere, triangle
from whitted.hardcases.forms import Pair
from whitted.hardcases.planes import star

FAR = 100.0  # radii
ETA = 1.5


def _towards_a_sphere(rng, count):
    o = np.array([0.0, 0.0, -FAR])[:, None] * np.ones(count)
    d = np.stack([*rng.uniform(-0.7, 0.7, (2, count)), np.full(count, FAR)])
    return o, d / np.linalg.norm(d, axis=0)


def _sphere_root(o, d):
    from mpmath import sqrt

    a, b = sum(x * x for x in d), sum(x * y for x, y in zip(d, o, strict=True))
    return (-b - sqrt(b * b - a * (sum(x * x for x in o) - 1))) / a


def _towards_a_plane(rng, count):
    n = rng.standard_normal((3, count))
    n /= np.linalg.norm(n, axis=0)
    along = np.cross(n, rng.standard_normal((3, count)), axis=0)
    d = along / np.linalg.norm(along, axis=0) - 1e-3 * n
    return rng.uniform(-1, 1, (3, count)), d, n, rng.uniform(-3, -2, count)


def _plane_distance(o, d, n, h):
    return (h - sum(x * y for x, y in zip(n, o, strict=True))) / sum(x * y for x, y in zip(n, d, strict=True))


def _near_the_normal(rng, count):
    n = rng.standard_normal((3, count))
    n /= np.linalg.norm(n, axis=0)
    along = np.cross(n, rng.standard_normal((3, count)), axis=0)
    d = along * (rng.uniform(0, 1e-3, count) / np.linalg.norm(along, axis=0)) - n
    return d / np.linalg.norm(d, axis=0), n


def _component(form):
    """The component of a refracted direction along the first axis plus twice that along the second, and so on."""

    def component(d, n):
        t = form(d, n, ETA)
        return t.x + 2 * t.y + 3 * t.z

    return component


def _refracted_component(d, n):
    from mpmath import sqrt

    d, n = ([x / sqrt(sum(y * y for y in v)) for x in v] for v in (d, n))
    cos = -sum(x * y for x, y in zip(d, n, strict=True))
    across = cos / ETA - sqrt(1 - (1 - cos * cos) / ETA**2)
    return sum(k * (x / ETA + across * y) for k, x, y in zip((1, 2, 3), d, n, strict=True))


def _narrow_lobe(rng, count):
    n = np.full(count, 1e5)
    return rng.uniform(0.1, 10, count) / n, n


def _towards_a_triangle(rng, count):
    v = rng.uniform(-1, 1, (3, 3, count))
    target = np.einsum("kn,kin->in", rng.dirichlet((2, 2, 2), count).T, v)
    o = rng.standard_normal((3, count))
    o *= 3 / np.linalg.norm(o, axis=0)
    return o, target - o, *v


def _distance(form):
    return lambda *arguments: form(*arguments)[1]


def _triangle_distance(o, d, v0, v1, v2):
    e1, e2, s = ([x - y for x, y in zip(a, b, strict=True)] for a, b in ((v1, v0), (v2, v0), (o, v0)))
    n = [e1[i - 2] * e2[i - 1] - e1[i - 1] * e2[i - 2] for i in range(3)]
    return -sum(x * y for x, y in zip(n, s, strict=True)) / sum(x * y for x, y in zip(n, d, strict=True))


STAR = star()


def _level_with_corners(rng, count):
    return rng.integers(-1000, 1001, count) + 0.5, rng.choice([float(y) for _, y in STAR], count)


def _side(form):
    """1 outside of the star, 2 inside."""
    return lambda x, y: dr.select(form(x, y, STAR), type(x)(2), 1)


def _side_of_star(x, y):
    inside = False
    for (ax, ay), (bx, by) in zip(STAR, [*STAR[1:], STAR[0]], strict=True):
        area = (bx - ax) * (y - ay) - (x - ax) * (by - ay)
        inside ^= (ay <= y < by and area > 0) or (by <= y < ay and area < 0)
    return 2 if inside else 1


PAIRS = (
    Pair(
        "hit on a sphere 100 radii away",
        lambda o, d: sphere.textbook_roots(o, d, 0, 1)[0],
        lambda o, d: sphere.roots(o, d, 0, 1)[0],
        _towards_a_sphere,
        _sphere_root,
    ),
    Pair(
        "hit on a plane at a slope of 1/1000",
        plane.textbook_distance,
        plane.distance,
        _towards_a_plane,
        _plane_distance,
    ),
    Pair(
        "hit on a triangle, watertight",
        _distance(triangle.textbook_hit),
        _distance(triangle.hit),
        _towards_a_triangle,
        _triangle_distance,
    ),
    Pair(
        "inside a star of 14 corners, level with one",
        _side(polygon.textbook_inside),
        _side(polygon.inside),
        _level_with_corners,
        _side_of_star,
    ),
    Pair(
        "refraction within 1/1000 of the normal",
        _component(optics.textbook_refract),
        _component(optics.refract),
        _near_the_normal,
        _refracted_component,
    ),
    Pair(
        "Phong's lobe of the exponent 1e5",
        lambda versine, n: optics.textbook_power_cosine(1 - versine, n),
        optics.power_cosine,
        _narrow_lobe,
        lambda versine, n: (1 - versine) ** n,
    ),
)
