"""Sobol' points: the digits against two independent sources, nets exactly, randomisation by tests of stated level.

Seeds are fixed. Had they been drawn at random, each statistical test here would fail for correct code with the
probability that its docstring names, and this file with at most 0.5 %.
"""

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from whitted.sampling.screen import morton, shuffle_digits
from whitted.sampling.sequences import owen_scramble, sobol_2d
from whitted.sampling.sobol import DIMENSIONS, columns, digits, sobol

LEVEL = 1e-5  # of one comparison
PAIRS = list(itertools.combinations(range(8), 2))


def words(value):
    return mi.UInt32(np.asarray(value, np.uint32))


def scipy_points(count):
    """Return scipy's points in the order of the index, not of its Gray code, as words of 32 digits."""
    points = qmc.Sobol(DIMENSIONS, scramble=False, bits=32).random(count)
    number = np.arange(count)
    ordered = np.empty((count, DIMENSIONS), np.uint32)
    ordered[number ^ (number >> 1)] = (points * 2.0**32).astype(np.uint32)
    return ordered


@pytest.mark.parametrize("dimension", range(DIMENSIONS))
def test_unscrambled_points_are_those_of_scipy(dimension):
    index = np.arange(1 << 14)
    expected = scipy_points(1 << 14)[:, dimension]
    for bits in (14, 17, 32):
        np.testing.assert_array_equal(np.array(dr.brev(digits(words(index), dimension, bits))), expected)
        np.testing.assert_array_equal(
            np.array(dr.brev(digits(words(index), mi.UInt32(dimension), bits))), expected
        )


@pytest.mark.parametrize("dimension", range(DIMENSIONS))
def test_the_whole_range_of_indices_by_slow_matrices(dimension):
    """The generator matrix times the index in Python's integers, and its shape: ones on the diagonal, zeros below."""
    rng = np.random.default_rng(dimension)
    index = np.concatenate([rng.integers(0, 2**32, 2000), [0, 1, 2**31, 2**32 - 1]])
    matrix = columns(dimension)
    assert [int(column).bit_length() for column in matrix] == list(range(1, 33))
    expected = []
    for number in index:
        word = 0
        for bit in range(32):
            word ^= matrix[bit] if int(number) >> bit & 1 else 0
        expected.append(word)
    np.testing.assert_array_equal(np.array(digits(words(index), dimension)), expected)
    np.testing.assert_array_equal(np.array(digits(words(index), words(np.full(2004, dimension)))), expected)


@pytest.mark.parametrize("dimension", range(DIMENSIONS))
@pytest.mark.parametrize("seed", [0, 12345, 2**32 - 1])
def test_each_coordinate_is_stratified_in_each_aligned_block(dimension, seed):
    for start in (0, 1, 7, 2**20 + 3):
        for k in range(13):
            first = (start << k) % 2**32
            u = np.array(sobol(words(np.arange(first, first + 2**k)), dimension, words(seed)), np.float64)
            assert len(np.unique((u * 2**k).astype(int))) == 2**k


def t_value(first, second, m):
    """The quality parameter of the net of two dimensions by linear algebra: Niederreiter's criterion."""
    rows = [
        [int("".join(str(c >> r & 1) for c in columns(d)[:m]), 2) for r in range(m)] for d in (first, second)
    ]
    for independent in range(m, 0, -1):
        if all(rank(rows[0][:i] + rows[1][: independent - i]) == independent for i in range(independent + 1)):
            return m - independent
    return m


def rank(vectors):
    """The rank of words as vectors modulo 2."""
    vectors, found = list(vectors), 0
    while vectors:
        pivot = vectors.pop()
        if pivot:
            found += 1
            low = pivot & -pivot
            vectors = [v ^ pivot if v & low else v for v in vectors]
    return found


