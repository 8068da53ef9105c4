"""Where the noise of a picture comes from: the share of the variance that the draws for each effect cause.

One evaluation of the picture takes some samples per pixel; all its random numbers come from one seed for each effect
that is drawn for. Evaluations with other seeds for one effect at a time give the Sobol' indices of
`whitted.stats.attribution`. With one sample these are the shares of the integrand's variance, whatever the sampler;
with more they are those of the noise that is left after so many low-discrepancy samples, which take off some effects'
noise faster than others'. Left out: Mitsuba's integrators, whose samplers don't tell what a number is for.
"""

import html
import json
from dataclasses import dataclass, field

import mitsuba as mi
import numpy as np

from whitted import _backend, denormals, image
from whitted.effects import chosen
from whitted.errors import UsageError
from whitted.film import luminance, windowed
from whitted.sampling.draws import EFFECTS
from whitted.sampling.groups import Evaluations
from whitted.scene import as_scene
from whitted.scene import integrator as as_integrator
from whitted.stats.attribution import Attribution
from whitted.tracing import LANES, TreePasses

FROZEN = {
    "pixel": "antialiasing",
    "lens": "depth_of_field",
    "time": "motion_blur",
}  # held at the centre without these
# Linear Rec. 709, told apart by people who don't see all colours [OkabeIto2008]
COLOURS = {
    "pixel": (0.093, 0.456, 0.815),
    "lens": (0.0, 0.168, 0.445),
    "time": (0.262, 0.153, 0.031),
    "light": (0.791, 0.347, 0.0),
    "gloss": (0.604, 0.191, 0.386),
    "hemisphere": (0.0, 0.342, 0.171),
    "branch": (0.665, 0.112, 0.0),
    "wavelength": (0.212, 0.212, 0.212),
}
BRIGHT = 95  # percentile of the pixels' standard deviations that is shown at full brightness


@dataclass(frozen=True)
class Shares:
    """The noise shares of a picture.

    Attributes:
        scene, integrator: what was evaluated, text.
        evaluations, spp: how many there were, of so many samples per pixel each.
        variance: of each pixel's luminance in one evaluation, ``float64`` [H, W].
        effects: from the name of each effect that is drawn for to its `whitted.stats.attribution.Share` in the whole
            picture, the largest first.
        interaction: `Interval` of what several effects cause together.
        total, first, error: by effect, [H, W]: the total share of each pixel's variance, that of the effect alone, and
            the standard error of the former; 0 where there is no variance.
    """

    scene: str
    integrator: str
    evaluations: int
    spp: int
    variance: np.ndarray = field(repr=False)
    effects: dict
    interaction: object
    total: dict = field(repr=False)
    first: dict = field(repr=False)
    error: dict = field(repr=False)

    def to_dict(self):
        """Return the numbers of the whole picture for JSON."""
        effects = {name: share.to_dict() for name, share in self.effects.items()}
        names = ("scene", "integrator", "evaluations", "spp")
        facts = {name: getattr(self, name) for name in names}
        return facts | {"effects": effects, "interaction": self.interaction.to_dict()}

    def channels(self):
        """Return the channels of an EXR file: ``share.EFFECT.Y`` (total), ``.first.Y`` and ``.stderr.Y`` of it."""
        made = {}
        for name in self.effects:
            made[f"share.{name}.Y"] = np.float32(self.total[name])
            made[f"share.{name}.first.Y"] = np.float32(self.first[name])
            made[f"share.{name}.stderr.Y"] = np.float32(self.error[name])
        return made

    def picture(self):
        """Return the `whitted.image.Picture`: the false colours, with the channels of `channels` and the numbers."""
        layers = image.layer_channels("", self.false_colour())
        return image.Picture(layers | self.channels(), {"noiseShares": json.dumps(self.to_dict())})

    def false_colour(self):
        """Return linear RGB, ``float32`` [H, W, 3]: what makes a pixel's noise as hue, how much there is as brightness.

        The colours of the effects (``COLOURS``) are mixed by their total shares.
        """
        weights = np.stack(
            [np.clip(self.total[name], 0, 1) for name in self.effects] or [self.variance * 0], axis=-1
        )
        colours = np.array([COLOURS[name] for name in self.effects] or [(0, 0, 0)])
        sums = weights.sum(axis=-1, keepdims=True)
        hue = (weights @ colours) / np.maximum(sums, 1e-9)
        deviation = np.sqrt(self.variance)
        noisy = deviation[deviation > 0]
        full = np.percentile(noisy, BRIGHT) if noisy.size else 1.0
        return (hue * np.minimum(deviation / full, 1)[..., None]).astype(np.float32)

    def write(self, path):
        """Write the picture as EXR.

        Raises:
            UsageError: the file can't be written.
        """
        image.write_exr(path, self.picture())

    def __str__(self):
        rows = [("effect", "with interactions", "alone")]
        rows += [(name, _percent(share.total), _percent(share.first)) for name, share in self.effects.items()]
        rows.append(("interaction", "", _percent(self.interaction)))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        return "\n".join([f"{self.scene}: shares of the variance of {self.spp} spp", *lines])

    def _repr_html_(self):
        from whitted import tonemap

        return f"{tonemap.html_image(self.false_colour())}<pre>{html.escape(str(self))}</pre>"


