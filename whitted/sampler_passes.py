"""Passes of Mitsuba's integrators with its samplers, summed up by ourselves, so that a seed has one picture.

Mitsuba's film adds samples by atomic operations in single precision: with more than one thread the last bits vary, and
after thousands of samples of a value the sum is off by 3e-5. Here each pixel adds up its own samples in order and in
double precision, at 1 to 4 % more time. The filter is a box of one pixel. Left out: integrators that don't gather
radiance along eye rays, such as light tracers.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import denormals
from whitted.film import colours
from whitted.stats.moments import Moments

LANES = 1 << 22  # of one pass: about 100 MB of samples
MOST = (1 << 32) - 1  # lanes of a wavefront


class SamplerPasses:
    """All samples of a window, by one sampler.

    Args:
        integrator: ``mi.SamplingIntegrator``.
        scene: ``mi.Scene``.
        sensor: ``mi.Sensor`` whose film is not cropped, see `whitted.film.cropped`.
        sampler: ``mi.Sampler``; a copy is used.
        window: `whitted.film.Window`. Windows draw numbers of their own: the same window and seed, the same bits.
        seed: ``int``, 32 bits.
        spp: samples per pixel that the sampler accepts.
    """

    def __init__(self, integrator, scene, sensor, sampler, window, seed, spp):
        self.integrator, self.scene, self.sensor = integrator, scene, sensor
        self.window, self.spp = window, spp
        self.per_pass = _divisor(spp, max(min(LANES // window.pixels, MOST // window.pixels), 1))
        self.sampler = sampler.clone()
        self.sampler.set_sample_count(spp)
        self.sampler.set_samples_per_wavefront(self.per_pass)
        self.sampler.seed((seed + 2654435761 * (window.y * 65536 + window.x)) % 2**32, self.lanes)
        self.channels = 1 if mi.is_monochromatic else 3
        zeros = (dr.opaque(mi.Float64, 0, window.pixels) for _ in range(self.channels + 1))
        self.sums = list(zeros)

    @property
    def lanes(self):
        """The number of lanes of a pass."""
        return self.window.pixels * self.per_pass

    @denormals.flushed()
    def run(self):
        """Take all samples."""
        for done in range(self.per_pass, self.spp + 1, self.per_pass):
            values = self._radiance()
            if done < self.spp:
                self.sampler.advance()
                self.sampler.schedule_state()
            dr.eval(values)
            self.sums = self._added(values)
            dr.eval(self.sums)

    def _radiance(self):
        """The colours of the next samples, a list of ``Float`` [lanes], pixel by pixel."""
        pixel = dr.arange(mi.UInt32, self.lanes) // dr.opaque(mi.UInt32, self.per_pass)
        row = pixel // dr.opaque(mi.UInt32, self.window.width)
        x = pixel - row * dr.opaque(mi.UInt32, self.window.width) + dr.opaque(mi.UInt32, self.window.x)
        corner = mi.Point2f(mi.Float(x), mi.Float(row + dr.opaque(mi.UInt32, self.window.y)))
        width, height = self.sensor.film().size()
        # In the order in which Mitsuba's own render loop draws
        position = (corner + self.sampler.next_2d()) * mi.ScalarPoint2f(1 / width, 1 / height)
        lens = self.sampler.next_2d() if self.sensor.needs_aperture_sample() else mi.Point2f(0.5)
        time = self.sensor.shutter_open()
        if self.sensor.shutter_open_time() > 0:
            time = time + self.sampler.next_1d() * self.sensor.shutter_open_time()
        wavelength = self.sampler.next_1d() if mi.is_spectral else mi.Float(0)
        ray, weight = self.sensor.sample_ray_differential(time, wavelength, position, lens)
        L, _, _ = self.integrator.sample(self.scene, self.sampler, ray, self.sensor.get_medium())
        return colours(L * weight, ray.wavelengths, self.channels)

    def _added(self, values):
        """The sums with the samples of a pass added; those that aren't finite are left out."""
        first = dr.arange(mi.UInt32, self.window.pixels) * dr.opaque(mi.UInt32, self.per_pass)
        count = dr.opaque(mi.UInt32, self.per_pass)

        def step(i, *sums):
            sample = [dr.gather(mi.Float, value, first + i) for value in values]
            finite = dr.isfinite(sum(sample, mi.Float(0)))
            taken = [mi.Float64(dr.select(finite, value, 0)) for value in (*sample, mi.Float(1))]
            return i + 1, *(total + value for total, value in zip(sums, taken, strict=True))

        state = (mi.UInt32(0), *self.sums)
        return list(dr.while_loop(state, lambda i, *_: i < count, step, label="film")[1:])

    def moments(self):
        """Return the ``Moments``, one group."""
        planes = [total.numpy().reshape(self.window.height, self.window.width) for total in self.sums]
        return Moments(np.stack(planes[:-1], axis=-1)[None], planes[-1][None])


def _divisor(number, most):
    """The largest divisor of ``number`` up to ``most``."""
    return next(n for n in range(min(number, most), 0, -1) if number % n == 0)
