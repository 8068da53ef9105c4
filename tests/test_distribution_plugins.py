"""`distribution` and Mitsuba's integrators make the same picture with each plugin of Mitsuba's.

Each scene is rendered by itself, with all effects and with those found, and nested. One comparison has false alarms at
1e-5, see `pictures`; there are about 150. Each sees a bias of 2 % of the picture's mean, most of them one of 0.5 %.
"""

import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import DISTRIBUTION, agree, assert_same, gallery, panel, reference, renders, worst
from plugins import of_kind
from test_lobes import NESTED, NOT_LOADED, PLUGINS, bent_normal, blend, bumps, conductor, dielectric, diffuse
from test_lobes import made, mask, plastic, twosided
from test_whitted_shapes import NOT_LOADED as NOT_LOADED_SHAPES
from test_whitted_shapes import SENSORS, SHAPES, small_film, upright
from whitted_scenes import EMITTERS, GREY, NO_EMITTERS, ball, camera, films, stage, transform

# ---- BSDFs

roughdielectric = {"type": "roughdielectric", "alpha": 0.3}
roughconductor = {"type": "roughconductor", "alpha": 0.2}
roughplastic = {"type": "roughplastic", "alpha": 0.2}
MORE = {
    "blend(diffuse, roughconductor)": blend(diffuse, roughconductor),
    "blend(roughdielectric, plastic)": blend(roughdielectric, plastic),
    "blend(conductor, diffuse)": blend(conductor, diffuse),
    "bumpmap(plastic)": {"type": "bumpmap", "arbitrary": bumps, "nested": plastic},
    "bumpmap(roughconductor)": {"type": "bumpmap", "arbitrary": bumps, "nested": roughconductor},
    "mask(roughdielectric)": mask(roughdielectric),
    "mask(roughplastic)": mask(roughplastic, 0.7),
    "normalmap(roughdielectric)": {"type": "normalmap", "normalmap": bent_normal, "nested": roughdielectric},
    "twosided(roughplastic)": twosided(roughplastic),
    "twosided(roughplastic, diffuse)": twosided(roughplastic, diffuse),
}
BEHIND = {"twosided(conductor, plastic)", "twosided(roughplastic, diffuse)"}  # seen from the back
GALLERIES = {
    "specular": [
        "conductor",
        "dielectric",
        "bumpmap",
        "normalmap",
        "blendbsdf",
        "twosided(conductor)",
        "twosided(normalmap)",
        "bumpmap(conductor)",
        "normalmap(bumpmap)",
    ],
    "rough": [
        "diffuse",
        "roughconductor",
        "roughplastic",
        "pplastic",
        "normalmap(twosided(diffuse))",
        "blend(diffuse, roughconductor)",
        "bumpmap(roughconductor)",
        "twosided(roughplastic)",
        "twosided(roughplastic, diffuse)",
    ],
    "rough and transmitting": [
        "roughdielectric",
        "principled",
        "principledthin",
        "normalmap(roughdielectric)",
    ],
    "specular and smooth": [
        "plastic",
        "twosided",
        "twosided(conductor, plastic)",
        "twosided(diffuse, conductor)",
        "twosided(plastic, diffuse)",
        "twosided(bumpmap)",
        "bumpmap(plastic)",
        "blend(dielectric, plastic)",
        "blend(normalmap, bumpmap)",
    ],
    "straight through": [
        "null",
        "thindielectric",
        "circular",
        "polarizer",
        "retarder",
        "mask",
        "hair",
        "mask(twosided)",
        "mask(mask)",
    ],
    "masks": [
        "mask(dielectric)",
        "mask(thindielectric)",
        "mask(textured)",
        "mask(normalmap)",
        "mask(roughdielectric)",
        "mask(roughplastic)",
        "blend(null, dielectric)",
        "blend(blend(null, conductor), dielectric)",
    ],
    "blends": [
        "mask(blend)",
        "blend(mask, conductor)",
        "blend(blend, mask)",
        "blend(twosided, twosided)",
        "blend(conductor, diffuse)",
        "blend(roughdielectric, plastic)",
    ],
}


def chosen_point_by_point(spec, scale=331):
    """Return a BSDF's dict in which a ``blendbsdf`` is one child or the other in stripes finer than pixels.

    Of a blend of specular and smooth children Mitsuba weighs the samples wrongly where both have a share.
    """
    spec = spec() if callable(spec) else spec
    if not isinstance(spec, dict):
        return spec
    spec = {name: chosen_point_by_point(value, scale * 1.137) for name, value in spec.items()}
    if spec.get("type") == "blendbsdf" and isinstance(spec["weight"], float):
        assert spec["weight"] == 0.4
        stripes = mi.Bitmap(np.float32([0, 1, 0, 1, 0]).reshape(1, 5, 1))
        to_uv = transform().scale([scale, 1, 1])
        spec["weight"] = {
            "type": "bitmap",
            "bitmap": stripes,
            "raw": True,
            "filter_type": "nearest",
            "to_uv": to_uv,
        }
    return spec


