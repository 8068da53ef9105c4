"""Sampling of rectangles by solid angle: against the solid angle in closed form, Lambert's formula and its density."""

import mitsuba as mi
import numpy as np
import pytest
from lights import (
    LEVEL,
    a_rectangle,
    check_consistency,
    chi_square,
    hull,
    lambert,
    moments,
    nodes,
    point,
    random_numbers,
    single,
    uneven,
    unit,
    vector,
)

from whitted.lights import rectangle, warp

NONE = (0, 0, 0)


def solid_angle(x0, x1, y0, y1, z):
    """The sum of the corners' angles, ``longdouble``."""
    x0, x1, y0, y1, z = (np.asarray(a, np.longdouble) for a in (x0, x1, y0, y1, z))

    def corner(x, y):
        return np.arctan2(x * y, z * np.sqrt(x * x + y * y + z * z))

    return corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)


def corners(o, ex, ey):
    o, ex, ey = single(o), single(ex), single(ey)
    return [o, o + ex, o + ex + ey, o + ey]


def square(h, x=0.0, y=0.0):
    """A square of side 2 with its middle at ``(x, y, h)``."""
    return (x - 1, y - 1, h), (2, 0, 0), (0, 2, 0)


def wall(d):
    """A wall light [d] x [-1, 1] x [0, 1] above the floor."""
    return (d, -1, 0), (0, 2, 0), (0, 0, 1)


TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
PLACES = {  # geometry, receiver's normal
    "faced": (square(1), (0, 0, 1)),
    "faced askew": (square(1, 0.7, -0.3), unit([0.5, -0.3, 0.8])),
    "very close": (square(0.05), unit([0.2, 0.1, 1])),
    "aside": (square(0.3, 2.5, 0.2), (1, 0, 0)),
    "touching the floor": (wall(0.1), (0, 0, 1)),
    "partly below": (square(0.5, 0.3), unit([1, 0.2, 0.1])),
    "mostly below": (square(0.5, 0.3), unit([1, 0.2, -0.7])),
    "long": (((-5, 0.2, 0.5), (10, 0, 0), (0, 0.1, 0)), unit([0.3, 0, 1])),
    "turned": (tuple(np.array(square(0.6, 0.8, 0.4)) @ TURN.T), unit(TURN @ [0.4, 0.2, 0.5])),
    "far": (square(300, 40), unit([0.3, 0.2, 0.5])),
    "very far": (square(1e4, 3e3), unit([0.3, 0.2, 0.5])),
}


@pytest.mark.parametrize("seed", range(4))
def test_solid_angle_of_random_rectangles(seed):
    """Sizes 0.01 to 1, distances up to 1000 sizes, heights over the plane from 1e-5; the receivers rounded."""
    rng = np.random.default_rng(seed)
    w, h = single(10 ** rng.uniform(-2, 0, (2, 20_000)))
    x, y = rng.choice([-1, 1], (2, w.size)) * 10 ** rng.uniform(-4, 3, (2, w.size))
    z = 10 ** rng.uniform(-5, 2.9, w.size)
    x, y = x + w / 2 * rng.integers(-1, 2, w.size), y + h / 2 * rng.integers(-1, 2, w.size)
    p = single(np.stack([x, y, z], -1))
    o = single(np.stack([-w / 2, -h / 2, 0 * w], -1))
    ex, ey = np.stack([w, 0 * w, 0 * w], -1), np.stack([0 * h, h, 0 * h], -1)
    _, _, _, pdf = rectangle.sample(
        point(o), vector(ex), vector(ey), point(p), mi.Vector3f(0), random_numbers(w.size, seed)
    )

    def truth(p):
        x, y, z = p.T
        return np.float64(
            solid_angle(o[:, 0] - x, o[:, 0] + w - x, o[:, 1] - y, o[:, 1] + h - y, np.maximum(z, 1e-30))
        )

    near = np.linalg.norm(p, axis=1) < 499 * (w + h)  # farther off the area is sampled
    reach = np.maximum(abs(p[:, :2]).max(-1), 0.5 * (w + h))
    lower, upper = (a[near] for a in hull(truth, p, reach[:, None]))
    found = 1 / np.array(pdf, np.float64)[near]
    assert (found > lower * (1 - 2e-6)).all()
    assert (found < upper * (1 + 2e-6)).all()
    assert np.median(abs(found / truth(p)[near] - 1)) < 1e-6


@pytest.mark.parametrize("z", [1e-6, 1e-3, 1, 1e3])
def test_solid_angle_at_exact_distances(z):
    """Receivers over the middle, a side and a corner of a square, and beside it; no rounding to allow for."""
    for x, y in ((0, 0), (1, 0), (1, 1), (0.5, 1), (2, 0.25), (1.5, 1.5)):
        light = a_rectangle(rectangle, *square(0))
        pdf = light("pdf", (x, y, z), NONE, mi.Point3f(0.5, 0.5, 0))[0]
        exact = solid_angle(-1 - x, 1 - x, -1 - y, 1 - y, np.float32(z))
        assert abs(1 / pdf / exact - 1) < 2e-6


