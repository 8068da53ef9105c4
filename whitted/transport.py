"""Direct light at a vertex, and the stack of a ray tree that is walked depth first."""

import functools
from typing import ClassVar

import drjit as dr
import mitsuba as mi

UNROLLED_LIGHTS = 4  # up to here a light costs less unrolled into the kernel than by a virtual call in a loop


def when(active, step, *state):
    """Return ``step(*state)`` for the active lanes and ``state`` for the others; skip it where no lane needs it."""
    return dr.if_stmt(state, active, step, lambda *state: state if len(state) > 1 else state[0])


def light_sample(world, si, draws, node, emitter, active, shadows=True, context=None):
    """Sample one emitter from ``si`` and look whether its light arrives.

    The arguments are those of ``direct_light``, and ``emitter`` its number, ``int`` or ``UInt32`` [N].

    Returns:
        ``DirectionSample3f``; the radiance (``Spectrum``) scattered along ``-ray.d`` if nothing is in between, 0 in
        inactive lanes; the transmittance (``Spectrum``) of what is in between.
    """
    drawn = not isinstance(emitter, int) or world.needs_sample[emitter]
    u = draws("light", node, emitter) if drawn else mi.Point2f(0)
    ds, weight = world.sample_light(emitter, si, u, active)
    scattered = si.bsdf().eval(context or mi.BSDFContext(), si, si.to_local(ds.d), active)
    value = scattered * weight
    sampled = active & (ds.pdf != 0)
    lit = sampled & ~dr.all(value == 0)  # NaN, for which no comparison holds, is lit and counted
    visible = (
        world.transmittance(si, ds.p, world.light_shape(emitter, active), lit) if shadows else mi.Spectrum(1)
    )
    world.watch("light sample", weight, si, sampled)
    world.watch("BSDF", scattered, si, sampled)
    world.watch("transmittance", visible, si, lit)
    return ds, dr.select(lit, value, 0), visible


def direct_light(world, si, draws, node, active, shadows=True, context=None):
    """Estimate the light that every emitter sends to ``si`` directly and that is scattered along ``-ray.d``.

    Each emitter is sampled once: the sum over emitters of ``f(wi, wo) cos / p * L * V``. Delta lobes don't take
    part. No shadow ray is traced where the BSDF is 0, so lights behind the surface cost none.

    Args:
        world: ``World``.
        si: ``SurfaceInteraction3f`` [N].
        draws: numbers, asked for effect ``light`` once for each emitter that isn't a delta.
        node: ``UInt32`` [N], the vertex's node of the ray tree.
        active: ``Bool`` [N].
        shadows: whether light is blocked at all.
        context: ``mi.BSDFContext`` in which the BSDF is asked, by default a plain one.

    Returns:
        ``Spectrum`` [N], radiance.
    """
    active = active & mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Smooth)
    emitters = len(world.emitters)

    def add_emitter(emitter, L):
        _, unshadowed, visible = light_sample(world, si, draws, node, emitter, active, shadows, context)
        return L + unshadowed * visible

    def unrolled(L, rays, sampler):
        world.rays = dict(rays)
        for emitter in range(emitters):
            L = add_emitter(emitter, L)
        return L, world.rays, sampler

    def looped(emitter, L, rays, sampler):
        world.rays = dict(rays)
        L = add_emitter(emitter, L)
        return emitter + 1, L, world.rays, sampler

    if emitters <= UNROLLED_LIGHTS:
        L, world.rays, _ = when(active, unrolled, mi.Spectrum(0), world.rays, draws.state)
    else:
        state = (mi.UInt32(0), mi.Spectrum(0), world.rays, draws.state)
        _, L, world.rays, _ = dr.while_loop(
            state, lambda emitter, *_: active & (emitter < emitters), looped, label="emitters"
        )
    return L


