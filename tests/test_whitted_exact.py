"""Pictures without noise, whose values are known in closed form."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from whitted_scenes import camera, transform

import whitted
from whitted.sampling.draws import Draws
from whitted.world import World

BLACK = {"type": "diffuse", "reflectance": 0.0}


def traced(scene, origins, directions, **properties):
    """Return what `whitted` finds along rays: ``float64`` by name, radiance as [N, 3]."""
    origins, directions = np.broadcast_arrays(
        np.atleast_2d(np.float32(origins)), np.atleast_2d(np.float32(directions))
    )
    ray = mi.Ray3f(mi.Point3f(origins.T), dr.normalize(mi.Vector3f(directions.T)))
    number = dr.arange(mi.UInt32, len(origins))
    draws = Draws(number, dr.zeros(mi.UInt32, len(origins)), mi.UInt32(3), number)
    integrator = mi.load_dict({"type": "whitted", **properties})
    found = integrator.estimate(World(scene, integrator.hide_emitters), ray, draws)
    found = {name: np.array(value, np.float64) for name, value in found.items()}
    return {name: np.broadcast_to(v, (*v.shape[:-1], len(origins))).T for name, v in found.items()}


def radiance(*args, **properties):
    return traced(*args, **properties)["radiance"]


def scene_of(**things):
    return mi.load_dict({"type": "scene", **things}, optimize=False)


def plane(z=0.0, up=True, size=100, **properties):
    to_world = transform().translate([0, 0, z]).rotate([1, 0, 0], 0 if up else 180).scale(size)
    return {"type": "rectangle", "to_world": to_world, **properties}


def emitting(radiance):
    return {"type": "area", "radiance": {"type": "rgb", "value": [radiance] * 3}}


# ---- Direct light of emitters without extent

POINTS = np.array([[0, 0, 0], [1, 0.5, 0], [-1.5, 2, 0], [3, -2, 0]], np.float64)
EYES = POINTS + np.array([0.2, 0.3, 4])
RHO = np.array([0.7, 0.5, 0.2])
LIGHT = np.array([0.5, 0.2, 2.5])


def floor():
    return plane(bsdf={"type": "diffuse", "reflectance": {"type": "rgb", "value": list(RHO)}})


def seen(scene, **properties):
    return radiance(scene, EYES, POINTS - EYES, **properties)


def falling_off():
    to_light = LIGHT - POINTS
    distance = np.linalg.norm(to_light, axis=1)
    return to_light[:, 2] / distance / distance**2


def test_point_light():
    light = {"type": "point", "position": list(LIGHT), "intensity": {"type": "rgb", "value": [3, 2, 1]}}
    expected = RHO / np.pi * [3, 2, 1] * falling_off()[:, None]
    np.testing.assert_allclose(seen(scene_of(floor=floor(), light=light)), expected, rtol=1e-5)


def test_spot_light():
    aimed = transform().look_at(list(LIGHT), [0.5, 0.2, 0], [0, 1, 0])
    light = {"type": "spot", "to_world": aimed, "intensity": 5.0, "cutoff_angle": 60, "beam_width": 59}
    expected = RHO / np.pi * 5 * falling_off()[:, None]
    np.testing.assert_allclose(seen(scene_of(floor=floor(), light=light)), expected, rtol=1e-5)
    light |= {"cutoff_angle": 20, "beam_width": 19}
    narrow = seen(scene_of(floor=floor(), light=light))
    np.testing.assert_allclose(narrow[0], expected[0], rtol=1e-5)
    assert not narrow[3].any()


def test_directional_light():
    d = np.array([0.3, -0.4, -0.8])
    light = {"type": "directional", "direction": list(d), "irradiance": 2.0}
    expected = np.broadcast_to(RHO / np.pi * 2 * 0.8 / np.linalg.norm(d), (4, 3))
    np.testing.assert_allclose(seen(scene_of(floor=floor(), light=light)), expected, rtol=1e-5)


def test_light_adds_up_over_more_emitters_than_are_unrolled():
    lights = {
        f"light{i}": {"type": "point", "position": list(LIGHT), "intensity": float(2**i)} for i in range(7)
    }
    expected = RHO / np.pi * (2**7 - 1) * falling_off()[:, None]
    np.testing.assert_allclose(seen(scene_of(floor=floor(), **lights)), expected, rtol=1e-5)


def test_an_occluder_casts_a_shadow_unless_shadows_are_off():
    light = {"type": "point", "position": list(LIGHT), "intensity": 1.0}
    ball = {"type": "sphere", "center": list(POINTS[1] * 0.5 + LIGHT * 0.5), "radius": 0.2}
    scene = scene_of(floor=floor(), light=light, ball=ball)
    expected = RHO / np.pi * falling_off()[:, None]
    blocked = seen(scene)
    assert not blocked[1].any()
    np.testing.assert_allclose(blocked[[0, 2, 3]], expected[[0, 2, 3]], rtol=1e-5)
    np.testing.assert_allclose(seen(scene, shadows=False), expected, rtol=1e-5)


def test_a_glass_pane_casts_a_full_shadow():
    light = {"type": "point", "position": list(LIGHT), "intensity": 1.0}
    pane = plane(1.0, bsdf={"type": "dielectric"})
    eyes = POINTS + np.array([0.2, 0.3, 0.5])
    found = radiance(scene_of(floor=floor(), light=light, pane=pane), eyes, POINTS - eyes)
    assert not found.any()


# ---- Chains of perfect reflections and refractions


def test_the_mirror_image_of_an_emitter():
    mirror = {"type": "conductor", "specular_reflectance": {"type": "rgb", "value": [0.8, 0.5, 0.1]}}
    panel = {
        "type": "rectangle",
        "to_world": transform().translate([2, 0, 2]).rotate([1, 0, 0], 180).scale(0.5),
        "emitter": emitting(3.0),
        "bsdf": BLACK,
    }
    scene = scene_of(mirror=plane(bsdf=mirror), panel=panel)
    hits = radiance(scene, [-2, 0, 2], [[2, 0, -2], [2.2, 0.1, -2], [2, 1, -2]])
    np.testing.assert_allclose(hits[:2], np.broadcast_to([2.4, 1.5, 0.3], (2, 3)), rtol=1e-5)
    assert not hits[2].any()


def fresnel(cos, eta):
    cos_t = np.sqrt(1 - (1 - cos**2) / eta**2)
    s, p = (cos - eta * cos_t) / (cos + eta * cos_t), (eta * cos - cos_t) / (eta * cos + cos_t)
    return (s**2 + p**2) / 2


ANGLES = np.radians([0, 30, 60, 80])


def slab(front, back, thickness=0.1):
    """A glass slab at z = 0 between two emitters that fill half of all directions each."""
    return scene_of(
        top=plane(0, bsdf={"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}),
        bottom=plane(-thickness, up=False, bsdf={"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}),
        before=plane(5, up=False, emitter=emitting(front), bsdf=BLACK),
        behind=plane(-5, emitter=emitting(back), bsdf=BLACK),
    )


def through_slab(scene, **properties):
    directions = np.stack([np.sin(ANGLES), 0 * ANGLES, -np.cos(ANGLES)], axis=1)
    return traced(scene, -directions, directions, min_contribution=0, **properties)


@pytest.mark.parametrize("max_depth", [2, 3, 4, 5, 6, 9, 40])
def test_a_slab_of_glass_transmits_the_series_cut_at_max_depth(max_depth):
    r = fresnel(np.cos(ANGLES), 1.5)
    there = sum((r ** (2 * k) for k in range(20) if 3 + 2 * k <= max_depth), 0 * r)
    found = through_slab(slab(0.0, 1.0), max_depth=max_depth)["radiance"]
    np.testing.assert_allclose(found[:, 0], (1 - r) ** 2 * there, rtol=2e-5)
    if max_depth == 40:
        np.testing.assert_allclose(found[:, 0], (1 - r) / (1 + r), rtol=2e-5)


@pytest.mark.parametrize("max_depth", [1, 2, 3, 4, 5, 6, 9, 40])
def test_a_slab_of_glass_reflects_the_series_cut_at_max_depth(max_depth):
    r = fresnel(np.cos(ANGLES), 1.5)
    inside = sum((r ** (2 * k + 1) for k in range(20) if 4 + 2 * k <= max_depth), 0 * r)
    found = through_slab(slab(1.0, 0.0), max_depth=max_depth)["radiance"]
    np.testing.assert_allclose(found[:, 0], (max_depth > 1) * r + (1 - r) ** 2 * inside, rtol=2e-5, atol=1e-8)
    if max_depth == 40:
        np.testing.assert_allclose(found[:, 0], 2 * r / (1 + r), rtol=2e-5)


@pytest.mark.parametrize("max_depth", [1, 2, 3, 4, 7])
def test_what_a_slab_of_glass_drops_is_what_is_missing(max_depth):
    found = through_slab(slab(1.0, 1.0), max_depth=max_depth)
    np.testing.assert_allclose(found["radiance"][:, 0] + found["dropped_by_depth"], 1, rtol=1e-5)


def ball(radius=1.0, **glass):
    return {"type": "sphere", "radius": radius, "bsdf": {"type": "dielectric", **glass}}


FURNACES = {
    "sphere": {"ball": ball(int_ior=1.5)},
    "shell": {"outside": ball(int_ior=1.5), "inside": ball(0.9, int_ior=1.0, ext_ior=1.5)},
    "holes": {
        "ball": {
            "type": "sphere",
            "bsdf": {
                "type": "mask",
                "opacity": 0.6,
                "nested": {"type": "twosided", "nested": {"type": "conductor"}},
            },
        }
    },
    "thin": {"ball": {"type": "sphere", "bsdf": {"type": "thindielectric"}}},
}


@pytest.mark.parametrize("name", FURNACES)
@pytest.mark.parametrize(
    ("max_depth", "min_contribution"), [(1, 0), (4, 0), (4, 0.02), (12, 0), (12, 1 / 1024)]
)
def test_in_a_furnace_all_that_is_not_radiance_is_accounted_for(name, max_depth, min_contribution):
    """Everything is lit by radiance 1, and nothing absorbs: radiance and throughput dropped add up to 1."""
    scene = scene_of(sensor=camera(), sky={"type": "constant", "radiance": 1.0}, **FURNACES[name])
    integrator = {"type": "whitted", "max_depth": max_depth, "min_contribution": min_contribution}
    done = whitted.render(scene, integrator, spp=16)
    lost = done.to_dict()["truncation"]
    dropped = [lost[account]["throughput_dropped"] for account in ("by_depth", "by_cutoff")]
    assert done.mean.mean(dtype=np.float64) + sum(dropped) == pytest.approx(1, abs=1e-5)
    assert dropped[0] > 0 or min_contribution > 0
    assert dropped[1] >= 0 if min_contribution else dropped[1] == 0


@pytest.mark.parametrize("max_depth", [1, 2, 50, 128])
def test_a_box_of_mirrors_gives_the_geometric_series(max_depth):
    """Walls that emit 1 and reflect 0.99: (1 - 0.99^n) / 0.01."""
    mirror = {"type": "conductor", "specular_reflectance": 0.99}
    scene = scene_of(box={"type": "cube", "flip_normals": True, "bsdf": mirror, "emitter": emitting(1.0)})
    directions = np.random.default_rng(1).normal(size=(50, 3))
    found = radiance(scene, [0.1, 0.2, 0.3], directions, max_depth=max_depth, min_contribution=0)
    np.testing.assert_allclose(found, (1 - 0.99**max_depth) / 0.01, rtol=1e-5)


def test_the_cutoff_ends_the_series_where_it_says():
    """A branch of throughput 0.5^k is followed while that is at least the cutoff."""
    mirror = {"type": "conductor", "specular_reflectance": 0.5}
    scene = scene_of(box={"type": "cube", "flip_normals": True, "bsdf": mirror, "emitter": emitting(1.0)})
    for cutoff, terms in ((0.6, 1), (0.5, 2), (0.1, 4), (1 / 1024, 11)):
        found = traced(scene, [0.1, 0.2, 0.3], [0.3, 0.4, 0.5], max_depth=20, min_contribution=cutoff)
        assert found["radiance"][0, 0] == pytest.approx(2 - 0.5 ** (terms - 1), rel=1e-6)
        assert found["dropped_by_cutoff"][0] == pytest.approx(0.5**terms, rel=1e-6)


def test_eta_1_is_no_sphere_at_all():
    things = {"floor": floor(), "light": {"type": "point", "position": list(LIGHT), "intensity": 1.0}}
    glass = {
        "type": "sphere",
        "center": [0, 0, 3],
        "radius": 0.5,
        "bsdf": {"type": "dielectric", "int_ior": 1.0, "ext_ior": 1.0},
    }
    light = things["light"] | {"position": [5, 5, 5.0]}
    eyes = np.array([[0.1, 0.05, 6.0], [-0.2, 0.3, 6.0]])
    with_ball = radiance(scene_of(**things | {"light": light}, glass=glass), eyes, [0, 0, -1])
    without = radiance(scene_of(**things | {"light": light}), eyes, [0, 0, -1])
    np.testing.assert_allclose(with_ball, without, rtol=1e-5)


# ---- Ambient light

AMBIENT = {"type": "rgb", "value": [0.1, 0.2, 0.4]}


@pytest.mark.parametrize(
    ("bsdf", "share"),
    [
        ({"type": "diffuse", "reflectance": 0.5}, 0.5),
        ({"type": "twosided", "nested": {"type": "diffuse", "reflectance": 0.5}}, 0.5),
        ({"type": "mask", "opacity": 0.4, "nested": {"type": "diffuse", "reflectance": 0.5}}, 0.2),
        ({"type": "roughconductor"}, 0),
        ({"type": "conductor"}, 0),
        ({"type": "dielectric"}, 0),
        ({"type": "roughdielectric"}, 0),
    ],
)
def test_ambient_light_meets_diffuse_lobes_only(bsdf, share):
    scene = scene_of(floor=plane(bsdf=bsdf))
    found = seen(scene, ambient=AMBIENT)
    np.testing.assert_allclose(found, np.broadcast_to(np.array([0.1, 0.2, 0.4]) * share, (4, 3)), rtol=1e-6)


def test_ambient_light_is_carried_along_specular_chains_but_not_met_at_max_depth_1():
    mirror = plane(8, up=False, bsdf={"type": "conductor", "specular_reflectance": 0.5})
    scene = scene_of(floor=floor(), mirror=mirror)
    up = radiance(scene, EYES, [0, 0, 1], ambient=AMBIENT)
    np.testing.assert_allclose(up, np.broadcast_to(RHO * [0.1, 0.2, 0.4] * 0.5, (4, 3)), rtol=1e-6)
    assert not seen(scene, ambient=AMBIENT, max_depth=1).any()


# ---- What is refused and what is empty


def test_max_depth_0_is_black_and_1_is_emitted_light_only():
    scene = scene_of(floor=floor(), sky={"type": "constant", "radiance": 0.7})
    none = traced(scene, [0, 0, 1], [[0, 0, 1], [0, 0, -1]], max_depth=0)
    assert not none["radiance"].any()
    assert not none["alpha"].any()
    one = radiance(scene, [0, 0, 1], [[0, 0, 1], [0, 0, -1]], max_depth=1)
    np.testing.assert_allclose(one[:, 0], [0.7, 0], rtol=1e-6)


@pytest.mark.parametrize(
    "wrong",
    [{"max_depth": -1}, {"max_depth": 129}, {"min_contribution": -0.1}, {"min_contribution": float("inf")}],
)
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(Exception, match=next(iter(wrong))):
        mi.load_dict({"type": "whitted", **wrong})


def test_a_scene_without_surfaces_or_emitters_is_black():
    assert not radiance(scene_of(sensor=camera()), [0, 0, 0], [0, 0, 1]).any()
    assert not radiance(scene_of(floor=floor()), [0, 0, 1], [0, 0, -1]).any()
