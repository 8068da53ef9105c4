"""Every shape, sensor, film and filter of Mitsuba under `whitted`: the picture of `path` at `max_depth` 2.

A table that lacks one fails. Each comparison has false alarms at 1e-5, see `pictures`.
"""

import struct
import zlib

import mitsuba as mi
import numpy as np
import pytest
from pictures import same_light
from plugins import of_kind
from whitted_scenes import EMITTERS, GREY, PATH, ROUGH, WHITTED, ball, camera, films, stage, transform

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
