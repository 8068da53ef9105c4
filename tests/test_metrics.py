"""Error metrics against values worked out by hand, and the noise that they take out."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from whitted.stats import metrics

I = np.array([[[1.0, 2.0], [3.0, 4.0]]])  # noqa: E741, the letter of the equations
R = np.array([[[1.0, 1.0], [2.0, 4.0]]])


def test_values_by_hand():
    found = metrics.compare(I, R)
    assert found.mse == 0.5
    assert found.rmse == pytest.approx(math.sqrt(0.5))
    assert found.mae == 0.5
    assert found.bias == 0.5
    assert found.rel_bias == 0.25
    assert found.rel_mse == pytest.approx((1 / 1.04 + 1 / 4.04) / 4)
    assert found.smape == pytest.approx((2 / 3.02 + 2 / 5.02) / 4)
    assert found.psnr == pytest.approx(10 * math.log10(2))
    assert found.p99 == 1
    assert found.bias_error is None
    assert found.unbiased_mse is None


def test_metrics_are_asked_for_by_name():
    """Each but those of sight is what `compare` gives."""
    found = metrics.compare(I, R)
    for name, metric in metrics.METRICS.items():
        if name not in metrics.PERCEPTUAL:
            assert metric(I, R) == getattr(found, name), name
    assert all(name in metrics.METRICS for name in metrics.PERCEPTUAL)


def test_equal_pictures():
    found = metrics.compare(np.zeros((2, 2, 3)), np.zeros((2, 2, 3)))
    assert (found.mse, found.rel_mse, found.smape, found.psnr) == (0, 0, 0, math.inf)
    json.dumps(found.to_dict(), allow_nan=True)
    assert found.to_dict()["psnr"] is None


def test_noise_is_taken_out_of_the_squared_error():
    """The bias of 0.1 is found under noise of 0.5; the estimate's standard deviation is 0.003."""
    rng = np.random.default_rng(1)
    shape = (256, 256, 3)
    sd = np.full(shape, 0.5)
    image, reference = 1.1 + 0.5 * rng.standard_normal(shape), 1 + 0.5 * rng.standard_normal(shape)
    found = metrics.compare(image, reference, sd, sd)
    assert found.mse > 0.4
    assert found.unbiased_mse == pytest.approx(0.01, abs=0.009)


def test_standard_error_of_the_bias():
    """Channels that share their noise have the stated error; 400 repetitions give it to 3.5 %."""
    rng = np.random.default_rng(2)
    sd = np.full((4, 4, 3), 0.3)
    zero = np.zeros_like(sd)
    noise = np.repeat(0.3 * rng.standard_normal((400, 4, 4, 1)), 3, axis=-1)
    spread = np.std([metrics.bias(image, zero) for image in noise])
    assert metrics.bias_error(sd, zero) == pytest.approx(spread, rel=0.15)
    assert metrics.bias_error(sd, zero) == pytest.approx(0.3 / 4)


def test_nonfinite_pixels_are_counted():
    image = I.copy()
    image[0, 1, 0] = np.nan
    found = metrics.compare(image, R)
    assert found.nonfinite == 1
    assert found.mse == 0.5
    with pytest.raises(ValueError, match="no pixel"):
        metrics.compare(np.full_like(R, np.inf), R)


def test_shapes_must_match():
    with pytest.raises(ValueError, match="shapes"):
        metrics.compare(I, R[:, :1])


def write(path, value, stderr=None, width=3):
    from whitted.image import Picture, layer_channels, write_exr

    channels = layer_channels("", np.full((2, width, 3), value, np.float32))
    if stderr is not None:
        channels |= layer_channels("stderr", np.full((2, width, 3), stderr, np.float32))
    write_exr(path, Picture(channels))
    return str(path)


def test_compare_command(tmp_path):
    from whitted.cli.compare import command

    a, b = write(tmp_path / "a.exr", 1.5, 0.1), write(tmp_path / "b.exr", 1.0, 0.2)
    result = CliRunner().invoke(command, [a, b, "--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == 0
    assert found["mse"] == 0.25
    assert found["unbiased_mse"] == pytest.approx(0.2)
    table = CliRunner().invoke(command, [a, b])
    assert table.exit_code == 0
    assert "unbiased_mse" in table.stdout
    assert "carry none" in CliRunner().invoke(command, [a, write(tmp_path / "c.exr", 1.0)]).stdout


def test_compare_command_refuses_different_sizes(tmp_path):
    from whitted.cli.compare import command
    from whitted.errors import UsageError

    a, b = write(tmp_path / "a.exr", 1), write(tmp_path / "b.exr", 1, width=4)
    result = CliRunner().invoke(command, [a, b])
    assert isinstance(result.exception, UsageError)
    assert "a.exr is 3x2 and" in str(result.exception)
