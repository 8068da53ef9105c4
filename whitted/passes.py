"""The pass loop: a render is made of passes, each a range of samples of all its pixels, until a limit is met.

Memory doesn't grow with the number of samples: a pass has a bounded number of lanes, and only sums are kept.
"""

import math
import time as clock
import warnings
from contextlib import contextmanager, nullcontext

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import _backend
from whitted.errors import UsageError
from whitted.film import BLOCK, Grid, Sums, Window, colours, cropped, eye_rays
from whitted.interrupt import stop_on_signals
from whitted.progress import Progress, bar
from whitted.results import Render, Truncation
from whitted.sampling.groups import SEGMENTS, Replicates, Segments
from whitted.scene import as_scene
from whitted.scene import integrator as as_integrator
from whitted.stats.moments import Moments
from whitted.world import KINDS, World

LANES = 1 << 21  # of one pass: enough to fill the machine, 100 MB of samples
PASS_SECONDS = 0.5  # of a pass under a time budget, which can be overrun by one pass
MAX_SPP = 1 << 31

__all__ = ["Render", "fill_film", "render"]


class TreePasses:
    """Passes of one of our integrators: our eye rays, our sequences, our sums.

    Args:
        integrator: has ``estimate(world, ray, draws, active)`` and ``hide_emitters``.
        scene: ``mi.Scene``.
        sensor: ``mi.Sensor``; its film gives size and filter.
        window: the pixels wanted, ``Window``.
        groups: ``Segments`` or ``Replicates``.
        encode: from radiance (``Spectrum``), alpha (``Float``), and ray to a list of values to sum up.
        channels: the length of that list.
    """

    def __init__(self, integrator, scene, sensor, window, groups, encode, channels):
        self.integrator, self.scene, self.sensor, self.groups, self.encode = (
            integrator,
            scene,
            sensor,
            groups,
            encode,
        )
        film = sensor.film()
        self.size = tuple(int(n) for n in film.size())
        self.sums = Sums(window, film.rfilter(), channels)
        self.source = window.grown(self.sums.border, self.size, beyond=film.sample_border())
        self.rays = dict.fromkeys(KINDS, 0)
        self.truncation = Truncation()

    @property
    def lanes(self):
        """Lanes of a pass of one sample in each pixel."""
        return Grid(self.source, 0, 1).lanes

    def run(self, start, stop):
        """Take the samples ``start`` to ``stop`` of each pixel."""
        grid = Grid(self.source, start, stop)
        with dr.suspend_grad():
            ray, weight, draws, offset, active = eye_rays(self.sensor, self.size, grid, self.groups)
            world = World(self.scene, self.integrator.hide_emitters)
            found = self.integrator.estimate(world, ray, draws, active)
            for name in Truncation.NAMES:  # what is only measured must not cost the picture a sample
                found[name] = dr.select(dr.isfinite(found[name]), found[name], 0)
            values = self.encode(found, weight, ray)
            tally = dr.zeros(mi.UInt32, len(KINDS))
            for number, kind in enumerate(KINDS):
                dr.scatter_reduce(dr.ReduceOp.Add, tally, world.rays[kind], mi.UInt32(number), active)
            losses = [dr.select(active, found[name], 0) for name in Truncation.NAMES]
            dr.eval(values, offset if self.sums.border else None, losses, tally)
            self.sums.add(grid, self.groups.pieces(start, stop), values, offset)
        for kind, count in zip(KINDS, tally.numpy(), strict=True):
            self.rays[kind] += int(count)
        blocks = [
            dr.block_sum(loss, BLOCK**2).numpy() for loss in losses
        ]  # after dr.eval, else it runs all again
        self.truncation.add(grid.lanes, *blocks)

    def moments(self, release=False):
        """Return the ``Moments`` of the samples so far; with ``release``, for the last time."""
        return Moments(*self.sums.arrays(release))

    @property
    def nonfinite(self):
        """How many samples of the window weren't finite and were left out."""
        return int(dr.sum(self.sums.nonfinite)[0])


