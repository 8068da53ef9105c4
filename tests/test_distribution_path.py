"""`distribution` against Mitsuba's integrators: depths, numbers of samples, hidden emitters, variants, ways to call it.

One comparison has false alarms at 1e-5, see `pictures`; there are about 50. Each sees a bias of 2 % of the
picture, in spectral and mono variants of 4 %.
"""

import functools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import (
    DISTRIBUTION,
    LAMP,
    SKY,
    Difference,
    assert_same,
    many,
    nested,
    panel,
    reference,
    renders,
)
from whitted_scenes import EMITTERS, GREY, ROUGH, ball, camera, stage, transform

import whitted
from whitted import direct, paths
from whitted.lights.bounded import BoundedLights
from whitted.lights.collection import Lights
from whitted.world import World


def mixed(sensor=None):
    """Glass, rough metal and plastic on a diffuse floor, under a panel and a sky with a picture on it."""
    small = {"radius": 0.4}
    return stage(
        sensor,
        glass=ball({"type": "dielectric"}),
        metal=ball(ROUGH) | small | {"center": [-1, 0.5, 0.3]},
        plastic=ball({"type": "plastic"}) | small | {"center": [1, 0.5, 0.3]},
        panel=panel(),
        sky=EMITTERS["envmap"](),
    )


@functools.cache
def of_mixed(max_depth):
    scene = mixed()
    return renders(scene, reference(scene, max_depth=max_depth))


# ---- Depths and numbers of samples


@pytest.mark.parametrize("max_depth", [1, 2, 3, 4, -1])
def test_depths(max_depth):
    integrator = DISTRIBUTION | {"max_depth": max_depth}
    found = renders(mixed(), integrator)
    assert_same(found, of_mixed(max_depth))
    assert_same(renders(mixed(), nested(integrator)), of_mixed(max_depth))
    other = {1: 2, 2: 1, 3: 2, 4: 3, -1: 4}[max_depth]
    assert Difference.of(found, of_mixed(other)).ratio > 1, "another depth is told apart"


def test_depth_0_is_black():
    assert not np.any(mi.render(mixed(), integrator=mi.load_dict(DISTRIBUTION | {"max_depth": 0}), spp=1))


NUMBERS = [{"rr_depth": depth} for depth in (1, 2, 5, 100)]
NUMBERS += [{"tree_depth": depth} for depth in (0, 1, 4)]
SPLITS = ("light_samples", "gloss_samples", "interreflection_samples")
NUMBERS += [{name: count} for name in SPLITS for count in (3, 4)]
NUMBERS += [dict.fromkeys(SPLITS, count) for count in (3, 4)]
NUMBERS += [dict(zip(SPLITS, (3, 4, 2), strict=True)) | {"tree_depth": 1, "rr_depth": 2}]


@pytest.mark.parametrize("numbers", NUMBERS, ids=str)
def test_numbers_of_samples_do_not_change_the_mean(numbers):
    integrator = DISTRIBUTION | {"max_depth": -1} | numbers
    assert_same(renders(mixed(), integrator, spp=32), of_mixed(-1))


def test_numbers_of_samples_nested():
    integrator = DISTRIBUTION | {"max_depth": -1} | NUMBERS[-1]
    assert_same(renders(mixed(), nested(integrator), spp=32), of_mixed(-1))


def test_numbers_of_samples_that_are_shared_out():
    """On a scene whose kernels are small, as each number that is tried out takes one."""
    scene = stage(metal=ball(ROUGH), panel=panel())
    integrator = DISTRIBUTION | {"max_depth": 3} | dict.fromkeys(SPLITS, "auto")
    assert_same(renders(scene, integrator, spp=32), renders(scene, reference(scene, max_depth=3), spp=32))


def whole(*_):
    return mi.Float(1)


def doubled(method):
    return lambda *arguments: 2 * method(*arguments)


MUTATIONS = {
    "a light's sample counts in full beside rays": (direct, "power_heuristic", lambda _: whole),
    "a ray that meets a light counts in full": (paths, "power_heuristic", lambda _: whole),
    "the density of a light is twice as large": (Lights, "pdf", doubled),
    "unoccluded light is twice as large": (BoundedLights, "irradiance", doubled),
    "nothing blocks light": (World, "transmittance", lambda _: lambda *_, **__: mi.Spectrum(1)),
}


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_a_factor_left_out_is_seen(mutation, monkeypatch):
    where, name, mutant = MUTATIONS[mutation]
    monkeypatch.setattr(where, name, mutant(getattr(where, name)))
    assert Difference.of(renders(mixed(), DISTRIBUTION | {"max_depth": 3}), of_mixed(3)).ratio > 1


