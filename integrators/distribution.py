r"""Distribution ray tracing: one sample of everything that is distributed, along paths that branch where it pays.

Source: [CookPorterCarpenter1984] for what is distributed, [Kajiya1986] for following all of it to the end, [Veach1997]
for combining techniques. Left out: participating media.
"""

import dataclasses

import drjit as dr
import mitsuba as mi

from whitted import budget, denormals, effects, tracing
from whitted.errors import UsageError
from whitted.offsets import check_rule
from whitted.paths import Paths
from whitted.pilot import Pilot
from whitted.sampling.draws import SamplerDraws
from whitted.world import World

MAX_SAMPLES = 64
# Numbers of samples at the first hit, and the kind as which `whitted.budget` shares them out
SAMPLES = {"light_samples": "light", "gloss_samples": "lobes", "interreflection_samples": "lobes"}


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
    ``tree_depth``              integer up to this depth all branches of specular surfaces are followed, 0
                                        below one is chosen at random; 0: from the start
    ``light_samples``           integer shadow rays to each group of lights from the first hit, 1 to 64, 1
                                        or ``auto``: the number with the least noise at equal cost
    ``gloss_samples``           integer rays into rough lobes at the first hit, 1 to 64, or ``auto``     1
    ``interreflection_samples`` integer rays into diffuse lobes at the first hit, 1 to 64, or ``auto``;  1
                                        of a surface with both kinds of lobes the larger number counts
    ``offset``                  string  where rays leave surfaces: beside them by the ``bound`` of       bound
                                        rounding errors, or as ``mitsuba`` does
    ``direct_light``            string  how rough surfaces find lights: by ``rays``, by samples of the   auto
                                        ``lights``, by ``both``; ``auto``: ``both`` where it pays, if
                                        ``effects`` is ``auto`` too, else ``both``
    ``closed_form``             boolean whether of unoccluded light on diffuse surfaces only what is     auto
                                        missing from it is sampled, where it is known in closed form;
                                        ``auto``: where it pays, if ``effects`` is ``auto`` too
    =========================== ======= ================================================================ =======

    With :math:`f` the BSDF at :math:`x_k` and all effects on it estimates the rendering equation up to ``max_depth``,

    .. math::
        L(x_k) = L_e(x_k) + \int f L_e V \cos\theta \, d\omega + \int f \cos\theta \, L(x_{k+1}) \, d\omega

    averaged over pixel, lens and shutter. Emitters are sampled at each vertex: all infinite ones, and one of the
    bounded ones, chosen by its unshadowed contribution; rough lobes look for them too. Specular chains from the eye
    may be a tree before they are paths.

    * Estimates: E (S | D)* L in Heckbert's notation, what ``path`` does. Light passes straight through null, mask and
      thin surfaces, as in ``volpath``, and such passages don't count for ``max_depth``.
    * Does not estimate: participating media, polarisation.
    * Bias: none with all effects on. What leaving an effect out does is told in ``docs/effects.md``; ``auto`` leaves
      out what changes the picture by less than 1e-4 of its mean, with 95 % confidence.
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
        self.offset = props.get("offset", "bound")
        check_rule(self.offset)
        self.effects = effects.parse(props.get("effects", "auto"))
        self.tree_depth = props.get("tree_depth", 0)
        self.samples = {name: props.get(name, 1) for name in SAMPLES}
        self.direct_light = props.get("direct_light", "auto")
        if self.direct_light not in ("auto", *effects.TECHNIQUES):
            raise UsageError(
                f"direct_light is {self.direct_light!r}; accepted are auto, {', '.join(effects.TECHNIQUES)}"
            )
        self.closed_form = props.get("closed_form", "auto")
        if self.closed_form not in ("auto", True, False):
            raise UsageError(f"closed_form is {self.closed_form!r}; accepted are auto, true and false")
        _check("max_depth", self.max_depth, -1, 2**31 - 1)
        _check("rr_depth", self.rr_depth, 1, 2**31 - 1)
        _check("tree_depth", self.tree_depth, 0, 64)
        for name, value in self.samples.items():
            if value != "auto":
                _check(name, value, 1, MAX_SAMPLES, " and auto")

    @denormals.flushed()
    def plan(self, world, sensor=None, name="scene"):
        """Return the `effects.Plan` of a ``World`` seen by a sensor; without one nothing is measured."""
        pilot = Pilot(self, world, sensor) if sensor is not None else None
        found = effects.decide(world, sensor, self.effects, self.max_depth, name, pilot)
        technique, reason = self.technique_of(found), ""
        if pilot is not None and self.effects == self.direct_light == "auto":
            technique, reason = pilot.direct_light(found.effects)
        found = dataclasses.replace(found, direct_light=technique, reason=reason)
        if pilot is not None and self.effects == self.closed_form == "auto":
            found = dataclasses.replace(found, **budget.closed_form(pilot, found))
        if pilot is None or "auto" not in self.samples.values():
            return found
        return dataclasses.replace(found, samples=budget.share_out(pilot, found))

    def fixed(self, plan):
        """Return an integrator that simulates what a plan of this one says, with nothing left to decide."""
        decided = {
            "effects": effects.spell(tuple(plan.effects)),
            "direct_light": self.technique_of(plan),
            "closed_form": self.uses_closed_form(plan),
        }
        return mi.load_dict(self.properties() | decided | self.samples_of(plan))

    def samples_of(self, plan):
        """Return the numbers of samples at the first hit by property, the plan's for `auto`."""
        found = getattr(plan, "samples", {})
        return {
            name: found.get(kind, 1) if self.samples[name] == "auto" else self.samples[name]
            for name, kind in SAMPLES.items()
        }

    def technique_of(self, plan):
        """Return how rough surfaces find lights, one of `effects.TECHNIQUES`."""
        return getattr(plan, "direct_light", None) or (
            "both" if self.direct_light == "auto" else self.direct_light
        )

    def uses_closed_form(self, plan):
        """Return whether unoccluded light is taken in closed form where it is known."""
        decided = getattr(plan, "closed_form", None)
        return self.closed_form in ("auto", True) if decided is None else decided

    def world(self, scene):
        """Return the ``World`` of an ``mi.Scene`` in which rays are traced."""
        return World(scene, self.hide_emitters, self.offset)

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
            return Paths(self, world, ray, draws, plan).trace(mi.Bool(active) & (self.max_depth != 0))

    def sample(self, scene, sampler, ray, medium=None, active=True):
        """Estimate the radiance along ``ray``, as Mitsuba's integrators do when they are nested."""
        world = self.world(scene)
        found = self.estimate(world, mi.Ray3f(ray), SamplerDraws(sampler), self.plan(world), active)
        return tracing.contained(found["radiance"]), active & (found["alpha"] > 0), []

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
        names = (
            "max_depth",
            "rr_depth",
            "hide_emitters",
            "tree_depth",
            "direct_light",
            "closed_form",
            "offset",
        )
        values = {name: getattr(self, name) for name in names} | self.samples
        return {"type": "distribution", "effects": effects.spell(self.effects)} | values

    def to_string(self):
        """Return the parameters on one line."""
        values = list(self.properties().items())[1:]
        return f"DistributionIntegrator[{', '.join(f'{name}={value}' for name, value in values)}]"


def _check(name, value, lowest, highest, besides=""):
    if not (isinstance(value, int) and lowest <= value <= highest):
        raise UsageError(f"{name} is {value}; accepted are whole numbers from {lowest} to {highest}{besides}")


mi.register_integrator("distribution", DistributionIntegrator)
