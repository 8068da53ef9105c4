"""Which effect owns which light paths: `distribution` against a plain path tracer that sorts paths by their lobes.

A scattering belongs to the kind of the lobe that was followed there; the last one before the light only if it is
specular, as the direct light of other lobes is nobody's. One comparison has false alarms at 1e-5, see `pictures`; there
are 18 of them, and 8 more that have to fail.
"""

from functools import cache
from itertools import combinations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import Difference, assert_same, renders
from pictures import LEVEL, REPLICATES, _t_values
from scipy import stats
from whitted_scenes import camera, panel, stage, transform

from whitted.effects import NAMES, spell

OWNERS = ("reflection", "refraction", "interreflection")
MISSING = [gone for count in (1, 2, 3) for gone in combinations(OWNERS, count)]
DEPTH = 5
SPP = {"reference": 4096, "distribution": 256, "path": 1024}


@cache
def scene():
    """Mirror and glass, smooth and rough, and two kinds of plastic, among diffuse walls under a panel and the sky."""
    bsdfs = (
        {"type": "conductor", "specular_reflectance": 0.8},
        {"type": "dielectric"},
        {"type": "roughconductor", "alpha": 0.3},
        {"type": "roughdielectric", "alpha": 0.2},
        {"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": 0.4},
        {"type": "principled", "roughness": 0.4, "metallic": 0.2, "spec_trans": 0.4, "clearcoat": 0.5},
        {"type": "plastic", "diffuse_reflectance": 0.5},
    )
    places = [
        (-1.2, 0.4, 0.3),
        (-0.4, 0.4, 1),
        (0.5, 0.4, 0.9),
        (1.3, 0.4, 0.4),
        (-0.6, 0.5, -0.5),
        (0.4, 0.5, -0.4),
    ]
    balls = {
        f"ball{number}": {"type": "sphere", "center": list(place), "radius": 0.38, "bsdf": bsdf}
        for number, (place, bsdf) in enumerate(zip([*places, (0, 1.3, 0)], bsdfs, strict=True))
    }
    wall = {"type": "twosided", "nested": {"type": "diffuse", "reflectance": 0.5}}
    back = {"type": "rectangle", "to_world": transform().translate([0, 1.5, -1.4]).scale(2.5), "bsdf": wall}
    side = back | {"to_world": transform().translate([-2, 1.5, 0]).rotate([0, 1, 0], 90).scale(2.5)}
    return stage(
        camera(), light=panel(4.0), sky={"type": "constant", "radiance": 0.5}, back=back, side=side, **balls
    )


@cache
def classes():
    """The picture by classes of paths: an array [16 seeds, 8, H, W, 3], the class being a bit for each of `OWNERS`."""
    return np.array([traced(scene(), SPP["reference"], seed) for seed in range(REPLICATES)])


def traced(scene, spp, seed, mistake=None):
    """Trace paths that find light by chance alone, see `classes`.

    ``mistake``, made on purpose: "direct", rough lobes own their direct light; "rough", they count as diffuse ones.
    """
    sensor = scene.sensors()[0]
    width, height = sensor.film().size()
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, width * height * spp)
    pixel = dr.arange(mi.UInt32, width * height * spp) // spp
    corner = mi.Point2f(pixel % width, pixel // width)
    position = (corner + sampler.next_2d()) * mi.ScalarPoint2f(1 / width, 1 / height)
    ray, throughput = sensor.sample_ray(0, 0, position, 0.5)
    context, alive = mi.BSDFContext(), dr.full(mi.Bool, True, width * height * spp)
    owners, pending = dr.zeros(mi.UInt32, len(pixel)), dr.zeros(mi.UInt32, len(pixel))
    found = dr.zeros(mi.Float, 8 * width * height * 3)
    for _ in range(DEPTH):
        si = scene.ray_intersect(ray, alive)
        L = throughput * si.emitter(scene, alive).eval(si, alive)
        place = owners * width * height + pixel
        for channel in range(3):
            dr.scatter_reduce(dr.ReduceOp.Add, found, L[channel], place * 3 + channel, alive)
        sample, weight = si.bsdf().sample(context, si, sampler.next_1d(), sampler.next_2d(), alive)
        throughput *= weight
        alive &= si.is_valid() & dr.any(throughput > 0)
        owners |= pending  # light has come as far as to be scattered there once more
        is_delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        is_rough = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Glossy)
        owner = owner_of(sample.sampled_type)
        if mistake == "rough":
            owner = dr.select(is_rough, mi.UInt32(4), owner)
        at_once = is_delta | (is_rough & (mistake == "direct"))
        owners |= dr.select(at_once, owner, 0)
        pending = dr.select(at_once, mi.UInt32(0), owner)
        ray = si.spawn_ray(si.to_world(sample.wo))
        dr.eval(ray, throughput, owners, pending, alive, found, sampler)
    return found.numpy().reshape(8, height, width, 3).astype(np.float64) / spp


