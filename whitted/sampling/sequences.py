"""The first two Sobol' dimensions and Owen's nested scrambling as arithmetic on 32-bit words.

Source: [Owen1995] for nested uniform scrambling, [Burley2020] for doing it by a hash, [Vegdahl2021] for the
hash used here. Left out: Sobol' dimensions beyond two; further dimensions are padded with shuffled copies.
"""

import drjit as dr
import mitsuba as mi

# Butterfly steps of the Pascal matrix modulo 2, which generates the second Sobol' dimension
_PASCAL = ((1, 0xAAAAAAAA), (2, 0xCCCCCCCC), (4, 0xF0F0F0F0), (8, 0xFF00FF00), (16, 0xFFFF0000))


def hash4(x, y, z, w):
    """Four well-mixed 32-bit words from four: pcg4d of [JarzynskiOlano2020], its upper bits folded into the lower.

    Without that the lowest bit of a word is set in 3 of 8 or 5 of 8 cases, and it decides in which half of the unit
    interval the first number of a scrambled sequence lies.

    Args:
        x, y, z, w: ``UInt32``, any value.

    Returns:
        A tuple of four ``UInt32``.
    """
    x, y, z, w = (v * mi.UInt32(1664525) + mi.UInt32(1013904223) for v in (x, y, z, w))

    def mix(x, y, z, w):
        x = dr.fma(y, w, x)
        y = dr.fma(z, x, y)
        z = dr.fma(x, y, z)
        return x, y, z, dr.fma(y, z, w)

    words = mix(x, y, z, w)
    words = mix(*(v ^ (v >> 16) for v in words))
    return tuple(v ^ (v >> 16) for v in words)


def permute_low_to_high(x, seed):
    """A random permutation in which bit ``i`` of the result depends on bits ``0..i`` of ``x`` only.

    It is Owen's scramble for words whose digits are reversed; the hash is of Laine and Karras' kind with the
    constants of [Vegdahl2021].
    """
    x = x ^ (x * mi.UInt32(0x3D20ADEA))
    x = x + seed
    x = x * ((seed >> 16) | 1)
    x = x ^ (x * mi.UInt32(0x05526C56))
    return x ^ (x * mi.UInt32(0x53A22864))


def owen_scramble(x, seed):
    """Nested uniform scrambling in base 2 of the digits of ``x``, the most significant first."""
    return dr.brev(permute_low_to_high(dr.brev(x), seed))


def to_unit(x):
    """Map ``UInt32`` to ``Float`` in [0, 1), by the upper 24 bits."""
    return mi.Float(x >> 8) * mi.ScalarFloat(2.0**-24)


def sobol_2d(index, seeds):
    """Point ``index`` of an Owen-scrambled, shuffled (0, 2)-sequence in base 2.

    Every aligned block of ``2**k`` indices is a (0, k, 2)-net: it has one point in each elementary interval.

    Args:
        index: ``UInt32`` [N], the position in the sequence.
        seeds: three ``UInt32`` [N]: for the order of the points and for each dimension.

    Returns:
        ``Point2f`` [N] in [0, 1)^2.
    """
    shuffled = dr.brev(
        owen_scramble(index, seeds[0])
    )  # digits of the radical inverse, most significant first
    pascal = shuffled
    for shift, mask in _PASCAL:
        pascal = pascal ^ ((pascal << shift) & mi.UInt32(mask))
    return mi.Point2f(to_unit(owen_scramble(shuffled, seeds[1])), to_unit(owen_scramble(pascal, seeds[2])))
