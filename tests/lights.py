"""Light shapes to try the samplers on, and the truth about them in longer arithmetic."""

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
from scipy import stats

EPS = 2.0**-24
LEVEL = 1e-4  # of each statistical test


def single(a):
    """What is left of numbers in single precision, as ``float64``."""
    return np.asarray(np.asarray(a, np.float32), np.float64)


def unit(v):
    v = np.asarray(v, np.float64)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_units(count, seed):
    return unit(np.random.default_rng(seed).normal(size=(count, 3)))


def point(v):
    """A ``Point3f`` from an array [3] or [N, 3]."""
    return mi.Point3f(np.asarray(v, np.float32).T)


def vector(v):
    """A ``Vector3f`` from an array [3] or [N, 3]."""
    return mi.Vector3f(np.asarray(v, np.float32).T)


def nodes(k):
    """k x k points of the unit square and weights to integrate by; dense at the sides, where estimates may be steep."""
    v = (np.arange(k) + 0.5) / k
    x, y = np.meshgrid(v * v * (3 - 2 * v), v * v * (3 - 2 * v))
    wx, wy = np.meshgrid(6 * v * (1 - v), 6 * v * (1 - v))
    weight = (wx * wy).ravel()
    return mi.Point2f(np.float32(x.ravel()), np.float32(y.ravel())), weight / weight.sum()


def random_numbers(count, seed):
    return mi.Point2f(np.float32(np.random.default_rng(seed).random((2, count)) * (1 - EPS)))


@dataclass
class Flat:
    """A flat light: its module, its geometry as arrays, and where the unit square goes on it."""

    module: Any
    arguments: tuple
    place: Any  # from numbers s, t to points [..., 3]
    stretch: Any  # area per area of the unit square, at s, t
    normal: np.ndarray
    back: Any  # from points to s, t

    def __call__(self, name, p, n, u_or_q):
        return getattr(self.module, name)(*self.arguments, point(p), vector(n), u_or_q)

    def irradiance(self, p, n):
        return np.array(self.module.irradiance(*self.arguments, point(p), vector(n)), np.float64)

    def solid_angles(self, p, s, t):
        """Density of solid angle over the unit square, seen from ``p``."""
        v = self.place(s, t) - np.asarray(p, np.float64)
        r2 = (v * v).sum(-1)
        return abs(v @ self.normal) / r2**1.5 * self.stretch(s, t)


def a_rectangle(module, o, ex, ey):
    o, ex, ey = single(o), single(ex), single(ey)
    normal = np.cross(ex, ey)
    area = np.linalg.norm(normal)
    frame = np.linalg.pinv(np.stack([ex, ey], 1))
    return Flat(
        module,
        (point(o), vector(ex), vector(ey)),
        lambda s, t: o + s[..., None] * ex + t[..., None] * ey,
        lambda s, t: area + 0 * s,
        normal / area,
        lambda q: (q - o) @ frame.T,
    )


def a_triangle(module, a, b, c):
    a, b, c = single(a), single(b), single(c)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal)
    frame = np.linalg.pinv(np.stack([b - a, c - a], 1))

    def back(q):
        x, y = ((q - a) @ frame.T).T
        return np.stack([x + y, y / np.maximum(x + y, 1e-30)], -1)

    return Flat(
        module,
        (point(a), point(b), point(c)),
        lambda s, t: a + (s * (1 - t))[..., None] * (b - a) + (s * t)[..., None] * (c - a),
        lambda s, t: area * s,
        normal / area,
        back,
    )


def a_disk(module, centre, axis, radius):
    centre, axis, radius = single(centre), single(axis), float(single(radius))
    x = unit(np.cross(axis, [0.3, 0.5, 0.8]))
    y = np.cross(axis, x)

    def place(s, t):
        phi = 2 * np.pi * t
        return centre + radius * s[..., None] * (np.cos(phi)[..., None] * x + np.sin(phi)[..., None] * y)

    def back(q):
        v = (q - centre) / radius
        return np.stack([np.hypot(v @ x, v @ y), np.arctan2(v @ y, v @ x) / (2 * np.pi) % 1], -1)

    return Flat(
        module,
        (point(centre), vector(axis), mi.Float(radius)),
        place,
        lambda s, t: 2 * np.pi * radius**2 * s,
        axis / np.linalg.norm(axis),
        back,
    )


def moments(light, p, n, preference=None, k=256):
    """The mean of the estimates ``cosine / density`` of irradiance, their spread and the largest, both over the mean.

    Sampled with the normal ``n`` or with a ``preference`` in its place.
    """
    u, weight = nodes(k)
    _, d, _, pdf = light("sample", p, n if preference is None else preference, u)
    pdf = np.array(pdf, np.float64)
    estimate = np.maximum(single(n) @ np.array(d, np.float64), 0) / pdf
    mean = weight @ estimate
    return mean, np.sqrt(weight @ (estimate - mean) ** 2) / mean, estimate.max() / mean


def uneven(edges, lo, hi, focus, scale):
    """Edges of cells in [lo, hi] that are dense about ``focus``, where there is a peak of width ``scale``."""
    a, b = np.arcsinh((lo - focus) / scale), np.arcsinh((hi - focus) / scale)
    return np.clip(focus + scale * np.sinh(np.linspace(a, b, edges)), lo, hi)


