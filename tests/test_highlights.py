"""The highlights of the shipped scene ``whitted_1980``: where its first comment says, and as bright."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from whitted.sampling.draws import Draws
from whitted.scene import shipped_path
from whitted.world import World

LIGHT, INTENSITY = np.array([-300.0, 900, 800]), 5.4e6
HIGHLIGHT, ROUGHNESS = 0.006, 0.035
BALLS = {"shell": ([-0.35, 2.35, 2.2], 1.15, 1.0), "mirror": ([1.35, 1.45, -0.6], 1.25, 0.85)}
EYE = np.array([0.0, 2.7, 9.0])


def load(**defines):
    text = {name: str(value) for name, value in defines.items()}
    return mi.load_file(str(shipped_path("whitted_1980")), sky="0, 0, 0", optimize=False, **text)


def radiance(scene, targets, max_depth=2):
    """The direct light alone that is seen at points, [N]."""
    number = dr.arange(mi.UInt32, len(targets))
    draws = Draws(number, dr.zeros(mi.UInt32, len(targets)), mi.UInt32(3), number)
    eye = mi.Point3f(EYE)
    ray = mi.Ray3f(eye, dr.normalize(mi.Point3f(np.float32(targets).T) - eye))
    integrator = mi.load_dict({"type": "whitted", "max_depth": max_depth})
    return np.array(integrator.estimate(World(scene), ray, draws)["radiance"])[0]


def brightest(centre, radius):
    """The point of a ball at which the normal halves the directions to eye and light, and half the angle between."""
    normal = np.array([0.0, 0, 1])
    for _ in range(50):
        p = centre + radius * normal
        to_eye, to_light = ((x - p) / np.linalg.norm(x - p) for x in (EYE, LIGHT))
        normal = (to_eye + to_light) / np.linalg.norm(to_eye + to_light)
    return p, np.arccos(normal @ to_light)


@pytest.mark.parametrize("name", BALLS)
def test_a_highlight_at_its_brightest(name):
    centre, radius, reflectance = BALLS[name]
    p, t = brightest(np.array(centre), radius)
    irradiance = INTENSITY / ((LIGHT - p) ** 2).sum()
    expected = HIGHLIGHT * reflectance * irradiance / (4 * np.pi * ROUGHNESS**2 * np.cos(t))
    assert expected > 1, "white"
    assert radiance(load(), [p])[0] == pytest.approx(expected, rel=0.01)
    assert radiance(load(highlight=0), [p])[0] == 0


@pytest.mark.parametrize("name", BALLS)
def test_a_highlight_is_small(name):
    centre, radius, _ = BALLS[name]
    p, _ = brightest(np.array(centre), radius)
    ring = np.stack([p + 0.15 * radius * np.array([np.cos(a), np.sin(a), 0]) for a in np.linspace(0, 6, 13)])
    assert radiance(load(), ring).max() < 0.05 * radiance(load(), [p])[0]
