"""Runs hard cases, and shows what came of them: as a table, as JSON, as plots of error against what was swept."""

import html
import json
from dataclasses import dataclass, field
from pathlib import Path

from whitted import _backend, files
from whitted.hardcases import regime
from whitted.hardcases.families import LATER, chosen
from whitted.hardcases.forms import measure
from whitted.hardcases.pairs import PAIRS

LABELS = {"textbook": "textbook form", "ours": "ours", "reference": "Mitsuba"}


@dataclass(frozen=True)
class Stability:
    """What came of the hard cases.

    Attributes:
        results: `whitted.hardcases.case.Result` of each.
        forms: `whitted.hardcases.forms.Cost` of textbook forms and the stable ones beside them; empty if not asked for.
        regime: what Mitsuba's numbers are of, a dict, see `whitted.hardcases.regime`.
    """

    results: tuple
    forms: tuple
    regime: dict = field(repr=False)

    @property
    def holds(self):
        """Whether every case keeps its tolerance."""
        return all(result.holds() for result in self.results)

    @property
    def broken_by_textbook(self):
        """The cases in which the textbook form misses the tolerance that ours meets, a list of `Result`."""
        return [r for r in self.results if r.holds() and r.holds("textbook") is False]

    def to_dict(self):
        """Return all numbers for JSON."""
        return {
            "holds": self.holds,
            "cases": [result.to_dict() for result in self.results],
            "forms": [cost.to_dict() for cost in self.forms],
            "later": {name: list(numbers) for name, numbers in LATER.items()},
            "regime": self.regime,
        }

    def write(self, path):
        """Write the numbers as JSON.

        Raises:
            UsageError: the file can't be written.
        """
        files.write(path, json.dumps(self.to_dict(), indent=2) + "\n")

    def plot(self, folder):
        """Write a PNG for each family that sweeps something: error against what is swept. Return the paths.

        Raises:
            UsageError: matplotlib isn't installed, or a file can't be written.
        """
        from whitted.hardcases.plots import plot

        families = dict.fromkeys(result.case.family for result in self.results)
        made = [plot(family, self._of(family), Path(folder), LABELS) for family in families]
        return [path for path in made if path is not None]

    def _of(self, family):
        return [result for result in self.results if result.case.family == family]

    def _repr_html_(self):
        rows = "".join(
            f"<tr><td>{html.escape(r.case.name)}</td>"
            + "".join(f"<td>{shown(r, form)}</td>" for form in LABELS)
            + f"<td>{shown_tolerance(r)}</td><td>{'holds' if r.holds() else 'broken'}</td></tr>"
            for r in self.results
        )
        heads = "".join(f"<th>{name}</th>" for name in ("case", *LABELS.values(), "tolerance", "verdict"))
        return f"<table><tr>{heads}</tr>{rows}</table>"


def stability(only=None, *, forms=True, progress=None):
    """Run the hard cases, each against its truth.

    Args:
        only: a family or a case; None: all.
        forms: whether to measure what the stable forms cost and gain, too, where nothing is picked.
        progress: is called with the name of each case before it runs.

    Returns:
        `Stability`.

    Raises:
        UsageError: there is no such family or case.
        BackendError: there is no usable LLVM.
    """
    _backend.activate()
    results = []
    for each in chosen(only):
        if progress:
            progress(each.name)
        results.append(each.run())
    costs = [cost for pair in PAIRS for cost in measure(pair)] if forms and only is None else []
    return Stability(tuple(results), tuple(costs), regime.found())


def shown(result, form):
    """Return the worst error of a form as text; a dash where there is no such form."""
    point = result.worst(form)
    return "-" if point is None else f"{getattr(point, form):.2g}"


def shown_tolerance(result):
    """Return the tolerance where ours is worst, as text."""
    return f"{result.worst('ours').tolerance:.2g}"
