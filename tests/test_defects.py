"""`check` knows where Mitsuba is wrong, and blames neither side there."""

import mitsuba as mi
import pytest
from whitted_scenes import GREY, ball, camera, panel, stage, transform

import whitted
from whitted.defects import known_defects

PATH = {"type": "path", "max_depth": 2}


def found(scene, integrator=None):
    return " ".join(known_defects(scene, mi.load_dict(integrator or PATH)))


def tiny():
    return {
        "type": "sphere",
        "center": [0, 3, 0],
        "radius": 3e-3,
        "emitter": {"type": "area", "radiance": 3e4},
    }


def beside():
    """A panel before the light, nearer than the last 0.09 % of the way."""
    to_world = transform().translate([0.5, 1.9995, 1]).rotate([1, 0, 0], 90)
    return {"type": "rectangle", "to_world": to_world}


def blend():
    return ball({"type": "blendbsdf", "weight": 0.5, "a": {"type": "conductor"}, "b": {"type": "diffuse"}})


def screen():
    to_world = transform().translate([0, 1.5, 0]).rotate([1, 0, 0], -90)
    half = {"type": "mask", "opacity": 0.5, "bsdf": {"type": "diffuse"}}
    return {"type": "rectangle", "to_world": to_world, "bsdf": half}


SCENES = {
    "take volpath": lambda: {"light": panel(3.0), "screen": screen()},
    "look small": lambda: {"light": tiny()},
    "wrong weights": lambda: {"ball": blend(), "light": panel(3.0)},
    "0.09 %": lambda: {"light": panel(3.0), "shade": beside()},
}


@pytest.mark.parametrize("words", SCENES)
def test_each_is_found(words):
    scene = stage(**SCENES[words]())
    assert words in found(scene)
    assert not known_defects(scene, mi.load_dict({"type": "distribution"}))


def test_volpath_lets_light_through():
    assert not found(stage(light=panel(3.0), screen=screen()), {"type": "volpath"})


def test_a_plain_scene_has_none():
    assert not found(stage(ball=ball(), light=panel(3.0)))


@pytest.mark.parametrize("words", ["take volpath", "look small", "0.09 %"])
def test_check_blames_neither_side(words):
    scene = stage(camera(size=16), **SCENES[words]())
    agreement = whitted.check(scene, {"type": "distribution", "max_depth": 2}, PATH, spp=64)
    assert agreement.verdict == "not comparable"
    assert words in agreement.reason


def small_ball(size):
    """A ball on a floor in the sun, of ten times the ``size``."""
    sensor = camera(size=16) | {"near_clip": size}
    sensor["to_world"] = transform().look_at([0, 40 * size, 40 * size], [0, 0, 0], [0, 1, 0])
    things = {"type": "sphere", "center": [0, 6 * size, 0], "radius": 5 * size, "bsdf": GREY}
    return stage(
        sensor, ball=things, sun={"type": "directional", "direction": [0.2, -1, -0.3], "irradiance": 3.0}
    )


def test_check_knows_an_offset_by_which_rays_step_over_things():
    tested = {"type": "distribution", "max_depth": 2}
    moved, wrong = (whitted.check(small_ball(1e-4), tested, PATH, spp=64, tolerance=t) for t in (0.01, 3e-4))
    assert moved.verdict == "agree"
    assert "with our own offset: rejected" in moved.notes[-1]
    assert min(moved.assessment.p_value.values()) > moved.assessment.threshold
    assert wrong.verdict == "not comparable"
    assert "by where rays leave surfaces alone" in wrong.reason
    larger = whitted.check(small_ball(1e-2), tested, PATH, spp=64)
    assert (larger.verdict, larger.notes) == ("agree", ())


def test_the_offset_excuses_nothing_else():
    tested = {"type": "distribution", "max_depth": 2}
    assert whitted.check(small_ball(1e-4), tested, PATH | {"max_depth": 1}, spp=64).verdict == "differ"
