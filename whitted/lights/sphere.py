"""Spheres as seen from a point: sampling by solid angle, its density, and irradiance.

From outside a sphere fills a round cone. If all of it is above the receiver's horizon, points are drawn exactly in
proportion to the cosine [UrenaGeorgiev2018]: the circle in which the cone meets the unit sphere is flat, and going
along the normal from a uniform point of its disk to the unit sphere gives a uniform projected solid angle. Cut by the
horizon, or with no normal given, the cone is sampled uniformly [ShirleyWangZimmerman1996] and warped by [Hart2020].
From inside, directions are drawn in proportion to the cosine. ``1 - cos`` is ``sin^2 / (1 + cos)`` throughout, so
small spheres lose no digits. Left out: the exact map of [UrenaGeorgiev2018] for spheres that the horizon cuts.
"""

import drjit as dr
import mitsuba as mi

from whitted.lights import guards, warp

MARGIN = 1e-5  # relative, of what counts as a sphere's own surface


def sample(centre, radius, p, n, u, inside=None):
    """Draw a point of a sphere that is visible from the receiver, nearly in proportion to the cosine there.

    Args:
        centre: ``Point3f`` [N or 1].
        radius: ``Float`` [N or 1], at least 0.
        p: ``Point3f`` [N], the receiver, outside or inside.
        n: ``Vector3f`` or ``Normal3f`` [N], its unit normal, or 0 to sample uniformly by solid angle.
        u: ``Point2f`` [N], uniform in [0, 1)^2.
        inside: ``Bool`` [N], where ``p`` is taken to be inside, whatever rounding says; by default it is where it is.

    Returns:
        The point ``q`` (``Point3f``), the unit direction ``d`` from ``p`` to it (``Vector3f``), their distance and the
        density at ``p`` by solid angle (``Float``); density 0 means that the light can't be sampled (no area). If the
        horizon of ``n`` cuts the sphere, directions below it may come up; nothing arrives from there.
    """
    view = _View(centre, radius, p, n, inside)
    weights = view.weights()
    t = dr.select(view.exact, u, warp.bilinear(u, weights))
    disk = mi.warp.square_to_uniform_disk_concentric(t)
    r2 = dr.squared_norm(disk)

    rise = view.sin2 * dr.maximum(1 - r2, 0)
    height = view.nz * view.cos + view.nx * view.sin * disk.x
    lift = rise / (height + dr.sqrt(height * height + rise))
    cosine = height + lift
    spread = dr.select(view.exact, view.sin, dr.sqrt(view.cap * (2 - view.cap * r2)))
    along = spread * disk.x + dr.select(view.exact, lift * view.nx, 0)
    across = view.x * along + view.y * (spread * disk.y)
    above = dr.select(view.exact, lift * view.nz, view.cap * dr.maximum(1 - r2, 0))
    z = view.cos + above
    d = across + view.z * z

    # the foot of the perpendicular from the centre, and half the chord, in units of the distance to the centre
    b = dr.select(view.inside, dr.dot(view.v, d), z)
    foot = dr.select(view.inside, b * d - view.v, z * across - dr.squared_norm(across) * view.z)
    half = dr.sqrt(dr.select(view.inside, b * b + view.power, above * (z + view.cos)))
    length = dr.select(view.inside & (b > 0), b + half, view.power / (dr.select(view.inside, -b, b) + half))
    offset = view.distance * (foot + d * dr.select(view.inside, half, -half))

    density = guards.usable(view.density(cosine, warp.bilinear_pdf(t, weights)))
    good = density > 0
    q = centre + dr.select(good, offset, 0)
    return q, dr.select(good, d, 0), dr.select(good, length * view.distance, 0), density


def pdf(centre, radius, p, n, q, inside=None):
    """Return the density (``Float`` [N], per steradian) with which ``sample`` draws the direction from ``p`` to ``q``.

    ``q`` is a ``Point3f`` [N] on the sphere that is visible from ``p``; the other arguments are those of ``sample``.
    """
    view = _View(centre, radius, p, n, inside)
    d = (q - p) / dr.norm(q - p)
    across = (q - centre) / dr.norm(q - p)
    x, y = dr.dot(across, view.x), dr.dot(across, view.y)
    g = dr.rsqrt(view.cap * (1 + dr.safe_sqrt(1 - x * x - y * y)))
    t = mi.warp.uniform_disk_to_square_concentric(mi.Point2f(x, y) * g)
    return guards.usable(view.density(dr.dot(d, n), warp.bilinear_pdf(t, view.weights())))


def irradiance(centre, radius, p, n, inside=None):
    r"""Return the irradiance (``Float`` [N]) at ``p`` from a sphere of radiance 1, which is pi inside.

    What lies below the horizon of the unit normal ``n`` is left out, and nothing is in between. The arguments are
    those of ``sample``; ``n`` isn't 0. With the sine ``s`` of the sphere's angular radius, ``z^2 = (s^2 - c^2) / (1 -
    s^2)`` and the cosine ``c`` between ``n`` and the centre it is

        E = pi s^2 c  for  c >= s,    s^2 (c atan2(z, -c) + z) - (z - atan z)  for  |c| < s,    else 0.
    """
    view = _View(centre, radius, p, n, inside)
    c, s2 = dr.dot(n, view.v), view.sin2
    s, cos = dr.sqrt(s2), dr.sqrt(view.power)
    rise = dr.safe_sqrt((s - c) * (s + c))
    z = rise / cos
    z2, excess = z * z, 0  # z - atan z by its series
    for k in range(15, 1, -2):
        excess = z2 * (1 / k - excess)
    small = z * (s2 - excess)
    large = dr.atan2(rise, cos) - rise * cos
    clipped = s2 * c * dr.atan2(rise, -c * cos) + dr.select(z < 0.3, small, large)
    E = dr.select(c >= s, dr.pi * s2 * c, dr.select(c > -s, clipped, 0))
    return dr.select(view.inside, dr.pi, E)


def is_inside(centre, radius, p, narrow=False):
    """Return where ``p`` (``Point3f`` [N]) is inside of a sphere or, up to rounding, on it (``Bool``).

    Where ``narrow`` (``Bool`` [N or 1]), what is on it up to rounding counts as outside.
    """
    margin = MARGIN * (radius + dr.norm(p)) * radius
    return dr.squared_norm(p - centre) - dr.square(radius) <= dr.select(narrow, -margin, margin)


class _View:
    """The cone that a sphere fills: its axis ``z`` and angular radius, with the normal in the plane of ``x`` and ``z``.

    The unit of length is the distance to the centre. From inside with a normal it is the normal's hemisphere, from
    inside without one it is the whole sphere of directions.
    """

    def __init__(self, centre, radius, p, n, inside=None):
        v = centre - p
        distance = dr.norm(v)
        oriented = dr.squared_norm(n) > 0
        self.inside = distance < radius if inside is None else inside
        self.distance = dr.select(distance > 0, distance, 1)
        self.v = v / self.distance
        power = (distance - radius) * (distance + radius)
        power = dr.maximum(dr.select(self.inside, -power, power), 0)
        self.power = power / dr.square(self.distance)
        self.sin2 = dr.minimum(dr.square(radius / self.distance), 1)
        self.sin = dr.sqrt(self.sin2)
        self.cos = dr.select(self.inside, dr.select(oriented, 0, -1), dr.sqrt(self.power))
        self.cap = dr.select(self.inside, 2, self.sin2 / (1 + self.cos))  # 1 - cos, at most

        forward = dr.select(distance > 0, self.v, mi.Vector3f(0, 0, 1))
        self.z = dr.select(self.inside & oriented, mi.Vector3f(n), forward)
        s, t = mi.coordinate_system(self.z)
        ns, nt, self.nz = dr.dot(n, s), dr.dot(n, t), dr.dot(n, self.z)
        self.nx = dr.sqrt(ns * ns + nt * nt)
        cos, sin = dr.select(self.nx > 0, ns / self.nx, 1), dr.select(self.nx > 0, nt / self.nx, 0)
        self.x, self.y = s * cos + t * sin, t * cos - s * sin
        self.exact = oriented & (self.inside | (self.nz * self.cos >= self.nx * self.sin)) & (self.nz > 0)

    def weights(self):
        """Return the weights of the warp: the cosine is linear along ``x``."""
        cap = warp.CORNER * warp.CORNER * self.cap
        z, x = self.nz * (1 - cap), self.nx * dr.sqrt(cap * (2 - cap))
        return warp.corner_weights([z - x, z + x, z - x, z + x])

    def density(self, cosine, warped):
        """Return the density of a direction with this cosine, or by the warp's density for it."""
        exact = cosine / (dr.pi * self.sin2 * self.nz)
        return dr.select(self.exact, exact, dr.select(self.inside, 1, warped) / (dr.two_pi * self.cap))
