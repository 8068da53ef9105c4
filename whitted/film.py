"""From eye rays to pixels: where samples lie on the film, and how they are summed up.

Mitsuba adds samples to the film by atomic operations, in an order that varies from run to run. Here each pixel
gathers the samples that its reconstruction filter covers, in the order of their numbers and in double precision: the
same seed gives the same bits, and a crop the bits of the whole picture.
"""

import math
from contextlib import contextmanager
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.errors import UsageError
from whitted.sampling.draws import Draws, joint_dimensions

MOST_PIXELS = 1 << 28  # of a picture, of which the sums alone take 10 GB: beyond memory Dr.Jit would abort
BLOCK = 4  # pixels of a block's side; neighbours share a SIMD packet, and so their rays stay together


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels of the film: left, top, width, height."""

    x: int
    y: int
    width: int
    height: int

    @property
    def pixels(self):
        """The number of pixels."""
        return self.width * self.height

    def grown(self, border, size, beyond):
        """Return the window with a border around it, which ends at the film's edges unless it may go beyond."""
        x, y = self.x - border, self.y - border
        right, bottom = self.x + self.width + border, self.y + self.height + border
        if not beyond:
            x, y, right, bottom = max(x, 0), max(y, 0), min(right, size[0]), min(bottom, size[1])
        return Window(x, y, right - x, bottom - y)


