r"""Where a ray meets a sphere.

.. math:: |o + t d - c|^2 = r^2
"""

import drjit as dr

from whitted.geometry.arithmetic import plain_dot, sum_of_products


def textbook_roots(o, d, centre, radius):
    r"""Return the two distances, as lectures write them.

    .. math:: t = \frac{-B \mp \sqrt{B^2 - 4 A C}}{2 A}, \quad
        A = d \cdot d,\; B = 2\, d \cdot (o - c),\; C = |o - c|^2 - r^2

    The discriminant cancels where the sphere is small or far off: at a distance of 1000 radii the hit is off by a
    twentieth of one, and 5 % of the rays that pass by hit.

    Args:
        o, centre: points [N].
        d: vector [N], of any length.
        radius: ``Float`` [N].

    Returns:
        ``Float`` [N], the smaller first; NaN where the ray's line misses.
    """
    m = o - centre
    A = plain_dot(d, d)
    B = 2 * plain_dot(d, m)
    C = plain_dot(m, m) - radius * radius
    root = dr.sqrt(B * B - 4 * A * C)
    return (-B - root) / (2 * A), (-B + root) / (2 * A)


def roots(o, d, centre, radius):
    r"""Return the two distances to a few roundings of the distance to the sphere's centre.

    .. math:: D = r^2 - |m - \tfrac{m \cdot d}{d \cdot d} d|^2, \quad q = -m \cdot d \mp \sqrt{d \cdot d\, D}, \quad
        t_0 = C / q, \quad t_1 = q / (d \cdot d)

    The discriminant is taken from the ray's distance to the centre [HainesEtAl2019], and C in twice the precision, so
    that neither small and far spheres nor the near surface of a huge one cost digits. The arguments and the result are
    those of `textbook_roots`.
    """
    m = o - centre
    a, b = dr.dot(d, d), -dr.dot(m, d)
    D = radius * radius - dr.squared_norm(dr.fma(d, b / a, m))
    q = b + dr.mulsign(dr.sqrt(a * D), b)
    C = sum_of_products((m.x, m.x), (m.y, m.y), (m.z, m.z), (-radius, radius))
    near, far = C / q, q / a
    return dr.minimum(near, far), dr.maximum(near, far)


def on_surface(p, centre, radius):
    """Return the point [N] of the sphere that is nearest to ``p``: a hit whose distance was rounded, put right."""
    return centre + dr.normalize(p - centre) * radius
