"""What the lights of a scene are taken apart into, and that sampling them all together has the density that it says."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from whitted_scenes import transform

from whitted.lights.primitives import DISK, MITSUBA, POINT, RECTANGLE, SPHERE, TRIANGLE, primitives_of
from whitted.world import World

GLOW = {"type": "area", "radiance": 2.0}
TURN = {"plain": [], "turned": ["rotate"], "mirrored": ["mirror"], "both": ["rotate", "mirror"]}
KINDS = {"rectangle": RECTANGLE, "disk": DISK, "sphere": SPHERE, "cube": TRIANGLE}


def placed(turns, scale=0.4):
    to_world = transform().translate([0.3, 1.2, -0.5])
    if "rotate" in turns:
        to_world = to_world.rotate([0.6, 0, 0.8], 130)
    return to_world.scale([-scale if "mirror" in turns else scale, scale, scale])


def scene_of(**things):
    return mi.load_dict({"type": "scene", **things}, optimize=False)


def towards(scene, points, normals):
    """What a scene emits at points, seen from the side that the normals point to and from the other: luminances."""
    found = []
    for side in (1, -1):
        origin = mi.Point3f((points + side * 0.05 * normals).T)
        si = scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(-side * normals.T)))
        found.append(np.array(si.emitter(scene).eval(si))[0])
    return found


@pytest.mark.parametrize("turns", TURN.values(), ids=TURN)
@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("shape", ["rectangle", "disk", "cube"])
def test_flat_primitives_emit_to_the_side_of_their_normals(shape, flipped, turns):
    light = {"type": shape, "to_world": placed(turns), "flip_normals": flipped, "emitter": GLOW}
    scene = scene_of(light=light)
    parts = primitives_of(scene)
    assert set(parts.kind) == {KINDS[shape]}
    a, b, c = (parts.geometry[:, i : i + 3] for i in (0, 3, 6))
    middle = {RECTANGLE: a + (b + c) / 2, TRIANGLE: (a + b + c) / 3, DISK: a + 0.01}[KINDS[shape]]
    normal = {RECTANGLE: np.cross(b, c), TRIANGLE: np.cross(b - a, c - a), DISK: b}[KINDS[shape]]
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    if shape == "disk":
        middle = middle - ((middle - a) * normal).sum(1, keepdims=True) * normal
    front, back = towards(scene, middle, normal)
    np.testing.assert_allclose(front, 2)
    np.testing.assert_array_equal(back, 0)
    np.testing.assert_allclose(normal, parts.axis, atol=1e-6)


@pytest.mark.parametrize("turns", TURN.values(), ids=TURN)
@pytest.mark.parametrize("flipped", [False, True])
def test_spheres_emit_to_their_side(flipped, turns):
    scene = scene_of(
        light={"type": "sphere", "to_world": placed(turns), "flip_normals": flipped, "emitter": GLOW}
    )
    (geometry,) = primitives_of(scene).geometry
    centre, radius, side = geometry[:3], geometry[3], geometry[4]
    np.testing.assert_allclose(np.append(centre, radius), [0.3, 1.2, -0.5, 0.4], rtol=1e-5)
    outwards = np.array([[0.6, 0.0, 0.8]])
    outside, inside = towards(scene, centre + radius * outwards, outwards)
    assert (outside[0] > 0) == (side > 0)
    assert (inside[0] > 0) == (side < 0)


def test_what_is_not_flat_round_or_rectangular_is_left_to_mitsuba():
    stretched = transform().scale([1, 2, 1])
    sheared = (
        transform().rotate([0, 0, 1], 30) @ transform().scale([1, 3, 1]) @ transform().rotate([0, 0, 1], 40)
    )
    bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(np.ones((2, 2, 3), np.float32)), "raw": True}
    kinds = {
        "ellipse": ({"type": "disk", "to_world": stretched, "emitter": GLOW}, {MITSUBA}),
        "parallelogram": ({"type": "rectangle", "to_world": sheared, "emitter": GLOW}, {TRIANGLE}),
        "cylinder": ({"type": "cylinder", "emitter": GLOW}, {MITSUBA}),
        "textured": ({"type": "rectangle", "emitter": {"type": "area", "radiance": bitmap}}, {MITSUBA}),
        "spot": ({"type": "spot"}, {MITSUBA}),
    }
    for light, expected in kinds.values():
        assert set(primitives_of(scene_of(light=light)).kind) == expected
    assert len(primitives_of(scene_of(sky={"type": "constant"}, sun={"type": "directional"}))) == 0


@pytest.mark.parametrize("shape", ["rectangle", "disk", "sphere", "cube", "cylinder"])
def test_power_is_that_of_the_rays_that_leave_a_light(shape):
    scene = scene_of(light={"type": shape, "to_world": placed(["rotate"]), "emitter": GLOW})
    u = np.random.default_rng(1).random((5, 1 << 16), np.float32)
    _, weight = scene.emitters()[0].sample_ray(0, mi.Float(u[0]), mi.Point2f(u[1:3]), mi.Point2f(u[3:5]))
    np.testing.assert_allclose(primitives_of(scene).power.sum(), np.array(weight)[0].mean(), rtol=1e-3)


def test_as_points_keep_place_and_power():
    scene = scene_of(
        panel={"type": "rectangle", "to_world": placed([]), "emitter": GLOW},
        ball={"type": "sphere", "center": [1, 2, 3], "radius": 0.5, "emitter": GLOW},
        box={"type": "cube", "to_world": placed(["rotate"]), "emitter": GLOW},
        lamp={"type": "point", "position": [0, 1, 0]},
    )
    parts = primitives_of(scene, as_points=True)
    assert parts.kind.tolist() == [POINT, POINT, POINT, MITSUBA]
    panel, ball, box, _ = parts.geometry
    np.testing.assert_allclose(panel, [0.3, 1.2, -0.5, 0, 0, 1, 0.64, 0, 0], atol=1e-6)
    np.testing.assert_allclose(ball, [1, 2, 3, 0, 0, 0, np.pi * 0.25, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(box, [0.3, 1.2, -0.5, 0, 0, 0, 6 * 0.64 / 4, 0, 0], rtol=1e-5)
    np.testing.assert_allclose(parts.power[:3], primitives_power(scene), rtol=1e-5)


def primitives_power(scene):
    parts = primitives_of(scene)
    return [parts.power[parts.emitter == emitter].sum() for emitter in range(3)]


ALL = {
    "panel": {"type": "rectangle", "emitter": GLOW},
    "coin": {"type": "disk", "emitter": GLOW},
    "ball": {"type": "sphere", "emitter": GLOW},
    "box": {"type": "cube", "emitter": GLOW},
    "tube": {"type": "cylinder", "emitter": GLOW},
}


@pytest.mark.parametrize("factor", [1, 0.5], ids=["density", "a wrong density is seen"])
@pytest.mark.parametrize("distance", [0.5, 6])
def test_what_is_sampled_has_the_density_that_it_says(distance, factor):
    """The points that ``sample`` gives, met by rays, have in ``pdf`` the same density; near and by area."""
    lights = {
        name: light
        | {"to_world": transform().translate([2.0 * i, 0.2 * i, 0]).rotate([0.8, 0.6, 0], 70).scale(0.3)}
        for i, (name, light) in enumerate(ALL.items())
    }
    world = World(scene_of(**lights))
    bounded, count = world.lights().bounded, 4096
    u = np.random.default_rng(3).random((6, count), np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.p = mi.Point3f(8 * u[0], 0.6 + distance * (0.2 + u[1]), 4 * u[2] - 2)
    n = dr.normalize(mi.Vector3f(0.3, -1, 0.1))
    sample = bounded.sample(si, n, mi.Point2f(u[3:5]), mi.Float(u[5]), mi.Bool(True))
    seen = world.scene.ray_intersect(mi.Ray3f(si.p, sample.d))
    lit = (dr.max(sample.weight) > 0) & (dr.norm(seen.p - sample.target) < 1e-4) & seen.is_valid()
    ratio = (bounded.pdf(seen, si.p, n, lit) * factor / sample.pdf).numpy()[lit.numpy()]
    assert len(ratio) > count / 4
    assert (np.abs(ratio - 1) < 0.02).mean() > 0.99 if factor == 1 else (np.abs(ratio - 1) > 0.02).all()
