r"""A reference from two unbiased sets of pictures, and squared errors against it."""

import numpy as np


def squared_error(image, reference, reference_variance=0.0):
    r"""Return :math:`\overline{(I - R)^2} - \mathrm{Var}\,R`, the squared error against what R estimates.

    Args:
        image, reference: [H, W, C], linear radiance.
        reference_variance: mean variance of the reference's values, >= 0.
    """
    return float(np.mean((np.asarray(image, np.float64) - reference) ** 2) - reference_variance)


def combined(a, b):
    r"""Return the mean of two unbiased sets of pictures, weighted by their precision, and its mean variance.

    With the mean variances of the sets' means, :math:`v_a, v_b`, the weights are :math:`1/v_a` and :math:`1/v_b`.

    Args:
        a, b: [R, H, W, C] and [S, H, W, C], R and S >= 2.
    """
    variances = [np.mean(np.var(side, axis=0, ddof=1, dtype=np.float64)) / len(side) for side in (a, b)]
    means = [np.mean(side, axis=0, dtype=np.float64) for side in (a, b)]
    exact = [mean for mean, variance in zip(means, variances, strict=True) if variance == 0]
    if exact:
        return exact[0], 0.0
    total = sum(1 / variance for variance in variances)
    reference = sum(mean / variance for mean, variance in zip(means, variances, strict=True)) / total
    return reference, float(1 / total)
