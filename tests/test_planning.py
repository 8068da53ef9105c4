"""What a scene calls for: the evidence for every effect, the pilot's bounds, and what a plan costs.

That a bound holds is tested on pictures whose noise is far below it.
"""

import json

import mitsuba as mi
import numpy as np
import pytest
from test_effects import POINT, checker, far_lamp, lens, moving
from whitted_scenes import EMITTERS, GREY, ball, camera, panel, stage, transform

import whitted
from whitted import effects
from whitted.errors import UsageError
from whitted.world import World

BOUNDED = {"radiance", "relative"}


def plan(scene, **options):
    return whitted.plan(scene, {"type": "distribution"} | options, costs=False)


def told(scene, effect, max_depth=-1):
    """Whether the objects of a scene alone call for an effect, and the evidence."""
    sensor = scene.sensors()[0] if scene.sensors() else None
    finding = effects.decide(World(scene), sensor, max_depth=max_depth)[effect]
    assert finding.bound is None
    assert finding.dimensions == (effects.DIMENSIONS[effect] if finding.called_for else 0)
    return finding.called_for, finding.evidence


# ---- What the objects tell

CONDUCTOR, DIELECTRIC = {"type": "conductor"}, {"type": "dielectric"}
ROUGH, ROUGH_GLASS = {"type": "roughconductor", "alpha": 0.3}, {"type": "roughdielectric", "alpha": 0.3}
PLASTIC = {"type": "roughplastic", "alpha": 0.2}
SENTENCES = [  # effect, what there is beside a floor, max_depth, whether it is called for, words of the evidence
    ("antialiasing", {}, -1, True, "each pixel is an area"),
    ("soft_shadows", {}, -1, False, "there is no emitter"),
    ("soft_shadows", {"lamp": POINT}, -1, False, "all emitters are delta: point light 'lamp'"),
    ("soft_shadows", {"lamp": "area"}, -1, True, "light from an area: area light"),
    ("soft_shadows", {"sky": "constant"}, -1, True, "light from an area: constant background emitter 'sky'"),
    ("soft_shadows", {"lamp": "area"}, 1, False, "max_depth = 1: no surface is lit"),
    (
        "soft_shadows",
        {"lamp": "area", "floor": CONDUCTOR},
        -1,
        False,
        "no surface scatters light, all are specular: smooth conductor",
    ),
    ("reflection", {"ball": CONDUCTOR}, 2, True, "reflecting: smooth conductor"),
    ("reflection", {"ball": CONDUCTOR}, 1, False, "nothing is seen in smooth conductor"),
    ("reflection", {"ball": ROUGH}, 3, True, "reflecting: rough conductor"),
    ("reflection", {"ball": ROUGH}, 2, False, "max_depth = 2: nothing is seen in rough conductor"),
    ("reflection", {"ball": GREY}, -1, False, "none is reflecting: smooth diffuse"),
    ("refraction", {"ball": DIELECTRIC}, 2, True, "refracting: smooth dielectric"),
    ("refraction", {"ball": ROUGH_GLASS}, 2, False, "max_depth = 2: nothing is seen in rough dielectric"),
    ("refraction", {"ball": CONDUCTOR}, -1, False, "none is refracting: smooth"),
    ("gloss", {"ball": PLASTIC}, -1, True, "rough reflection lobe: rough plastic"),
    ("gloss", {"ball": PLASTIC}, 1, False, "max_depth = 1: no surface is lit"),
    ("gloss", {"ball": CONDUCTOR}, -1, False, "no rough reflection lobe: smooth"),
    ("translucency", {"ball": ROUGH_GLASS}, -1, True, "rough transmission lobe: rough dielectric"),
    ("translucency", {"ball": ROUGH_GLASS}, 1, False, "max_depth = 1: no surface is lit"),
    ("translucency", {"ball": ROUGH}, -1, False, "no rough transmission lobe: "),
    ("interreflection", {}, -1, True, "diffuse: smooth diffuse"),
    ("interreflection", {}, 2, False, "max_depth = 2: light is scattered once at most"),
    ("interreflection", {"floor": ROUGH}, -1, False, "no surface is diffuse: rough conductor"),
    ("depth_of_field", {}, -1, False, "perspective camera 'sensor' has no aperture"),
    ("depth_of_field", {"sensor": 0.3}, -1, True, "aperture_radius = 0.3"),
    ("motion_blur", {}, -1, False, "shutter_open = shutter_close"),
    ("motion_blur", {"sensor": "open"}, -1, True, "the shutter is open for 1"),
]


