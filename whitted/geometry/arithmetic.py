"""Sums and products whose rounding errors are known: two numbers stand for one of twice the digits.

Source: [OgitaRumpOishi2005]. Dr.Jit compiles what is written, without contraction, so that these hold.
"""

import drjit as dr


def two_sum(a, b):
    """Return the rounded sum of two ``Float``, and its error exactly."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def two_product(a, b):
    """Return the rounded product of two ``Float``, and its error exactly unless that underflows."""
    p = a * b
    return p, dr.fma(a, b, -p)


def difference_of_products(a, b, c, d):
    """Return a b - c d, to 1.5 ulp whatever cancels [JeannerodLouvetMuller2013]."""
    cd = c * d
    return dr.fma(a, b, -cd) + dr.fma(-c, d, cd)


def sum_of_products(*pairs):
    """Return the sum of the products of pairs of ``Float``, nearly as if computed in twice the precision."""
    total, error = two_product(*pairs[0])
    for a, b in pairs[1:]:
        product, low = two_product(a, b)
        total, lost = two_sum(total, product)
        error = error + (lost + low)
    return total + error


def plain_dot(a, b):
    """Return a . b as a textbook writes it: products rounded, then added."""
    return a.x * b.x + a.y * b.y + a.z * b.z
