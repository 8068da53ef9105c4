"""Do 95 % intervals hold the truth 95 times in 100? Toy studies of 16 replicates whose truth is known.

`BAND` is what is asked of each; of 8000 studies the share held has a standard error of 0.25 %, of 2000 one of 0.5 %.
The seeds are fixed. What is known not to be held is tested as well, so that the documentation's figures are no guess.
"""

import numpy as np
import pytest

from whitted.stats.convergence import slope
from whitted.stats.curves import Curve, cheapest, cost_ratio_at, ratio_at
from whitted.stats.decomposition import decompose, squared_bias
from whitted.stats.efficiency import efficiency
from whitted.stats.intervals import bootstrap_t, mean, percentile, student

BAND = (0.935, 0.965)
REPLICATES = 16
STUDIES = 8000
FEWER = 399  # resamples where all studies are done at once; coverage is that of 1999
N = np.array([4.0, 16, 64, 256])

LAWS = {  # each of mean 1
    "normal": lambda rng, shape: 1 + 0.2 * rng.standard_normal(shape),
    "chi-square 8": lambda rng, shape: rng.chisquare(8, shape) / 8,
    "exponential": lambda rng, shape: rng.exponential(1, shape),
    "lognormal 1/2": lambda rng, shape: np.exp(0.5 * rng.standard_normal(shape) - 0.125),
    "lognormal 1": lambda rng, shape: np.exp(rng.standard_normal(shape) - 0.5),
}
USUAL = ("normal", "chi-square 8", "exponential", "lognormal 1/2")


def held(interval, truth):
    return float(np.mean(interval.holds(truth)))


def within(share):
    return BAND[0] <= share <= BAND[1]


def draws(law, *shape, seed=1):
    return LAWS[law](np.random.default_rng(seed), shape)


def of_mean(values, **options):
    return bootstrap_t(lambda w: mean(values, w), len(values), resamples=FEWER, **options)


@pytest.mark.parametrize("law", USUAL)
def test_bootstrap_t_holds_means(law):
    assert within(held(of_mean(draws(law, REPLICATES, STUDIES)), 1))


def test_student_holds_means_of_normal_replicates_alone():
    assert within(held(student(draws("normal", REPLICATES, STUDIES)), 1))
    assert held(student(draws("exponential", REPLICATES, STUDIES)), 1) < 0.92


def test_the_logarithm_serves_positive_quantities_as_well():
    values = draws("chi-square 8", REPLICATES, STUDIES, seed=2)
    assert within(held(of_mean(values, scale="log"), 1))


def test_no_method_holds_means_of_long_tails():
    """As `whitted.stats.intervals` says: about 91 and 85 % of lognormal means of sigma 1."""
    values = draws("lognormal 1", REPLICATES, STUDIES)
    assert 0.90 < held(of_mean(values), 1) < BAND[0]
    assert 0.84 < held(student(values), 1) < 0.87


def test_percentiles_are_too_narrow():
    """About 89 % at 8 replicates, and at 16 still less than what is asked for."""
    for replicates, low, high in ((8, 0.875, 0.90), (16, 0.91, BAND[0])):
        values = draws("normal", replicates, STUDIES)
        found = percentile(lambda w, values=values: mean(values, w), replicates)
        assert low < held(found, 1) < high


def test_ratios_of_two_errors():
    """Of 16 and of 11 replicates."""
    a, b = draws("chi-square 8", 16, 4000), 0.5 * draws("chi-square 8", 11, 4000, seed=2)
    found = bootstrap_t(lambda v, w: mean(a, v) / mean(b, w), 16, 11, scale="log", resamples=FEWER)
    assert within(held(found, 2))


def errors_along(law, studies, seed=3):
    """Return squared errors [R, studies, K] that fall as 1 / n."""
    return draws(law, REPLICATES, studies, len(N), seed=seed) / N


@pytest.mark.parametrize("law", ["normal", "chi-square 8"])
def test_slopes_of_independent_samples(law):
    errors = errors_along(law, 2000)
    x = np.log(N) - np.log(N).mean()
    found = bootstrap_t(lambda w: np.log(mean(errors, w)) @ x / (2 * x @ x), REPLICATES, resamples=FEWER)
    assert within(held(found, -0.5))
    one = slope(N, errors[:, 0]).interval
    assert one.value == pytest.approx(found.value[0])
    assert one.high - one.low == pytest.approx(found.high[0] - found.low[0], rel=0.2)


