"""The cells of a study: what each renders, the key by which it is known, and the parts it is cut into.

A key is made of content: the scene's hash, the integrator with nothing left to decide, the sampler, samples, seed, size
and versions. The same cell has the same key in every study, on every machine and in any order.
"""

import hashlib
import json
from dataclasses import dataclass, field, replace

import numpy as np

from whitted.replicates import STRIDE, seeds

CELL, REFERENCE = "cell", "reference"
SIDES = {CELL: 2, REFERENCE: 3}  # of `whitted.replicates.seeds`: no cell shares a seed with a reference
PART = 1 << 27  # samples of a part: some ten seconds
ROWS = 4  # parts are whole numbers of these rows: blocks of pixels that are rendered together


@dataclass(frozen=True)
class Scene:
    """A scene as a worker has found it: its label, where it is, its hash and its size in pixels."""

    label: str
    scene: str
    define: dict
    sensor: int
    width: int
    height: int
    hash: str


@dataclass(frozen=True)
class Method:
    """An integrator with a sampler or effects.

    Attributes:
        label: how it is called in the study.
        integrator: dict as for ``mi.load_dict``, with nothing left to decide.
        sampler: name of a Mitsuba sampler, or None where the integrator has sequences of its own.
        effects: as asked for, or None where it has no choice.
        simulated: names of the effects that this means in the scene.
        plan_seconds: what deciding took, or None.
        accepted: from samples per pixel asked for to those that the sampler takes.
    """

    label: str
    integrator: dict
    sampler: str | None
    effects: str | None
    simulated: tuple
    plan_seconds: float | None
    accepted: dict


@dataclass(frozen=True)
class Part:
    """A window of pixels and a range of samples: left, top, width, height; from ``start`` to before ``stop``."""

    x: int
    y: int
    width: int
    height: int
    start: int
    stop: int


@dataclass(frozen=True)
class Cell:
    """One render of a study.

    Attributes:
        role: ``cell``, or ``reference`` for a part of what errors are taken against.
        scene, method: `Scene`, `Method`.
        spp: samples per pixel.
        replicate: its number.
        seed: ``int``, 32 bits.
        variant: of Mitsuba.
        versions: of whitted, mitsuba and drjit, a dict.
        timed: it has to run alone, so that its seconds count; no part of the key.
    """

    role: str
    scene: Scene
    method: Method
    spp: int
    replicate: int
    seed: int
    variant: str
    versions: dict = field(repr=False)
    timed: bool = True

    @property
    def content(self):
        """What the key is made of, a dict that JSON can hold."""
        return {
            "scene": self.scene.hash,
            "sensor": self.scene.sensor,
            "size": [self.scene.width, self.scene.height],
            "integrator": self.method.integrator,
            "sampler": self.method.sampler,
            "effects": self.method.effects,
            "spp": self.spp,
            "seed": self.seed,
            "variant": self.variant,
            "versions": self.versions,
        }

    @property
    def key(self):
        """The cell's key: 24 hexadecimal digits."""
        return digest(self.content)

    @property
    def parts(self):
        """The `Part` list that make up the cell, in the order in which they are put together."""
        width, height = self.scene.width, self.scene.height
        rows = max(PART // (width * self.spp) // ROWS, 1) * ROWS
        samples = self.spp
        if self.method.sampler is None:  # the samples of Mitsuba's samplers can't be taken from the middle
            samples = max(PART // (width * ROWS), 1)
            samples = 1 << (samples.bit_length() - 1)
        return [
            Part(0, y, width, min(rows, height - y), start, min(start + samples, self.spp))
            for y in range(0, height, rows)
            for start in range(0, self.spp, samples)
        ]

    @property
    def whole(self):
        """The `Part` that is all of the cell."""
        return Part(0, 0, self.scene.width, self.scene.height, 0, self.spp)


def digest(content):
    """Return a digest of what JSON can hold, 24 hexadecimal digits."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def cells_of(specification, scene, methods, reference, versions):
    """Return the cells of one scene: those of the reference, and a list for each replicate.

    Args:
        specification: `whitted.studies.specification.Specification`.
        scene: `Scene`.
        methods: list of `Method`.
        reference: `Method` of the reference.
        versions: dict, part of the key.
    """
    spec = specification

    def cell(role, method, spp, replicate, timed):
        made = Cell(role, scene, method, spp, replicate, spec.seed, spec.variant, versions, timed)
        first = int(digest(made.content | {"role": role}), 16) % STRIDE
        return replace(made, seed=seeds(SIDES[role], first, replicate + 1)[-1])

    wanted = spec.reference
    spp = reference.accepted[wanted.spp]
    references = [cell(REFERENCE, reference, spp, r, False) for r in range(wanted.replicates)]
    timed = spec.replicates if spec.timed is None else spec.timed
    # Two steps of a ladder may be rounded to the same samples
    settings = [
        (method, n) for method in methods for n in dict.fromkeys(method.accepted[n] for n in spec.spp)
    ]
    ladders = [[cell(CELL, *setting, r, r < timed) for setting in settings] for r in range(spec.replicates)]
    return references, ladders


def interleaved(turns, seed):
    """Return the cells of all scenes in the order in which they run: turn by turn, each in an order of its own.

    So what slows the machine for a while slows all methods alike.

    Args:
        turns: for each scene a list of lists of cells, one for each replicate.
        seed: ``int``.
    """
    order = []
    for number, lists in enumerate(zip(*turns, strict=True)):
        cells = [cell for one in lists for cell in one]
        order += [cells[i] for i in np.random.default_rng([seed, number]).permutation(len(cells))]
    return order
