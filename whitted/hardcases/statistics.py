"""Statistics: variances of values whose mean exceeds their spread by far, of constants, and numbers of samplers."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.walls import MOMENT, by_path, wall
from whitted.sampling.draws import Draws
from whitted.stats.moments import Moments
from whitted.stats.running import Running

FAMILY = "statistics"
COUNT = 4096
GROUPS = 8
DOUBLE = 2.0**-53  # the relative error of a rounding in double precision
PIXELS, SPP, NUMBERS = 4096, 64, 8  # of a sampler
CELLS = 8  # of an axis


def textbook_variance(values):
    r"""The unbiased variance of ``float32`` values [N] from their running sums, as lectures write it.

    .. math:: \\frac{1}{n - 1} \\left(\\sum x^2 - \\frac{1}{n} \\left(\\sum x\\right)^2\\right)
    """
    count = np.float32(len(values))
    total, squares = (np.cumsum(v, dtype=np.float32)[-1] for v in (values, values * values))
    return np.float64((squares - total * total / count) / (count - 1))


def _bright(mean):
    """Normal values of variance 1 about a mean, rounded to single precision, and their variance (``longdouble``)."""
    values = np.float32(mean + np.random.default_rng(85).standard_normal(COUNT))
    return values, np.longdouble(values).var(ddof=1)


@case(
    "85", FAMILY,
    sweep=("mean", (0.0, 1e2, 1e3, 1e4, 1e5, 1e6)), tolerance=lambda mean: COUNT * DOUBLE * (1 + mean * DOUBLE),
    why="deviations from the first value are exact in double precision; sums of n are right to n 2^-53",
    source="ChanGolubLeVeque1983",
)  # fmt: skip
def variance_far_below_the_mean(mean):
    """The sample variance of 4096 values of deviation 1, relative."""
    values, truth = _bright(mean)
    return Errors(Running.of(values).variance() / truth - 1, textbook_variance(values) / truth - 1)


@case(
    "85", FAMILY,
    sweep=("mean", (0.0, 1e2, 1e3, 1e4, 1e5, 1e6)), tolerance=lambda mean: COUNT * DOUBLE * (1 + mean),
    why="the means of parts are rounded: 2^-53 of the mean each, against a deviation of 1",
    source="ChanGolubLeVeque1983",
)  # fmt: skip
def variance_merged_from_parts(mean):
    """The same, merged from parts of 64 values, relative."""
    values, truth = _bright(mean)
    merged = Running()
    for part in np.split(values, 64):
        merged = merged.add(part)
    return Errors(merged.variance() / truth - 1, _welford(values) / truth - 1)


def _welford(values):
    """The unbiased variance, value by value in single precision: better than sums of squares, and not enough."""
    mean = m2 = np.float32(0)
    for count, value in enumerate(values, 1):
        delta = value - mean
        mean = mean + delta / np.float32(count)
        m2 = m2 + delta * (value - mean)
    return np.float64(m2 / np.float32(len(values) - 1))


@case(
    "85", FAMILY,
    sweep=("mean", (0.0, 1e2, 1e3, 1e4, 1e5, 1e6)), tolerance=lambda mean: U + 16 * DOUBLE * (1 + 64 * mean),
    why="sums in double precision over a standard error of 1/64, which is rounded to single", source="Cochran1977",
)  # fmt: skip
def standard_error_of_a_bright_pixel(mean):
    """The standard error of a pixel's mean from its eight groups of 512 samples, relative."""
    values = _bright(mean)[0].reshape(GROUPS, -1)
    moments = Moments(
        values.sum(1, dtype=np.float64).reshape(GROUPS, 1, 1, 1), np.full((GROUPS, 1, 1), 512.0)
    )
    of_groups = np.longdouble(values).mean(1)
    truth = np.sqrt(of_groups.var(ddof=1) / GROUPS)
    plain = np.sqrt(textbook_variance(values.mean(1, dtype=np.float32)) / GROUPS)
    return Errors(moments.standard_error() / truth - 1, plain / truth - 1)


@case(
    "86", FAMILY, unit="of the square",
    sweep=("value", (0.1, 1.1, 1e3 / 7, 1e6 / 7)), tolerance=0,
    why="deviations from the first value are 0, those of equal means too", source="ChanGolubLeVeque1983",
)  # fmt: skip
def variance_of_a_constant(value):
    """The variance of 4096 equal values, merged from parts, and by Mitsuba's integrator ``moment``."""
    values = np.full(COUNT, np.float32(value))
    square = np.float64(values[0]) ** 2
    merged = sum((Running.of(part) for part in np.split(values, 64)), Running())
    moment = by_path(wall(value, side=1), COUNT, MOMENT)
    reference = moment[..., -2] - moment[..., -5] ** 2
    return Errors(merged.variance() / square, textbook_variance(values) / square, reference / square)


