"""Pictures as OpenEXR files, and the sums of samples that are kept beside them.

A file holds 32-bit floats: the radiance in the root layer, what is known of its error in further layers, and
the facts of its making in the header, so that it can be judged without the program that made it. Left out:
deep and subsampled (luminance and chroma) pictures, and all but the first part of multi-part files.
"""

import contextlib
import io
import json
import numbers
import os
from dataclasses import dataclass, field

import numpy as np

from whitted import files
from whitted.errors import UsageError

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # x, y of red, green, blue and white
MOMENTS_FORMAT = 1
_WINDOWS = ("dataWindow", "displayWindow")
_STRUCTURE = ("channels", "chunkCount", "compression", "lineOrder", "tiles", "type", *_WINDOWS)
_INTEGERS = ("samplesPerPixel", "seed")  # written as strings where 32 bits are too few


@dataclass
class Picture:
    """A linear picture: named channels of equal size, and a header.

    Attributes:
        channels: name to ``float32`` [height, width]. ``R, G, B[, A]`` or ``Y`` is the radiance, in the root
            layer; ``stderr.*`` its standard error, ``spp.Y`` the samples taken, ``lost.Y`` the radiance given
            up, ``share.<effect>.Y`` the part of the variance that an effect makes.
        header: name to ``int``, ``float``, ``str``, list of ``str`` or array of two or three numbers, such as
            ``samplesPerPixel``, ``renderTimeSeconds``, ``compileTimeSeconds``, ``seed``, ``integrator``,
            ``variant``, ``effects``, ``sceneHash``.
        offset: x, y in pixels of a crop's upper left corner within the whole picture.
        full_size: width, height in pixels of the whole picture; where it is None, this is no crop.
    """

    channels: dict
    header: dict = field(default_factory=dict)
    offset: tuple = (0, 0)
    full_size: tuple | None = None

    @property
    def height(self):
        """The number of rows held."""
        return next(iter(self.channels.values())).shape[0]

    @property
    def width(self):
        """The number of columns held."""
        return next(iter(self.channels.values())).shape[1]

    @property
    def rgb(self):
        """The radiance, ``float32`` [height, width, 3]; of a mono picture, three times the same."""
        return self.layer("")

    @property
    def stderr(self):
        """The standard error of ``rgb``, of the same shape, or None."""
        return self.layer("stderr")

    def layer(self, name):
        """Return a layer's colours, ``float32`` [height, width, 3], or None where it has none."""
        names = layer_names(name)
        if all(channel in self.channels for channel in names):
            return np.stack([self.channels[channel] for channel in names], axis=-1)
        mono = self.channels.get(layer_names(name, 1)[0])
        return None if mono is None else np.repeat(mono[..., None], 3, axis=-1)


def layer_names(layer, count=3):
    """Return the names of a layer's ``count`` (1, 3 or 4) channels, such as ``stderr.R``."""
    return [f"{layer}.{letter}" if layer else letter for letter in {1: "Y", 3: "RGB", 4: "RGBA"}[count]]


def layer_channels(layer, array):
    """Return a dict of a layer's channels from an array [height, width] or [height, width, 1, 3 or 4]."""
    array = np.asarray(array, np.float32)
    array = array[..., None] if array.ndim == 2 else array
    return {name: array[..., i] for i, name in enumerate(layer_names(layer, array.shape[-1]))}


def write_exr(path, picture):
    """Write a ``Picture`` as 32-bit float, ZIP-compressed OpenEXR; the old file stays until that is whole.

    Rec. 709 primaries are noted for colour pictures whose header names none. OpenEXR keeps floats of a header
    in 32 bits; ``None`` is left out.

    Raises:
        UsageError: the file can't be written.
        ValueError, TypeError: channels differ in size, or the header has a value of another type.
    """
    files.write(path, encode_exr(picture))


def encode_exr(picture):
    """Return the ``bytes`` of the file that ``write_exr`` writes."""
    import OpenEXR

    channels = {name: np.ascontiguousarray(plane, np.float32) for name, plane in picture.channels.items()}
    size = (picture.width, picture.height)
    if any(plane.shape != size[::-1] for plane in channels.values()):
        raise ValueError(f"channels of different sizes: { {plane.shape for plane in channels.values()} }")
    header = {} if "Y" in channels else {"chromaticities": REC709}
    header |= {name: _attribute(name, value) for name, value in picture.header.items() if value is not None}
    header |= {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": _window(picture.offset, size),
        "displayWindow": _window((0, 0), picture.full_size or size),
    }
    buffer = io.BytesIO()  # given a path, OpenEXR would lose what the system says about a failure
    OpenEXR.File(header, channels).write(buffer)
    return buffer.getvalue()