# ---- Emitters that are hidden, and alpha

OWN_BSDFS = {
    "black": {"type": "diffuse", "reflectance": 0.0},
    "diffuse": GREY,
    "mask": {"type": "mask", "opacity": 0.4, "nested": GREY},
    "glass": {"type": "dielectric"},
    "twosided": {"type": "twosided", "nested": GREY},
}


def in_view(bsdf, angle=-20):
    to_world = transform().translate([0.2, 1, 1.2]).rotate([0, 1, 0], angle).scale(0.4)
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf, "emitter": LAMP}


@pytest.mark.parametrize("bsdf", OWN_BSDFS)
def test_emitters_of_their_own_bsdf_from_both_sides(bsdf):
    for angle in (-20, 160):
        scene = stage(ball=ball(), lamp=in_view(OWN_BSDFS[bsdf], angle), sky=SKY)
        assert_same(renders(scene, DISTRIBUTION), renders(scene, reference(scene, max_depth=4)))


@pytest.mark.parametrize("bsdf", ["black", "mask"])
def test_hidden_emitters_are_those_of_volpath(bsdf):
    """`path` shades what it finds behind a hidden emitter at a wrong point."""
    scene = stage(camera(pixel_format="rgba"), ball=ball(), lamp=in_view(OWN_BSDFS[bsdf]), sky=SKY)
    hide = {"hide_emitters": True, "max_depth": 4}
    expected = renders(scene, {"type": "volpath"} | hide)[..., :3]
    for integrator in (DISTRIBUTION | hide, nested(DISTRIBUTION | hide)):
        assert_same(renders(scene, integrator), expected)
    alpha = renders(scene, DISTRIBUTION | hide)[..., 3:]
    assert_same(alpha, renders(scene, {"type": "path"} | hide)[..., 3:])
    assert (alpha == 0).any()
    assert Difference.of(renders(scene, DISTRIBUTION), expected).ratio > 1


# ---- Variants


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_variants(variant):
    mi.set_variant(variant)
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.2}
    glass = {"type": "dielectric", "specular_transmittance": {"type": "rgb", "value": [0.7, 0.4, 0.2]}}
    things = {"gold": ball(gold), "glass": ball(glass) | {"center": [-1, 0.5, 0.3], "radius": 0.4}}
    for light in ({"panel": panel(LAMP["radiance"])}, many(7) | {"sky": SKY}):
        scene = stage(**things, **light)
        expected = renders(scene, reference(scene, max_depth=4), spp=256)
        assert_same(renders(scene, DISTRIBUTION, spp=256), expected, 0.04)
        assert_same(renders(scene, nested(DISTRIBUTION), spp=256), expected, 0.04)


# ---- Ways to call it


def picture(scene, integrator=DISTRIBUTION, **options):
    return mi.render(scene, integrator=mi.load_dict(integrator), **options).numpy()