class Grid:
    """The samples of one pass, one per lane: block by block, then sample by sample, then pixel by pixel.

    Rows of blocks are shuffled by a fixed stride, so that no thread gets all of a costly part of the picture.

    Args:
        window: the pixels that are sampled.
        start, stop: the numbers of the samples taken in each.
    """

    def __init__(self, window, start, stop):
        self.window, self.start, self.count = window, start, stop - start
        self.left, self.top = window.x // BLOCK, window.y // BLOCK
        self.columns = -(-(window.x + window.width) // BLOCK) - self.left
        self.rows = -(-(window.y + window.height) // BLOCK) - self.top
        self.stride = _coprime(round(0.618 * self.rows), self.rows)
        self.stride_back = pow(self.stride, -1, self.rows)

    @property
    def lanes(self):
        """The number of lanes; those of blocks that the window cuts are in part idle."""
        return self.columns * self.rows * BLOCK**2 * self.count

    def samples(self):
        """Return x and y of each lane's pixel (``Int32``), the sample's number, the block's, and who is active."""
        lane = dr.arange(mi.UInt32, self.lanes)
        within = lane % BLOCK**2
        sample = lane // BLOCK**2
        block = sample // dr.opaque(mi.UInt32, self.count)
        number = sample - block * dr.opaque(mi.UInt32, self.count) + dr.opaque(mi.UInt32, self.start)
        slot = block // dr.opaque(mi.UInt32, self.columns)
        column = block - slot * dr.opaque(mi.UInt32, self.columns)
        row = slot * dr.opaque(mi.UInt32, self.stride) % dr.opaque(mi.UInt32, self.rows)
        x = mi.Int32(column * BLOCK + within % BLOCK) + dr.opaque(mi.Int32, self.left * BLOCK)
        y = mi.Int32(row * BLOCK + within // BLOCK) + dr.opaque(mi.Int32, self.top * BLOCK)
        return x, y, number, mi.UInt32(y >> 2) * 65536 + mi.UInt32(x >> 2), self.holds(x, y)

    def holds(self, x, y):
        """Return the mask of the pixels that lie in the window."""
        left, top = dr.opaque(mi.Int32, self.window.x), dr.opaque(mi.Int32, self.window.y)
        right = dr.opaque(mi.Int32, self.window.x + self.window.width)
        bottom = dr.opaque(mi.Int32, self.window.y + self.window.height)
        return (x >= left) & (x < right) & (y >= top) & (y < bottom)

    def lane(self, x, y, number):
        """Return the lane of sample ``number`` of a pixel: the inverse of ``samples``."""
        column = mi.UInt32((x >> 2) - dr.opaque(mi.Int32, self.left))
        row = mi.UInt32((y >> 2) - dr.opaque(mi.Int32, self.top))
        slot = row * dr.opaque(mi.UInt32, self.stride_back) % dr.opaque(mi.UInt32, self.rows)
        block = slot * dr.opaque(mi.UInt32, self.columns) + column
        sample = block * dr.opaque(mi.UInt32, self.count) + (number - dr.opaque(mi.UInt32, self.start))
        return sample * BLOCK**2 + mi.UInt32((y & 3) * BLOCK + (x & 3))


def _coprime(wanted, number):
    """The first integer from ``wanted`` on, at least 1, that has no factor in common with ``number``."""
    wanted = max(wanted, 1)
    while math.gcd(wanted, number) != 1:
        wanted += 1
    return wanted


def eye_rays(sensor, size, grid, groups, plan):
    """Draw the eye rays of a pass: pixel, lens, time and wavelength.

    Args:
        sensor: ``mi.Sensor`` whose film is not cropped, see ``cropped``.
        size: width and height of the film.
        grid: ``Grid``.
        groups: how samples are numbered, see ``whitted.sampling.groups``.
        plan: the effects simulated: without ``antialiasing`` rays pass through the centres of pixels, without
            ``depth_of_field`` through that of the lens, without ``motion_blur`` when the shutter opens.

    Returns:
        ``Ray3f``, its weight (``Spectrum``), the draws for the rest of the sample, the offset of the sample from
        the pixel's corner (``Point2f`` in [0, 1)^2), and the mask of active lanes.
    """
    x, y, number, block, active = grid.samples()
    index, seed = groups.number(number)
    # The film's border may have negative coordinates; 16 bits for each keep the numbers apart
    pixel = mi.UInt32(y & 0xFFFF) * 65536 + mi.UInt32(x & 0xFFFF)
    bits = 16 if grid.start + grid.count <= 1 << 16 else 32
    draws = Draws(pixel, index, seed, block, joint_dimensions(plan), bits)
    offset = draws("pixel") if "antialiasing" in plan else mi.Point2f(0.5)
    position = (mi.Point2f(x, y) + offset) * mi.ScalarPoint2f(1 / size[0], 1 / size[1])
    lens = draws("lens") if "depth_of_field" in plan else mi.Point2f(0.5)
    time = sensor.shutter_open()
    if "motion_blur" in plan:
        time = time + draws("time").x * sensor.shutter_open_time()
    wavelength = draws("wavelength").x if mi.is_spectral else mi.Float(0)
    # As Mitsuba calls it: some sensors have no other form
    ray, weight = sensor.sample_ray_differential(time, wavelength, position, lens, active)
    return mi.Ray3f(ray), weight, draws, offset, active


def colours(L, wavelengths, channels=3):
    """Return a ``Spectrum`` as a list of three ``Float``, linear Rec. 709, or in a mono variant of one or three."""
    if mi.is_spectral:
        return list(mi.spectrum_to_srgb(L, wavelengths))
    return [L.x] * channels if mi.is_monochromatic else list(L)


def finite(values):
    """Return the mask of the samples whose values (list of ``Float``) are all finite."""
    scale = 0.5 ** len(values).bit_length()  # else the sum of finite ones could overflow
    return dr.isfinite(sum((value * scale for value in values), mi.Float(0)))


def luminance(L, wavelengths):
    """Return the luminance of a ``Spectrum`` (``Float``)."""
    if mi.is_monochromatic:
        return L.x
    return mi.luminance(L, wavelengths) if mi.is_spectral else mi.luminance(L)


@contextmanager
def cropped(sensor, window=None):
    """Give the sensor's film another crop for a while; yield the ``Window`` of the one it has.

    A sensor maps its film's crop to the unit square, so its rays differ in the last bits from crop to crop. Where
    ``window`` is None the film is whole: the same rays for every crop.
    """
    film = sensor.film()
    own = Window(*(int(n) for n in (*film.crop_offset(), *film.crop_size())))
    window = window or Window(0, 0, *(int(n) for n in film.size()))
    if window == own:
        yield own
        return
    _set_crop(sensor, window)
    try:
        yield own
    finally:
        _set_crop(sensor, own)


@contextmanager
def windowed(sensor, crop=None):
    """Undo the film's crop for a while; yield the ``Window`` of the crop wanted, else the film's.

    Args:
        sensor: ``mi.Sensor``.
        crop: x, y, width, height in pixels, or None.

    Raises:
        UsageError: the crop doesn't lie in the film, or is of more than ``MOST_PIXELS``.
    """
    with cropped(sensor) as window:
        if crop is not None:
            window = Window(*(int(n) for n in crop))
            width, height = (int(n) for n in sensor.film().size())
            fits = 0 <= window.x < window.x + window.width <= width
            if not (fits and 0 <= window.y < window.y + window.height <= height):
                raise UsageError(
                    f"crop {','.join(map(str, crop))} doesn't lie in the film of {width}x{height} pixels"
                )
        if window.pixels > MOST_PIXELS:
            raise UsageError(
                f"a picture of {window.width}x{window.height} pixels is too large; accepted are {MOST_PIXELS} in all,"
                " and crops of larger films"
            )
        yield window


def resize(sensor, width, height):
    """Give the sensor's film another size, in pixels; a crop is undone."""
    _set_crop(sensor, Window(0, 0, width, height), size=(width, height))


def _set_crop(sensor, window, size=None):
    parameters = mi.traverse(sensor)
    if size is not None:
        parameters["film.size"] = mi.ScalarVector2u(size)
    parameters["film.crop_size"] = mi.ScalarVector2u(window.width, window.height)
    parameters["film.crop_offset"] = mi.ScalarPoint2u(window.x, window.y)
    parameters.update()


class Sums:
    """Per group and pixel: the sums of filter weights and of weighted values, in double precision.

    Args:
        window: the pixels summed up.
        rfilter: ``mi.ReconstructionFilter``.
        channels: how many values a sample has.
    """

    def __init__(self, window, rfilter, channels):
        self.window, self.rfilter, self.channels = window, rfilter, channels
        self.border = 0 if rfilter.is_box_filter() else int(rfilter.border_size())
        self.groups = {}
        self.nonfinite = dr.zeros(mi.UInt32, window.pixels)

    def add(self, grid, pieces, values, offset):
        """Add the samples of a pass; samples that aren't finite are left out and counted.

        Args:
            grid: ``Grid`` of the pass; its window covers the filter's footprint around ours, as far as there is film.
            pieces: the samples of each group, as ``groups.pieces`` gives them.
            values: list of evaluated ``Float`` [lanes].
            offset: evaluated ``Point2f`` [lanes], within the pixel; not used by a box filter.
        """
        lane = dr.arange(mi.UInt32, self.window.pixels)
        row = lane // dr.opaque(mi.UInt32, self.window.width)
        x = mi.Int32(lane - row * dr.opaque(mi.UInt32, self.window.width)) + dr.opaque(
            mi.Int32, self.window.x
        )
        y = mi.Int32(row) + dr.opaque(mi.Int32, self.window.y)
        for group, first, stride, count in pieces:
            # Zeros in memory, not literal ones: the first pass takes as much memory, and the same kernel, as the rest
            empty = (dr.opaque(mi.Float64, 0, self.window.pixels) for _ in range(self.channels + 1))
            sums = self.groups.get(group) or list(empty)
            piece = [dr.opaque(mi.UInt32, number) for number in (first, stride, count)]
            self.groups[group], self.nonfinite = self._gather(grid, piece, values, offset, x, y, sums)
            dr.eval(self.groups[group], self.nonfinite)

    def _gather(self, grid, piece, values, offset, x, y, sums):
        first, stride, count = piece
        side = 2 * self.border + 1

        def step(i, sums, nonfinite):
            neighbour = i // count if self.border else mi.UInt32(0)
            number = first + (i - neighbour * count) * stride
            dx = mi.Int32(neighbour % side) - self.border
            dy = mi.Int32(neighbour // side) - self.border
            inside = grid.holds(x + dx, y + dy)
            lane = grid.lane(x + dx, y + dy, number)
            sample = [dr.gather(mi.Float, value, lane, inside) for value in values]
            weight = mi.Float(1)
            if self.border:
                at = dr.gather(mi.Point2f, offset, lane, inside) + mi.Point2f(dx, dy) - 0.5
                weight = self.rfilter.eval(at.x) * self.rfilter.eval(at.y)
            is_finite = finite(sample)
            taken = inside & is_finite
            parts = [mi.Float64(dr.select(taken, v, 0)) for v in [*sample, weight]]
            if self.border:
                # Negative lobes may cancel the weights: no product may be rounded before it is summed up
                parts[:-1] = [parts[-1] * v for v in parts[:-1]]
            sums = [total + part for total, part in zip(sums, parts, strict=True)]
            nonfinite = nonfinite + dr.select(
                inside & ~is_finite & (dx == 0) & (dy == 0), mi.UInt32(1), mi.UInt32(0)
            )
            return i + 1, sums, nonfinite

        total = count * side**2
        state = (mi.UInt32(0), sums, self.nonfinite)
        _, sums, nonfinite = dr.while_loop(state, lambda i, *_: i < total, step, label="film")
        return sums, nonfinite

    def arrays(self, release=False):
        """Return sums [G, H, W, C] and weights [G, H, W], ``float64``, of the groups so far.

        With ``release`` they are moved, so that they don't lie in memory twice, and there is nothing left to add to.
        """
        shape = (self.window.height, self.window.width)
        count = max(self.groups, default=-1) + 1
        sums = np.zeros((count, *shape, self.channels))
        weights = np.zeros((count, *shape))
        for group in list(self.groups):
            totals = self.groups.pop(group) if release else self.groups[group]
            for channel, total in enumerate(totals[:-1]):
                sums[group, ..., channel] = total.numpy().reshape(shape)
            weights[group] = totals[-1].numpy().reshape(shape)
            if release:
                del totals, total
                dr.flush_malloc_cache()
        return sums, weights
