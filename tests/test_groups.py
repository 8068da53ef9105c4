"""Samples are shared out over groups without gap or overlap, and the moments of groups are what they say."""

import numpy as np
import pytest

from whitted.sampling.groups import SEGMENTS, Replicates, Segments
from whitted.stats.moments import Moments

RNG = np.random.default_rng(5)


def members(groups, start, stop):
    """Return the samples of each group in passes from ``start`` to ``stop``, as a dict from sample to group."""
    found = {}
    while start < stop:
        end = groups.end(start, stop - start)
        assert start < end <= stop
        for group, first, stride, count in groups.pieces(start, end):
            assert 0 <= group < groups.count
            for number in range(first, first + stride * count, stride):
                assert start <= number < end
                assert number not in found
                found[number] = group
        start = end
    return found


@pytest.mark.parametrize(
    "groups", [Segments(0), *(Replicates(0, count) for count in (1, 2, 3, 8, 100))], ids=str
)
def test_every_range_is_shared_out_exactly(groups):
    whole = members(groups, 0, 300)
    assert sorted(whole) == list(range(300))
    for start in (0, 1, 5, 7, 8, 9, 31, 64, 100):
        for length in (1, 2, 7, 8, 9, 40, 64, 199):
            part = members(groups, start, start + length)
            assert part == {number: whole[number] for number in range(start, start + length)}


@pytest.mark.parametrize("power", range(3, 12))
def test_segments_are_equal_and_aligned_at_powers_of_two(power):
    found = members(Segments(0), 0, 2**power)
    for group in range(SEGMENTS):
        assert sum(g == group for g in found.values()) == 2**power // SEGMENTS
    octave = 2 ** (power - 1)
    last = [number for number, group in found.items() if group == 5 and number >= octave]
    if power > 3:
        assert last[0] % len(last) == 0
        assert last == list(range(last[0], last[0] + octave // SEGMENTS))


def test_large_numbers():
    start = 2**30 + 12345
    pieces = list(Segments(0).pieces(start, start + 1000))
    assert pieces == [(0, start, 1, 1000)]
    assert sum(count for *_, count in Replicates(0, 7).pieces(start, start + 1000)) == 1000


def random_moments(groups, shape=(3, 4), channels=2):
    return Moments(RNG.normal(1, 1, (groups, *shape, channels)), RNG.uniform(1, 2, (groups, *shape)))


def brute_force_error(sums, weights):
    """The standard error of a ratio at one pixel, written out."""
    groups, ratio = len(sums), sum(sums) / sum(weights)
    residuals = [s - ratio * w for s, w in zip(sums, weights, strict=True)]
    return np.sqrt(groups / (groups - 1) * sum(r * r for r in residuals)) / sum(weights)


@pytest.mark.parametrize("groups", [2, 3, 8])
def test_moments_against_sums_written_out(groups):
    moments = random_moments(groups)
    mean, stderr = moments.mean(), moments.standard_error()
    for y, x, c in np.ndindex(mean.shape):
        sums, weights = moments.sums[:, y, x, c], moments.weights[:, y, x]
        assert mean[y, x, c] == pytest.approx(sums.sum() / weights.sum(), rel=1e-6)
        assert stderr[y, x, c] == pytest.approx(brute_force_error(sums, weights), rel=1e-6)


def test_equal_weights_give_the_textbook_error():
    values = RNG.normal(3, 1, (6, 2, 2, 1))
    moments = Moments(values * 5, np.full((6, 2, 2), 5.0))
    np.testing.assert_allclose(moments.standard_error(), values.std(0, ddof=1) / np.sqrt(6), rtol=1e-6)
    mean, error = moments.image_mean()
    assert mean == pytest.approx(values.mean(), rel=1e-6)
    assert error == pytest.approx(values.mean((1, 2, 3)).std(ddof=1) / np.sqrt(6), rel=1e-6)


def test_error_of_the_image_mean_sees_correlation_between_pixels():
    common = RNG.normal(3, 1, (8, 1, 1, 1)) + np.zeros((8, 5, 5, 1))
    error = Moments(common, np.ones((8, 5, 5))).image_mean()[1]
    assert error == pytest.approx(common[:, 0, 0, 0].std(ddof=1) / np.sqrt(8), rel=1e-6)


def test_standard_error_is_unbiased_in_square():
    """4000 draws of 4 groups: the mean of the squares is within 6 % with a probability of 1 - 1e-6."""
    values = RNG.normal(0, 1, (4, 4000, 1, 1)) + 10
    moments = Moments(values * 3, np.full((4, 4000, 1), 3.0))
    assert np.mean(moments.standard_error().astype(np.float64) ** 2) == pytest.approx(1 / 4, rel=0.1)


def test_adding_is_summing_and_absent_groups_are_empty():
    few, many = random_moments(2), random_moments(5)
    for total in (few + many, many + few):
        np.testing.assert_allclose(total.sums[:2], few.sums + many.sums[:2])
        np.testing.assert_array_equal(total.weights[2:], many.weights[2:])


def test_below_two_groups_there_is_no_error():
    assert random_moments(1).standard_error() is None
    assert random_moments(1).image_mean()[1] is None
    padded = random_moments(1) + Moments(np.zeros((3, 3, 4, 2)), np.zeros((3, 3, 4)))
    assert padded.standard_error() is None, "empty groups don't count"


def test_pixels_without_samples_are_black_and_raise_no_warning():
    moments = random_moments(3)
    moments.sums[:, 1, 1], moments.weights[:, 1, 1] = 0, 0
    assert not moments.mean()[1, 1].any()
    assert not moments.standard_error()[1, 1].any()
