"""Irradiance from a convex polygon of constant radiance, clipped to the receiver's horizon.

Source: Lambert's formula [Lambert1760]; [Arvo1995a] has a derivation. Left out: polygons that aren't convex, radiance
that varies.
"""

import drjit as dr
import mitsuba as mi

SMALL = 0.4  # size over distance; below it the terms of Lambert's formula are summed less what cancels


def irradiance(vertices, p, n):
    r"""Return the irradiance (``Float`` [N]) at ``p`` from a plane convex polygon of radiance 1.

    Both faces emit, what lies below the horizon of ``n`` is left out, and nothing is in between:

        E = 1/2 |sum_i g_i n . (v_i x v_{i+1})|,    g_i = angle(v_i, v_{i+1}) / |v_i x v_{i+1}|

    with the vertices ``v_i``, as seen from ``p``, of the polygon that is left. Where it is small all ``g_i`` are nearly
    ``g = 1 / |v_0|^2``: there ``(g_i - g) n . (v_i x v_{i+1})`` is summed, and ``g`` times the area added.

    Measured on regular polygons above the horizon, the relative error times both cosines is at most 8e-7 for radii
    up to 0.19 of the distance and from 1 on, 4e-6 in between.

    Args:
        vertices: sequence of ``Point3f`` [N or 1], 3 or more, in order around the polygon.
        p: ``Point3f`` [N], the receiver.
        n: ``Vector3f`` or ``Normal3f`` [N], its unit normal.
    """
    first = vertices[0] - p
    reach2 = dr.squared_norm(first)
    offsets = [mi.Vector3f(0), *(vertex - vertices[0] for vertex in vertices[1:])]
    heights = [dr.dot(n, first) + dr.dot(n, offset) for offset in offsets]
    size2 = dr.squared_norm(offsets[1])
    for offset in offsets[2:]:
        size2 = dr.maximum(size2, dr.squared_norm(offset))
    small = size2 < SMALL * SMALL * reach2

    total = mi.Float(0)
    leave, enter = mi.Vector3f(0), mi.Vector3f(0)  # where the polygon crosses the horizon
    for i, (a, above) in enumerate(zip(offsets, heights, strict=True)):
        b, b_above = offsets[(i + 1) % len(offsets)], heights[(i + 1) % len(offsets)]
        a_up, b_up = above > 0, b_above > 0
        cut = a + (b - a) * dr.select(a_up == b_up, 0, above / (above - b_above))
        leave, enter = dr.select(a_up & ~b_up, cut, leave), dr.select(b_up & ~a_up, cut, enter)
        total += _edge(first, reach2, dr.select(a_up, a, cut), dr.select(b_up, b, cut), n, small)
    return 0.5 * dr.abs(total + _edge(first, reach2, leave, enter, n, small))


def _edge(first, reach2, a, b, n, small):
    """The term of the edge from ``first + a`` to ``first + b``; for small polygons with its share of the area's."""
    va, vb, ab = first + a, first + b, b - a
    aa, bb = dr.squared_norm(va), dr.squared_norm(vb)
    la, lb, reach = dr.sqrt(aa), dr.sqrt(bb), dr.sqrt(reach2)
    product, cosine = la * lb, dr.dot(va, vb)
    cross = dr.cross(dr.select(aa < bb, va, vb), ab)  # from the nearer end, which loses fewer digits
    sine = dr.norm(cross)

    large = dr.select(sine > 0, dr.atan2(sine, cosine) / sine, 0)
    # angle / sine - 1, by its series in the tangent of half the angle, and 1 / (la lb) - 1 / reach^2
    t2 = dr.square(sine / (product + cosine))
    excess = mi.Float(0)
    for k in range(7, 0, -1):
        excess = t2 * (2 / (4 * k * k - 1) - excess)
    da, db = dr.dot(a, first + va) / (la + reach), dr.dot(b, first + vb) / (lb + reach)
    difference = (excess - (da * lb + reach * db) / reach2) / product
    area = dr.select(small, dr.dot(n, dr.cross(a, ab)) / reach2, 0)
    return area + dr.dot(n, cross) * dr.select(small, difference, large)
