"""`check` knows where Mitsuba is wrong, and blames neither side there."""

import mitsuba as mi
import pytest
from whitted_scenes import ball, camera, panel, stage, transform

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


SCENES = {
    "look small": lambda: {"light": tiny()},
    "wrong weights": lambda: {"ball": blend(), "light": panel(3.0)},
    "0.09 %": lambda: {"light": panel(3.0), "shade": beside()},
}


@pytest.mark.parametrize("words", SCENES)
def test_each_is_found(words):
    scene = stage(**SCENES[words]())
    assert words in found(scene)
    assert not known_defects(scene, mi.load_dict({"type": "distribution"}))


def test_a_plain_scene_has_none():
    assert not found(stage(ball=ball(), light=panel(3.0)))


@pytest.mark.parametrize("words", ["look small", "0.09 %"])
def test_check_blames_neither_side(words):
    scene = stage(camera(size=16), **SCENES[words]())
    agreement = whitted.check(scene, {"type": "distribution", "max_depth": 2}, PATH, spp=64)
    assert agreement.verdict == "not comparable"
    assert words in agreement.reason
