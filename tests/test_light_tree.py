"""The choice among many lights: exact shares, the whole of each distribution, and bounds that leave no light out.

Seeds are fixed. Had they been drawn at random, the one statistical test here would fail for correct code with a
probability of at most 2e-4; all others are exact to the tolerance that they state.
"""

import mitsuba as mi
import numpy as np
import pytest
from light_trees import irradiance, probabilities, random_lights, random_receivers, sample, shares, unit
from scipy import integrate, stats

from whitted.lights.tree import LightTree
from whitted.lights.tree_build import WIDTH, orientation_measure

LEVEL = 1e-4  # of one comparison


# ---- The importance


@pytest.mark.parametrize(("cos_spread", "cos_emission"), [(1, 0), (-1, 0), (0.3, 0), (-0.6, 0.5), (0.9, 0.8)])
def test_orientation_measure_is_its_integral(cos_spread, cos_emission):
    spread, reach = np.arccos(cos_spread), np.arccos(cos_emission)
    end = min(spread + reach, np.pi)
    rim, _ = integrate.quad(lambda t: np.cos(t - spread) * np.sin(t), spread, end)
    expected = 2 * np.pi * (1 - cos_spread + rim)
    assert orientation_measure(cos_spread, cos_emission) == pytest.approx(expected, rel=1e-9)


def grazes_nothing(lights, p, n):
    """Tell which receivers see each light either well above their horizon and its own, or not at all."""
    w = unit((lights[0] + lights[1])[None] / 2 - p[:, None].astype(np.float64))
    cosines = np.stack([(w * n[:, None]).sum(-1), np.where(lights[4] == 1, -(w * lights[3]).sum(-1), 1)])
    return (np.abs(cosines) > 0.01).all((0, 2)) & (cosines > 0).all(0).any(1)


SMALL = [(2, ("point",)), (2, ("flat",)), (WIDTH, ("point",)), (WIDTH, ("point", "flat"))]


@pytest.mark.parametrize(("count", "kinds"), SMALL)
def test_small_lights_are_chosen_by_their_share_in_the_irradiance(count, kinds):
    lights, _, _ = random_lights(count, 5, 0, kinds)
    p, n = random_receivers(3000, 6)
    kept = grazes_nothing(lights, p, n)
    assert kept.sum() > 500
    p, n = p[kept], n[kept]
    expected = shares(irradiance(lights, p, n))
    np.testing.assert_allclose(probabilities(LightTree(*lights), p, n), expected, rtol=2e-4, atol=1e-6)
    mutants = {
        "power": (*lights[:2], np.ones(count), *lights[3:]),
        "distance": ((lights[0] - p[0]) * 2 + p[0], (lights[1] - p[0]) * 2 + p[0], *lights[2:]),
    }
    for mutant in mutants.values():
        assert np.abs(probabilities(LightTree(*mutant), p, n) - expected).max() > 0.1
    assert np.abs(probabilities(LightTree(*lights), p, 0 * n) - expected).max() > 0.1
    if "flat" in kinds:
        turned = (*lights[:3], -lights[3], *lights[4:])
        assert np.abs(probabilities(LightTree(*turned), p, n) - expected).max() > 0.1


def test_a_distant_sphere_counts_as_a_point_of_its_power():
    at = np.array([[0.0, 0, 50], [30, 0, 40]])
    for h in (0.0, 0.05):
        tree = LightTree(at - h, at + h, [1, 2], at, [-1, -1], [0, 0])
        found = probabilities(tree, np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32))
        np.testing.assert_allclose(found, [[1 / 2.6, 1.6 / 2.6]], rtol=1e-4)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_of_length_and_power_do_not_matter(scale):
    lights, _, _ = random_lights(100, 3)
    p, n = random_receivers(50, 4)
    scaled = LightTree(lights[0] * scale, lights[1] * scale, lights[2] * scale, *lights[3:])
    found, expected = probabilities(scaled, p * np.float32(scale), n), probabilities(LightTree(*lights), p, n)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-6)


# ---- The distribution


