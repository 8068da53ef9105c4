"""Sampling of disks by solid angle: against line integrals along the rim, closed forms and its density."""

import mitsuba as mi
import numpy as np
import pytest
from lights import (
    EPS,
    LEVEL,
    a_disk,
    check_consistency,
    chi_square,
    moments,
    nodes,
    point,
    random_numbers,
    random_units,
    single,
    uneven,
    unit,
    vector,
)

from whitted.lights import disk, warp

NONE = (0, 0, 0)


def irradiance(centre, axis, radius, n):
    """The integral of ``n . (r x dr) / (2 |r|^2)`` along what is above the horizon, seen from the origin.

    By Gauss's rule on pieces of the rim that are the smaller the nearer the receiver is; along the horizon it is half
    the angle.
    """
    centre, axis, n = np.asarray(centre, np.float64), unit(axis), unit(n)
    x = unit(np.cross(axis, [0.3, 0.5, 0.8]))
    y = np.cross(axis, x)
    reach, middle = radius * np.hypot(n @ x, n @ y), np.arctan2(n @ y, n @ x)
    if n @ centre <= -reach:
        return 0.0
    half = np.pi if n @ centre >= reach else np.arccos(-(n @ centre) / reach)
    start, stop = middle - half, middle + half
    nearest = np.arctan2(-centre @ y, -centre @ x) + 2 * np.pi * np.arange(-2, 3)
    steps = np.r_[0, 2.0 ** np.arange(-40, 3)]
    ends = np.unique(np.clip(np.add.outer(nearest, np.r_[steps, -steps]), start, stop))
    ends = np.unique(np.r_[start, ends, stop])
    node, weight = np.polynomial.legendre.leggauss(40)
    length = np.diff(ends)[:, None] / 2
    phi, weight = (ends[:-1, None] + length * (1 + node)).ravel(), (length * weight).ravel()
    r = centre + radius * (np.cos(phi)[:, None] * x + np.sin(phi)[:, None] * y)
    dr = radius * (np.cos(phi)[:, None] * y - np.sin(phi)[:, None] * x)
    total = (np.cross(r, dr) @ n / (r * r).sum(-1)) @ weight
    if half < np.pi:
        a, b = (centre + radius * (np.cos(phi) * x + np.sin(phi) * y) for phi in (start, stop))
        cross = np.cross(b, a)
        total += np.sign(cross @ n) * np.arctan2(np.linalg.norm(cross), a @ b)
    return abs(total) / 2


def solid_angle(lateral, h):
    """Of a disk of radius 1 at a height ``h``: the integral over chords; the rule converges exponentially."""
    count = 400_000
    phi = (np.arange(count) + 0.5) * np.pi / count
    y, x = np.cos(phi), np.sin(phi)
    rho2 = y * y + h * h

    def part(x):
        return h * x / (rho2 * np.sqrt(x * x + rho2))

    return (part(x + lateral) + part(x - lateral)) @ x * np.pi / count


def above(lateral, h):
    """A disk of radius 1 at a height ``h``, with its middle ``lateral`` to the side."""
    return (lateral, 0.1 * lateral, h), (0, 0, 1), 1.0


TURN = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))[0]
PLACES = {  # geometry, receiver's normal
    "faced": (above(0, 1), (0, 0, 1)),
    "faced askew": (above(0.7, 1), unit([0.5, -0.3, 0.8])),
    "close": (above(0.5, 0.1), unit([0.2, 0.1, 1])),
    "aside": (above(2.5, 0.3), (1, 0, 0)),
    "on the floor's edge": (((0.1, 0, 1), (1, 0, 0), 1.0), (0, 0, 1)),
    "partly below": (((0.5, 0.2, 0.4), (0.8, 0, -0.6), 1.0), (0, 0, 1)),
    "mostly below": (((0.5, 0.2, -0.4), (0.8, 0, -0.6), 1.0), (0, 0, 1)),
    "turned": ((TURN @ [0.8, 0.4, 0.6], -TURN[:, 2], 0.7), unit(TURN @ [0.4, 0.2, 0.5])),
    "far": (((40, 3, 300), unit([0.3, 0.2, 1]), 0.5), unit([0.3, 0.2, 0.5])),
    "very far": (((3e3, 0, 1e4), unit([0.3, 0.2, 1]), 0.1), unit([0.3, 0.2, 0.5])),
}


def of(geometry):
    """The light, and the geometry as it is in single precision."""
    centre, axis, radius = geometry
    return a_disk(disk, *geometry), (single(centre), single(axis), float(single(radius)))


