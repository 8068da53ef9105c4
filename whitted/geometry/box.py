"""Where a ray enters and leaves a box whose sides are along the axes."""

import drjit as dr

WIDER = 1 + 2 * 3 * 2.0**-24 / (1 - 3 * 2.0**-24)  # of the far distance: what rounding may have taken off


def textbook_span(o, d, low, high):
    r"""Return the distances at which the ray enters and leaves, by slabs.

    .. math:: t_\text{in} = \max_i \min(\tfrac{l_i - o_i}{d_i}, \tfrac{h_i - o_i}{d_i}), \quad
        t_\text{out} = \min_i \max(\dots)

    A ray along a side and within its plane has 0 / 0 there. Comparisons with NaN are false, and the ray is taken to
    pass by, or to hit, as the order of the comparison may have it.

    Args:
        o: point [N].
        d: vector [N].
        low, high: points [N].

    Returns:
        ``Float`` [N] twice; the ray's line meets the box where the first is not above the second.
    """
    near, far = (low - o) / d, (high - o) / d
    swapped = near > far
    near, far = dr.select(swapped, far, near), dr.select(swapped, near, far)
    begin = dr.select(near.x > near.y, near.x, near.y)
    begin = dr.select(begin > near.z, begin, near.z)
    end = dr.select(far.x < far.y, far.x, far.y)
    return begin, dr.select(end < far.z, end, far.z)


def span(o, d, low, high):
    """Return the same for closed boxes, with a far end that rounding can't bring before the near one [Ize2013].

    Where 0 / 0 arises the origin lies in the slab's face, which belongs to the box: the slab doesn't bound the ray. The
    arguments and the result are those of `textbook_span`.
    """
    inverse = 1 / d
    a, b = (low - o) * inverse, (high - o) * inverse
    near, far = dr.minimum(a, b), dr.maximum(a, b)
    within = dr.isnan(a) | dr.isnan(b)
    near, far = dr.select(within, -dr.inf, near), dr.select(within, dr.inf, far)
    return dr.max(near), dr.min(far) * WIDER
