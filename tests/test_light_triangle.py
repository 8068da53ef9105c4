"""Sampling of triangles by solid angle: against solid angles in long double, Lambert's formula and its density."""

import mitsuba as mi
import numpy as np
import pytest
from lights import (
    LEVEL,
    a_triangle,
    check_consistency,
    chi_square,
    hull,
    lambert,
    moments,
    point,
    pooled_chi_square,
    random_numbers,
    random_units,
    single,
    solid_angle,
    unit,
)

from whitted.lights import triangle, warp

NONE = (0, 0, 0)


def wall(d):
    """The halves of a wall light [d] x [-1, 1] x [0, 1] above the floor."""
    return ((d, -1, 0), (d, 1, 0), (d, 1, 1)), ((d, -1, 0), (d, 1, 1), (d, -1, 1))


PLACES = {  # vertices, receiver's normal
    "faced": (((-1, -1, 1), (1, -1, 1), (0, 1, 1)), (0, 0, 1)),
    "faced askew": (((-0.3, -1, 1), (1, -0.2, 0.8), (0.2, 1, 1.2)), unit([0.5, -0.3, 0.8])),
    "aside": (((1, -1, 0.3), (2, -1, 0.3), (1, 1, 0.3)), (1, 0, 0)),
    "close": (((-1, -1, 0.2), (1, -1, 0.2), (0, 1, 0.2)), unit([0.2, 0.1, 1])),
    "touching the floor by a side": (wall(0.3)[0], (0, 0, 1)),
    "touching the floor by a vertex": (wall(0.3)[1], (0, 0, 1)),
    "partly below": (((-1, -1, 0.5), (1, -1, 0.5), (0, 1, 0.5)), unit([1, 0.2, 0.1])),
    "mostly below": (((-1, -1, 0.5), (1, -1, 0.5), (0, 1, 0.5)), unit([1, 0.2, -0.7])),
    "sliver": (((-1, 0, 0.5), (1, 0.01, 0.5), (0.5, 0.08, 0.5)), unit([0.3, 0, 1])),
    "far": (((40, 0, 300), (41, 0, 300), (40, 1, 301)), unit([0.3, 0.2, 0.5])),
    "very far": (((3e3, 0, 1e4), (3e3 + 1, 0, 1e4), (3e3, 1, 1e4)), unit([0.3, 0.2, 0.5])),
}


def away(vertices):
    """The distance of the farthest vertex over the shortest altitude."""
    a, b, c = single(vertices)
    sides = [np.linalg.norm(v) for v in (b - a, c - b, a - c)]
    return 1 + max(np.linalg.norm(v) for v in (a, b, c)) * max(sides) / np.linalg.norm(np.cross(b - a, c - a))


def length_over_distance(a, b):
    """The length of a side over its distance from the origin."""
    side = b - a
    length = np.linalg.norm(side, axis=-1)
    foot = a + np.clip(-(a * side).sum(-1) / length**2, 0, 1)[:, None] * side
    return length / np.linalg.norm(foot, axis=-1)


@pytest.mark.parametrize("size", [1e-4, 1e-2, 1, 100])
def test_solid_angle_of_random_triangles(size):
    """The density for no normal is one over it. Vertices on a sphere about a point at distance 1, and rounded.

    A receiver near a side is allowed an error of 3e-7 times the side's length over its distance.
    """
    count = 20_000
    middle = random_units(count, 1)
    corners = [single(middle + size * random_units(count, k)) for k in (2, 3, 4)]
    pdf = triangle.pdf(*map(point, corners), point(NONE), mi.Vector3f(0), point(corners[0]))
    truth = solid_angle(*corners, NONE)
    lower, upper = 0, 0
    for k in range(3):

        def moved(step, k=k):
            return solid_angle(*(corner + step * (i == k) for i, corner in enumerate(corners)), NONE)

        least, largest = hull(moved, np.zeros(3), max(1, size))
        lower, upper = lower + least - truth, upper + largest - truth
    lower = np.where(upper > truth, -truth, lower)  # seen edge on within rounding
    found = 1 / np.array(pdf, np.float64)
    near = np.max([length_over_distance(corners[k - 1], corners[k]) for k in range(3)], 0)
    assert (found > (truth + lower) * (1 - 2e-6 - 3e-7 * near)).all()
    assert (found < (truth + upper) * (1 + 2e-6 + 3e-7 * near)).all()
    assert np.median(abs(found / truth - 1)) < 1e-6


@pytest.mark.parametrize("name", PLACES)
def test_estimates_have_the_irradiance_as_mean(name):
    """By quadrature, to which the horizon's kink costs accuracy; with the receiver's normal preferred and without."""
    vertices, n = PLACES[name]
    light = a_triangle(triangle, *vertices)
    E = lambert(single(vertices), NONE, single(n))
    for preference in (n, NONE):
        mean, _, _ = moments(light, NONE, n, preference, k=512)
        assert abs(mean / E - 1) < (1e-3 if "below" in name else 2e-5)
    np.testing.assert_allclose(light.irradiance(NONE, n), E, rtol=1e-5)


