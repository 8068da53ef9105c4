"""Slopes: exact powers, what is left out, and that nets are told from independent points where theory says so."""

import numpy as np
import pytest
from scipy.stats import qmc

from whitted.stats.convergence import slope

N = np.array([4, 16, 64, 256, 1024])


def test_a_power_has_its_slope():
    found = slope(N, np.tile(3 * N**-1.4, (8, 1)))
    assert (found.interval.value, found.interval.low, found.interval.high) == pytest.approx(
        (-0.7, -0.7, -0.7)
    )
    assert found.used == (4, 16, 64, 256, 1024)
    assert found.left_out == ()


def test_the_fit_is_that_of_least_squares_on_mean_squared_errors():
    errors = np.random.default_rng(1).gamma(2, 1, (16, 5)) / N
    expected = np.polyfit(np.log(N), np.log(np.sqrt(errors.mean(0))), 1)[0]
    assert slope(N, errors).interval.value == pytest.approx(expected)


def test_what_is_near_the_references_error_is_left_out_and_said():
    """RMSE of 1/2, 1/4, 1/8, 1/16, 1/32 against three times 0.03."""
    found = slope(N, np.tile(1 / N, (4, 1)), reference_variance=0.03**2)
    assert found.left_out == (256, 1024)
    assert found.interval.value == pytest.approx(-0.5)
    assert str(found).endswith("without n = 256, 1024")
    assert found.to_dict()["left_out"] == [256, 1024]


def test_negative_mean_errors_have_no_slope():
    errors = np.tile([1.0, 0.25, -0.01], (4, 1))
    assert slope(N[:3], errors).left_out == (64,)
    nothing = slope(N[:3], -errors[:, ::-1])
    assert nothing.used == (4,)
    assert np.isnan([nothing.interval.value, nothing.interval.low]).all()


def test_a_single_negative_error_is_no_obstacle():
    errors = np.random.default_rng(2).normal(1, 0.6, (16, 5)) / N
    assert (errors < 0).any()
    found = slope(N, errors)
    assert found.left_out == ()
    assert found.interval.low < -0.5 < found.interval.high


def test_one_replicate_has_no_interval():
    found = slope(N, 1 / N[None])
    assert found.interval.value == pytest.approx(-0.5)
    assert np.isnan(found.interval.low)


def test_shapes_have_to_match():
    with pytest.raises(ValueError, match="not"):
        slope(N, np.ones((8, 4)))


def product_errors(points):
    """Return squared errors of the mean of 4 x y over points [R, n, 2]; the truth is 1."""
    return ((4 * points.prod(axis=-1)).mean(axis=-1) - 1) ** 2


def test_rates_of_theory():
    """-1/2 for independent points; for Owen-scrambled ones of a smooth function -3/2, up to a logarithm."""
    rng = np.random.default_rng(3)
    n = 2 ** np.arange(3, 11)
    independent = np.stack([product_errors(rng.random((64, k, 2))) for k in n], axis=1)
    assert slope(n, independent).interval.holds(-0.5)
    nets = np.stack(
        [product_errors(np.stack([qmc.Sobol(2, rng=rng).random(k) for _ in range(32)])) for k in n],
        axis=1,
    )
    found = slope(n, nets).interval
    assert found.high < -1
    assert not found.holds(-0.5)
