"""Statistics of the comparisons at equal time: curves, ratios, references, against values known by hand or in theory.

Seeds are fixed. Had they been drawn at random, the tests that say so would fail for correct code with the probability
in their docstrings.
"""

import importlib.util
import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "experiments"


def loaded(name):
    """Return a module of experiments/, which is no package."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


equal_time = loaded("equal_time")
comparison = loaded("comparison")

SPP = np.array([4, 16, 64, 256])


def curve(error=1.0, slope=-1.0, cost=1e-3, turns=16, noise=0.0, seed=0):
    """Return a curve of errors error * spp^slope at cost * spp seconds, both with relative noise."""
    rng = np.random.default_rng(seed)

    def noisy(values):
        return np.exp(noise * rng.standard_normal((turns, len(SPP)))) * values

    return equal_time.Curve(SPP, noisy(cost * SPP), noisy(error * SPP**slope))


def test_a_power_of_the_time_is_interpolated_exactly():
    made = curve(error=3.0, slope=-1.7, cost=2e-3)
    for spp in (4, 5.5, 16, 100, 256, 300):
        assert made.at(2e-3 * spp) == pytest.approx(3.0 * spp**-1.7, rel=1e-12)
        assert made.spp_at(2e-3 * spp) == pytest.approx(spp, rel=1e-12)


def test_times_are_medians_and_errors_are_means():
    seconds = np.tile([1.0, 2.0], (3, 1))
    seconds[0] = 100
    errors = np.array([[8.0, 1.0], [8.0, 2.0], [8.0, 9.0]])
    made = equal_time.Curve(np.array([1, 2]), seconds, errors)
    assert made.span == (1, 2)
    assert made.at(1.0) == pytest.approx(8)
    assert made.at(2.0) == pytest.approx(4)
    assert made.at(2.0, [1, 1]) == pytest.approx(2)


def test_times_out_of_order_give_a_curve():
    made = equal_time.Curve(np.array([1, 2, 4]), np.array([[1.0, 0.9, 3.0]]), np.array([[4.0, 2.0, 1.0]]))
    assert made.at(1.5) == pytest.approx(2 * 1.5 ** -(np.log(2) / np.log(3)), rel=1e-4)


def test_errors_without_noise_have_no_ratio():
    found = equal_time.advantage(curve(error=0.0), [curve()], 0.1)
    assert np.isnan([found.value, found.low, found.high]).all()


def test_the_common_time_is_reached_by_all():
    assert equal_time.common_seconds([curve(cost=1e-3), curve(cost=2e-3)]) == pytest.approx(0.256)
    with pytest.raises(ValueError, match="no time"):
        equal_time.common_seconds([curve(cost=1e-3), curve(cost=1.0)])


def test_equal_time_is_no_equal_number_of_samples():
    """Twice the error at a quarter of the cost is half the error, where the error falls as 1/n."""
    found = equal_time.advantage(curve(error=2.0, cost=0.25e-3), [curve(error=5.0), curve()], 0.05)
    assert found.value == pytest.approx(2)
    assert (found.low, found.high) == pytest.approx((2, 2))
    assert found.best == 1
    same_spp = curve().errors[0, 1] / curve(error=2.0).errors[0, 1]
    assert same_spp == pytest.approx(0.5)  # what leaving the time out would say


def test_intervals_of_ratios_hold_the_truth():
    """Those of 16 renders are a bit too narrow: 93 % hold it. Of 200, 86 to 99 % do with a probability of 99.9 %."""
    others = [curve(error=2.0, noise=0.1, seed=2 * k) for k in range(200)]
    ours = [curve(noise=0.1, seed=2 * k + 1) for k in range(200)]
    draws = equal_time.RESAMPLES
    equal_time.RESAMPLES = 200
    try:
        found = [equal_time.advantage(a, [b], 0.05) for a, b in zip(ours, others, strict=True)]
    finally:
        equal_time.RESAMPLES = draws
    assert 0.86 <= np.mean([ratio.low <= 2 <= ratio.high for ratio in found]) <= 0.99
    assert np.mean([ratio.low <= 2.3 <= ratio.high for ratio in found]) < 0.5  # another value is told apart


def noisy(truth, sd, count, rng):
    return (truth + sd * rng.standard_normal((count, *truth.shape))).astype(np.float32)


TRUTH = np.random.default_rng(5).random((32, 32, 3))


def test_the_reference_weighs_sides_by_their_precision():
    """The variance is estimated from 3072 values, to 1 %; the squared error to 2.6 %. Six times that is allowed."""
    rng = np.random.default_rng(7)
    reference, variance = equal_time.combined(noisy(TRUTH, 0.1, 8, rng), noisy(TRUTH, 0.3, 4, rng))
    expected = 1 / (8 / 0.1**2 + 4 / 0.3**2)
    assert variance == pytest.approx(expected, rel=0.06)
    assert np.mean((reference - TRUTH) ** 2) == pytest.approx(expected, rel=0.16)
    plain = 0.1**2 / 8 / 4 + 0.3**2 / 4 / 4  # of the plain mean of both
    assert variance < 0.5 * plain


def test_a_reference_without_noise_is_exact():
    still = np.tile(TRUTH, (2, 1, 1, 1))
    reference, variance = equal_time.combined(noisy(TRUTH, 0.1, 4, np.random.default_rng(1)), still)
    np.testing.assert_array_equal(reference, TRUTH)
    assert variance == 0


def test_the_noise_of_the_reference_is_taken_out_of_the_error():
    """An error of 0.05^2 against a reference of variance 0.05^2: 400 estimates have a relative error of 0.3 %."""
    rng = np.random.default_rng(9)
    pairs = ((noisy(TRUTH, 0.05, 1, rng)[0], noisy(TRUTH, 0.05, 1, rng)[0]) for _ in range(100))
    found, left_in = [], []
    for image, reference in pairs:
        found.append(equal_time.squared_error(image, reference, 0.05**2))
        left_in.append(equal_time.squared_error(image, reference))
    assert np.mean(found) == pytest.approx(0.05**2, rel=0.03)
    assert np.mean(left_in) == pytest.approx(2 * 0.05**2, rel=0.03)


def test_bands_hold_the_mean():
    mean, low, high = curve(noise=0.2).band()
    assert (low < mean).all()
    assert (mean < high).all()
    np.testing.assert_allclose(curve().band()[1:], np.tile(1.0 / SPP, (2, 1)))


@pytest.mark.parametrize("spp", [1, 4, 10, 16, 64, 100, 256, 1024])
def test_samples_fill_the_grid_of_each_sampler(spp):
    root = {name: comparison.whole(name, spp) ** 0.5 for name in ("stratified", "multijitter", "orthogonal")}
    assert all(value == int(value) for value in root.values())
    prime = int(root["orthogonal"])
    assert prime > 1
    assert all(prime % k for k in range(2, prime))
    for name in ("ldsampler", "owen_sobol"):
        assert comparison.whole(name, spp).bit_count() == 1
    assert comparison.whole("independent", spp) == spp
    for name in (*comparison.SAMPLERS, comparison.OWN):
        assert spp / 4.1 <= comparison.whole(name, spp) <= 4.1 * spp


def test_every_sampler_is_paired_with_every_integrator_of_mitsuba():
    direct, deep = comparison.methods(2), comparison.methods(8)
    pairs = {
        (label.rpartition(" ")[0], method.sampler) for label, method in direct.items() if method.is_mitsuba
    }
    unbiased = [name for name in comparison.SAMPLERS if name != "ldsampler"]
    assert pairs == set(itertools.product(("path", "direct 1/0", "direct 1/1"), unbiased))
    assert "path ldsampler" in direct  # shown, though never the best
    assert {method.integrator["type"] for method in deep.values()} == {"path", "distribution"}


def test_a_scene_is_rendered_without_changing_it():
    """Means of both pictures agree, the sampler apart; a pass takes time; and the same seed gives the same picture."""
    bench = comparison.Bench("open_floor", 8)
    image, seconds = bench.render(comparison.OURS, bench.seed(comparison.OURS, 0), 16)
    again, _ = bench.render(comparison.OURS, bench.seed(comparison.OURS, 0), 16)
    np.testing.assert_array_equal(image, again)
    other, _ = bench.render("path multijitter", bench.seed("path multijitter", 0), 256)
    assert image.shape == (8, 8, 3)
    assert seconds > 0
    assert image.mean() == pytest.approx(other.mean(), rel=0.02)


def test_seeds_differ_between_methods_and_replicates():
    bench = comparison.Bench("open_floor", 8)
    seeds = {bench.seed(label, number) for label in bench.methods for number in range(16)}
    assert len(seeds) == 16 * len(bench.methods)
    apart = np.diff(np.sort(list(seeds)))
    assert apart.min() > max(
        comparison.SPP[:5]
    )  # nearer ones repeat a stratified pattern, shifted by a pixel
