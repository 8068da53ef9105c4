"""Intervals: exact cases, what comes out of too little data, and what is printed. Coverage is in test_coverage.py."""

import json

import numpy as np
import pytest
from scipy import stats

from whitted.stats.intervals import Interval, bootstrap_t, mean, midmean, percentile, student

VALUES = np.random.default_rng(1).gamma(4, 1, 16)
SOME = np.random.default_rng(2).gamma(4, 1, 11)


def means(values):
    return lambda weights: mean(values, weights)


def test_students_interval_is_scipys():
    found = student(VALUES, level=0.9)
    expected = stats.t.interval(0.9, 15, VALUES.mean(), stats.sem(VALUES))
    assert (found.low, found.high) == pytest.approx(expected)
    assert found.value == pytest.approx(VALUES.mean())


def test_places_have_intervals_of_their_own():
    columns = np.random.default_rng(3).normal(0, 1, (8, 2, 5))
    for method in (student, lambda x: bootstrap_t(means(x), len(x)), lambda x: percentile(means(x), len(x))):
        together, alone = method(columns), method(columns[:, 1, 3])
        assert together.low.shape == (2, 5)
        np.testing.assert_allclose([together.low[1, 3], together.high[1, 3]], [alone.low, alone.high])


def test_the_jackknife_of_a_mean_is_its_standard_error():
    """A bootstrap-t whose quantiles are divided out: both ends are the standard error times a quantile of t*."""
    rng = np.random.default_rng(0)
    weights = rng.multinomial(16, np.full(16, 1 / 16), 1999)
    drawn = np.stack([np.repeat(VALUES, row) for row in weights])
    t = np.sort((drawn.mean(1) - VALUES.mean()) / stats.sem(drawn, axis=1))
    found = bootstrap_t(means(VALUES), 16)
    assert found.low == pytest.approx(VALUES.mean() - t[1949] * stats.sem(VALUES))
    assert found.high == pytest.approx(VALUES.mean() - t[49] * stats.sem(VALUES))


def test_the_percentile_bootstrap_takes_the_resamples_as_they_are():
    weights = np.random.default_rng(0).multinomial(16, np.full(16, 1 / 16), 1999)
    drawn = np.sort(weights @ VALUES / 16)
    found = percentile(means(VALUES), 16)
    assert (found.low, found.high) == pytest.approx((drawn[49], drawn[1949]))


def test_weights_are_repetitions():
    weights = np.array([[2.0, 0.0, 1.0, 3.0], [1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 0.0, 0.0]])
    values = np.array([[3.0, 1.0], [1.0, 2.0], [7.0, np.nan], [4.0, 8.0]])
    repeated = [np.repeat(values, row.astype(int), axis=0) for row in weights]
    np.testing.assert_allclose(mean(values[:, 0], weights), [r[:, 0].mean() for r in repeated])
    fourfold = [np.repeat(r, 4, axis=0) for r in repeated]  # whose quarters are whole numbers
    expected = [[stats.trim_mean(c[~np.isnan(c)], 0.25) for c in r.T] for r in fourfold]
    np.testing.assert_allclose(midmean(values, weights), expected)
    assert mean(values, weights[0]).shape == (2,)
    assert midmean(values, np.ones((5, 4, 4))).shape == (5, 4, 2)
    assert np.isnan(midmean(values[:, 1], np.array([0.0, 0.0, 1.0, 0.0])))


def test_equal_seeds_give_equal_intervals():
    assert bootstrap_t(means(VALUES), 16, seed=3) == bootstrap_t(means(VALUES), 16, seed=3)
    assert bootstrap_t(means(VALUES), 16, seed=3) != bootstrap_t(means(VALUES), 16, seed=4)


def test_intervals_follow_shift_scale_and_inversion():
    found, moved = bootstrap_t(means(VALUES), 16), bootstrap_t(means(5 - 2 * VALUES), 16)
    assert (5 - moved.high) / 2 == pytest.approx(found.low)
    assert (5 - moved.low) / 2 == pytest.approx(found.high)

    def ratio(v, w):
        return mean(VALUES, v) / mean(SOME, w)

    found = bootstrap_t(ratio, 16, 11, scale="log")
    inverse = bootstrap_t(lambda v, w: 1 / ratio(v, w), 16, 11, scale="log")
    assert (1 / inverse.high, 1 / inverse.value, 1 / inverse.low) == pytest.approx(
        (found.low, found.value, found.high)
    )