def chi_square(light, p, n, edges, sampled="sample", density="pdf", count=100_000, seed=1, parts=8):
    """The p-value of samples of a flat light against its density, over cells of its area; and the density's integral.

    The density is integrated over each cell by the midpoint rule on ``parts`` x ``parts`` parts.
    """
    q = light(sampled, p, n, random_numbers(count, seed))[0]
    s, t = light.back(np.array(q, np.float64).T).T
    counts = np.histogram2d(s, t, edges)[0]

    def middles(e):
        within = (np.arange(parts) + 0.5) / parts
        return (e[:-1, None] + np.diff(e)[:, None] * within).ravel(), np.repeat(np.diff(e) / parts, parts)

    (s, ds), (t, dt) = middles(edges[0]), middles(edges[1])
    s, t = (a.ravel() for a in np.meshgrid(s, t, indexing="ij"))
    pdf = np.array(light(density, p, n, point(light.place(s, t))), np.float64)
    mass = (pdf * light.solid_angles(p, s, t)).reshape(len(ds), len(dt)) * ds[:, None] * dt
    mass = mass.reshape(len(ds) // parts, parts, len(dt) // parts, parts).sum((1, 3))
    return pooled_chi_square(counts.ravel(), mass.ravel() * count), mass.sum()


def pooled_chi_square(counts, expected, least=10):
    """The p-value of counts; cells in which few are expected are taken together."""
    order = np.argsort(expected)
    counts, expected = counts[order], expected[order]
    few = int(np.searchsorted(np.cumsum(expected), least)) + 1
    few = max(few, int(np.searchsorted(expected, least)))
    counts, expected = (np.r_[a[:few].sum(), a[few:]] for a in (counts, expected))
    statistic = ((counts - expected) ** 2 / expected).sum()
    return stats.chi2.sf(statistic, len(counts) - 1)


def check_consistency(light, n, away, sharp, count=20_000):
    """``pdf`` gives what ``sample`` returned, and point, direction and distance from the origin agree.

    ``away`` tells how many sizes off the light is: for that much the rounding of the point counts, and with a normal
    for fifty times as much where the warp is steepest. ``sharp`` is the error allowed at the median, in 2^-24.
    """
    q, d, distance, pdf = light("sample", (0, 0, 0), n, random_numbers(count, 3))
    pdf = np.array(pdf, np.float64)
    back = abs(np.array(light("pdf", (0, 0, 0), n, q), np.float64) / pdf - 1)
    assert (pdf > 0).all()
    assert np.median(back) <= sharp * EPS
    assert back.max() < (1000 * away if np.any(n) else 100) * EPS
    v = np.array(q, np.float64)
    np.testing.assert_allclose(np.array(distance), np.linalg.norm(v, axis=0), rtol=8 * EPS)
    np.testing.assert_allclose(np.array(d), v / np.linalg.norm(v, axis=0), atol=8 * EPS)
    s, t = light.back(v.T).T
    assert min(s.min(), t.min()) > -8 * EPS * away
    assert max(s.max(), t.max()) < 1 + 8 * EPS * away


def solid_angle(a, b, c, p):
    """The solid angle of triangles, ``longdouble``, by Van Oosterom and Strackee's formula."""
    a, b, c = (np.asarray(v, np.longdouble) - np.asarray(p, np.longdouble) for v in (a, b, c))
    la, lb, lc = (np.sqrt((v * v).sum(-1)) for v in (a, b, c))
    volume = abs((a * np.cross(b - a, c - a)).sum(-1))
    dots = (a * b).sum(-1) * lc + (a * c).sum(-1) * lb + (b * c).sum(-1) * la
    return 2 * np.arctan2(volume, la * lb * lc + dots)


def clip(vertices, n):
    """Sutherland and Hodgman's part of a polygon, seen from the origin, above the horizon of ``n``."""
    part = []
    for a, b in zip(vertices, [*vertices[1:], vertices[0]], strict=True):
        ha, hb = a @ n, b @ n
        if ha > 0:
            part.append(a)
        if (ha > 0) != (hb > 0):
            part.append(a + (b - a) * (ha / (ha - hb)))
    return part


def lambert(vertices, p, n):
    """The irradiance at one point from a polygon, ``longdouble``: Lambert's formula as in the textbook."""
    p, n = np.asarray(p, np.longdouble), np.asarray(n, np.longdouble)
    part = clip([np.asarray(v, np.longdouble) - p for v in vertices], n)
    total = np.longdouble(0)
    for a, b in zip(part, [*part[1:], *part[:1]], strict=True):
        cross = np.cross(a, b)
        sine = np.sqrt(cross @ cross)
        if sine > 0:
            total += np.arctan2(sine, a @ b) * (cross @ n) / sine
    return float(abs(total) / 2)


def hull(truth, p, reach, halves=4):
    """The least and the largest of ``truth(p)`` when ``p`` moves by some half units in the last place of ``reach``."""
    step = halves * EPS * reach
    around = [truth(p)] + [truth(p + sign * step * axis) for axis in np.eye(3) for sign in (-1, 1)]
    return np.min(around, 0), np.max(around, 0)
