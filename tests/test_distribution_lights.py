"""`distribution` and Mitsuba make the same picture under lights of all shapes, many or few, near or far, from any side.

One comparison has false alarms at 1e-5, see `pictures`; there are about 50. Each sees a bias of 2 % of the picture.
"""

import functools

import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import (
    DISTRIBUTION,
    LAMP,
    assert_agrees,
    assert_same,
    many,
    overhead,
    reference,
    renders,
    standing,
    ways,
)
from whitted_scenes import EMITTERS, GREY, ball, bitmap, camera, stage, transform


def among(**lights):
    """A ball and a wall, close to lights."""
    wall = {"type": "rectangle", "to_world": transform().translate([0, 1, -1.2]).scale(2), "bsdf": GREY}
    return stage(ball=ball(GREY) | {"center": [-0.4, 0.5, 0]}, wall=wall, **lights)


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


@ways("all", "found")
@pytest.mark.parametrize("count", [1, 2, 5, 70])
def test_many_lights(count, way):
    assert_agrees(stage(ball=ball(), **many(count)), spp=256 if count in (1, 70) else 1024, way=way)


@ways("all", "found")
@pytest.mark.parametrize("sky", ["constant", "envmap"])
def test_lights_of_all_kinds_together(sky, way):
    lights = many(7) | {"sun": EMITTERS["directional"](), "sky": EMITTERS[sky]()}
    assert_agrees(stage(ball=ball(), **lights), spp=128, way=way)


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


def test_what_is_inside_of_a_lamp_casts_its_shadow():
    bsdf = {"type": "diffuse", "reflectance": 0.5}
    lamp = {"type": "sphere", "radius": 2.0, "flip_normals": True, "bsdf": bsdf}
    lamp |= {"emitter": {"type": "area", "radiance": 1.0}}
    sensor = camera(size=16) | {"to_world": transform().look_at([0.3, 0.2, 1.2], [0, 0, -1], [0, 1, 0])}
    things = {"ball": {"type": "sphere", "radius": 0.6, "center": [0, 0, -0.9]}, "lamp": lamp}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, **things}, optimize=False)
    assert_agrees(scene, DISTRIBUTION | {"max_depth": 2}, spp=256, detectable=0.005)


PANES = {
    "rough glass": {"type": "roughdielectric", "alpha": 0.3},
    "diffuse both ways": {"type": "principledthin", "spec_trans": 0.3, "diff_trans": 1.2},
    "half open": {"type": "mask", "opacity": 0.5, "nested": GREY},
    "thin glass": {"type": "thindielectric"},
}


@ways("all", "found", "nested")
@pytest.mark.parametrize("pane", PANES)
def test_panes_lit_from_behind(pane, way):
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
    assert_agrees(stage(window=window, **lamps), spp=1024, way=way)
