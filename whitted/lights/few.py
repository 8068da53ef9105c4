"""The choice of one light among few, each weighed by itself and with what the surface makes of its light."""

import drjit as dr
import mitsuba as mi

from whitted.lights.importance import importance
from whitted.lights.tree_build import Lights, build

MOST = 4


class FewLights:
    """Up to `MOST` lights, given by their bounds alone; the arguments are those of ``LightTree``.

    Each is chosen with the share of its `importance`. The shares at a vertex are numbers in the kernel, which a ray can
    take along for the light that it may meet.
    """

    def __init__(self, lower, upper, power, axis, cos_spread, cos_emission):
        lights = Lights(lower, upper, power, axis, cos_spread, cos_emission)
        self.count = lights.count
        bounds, *_, slot = build(lights)
        # Scalars in memory: the kernel reads them once for all lanes, and serves all values
        self.bounds = [[dr.opaque(mi.Float, float(number)) for number in row] for row in bounds[slot]]

    @property
    def shares_type(self):
        """The type of ``shares``."""
        return {1: mi.Float, 2: mi.Vector2f, 3: mi.Vector3f, 4: mi.Vector4f}[self.count]

    def shares(self, p, n, response=None):
        """Return the probabilities of the lights (``shares_type``), all 0 where no light comes from any.

        Args:
            p, n: the receiver, as for ``LightTree.sample``.
            response: maps unit directions, a list of ``Vector3f`` [M], to a mask and a list of ``Float`` [M]: where and
                how much the surface scatters from there, see `importance`.
        """
        if self.count == 1:
            return mi.Float(1)
        responses = [None] * self.count
        if response is not None:
            centres = [mi.Point3f(*row[:3]) for row in self.bounds]
            mask, values = response([dr.normalize(centre - p) for centre in centres])
            responses = [(mask, value) for value in values]
        weights = [importance(row, p, n, known) for row, known in zip(self.bounds, responses, strict=True)]
        total = sum(weights)
        return self.shares_type(weights) * dr.select(total > 0, dr.rcp(total), 0)

    def sample(self, shares, u):
        """Choose a light by a ``Float`` [M] in [0, 1): its number (``UInt32``), its probability, if there is one."""
        if self.count == 1:
            return mi.UInt32(0), shares, mi.Bool(True)
        leaf, probability, below = mi.UInt32(0), mi.Float(0), mi.Float(0)
        for number in range(self.count):  # the last one that isn't 0 and doesn't start beyond u
            taken = (shares[number] > 0) & (below <= u)
            leaf = dr.select(taken, number, leaf)
            probability = dr.select(taken, shares[number], probability)
            below += shares[number]
        return leaf, probability, probability > 0

    def probability(self, shares, leaf):
        """Return the probability of a light, 0 to ``count``."""
        return shares if self.count == 1 else pick(list(shares), leaf)


def pick(column, number):
    """Return the entry of a short list of values for a ``number``, ``int`` or ``UInt32`` [M]."""
    if isinstance(number, int):
        return column[number]
    found = column[0]
    for index, value in enumerate(column[1:], 1):
        found = dr.select(number == index, value, found)
    return found
