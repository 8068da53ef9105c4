"""What of the hard cases of whole scenes can't be a case: comparisons of two estimates with noise of their own."""

import mitsuba as mi
import numpy as np

import whitted
from whitted.hardcases import scenes
from whitted.hardcases.scenes import DISTRIBUTION, WHITTED, square


def under(light):
    """A diffuse floor under a mesh that emits."""
    sensor = {"type": "perspective", "fov": 40, "film": scenes.film(8, 8)}
    sensor["to_world"] = scenes.place().look_at([0.3, 1.8, 4.5], [0, 0.6, 0], [0, 1, 0])
    floor = square(3, 0, False, bsdf={"type": "diffuse", "reflectance": 0.6})
    return mi.load_dict({"type": "scene", "sensor": sensor, "floor": floor, "light": light}, optimize=False)


def lamps():
    """The same light without and with triangles that have no area."""
    for spoilt in (False, True):
        emitter = {"type": "area", "radiance": 4.0}
        yield square(0.5, 2, spoilt, down=True, bsdf={"type": "diffuse"}, emitter=emitter)


def test_triangles_without_area_in_a_light_are_not_sampled():
    plain, spoilt = (whitted.render(under(lamp), WHITTED, spp=16) for lamp in lamps())
    np.testing.assert_array_equal(spoilt.mean, plain.mean)
    assert plain.mean[-1].min() > 0.04, "the floor is lit"


def test_distribution_estimates_the_same_light_by_other_samples():
    """Its choice among triangles has more of them; one comparison has false alarms at 1e-5."""
    plain, spoilt = (whitted.render(under(lamp), DISTRIBUTION, spp=64, replicates=8) for lamp in lamps())
    error = np.sqrt(sum((one.standard_error.astype(np.float64) ** 2).sum() for one in (plain, spoilt)))
    assert (
        abs(spoilt.mean.astype(np.float64).sum() - plain.mean.sum(dtype=np.float64))
        < 4.5 * np.sqrt(3) * error
    )
