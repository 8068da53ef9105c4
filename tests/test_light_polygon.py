"""Lambert's formula with clipping, against the textbook's form in long double and against closed forms."""

import numpy as np
import pytest
from lights import EPS, a_rectangle, a_triangle, lambert, point, random_units, single, unit, vector

from whitted.lights import polygon, rectangle, triangle


def irradiance(vertices, p, n):
    return np.array(polygon.irradiance([point(v) for v in vertices], point(p), vector(n)), np.float64)


def wall(d):
    """A wall light [d] x [-1, 1] x [0, 1] above the floor."""
    return single([(d, -1, 0), (d, 1, 0), (d, 1, 1), (d, -1, 1)])


def corner_to_wall(d):
    """The irradiance on the floor at a distance ``d`` before the middle of the wall [-1, 1] x [0, 1]."""
    return np.arctan2(1, d) - d / np.hypot(d, 1) * np.arctan2(1, np.hypot(d, 1))


@pytest.mark.parametrize("d", [10, 1, 0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6])
def test_wall_that_touches_the_floor(d):
    """The configuration factor of a rectangle perpendicular to the receiver and based at its plane."""
    E = irradiance(wall(d), (0, 0, 0), (0, 0, 1))
    np.testing.assert_allclose(E, corner_to_wall(np.float64(np.float32(d))), rtol=1e-6)


def test_published_numbers():
    published = {1: 0.35019, 0.1: 1.39323, 0.01: 1.55294, 0.001: 1.56901}
    for d, E in published.items():
        assert abs(irradiance(wall(d), (0, 0, 0), (0, 0, 1))[0] - E) < 6e-6


@pytest.mark.parametrize("h", [100, 1, 0.05, 1e-3, 1e-6])
def test_square_that_is_parallel(h):
    """The configuration factor of a square of side 2 at a height ``h`` over the receiver."""
    E = irradiance([(-1, -1, h), (1, -1, h), (1, 1, h), (-1, 1, h)], (0, 0, 0), (0, 0, 1))
    far = np.hypot(1, np.float64(np.float32(h)))
    np.testing.assert_allclose(E, 4 / far * np.arctan(1 / far), rtol=1e-6)


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e-2, 0.1, 0.19, 0.21, 0.3, 1, 3, 100])
@pytest.mark.parametrize("corners", [3, 4])
def test_random_polygons_above_the_horizon(size, corners):
    """Regular polygons with their middle at distance 1; relative error times both cosines, in units of 2^-24.

    Where the terms cancel and are summed as they are, with sizes of 0.2 and more, their rounding counts for more.
    """
    rng = np.random.default_rng(3)
    worst = 0
    for k in range(150):
        way, normal, n = random_units(3, 100 * k + corners)
        cosines = abs(way @ normal) * (way @ n)
        if min(abs(way @ normal), way @ n) < 0.3:
            continue
        x = unit(np.cross(normal, way))
        y = np.cross(normal, x)
        turn = 2 * np.pi * (np.arange(corners) / corners + rng.random())
        vertices = single(way + size * (np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y))
        n = single(n)
        truth = lambert(vertices, np.zeros(3), n)
        worst = max(worst, abs(irradiance(vertices, np.zeros(3), n)[0] / truth - 1) * cosines / EPS)
    assert 0 < worst < (100 if 0.2 < size < 1 else 16)


@pytest.mark.parametrize("size", [1e-4, 1e-2, 0.3, 1, 10, 1e3])
def test_random_polygons_anywhere(size):
    """Absolute error, to the irradiance of a surface that faces the light; half of these are cut by the horizon."""
    for k in range(200):
        way, normal, n = random_units(3, k)
        if k % 2:
            n = unit(n - (n @ way) * way + size * way * n[0])
        x = unit(np.cross(normal, way))
        o = way - 0.3 * size * x
        vertices = single(
            [o, o + size * x, o + size * x + size * np.cross(normal, x), o + size * np.cross(normal, x)]
        )
        n = single(n)
        truth = lambert(vertices, np.zeros(3), n)
        faced = min(np.pi, size**2)
        assert abs(irradiance(vertices, np.zeros(3), n)[0] - truth) < 2e-5 * faced


