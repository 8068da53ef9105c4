"""The samplers of Sobol' points, registered for the variant that is active."""

import importlib

import mitsuba as mi

OURS = ("owen_sobol", "zsobol")


def register():
    """Run the plugins' modules for the active variant."""
    for name in OURS:
        importlib.reload(importlib.import_module(f"whitted.samplers.{name}"))


def make(kind, width=8, height=8, count=16, **parameters):
    """Return a sampler of any kind for a film of the given size."""
    if kind == "zsobol":
        parameters |= {"width": width, "height": height}
    return mi.load_dict({"type": kind, "sample_count": count, **parameters})
