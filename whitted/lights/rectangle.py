"""Rectangles as seen from a point: sampling by solid angle, its density, and irradiance.

Source: [UrenaFajardoKing2013] for cutting the rectangle into strips such that solid angle is preserved, [Hart2020]
for the warp by the cosines in the corners. It is put differently here: all is told by half the solid angle ``tau(x)``
of the part of an endless strip that lies beyond ``x``. This part is a triangle with its third vertex in the pole in
which all lines along ``ex`` meet, so that by [VanOosteromStrackee1983]

    tan tau(x) = z h / D(x),    D(x) = (r0 + x) (r1 + x) + z^2 + y0 y1,    r_j^2 = x^2 + y_j^2 + z^2,    h = y1 - y0

for a receiver at height ``z`` over the origin of the plane. Its inverse needs square roots only. Both keep their
digits when the receiver is close to the rectangle or to its plane. Left out: parallelograms that aren't rectangles.
"""

import drjit as dr
import mitsuba as mi

from whitted.lights import guards, polygon, warp

FAR = 1e3  # in units of ``size``; farther off solid angle is uniform over the area to 0.4 %, and that is sampled
EXPONENT = 0x7F800000  # the bits of a float's exponent


def sample(o, ex, ey, p, n, u):
    """Draw a point of a rectangle, nearly in proportion to the cosine at the receiver.

    Args:
        o: ``Point3f`` [N or 1], a corner.
        ex, ey: ``Vector3f`` [N or 1], the edges from it, which have to be orthogonal: halve other parallelograms
            into triangles.
        p: ``Point3f`` [N], the receiver.
        n: ``Vector3f`` or ``Normal3f`` [N], its unit normal, or 0 to sample uniformly by solid angle.
        u: ``Point2f`` [N], uniform in [0, 1)^2.

    Returns:
        The point ``q`` (``Point3f``), the unit direction ``d`` from ``p`` to it (``Vector3f``), their distance and the
        density at ``p`` by solid angle (``Float``); density 0 means that the light can't be sampled (``p`` in its
        plane, no area). Directions below the horizon of ``n`` may come up; nothing arrives from there.
    """
    view = _View(o, ex, ey, p)
    weights = view.weights(n)
    t = warp.bilinear(u, weights)
    x, y = view.point(t)
    offset = view.size * ((x - view.cx) * view.ax + (y - view.cy) * view.ay)
    density = view.density(x, y) * warp.bilinear_pdf(t, weights)
    return guards.sampled(view.centre, offset, view.v + offset, density)


def pdf(o, ex, ey, p, n, q):
    """Return the density (``Float`` [N], per steradian) with which ``sample`` draws the direction from ``p`` to ``q``.

    ``q`` is a ``Point3f`` [N] on the rectangle; the other arguments are those of ``sample``.
    """
    view = _View(o, ex, ey, p)
    offset = (q - view.centre) / view.size
    x = dr.clip(dr.dot(offset, view.ax), -0.5 * view.w, 0.5 * view.w)
    y = dr.clip(dr.dot(offset, view.ay), -0.5 * view.h, 0.5 * view.h)
    t = view.number(x, y)
    return guards.usable(view.density(view.cx + x, view.cy + y) * warp.bilinear_pdf(t, view.weights(n)))


def irradiance(o, ex, ey, p, n):
    """Return the irradiance (``Float`` [N]) at ``p`` from a rectangle of radiance 1 that emits from both faces.

    What lies below the horizon of the unit normal ``n`` is left out, and nothing is in between. The arguments are
    those of ``sample``, but ``ex`` and ``ey`` needn't be orthogonal; ``n`` isn't 0.
    """
    return polygon.irradiance((o, o + ex, o + ex + ey, o + ey), p, n)