@pytest.mark.parametrize("count", [1, 2, 3, WIDTH, WIDTH + 1, 100, 1500])
@pytest.mark.parametrize("seed", [1, 2])
def test_probabilities_add_up_to_one_where_no_light_faces_away(count, seed):
    lights, _, _ = random_lights(count, seed, kinds=("point", "sphere"))
    p, n = random_receivers(40, seed)
    np.testing.assert_allclose(probabilities(LightTree(*lights), p, 0 * n).sum(1), 1, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, WIDTH, WIDTH + 1, 60, 700])
def test_each_light_has_its_interval_of_numbers(count):
    """Evenly spaced numbers meet each light as often as its probability says, to a few of 2^15, and so no light."""
    size, few = 1 << 15, 3
    lights, _, _ = random_lights(count, count)
    tree = LightTree(*lights)
    p, n = random_receivers(20, 7)
    expected = probabilities(tree, p, n)
    spoilt = 0
    for receiver in range(len(p)):
        u = (np.arange(size) + 0.5) / size
        leaf, probability, rest, valid = sample(tree, p[receiver], n[receiver], u)
        counts = np.bincount(leaf[valid], minlength=count)
        assert (np.abs(counts - size * expected[receiver]) <= few).all()
        assert abs(valid.sum() - size * expected[receiver].sum()) <= few
        np.testing.assert_allclose(probability, np.where(valid, expected[receiver][leaf], 0), rtol=1e-5)
        assert ((rest >= 0) & (rest < 1)).all()
        for light in np.flatnonzero(counts > 100):
            inside = np.sort(rest[valid & (leaf == light)])
            even = (np.arange(len(inside)) + 0.5) / len(inside)
            assert np.abs(inside - even).max() <= few / len(inside)
            spoilt += np.abs(inside**2 - even).max() > few / len(inside)
    assert spoilt > 0 or not expected.any()


def test_lights_are_met_as_often_as_they_should_over_random_receivers():
    """One test of level 1e-4 for the lights and one for the remaining digits in 16 cells."""
    lights, _, _ = random_lights(40, 8)
    tree = LightTree(*lights)
    p, n = random_receivers(20000, 9)
    u = np.random.default_rng(10).random(len(p), np.float32)
    leaf, _, rest, valid = sample(tree, p, n, u)
    expected = probabilities(tree, p, n).sum(0)
    often = expected > 20
    observed = np.append(np.bincount(leaf[valid], minlength=40)[often], 0)
    observed[-1] = len(p) - observed.sum()
    expected = np.append(expected[often], len(p) - expected[often].sum())
    assert stats.chisquare(observed, expected).pvalue > LEVEL
    assert stats.chisquare(np.histogram(rest[valid], 16, (0, 1))[0]).pvalue > LEVEL
    uniform = np.full(len(expected), len(p) / len(expected))
    assert stats.chisquare(observed, uniform).pvalue < 1e-10


# ---- Bounds


def left_out(tree, points, normals, p, n):
    """Count pairs of a receiver and a light of which some point faces the other, of probability 0; and all pairs."""
    found = probabilities(tree, p, n)
    w = points[None] - p[:, None, None].astype(np.float64)
    in_front = np.einsum("mnkj,mj->mnk", w, n.astype(np.float64)) > 0
    facing = ~(np.einsum("mnkj,nkj->mnk", w, normals) >= 0)  # also points, which have no normal
    contributes = (in_front & facing).any(2)
    return (contributes & ~(found > 0)).sum(), contributes.sum()


def hard_receivers(points, count, seed):
    """Receivers near and on the lights, many of them with their horizon through a point of a light."""
    rng = np.random.default_rng(seed)
    p, n = random_receivers(count, seed)
    p += np.float32(points.min((0, 1)).round())
    target = points[rng.integers(len(points), size=count), rng.integers(points.shape[1], size=count)]
    near = rng.random(count) < 0.5
    beside = target + unit(rng.normal(size=(count, 3))) * 10 ** rng.uniform(-6, -1, (count, 1))
    p[near] = np.float32(beside)[near]
    w = unit(target - p)
    grazing = rng.random(count) < 0.7
    across = unit(n - (n * w).sum(1, keepdims=True) * w + 1e-5 * rng.normal(size=(count, 3)))
    n[grazing] = np.float32(across)[grazing]
    return p, n


SIZES = [0.0, 1e-4, 0.05, 0.5]