def bias_held(bias, reference_sd=0.0, studies=2000, size=(16, 16, 1)):
    rng = np.random.default_rng(4)
    count = 0
    for _ in range(studies):
        images = bias + rng.standard_normal((REPLICATES, *size))
        found = squared_bias(images, reference_sd * rng.standard_normal(size), reference_sd**2)
        count += found.holds(bias**2)
    return count / studies


@pytest.mark.parametrize("bias", [0.0, 0.3])
def test_squared_biases(bias):
    assert within(bias_held(bias))


def wrong_claims(law, studies, curves=1):
    """Return how often a setting is called good enough whose RMSE isn't: just above what was asked for."""
    rng, wrong = np.random.default_rng(5), 0
    truth = np.array([1.0, 0.3])
    for _ in range(studies):
        made = {
            name: Curve(np.array([1, 4]), None, truth * LAWS[law](rng, (REPLICATES, 2)))
            for name in range(curves)
        }
        choice = cheapest(made, 1 - 1e-9)
        wrong += choice is not None and choice.spp == 1
    return wrong / studies


def test_claims_of_the_cheapest_setting():
    """Of 300 about 15 are wrong; more than 28 with probability 1e-3."""
    assert wrong_claims("normal", 300) <= 28 / 300


@pytest.mark.long
@pytest.mark.parametrize("law", ["normal", "chi-square 8"])
def test_claims_of_the_cheapest_setting_in_many_studies(law):
    assert 1 - BAND[1] <= wrong_claims(law, 2000) <= 1 - BAND[0]


@pytest.mark.long
def test_claims_among_several_curves():
    """All four have a setting that isn't good enough; the claim is wrong where any is called so."""
    assert wrong_claims("normal", 1000, curves=4) <= 1 - BAND[0]


@pytest.mark.long
@pytest.mark.parametrize("law", ["normal", "chi-square 8"])
def test_fitted_slopes(law):
    errors = errors_along(law, 2000, seed=6)
    found = [slope(N, errors[:, i]).interval.holds(-0.5) for i in range(2000)]
    assert within(np.mean(found))


@pytest.mark.long
@pytest.mark.parametrize("bias", [0.0, 0.05, 0.3, 2.0])
def test_squared_biases_against_a_noisy_reference(bias):
    assert within(bias_held(bias, reference_sd=0.25))


@pytest.mark.long
def test_errors_and_variances_of_decompositions():
    rng, found = np.random.default_rng(7), []
    for _ in range(4000):
        images = 0.3 + rng.standard_normal((REPLICATES, 12, 12, 1))
        parts = decompose(images, 0.1 * rng.standard_normal((12, 12, 1)), 0.01)
        found.append((parts.mse.holds(1.09), parts.variance.holds(1)))
    assert all(within(share) for share in np.mean(found, axis=0))


def curve(rng, error, cost, noise):
    errors = error / N * LAWS["chi-square 8"](rng, (REPLICATES, len(N)))
    return Curve(N, cost * N * np.exp(noise * rng.standard_normal(errors.shape)), errors)


@pytest.mark.long
@pytest.mark.parametrize(("ratio", "at", "paired"), [(ratio_at, 0.05, False), (cost_ratio_at, 0.2, True)])
def test_ratios_at_equal_time_and_at_equal_error(ratio, at, paired):
    """Times strayed by 5 %; of 400 studies the share held has a standard error of 1.1 %, of which 3 are allowed."""
    rng, found = np.random.default_rng(8), []
    for _ in range(400):
        a, b = curve(rng, 2.0, 1e-3, 0.05), curve(rng, 1.0, 1e-3, 0.05)
        found.append(ratio(a, b, at, paired=paired).holds(2))
    assert 0.917 <= np.mean(found) <= 0.983


@pytest.mark.long
def test_efficiencies():
    rng, found = np.random.default_rng(9), []
    for _ in range(2000):
        errors, seconds = LAWS["chi-square 8"](rng, 16), 2 * np.exp(0.05 * rng.standard_normal(16))
        found.append(efficiency(errors, seconds).holds(0.5))
    assert within(np.mean(found))
