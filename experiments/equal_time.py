r"""Statistics of a comparison at equal time: squared errors, their curves over seconds, ratios with intervals.

Source: [EfronTibshirani1993] for the bootstrap. Renders of all methods are made in turn; turns are resampled whole, so
that what slows all methods of a turn doesn't widen an interval. Left out: the noise of the reference, told apart.
"""

from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000
INTERVAL = (2.5, 97.5)  # percentiles
SPREAD = 1 + 1e-6  # at least, between one time and the next


@dataclass(frozen=True)
class Curve:
    """Error against seconds of one method.

    Attributes:
        spp: ``int`` [K], K >= 2, increasing: samples per pixel.
        seconds: ``float64`` [R, K] > 0, of one render in each of R turns.
        errors: ``float64`` [R, K], mean squared error of the same renders; a single one may be negative.
    """

    spp: np.ndarray
    seconds: np.ndarray
    errors: np.ndarray

    def at(self, seconds, turns=slice(None)):
        """Return the mean squared error at a time, from some of the turns; NaN where there is no noise to measure.

        Between the mean errors at the median times it is interpolated, a power of the time in each part; outside,
        the first and the last part are continued.
        """
        times, errors = np.median(self.seconds[turns], axis=0), self.errors[turns].mean(axis=0)
        return _power(times, errors, seconds)

    def spp_at(self, seconds):
        """Return the samples per pixel, a float, that take a time, interpolated likewise."""
        return _power(np.median(self.seconds, axis=0), np.asarray(self.spp, float), seconds)

    @property
    def span(self):
        """The shortest and the longest time, medians."""
        times = np.median(self.seconds, axis=0)
        return times[0], times[-1]

    def band(self, seed=0):
        """Return the mean error of each K and its bootstrap 95 % interval, ``float64`` [3, K]."""
        means = self.errors[resampled(len(self.errors), seed)].mean(axis=1)
        return np.stack([self.errors.mean(axis=0), *np.percentile(means, INTERVAL, axis=0)])


def _power(x, y, at):
    """Interpolate positive ``y`` over ``x``, both by their logarithms; times out of order are raised to make one."""
    if not (y > 0).all():
        return np.nan
    steps = SPREAD ** np.arange(len(x))
    x = np.maximum.accumulate(x / steps) * steps
    i = np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2)
    slope = np.log(y[i + 1] / y[i]) / np.log(x[i + 1] / x[i])
    return float(y[i] * (at / x[i]) ** slope)


def resampled(turns, seed=0):
    """Return ``RESAMPLES`` draws of turns with replacement, ``int`` [RESAMPLES, turns]."""
    return np.random.default_rng(seed).integers(0, turns, (RESAMPLES, turns))


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


def common_seconds(curves):
    """Return the longest time that all curves have reached.

    Raises:
        ValueError: one of them begins later.
    """
    time = min(curve.span[1] for curve in curves)
    if time < max(curve.span[0] for curve in curves):
        raise ValueError("there is no time that all methods have both stayed below and reached")
    return float(time)


@dataclass(frozen=True)
class Ratio:
    """How many times lower an error is than that of the best of others, at a time; ``best`` is its number."""

    value: float
    low: float
    high: float
    best: int


def advantage(ours, others, seconds, seed=0):
    r"""Return the `Ratio` :math:`\min_i \mathrm{MSE}_i / \mathrm{MSE}` at equal time, with its bootstrap 95 % interval.

    The best of the others is chosen anew in each resample, as it was in the data.

    Args:
        ours: `Curve`.
        others: list of `Curve`, all of as many turns.
        seconds: the time, > 0.
    """

    def ratio(turns):
        return min(other.at(seconds, turns) for other in others) / ours.at(seconds, turns)

    errors = [other.at(seconds) for other in others]
    value = ratio(slice(None))
    ratios = [ratio(turns) for turns in resampled(len(ours.seconds), seed)]
    if not np.isfinite([value, *ratios]).all():
        return Ratio(value, np.nan, np.nan, int(np.argmin(errors)))
    return Ratio(value, *np.percentile(ratios, INTERVAL), int(np.argmin(errors)))