@pytest.mark.parametrize("offset", [0, 3000])
@pytest.mark.parametrize("extent", SIZES)
def test_no_light_that_contributes_is_left_out(extent, offset):
    """Over the four sizes, and in either place, 1e5 pairs that contribute."""
    pairs = 0
    for count in (1, 5, 30, 200):
        (lower, upper, *rest), points, normals = random_lights(count, count, extent)
        tree, points = LightTree(lower + offset, upper + offset, *rest), points + offset
        p, n = hard_receivers(points, 18000 // count, count)
        missing, contributing = left_out(tree, points, normals, p, n)
        assert missing == 0
        pairs += contributing
    assert pairs > 25000


@pytest.mark.parametrize(("column", "value"), [(3, 0), (6, -1), (8, 1), (10, 0.9)])
def test_bounds_that_are_too_tight_would_be_noticed(column, value):
    """Radius, axis, cone and angle of emission, each made wrong in all nodes."""
    lights, points, normals = random_lights(200, 200, 0.5)
    p, n = hard_receivers(points, 90, 200)
    tree = LightTree(*lights)
    bounds = np.array(tree.bounds).reshape(-1, 12)
    bounds[:, column] = value
    if column == 8:
        bounds[:, 9] = 0
    tree.bounds = mi.Float(bounds.ravel())
    missing, _ = left_out(tree, points, normals, p, n)
    assert missing > 100


def test_a_light_behind_the_horizon_or_facing_away_is_never_chosen():
    at = np.array([[0.0, 0, 1], [0, 0, -1], [0, 1, 1]])
    tree = LightTree(
        at - 0.01, at + 0.01, np.ones(3), [[0, 0, -1], [0, 0, 1], [0, 0, 1]], np.ones(3), np.zeros(3)
    )
    up = np.array([[0, 0, 1]], np.float32)
    np.testing.assert_array_equal(probabilities(tree, 0 * up, up), [[1, 0, 0]])
    np.testing.assert_array_equal(probabilities(tree, 0 * up, -up), [[0, 1, 0]])
    valid = sample(tree, [0, 0, 3], [0, 0, 1], [0.5])[3]
    assert not valid.any()


def test_light_of_a_narrow_beam_stays_in_the_beam():
    at = np.array([[0.0, 0, 1], [2, 0, 1]])
    down = np.array([[0, 0, -1.0]] * 2)
    tree = LightTree(at, at, np.ones(2), down, np.ones(2), np.full(2, np.cos(np.radians(30))))
    x = np.tan(np.radians([0, 29, 31, 45]))
    p = np.stack([x, 0 * x, 0 * x], 1).astype(np.float32)
    n = np.tile(np.float32([0, 0, 1]), (4, 1))
    np.testing.assert_array_equal(probabilities(tree, p, n) > 0, [[1, 0], [1, 0], [0, 0], [0, 0]])


# ---- The variance


def relative_variances(E, probability):
    """The mean over receivers of the relative variance of ``E / probability`` for one light chosen."""
    total = E.sum(1)
    kept = total > 1e-3 * np.median(total[total > 0])
    E = E[kept] / total[kept, None]
    probability = np.broadcast_to(probability, (len(kept), E.shape[1]))[kept]
    return np.mean((E**2 / np.maximum(probability, 1e-99)).sum(1)) - 1


@pytest.mark.parametrize(("count", "gain"), [(4, 1e6), (16, 4), (64, 7), (1024, 50)])
def test_variance_is_that_much_lower_than_of_even_choice(count, gain):
    """From the probabilities themselves, so without noise. With the powers of other lights the gain is lost."""
    lights, _, _ = random_lights(count, count, 0, ("point", "flat"))
    p, n = random_receivers(100000 // count, 11)
    if count <= WIDTH:
        kept = grazes_nothing(lights, p, n)
        p, n = p[kept], n[kept]
    E = irradiance(lights, p, n)

    def variance(lights):
        return max(relative_variances(E, probabilities(LightTree(*lights), p, n)), 1e-6)

    even = relative_variances(E, 1 / count)
    assert even / variance(lights) > gain
    assert not even / variance((*lights[:2], np.roll(lights[2], 1), *lights[3:])) > gain
