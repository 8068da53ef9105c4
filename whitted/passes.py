"""The pass loop: a render is made of passes, each a range of samples of all its pixels, until a limit is met.

Memory doesn't grow with the number of samples: a pass has a bounded number of lanes, and only sums are kept.
"""

import math
import time as clock
import warnings
from contextlib import nullcontext

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import _backend
from whitted.effects import chosen
from whitted.errors import UsageError
from whitted.film import colours, windowed
from whitted.interrupt import stop_on_signals
from whitted.progress import Progress, bar
from whitted.results import Render
from whitted.sampling.groups import SEGMENTS, Replicates, Segments
from whitted.scene import as_scene
from whitted.scene import integrator as as_integrator
from whitted.stats.moments import root_mean_square
from whitted.tracing import MAX_SPP, MitsubaPasses, TreePasses, samples_per_pass

PASS_SECONDS = 0.5  # of a pass under a time budget, which can be overrun by one pass

__all__ = ["Render", "render"]


def render(
    scene,
    integrator=None,
    *,
    spp=None,
    time=None,
    target_error=None,
    effects=None,
    seed=0,
    replicates=1,
    sensor=0,
    crop=None,
    resume=None,
    progress=None,
):
    """Render a picture with its standard error, until the first of the given limits is met.

    SIGINT and SIGTERM end it after the pass at hand; what is there is returned and marked as partial.

    Args:
        scene: ``Scene``, ``mi.Scene``, a path, or the name of a shipped scene.
        integrator: ``"NAME[:key=value,...]"``, a dict, an ``mi.Integrator``, or None for the scene's own.
        spp: samples per pixel, 1 or more; where no limit is given, the scene's.
        time: seconds of rendering after the kernel is compiled; overrun by one pass at most.
        target_error: root mean square error of the picture as estimated, divided by the picture's mean. Rare
            bright samples that haven't come up yet aren't in the estimate.
        effects: ``"auto"``, ``"all"`` or names, for an integrator that has a choice; None takes its own.
        seed: ``int``; the same seed gives the same bits with one of our integrators.
        replicates: number of independent randomisations between which the error is taken; 1 keeps one
            sequence whole, which is less noisy, and takes an upper bound of the error from its segments.
        sensor: the sensor's number.
        crop: x, y, width, height in pixels of a part of the film; None takes the film's crop.
        resume: a ``Render`` with the same settings, to which samples are added: ``spp`` more; where no limit is
            given as many as it still lacks, else as many as it has.
        progress: is called with the ``Progress`` after each pass; True shows a bar on a terminal.

    Returns:
        ``Render``.

    Raises:
        UsageError: an argument is out of range, or the scene can't be rendered.
        BackendError: there is no usable LLVM.
    """
    start_time = clock.perf_counter()
    scene = as_scene(scene)
    _backend.check(mi.variant())
    integrator, note = as_integrator(integrator, scene.mitsuba)
    integrator = chosen(integrator, effects)
    camera = scene.mitsuba.sensors()[sensor]
    world = plan = None
    _check_limits(spp, time, target_error, replicates)
    if spp is None and time is None and target_error is None and resume is None:
        spp = camera.sampler().sample_count()

    if hasattr(integrator, "estimate"):
        world = integrator.world(scene.mitsuba)  # refuses what it can't render
        plan = integrator.plan(world, camera, scene.name)
    with windowed(camera, crop) as window:
        if world is None:
            passes = MitsubaPasses(integrator, scene.mitsuba, camera, window, seed, replicates, spp)
        else:
            passes = _passes(integrator, world, camera, plan, window, seed, replicates)
        settings = _settings(scene, integrator, camera, window, seed, replicates, passes, plan)
        has_other_limit = time is not None or target_error is not None
        first, goal = _range(resume, settings, spp, has_other_limit)
        for warning in [*([note] if note else []), *_warnings(scene, integrator)]:
            warnings.warn(warning, stacklevel=2)
        with (
            stop_on_signals() as stopped,
            bar(scene.name) if progress is True else nullcontext(progress) as report,
        ):
            loop = _Loop(passes, first, goal, time, target_error, report, resume)
            loop.run(stopped)
        return loop.result(settings, clock.perf_counter() - start_time, scene.load_seconds)


