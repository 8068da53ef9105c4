"""Refuse scenes that Mitsuba loads in silence and then renders wrongly, or that abort it.

The text is scanned for the line and the spelling of a number that isn't finite; the parsed scene is checked as well,
which has what the scan cannot see, such as a matrix that overflows, or what parts an object consists of. Left out:
numbers inside meshes and textures (Mitsuba checks mesh vertices itself).
"""

import collections
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
LONGEST = 1e18  # of a length, whose square has to be finite too
# By plugin or kind: numbers beyond which Mitsuba aborts, never ends, or reads them as something else
RANGES = {
    "Sampler": {"sample_count": (1, 1 << 30)},
    "Film": {
        "width": (1, 65535),
        "height": (1, 65535),
        "crop_width": (1, 65535),
        "crop_height": (1, 65535),
        "crop_offset_x": (0, 65534),
        "crop_offset_y": (0, 65534),
    },
    "gaussian": {"stddev": (0, 16)},
    "tent": {"radius": (0, 64)},
    "lanczos": {"lobes": (1, 64)},
    "mitchell": {"B": (-100, 100), "C": (-100, 100)},
}
EMISSION = frozenset(["intensity", "irradiance", "radiance", "scale", "sky_scale", "sun_scale"])
CYLINDER = {"p0": (0, 0, 0), "p1": (0, 0, 1)}  # its ends, as Mitsuba has them by default
OF_SURFACES = frozenset(["area", "directionalarea"])  # emitters that need a shape
OTHERS = frozenset(
    ["constant", "directional", "envmap", "point", "projector", "spot", "sunsky"]
)  # that mustn't have one

_SKIPPED = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<!DOCTYPE[^>]*>", re.DOTALL)
_ELEMENT = re.compile(r"<([A-Za-z_][\w.:-]*)((?:\s+[\w.:-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*/?>")
_TAG = re.compile(r"<(/?)([A-Za-z_][\w.:-]*)((?:\s+[\w.:-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(/?)>")
_ATTRIBUTE = re.compile(r"([\w.:-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")


def elements(text):
    """Yield ``(line, tag, attributes)`` for each element of an XML text, in order.

    The scan is lenient, as Mitsuba's parser is: it takes ``--`` in comments, which strict parsers refuse.
    """
    text = _blank(text)
    line, seen = 1, 0
    for match in _ELEMENT.finditer(text):
        line += text.count("\n", seen, match.start())
        seen = match.start()
        yield line, match[1], _attributes(match[2])


def _attributes(text):
    return {name: a or b for name, a, b in _ATTRIBUTE.findall(text)}


def _blank(text):
    """Replace what is no element by blanks."""
    return _SKIPPED.sub(lambda skipped: re.sub(r"[^\n]", " ", skipped[0]), text)


def check_text(text, file, parameters):
    """Check numbers and names in an XML text; ``<default>`` elements are added to the dict ``parameters``.

    Raises:
        UsageError: a number is NaN, infinite or beyond single precision, or an element has two parts of one name;
            the line names file, line and value.
    """
    _check_names(text, file)
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
    """Check the numbers and the parts of a parsed scene; ``locate(node)`` names the file and line of a node.

    Raises:
        UsageError: a number is NaN, infinite or beyond single precision, a length has a square that is, a transform
            has no inverse, or an object lacks a part without which Mitsuba aborts or ignores it.
    """
    import mitsuba as mi

    holders = {}
    for node in nodes:
        props = mi.Properties(node.props)  # a copy: what is read here must not count as read by the plugin
        for name in props.keys():  # noqa: SIM118, not a mapping
            if props.type(name).name == "ResolvedReference":
                holders.setdefault(props[name].index(), []).append(node)
            limit = LONGEST if _is_length(node, props, name) else LARGEST
            wrong = [number for number in _numbers(props, name) if not abs(number) <= limit]
            if wrong:
                wanted = "length up to 1e18" if abs(wrong[0]) <= LARGEST else "finite float32"
                raise UsageError(
                    f"{locate(node)}: {name!r} of '{props.plugin_name()}' contains {wrong[0]:g}; a {wanted} is needed"
                )
        if _is_placed(node) and "to_world" in props and not _is_invertible(props["to_world"]):
            raise UsageError(
                f"{locate(node)}: 'to_world' of '{props.plugin_name()}' flattens it or makes it too small; "
                "scales from 1e-18 on are accepted, also across a flat shape"
            )
        for name, (low, high) in _ranges(node, props).items():
            if name in props and not all(low <= number <= high for number in _numbers(props, name)):
                raise UsageError(
                    f"{locate(node)}: {name!r} of '{props.plugin_name()}' is {props[name]:.10g}; "
                    f"accepted are {low} to {high}"
                )
    for number, node in enumerate(nodes):
        if node.type.name == "Emitter" and (negative := min(_strengths(node, nodes), default=0)) < 0:
            raise UsageError(
                f"{locate(node)}: '{node.props.plugin_name()}' emits {negative:g}; accepted are numbers from 0 on"
            )
        if complaint := _lacks(node, nodes, holders.get(number, ())):
            raise UsageError(f"{locate(node)}: '{node.props.plugin_name()}' {complaint}")


