r"""Distribution ray tracing: one sample of everything that is distributed, along paths that branch where it pays.

Source: [CookPorterCarpenter1984] for what is distributed, [Kajiya1986] for following all of it to the end, [Veach1997]
for combining techniques. Left out: participating media.
"""

import dataclasses
from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from whitted import effects, tracing, transport
from whitted.direct import DirectLight, power_heuristic
from whitted.errors import UsageError
from whitted.pilot import Pilot
from whitted.sampling.draws import SamplerDraws
from whitted.transport import when
from whitted.world import World

# Tag bits of a ray: it has met only null surfaces; only specular ones; its last lobe was specular; only what it hits
# emits counts
CLEAR, CHAIN, SPECULAR, FINAL = 1, 2, 4, 8
VISIT = 16  # the number of surfaces met, counted in the tag's upper bits
CUTOFF = 1 / 16  # a branch of the tree with less throughput than this survives by roulette
MOST_SURVIVAL = 0.95  # of roulette, as in Mitsuba's path
MAX_SAMPLES = 64
# Numbers of samples at the first hit, and the kind as which a pilot shares them out
SAMPLES = {"light_samples": "light", "gloss_samples": "lobes", "interreflection_samples": "lobes"}
INFINITE = 2**32 - 1


class DistributionIntegrator(mi.SamplingIntegrator):
    r"""Distribution ray tracing (``distribution``).

    =========================== ======= ================================================================ =======
    parameter                   type    meaning                                                          default
    =========================== ======= ================================================================ =======
    ``max_depth``               integer longest path in segments, as in Mitsuba's ``path``; -1: no limit -1
    ``rr_depth``                integer from this depth on paths end by roulette, as in ``path``         5
    ``hide_emitters``           boolean eye rays pass through area emitters and don't see the            false
                                        environment
    ``effects``                 string  ``auto``: what the scene calls for; ``all``; or a list of names  auto
    ``tree_depth``              integer up to this depth all branches of specular surfaces are followed, 2
                                        below one is chosen at random
    ``light_samples``           integer shadow rays to each group of lights from the first hit, 1 to 64, 1
                                        or ``auto``: shared out by the noise that each effect causes
    ``gloss_samples``           integer rays into rough lobes at the first hit, 1 to 64, or ``auto``     1
    ``interreflection_samples`` integer rays into diffuse lobes at the first hit, 1 to 64, or ``auto``   1
    =========================== ======= ================================================================ =======

    With :math:`f` the BSDF at :math:`x_k` and all effects on it estimates the rendering equation up to ``max_depth``,

    .. math::
        L(x_k) = L_e(x_k) + \int f L_e V \cos\theta \, d\omega + \int f \cos\theta \, L(x_{k+1}) \, d\omega

    averaged over pixel, lens and shutter: emitters are sampled at each vertex (all infinite ones, and one of the bounded
    ones chosen by its unshadowed contribution), rough lobes look for them too, and specular chains from the eye are a
    tree before they are paths.

    * Estimates: E (S | D)* L in Heckbert's notation, what ``path`` does. Light passes straight through null, mask and
      thin surfaces, as in ``volpath``, and such passages don't count for ``max_depth``.
    * Does not estimate: participating media, polarisation.
    * Bias: none with all effects on. What leaving an effect out does is told in ``docs/effects.md``; ``auto`` leaves out
      what changes the picture by less than a thousandth of its mean, with 95 % confidence.
    * Nested in other integrators the eye rays are theirs, and so are their pixel, lens and time.
    * Gradients are not available.

    .. code-block:: xml

        <integrator type="distribution">
            <integer name="max_depth" value="6"/>
            <string name="light_samples" value="auto"/>
        </integrator>
    """

    def __init__(self, props):
        super().__init__(props)
        self.max_depth = props.get("max_depth", -1)
        self.rr_depth = props.get("rr_depth", 5)
        self.hide_emitters = bool(props.get("hide_emitters", False))
        self.effects = effects.parse(props.get("effects", "auto"))
        self.tree_depth = props.get("tree_depth", 2)
        self.samples = {name: props.get(name, 1) for name in SAMPLES}
        _check("max_depth", self.max_depth, -1, 2**31 - 1)
        _check("rr_depth", self.rr_depth, 1, 2**31 - 1)
        _check("tree_depth", self.tree_depth, 0, 64)
        for name, value in self.samples.items():
            if value != "auto":
                _check(name, value, 1, MAX_SAMPLES, " and auto")

    def plan(self, world, sensor=None, name="scene"):
        """Return the `effects.Plan` of a ``World`` seen by a sensor; without one nothing is measured."""
        pilot = Pilot(self, world, sensor) if sensor is not None else None
        found = effects.decide(world, sensor, self.effects, self.max_depth, name, pilot)
        if pilot is None or "auto" not in self.samples.values():
            return found
        return dataclasses.replace(found, samples=pilot.share(found.effects))

    def fixed(self, plan):
        """Return an integrator that simulates what a plan of this one says, with nothing left to decide."""
        return mi.load_dict(
            self.properties() | {"effects": effects.spell(tuple(plan.effects))} | self.samples_of(plan)
        )

    def samples_of(self, plan):
        """Return the numbers of samples at the first hit by their properties' names, those that are shared out too."""
        shared = getattr(plan, "samples", {})
        return {
            name: shared.get(kind, 1) if self.samples[name] == "auto" else self.samples[name]
            for name, kind in SAMPLES.items()
        }

    def estimate(self, world, ray, draws, plan, active=True):
        """Estimate the radiance along each eye ray.

        Args:
            world: ``World``; its ray counts are increased.
            ray: ``Ray3f`` [N], the eye rays.
            draws: numbers by effect and node, ``whitted.sampling.draws``.
            plan: `effects.Plan`, what is simulated.
            active: ``Bool`` [N].

        Returns:
            A dict: ``radiance`` (``Spectrum``), ``alpha`` (``Float``; 1 less the share that met nothing).
        """
        with dr.suspend_grad():
            return _Walk(self, world, ray, draws, plan).run(mi.Bool(active) & (self.max_depth != 0))

    def sample(self, scene, sampler, ray, medium=None, active=True):
        """Estimate the radiance along ``ray``, as Mitsuba's integrators do when they are nested."""
        world = World(scene, self.hide_emitters)
        found = self.estimate(world, mi.Ray3f(ray), SamplerDraws(sampler), self.plan(world), active)
        return found["radiance"], active & (found["alpha"] > 0), []

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        """Render as Mitsuba's integrators do, with our own eye rays and sample sequences."""
        return tracing.fill_film(self, scene, sensor, seed, spp, develop, evaluate)

    def render_forward(self, *args, **kwargs):
        """Gradients are not available: raises ``RuntimeError``."""
        raise RuntimeError("distribution has no gradients: take Mitsuba's prb")

    render_backward = render_forward

    def aov_names(self):
        """Return the names of further channels: none."""
        return []

    def properties(self):
        """Return the dict that ``mi.load_dict`` makes an equal integrator of."""
        names = ("max_depth", "rr_depth", "hide_emitters", "tree_depth")
        values = {name: getattr(self, name) for name in names} | self.samples
        return {"type": "distribution", "effects": effects.spell(self.effects)} | values

    def to_string(self):
        """Return the parameters on one line."""
        values = list(self.properties().items())[1:]
        return f"DistributionIntegrator[{', '.join(f'{name}={value}' for name, value in values)}]"


