"""Independent randomisations of a picture by any integrator of Mitsuba, for statistics between them.

Each is rendered in one pass, so that a stratified sampler keeps its strata, and through a box filter of one
pixel, so that pixels are independent. The scene is left as it is. Left out: stopping early.
"""

import functools
import math

import numpy as np

from whitted import denormals

SAMPLER = "multijitter"  # not ldsampler: it correlates dimensions, and darkens a Cornell box by 0.4 %
STRIDE = 100003  # between seeds: seeds less than spp apart repeat a stratified pattern, shifted by a pixel


@denormals.flushed()
def replicate(integrator, scene, sensor, seed, spp):
    """Render one replicate, ``float32`` [height, width, channels], channels being 3, or 1 in mono variants.

    Args:
        integrator, scene: objects of Mitsuba.
        sensor: from `box_sensor`.
        seed: >= 0; one of `seeds`.
        spp: samples per pixel; from `whole_grid`.
    """
    image = np.array(integrator.render(scene, sensor, seed=seed, spp=spp), np.float32)
    return image[..., : 1 if image.shape[-1] < 3 else 3]  # further channels are an integrator's own


def seeds(side, first, count):
    """Return ``count`` seeds for a side (0, 1, ...) of at most four; no two sides share one."""
    return [(STRIDE * (4 * k + side) + first) % 2**32 for k in range(count)]


def whole_grid(spp):
    """Return the samples per pixel, at least ``spp``, for which the sampler's grid is full."""
    rows = math.isqrt(spp)
    return rows * -(-spp // rows)


def box_sensor(sensor, sampler=SAMPLER):
    """Return a copy of an ``mi.Sensor`` that has a box filter, an RGB film and another sampler.

    Rays come from the original, which stays as it is. Size and crop of the film are kept.
    """
    import mitsuba as mi

    film = sensor.film()
    width, height = film.size()
    crop_width, crop_height = film.crop_size()
    x, y = film.crop_offset()
    made = mi.load_dict(
        {
            "type": _register(mi.variant()),
            "shutter_open": float(np.ravel(sensor.shutter_open())[0]),
            "shutter_close": float(np.ravel(sensor.shutter_open() + sensor.shutter_open_time())[0]),
            "sampler": {"type": sampler},
            "film": {
                "type": "hdrfilm",
                "width": int(width),
                "height": int(height),
                "crop_width": int(crop_width),
                "crop_height": int(crop_height),
                "crop_offset_x": int(x),
                "crop_offset_y": int(y),
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
        }
    )
    made.take(sensor)
    return made


@functools.cache
def _register(variant):
    """Register the plugin of the private sensor for a variant; return its name."""
    import mitsuba as mi

    class Borrowed(mi.Sensor):
        """Asks another sensor for its rays."""

        def take(self, sensor):
            self.lender = sensor
            self.m_needs_sample_2 = sensor.needs_sample_2()
            self.m_needs_sample_3 = sensor.needs_sample_3()
            self.set_medium(sensor.get_medium()) if sensor.get_medium() is not None else None

        def sample_ray(self, *args, **kwargs):
            return self.lender.sample_ray(*args, **kwargs)

        def sample_ray_differential(self, *args, **kwargs):
            return self.lender.sample_ray_differential(*args, **kwargs)

        def sample_direction(self, *args, **kwargs):
            return self.lender.sample_direction(*args, **kwargs)

        def bbox(self):
            return self.lender.bbox()

        def to_string(self):
            return f"Borrowed[{self.lender}]"

    name = "_whitted_borrowed_sensor"
    mi.register_sensor(name, Borrowed)
    return name
