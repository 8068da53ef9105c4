"""`whitted` and Mitsuba's `path` estimate the same light where they own the same paths: at `max_depth` 2.

Both then have emitted light and direct light at the first surface. Every emitter, shape, sensor and film of Mitsuba
is met; a table that lacks one fails. Each comparison has false alarms at 1e-5, see `pictures`.
"""

import struct
import zlib

import mitsuba as mi
import numpy as np
import pytest
from pictures import differ, same_light
from plugins import of_kind
from whitted_scenes import camera, films, transform

PATH = {"type": "path", "max_depth": 2}
VOLPATH = {"type": "volpath", "max_depth": 2}
WHITTED = {"type": "whitted", "max_depth": 2}
ROUGH = {"type": "roughconductor", "alpha": 0.3}
GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.4, 0.3]}}


def stage(sensor=None, floor=GREY, **things):
    """A floor under other things."""
    ground = {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(2.5), "bsdf": floor}
    return mi.load_dict(
        {"type": "scene", "sensor": sensor or camera(), "floor": ground, **things}, optimize=False
    )


def ball(bsdf=ROUGH):
    return {"type": "sphere", "center": [0, 0.6, 0], "radius": 0.5, "bsdf": bsdf}


def bitmap(width=8, height=4):
    rows = np.random.default_rng(2).uniform(0.2, 2, (height, width, 3)).astype(np.float32)
    return mi.Bitmap(rows)


def panel(radiance):
    to_world = transform().translate([0.5, 2, 1]).rotate([1, 0, 0], 90).scale(0.6)
    return {"type": "rectangle", "to_world": to_world, "emitter": {"type": "area", "radiance": radiance}}


def from_above(at=(0.5, 3, 1.5)):
    return transform().look_at(list(at), [0, 0, 0], [0, 1, 0])


def window():
    """An emitting square with one direction."""
    emitter = {"type": "directionalarea", "radiance": 5.0}
    to_world = transform().translate([0, 2, 0]).rotate([1, 0, 0], 90)
    return {"type": "rectangle", "to_world": to_world, "emitter": emitter}


EMITTERS = {
    "area": lambda: panel({"type": "rgb", "value": [5, 4, 3]}),
    "area, textured": lambda: panel(
        {"type": "bitmap", "bitmap": bitmap(), "raw": True, "filter_type": "nearest"}
    ),
    "constant": lambda: {"type": "constant", "radiance": 0.8},
    "directional": lambda: {"type": "directional", "direction": [0.3, -1, -0.5], "irradiance": 1.5},
    "directionalarea": window,
    "envmap": lambda: {"type": "envmap", "bitmap": bitmap()},
    "point": lambda: {"type": "point", "position": [1, 2, 1.5], "intensity": 4.0},
    "projector": lambda: {
        "type": "projector",
        "to_world": from_above(),
        "fov": 50,
        "irradiance": {"type": "bitmap", "bitmap": bitmap(), "raw": True},
    },
    "spot": lambda: {"type": "spot", "to_world": from_above(), "intensity": 9.0, "cutoff_angle": 30},
    "sunsky": lambda: {"type": "sunsky", "to_world": transform().rotate([1, 0, 0], -90), "sun_scale": 0.0},
    "sunsky, with sun": lambda: {"type": "sunsky", "to_world": transform().rotate([1, 0, 0], -90)},
}
NO_EMITTERS = {"timed_sunsky": "Mitsuba's own integrators fail on it in the llvm variants"}


@pytest.mark.parametrize("name", EMITTERS)
def test_emitters(name):
    image = same_light(stage(ball=ball(), light=EMITTERS[name]()), WHITTED, PATH)
    assert (image.max() > 0) == (name != "directionalarea")  # that one can't be sampled, nor seen but head-on


def test_no_emitter_is_left_out():
    assert of_kind("Emitter") == {name.split(",")[0] for name in EMITTERS} | NO_EMITTERS.keys()


def test_all_emitters_together():
    names = ("area", "constant", "directional", "point", "spot", "projector")
    lights = {name: EMITTERS[name]() for name in names}
    same_light(stage(ball=ball(), **lights), WHITTED, PATH)


# ---- Shapes


def upright():
    return transform().translate([0, 0.6, 0]).rotate([0, 1, 0], 30).rotate([1, 0, 0], 20).scale(0.5)


