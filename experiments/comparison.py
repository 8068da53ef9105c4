"""Errors and kernel seconds of `distribution` and of Mitsuba's integrators on one scene, render by render.

Each replicate is one pass at full samples per pixel through a box filter. The reference is the mean of replicates of
`distribution` and of the best of Mitsuba's integrators with `multijitter`, by other seeds than those judged, weighted
by their precision; the two sides are tested against each other. In the reference `distribution` has Mitsuba's offset of
rays, which moves penumbrae by up to 2e-4 of the radiance in tiles of 16x16: that is charged to our side, not to
Mitsuba's. Mitsuba's film adds up in float32, which is wrong by up to 3e-5 after 4,096 samples of the same value, and by
2e-6 after 256: the reference takes means of such. All methods are rendered in turn. What is finished is kept under
out/comparison, and an interrupted run goes on there. Left out: the time to plan and to compile.
"""

import whitted  # noqa: I001, first, since it finds LLVM before drjit looks for one

import argparse
import dataclasses
import io
import json
import math
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np
from combining import combined, squared_error

from whitted import files
from whitted.kernels import timed
from whitted.replicates import box_sensor, replicate, seeds
from whitted.stats.agreement import assess
from whitted.stats.curves import Curve, advantage, common_cost, ratio_at

FOLDER = Path("out/comparison")
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
BIASED, OWN = "ldsampler", "owen_sobol"  # neither is counted among Mitsuba's best
SPP = tuple(4**k for k in range(1, 8))
AUTO = {"light_samples": "auto", "gloss_samples": "auto", "interreflection_samples": "auto"}
OURS, DEFAULTS = "distribution, auto", "distribution"
WEAKEST, STRONG = "path independent", "multijitter"
FIRST_SEED = 100
OURS_AS_MITSUBA = "distribution, auto, Mitsuba's offset"  # only in the reference
LEVEL = 1e-3  # of the test of the reference's two sides, on each scene
REFERENCE_SHARE, TENTH = 0.05, 0.1  # of the smallest error: the reference's variance aimed at, and allowed
REFERENCE_BATCH, REFERENCE_MOST, LONGER = 12, 36, 4  # replicates of each side, of so many times the samples
EXACT_SPP = 256  # with so many samples Mitsuba's film has no rounding that matters
MAP_REPLICATES = 8


@dataclasses.dataclass(frozen=True)
class Size:
    """Width and height in pixels, number of replicates, and the kernel seconds that each ladder of samples reaches.

    The seconds are those for each surface that scatters, so that long paths get about as many samples as short ones.
    """

    side: int
    turns: int
    seconds: float


SIZES = {"large": Size(256, 16, 0.5), "small": Size(64, 4, 0.06)}


@dataclasses.dataclass(frozen=True)
class Method:
    """An integrator's dict and the sampler's name, which our integrators don't draw from."""

    integrator: dict
    sampler: str = "independent"

    @property
    def is_mitsuba(self):
        """Whether it is a pair of Mitsuba's own, and unbiased."""
        return self.integrator["type"] in ("direct", "path") and self.sampler not in (BIASED, OWN)


def methods(depth):
    """Return all methods by name that estimate paths of up to ``depth`` segments; with 2, direct light alone."""
    paths = {"max_depth": depth}
    found = {OURS: Method({"type": "distribution"} | paths | AUTO)}
    found[DEFAULTS] = Method({"type": "distribution"} | paths)
    mitsuba = {"path": {"type": "path"} | paths}
    if depth == 2:
        found["whitted"] = Method({"type": "whitted", "min_contribution": 0.0} | paths)
        for name, count in (("direct 1/0", 0), ("direct 1/1", 1)):
            mitsuba[name] = {"type": "direct", "emitter_samples": 1, "bsdf_samples": count}
    for name, integrator in mitsuba.items():
        for sampler in (*SAMPLERS, OWN):
            found[f"{name} {sampler}"] = Method(integrator, sampler)
    return found


def whole(sampler, spp):
    """Return the number nearest to ``spp``, as a ratio, for which a sampler of Mitsuba's is whole."""
    root = math.isqrt(spp)
    if sampler in ("stratified", "multijitter"):
        accepted = [n * n for n in range(1, root + 2)]
    elif sampler == "orthogonal":
        primes = [n for n in range(2, 2 * root + 3) if all(n % k for k in range(2, n))]
        accepted = [n * n for n in primes]
    elif sampler in (BIASED, OWN):
        accepted = [1 << k for k in range(spp.bit_length() + 1)]
    else:
        return spp
    return min(accepted, key=lambda n: abs(math.log(n / spp)))


