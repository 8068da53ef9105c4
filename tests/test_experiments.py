"""References of the comparisons at equal time, against values known by hand or in theory.

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


combining = loaded("combining")
comparison = loaded("comparison")


def noisy(truth, sd, count, rng):
    return (truth + sd * rng.standard_normal((count, *truth.shape))).astype(np.float32)


TRUTH = np.random.default_rng(5).random((32, 32, 3))


def test_the_reference_weighs_sides_by_their_precision():
    """The variance is estimated from 3072 values, to 1 %; the squared error to 2.6 %. Six times that is allowed."""
    rng = np.random.default_rng(7)
    reference, variance = combining.combined(noisy(TRUTH, 0.1, 8, rng), noisy(TRUTH, 0.3, 4, rng))
    expected = 1 / (8 / 0.1**2 + 4 / 0.3**2)
    assert variance == pytest.approx(expected, rel=0.06)
    assert np.mean((reference - TRUTH) ** 2) == pytest.approx(expected, rel=0.16)
    plain = 0.1**2 / 8 / 4 + 0.3**2 / 4 / 4  # of the plain mean of both
    assert variance < 0.5 * plain


def test_a_reference_without_noise_is_exact():
    still = np.tile(TRUTH, (2, 1, 1, 1))
    reference, variance = combining.combined(noisy(TRUTH, 0.1, 4, np.random.default_rng(1)), still)
    np.testing.assert_array_equal(reference, TRUTH)
    assert variance == 0


def test_the_noise_of_the_reference_is_taken_out_of_the_error():
    """An error of 0.05^2 against a reference of variance 0.05^2: 400 estimates have a relative error of 0.3 %."""
    rng = np.random.default_rng(9)
    pairs = ((noisy(TRUTH, 0.05, 1, rng)[0], noisy(TRUTH, 0.05, 1, rng)[0]) for _ in range(100))
    found, left_in = [], []
    for image, reference in pairs:
        found.append(combining.squared_error(image, reference, 0.05**2))
        left_in.append(combining.squared_error(image, reference))
    assert np.mean(found) == pytest.approx(0.05**2, rel=0.03)
    assert np.mean(left_in) == pytest.approx(2 * 0.05**2, rel=0.03)


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
