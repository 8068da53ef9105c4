"""`distribution` and Mitsuba's integrators make the same picture with each plugin of Mitsuba's.

Each scene is rendered by itself, with all effects and with those found, and nested. One comparison has false alarms at
1e-5, see `pictures`; there are about 150. Each sees a bias of 2 % of the picture's mean, most of them one of 0.5 %.
"""

from itertools import chain

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import (
    DETECTABLE,
    DISTRIBUTION,
    Difference,
    assert_agrees,
    balls,
    gallery,
    panel,
    place,
    reference,
    renders,
)
from plugins import of_kind
from test_lobes import (
    NESTED,
    NOT_LOADED,
    PLUGINS,
    bent_normal,
    blend,
    bumps,
    conductor,
    diffuse,
    made,
    mask,
    plastic,
    twosided,
)
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
        return gallery(balls(bsdfs, BEHIND), panel=panel(), sky=EMITTERS["envmap"]())

    truth = scene(chosen_point_by_point)
    integrator = DISTRIBUTION | {"max_depth": -1}
    found, _ = assert_agrees(scene(lambda spec: spec), integrator, spp=32, truth=truth)
    shorter = renders(truth, reference(truth, max_depth=3), spp=32)
    assert Difference.of(found, shorter).ratio > 1, "paths that end too early are told"


def test_no_bsdf_is_left_out():
    assert of_kind("BSDF") == PLUGINS.keys() | NOT_LOADED.keys()
    assert sorted(chain(*GALLERIES.values())) == sorted(PLUGINS | NESTED | MORE)


# ---- Emitters


@pytest.mark.parametrize("name", [name for name in EMITTERS if name != "directionalarea"])
def test_emitters(name):
    assert_agrees(stage(ball=ball(), light=EMITTERS[name]()), spp=1024 if "area" in name else 512)


def test_an_emitter_that_neither_rays_nor_samples_find():
    scene = stage(ball=ball(), light=EMITTERS["directionalarea"]())
    found, expected = assert_agrees(scene, detectable=np.inf)
    assert not found.any()
    assert not expected.any()


def test_no_emitter_is_left_out():
    assert of_kind("Emitter") == {name.split(",")[0] for name in EMITTERS} | NO_EMITTERS.keys()


# ---- Textures


def coloured_cube(number):
    """A cube whose corners have colours of their own."""
    reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
    bsdf = {"type": "diffuse", "reflectance": reflectance}
    cube = mi.load_dict({"type": "cube", "to_world": place(number, 0.3).rotate([1, 1, 0], 30), "bsdf": bsdf})
    colours = np.random.default_rng(7).random(3 * cube.vertex_count(), np.float32)
    cube.add_attribute("vertex_color", 3, colours)
    return cube


def dim():
    return mi.Bitmap(np.random.default_rng(9).random((4, 8, 3), np.float32))


def texture(kind, **properties):
    return {"type": kind} | properties


def volume():
    grid = np.random.default_rng(8).random((4, 4, 4, 3), np.float32)
    return texture("volume", volume={"type": "gridvolume", "grid": mi.VolumeGrid(grid), "raw": True})


TEXTURES = {
    "llvm_ad_rgb": {
        "bitmap": lambda: texture("bitmap", bitmap=dim(), raw=True, to_uv=transform().scale([3, 2, 1])),
        "checkerboard": lambda: texture("checkerboard", to_uv=transform().scale([8, 8, 1])),
        "rawconstant": lambda: texture("rawconstant", value=[0.2, 0.5, 0.8]),
        "srgb": lambda: texture("srgb", color=[0.2, 0.5, 0.8]),
        "uniform": lambda: texture("uniform", value=0.4),
        "volume": volume,
    },
    "llvm_ad_spectral": {
        "bitmap": lambda: texture("bitmap", bitmap=dim()),
        "irregular": lambda: texture("irregular", wavelengths="400 500 700", values="0.2 0.6 0.4"),
        "regular": lambda: texture("regular", wavelength_min=400, wavelength_max=700, values="0.2 0.6 0.4"),
        "srgb": lambda: texture("srgb", color=[0.2, 0.5, 0.8]),
    },
}
LIGHTS = {
    "llvm_ad_rgb": {"panel": lambda: panel()},
    "llvm_ad_spectral": {
        "panel": lambda: panel({"type": "blackbody", "temperature": 4000.0}),
        "point": lambda: EMITTERS["point"]() | {"intensity": {"type": "d65", "scale": 100.0}},
    },
}


@pytest.mark.parametrize("variant", TEXTURES)
def test_textures(variant):
    mi.set_variant(variant)
    bsdfs = {name: {"type": "diffuse", "reflectance": make()} for name, make in TEXTURES[variant].items()}
    shapes = balls(bsdfs)
    if variant == "llvm_ad_rgb":
        shapes["cube"] = coloured_cube(7)
    lights = {name: make() for name, make in LIGHTS[variant].items()}
    is_spectral = mi.is_spectral  # wavelengths are one more source of noise
    assert_agrees(gallery(shapes, **lights), spp=256, detectable=0.04 if is_spectral else DETECTABLE)