@pytest.mark.parametrize(
    ("lateral", "h", "E"), [(0, 1, 1.570796), (0.5, 1, 1.375963), (3, 1, 0.037405), (1, 0.01, 1.562942)]
)
def test_parallel_receiver(lateral, h, E):
    """Published numbers, and the closed form of a parallel disk."""
    found = disk.irradiance(
        point((lateral, 0, h)), mi.Vector3f(0, 0, 1), mi.Float(1), point(NONE), mi.Vector3f(0, 0, 1)
    )[0]
    assert abs(found - E) < 6e-7
    h, x2 = np.float64(np.float32(h)), lateral**2
    exact = np.pi / 2 * (1 - (x2 + h * h - 1) / np.sqrt((x2 + h * h + 1) ** 2 - 4 * x2))
    assert abs(found / exact - 1) < 2e-6


@pytest.mark.parametrize("distance", [1e-3, 0.1, 1, 3, 15, 25, 100, 1e4])
def test_irradiance_of_random_disks(distance):
    """Error relative to a surface that faces the light; the horizon cuts half of the far ones."""
    rng = np.random.default_rng(1)
    for k in range(60):
        axis, n, way = random_units(3, k)
        way = (
            unit(np.cross(axis, way)) * rng.uniform(0, 2) + axis * distance
            if distance < 1
            else way * distance
        )
        if distance > 1 and k % 2:
            n = unit(n - (n @ way) * way / distance**2 + way / distance**2 * rng.uniform(-1, 1))
        if abs(unit(way) @ axis) < 1e-3:
            continue
        axis, n, way = (single(v) for v in (axis, n, way))
        E = disk.irradiance(point(way), vector(axis), mi.Float(1), point(NONE), vector(n))[0]
        assert abs(E - irradiance(way, axis, 1, n)) < 1e-5 * irradiance(way, axis, 1, unit(way))


@pytest.mark.parametrize("name", PLACES)
def test_estimates_have_the_irradiance_as_mean(name):
    """By quadrature, to which the horizon's kink costs accuracy; with the receiver's normal preferred and without."""
    light, geometry = of(PLACES[name][0])
    n = PLACES[name][1]
    E = irradiance(*geometry, single(n))
    for preference in (n, NONE):
        mean, _, _ = moments(light, NONE, n, preference, k=512)
        assert abs(mean / E - 1) < (1e-3 if "below" in name else 2e-5)
    np.testing.assert_allclose(light.irradiance(NONE, n), E, rtol=1e-5)


@pytest.mark.parametrize(
    ("lateral", "h"),
    [
        (0, 1e-3),
        (0, 1),
        (0.5, 0.1),
        (0.9, 0.1),
        (1, 0.1),
        (1.1, 0.01),
        (1.3, 1e-3),
        (3, 1e-4),
        (2, 2),
        (90, 1e4),
    ],
)
def test_solid_angle_is_the_mean_of_one_over_the_density(lateral, h):
    u, weight = nodes(1024)
    geometry = (point((lateral, 0, h)), mi.Vector3f(0, 0, 1), mi.Float(1))
    pdf = disk.sample(*geometry, point(NONE), mi.Vector3f(0), u)[3]
    assert abs(weight @ (1 / np.array(pdf, np.float64)) / solid_angle(lateral, np.float32(h)) - 1) < 5e-6


@pytest.mark.parametrize(
    ("lateral", "h", "factor", "spread"),
    [
        *((0, h, 1 + 4e-6, 1e-6) for h in (1e-4, 0.1, 1, 100)),  # seen face on
        *((lateral, 20, 1.001, 2e-4) for lateral in (0, 10, 100)),  # small
        *((lateral, 0.1, 1.45, 0.052) for lateral in (0.5, 0.9, 1, 1.1, 1.3, 2)),
        *((lateral, 1e-2, 3, 0.08) for lateral in (0.5, 0.99, 1, 1.001, 1.01, 1.1)),
        *((lateral, 1e-4, 8, 0.08) for lateral in (0.5, 0.99, 1, 1.001, 1.01, 1.1)),
    ],
)
def test_sampling_is_nearly_uniform(lateral, h, factor, spread):
    """What the module's documentation says of the density for no normal."""
    u, weight = nodes(512)
    geometry = (point((lateral, 0, h)), mi.Vector3f(0, 0, 1), mi.Float(1))
    inverse = 1 / np.array(disk.sample(*geometry, point(NONE), mi.Vector3f(0), u)[3], np.float64)
    mean = weight @ inverse
    assert inverse.max() / inverse.min() < factor
    assert np.sqrt(weight @ (inverse - mean) ** 2) / mean < spread


