"""What a study has found, scene by scene: ladders of errors and seconds, and what the statistics say of them.

All intervals are at 95 %, from replicates that are whole: of a method that is half done those are taken that have
every step of the ladder. The squared errors are without the reference's own variance. Left out: comparing scenes.
"""

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from whitted.stats import tails
from whitted.stats.convergence import BEYOND, slope
from whitted.stats.curves import Curve, cheapest, common_cost, cost_ratio_at, ratio_at
from whitted.stats.decomposition import PAIRS, decompose
from whitted.stats.efficiency import efficiency
from whitted.stats.running import Running

TARGETS = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005)  # relative RMSE of which the cheapest setting is sought
WIDE = 0.2  # relative spread of a setting's seconds, half the range of its middle half over the median, that is told
SHORTEST = 5e-3  # seconds; shorter ones spread by what the clock and the threads do
ROWS = (
    "SELECT scenes.label AS scene, methods.id AS method_id, methods.label AS method, cells.spp AS spp, replicate,"
    " cells.picture AS picture, metric, value, reference_part, execute"
    " FROM cells JOIN scenes ON scenes.id = cells.scene JOIN methods ON methods.id = cells.method"
    " JOIN errors ON errors.cell = key JOIN reference_pictures ON reference_pictures.id = reference"
    " LEFT JOIN timings ON timings.cell = key AND warm = 1"
    " WHERE role = 'cell' AND status = 'done' AND cells.wanted = 1 AND reference_pictures.wanted = 1"
)


@dataclass(frozen=True)
class Ladder:
    """The replicates of one method on one scene, from few samples to many.

    Attributes:
        label: of the method.
        method: its id in the store.
        spp: int [K], increasing.
        errors: ``float64`` [R, K], mean squared errors without the reference's variance.
        metrics: by name, ``float64`` [R, K], as stored.
        seconds: ``float64`` [R, K] of kernels, warm, NaN where they don't count; or None.
        pictures: [R][K], paths.
        variance: of the reference's pixels, mean.
    """

    label: str
    method: str
    spp: np.ndarray
    errors: np.ndarray
    metrics: dict
    seconds: np.ndarray | None
    pictures: list
    variance: float

    @property
    def curve(self):
        """The `whitted.stats.curves.Curve` over seconds where they are known, else over samples."""
        return Curve(self.spp, self.seconds, self.errors)

    @property
    def curve_of_samples(self):
        """The `whitted.stats.curves.Curve` over samples per pixel."""
        return Curve(self.spp, None, self.errors)

    @property
    def told(self):
        """Which steps lie far enough above the reference's own error, bool [K]."""
        return self.errors.mean(axis=0) >= BEYOND**2 * self.variance


@dataclass(frozen=True)
class Scene:
    """What a study says of a scene; dicts are by the method's label.

    Attributes:
        label, identity: of the scene, and its id in the store.
        reference: row of ``reference_pictures``.
        ladders: `Ladder`.
        slopes: `whitted.stats.convergence.Slope`.
        efficiencies: `Interval` at the most samples, or None without seconds.
        baseline: the label that ratios are relative to.
        cost: seconds (or samples) at which errors are compared, or None.
        ratios: `Interval` of the MSE of the baseline over the method's, at that cost.
        error: RMSE at which costs are compared, or None.
        cost_ratios: `Interval` of the cost of the baseline over the method's, at that error.
        cheapest: relative RMSE to `whitted.stats.curves.Choice` or None.
        parts: `whitted.stats.decomposition.Decomposition` at the most samples.
        pixel_tails, replicate_tails: `whitted.stats.tails`, at the most samples.
        shares: rows of ``shares``, lists.
        warnings: what a reader should know, sentences.
    """

    label: str
    identity: str
    reference: dict
    ladders: dict
    slopes: dict = field(default_factory=dict)
    efficiencies: dict = field(default_factory=dict)
    baseline: str = ""
    cost: float | None = None
    ratios: dict = field(default_factory=dict)
    error: float | None = None
    cost_ratios: dict = field(default_factory=dict)
    cheapest: dict = field(default_factory=dict)
    parts: dict = field(default_factory=dict)
    pixel_tails: dict = field(default_factory=dict)
    replicate_tails: dict = field(default_factory=dict)
    shares: dict = field(default_factory=dict)
    warnings: tuple = ()


