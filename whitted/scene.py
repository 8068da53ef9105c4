"""Load a scene from Mitsuba XML or by the name of a shipped one, with errors of one line that name file and
line.

The scene is the one that ``mi.load_file(..., optimize=False)`` gives: with its optimisation Mitsuba merges
meshes, loses their names and changes the order of shapes from run to run.
"""

import hashlib
import os
import re
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from whitted import _backend, validation
from whitted.errors import UsageError, nearest
from whitted.messages import explain
from whitted.mirrored import turned_inside_out
from whitted.specification import integrator

ROBUST = "embree_use_robust_intersections"  # without it rays pass between triangles that share an edge

__all__ = ["Scene", "as_scene", "integrator", "load", "shipped"]


@dataclass
class Scene:
    """A loaded scene, with where it came from.

    ``hash`` is the SHA-256, in hex, of the XML, its includes, the parameters and the files that it refers
    to; it is empty for a scene that was not loaded from a file. ``load_seconds`` is wall time. ``notes`` are lines
    that a user should read before looking at a picture.
    """

    mitsuba: object = field(repr=False)
    name: str
    path: Path | None = None
    hash: str = ""
    load_seconds: float = 0.0
    notes: tuple = ()


def load(path_or_name, /, **defines):
    """Load a scene, as a `Scene`.

    ``path_or_name`` is the path of a Mitsuba XML file, or the name of a shipped scene; an existing path wins.
    ``defines`` replace the scene's ``<default>`` parameters; a value is text, a number, a bool or a
    sequence of numbers. Where no variant is active ``llvm_ad_rgb`` is set. Embree intersects meshes watertight,
    unless the scene has the boolean ``embree_use_robust_intersections`` of its own.

    Raises:
        UsageError: there is no such scene, or something in it is wrong; one line with file, line and value.
        BackendError: the variant cannot run on this machine.
    """
    path = _locate(path_or_name)
    _backend.activate()
    start = time.perf_counter()
    defines = {name: _as_text(value) for name, value in defines.items()}
    text = _read(path)
    scene, digest, notes = _instantiate(path, text, defines)
    if not scene.sensors():
        raise UsageError(f"{path}: the scene has no <sensor>, and so no picture")
    _check_lenses(scene, f"{path}: ")
    return Scene(scene, path.stem, path, digest, time.perf_counter() - start, notes)


def as_scene(scene):
    """Return a `Scene` for a `Scene`, an ``mi.Scene``, or a path or name to load.

    Raises:
        UsageError: it is none of these, cannot be loaded, or has no sensor.
    """
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, str | os.PathLike):
        return load(scene)
    if type(scene).__name__ != "Scene" or not hasattr(scene, "sensors"):
        raise UsageError(
            f"scene: a Scene, an mi.Scene, a path or a name is needed, not {type(scene).__name__}"
        )
    if not scene.sensors():
        raise UsageError("the scene has no sensor, and so no picture")
    _check_lenses(scene)
    return Scene(scene, scene.id() if not scene.id().startswith("_") and scene.id() else "scene")


def _check_lenses(scene, where=""):
    """Refuse lenses whose focus lies before the near plane, or too far: Mitsuba would render black without a word."""
    for sensor in scene.sensors():
        if sensor.class_name() == "ThinLensCamera":
            focus, near = float(sensor.focus_distance()[0]), float(sensor.near_clip())
            if not near <= focus <= validation.LONGEST:
                raise UsageError(
                    f"{where}focus_distance is {focus:g}; accepted are near_clip, {near:g}, to {validation.LONGEST:g}"
                )


def shipped():
    """Return a dict from the name of each shipped scene to the first sentence of its first comment."""
    return {path.stem: _summary(path.read_text(encoding="utf-8")) for path in sorted(_folder().glob("*.xml"))}


def shipped_path(name):
    """Return the path of a shipped scene's XML.

    Raises:
        UsageError: there is none of that name; the line has the nearest ones.
    """
    names = [path.stem for path in _folder().glob("*.xml")]
    if name not in names:
        raise UsageError(f"no shipped scene is called {name!r}{nearest(name, names)}")
    return _folder() / f"{name}.xml"


def _folder():
    from importlib.resources import files

    return Path(str(files("whitted.scenes")))


def _summary(text):
    comment = re.search(r"<!--(.*?)-->", text, re.DOTALL)
    words = " ".join(comment[1].split()) if comment else ""
    return re.split(r"(?<=\w\w[.!?])\s", words)[0]  # an initial, as in "T. Whitted", ends no sentence