def _check_names(text, file):
    """Refuse an element that has two parts of one name: Mitsuba takes the last in silence, or misnames the mistake."""
    text = _blank(text)
    names = [set()]  # of the parts of each open element
    for match in _TAG.finditer(text):
        closes, tag, attributes, is_empty = match.groups()
        if closes:
            del names[max(len(names) - 1, 1) :]
            continue
        name = _attributes(attributes).get("name")
        if name is not None and tag != "default":
            if name in names[-1]:
                line = 1 + text.count("\n", 0, match.start())
                raise UsageError(f"{file}:{line}: <{tag} name={name!r}> stands beside another {name!r}")
            names[-1].add(name)
        if not is_empty:
            names.append(set())


def _strengths(node, nodes):
    """Yield the numbers that say how much an emitter emits, those of its textures included."""
    import mitsuba as mi

    props = mi.Properties(node.props)
    for name in props.keys():  # noqa: SIM118, not a mapping
        kind = props.type(name).name
        if kind == "ResolvedReference":
            part = nodes[props[name].index()]
            if part.type.name == "Texture":
                yield from _strengths(part, nodes)
        elif kind in ("Float", "Color", "Spectrum") and (name in EMISSION or node.type.name == "Texture"):
            yield from _numbers(props, name)


def _lacks(node, nodes, holders):
    """Say what an object lacks, as a clause, or return an empty text; ``holders`` are those that it is a part of."""
    import mitsuba as mi

    props = mi.Properties(node.props)
    plugin, held = props.plugin_name(), {holder.type.name for holder in holders}
    parts = [props[name] for name in props.keys() if props.type(name).name == "ResolvedReference"]  # noqa: SIM118
    count = collections.Counter(nodes[part.index()].type.name for part in parts)
    if plugin == "bitmap" and "filename" not in props:
        return "needs a 'filename'"
    if plugin == "blendbsdf" and count["BSDF"] != 2:
        return f"needs two BSDFs, not {count['BSDF']}"
    if plugin == "volume" and node.type.name == "Texture" and not count["Volume"]:
        return "needs a <volume>"
    if plugin == "shapegroup" and not count["Shape"]:
        return "needs a shape"
    if plugin == "cylinder" and not any(_axis(props)):
        return "needs a 'p0' and a 'p1' that differ"
    if plugin == "irradiancemeter" and "Shape" not in held:
        return "measures on a shape; put it into one"
    if plugin in OF_SURFACES and "Shape" not in held:
        return "shines from a shape; put it into one"
    if plugin in OTHERS and node.type.name == "Emitter" and "Shape" in held:
        return "does not shine from a shape; put it beside the shape, not into it"
    if plugin == "timed_sunsky":
        return "cannot be rendered by this version of Mitsuba, only 'sunsky' can"
    return ""


def _axis(props):
    """Return the difference of a cylinder's ends, rounded as Mitsuba rounds them, as a list of numbers."""
    import numpy as np

    ends = zip(*(props.get(name, end) for name, end in CYLINDER.items()), strict=True)
    return [float(np.float32(high)) - float(np.float32(low)) for low, high in ends]


def _ranges(node, props):
    return RANGES.get(node.type.name, {}) | RANGES.get(props.plugin_name(), {})


def _is_placed(node):
    """Whether an object has a place in space."""
    return node.type.name in ("Shape", "Sensor", "Emitter")


def _is_length(node, props, name):
    """Whether the numbers of a property are lengths, or become such when they scale a shape."""
    return _is_placed(node) and (props.type(name).name == "Vector" or name in ("to_world", "radius"))


def _is_invertible(transform):
    """Whether a transform has an inverse, by which normals are transformed, whose numbers have finite squares."""
    import numpy as np

    try:
        inverse = np.linalg.inv(np.array(transform.matrix, np.float64)[:3, :3])
    except np.linalg.LinAlgError:
        return False
    return bool((np.abs(inverse) <= LONGEST).all())


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
