"""Heavy tails: Hill's index on powers, fireflies, and false alarms on what has none.

Rates of false alarms are measured with fixed seeds; those in the docstrings are of larger simulations.
"""

import json

import numpy as np
import pytest

from whitted.stats.running import Running
from whitted.stats.tails import pixel_tail, replicate_tail

PIXELS = 10_000


def normal(rng, shape):
    return rng.standard_normal(shape)


def lognormal(rng, shape):
    return np.exp(rng.standard_normal(shape))


def pareto(index):
    return lambda rng, shape: 1 + rng.pareto(index, shape)


def fireflies(rng, shape):
    """Three bright pixels in 10^4."""
    values = rng.standard_normal(shape)
    values[:3] *= 1000
    return values


def test_exact_quantiles_of_a_power_have_its_index():
    """Of 10^5 quantiles the sum over the largest 1000 is an integral of the logarithm, to 1 %."""
    u = (np.arange(100_000) + 0.5) / 100_000
    for index in (1.5, 3.0):
        assert pixel_tail(u[:, None] ** (-1 / index)).index.value == pytest.approx(index, rel=0.01)


@pytest.mark.parametrize("index", [1.5, 3.0])
def test_the_interval_holds_the_index_of_a_power(index):
    """At 95 %, 200 intervals hold it fewer than 180 times with probability 1e-3."""
    rng = np.random.default_rng(1)
    held = sum(pixel_tail(pareto(index)(rng, (PIXELS, 1))).index.holds(index) for _ in range(200))
    assert 180 <= held < 200


@pytest.mark.parametrize("light", [normal, lognormal, pareto(3)])
def test_light_tails_raise_no_alarm(light):
    """Index 3 raises 0.3 %, so that more than 2 alarms in 100 have probability 4e-3; the others raise none."""
    rng = np.random.default_rng(2)
    alarms = sum(not pixel_tail(light(rng, (PIXELS, 1))).trusted for _ in range(100))
    assert alarms <= 2


@pytest.mark.parametrize("heavy", [pareto(1.5), fireflies])
def test_heavy_tails_are_found(heavy):
    rng = np.random.default_rng(3)
    found = sum(not pixel_tail(heavy(rng, (PIXELS, 1))).trusted for _ in range(100))
    assert found >= 97


def test_fireflies_are_seen_by_their_share_and_not_by_the_index():
    found = pixel_tail(fireflies(np.random.default_rng(4), (PIXELS, 1)))
    assert found.index.value > 2
    assert found.top_share > 0.99
    assert str(found).startswith("Heavy tail: 0.1 % of the pixels hold 99.7 % of the squared error")


def test_shares_by_hand():
    """A hundred errors of 3 among 10^5 of 1: 900 of 100800; the 0.1 % of pixels are these hundred."""
    errors = np.ones((100_000, 1))
    errors[:100] = 3
    assert pixel_tail(errors).top_share == pytest.approx(900 / 100_800)


def test_channels_are_one_pixel():
    errors = np.zeros((1000, 3))
    errors[7] = (2, -3, 6)
    errors[11, 0] = 1
    assert pixel_tail(errors).top_share == pytest.approx(49 / 50)


def test_pictures_without_errors_raise_no_alarm():
    for errors in (np.zeros((64, 64, 3)), np.ones((64, 64, 3)), np.full((64, 64, 3), np.nan)):
        assert pixel_tail(errors).trusted


def test_few_pixels_have_no_index():
    found = pixel_tail(np.random.default_rng(5).standard_normal((20, 20, 3)))
    assert np.isnan(found.index.value)
    assert "too few" in str(found)


def test_values_that_are_no_numbers_are_left_out():
    errors = np.random.default_rng(6).standard_normal((PIXELS, 3))
    clean = pixel_tail(errors)
    assert pixel_tail(np.concatenate([errors, [[np.inf, 0, 0], [0, np.nan, 0]]])) == clean


def replicates(law, samples, count=16, seed=7):
    """Return the moments of means of samples, over 32 x 32 pixels."""
    values = law(np.random.default_rng(seed), (count, samples, 32, 32, 1))
    return Running.of(values.mean(axis=1))


@pytest.mark.parametrize("law", [normal, lognormal, pareto(3)])
def test_replicates_of_light_tails_raise_no_alarm(law):
    found = [replicate_tail(replicates(law, 64, seed=seed)) for seed in range(5)]
    assert all(one.trusted for one in found)


def test_replicates_of_infinite_variance_are_found():
    found = [replicate_tail(replicates(pareto(1.5), 64, seed=seed)) for seed in range(5)]
    assert not any(one.trusted for one in found)


def test_normal_replicates_have_no_excess():
    """The mean of 1024 kurtoses of 16 values, each of standard deviation 1.1."""
    found = replicate_tail(replicates(normal, 1))
    assert found.kurtosis.value == pytest.approx(0, abs=4 * 1.1 / 32)
    assert found.kurtosis.low < 0 < found.kurtosis.high


def test_noise_in_single_replicates_is_the_largest_excess():
    values = np.zeros((16, 8, 8, 3))
    values[3, 1, 2], values[9, 5, 5] = 1, 2
    found = replicate_tail(Running.of(values))
    assert found.kurtosis.value == pytest.approx(16)
    assert not found.trusted
    assert "too low" in str(found)


def test_a_noisy_corner_counts_by_its_variance():
    """Quiet pixels with normal noise don't hide a few loud ones where one replicate has it all."""
    values = np.random.default_rng(8).standard_normal((16, 32, 32, 1))
    values[2, 0, 0], values[5, 3, 3] = 1e3, 1e3
    found = replicate_tail(Running.of(values))
    assert not found.trusted
    assert Running.of(values).excess_kurtosis().mean() < 0.1


def test_replicates_without_noise_or_too_few():
    still = replicate_tail(Running.of(np.ones((8, 4, 4, 3))))
    assert still.trusted
    assert np.isnan(still.kurtosis.value)
    few = replicate_tail(Running.of(np.random.default_rng(9).random((3, 4, 4, 3))))
    assert not few.trusted
    assert "No tail can be told from 3 replicates" in str(few)


def test_json_and_sentences():
    errors = normal(np.random.default_rng(10), (PIXELS, 3))
    for found in (pixel_tail(errors), replicate_tail(Running.of(errors[:1600].reshape(16, 10, 10, 3)))):
        text = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        assert text["sentence"].startswith("No heavy tail: ")
        assert text["trusted"] is True
