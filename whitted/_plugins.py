"""Register the plugins of this package with Mitsuba, once per variant, from the entry-point table.

A plugin module defines its class and registers it at module scope, so that it must run again after each
change of the variant. Mitsuba 3.10 and later do so for every package (mitsuba-renderer/mitsuba3, pull
request 1943); for earlier ones it is done here, in the same way, for our own plugins.
"""

import functools
import importlib
import re
import sys

from whitted import _backend
from whitted.errors import BackendError

GROUP = "mitsuba"


@functools.cache
def register():
    """Register the plugins for the active variant, if there is one, and again on each change of the variant.

    Raises:
        BackendError: the active variant cannot run on this machine.
    """
    import mitsuba as mi

    if mi.variant() is not None:
        _on_variant(None, mi.variant())
    mi.detail.add_variant_callback(_on_variant)


def entries():
    """Return the entry points of our own plugins: ``name`` is the XML type, ``value`` the module."""
    from importlib import metadata

    try:
        return tuple(metadata.distribution("whitted").entry_points.select(group=GROUP))
    except metadata.PackageNotFoundError:
        raise BackendError("whitted is not installed, only on the path: pip install whitted") from None


def _on_variant(old, new):
    """Import or reload the plugin modules for the variant ``new``; Mitsuba calls this after each change."""
    _backend.check(new)
    if new.startswith("scalar") or _mitsuba_registers():
        return  # the plugins work on wavefronts: scalar variants have none
    for entry in entries():
        if entry.value in sys.modules:
            importlib.reload(sys.modules[entry.value])
        else:
            importlib.import_module(entry.value)


def _mitsuba_registers():
    import mitsuba as mi

    major, minor = re.findall(r"\d+", mi.__version__)[:2]
    return (int(major), int(minor)) >= (3, 10)
