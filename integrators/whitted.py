r"""Whitted's ray tracer: direct light at the ends of a deterministic tree of reflections and refractions.

Source: [Whitted1980]; the cutoff is Hall and Greenberg's adaptive depth control [HallGreenberg1983]. Left out:
everything that is scattered after a diffuse or glossy surface, and participating media.
"""

from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from whitted import effects, optics, tracing, transport
from whitted.errors import UsageError
from whitted.film import luminance
from whitted.offsets import check_rule
from whitted.sampling.draws import SamplerDraws
from whitted.world import World

KEPT, BY_DEPTH, BY_CUTOFF = range(3)  # the accounts that light goes to: the picture, or one of the two losses
CLEAR = 4  # tag bit: the path from the eye met nothing but null surfaces
CARRY_ON = 16  # one in so many branches that are given up is followed, to estimate what is lost
LONGEST_AUDIT = 0.5  # the highest probability with which such a branch goes on at each further surface
MAX_DEPTH = 128  # bounds the stack


class WhittedIntegrator(mi.SamplingIntegrator):
    r"""Whitted ray tracing (``whitted``).

    ==================== ======= ======================================================================= =======
    parameter            type    meaning                                                                 default
    ==================== ======= ======================================================================= =======
    ``max_depth``        integer longest path in segments, as in Mitsuba's ``path``: 1 is emitted light  8
                                 seen directly, 2 is ray casting (direct light only); 0 to 128
    ``min_contribution`` float   a branch is given up when its throughput times eta^2 (largest channel)  1/1024
                                 falls below this; 0 follows every branch to ``max_depth``
    ``shadows``          boolean whether surfaces block the light of emitters                            true
    ``ambient``          rgb     radiance that reaches every diffuse lobe from all around, unshadowed    0
    ``hide_emitters``    boolean eye rays pass through area emitters and don't see the environment       false
    ``offset``           string  where rays leave surfaces: beside them by the ``bound`` of rounding     bound
                                 errors, or as ``mitsuba`` does
    ``local_model``      string  ``bsdf``, or ``classic``: at a ``phong`` BSDF a light that would give a   bsdf
                                 surface facing it the irradiance :math:`\pi I` adds
                                 :math:`I (k_d \, n \cdot l + k_s \, (r \cdot v)^n)`; others keep theirs
    ==================== ======= ======================================================================= =======

    With the delta lobes :math:`s` of the BSDF at :math:`x_k`, :math:`\rho_s` their reflectance or transmittance,
    and the rest of the BSDF :math:`f`, it estimates

    .. math::
        L(x_k) = L_e(x_k) + \sum_{e} \int f L_e V \cos\theta \, d\omega_e + \sum_s \rho_s \, L(x_{k+1}^s)

    where each emitter :math:`e` is sampled once and each :math:`s` is followed.

    * Estimates: E S* (L | D L) in Heckbert's notation: emitted light and direct light at the end of chains of
      perfect reflections and refractions. Every lobe that isn't perfectly specular (diffuse, rough, glossy,
      principled) counts as D. Light passes straight through null, mask and thin surfaces.
    * Does not estimate: light that meets another surface after a D, such as interreflection, caustics and blurred
      reflections; participating media.
    * Bias: none for these paths with ``min_contribution`` 0 and ``ambient`` 0. The radiance given up to
      ``max_depth`` and to ``min_contribution`` is estimated without bias and reported with the picture.
    * With ``local_model`` ``classic`` highlights follow no BSDF: E S* (L | P L), P a surface with the illumination
      of [Phong1975]. Such a picture isn't comparable with that of ``path``.
    * Rays that only serve to estimate a loss are counted with the others: a few in a hundred.
    * Gradients are not available: the tree's stack lies in local memory, which Dr.Jit doesn't differentiate.

    .. code-block:: xml

        <integrator type="whitted">
            <integer name="max_depth" value="8"/>
        </integrator>
    """

    estimates = "E S* (L | D L)"

    def __init__(self, props):
        super().__init__(props)
        self.max_depth = props.get("max_depth", 8)
        self.min_contribution = float(props.get("min_contribution", 1 / 1024))
        self.shadows = bool(props.get("shadows", True))
        self.hide_emitters = bool(props.get("hide_emitters", False))
        self.offset = props.get("offset", "bound")
        check_rule(self.offset)
        self.local_model = props.get("local_model", "bsdf")
        self.ambient = props.get_emissive_texture("ambient") if "ambient" in props else None
        if not (isinstance(self.max_depth, int) and 0 <= self.max_depth <= MAX_DEPTH):
            raise UsageError(
                f"max_depth is {self.max_depth}; accepted are whole numbers from 0 to {MAX_DEPTH}"
            )
        if not 0 <= self.min_contribution < float("inf"):
            raise UsageError(f"min_contribution is {self.min_contribution}; accepted are 0 and above")
        if self.local_model not in optics.LOCAL_MODELS:
            accepted = " and ".join(optics.LOCAL_MODELS)
            raise UsageError(f"local_model is {self.local_model!r}; accepted are {accepted}")
        if self.local_model == "classic":
            self.estimates = "E S* (L | P L)"

    def world(self, scene):
        """Return the ``World`` of an ``mi.Scene`` in which rays are traced."""
        return World(scene, self.hide_emitters, self.offset)

    def estimate(self, world, ray, draws, plan=None, active=True):
        """Trace the ray tree of each eye ray.

        Args:
            world: ``World``; its ray counts are increased.
            ray: ``Ray3f`` [N], the eye rays.
            draws: numbers by effect and node, ``whitted.sampling.draws``.
            plan: has no say in what is traced.
            active: ``Bool`` [N].

        Returns:
            A dict: ``radiance`` (``Spectrum``), ``alpha`` (``Float``; 1 less the share that met nothing), and
            for each of ``by_depth`` and ``by_cutoff`` the luminance lost, ``lost_...``, and the throughput given
            up, ``dropped_...`` (``Float``).
        """
        with dr.suspend_grad():
            return _Tree(self, world, ray, draws).grow(mi.Bool(active) & (self.max_depth > 0))

    def plan(self, world, sensor=None, name="scene"):
        """Return the `effects.Plan` of a ``World`` seen by a sensor: of what can be distributed or branched over."""
        found = effects.decide(world, sensor, max_depth=self.max_depth, name=name)
        left_out = {"gloss", "translucency", "interreflection"} | (
            set() if self.shadows else {"soft_shadows"}
        )
        return found.without(left_out, "not simulated")

    def sample(self, scene, sampler, ray, medium=None, active=True):
        """Estimate the radiance along ``ray``, as Mitsuba's integrators do when they are nested."""
        world = self.world(scene)
        found = self.estimate(world, mi.Ray3f(ray), SamplerDraws(sampler), active=active)
        return tracing.contained(found["radiance"]), active & (found["alpha"] > 0), []

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        """Render as Mitsuba's integrators do, with our own eye rays and sample sequences."""
        return tracing.fill_film(self, scene, sensor, seed, spp, develop, evaluate)

    def render_forward(self, *args, **kwargs):
        """Gradients are not available: raises ``RuntimeError``."""
        raise RuntimeError(
            "whitted has no gradients: its ray tree can't be differentiated; take Mitsuba's prb"
        )

    render_backward = render_forward

    def aov_names(self):
        """Return the names of further channels: none."""
        return []

    def to_string(self):
        """Return the parameters on one line."""
        return (
            f"WhittedIntegrator[max_depth={self.max_depth}, min_contribution={self.min_contribution}, "
            f"shadows={self.shadows}, ambient={self.ambient}, hide_emitters={self.hide_emitters}, "
            f"offset={self.offset}, local_model={self.local_model}]"
        )


