"""Do two integrators make the same picture? A test of means, of a level that adds up over a suite."""

import mitsuba as mi
import numpy as np
from scipy import stats

LEVEL = (
    1e-5  # false alarms of one comparison of two pictures: a suite of 100 of them fails by chance with 0.1 %
)
REPLICATES = 16  # on each side
TILE = 4


def same_light(scene, ours, theirs, spp=128, sensor=0, channels=slice(None)):
    """Assert that two integrators (dicts) estimate the same picture; return the mean of ours.

    The means of the picture and of its tiles of 4x4 pixels, of all channels, between 16 renders of different seeds
    on each side, by Student's t with Bonferroni's correction: false alarms at 1e-5.
    """
    a, b = (_renders(scene, integrator, spp, sensor) for integrator in (ours, theirs))
    a, b = a[..., channels], b[..., channels]
    assert a.shape == b.shape
    assert np.isfinite(a).all()
    t, scale = _t_values(a, b)
    limit = stats.t.isf(LEVEL / 2 / t.size, 2 * REPLICATES - 2)
    worst = np.abs(t).max()
    assert worst < limit, (
        f"t = {worst:.3g} > {limit:.3g}; means {a.mean((0, 1, 2))}, {b.mean((0, 1, 2))}, scale {scale}"
    )
    return a.mean(0)


def differ(scene, ours, theirs, **options):
    """Return whether `same_light` fails."""
    try:
        same_light(scene, ours, theirs, **options)
    except AssertionError:
        return True
    return False


def _renders(scene, integrator, spp, sensor):
    made = mi.load_dict(integrator)
    seeds = [100003 * k + 5 for k in range(REPLICATES)]
    images = [np.array(mi.render(scene, integrator=made, spp=spp, seed=s, sensor=sensor)) for s in seeds]
    images = np.array(images, np.float64)
    return images[..., None] if images.ndim == 3 else images


def _t_values(a, b):
    def parts(images):
        r, height, width, channels = images.shape
        height, width = max(height // TILE, 1) * min(TILE, height), max(width // TILE, 1) * min(TILE, width)
        cut = images[:, :height, :width]
        tiles = cut.reshape(r, -1, min(TILE, height), max(width // TILE, 1), min(TILE, width), channels)
        tiles = tiles.mean((2, 4)).reshape(r, -1)
        return np.concatenate([images.mean((1, 2)), tiles], axis=1)

    a, b = parts(a), parts(b)
    scale = max(np.abs(a).max(), np.abs(b).max())
    rounding = 2e-5 * (np.abs(a.mean(0)) + 1e-2 * scale)  # where neither has noise
    error = np.sqrt((a.var(0, ddof=1) + b.var(0, ddof=1)) / REPLICATES + rounding**2 + 1e-300)
    return (a.mean(0) - b.mean(0)) / error, scale