@functools.cache
def node_type(variant, with_density=False, shares_type=None, splits=False):
    """Return the class of a ray waiting to be traced, for a variant that is active.

    ``with_density`` adds where its direction was sampled, and with which density; and what lights were chosen by there,
    if that has a type. ``SAMPLED`` are the names of these. ``splits`` adds which part of its sample a ray belongs to.
    """
    sampled = {
        "p": mi.Point3f,  # the vertex at which the direction was sampled
        "n": mi.Vector3f,  # that vertex's side for lights
        "pdf": mi.Float,  # of the direction, per solid angle
        **({"shares": shares_type} if shares_type else {}),
    }
    sampled = sampled if with_density else {}

    class Node:
        SAMPLED: ClassVar = tuple(sampled)
        DRJIT_STRUCT: ClassVar = {
            "o": mi.Point3f,  # origin
            "d": mi.Vector3f,  # direction
            "w": mi.Spectrum,  # throughput from the eye to this ray
            "eta": mi.Float,  # product of relative indices of refraction along the path
            "depth": mi.UInt32,  # surfaces met before this ray
            "tag": mi.UInt32,  # flags of the integrator's own
            "id": mi.UInt32,  # number of the node in the tree, the same in every order of traversal
            **sampled,
            **({"part": mi.UInt32} if splits else {}),  # the number among the parts of all samples
        }

        def __init__(self, *values, **named):
            for name, value in zip(self.DRJIT_STRUCT, values, strict=False):
                setattr(self, name, value)
            for name in list(self.DRJIT_STRUCT)[len(values) :]:
                setattr(self, name, named.get(name))

    return Node


def send(world, si, child, wo, reflects, active):
    """Let the ray ``child`` leave ``si`` into a specular lobe's local direction, and count it in the active lanes."""
    ray = world.spawn(si, si.to_world(wo))
    child.o, child.d = ray.o, ray.d
    world.count("reflection", active & reflects)
    world.count("transmission", active & ~reflects)


class Stack:
    """A per-lane stack in local memory, with two precautions against Dr.Jit 1.5.

    The pointer has full width: one that enters a loop with width 1 would be taken for uniform over the lanes, and the
    wrong entries read. And the size stands in the program as a number: the key under which Dr.Jit finds a compiled
    kernel again leaves out how much local memory it has, so that without it a kernel with a smaller stack could be
    taken, which would write beyond its end.

    A symbolic loop or condition carries ``state``; ``with_state`` makes the stack anew from it.
    """

    def __init__(self, size, entries, pointer):
        self.size, self.entries, self.pointer = size, entries, pointer

    @classmethod
    def empty(cls, dtype, size, width):
        """Return an empty stack of ``size`` entries for ``width`` lanes."""
        return cls(size, dr.alloc_local(dtype, size), dr.zeros(mi.UInt32, width))

    @property
    def state(self):
        """The arrays to hand on."""
        return self.entries, self.pointer

    def with_state(self, entries, pointer):
        """Return a stack of this size with other arrays."""
        return Stack(self.size, entries, pointer)

    def update(self, entries, pointer):
        """Take other arrays."""
        self.entries, self.pointer = entries, pointer

    def push(self, node, active):
        """Put ``node`` on top in the active lanes."""
        active = active & (self.pointer < self.size)
        self.entries.write(node, self.pointer, active)
        self.pointer = dr.select(active, self.pointer + 1, self.pointer)

    def push_all_but_first(self, child, active, next_node, has_next):
        """Make ``child`` the next node in the active lanes that have none, and push it in the others.

        Returns the next node and the lanes that have one.
        """
        self.push(child, active & has_next)
        return dr.select(active & ~has_next, child, next_node), has_next | active

    def pop(self, node, active):
        """Return the top where an active lane has one, ``node`` elsewhere, and the mask of the lanes that had."""
        active = active & (self.pointer > 0)
        self.pointer = dr.select(active, self.pointer - 1, self.pointer)

        def top(entries, pointer, node):
            return entries, pointer, dr.select(active, entries.read(pointer, active), node)

        self.entries, self.pointer, node = when(active, top, self.entries, self.pointer, node)
        return node, active


class NoStack:
    """In place of a `Stack` where a ray never leaves more than one behind."""

    state = ()

    def with_state(self):
        """Return itself."""
        return self

    def update(self):
        """Do nothing."""

    def push_all_but_first(self, child, active, next_node, has_next):
        """Make ``child`` the next node in the active lanes, of which none has one."""
        return dr.select(active, child, next_node), has_next | active

    def pop(self, node, active):
        """Return ``node``, and that no lane has found another."""
        return node, mi.Bool(False)


def capacity(branching, max_depth):
    """Entries that a depth-first walk needs: each level leaves all children but one behind.

    Rounded up to a power of two of at least 8, so that the usual depths share one kernel.
    """
    needed = max(branching - 1, 0) * max(max_depth - 1, 0) + 1
    return max(8, 1 << (needed - 1).bit_length())
