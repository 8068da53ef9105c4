"""The properties of `distribution` against Mitsuba's integrators: depths, numbers of samples, lights, ways to call it.

One comparison has false alarms at 1e-5, see `pictures`; there are about 100. Each sees a bias of 2 % of the picture.
"""

import functools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import (
    BLACK,
    DISTRIBUTION,
    Difference,
    assert_agrees,
    assert_same,
    nested,
    overhead,
    panel,
    reference,
    renders,
)
from whitted_scenes import EMITTERS, GREY, ROUGH, ball, bitmap, camera, stage, transform

import whitted

LAMP = {"type": "area", "radiance": {"type": "rgb", "value": [5, 4, 3]}}
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.4, 0.5]}}


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
    integrator = DISTRIBUTION | {"max_depth": -1} | dict.fromkeys(SPLITS, "auto")
    assert_same(renders(mixed(), integrator, spp=32), of_mixed(-1))


# ---- Emitters that are hidden, and alpha

OWN_BSDFS = {
    "black": BLACK,
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


# ---- Lights


def among(**lights):
    """A ball and a wall, close to lights."""
    wall = {"type": "rectangle", "to_world": transform().translate([0, 1, -1.2]).scale(2), "bsdf": GREY}
    return stage(ball=ball(GREY) | {"center": [-0.4, 0.5, 0]}, wall=wall, **lights)


def standing(kind, to_world=None, radiance=None, **properties):
    """A light to the right of the ball, turned so that it shines on the wall as well."""
    turned = transform().translate([0.7, 0.7, 0.6]).rotate([0, 1, 0], 210).rotate([1, 0, 0], 20).scale(0.3)
    emitter = LAMP | ({"radiance": radiance} if radiance else {})
    return {
        "type": kind,
        "to_world": turned if to_world is None else to_world,
        "emitter": emitter,
    } | properties


def textured(kind, **properties):
    picture = {"type": "bitmap", "bitmap": bitmap(), "raw": True, "filter_type": "nearest"}
    return standing(kind, radiance=picture, **properties)


def on_floor(kind):
    return standing(kind, transform().translate([0.9, 0.4, 0.6]).rotate([0, 1, 0], -60).scale(0.4))


def sheared():
    matrix = np.eye(4)
    matrix[0, 1], matrix[1, 2] = 0.4, 0.2
    return mi.ScalarTransform4f(matrix)


LIGHTS = {
    **{f"textured {kind}": functools.partial(textured, kind) for kind in ("rectangle", "disk", "sphere")},
    "flipped rectangle": lambda: standing("rectangle", flip_normals=True),
    "flipped disk": lambda: standing("disk", flip_normals=True),
    "flipped cylinder": lambda: standing("cylinder", flip_normals=True),
    "flipped textured disk": lambda: textured("disk", flip_normals=True),
    "mirrored rectangle": lambda: standing("rectangle", overhead() @ transform().scale([-1, 1, 1])),
    "sheared rectangle": lambda: standing("rectangle", overhead() @ sheared()),
    "mirrored disk": lambda: standing("disk", overhead() @ transform().scale([-1, 1, 1])),
    "ellipse": lambda: standing("disk", overhead() @ transform().scale([1, 0.4, 1])),
    "mirrored cube": lambda: standing("cube", overhead(0.4) @ transform().scale([-1, 1, 1])),
    "rectangle on the floor": lambda: on_floor("rectangle"),
    "disk on the floor": lambda: on_floor("disk"),
    "sphere on the floor": lambda: on_floor("sphere"),
    "cube on the floor": lambda: on_floor("cube"),
    "rectangle through the floor": lambda: (
        on_floor("rectangle")
        | {"to_world": transform().translate([0.9, 0.2, 0.6]).rotate([0, 1, 0], -60).scale(0.4)}
    ),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_lights(name):
    scene = among(light=LIGHTS[name]())
    spp = 2048 if "flipped" in name else 256  # which give little light, near the floor
    expected = renders(scene, reference(scene, max_depth=3), spp)
    assert_same(renders(scene, DISTRIBUTION | {"max_depth": 3}, spp), expected)


def test_a_textured_mesh_as_a_light(tmp_path):
    """Two triangles, each with its own part of the texture: of parts that overlap Mitsuba samples one only."""
    mesh = mi.Mesh("roof", 6, 2, has_vertex_texcoords=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.float32(
        [-1, -1, 0, 1, -1, 0, 0, 1, 0, 1, -1, 0, 1.5, 1, 1, 0, 1, 0]
    ).ravel()
    parameters["vertex_texcoords"] = np.float32([0, 0, 0.5, 0, 0, 1, 0.5, 0, 1, 0, 1, 1])
    parameters["faces"] = np.uint32([0, 1, 2, 3, 4, 5])
    parameters.update()
    mesh.write_ply(str(tmp_path / "roof.ply"))
    scene = among(light=textured("ply", filename=str(tmp_path / "roof.ply"), face_normals=True))
    expected = renders(scene, reference(scene, max_depth=3), spp=256)
    assert_same(renders(scene, DISTRIBUTION | {"max_depth": 3}, spp=256), expected)


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
    random = np.random.default_rng(5)
    kinds = ("rectangle", "point", "sphere", "spot", "disk", "cube", "cylinder")
    return {f"light{number}": small_light(kinds[number % 7], random) for number in range(count)}


@pytest.mark.parametrize("count", [1, 2, 5, 70])
def test_many_lights(count):
    assert_agrees(stage(ball=ball(), **many(count)), spp=256 if count in (1, 70) else 1024)


@pytest.mark.parametrize("sky", ["constant", "envmap"])
def test_lights_of_all_kinds_together(sky):
    lights = many(7) | {"sun": EMITTERS["directional"](), "sky": EMITTERS[sky]()}
    assert_agrees(stage(ball=ball(), **lights), spp=128)


def test_the_inside_of_a_lamp_lights_itself():
    """Within a diffuse sphere of reflectance r that emits 1 all has the radiance 1 + r + ..., almost without noise.

    A few in 10^4 of the rays along the wall meet it before they should.
    """
    bsdf = {"type": "diffuse", "reflectance": 0.5}
    lamp = {"type": "sphere", "radius": 2.0, "flip_normals": True, "bsdf": bsdf}
    lamp |= {"emitter": {"type": "area", "radiance": 1.0}}
    sensor = camera(size=8) | {"to_world": transform().look_at([0.3, 0.2, 0.1], [0, 0, -1], [0, 1, 0])}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, "lamp": lamp}, optimize=False)
    for max_depth, radiance in ((2, 1.5), (4, 1.875)):
        image = mi.render(
            scene, integrator=mi.load_dict(DISTRIBUTION | {"max_depth": max_depth}), spp=1024
        ).numpy()
        np.testing.assert_allclose(image, radiance, rtol=5e-3)
        np.testing.assert_allclose(image.mean(), radiance, rtol=3e-4)
    lamp["flip_normals"], lamp["bsdf"] = False, {"type": "twosided", "nested": bsdf}
    dark = mi.load_dict({"type": "scene", "sensor": sensor, "lamp": lamp}, optimize=False)
    assert not np.any(mi.render(dark, integrator=mi.load_dict(DISTRIBUTION), spp=16))


PANES = {
    "rough glass": {"type": "roughdielectric", "alpha": 0.3},
    "diffuse both ways": {"type": "principledthin", "spec_trans": 0.3, "diff_trans": 1.2},
    "half open": {"type": "mask", "opacity": 0.5, "nested": GREY},
    "thin glass": {"type": "thindielectric"},
}


@pytest.mark.parametrize("pane", PANES)
def test_panes_lit_from_behind(pane):
    window = {
        "type": "rectangle",
        "to_world": transform().translate([0, 1, 1]).scale(0.8),
        "bsdf": PANES[pane],
    }
    behind = transform().translate([0.3, 1, -1.5]).scale(0.6)
    lamps = {
        "area": {"type": "rectangle", "to_world": behind, "emitter": LAMP},
        "point": {"type": "point", "position": [-0.6, 1, -1.5], "intensity": 3.0},
    }
    assert_agrees(stage(window=window, **lamps), spp=1024)


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
    ({"type": "thindielectric"}, SKY, {"max_depth": 2}, {"reflection": 1, "transmission": 1}),
]


@pytest.mark.parametrize(("bsdf", "light", "properties", "rays"), COUNTS)
def test_rays_are_counted(bsdf, light, properties, rays):
    done = whitted.render(down_at(light=light)(bsdf), DISTRIBUTION | properties, spp=8)
    kinds = ("shadow", "reflection", "transmission", "interreflection")
    assert done.rays == {"eye": EYE} | {kind: EYE * rays.get(kind, 0) for kind in kinds}


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