def ladders(store):
    """Return the `Ladder` of each method by scene, a dict of dicts: ``{scene: {method: Ladder}}``.

    Args:
        store: `whitted.studies.store.Store`.
    """
    cells = defaultdict(dict)
    for row in store.query(ROWS):
        cells[row["scene"], row["method"]].setdefault((row["replicate"], row["spp"]), {})[row["metric"]] = row
    found = defaultdict(dict)
    for (scene, method), by_place in cells.items():
        ladder = _ladder(method, by_place)
        if ladder is not None:
            found[scene][method] = ladder
    scenes = [row["label"] for row in store.query("SELECT label FROM scenes ORDER BY rowid")]
    methods = [row["id"] for row in store.query("SELECT id FROM methods ORDER BY rowid")]
    return {
        scene: dict(sorted(found[scene].items(), key=lambda item: methods.index(item[1].method)))
        for scene in scenes
        if scene in found
    }


def analyse(store, errors=()):
    """Return the `Scene` of each scene that has something to say.

    Args:
        store: `whitted.studies.store.Store`.
        errors: relative RMSEs of which the cheapest setting is sought, beside ``TARGETS``.
    """
    rows = store.query(
        "SELECT reference_pictures.*, scenes.label FROM reference_pictures JOIN scenes ON scenes.id = scene"
        " WHERE wanted = 1"
    )
    references = {row["label"]: row for row in rows}
    return [
        _scene(store, scene, own, references[scene], {*TARGETS, *errors})
        for scene, own in ladders(store).items()
    ]


def _ladder(label, by_place):
    """The ladder of cells by replicate and samples, or None where no replicate is whole."""
    spp = sorted({place[1] for place in by_place})
    replicates = sorted({place[0] for place in by_place})
    whole = [r for r in replicates if all("mse" in by_place.get((r, n), {}) for n in spp)]
    if not whole:
        return None
    cells = [[by_place[r, n] for n in spp] for r in whole]

    def table(value):
        return np.array([[value(cell) for cell in row] for row in cells], float)

    names = set.intersection(*(set(cell) for row in cells for cell in row))
    first = cells[0][0]["mse"]
    seconds = table(lambda cell: np.nan if cell["mse"]["execute"] is None else cell["mse"]["execute"])
    return Ladder(
        label=label,
        method=first["method_id"],
        spp=np.array(spp),
        errors=table(lambda cell: cell["mse"]["value"] - cell["mse"]["reference_part"]),
        metrics={name: table(lambda cell, name=name: cell[name]["value"]) for name in sorted(names)},
        seconds=seconds if np.isfinite(seconds).any(axis=0).all() else None,
        pictures=[[cell["mse"]["picture"] for cell in row] for row in cells],
        variance=first["reference_part"],
    )


def _scene(store, label, own, reference, errors):
    """The analysis of one scene."""
    timed = all(ladder.seconds is not None for ladder in own.values())
    curves = {name: ladder.curve if timed else ladder.curve_of_samples for name, ladder in own.items()}
    several = {name: curve for name, curve in curves.items() if len(curve.spp) > 1}
    baseline = _baseline(store, own)
    cost, error = _common(several)
    base = several.get(baseline)
    pictures = {name: _pictures(store, ladder) for name, ladder in own.items()}
    truth = store.picture(reference["picture"])
    return Scene(
        label=label,
        identity=reference["scene"],
        reference=reference,
        ladders=own,
        slopes={n: slope(x.spp, x.errors, x.variance) for n, x in own.items() if n in several},
        efficiencies={n: _efficiency(x) for n, x in own.items()},
        baseline=baseline,
        cost=cost,
        ratios={n: ratio_at(base, c, cost) for n, c in several.items() if n != baseline and cost and base},
        error=error,
        cost_ratios={
            n: cost_ratio_at(base, c, error) for n, c in several.items() if n != baseline and error and base
        },
        cheapest={e: cheapest(curves, e * reference["mean"]) for e in sorted(errors, reverse=True)},
        parts={n: decompose(p, *_truth(truth, p)) for n, p in pictures.items() if len(p) >= PAIRS},
        pixel_tails={n: tails.pixel_tail(p[0] - _truth(truth, p)[0]) for n, p in pictures.items()},
        replicate_tails={n: tails.replicate_tail(Running.of(p)) for n, p in pictures.items()},
        shares=_shares(store, own),
        warnings=tuple(_warnings(store, own, reference)),
    )


