"""Scenes on which `distribution` is compared with Mitsuba's integrators, and the comparison itself."""

import drjit as dr
import mitsuba as mi
import numpy as np
from pictures import LEVEL, REPLICATES, _renders, _t_values
from scipy import stats
from whitted_scenes import camera, transform

from whitted.world import bsdfs_of

DISTRIBUTION = {"type": "distribution", "effects": "all", "max_depth": 4}
DETECTABLE = 0.02  # of the picture's mean: a bias as large is seen by every comparison


def nested(integrator):
    """Return the dict of an integrator inside ``aov`` inside ``moment``, so that its ``sample`` alone is called.

    The outermost ``aov`` would call its ``render``, as well.
    """
    return {"type": "moment", "inner": {"type": "aov", "aovs": "depth:depth", "inner": integrator}}


def ways(integrator):
    """Return the dicts in which a ``distribution`` is tried: by itself, with all effects and those found, and nested."""
    auto = integrator | {"effects": "auto"}
    return {"all": integrator, "auto": auto, "nested": nested(auto)}


def reference(scene, **options):
    """Return the dict of the integrator of Mitsuba's that is right on a scene.

    ``path`` stops shadow rays at null, mask and thin surfaces, and counts them for the depth; ``volpath`` doesn't.
    """
    is_transparent = any(int(bsdf.flags()) & mi.BSDFFlags.Null for bsdf in bsdfs_of(scene))
    return {"type": "volpath" if is_transparent else "path"} | options


def renders(scene, integrator, spp=64, sensor=0):
    """Return 16 pictures [16, H, W, C] of different seeds."""
    return _renders(scene, integrator, spp, sensor)


def worst(found, expected):
    """Compare two stacks of `renders`, their means and those of their tiles, by Student's t with Bonferroni's correction.

    Returns:
        The largest t over its limit, which is above 1 for equal means with a probability of 1e-5; the tile of 4x4 pixels
        (or "picture") and the channel where it is; the smallest bias relative to the mean of the picture that is seen.
    """
    channels = expected.shape[-1]
    found = found[..., :channels]
    t, _ = _t_values(found, expected)
    limit = stats.t.isf(LEVEL / 2 / t.size, 2 * REPLICATES - 2)
    at = int(np.abs(t).argmax())
    tile, channel = divmod(at, channels)
    a, b = found.mean((1, 2, 3)), expected.mean((1, 2, 3))
    bias = limit * np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / REPLICATES) / max(b.mean(), 1e-30)
    return abs(t[at]) / limit, f"tile {tile - 1}" if tile else "picture", channel, bias


def assert_same(found, expected, what="", detectable=DETECTABLE):
    """Assert that two stacks of `renders` have the same mean, and that a relative bias of ``detectable`` would be seen."""
    assert np.isfinite(found).all(), what
    ratio, where, channel, bias = worst(found, expected)
    means = found.mean(), expected.mean()
    assert ratio < 1, f"{what}: t over its limit is {ratio:.3g}, {where}, channel {channel}; means {means}"
    assert bias < detectable, f"{what}: only a bias of {bias:.2g} would be seen"


def agree(scene, integrator=DISTRIBUTION, spp=64, truth=None, detectable=DETECTABLE):
    """Assert that ``distribution`` and Mitsuba make the same picture, in all the `ways`; return Mitsuba's pictures.

    Args:
        scene: ``mi.Scene``.
        integrator: dict.
        spp: samples per pixel of each of 16 pictures.
        truth: another scene for Mitsuba, of the same light.
    """
    truth = truth or scene
    expected = renders(truth, reference(truth, max_depth=integrator["max_depth"]), spp)
    for way, one in ways(integrator).items():
        assert_same(renders(scene, one, spp)[..., : expected.shape[-1]], expected, way, detectable)
    return expected


# ---- Scenes


def gallery(bsdfs, behind=(), **lights):
    """Up to nine balls in three rows before a wall, each of another BSDF (a dict from name to ``mi.BSDF`` or dict).

    Those named in ``behind`` show their back. Light comes from a panel above and from the sky.
    """
    balls = {}
    for number, (name, bsdf) in enumerate(bsdfs.items()):
        column, row = number % 3, number // 3
        centre = [1.1 * (column - 1), 0.5 + 1.05 * row, 0.1 * column]
        made = {"type": "sphere", "center": centre, "radius": 0.45, "flip_normals": name in behind}
        balls[f"ball{number}"] = made | {"bsdf": bsdf}
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.4, 0.3]}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": camera(size=24)
            | {"to_world": transform().look_at([0, 1.6, 6], [0, 1.5, 0], [0, 1, 0]), "fov": 36},
            "floor": {
                "type": "rectangle",
                "to_world": transform().rotate([1, 0, 0], -90).scale(3),
                "bsdf": grey,
            },
            **balls,
            **lights,
        },
        optimize=False,
    )


def panel(scale=0.8, height=4.5, **emitter):
    """A square light that looks down, out of view."""
    to_world = transform().translate([0.5, height, 1.5]).rotate([1, 0, 0], 90).scale(scale)
    return {"type": "rectangle", "to_world": to_world, "emitter": {"type": "area"} | (emitter or {"radiance": 5.0})}
