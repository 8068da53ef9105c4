"""Triangles as seen from a point: sampling by solid angle, its density, and irradiance.

Source: [Arvo1995] for cutting off a share of the spherical triangle at a point of the side ``bc`` and then going from
``a`` towards it, [Hart2020] for the warp by the cosines at the vertices, [VanOosteromStrackee1983] for the solid
angle. The tangent of half the solid angle is a ratio of two expressions linear in a unit vector that moves along
``bc``, so the point on the side comes from a linear equation, with no difference of angles: small triangles lose no
digits. Left out: a solid angle that keeps its digits for receivers so close to a side that rounding their positions
changes it; its relative error is up to 3e-7 times the side's length over the distance.
"""

import drjit as dr
import mitsuba as mi

from whitted.lights import guards, polygon, warp


def sample(a, b, c, p, n, u):
    """Draw a point of a triangle, nearly in proportion to the cosine at the receiver.

    Args:
        a, b, c: ``Point3f`` [N or 1], the vertices.
        p: ``Point3f`` [N], the receiver.
        n: ``Vector3f`` or ``Normal3f`` [N], its unit normal, or 0 to sample uniformly by solid angle.
        u: ``Point2f`` [N], uniform in [0, 1)^2.

    Returns:
        The point ``q`` (``Point3f``), the unit direction ``d`` from ``p`` to it (``Vector3f``), their distance and the
        density at ``p`` by solid angle (``Float``); density 0 means that the light can't be sampled (``p`` in its
        plane, no area). Directions below the horizon of ``n`` may come up; nothing arrives from there.
    """
    view = _View(a, b, c, p, n)
    t = warp.bilinear(u, view.weights)
    r, s = view.point(t)
    offset = r * (view.ab + s * view.bc)
    return guards.sampled(view.apex, offset, view.a + offset, view.density(t))


def pdf(a, b, c, p, n, q):
    """Return the density (``Float`` [N], per steradian) with which ``sample`` draws the direction from ``p`` to ``q``.

    ``q`` is a ``Point3f`` [N] on the triangle; the other arguments are those of ``sample``.
    """
    view = _View(a, b, c, p, n)
    return guards.usable(view.density(view.number(q - view.apex)))


def irradiance(a, b, c, p, n):
    """Return the irradiance (``Float`` [N]) at ``p`` from a triangle of radiance 1 that emits from both faces.

    What lies below the horizon of the unit normal ``n`` is left out, and nothing is in between. The arguments are
    those of ``sample``; ``n`` isn't 0.
    """
    return polygon.irradiance((a, b, c), p, n)


class _View:
    """The vertices seen from the receiver, turned such that ``a`` has the largest cosine.

    The density by solid angle is proportional to the warp's. It is bilinear in the share cut off along ``bc`` and in
    the square of the distance from ``a``, which fits a linear cosine best where it falls off from ``a``.
    """

    def __init__(self, a, b, c, p, n):
        corners = a, b, c
        seen = [corner - p for corner in corners]
        lengths = [dr.norm(v) for v in seen]
        ca, cb, cc = cosines = [dr.dot(n, v) / length for v, length in zip(seen, lengths, strict=True)]
        first_b, first_c = (cb > ca) & (cb >= cc), (cc > ca) & (cc > cb)

        def turned(x, y, z):
            return (
                dr.select(first_b, y, dr.select(first_c, z, x)),
                dr.select(first_b, z, dr.select(first_c, x, y)),
                dr.select(first_b, x, dr.select(first_c, y, z)),
            )

        self.apex, b, c = turned(*corners)
        self.ab, self.bc = b - self.apex, c - b
        self.a, self.b, c = turned(*seen)
        self.la, self.lb, lc = turned(*lengths)
        ca, cb, cc = turned(*cosines)
        self.weights = warp.corner_weights([ca, ca, cb, cc])
        self.ua, self.ub = self.a / self.la, self.b / self.lb
        self.normal = dr.cross(self.ab, self.bc)
        self.det = dr.abs(dr.dot(self.a, self.normal)) / (self.la * self.lb)
        self.sum = (
            _sum(self.ua, self.b, self.lb, self.ab) / self.lb
        )  # 1 + cosine of the angle between a and b
        self.half = self.half_angle(1, c, lc)

    def half_angle(self, s, c, lc):
        """Return half the solid angle of ``a``, ``b`` and the point ``c`` at ``b + s bc``, of length ``lc``."""
        return dr.atan2(s * self.det, self.sum * lc + dr.dot(self.ua, c) + dr.dot(self.ub, c))

    def point(self, t):
        """Return ``r`` and ``s`` such that the point ``a + r (ab + s bc)`` divides the solid angle by ``t``."""
        sin, cos = dr.sincos(t.x * self.half)
        across = self.bc - self.ub * dr.dot(self.ub, self.bc)
        height = dr.norm(dr.cross(self.ub, self.bc))
        s = _towards(
            self.ub, self.lb, self.bc, sin * self.sum * height, cos * self.det - sin * dr.dot(self.ua, across)
        )
        ae, e = self.ab + s * self.bc, self.b + s * self.bc
        le = dr.norm(e)
        # half of 1 - cos of the angle between a and e
        whole = 0.5 * dr.squared_norm(dr.cross(self.ua, ae)) / (le * _sum(self.ua, e, le, ae))
        part = dr.minimum(t.y * whole, 1)
        return _towards(self.ua, self.la, ae, dr.sqrt(part), dr.sqrt(1 - part)), s

    def number(self, aq):
        """Return the numbers that ``point`` takes to the point ``a + aq``."""
        scale = 1 / dr.squared_norm(self.normal)
        r = dr.clip(dr.dot(dr.cross(aq, self.bc), self.normal) * scale, 0, 1)
        rs = dr.dot(dr.cross(self.ab, aq), self.normal) * scale
        s = dr.clip(dr.select(r > 0, rs / r, 0), 0, 1)
        ae = self.ab + s * self.bc
        e, v = self.b + s * self.bc, self.a + r * ae
        le, lv = dr.norm(e), dr.norm(v)
        # the ratio of 1 - cos, less the factor that both have
        share = le * _sum(self.ua, e, le, ae) / (lv * _sum(self.ua, v, lv, r * ae))
        x = self.half_angle(s, e, le) / self.half
        return mi.Point2f(dr.clip(x, 0, 1), dr.clip(r * r * share, 0, 1))

    def density(self, t):
        """Return the density by solid angle at the numbers ``t``."""
        return 0.5 * warp.bilinear_pdf(t, self.weights) / self.half


def _sum(u, b, lb, ab):
    """``|b| + u . b`` for a unit vector ``u`` along ``b - ab``, without cancellation for opposite directions."""
    dot = dr.dot(u, b)
    return dr.select(dot > 0, lb + dot, dr.squared_norm(dr.cross(u, ab)) / (lb - dot))


def _towards(u, la, ab, sin, cos):
    """The share ``r`` in [0, 1] for which ``la u + r ab`` makes the angle ``2 atan(sin / cos)`` with the unit ``u``."""
    double = 2 * sin * cos
    r = double * la / (dr.norm(dr.cross(u, ab)) * (cos * cos - sin * sin) - double * dr.dot(u, ab))
    return dr.clip(r, 0, 1)