@pytest.mark.parametrize("name", GALLERIES)
def test_bsdfs(name):
    def scene(prepare):
        bsdfs = {one: made(prepare((PLUGINS | NESTED | MORE)[one])) for one in GALLERIES[name]}
        return gallery(bsdfs, BEHIND, panel=panel(), sky=EMITTERS["envmap"]())

    truth = scene(chosen_point_by_point)
    found = agree(scene(lambda spec: spec), DISTRIBUTION | {"max_depth": -1}, truth=truth)
    assert worst(found, renders(truth, reference(truth, max_depth=3)))[0] > 1, "paths that end too early are told"


def test_no_bsdf_is_left_out():
    assert of_kind("BSDF") == PLUGINS.keys() | NOT_LOADED.keys()
    assert sorted(sum(GALLERIES.values(), [])) == sorted(PLUGINS | NESTED | MORE)


# ---- Emitters


@pytest.mark.parametrize("name", [name for name in EMITTERS if name != "directionalarea"])
def test_emitters(name):
    agree(stage(ball=ball(), light=EMITTERS[name]()), spp=512)


def test_an_emitter_that_neither_rays_nor_samples_find():
    found = agree(stage(ball=ball(), light=EMITTERS["directionalarea"]()), detectable=np.inf)
    assert not found.any()


def test_no_emitter_is_left_out():
    assert of_kind("Emitter") == {name.split(",")[0] for name in EMITTERS} | NO_EMITTERS.keys()


# ---- Shapes

NOT_LIGHTS = {
    "bsplinecurve": "Mitsuba fails: it has no density on curves",
    "linearcurve": "Mitsuba fails: it has no density on curves",
    "ellipsoids": "Mitsuba can't sample points on it; its path finds it by chance only",
    "sdfgrid": "Mitsuba can't sample points on it; path, volpath and direct disagree by 10 %",
    "merge": "the parts emit, not the whole",
}


def shape_of(name, folder, **properties):
    if name == "merge":
        shape = SHAPES[name](folder)
        return shape | {part: shape[part] | properties for part in ("a", "b")}
    return SHAPES[name](folder) | properties


@pytest.mark.parametrize("name", SHAPES)
def test_shapes(name, tmp_path):
    shape = shape_of(name, tmp_path, bsdf={"type": "twosided", "nested": GREY | {"reflectance": 0.9}})
    lights = {"point": EMITTERS["point"](), "area": panel()}
    found = agree(stage(shape=shape, **lights), spp=128)
    assert abs(found.mean(0) - renders(stage(**lights), reference(stage(**lights)), 16).mean(0)).max() > 0.02


def test_instances():
    group = {"type": "shapegroup", "ball": {"type": "sphere", "radius": 0.5, "bsdf": roughconductor}}
    stretched = transform().translate([0, 0.6, 0]).rotate([0, 0, 1], 30).scale([0.5, 1.2, 1])
    one = {"type": "instance", "to_world": stretched, "group": {"type": "ref", "id": "group"}}
    agree(stage(group=group, one=one, point=EMITTERS["point"](), area=panel()), spp=128)


@pytest.mark.parametrize("name", [name for name in SHAPES if name not in NOT_LIGHTS])
def test_shapes_that_emit(name, tmp_path):
    light = shape_of(name, tmp_path, emitter={"type": "area", "radiance": 2.0})
    agree(stage(shape=light, ball=ball() | {"center": [1, 0.4, 0.8], "radius": 0.3}), spp=512)


def test_no_shape_is_left_out():
    assert of_kind("Shape") == SHAPES.keys() | NOT_LOADED_SHAPES.keys() | {"instance", "shapegroup"}


# ---- Sensors and filters


@pytest.mark.parametrize("name", SENSORS)
def test_sensors(name):
    things = {"ball": ball(), "area": panel(), "sky": EMITTERS["envmap"]()}
    spp = 2048 if name in ("distant", "irradiancemeter", "radiancemeter") else 64
    if name == "irradiancemeter":
        meter = {"type": "irradiancemeter", "film": small_film(1, 1)}
        things["plate"] = {"type": "rectangle", "to_world": upright(), "sensor": meter}
        scene = mi.load_dict({"type": "scene", **things}, optimize=False)
    else:
        scene = stage(SENSORS[name](), **things)
    agree(scene, spp=spp)


def test_no_sensor_is_left_out():
    assert of_kind("Sensor") == SENSORS.keys()


@pytest.mark.parametrize("rfilter", films())
def test_filters(rfilter):
    agree(stage(camera(rfilter), ball=ball(), area=panel(), sky=EMITTERS["envmap"]()))


def test_no_filter_is_left_out():
    assert of_kind("ReconstructionFilter") == set(films())
