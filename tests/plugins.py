"""What Mitsuba has: so that a table of its plugins in a test leaves none out unnoticed."""

from pathlib import Path

import mitsuba as mi


def of_kind(kind):
    """Return the names of Mitsuba's own plugins of a kind, such as "BSDF" or "Shape", as a set."""
    manager = mi.PluginManager.instance()
    names = [file.stem for file in (Path(mi.__file__).parent / "plugins").iterdir()]
    return {name for name in names if manager.plugin_type(name) == getattr(mi.ObjectType, kind)}
