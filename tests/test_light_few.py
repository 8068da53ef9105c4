"""The choice among few lights: the shares are those in a tree's node, or those in the light that is scattered."""

import mitsuba as mi
import numpy as np
import pytest
from light_trees import probabilities, random_lights, random_receivers
from scipy import stats

from whitted.lights.few import MOST, FewLights, pick
from whitted.lights.importance import BESIDE
from whitted.lights.tree import LightTree

LEVEL = 1e-4  # of a false alarm; seeds are fixed


def made(count, receivers=500, seed=3):
    lights, *_ = random_lights(count, seed)
    p, n = random_receivers(receivers, seed + 1)
    return lights, p, n


def vectors(p, n):
    return mi.Point3f(p.T), mi.Vector3f(n.T)


def shares_of(few, p, n, response=None):
    found = few.shares(*vectors(p, n), response)
    return np.array([np.array(share) for share in found], np.float64).T


@pytest.mark.parametrize("count", range(2, MOST + 1))
def test_shares_are_those_of_a_tree(count):
    lights, p, n = made(count)
    for normal in (n, 0 * n):
        found = shares_of(FewLights(*lights), p, normal)
        np.testing.assert_allclose(found, probabilities(LightTree(*lights), p, normal), rtol=2e-6, atol=1e-20)
        total = found.sum(1)
        np.testing.assert_allclose(total[total > 0], 1, rtol=1e-6)


def test_one_light_is_always_chosen():
    lights, p, n = made(1)
    few = FewLights(*lights)
    leaf, probability, valid = few.sample(few.shares(*vectors(p, n)), mi.Float(0.7))
    assert (int(leaf[0]), float(probability[0]), bool(valid[0])) == (0, 1.0, True)


def test_lights_come_up_as_often_as_their_shares_say():
    lights, p, n = made(MOST, receivers=200)
    few, tries = FewLights(*lights), 2000
    u = np.tile((np.arange(tries, dtype=np.float32) + 0.5) / tries, len(p))
    shares = few.shares(*vectors(np.repeat(p, tries, 0), np.repeat(n, tries, 0)))
    expected = np.array(shares, np.float64)
    leaf, probability, valid = (np.array(a) for a in few.sample(shares, mi.Float(u)))
    np.testing.assert_array_equal(valid, expected.sum(0) > 0)
    np.testing.assert_array_equal(probability[valid], expected[leaf, np.arange(len(u))][valid])
    assert (probability[valid] > 0).all()
    chosen = (leaf == np.arange(MOST)[:, None]) & valid
    counts = chosen.reshape(MOST, len(p), tries).mean(2)
    np.testing.assert_allclose(counts, expected.reshape(MOST, len(p), tries)[..., 0], atol=1.01 / tries)


def test_numbers_at_random():
    lights, p, n = made(MOST, receivers=1)
    few = FewLights(*lights)
    u = np.random.default_rng(5).random(100_000, np.float32)
    point, normal = vectors(np.repeat(p, len(u), 0), np.repeat(0 * n, len(u), 0))
    shares = few.shares(point, normal)
    leaf, *_ = few.sample(shares, mi.Float(u))
    counts = np.bincount(leaf.numpy(), minlength=MOST)
    expected = np.array([float(share[0]) for share in shares]) * len(u)
    assert stats.chisquare(counts, expected * counts.sum() / expected.sum()).pvalue > LEVEL


def test_the_response_takes_the_place_of_the_cosine():
    lights, p, n = made(3)
    few = FewLights(*lights)
    plain = shares_of(few, p, 0 * n)
    values = [7.0, 0.0, 0.5]

    def response(directions):
        for row, direction in zip(few.bounds, directions, strict=True):
            toward = np.array([float(x[0]) for x in row[:3]]) - p
            expected = toward / np.linalg.norm(toward, axis=1, keepdims=True)
            np.testing.assert_allclose(np.array(direction).T, expected, atol=1e-5)
        return mi.Bool(np.arange(len(p)) % 2 == 0), [mi.Float(value) for value in values]

    found = shares_of(few, p, 0 * n, response)
    np.testing.assert_allclose(found[1::2], plain[1::2], rtol=1e-5)
    weighed = plain * (np.array(values) + BESIDE)  # without a normal the mean cosine counts as 1
    expected = weighed / np.maximum(weighed.sum(1, keepdims=True), 1e-30)
    np.testing.assert_allclose(found[::2], expected[::2], rtol=1e-4, atol=1e-12)


def test_pick():
    column = [mi.Float(k + 0.5) for k in range(4)]
    np.testing.assert_array_equal(pick(column, mi.UInt32([3, 0, 2, 1])).numpy(), [3.5, 0.5, 2.5, 1.5])
    assert pick(column, 2) is column[2]
