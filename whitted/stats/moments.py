"""Sums of weighted radiance by group of samples, and what the spread between the groups says about the error.

A group is an independent randomisation (a replicate) or a segment of one low-discrepancy sequence. Sums are
additive over ranges of samples, so resumed, cropped and distributed renders are sums of these. Only the spread
between groups is used: it holds for any reconstruction filter and for stratified points, where the spread within a
group doesn't. Between segments of one sequence it is an upper bound, since they are negatively correlated.
"""

from dataclasses import dataclass

import numpy as np

# Of a pixel; filters give its own sample no less, so that then negative lobes have cancelled the rest
LEAST_WEIGHT = 0.25


@dataclass
class Moments:
    """Sums over the samples of each of G groups.

    Attributes:
        sums: ``float64`` [G, H, W, C], sum of filter weight times value.
        weights: ``float64`` [G, H, W], sum of filter weights.
    """

    sums: np.ndarray
    weights: np.ndarray

    def __add__(self, other):
        """Add the sums of two ranges of samples; a group that one of them lacks counts as empty."""
        groups = max(len(self.sums), len(other.sums))

        def padded(a):
            return np.concatenate([a, np.zeros((groups - len(a), *a.shape[1:]))])

        return Moments(padded(self.sums) + padded(other.sums), padded(self.weights) + padded(other.weights))

    def first(self, channels):
        """Return the moments of the first ``channels`` channels."""
        return Moments(self.sums[..., :channels], self.weights)

    def mean(self):
        """Return the estimate of each pixel, ``float32`` [H, W, C]; 0 where there is no sample.

        A filter with negative lobes may leave a pixel of one sample next to no weight, and then the ratio of the sums
        is of any size. Such a pixel is taken from its neighbours m, as far as its own sums fall short:
        m + (S - m W) / LEAST_WEIGHT.
        """
        sums, weights = self.sums.sum(0), self.weights.sum(0)
        mean = _ratio(sums, weights)
        weak = (weights != 0) & (weights < LEAST_WEIGHT)
        if weak.any():
            near = _ratio(_around(sums), _around(weights))
            mean[weak] = (near + (sums - near * weights[..., None]) / LEAST_WEIGHT)[weak]
        return mean.astype(np.float32)

    def standard_error(self):
        """Return the standard error of ``mean``, ``float32`` [H, W, C]; None below two groups.

        With the residuals r_g = S_g - m W_g of the ratio m = sum S / sum W it is
        sqrt(G / (G - 1) sum r_g^2) / sum W, the jackknife of a ratio to first order [Cochran1977, 6.17].
        """
        filled = [g for g in range(len(self.weights)) if self.weights[g].any()]
        if len(filled) < 2:
            return None
        total = self.weights.sum(0)
        mean = _ratio(self.sums.sum(0), total)
        squares = sum((self.sums[g] - mean * self.weights[g][..., None]) ** 2 for g in filled)
        scale = len(filled) / (len(filled) - 1)
        return _ratio(np.sqrt(scale * squares), total).astype(np.float32)

    def image_mean(self):
        """Return the mean over pixels and channels and its standard error (None below two groups), floats.

        The error is taken between the groups' own image means, and so holds whatever the correlation of pixels.
        """
        mean = float(self.mean().mean(dtype=np.float64))
        total = self.weights.sum(0)
        filled = [g for g in range(len(self.weights)) if self.weights[g].any()]
        if len(filled) < 2:
            return mean, None
        ratio = _ratio(self.sums.sum(0), total)
        parts = [_ratio(self.sums[g] - ratio * self.weights[g][..., None], total).mean() for g in filled]
        scale = len(filled) / (len(filled) - 1)
        return mean, float(np.sqrt(scale * np.sum(np.square(parts))))


def root_mean_square(values):
    """Return the root mean square of an array, in double precision."""
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


def _around(a):
    """The sums over the three by three pixels around each of an array [H, W, ...], as far as there are any."""
    padded = np.pad(a, [(1, 1), (1, 1)] + [(0, 0)] * (a.ndim - 2))
    height, width = a.shape[:2]
    return sum(padded[y : y + height, x : x + width] for y in range(3) for x in range(3))


def _ratio(a, weights):
    """``a / weights`` with 0 where the weight is 0; ``weights`` has one axis less than ``a``."""
    inverse = np.zeros_like(weights)
    np.divide(1, weights, out=inverse, where=weights != 0)
    return a * inverse[..., None]