def written_mesh(folder):
    """Write the faces of an octahedron as PLY, OBJ and Mitsuba's serialized format; return the path's stem."""
    corners = np.float32([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = np.uint32(
        [[x, y, z] if (x + y + z) % 2 else [y, x, z] for x in (0, 1) for y in (2, 3) for z in (4, 5)]
    )
    mesh = mi.Mesh("octahedron", len(corners), len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"], parameters["faces"] = corners.ravel(), faces.ravel()
    parameters.update()
    mesh.write_ply(str(folder / "mesh.ply"))
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    body = struct.pack("<I", 0x1000) + b"octahedron\0" + struct.pack("<QQ", len(corners), len(faces))
    packed = struct.pack("<HH", 0x041C, 4) + zlib.compress(body + corners.tobytes() + faces.tobytes())
    (folder / "mesh.serialized").write_bytes(packed + struct.pack("<QI", 0, 1))
    return folder / "mesh"


def written_curve(folder):
    points = [
        (-1, -0.5, 0, 0.2),
        (-0.4, 0.8, 0.2, 0.3),
        (0.4, -0.6, 0, 0.25),
        (1, 0.6, 0.1, 0.2),
        (1.2, 1, 0, 0.1),
    ]
    path = folder / "curve.txt"
    path.write_text("\n".join(" ".join(map(str, point)) for point in points) + "\n")
    return str(path)


def of_file(kind):
    return lambda folder: {
        "type": kind,
        "filename": f"{written_mesh(folder)}.{kind}",
        "face_normals": True,
        "to_world": upright(),
    }


def of_curve(kind):
    return lambda folder: {"type": kind, "filename": written_curve(folder), "to_world": upright()}


def of_ellipsoids(kind):
    def make(folder):
        values = {
            "centers": [[-0.4, 0.6, 0], [0.4, 0.7, 0.2]],
            "scales": [[0.3, 0.2, 0.1], [0.1, 0.2, 0.2]],
            "quaternions": [[0.2, 0.1, 0.3, 0.9], [0, 0, 0, 1]],
        }
        return {"type": kind, **{name: mi.TensorXf(np.float32(value)) for name, value in values.items()}}

    return make


def blob(folder):
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 9)] * 3, indexing="ij")
    distance = np.float32(np.sqrt(x * x + y * y + z * z) - 0.7)[..., None] / 2
    to_world = upright() @ transform().translate(-0.5)
    return {"type": "sdfgrid", "grid": mi.TensorXf(distance), "to_world": to_world}


NOT_LOADED = {"blender": "takes pointers into Blender's memory"}
SHAPES = {
    "bsplinecurve": of_curve("bsplinecurve"),
    "cube": lambda folder: {"type": "cube", "to_world": upright()},
    "cylinder": lambda folder: {"type": "cylinder", "to_world": upright()},
    "disk": lambda folder: {"type": "disk", "to_world": upright()},
    "ellipsoids": of_ellipsoids("ellipsoids"),
    "ellipsoidsmesh": of_ellipsoids("ellipsoidsmesh"),
    "linearcurve": of_curve("linearcurve"),
    "merge": lambda folder: {"type": "merge", "a": of_file("ply")(folder), "b": of_file("obj")(folder)},
    "obj": of_file("obj"),
    "ply": of_file("ply"),
    "rectangle": lambda folder: {"type": "rectangle", "to_world": upright()},
    "sdfgrid": blob,
    "serialized": of_file("serialized"),
    "sphere": lambda folder: {"type": "sphere", "to_world": upright()},
}


def lit(things):
    lights = {name: EMITTERS[name]() for name in ("point", "area")}
    return stage(**things, **lights)


@pytest.mark.parametrize("name", SHAPES)
def test_shapes(name, tmp_path):
    bsdf = {"type": "twosided", "nested": GREY | {"reflectance": 0.9}}
    shape = SHAPES[name](tmp_path) | {"bsdf": bsdf}
    if name == "merge":
        shape = SHAPES[name](tmp_path)
        for part in ("a", "b"):
            shape[part]["bsdf"] = bsdf
    image = same_light(lit({"shape": shape}), WHITTED, PATH)
    assert abs(image - same_light(lit({}), WHITTED, PATH)).max() > 0.02, "the shape is in view"


def test_instances():
    group = {"type": "shapegroup", "ball": {"type": "sphere", "radius": 0.5, "bsdf": ROUGH}}
    stretched = transform().translate([0, 0.6, 0]).rotate([0, 0, 1], 30).scale([0.5, 1.2, 1])
    things = {
        "group": group,
        "one": {"type": "instance", "to_world": stretched, "group": {"type": "ref", "id": "group"}},
    }
    same_light(lit(things), WHITTED, PATH)


def test_no_shape_is_left_out():
    assert of_kind("Shape") == SHAPES.keys() | NOT_LOADED.keys() | {"instance", "shapegroup"}


def test_shapes_that_emit():
    emitter = {"type": "area", "radiance": 2.0}
    for name in ("sphere", "cylinder", "disk", "cube"):
        shape = SHAPES[name](None) | {"emitter": emitter}
        same_light(stage(shape=shape), WHITTED, PATH)