class _Tree:
    """One walk over the ray trees of all lanes, depth first, in one symbolic loop."""

    def __init__(self, integrator, world, ray, draws):
        self.integrator, self.world, self.ray, self.draws = integrator, world, ray, draws
        # Data, not literals: the kernel serves all values
        self.max_depth = dr.opaque(mi.UInt32, integrator.max_depth)
        self.cutoff = dr.opaque(mi.Float, integrator.min_contribution)
        self.Node = transport.node_type(mi.variant())

    def grow(self, active):
        ray, world = self.ray, self.world
        width = dr.width((ray, active))
        active = active & dr.full(mi.Bool, True, width)
        root = self.Node(
            ray.o, ray.d, mi.Spectrum(1), mi.Float(1), mi.UInt32(0), mi.UInt32(CLEAR), mi.UInt32(0)
        )
        size = transport.capacity(world.branching, self.integrator.max_depth)
        stack = transport.Stack.empty(self.Node, size, width)
        world.count("eye", active)
        sums = {
            "radiance": mi.Spectrum(0),
            "escaped": mi.Float(0),
            "lost_by_depth": mi.Float(0),
            "lost_by_cutoff": mi.Float(0),
            "dropped_by_depth": mi.Float(0),
            "dropped_by_cutoff": mi.Float(0),
        }

        def step(active, node, sums, rays, sampler, *arrays):
            world.rays, sums, walk = dict(rays), dict(sums), stack.with_state(*arrays)
            active, node = self.visit(active, node, sums, walk)
            return active, node, sums, world.rays, sampler, *walk.state

        state = (active, root, sums, world.rays, self.draws.state, *stack.state)
        _, _, sums, world.rays, *_ = dr.while_loop(state, lambda active, *_: active, step, label="ray tree")
        escaped = sums.pop("escaped")
        sums["alpha"] = 1 - escaped if self.integrator.max_depth > 0 else mi.Float(0)
        return sums

    def visit(self, active, node, sums, stack):
        """Trace one ray per lane, account for the light it finds, and choose the next ray."""
        world, draws = self.world, self.draws
        ray = mi.Ray3f(node.o, node.d, self.ray.time, self.ray.wavelengths)
        is_eye = node.depth == 0
        si = world.intersect(ray, is_eye, active)
        hit = active & si.is_valid()
        account = node.tag & 3
        kept = account == KEPT

        # ---- Emission
        seen = active & ~(is_eye & ~hit) if world.hide_emitters else active
        emitted = world.emission(si, seen)
        world.watch("emission", emitted, si, seen & kept)
        self.add(sums, account, seen, node.w * emitted)
        if not world.has_environment:
            unseen = active & ~hit & kept & ((node.tag & CLEAR) != 0)
            sums["escaped"] += dr.select(unseen, dr.mean(node.w), 0)

        # ---- The end of the tree: one in CARRY_ON goes on, on the account of what is lost to depth
        within = node.depth + 1 < self.max_depth
        ends = hit & kept & ~within
        u = draws.audit(node.id)
        carried = ends & (u < 1 / CARRY_ON)
        u = dr.select(carried, u * CARRY_ON, u)
        w = dr.select(carried, node.w * CARRY_ON, node.w)
        account = dr.select(carried, BY_DEPTH, account)
        goes_on = hit & (within | (account != KEPT))

        # ---- Direct light
        context = optics.bsdf_context(self.integrator.local_model)
        L = transport.direct_light(world, si, draws, node.id, goes_on, self.integrator.shadows, context)
        if self.integrator.ambient is not None:
            L += self.integrator.ambient.eval(si, goes_on) * world.diffuse_reflectance(si, goes_on)
        world.watch("direct light", L, si, goes_on & kept)
        self.add(sums, account, goes_on, w * L)

        # ---- Branches
        def branch(node, has_next, sums, rays, *arrays):
            world.rays, sums, pushed = dict(rays), dict(sums), stack.with_state(*arrays)
            vertex = _Vertex(si, node, w, account, goes_on, ends, u)
            node, has_next = self.branch(vertex, sums, pushed)
            return node, has_next, sums, world.rays, *pushed.state

        specular = mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Delta) & (goes_on | ends)
        node, has_next, branched, world.rays, stack.entries, stack.pointer = transport.when(
            specular, branch, node, mi.Bool(False), sums, world.rays, *stack.state
        )
        sums.update(branched)

        # ---- Stop, or go back to the last ray left behind
        node, from_stack = stack.pop(node, active & ~has_next)
        return has_next | from_stack, node

    def add(self, sums, account, active, L):
        """Add radiance to the account of each lane."""
        sums["radiance"] = sums["radiance"] + dr.select(active & (account == KEPT), L, 0)
        lost = dr.select(active, luminance(L, self.ray.wavelengths), 0)
        sums["lost_by_depth"] += dr.select(account == BY_DEPTH, lost, 0)
        sums["lost_by_cutoff"] += dr.select(account == BY_CUTOFF, lost, 0)

    def branch(self, vertex, sums, stack):
        """Follow one child of a vertex and push the others; return the child and the lanes that have one.

        The uniform number ``u`` decides all that is random: which dropped branches are carried on, and the one
        child that a branch takes which is only carried on to estimate a loss. That child is taken with a
        probability in proportion to its share, and the branch ends by roulette as a path does.
        """
        si, node, w, account, active, ends, u = vertex
        world = self.world
        children = world.delta_lobes(si, active | ends)
        importance = [_importance(w * weight, node.eta * eta) for _, weight, eta, _ in children]
        total = sum(importance, mi.Float(0))
        survival = dr.minimum(total / _importance(w, node.eta), LONGEST_AUDIT)
        is_kept = account == KEPT
        below = mi.Float(0)

        next_node, has_next = node, mi.Bool(False)
        for slot, ((wo, weight, eta, kind), share) in enumerate(zip(children, importance, strict=True)):
            child = self.Node(w=w * weight, eta=node.eta * eta, depth=node.depth + 1)
            child.id = node.id * world.branching + (slot + 1)
            present = active & ~(share <= 0)  # NaN is followed, and counted in the end
            throughput = dr.mean(node.w * weight) * dr.square(child.eta)
            sums["dropped_by_depth"] += dr.select(ends, throughput, 0)

            dropped = present & is_kept & (share < self.cutoff)
            sums["dropped_by_cutoff"] += dr.select(dropped, throughput, 0)
            first = (slot % CARRY_ON) / CARRY_ON
            saved = dropped & (u >= first) & (u < first + 1 / CARRY_ON)
            chance = survival * share / total
            chosen = present & ~is_kept & (u >= below) & (u < below + chance)
            below = below + chance

            child.w = child.w * dr.select(saved, CARRY_ON, dr.select(chosen, dr.rcp(chance), 1))
            clear = dr.select(mi.has_flag(kind, mi.BSDFFlags.Null), node.tag & CLEAR, 0)
            child.tag = dr.select(saved, BY_CUTOFF, account) | clear
            spawned = saved | chosen | (present & is_kept & ~dropped)
            reflects = mi.has_flag(kind, mi.BSDFFlags.DeltaReflection)
            world.watch("throughput", child.w, si, spawned & is_kept)
            transport.send(world, si, child, wo, reflects, spawned)
            next_node, has_next = stack.push_all_but_first(child, spawned, next_node, has_next)
        return next_node, has_next


class _Vertex(NamedTuple):
    """A surface point from which the tree branches."""

    si: object
    node: object  # the ray that led here
    w: object  # its throughput, raised if it is only carried on to estimate a loss
    account: object
    active: object  # the lanes that go on
    ends: object  # the lanes whose branches are given up to the depth
    u: object


def _importance(w, eta):
    """How much a branch may still contribute: throughput without the compression of radiance by refraction."""
    return dr.max(w) * dr.square(eta)


mi.register_integrator("whitted", WhittedIntegrator)
