"""Do two integrators estimate the same image? A test on replicates of both, with the interval of the bias.

First it is asked whether both estimate the same light paths of the scene (`whitted.path_classes`); if so, a
pilot chooses the number of samples, fresh replicates of both are rendered, and `whitted.stats.agreement`
judges them. The number of samples is fixed before the data that are judged exist. A difference has to show up
twice: the second time in fresh replicates of four times the samples. One that is gone as soon as ours lets rays leave
surfaces by Mitsuba's rule counts only where it exceeds the tolerance. Left out: what only gradients show.
"""

import contextlib
import functools
import html
import json
import math
import time as clock
from dataclasses import dataclass, field, replace

import numpy as np

from whitted import files
from whitted.defects import known_defects
from whitted.errors import UsageError
from whitted.path_classes import Classes, compare_classes, describe, has_null
from whitted.replicates import box_sensor, replicate, seeds, whole_grid
from whitted.scene import as_scene
from whitted.scene import integrator as make_integrator
from whitted.stats.agreement import assess, relative_errors

CONFIRM_FACTOR = 4  # rare, skewed noise can pass for a difference: one must show up again in more samples
CONFIRM_SEED = 50021  # apart from the seeds of all sides
REPLICATES = 32  # of each side; 16 for pictures beyond LARGE values
LARGE = 1 << 19
MOST = 1 << 28  # values of all replicates together, 1 GiB
SECONDS = 300.0  # at most for rendering, where neither spp nor time is given
TILE_TOLERANCE = 5  # times the tolerance of the image
PILOTS, PILOT_SPP = 8, 16
NORMAL_SPP, MOST_SPP = 64, 1 << 16  # of the pilot's choice; with fewer, replicates are far from normal
BY_OFFSET = "they differ by where rays leave surfaces alone: with Mitsuba's offset for both no test rejects"
IMAGE_MARGIN, TILE_MARGIN = 5, 8  # standard errors that shall fit into the tolerance: interval and scatter


@dataclass(frozen=True)
class Agreement:
    """The outcome of `check`.

    ``verdict`` is ``agree``, ``differ``, ``undecided`` or ``not comparable`` and ``reason`` says why;
    ``integrators`` and ``means`` (the mean images, ``float64`` [height, width, channels]) are those of the
    tested integrator and of the reference. The `Assessment` of the statistics is None where nothing was
    rendered.
    """

    verdict: str
    reason: str
    scene: str
    integrators: tuple
    level: float
    tolerance: float
    tile_tolerance: float
    spp: int = 0
    replicates: int = 0
    seed: int = 0
    seconds: float = 0.0
    classes: Classes = field(default_factory=lambda: Classes(True))
    assessment: object = field(default=None, repr=False)
    notes: tuple = ()

    @property
    def means(self):
        """The two mean images, or None."""
        return None if self.assessment is None else self.assessment.means

    def to_dict(self):
        """Return the JSON of ``whitted check --json``."""
        found = self.assessment
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "scene": self.scene,
            "integrators": list(self.integrators),
            "level": self.level,
            "tolerance": self.tolerance,
            "tile_tolerance": self.tile_tolerance,
            "bias": found and {"image": found.image.to_dict(), "tiles": found.tile.to_dict()},
            "p_value": found.p_value if found else {},
            "threshold": found and found.threshold,
            "smallest_detectable_bias": found and found.smallest_detectable,
            "smallest_detectable_bias_tile": found and found.smallest_detectable_tile,
            "nonfinite": list(found.nonfinite) if found else [0, 0],
            "spp": self.spp,
            "replicates": self.replicates,
            "seed": self.seed,
            "seconds": self.seconds,
            "paths": self.classes.to_dict(),
            "notes": list(self.notes),
        }

    def write(self, path):
        """Write the JSON to a file.

        Raises:
            UsageError: the file cannot be written.
        """
        files.write(path, json.dumps(self.to_dict(), indent=2) + "\n")

    def __str__(self):
        a, b = self.integrators
        lines = [f"{self.scene}: {self.verdict}", f"  {self.reason}", f"  {a}", f"  against {b}"]
        if found := self.assessment:
            x, y, width, height = found.tile.box or (0, 0, *found.means[0].shape[1::-1])
            tests = ", ".join(f"{name} {p:.2g}" for name, p in found.p_value.items())
            lines += [
                f"  bias of the image     {_interval(found.image)}  tolerance {_percent(self.tolerance)}",
                f"  bias of worst tile    {_interval(found.tile)}  tolerance {_percent(self.tile_tolerance)}"
                f"  at x {x}, y {y}, {width}x{height}",
                f"  smallest detectable   {_percent(found.smallest_detectable)} image, "
                f"{_percent(found.smallest_detectable_tile)} tile, with probability 90 %",
                f"  p-values              {tests}",
                f"  a test rejects at     {found.threshold:.2g}, all together at {self.level:g}",
                f"  {self.replicates} replicates x {self.spp} spp of each, {self.seconds:.1f} s",
            ]
        return "\n".join(lines + [f"  note: {note}" for note in self.notes])

    def _repr_html_(self):
        return f"<pre>{html.escape(str(self))}</pre>"


