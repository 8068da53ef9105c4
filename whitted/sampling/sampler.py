"""What the Mitsuba samplers of Sobol' points share: joint dimensions first, then padded pairs.

Source: [KolligKeller2002] for padding with randomised points of two dimensions; the rest as in
``whitted.sampling.sobol``. Left out: Mitsuba's scalar variants, and drawing in functions under ``dr.freeze``, which
refuse the table of matrices that a draw in a loop looks up.
"""

import functools

import drjit as dr
import mitsuba as mi

from whitted.errors import UsageError
from whitted.sampling.sequences import hash4, owen_scramble
from whitted.sampling.sobol import digits, pascal, scrambled

JOINT = (
    8  # numbers that are one point of the sequence: in Mitsuba's path those of the pixel and the first hit
)
MAX_COUNT = 1 << 24
UNCHANGED = 0xFFFFFFFF  # Mitsuba's default for the size of the wavefront


def numbers(index, bits, key, dimension, count):
    """Return the next one or two numbers of a sample.

    Args:
        index: ``UInt32`` [N] below ``2**bits``, the sample's position in the sequence.
        bits: ``int``, 1 to 32.
        key: three ``UInt32`` [N or 1] that stand for the randomisation.
        dimension: ``UInt32`` [N or 1], how many numbers have been drawn; a literal makes for faster code.
        count: 1 or 2.

    Returns:
        List of ``Float`` [N] in [0, 1). The first ``JOINT`` numbers are coordinates of one point; the others come
        from (0, 2)-sequences, the order of which is shuffled anew for each draw.
    """
    order, *seeds = hash4(key[0], dimension, key[1], key[2])[1:]
    if dimension.state == dr.VarState.Literal:
        first = int(dimension[0])
        joint = first + count <= JOINT
        words = (
            [digits(index, first + k, bits) for k in range(count)] if joint else _padded(index, bits, order)
        )
    else:
        joint = dimension + count <= JOINT
        near = [digits(index, dimension + k, bits, joint) for k in range(2)]
        words = [dr.select(joint, *pair) for pair in zip(near, _padded(index, bits, order), strict=True)]
    return [scrambled(words[k], seeds[k]) for k in range(count)]


def _padded(index, bits, order):
    """The digits of the point of a (0, 2)-sequence, in an order that keeps aligned blocks together."""
    shuffled = owen_scramble(index, order) & mi.UInt32((1 << bits) - 1)
    return shuffled, pascal(shuffled, bits)


def whole_number(props, name, default, low, high):
    """Return an integer parameter of a plugin, checked.

    Raises:
        UsageError: it is missing and has no default (None), or is no whole number from ``low`` to ``high``.
    """
    if default is None and name not in props:
        raise UsageError(f"{props.plugin_name()} needs {name}, a whole number from {low} to {high}")
    value = props.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise UsageError(f"{name} is {value}; accepted are whole numbers from {low} to {high}")
    return value


def divided(number, divisor):
    """Return ``number // divisor`` (``UInt32`` [N], ``int``), where it can by a shift, which is much faster."""
    if divisor & (divisor - 1) == 0:
        return number >> dr.opaque(mi.UInt32, divisor.bit_length() - 1)
    return number // dr.opaque(mi.UInt32, divisor)


@functools.cache
def sampler_type(variant):
    """Return the class that the samplers derive from, for a variant that is active."""

    class SobolSampler(mi.Sampler):
        """Derived classes say in ``place`` which point of which sequence a lane has.

        Mitsuba carries all attributes that are Dr.Jit arrays, in lists too, through its loops.
        """

        def __init__(self, props):
            whole_number(props, "sample_count", 4, 1, MAX_COUNT)
            base_seed = whole_number(props, "seed", 0, 0, 2**32 - 1)
            super().__init__(props)
            self.base_seed = base_seed
            self.per_pass = 0  # samples of a pixel in a pass; 0 where nobody has said it
            self.stride = 1  # how far a pass takes a pixel on in its sequence
            self.words = [mi.UInt32(0), mi.UInt32(0)]  # the seeds, of a render and of the scene
            self.taken = mi.UInt32(0)  # how far the passes before have come
            self.index, self.bits, self.key = mi.UInt32(0), 32, [mi.UInt32(0)] * 3
            self.dimension = mi.UInt32(0)

        def place(self, lane):
            """Set ``stride``, ``index``, ``bits`` and ``key``, as for ``numbers``, of the lanes (``UInt32`` [N])."""
            raise NotImplementedError

        def seed(self, seed, wavefront_size=UNCHANGED):
            """Start anew with another randomisation, on a wavefront of the given size."""
            word = mi.UInt32(seed % 2**32 if isinstance(seed, int) else seed)
            super().seed(word, wavefront_size)
            dr.make_opaque(word)  # data, no part of the kernel
            self.words = [word, dr.opaque(mi.UInt32, self.base_seed)]
            self._start(dr.opaque(mi.UInt32, 0))

        def advance(self):
            """Go on to the next pass."""
            # Not super().advance(): called from Python, Mitsuba's method calls this one again
            self._start(self.taken + dr.opaque(mi.UInt32, self.stride))

        def _start(self, taken):
            self.taken, self.dimension = taken, mi.UInt32(0)
            self.place(dr.arange(mi.UInt32, self.wavefront_size()))

        def next_1d(self, active=True):
            """Return the next number, ``Float`` [N] in [0, 1)."""
            return self._next(1)[0]

        def next_2d(self, active=True):
            """Return the next two numbers, ``Point2f`` [N] in [0, 1)^2."""
            return mi.Point2f(*self._next(2))

        def _next(self, count):
            drawn = numbers(self.index, self.bits, self.key, self.dimension, count)
            self.dimension = self.dimension + count
            return drawn

        def set_sample_count(self, count):
            """Set the number of samples per pixel."""
            if not 1 <= count <= MAX_COUNT:
                raise UsageError(f"sample_count is {count}; accepted are whole numbers from 1 to {MAX_COUNT}")
            super().set_sample_count(count)
            self.per_pass = 0

        def set_samples_per_wavefront(self, count):
            """Say how many samples of each pixel a pass takes."""
            super().set_samples_per_wavefront(count)
            self.per_pass = count

        def schedule_state(self):
            """Schedule what changes from pass to pass."""
            super().schedule_state()
            dr.schedule(self.taken, self.dimension)

        def fork(self):
            """Return a sampler with the same parameters; for Mitsuba's sake it also has the same state."""
            return self.clone()

        def clone(self):
            """Return a sampler that goes on with the same numbers."""
            props = mi.Properties()
            for name, value in self.parameters().items():
                props[name] = value
            other = type(self)(props)
            if self.wavefront_size():
                mi.Sampler.seed(other, 0, self.wavefront_size())
            for name, value in vars(self).items():
                setattr(other, name, dr.copy(value))  # loops change arrays in place
            return other

        def parameters(self):
            """Return the parameters of the plugin as a ``dict``."""
            return {"sample_count": self.sample_count(), "seed": self.base_seed}

        def to_string(self):
            """Return the parameters on one line."""
            listed = ", ".join(f"{name}={value}" for name, value in self.parameters().items())
            return f"{type(self).__name__}[{listed}]"

    return SobolSampler
