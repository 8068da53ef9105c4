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


def textbook_footprint(o, d, d_x, n, h):
    r"""Return how far the hit moves on a plane from one ray to its neighbour, as the difference of both hits.

    .. math:: \Delta p = (o + t_x d_x) - (o + t d)

    What is left of the hits' digits is fewer the finer the pixels are.

    Args:
        o: point [N], of both rays.
        d, d_x: vectors [N], their directions.
        n: vector [N], of any length.
        h: ``Float`` [N], the plane is where ``n . x = h``.

    Returns:
        Vector [N].
    """
    hit, hit_x = (o + textbook_distance(o, direction, n, h) * direction for direction in (d, d_x))
    return hit_x - hit


def footprint(o, d, d_x, n, h):
    r"""Return the same from the difference of the directions, which is exact between neighbours.

    .. math:: \Delta p = t \left(\Delta d - \frac{n \cdot \Delta d}{n \cdot d_x} d_x\right)

    Source: [Igehy1999], with differences for differentials. The arguments and the result are those of
    `textbook_footprint`.
    """
    change = d_x - d
    slopes = (sum_of_products((n.x, v.x), (n.y, v.y), (n.z, v.z)) for v in (change, d_x))
    along, across = slopes
    return distance(o, d, n, h) * (change - along / across * d_x)