def check(
    scene,
    integrator=None,
    reference=None,
    *,
    spp=None,
    time=None,
    seed=0,
    tolerance=0.01,
    replicates=None,
    level=0.01,
    sensor=0,
    progress=None,
):
    """Test whether two integrators estimate the same image of a scene, as an `Agreement`.

    Both are rendered through a box filter and with Mitsuba's ``multijitter`` sampler, whatever the scene has;
    the scene is left as it is. ``min_contribution``, where the integrator has it, is 0 unless the user set
    it.

    Args:
        scene: a `Scene`, an ``mi.Scene``, a path or the name of a shipped scene.
        integrator: as for `whitted.scene.integrator`; by default the scene's own if it is ours.
        reference: likewise; by default Mitsuba's ``path`` with the integrator's ``max_depth``, or ``volpath``
            where light passes straight through surfaces of the scene.
        spp: samples per pixel of each replicate, > 0; rounded up to a full grid of the sampler.
        time: seconds of rendering after compilation, > 0; where spp is given it is not used. With neither, as
            many samples as the tolerance needs according to a pilot, in at most 300 s.
        seed: >= 0; equal seeds give equal results.
        tolerance: relative bias that the image may have, in (0, 1); a 16x16 tile may have five times that.
        replicates: of each side, >= 8; by default 32, and 16 for large pictures.
        level: probability that equal integrators are found to differ, in (0, 0.5).
        sensor: index of the scene's sensor.
        progress: called with the number of replicates done and their total.

    Raises:
        UsageError: a value is out of range, or the picture is too large.
    """
    _validate(spp=spp, time=time, tolerance=tolerance, level=level)
    scene = as_scene(scene)
    sensors = scene.mitsuba.sensors()
    if not 0 <= sensor < len(sensors):
        raise UsageError(f"sensor {sensor}: the scene has sensors 0 to {len(sensors) - 1}")
    start = clock.perf_counter()
    sides, notes = _sides(scene.mitsuba, integrator, reference)
    sides = [_planned(side, scene.mitsuba, sensors[sensor]) for side in sides]
    facts = {"scene": scene.name, "level": level, "tolerance": tolerance, "seed": seed}
    facts["tile_tolerance"] = TILE_TOLERANCE * tolerance
    with _without_cutoff(sides[0], integrator), _without_cutoff(sides[1], reference):
        facts["integrators"] = tuple(describe(side) for side in sides)
        classes = compare_classes(scene.mitsuba, sensors[sensor], *sides, seed=seed)
        if not classes.comparable:
            facts |= {"notes": notes, "seconds": clock.perf_counter() - start}
            return Agreement("not comparable", classes.reason, classes=classes, **facts)
        camera = box_sensor(sensors[sensor])
        replicates = _replicates(replicates, camera)
        if spp is None:
            spp = _choose_spp(sides, scene.mitsuba, camera, replicates, time, seed, tolerance)
        for attempt in range(2):
            spp = whole_grid(spp * CONFIRM_FACTOR**attempt)
            plan = [seeds(side, seed + attempt * CONFIRM_SEED, replicates) for side in range(2)]
            render = functools.partial(_render, sides, scene.mitsuba, camera, plan, spp, progress=progress)
            judge = functools.partial(
                assess, tolerance=tolerance, tile_tolerance=facts["tile_tolerance"], level=level, seed=seed
            )
            images = render()
            found, shared = judge(*images), None
            if found.verdict != "differ":
                break
            shared = _with_shared_offset(sides, images, render, judge)
            if shared and shared.verdict != "differ":
                break
        if attempt:
            confirmed = "confirmed" if found.verdict == "differ" else "not confirmed"
            notes += (
                f"a first difference was {confirmed} by fresh replicates of {CONFIRM_FACTOR} times the samples",
            )
    verdict, reason = found.verdict, found.reason
    if verdict == "differ" and shared and shared.verdict != "differ":
        verdict, reason, found, further = _by_offset(found, shared, tolerance, facts["tile_tolerance"])
        notes += further
    elif verdict == "differ" and (
        defects := [d for side in sides for d in known_defects(scene.mitsuba, side)]
    ):
        verdict = "not comparable"
        reason = f"they differ, and Mitsuba is known to be wrong here: {defects[0]}"
        notes += tuple(f"also known: {defect}" for defect in defects[1:])
    return Agreement(
        verdict,
        reason,
        spp=spp,
        replicates=replicates,
        seconds=clock.perf_counter() - start,
        classes=classes,
        assessment=found,
        notes=notes,
        **facts,
    )


