"""The families of hard cases: a module for each, and what is left to other parts of the toolkit."""

import importlib

from whitted.errors import UsageError, nearest
from whitted.hardcases.case import FAMILIES

MODULES = (
    "spheres",
    "planes",
    "surfaces",
    "scenes",
    "furnaces",
    "stacks",
    "lights",
    "penumbrae",
    "camera",
    "reflection",
    "specular",
    "gloss",
    "values",
    "statistics",
)

# Numbers of the catalogue that need what the toolkit doesn't have yet
LATER = {
    "moving objects": ("73", "74", "75", "76", "77", "78"),
    "adaptive sampling": ("87", "88"),
    "structures of its own": ("78",),
    "instances in instances": ("R12",),
    "smoothed shadow terminators, which Mitsuba's pictures don't have either": ("26",),
}


def families():
    """Return the cases, a dict from family to a dict from name to `whitted.hardcases.case.Case`."""
    for name in MODULES:
        importlib.import_module(f"whitted.hardcases.{name}")
    return FAMILIES


def chosen(only=None):
    """Return a list of cases: all, those of a family, or one.

    Raises:
        UsageError: ``only`` is neither.
    """
    known = families()
    cases = {name: case for family in known.values() for name, case in family.items()}
    if only is None:
        return list(cases.values())
    if only in known:
        return list(known[only].values())
    if only in cases:
        return [cases[only]]
    raise UsageError(f"no family or case is called {only!r}{nearest(only, [*known, *cases])}")
