r"""Where a ray meets a plane.

.. math:: n \cdot (o + t d) = h
"""

from whitted.geometry.arithmetic import plain_dot, sum_of_products


def textbook_distance(o, d, n, h):
    r"""Return the distance, as lectures write it.

    .. math:: t = \frac{h - n \cdot o}{n \cdot d}

    Both sums cancel: the lower where the ray is nearly parallel, so that the sign may be wrong, the upper where the
    origin is near to the plane and far from 0. No test for 0 catches either.

    Args:
        o: point [N].
        d, n: vectors [N], of any length.
        h: ``Float`` [N].

    Returns:
        ``Float`` [N], of either sign; infinite or NaN where the sum below is 0.
    """
    return (h - plain_dot(n, o)) / plain_dot(n, d)


def distance(o, d, n, h):
    """Return the distance to two roundings of itself, unless the sums cancel beyond twice the digits.

    Each sum is taken in twice the precision. The arguments and the result are those of `textbook_distance`.
    """
    above = -sum_of_products((n.x, o.x), (n.y, o.y), (n.z, o.z), (h, type(h)(-1)))
    return above / sum_of_products((n.x, d.x), (n.y, d.y), (n.z, d.z))
