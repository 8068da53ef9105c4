"""What rays meet: the one place where an integrator touches the scene, and where rays are counted."""

import functools
import operator

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import lobes
from whitted.contents import bsdfs_of
from whitted.errors import UsageError
from whitted.lights.collection import Lights
from whitted.lights.primitives import mean_radiance, registry_number
from whitted.offsets import Offsets

NEAR = 1e-3  # of the way to a light: rays that end so early don't meet its own surface
ROUNDING = 5e-7  # likewise of the way to a point in space
KINDS = ("eye", "shadow", "reflection", "transmission", "interreflection")
# What an estimate is made of, as `World.watch` is told; and where its finding lies among the counts of rays
TERMS = ("eye ray", "emission", "light sample", "BSDF", "transmittance", "direct light", "throughput")
CAUSE = "cause"
SHAPE_BITS = 24  # below the number of the term


class World:
    """Mitsuba's own scene: its Embree or OptiX structure, its BSDFs and its emitters.

    ``rays`` counts the rays of each kind of ``KINDS`` per lane, if asked to; a symbolic loop carries it as part of its
    state.

    ``flags`` are those of all BSDFs together; ``branching`` is the largest number of delta lobes at one point.

    Args:
        scene: ``mi.Scene``.
        hide_emitters: eye rays pass through area emitters and don't see the environment.
        offset: where rays leave surfaces, one of ``whitted.offsets.RULES``.

    Raises:
        UsageError: the scene has something that this world can't render correctly.
    """

    def __init__(self, scene, hide_emitters=False, offset="bound"):
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
        self.is_lambertian = all(map(lobes.is_lambertian, bsdfs))
        black = [bsdf for bsdf in bsdfs if lobes.is_black(bsdf)]
        self._has_black = bool(black)
        self._has_diffuse = any(
            int(bsdf.flags()) & mi.BSDFFlags.Diffuse for bsdf in bsdfs if bsdf not in black
        )
        self._glow = _glow(scene, self.emitters)
        shapes = {shape.emitter().ptr: shape for shape in scene.shapes() if shape.emitter() is not None}
        self._light_shapes = [registry_number(shapes[e.ptr]) if e.ptr in shapes else 0 for e in self.emitters]
        self.is_crowded = _is_crowded(scene)
        self._convex = _which_are_convex(shapes.values())
        self.offsets = Offsets(scene, offset)
        self._lights = {}
        self.count_rays(False)

    def count_rays(self, wanted=True):
        """Count from zero from now on, or not at all, which makes kernels up to a tenth faster."""
        self.rays = {kind: mi.UInt32(0) for kind in KINDS} if wanted else {}

    def watch_values(self):
        """Take note from now on of the first term of each lane that isn't finite, see `watch`; count no rays."""
        self.rays = {CAUSE: mi.UInt32(0)}

    def watch(self, term, value, si, active):
        """Be told of a term of the estimate; nothing comes of it unless values are watched.

        The first one that isn't finite leaves 1 + its number in ``TERMS`` and the number of its shape in
        ``rays[CAUSE]``.

        Args:
            term: one of ``TERMS``.
            value: ``Float`` or ``Spectrum`` [N].
            si: ``SurfaceInteraction3f`` [N], or None where there is no surface.
            active: ``Bool`` [N].
        """
        if CAUSE not in self.rays:
            return
        shape = mi.UInt32(0) if si is None else dr.reinterpret_array(mi.UInt32, si.shape)
        number = mi.UInt32((TERMS.index(term) + 1) << SHAPE_BITS) + (shape & ((1 << SHAPE_BITS) - 1))
        finite = dr.isfinite(value)
        finite = finite if isinstance(value, mi.Float) else dr.all(finite)
        first = active & ~finite & (self.rays[CAUSE] == 0)
        self.rays[CAUSE] = dr.select(first, number, self.rays[CAUSE])

    def lights(self, as_points=False):
        """Return the `Lights` of the scene, ready to be sampled by distribution."""
        as_points = as_points and self.has_visible_emitters  # else they are points anyway
        if as_points not in self._lights:
            self._lights[as_points] = Lights(self.scene, as_points)
        return self._lights[as_points]

    def knows_unoccluded(self, lights):
        """Return whether light of ``lights`` that nothing keeps off is known in closed form, on some surface at all."""
        return lights.is_closed and self._has_diffuse

    def count(self, kind, active):
        """Add the active lanes to the count of a kind of ray."""
        if kind in self.rays:
            self.rays[kind] = self.rays[kind] + dr.select(active, mi.UInt32(1), mi.UInt32(0))

    def intersect(self, ray, is_eye, active):
        """Return the nearest ``SurfaceInteraction3f`` along ``ray``; the caller has counted it.

        ``is_eye`` (``Bool``): from these rays emitters are hidden where the world is told so, and neighbouring lanes
        have similar ones.
        """
        si = self.scene.ray_intersect(ray, mi.RayFlags.All, is_eye, active)
        if self.hide_emitters and self.has_area_emitters:
            si = self._behind_emitters(si, ray, active & is_eye)
        return si

    def _behind_emitters(self, si, ray, active):
        """Follow ``ray`` to the first surface that doesn't emit."""

        def on_emitter(si, active):
            return active & si.is_valid() & (si.shape.emitter() != None)  # noqa: E711 (a pointer array)

        def step(si, active):
            si = self.scene.ray_intersect(self.spawn(si, ray.d), mi.RayFlags.All, False, active)
            return si, on_emitter(si, active)

        start = on_emitter(si, active)
        behind, _ = dr.while_loop((si, start), lambda si, active: active, step, label="behind emitters")
        return dr.select(start, behind, si)

    def transmittance(self, si, target, shape, active, inside=False):
        """Return the ``Spectrum`` in [0, 1] that travels straight from ``si`` to the point ``target`` of a light.

        Null, mask and thin surfaces attenuate; all others block. The rays are counted as shadow rays, one for
        each call. Where nothing comes near a light's surface they end a little before it (a thousandth of the way, as
        Mitsuba's always do); else they go all the way, and the light's own surface doesn't block.

        Args:
            shape: ``UInt32`` [N], the number of the shape that the target lies on, see `light_shape`; 0 if on none.
            inside: the target lies inside of the shape, which doesn't block.
        """
        self.count("shadow", active)
        exact = self.is_crowded or inside
        if not self.is_transparent:
            blocked = self._blocked(si, target, shape, active, exact, inside)
            return dr.select(blocked, mi.Spectrum(0), mi.Spectrum(1))

        def step(at, passed, active):
            ray, reach = self._shadow_ray(at, target, shape, exact, inside)
            hit = self.scene.ray_intersect(ray, mi.RayFlags.All, False, active)
            met = active & hit.is_valid() & ~(exact & _arrived(hit, reach, shape))
            through = dr.dispatch(hit.bsdf(), lobes.null_transmission, hit, met)
            passed = dr.select(met, passed * through, passed)
            return hit, passed, met & ~dr.all(passed == 0)

        _, passed, _ = dr.while_loop(
            (si, mi.Spectrum(1), mi.Bool(active)), lambda *state: state[2], step, label="transmittance"
        )
        return dr.select(active, passed, 0)

    def _blocked(self, si, target, shape, active, exact, inside):
        """Whether something lies between ``si`` and ``target``."""
        ray, reach = self._shadow_ray(si, target, shape, exact, inside)
        if not exact:
            return self.scene.ray_test(ray, active)
        hit = self.scene.ray_intersect_preliminary(ray, active=active)
        return hit.is_valid() & ~_arrived(hit, reach, shape)

    def _shadow_ray(self, si, target, shape, exact, inside):
        """The ray to ``target``, and the distance from which on it is there if it meets the light's own surface."""
        ray = self.spawn(si, target - si.p)
        way, on_surface = target - ray.o, shape != 0
        distance = dr.norm(way)
        ray.d = way / distance
        ray.maxt = distance * (1 - ROUNDING)
        reach = mi.Float(0) if inside else distance * (1 - NEAR)
        # Of a convex light the first point met is right, whatever rounding makes of the distance
        if exact and self._convex is True:
            reach = mi.Float(0)
        elif exact and self._convex is not False:
            reach *= 1 - dr.gather(mi.Float, self._convex, shape, shape < dr.width(self._convex))
        if not exact:
            ray.maxt = dr.select(on_surface, reach, ray.maxt)
        return ray, reach

    def light_shape(self, emitter, active):
        """Return the number (``UInt32``) of the shape of an emitter, ``int`` or ``UInt32`` [N]; 0 if it has none."""
        if isinstance(emitter, int):
            return dr.opaque(mi.UInt32, self._light_shapes[emitter])
        return dr.gather(mi.UInt32, mi.UInt32(self._light_shapes), emitter, active)

    def spawn(self, si, direction):
        """Return a ``Ray3f`` that leaves the surface at ``si`` in a world-space ``direction``."""
        return mi.Ray3f(self.offsets.origin(si, direction), direction, si.time, si.wavelengths)

    def emission(self, si, active):
        """Return the ``Spectrum`` emitted towards the ray's origin by what it met, or by the environment."""
        if not self.has_visible_emitters:
            return mi.Spectrum(0)
        environment = self.scene.environment()
        if self.has_area_emitters and self._glow is None:
            return si.emitter(self.scene, active).eval(si, active)
        L = mi.Spectrum(0)
        if environment is not None:  # only rays that escape see it
            escaped = active & ~si.is_valid()
            L = dr.select(escaped, environment.eval(si, escaped), 0)
        if self.has_area_emitters:
            glow, size = self._glow
            shape = dr.reinterpret_array(mi.UInt32, si.shape)
            shines = active & si.is_valid() & (si.wi.z > 0) & (shape < size)
            L = dr.select(shines, dr.gather(mi.Spectrum, glow, shape, shines), L)
        return L

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

    def scatters(self, si):
        """Return where ``si`` may scatter light smoothly (``Bool``)."""
        smooth = mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Smooth)
        if not self._has_black:
            return smooth
        return smooth & dr.dispatch(si.bsdf(), lambda bsdf: mi.Bool(not lobes.is_black(bsdf)))

    def scatter(self, si, u, v, albedo, active):
        """Sample the smooth lobes at ``si``; the arguments and the result are those of `lobes.scatter`.

        ``albedo`` (``Spectrum``) is the diffuse reflectance, where ``is_lambertian``.
        """
        if self.is_lambertian:
            sample = dr.zeros(mi.BSDFSample3f)
            sample.wo = mi.warp.square_to_cosine_hemisphere(v)
            sample.pdf = mi.warp.square_to_cosine_hemisphere_pdf(sample.wo)
            sample.wo.z = dr.mulsign(sample.wo.z, si.wi.z)
            sample.eta, sample.sampled_type = mi.Float(1), mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
            return sample, dr.select(active, albedo, 0)
        if not self.mixes_lobes:
            return si.bsdf().sample(mi.BSDFContext(), si, u, v, active)
        return dr.dispatch(si.bsdf(), lobes.scatter, si, u, v, active)

    def response(self, si, active):
        """Return a function that says how much of the light from some directions ``si`` scatters.

        It maps a list of unit ``Vector3f`` [N] to the mask ``active`` and a list of ``Float`` [N], the BSDF times the
        cosine, mean over the colours.
        """

        def evaluate(bsdf, si, directions, active):
            return [dr.mean(bsdf.eval(mi.BSDFContext(), si, d, active)) for d in directions]

        def answer(directions):
            local = [si.to_local(d) for d in directions]
            return active, dr.dispatch(si.bsdf(), evaluate, si, local, active)

        return answer

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