@pytest.mark.parametrize("lift", [-0.2, 0, 0.3, 0.9])
def test_light_partly_below_the_horizon(lift):
    """A wall that reaches below the floor gives as much as its upper part."""
    lower = single([(0.5, -1, -lift), (0.5, 1, -lift), (0.5, 1, 1), (0.5, -1, 1)])
    cut = single([(0.5, -1, max(-lift, 0)), (0.5, 1, max(-lift, 0)), (0.5, 1, 1), (0.5, -1, 1)])
    E = irradiance(lower, (0, 0, 0), (0, 0, 1))
    np.testing.assert_allclose(E, irradiance(cut, (0, 0, 0), (0, 0, 1)), rtol=1e-6)
    np.testing.assert_allclose(E, lambert(lower, np.zeros(3), np.array([0, 0, 1.0])), rtol=1e-6)


def test_light_below_the_horizon_or_edge_on():
    assert irradiance(wall(1), (0, 0, 1.5), (0, 0, 1))[0] == 0
    assert irradiance(wall(1), (0, 0, 1), (0, 0, 1))[0] == 0
    assert irradiance(wall(1), (1, 0, -2), (0, 0, 1))[0] < 4 * EPS
    assert irradiance(wall(1), (1, 0, -2), (0.6, 0, 0.8))[0] < 4 * EPS


def test_order_and_start_of_the_vertices():
    vertices, n = wall(0.3), (0.6, 0, 0.8)
    E = [
        irradiance(np.roll(order, k, 0), (0, 0.2, 0.1), n)[0]
        for order in (vertices, vertices[::-1])
        for k in range(4)
    ]
    np.testing.assert_allclose(E, E[0], rtol=1e-6)


def test_shapes_use_it():
    o, ex, ey, p, n = (0.3, -1, 0.2), (0, 2, 0), (0, 0, 1), (0, 0.1, 0), unit([0.1, 0.2, 0.9])
    whole = a_rectangle(rectangle, o, ex, ey).irradiance(p, n)
    corners = single([o, np.add(o, ex), np.add(np.add(o, ex), ey), np.add(o, ey)])
    halves = [a_triangle(triangle, corners[0], corners[k], corners[k + 1]).irradiance(p, n) for k in (1, 2)]
    np.testing.assert_allclose(whole, lambert(corners, np.zeros(3) + single(p), single(n)), rtol=2e-6)
    np.testing.assert_allclose(halves[0] + halves[1], whole, rtol=2e-6)


def test_oracle_and_clipping_are_needed():
    """Without clipping, with the vertices' cosines clamped or with a light of half the size the check fails."""
    n = np.array([0, 0, 1.0])
    below = single([(0.5, -1, -0.5), (0.5, 1, -0.5), (0.5, 1, 1), (0.5, -1, 1)])
    E = irradiance(below, (0, 0, 0), n)[0]
    unclipped = sum(
        np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b) * unit(np.cross(a, b)) @ n / 2
        for a, b in zip(below, np.roll(below, -1, 0), strict=True)
    )
    assert abs(abs(unclipped) / E - 1) > 0.1
    assert abs(lambert(below * [1, 0.5, 1], np.zeros(3), n) / E - 1) > 0.1


def test_small_polygons_need_what_cancels_taken_out():
    """The textbook's form in single precision is wrong by more than 1e-4 at a size of 1e-3."""
    vertices = np.float32([(1, 0, 0), (1, 1e-3, 0), (1, 1e-3, 1e-3), (1, 0, 1e-3)]) + np.float32(
        [0, 0.3, 0.4]
    )
    n = np.float32(unit([1, 0.2, 0.5]))
    total = np.float32(0)
    for a, b in zip(vertices, np.roll(vertices, -1, 0), strict=True):
        cross = np.cross(a, b)
        total += np.arctan2(np.linalg.norm(cross), a @ b) * (cross @ n) / np.linalg.norm(cross)
    truth = lambert(np.float64(vertices), np.zeros(3), np.float64(n))
    assert abs(abs(total) / 2 / truth - 1) > 1e-4
    assert abs(irradiance(vertices, np.zeros(3), n)[0] / truth - 1) < 2e-6