@pytest.mark.parametrize(("effect", "things", "depth", "called", "words"), SENTENCES)
def test_the_evidence_of_the_objects(effect, things, depth, called, words):
    made = {
        name: EMITTERS[thing]() if thing in ("area", "constant") else thing for name, thing in things.items()
    }
    if "ball" in made:
        made["ball"] = ball(made["ball"])
    if "sensor" in made:
        made["sensor"] = moving() if made["sensor"] == "open" else lens(made["sensor"])
    if "lamp" in made:
        made["lamp"] = made["lamp"] | {"bsdf": made["floor"]} if made.get("floor") else made["lamp"]
    is_called, evidence = told(stage(**made), effect, depth)
    assert is_called == called
    assert words in evidence


def test_of_given_rays_lens_and_shutter_are_unknown():
    scene = stage(light=POINT)
    found = effects.decide(World(scene), None)
    for effect in ("depth_of_field", "motion_blur"):
        assert found[effect].called_for
        assert found[effect].evidence == "the eye rays are given"


def test_all_and_lists_are_as_asked():
    scene = stage(light=POINT)
    everything = plan(scene, effects="all")
    assert everything.effects == list(effects.NAMES)
    some = plan(scene, effects="gloss,antialiasing")
    assert some.effects == ["antialiasing", "gloss"]
    assert {finding.evidence for finding in some.findings} == {"asked for", "not asked for"}


def test_many_objects_are_not_all_named():
    balls = {f"ball{i}": ball(CONDUCTOR | {"id": f"metal{i}"}) for i in range(5)}
    _, evidence = told(stage(**balls), "reflection")
    assert evidence.endswith(" and 2 more")


# ---- What only a pilot tells


def test_an_open_shutter_before_a_scene_at_rest():
    still = plan(stage(moving(0.0), ball=ball(GREY), light=POINT))["motion_blur"]
    assert not still.called_for
    assert still.evidence == "the shutter is open for 1; nothing moves"
    blurred = plan(stage(moving(0.5), ball=ball(GREY), light=POINT))["motion_blur"]
    assert blurred.called_for
    assert blurred.evidence == "the shutter is open for 1; the camera moves"


def through(radius, focus=4.0):
    """The finding on a lens."""
    sensor = lens(radius) | {"focus_distance": focus}
    return plan(stage(sensor, floor=checker(), ball=ball(GREY), light=POINT))["depth_of_field"]


def test_a_wide_lens_is_called_for_at_once_and_a_tiny_one_is_measured():
    wide, tiny, middling = through(0.3), through(1e-5), through(0.05)
    assert wide.called_for
    assert wide.bound is None
    assert not tiny.called_for
    assert tiny.bound.keys() == BOUNDED
    assert 0 < tiny.bound["relative"] <= effects.NEGLIGIBLE
    assert middling.called_for
    assert middling.bound["relative"] > effects.NEGLIGIBLE
    for finding, radius in ((wide, 0.3), (tiny, 1e-5), (middling, 0.05)):
        assert finding.evidence.startswith(f"aperture_radius = {radius:g}; rays through it are off by up to ")


def test_the_blur_of_a_lens_is_that_of_its_circle_of_confusion():
    """A plane at the distance z through a lens of radius r focused at f: r |z / f - 1|, over the size of a pixel."""
    radius, focus, z, fov = 0.028, 2.0, 5.0, 8.0
    sensor = lens(radius) | {"focus_distance": focus, "fov": fov, "to_world": transform()}
    wall = {"type": "rectangle", "to_world": transform().translate([0, 0, z]).rotate([0, 1, 0], 180).scale(9)}
    finding = plan(mi.load_dict({"type": "scene", "sensor": sensor, "wall": wall, "light": POINT}))[
        "depth_of_field"
    ]
    pixel = 2 * z * np.tan(np.radians(fov / 2)) / 16
    assert float(finding.evidence.split()[-2]) == pytest.approx(radius * (z / focus - 1) / pixel, rel=0.02)


