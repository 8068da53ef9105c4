"""The random numbers of one sample, named by the effect and by the node of the ray tree that they serve.

A number is a pure function of its arguments, so depth-first and breadth-first traversals draw the same ones,
an effect can be left out or frozen without touching the others, and a render resumes at any index.
"""

import drjit as dr
import mitsuba as mi

from whitted.sampling.sequences import hash4, owen_scramble, sobol_2d, to_unit
from whitted.sampling.sobol import digits, pascal, scrambled

EFFECTS = ("pixel", "lens", "time", "light", "gloss", "hemisphere", "branch", "wavelength")
AUDIT = 0x9E3779B9  # sets the numbers apart that choose what is measured from those that make the picture


class Draws:
    """Owen-scrambled Sobol' points over the sample index.

    What is drawn for the effects of ``joint`` before the first branch, at node 0, are coordinates of one point, so that
    effects are stratified together. All other draws, one for each effect, node and split, are (0, 2)-points of their
    own, in an order of their own.

    Args:
        pixel: ``UInt32`` [N], the pixel's number in the whole film, so that a crop draws the same numbers.
        index: ``UInt32`` [N], the sample's number within the pixel.
        seed: ``UInt32`` [N or 1]; different seeds give independent randomisations.
        block: ``UInt32`` [N], the number of the pixel's block; audits are decided alike in a whole block.
        joint: from names of ``EFFECTS`` to the first of two dimensions of the point; see ``joint_dimensions``.
        bits: ``int``, the index is below ``2**bits``.
    """

    def __init__(self, pixel, index, seed, block, joint=None, bits=32):
        self.pixel, self.index, self.seed, self.block = pixel, index, seed, block
        self.joint, self.bits = joint or {}, bits
        self.state = None

    def __call__(self, effect, node=0, split=0, part=None):
        """Return a ``Point2f`` in [0, 1)^2 for an effect at a node.

        Args:
            effect: one of ``EFFECTS``, or a mask and two of them, the first where the mask is set.
            node: ``UInt32`` [N].
            split: ``int`` or ``UInt32``, tells several draws for one effect at one node apart.
            part: where a sample draws several times for the same, the number of the draw and how many there are
                (``UInt32``): together with those of the other samples they make up one sequence.
        """
        index = self.index if part is None else self.index * part[1] + part[0]
        key = mi.UInt32(split) * len(EFFECTS) + _number(effect)
        node = mi.UInt32(node)
        order, *seeds = hash4(self.pixel, key, self.seed, node)[1:]
        first = self.joint.get(effect if isinstance(effect, str) else effect[1])
        if first is None or part is not None or not (isinstance(split, int) and split == 0):
            return sobol_2d(index, (order, *seeds))
        words = [digits(index, first + k, self.bits) for k in range(2)]
        if not (node.state == dr.VarState.Literal and node[0] == 0):
            shuffled = owen_scramble(index, order)
            words = [
                dr.select(node == 0, *pair) for pair in zip(words, (shuffled, pascal(shuffled)), strict=True)
            ]
        return mi.Point2f(*(scrambled(word, seed) for word, seed in zip(words, seeds, strict=True)))

    def audit(self, node):
        """Return a ``Float`` in [0, 1) that decides what is measured at a node, without a say in the picture.

        It is the same in all pixels of a block, so that their rays stay together.
        """
        return to_unit(hash4(self.block, self.index, self.seed + AUDIT, mi.UInt32(node))[0])


def joint_dimensions(plan):
    """Return the ``joint`` of `Draws` for what a plan simulates: what isn't called for takes no dimension."""
    wanted = {
        "pixel": "antialiasing" in plan,
        "lens": "depth_of_field" in plan,
        "light": "soft_shadows" in plan,
        "gloss": any(effect in plan for effect in ("gloss", "translucency", "interreflection")),
    }
    names = [name for name, is_wanted in wanted.items() if is_wanted]
    return {name: 2 * number for number, name in enumerate(names)}


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

    def __call__(self, effect, node=0, split=0, part=None):
        """Return the sampler's next ``Point2f``; the arguments don't matter."""
        return self.sampler.next_2d()

    def audit(self, node):
        """Return the sampler's next ``Float``."""
        return self.sampler.next_1d()
