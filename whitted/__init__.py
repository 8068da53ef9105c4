"""Whitted and distribution ray tracing as Mitsuba plugins: importing it registers them, sets no variant."""

from whitted import _backend, _plugins

_backend.prepare()
_plugins.register()

# Loaded when first asked for, so that a command starts without what it does not use.
_EXPORTS = {
    "Agreement": "whitted.comparison",
    "Plan": "whitted.effects",
    "Render": "whitted.passes",
    "Scene": "whitted.scene",
    "Stability": "whitted.hardcases.run",
    "Study": "whitted.studies.study",
    "check": "whitted.comparison",
    "load": "whitted.scene",
    "noise_shares": "whitted.noise",
    "plan": "whitted.planning",
    "render": "whitted.passes",
    "stability": "whitted.hardcases.run",
    "study": "whitted.studies.study",
    "trace": "whitted.raytree",
}

__all__ = [
    "Agreement",
    "Plan",
    "Render",
    "Scene",
    "Stability",
    "Study",
    "check",
    "load",
    "noise_shares",
    "plan",
    "render",
    "stability",
    "study",
    "trace",
]


def __getattr__(name):
    if name == "__version__":
        from importlib.metadata import version

        value = version("whitted")
    elif name in _EXPORTS:
        from importlib import import_module

        value = getattr(import_module(_EXPORTS[name]), name)
    else:
        raise AttributeError(f"module 'whitted' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__():
    return sorted([*globals(), *_EXPORTS, "__version__"])