def owner_of(sampled_type):
    """The bit of a lobe's owner."""
    flags = mi.BSDFFlags
    reflects = (sampled_type & (flags.DeltaReflection | flags.GlossyReflection)) != 0
    refracts = (sampled_type & (flags.DeltaTransmission | flags.GlossyTransmission)) != 0
    return dr.select(reflects, mi.UInt32(1), dr.select(refracts, mi.UInt32(2), mi.UInt32(4)))


def without(gone):
    """The sum of the classes that are left, [16, H, W, 3]."""
    dropped = sum(1 << OWNERS.index(effect) for effect in gone)
    return classes()[:, [owners for owners in range(8) if not owners & dropped]].sum(1)


@cache
def distribution(gone=()):
    """Pictures of `distribution` with some effects missing, [16, H, W, 3]."""
    effects = tuple(name for name in NAMES if name not in gone)
    made = {"type": "distribution", "max_depth": DEPTH, "effects": spell(effects)}
    return renders(scene(), made, SPP["distribution"])


def test_the_classes_add_up_to_path():
    assert_same(without(()), renders(scene(), {"type": "path", "max_depth": DEPTH}, SPP["path"]))


def test_every_class_carries_light():
    shares = classes().mean((0, 2, 3, 4)) / classes().sum(1).mean()
    assert (shares > 0.002).all(), shares


def test_all_effects_are_all_classes():
    assert_same(distribution(), without(()))


@pytest.mark.parametrize("gone", MISSING, ids="+".join)
def test_missing_effects_leave_the_other_classes(gone):
    assert_same(distribution(gone), without(gone), detectable=0.01)


@pytest.mark.parametrize("gone", MISSING[:6], ids="+".join)
def test_the_sum_of_other_classes_is_rejected(gone):
    """One class too many, the faintest that could be counted by mistake, is one that `assert_same` sees."""
    dropped = sum(1 << OWNERS.index(effect) for effect in gone)
    wrong = [owners for owners in range(1, 8) if owners & dropped]
    faintest = min(wrong, key=lambda owners: classes()[:, owners].mean())
    assert Difference.of(distribution(gone), without(gone) + classes()[:, faintest]).ratio > 1


@pytest.mark.parametrize("gone", MISSING, ids="+".join)
def test_an_effect_adds_light_everywhere(gone):
    """No tile is brighter without it: 50 tiles and channels at a level of 1e-5 together; the picture is darker."""
    t, _ = _t_values(distribution(), distribution(gone))
    assert t.min() > -stats.t.isf(LEVEL / t.size, 2 * REPLICATES - 2)
    assert t[:3].min() > 10


@pytest.mark.parametrize("mistake", ["direct", "rough"])
def test_other_rules_are_rejected(mistake):
    """If rough lobes owned their direct light, or belonged to the diffuse ones, it would show."""
    gone = ("reflection",)
    other = np.array([traced(scene(), 1024, seed, mistake) for seed in range(REPLICATES)])
    assert_same(other.sum(1), classes().sum(1))
    left = other[:, [owners for owners in range(8) if not owners & 1]].sum(1)
    assert Difference.of(distribution(gone), left).ratio > 1