def _glow(scene, emitters):
    """The radiance of all shapes by their registry numbers, and how many there are; None if it varies over one."""
    area = [e for e in emitters if _is_surface(e)]
    other = mi.EmitterFlags.SpatiallyVarying | mi.EmitterFlags.DeltaDirection
    shapes = {shape.emitter().ptr: shape for shape in scene.shapes() if shape.emitter() is not None}
    if mi.is_spectral or not area or any(int(e.flags()) & other or e.ptr not in shapes for e in area):
        return None
    numbers = {registry_number(shapes[e.ptr]): e for e in area}
    table = np.zeros((max(numbers) + 1, dr.size_v(mi.Spectrum)), np.float32)
    for number, emitter in numbers.items():
        try:
            table[number] = mean_radiance(emitter, shapes[emitter.ptr])
        except RuntimeError:  # positions can't be sampled on the shape
            return None
    return mi.Float(table.ravel().tolist()), dr.opaque(mi.UInt32, len(table))


def _arrived(hit, reach, shape):
    """Whether what a shadow ray has met is the light that it was sent to."""
    return (hit.t >= reach) & (dr.reinterpret_array(mi.UInt32, hit.shape) == shape)


def _which_are_convex(shapes):
    """Whether all shapes of lights are convex, or none is, ``bool``; else by registry number 1 for those, else 0."""
    found = {registry_number(shape): _is_convex(shape) for shape in shapes}
    if len(set(found.values())) < 2:
        return any(found.values())
    return mi.Float([float(found.get(number, False)) for number in range(max(found) + 1)])