def fullest(x, y, cells):
    """How many points are in the fullest and the emptiest elementary interval of area ``2**-cells``."""
    most, least = 0, len(x)
    for i in range(cells + 1):
        cell = (x * 2**i).astype(int) * 2 ** (cells - i) + (y * 2 ** (cells - i)).astype(int)
        counts = np.bincount(cell, minlength=2**cells)
        most, least = max(most, counts.max()), min(least, counts.min())
    return most, least


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_pairs_are_nets_of_the_quality_that_theory_gives(first, second):
    """Scrambled or not, a pair is a (t, m, 2)-net; that it is none for t - 1 shows that the check can fail."""
    m = 8
    t = t_value(first, second, m)
    assert t == 0 or (first, second) != (0, 1)
    for start in (0, 3, 1000):
        index = words(np.arange(start << m, (start + 1) << m))
        for seed in (11, 2**31):
            x, y = (np.array(sobol(index, d, words(seed + d)), np.float64) for d in (first, second))
            assert fullest(x, y, m - t) == (2**t, 2**t)
            if t:
                assert fullest(x, y, m - t + 1) != (2 ** (t - 1), 2 ** (t - 1))


def test_some_pairs_are_worse_than_the_first():
    assert {t_value(*pair, 8) for pair in PAIRS} > {0}


def test_the_first_two_dimensions_are_those_of_sobol_2d():
    """Shuffling the index first, which sobol_2d does too, gives the same bits."""
    index, seeds = words(np.arange(1000)), [words(seed) for seed in (77, 2**31, 5)]
    shuffled = owen_scramble(index, seeds[0])
    ours = [np.array(sobol(shuffled, d, seeds[d + 1])) for d in (0, 1)]
    np.testing.assert_array_equal(ours, np.array(sobol_2d(index, seeds)))


def chi_square_2d(x, y, cells=8):
    """The probability that independent uniform numbers fill equal cells as unevenly as these."""
    counts = np.histogram2d(x, y, cells, [(0, 1), (0, 1)])[0]
    return stats.chisquare(counts.ravel()).pvalue


def of_seeds(index, count=1 << 14, apart=True):
    """Return point ``index`` of many randomisations, [8, count]; seeds of all dimensions alike unless ``apart``."""
    seeds = np.random.default_rng(17).integers(0, 2**32, (8 if apart else 1, count))
    return np.array([sobol(words(index), d, words(seeds[d if apart else 0])) for d in range(8)], np.float64)


@pytest.mark.parametrize("index", [0, 1, 6, 37])
def test_each_pair_of_coordinates_is_uniform_over_seeds(index):
    """28 tests of level 1e-5 for each index: 0.11 % for all."""
    points = of_seeds(index)
    assert min(chi_square_2d(points[a], points[b]) for a, b in PAIRS) > LEVEL


def test_one_seed_for_all_coordinates_would_be_noticed():
    points = of_seeds(0, apart=False)
    assert max(chi_square_2d(points[a], points[b]) for a, b in PAIRS) < LEVEL


def test_means_are_unbiased_and_uncorrelated():
    """8 means and 28 correlations of level 1e-5, over seeds, of the mean of 13 points: 0.04 %."""
    means = np.mean([of_seeds(index) for index in range(13)], axis=0)
    error = means.std(1, ddof=1) / np.sqrt(means.shape[1])
    assert (abs(means.mean(1) - 0.5) < stats.norm.isf(LEVEL / 2) * error).all()
    correlation = np.corrcoef(means)[np.triu_indices(8, 1)]
    assert (abs(correlation) < stats.norm.isf(LEVEL / 2) / np.sqrt(means.shape[1])).all()


def product(u):
    """A smooth function of mean 1 in which all four variables are multiplied."""
    return np.prod(1 + np.array([1.0, 0.5, 0.25, 0.125])[:, None, None] * (u - 0.5), axis=0)


def additive(u):
    """A smooth function of mean 1 that is a sum over the four variables."""
    return (3 * u**2).mean(0)


SIZES = 2 ** np.arange(3, 12)