class _Loop:
    """One run of passes, with what was measured of it."""

    def __init__(self, passes, first, goal, seconds, target_error, progress, earlier):
        self.passes, self.first, self.goal = passes, first, goal
        self.limit, self.target_error, self.progress = seconds, target_error, progress
        self.earlier = earlier.moments if earlier else None
        self.spp, self.wall, self.compile, self.execute = first, 0.0, 0.0, 0.0
        self.operations, self.cache_hit = 0, True
        self.error, self.checked, self.count = None, 0, 0
        self.reached = False

    def run(self, stopped):
        """Run passes, at least one, until a limit is met or ``stopped()`` says so."""
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            self._pass()
            while not self._done() and not stopped():
                self._pass()
        self.stopped = stopped()

    def moments(self, release=False):
        """Return the moments of all samples, an earlier render's included."""
        moments = self.passes.moments(release)
        return moments if self.earlier is None else self.earlier + moments

    def _done(self):
        if self.spp >= self.goal:
            return True
        if self.limit is not None and self.wall - self.compile >= self.limit:
            return True
        self.reached = (
            self.target_error is not None and self.error is not None and self.error <= self.target_error
        )
        return self.reached

    def _pass(self):
        wanted = min(samples_per_pass(self.passes.lanes), self.goal - self.spp)
        if self.target_error is not None:
            wanted = min(wanted, max(self.spp, SEGMENTS))  # look early, and each time twice as far
        if self.limit is not None:
            taken = self.spp - self.first
            rate = (self.wall - self.compile) / taken if taken else math.inf
            left = max(self.limit - (self.wall - self.compile), 0)
            wanted = max(1, min(wanted, int(min(PASS_SECONDS, left) / rate) if taken else 1))
        stop = self.passes.groups.end(self.spp, wanted)
        begin = clock.perf_counter()
        self.passes.run(self.spp, stop)
        self.wall += clock.perf_counter() - begin
        self._read_history()
        self.spp = stop
        self.count += 1
        if self.progress or self.target_error is not None:
            self._report()

    def _read_history(self):
        for kernel in dr.kernel_history((dr.KernelType.JIT,)):
            self.compile += (kernel["codegen_time"] + kernel["backend_time"]) / 1000
            self.execute += kernel["execution_time"] / 1000
            self.operations = max(self.operations, kernel["operation_count"])
            self.cache_hit &= bool(kernel["cache_hit"])

    def _report(self):
        if self.spp >= 1.25 * self.checked:  # looking costs about as much as a sample
            self.checked = self.spp
            self.error = _relative_error(self.moments())
        if self.progress:
            fractions = [0.0]
            if self.goal < MAX_SPP:
                fractions.append((self.spp - self.first) / (self.goal - self.first))
            if self.limit is not None:
                fractions.append((self.wall - self.compile) / self.limit)
            if self.target_error is not None and self.error:
                fractions.append((self.target_error / self.error) ** 2)
            goal = self.goal if self.goal < MAX_SPP else None
            fraction = min(max(fractions), 1.0)
            self.progress(Progress(self.count, self.spp, goal, self.wall, self.error, fraction))

    def result(self, settings, total, load):
        """Return the ``Render``."""
        passes = self.passes
        seconds = {
            "load": load,
            "trace": max(self.wall - self.compile - self.execute, 0.0),
            "compile": self.compile,
            "execute": self.execute,
            "total": total,
        }
        missed = self.spp < self.goal < MAX_SPP or (self.target_error is not None and not self.reached)
        return Render(
            moments=self.moments(release=True),
            spp=self.spp,
            requested=self.goal if self.goal < MAX_SPP else None,
            rays=passes.rays,
            seconds=seconds,
            kernel={"operations": self.operations, "cache_hit": self.cache_hit},
            truncation=passes.truncation,
            nonfinite=passes.nonfinite,
            diagnosis=passes.diagnosis(self.first, self.spp),
            partial=self.stopped or (missed and not self.reached),
            **settings,
        )