# ---- Sensors, films and filters


def small_film(width=16, height=16):
    return {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
    }


def eye():
    return {"to_world": transform().look_at([0.3, 1.8, 4.5], [0, 0.6, 0], [0, 1, 0]), "film": small_film()}


def looking(kind, **properties):
    return lambda: {"type": kind, **eye(), **properties}


SENSORS = {
    "batch": lambda: {
        "type": "batch",
        "film": small_film(32),
        "left": {"type": "perspective", **eye()},
        "right": {"type": "perspective", **eye(), "fov": 20},
    },
    "distant": lambda: {
        "type": "distant",
        "direction": [0.2, -1, -0.3],
        "target": {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(2.5)},
        "film": small_film(1, 1),
    },
    "irradiancemeter": lambda: None,
    "orthographic": lambda: {
        "type": "orthographic",
        "to_world": eye()["to_world"] @ transform().scale(2),
        "film": small_film(),
    },
    "perspective": looking("perspective", fov=40, near_clip=4.2, principal_point_offset_x=0.2),
    "radiancemeter": lambda: {
        "type": "radiancemeter",
        "origin": [0.3, 1.8, 4.5],
        "direction": [-0.1, -0.45, -1],
        "film": small_film(1, 1),
    },
    "thinlens": looking(
        "thinlens", aperture_radius=0.2, focus_distance=4, fov=40, shutter_open=0, shutter_close=1
    ),
}


@pytest.mark.parametrize("name", SENSORS)
def test_sensors(name):
    things = {"ball": ball(), "area": EMITTERS["area"](), "sky": EMITTERS["envmap"]()}
    if name == "irradiancemeter":
        meter = {"type": "irradiancemeter", "film": small_film(1, 1)}
        things["plate"] = {"type": "rectangle", "to_world": upright(), "sensor": meter}
        scene = mi.load_dict({"type": "scene", **things}, optimize=False)
    else:
        scene = stage(SENSORS[name](), **things)
    assert len(scene.sensors()) == 1
    assert same_light(scene, WHITTED, PATH).any()


def test_no_sensor_is_left_out():
    assert of_kind("Sensor") == SENSORS.keys()


@pytest.mark.parametrize("rfilter", films())
def test_filters(rfilter):
    things = {"ball": ball(), "area": EMITTERS["area"](), "sky": EMITTERS["envmap"]()}
    same_light(stage(camera(rfilter), **things), WHITTED, PATH)


def test_no_filter_is_left_out():
    assert of_kind("ReconstructionFilter") == set(films())


@pytest.mark.parametrize("border", [False, True])
@pytest.mark.parametrize("crop", [None, (4, 4, 9, 8)])
def test_the_films_edges(border, crop):
    sensor = camera("gaussian", crop=crop, sample_border=border)
    same_light(stage(sensor, ball=ball(), sky=EMITTERS["envmap"]()), WHITTED, PATH)


@pytest.mark.parametrize("pixel_format", ["luminance", "luminance_alpha", "rgb", "rgba", "xyz", "xyza"])
def test_pixel_formats(pixel_format):
    sensor = camera(pixel_format=pixel_format)
    image = same_light(stage(sensor, ball=ball(), point=EMITTERS["point"]()), WHITTED, PATH)
    assert image.shape[-1] == {"l": 1, "r": 3, "x": 3}[pixel_format[0]] + pixel_format.endswith("a")


# ---- Depths, emitters that are hidden, and alpha


@pytest.mark.parametrize("max_depth", [0, 1, 2])
def test_depths(max_depth):
    lights = {name: EMITTERS[name]() for name in ("area", "constant", "point")}
    scene = stage(camera(pixel_format="rgba"), ball=ball(), **lights)
    same_light(scene, WHITTED | {"max_depth": max_depth}, PATH | {"max_depth": max_depth})


@pytest.mark.parametrize("max_depth", [3, 6])
def test_specular_chains_that_see_emitted_light_only(max_depth):
    """Without a surface that scatters there is nothing that `path` could add."""
    panel_in_view = {
        "type": "sphere",
        "center": [1, 1.4, 0],
        "radius": 0.3,
        "emitter": {"type": "area", "radiance": 3.0},
    }
    black = {"type": "diffuse", "reflectance": 0.0}
    scene = stage(
        floor=black,
        ball=ball({"type": "dielectric"}),
        mirror=ball({"type": "conductor"}) | {"center": [-1.1, 0.6, 0.2]},
        panel=panel_in_view | {"bsdf": black},
        sky=EMITTERS["envmap"](),
    )
    options = {"max_depth": max_depth}
    same_light(scene, WHITTED | options | {"min_contribution": 0.0}, PATH | options, spp=256)


