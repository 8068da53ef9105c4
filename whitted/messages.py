"""Turn Mitsuba's errors, of several lines and with C++ positions, into one line that a user can act on."""

import re
from pathlib import Path

from whitted import _plugins
from whitted.errors import UsageError, nearest

_LOCATION = re.compile(r"(?:Error while loading|While loading|At) (.+?) \(line (\d+), col \d+\): ")
_XML = re.compile(r'Parsing of XML file "(.*?)" failed: (.*?) \(line (\d+), col \d+\)', re.DOTALL)
_UNKNOWN_PLUGIN = re.compile(
    r'failed to instantiate (\w+) plugin of type ".*?": \[PluginManager\] Plugin "(.*?)" not'
)
_WRONG_KIND = re.compile(r'instantiate (\w+) plugin of type "(.*?)": .*Type mismatch: .* is of type "(.*?)"')
_UNKNOWN_PROPERTY = re.compile(
    r'Found \d+ unreferenced propert(?:y|ies) in (\w+) plugin of type "(.*?)":\n(.*)', re.DOTALL
)
_UNUSED_PARAMETER = re.compile(r"Found unused parameters?:\n\s*- \$(\w+)=")
_CONSTRUCTOR = re.compile(r'failed to instantiate (\w+) plugin of type "(.*?)": (.*)', re.DOTALL)
_TRACEBACK = re.compile(
    r"Traceback \(most recent call last\):\n(?:[ \t][^\n]*\n)*([\w.]+)(?:: (.*))?", re.DOTALL
)
_SPEAKER = re.compile(r"^\[([\w.:]+)\] ")

# Read by Mitsuba's base classes, and so in no plugin's own file.
INHERITED = {
    "integrator": "max_depth rr_depth hide_emitters timeout block_size samples_per_pass",
    "sensor": "to_world fov fov_axis focal_length near_clip far_clip shutter_open shutter_close srf"
    " principal_point_offset_x principal_point_offset_y",
    "film": "width height crop_offset_x crop_offset_y crop_width crop_height sample_border size_multiplier",
    "sampler": "sample_count seed",
    "shape": "to_world flip_normals silhouette_sampling_weight face_normals",
    "emitter": "to_world sampling_weight",
}
_NOT_PROPERTIES = re.compile(
    r"(mem|str|pthread|jit|deregister|frame|init|scalar|llvm|cuda)_?\w*|abort|snprintf|variant|tolower"
)


def explain(error, texts=None, parameters=()):
    """Return a `UsageError` with the one useful line of an exception of Mitsuba's loader.

    ``texts`` maps the files that were loaded to their XML, to find the line of a property; ``parameters``
    are the names that the scene declares with ``<default>``.
    """
    message = re.sub(r"\[\w+\.(?:cpp|h):\d+\] ", "", str(error)).strip()
    if match := _XML.search(message):
        return UsageError(f"{match[1]}:{match[3]}: malformed XML: {match[2]}")
    if match := _UNUSED_PARAMETER.search(message):
        return UsageError(
            f"-D {match[1]}: the scene has no parameter of that name{nearest(match[1], parameters)}"
        )
    where, line = "", 0
    for location in _LOCATION.finditer(message):
        where, line, rest = location[1], int(location[2]), message[location.end() :]
    message = rest if where else re.sub(r'(?:At|While loading) dictionary node ".*?": ', "", message)
    if match := _UNKNOWN_PROPERTY.search(message):
        kind, plugin, listed = match.groups()
        names = re.findall(r'^  - \w+ "(.*?)":', listed, re.MULTILINE)
        line = _line_of_name((texts or {}).get(where, ""), line, names[0])
        message = f"{plugin!r} has no property {names[0]!r}" + nearest_property(names[0], plugin, kind)
        if names[0] in property_names(plugin, kind):
            message = f"{plugin!r} does not use its property {names[0]!r} here"
    elif match := _UNKNOWN_PLUGIN.search(message):
        kind = "" if match[1] == "unknown" else match[1]
        message = f"no {kind or 'plugin'} is called {match[2]!r}" + nearest(match[2], plugin_names(kind))
    elif match := _WRONG_KIND.search(message):
        message = f"{match[2]!r} is a {match[3]}, not a {match[1]}"
    elif match := _CONSTRUCTOR.search(message):
        kind = "" if match[1] == "unknown" else match[1] + " "
        message = f"{kind}{match[2]!r}: {_cause(match[3])}"
    message = " ".join(re.sub(r'^Error while loading XML file "(.*?)": ', r"\1: ", message).split())
    return UsageError(f"{where}:{line}: {message}" if where else message)


