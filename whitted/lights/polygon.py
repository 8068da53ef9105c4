"""Irradiance from a convex polygon of constant radiance, clipped to the receiver's horizon.

Source: Lambert's formula [Lambert1760]; [Arvo1995a] has a derivation. Left out: polygons that aren't convex, radiance
that varies.
"""

import functools
import operator

import drjit as dr
import mitsuba as mi

from whitted.transport import when

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
    view = _View(first, reach2, size2 < SMALL * SMALL * reach2, n)
    whole = view.sum(_edges(offsets))
    is_cut = ~functools.reduce(operator.and_, (above > 0 for above in heights))
    total = when(is_cut, lambda total: view.sum(_clipped(offsets, heights)), whole)
    return 0.5 * dr.abs(total)


def _edges(corners):
    """The edges of a polygon, pairs of corners."""
    return zip(corners, corners[1:] + corners[:1], strict=True)


def _clipped(corners, heights):
    """The edges of what is left of a polygon above the horizon, with that along the horizon."""
    leave, enter = mi.Vector3f(0), mi.Vector3f(0)  # where the polygon crosses the horizon
    edges = []
    for (a, b), (above, b_above) in zip(_edges(corners), _edges(heights), strict=True):
        a_up, b_up = above > 0, b_above > 0
        cut = a + (b - a) * dr.select(a_up == b_up, 0, above / (above - b_above))
        leave, enter = dr.select(a_up & ~b_up, cut, leave), dr.select(b_up & ~a_up, cut, enter)
        edges.append((dr.select(a_up, a, cut), dr.select(b_up, b, cut)))
    return [*edges, (leave, enter)]


class _View:
    """A polygon from the receiver; edges are given by offsets from the first corner at ``first``."""

    def __init__(self, first, reach2, small, n):
        self.first, self.reach2, self.small, self.n = first, reach2, small, n

    def sum(self, edges):
        """Return twice the irradiance from a polygon, or minus that; a form that no lane needs is left out."""
        edges = list(edges)
        total = when(self.small, lambda total: sum(self._less_mean(*edge) for edge in edges), mi.Float(0))
        return when(~self.small, lambda total: sum(self._angle(*edge) for edge in edges), total)

    def _edge(self, a, b):
        """The ends as seen from the receiver, their distances, and their cross product."""
        va, vb = self.first + a, self.first + b
        aa, bb = dr.squared_norm(va), dr.squared_norm(vb)
        cross = dr.cross(dr.select(aa < bb, va, vb), b - a)  # from the nearer end, which loses fewer digits
        return va, vb, dr.sqrt(aa), dr.sqrt(bb), cross

    def _angle(self, a, b):
        """The term of an edge as it is."""
        va, vb, _, _, cross = self._edge(a, b)
        sine = dr.norm(cross)
        return dr.dot(self.n, cross) * dr.select(sine > 0, dr.atan2(sine, dr.dot(va, vb)) / sine, 0)

    def _less_mean(self, a, b):
        """The term of an edge of a small polygon less ``g``, with the edge's share of the area."""
        va, vb, la, lb, cross = self._edge(a, b)
        product, reach = la * lb, dr.sqrt(self.reach2)
        # angle / sine - 1, by its series in the tangent of half the angle, and 1 / (la lb) - 1 / reach^2
        t2 = dr.squared_norm(cross) / dr.square(product + dr.dot(va, vb))
        excess = mi.Float(0)
        for k in range(7, 0, -1):
            excess = t2 * (2 / (4 * k * k - 1) - excess)
        da, db = dr.dot(a, self.first + va) / (la + reach), dr.dot(b, self.first + vb) / (lb + reach)
        difference = (excess - (da * lb + reach * db) / self.reach2) / product
        return dr.dot(self.n, dr.cross(a, b - a)) / self.reach2 + dr.dot(self.n, cross) * difference