def slope(points_of, integrand):
    """Fit the exponent of the error over 2^3 to 2^11 points; return it with its standard error."""
    errors = [np.sqrt(np.mean((integrand(points_of(size)).mean(1) - 1) ** 2)) for size in SIZES]
    fit = stats.linregress(np.log(SIZES), np.log(errors))
    return fit.slope, fit.stderr


def joint_points(size, replicates=256):
    """Return [4, replicates, size] coordinates."""
    seeds = np.random.default_rng(size).integers(0, 2**32, (4, replicates, 1))
    index, seeds = np.broadcast_arrays(np.arange(size), seeds)
    u = [sobol(words(index[d].ravel()), d, words(seeds[d].ravel())) for d in range(4)]
    return np.array(u, np.float64).reshape(4, replicates, size)


def test_errors_of_smooth_integrands_fall_as_theory_says():
    """As n^-3/2 (log n)^((s-1)/2) where s variables are multiplied [Owen1997]: s = 1, and s = 4, which is less steep
    by at most 3/2 over the mean of log n. Independent numbers give n^-1/2, which the same fit finds.
    """
    exponent, error = slope(joint_points, additive)
    assert abs(exponent + 1.5) < 4 * error
    exponent, error = slope(joint_points, product)
    assert exponent + 4 * error < -1
    assert -1.5 - 4 * error < exponent < -1.5 + 1.5 / np.log(SIZES).mean()
    rng = np.random.default_rng(3)
    exponent, error = slope(lambda size: rng.random((4, 256, size)), product)
    assert abs(exponent + 0.5) < 4 * error


def test_morton_order_interleaves_bits():
    x, y = np.random.default_rng(1).integers(0, 2**16, (2, 1000))
    expected = [
        int("".join(a + b for a, b in zip(f"{v:016b}", f"{u:016b}", strict=True)), 2)
        for u, v in zip(x, y, strict=True)
    ]
    np.testing.assert_array_equal(np.array(morton(words(x), words(y))), expected)


@pytest.mark.parametrize("bits", [0, 1, 2, 3, 6, 9, 12])
def test_shuffled_digits_are_permutations_of_aligned_blocks(bits):
    index = np.arange(1 << bits)
    shuffled = np.array(shuffle_digits(words(index), bits, [words(3), words(4)])).astype(int)
    for digits_kept in range(0, bits + 1, 2):
        low = bits - digits_kept
        block = shuffled >> low
        assert len(np.unique(block)) == 1 << digits_kept
        np.testing.assert_array_equal(block, np.repeat(block[:: 1 << low], 1 << low))


def test_all_32_bits_are_shuffled():
    index = np.arange(2**32 - 4096, 2**32)
    for bits in (31, 32):
        shuffled = np.array(shuffle_digits(words(index % 2**bits), bits, [words(3), words(4)])).astype(int)
        assert len(np.unique(shuffled)) == 4096
        assert len(np.unique(shuffled >> (12 - bits % 2))) == 1 + bits % 2
        assert (shuffled < 2**bits).all()


def keys(count):
    return [words(word) for word in np.random.default_rng(5).integers(0, 2**32, (2, count))]


def test_all_permutations_of_a_digit_are_as_frequent():
    """Two tests of level 1e-5, of 24 permutations over seeds: of the first digit, and of one with digits above it."""
    key = keys(1 << 15)
    for base, bits in ((0, 2), (16, 6)):
        order = [np.array(shuffle_digits(words(base + d), bits, key)) & 3 for d in range(4)]
        assert (np.sort(order, axis=0) == np.arange(4)[:, None]).all()
        names, counts = np.unique(np.array(order), axis=1, return_counts=True)
        assert names.shape[1] == 24
        assert stats.chisquare(counts).pvalue > LEVEL


def test_digits_under_different_digits_are_shuffled_independently():
    """One test of level 1e-5: a table of where digit 0 goes under two digits above."""
    key = keys(1 << 15)
    a, b = (np.array(shuffle_digits(words(above << 2), 6, key)) & 3 for above in (2, 3))
    assert stats.chi2_contingency(np.histogram2d(a, b, 4)[0]).pvalue > LEVEL