class _Walk:
    """One walk along the paths of all lanes: a loop over vertices, with a stack where paths branch."""

    def __init__(self, integrator, world, ray, draws, plan):
        self.world, self.ray, self.draws = world, ray, draws
        self.lights = world.lights("soft_shadows" not in plan)
        flags, lobe, limit = world.flags, mi.BSDFFlags, integrator.max_depth
        # Data, not literals: the kernel serves all values
        self.max_depth = dr.opaque(mi.UInt32, INFINITE if limit < 0 else limit)
        self.rr_depth = dr.opaque(mi.UInt32, integrator.rr_depth)
        self.tree_depth = dr.opaque(mi.UInt32, integrator.tree_depth)
        self.light_samples, self.gloss_samples, self.diffuse_samples = integrator.samples_of(plan).values()

        # ---- What the kernel needs of it all
        self.scatters = limit < 0 or limit >= 2 or world.is_transparent
        onwards = limit < 0 or limit >= 3
        self.reflects, self.refracts = "reflection" in plan, "refraction" in plan
        self.interreflects = "interreflection" in plan and onwards and bool(flags & lobe.Diffuse)
        self.mirrored = {
            +lobe.GlossyReflection: "gloss" not in plan and bool(flags & lobe.GlossyReflection),
            +lobe.GlossyTransmission: "translucency" not in plan and bool(flags & lobe.GlossyTransmission),
        }
        is_rough = bool(flags & lobe.Glossy)
        self.combines_rough = is_rough and self.lights.is_hittable and not any(self.mirrored.values())
        self.combines_diffuse = self.interreflects and self.lights.is_hittable and not self.lights.is_plain
        self.meets = self.lights.only_met and bool(flags & lobe.Smooth)
        self.combines = self.combines_rough or self.combines_diffuse or self.meets
        follows_rough = is_rough and onwards and (self.reflects or self.refracts)
        self.has_specular = self.scatters and world.branching > 0
        self.has_smooth = self.scatters and (
            self.interreflects or follows_rough or self.combines_rough or self.meets
        )
        self.may_end = limit < 0 or limit > integrator.rr_depth
        self.splits = max(
            self.gloss_samples if is_rough else 1, self.diffuse_samples if self.interreflects else 1
        )
        self.goes_on = self.has_specular or self.has_smooth  # beyond the first surface
        self.has_stack = self.has_specular or (self.has_smooth and self.splits > 1)
        self.Node = transport.node_type(mi.variant(), self.combines)
        levels = integrator.tree_depth * world.branching if self.has_specular else 0
        self.stack_size = max(8, 1 << (levels + self.splits).bit_length())

    def run(self, active):
        """Return the sums over the paths of each lane."""
        ray, width = self.ray, dr.width((self.ray, active))
        active = active & dr.full(mi.Bool, True, width)
        root = self.Node(
            ray.o,
            ray.d,
            mi.Spectrum(1),
            mi.Float(1),
            mi.UInt32(0),
            mi.UInt32(CLEAR | CHAIN | SPECULAR),
            mi.UInt32(0),
        )
        if self.combines:
            root.p, root.n, root.pdf = mi.Point3f(0), mi.Vector3f(0), mi.Float(0)
        self.world.count("eye", active)
        sums = {"radiance": mi.Spectrum(0), "escaped": mi.Float(0)}
        if not self.goes_on:
            self.visit(active, root, sums, None)
        else:
            sums = self.loop(active, root, sums, width)
        return {"radiance": sums["radiance"], "alpha": dr.select(active, 1 - sums["escaped"], 0)}

    def loop(self, active, root, sums, width):
        world = self.world
        stack = transport.Stack.empty(self.Node, self.stack_size, width) if self.has_stack else None

        def step(active, node, sums, rays, sampler, *arrays):
            world.rays, sums = dict(rays), dict(sums)
            walk = stack.with_state(*arrays) if stack else None
            active, node = self.visit(active, node, sums, walk)
            return active, node, sums, world.rays, sampler, *(walk.state if walk else ())

        state = (active, root, sums, world.rays, self.draws.state, *(stack.state if stack else ()))
        _, _, sums, world.rays, *_ = dr.while_loop(state, lambda active, *_: active, step, label="paths")
        return sums

    def visit(self, active, node, sums, stack):
        """Trace one ray per lane, account for the light it finds, and choose the next ray."""
        world, lights = self.world, self.lights
        ray = mi.Ray3f(node.o, node.d, self.ray.time, self.ray.wavelengths)
        is_eye = (node.depth == 0) & ((node.tag & CHAIN) != 0)
        si = world.intersect(ray, is_eye, active)
        hit = active & si.is_valid()

        # ---- Emission
        seen = active & ~(is_eye & ~hit) if world.hide_emitters else active
        sums["radiance"] = sums["radiance"] + dr.select(
            seen, node.w * world.emission(si, seen) * self.emission_weight(si, node, seen), 0
        )
        if not world.has_environment:
            unseen = active & ~hit & ((node.tag & CLEAR) != 0)
            sums["escaped"] += dr.select(unseen, dr.mean(node.w), 0)
        if not self.scatters:
            return mi.Bool(False), node
        within = hit & ((node.tag & FINAL) == 0) & (node.depth + 1 < self.max_depth)

        # ---- Direct light
        vertex = self.vertex(si, node, hit, within)
        light = DirectLight(
            world,
            lights,
            self.draws,
            si,
            node.id,
            vertex.albedo,
            closed=vertex.is_seen,
            combined=vertex.combined,
            samples=self.count(vertex, self.light_samples),
            rays=self.count(vertex, self.gloss_samples if self.splits > 1 else 1),
        )
        sums["radiance"] += dr.select(within, node.w * light.estimate(within), 0)

        # ---- Branches
        if not self.goes_on:
            return mi.Bool(False), node
        next_node, has_next = node, mi.Bool(False)
        if self.has_smooth:
            next_node, has_next = self.scatter(vertex, stack)
        if self.has_specular:
            next_node, has_next = self.branch(vertex, next_node, has_next, stack)

        # ---- Stop, or go back to the last ray left behind
        next_node, has_next = self.roulette(next_node, has_next)
        if stack is None:
            return has_next, dr.select(has_next, next_node, node)
        node, from_stack = stack.pop(dr.select(has_next, next_node, node), active & ~has_next)
        return has_next | from_stack, node

    def emission_weight(self, si, node, active):
        """The share that rays have in the estimate of a light that they meet, beside sampling that light."""
        if not self.goes_on:
            return mi.Float(1)
        if self.lights.as_points:
            return dr.select((node.tag & CHAIN) != 0, mi.Float(1), 0)
        specular = (node.tag & SPECULAR) != 0
        if not self.combines:
            return dr.select(specular, mi.Float(1), 0)
        combined = active & ~specular & (node.pdf != 0) & (si.emitter(self.world.scene) != None)  # noqa: E711

        def share(weight):
            weight = power_heuristic(dr.abs(node.pdf), self.lights.pdf(si, node.p, node.n, combined))
            return dr.select((node.pdf < 0) & self.lights.is_plain_at(si), 0, weight)

        weight = when(combined, share, mi.Float(0))
        return dr.select(specular, mi.Float(1), dr.select(combined, weight, 0))

    def vertex(self, si, node, hit, within):
        """What is known of a surface point before anything is followed from there."""
        flags = si.bsdf().flags()
        rough = mi.has_flag(flags, mi.BSDFFlags.Glossy)
        onwards = node.depth + 2 < self.max_depth
        is_seen = (node.tag & CHAIN) != 0
        combined = None
        if self.combines:
            plain = rough & self.combines_rough
            combined = plain, plain | (onwards & self.combines_diffuse) | self.meets
        albedo = mi.Spectrum(0)
        if self.lights.is_closed or self.world.is_lambertian:
            albedo = self.world.diffuse_reflectance(si, within)
        return _Vertex(
            si,
            node,
            hit,
            within,
            flags,
            rough,
            onwards,
            is_seen & (node.depth == 0),
            is_seen,
            albedo,
            combined,
        )

    def count(self, vertex, samples):
        """The number of samples at a vertex: several at the first hit, one elsewhere."""
        return 1 if samples == 1 else dr.select(vertex.is_first, mi.UInt32(samples), 1)

    def scatter(self, vertex, stack):
        """Follow one ray into the smooth lobes of a vertex and push the others, if it is split."""
        node, has_next = self.lobe(vertex, mi.UInt32(0))
        if self.splits == 1:
            return node, has_next
        splits = self.count(vertex, self.splits)
        going = vertex.active & dr.full(mi.Bool, True, dr.width(vertex.active))

        def step(j, rays, sampler, *arrays):
            self.world.rays, pushed = dict(rays), stack.with_state(*arrays)
            node, present = self.lobe(vertex, j)
            pushed.push(node, present)
            return j + 1, self.world.rays, sampler, *pushed.state

        state = (mi.UInt32(1), self.world.rays, self.draws.state, *stack.state)
        _, self.world.rays, _, stack.entries, stack.pointer = dr.while_loop(
            state, lambda j, *_: going & (j < splits), step, label="splits"
        )
        return node, has_next

    def lobe(self, vertex, j):
        """Sample one ray into the smooth lobes of a vertex; return it and the lanes that have one."""
        si, node = vertex.si, vertex.node
        lobe = mi.BSDFFlags
        active = vertex.active & mi.has_flag(vertex.flags, lobe.Smooth)
        part = None if self.splits == 1 else (j, self.count(vertex, self.splits))
        u = self.draws("branch", node.id, 0, part)
        v = self.draws((vertex.rough, "gloss", "hemisphere"), node.id, 0, part)
        sample, weight = self.world.scatter(si, u.x, v, vertex.albedo, active)
        reflects = mi.has_flag(sample.sampled_type, lobe.GlossyReflection)
        transmits = mi.has_flag(sample.sampled_type, lobe.GlossyTransmission)
        followed = vertex.onwards & (
            (reflects & self.reflects)
            | (transmits & self.refracts)
            | (~reflects & ~transmits & self.interreflects)
        )
        active &= (followed | (vertex.rough & self.combines_rough) | self.meets) & ~dr.all(weight == 0)
        if self.splits > 1:
            wanted = dr.select(reflects | transmits, mi.UInt32(self.gloss_samples), self.diffuse_samples)
            wanted = dr.select(vertex.is_first, wanted, 1)
            active &= j < wanted
            weight = weight * dr.rcp(mi.Float(wanted))

        wo = self.centred(si, sample, reflects, transmits)
        child = self.child(node, node.w * weight, sample.eta, j + self.world.branching)
        child.tag |= dr.select(followed, mi.UInt32(0), FINAL)
        ray = self.world.spawn(si, si.to_world(wo))
        child.o, child.d = ray.o, ray.d
        if self.combines:
            pdf = si.bsdf().pdf(mi.BSDFContext(), si, wo, active) if self.world.mixes_lobes else sample.pdf
            rays = self.count(vertex, self.gloss_samples if self.splits > 1 else 1)
            pdf = pdf * rays * dr.rcp(mi.Float(self.count(vertex, self.light_samples)))
            child.p, child.n = si.p, self.world.light_side(si)
            child.pdf = dr.select(vertex.combined[0], pdf, dr.select(vertex.combined[1], -pdf, 0))
        self.world.count("reflection", active & reflects)
        self.world.count("transmission", active & transmits)
        self.world.count("interreflection", active & ~reflects & ~transmits)
        return child, active

    def centred(self, si, sample, reflects, transmits):
        """The direction of a sample, or the middle of its lobe where that isn't distributed."""
        wo = sample.wo
        if self.mirrored[+mi.BSDFFlags.GlossyReflection]:
            wo = dr.select(reflects, mi.reflect(si.wi), wo)
        if self.mirrored[+mi.BSDFFlags.GlossyTransmission]:
            cosine = dr.sqrt(dr.maximum(1 - (1 - dr.square(si.wi.z)) / dr.square(sample.eta), 0))
            straight = mi.Vector3f(-si.wi.x / sample.eta, -si.wi.y / sample.eta, -dr.mulsign(cosine, si.wi.z))
            wo = dr.select(transmits, dr.normalize(straight), wo)
        return wo

    def child(self, node, w, eta, slot):
        """A ray that leaves the surface where ``node`` ended; its direction is still to be set."""
        child = self.Node(w=w, eta=node.eta * eta, depth=node.depth + 1)
        child.tag = node.tag // VISIT * VISIT + VISIT
        child.id = node.id * (self.world.branching + self.splits) + (slot + 1)
        if self.combines:
            child.p, child.n, child.pdf = node.p, node.n, node.pdf
        return child

    def branch(self, vertex, smooth, has_smooth, stack):
        """Follow the specular lobes of a vertex: all of them in the upper levels of the tree, below one at random.

        ``smooth`` is the ray into the smooth lobes where ``has_smooth``. Returns the next ray and the lanes that
        have one; the other rays are pushed.
        """
        specular = vertex.hit & mi.has_flag(vertex.flags, mi.BSDFFlags.Delta)

        def split(next_node, has_next, rays, sampler, *arrays):
            self.world.rays, pushed = dict(rays), stack.with_state(*arrays)
            next_node, has_next = self.split(vertex, specular, next_node, has_next, pushed)
            return next_node, has_next, self.world.rays, sampler, *pushed.state

        next_node, has_next, self.world.rays, _, stack.entries, stack.pointer = when(
            specular, split, smooth, has_smooth, self.world.rays, self.draws.state, *stack.state
        )
        return next_node, has_next

    def split(self, vertex, active, smooth, has_smooth, stack):
        """The branches of the lanes that are at a specular surface; see ``branch``."""
        si, node, world = vertex.si, vertex.node, self.world
        in_tree = ((node.tag & CHAIN) != 0) & (node.tag // VISIT < self.tree_depth)
        u = self.draws("branch", node.id, 1)
        lobes = []
        for slot, (wo, weight, eta, kind) in enumerate(world.delta_lobes(si, active)):
            straight = mi.has_flag(kind, mi.BSDFFlags.Null)
            reflects = mi.has_flag(kind, mi.BSDFFlags.DeltaReflection)
            followed = straight | (vertex.active & ((reflects & self.reflects) | (~reflects & self.refracts)))
            child = self.child(node, node.w * weight, eta, slot)
            child.tag |= dr.select(straight, node.tag % VISIT, (node.tag & CHAIN) | mi.UInt32(SPECULAR))
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
            ray = world.spawn(si, si.to_world(wo))
            child.o, child.d = ray.o, ray.d
            world.count("reflection", spawned & reflects)
            world.count("transmission", spawned & ~reflects)
            stack.push(child, spawned & has_next)
            next_node = dr.select(spawned & ~has_next, child, next_node)
            has_next |= spawned
        return next_node, has_next

    def roulette(self, node, active):
        """End long paths at random, as Mitsuba's ``path`` does."""
        if not self.may_end:
            return node, active
        survival = dr.minimum(_importance(node.w, node.eta) * self.splits, MOST_SURVIVAL)
        u = self.draws("branch", node.id, 2).x
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
    albedo: object  # Spectrum: reflectance of the diffuse lobes, where it is needed
    combined: object  # masks, see `DirectLight`; None: none of both


def _importance(w, eta):
    """How much a ray may still contribute: throughput without the compression of radiance by refraction."""
    return dr.max(w) * dr.square(eta)


def _check(name, value, lowest, highest, besides=""):
    if not (isinstance(value, int) and lowest <= value <= highest):
        raise UsageError(f"{name} is {value}; accepted are whole numbers from {lowest} to {highest}{besides}")


mi.register_integrator("distribution", DistributionIntegrator)
