"""Paths from the eye through everything that scatters: the loop of distribution ray tracing.

Specular chains from the eye may be a tree, whose branches wait on a stack; all else is a path, split at the first hit
where more samples of a kind are wanted. Source: [Kajiya1986] for paths, [ArvoKirk1990] for roulette and splitting,
[Veach1997] for combining what rays and lights find.
"""

from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from whitted import transport
from whitted.direct import DirectLight, power_heuristic
from whitted.transport import when

# Tag bits of a ray: it has met only null surfaces; only specular ones; it alone looks for the lights that it may meet;
# only what it hits emits counts
CLEAR, CHAIN, ALONE, FINAL = 1, 2, 4, 8
INFINITE = 2**32 - 1
VISIT = 16  # the number of surfaces met, counted in the tag's upper bits
CUTOFF = 1 / 16  # a branch of the tree with less throughput than this survives by roulette
MOST_SURVIVAL = 0.95  # of roulette, as in Mitsuba's path


class Paths:
    """One walk along the paths of all lanes: a loop over vertices, with a stack where paths branch.

    Args:
        integrator: the parameters, those of ``distribution``.
        world: ``World``; its ray counts are increased.
        ray: ``Ray3f`` [N], the eye rays.
        draws: numbers by effect and node, ``whitted.sampling.draws``.
        plan: names of effects, ``whitted.effects.Plan`` or a set: what isn't in it leaves no trace in the kernel.
    """

    def __init__(self, integrator, world, ray, draws, plan):
        self.world, self.ray = world, ray
        self.lights = world.lights("soft_shadows" not in plan)
        limit = integrator.max_depth
        # Data, not literals: the kernel serves all values
        self.max_depth = dr.opaque(mi.UInt32, INFINITE if limit < 0 else limit)
        self.rr_depth = dr.opaque(mi.UInt32, integrator.rr_depth)
        self.tree_depth = dr.opaque(mi.UInt32, integrator.tree_depth)
        counts = integrator.samples_of(plan).values()
        self.light_samples, self.gloss_samples, self.diffuse_samples = counts
        self.light_count, self.gloss_count, self.diffuse_count = (dr.opaque(mi.UInt32, n) for n in counts)
        self._decide(integrator, plan)
        self.draws = draws.refined() if max(self.splits, self.light_samples) > 1 else draws

    def _decide(self, integrator, plan):
        """Find out what the kernel needs of it all: Python values, known when it is made."""
        flags, lobe, limit = self.world.flags, mi.BSDFFlags, integrator.max_depth
        scatters = limit < 0 or limit >= 2 or self.world.is_transparent
        self.scatters = scatters and bool(self.world.bsdfs)
        onwards = limit < 0 or limit >= 3
        self.reflects, self.refracts = "reflection" in plan, "refraction" in plan
        self.interreflects = "interreflection" in plan and onwards and bool(flags & lobe.Diffuse)
        self.mirrored = {
            +lobe.GlossyReflection: "gloss" not in plan and bool(flags & lobe.GlossyReflection),
            +lobe.GlossyTransmission: "translucency" not in plan and bool(flags & lobe.GlossyTransmission),
        }
        self.is_rough = is_rough = bool(flags & lobe.Glossy)
        # Rough surfaces look for lights with their rays; alone: with nothing else
        self.seeks = is_rough and self.lights.is_hittable and not any(self.mirrored.values())
        self.technique = integrator.technique_of(plan) if self.seeks else "both"
        self.seeks_alone = self.technique == "rays"
        self.closes = self.world.knows_unoccluded(self.lights) and integrator.uses_closed_form(plan)
        self.combines_diffuse = self.interreflects and self.lights.is_hittable and not self.lights.is_plain
        self.meets = self.lights.only_met and bool(flags & lobe.Smooth)
        self.combines = (self.seeks and not self.seeks_alone) or self.combines_diffuse or self.meets
        follows_rough = is_rough and onwards and (self.reflects or self.refracts)
        followed = (
            (self.reflects, +lobe.DeltaReflection),
            (self.refracts, +lobe.DeltaTransmission),
            (True, +lobe.Null),
        )
        specular = any(follows and flags & kind for follows, kind in followed)
        self.has_specular = self.scatters and self.world.branching > 0 and specular
        self.has_smooth = self.scatters and (self.interreflects or follows_rough or self.seeks or self.meets)
        self.may_end = limit < 0 or limit > integrator.rr_depth
        self.splits = max(
            self.gloss_samples if is_rough else 1, self.diffuse_samples if self.interreflects else 1
        )
        self.goes_on = self.has_specular or self.has_smooth  # beyond the first surface
        self.has_tree = self.has_specular and integrator.tree_depth > 0
        self.has_stack = self.has_tree or (self.has_smooth and self.splits > 1)
        self.Node = transport.node_type(mi.variant(), self.combines, self.lights.shares_type, self.splits > 1)
        levels = integrator.tree_depth * self.world.branching if self.has_tree else 0
        self.stack_size = max(8, 1 << (levels + self.splits).bit_length())

    def trace(self, active):
        """Return a dict of what the paths of each lane (``Bool`` [N]) find: ``radiance`` and ``alpha``."""
        ray, width = self.ray, dr.width((self.ray, active))
        active = active & dr.full(mi.Bool, True, width)
        root = self.Node(
            ray.o,
            ray.d,
            mi.Spectrum(1),
            mi.Float(1),
            mi.UInt32(0),
            mi.UInt32(CLEAR | CHAIN | ALONE),
            mi.UInt32(0),
        )
        if self.combines:
            root.p, root.n, root.pdf = mi.Point3f(0), mi.Vector3f(0), mi.Float(0)
            if self.lights.shares_type:
                root.shares = self.lights.shares_type(0)
        if self.splits > 1:
            root.part = self.draws.index
        self.world.count("eye", active)
        sums = {"radiance": mi.Spectrum(0), "escaped": mi.Float(0)}
        if not self.goes_on:
            self._visit(active, root, sums, transport.NoStack())
        else:
            sums = self._loop(active, root, sums, width)
        return {"radiance": sums["radiance"], "alpha": dr.select(active, 1 - sums["escaped"], 0)}

    def _loop(self, active, root, sums, width):
        world = self.world
        stack = transport.NoStack()
        if self.has_stack:
            stack = transport.Stack.empty(self.Node, self.stack_size, width)

        def step(active, node, sums, rays, sampler, *arrays):
            world.rays, sums = dict(rays), dict(sums)
            walk = stack.with_state(*arrays)
            active, node = self._visit(active, node, sums, walk)
            return active, node, sums, world.rays, sampler, *walk.state

        state = (active, root, sums, world.rays, self.draws.state, *stack.state)
        _, _, sums, world.rays, *_ = dr.while_loop(state, lambda active, *_: active, step, label="paths")
        return sums

    def _visit(self, active, node, sums, stack):
        """Trace one ray per lane, account for the light it finds, and choose the next ray."""
        world, lights = self.world, self.lights
        ray = mi.Ray3f(node.o, node.d, self.ray.time, self.ray.wavelengths)
        is_eye = (node.depth == 0) & ((node.tag & CHAIN) != 0)
        si = world.intersect(ray, is_eye, active)
        hit = active & si.is_valid()

        # ---- Emission
        seen = active & ~(is_eye & ~hit) if world.hide_emitters else active
        emitted = world.emission(si, seen) * self._emission_weight(si, node, seen)
        world.watch("emission", emitted, si, seen)
        sums["radiance"] = sums["radiance"] + dr.select(seen, node.w * emitted, 0)
        if not world.has_environment:
            unseen = active & ~hit & ((node.tag & CLEAR) != 0)
            sums["escaped"] += dr.select(unseen, dr.mean(node.w), 0)
        if not self.scatters:
            return mi.Bool(False), node
        within = hit & ((node.tag & FINAL) == 0) & (node.depth + 1 < self.max_depth)

        # ---- Direct light
        vertex = self._vertex(si, node, hit, within)
        light = DirectLight(
            world,
            lights,
            vertex.draws,
            si,
            node.id,
            vertex.albedo,
            closed=vertex.is_seen if self.closes else None,
            combined=vertex.combined,
            samples=self._light_samples(vertex.is_first),
            rays=vertex.splits,
            rough=vertex.rough if self.is_rough else None,
            technique=self.technique,
        )
        lit = light.estimate(within)
        world.watch("direct light", lit, si, within)
        sums["radiance"] += dr.select(within, node.w * lit, 0)

        # ---- Branches
        if not self.goes_on:
            return mi.Bool(False), node
        next_node, has_next = node, mi.Bool(False)
        if self.has_smooth:
            next_node, has_next = self._scatter(vertex, light, stack)
        if self.has_specular:
            next_node, has_next = self._branch(vertex, next_node, has_next, stack)

        # ---- Stop, or go back to the last ray left behind
        next_node, has_next = self._roulette(next_node, has_next)
        node, from_stack = stack.pop(dr.select(has_next, next_node, node), active & ~has_next)
        return has_next | from_stack, node

    def _emission_weight(self, si, node, active):
        """The share that rays have in the estimate of a light that they meet, beside sampling that light."""
        if not self.goes_on:
            return mi.Float(1)
        if self.lights.as_points:
            return dr.select((node.tag & CHAIN) != 0, mi.Float(1), 0)
        alone = (node.tag & ALONE) != 0
        if not self.combines:
            return dr.select(alone, mi.Float(1), 0)
        combined = active & ~alone & (node.pdf != 0) & (si.emitter(self.world.scene) != None)  # noqa: E711

        shares = node.shares if self.lights.shares_type else mi.Float(1)

        def share(weight):
            sampled = self.lights.pdf(si, node.p, node.n, combined, shares)
            weight = power_heuristic(dr.abs(node.pdf), sampled)
            if self.technique == "lights":
                weight = dr.select((node.pdf > 0) & (sampled > 0), 0, weight)
            return dr.select((node.pdf < 0) & self.lights.is_plain_at(si), 0, weight)

        weight = when(combined, share, mi.Float(0))
        return dr.select(alone, mi.Float(1), dr.select(combined, weight, 0))

    def _vertex(self, si, node, hit, within):
        """What is known of a surface point before anything is followed from there."""
        flags = si.bsdf().flags()
        rough = mi.has_flag(flags, mi.BSDFFlags.Glossy)
        onwards = node.depth + 2 < self.max_depth
        is_seen = (node.tag & CHAIN) != 0
        is_first = is_seen & (node.depth == 0)
        combined = None
        if self.combines or self.seeks_alone:
            plain = rough & self.seeks
            combined = plain, plain | (onwards & self.combines_diffuse) | self.meets
        albedo = mi.Spectrum(0)
        if self.closes or self.world.is_lambertian:
            albedo = self.world.diffuse_reflectance(si, within)
        return _Vertex(
            si,
            node,
            hit,
            within,
            flags,
            rough,
            onwards,
            is_first,
            is_seen,
            self._splits(flags, rough, is_first),
            self.draws.at(node.part) if self.splits > 1 else self.draws,
            albedo,
            combined,
        )

    def _light_samples(self, is_first):
        """The number of samples of each group of lights: several at the first hit, one elsewhere."""
        return 1 if self.light_samples == 1 else dr.select(is_first, self.light_count, 1)

    def _splits(self, flags, rough, is_first):
        """The number of rays into the smooth lobes of a vertex: the larger one where it has both kinds of lobes."""
        if self.splits == 1:
            return 1
        diffuse = mi.has_flag(flags, mi.BSDFFlags.Diffuse) & self.interreflects
        splits = dr.select(rough, self.gloss_count, 1)
        splits = dr.select(diffuse, dr.maximum(splits, self.diffuse_count), splits)
        return dr.select(is_first, splits, 1)

    def _scatter(self, vertex, light, stack):
        """Follow one ray into the smooth lobes of a vertex and push the others, if it is split.

        ``light`` is the `DirectLight` that was estimated there.
        """
        node, has_next = self._lobe(vertex, light, mi.UInt32(0))
        if self.splits == 1:
            return node, has_next
        going = vertex.active & dr.full(mi.Bool, True, dr.width(vertex.active))

        def step(j, rays, sampler, *arrays):
            self.world.rays, pushed = dict(rays), stack.with_state(*arrays)
            node, present = self._lobe(vertex, light, j)
            pushed.push(node, present)
            return j + 1, self.world.rays, sampler, *pushed.state

        state = (mi.UInt32(1), self.world.rays, self.draws.state, *stack.state)
        _, self.world.rays, _, *arrays = dr.while_loop(
            state, lambda j, *_: going & (j < vertex.splits), step, label="splits"
        )
        stack.update(*arrays)
        return node, has_next

    def _lobe(self, vertex, light, j):
        """Sample one ray into the smooth lobes of a vertex; return it and the lanes that have one."""
        si, node = vertex.si, vertex.node
        lobe = mi.BSDFFlags
        active = vertex.active & mi.has_flag(vertex.flags, lobe.Smooth)
        draws = vertex.draws.part(j, vertex.splits) if self.splits > 1 else vertex.draws
        u = draws("branch", node.id)
        v = draws((vertex.rough, "gloss", "hemisphere"), node.id)
        sample, weight = self.world.scatter(si, u.x, v, vertex.albedo, active)
        reflects = mi.has_flag(sample.sampled_type, lobe.GlossyReflection)
        transmits = mi.has_flag(sample.sampled_type, lobe.GlossyTransmission)
        followed = vertex.onwards & (
            (reflects & self.reflects)
            | (transmits & self.refracts)
            | (~reflects & ~transmits & self.interreflects)
        )
        active &= (followed | (vertex.rough & self.seeks) | self.meets) & ~dr.all(weight == 0)
        if self.splits > 1:
            weight = weight * dr.rcp(mi.Float(vertex.splits))

        wo = self._centred(si, sample, reflects, transmits)
        child = self._child(node, node.w * weight, sample.eta, 0)
        if self.splits > 1:
            child.part = draws.index
        child.tag |= dr.select(followed, mi.UInt32(0), FINAL)
        if self.seeks_alone:
            child.tag |= dr.select(vertex.rough, mi.UInt32(ALONE), 0)
        ray = self.world.spawn(si, si.to_world(wo))
        child.o, child.d = ray.o, ray.d
        if self.combines:
            pdf = si.bsdf().pdf(mi.BSDFContext(), si, wo, active) if self.world.mixes_lobes else sample.pdf
            pdf = pdf * vertex.splits * dr.rcp(mi.Float(self._light_samples(vertex.is_first)))
            child.p, child.n = si.p, light.n
            if self.lights.shares_type:
                child.shares = light.shares
            child.pdf = dr.select(vertex.combined[0], pdf, dr.select(vertex.combined[1], -pdf, 0))
        self.world.watch("throughput", child.w, si, active)
        self.world.count("reflection", active & reflects)
        self.world.count("transmission", active & transmits)
        self.world.count("interreflection", active & ~reflects & ~transmits)
        return child, active

    def _centred(self, si, sample, reflects, transmits):
        """The direction of a sample, or the middle of its lobe where that isn't distributed."""
        wo = sample.wo
        if self.mirrored[+mi.BSDFFlags.GlossyReflection]:
            wo = dr.select(reflects, mi.reflect(si.wi), wo)
        if self.mirrored[+mi.BSDFFlags.GlossyTransmission]:
            cosine = dr.sqrt(dr.maximum(1 - (1 - dr.square(si.wi.z)) / dr.square(sample.eta), 0))
            straight = mi.Vector3f(-si.wi.x / sample.eta, -si.wi.y / sample.eta, -dr.mulsign(cosine, si.wi.z))
            wo = dr.select(transmits, dr.normalize(straight), wo)
        return wo

    def _child(self, node, w, eta, slot):
        """A ray that leaves the surface where ``node`` ended; its direction is still to be set.

        ``slot`` is 0 for smooth lobes: the first ray into one, whatever part of the sample it is, is node 1.
        """
        child = self.Node(w=w, eta=node.eta * eta, depth=node.depth + 1)
        child.tag = node.tag // VISIT * VISIT + VISIT
        # an odd factor: by an even one the upper levels are shifted out, and long paths get the same numbers again
        child.id = node.id * ((self.world.branching + 1) | 1) + (slot + 1)
        if self.combines:
            for name in self.Node.SAMPLED:
                setattr(child, name, getattr(node, name))
        if self.splits > 1:
            child.part = node.part
        return child

    def _branch(self, vertex, smooth, has_smooth, stack):
        """Follow the specular lobes of a vertex: all of them in the upper levels of the tree, below one at random.

        ``smooth`` is the ray into the smooth lobes where ``has_smooth``. Returns the next ray and the lanes that
        have one; the other rays are pushed.
        """
        specular = vertex.hit & mi.has_flag(vertex.flags, mi.BSDFFlags.Delta)

        def split(next_node, has_next, rays, sampler, *arrays):
            self.world.rays, pushed = dict(rays), stack.with_state(*arrays)
            next_node, has_next = self._split(vertex, specular, next_node, has_next, pushed)
            return next_node, has_next, self.world.rays, sampler, *pushed.state

        next_node, has_next, self.world.rays, _, *arrays = when(
            specular, split, smooth, has_smooth, self.world.rays, self.draws.state, *stack.state
        )
        stack.update(*arrays)
        return next_node, has_next

    def _split(self, vertex, active, smooth, has_smooth, stack):
        """The branches of the lanes that are at a specular surface; see ``branch``."""
        si, node, world = vertex.si, vertex.node, self.world
        in_tree = mi.Bool(False)
        if self.has_tree:
            in_tree = ((node.tag & CHAIN) != 0) & (node.tag // VISIT < self.tree_depth)
        u = vertex.draws("branch", node.id, 1)
        lobes = []
        for slot, (wo, weight, eta, kind) in enumerate(world.delta_lobes(si, active), 1):
            straight = mi.has_flag(kind, mi.BSDFFlags.Null)
            reflects = mi.has_flag(kind, mi.BSDFFlags.DeltaReflection)
            followed = straight | (vertex.active & ((reflects & self.reflects) | (~reflects & self.refracts)))
            child = self._child(node, node.w * weight, eta, slot)
            child.tag |= dr.select(straight, node.tag % VISIT, (node.tag & CHAIN) | mi.UInt32(ALONE))
            child.depth = dr.select(straight, node.depth, child.depth)
            share = dr.select(active & followed, _importance(child.w, child.eta), 0)
            lobes.append((child, wo, share, reflects))

        share = dr.select(has_smooth, _importance(smooth.w, smooth.eta), 0)
        total = sum((share for _, _, share, _ in lobes), share)
        kept = has_smooth & (in_tree | (u.x * total < share))
        smooth.w = smooth.w * dr.select(in_tree, 1, total / share)
        next_node, has_next, below = smooth, dr.select(active, kept, has_smooth), share
        for child, wo, share, reflects in lobes:
            survival = dr.select(in_tree, dr.minimum(share / CUTOFF, 1), share / total)
            chosen = (u.x * total >= below) & (u.x * total < below + share)
            spawned = active & ~(share <= 0) & dr.select(in_tree, u.y < survival, chosen)
            below = below + share
            child.w = child.w * dr.rcp(survival)
            world.watch("throughput", child.w, si, spawned)
            transport.send(world, si, child, wo, reflects, spawned)
            next_node, has_next = stack.push_all_but_first(child, spawned, next_node, has_next)
        return next_node, has_next

    def _roulette(self, node, active):
        """End long paths at random, as Mitsuba's ``path`` does."""
        if not self.may_end:
            return node, active
        survival = dr.minimum(_importance(node.w, node.eta) * self.splits, MOST_SURVIVAL)
        draws = self.draws.at(node.part) if self.splits > 1 else self.draws
        u = draws("branch", node.id, 2).x
        played = active & (node.depth >= self.rr_depth)
        node.w = node.w * dr.select(played, dr.rcp(survival), 1)
        return node, active & (~played | (u < survival))


class _Vertex(NamedTuple):
    """A surface point from which paths go on."""

    si: object
    node: object  # the ray that led here
    hit: object  # Bool: the lanes that have met a surface
    active: object  # Bool: of these, the lanes that may scatter
    flags: object  # of the BSDF
    rough: object  # Bool: it has rough lobes
    onwards: object  # Bool: what is followed from here may scatter again
    is_first: object  # Bool: it is seen by the eye directly
    is_seen: object  # Bool: it is seen directly or by way of specular surfaces
    splits: object  # UInt32 or 1: how many rays go into its smooth lobes
    draws: object  # the numbers of its sample, or part of a sample
    albedo: object  # Spectrum: reflectance of the diffuse lobes, where it is needed
    combined: object  # masks, see `DirectLight`; None: none of both


def _importance(w, eta):
    """How much a ray may still contribute: throughput without the compression of radiance by refraction."""
    return dr.max(w) * dr.square(eta)