def read(path):
    """Return the ``Picture`` in an OpenEXR file of ours or another program's; all values become ``float32``.

    Raises:
        UsageError: there is no such file, it is no OpenEXR file or a broken one, or it has no radiance.
    """
    import OpenEXR

    data = files.read(path)
    if data[:4] != b"\x76\x2f\x31\x01":
        raise UsageError(f"cannot read {path}: it is not an OpenEXR file")
    try:
        with _muted(), OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
            header, channels = dict(file.header()), dict(file.channels())  # closing empties them
    except Exception as error:  # the package raises several types, none of which tells more
        raise UsageError(f"cannot read {path}: the file is truncated or damaged") from error
    if header["type"] not in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
        raise UsageError(f"cannot read {path}: deep pictures are not supported")
    if any(channel.xSampling != 1 or channel.ySampling != 1 for channel in channels.values()):
        raise UsageError(f"cannot read {path}: subsampled channels are not supported")
    data_window, display_window = (np.asarray(header[name]) for name in _WINDOWS)
    picture = Picture(
        channels={name: channel.pixels.astype(np.float32) for name, channel in channels.items()},
        header={name: value for name, value in _header(header) if name not in _STRUCTURE},
        offset=tuple((data_window[0] - display_window[0]).tolist()),
        full_size=tuple((display_window[1] - display_window[0] + 1).tolist()),
    )
    if picture.rgb is None:
        names = ", ".join(picture.channels) or "none"
        raise UsageError(f"cannot read {path}: it has neither channels R, G, B nor Y; there are: {names}")
    return picture


def _window(corner, size):
    corner = np.asarray(corner, np.int32)
    return corner, corner + np.asarray(size, np.int32) - 1


def _attribute(name, value):
    """Return a header's value as a type for which OpenEXR has a lossless attribute."""
    if isinstance(value, numbers.Integral):
        return int(value) if -(2**31) <= value < 2**31 else str(int(value))
    if isinstance(value, numbers.Real):
        return float(value)
    if isinstance(value, (str, np.ndarray)):
        return value
    if isinstance(value, (list, tuple)):
        if all(isinstance(item, str) for item in value):
            return list(value) or [""]  # OpenEXR has no empty list
        if all(isinstance(item, numbers.Real) for item in value):
            return tuple(value)
    raise TypeError(f"header attribute {name!r}: {type(value).__name__} has no OpenEXR type")


def _header(header):
    """Yield the attributes whose types ``_attribute`` makes; time codes and the like are left out."""
    for name, value in header.items():
        if name in _INTEGERS and isinstance(value, str) and value.lstrip("-").isdigit():
            yield name, int(value)
        elif isinstance(value, list):
            yield name, [] if value == [""] else value
        elif isinstance(value, (int, float, str, np.ndarray)) or name == "chromaticities":
            yield name, value


@contextlib.contextmanager
def _muted():
    """Silence OpenEXR, which prints about damaged files from C and from Python, on both outputs."""
    saved = os.dup(2)
    try:
        with open(os.devnull, "w") as nothing, contextlib.redirect_stdout(nothing):
            os.dup2(nothing.fileno(), 2)
            yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)


def write_moments(path, arrays, meta):
    """Write named arrays and a dict of facts, with which a render can go on later.

    Args:
        arrays: name to ``np.ndarray`` of numbers; kept bit for bit.
        meta: a dict that JSON can hold.

    Raises:
        UsageError: the file can't be written.
    """
    if any(array.dtype.hasobject for array in arrays.values()):
        raise TypeError("moments are arrays of numbers")
    buffer = io.BytesIO()
    text = json.dumps({"format": MOMENTS_FORMAT, "meta": meta})
    named = {f"array.{name}": array for name, array in arrays.items()}
    np.savez(buffer, json=np.array(text), **named)
    files.write(path, buffer.getvalue())


def read_moments(path):
    """Return the arrays and the dict of facts that ``write_moments`` has written.

    Raises:
        UsageError: there is no such file, it is damaged, or another version's.
    """
    data = files.read(path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            head = json.loads(str(stored["json"]))
            version, meta = head["format"], head["meta"]
            arrays = {name[6:]: stored[name] for name in stored.files if name.startswith("array.")}
    except Exception as error:  # of a dozen types, for a damaged archive
        raise UsageError(f"cannot read {path}: it is damaged, or no file of a render's moments") from error
    if version != MOMENTS_FORMAT:
        raise UsageError(f"cannot read {path}: moments of format {version!r}, not {MOMENTS_FORMAT}")
    return arrays, meta
