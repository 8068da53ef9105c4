"""A lamp alone in a scene, as `distribution` samples it and as Mitsuba does, and points of the unit square to try."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.lights.bounded import BoundedLights


class Lamp:
    """One light.

    Args:
        light: dict of an emitter, or of a shape, which is given the radiance 1.
    """

    def __init__(self, light):
        self.scene = mi.load_dict(
            {"type": "scene", "lamp": light if "intensity" in light else shining(light)}
        )
        self.emitter = self.scene.emitters()[0]
        self.lights = BoundedLights(self.scene)

    def sample(self, p, n, u):
        """Return a `LightSample` for receivers at ``p`` with the normal ``n`` (``float`` [3, N] or [3]), or 0."""
        si, n, active = receiver(p, u), vector(n, u), dr.full(mi.Bool, True, dr.width(u))
        shares = self.lights.shares(si.p, n)
        return self.lights.sample(si, n, u, dr.full(mi.Float, 0.5, dr.width(u)), active, shares)

    def estimates(self, p, n, u):
        """Return estimates of the irradiance, ``float64`` [N]."""
        sample = self.sample(p, n, u)
        return _received(sample.d, sample.weight, n)

    def estimates_of_mitsuba(self, p, n, u):
        """Return the same by Mitsuba's emitter."""
        ds, weight = self.emitter.sample_direction(receiver(p, u), u, True)
        return _received(ds.d, weight, n)

    def estimates_by_area(self, p, n, u):
        r"""Return the same by points that are uniform over the area: :math:`\cos \cos' A / r^2`, each emitting side."""
        at = self.scene.shapes()[0].sample_position(0.0, u)
        v = at.p - mi.Point3f(vector(p))
        d = dr.normalize(v)
        cosines = dr.maximum(-dr.dot(d, at.n), 0) / (dr.squared_norm(v) * at.pdf)
        return _received(d, mi.Spectrum(cosines), n)

    def irradiance(self, p, n):
        """Return the irradiance in closed form, ``float64`` [N]."""
        p, n = np.broadcast_arrays(np.reshape(p, (3, -1)), np.reshape(n, (3, -1)))
        active = dr.full(mi.Bool, True, p.shape[1])
        return np.array(self.lights.irradiance(receiver(p), vector(n), active), np.float64)[0]


def shining(shape, radiance=1.0):
    """The dict of a shape with an emitter."""
    return shape | {"emitter": {"type": "area", "radiance": radiance}}


def receiver(p, like=None):
    """A ``SurfaceInteraction3f`` at ``p`` (``float`` [3, N] or [3])."""
    p = mi.Point3f(vector(p, like))
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(p))
    si.p, si.t = p, 1.0
    return si


def vector(x, like=None):
    """A Dr.Jit vector in single precision from [3, N] or [3], as wide as ``like`` if that is given."""
    x = np.float32(x).reshape(3, -1)
    width = x.shape[1] if like is None else dr.width(like)
    return mi.Vector3f(np.broadcast_to(x, (3, width)))


def lattice(k):
    """The middles of k x k cells of the unit square (``Point2f``)."""
    middle = (np.arange(k) + 0.5) / k
    x, y = np.meshgrid(middle, middle)
    return mi.Point2f(np.float32(x.ravel()), np.float32(y.ravel()))


def gauss(k):
    """k x k points of the unit square by Gauss's rule (``Point2f``), and their weights (``float64``), of sum 1."""
    x, weight = np.polynomial.legendre.leggauss(k)
    x, y = np.meshgrid((1 + x) / 2, (1 + x) / 2)
    weight = np.outer(weight, weight).ravel() / 4
    return mi.Point2f(np.float32(x.ravel()), np.float32(y.ravel())), weight


def spread(estimates, mean):
    """Return the standard deviation of estimates relative to their true mean; infinite where one is no number."""
    return float(np.sqrt(np.mean((estimates / mean - 1) ** 2)))


def lambert(corners, n):
    """The irradiance at the origin from what of convex polygons of radiance 1 is above the horizon, ``longdouble`` [N].

    Args:
        corners: list of [3, N].
        n: [3, N], unit.

    Returns:
        The irradiance, and the sum of the angles under which the edges are seen.
    """
    n = np.longdouble(n)
    corners = [np.longdouble(corner) for corner in corners]
    heights = [(n * corner).sum(0) for corner in corners]
    total, angles, leave, enter = 0, 0, np.zeros_like(n), np.zeros_like(n)
    for a, b, above, b_above in zip(
        corners, [*corners[1:], corners[0]], heights, [*heights[1:], heights[0]], strict=True
    ):
        cuts = (above > 0) != (b_above > 0)
        cut = a + (b - a) * np.where(cuts, above / np.where(cuts, above - b_above, 1), 0)
        leave, enter = np.where(cuts & (above > 0), cut, leave), np.where(cuts & (b_above > 0), cut, enter)
        angle, term = _edge(np.where(above > 0, a, cut), np.where(b_above > 0, b, cut), n)
        total, angles = total + term, angles + angle
    angle, term = _edge(leave, enter, n)
    return np.abs(total + term) / 2, angles + angle


def _edge(a, b, n):
    """The angle under which an edge is seen, and its term of Lambert's formula."""
    cross = np.cross(a, b - a, axis=0)
    sine = np.sqrt((cross * cross).sum(0))
    angle = np.arctan2(sine, (a * b).sum(0))
    return angle, (n * cross).sum(0) * angle / np.where(sine > 0, sine, 1)


def _received(d, weight, n):
    received = dr.maximum(dr.dot(d, vector(n)), 0) * weight
    return np.array(received, np.float64)[0]
