"""Refuse scenes whose numbers are not finite, before Mitsuba loads them in silence.

The text is scanned for the line and the spelling of a number; the parsed scene is checked as well, which
has what the scan cannot see, such as a matrix that overflows. Left out: numbers inside meshes and textures
(Mitsuba checks mesh vertices itself).
"""

import math
import re

from whitted.errors import UsageError

NUMERIC_ELEMENTS = frozenset(
    [
        "integer",
        "float",
        "vector",
        "point",
        "rgb",
        "spectrum",
        "translate",
        "rotate",
        "scale",
        "matrix",
        "lookat",
    ]
)
NUMERIC_ATTRIBUTES = frozenset(["value", "x", "y", "z", "angle", "origin", "target", "up"])
LARGEST = 3.4028235e38  # of single precision, in which Mitsuba computes

_SKIPPED = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<!DOCTYPE[^>]*>", re.DOTALL)
_ELEMENT = re.compile(r"<([A-Za-z_][\w.:-]*)((?:\s+[\w.:-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*/?>")
_ATTRIBUTE = re.compile(r"([\w.:-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")


def elements(text):
    """Yield ``(line, tag, attributes)`` for each element of an XML text, in order.

    The scan is lenient, as Mitsuba's parser is: it takes ``--`` in comments, which strict parsers refuse.
    """
    text = _SKIPPED.sub(lambda skipped: re.sub(r"[^\n]", " ", skipped[0]), text)
    line, seen = 1, 0
    for match in _ELEMENT.finditer(text):
        line += text.count("\n", seen, match.start())
        seen = match.start()
        yield line, match[1], {name: a or b for name, a, b in _ATTRIBUTE.findall(match[2])}


def check_text(text, file, parameters):
    """Check the numbers in an XML text; ``<default>`` elements are added to the dict ``parameters``.

    Raises:
        UsageError: a number is NaN, infinite or beyond single precision; the line names file, line and value.
    """
    for line, tag, attributes in elements(text):
        if tag == "default" and "name" in attributes:
            parameters.setdefault(attributes["name"], attributes.get("value", ""))
        if tag not in NUMERIC_ELEMENTS:
            continue
        for name in NUMERIC_ATTRIBUTES & attributes.keys():
            value = _substitute(attributes[name], parameters)
            for number in re.split(r"[\s,:;]+", value):
                if not _finite(number):
                    label = f"<{tag} name={attributes['name']!r}>" if "name" in attributes else f"<{tag}>"
                    raise UsageError(
                        f"{file}:{line}: {label} has {name}={number}; a finite float32 is needed"
                    )


def check_nodes(nodes, locate):
    """Check the numbers of a parsed scene; ``locate(node)`` names the file and line of a node.

    Raises:
        UsageError: a number is NaN, infinite or beyond single precision.
    """
    import mitsuba as mi

    for node in nodes:
        props = mi.Properties(node.props)  # a copy: what is read here must not count as read by the plugin
        for name in props.keys():  # noqa: SIM118, not a mapping
            numbers = _numbers(props, name)
            if not all(abs(number) <= LARGEST for number in numbers):
                value = next(number for number in numbers if not abs(number) <= LARGEST)
                raise UsageError(
                    f"{locate(node)}: {name!r} of '{props.plugin_name()}' contains {value}; "
                    "a finite float32 is needed"
                )


def _numbers(props, name):
    """Return the numbers that a property holds, as a flat list; empty if it holds none."""
    kind = props.type(name).name
    if kind in ("Float", "Integer"):
        return [props[name]]
    if kind in ("Vector", "Color"):
        return [float(component) for component in props[name]]
    if kind == "Transform":
        return [float(entry) for row in props[name].matrix for entry in row]
    if kind == "Spectrum":
        return [float(entry) for entry in (*props[name].wavelengths, *props[name].values)]
    return []


def _substitute(value, parameters):
    """Replace each ``$name``; the longest names first, as ``$radius`` is not ``$r`` followed by letters."""
    if "$" in value:
        for name in sorted(parameters, key=len, reverse=True):
            value = value.replace("$" + name, parameters[name])
    return value


def _finite(number):
    """Tell whether the text is a finite number; what is no number at all is left to Mitsuba."""
    try:
        value = float(number)
    except ValueError:
        return True
    return math.isfinite(value) and abs(value) <= LARGEST