def _passes(integrator, world, sensor, plan, window, seed, replicates):
    """The passes of one of our integrators."""
    groups = Replicates(seed, replicates) if replicates > 1 else Segments(seed)
    channels = 1 if mi.is_monochromatic else 3
    is_full = world.has_environment  # then no pixel is empty

    def encode(found, weight, ray):
        radiance = colours(found["radiance"] * weight, ray.wavelengths, channels)
        lost = found.get("lost_by_depth", mi.Float(0)) + found.get("lost_by_cutoff", mi.Float(0))
        return [*radiance, lost] if is_full else [*radiance, lost, found["alpha"]]

    count = channels + (1 if is_full else 2)
    return TreePasses(integrator, world, sensor, plan, window, groups, encode, count)


def _warnings(scene, integrator):
    """What a user should know of a scene before looking at its picture."""
    yield from scene.notes
    if not scene.mitsuba.emitters():
        yield f"scene '{scene.name}' has no emitter: the picture is black"
    if hasattr(integrator, "estimate") and any(
        shape.is_medium_transition() for shape in scene.mitsuba.shapes()
    ):
        yield f"scene '{scene.name}' has participating media, which are ignored"


def _settings(scene, integrator, sensor, window, seed, replicates, passes, plan):
    """What a render was made of, as far as it doesn't depend on how far it got."""
    return {
        "scene": scene.name,
        "scene_hash": scene.hash,
        "integrator": _one_line(integrator),
        "variant": mi.variant(),
        "window": window,
        "size": tuple(int(n) for n in sensor.film().size()),
        "seed": seed,
        "replicates": replicates,
        "error_kind": passes.groups.kind,
        "plan": plan,
    }


def _range(resume, settings, spp, has_other_limit):
    """The first sample's number and that after the last."""
    if resume is None:
        return 0, spp or MAX_SPP
    for name in ("scene_hash", "integrator", "variant", "window", "size", "seed", "replicates"):
        before, now = getattr(resume, name), settings[name]
        if before != now:
            raise UsageError(f"can't continue: the earlier render has {name} {before}, this one {now}")
    if spp is None and has_other_limit:
        return resume.spp, MAX_SPP
    lacking = resume.requested - resume.spp if resume.partial and resume.requested else resume.spp
    return resume.spp, min(resume.spp + (spp or lacking), MAX_SPP)


def _check_limits(spp, time, target_error, replicates):
    if spp is not None and not 1 <= spp < MAX_SPP:
        raise UsageError(f"spp is {spp}; accepted are 1 to {MAX_SPP - 1}")
    if time is not None and not 0 < time < math.inf:
        raise UsageError(f"time is {time}; accepted are seconds above 0")
    if target_error is not None and not 0 < target_error < math.inf:
        raise UsageError(f"target_error is {target_error}; accepted are numbers above 0")
    if not 1 <= replicates <= 1024:
        raise UsageError(f"replicates is {replicates}; accepted are 1 to 1024")
    if spp is not None and replicates > spp:
        raise UsageError(f"replicates is {replicates}, more than the {spp} samples per pixel")


def _relative_error(moments):
    """Root mean square of the standard errors divided by the picture's mean, or None."""
    moments = moments.first(1 if mi.is_monochromatic else 3)  # losses and alpha are no part of the picture
    stderr = moments.standard_error()
    if stderr is None:
        return None
    mean = float(np.mean(moments.mean()))
    return root_mean_square(stderr) / mean if mean > 0 else None


def _one_line(thing):
    return " ".join(str(thing).split())