def test_mean_needs_the_density_of_the_warp(monkeypatch):
    """Without the warp's factor in the density the mean is off."""
    vertices, n = PLACES["faced askew"]
    monkeypatch.setattr(warp, "bilinear_pdf", lambda t, weights: 1)
    mean, _, _ = moments(a_triangle(triangle, *vertices), NONE, n)
    assert abs(mean / lambert(single(vertices), NONE, single(n)) - 1) > 0.01


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_density_is_that_of_the_samples(name, preferred):
    vertices, n = PLACES[name]
    check_consistency(a_triangle(triangle, *vertices), n if preferred else NONE, away(vertices), sharp=16)


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_samples_follow_the_density(name, preferred):
    """22 tests of level 1e-4: 0.22 %; the density integrates to 1."""
    vertices, n = PLACES[name]
    light = a_triangle(triangle, *vertices)
    edges = [np.linspace(0, 1, 13)] * 2
    p_value, mass = chi_square(light, NONE, n if preferred else NONE, edges, parts=16)
    assert abs(mass - 1) < 1e-3
    assert p_value > LEVEL


@pytest.mark.parametrize("name", PLACES)
def test_samples_are_uniform_by_solid_angle(name):
    """11 tests of level 1e-4: 0.11 %. Over 144 triangles of equal area, whose solid angles are known."""
    vertices, _ = PLACES[name]
    a, b, c = single(vertices)
    light = a_triangle(triangle, a, b, c)
    q = np.array(light("sample", NONE, NONE, random_numbers(100_000, 2))[0], np.float64).T
    k = 12
    frame = np.linalg.pinv(np.stack([b - a, c - a], 1))
    x, y = np.clip((q - a) @ frame.T, 0, 1 - 1e-9).T * k
    upper = (x % 1 + y % 1 > 1).astype(int)
    counts = np.zeros((k + 1, k + 1, 2))
    np.add.at(counts, (x.astype(int), y.astype(int), upper), 1)
    i, j, up = np.nonzero(np.add.outer(np.add.outer(np.arange(k + 1), np.arange(k + 1)), [0, 1]) < k)

    def corner(di, dj):
        return (
            a
            + ((i + up + di * (1 - 2 * up)) / k)[:, None] * (b - a)
            + ((j + up + dj * (1 - 2 * up)) / k)[:, None] * (c - a)
        )

    omega = np.float64(solid_angle(corner(0, 0), corner(1, 0), corner(0, 1), NONE))
    assert abs(omega.sum() / np.float64(solid_angle(a, b, c, NONE)) - 1) < 1e-9
    assert pooled_chi_square(counts[i, j, up], omega / omega.sum() * 100_000) > LEVEL


def test_a_wrong_distribution_would_be_noticed():
    """Area sampling fails the same test, and so do warped samples with the density of others."""
    vertices, n = PLACES["faced askew"]
    light = a_triangle(triangle, *vertices)
    u = random_numbers(100_000, 1)
    flat = mi.warp.square_to_uniform_triangle(u)
    a, b, c = light.arguments
    q = {"area": a + flat.x * (b - a) + flat.y * (c - a), "warped": light("sample", NONE, n, u)[0]}

    class Swapped:
        pdf = triangle.pdf
        area = staticmethod(lambda *_: (q["area"],))
        warped = staticmethod(lambda *_: (q["warped"],))

    light.module = Swapped
    edges = [np.linspace(0, 1, 13)] * 2
    assert chi_square(light, NONE, NONE, edges, sampled="area")[0] < 1e-10
    assert chi_square(light, NONE, NONE, edges, sampled="warped")[0] < 1e-10
    assert chi_square(light, NONE, n, edges, sampled="area")[0] < 1e-10


@pytest.mark.parametrize("d", [1, 0.1, 0.01, 1e-3])
@pytest.mark.parametrize("half", [0, 1])
def test_spread_is_bounded_as_the_light_is_touched(d, half):
    """Half a wall light from the floor at a distance ``d``; near a side rounding changes the solid angle."""
    vertices = wall(d)[half]
    light = a_triangle(triangle, *vertices)
    E = lambert(single(vertices), NONE, np.array([0, 0, 1.0]))
    for preference, bound in (((0, 0, 1), 0.36), (NONE, 0.66)):
        mean, spread, largest = moments(light, NONE, (0, 0, 1), preference)
        assert abs(mean / E - 1) < 2e-5 + 2e-7 / d
        assert spread < bound
        assert largest < 3
