"""Where the noise of rendered pictures comes from: exact where one effect makes it all, else by closed forms."""

import json

import mitsuba as mi
import numpy as np
import pytest
from commands import refused
from studies import finished
from whitted_scenes import room

import whitted
from whitted import image
from whitted.errors import UsageError
from whitted.film import cropped
from whitted.noise import noise_shares
from whitted.sampling.draws import EFFECTS
from whitted.sampling.groups import Evaluations
from whitted.tracing import TreePasses

DIRECT = "distribution:max_depth=2"


def seen_from_above(**things):
    """A scene of things around the origin, seen by a pixel from 3.5 above, [-1, 1]^2 of the floor."""
    look = mi.ScalarTransform4f().look_at([0, 0, 3.5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
    sensor = {"type": "orthographic", "to_world": look, "film": film}
    return mi.load_dict({"type": "scene", "sensor": sensor, **things}, optimize=False)


def square(x, z, size, **rest):
    to_world = mi.ScalarTransform4f().translate([x, 0, z]) @ mi.ScalarTransform4f().scale([size, size, 1])
    return {"type": "rectangle", "to_world": to_world, **rest}


def grey(value):
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": value}}


def shipped(name, effects):
    return whitted.load(name, width=24, height=24), f"{DIRECT},effects={effects}"


def rough_metal():
    """A floor of rough metal that finds an area light by its own rays alone."""
    lamp = square(0, 5, 2, bsdf=grey(0.0), flip_normals=True, emitter={"type": "area", "radiance": 1.0})
    scene = seen_from_above(floor=square(0, 0, 4, bsdf={"type": "roughconductor", "alpha": 0.3}), lamp=lamp)
    return scene, f"{DIRECT},direct_light=rays,effects=antialiasing+gloss+soft_shadows"


def bounced():
    """A floor that a point light can't see, and a ceiling that it can."""
    light = {"type": "point", "position": [0, 0, 4], "intensity": {"type": "rgb", "value": 1.0}}
    scene = seen_from_above(
        floor=square(0, 0, 9, bsdf=grey(0.5)),
        shade=square(0, 3.9, 2, bsdf=grey(0.0)),
        ceiling=square(0, 5, 9, bsdf=grey(0.5), flip_normals=True),
        light=light,
    )
    return scene, "distribution:max_depth=3,effects=antialiasing+interreflection"


ONE_EFFECT = {
    "light": lambda: shipped("soft_shadows", "antialiasing+soft_shadows"),
    "lens": lambda: shipped("depth_of_field", "antialiasing+depth_of_field"),
    "gloss": rough_metal,
    "hemisphere": bounced,
}


@pytest.mark.parametrize("effect", ONE_EFFECT)
def test_one_effect_makes_all_of_the_noise(effect):
    found = noise_shares(*ONE_EFFECT[effect](), freeze=["pixel"], evaluations=64)
    noisy = found.variance > 0
    assert noisy.mean() > 0.1
    assert next(iter(found.effects)) == effect
    assert found.effects[effect].total.value == pytest.approx(1, abs=1e-9)
    assert found.effects[effect].first.holds(1)
    np.testing.assert_allclose(found.total[effect][noisy], 1, rtol=1e-9)
    for other in set(found.effects) - {effect}:
        assert found.effects[other].total.value == 0


def floor(emission=None, x=-2, brightness=1.0):
    """A floor under a far light that a blocker halves: of radiance 0 or ``brightness``, besides its ``emission``.

    It is dark under a strong light, so that it is hardly ever taken for the light itself.
    """
    light = {"type": "area", "radiance": {"type": "rgb", "value": 1e6 * np.pi / 2 * brightness}}
    glow = {} if emission is None else {"emitter": {"type": "area", "radiance": emission}}
    return seen_from_above(
        floor=square(x, 0, 2, bsdf=grey(0.005), **glow),
        light=square(0, 100, 1, bsdf=grey(0.0), flip_normals=True, emitter=light),
        blocker=square(5, 99.999, 5, bsdf=grey(0.0)),
    )


def test_two_gates_share_as_their_product_does():
    """The floor fills half of the pixel, and sees half of the light."""
    found = noise_shares(floor(), DIRECT, evaluations=2048)
    assert found.variance[0, 0] == pytest.approx(3 / 16, rel=0.05)
    for name in ("pixel", "light"):
        share = found.effects[name]
        assert share.total.holds(2 / 3), share
        assert share.first.holds(1 / 3), share
        assert share.total.high - share.total.low < 0.15
    assert found.interaction.holds(1 / 3)


def test_two_summands_share_as_their_variances_do():
    """Emission of 0 or 1 by the pixel's half, of variance 1/4, and light of 0 or 1/2, of variance 1/16."""
    stripes = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": 0.0},
        "color1": {"type": "rgb", "value": 1.0},
        "to_uv": mi.ScalarTransform4f().scale([1, 0.001, 1]),
    }
    found = noise_shares(floor(stripes, x=0, brightness=0.5), DIRECT, evaluations=2048)
    assert found.variance[0, 0] == pytest.approx(5 / 16, rel=0.05)
    for name, share in (("pixel", 0.8), ("light", 0.2)):
        assert found.effects[name].first.holds(share)
        assert found.effects[name].total.holds(share)
    assert found.interaction.holds(0)


def values(effect, swapped=False, count=4):
    scene = whitted.load("soft_shadows", width=8, height=8).mitsuba
    made = mi.load_dict({"type": "distribution", "max_depth": 2, "effects": "antialiasing+soft_shadows"})
    camera = scene.sensors()[0]
    world = made.world(scene)
    with cropped(camera) as window:
        plan = made.plan(world, camera)
        groups = Evaluations(3, count, first=5, effect=effect, swapped=swapped)
        passes = TreePasses(
            made, world, camera, plan, window, groups, lambda f, w, r: [f["radiance"].x], 1, counted=False
        )
        passes.run(0, count)
    return passes.moments().sums, passes.drawn


def test_only_the_draws_for_the_effect_change():
    a, drawn = values(None)
    b, _ = values(None, swapped=True)
    assert drawn == {"pixel", "light"}
    assert (a != b).mean() > 0.3
    for effect in EFFECTS:
        mixed, _ = values(effect)
        assert (mixed == a).all() == (effect not in drawn)
        assert (mixed != b).any()


def test_the_numbers_of_an_evaluation_do_not_depend_on_the_batch():
    whole, _ = values("light", count=4)
    np.testing.assert_array_equal(values("light", count=2)[0], whole[:2])


def test_brightness_has_no_say():
    plain, bright = (noise_shares(floor(brightness=b), DIRECT, evaluations=64).to_dict() for b in (1, 1e3))
    for name, share in plain["effects"].items():
        assert bright["effects"][name]["total"]["value"] == pytest.approx(share["total"]["value"], rel=1e-4)


def test_a_crop_has_the_shares_of_the_whole():
    scene = whitted.load("soft_shadows", width=16, height=16)
    whole, part = (noise_shares(scene, DIRECT, evaluations=8, crop=crop) for crop in (None, (4, 8, 5, 3)))
    np.testing.assert_array_equal(part.total["light"], whole.total["light"][8:11, 4:9])


def test_a_wide_filter_mixes_the_noise_of_neighbours():
    narrow, wide = (
        noise_shares(room(rfilter, size=12), "whitted", evaluations=32) for rfilter in ("box", "gaussian")
    )
    assert wide.variance.mean() < narrow.variance.mean()
    for found in (narrow, wide):
        assert found.effects["pixel"].total.value > 0.5


def test_more_samples_leave_other_noise():
    """Low-discrepancy points take off smooth noise first; what is left at edges involves the pixel as well."""
    scene = whitted.load("soft_shadows", width=24, height=24)
    one, many = (noise_shares(scene, DIRECT, spp=spp, evaluations=32) for spp in (1, 16))
    assert many.variance.mean() < one.variance.mean() / 16
    assert many.effects["pixel"].total.low > one.effects["pixel"].total.high


def test_the_ray_tree_has_shares_too():
    found = noise_shares(whitted.load("whitted_1980", width=24, height=24), "whitted", evaluations=16)
    assert sum(share.first.value for share in found.effects.values()) < 1.05
    assert found.effects["pixel"].total.value > 0.5


def test_the_picture_and_its_facts(tmp_path):
    found = noise_shares(whitted.load("depth_of_field", width=16, height=16), DIRECT, evaluations=8)
    found.write(tmp_path / "shares.exr")
    picture = image.read(tmp_path / "shares.exr")
    np.testing.assert_array_equal(picture.channels["share.lens.Y"], np.float32(found.total["lens"]))
    assert {"share.lens.first.Y", "share.lens.stderr.Y", "share.pixel.Y"} <= set(picture.channels)
    assert json.loads(picture.header["noiseShares"]) == found.to_dict()
    colours = found.false_colour()
    assert np.isfinite(colours).all()
    assert colours.max() <= 1
    assert (colours[found.variance == 0] == 0).all()
    assert "lens" in str(found)
    assert "<img" in found._repr_html_()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"integrator": "path"}, "PathIntegrator doesn't tell"),
        ({"evaluations": 3}, "evaluations is 3"),
        ({"spp": 0}, "spp is 0"),
        ({"freeze": ["gloss"]}, "'gloss' can't be held; accepted are pixel, lens, time"),
        ({"effects": "glosss"}, "did you mean 'gloss'"),
    ],
)
def test_wrong_arguments_are_one_line(options, words):
    with pytest.raises(UsageError, match=words):
        noise_shares("soft_shadows", **options)


def test_render_writes_them_beside_the_picture(tmp_path):
    arguments = [
        "render",
        "soft_shadows",
        "--width",
        "16",
        "--spp",
        "4",
        "--shares",
        "8",
        "--png",
        "--stats",
        "s.json",
    ]
    code, out, err = finished(*arguments, cwd=tmp_path)
    assert code == 0, err
    assert "light" in out
    assert (tmp_path / "soft_shadows.shares.png").is_file()
    shares = json.loads((tmp_path / "s.json").read_text())["shares"]
    assert shares["evaluations"] == 8
    assert "share.light.Y" in image.read(tmp_path / "soft_shadows.exr").channels
    refused(finished(*arguments[:2], "--shares", "8", "--integrator", "path", cwd=tmp_path), "PathIntegrator")
