"""Points of the Sobol' sequence in sixteen dimensions, Owen-scrambled by a hash.

Source: [Sobol1967] for the sequence, [JoeKuo2008] for the direction numbers; scrambling as in
``whitted.sampling.sequences``. Left out: further dimensions, and the order by Gray code.

Words of digits have the first digit after the binary point in bit 0: in this order the first dimension is the index
itself, and a scramble takes one reversal of bits instead of two.
"""

import functools

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.sampling.sequences import permute_low_to_high, to_unit

DIMENSIONS = 16

# Degree and inner coefficients of the primitive polynomial, and the first direction numbers, from dimension 1 on:
# the table new-joe-kuo-6 of [JoeKuo2008]. Dimension 0 is the radical inverse and has none.
_DIRECTIONS = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
    (5, 4, (1, 1, 5, 5, 5)),
    (5, 7, (1, 1, 7, 11, 19)),
    (5, 11, (1, 1, 5, 1, 1)),
    (5, 13, (1, 1, 1, 3, 11)),
    (5, 14, (1, 3, 5, 5, 31)),
    (6, 1, (1, 3, 3, 9, 7, 49)),
    (6, 13, (1, 1, 1, 15, 21, 21)),
    (6, 16, (1, 3, 1, 13, 27, 49)),
)

# Butterfly steps of the Pascal matrix modulo 2, which generates dimension 1
_PASCAL = ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF))


def sobol(index, dimension, seed, bits=32):
    """Return one coordinate of an Owen-scrambled Sobol' point.

    For each dimension, every aligned block of ``2**k`` indices has one point in each interval of length ``2**-k``.

    Args:
        index: ``UInt32`` [N], the position in the sequence, any value below ``2**bits``.
        dimension: ``int``, 0 to 15; or ``UInt32`` [N], which is slower.
        seed: ``UInt32`` [N], a well mixed word, for the scrambling; different dimensions need different seeds.
        bits: ``int``, 1 to 32; fewer are faster.

    Returns:
        ``Float`` [N] in [0, 1).
    """
    return scrambled(digits(index, dimension, bits), seed)


def scrambled(word, seed):
    """Return the number in [0, 1) whose binary digits are those of ``word``, nested-uniformly scrambled."""
    return to_unit(dr.brev(permute_low_to_high(word, seed)))


def digits(index, dimension, bits=32, active=True):
    """Return the digits of one coordinate of a Sobol' point, unscrambled.

    With the generator matrix :math:`C` of the dimension it is :math:`C \\, \\text{index}` modulo 2.

    Args:
        index, dimension, bits: as for ``sobol``.
        active: ``Bool`` [N]; where it is false the result is 0 or some other word, and ``dimension`` may be anything.

    Returns:
        ``UInt32`` [N].
    """
    if not isinstance(dimension, int):
        return _looked_up(index, dimension, bits, active)
    if dimension == 0:
        return mi.UInt32(index)
    if dimension == 1:
        return pascal(index, bits)
    word = mi.UInt32(0)
    for bit, column in enumerate(columns(dimension)[:bits]):
        word = word ^ dr.select((index & (1 << bit)) != 0, mi.UInt32(column), 0)
    return word


def pascal(index, bits=32):
    """Return the digits in dimension 1, by a butterfly of shifts instead of 32 columns."""
    for shift, mask in _PASCAL:
        if shift < bits:
            index = index ^ ((index >> shift) & mi.UInt32(mask))
    return index


def _looked_up(index, dimension, bits, active):
    """The digits for a dimension that is not known when the kernel is made, a byte of the index at a time."""
    table = _byte_table(mi.variant())
    word = mi.UInt32(0)
    for byte in range(-(-bits // 8)):
        entry = dimension * 1024 + (((index >> (8 * byte)) & 255) + 256 * byte)
        word = word ^ dr.gather(mi.UInt32, table, entry, active)
    return word


@functools.cache
def columns(dimension):
    """Return the 32 columns of the generator matrix of a dimension, as words of digits (``tuple`` of ``int``)."""
    if dimension == 0:
        return tuple(1 << k for k in range(32))
    degree, coefficients, first = _DIRECTIONS[dimension - 1]
    m = list(first)
    for k in range(degree, 32):
        value = m[k - degree] ^ (m[k - degree] << degree)
        for j in range(1, degree):
            if coefficients >> (degree - 1 - j) & 1:
                value ^= m[k - j] << j
        m.append(value)
    # Direction number k has k + 1 digits, the last of them in its bit 0
    return tuple(int(f"{value:0{k + 1}b}"[::-1], 2) for k, value in enumerate(m))


@functools.cache
def _byte_table(variant):
    """The products of all matrices with all bytes of an index: ``UInt32`` [16 * 4 * 256], for an active variant."""
    table = np.zeros((DIMENSIONS, 4, 256), np.uint32)
    for dimension in range(DIMENSIONS):
        for bit, column in enumerate(columns(dimension)):
            table[dimension, bit // 8, (np.arange(256) >> (bit % 8) & 1) == 1] ^= np.uint32(column)
    return mi.UInt32(table.ravel())
