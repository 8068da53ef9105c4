"""What rays meet: the one place where an integrator touches the scene, and where rays are counted."""

import functools
import operator

import drjit as dr
import mitsuba as mi

from whitted import lobes
from whitted.errors import UsageError
from whitted.lights.collection import Lights

KINDS = ("eye", "shadow", "reflection", "transmission", "interreflection")


class World:
    """Mitsuba's own scene: its Embree or OptiX structure, its BSDFs and its emitters.

    ``rays`` counts the rays of each kind of ``KINDS`` per lane; a symbolic loop carries it as part of its state.

    ``flags`` are those of all BSDFs together; ``branching`` is the largest number of delta lobes at one point.

    Args:
        scene: ``mi.Scene``.
        hide_emitters: eye rays pass through area emitters and don't see the environment.

    Raises:
        UsageError: the scene has something that this world can't render correctly.
    """

    def __init__(self, scene, hide_emitters=False):
        if mi.is_polarized:
            raise UsageError(
                f"variant {mi.variant()}: polarised light is not simulated; take a variant without it"
            )
        self.scene = scene
        self.emitters = scene.emitters()
        self.needs_sample = [not _is_delta(e) for e in self.emitters]
        self.hide_emitters = hide_emitters
        self.has_visible_emitters = any(self.needs_sample)
        self.has_area_emitters = any(_is_surface(e) for e in self.emitters)
        self.has_environment = scene.environment() is not None and not hide_emitters
        self.bsdfs = bsdfs = bsdfs_of(scene)
        for bsdf in bsdfs:
            lobes.check_supported(bsdf)
        self.flags = functools.reduce(operator.or_, (int(bsdf.flags()) for bsdf in bsdfs), 0)
        self.is_transparent = bool(self.flags & mi.BSDFFlags.Null)
        self.branching = max(map(lobes.count, bsdfs), default=0)
        self.mixes_lobes = any(
            lobes.count(bsdf) and int(bsdf.flags()) & mi.BSDFFlags.Smooth for bsdf in bsdfs
        )
        self._lights = {}
        self.forget_rays()

    def forget_rays(self):
        """Count from zero again."""
        self.rays = {kind: mi.UInt32(0) for kind in KINDS}

    def lights(self, as_points=False):
        """Return the `Lights` of the scene, ready to be sampled by distribution."""
        if as_points not in self._lights:
            self._lights[as_points] = Lights(self.scene, as_points)
        return self._lights[as_points]

    def count(self, kind, active):
        """Add the active lanes to the count of a kind of ray."""
        self.rays[kind] = self.rays[kind] + dr.select(active, mi.UInt32(1), mi.UInt32(0))

    def intersect(self, ray, is_eye, active, coherent=False):
        """Return the nearest ``SurfaceInteraction3f`` along ``ray``; the caller has counted it.

        ``is_eye`` (``Bool``): from these rays emitters are hidden where the world is told so. ``coherent`` (``bool``):
        neighbouring lanes have similar rays.
        """
        si = self.scene.ray_intersect(ray, mi.RayFlags.All, coherent, active)
        if self.hide_emitters and self.has_area_emitters:
            si = self._behind_emitters(si, ray, active & is_eye)
        return si

    def _behind_emitters(self, si, ray, active):
        """Follow ``ray`` to the first surface that doesn't emit."""

        def on_emitter(si, active):
            return active & si.is_valid() & (si.shape.emitter() != None)  # noqa: E711 (a pointer array)

        def step(si, active):
            si = self.scene.ray_intersect(si.spawn_ray(ray.d), mi.RayFlags.All, False, active)
            return si, on_emitter(si, active)

        start = on_emitter(si, active)
        behind, _ = dr.while_loop((si, start), lambda si, active: active, step, label="behind emitters")
        return dr.select(start, behind, si)

    def transmittance(self, si, target, active):
        """Return the ``Spectrum`` in [0, 1] that travels straight from ``si`` to the point ``target``.

        Null, mask and thin surfaces attenuate; all others block. The rays are counted as shadow rays, one for
        each call.
        """
        self.count("shadow", active)
        ray = si.spawn_ray_to(target)
        if not self.is_transparent:
            return dr.select(self.scene.ray_test(ray, active), mi.Spectrum(0), mi.Spectrum(1))

        def step(ray, passed, active):
            hit = self.scene.ray_intersect(ray, mi.RayFlags.All, False, active)
            met = active & hit.is_valid()
            through = dr.dispatch(hit.bsdf(), lobes.null_transmission, hit, met)
            passed = dr.select(met, passed * through, passed)
            return hit.spawn_ray_to(target), passed, met & ~dr.all(passed == 0)

        _, passed, _ = dr.while_loop(
            (ray, mi.Spectrum(1), mi.Bool(active)), lambda *state: state[2], step, label="transmittance"
        )
        return dr.select(active, passed, 0)

    def spawn(self, si, direction):
        """Return a ``Ray3f`` that leaves the surface at ``si`` in a world-space ``direction``."""
        return si.spawn_ray(direction)

    def emission(self, si, active):
        """Return the ``Spectrum`` emitted towards the ray's origin by what it met, or by the environment."""
        if not self.has_visible_emitters:
            return mi.Spectrum(0)
        environment = self.scene.environment()
        if environment is not None and not self.has_area_emitters:  # then only rays that escape see one
            escaped = active & ~si.is_valid()
            return dr.select(escaped, environment.eval(si, escaped), 0)
        return si.emitter(self.scene, active).eval(si, active)

    def sample_light(self, emitter, si, u, active):
        """Sample a direction from ``si`` to one emitter, without regard to what lies between.

        Args:
            emitter: the emitter's number, ``int`` or ``UInt32`` [N].
            u: ``Point2f`` [N] in [0, 1)^2; not used where ``needs_sample[emitter]`` is false.

        Returns:
            ``DirectionSample3f`` and the ``Spectrum`` of radiance divided by the density of the sample.
        """
        if isinstance(emitter, int):
            light = self.emitters[emitter]
        else:
            light = dr.gather(mi.EmitterPtr, self.scene.emitters_dr(), emitter, active)
        return light.sample_direction(si, u, active)

    def delta_lobes(self, si, active):
        """Return ``branching`` delta lobes at ``si``, each as ``lobes.delta_lobes`` gives them, the kind as ``UInt32``.

        Absent lobes have weight 0.
        """
        slots = self.branching
        absent = (mi.Vector3f(0, 0, 1), mi.Spectrum(0), mi.Float(1), 0)

        def split(bsdf, si, active):
            found = lobes.delta_lobes(bsdf, si, active)[:slots]  # instances of other scenes may have more
            found += [absent] * (slots - len(found))
            return [(wo, weight, eta, mi.UInt32(kind)) for wo, weight, eta, kind in found]

        return dr.dispatch(si.bsdf(), split, si, active) if slots else []

    def scatter(self, si, u, v, active):
        """Sample the smooth lobes at ``si``; the arguments and the result are those of `lobes.scatter`."""
        if not self.mixes_lobes:
            return si.bsdf().sample(mi.BSDFContext(), si, u, v, active)
        return dr.dispatch(si.bsdf(), lobes.scatter, si, u, v, active)

    def light_side(self, si):
        """Return the unit normal (``Vector3f``) of the side of ``si`` from which light is scattered back, or 0.

        It is 0 where the surface transmits as well, so that light may come from either side.
        """
        n = mi.Vector3f(si.sh_frame.n) * dr.mulsign(mi.Float(1), si.wi.z)
        transmits = mi.BSDFFlags.DiffuseTransmission | mi.BSDFFlags.GlossyTransmission
        if not self.flags & transmits:
            return n
        return dr.select((si.bsdf().flags() & +transmits) != 0, 0, n)

    def diffuse_reflectance(self, si, active):
        """Return the reflectance (``Spectrum``) of the diffuse lobes at ``si``."""
        return dr.dispatch(si.bsdf(), lobes.diffuse_reflectance, si, active)


def bsdfs_of(scene):
    """Return all outermost BSDFs of a scene, those of shape groups included."""
    found = {}

    def visit(node):
        for child in lobes.objects_of(node).values():
            if isinstance(child, mi.BSDF):
                found[child.ptr] = child
            elif isinstance(child, (mi.Shape, mi.Scene)):
                visit(child)

    visit(scene)
    return list(found.values())


def _is_delta(emitter):
    return bool(int(emitter.flags()) & (mi.EmitterFlags.DeltaPosition | mi.EmitterFlags.DeltaDirection))


def _is_surface(emitter):
    return bool(int(emitter.flags()) & mi.EmitterFlags.Surface)
