"""What a hard case is: something swept, a truth, a tolerance, and the errors of the forms that are compared.

A case is a function of the swept value that returns `Errors`. Its docstring says what is computed, its decorator the
rest:

    @case("8", "spheres", unit="radii", sweep=("distance", (1e1, 1e3, 1e6)), tolerance=2 * U,
          why="two roundings of the radius", source="PharrJakobHumphreys2023")
    def point_on_a_far_sphere(distance):
        "How far a hit lies off the sphere."
        ...
        return Errors(ours=..., textbook=..., reference=...)

The truth is computed in double precision or better from the same rounded input.
"""

import math
from dataclasses import dataclass, field

import numpy as np

FAMILIES = {}  # by name, the cases in their order


@dataclass(frozen=True)
class Errors:
    """The largest error of each form at one value of the sweep; None where there is no such form.

    Arrays stand for their maximum, and what is no number for an infinite error.

    Attributes:
        ours: of what the toolkit does.
        textbook: of the formula as it is usually written.
        reference: of Mitsuba.
    """

    ours: object
    textbook: object = None
    reference: object = None

    def __post_init__(self):
        for name in ("ours", "textbook", "reference"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _largest(value))


@dataclass(frozen=True)
class Case:
    """A hard case; see the module.

    Attributes:
        name: of its function.
        number: in the catalogue, text.
        family: what it is listed under.
        asks: what is computed, a clause.
        unit: of the errors.
        parameter: what is swept; empty where nothing is.
        values: of the sweep.
        tolerance: number, or a function of the swept value.
        why: where the tolerance comes from, a clause.
        source: key of ``references.bib``, or what the truth was derived from.
        measure: function of the swept value to `Errors`.
    """

    name: str
    number: str
    family: str
    asks: str
    unit: str
    parameter: str
    values: tuple
    tolerance: object
    why: str
    source: str
    measure: object = field(repr=False)

    def run(self):
        """Return the `Result` of the whole sweep."""
        points = []
        for value in self.values or (None,):
            with np.errstate(all="ignore"):  # what is no number counts as an infinite error
                found = self.measure() if value is None else self.measure(value)
            tolerance = self.tolerance(value) if callable(self.tolerance) else self.tolerance
            points.append(Point(value, found.ours, found.textbook, found.reference, float(tolerance)))
        return Result(self, tuple(points))


@dataclass(frozen=True)
class Point:
    """The errors and the tolerance at one value of the sweep."""

    value: float | None
    ours: float
    textbook: float | None
    reference: float | None
    tolerance: float


@dataclass(frozen=True)
class Result:
    """What came of a case."""

    case: Case
    points: tuple

    def worst(self, form):
        """Return the `Point` at which a form (``ours``, ``textbook``, ``reference``) is worst against the tolerance.

        None where there is no such form.
        """
        points = [point for point in self.points if getattr(point, form) is not None]
        return max(points, key=lambda point: _excess(getattr(point, form), point.tolerance), default=None)

    def holds(self, form="ours"):
        """Return whether a form keeps the tolerance at every value; None where there is no such form."""
        point = self.worst(form)
        return None if point is None else getattr(point, form) <= point.tolerance

    def to_dict(self):
        """Return the numbers for JSON; an infinite error is the text ``"inf"``, since JSON has none."""
        case, ours = self.case, self.worst("ours")

        def of(form):
            point = self.worst(form)
            return None if point is None else _plain(getattr(point, form))

        return {
            "case": case.name,
            "number": case.number,
            "family": case.family,
            "asks": case.asks,
            "holds": self.holds(),
            "textbook_holds": self.holds("textbook"),
            "reference_holds": self.holds("reference"),
            "error": of("ours"),
            "tolerance": _plain(ours.tolerance),
            "textbook_error": of("textbook"),
            "reference_error": of("reference"),
            "unit": case.unit,
            "parameter": case.parameter,
            "why": case.why,
            "source": case.source,
            "points": [
                {name: _plain(getattr(point, name)) for name in Point.__dataclass_fields__}
                for point in self.points
            ],
        }


def case(number, family, *, tolerance, why, source, unit="", sweep=("", ())):
    """Register the decorated function as the `Case` of its name; the arguments are those of `Case`.

    Args:
        sweep: what is swept, and the values.
    """

    def register(measure):
        asks = measure.__doc__[0].lower() + measure.__doc__[1:].rstrip(".")
        made = Case(measure.__name__, number, family, asks, unit, *sweep, tolerance, why, source, measure)
        assert not any(made.name in known for known in FAMILIES.values()), f"two cases are called {made.name}"
        FAMILIES.setdefault(family, {})[made.name] = made
        return measure

    return register


def _largest(error):
    error = np.abs(np.asarray(error, np.float64))
    return float(np.where(np.isnan(error), np.inf, error).max(initial=0.0))


def _excess(error, tolerance):
    return error / tolerance if tolerance else (math.inf if error else 0.0)


def _plain(value):
    return value if value is None or math.isfinite(value) else "inf"