def _validate(spp, time, tolerance, level):
    if spp is not None and spp < 1:
        raise UsageError(f"spp is {spp}; at least 1 is needed")
    if time is not None and not 0 < time < math.inf:
        raise UsageError(f"time is {time}; a positive number of seconds is needed")
    if not 0 < tolerance < 1:
        raise UsageError(f"tolerance is {tolerance}; a number between 0 and 1 is needed, such as 0.01")
    if not 0 < level < 0.5:
        raise UsageError(f"level is {level}; a number between 0 and 0.5 is needed, such as 0.01")


def _sides(scene, integrator, reference):
    """Return the two integrators, and notes on those that the user did not choose."""
    tested, note = make_integrator(integrator, scene)
    notes = [note] if note else []
    if reference is None:
        depth = getattr(tested, "max_depth", None)
        name = "volpath" if has_null(scene) else "path"
        reference = {"type": name} | ({} if depth is None else {"max_depth": int(depth)})
        if name == "volpath":
            notes.append("the reference is volpath: shadow rays of path stop at null, mask and thin surfaces")
    return (tested, make_integrator(reference, scene)[0]), tuple(notes)


def _planned(integrator, scene, sensor):
    """Decide once for all replicates what is left to the integrator to decide."""
    if not hasattr(integrator, "fixed"):
        return integrator
    return integrator.fixed(integrator.plan(integrator.world(scene), sensor))


def _without_cutoff(integrator, spec):
    """Switch an integrator's cutoff off for a while, unless the user has set it: it gives up light."""
    if not hasattr(integrator, "min_contribution") or _has_set_cutoff(integrator, spec):
        return contextlib.nullcontext()
    return _changed(integrator, "min_contribution", 0.0)


@contextlib.contextmanager
def _changed(integrator, name, value):
    """Give an attribute another value for a while."""
    before = getattr(integrator, name)
    setattr(integrator, name, value)
    try:
        yield
    finally:
        setattr(integrator, name, before)