@pytest.mark.parametrize("name", PLACES)
def test_estimates_have_the_irradiance_as_mean(name):
    """By quadrature, to which the horizon's kink costs accuracy; with the receiver's normal preferred and without."""
    geometry, n = PLACES[name]
    light = a_rectangle(rectangle, *geometry)
    E = lambert(corners(*geometry), NONE, single(n))
    for preference in (n, NONE):
        mean, _, _ = moments(light, NONE, n, preference, k=512)
        assert abs(mean / E - 1) < (1e-3 if "below" in name else 1e-5)
    np.testing.assert_allclose(light.irradiance(NONE, n), E, rtol=1e-5)


def test_mean_needs_the_density_of_the_warp(monkeypatch):
    """Without the warp's factor in the density the mean is off."""
    geometry, n = PLACES["faced askew"]
    monkeypatch.setattr(warp, "bilinear_pdf", lambda t, weights: 1)
    mean, _, _ = moments(a_rectangle(rectangle, *geometry), NONE, n)
    assert abs(mean / lambert(corners(*geometry), NONE, single(n)) - 1) > 0.01


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_density_is_that_of_the_samples(name, preferred):
    geometry, n = PLACES[name]
    shortest = min(np.linalg.norm(geometry[1]), np.linalg.norm(geometry[2]))
    away = 1 + max(np.linalg.norm(v) for v in corners(*geometry)) / shortest
    check_consistency(a_rectangle(rectangle, *geometry), n if preferred else NONE, away, sharp=16)


def edges_for(geometry):
    """Cells of a rectangle, small where the receiver at the origin is near."""
    o, ex, ey = (np.asarray(a, np.float64) for a in geometry)
    height = abs(o @ unit(np.cross(ex, ey)))
    return [
        uneven(13, 0, 1, np.clip(-(o @ e) / (e @ e), 0, 1), max(height / np.linalg.norm(e), 0.02))
        for e in (ex, ey)
    ]


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_samples_follow_the_density(name, preferred):
    """22 tests of level 1e-4: 0.22 %; the density integrates to 1."""
    geometry, n = PLACES[name]
    light = a_rectangle(rectangle, *geometry)
    p_value, mass = chi_square(light, NONE, n if preferred else NONE, edges_for(geometry), parts=16)
    assert abs(mass - 1) < 1e-3
    assert p_value > LEVEL


def test_a_wrong_distribution_would_be_noticed(monkeypatch):
    """Area sampling, or warped samples with the density of others, fail the same test."""
    geometry, n = PLACES["faced askew"]
    light = a_rectangle(rectangle, *geometry)
    by_area = random_numbers(100_000, 1)
    o, ex, ey = light.arguments

    class Swapped:
        pdf = rectangle.pdf
        area = staticmethod(lambda o, ex, ey, p, n, u: (o + by_area.x * ex + by_area.y * ey,))

    light.module = Swapped
    assert chi_square(light, NONE, NONE, edges_for(geometry), sampled="area")[0] < 1e-10
    light.module = rectangle
    q = rectangle.sample(o, ex, ey, point(NONE), vector(n), by_area)[0]
    monkeypatch.setattr(warp, "bilinear_pdf", lambda t, weights: 1)
    Swapped.area = staticmethod(lambda *_: (q,))
    light.module = Swapped
    assert chi_square(light, NONE, n, edges_for(geometry), sampled="area")[0] < 1e-10


@pytest.mark.parametrize("d", [1, 0.1, 0.01, 1e-3, 1e-4, 1e-5])
def test_spread_is_bounded_as_the_light_is_touched(d):
    """A wall light from the floor at a distance ``d``: the relative spread of one estimate of the irradiance."""
    light = a_rectangle(rectangle, *wall(d))
    E = lambert(corners(*wall(d)), NONE, np.array([0, 0, 1.0]))
    for preference, bound in (((0, 0, 1), 0.08), (NONE, 0.66)):
        mean, spread, _ = moments(light, NONE, (0, 0, 1), preference)
        assert abs(mean / E - 1) < 2e-5
        assert spread < bound


@pytest.mark.parametrize("d", [1, 0.1, 0.01])
def test_spread_of_area_sampling_is_not(d):
    """The same by area: about 0.32 / d."""
    u, weight = nodes(1024)
    y, z = 2 * np.array(u[0], np.float64) - 1, np.array(u[1], np.float64)
    estimate = 2 * d * z / (d * d + y * y + z * z) ** 2
    mean = weight @ estimate
    assert abs(mean / lambert(corners(*wall(d)), NONE, np.array([0, 0, 1.0])) - 1) < 1e-4
    assert 0.3 < np.sqrt(weight @ (estimate - mean) ** 2) / mean * d < 0.5


def test_spread_over_a_close_light():
    """A square of side 2 at a height of 0.05: by area it is 13."""
    _, spread, largest = moments(a_rectangle(rectangle, *square(0.05)), NONE, (0, 0, 1))
    assert spread < 0.55
    assert largest < 2.1


@pytest.mark.parametrize(("distance", "bound"), [(3, 0.07), (10, 0.02), (100, 2e-3)])
def test_estimates_are_nearly_constant_from_afar(distance, bound):
    """Whatever the receiver's normal, as long as it faces the light well."""
    for n in ((0, 0, 1), (0.8, 0, 0.6), (0, -0.6, 0.8)):
        assert moments(a_rectangle(rectangle, *square(distance)), NONE, n, k=64)[1] < bound
