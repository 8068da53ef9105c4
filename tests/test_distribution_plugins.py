"""`distribution` and Mitsuba's integrators make the same picture with each plugin of Mitsuba's.

Each scene is rendered with all effects, and in ``make test-long`` with those found and nested, too. One comparison has
false alarms at 1e-5, see `pictures`; there are about 120. Each sees a bias of 2 % of the picture's mean (4 % with
spectra), those of BSDFs one of 1 %.
"""

from itertools import chain

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from distribution_bsdfs import BEHIND, BSDFS, GROUPS, chosen_point_by_point, group
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
    ways,
)
from plugins import of_kind
from test_lobes import NOT_LOADED, PLUGINS
from test_whitted_shapes import NOT_LOADED as NOT_LOADED_SHAPES
from test_whitted_shapes import SENSORS, SHAPES, small_film, upright
from whitted_scenes import EMITTERS, GREY, NO_EMITTERS, ROUGH, ball, camera, films, stage, transform

# ---- BSDFs


@ways("all", "found", "nested")
@pytest.mark.parametrize("name", GROUPS)
def test_bsdfs(name, way):
    lights = {"panel": panel(), "sky": EMITTERS["envmap"]()}
    truth = gallery(balls(group(name, chosen_point_by_point), BEHIND), **lights)
    scene = gallery(balls(group(name), BEHIND), **lights)
    integrator = DISTRIBUTION | {"max_depth": -1}
    found, _ = assert_agrees(scene, integrator, spp=32, truth=truth, way=way)
    if way == "all":
        shorter = renders(truth, reference(truth, max_depth=3), spp=32)
        assert Difference.of(found, shorter).ratio > 1, "paths that end too early are told"


def test_no_bsdf_is_left_out():
    assert of_kind("BSDF") == PLUGINS.keys() | NOT_LOADED.keys()
    assert sorted(chain(*GROUPS.values())) == sorted(BSDFS)


# ---- Emitters


@ways("all", "found", "nested")
@pytest.mark.parametrize("name", [name for name in EMITTERS if name != "directionalarea"])
def test_emitters(name, way):
    assert_agrees(stage(ball=ball(), light=EMITTERS[name]()), spp=1024 if "area" in name else 512, way=way)


def test_an_emitter_that_neither_rays_nor_samples_find():
    scene = stage(ball=ball(), light=EMITTERS["directionalarea"]())
    found, expected = assert_agrees(scene, detectable=np.inf)
    assert not found.any()
    assert not expected.any()


SKIES = [name for name in EMITTERS if name.startswith(("constant", "envmap", "sunsky"))]


@ways("all", "found", "nested")
@pytest.mark.parametrize("name", [None, *(name for name in EMITTERS if "area" not in name)])
def test_emitters_without_a_surface(name, way):
    lights = {"light": EMITTERS[name]()} if name else {}
    scene = mi.load_dict({"type": "scene", "camera": camera(size=8)} | lights)
    found, _ = assert_agrees(scene, spp=256, detectable=DETECTABLE if name in SKIES else np.inf, way=way)
    assert found.any() == (name in SKIES)


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


@ways("all", "found", "nested")
@pytest.mark.parametrize("variant", TEXTURES)
def test_textures(variant, way):
    mi.set_variant(variant)
    bsdfs = {name: {"type": "diffuse", "reflectance": make()} for name, make in TEXTURES[variant].items()}
    shapes = balls(bsdfs)
    if variant == "llvm_ad_rgb":
        shapes["cube"] = coloured_cube(7)
    lights = {name: make() for name, make in LIGHTS[variant].items()}
    is_spectral = mi.is_spectral  # wavelengths are one more source of noise
    assert_agrees(gallery(shapes, **lights), spp=256, detectable=0.04 if is_spectral else DETECTABLE, way=way)


def test_no_texture_is_left_out():
    named = chain(*TEXTURES.values())
    assert of_kind("Texture") == set(named) | {"mesh_attribute", "blackbody", "d65"}


# ---- Shapes