def _baseline(store, own):
    """The method that the others are compared with: the first of Mitsuba's, else the first."""
    samplers = {row["id"]: row["sampler"] for row in store.query("SELECT id, sampler FROM methods")}
    mitsuba = [name for name, ladder in own.items() if samplers[ladder.method] is not None]
    return (mitsuba or list(own))[0]


def _common(curves):
    """The highest cost that all have reached, and the lowest RMSE that all have; None where there is none."""
    if len(curves) < 2:
        return None, None
    try:
        cost = common_cost(curves.values())
    except ValueError:
        cost = None
    squares = [curve.errors.mean(axis=0) for curve in curves.values()]
    lowest, highest = max(s.min() for s in squares), min(s.max() for s in squares)
    return cost, math.sqrt(lowest) if 0 < lowest < highest else None


def _efficiency(ladder):
    """Efficiency at the most samples, or None without seconds."""
    return None if ladder.seconds is None else efficiency(ladder.errors[:, -1], ladder.seconds[:, -1])


def _pictures(store, ladder):
    """The pictures of the most samples, ``float32`` [R, H, W, C]."""
    return np.stack([store.pixels(row[-1]) for row in ladder.pictures])


def _truth(truth, pictures):
    """The reference's pixels and their variance, with as many channels as the pictures have."""
    channels = pictures.shape[-1]
    return truth.rgb[..., :channels], np.square(truth.stderr[..., :channels], dtype=np.float64)


def _shares(store, own):
    found = defaultdict(list)
    names = {ladder.method: name for name, ladder in own.items()}
    for row in store.query("SELECT * FROM shares ORDER BY total DESC"):
        if row["method"] in names:
            found[names[row["method"]]].append(row)
    return dict(found)


def _warnings(store, own, reference):
    """What a reader should know."""
    for name, ladder in own.items():
        near = ladder.spp[~ladder.told]
        if len(near):
            few = ", ".join(map(str, near))
            yield f"{name}: at {few} spp the error is within {BEYOND:g} times that of the reference, and tells little."
        if ladder.seconds is not None:
            yield from _spread(name, ladder)
    sql = "SELECT count(*) AS number FROM cells WHERE scene = ? AND same_bits = 0 AND wanted = 1"
    differing = store.query(sql, reference["scene"])[0]["number"]
    if differing:
        yield f"{differing} cells gave other bits when they were rendered again."
    probes = store.query(
        "SELECT DISTINCT probe FROM environments JOIN cells ON cells.environment = environments.id"
        " WHERE cells.scene = ? AND wanted = 1",
        reference["scene"],
    )
    if len(probes) > 1:
        yield "Pictures are of machines whose last bits differ; the column probe of environments tells which."
    machines = store.query(
        "SELECT DISTINCT cpu, cores FROM timings JOIN environments ON environments.id = timings.environment"
        " JOIN cells ON key = cell WHERE scene = ? AND cells.wanted = 1 AND warm = 1",
        reference["scene"],
    )
    if len(machines) > 1:
        kinds = "; ".join(f"{row['cpu']}, {row['cores']} cores" for row in machines)
        yield f"Seconds are of machines of several kinds: {kinds}."


def _spread(name, ladder):
    """Tell of settings whose seconds vary too much to be trusted."""
    for spp, column in zip(ladder.spp, ladder.seconds.T, strict=True):
        column = column[np.isfinite(column)]
        middle = np.median(column)
        quarter = np.subtract(*np.percentile(column, [75, 25])) / 2
        if len(column) > 2 and middle > SHORTEST and quarter > WIDE * middle:
            yield f"{name}: the seconds of {spp} spp vary by {100 * quarter / middle:.0f} %; something else ran."
