r"""Error metrics between two pictures: ``image`` I and ``reference`` R, arrays (H, W, C) of linear radiance.

Each is a mean over pixels and channels. Where the pictures carry standard errors :math:`\sigma_I, \sigma_R`,
noise is taken out of the squared error, and means get errors of their own. Those of sight are in
`whitted.stats.perceptual`. Left out: structural similarity.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np

EPSILON = 1e-2  # of relMSE, times the squared mean of the reference; of SMAPE, times that mean


@dataclass(frozen=True)
class Metrics:
    """The metrics of one pair of pictures; those that need standard errors are None without them."""

    mse: float
    rmse: float
    rel_mse: float
    mae: float
    smape: float
    p99: float  # 99 % of the absolute errors are below
    psnr: float  # dB, peak 1; infinite where the pictures are equal
    bias: float  # mean of I - R
    rel_bias: float
    bias_error: float | None  # standard error of the bias
    unbiased_mse: float | None  # may be negative
    nonfinite: int  # pixels left out since either picture has a value there that is no number

    def to_dict(self):
        """Return the numbers for JSON; an infinite PSNR, which JSON cannot hold, is None."""
        return {name: None if value == math.inf else value for name, value in asdict(self).items()}


def compare(image, reference, stderr=None, reference_stderr=None):
    """Return the `Metrics` of two pictures.

    Args:
        image, reference: (H, W, C), linear radiance.
        stderr, reference_stderr: their standard errors, (H, W, C); None counts as unknown, and one alone
        suffices
            only where the other picture is exact, which is for the caller to say by an array of zeros.

    Raises:
        ValueError: the shapes differ, or no pixel is left.
    """
    image, reference = np.asarray(image, np.float64), np.asarray(reference, np.float64)
    if image.shape != reference.shape:
        raise ValueError(f"pictures of different shapes: {image.shape} and {reference.shape}")
    known = stderr is not None and reference_stderr is not None
    errors = [np.asarray(e, np.float64) for e in (stderr, reference_stderr)] if known else []
    whole = np.logical_and.reduce([np.isfinite(x).all(-1) for x in (image, reference, *errors)])
    if not whole.any():
        raise ValueError("no pixel has numbers in both pictures")
    image, reference, *errors = (x[whole] for x in (image, reference, *errors))
    mean = reference.mean()
    return Metrics(
        mse=mse(image, reference),
        rmse=rmse(image, reference),
        rel_mse=rel_mse(image, reference),
        mae=mae(image, reference),
        smape=smape(image, reference),
        p99=p99(image, reference),
        psnr=psnr(image, reference),
        bias=bias(image, reference),
        rel_bias=bias(image, reference) / mean if mean else math.nan,
        bias_error=bias_error(*errors) if known else None,
        unbiased_mse=unbiased_mse(image, reference, *errors) if known else None,
        nonfinite=int((~whole).sum()),
    )


def mse(image, reference):
    r"""Return the mean squared error :math:`\overline{(I - R)^2}`."""
    return float(np.mean((image - reference) ** 2))


def rmse(image, reference):
    """Return the root of `mse`."""
    return math.sqrt(mse(image, reference))


def rel_mse(image, reference, epsilon=None):
    r"""Return :math:`\overline{(I - R)^2 / (R^2 + \epsilon)}`.

    By default ``epsilon`` is 0.01 :math:`\bar R^2`.
    """
    epsilon = EPSILON * np.mean(reference) ** 2 if epsilon is None else epsilon
    return _mean_ratio((image - reference) ** 2, reference**2 + epsilon)


def mae(image, reference):
    r"""Return the mean absolute error :math:`\overline{|I - R|}`."""
    return float(np.mean(abs(image - reference)))


def smape(image, reference, epsilon=None):
    r"""Return :math:`\overline{2 |I - R| / (|I| + |R| + \epsilon)}`, in [0, 2].

    By default ``epsilon`` is 0.01 :math:`|\bar R|`. Noise in either picture biases it.
    """
    epsilon = EPSILON * abs(np.mean(reference)) if epsilon is None else epsilon
    return _mean_ratio(2 * abs(image - reference), abs(image) + abs(reference) + epsilon)


def p99(image, reference):
    """Return the 99th percentile of the absolute error."""
    return float(np.quantile(abs(image - reference), 0.99))


def psnr(image, reference, peak=1.0):
    r"""Return :math:`10 \log_{10}(p^2 / \mathrm{MSE})` in dB; radiance has no natural peak, so state it."""
    error = mse(image, reference)
    return 10 * math.log10(peak * peak / error) if error else math.inf


def bias(image, reference):
    r"""Return the signed difference of the means, :math:`\overline{I - R}`."""
    return float(np.mean(image - reference))


def bias_error(stderr, reference_stderr):
    r"""Return the standard error of `bias`.

    .. math:: \sigma = \frac{1}{n} \sqrt{\sum_p \Bigl(\sum_c \sqrt{\sigma_I^2+\sigma_R^2}\Bigr)^2}

    Pixels are taken as independent, which a box filter makes them (with a wider one the error is larger), and
    a pixel's channels as fully correlated, which errs on the safe side. The arrays are (..., C), n counting
    pixels and channels.
    """
    both = np.sqrt(np.square(stderr) + np.square(reference_stderr)).sum(-1)
    return float(np.sqrt(np.sum(both**2)) / np.size(stderr))


def unbiased_mse(image, reference, stderr, reference_stderr):
    r"""Return the MSE without the noise of both, :math:`\overline{(I - R)^2 - \sigma_I^2 - \sigma_R^2}`."""
    noise = np.square(stderr) + np.square(reference_stderr)
    return float(np.mean((image - reference) ** 2 - noise))


def _mean_ratio(above, below):
    """Return the mean of the ratio, 0 / 0 being 0."""
    return float(np.mean(np.divide(above, below, out=np.zeros_like(above, float), where=below > 0)))


def _flip(image, reference):
    from whitted.stats.perceptual import flip

    return flip(image, reference)[0]


def _ciede2000(image, reference):
    from whitted.stats.perceptual import ciede2000

    return ciede2000(image, reference)[0]


# By the name under which a study asks for them: image and reference, (H, W, C), to a number.
METRICS = {
    "mse": mse,
    "rmse": rmse,
    "rel_mse": rel_mse,
    "mae": mae,
    "smape": smape,
    "p99": p99,
    "psnr": psnr,
    "bias": bias,
    "flip": _flip,
    "ciede2000": _ciede2000,
}
PERCEPTUAL = frozenset({"flip", "ciede2000"})  # what people see: a second to load, slower, and not for proofs