def _is_convex(shape):
    """Whether a ray to a point on the side of a light that it is seen from meets nothing of the light before."""
    if shape.class_name() == "Sphere":  # with a texture, points on the other side are sampled as well
        return not int(shape.emitter().flags()) & mi.EmitterFlags.SpatiallyVarying
    return shape.class_name() in ("Rectangle", "Disk")


def _is_crowded(scene):
    """Whether anything comes so near to the surface of a light that a shadow ray that ends early could miss it."""
    bounds = [(np.array(s.bbox().min), np.array(s.bbox().max), s.emitter()) for s in scene.shapes()]
    margin = NEAR * float(dr.norm(scene.bbox().extents())) if bounds else 0.0
    lower, upper = (np.array([box[side] for box in bounds]).reshape(-1, 3) for side in (0, 1))
    for number, (low, high, emitter) in enumerate(bounds):
        if emitter is None:
            continue
        near = (lower <= high + margin).all(1) & (upper >= low - margin).all(1)
        near[number] = False
        if near.any():
            return True
    return False


def _is_delta(emitter):
    return bool(int(emitter.flags()) & (mi.EmitterFlags.DeltaPosition | mi.EmitterFlags.DeltaDirection))


def _is_surface(emitter):
    return bool(int(emitter.flags()) & mi.EmitterFlags.Surface)
