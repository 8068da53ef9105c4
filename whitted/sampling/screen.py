"""One order for the samples of a whole screen, in which near pixels are near: a Z-curve with shuffled digits.

Source: [Morton1966] for the curve, [AhmedWonka2020] for shuffling its digits, which keeps a low-discrepancy
sequence well distributed over every square of pixels, so that the error is blue noise. Left out: their tables; each
shuffle is hashed where it is needed.
"""

import drjit as dr
import mitsuba as mi

from whitted.sampling.sequences import hash4


def morton(x, y):
    """Interleave the bits of two ``UInt32`` [N] below 2^16: those of ``x`` are the even ones."""

    def spread(v):
        for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
            v = (v | (v << shift)) & mi.UInt32(mask)
        return v

    return spread(x) | (spread(y) << 1)


def shuffle_digits(index, bits, key):
    """Permute the base-4 digits of an index, each at random, depending on the digits above it.

    An aligned block of ``4**k`` indices goes to one of the same size. Where ``bits`` is odd the last digit is in
    base 2.

    Args:
        index: ``UInt32`` [N] below ``2**bits``.
        bits: ``int``, 0 to 32.
        key: two ``UInt32`` [N or 1], well mixed; different keys give independent permutations.

    Returns:
        ``UInt32`` [N] below ``2**bits``, a permutation of the indices.
    """
    shuffled = mi.UInt32(0)
    last = bits % 2
    for place in range(bits - 2, last - 1, -2):
        above = index >> (place + 2) if place + 2 < 32 else mi.UInt32(0)
        word = hash4(above, mi.UInt32(place), *key)[3]
        shuffled = (shuffled << 2) | _permuted(index >> place, word)
    if last:
        word = hash4(index >> 1, mi.UInt32(32), *key)[3]
        shuffled = (shuffled << 1) | ((index ^ (word >> 31)) & 1)
    return shuffled


def _permuted(digit, word):
    """One of the 24 permutations of two bits: all of them are affine maps modulo 2."""
    first = ((word >> 16) * 3) >> 16  # columns of the matrix are two different ones of 1, 2, 3
    second = first + 1 + ((word >> 2) & 1)
    second = dr.select(second > 2, second - 3, second) + 1
    first = dr.select((digit & 1) != 0, first + 1, 0)
    return first ^ dr.select((digit & 2) != 0, second, 0) ^ (word & 3)
