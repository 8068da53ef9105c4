"""Bias and variance apart: against their definitions, closed forms, and what happens without each term."""

import itertools

import numpy as np
import pytest

from whitted.stats.decomposition import decompose, maps

SHAPE = (6, 5, 3)


def renders(rng, count=16, bias=0.0, sd=1.0, shape=SHAPE):
    return bias + sd * rng.standard_normal((count, *shape))


def test_both_definitions_of_the_squared_bias():
    rng = np.random.default_rng(1)
    images, reference = renders(rng, 5, 0.7), rng.random(SHAPE)
    found = decompose(images, reference, 0.04)
    variance = images.var(axis=0, ddof=1).mean()
    plain = np.mean((images.mean(0) - reference) ** 2) - variance / 5 - 0.04
    pairs = itertools.permutations(images - reference, 2)
    products = np.mean([np.mean(a * b) for a, b in pairs]) - 0.04
    assert found.variance.value == pytest.approx(variance)
    assert found.bias_squared.value == pytest.approx(plain)
    assert found.bias_squared.value == pytest.approx(products)
    assert found.mse.value == pytest.approx(np.mean((images - reference) ** 2) - 0.04)
    assert found.mse.value == pytest.approx(found.variance.value + found.bias_squared.value)


def test_maps_have_the_values_as_their_means():
    rng = np.random.default_rng(2)
    images, reference, noise = renders(rng, 6), rng.random(SHAPE), rng.random(SHAPE)
    found, parts = decompose(images, reference, noise), maps(images, reference, noise)
    for name, part in parts.items():
        assert part.shape == SHAPE
        assert part.mean() == pytest.approx(getattr(found, name).value)
    np.testing.assert_allclose(parts["mse"], parts["variance"] + parts["bias_squared"])


def test_bias_without_noise_is_exact():
    found = decompose(np.full((8, *SHAPE), 0.8), np.full(SHAPE, 0.5))
    for name, truth in {"mse": 0.09, "variance": 0.0, "bias_squared": 0.09}.items():
        part = getattr(found, name)
        if name == "variance":
            assert abs(part.value) < 1e-15
        else:
            assert (part.value, part.low, part.high) == pytest.approx((truth, truth, truth), rel=1e-6)


def test_equal_pictures_have_no_error():
    image = np.random.default_rng(3).random(SHAPE)
    found = decompose(np.tile(image, (8, 1, 1, 1)), image)
    assert (found.bias_squared.low, found.bias_squared.high) == (0, 0)
    assert found.mse.value == 0


def test_noise_is_no_bias():
    """The mean of 300 estimates is within four standard errors of the truth; without a term it is not."""
    rng = np.random.default_rng(4)
    estimates, plain, uncorrected = [], [], []
    for _ in range(300):
        reference = 0.4 * rng.standard_normal((16, 16, 1))
        images = renders(rng, 4, 0.1, shape=(16, 16, 1))
        estimates.append(maps(images, reference, 0.16)["bias_squared"].mean())
        plain.append(np.mean((images.mean(0) - reference) ** 2) - 0.16)
        uncorrected.append(maps(images, reference)["bias_squared"].mean())
    error = 4 * np.std(estimates) / np.sqrt(300)
    assert abs(np.mean(estimates) - 0.01) < error
    assert np.mean(plain) - 0.01 > 10 * error
    assert np.mean(uncorrected) - 0.01 > 10 * error


def test_the_interval_has_the_width_of_theory():
    """Without bias the squared bias has variance 2 sd^4 / (K (K - 1) N); with much of it 4 b^2 sd^2 / (K N)."""
    rng = np.random.default_rng(5)
    shape, count = (64, 64, 1), 16
    for bias, expected in ((0.0, np.sqrt(2 / (16 * 15 * 4096))), (5.0, np.sqrt(4 * 25 / (16 * 4096)))):
        found = decompose(renders(rng, count, bias, shape=shape), np.zeros(shape)).bias_squared
        half = (found.high - found.low) / 2
        assert half == pytest.approx(2.05 * expected, rel=0.3)


def test_resampling_images_gives_a_spread_that_is_too_large():
    """By the square root of pixels over images, here 16."""
    rng = np.random.default_rng(6)
    images = renders(rng, 16, shape=(64, 64, 1)).reshape(16, -1)
    products = images @ images.T / 4096
    drawn = rng.integers(0, 16, (500, 16))
    resampled = products[drawn[:, :, None], drawn[:, None, :]]
    squares = np.einsum("bii->b", resampled)
    spread = np.std((resampled.sum((1, 2)) - squares) / 240)
    assert spread > 8 * np.sqrt(2 / (16 * 15 * 4096))


def test_a_noisy_reference_widens_the_interval():
    rng = np.random.default_rng(7)
    shape = (32, 32, 3)
    images, reference = renders(rng, 16, 0.05, shape=shape), 0.3 * rng.standard_normal(shape)
    exact, noisy = decompose(images, reference), decompose(images, reference, np.full(shape, 0.09))
    assert noisy.bias_squared.value == pytest.approx(exact.bias_squared.value - 0.09)
    for name in ("mse", "bias_squared"):
        before, after = getattr(exact, name), getattr(noisy, name)
        assert after.high - after.low > before.high - before.low
    assert noisy.variance == exact.variance
    added = np.sqrt(2 * 0.09**2 * 3 / (32 * 32 * 3))  # channels wholly correlated
    assert noisy.bias_squared.high - noisy.bias_squared.low > 2 * 1.95 * added


def test_a_number_stands_for_a_map():
    rng = np.random.default_rng(8)
    images, reference = renders(rng, 8), rng.random(SHAPE)
    assert decompose(images, reference, 0.1) == decompose(images, reference, np.full(SHAPE, 0.1))


def test_few_images_have_values_and_no_intervals():
    rng = np.random.default_rng(9)
    images, reference = renders(rng, 4), rng.random(SHAPE)
    for count, known in ((2, "mse"), (3, "mse variance"), (4, "mse variance bias_squared")):
        found = decompose(images[:count], reference)
        for name in ("mse", "variance", "bias_squared"):
            assert np.isnan(getattr(found, name).low) == (name not in known.split())
        assert np.isfinite(found.bias_squared.value)
    alone = decompose(images[:1], reference)
    assert alone.mse.value == pytest.approx(np.mean((images[0] - reference) ** 2))
    assert np.isnan(alone.bias_squared.value)


def test_values_that_are_no_numbers_are_not_hidden():
    images = renders(np.random.default_rng(10), 8)
    images[3, 1, 1, 0] = np.nan
    found = decompose(images, np.zeros(SHAPE))
    for name in ("mse", "variance", "bias_squared"):
        part = getattr(found, name)
        assert np.isnan([part.value, part.low, part.high]).all()


def test_shapes_have_to_match():
    with pytest.raises(ValueError, match=r"\(6, 5, 3\)"):
        decompose(np.zeros((4, 5, 6, 3)), np.zeros(SHAPE))


def test_json():
    found = decompose(renders(np.random.default_rng(11), 8), np.zeros(SHAPE)).to_dict()
    assert set(found) == {"mse", "variance", "bias_squared"}
    assert found["bias_squared"]["low"] < found["bias_squared"]["high"]
