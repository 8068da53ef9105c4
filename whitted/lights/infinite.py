"""Lights infinitely far away: a uniform sky by the cosine, every other as Mitsuba samples it."""

import drjit as dr
import mitsuba as mi

from whitted.lights.primitives import is_delta
from whitted.lights.sample import LightSample


def infinite_lights(scene, as_points=False):
    """Return the infinite lights of an ``mi.Scene`` as a list; with ``as_points`` those of a single direction only."""
    box = scene.bbox()
    bounds = (box.center(), dr.norm(box.extents())) if box.valid() else (mi.ScalarPoint3f(0), 1.0)
    emitters = [e for e in scene.emitters() if int(e.flags()) & mi.EmitterFlags.Infinite]
    kinds = {"ConstantBackgroundEmitter": UniformSky}
    return [
        kinds.get(e.class_name(), InfiniteLight)(scene, e, bounds)
        for e in emitters
        if is_delta(e) or not as_points
    ]


class InfiniteLight:
    """An environment or a directional emitter; its interface is that of `BoundedLights`."""

    is_closed = as_points = False
    is_plain = False

    def __init__(self, scene, emitter, bounds):
        self.scene, self.emitter = scene, emitter
        self.centre, self.radius = bounds
        self.is_hittable = not is_delta(emitter)
        self.has_deltas = not self.is_hittable
        self.needs_choice, self.needs_point = False, self.is_hittable

    def sample(self, si, n, u, choice, active, shares=None):
        """Sample a direction; see `BoundedLights.sample`."""
        ds, weight = self.emitter.sample_direction(si, u, active)
        weight = dr.select(active & ~(ds.pdf <= 0), weight, 0)
        return LightSample(ds.d, ds.p, weight, dr.select(ds.delta, 0, ds.pdf), mi.UInt32(0))

    def pdf(self, si, p, n, active):
        """Return the density with which ``sample`` finds the direction in which ``si`` has met nothing."""
        receiver = dr.zeros(mi.Interaction3f)
        receiver.p, receiver.time, receiver.wavelengths = p, si.time, si.wavelengths
        ds = mi.DirectionSample3f(self.scene, si, receiver)
        return self.emitter.pdf_direction(receiver, ds, active)


class UniformSky(InfiniteLight):
    """A sky of one radiance, from which the cosine at the receiver decides alone."""

    is_plain = True

    def sample(self, si, n, u, choice, active, shares=None):
        """Sample the cosine on the receiver's side, or all directions where ``n`` is 0."""
        has_side = ~dr.all(n == 0)
        frame = mi.Frame3f(dr.select(has_side, n, mi.Vector3f(0, 0, 1)))
        local = dr.select(
            has_side, mi.warp.square_to_cosine_hemisphere(u), mi.warp.square_to_uniform_sphere(u)
        )
        d = frame.to_world(local)
        pdf = self._density(d, n)
        away = dr.zeros(mi.SurfaceInteraction3f)
        away.wi, away.wavelengths = -d, si.wavelengths
        weight = dr.select(pdf > 0, self.emitter.eval(away, active) * dr.rcp(pdf), 0)
        reach = 2 * self.radius + dr.norm(si.p - self.centre)
        return LightSample(d, dr.fma(d, reach, si.p), dr.select(active, weight, 0), pdf, mi.UInt32(0))

    def pdf(self, si, p, n, active):
        """Return the density with which ``sample`` finds the direction in which ``si`` has met nothing."""
        return self._density(-si.wi, n)

    def _density(self, d, n):
        return dr.select(dr.all(n == 0), dr.inv_four_pi, dr.maximum(dr.dot(d, n), 0) * dr.inv_pi)
