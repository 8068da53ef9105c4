r"""Pictures in a page, as numbers: a viewer decodes them in the browser, and shows radiance rather than colours.

A picture travels as base64 of zlib of its floats, with two steps before that make them small. Mantissas are rounded to
12 bits: the relative error is at most :math:`2^{-13}` (1.2e-4), which is about a unit of the fourth digit that the
viewer shows, and what is rounded away is mostly noise, which doesn't compress. The four bytes of the floats are then
stored as four planes, one after another, so that signs and exponents lie together: the shuffle of HDF5 and of Blosc
[Alted2010]. A path-traced 512 x 512 picture at 16 samples per pixel takes 1.75 MB of text; its floats alone would take
4.2 MB. Left out: prediction from neighbours, which would save a twentieth of such a picture.

The viewer itself is made from web/ (``make viewer``) and lies built in assets/, with the licences of what it contains.
"""

import base64
import json
import re
import zlib
from dataclasses import dataclass
from html import escape
from importlib.resources import files

import numpy as np

MANTISSA = 23  # bits of a float32
RADIANCE_BITS = 12
STDERR_BITS = 6  # relative error below 1 %: the viewer shows two digits, and few replicates know no more
CHANNELS = {1: ["Y"], 3: ["R", "G", "B"]}


@dataclass(frozen=True)
class Entry:
    """A picture that the viewer offers.

    Attributes:
        id: its name in the page: letters, digits, ``-`` and ``_``; unique.
        name: what people choose it by; samples and seconds are added to it.
        group: its scene; only pictures of one scene, which have one size, are compared.
        radiance: [height, width, 1 or 3], linear; any value, NaN and infinity too.
        text: the picture in words, for people who don't see it.
        stderr: the standard error of ``radiance``, of the same shape, or None.
        reference: the ``id`` of the picture that this one's error is measured against, or None.
        spp: samples per pixel, or None.
        seconds: the time that it took, or None.
    """

    id: str
    name: str
    group: str
    radiance: np.ndarray
    text: str
    stderr: np.ndarray | None = None
    reference: str | None = None
    spp: float | None = None
    seconds: float | None = None


def encode(planes, bits=RADIANCE_BITS):
    """Return numbers as base64 text, which the viewer and `decode` read.

    Args:
        planes: [height, width, channels]; kept as ``float32``. Zero and infinity are kept exactly, NaN as one
            of its kinds, and numbers below 1e-38 to within 2e-42.
        bits: of the mantissa that are kept, 1 to 22: the relative error is at most ``2**-(bits + 1)``.
    """
    values = np.array(planes, np.float32, order="C")
    values[np.isnan(values)] = np.nan
    words, unit = values.view(np.uint32), 1 << (MANTISSA - bits)
    rounded = (words + unit // 2) // unit * unit
    finite = np.isfinite(rounded.view(np.float32))  # what is or would become infinite is cut instead
    words = np.where(finite, rounded, words // unit * unit).astype("<u4")
    shuffled = words.reshape(-1, 1).view(np.uint8).T.tobytes()
    return base64.b64encode(zlib.compress(shuffled)).decode("ascii")


def decode(text, shape):
    """Return the ``float32`` array of a shape from which `encode` made the text."""
    shuffled = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    words = np.ascontiguousarray(shuffled.reshape(4, -1).T).view("<u4")
    return words.astype(np.uint32).view(np.float32).reshape(shape)


def viewer(entries, identifier="pictures"):
    """Return the HTML of a viewer with its data; the page needs `script` and `style` once.

    The arguments and errors are those of `data`.
    """
    return f"{place(identifier)}\n{data(entries, identifier)}"


def place(identifier="pictures"):
    """Return the HTML of the element where the viewer appears."""
    return f'<div class="whitted-viewer" data-manifest="{escape(identifier)}"></div>'


def data(entries, identifier="pictures"):
    """Return the HTML of a viewer's data, which may stand anywhere in the page: best at its end, since it is long.

    Args:
        entries: of `Entry`; a scene's come in the order in which it offers them, and its first two are shown.
        identifier: an HTML id that nothing else in the page has.

    Raises:
        ValueError: there are no pictures, an id is no id or there twice, a scene's differ in shape, a reference isn't
            among them, or samples or seconds are no finite number.
    """
    _check(entries)
    manifest = json.dumps([_facts(entry) for entry in entries], allow_nan=False).replace("<", "\\u003c")
    head = _element("application/json", identifier, manifest, ' class="whitted-viewer-data"')
    return "\n".join([head, *(line for entry in entries for line in _data(entry))])


def script():
    """Return the HTML of the viewer's script."""
    return f"<script>{_asset('viewer.js')}</script>"


def style():
    """Return the HTML of the viewer's style sheet."""
    return f"<style>{_asset('viewer.css')}</style>"


def _asset(name):
    return files("whitted.reports").joinpath("assets", name).read_text("utf-8")


def _facts(entry):
    height, width, channels = entry.radiance.shape
    return {
        "id": entry.id,
        "name": entry.name,
        "group": entry.group,
        "spp": entry.spp,
        "seconds": entry.seconds,
        "width": width,
        "height": height,
        "channels": CHANNELS[channels],
        "has_stderr": entry.stderr is not None,
        "reference": entry.reference,
        "text": entry.text,
    }


def _data(entry):
    yield _element("text/plain", f"picture-{entry.id}", encode(entry.radiance))
    if entry.stderr is not None:
        yield _element("text/plain", f"stderr-{entry.id}", encode(entry.stderr, STDERR_BITS))


def _element(kind, identifier, content, attributes=""):
    return f'<script type="{kind}" id="{escape(identifier)}"{attributes}>{content}</script>'


def _check(entries):
    if not entries:
        raise ValueError("a viewer needs a picture")
    ids = [entry.id for entry in entries]
    groups = {entry.id: entry.group for entry in entries}
    shapes = {entry.group: np.shape(entry.radiance) for entry in reversed(entries)}
    for entry in entries:
        shape = shapes[entry.group]
        if not re.fullmatch(r"[\w-]+", entry.id, re.ASCII):
            raise ValueError(f"an id is of letters, digits, - and _, not {entry.id!r}")
        if ids.count(entry.id) > 1:
            raise ValueError(f"an id is there more than once: {entry.id}")
        if np.shape(entry.radiance) != shape or len(shape) != 3 or shape[2] not in CHANNELS:
            raise ValueError(
                f"{entry.id}: a picture of shape {np.shape(entry.radiance)} in a scene of {shape}"
            )
        if entry.stderr is not None and np.shape(entry.stderr) != shape:
            raise ValueError(f"{entry.id}: a standard error of shape {np.shape(entry.stderr)} for {shape}")
        if entry.reference is not None and groups.get(entry.reference) != entry.group:
            raise ValueError(f"{entry.id}: its scene has no reference {entry.reference}")
