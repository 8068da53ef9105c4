"""Efficiency and times: closed forms, and that they are one thing said in three ways."""

import numpy as np
import pytest
from scipy import stats

from whitted.stats.efficiency import efficiency, time_to_error, time_to_unit_variance

RNG = np.random.default_rng(1)
ERRORS = RNG.gamma(4, 0.25, 16)
SECONDS = 2 * np.exp(0.1 * RNG.standard_normal(16))


def test_values_by_hand():
    errors, seconds = [1.0, 2.0, 3.0, 4.0], [2.0, 2.0, 3.0, 50.0]
    assert efficiency(errors, seconds).value == pytest.approx(1 / (2.5 * 2.5))
    assert time_to_unit_variance(errors, seconds).value == pytest.approx(2.5 * 2.5)
    assert time_to_error(0.5, errors, seconds).value == pytest.approx(2.5 * 2.5 / 0.25)
    assert time_to_error(0.5, errors, seconds, slope=-1.5).value == pytest.approx(2.5 * 10 ** (1 / 3))


def test_time_to_unit_variance_is_the_inverse_of_efficiency():
    forth, back = efficiency(ERRORS, SECONDS), time_to_unit_variance(ERRORS, SECONDS)
    assert (forth.low, forth.high) == pytest.approx((1 / back.high, 1 / back.low))
    same = time_to_error(1.0, ERRORS, SECONDS)
    assert (same.low, same.high) == pytest.approx((back.low, back.high))


def test_efficiency_of_independent_samples_does_not_depend_on_their_number():
    more = efficiency(ERRORS / 16, SECONDS * 16)
    assert more.value == pytest.approx(efficiency(ERRORS, SECONDS).value)
    steep = efficiency(ERRORS / 16**2, SECONDS * 16)  # a sequence whose RMSE falls as 1/n
    assert steep.value == pytest.approx(16 * more.value)


def test_renders_without_a_time_count_for_the_error():
    seconds = np.where(np.arange(16) < 8, SECONDS, np.nan)
    found = efficiency(ERRORS, seconds)
    assert found.value == pytest.approx(1 / (ERRORS.mean() * stats.trim_mean(SECONDS[:8], 0.25)))
    assert found.low < found.value < found.high


def test_intervals_of_exact_measurements_are_points():
    found = efficiency(np.full(4, 0.5), np.full(4, 3.0))
    assert (found.low, found.high) == pytest.approx((2 / 3, 2 / 3))


def test_shapes_have_to_match():
    with pytest.raises(ValueError, match="same renders"):
        efficiency(ERRORS, SECONDS[:8])
