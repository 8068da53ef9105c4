r"""What accuracy costs: efficiency, time to unit variance, time to a stated error, each with its interval.

Efficiency is :math:`1 / (V T)`, V the expected squared error of a render and T its time [PharrJakobHumphreys2023,
section 2.1.4]. Independent samples have one efficiency, however many they are. Samples of a low-discrepancy sequence do
not: their squared error falls faster than 1/n, so that the efficiency grows with n, which is to be stated with it. Left
out: ladders of several n, see `whitted.stats.curves`.
"""

import numpy as np

from whitted.stats.intervals import bootstrap_t, mean, midmean

INDEPENDENT = -0.5  # slope of RMSE against n, or time, of independent samples


def efficiency(errors, seconds, level=0.95, seed=0):
    """Return the `Interval` of 1 / (V T) at the number of samples that was measured.

    Args:
        errors: [R], squared error or variance of each replicate; V is their mean.
        seconds: [R], the time of each, > 0, NaN where it wasn't measured; T is their mean
            without the lowest and the highest quarter.
        level: in (0, 1).
        seed: of the resamples, of replicates whole.
    """
    return _interval(lambda v, t: 1 / (v * t), errors, seconds, level, seed)


def time_to_unit_variance(errors, seconds, level=0.95, seed=0):
    """Return the `Interval` of V T, the seconds in which independent samples reach a squared error of 1.

    The arguments are those of `efficiency`.
    """
    return _interval(lambda v, t: v * t, errors, seconds, level, seed)


def time_to_error(error, errors, seconds, slope=INDEPENDENT, level=0.95, seed=0):
    r"""Return the `Interval` of the seconds in which the RMSE falls to ``error``.

    .. math:: T(e) = T_n\, (\mathrm{RMSE}_n / e)^{1 / |b|}

    Args:
        error: RMSE, > 0.
        errors, seconds: of renders of n samples, as for `efficiency`.
        slope: b, of RMSE against n, < 0, and against time as well: what a render costs besides its samples is left
            out. It counts as known; its own error isn't in the interval, and weighs the more the further ``error`` is
            from what was measured.
        level: in (0, 1).
        seed: of the resamples.
    """
    power = 1 / (2 * abs(slope))
    return _interval(lambda v, t: t * (v / error**2) ** power, errors, seconds, level, seed)


def _interval(function, errors, seconds, level, seed):
    """Return the log-scale `Interval` of a function of the mean error and the midmean of time."""
    errors, seconds = np.asarray(errors, np.float64), np.asarray(seconds, np.float64)
    if errors.ndim != 1 or errors.shape != seconds.shape:
        raise ValueError(
            f"errors and seconds are [R] of the same renders, not {errors.shape} and {seconds.shape}"
        )

    def statistic(weights):
        return function(mean(errors, weights), midmean(seconds, weights))

    return bootstrap_t(statistic, len(errors), level=level, seed=seed, scale="log")
