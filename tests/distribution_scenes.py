"""Scenes on which `distribution` is compared with Mitsuba's integrators, and the comparison itself."""

import dataclasses

import mitsuba as mi
import numpy as np
import pytest
from pictures import LEVEL, REPLICATES, _renders, _t_values
from scipy import stats
from whitted_scenes import GREY, camera, transform

from whitted.contents import bsdfs_of

DISTRIBUTION = {"type": "distribution", "effects": "all", "max_depth": 4}
DETECTABLE = 0.02  # of the picture's mean: a bias as large is seen by every comparison
LAMP = {"type": "area", "radiance": {"type": "rgb", "value": [5, 4, 3]}}
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.4, 0.5]}}

# ---- The comparison


def nested(integrator):
    """Return the dict of an integrator inside ``aov`` inside ``moment``, so that its ``sample`` alone is called.

    As the outermost ``aov`` would call its ``render``.
    """
    return {"type": "moment", "inner": {"type": "aov", "aovs": "depth:depth", "inner": integrator}}


def reference(scene, **options):
    """Return the dict of the integrator of Mitsuba's that is right on a scene.

    ``path`` stops shadow rays at null, mask and thin surfaces, and counts these for the depth; ``volpath`` doesn't.
    """
    is_transparent = any(int(bsdf.flags()) & mi.BSDFFlags.Null for bsdf in bsdfs_of(scene))
    return {"type": "volpath" if is_transparent else "path"} | options


def renders(scene, integrator, spp=64, sensor=0):
    """Return 16 pictures [16, H, W, C] of different seeds; what is ``auto`` is decided once, not for each of them."""
    if integrator["type"] == "distribution":
        made = mi.load_dict(integrator)
        integrator = made.fixed(made.plan(made.world(scene), scene.sensors()[sensor])).properties()
    return _renders(scene, integrator, spp, sensor)


@dataclasses.dataclass
class Difference:
    """Of two stacks of pictures: Student's t of the means of the picture and of its tiles of 4x4 pixels, all channels.

    ``ratio`` is the largest t over its limit, with Bonferroni's correction: above 1 for equal means with a probability
    of 1e-5. ``where`` is its tile (row by row) and channel. A relative ``bias`` of the picture is seen.
    """

    ratio: float
    where: str
    bias: float
    means: tuple

    @classmethod
    def of(cls, found, expected):
        """Compare two stacks of `renders`; channels that only the first one has don't count."""
        channels = expected.shape[-1]
        found = found[..., :channels]
        assert np.isfinite(found).all()
        t, _ = _t_values(found, expected)
        limit = stats.t.isf(LEVEL / 2 / t.size, 2 * REPLICATES - 2)
        tile, channel = divmod(int(np.abs(t).argmax()), channels)
        where = f"{f'tile {tile - 1}' if tile else 'picture'}, channel {channel}"
        a, b = found.mean((1, 2, 3)), expected.mean((1, 2, 3))
        error = np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / REPLICATES)
        return cls(np.abs(t).max() / limit, where, limit * error / max(b.mean(), 1e-30), (a.mean(), b.mean()))


def assert_same(found, expected, detectable=DETECTABLE):
    """Assert that two stacks of `renders` have the same mean, and that a relative bias ``detectable`` would be seen."""
    difference = Difference.of(found, expected)
    assert difference.ratio < 1, difference
    assert difference.bias < detectable, difference


# How `distribution` is called in a comparison: with all effects; with those found, and all light from samples, as with
# all effects unoccluded light is known where it has a closed form; nested, on rays and numbers of Mitsuba's.
WAYS = {
    "all": lambda integrator: integrator,
    "found": lambda integrator: (
        integrator | {"effects": "auto", "direct_light": "both", "closed_form": False}
    ),
    "nested": nested,
}


def ways(*names):
    """Return the decorator of a test that is called in these ways, in all but the first in ``make test-long`` only."""
    first, *others = names
    return pytest.mark.parametrize(
        "way", [first, *(pytest.param(name, marks=pytest.mark.long) for name in others)]
    )