class Bench:
    """A scene, and the methods that estimate its picture."""

    def __init__(self, name, side):
        self.scene = whitted.load(name, width=side, height=side).mitsuba
        self.sensor = self.scene.sensors()[0]
        self.depth = int(self.scene.integrator().max_depth)
        self.methods = methods(self.depth)
        self.integrators = {label: self._made(method) for label, method in self.methods.items()}
        ours = self.integrators[OURS].properties() | {"offset": "mitsuba"}
        self.integrators[OURS_AS_MITSUBA] = mi.load_dict(ours)
        self.cameras = {sampler: box_sensor(self.sensor, sampler) for sampler in (*SAMPLERS, OWN)}

    def _made(self, method):
        """The integrator, what it may decide being decided once."""
        made = mi.load_dict(method.integrator)
        if not hasattr(made, "fixed"):
            return made
        return made.fixed(made.plan(made.world(self.scene), self.sensor))

    def seed(self, label, number):
        """Return the seed of a replicate: no two methods share one, nor does the reference with any."""
        first = FIRST_SEED + 7919 * list(self.methods).index(label)
        return seeds(2, first, number + 1)[-1]

    def render(self, label, seed, spp):
        """Return the picture, ``float32`` [H, W, 3], and the seconds that all kernels took."""
        camera = self.cameras[self.methods.get(label, self.methods[OURS]).sampler]
        return timed(replicate, self.integrators[label], self.scene, camera, seed, spp)

    def climb(self, label, seconds):
        """Return the ladder of samples per pixel up to the first that takes ``seconds``, and the variance there."""
        ladder = []
        self.render(label, self.seed(label, 1000), whole(self.methods[label].sampler, SPP[0]))  # compiles
        for spp in SPP:
            ladder.append(whole(self.methods[label].sampler, spp))
            image, taken = self.render(label, self.seed(label, 1001), ladder[-1])
            if taken >= seconds and len(ladder) > 1:
                break
        other, _ = self.render(label, self.seed(label, 1002), ladder[-1])
        return {"spp": ladder, "variance": squared_error(image, other) / 2}

    def reference(self, ladders):
        """Return the reference, its mean variance, and what the test of its two sides says."""
        aim = REFERENCE_SHARE * min(ladder["variance"] for ladder in ladders.values())
        strong = [label for label in ladders if label.endswith(STRONG)]
        theirs = min(strong, key=lambda label: ladders[label]["variance"])
        sides, variance = ([], []), math.inf
        while variance > aim and len(sides[0]) < REFERENCE_MOST:
            for number, (label, images) in enumerate(zip((OURS_AS_MITSUBA, theirs), sides, strict=True)):
                start, spp = len(images), LONGER * ladders[OURS if number == 0 else label]["spp"][-1]
                parts = max(1, spp // EXACT_SPP) if label == theirs else 1
                for turn in range(start, start + REFERENCE_BATCH):
                    pieces = seeds(number, 0, (turn + 1) * parts)[-parts:]
                    pictures = [self.render(label, seed, spp // parts)[0] for seed in pieces]
                    images.append(np.mean(pictures, axis=0, dtype=np.float64))
            mean, variance = combined(*map(np.array, sides))
        found = assess(*map(np.array, sides), level=LEVEL)
        facts = {"replicates": len(sides[0]), "variance": variance, "of": theirs, "verdict": found.verdict}
        return mean, facts | {"image": found.image.to_dict(), "p_value": found.p_value}

    def turn(self, number, ladders, reference, variance):
        """Render every method on every rung once; return seconds, squared error and bias by method."""
        found = {label: [] for label in ladders}
        for rung in range(len(SPP)):  # methods next to each other in time are those that are compared
            for label, ladder in ladders.items():
                if rung < len(ladder["spp"]):
                    image, seconds = self.render(label, self.seed(label, number), ladder["spp"][rung])
                    bias = float(np.mean(image - reference))
                    found[label].append([seconds, squared_error(image, reference, variance), bias])
        return found


def measure(name, size="large", force=False):
    """Measure a scene, or what is missing of it; return what was found and the reference.

    The dict has ``ladders`` and ``turns`` by method, ``reference`` (its variance, and the test of its two sides), and
    the ``settings``, with others than which it is measured anew.
    """
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)  # orthogonal warns of sample counts that it rounds
    FOLDER.mkdir(parents=True, exist_ok=True)
    settings = {"scene": name, **dataclasses.asdict(SIZES[size])}
    side = settings["side"]
    kept, pictures = _path(name, side, "found.json"), _path(name, side, "reference.npz")
    found = json.loads(kept.read_text()) if kept.exists() and not force else {}
    if found.get("settings") != settings:
        found = {"settings": settings, "turns": []}
        _path(name, side, "maps.npz").unlink(missing_ok=True)
    if len(found["turns"]) < SIZES[size].turns:
        _complete(found, name, SIZES[size], kept, pictures)
    return found, np.load(pictures)["reference"]


def _complete(found, name, size, kept, pictures):
    """Measure what is missing, and keep each part when it is there."""
    start = time.perf_counter()

    def keep(message):
        files.write(kept, json.dumps(found, indent=1) + "\n")
        taken = time.perf_counter() - start
        print(f"{name}, {size.side}x{size.side}: {message}, {taken:.0f} s", file=sys.stderr, flush=True)

    bench = Bench(name, size.side)
    found["depth"] = bench.depth
    found["samples"] = bench.integrators[OURS].samples
    if "ladders" not in found:
        seconds = size.seconds * (bench.depth - 1)
        found["ladders"] = {label: bench.climb(label, seconds) for label in bench.methods}
        keep("samples per pixel chosen")
    else:
        for label, ladder in found["ladders"].items():  # compiles
            bench.render(label, 0, ladder["spp"][0])
    if "reference" not in found:
        reference, facts = bench.reference(found["ladders"])
        _save(pictures, reference=reference)
        found["reference"] = facts
        keep("reference rendered")
    reference = np.load(pictures)["reference"]
    for number in range(len(found["turns"]), size.turns):
        variance = found["reference"]["variance"]
        found["turns"].append(bench.turn(number, found["ladders"], reference, variance))
        keep(f"turn {number + 1} of {size.turns}")


def curves(found):
    """Return the `Curve` of each method."""
    made = {}
    for label, ladder in found["ladders"].items():
        values = np.array([turn[label] for turn in found["turns"]])
        made[label] = Curve(np.array(ladder["spp"]), values[..., 0], values[..., 1])
    return made


def mitsuba_pairs(found):
    """Return the names of Mitsuba's unbiased pairs."""
    return [label for label, method in methods(found["depth"]).items() if method.is_mitsuba]


def advantages(found, ours):
    """Return the time of comparison, the name of Mitsuba's best pair, and the `Interval` to it and to the weakest."""
    made = curves(found)
    seconds = common_cost(made.values())
    pairs = mitsuba_pairs(found)
    to_best, best = advantage(made[ours], [made[label] for label in pairs], seconds)
    return seconds, pairs[best], to_best, ratio_at(made[WEAKEST], made[ours], seconds)


def maps(found, reference):
    """Render some methods at equal time, or return what is kept.

    Returns:
        Methods by name, each with its ``spp``, a ``picture`` [H, W, 3], and the ``error`` [H, W], root mean square over
        replicates and channels.
    """
    settings = found["settings"]
    seconds, rival, *_ = advantages(found, OURS)
    kept = _path(settings["scene"], settings["side"], "maps.npz")
    labels = list(dict.fromkeys((OURS, rival, f"path {STRONG}", WEAKEST)))
    if kept.exists() and (stored := np.load(kept))["labels"].tolist() == labels:
        values = zip(stored["spp"].tolist(), stored["pictures"], stored["errors"], strict=True)
    else:
        bench, made = Bench(settings["scene"], settings["side"]), curves(found)
        values = [_map(bench, label, made[label].spp_in(seconds), reference) for label in labels]
        spp, pictures, errors = map(np.array, zip(*values, strict=True))
        _save(kept, labels=labels, spp=spp, pictures=pictures, errors=errors)
    return {
        label: dict(zip(("spp", "picture", "error"), value, strict=True))
        for label, value in zip(labels, values, strict=True)
    }


def _map(bench, label, spp, reference):
    """Return the samples per pixel, a picture, and the error of each pixel."""
    spp = whole(bench.methods[label].sampler, max(round(spp), 1))
    numbers = range(2000, 2000 + MAP_REPLICATES)
    images = np.array([bench.render(label, bench.seed(label, number), spp)[0] for number in numbers])
    return spp, images[0], np.sqrt(np.mean((images - reference) ** 2, axis=(0, -1)))


def _path(name, side, suffix):
    return FOLDER / f"{name}_{side}_{suffix}"


def _save(path, **arrays):
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)
    files.write(path, packed.getvalue())


def arguments():
    """Return the size's name and whether to measure again, from the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--force", action="store_true", help="measure again; if interrupted, go on without it"
    )
    parser.add_argument("--small", action="store_true", help="small pictures, few replicates: minutes")
    chosen = parser.parse_args()
    return "small" if chosen.small else "large", chosen.force
