"""The sample sequences: nets exactly, uniformity and independence by tests of stated level.

Seeds are fixed. Had they been drawn at random, each statistical test here would fail for correct code with the
probability that its docstring names, and this file with at most 1.5 %.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats

from whitted.sampling.draws import EFFECTS, Draws, joint_dimensions
from whitted.sampling.groups import opaque_seed
from whitted.sampling.sequences import hash4, owen_scramble, permute_low_to_high, sobol_2d

LEVEL = 1e-4  # of one comparison


def words(*values):
    return [mi.UInt32(value) for value in values]


def points(index, seeds):
    """Return sobol_2d at the indices as ``float64`` [N, 2]."""
    return np.array(sobol_2d(mi.UInt32(np.asarray(index, np.uint32)), words(*seeds)), np.float64).T


def draws_of(pixel=0, index=0, seed=0, block=0, joint=None):
    return Draws(*(mi.UInt32(np.asarray(value, np.uint32)) for value in (pixel, index, seed, block)), joint)


@pytest.mark.parametrize("seed", range(5))
def test_aligned_blocks_are_nets(seed):
    """Each aligned block of 2^k indices has one point in every elementary interval of area 2^-k."""
    seeds = np.random.default_rng(seed).integers(0, 2**32, 3)
    for start in (0, 1, 5, 77, 2**20 + 3):
        for k in range(11):
            first = (start << k) % 2**32
            x, y = points(np.arange(first, first + 2**k), seeds).T
            for i in range(k + 1):
                cell = (x * 2**i).astype(int) * 2 ** (k - i) + (y * 2 ** (k - i)).astype(int)
                assert len(np.unique(cell)) == 2**k, (start, k, i)


@pytest.mark.parametrize("seed", [0, 1, 0xFFFFFFFF, 0x12345678])
def test_scrambles_are_nested_permutations(seed):
    """Equal leading digits stay equal, to the last digit: of 2^16 words with 16 leading digits all different ones."""
    top = mi.UInt32(np.arange(1 << 16, dtype=np.uint32) << 16)
    scrambled = np.array(owen_scramble(top, mi.UInt32(seed)))
    other = np.array(owen_scramble(top | 0xABCD, mi.UInt32(seed)))
    for digits in range(1, 17):
        assert len(np.unique(scrambled >> (32 - digits))) == 1 << digits
        np.testing.assert_array_equal(scrambled >> (32 - digits), other >> (32 - digits))
    low = mi.UInt32(np.arange(1 << 16, dtype=np.uint32))
    assert len(np.unique(np.array(permute_low_to_high(low, mi.UInt32(seed))) & 0xFFFF)) == 1 << 16


def test_numbers_lie_in_the_unit_interval():
    highest = np.array(mi.UInt32(0xFFFFFFFF))
    for index in (0, 1, 2**32 - 1):
        p = points([index], highest.repeat(3))
        assert (p >= 0).all()
        assert (p < 1).all()


def chi_square(u, cells=64):
    """The probability that uniform numbers fill equal cells as unevenly as these."""
    counts = np.histogram(u, cells, (0, 1))[0]
    return stats.chisquare(counts).pvalue


@pytest.mark.parametrize("effect", EFFECTS)
def test_one_draw_of_each_pixel_is_uniform(effect):
    """16 tests of level 1e-4: 0.16 %."""
    numbers = draws_of(pixel=np.arange(1 << 16), index=3, seed=8)(effect, node=5)
    for u in np.array(numbers):
        assert chi_square(u) > LEVEL


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("pixel", [0, 5, 65541])
def test_the_first_number_of_a_pixel_is_uniform_over_seeds(effect, pixel):
    """48 tests of level 1e-4: 0.5 %. What a render of one sample is on average depends on it."""
    seeds = [int(opaque_seed(0, number)[0]) for number in range(1 << 12)]
    draws = draws_of(
        pixel=pixel, index=0, seed=np.array(seeds), joint=joint_dimensions({"antialiasing", "soft_shadows"})
    )
    for u in np.array(draws(effect)):
        assert chi_square(u, 16) > LEVEL


def test_every_bit_of_a_hash_is_set_as_often_as_not():
    """128 bits for each of 3 pixels, at 6 standard errors: 1e-6."""
    count = 1 << 16
    for pixel in (0, 5, 65541):
        found = np.array(
            [
                w.numpy()
                for w in hash4(mi.UInt32(pixel), mi.UInt32(3), dr.arange(mi.UInt32, count), mi.UInt32(0))
            ]
        )
        share = np.unpackbits(found.astype(">u4").view(np.uint8).reshape(4, count, 4), axis=2).mean(axis=1)
        assert np.abs(share - 0.5).max() < 6 * 0.5 / np.sqrt(count)


def test_points_of_many_seeds_fill_the_square_uniformly():
    """One test of level 1e-4."""
    x, y = np.array(draws_of(index=11, seed=np.arange(1 << 16))("light", 2))
    counts = np.histogram2d(x, y, 16, [(0, 1), (0, 1)])[0]
    assert stats.chisquare(counts.ravel()).pvalue > LEVEL


SIZE = 1 << 14
NUMBER = np.arange(SIZE)
PAIRS = {
    "two effects": (draws_of, {"pixel": NUMBER}, ("light", 0, 0), {"pixel": NUMBER}, ("gloss", 0, 0)),
    "two nodes": (draws_of, {"pixel": NUMBER}, ("light", 1, 0), {"pixel": NUMBER}, ("light", 2, 0)),
    "two splits": (draws_of, {"pixel": NUMBER}, ("light", 1, 0), {"pixel": NUMBER}, ("light", 1, 1)),
    "neighbours": (draws_of, {"pixel": NUMBER}, ("pixel", 0, 0), {"pixel": NUMBER + 1}, ("pixel", 0, 0)),
    "rows": (draws_of, {"pixel": NUMBER}, ("pixel", 0, 0), {"pixel": NUMBER + 65536}, ("pixel", 0, 0)),
    "two seeds": (
        draws_of,
        {"pixel": NUMBER, "seed": 1},
        ("lens", 0, 0),
        {"pixel": NUMBER, "seed": 2},
        ("lens", 0, 0),
    ),
    "two samples": (
        draws_of,
        {"pixel": NUMBER, "index": 0},
        ("lens", 0, 0),
        {"pixel": NUMBER, "index": 1024},
        ("lens", 0, 0),
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_draws_that_have_to_be_independent_are_uncorrelated(name):
    """4 correlations each, and 4 of the digits' parity, of level 1e-4: 0.6 % / 7 = 0.08 % for each pair of draws.

    Two samples of one pixel lie in different strata of a block that holds both: samples 0 and 1024 are strangers.
    """
    make, first, at_first, second, at_second = PAIRS[name]
    a = np.array(make(**first)(*at_first), np.float64)
    b = np.array(make(**second)(*at_second), np.float64)
    limit = stats.norm.isf(LEVEL / 2) / np.sqrt(SIZE)
    for u in a:
        for v in b:
            assert abs(np.corrcoef(u, v)[0, 1]) < limit
            parity = np.corrcoef((u * 256).astype(int) % 2, (v * 256).astype(int) % 2)[0, 1]
            assert abs(parity) < limit


def test_the_two_coordinates_of_a_draw_are_uncorrelated():
    """One test of level 1e-4."""
    x, y = np.array(draws_of(pixel=NUMBER)("light", 3), np.float64)
    assert abs(np.corrcoef(x, y)[0, 1]) < stats.norm.isf(LEVEL / 2) / np.sqrt(SIZE)


def test_a_correlation_would_be_noticed():
    """Two samples of one pixel that share a block of two are in different halves, and so correlated."""
    first = np.array(draws_of(pixel=NUMBER, index=0)("lens"), np.float64)
    second = np.array(draws_of(pixel=NUMBER, index=1)("lens"), np.float64)
    assert np.corrcoef(first[0], second[0])[0, 1] < -10 / np.sqrt(SIZE)


def test_audits_are_uniform_and_alike_in_a_block():
    """Three tests of level 1e-4."""
    every = draws_of(pixel=NUMBER, index=5, seed=2, block=NUMBER // 16).audit(7).numpy()
    assert (every.reshape(-1, 16) == every[::16, None]).all()
    assert chi_square(every[::16], 16) > LEVEL
    by_node = draws_of(block=3).audit(mi.UInt32(NUMBER.astype(np.uint32))).numpy()
    assert chi_square(by_node) > LEVEL
    by_index = draws_of(block=3, index=NUMBER).audit(1).numpy()
    assert abs(np.corrcoef(by_node, by_index)[0, 1]) < stats.norm.isf(LEVEL / 2) / np.sqrt(SIZE)


def test_numbers_depend_on_nothing_but_their_arguments():
    everything = draws_of(pixel=[4, 9, 2], index=[7, 7, 1], seed=[3, 3, 3])("light", mi.UInt32([1, 5, 8]), 2)
    alone = draws_of(pixel=[9], index=[7], seed=[3])("light", 5, 2)
    np.testing.assert_array_equal(np.array(everything)[:, 1], np.array(alone)[:, 0])


@pytest.mark.parametrize("node", [0, 1, 2**31, 2**32 - 1])
def test_node_and_split_may_be_numbers_or_arrays(node):
    draws = draws_of(pixel=np.arange(4))
    number = np.array(draws("light", node, 3))
    array = np.array(draws("light", mi.UInt32(node), mi.UInt32(3)))
    np.testing.assert_array_equal(number, array)


def test_pcg4d_as_published_with_upper_bits_folded_into_lower():
    """The same arithmetic in Python's integers."""
    v = [11, 22, 33, 2**32 - 1]
    a = [(n * 1664525 + 1013904223) % 2**32 for n in v]

    def mix(x, y, z, w):
        x = (x + y * w) % 2**32
        y = (y + z * x) % 2**32
        z = (z + x * y) % 2**32
        return x, y, z, (w + y * z) % 2**32

    a = mix(*(n ^ (n >> 16) for n in mix(*a)))
    assert [int(w[0]) for w in hash4(*words(*v))] == [n ^ (n >> 16) for n in a]


def test_seeds_of_users_and_replicates_are_spread():
    seeds = [
        int(opaque_seed(seed, replicate)[0]) for seed in (*range(40), 2**40, -1) for replicate in range(8)
    ]
    assert len(set(seeds)) == len(seeds)
    bits = np.unpackbits(np.array(seeds, np.uint32).view(np.uint8)).reshape(-1, 32).mean(0)
    assert (abs(bits - 0.5) < 0.15).all()


def test_seeds_are_data_and_no_part_of_the_kernel():
    assert dr.width(opaque_seed(5)) == 1
    assert opaque_seed(5).state == dr.VarState.Evaluated
