"""Running moments: against SciPy's, merged in any parts, and where the mean exceeds the spread by far."""

import numpy as np
import pytest
from scipy import stats

from whitted.stats.running import Running

VALUES = np.random.default_rng(1).exponential(1, (37, 4, 3))


def test_moments_are_scipys():
    found = Running.of(VALUES)
    assert found.count == 37
    np.testing.assert_allclose(found.mean, VALUES.mean(0), rtol=1e-13)
    np.testing.assert_allclose(found.variance(), VALUES.var(0, ddof=1), rtol=1e-13)
    np.testing.assert_allclose(found.standard_error(), stats.sem(VALUES), rtol=1e-13)
    np.testing.assert_allclose(found.skewness(), stats.skew(VALUES, bias=False), rtol=1e-12)
    np.testing.assert_allclose(found.excess_kurtosis(), stats.kurtosis(VALUES, bias=False), rtol=1e-12)


def test_values_by_hand():
    """Of 1, 2, 3, 6: deviations -2, -1, 0, 3, so m2 = 14, m3 = 18, m4 = 98."""
    found = Running.of([1.0, 2.0, 3.0, 6.0])
    assert (found.mean, found.m2, found.m3, found.m4) == (3, 14, 18, 98)
    assert found.variance() == pytest.approx(14 / 3)


@pytest.mark.parametrize("cuts", [(1,), (5, 6, 20), range(1, 37)])
def test_parts_merge_to_the_whole(cuts):
    whole, merged = Running.of(VALUES), Running()
    for part in np.split(VALUES, list(cuts)):
        merged = merged.add(part)
    assert merged.count == whole.count
    for name in ("mean", "m2", "m3", "m4"):
        np.testing.assert_allclose(getattr(merged, name), getattr(whole, name), rtol=1e-11, err_msg=name)


def test_merging_is_deterministic():
    parts = [Running.of(part) for part in np.split(VALUES, [3, 17])]
    first, again = (parts[0] + parts[1] + parts[2] for _ in range(2))
    for name in ("mean", "m2", "m3", "m4"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


def test_nothing_is_a_neutral_element():
    whole = Running.of(VALUES)
    for merged in (whole + Running(), Running() + whole, whole.add(VALUES[:0])):
        np.testing.assert_array_equal(merged.m4, whole.m4)
    assert (Running() + Running()).count == 0
    assert np.isnan(Running().variance())
    assert np.isnan(Running.of([2.0]).standard_error())


@pytest.mark.parametrize(("offset", "dtype"), [(1e8, np.float64), (1e4, np.float32)])
def test_nothing_cancels_where_the_mean_is_large(offset, dtype):
    """The truth is that of the values as rounded to their type; sums of squares in that type are far off."""
    values = (offset + np.random.default_rng(2).standard_normal(4096)).astype(dtype)
    shifted = values.astype(np.float64) - offset
    merged = Running()
    for part in np.split(values, 16):
        merged = merged.add(part)
    for found in (Running.of(values), merged):
        assert found.variance() == pytest.approx(shifted.var(ddof=1), rel=1e-7)
        assert found.skewness() == pytest.approx(stats.skew(shifted, bias=False), abs=1e-6)
        assert found.excess_kurtosis() == pytest.approx(stats.kurtosis(shifted, bias=False), abs=1e-6)
    naive = (np.sum(values * values) - np.sum(values) ** 2 / 4096) / 4095
    assert abs(naive / shifted.var(ddof=1) - 1) > 0.1


@pytest.mark.parametrize("value", [0.1, 1e20, 0.0, -3.3])
def test_a_constant_has_no_variance(value):
    parts = [np.full(count, value) for count in (4096, 1, 333)]
    merged = Running.of(parts[0]).add(parts[1]).add(parts[2])
    for found in (Running.of(parts[0]), merged):
        assert found.mean == value
        assert found.variance() == 0
        assert np.isnan(found.excess_kurtosis())


def test_kurtosis_is_at_most_the_count():
    """One value apart from all others has the largest that there is."""
    values = np.zeros(16)
    values[3] = 1
    assert Running.of(values).excess_kurtosis() == pytest.approx(16)
    assert Running.of(VALUES).excess_kurtosis().max() < 37


def test_any_axis():
    np.testing.assert_allclose(Running.of(VALUES, axis=1).mean, VALUES.mean(1), rtol=1e-13)