def _locate(path_or_name):
    path = Path(path_or_name)
    if path.is_dir():
        raise UsageError(f"{path}: a folder; the XML file of a scene is needed")
    if path.exists():
        return path
    text = str(path_or_name)
    if os.sep in text or text.endswith(".xml"):
        raise UsageError(f"{path}: no such file")
    return shipped_path(text)


def _read(path):
    """Return the text of an XML file.

    Raises:
        UsageError: it cannot be read, is empty, or is not text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
    if not data.strip():
        raise UsageError(f"{path}: the file is empty; a Mitsuba XML scene is needed")
    declared = re.match(rb"<\?xml[^>]*encoding=[\"']([\w.-]+)", data)
    try:
        return data.decode(declared[1].decode() if declared else "utf-8-sig")
    except LookupError as error:
        raise UsageError(
            f"{path}:1: the encoding {declared[1].decode()!r} is not known; use UTF-8"
        ) from error
    except UnicodeDecodeError as error:
        line = 1 + data.count(b"\n", 0, error.start)
        byte = f"0x{data[error.start]:02x}"
        raise UsageError(f"{path}:{line}: the byte {byte} is no {error.encoding} text; use UTF-8") from error


def _instantiate(path, text, defines):
    """Parse, check and instantiate a scene; return it with its hash and notes on it."""
    import mitsuba as mi

    first = next(validation.elements(text), None)
    if first is not None and first[1] != "scene":
        raise UsageError(f"{path}:{first[0]}: the root element is <{first[1]}>, not <scene>")
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = config.merge_equivalent = False
    config.parallel = (
        False  # in parallel the order of objects varies, and with it the key of a compiled kernel
    )
    texts, parameters = {str(path): text}, dict(defines)
    validation.check_text(text, path, parameters)
    with _resolver(path):
        try:
            state = mi.parser.parse_file(config, str(path), **defines)
            for file in map(str, state.files[1:]):
                texts[file] = _read(Path(file))
                validation.check_text(texts[file], file, parameters)
            mi.parser.transform_all(config, state)

            def locate(node):
                return re.sub(r" \(line (\d+), col \d+\)$", r":\1", mi.parser.file_location(state, node))

            validation.check_nodes(state.nodes, locate)
            files = _referred_files(state.nodes, locate)
            if ROBUST not in state.root.props and mi.variant().startswith("llvm"):
                state.root.props[ROBUST] = True
            with _threads_for_files():
                scene = mi.parser.instantiate(config, state)
                notes = turned_inside_out(state.nodes, locate)
        except (RuntimeError, ValueError, TypeError) as error:
            declared = [a.get("name", "") for _, tag, a in validation.elements(text) if tag == "default"]
            raise explain(error, texts, declared) from error
    return scene, _digest(texts.values(), defines, files), notes


def _referred_files(nodes, locate):
    """Return the paths of the files that the nodes' ``filename`` properties refer to."""
    import mitsuba as mi

    found = []
    for node in nodes:
        props = mi.Properties(node.props)  # a copy, so that the original counts as unread
        if "filename" in props and props.type("filename").name == "String":
            name = props["filename"]
            file = Path(str(mi.file_resolver().resolve(name)))
            if not file.is_file():
                plugin = props.plugin_name()
                raise UsageError(f"{locate(node)}: the file {name!r} of {plugin!r} does not exist")
            found.append(file)
    return found


def _digest(texts, defines, files):
    digest = hashlib.sha256()
    for part in (*texts, *(f"{name}={value}" for name, value in sorted(defines.items()))):
        digest.update(part.encode() + b"\0")
    for file in files:
        with open(file, "rb") as data:
            digest.update(hashlib.file_digest(data, "sha256").digest())
    return digest.hexdigest()


@contextmanager
def _resolver(path):
    """Look for files beside the scene first, as ``mi.load_file`` does, and forget the folder afterwards."""
    import mitsuba as mi

    before = mi.file_resolver()
    during = mi.FileResolver(before)
    during.prepend(str(path.parent.resolve()))
    mi.set_file_resolver(during)
    try:
        yield
    finally:
        mi.set_file_resolver(before)


@contextmanager
def _threads_for_files():
    """Give Dr.Jit two threads at least: with one Mitsuba waits for ever for a second that decodes an EXR file."""
    import drjit as dr

    before = dr.thread_count()
    if before < 2:
        dr.set_thread_count(2)
    try:
        yield
    finally:
        if before < 2:
            dr.set_thread_count(before)


def _as_text(value):
    """Return a parameter's value as XML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return str(value)