NO_LIGHTS = {
    "bsplinecurve": "Mitsuba's own integrators fail: no density on curves",
    "linearcurve": "Mitsuba's own integrators fail: no density on curves",
    "merge": "its parts emit",
    "sdfgrid": "path and volpath differ by a tenth in what is seen of it directly",
}
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
        shape["to_world"] = to_world
    return shape | properties


@ways("all", "found", "nested")
@pytest.mark.parametrize("name", COLLECTIONS)
def test_shapes(name, way, tmp_path):
    bsdf = {"type": "twosided", "nested": GREY | {"reflectance": 0.9}}
    turned = transform().rotate([0, 1, 0], 30).rotate([1, 0, 0], 20)
    shapes = {}
    for number, one in enumerate(COLLECTIONS[name]):
        # Mitsuba doesn't turn an sdfgrid, and its corner is at the origin
        own = transform().translate(-0.5).scale(1) if one == "sdfgrid" else turned
        shapes[one] = shape_of(one, tmp_path, place(number) @ own, bsdf=bsdf)
    shapes["group"] = {"type": "shapegroup", "ball": {"type": "sphere", "bsdf": ROUGH}}
    to_world = place(8) @ turned.scale([1, 0.5, 0.8])
    shapes["one"] = {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": "group"}}
    scene = gallery(shapes, point=EMITTERS["point"](), panel=panel())
    assert_agrees(scene, spp=256, way=way)
    assert seen(scene) == len(COLLECTIONS[name]) + 2  # with the floor and the instance


def seen(scene):
    """Return how many shapes eye rays meet."""
    x, y = np.meshgrid(*[np.linspace(0.01, 0.99, 64, dtype=np.float32)] * 2)
    position = mi.Point2f(x.ravel(), y.ravel())
    ray, _ = scene.sensors()[0].sample_ray(0, 0.5, position, mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    return len({int(number) for number in dr.reinterpret_array(mi.UInt32, si.shape).numpy()} - {0})


@ways("all", "nested")
@pytest.mark.parametrize("name", sorted(SHAPES.keys() - NO_LIGHTS.keys()))
def test_shapes_that_emit(name, way, tmp_path):
    emitter = {"type": "area", "radiance": 2.0}
    light = shape_of(name, tmp_path, upright(), emitter=emitter)
    if name in ("obj", "ply", "serialized"):
        light["flip_normals"] = True
    scene = stage(shape=light, ball=ball() | {"center": [1, 0.4, 0.8], "radius": 0.3})
    assert_agrees(scene, spp=2048 if name == "cylinder" else 512, way=way)


def test_no_shape_is_left_out():
    named = chain(*COLLECTIONS.values())
    assert of_kind("Shape") == set(named) | NOT_LOADED_SHAPES.keys() | {"instance", "shapegroup"}


# ---- Sensors and filters


@ways("all", "found", "nested")
@pytest.mark.parametrize("name", SENSORS)
def test_sensors(name, way):
    has_pixels = name in ("batch", "orthographic", "perspective", "thinlens")
    lights = {"area": panel(), "sky": EMITTERS["envmap"]()} if has_pixels else {"sky": EMITTERS["constant"]()}
    things = {"ball": ball(), **lights}
    if name == "irradiancemeter":
        meter = {"type": "irradiancemeter", "film": small_film(1, 1)}
        things["plate"] = {"type": "rectangle", "to_world": upright(), "sensor": meter}
        scene = mi.load_dict({"type": "scene", **things}, optimize=False)
    else:
        scene = stage(SENSORS[name](), **things)
    assert_agrees(scene, spp=64 if has_pixels else 1 << 16, way=way)


def test_no_sensor_is_left_out():
    assert of_kind("Sensor") == SENSORS.keys()


@ways("all", "nested")
@pytest.mark.parametrize("rfilter", films())
def test_filters(rfilter, way):
    assert_agrees(stage(camera(rfilter), ball=ball(), area=panel(), sky=EMITTERS["envmap"]()), way=way)


def test_no_filter_is_left_out():
    assert of_kind("ReconstructionFilter") == set(films())