class _View:
    """The rectangle [x0, x1] x [y0, y1], with edges of lengths ``w`` and ``h``, from a height ``z`` over the origin.

    Lengths are in units of ``size``, the power of two next below the edges' sum: nothing is rounded on the way. The
    axes are turned such that the centre's coordinates ``cx``, ``cy`` and ``z`` aren't negative.
    """

    def __init__(self, o, ex, ey, p):
        width, height = dr.norm(ex), dr.norm(ey)
        exponent = dr.reinterpret_array(mi.UInt32, width + height) & EXPONENT
        self.size = dr.reinterpret_array(mi.Float, exponent)
        self.w, self.h = width / self.size, height / self.size
        self.centre = o + 0.5 * (ex + ey)
        self.v = self.centre - p
        ax, ay = ex / width, ey / height
        az = dr.cross(ax, ay)
        cx, cy, z = (dr.dot(self.v, axis) / self.size for axis in (ax, ay, az))
        self.ax, self.ay, self.az = dr.mulsign(ax, cx), dr.mulsign(ay, cy), dr.mulsign(az, z)
        self.cx, self.cy, self.z = dr.abs(cx), dr.abs(cy), dr.abs(z)
        self.far = dr.square(cx) + dr.square(cy) + dr.square(z) > FAR * FAR

        self.x0, self.x1 = self.cx - 0.5 * self.w, self.cx + 0.5 * self.w
        self.y0, self.y1 = self.cy - 0.5 * self.h, self.cy + 0.5 * self.h
        self.N = self.z * self.h
        self.r00, self.r01, self.D0 = self.strip(self.x0)
        self.r10, self.r11, self.D1 = self.strip(self.x1)
        self.half = self.tau(self.w, self.x0, self.r00, self.r01, self.D0)

    def strip(self, x):
        """Return the distances ``r0``, ``r1`` of the ends of the strip's cut at ``x``, and ``D(x)``.

        Of two ways to write it, each with no difference of large numbers where the other has one.
        """
        z2, y0y1 = self.z * self.z, self.y0 * self.y1
        y2, rho2 = self.y0 * self.y0 + self.y1 * self.y1, x * x + z2
        r0, r1 = dr.sqrt(rho2 + self.y0 * self.y0), dr.sqrt(rho2 + self.y1 * self.y1)
        r0r1 = r0 * r1
        sum_ = dr.select(y0y1 > 0, r0r1 + y0y1, rho2 * (rho2 + y2) / (r0r1 - y0y1))
        ahead = sum_ + x * (r0 + r1) + rho2
        behind = (y0y1 * y0y1 + z2 * (y2 + z2)) / ((r0 - x) * (r1 - x)) + z2 + y0y1
        return r0, r1, dr.select((x < 0) & (x * x > dr.abs(y0y1)), behind, ahead)

    def tau(self, dx, x, r0, r1, D):
        """Return half the solid angle between ``x`` and ``x1 = x + dx``, without a difference of angles."""
        twice = x + self.x1
        step = (self.r11 + self.x1) * (1 + twice / (self.r10 + r0)) + (r0 + x) * (1 + twice / (self.r11 + r1))
        return dr.atan2(self.N * dx * step, D * self.D1 + self.N * self.N)

    def heights(self, x):
        """Return ``rho^2 = x^2 + z^2`` and ``1 - y / r``, which is uniform by solid angle, at both ends of the cut."""
        rho2 = x * x + self.z * self.z
        return rho2, _one_minus_sine(self.y0, rho2), _one_minus_sine(self.y1, rho2)

    def point(self, t):
        """Return the coordinates of the point that divides the solid angle by the numbers ``t``."""
        z, k = self.z, self.z * self.z + self.y0 * self.y1
        s, c = dr.sincos((1 - t.x) * self.half)
        # in proportion to sine and cosine of tau(x)
        s, c = s * self.D1 + c * self.N, c * self.D1 - s * self.N
        x = 0.5 * z * (self.N * (c * c - s * s) - 2 * k * s * c)
        x /= dr.sqrt(s * (self.N * c - k * s)) * dr.sqrt((z * c + self.y1 * s) * (z * c - self.y0 * s))
        x = dr.clip(x, self.x0, self.x1)
        rho2, k0, k1 = self.heights(x)
        k = dr.lerp(k0, k1, t.y)
        y = dr.clip((1 - k) * dr.sqrt(rho2 / (k * (2 - k))), self.y0, self.y1)
        x = dr.select(self.far, self.cx + (t.x - 0.5) * self.w, x)
        y = dr.select(self.far, self.cy + (t.y - 0.5) * self.h, y)
        return x, y

    def number(self, x, y):
        """Return the numbers that ``point`` takes to the coordinates ``x`` and ``y``, given from the centre."""
        at_x, at_y = self.cx + x, self.cy + y
        tau = self.tau(0.5 * self.w - x, at_x, *self.strip(at_x))
        rho2, k0, k1 = self.heights(at_x)
        k = _one_minus_sine(at_y, rho2)
        tx = dr.select(self.far, x / self.w + 0.5, 1 - tau / self.half)
        ty = dr.select(self.far, y / self.h + 0.5, (k - k0) / (k1 - k0))
        return mi.Point2f(dr.clip(tx, 0, 1), dr.clip(ty, 0, 1))

    def density(self, x, y):
        """Return the density by solid angle before the warp."""
        r2 = x * x + y * y + self.z * self.z
        return dr.select(self.far, r2 * dr.sqrt(r2) / (self.w * self.h * self.z), 0.5 / self.half)

    def weights(self, n):
        """Return the weights of the warp."""
        nx, ny, nz = dr.dot(n, self.ax), dr.dot(n, self.ay), dr.dot(n, self.az) * self.z
        corners = (
            (self.x0, self.y0, self.r00),
            (self.x1, self.y0, self.r10),
            (self.x0, self.y1, self.r01),
            (self.x1, self.y1, self.r11),
        )
        return warp.corner_weights([(nx * x + ny * y + nz) / r for x, y, r in corners])


def _one_minus_sine(y, rho2):
    """``1 - y / r`` with ``r^2 = rho2 + y^2``, without the difference where ``y`` is positive."""
    r = dr.sqrt(rho2 + y * y)
    return dr.select(y > 0, rho2 / (r * (r + y)), 1 - y / r)