def complaint(error):
    """Return the line of what an object of Mitsuba complains of in the middle of a render; None for other errors."""
    line = " ".join(str(error).split())
    match = _SPEAKER.match(line) if isinstance(error, RuntimeError) else None
    return f"{match[1]}: {line[match.end() :]}" if match else None


def plugin_names(kind=""):
    """Return the names of the plugins of a kind such as ``"bsdf"``, or of all: Mitsuba's and our own."""
    import mitsuba as mi

    root, manager = Path(mi.__file__).parent, mi.PluginManager.instance()
    kinds = {"phase": "phasefunction", "rfilter": "reconstructionfilter", "spectrum": "texture"}
    native = [path.stem for path in (root / "plugins").glob("*.so")]
    if kind:
        wanted = kinds.get(kind, kind)
        native = [name for name in native if manager.plugin_type(name).name.lower() == wanted]
    ours = [entry.name for entry in _plugins.entries() if f".{kind}" in entry.value]
    if kind in ("", "integrator"):
        ours += [
            path.stem for path in (root / "python/ad/integrators").glob("[a-z]*.py") if path.stem != "common"
        ]
    return sorted({*native, *ours})


def nearest_property(name, plugin, kind=""):
    """Return a clause with the valid properties nearest to ``name``, or nothing where none is near.

    Mitsuba has no list of them: they are found as the words in the plugin's own file and as what its base
    class reads, so that a word which is no property may be among them.
    """
    near = nearest(name, property_names(plugin, kind))
    return near if near.startswith("; did you mean") else ""


def property_names(plugin, kind=""):
    """Return the words of a plugin's file that may be its properties, with those of its base class."""
    import mitsuba as mi

    manager = mi.PluginManager.instance()
    file = Path(mi.__file__).parent / "plugins" / f"{plugin}.so"
    if file.exists():
        kind = manager.plugin_type(plugin).name.lower()
        words = {
            word.decode() for word in re.findall(rb"(?<=\0)[a-z][a-z0-9_]{2,30}(?=\0)", file.read_bytes())
        }
        words = {word for word in words if not _NOT_PROPERTIES.fullmatch(word)}
    else:
        words = _python_words(plugin)
        kind = "" if words else kind
    return words | set(INHERITED.get(kind, "").split())


def _python_words(plugin):
    """Return the property names that the source of one of our plugins reads from ``props``."""
    from importlib.util import find_spec

    for entry in _plugins.entries():
        if entry.name == plugin:
            source = Path(find_spec(entry.value).origin).read_text(encoding="utf-8")
            return set(re.findall(r"""\bp\w*(?:\.\w+\(|\[)\s*["'](\w+)["']""", source))
    return set()


def _cause(message):
    """Return the last line of a Python traceback without its type, or a C++ message without its class."""
    if match := _TRACEBACK.search(message):
        return match[2] or match[1]
    return _SPEAKER.sub("", message)


def _line_of_name(text, line, name):
    """Return the line of the first ``name="..."`` of that name from a line on, or that line."""
    rows = text.splitlines()
    for number, row in enumerate(rows[max(line - 1, 0) :], start=max(line, 1)):
        if re.search(rf"""name\s*=\s*["']{re.escape(name)}["']""", row):
            return number
    return line