def test_mean_needs_the_density_of_the_warp_and_of_the_slices(monkeypatch):
    """With the density of a uniform distribution, or without the warp's factor, the mean is off."""
    (lateral, h), n = (1, 0.1), unit([0.5, 0.2, 0.5])
    light, geometry = of(above(lateral, h))
    u, weight = nodes(512)
    d = np.array(light("sample", NONE, NONE, u)[1], np.float64)
    uniform = weight @ np.maximum(single(n) @ d, 0) * solid_angle(np.hypot(lateral, 0.1 * lateral), h)
    assert abs(uniform / irradiance(*geometry, single(n)) - 1) > 1e-3
    monkeypatch.setattr(warp, "bilinear_pdf", lambda t, weights: 1)
    assert abs(moments(light, NONE, n)[0] / irradiance(*geometry, single(n)) - 1) > 0.01


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_density_is_that_of_the_samples(name, preferred):
    light, (centre, _, radius) = of(PLACES[name][0])
    check_consistency(
        light, PLACES[name][1] if preferred else NONE, 1 + np.linalg.norm(centre) / radius, sharp=32
    )


def test_density_from_near_the_rim():
    """Within 1e-3 radii of the rim rounding of the point itself counts; for most points the densities still agree."""
    light = a_disk(disk, (1.0, 0, 1e-3), (0, 0, 1), 1.0)
    q, _, _, pdf = light("sample", NONE, NONE, random_numbers(20_000, 3))
    back = abs(np.array(light("pdf", NONE, NONE, q), np.float64) / np.array(pdf, np.float64) - 1)
    assert np.quantile(back, 0.99) < 1e-3
    assert back.max() < 0.2


def edges_for(light, centre, axis, radius):
    """Cells in polar coordinates, small where the receiver at the origin is near."""
    h = abs(centre @ axis)
    r, phi = light.back(axis * (centre @ axis))
    scale = max(h / radius, 0.05)
    return uneven(13, 0, 1, min(r, 1), scale), uneven(
        13, 0, 1, phi, max(scale, 0.05) / (2 * np.pi * max(r, 0.3))
    )


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_samples_follow_the_density(name, preferred):
    """20 tests of level 1e-4: 0.2 %; the density integrates to 1."""
    light, geometry = of(PLACES[name][0])
    n = PLACES[name][1] if preferred else NONE
    p_value, mass = chi_square(light, NONE, n, edges_for(light, *geometry), parts=16)
    assert abs(mass - 1) < 1e-3
    assert p_value > LEVEL


def test_a_wrong_distribution_would_be_noticed():
    """Area sampling fails the same test, and so do warped samples with the density of others."""
    light, geometry = of(PLACES["faced askew"][0])
    n = PLACES["faced askew"][1]
    u = random_numbers(100_000, 1)
    flat = mi.warp.square_to_uniform_disk_concentric(u)
    q = {
        "area": light.arguments[0] + mi.Vector3f(flat.x, flat.y, 0),
        "warped": light("sample", NONE, n, u)[0],
    }

    class Swapped:
        pdf = disk.pdf
        area = staticmethod(lambda *_: (q["area"],))
        warped = staticmethod(lambda *_: (q["warped"],))

    light.module = Swapped
    edges = edges_for(light, *geometry)
    for sampled in ("area", "warped"):
        assert chi_square(light, NONE, NONE, edges, sampled=sampled)[0] < 1e-10


@pytest.mark.parametrize("d", [1, 0.1, 0.01, 1e-3, 1e-4])
def test_spread_is_bounded_as_the_light_is_touched(d):
    """A disk that stands on the floor, from the floor at a distance ``d``."""
    light, geometry = of(((d, 0.1, 1), (1, 0, 0), 1.0))
    E = irradiance(*geometry, np.array([0, 0, 1.0]))
    for preference, bound in (((0, 0, 1), 0.55), (NONE, 0.72)):
        mean, spread, largest = moments(light, NONE, (0, 0, 1), preference, k=512)
        assert abs(mean / E - 1) < 1e-4
        assert spread < bound
        assert largest < 8


def test_edge_on_or_below_the_horizon():
    for n in ((0, 0, 1), (0.6, 0, 0.8)):
        assert (
            disk.irradiance(point((2, 0, 0)), mi.Vector3f(0, 0, 1), mi.Float(1), point(NONE), vector(n))[0]
            <= EPS
        )
    assert (
        disk.irradiance(
            point((0, 0, -2)), mi.Vector3f(1, 0, 0), mi.Float(1), point(NONE), mi.Vector3f(0, 0, 1)
        )[0]
        == 0
    )