@pytest.mark.parametrize("integrator", [DISTRIBUTION, nested(DISTRIBUTION)], ids=["alone", "nested"])
def test_the_same_seed_gives_the_same_bits_and_another_does_not(integrator):
    scene = mixed()
    first, again, other = (picture(scene, integrator, spp=4, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5


@pytest.mark.parametrize("rfilter", ["box", "gaussian"])
def test_a_crop_is_the_same_bits_as_in_the_whole(rfilter):
    x, y, width, height = crop = (3, 5, 9, 8)
    whole = picture(mixed(camera(rfilter)), spp=8)
    part = picture(mixed(camera(rfilter, crop=crop)), spp=8)
    np.testing.assert_array_equal(part, whole[y : y + height, x : x + width])


def test_in_aov_the_picture_is_that_of_its_own_render():
    outer = {"type": "aov", "aovs": "depth:depth", "inner": DISTRIBUTION}
    np.testing.assert_array_equal(
        picture(mixed(), outer, spp=8, seed=1)[..., :3], picture(mixed(), spp=8, seed=1)
    )


def down_at(**things):
    """A scene in which all eye rays meet a large floor, with the floor's BSDF; nothing else is in view."""
    to_world = transform().look_at([0, 2, 0.1], [0, 0, 0], [0, 0, 1])
    floor = {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(50)}
    return lambda bsdf: mi.load_dict(
        {
            "type": "scene",
            "sensor": camera() | {"to_world": to_world},
            "floor": floor | {"bsdf": bsdf},
            **things,
        },
        optimize=False,
    )


POINT = {"type": "point", "position": [0, 5, 0], "intensity": 4.0}
MIRROR = {"type": "conductor"}
HALF = {"type": "mask", "opacity": 0.5, "nested": GREY}
EYE = 16 * 16 * 8
COUNTS = [  # BSDF of the floor, light, properties, rays for each eye ray but those not named, which are none
    (GREY, POINT, {"max_depth": 1}, {}),
    (GREY, POINT, {"max_depth": 2}, {"shadow": 1}),
    (GREY, POINT, {"max_depth": -1}, {"shadow": 1, "interreflection": 1}),
    (GREY, POINT, {"max_depth": -1, "light_samples": 4}, {"shadow": 4, "interreflection": 1}),
    (GREY, POINT, {"max_depth": -1, "interreflection_samples": 3}, {"shadow": 1, "interreflection": 3}),
    (GREY, SKY, {"max_depth": -1}, {"shadow": 1, "interreflection": 1}),
    (MIRROR, SKY, {"max_depth": -1}, {"reflection": 1}),
    (MIRROR, SKY, {"max_depth": 1}, {}),
    (HALF, POINT, {"max_depth": 2}, {"shadow": 1, "transmission": 1}),
    (
        {"type": "thindielectric"},
        SKY,
        {"max_depth": 2, "tree_depth": 1},
        {"reflection": 1, "transmission": 1},
    ),
]


@pytest.mark.parametrize(("bsdf", "light", "properties", "rays"), COUNTS)
def test_rays_are_counted(bsdf, light, properties, rays):
    done = whitted.render(down_at(light=light)(bsdf), DISTRIBUTION | properties, spp=8)
    kinds = ("shadow", "reflection", "transmission", "interreflection")
    assert done.rays == {"eye": EYE} | {kind: EYE * rays.get(kind, 0) for kind in kinds}


def furnace(reflects, **things):
    """The inside of a ball that emits 1 and reflects 0.96, among things that do the same: the radiance is 25."""
    shell = {
        "type": "sphere",
        "flip_normals": True,
        "bsdf": reflects,
        "emitter": {"type": "area", "radiance": 1.0},
    }
    to_world = transform().look_at([0.1, -0.2, 0.3], [1, 0.2, 0], [0, 1, 0])
    sensor = camera() | {"to_world": to_world, "near_clip": 1e-3}
    return mi.load_dict({"type": "scene", "sensor": sensor, "shell": shell, **things}, optimize=False)


MIRROR_96 = {"type": "conductor", "specular_reflectance": 0.96}
FURNACES = {
    "mirror": lambda: furnace(MIRROR_96),
    "diffuse": lambda: furnace(
        {"type": "diffuse", "reflectance": 0.96},
        ball={"type": "sphere", "center": [-0.5, 0, 0], "radius": 0.2, "bsdf": MIRROR_96}
        | {"emitter": {"type": "area", "radiance": 1.0}},
    ),
}


@pytest.mark.parametrize("name", FURNACES)
def test_paths_of_a_hundred_vertices_have_numbers_of_their_own(name):
    done = whitted.render(FURNACES[name](), DISTRIBUTION | {"max_depth": 2000}, spp=64)
    assert done.mean.mean() == pytest.approx(25, rel=0.02)
    assert done.rays["reflection"] + done.rays["interreflection"] > 20 * done.rays["eye"]
    assert done.mean.max() < 100


WRONG = [
    {"max_depth": -2},
    {"max_depth": 2.5},
    {"rr_depth": 0},
    {"tree_depth": 65},
    {"light_samples": 0},
    {"gloss_samples": 65},
    {"interreflection_samples": "many"},
    {"effects": "glos"},
]


@pytest.mark.parametrize("wrong", WRONG, ids=str)
def test_parameters_out_of_range_are_refused_in_one_line(wrong):
    (name,) = wrong
    with pytest.raises(RuntimeError, match=f"UsageError: {name}.*accepted are.*"):
        mi.load_dict({"type": "distribution"} | wrong)


def test_unknown_properties_are_refused():
    with pytest.raises(RuntimeError, match="max_dept"):
        mi.load_dict({"type": "distribution", "max_dept": 3})


def test_gradients_are_refused_and_do_no_harm_in_the_primal():
    scene = mixed()
    expected = picture(scene, spp=2)
    parameters = mi.traverse(scene)
    key = "floor.bsdf.reflectance.value"
    dr.enable_grad(parameters[key])
    parameters.update()
    image = mi.render(scene, parameters, integrator=mi.load_dict(DISTRIBUTION), spp=2)
    np.testing.assert_array_equal(image.numpy(), expected)
    with pytest.raises(RuntimeError) as caught:
        dr.backward(dr.mean(image, axis=None))
    error = caught.value
    while error.__cause__:
        error = error.__cause__
    assert "distribution has no gradients" in str(error)
