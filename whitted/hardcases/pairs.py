"""The textbook forms and the stable ones beside them whose cost and digits are measured."""

import numpy as np

from whitted import optics
from whitted.geometry import plane, sphere
from whitted.hardcases.forms import Pair

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