def test_depths_that_differ_are_told_apart():
    scene = stage(ball=ball({"type": "conductor"}), sky=EMITTERS["envmap"]())
    assert differ(scene, WHITTED | {"max_depth": 3}, PATH)


HIDE = {"hide_emitters": True}


@pytest.mark.parametrize("sky", ["constant", "envmap"])
def test_a_hidden_environment_is_that_of_path(sky):
    scene = stage(camera(pixel_format="rgba"), ball=ball(), sky=EMITTERS[sky]())
    image = same_light(scene, WHITTED | HIDE, PATH | HIDE)
    assert (image[..., 3] == 0).any()
    shown = same_light(scene, WHITTED, PATH)
    assert (shown[..., 3] == 1).all()


def test_hidden_area_emitters_are_those_of_volpath():
    """`path` shades what it finds behind a hidden emitter at a wrong point; what it finds there is right."""
    panel_in_view = {
        "type": "rectangle",
        "to_world": transform().translate([0.2, 1.2, 1.5]).scale(0.4),
        "emitter": {"type": "area", "radiance": 3.0},
    }
    scene = stage(camera(pixel_format="rgba"), ball=ball(), panel=panel_in_view, sky=EMITTERS["constant"]())
    image = same_light(scene, WHITTED | HIDE, VOLPATH | HIDE, channels=slice(0, 3))
    same_light(scene, WHITTED | HIDE, PATH | HIDE, channels=slice(3, 4))
    shown = same_light(scene, WHITTED, PATH)
    assert abs(shown[..., :3] - image).max() > 1


def of_rgba(**things):
    return stage(camera(pixel_format="rgba"), point=EMITTERS["point"](), **things)


@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "mask", "opacity": 0.4, "nested": GREY},
        {"type": "mask", "opacity": 0.4, "nested": {"type": "dielectric"}},
        {"type": "null"},
        {"type": "thindielectric"},
        {"type": "dielectric"},
    ],
    ids=lambda bsdf: bsdf["type"],
)
def test_alpha_is_that_of_path(bsdf):
    """What passes null surfaces only and meets nothing is empty. False alarms at 1e-5 over the 256 pixels."""
    scene = of_rgba(ball=ball(bsdf) | {"center": [0, 2.2, -1]})
    path = {"type": "path", "max_depth": 8, "rr_depth": 100}
    whitted = {"type": "whitted", "max_depth": 8, "min_contribution": 0.0}
    a = np.mean(
        [np.array(mi.render(scene, integrator=mi.load_dict(whitted), spp=64, seed=s)) for s in range(8)], 0
    )
    b = np.mean(
        [
            np.array(mi.render(scene, integrator=mi.load_dict(path), spp=64, seed=100003 * s))
            for s in range(8)
        ],
        0,
    )
    alpha, expected = a[..., 3].astype(np.float64), b[..., 3].astype(np.float64)
    assert 0 <= alpha.min() <= alpha.max() <= 1
    share = 5.5 * np.sqrt(0.25 / 512)  # the largest error of a share of 512 samples
    np.testing.assert_allclose(alpha, expected, atol=share)
    assert abs(alpha.mean() - expected.mean()) < share / np.sqrt(alpha.size)


# ---- Shadows through null, mask and thin surfaces


@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "mask", "opacity": 0.5, "nested": GREY},
        {"type": "mask", "opacity": {"type": "checkerboard", "color0": 0.2, "color1": 0.9}, "nested": GREY},
        {"type": "null"},
        {"type": "thindielectric"},
    ],
    ids=["mask", "textured", "null", "thin"],
)
@pytest.mark.parametrize("light", ["point", "area"])
def test_shadow_rays_pass_null_mask_and_thin_surfaces(bsdf, light):
    """`path` stops them there, so that `volpath` is the reference. The pane isn't in view."""
    to_world = transform().translate([0.6, 1.8, 1]).rotate([1, 0, 0], 90).scale(1.5)
    pane = {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}
    lights = {
        "point": {"type": "point", "position": [1, 3, 1.5], "intensity": 4.0},
        "area": panel(4.0)
        | {"to_world": transform().translate([0.5, 3, 1]).rotate([1, 0, 0], 90).scale(0.6)},
    }
    down = transform().look_at([0, 1.5, 1.3], [0, 0, 0], [0, 1, 0])
    sensor = camera() | {"to_world": down}
    scene = stage(sensor, pane=pane, ball=ball(GREY) | {"radius": 0.2}, light=lights[light])
    image = same_light(scene, WHITTED, VOLPATH)
    assert image.mean() > 0.01
    assert differ(scene, WHITTED, PATH)
