"""What a scene calls for, what each effect costs, and whether leaving out the rest changed anything."""

import dataclasses
import statistics

import drjit as dr
import mitsuba as mi

from whitted import _backend, effects
from whitted.comparison import check
from whitted.film import cropped
from whitted.sampling.groups import Segments
from whitted.scene import as_scene
from whitted.scene import integrator as as_integrator
from whitted.tracing import TreePasses

LANES = 1 << 19  # of a timed pass: some tens of milliseconds
TURNS = 15  # passes with and without an effect, in turn
__all__ = ["plan", "verify"]


def plan(scene, integrator=None, *, sensor=0, costs=True):
    """Decide which effects a scene calls for, as a `whitted.effects.Plan`.

    Args:
        scene: ``Scene``, ``mi.Scene``, a path, or the name of a shipped scene.
        integrator: as for ``whitted.render``.
        sensor: the sensor's number.
        costs: also measure what each effect adds to the kernel and to its time, and what all effects take, which
            compiles a kernel for each.

    Raises:
        UsageError: the integrator has no effects, or the scene can't be rendered.
    """
    scene = as_scene(scene)
    _backend.check(mi.variant())
    integrator = _with_choice(integrator, scene.mitsuba)
    world = integrator.world(scene.mitsuba)
    camera = scene.mitsuba.sensors()[sensor]
    found = integrator.plan(world, camera, scene.name)
    return _with_costs(found, integrator, world, camera) if costs else found


def verify(scene, integrator=None, *, sensor=0, **limits):
    """Check that the picture with what the scene calls for is that with all effects, as an `Agreement`.

    Args:
        scene, integrator, sensor: as for `plan`.
        limits: ``spp``, ``time``, ``seed``, ``tolerance`` and so on, as for ``whitted.check``.
    """
    scene = as_scene(scene)
    integrator = _with_choice(integrator, scene.mitsuba)
    return check(scene, integrator, effects.chosen(integrator, "all"), sensor=sensor, **limits)


def _with_choice(spec, scene):
    """The integrator asked for; where none was, the scene's own or one of its depth that has a choice of effects."""
    integrator, _ = as_integrator(spec, scene)
    if spec is None and not hasattr(integrator, "effects"):
        integrator = mi.load_dict({"type": "distribution", "max_depth": int(integrator.max_depth)})
    effects.check_choice(integrator)
    return integrator


def _with_costs(found, integrator, world, sensor):
    """The plan with what each effect that is called for adds to the kernel, and its share of the time."""
    alternatives = {effect: found.without([effect], "left out") for effect in found.effects}
    everything = effects.decide(world, sensor, "all")
    with cropped(sensor) as window:
        whole = _Timed(integrator, world, sensor, found, window)
        all_of_them = _Timed(integrator, world, sensor, everything, window)
        others = {e: _Timed(integrator, world, sensor, plan, window) for e, plan in alternatives.items()}
        for _ in range(TURNS):
            for timed in (whole, all_of_them, *others.values()):
                timed.run()
    costs = {
        effect: {
            "operations": whole.operations - timed.operations,
            "share_of_time": 1 - statistics.median(timed.seconds) / statistics.median(whole.seconds),
        }
        for effect, timed in others.items()
    }
    findings = tuple(
        dataclasses.replace(finding, cost=costs.get(finding.effect)) for finding in found.findings
    )
    kernel = {
        "operations": whole.operations,
        "operations_of_all": all_of_them.operations,
        "time_to_all": statistics.median(
            own / other for own, other in zip(whole.seconds, all_of_them.seconds, strict=True)
        ),
    }
    return dataclasses.replace(found, findings=findings, kernel=kernel)


class _Timed:
    """Passes with some effects, timed: the largest kernel, which is that of the integrator."""

    def __init__(self, integrator, world, sensor, plan, window):
        def encode(found, weight, ray):
            return list(found["radiance"] * weight)

        count = dr.size_v(mi.Spectrum)
        self.passes = TreePasses(integrator, world, sensor, plan, window, Segments(0), encode, count)
        self.samples = max(LANES // self.passes.lanes, 1)
        self.seconds, self.operations = [], 0
        self.run()  # compiles
        self.seconds.clear()

    def run(self):
        """Take samples once more."""
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            self.passes.run(0, self.samples)
            kernel = max(
                dr.kernel_history((dr.KernelType.JIT,)), key=lambda kernel: kernel["operation_count"]
            )
        self.operations = kernel["operation_count"]
        self.seconds.append(kernel["execution_time"])
