"""The random numbers of one sample, named by the effect and by the node of the ray tree that they serve.

A number is a pure function of its arguments, so depth-first and breadth-first traversals draw the same ones,
an effect can be left out or frozen without touching the others, and a render resumes at any index.
"""

import copy

import drjit as dr
import mitsuba as mi

from whitted.sampling.sequences import hash4, owen_scramble, sobol_2d, to_unit
from whitted.sampling.sobol import digits, pascal, scrambled

EFFECTS = ("pixel", "lens", "time", "light", "gloss", "hemisphere", "branch", "wavelength")
AUDIT = 0x9E3779B9  # sets the numbers apart that choose what is measured from those that make the picture


class Draws:
    """Owen-scrambled Sobol' points over the sample index.

    What is drawn for the effects of ``joint`` is coordinates of one point, so that they are stratified together. All
    other draws, one for each effect, node and split, are (0, 2)-points of their own, in an order of their own.

    Args:
        pixel: ``UInt32`` [N], the pixel's number in the whole film, so that a crop draws the same numbers.
        index: ``UInt32`` [N], the sample's number within the pixel.
        seed: ``UInt32`` [N or 1], or `Switched`; different seeds give independent randomisations.
        block: ``UInt32`` [N], the number of the pixel's block; audits are decided alike in a whole block.
        joint: from (name in ``EFFECTS``, node) to the first of two dimensions of the point; see ``joint_dimensions``.
        bits: ``int``, the index is below ``2**bits``.
    """

    def __init__(self, pixel, index, seed, block, joint=None, bits=32):
        self.pixel, self.index, self.seed, self.block = pixel, index, seed, block
        self.joint, self.bits = joint or {}, bits
        self.drawn = set()  # the effects that numbers were asked for, also of copies
        self.state = None

    def __call__(self, effect, node=0, split=0):
        """Return a ``Point2f`` in [0, 1)^2 for an effect at a node.

        Args:
            effect: one of ``EFFECTS``, or a mask and two of them, the first where the mask is set.
            node: ``UInt32`` [N].
            split: ``int`` or ``UInt32``, tells several draws for one effect at one node apart.
        """
        self.drawn.update([effect] if isinstance(effect, str) else effect[1:])
        key = mi.UInt32(split) * len(EFFECTS) + _number(effect)
        node = mi.UInt32(node)
        seed = self.seed.of(_number(effect)) if isinstance(self.seed, Switched) else self.seed
        order, *seeds = hash4(self.pixel, key, seed, node)[1:]
        joint = self._joint(effect, node) if isinstance(split, int) and split == 0 else {}
        if not joint:
            return sobol_2d(self.index, (order, *seeds))
        shuffled = owen_scramble(self.index, order)
        words = [shuffled, pascal(shuffled)]
        for number, first in joint.items():
            own = [digits(self.index, first + k, self.bits) for k in range(2)]
            words = [dr.select(node == number, *pair) for pair in zip(own, words, strict=True)]
        return mi.Point2f(*(scrambled(word, seed) for word, seed in zip(words, seeds, strict=True)))

    def _joint(self, effect, node):
        """The first dimension in the joint point by the nodes at which an effect has one, those that may be meant."""
        name = effect if isinstance(effect, str) else effect[1]
        known = node[0] if node.state == dr.VarState.Literal else None
        return {
            number: first
            for (joint, number), first in self.joint.items()
            if joint == name and known in (None, number)
        }

    def refined(self):
        """Return the same numbers, from sequences that are long enough for up to 256 parts of each sample."""
        other = copy.copy(self)
        other.bits = min(self.bits + 8, 32)
        return other

    def at(self, index):
        """Return the numbers of another sample of the pixel, or of a part of one."""
        other = copy.copy(self)
        other.index = index
        return other

    def part(self, number, count):
        """Return the numbers of one of ``count`` parts of the sample: together they make up a finer sequence."""
        return self.at(self.index * count + number)

    def audit(self, node):
        """Return a ``Float`` in [0, 1) that decides what is measured at a node, without a say in the picture.

        It is the same in all pixels of a block, so that their rays stay together.
        """
        seed = self.seed.one if isinstance(self.seed, Switched) else self.seed
        return to_unit(hash4(self.block, self.index, seed + AUDIT, mi.UInt32(node))[0])


class Switched:
    """Seeds of which one effect has another than the rest.

    Which one is data, so that one kernel serves for all of them.

    Args:
        one: ``UInt32`` [N or 1].
        other: ``UInt32`` [N or 1], the seed of the draws for ``effect``.
        effect: one of ``EFFECTS``; None: all have ``one``.
    """

    def __init__(self, one, other, effect=None):
        number = len(EFFECTS) if effect is None else EFFECTS.index(effect)
        self.one, self.other, self.number = one, other, dr.opaque(mi.UInt32, number)

    def of(self, number):
        """Return the seed of an effect, given by its number in ``EFFECTS`` (``int`` or ``UInt32`` [N])."""
        return dr.select(self.number == number, self.other, self.one)


def joint_dimensions(plan):
    """Return the ``joint`` of `Draws` for what a plan simulates: what isn't called for takes no dimension.

    The first dimensions of the sequence are the best. Lights at the second surface gain nothing from being among them.
    """
    scatters = any(effect in plan for effect in ("gloss", "translucency", "interreflection"))
    wanted = {
        ("pixel", 0): "antialiasing" in plan,
        ("lens", 0): "depth_of_field" in plan,
        ("gloss", 0): scatters,
        ("light", 0): "soft_shadows" in plan,
        ("gloss", 1): scatters,
        ("time", 0): "motion_blur" in plan,
    }
    drawn = [draw for draw, is_wanted in wanted.items() if is_wanted]
    return {draw: 2 * number for number, draw in enumerate(drawn)}


def _number(effect):
    if isinstance(effect, str):
        return EFFECTS.index(effect)
    mask, first, second = effect
    return dr.select(mask, mi.UInt32(EFFECTS.index(first)), mi.UInt32(EFFECTS.index(second)))


class SamplerDraws:
    """The numbers of a Mitsuba sampler, in the order in which they are asked for.

    For integrators nested in C++, where the sampler is all that is given. ``state`` has to be part of the state
    of any symbolic loop that draws.
    """

    def __init__(self, sampler):
        self.sampler = self.state = sampler
        self.index = mi.UInt32(0)

    def __call__(self, effect, node=0, split=0):
        """Return the sampler's next ``Point2f``; the arguments don't matter."""
        return self.sampler.next_2d()

    def refined(self, *_):
        """Return the same: further parts take further numbers."""
        return self

    at = part = refined

    def audit(self, node):
        """Return the sampler's next ``Float``."""
        return self.sampler.next_1d()