def test_no_texture_is_left_out():
    named = chain(*TEXTURES.values())
    assert of_kind("Texture") == set(named) | {"mesh_attribute", "blackbody", "d65"}


# ---- Shapes

CURVES = {"bsplinecurve", "linearcurve"}  # as lights Mitsuba's own integrators fail on them
COLLECTIONS = {
    "round": ["cylinder", "disk", "sphere", "sdfgrid", "bsplinecurve", "linearcurve", "ellipsoids"],
    "of faces": ["cube", "rectangle", "obj", "ply", "serialized", "merge", "ellipsoidsmesh"],
}


def shape_of(name, folder, to_world, **properties):
    """Return the dict of a shape of `SHAPES` with other properties; what has no place of its own is in the middle."""
    shape = SHAPES[name](folder)
    if name == "merge":
        more = properties | {"to_world": to_world}
        return shape | {part: shape[part] | more for part in ("a", "b")}
    if "to_world" in shape:
        shape["to_world"] = (
            to_world @ mi.ScalarTransform4f().translate(-0.5) if name == "sdfgrid" else to_world
        )
    return shape | properties


@pytest.mark.parametrize("name", COLLECTIONS)
def test_shapes(name, tmp_path):
    bsdf = {"type": "twosided", "nested": GREY | {"reflectance": 0.9}}
    turned = transform().rotate([0, 1, 0], 30).rotate([1, 0, 0], 20)
    shapes = {}
    for number, one in enumerate(COLLECTIONS[name]):
        straight = one == "sdfgrid"
        to_world = place(number) if straight else place(number) @ turned
        shapes[one] = shape_of(one, tmp_path, to_world, bsdf=bsdf)
    group = {"type": "shapegroup", "ball": {"type": "sphere", "bsdf": roughconductor}}
    shapes["group"] = group
    shapes["one"] = {
        "type": "instance",
        "to_world": place(8) @ turned.scale([1, 0.5, 0.8]),
        "group": {"type": "ref", "id": "group"},
    }
    scene = gallery(shapes, point=EMITTERS["point"](), panel=panel())
    assert_agrees(scene, spp=256)
    assert seen(scene) == len(COLLECTIONS[name]) + 2  # with the floor and the instance


def seen(scene):
    """Return how many shapes eye rays meet."""
    x, y = np.meshgrid(*[np.linspace(0.01, 0.99, 64, dtype=np.float32)] * 2)
    position = mi.Point2f(x.ravel(), y.ravel())
    ray, _ = scene.sensors()[0].sample_ray(0, 0.5, position, mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    return len({int(number) for number in dr.reinterpret_array(mi.UInt32, si.shape).numpy()} - {0})


@pytest.mark.parametrize("name", sorted(SHAPES.keys() - CURVES - {"merge"}))
def test_shapes_that_emit(name, tmp_path):
    emitter = {"type": "area", "radiance": 2.0}
    light = shape_of(name, tmp_path, upright(), emitter=emitter)
    if name in ("obj", "ply", "serialized"):
        light["flip_normals"] = True
    scene = stage(shape=light, ball=ball() | {"center": [1, 0.4, 0.8], "radius": 0.3})
    options = (
        {"type": "volpath"} if name == "sdfgrid" else {}
    )  # path's coherent eye rays meet another surface there
    assert_agrees(scene, spp=4096 if name in ("cylinder", "sdfgrid") else 512, **options)


def test_no_shape_is_left_out():
    named = chain(*COLLECTIONS.values())
    assert of_kind("Shape") == set(named) | NOT_LOADED_SHAPES.keys() | {"instance", "shapegroup"}


# ---- Sensors and filters


@pytest.mark.parametrize("name", SENSORS)
def test_sensors(name):
    things = {"ball": ball(), "area": panel(), "sky": EMITTERS["envmap"]()}
    spp = 64 if name in ("batch", "orthographic", "perspective", "thinlens") else 1 << 16
    if name == "irradiancemeter":
        meter = {"type": "irradiancemeter", "film": small_film(1, 1)}
        things["plate"] = {"type": "rectangle", "to_world": upright(), "sensor": meter}
        scene = mi.load_dict({"type": "scene", **things}, optimize=False)
    else:
        scene = stage(SENSORS[name](), **things)
    assert_agrees(scene, spp=spp)


def test_no_sensor_is_left_out():
    assert of_kind("Sensor") == SENSORS.keys()


@pytest.mark.parametrize("rfilter", films())
def test_filters(rfilter):
    assert_agrees(stage(camera(rfilter), ball=ball(), area=panel(), sky=EMITTERS["envmap"]()), spp=32)


def test_no_filter_is_left_out():
    assert of_kind("ReconstructionFilter") == set(films())
