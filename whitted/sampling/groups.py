"""How the samples of a pixel are shared out over groups, between which the error is estimated."""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from whitted.sampling.draws import Switched

SEGMENTS = 8


@dataclass(frozen=True)
class Segments:
    """One low-discrepancy sequence over all samples, cut into eight segments.

    The spread between the segments is an upper bound of the error, as they are negatively correlated. Sample ``t``
    belongs to the group of its three binary digits after the leading one, and for ``t < 8`` to group ``t``: in each
    octave of the sequence a group thus has an aligned block, which is stratified in itself, and where a sample
    belongs doesn't depend on how many follow.
    """

    seed: int
    count: int = SEGMENTS
    kind: str = "segments (upper bound)"

    def number(self, t):
        """Return the index within its sequence (``UInt32``) and the seed of the samples ``t`` (``UInt32``)."""
        return t, opaque_seed(self.seed)

    def end(self, start, wanted):
        """Return where a pass that begins at ``start`` has to end at the latest, at most ``wanted`` samples on."""
        octave = SEGMENTS if start < SEGMENTS else 1 << start.bit_length()
        return min(start + wanted, octave)

    def pieces(self, start, stop):
        """Yield ``(group, first, stride, count)``: the samples in ``[start, stop)`` that each group has."""
        octave = 0 if start < SEGMENTS else 1 << (start.bit_length() - 1)
        length = max(octave // SEGMENTS, 1)
        for group in range(SEGMENTS):
            first = max(start, octave + group * length)
            last = min(stop, octave + (group + 1) * length)
            if last > first:
                yield group, first, 1, last - first


@dataclass(frozen=True)
class Replicates:
    """Independent randomisations, which the samples go to in turn: the spread gives the standard error itself."""

    seed: int
    count: int
    kind: str = "replicates"

    def number(self, t):
        """Return the index within its sequence (``UInt32``) and the seed of the samples ``t`` (``UInt32``)."""
        seeds = dr.concat([opaque_seed(self.seed, replicate) for replicate in range(self.count)])
        return t // self.count, dr.gather(mi.UInt32, seeds, t % self.count)

    def end(self, start, wanted):
        """Return where a pass that begins at ``start`` has to end at the latest, at most ``wanted`` samples on."""
        return start + wanted

    def pieces(self, start, stop):
        """Yield ``(group, first, stride, count)``: the samples in ``[start, stop)`` that each group has."""
        for offset in range(min(self.count, stop - start)):
            first = start + offset
            yield first % self.count, first, self.count, -(-(stop - first) // self.count)


@dataclass(frozen=True)
class Evaluations(Replicates):
    """Replicates of which one effect's numbers are taken from others, for Sobol' indices by pick-freeze.

    Evaluation ``r`` has two independent seeds; all draws have the first, but those for ``effect`` the second.

    Args:
        first: number of the first evaluation; ``count`` is how many there are, 2 or more.
        effect: one of ``whitted.sampling.draws.EFFECTS``; None: all draws have the first seed.
        swapped: the seeds change places.
    """

    first: int = 0
    effect: str | None = None
    swapped: bool = False

    def number(self, t):
        """Return the index within its sequence (``UInt32``) and the seeds (`Switched`) of the samples ``t``."""
        numbers = range(self.first, self.first + self.count)
        pair = [
            dr.concat([opaque_seed(self.seed, 2 * number + side) for number in numbers])
            for side in ((1, 0) if self.swapped else (0, 1))
        ]
        one, other = (dr.gather(mi.UInt32, seeds, t % self.count) for seeds in pair)
        return t // self.count, Switched(one, other, self.effect)


def opaque_seed(seed, replicate=0):
    """Spread a user's seed (``int``, any size) and the number of a replicate over 32 bits.

    Returns an opaque ``UInt32``: the value is data and not part of the kernel, which is thus compiled once.
    """
    mixed = (int(seed) * 0x9E3779B97F4A7C15 + int(replicate) * 0xD1B54A32D192ED03) % 2**64
    return dr.opaque(mi.UInt32, ((mixed ^ (mixed >> 29)) * 0xBF58476D1CE4E5B9 % 2**64) >> 32)