def _has_set_cutoff(integrator, spec):
    """Whether the user chose the cutoff: named it, or made an object with another than the default."""
    import mitsuba as mi

    if isinstance(spec, str | dict):
        return "min_contribution" in spec
    return integrator.min_contribution != type(integrator)(mi.Properties()).min_contribution


def _replicates(replicates, camera):
    """Return how many replicates to make of each side."""
    values = 3 * math.prod(int(n) for n in camera.film().crop_size())
    if replicates is None:
        replicates = REPLICATES if values <= LARGE else REPLICATES // 2
    if replicates < 8:
        raise UsageError(f"replicates is {replicates}; at least 8 are needed for a test")
    if 2 * replicates * values > MOST:
        raise UsageError(f"a picture of {values // 3} pixels is too large for a check; make it smaller")
    return replicates


def _render(sides, scene, camera, plan, spp, chosen=(0, 1), progress=None):
    """Render the replicates of the chosen sides in turn, each with its seeds of the plan.

    Returns two arrays (replicates, height, width, channels), None for a side that isn't chosen.
    """
    images, replicates = [None, None], len(plan[0])
    for k in range(replicates):
        for side in chosen:
            image = replicate(sides[side], scene, camera, plan[side][k], spp)
            if images[side] is None:
                images[side] = np.empty((replicates, *image.shape), np.float32)
            images[side][k] = image
        if progress:
            progress(len(chosen) * (k + 1), len(chosen) * replicates)
    return images


def _with_shared_offset(sides, images, render, judge):
    """Judge again, with ours letting rays leave surfaces by Mitsuba's rule; None where both or neither are ours."""
    own = [number for number, side in enumerate(sides) if getattr(side, "offset", "mitsuba") != "mitsuba"]
    if len(own) != 1:
        return None
    with _changed(sides[own[0]], "offset", "mitsuba"):
        again = render(chosen=own)
    return judge(*(first if fresh is None else fresh for first, fresh in zip(images, again, strict=True)))


def _by_offset(found, shared, tolerance, tile_tolerance):
    """Return verdict, reason, `Assessment` and notes on a difference that is gone where both have one offset."""
    small = found.image.inside(tolerance) and found.tile.inside(tile_tolerance) and not any(found.nonfinite)
    if shared.verdict == "agree" and not small:
        return "not comparable", BY_OFFSET, found, ()
    reason = shared.reason
    if shared.verdict == "agree":
        reason = "no test rejects with Mitsuba's offset for both, and with our own the bias lies within the tolerance"
    note = f"with our own offset: {found.reason}"
    return shared.verdict, reason, replace(found, p_value=shared.p_value), (note,)


def _choose_spp(sides, scene, camera, replicates, time, seed, tolerance):
    """Return the samples per pixel of a replicate: what the tolerance needs, at most what the time allows.

    Where the user gave the time, all of it is used. The pilot's own samples are not used again.
    """
    pilots, seconds = [], 0.0
    for side, integrator in enumerate(sides):
        first, *rest = seeds(2 + side, seed, PILOTS + 1)
        replicate(integrator, scene, camera, first, PILOT_SPP)  # compiles
        start = clock.perf_counter()
        pilots.append(np.array([replicate(integrator, scene, camera, s, PILOT_SPP) for s in rest]))
        seconds += (clock.perf_counter() - start) / PILOTS
    allowed = PILOT_SPP * (time or SECONDS) / (replicates * seconds)
    image, tile = (error * math.sqrt(PILOTS / replicates) for error in relative_errors(*pilots))
    margin = max(image * IMAGE_MARGIN / tolerance, tile * TILE_MARGIN / (TILE_TOLERANCE * tolerance))
    wanted = allowed if time else min(allowed, max(PILOT_SPP * margin**2, NORMAL_SPP))
    return int(np.clip(wanted, 1, MOST_SPP))


def _percent(x):
    return f"{100 * x:.2g} %"


def _interval(bias):
    return f"{100 * bias.value:+.3f} % in [{100 * bias.low:+.3f}, {100 * bias.high:+.3f}] %"
