"""What a stable form costs in time and gains in digits over the textbook's, in single and in double precision."""

import math
import statistics
from dataclasses import asdict, dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

LANES, ROUNDS, TURNS = 1 << 16, 64, 5  # of one measurement; how often each is repeated
CHECKED = 256  # inputs at which digits are counted
PRECISIONS = {"single": np.float32, "double": np.float64}
MOST_DIGITS = 16.0


@dataclass(frozen=True)
class Pair:
    """A textbook form and the stable one beside it.

    Attributes:
        name: of what both compute, and where.
        textbook, stable: functions of the same Dr.Jit arrays to one ``Float``.
        inputs: function of a ``np.random.Generator`` and a number N to a tuple of arrays, [N] or [3, N].
        truth: function of the same inputs, numbers and lists of three of mpmath, to a number.
    """

    name: str
    textbook: object
    stable: object
    inputs: object
    truth: object


@dataclass(frozen=True)
class Cost:
    """What was measured of a `Pair` in ``single`` or ``double`` precision.

    Attributes:
        pair, precision: of what.
        textbook_ns, stable_ns: nanoseconds of one thread for one evaluation, median of `TURNS` taken in turn.
        textbook_digits, stable_digits: decimal digits that are right, in nine of ten inputs; 16 at most.
    """

    pair: str
    precision: str
    textbook_ns: float
    stable_ns: float
    textbook_digits: float
    stable_digits: float

    def to_dict(self):
        """Return the numbers for JSON."""
        return asdict(self)


def measure(pair):
    """Return the `Cost` of a `Pair` in each precision, a list."""
    return [_measure(pair, precision) for precision in PRECISIONS]


def _measure(pair, precision):
    forms = {"textbook": pair.textbook, "stable": pair.stable}
    timed = _arrays(pair.inputs(np.random.default_rng(1), LANES), precision)
    seconds = {name: [] for name in forms}
    for turn in range(TURNS + 1):
        for name, form in forms.items():
            took = _seconds(form, timed, precision)
            if turn:  # the first one compiles
                seconds[name].append(took)
    drawn = pair.inputs(np.random.default_rng(2), CHECKED)
    inputs = [np.asarray(x, PRECISIONS[precision]) for x in drawn]
    truth = _truth(pair, inputs)
    digits = [_digits(form(*_arrays(inputs, precision)), truth) for form in forms.values()]
    unit = 1e9 * dr.thread_count() / (LANES * ROUNDS)
    return Cost(pair.name, precision, *(statistics.median(seconds[name]) * unit for name in forms), *digits)


def _arrays(inputs, precision):
    """Dr.Jit arrays of a precision, vectors where there are three rows."""
    vector, number = _types(precision)
    return [(vector if np.ndim(x) == 2 else number)(np.asarray(x, PRECISIONS[precision])) for x in inputs]


def _types(precision):
    return (mi.Vector3f, mi.Float32) if precision == "single" else (mi.Vector3d, mi.Float64)


def _seconds(form, inputs, precision):
    """The kernel's seconds for `ROUNDS` evaluations in each lane, each of inputs a little different."""
    _, number = _types(precision)

    def step(i, total):
        first = inputs[0] * (1 + number(i) * 2.0**-20)
        return i + 1, total + form(first, *inputs[1:])

    dr.eval(inputs)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        start = (dr.zeros(mi.UInt32, LANES), dr.zeros(number, LANES))
        _, total = dr.while_loop(start, lambda i, total: i < ROUNDS, step, label="form")
        dr.eval(total)
        dr.sync_thread()
        return sum(kernel["execution_time"] for kernel in dr.kernel_history((dr.KernelType.JIT,))) / 1000


def _truth(pair, inputs):
    """The exact results, ``longdouble`` [N]."""
    import mpmath

    with mpmath.workdps(40):
        rows = [[mpmath.mpf(float(v)) for v in x] if np.ndim(x) == 1 else _columns(x, mpmath) for x in inputs]
        return [pair.truth(*row) for row in zip(*rows, strict=True)]


def _columns(x, mpmath):
    return [[mpmath.mpf(float(v)) for v in column] for column in x.T]


def _digits(found, truth):
    """Decimal digits that nine of ten results have right."""
    import mpmath

    found = np.array(found, np.float64)
    with mpmath.workdps(40):
        errors = [
            abs(mpmath.mpf(float(value)) - exact) / abs(exact) if math.isfinite(value) else 1.0
            for value, exact in zip(found, truth, strict=True)
        ]
    worst = float(sorted(errors)[round(0.9 * (len(errors) - 1))])
    return min(max(0.0, -math.log10(worst)), MOST_DIGITS) if worst else MOST_DIGITS
