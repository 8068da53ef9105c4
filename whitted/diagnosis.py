"""Where values come from that are no numbers: samples that met one are traced again, and watched.

While a `World` is watched its integrator hands it the terms that it adds up and multiplies by; the first of a sample
that isn't finite is its cause. Draws are functions of pixel and sample, so that the same rays are met again. Left out:
Mitsuba's integrators, which tell nothing of their terms.
"""

from collections import Counter
from dataclasses import dataclass

import drjit as dr
import numpy as np

from whitted.film import Grid, Window, eye_rays, finite
from whitted.lights.primitives import registry_number
from whitted.world import CAUSE, SHAPE_BITS, TERMS

PIXELS = 64  # traced again, at most
LANES = 1 << 20  # samples of one kernel


@dataclass(frozen=True)
class Cause:
    """A term that wasn't finite, and where.

    Attributes:
        term: one of ``TERMS``, or ``sum`` where all terms were finite and their sum wasn't.
        surface: the name of the shape; ``environment`` or ``sensor`` where there was none.
    """

    term: str
    surface: str

    def __str__(self):
        return f"{self.term} at {self.surface}"


@dataclass(frozen=True)
class Diagnosis:
    """What was found out about samples that weren't finite.

    Attributes:
        pixels: how many of the picture met one.
        traced: of these the ones traced again, a dict from (x, y) to a ``Counter`` from `Cause` to samples.
    """

    pixels: int
    traced: dict

    @property
    def causes(self):
        """All of them, a ``Counter`` from `Cause` to samples."""
        return sum(self.traced.values(), Counter())

    def to_dict(self):
        """Return the numbers for JSON, the most frequent cause first."""
        causes = [
            {"term": cause.term, "surface": cause.surface, "samples": count}
            for cause, count in self.causes.most_common()
        ]
        return {"pixels": self.pixels, "traced": len(self.traced), "causes": causes}

    def __str__(self):
        """One line for each pixel and cause."""
        return "\n".join(
            f"pixel {x},{y}: {cause}, in {count} samples"
            for (x, y), causes in self.traced.items()
            for cause, count in causes.most_common()
        )


def diagnose(passes, start, stop):
    """Find out where the values of a render came from that weren't finite.

    Args:
        passes: `whitted.tracing.TreePasses` that has run.
        start, stop: the range of samples that it took.

    Returns:
        `Diagnosis`.
    """
    counts = np.array(passes.sums.nonfinite)
    window = passes.sums.window
    bad = np.flatnonzero(counts)
    names = _names(passes.world.scene)
    traced = {}
    for number in bad[:PIXELS]:
        x, y = window.x + int(number) % window.width, window.y + int(number) // window.width
        codes = Counter()
        for first in range(start, stop, LANES):
            codes += _codes(passes, Window(x, y, 1, 1), first, min(first + LANES, stop))
        traced[x, y] = Counter({_cause(code, names): count for code, count in codes.items()})
    return Diagnosis(len(bad), traced)


def _codes(passes, window, start, stop):
    """Trace samples of a pixel again; return a ``Counter`` of the first causes of those that aren't finite."""
    grid, world = Grid(window, start, stop), passes.world
    with dr.suspend_grad():
        ray, weight, draws, _, active = eye_rays(passes.sensor, passes.size, grid, passes.groups, passes.plan)
        world.watch_values()
        world.watch("eye ray", weight, None, active)
        found = passes.integrator.estimate(world, ray, draws, passes.plan, active)
        is_finite = finite(passes.encode(found, weight, ray))
        codes = np.array(dr.select(active & ~is_finite, world.rays[CAUSE] + 1, 0))
    world.count_rays(False)
    return Counter(int(code) - 1 for code in codes[codes > 0])


def _cause(code, names):
    if code == 0:
        return Cause("sum", "sensor")
    term, shape = TERMS[(code >> SHAPE_BITS) - 1], code & ((1 << SHAPE_BITS) - 1)
    nowhere = "sensor" if term == "eye ray" else "environment"
    return Cause(term, names.get(shape, nowhere))


def _names(scene):
    """The names of the shapes by their registry numbers."""
    from whitted.contents import shapes_of

    return {registry_number(shape): shape.id() or shape.class_name() for shape in shapes_of(scene)}