class MitsubaPasses:
    """Passes of any other integrator of Mitsuba, which fills the film itself; each is independent of the others.

    Args:
        integrator, scene, sensor: objects of Mitsuba.
        window: the pixels wanted, ``Window``.
        seed: ``int``.
        replicates: passes at least, between which the error is taken. With 1 a pass is as large as fits, so that a
            stratified sampler isn't hurt; of a single pass the error isn't known.
        spp: samples per pixel asked for, or None.
    """

    kind = "replicates"

    def __init__(self, integrator, scene, sensor, window, seed, replicates, spp):
        self.integrator, self.scene, self.sensor, self.window = integrator, scene, sensor, window
        self.seed, self.lanes = seed, window.pixels
        self.count = replicates if replicates > 1 else SEGMENTS
        self.share = -(-spp // replicates) if spp else MAX_SPP
        self.total, self.weights = {}, {}
        self.rays, self.truncation, self.nonfinite = {}, None, 0

    @property
    def groups(self):
        """How samples are shared out: by pass."""
        return self

    def end(self, start, wanted):
        """Return where a pass that begins at ``start`` has to end at the latest."""
        return start + min(wanted, self.share)

    def run(self, start, stop):
        """Take as many samples as there are from ``start`` to ``stop``, as one group's."""
        samples = stop - start
        seed = (
            100003 * start + 7919 * self.seed
        ) % 2**32  # far apart: close seeds repeat stratified patterns
        with cropped(self.sensor, self.window):
            image = np.array(
                self.integrator.render(self.scene, self.sensor, seed=seed, spp=samples), np.float64
            )
        radiance = image[..., : 1 if image.shape[-1] < 3 else 3]
        finite = np.isfinite(radiance).all(-1, keepdims=True)
        self.nonfinite += int((~finite).sum()) * samples
        group = len(self.weights) % self.count if len(self.weights) < self.count else self._emptiest()
        self.total[group] = self.total.get(group, 0) + np.where(finite, radiance, 0) * samples
        self.weights[group] = self.weights.get(group, 0) + finite[..., 0] * float(samples)

    def _emptiest(self):
        return min(self.weights, key=lambda group: (self.weights[group].max(), group))

    def moments(self, release=False):
        """Return the ``Moments`` of the samples so far; with ``release``, for the last time."""
        order = sorted(self.total)
        return Moments(np.stack([self.total[g] for g in order]), np.stack([self.weights[g] for g in order]))


def fill_film(integrator, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
    """Render with one of our integrators into the sensor's film: what ``mi.Integrator.render`` does.

    Args:
        integrator: see ``TreePasses``.
        scene: ``mi.Scene``.
        sensor: ``mi.Sensor`` or its number.
        seed: ``int``.
        spp: samples per pixel; 0 takes the sampler's.
        develop: return the developed image, rather than only fill the film.
        evaluate: has no effect: sums are evaluated pass by pass.

    Returns:
        ``TensorXf`` [H, W, C] as the film develops it; empty if ``develop`` is false.
    """
    _backend.check(mi.variant())
    sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
    film = sensor.film()
    spp = spp or sensor.sampler().sample_count()
    channels = film.prepare(integrator.aov_names())
    special = mi.has_flag(film.flags(), mi.FilmFlags.Special)
    alpha = mi.has_flag(film.flags(), mi.FilmFlags.Alpha)

    def encode(found, weight, ray):
        L = found["radiance"] * weight
        if special:
            return film.prepare_sample(L, ray.wavelengths, channels, weight=1, alpha=found["alpha"])
        return [*colours(L, ray.wavelengths, 3), *([found["alpha"]] if alpha else [])]

    with cropped(sensor) as window:
        count = channels if special else channels - 1
        passes = TreePasses(integrator, scene, sensor, window, Replicates(_as_int(seed), 1), encode, count)
        step = _samples_per_pass(passes.lanes)
        for start in range(0, spp, step):
            passes.run(start, min(start + step, spp))
    sums, weights = passes.sums.arrays(release=True)
    values = sums[0] if special else np.concatenate([sums[0], weights[0][..., None]], axis=-1)
    film.put_block(
        mi.ImageBlock(mi.TensorXf(values.astype(np.float32)), mi.ScalarPoint2i(window.x, window.y))
    )
    return film.develop() if develop else mi.TensorXf()


def render(
    scene,
    integrator=None,
    *,
    spp=None,
    time=None,
    target_error=None,
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
        seed: ``int``; the same seed gives the same bits with one of our integrators.
        replicates: number of independent randomisations between which the error is taken; 1 keeps one
            sequence whole, which is less noisy, and takes an upper bound of the error from its segments.
        sensor: the sensor's number.
        crop: x, y, width, height in pixels of a part of the film; None takes the film's crop.
        resume: a ``Render`` with the same settings, to which samples are added (``spp`` more; by default as many
            as it still lacks, else as many as it was asked for).
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
    camera = scene.mitsuba.sensors()[sensor]
    ours = hasattr(integrator, "estimate")
    effects = (
        integrator.effects(World(scene.mitsuba), camera) if ours else []
    )  # and refuse what can't be rendered
    _check_limits(spp, time, target_error, replicates)
    if spp is None and time is None and target_error is None and resume is None:
        spp = camera.sampler().sample_count()

    with _window(camera, crop) as window:
        passes = _passes(integrator, scene.mitsuba, camera, window, seed, replicates, spp)
        settings = _settings(scene, integrator, camera, window, seed, replicates, passes) | {
            "effects": effects
        }
        first, goal = _range(resume, settings, spp)
        for warning in [*([note] if note else []), *_warnings(scene, integrator)]:
            warnings.warn(warning, stacklevel=2)
        with (
            stop_on_signals() as stopped,
            bar(scene.name) if progress is True else nullcontext(progress) as report,
        ):
            loop = _Loop(passes, first, goal, time, target_error, report, resume)
            loop.run(stopped)
        return loop.result(settings, clock.perf_counter() - start_time, scene.load_seconds, goal - first)


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
        """Run passes until a limit is met or ``stopped()`` says so."""
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
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
        if self.spp > self.first and self.limit is not None and self.wall - self.compile >= self.limit:
            return True
        self.reached = (
            self.target_error is not None and self.error is not None and self.error <= self.target_error
        )
        return self.reached

    def _pass(self):
        wanted = min(_samples_per_pass(self.passes.lanes), self.goal - self.spp)
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

    def result(self, settings, total, load, requested):
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
            requested=requested if self.goal < MAX_SPP else None,
            rays=passes.rays,
            seconds=seconds,
            kernel={"operations": self.operations, "cache_hit": self.cache_hit},
            truncation=passes.truncation,
            nonfinite=passes.nonfinite,
            partial=self.stopped or (missed and not self.reached),
            **settings,
        )


def _passes(integrator, scene, sensor, window, seed, replicates, spp):
    """The passes of an integrator: ours, or Mitsuba's."""
    if not hasattr(integrator, "estimate"):
        return MitsubaPasses(integrator, scene, sensor, window, seed, replicates, spp)
    groups = Replicates(seed, replicates) if replicates > 1 else Segments(seed)
    channels = 1 if mi.is_monochromatic else 3

    def encode(found, weight, ray):
        radiance = colours(found["radiance"] * weight, ray.wavelengths, channels)
        return [*radiance, found["alpha"], found["lost_by_depth"] + found["lost_by_cutoff"]]

    return TreePasses(integrator, scene, sensor, window, groups, encode, channels + 2)


def _warnings(scene, integrator):
    """What a user should know of a scene before looking at its picture."""
    if not scene.mitsuba.emitters():
        yield f"scene '{scene.name}' has no emitter: the picture is black"
    if hasattr(integrator, "estimate") and any(
        shape.is_medium_transition() for shape in scene.mitsuba.shapes()
    ):
        yield f"scene '{scene.name}' has participating media, which are ignored"


def _settings(scene, integrator, sensor, window, seed, replicates, passes):
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
    }


def _range(resume, settings, spp):
    """The first sample's number and that after the last."""
    if resume is None:
        return 0, spp or MAX_SPP
    for name in ("scene_hash", "integrator", "variant", "window", "size", "seed", "replicates"):
        before, now = getattr(resume, name), settings[name]
        if before != now:
            raise UsageError(f"can't continue: the earlier render has {name} {before}, this one {now}")
    asked = resume.requested or MAX_SPP
    missing = asked - resume.spp if resume.partial and resume.requested else asked
    return resume.spp, min(resume.spp + (spp or max(missing, 1)), MAX_SPP)


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


@contextmanager
def _window(sensor, crop):
    """Undo the film's crop for a while; yield the ``Window`` of the crop wanted, else the film's."""
    with cropped(sensor) as window:
        if crop is not None:
            window = Window(*(int(n) for n in crop))
            width, height = (int(n) for n in sensor.film().size())
            fits = 0 <= window.x < window.x + window.width <= width
            if not (fits and 0 <= window.y < window.y + window.height <= height):
                raise UsageError(
                    f"crop {','.join(map(str, crop))} doesn't lie in the film of {width}x{height} pixels"
                )
        yield window


def _samples_per_pass(lanes):
    """The largest power of two of samples per pixel with which a pass stays within ``LANES``."""
    return 1 << (max(LANES // lanes, 1).bit_length() - 1)


def _relative_error(moments):
    """Root mean square of the standard errors divided by the picture's mean, or None."""
    count = 1 if mi.is_monochromatic else 3  # alpha and losses are no part of the picture
    moments = Moments(moments.sums[..., :count], moments.weights)
    stderr = moments.standard_error()
    if stderr is None:
        return None
    mean = float(np.mean(moments.mean()))
    return float(np.sqrt(np.mean(np.square(stderr, dtype=np.float64)))) / mean if mean > 0 else None


def _as_int(seed):
    return int(np.ravel(seed)[0])


def _one_line(thing):
    return " ".join(str(thing).split())
