"""From linear radiance to what a screen shows: PNG, comparison panels, error maps.

The transfer function and the primaries are those of sRGB (IEC 61966-2-1), by colour-science, which takes a
second to import, so that is done when the first picture is tone-mapped. Left out: operators that compress
highlights; values past white are clipped, so that equal greys mean equal radiance.
"""

import base64
import warnings

import numpy as np

from whitted import files
from whitted.image import REC709


def tone_map(rgb, exposure=0.0, chromaticities=None):
    r"""Return the 8-bit sRGB picture of linear radiance.

    .. math:: \lfloor 255\, f(\min(\max(2^{e} M L, 0), 1)) + 1/2 \rfloor

    with :math:`f` the sRGB transfer function, :math:`e` the exposure and :math:`M` the change of primaries.

    Args:
        rgb: [height, width, 3], linear; NaN shows black, infinity white.
        exposure: in stops: +1 doubles the radiance.
        chromaticities: x, y of the picture's red, green, blue and white, as in an OpenEXR header; None and
            Rec. 709 need no change. Other whites are adapted by Bradford's method.

    Returns:
        ``uint8`` [height, width, 3].
    """
    colour = _colour()
    linear = np.asarray(rgb, np.float64)
    if chromaticities is not None and not np.allclose(chromaticities, REC709, atol=1e-4):
        points = np.reshape(np.asarray(chromaticities, np.float64), (4, 2))
        space = colour.RGB_Colourspace("picture", points[:3], points[3])
        matrix = colour.matrix_RGB_to_RGB(space, colour.RGB_COLOURSPACES["sRGB"], "Bradford")
        linear = linear @ matrix.T
    linear = np.clip(np.nan_to_num(linear * 2.0**exposure, nan=0.0, posinf=1.0), 0.0, 1.0)
    return np.floor(255 * colour.cctf_encoding(linear, function="sRGB") + 0.5).astype(np.uint8)


def encode_png(rgb, exposure=0.0, chromaticities=None):
    """Return the ``bytes`` of an 8-bit PNG of the picture that ``tone_map`` makes; the arguments are its own."""
    import mitsuba as mi

    stream = mi.MemoryStream()
    mi.Bitmap(tone_map(rgb, exposure, chromaticities)).write(stream, mi.Bitmap.FileFormat.PNG)
    return bytes(stream.raw_buffer())


def html_image(rgb):
    """Return linear radiance as an HTML image."""
    return f'<img src="data:image/png;base64,{base64.b64encode(encode_png(rgb)).decode()}">'


def write_png(path, rgb, exposure=0.0, chromaticities=None):
    """Write the picture that ``tone_map`` makes of linear radiance, as an 8-bit PNG.

    The arguments are those of ``tone_map``.

    Raises:
        UsageError: the file can't be written.
    """
    files.write(path, encode_png(rgb, exposure, chromaticities))


def panel(images, columns=None, gutter=8, background=1.0):
    """Return one linear picture with several of equal size in it, row by row.

    Args:
        images: list of [height, width, 3] arrays.
        columns: pictures per row; all in one row where it is None.
        gutter: pixels between neighbours; there are none at the borders.
        background: linear value of the gutter and of places that stay empty.

    Raises:
        ValueError: there are no pictures, or they differ in size.
    """
    images = [np.asarray(image, np.float32) for image in images]
    if len({image.shape for image in images}) != 1:
        raise ValueError(f"a panel takes pictures of one size, not {[image.shape for image in images]}")
    columns = min(columns or len(images), len(images))
    rows = -(-len(images) // columns)
    height, width, _ = images[0].shape
    size = (rows * (height + gutter) - gutter, columns * (width + gutter) - gutter, 3)
    result = np.full(size, background, np.float32)
    for i, image in enumerate(images):
        y, x = i // columns * (height + gutter), i % columns * (width + gutter)
        result[y : y + height, x : x + width] = image
    return result


def difference(a, b, scale=None):
    """Return a linear false-colour picture of ``a - b``: red where ``a`` is brighter, blue where ``b`` is.

    White is no difference of luminance, full red or blue a difference of ``scale`` or more; NaN shows black.

    Args:
        a, b: [height, width, 3], linear.
        scale: the luminance difference of the full colour; by default the 99th percentile of the absolute
            differences of this pair.
    """
    signed = (np.asarray(a, np.float64) - np.asarray(b, np.float64)) @ (0.2126, 0.7152, 0.0722)
    if scale is None:
        finite = np.abs(signed[np.isfinite(signed)])
        scale = np.percentile(finite, 99) if finite.size else 0.0
    strength = np.clip(signed / (scale or 1.0), -1.0, 1.0)
    strength = np.where(np.isnan(signed), np.nan, strength)
    red, blue = 1 + np.minimum(strength, 0), 1 - np.maximum(strength, 0)
    return np.nan_to_num(np.stack([red, np.minimum(red, blue), blue], axis=-1)).astype(np.float32)


def _colour():
    """Import colour-science without its remarks on the packages that it could also use."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour
