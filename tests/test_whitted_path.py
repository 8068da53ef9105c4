"""`whitted` and Mitsuba's `path` estimate the same light where they own the same paths: at `max_depth` 2.

Both then have emitted light and direct light at the first surface; at more depth they agree where nothing scatters.
Each comparison has false alarms at 1e-5, see `pictures`.
"""

import mitsuba as mi
import numpy as np
import pytest
from pictures import differ, same_light
from plugins import of_kind
from whitted_scenes import (
    EMITTERS,
    GREY,
    NO_EMITTERS,
    PATH,
    VOLPATH,
    WHITTED,
    ball,
    camera,
    panel,
    stage,
    transform,
)


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