def assert_agrees(scene, integrator=DISTRIBUTION, spp=64, truth=None, detectable=DETECTABLE, way="all"):
    """Assert that ``distribution`` and Mitsuba make the same picture.

    Args:
        scene: ``mi.Scene``.
        integrator: dict.
        spp: samples per pixel of each of 16 pictures.
        truth: another scene, for Mitsuba, of the same light.
        detectable: the smallest bias that has to be seen.
        way: a name in `WAYS`.

    Returns:
        Our pictures and Mitsuba's.
    """
    truth = truth or scene
    expected = renders(truth, reference(truth, max_depth=integrator["max_depth"]), spp)
    found = renders(scene, WAYS[way](integrator), spp)
    assert_same(found, expected, detectable)
    return found, expected


# ---- Scenes


def place(number, size=0.45):
    """Return the transform from the unit ball to the place of a ``number`` from 0 to 8 in a `gallery`."""
    column, row = number % 3, number // 3
    return transform().translate([1.1 * (column - 1), 0.5 + 1.05 * row, 0.1 * column]).scale(size)


def balls(bsdfs, behind=()):
    """Return the shapes of a gallery for a dict of BSDFs; of those named in ``behind`` the back is seen."""
    return {
        f"ball{number}": {
            "type": "sphere",
            "to_world": place(number),
            "flip_normals": name in behind,
            "bsdf": bsdf,
        }
        for number, (name, bsdf) in enumerate(bsdfs.items())
    }


def gallery(shapes, **lights):
    """Up to nine shapes at their `place` above a floor."""
    to_world = transform().look_at([0, 1.6, 6], [0, 1.5, 0], [0, 1, 0])
    sensor = camera(size=24) | {"to_world": to_world, "fov": 36}
    floor = {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(3), "bsdf": GREY}
    return mi.load_dict(
        {"type": "scene", "sensor": sensor, "floor": floor, **shapes, **lights}, optimize=False
    )


def overhead(scale=0.8, height=4.5):
    """Return the transform of a square that looks down, out of view."""
    return transform().translate([0.5, height, 1.5]).rotate([1, 0, 0], 90).scale(scale)


def panel(radiance=5.0, scale=0.8, height=4.5):
    """A square light out of view."""
    emitter = {"type": "area", "radiance": radiance}
    return {"type": "rectangle", "to_world": overhead(scale, height), "emitter": emitter}


def standing(kind, to_world=None, radiance=None, **properties):
    """A light to the right of the ball, turned so that it shines on the wall as well."""
    turned = transform().translate([0.7, 0.7, 0.6]).rotate([0, 1, 0], 210).rotate([1, 0, 0], 20).scale(0.3)
    emitter = LAMP | ({"radiance": radiance} if radiance else {})
    return {
        "type": kind,
        "to_world": turned if to_world is None else to_world,
        "emitter": emitter,
    } | properties


def small_light(kind, random):
    """A small light of a kind, anywhere."""
    at, colour = random.uniform([-2, 1.8, -2], [2, 3, 2]).tolist(), random.uniform(1, 3, 3).tolist()
    (heading, pitch), size = random.uniform(0, 360, 2), random.uniform(0.2, 0.4)
    colour = {"type": "rgb", "value": colour}
    turned = transform().translate(at).rotate([0, 1, 0], heading).rotate([1, 0, 0], pitch)
    if kind == "point":
        return {"type": "point", "position": at, "intensity": colour}
    if kind == "spot":
        return {"type": "spot", "to_world": turned, "intensity": colour, "cutoff_angle": 40}
    return standing(kind, turned.scale(size), colour)


def many(count):
    """Return a dict of lights of all kinds."""
    random = np.random.default_rng(5)
    kinds = ("rectangle", "point", "sphere", "spot", "disk", "cube", "cylinder")
    return {f"light{number}": small_light(kinds[number % 7], random) for number in range(count)}