CONVEX = {
    "plane": lambda: stage(light=POINT),
    "ball": lambda: mi.load_dict(
        {
            "type": "scene",
            "sensor": camera() | {"to_world": transform().look_at([0, 0.6, 2], [0, 0.6, 0], [0, 1, 0])},
            "ball": ball(GREY) | {"radius": 0.9},
            "light": {"type": "point", "position": [1, 2, 4], "intensity": 4.0},
        }
    ),
}


@pytest.mark.parametrize("name", CONVEX)
def test_a_convex_body_does_not_light_itself(name):
    finding = plan(CONVEX[name]())["interreflection"]
    assert not finding.called_for
    assert "0 % meet a surface" in finding.evidence
    assert finding.bound["relative"] <= effects.NEGLIGIBLE


def test_a_ball_on_a_floor_is_lit_by_it():
    finding = plan(stage(ball=ball(GREY), light=POINT))["interreflection"]
    assert finding.called_for
    assert finding.bound is None


def far(size):
    """A floor and a ball under a ball of light far away."""
    return stage(ball=ball(GREY), light=far_lamp(size))


def test_a_small_light_far_away_is_judged_by_its_bound():
    finding = plan(far(0.05))["soft_shadows"]
    assert not finding.called_for
    assert "seen in an angle of up to 0.001" in finding.evidence
    assert finding.bound["relative"] <= effects.NEGLIGIBLE
    large = plan(far(5.0))["soft_shadows"]
    assert large.called_for
    assert large.bound is None


# ---- Bounds are true


def change(scene, effect, spp=1024):
    """The mean absolute change of the pixels' luminance if an effect is left out, and its relative value."""
    pictures = []
    for wanted in (effects.NAMES, [name for name in effects.NAMES if name != effect]):
        made = {"type": "distribution", "max_depth": 3, "effects": effects.spell(effects.parse(wanted))}
        if effect != "interreflection":
            made["max_depth"] = 2  # noise that both have, in other numbers, would only hide the change
        picture = mi.render(scene, integrator=mi.load_dict(made), spp=spp)
        pictures.append(np.array(picture, np.float64) @ [0.212671, 0.71516, 0.072169])
    with_it, without = pictures
    return abs(with_it - without).mean(), abs(with_it - without).mean() / with_it.mean()


BOUNDS = {
    "soft_shadows": lambda: far(0.5),
    "depth_of_field": lambda: stage(lens(0.03), floor=checker(), light=POINT),
    "interreflection": lambda: stage(ball=ball(GREY) | {"radius": 0.12}, light=POINT),
}


@pytest.mark.parametrize("effect", BOUNDS)
def test_leaving_an_effect_out_changes_less_than_its_bound(effect):
    scene = BOUNDS[effect]()
    bound = plan(scene, max_depth=3 if effect == "interreflection" else 2)[effect].bound
    absolute, relative = change(scene, effect)
    assert 0 < absolute < bound["radiance"]
    assert 0 < relative < bound["relative"]


@pytest.mark.parametrize("effect", ["soft_shadows", "depth_of_field"])
def test_the_noise_of_other_effects_is_no_part_of_a_bound(effect):
    """The same samples with and without it: light that comes by way of other surfaces hardly adds to the change."""
    sensor = lens(1e-3) if effect == "depth_of_field" else None
    scene = stage(sensor, ball=ball(GREY), light=far_lamp(0.5))
    all_paths, direct = (plan(scene, max_depth=depth)[effect].bound["radiance"] for depth in (-1, 2))
    assert all_paths < 2 * direct


# ---- Editing


def edited(scene, key, value):
    """The effects called for before and after a parameter is edited."""
    before = plan(scene).effects
    parameters = mi.traverse(scene)
    parameters[key] = value
    parameters.update()
    return before, plan(scene).effects