def test_pairs_cancel_what_is_common():
    common = np.exp(np.random.default_rng(5).standard_normal(16))
    paired = bootstrap_t(lambda w: mean(2 * common, w) / mean(common, w), 16, scale="log")
    assert (paired.low, paired.high) == pytest.approx((2, 2))
    apart = bootstrap_t(lambda v, w: mean(2 * common, v) / mean(common, w), 16, 16, scale="log")
    assert apart.high / apart.low > 2


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_equal_values_leave_no_doubt(scale):
    found = bootstrap_t(means(np.full(8, 2.5)), 8, scale=scale)
    assert (found.value, found.low, found.high) == pytest.approx((2.5, 2.5, 2.5), rel=1e-14)
    nothing = bootstrap_t(means(np.zeros(8)), 8, scale=scale)
    assert (nothing.value, nothing.low, nothing.high) == (0, 0, 0)
    found = student(np.full(8, 2.5))
    assert (found.low, found.high) == (2.5, 2.5)


def test_without_an_interval_the_ends_are_nan():
    for values in ([2.0], [1.0, np.nan, 3.0]):
        for found in (student(values), bootstrap_t(means(values), len(values))):
            assert np.isnan([found.low, found.high]).all()
            assert not found.holds(2.0)
    assert bootstrap_t(means([2.0]), 1).value == 2
    assert np.isnan(bootstrap_t(means([-2.0, -1.0, -3.0]), 3, scale="log").value)


def test_few_replicates_bound_nothing():
    """Of two replicates half of the resamples are one alone, of five few enough."""
    assert bootstrap_t(means([1.0, 2.0]), 2).holds(1e9)
    assert bootstrap_t(means([1.0, 2.0]), 2, scale="log").low == 0
    found = bootstrap_t(means(VALUES[:5]), 5)
    assert np.isfinite([found.low, found.high]).all()


def test_resamples_without_a_value_count_as_far():
    """The mean of one in 12 resamples is negative and has no logarithm: nothing is known of the lower end."""
    values = np.array([-1.0, 1.0, 1.1, 0.9, 1.0, 1.2])
    found = bootstrap_t(means(values), 6, scale="log")
    assert found.low == 0
    assert np.isfinite(bootstrap_t(means(values), 6).low)


def test_an_unknown_scale_is_refused():
    with pytest.raises(ValueError, match="scale is 'cubic'"):
        bootstrap_t(means(VALUES), 16, scale="cubic")


@pytest.mark.parametrize(
    ("ends", "shown"),
    [
        ((2.7123, 2.6431, 2.7649), "2.71 [2.64, 2.76]"),
        ((12345.6, 12101.0, 12599.0), "12350 [12100, 12600]"),
        ((0.00123456, 0.0012, 0.0013), "0.00123 [0.00120, 0.00130]"),
        ((1.23456e-7, 1.1e-7, 1.4e-7), "1.23e-07 [1.10e-07, 1.40e-07]"),
        ((-0.5, -0.52, -0.48), "-0.500 [-0.520, -0.480]"),
        ((2.0, 2.0, 2.0), "2 [2, 2]"),
        ((2.5, np.nan, np.nan), "2.5 [nan, nan]"),
        ((2.5, 0.0, np.inf), "2.5 [0, inf]"),
    ],
)
def test_the_digits_shown_mean_something(ends, shown):
    assert str(Interval(*ends)) == shown


def test_json_holds_what_it_can():
    text = json.dumps(Interval(1.0, np.nan, np.inf, 0.9).to_dict(), allow_nan=False)
    assert json.loads(text) == {"value": 1.0, "low": None, "high": None, "level": 0.9}
    table = Interval(np.ones(2), np.zeros(2), np.array([2.0, np.inf])).to_dict()
    assert table["high"] == [2.0, None]


def test_ends_belong_to_an_interval():
    found = Interval(1.0, 0.5, 2.0)
    assert found.holds(0.5)
    assert found.holds(2.0)
    assert not found.holds(2.1)
    np.testing.assert_array_equal(Interval(*np.ones((3, 2))).holds(np.array([1, 2])), [True, False])
