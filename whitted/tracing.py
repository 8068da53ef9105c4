"""One pass of samples: by our integrators, with our own eye rays, sequences and sums; or by Mitsuba's.

Both kinds of passes have ``run(start, stop)``, ``moments()``, and what was counted on the way.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import _backend, denormals
from whitted.film import BLOCK, Grid, Sums, colours, cropped, eye_rays
from whitted.results import Truncation
from whitted.sampling.groups import SEGMENTS, Replicates
from whitted.stats.moments import Moments
from whitted.world import KINDS

LANES = 1 << 21  # of one pass: enough to fill the machine, 100 MB of samples
MAX_SPP = 1 << 31


class TreePasses:
    """Passes of one of our integrators: our eye rays, our sequences, our sums.

    Args:
        integrator: has ``estimate(world, ray, draws, plan, active)``.
        world: ``World``.
        sensor: ``mi.Sensor``; its film gives size and filter.
        plan: `whitted.effects.Plan`, what is simulated.
        window: the pixels wanted, ``Window``.
        groups: ``Segments`` or ``Replicates``.
        encode: from radiance (``Spectrum``), alpha (``Float``), and ray to a list of values to sum up.
        channels: the length of that list.
        counted: whether rays are.
    """

    def __init__(self, integrator, world, sensor, plan, window, groups, encode, channels, counted=True):
        self.integrator, self.world, self.sensor, self.plan = integrator, world, sensor, plan
        self.groups, self.encode = groups, encode
        film = sensor.film()
        self.size = tuple(int(n) for n in film.size())
        self.sums = Sums(window, film.rfilter(), channels)
        self.source = window.grown(self.sums.border, self.size, beyond=film.sample_border())
        self.rays = dict.fromkeys(KINDS if counted else (), 0)
        self.truncation = None
        self.drawn = set()  # the effects for which numbers were drawn

    @property
    def lanes(self):
        """Lanes of a pass of one sample in each pixel."""
        return Grid(self.source, 0, 1).lanes

    @denormals.flushed()
    def run(self, start, stop):
        """Take the samples ``start`` to ``stop`` of each pixel."""
        grid = Grid(self.source, start, stop)
        with dr.suspend_grad():
            ray, weight, draws, offset, active = eye_rays(
                self.sensor, self.size, grid, self.groups, self.plan
            )
            world = self.world
            world.count_rays(bool(self.rays))
            found = self.integrator.estimate(world, ray, draws, self.plan, active)
            given_up = [name for name in Truncation.NAMES if name in found]
            for name in given_up:  # what is only measured must not cost the picture a sample
                found[name] = dr.select(dr.isfinite(found[name]), found[name], 0)
            values = self.encode(found, weight, ray)
            tally = dr.zeros(mi.UInt32, len(self.rays))
            for number, kind in enumerate(self.rays):
                dr.scatter_reduce(dr.ReduceOp.Add, tally, world.rays[kind], mi.UInt32(number), active)
            losses = [dr.zeros(mi.Float, grid.lanes // BLOCK**2) for _ in given_up]
            block = dr.arange(mi.UInt32, grid.lanes) // BLOCK**2
            for name, loss in zip(given_up, losses, strict=True):
                dr.scatter_reduce(dr.ReduceOp.Add, loss, found[name], block, active)
            self.drawn = draws.drawn
            dr.eval(values, offset if self.sums.border else None, losses, tally)
            self.sums.add(grid, self.groups.pieces(start, stop), values, offset)
        for kind, count in zip(self.rays, tally.numpy(), strict=True):
            self.rays[kind] += int(count)
        if given_up:
            self.truncation = self.truncation or Truncation()
            self.truncation.add(grid.lanes, *(loss.numpy() for loss in losses))

    def moments(self, release=False):
        """Return the ``Moments`` of the samples so far; with ``release``, for the last time."""
        return Moments(*self.sums.arrays(release))

    @property
    def nonfinite(self):
        """How many samples of the window weren't finite and were left out."""
        return int(dr.sum(self.sums.nonfinite)[0])

    def diagnosis(self, start, stop):
        """Return the `whitted.diagnosis.Diagnosis` of the samples of a range that weren't finite, None without any."""
        if not self.nonfinite:
            return None
        from whitted.diagnosis import diagnose

        return diagnose(self, start, stop)


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

    def diagnosis(self, start, stop):
        """Return None: these integrators don't tell where a value comes from."""

    @property
    def groups(self):
        """How samples are shared out: by pass."""
        return self

    def end(self, start, wanted):
        """Return where a pass that begins at ``start`` has to end at the latest."""
        return start + min(wanted, self.share)

    @denormals.flushed()
    def run(self, start, stop):
        """Take as many samples as there are from ``start`` to ``stop``, as one group's."""
        samples = stop - start
        # Far apart: close seeds repeat stratified patterns
        seed = (100003 * start + 7919 * self.seed) % 2**32
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

    world = integrator.world(scene)
    plan = integrator.plan(world, sensor)
    with cropped(sensor) as window:
        count = channels if special else channels - 1
        groups = Replicates(_as_int(seed), 1)
        passes = TreePasses(integrator, world, sensor, plan, window, groups, encode, count, counted=False)
        step = samples_per_pass(passes.lanes)
        for start in range(0, spp, step):
            passes.run(start, min(start + step, spp))
    sums, weights = passes.sums.arrays(release=True)
    values = sums[0] if special else np.concatenate([sums[0], weights[0][..., None]], axis=-1)
    film.put_block(
        mi.ImageBlock(mi.TensorXf(values.astype(np.float32)), mi.ScalarPoint2i(window.x, window.y))
    )
    return film.develop() if develop else mi.TensorXf()


def contained(L):
    """Return radiance (``Spectrum``) with 0 where it isn't finite: Mitsuba's integrators put all on the film."""
    return dr.select(dr.all(dr.isfinite(L)), L, 0)


def samples_per_pass(lanes):
    """The largest power of two of samples per pixel with which a pass stays within ``LANES``."""
    return 1 << (max(LANES // lanes, 1).bit_length() - 1)


def _as_int(seed):
    return int(np.ravel(seed)[0])