@case(
    "86", FAMILY,
    sweep=("value", (0.1, 1.1, 1e3 / 7, 1e6 / 7)), tolerance=4 * DOUBLE,
    why="sums of single-precision numbers are exact in double precision; the mean, its product and residuals aren't",
    source="Cochran1977",
)  # fmt: skip
def standard_error_of_a_constant(value):
    """The standard error of a pixel of which all samples are equal, relative."""
    values = np.full((GROUPS, 509), np.float32(value))
    moments = Moments(
        values.sum(1, dtype=np.float64).reshape(GROUPS, 1, 1, 1), np.full((GROUPS, 1, 1), 509.0)
    )
    plain = textbook_variance(values.ravel()) / values.size
    return Errors(moments.standard_error() / value, np.sqrt(np.abs(plain)) / value)


# ---- Samplers


def _numbers(kind):
    """The first numbers of the samples of a sampler, ``float64`` [numbers, samples]."""
    sampler = mi.load_dict({"type": kind, "sample_count": SPP})
    sampler.set_samples_per_wavefront(SPP)
    sampler.seed(0, PIXELS * SPP)
    return np.array([sampler.next_1d() for _ in range(NUMBERS)], np.float64)


def _pairs(kind, apart):
    numbers = _numbers(kind)
    return zip(numbers[:-apart], numbers[apart:], strict=True)


def _excess(counts):
    """Pearson's statistic of counts of equal expectation, in standard deviations above its mean; 0 below."""
    expected = counts.mean()
    freedom = counts.size - 1
    return max(((counts - expected) ** 2).sum() / expected - freedom, 0) / np.sqrt(2 * freedom)


@case(
    "R2", FAMILY, unit="standard deviations",
    sweep=("numbers apart", (1.0, 2.0, 3.0, 4.0, 5.0)), tolerance=5,
    why="of independent numbers, 1 / sqrt(n); of stratified ones less", source="Owen1995",
)  # fmt: skip
def correlation_of_two_numbers(apart):
    """The correlation of two numbers of a sample of ``owen_sobol``, and of Mitsuba's ``ldsampler``."""

    def largest(kind):
        pairs = _pairs(kind, int(apart))
        return max(abs(np.corrcoef(a, b)[0, 1]) for a, b in pairs) * np.sqrt(PIXELS * SPP)

    return Errors(ours=largest("owen_sobol"), reference=largest("ldsampler"))


@case(
    "R2", FAMILY, unit="standard deviations",
    sweep=("numbers apart", (1.0, 2.0, 3.0, 4.0, 5.0)), tolerance=5,
    why="those of chi-square with 63 degrees of freedom", source="Owen1995",
)  # fmt: skip
def cells_of_two_numbers(apart):
    """How unevenly two numbers of a sample fill 8x8 cells, by ``owen_sobol`` and by Mitsuba's ``ldsampler``."""

    def worst(kind):
        pairs = _pairs(kind, int(apart))
        return max(_excess(np.histogram2d(a, b, CELLS, [[0, 1], [0, 1]])[0]) for a, b in pairs)

    return Errors(ours=worst("owen_sobol"), reference=worst("ldsampler"))


@case(
    "R2", FAMILY, unit="standard deviations",
    sweep=("pixels", (2.0**12, 2.0**16, 2.0**20)), tolerance=5,
    why="those of chi-square with 63 degrees of freedom", source="JarzynskiOlano2020",
)  # fmt: skip
def first_sample_of_each_pixel(pixels):
    """How unevenly the first samples of pixels fill 8x8 cells, and the lowest digits of a hash, as published."""
    lane = dr.arange(mi.UInt32, int(pixels))
    pixel = (lane >> 10) * 65536 + (lane & 1023)
    point = np.array(Draws(pixel, mi.UInt32(0), mi.UInt32(1), lane)("pixel"), np.float64)
    hashed = np.array([mi.Float(word & 7) / 8 for word in _pcg4d(pixel)[:2]], np.float64)
    return Errors(*(_excess(np.histogram2d(*p, CELLS, [[0, 1], [0, 1]])[0]) for p in (point, hashed)))


def _pcg4d(pixel):
    """The words of pcg4d of [JarzynskiOlano2020] for the numbers (pixel, 0, 1, 0)."""
    x, y, z, w = (mi.UInt32(v) * 1664525 + 1013904223 for v in (pixel, 0, 1, 0))
    for last in (False, True):
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
        if not last:
            x, y, z, w = (v ^ (v >> 16) for v in (x, y, z, w))
    return x, y, z, w
