"""Running moments up to the fourth, elementwise, that can be merged: mean, variance, skewness, kurtosis.

Powers of deviations from the mean are summed, not of the values, so that nothing cancels where the mean exceeds the
spread by far. Source: [ChanGolubLeVeque1983] for merging variances, [Pebay2008] for higher moments. Left out: weights,
see `whitted.stats.moments`.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Running:
    """Moments of ``count`` arrays of one shape; without arguments, of none.

    Attributes:
        count: how many values each place has seen.
        mean: ``float64``, the arrays' shape.
        m2, m3, m4: sums of the second, third and fourth powers of the deviations from ``mean``.
    """

    count: int = 0
    mean: np.ndarray = 0.0
    m2: np.ndarray = 0.0
    m3: np.ndarray = 0.0
    m4: np.ndarray = 0.0

    @classmethod
    def of(cls, values, axis=0):
        """Return the moments of values along an axis; a constant's are exact."""
        values = np.moveaxis(np.asarray(values, np.float64), axis, 0)
        count = len(values)
        if not count:
            return cls()
        first = values[0]
        deviation = values - first
        offset = deviation.mean(axis=0)
        deviation -= offset
        square = deviation * deviation
        sums = (square.sum(axis=0), (square * deviation).sum(axis=0), (square * square).sum(axis=0))
        return cls(count, first + offset, *sums)

    def add(self, values):
        """Return the moments with a batch of more arrays, [B, ...], merged in."""
        return self + Running.of(values)

    def __add__(self, other):
        """Merge; the same parts merged in the same order give the same bits."""
        if not self.count or not other.count:
            return self if self.count else other
        a, b, n = self.count, other.count, self.count + other.count
        delta = other.mean - self.mean
        d2 = delta * delta
        m2 = self.m2 + other.m2 + d2 * (a * b / n)
        m3 = self.m3 + other.m3 + d2 * delta * (a * b * (a - b) / n**2)
        m3 = m3 + 3 * delta * (a * other.m2 - b * self.m2) / n
        m4 = self.m4 + other.m4 + d2 * d2 * (a * b * (a * a - a * b + b * b) / n**3)
        m4 = m4 + 6 * d2 * (a * a * other.m2 + b * b * self.m2) / n**2
        m4 = m4 + 4 * delta * (a * other.m3 - b * self.m3) / n
        return Running(n, self.mean + delta * (b / n), m2, m3, m4)

    def variance(self):
        """Return the unbiased sample variance (ddof 1); NaN below two values."""
        return _ratio(self.m2, self.count - 1)

    def standard_error(self):
        """Return the standard error of ``mean``; NaN below two values."""
        return np.sqrt(_ratio(self.variance(), self.count))

    def skewness(self):
        """Return the adjusted sample skewness G1, of expectation 0 for normal values.

        NaN below three values, and where all are equal.
        """
        n = self.count
        if n < 3:
            return _ratio(self.m2, 0)
        g1 = np.sqrt(n) * _ratio(self.m3, self.m2 * np.sqrt(self.m2))
        return g1 * (np.sqrt(n * (n - 1)) / (n - 2))

    def excess_kurtosis(self):
        """Return the adjusted sample excess kurtosis G2, at most ``count``, of expectation 0 for normal values.

        NaN below four values, and where all are equal.
        """
        n = self.count
        if n < 4:
            return _ratio(self.m2, 0)
        g2 = n * _ratio(self.m4, self.m2 * self.m2) - 3
        return ((n + 1) * g2 + 6) * ((n - 1) / ((n - 2) * (n - 3)))


def _ratio(above, below):
    """Return the ratio, NaN where ``below`` isn't positive."""
    above, below = np.asarray(above, np.float64), np.asarray(below, np.float64)
    shape = np.broadcast_shapes(above.shape, below.shape)
    return np.divide(above, below, out=np.full(shape, np.nan), where=below > 0)[()]
