"""Integrators as users write them: ``NAME[:key=value,...]``, a dict, or an object of Mitsuba."""

import re

from whitted import _plugins, validation
from whitted.errors import UsageError, nearest
from whitted.messages import explain, plugin_names

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)", re.IGNORECASE)


def integrator(spec=None, scene=None):
    """Return ``(integrator, note)`` for what a user asked for.

    ``spec`` is text such as ``"whitted:max_depth=3,shadows=false,ambient=0.1 0.2 0.3"``, a dict as for
    ``mi.load_dict``, a ``mi.Integrator``, or None: then the integrator of the ``mi.Scene`` ``scene`` is
    taken if it is ours, else ``distribution`` where that exists, else ``whitted``. ``note`` is a sentence
    that says which was chosen where the user did not choose it, else None.

    Raises:
        UsageError: an unknown name or property, or a value that is refused.
    """
    import mitsuba as mi

    if isinstance(spec, mi.Integrator):
        return spec, None
    if isinstance(spec, str):
        return _from_dict(_parse(spec), spec), None
    if isinstance(spec, dict):
        return _from_dict(spec, spec.get("type")), None
    if spec is not None:
        raise UsageError(f"integrator: text, a dict or an mi.Integrator is needed, not {type(spec).__name__}")
    own = scene.integrator() if scene is not None else None
    modules = {entry.value for entry in _plugins.entries()}
    if own is not None and type(own).__module__ in modules:
        return own, None
    names = [entry.name for entry in _plugins.entries()]
    name = "distribution" if "distribution" in names else "whitted"
    reason = "the scene has no integrator" if own is None else "the scene's integrator is not one of ours"
    return _from_dict({"type": name}, name), f"{reason}; rendering with '{name}'"


def as_dict(spec):
    """Return the dict as for ``mi.load_dict`` that a text or a dict stands for; names in it aren't checked.

    Raises:
        UsageError: the text isn't of the form ``NAME[:key=value,...]``.
    """
    return dict(spec) if isinstance(spec, dict) else _parse(spec)


def _parse(text):
    """Return the dict that ``NAME[:key=value,...]`` stands for."""
    name, _, rest = text.partition(":")
    properties = {"type": name.strip()}
    if not properties["type"]:
        raise UsageError(f"--integrator {text!r}: NAME[:key=value,...] is needed")
    for item in rest.split(",") if rest else []:
        key, equals, value = (part.strip() for part in item.partition("="))
        if not (key and equals and value):
            raise UsageError(f"--integrator {text!r}: key=value is needed, not {item!r}")
        properties[key] = _value(value)
    return properties


def _value(text):
    """Return a bool, a number, a colour (three numbers) or, failing these, the text itself."""
    if text in ("true", "false"):
        return text == "true"
    words = text.split()
    if not all(_NUMBER.fullmatch(word) for word in words):
        return text
    numbers = [float(word) for word in words]
    if len(numbers) == 3:
        return {"type": "rgb", "value": numbers}
    if len(numbers) > 1:
        return text
    # Mitsuba takes an integer for a float, but not the reverse: 3.0 and 1e3 are integers to it.
    return int(numbers[0]) if numbers[0].is_integer() else numbers[0]


def _from_dict(properties, spec):
    import mitsuba as mi

    if not isinstance(properties.get("type"), str):
        raise UsageError("integrator: the dict needs a 'type', the integrator's name")

    try:
        config = mi.parser.ParserConfig(mi.variant())
        config.merge_meshes = config.merge_equivalent = False
        state = mi.parser.parse_dict(config, properties)
        validation.check_nodes(state.nodes, lambda node: f"--integrator {spec}")
        mi.parser.transform_all(config, state)
        made = mi.parser.instantiate(config, state)
    except (RuntimeError, TypeError, ValueError, AttributeError) as error:
        name = properties["type"]
        if 'Plugin "' in str(error) and f'"{name}" not found' in str(error):
            near = nearest(name, plugin_names("integrator"))
            raise UsageError(f"--integrator {spec}: no integrator is called {name!r}{near}") from error
        raise UsageError(f"--integrator {spec}: {explain(error)}") from error
    if not isinstance(made, mi.Integrator):
        raise UsageError(
            f"--integrator {spec}: {properties['type']!r} is no integrator"
            + nearest(properties["type"], plugin_names("integrator"))
        )
    return made