def test_a_scene_that_was_edited_has_a_new_plan():
    before, after = edited(far(0.05), "light.to_world", mi.Transform4f().translate([10, 100, 30]).scale(5))
    assert "soft_shadows" not in before
    assert after == ["antialiasing", "soft_shadows", "interreflection"]
    before, after = edited(stage(lens(1e-5), light=POINT), "sensor.aperture_radius", 0.3)
    assert set(after) - set(before) == {"depth_of_field"}
    above = transform().translate([0, 900, 0])
    scene = stage(ball={"type": "sphere", "to_world": above, "bsdf": GREY}, light=POINT)
    before, after = edited(scene, "ball.to_world", mi.Transform4f().translate([0, 0.6, 0]).scale(0.5))
    assert set(after) - set(before) == {"interreflection"}


# ---- The plan as an object, and what it costs


@pytest.fixture(scope="module")
def costed():
    mi.set_variant("llvm_ad_rgb")
    return whitted.plan(stage(ball=ball(CONDUCTOR), light=panel(3.0)), "distribution")


def test_costs_are_of_the_effects_called_for(costed):
    assert 0 < costed.kernel["operations"] < costed.kernel["operations_of_all"]
    assert 0 < costed.kernel["time_to_all"] < 1.5
    for finding in costed.findings:
        if not finding.called_for:
            assert finding.cost is None
            continue
        assert finding.cost.keys() == {"operations", "share_of_time"}
        assert finding.cost["share_of_time"] < 1
    assert {"reflection", "soft_shadows"} <= set(costed.effects)
    assert costed["reflection"].cost["operations"] > 0
    assert costed["soft_shadows"].cost["operations"] > 0


def test_a_plan_without_costs_has_none():
    found = plan(stage(light=POINT))
    assert found.kernel == {"operations": None}
    assert all(finding.cost is None for finding in found.findings)


def test_a_plan_as_json(costed):
    facts = json.loads(json.dumps(costed.to_dict()))
    assert {"scene", "effects", "kernel"} <= facts.keys()
    assert facts["kernel"] == costed.kernel
    assert [one["effect"] for one in facts["effects"]] == list(effects.NAMES)
    for one in facts["effects"]:
        assert {"effect", "called_for", "evidence", "dimensions", "bound"} <= one.keys()
        assert one["dimensions"] == (effects.DIMENSIONS[one["effect"]] if one["called_for"] else 0)
    assert json.loads(effects.as_json(costed)) == facts["effects"]


def test_a_plan_as_text(costed):
    lines = str(costed).splitlines()
    assert str(costed.kernel["operations"]) in lines[0]
    assert [line.split()[0] for line in lines[2:11]] == list(effects.NAMES)
    called = [line.split()[0] for line in lines[2:11] if line.split()[1] == "yes"]
    assert called == costed.effects
    page = costed._repr_html_()
    assert page.startswith("<pre>")
    assert "&#x27;" in page or "'" not in str(costed)


def test_a_plan_is_asked_by_name(costed):
    assert "reflection" in costed
    assert "refraction" not in costed
    assert costed["gloss"].effect == "gloss"
    assert costed.without({"reflection"}, "by hand")["reflection"].evidence == "by hand"


def test_an_integrator_without_effects_is_refused():
    with pytest.raises(UsageError, match="take the integrator distribution"):
        whitted.plan(stage(light=POINT), "whitted")


def test_a_fixed_integrator_has_nothing_left_to_decide():
    scene = stage(ball=ball(CONDUCTOR), light=panel(3.0))
    integrator = mi.load_dict({"type": "distribution", "light_samples": "auto"})
    found = integrator.plan(World(scene), scene.sensors()[0])
    fixed = integrator.fixed(found)
    assert fixed.plan(World(scene), scene.sensors()[0]).effects == found.effects
    assert fixed.properties()["light_samples"] == found.samples["light"]
    pictures = [mi.render(scene, integrator=one, spp=4).numpy() for one in (integrator, fixed)]
    np.testing.assert_array_equal(*pictures)


def test_where_there_is_no_choice_the_scenes_depth_is_taken():
    """A scene whose integrator is `whitted` is planned for `distribution` of the same depth."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted", "max_depth": 2},
            "sensor": camera(),
            "ball": ball(GREY),
            "light": POINT,
        }
    )
    found = whitted.plan(scene, costs=False)
    assert found["interreflection"].evidence == "max_depth = 2: light is scattered once at most"