def noise_shares(
    scene,
    integrator=None,
    *,
    evaluations=64,
    spp=1,
    effects=None,
    freeze=(),
    seed=0,
    sensor=0,
    crop=None,
    progress=None,
):
    """Measure where the noise of a picture comes from.

    Args:
        scene, integrator, effects, crop: as for ``whitted.render``; the integrator has to be one of ours.
        evaluations: pairs of independent pictures, 4 or more; the cost is that of as many times the number of effects
            drawn for and 2 more.
        spp: samples per pixel of an evaluation.
        freeze: names of draws that are held at the centre: ``pixel``, ``lens``, ``time``.
        seed: ``int``.
        sensor: the sensor's number, or an ``mi.Sensor``.
        progress: is called with the evaluations done and wanted.

    Returns:
        `Shares`.

    Raises:
        UsageError: an argument is out of range, or the integrator is one of Mitsuba's.
    """
    scene = as_scene(scene)
    _backend.check(mi.variant())
    made, _ = as_integrator(integrator, scene.mitsuba)
    made = chosen(made, effects)
    if not hasattr(made, "estimate"):
        name = " ".join(str(made).split()).split("[")[0]
        raise UsageError(
            f"noise shares: {name} doesn't tell what its random numbers are for; take one of ours"
        )
    _check(evaluations, spp, freeze)
    camera = scene.mitsuba.sensors()[sensor] if isinstance(sensor, int) else sensor
    world = made.world(scene.mitsuba)
    plan = made.plan(world, camera, scene.name).without([FROZEN[name] for name in freeze], "frozen")
    with windowed(camera, crop) as window, denormals.flushed():
        evaluate = _Evaluate(made, world, camera, plan, window, seed, spp)
        found, done = None, 0
        while done < evaluations:
            count = min(evaluate.batch, evaluations - done)
            count += (evaluations - done - count) == 1  # one alone has no mean to be centred by
            found = evaluate.add(found, done, count)
            done += count
            if progress:
                progress(done, evaluations)
    return _shares(found, scene.name, " ".join(str(made).split()), spp)


class _Evaluate:
    """Batches of evaluations of a picture's luminance."""

    def __init__(self, integrator, world, camera, plan, window, seed, spp):
        self.arguments = integrator, world, camera, plan, window
        self.seed, self.spp = seed, spp
        lanes = self._passes(Evaluations(seed, 2)).lanes
        self.batch = max(min(LANES // (lanes * spp), 64), 4)

    def add(self, found, first, count):
        """Return an `Attribution` with a batch added; the first finds out what is drawn for."""
        a, drawn = self._values(first, count, None)
        b, _ = self._values(first, count, None, swapped=True)
        found = found or Attribution(name for name in EFFECTS if name in drawn)
        found.add(a, b, {name: self._values(first, count, name)[0] for name in found.groups})
        return found

    def _values(self, first, count, effect, swapped=False):
        """The pictures [count, H, W] of evaluations, and the effects that were drawn for."""
        passes = self._passes(Evaluations(self.seed, count, first=first, effect=effect, swapped=swapped))
        step = max(LANES // passes.lanes, 1)
        for start in range(0, count * self.spp, step):
            passes.run(start, min(start + step, count * self.spp))
        moments = passes.moments(release=True)
        weights = np.where(moments.weights != 0, moments.weights, 1)
        return moments.sums[..., 0] / weights, passes.drawn

    def _passes(self, groups):
        integrator, world, camera, plan, window = self.arguments

        def encode(found, weight, ray):
            return [luminance(found["radiance"] * weight, ray.wavelengths)]

        return TreePasses(integrator, world, camera, plan, window, groups, encode, 1, counted=False)


def _shares(found, scene, integrator, spp):
    effects, interaction = found.shares()
    order = sorted(effects, key=lambda name: -effects[name].total.value)
    return Shares(
        scene=scene,
        integrator=integrator,
        evaluations=found.count,
        spp=spp,
        variance=found.variance,
        effects={name: effects[name] for name in order},
        interaction=interaction,
        total={name: found.total(name) for name in order},
        first={name: found.first(name) for name in order},
        error={name: found.total_error(name) for name in order},
    )


def _check(evaluations, spp, freeze):
    if not (isinstance(evaluations, int) and 4 <= evaluations <= 1 << 16):
        raise UsageError(f"evaluations is {evaluations}; accepted are whole numbers from 4 to {1 << 16}")
    if not (isinstance(spp, int) and 1 <= spp <= 1 << 16):
        raise UsageError(f"spp is {spp}; accepted are whole numbers from 1 to {1 << 16}")
    for name in freeze:
        if name not in FROZEN:
            raise UsageError(f"freeze: {name!r} can't be held; accepted are {', '.join(FROZEN)}")


def _percent(interval):
    value, low, high = (100 * x for x in (interval.value, interval.low, interval.high))
    return f"{value:.1f} % [{low:.1f}, {high:.1f}]"
