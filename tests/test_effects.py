"""What an effect that is off leaves of the picture: exactly, by closed forms and Mitsuba's objects, and in the limit.

Exact tests compare to a few float32 roundings. Comparisons of noisy pictures have false alarms at 1e-5 each, see
`pictures`; there are 7 of them, and 3 that have to fail.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from distribution_scenes import Difference, assert_same, renders
from whitted_scenes import EMITTERS, GREY, ball, bitmap, camera, panel, stage, transform

import whitted
from whitted import effects
from whitted.errors import UsageError

POINT = {"type": "point", "position": [1, 2, 1.5], "intensity": 4.0}
CENTRE, RADIANCE = [0.5, 2.0, 1.0], 3.0


def picture(scene, wanted="", spp=1, **options):
    """Render with some effects only; an empty list is none at all."""
    made = {"type": "distribution", "effects": effects.spell(effects.parse(wanted)), "max_depth": 2} | options
    return np.array(mi.render(scene, integrator=mi.load_dict(made), spp=spp))


def seen(scene, time=None):
    """The ``SurfaceInteraction3f`` of rays through the centres of pixels and of the lens."""
    sensor = scene.sensors()[0]
    width, height = sensor.film().size()
    pixel = dr.arange(mi.UInt32, width * height)
    position = (mi.Point2f(pixel % width, pixel // width) + 0.5) * mi.ScalarPoint2f(1 / width, 1 / height)
    ray, _ = sensor.sample_ray(sensor.shutter_open() if time is None else time, 0.5, position, 0.5)
    return scene.ray_intersect(ray)


def lit(scene, place, intensity, time=None):
    """The picture of a scene under a point light: ``intensity`` is a function of the unit direction from it."""
    si = seen(scene, time)
    offset = mi.Point3f(place) - si.p
    wo = dr.normalize(offset)
    value = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(wo), si.is_valid())
    value *= intensity(-wo) / dr.squared_norm(offset)
    return as_picture(scene, dr.select(scene.ray_test(si.spawn_ray_to(mi.Point3f(place))), 0, value))


def checker():
    texture = {"type": "checkerboard", "color0": 0.8, "color1": 0.0, "to_uv": transform().scale([5, 5, 1])}
    return {"type": "diffuse", "reflectance": texture}


def as_picture(scene, value):
    width, height = scene.sensors()[0].film().size()
    return np.array(value).T.reshape(height, width, 3)


def moving(speed=0.5):
    """A dict of a camera that moves to the right while its shutter is open, from 0.25 to 1.25."""

    class Moving(mi.Sensor):
        def __init__(self, props):
            super().__init__(props)
            self.speed = props["speed"]

        def sample_ray(self, time, wavelength, position, lens, active=True):
            ray = dr.zeros(mi.Ray3f)
            ray.o = mi.Point3f(self.speed * time, 0.8, 4)
            ray.d = dr.normalize(mi.Vector3f(0.8 * (position.x - 0.5), 0.8 * (0.5 - position.y), -1))
            ray.time, ray.maxt = time, dr.inf
            return ray, mi.Spectrum(1)

        def sample_ray_differential(self, *arguments):
            ray, weight = self.sample_ray(*arguments)
            return mi.RayDifferential3f(ray), weight

        def bbox(self):
            return mi.ScalarBoundingBox3f()

    mi.register_sensor("moving_in_test", Moving)
    shutter = {"shutter_open": 0.25, "shutter_close": 1.25}
    return {"type": "moving_in_test", "speed": speed, "film": camera()["film"]} | shutter


def light(shape, **properties):
    return {"type": shape, "emitter": {"type": "area", "radiance": RADIANCE}} | properties


# ---- Names


@pytest.mark.parametrize(
    "text", ["gloss,reflection", "gloss reflection", " reflection + gloss ", "gloss\nreflection"]
)
def test_a_list_may_be_written_in_several_ways(text):
    assert effects.parse(text) == ("reflection", "gloss")


@pytest.mark.parametrize("wanted", ["auto", "all", "", "gloss", effects.NAMES, [], effects.NAMES[3:5]])
def test_what_was_parsed_is_spelled_as_it_is_read(wanted):
    parsed = effects.parse(wanted)
    assert effects.parse(effects.spell(parsed)) == parsed


@pytest.mark.parametrize(
    ("wrong", "near"),
    [("softshadows", "soft_shadows"), ("al", "all"), ("glos,reflection", "gloss"), ("auto,gloss", "auto")],
)
def test_unknown_names_give_one_line_with_the_nearest(wrong, near):
    with pytest.raises(UsageError, match=f"'{near}'") as error:
        effects.parse(wrong)
    assert "\n" not in str(error.value)
    with pytest.raises(RuntimeError, match="effects: "):
        mi.load_dict({"type": "distribution", "effects": wrong})


# ---- Each effect off, by itself


def test_without_antialiasing_all_samples_are_at_the_centres_of_pixels():
    scene = stage(camera(size=20), floor=checker(), ball=ball(checker()), light=POINT)
    expected = lit(scene, POINT["position"], lambda _: 4.0)
    assert len(np.unique(expected == 0)) == 2
    for spp in (1, 16):
        np.testing.assert_allclose(picture(scene, spp=spp), expected, rtol=2e-6, atol=1e-7)
    assert abs(picture(scene, "antialiasing", 16) - expected).max() > 0.02


def test_without_depth_of_field_the_lens_is_a_pinhole():
    lens = camera() | {"type": "thinlens", "aperture_radius": 0.3, "focus_distance": 3.0}
    pinhole, wide = (
        stage(sensor, floor=checker(), ball=ball(checker()), light=POINT) for sensor in (camera(), lens)
    )
    found = picture(wide, "antialiasing", 16)
    np.testing.assert_allclose(found, picture(pinhole, "antialiasing", 16), rtol=2e-5, atol=1e-6)
    assert abs(picture(wide, "antialiasing,depth_of_field", 16) - found).max() > 0.02


def test_without_motion_blur_the_shutter_is_just_opening():
    scene = stage(moving(), floor=checker(), ball=ball(checker()), light=POINT)
    first, last = (lit(scene, POINT["position"], lambda _: 4.0, time) for time in (0.25, 1.25))
    np.testing.assert_allclose(picture(scene, spp=4), first, rtol=2e-6, atol=1e-7)
    assert abs(first - last).max() > 0.02
    assert abs(picture(scene, "motion_blur", 16) - first).max() > 0.02


def face_down(centre=CENTRE, size=0.4):
    return transform().translate(centre).rotate([1, 0, 0], 90).scale(size)


LIGHTS = {  # their areas, and whether they are flat
    "rectangle": (lambda: light("rectangle", to_world=face_down()), 0.64, True),
    "disk": (lambda: light("disk", to_world=face_down()), 0.16 * np.pi, True),
    "sphere": (lambda: light("sphere", center=CENTRE, radius=0.3), 0.36 * np.pi, False),
    "cube": (lambda: light("cube", to_world=transform().translate(CENTRE).scale(0.2)), 24 * 0.04, False),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_without_soft_shadows_a_light_is_a_point_of_equal_power(name):
    """E = L A cos cos' / d^2 from a flat one, L A cos / (4 d^2) from others: the power pi L A in both cases."""
    made, area, is_flat = LIGHTS[name]

    def intensity(d):
        return RADIANCE * area * (dr.maximum(-d.y, 0) if is_flat else 0.25)

    scene, dark = stage(light=made(), ball=ball(GREY)), stage(ball=ball(GREY))
    expected = lit(dark, CENTRE, intensity)
    is_light = as_picture(scene, mi.Color3f(mi.Float(seen(scene).emitter(scene) != None))) > 0  # noqa: E711
    is_dark = as_picture(dark, mi.Color3f(dr.select(seen(dark).is_valid(), 1, 0))) > expected
    assert (is_dark & (expected == 0)).any(), "there is a shadow"
    found = picture(scene)
    np.testing.assert_allclose(found[~is_light], expected[~is_light], rtol=1e-4, atol=1e-6)
    assert (found[is_light] == RADIANCE).all(), "the light itself is seen as it is"
    assert abs(picture(scene, "soft_shadows", 16) - found)[~is_light].max() > 0.1 * expected.max()


def test_a_ball_of_light_is_a_point_light_of_mitsuba():
    """I = pi r^2 L."""
    point = {"type": "point", "position": CENTRE, "intensity": RADIANCE * np.pi * 0.09}
    sphere = {
        "type": "sphere",
        "center": CENTRE,
        "radius": 0.3,
        "emitter": {"type": "area", "radiance": RADIANCE},
    }
    bsdf = {"type": "roughplastic", "alpha": 0.2}
    ours, theirs = (picture(stage(light=one, ball=ball(bsdf))) for one in (sphere, point))
    outside = theirs > 0
    np.testing.assert_allclose(ours[outside], theirs[outside], rtol=1e-4)


def test_a_textured_light_becomes_a_point_of_its_mean_radiance():
    textured = EMITTERS["area, textured"]() | {"to_world": face_down()}
    mean = {"type": "rgb", "value": np.array(bitmap()).mean((0, 1)).tolist()}
    plain = light("rectangle", to_world=face_down(), emitter={"type": "area", "radiance": mean})
    scenes = stage(light=textured), stage(light=plain)
    found, expected = map(picture, scenes)
    is_floor = as_picture(scenes[1], mi.Color3f(seen(scenes[1]).p.y)) < 1e-3
    assert (expected[is_floor] > 0).any()
    np.testing.assert_allclose(found[is_floor], expected[is_floor], rtol=1e-4)


def test_without_soft_shadows_the_environment_is_seen_but_lights_nothing():
    mirror = {"type": "conductor", "material": "none"}
    scene = stage(ball=ball(mirror), sky={"type": "constant", "radiance": 0.8})
    si = seen(scene)
    floor = as_picture(scene, mi.Color3f(dr.select(si.is_valid() & (si.p.y < 1e-3), 1, 0))) > 0
    sky = as_picture(scene, mi.Color3f(dr.select(si.is_valid(), 0, 1))) > 0
    found = picture(scene, "reflection", max_depth=4)
    assert (found[floor] == 0).all()
    np.testing.assert_allclose(found[sky], 0.8, rtol=1e-6)
    rest = found[~floor & ~sky]
    assert set(np.unique(rest.round(6))) == {np.float32(0), np.float32(0.8)}, "in the mirror as well"
    # The darkest pixel, below the ball, has 0.091
    assert (picture(scene, "soft_shadows", 256)[floor] > 0.08).all()


# ---- Rough lobes as mirrors

WAYS = {
    "gloss": ("reflection", "conductor", {"type": "roughconductor", "alpha": 0.3}, -1.0),
    "translucency": ("refraction", "dielectric", {"type": "roughdielectric", "alpha": 0.3}, 1.5),
}


def framed(bsdf, z):
    """An upright plate, behind or in front of most of the floor."""
    plate = {"type": "rectangle", "to_world": transform().translate([0, 0.8, z]).scale(1.1), "bsdf": bsdf}
    return stage(camera(size=24), floor=checker(), plate=plate, light=POINT)


def beyond(scene, *wanted):
    """What is seen by way of one surface, as far as float32 tells."""
    longer, shorter = (picture(scene, wanted, 64, max_depth=depth) for depth in (3, 2))
    change = longer - shorter
    return np.where(abs(change) > 1e-5 * longer.max(), change, 0)


@pytest.mark.parametrize("effect", WAYS)
def test_a_rough_lobe_that_is_not_distributed_shows_what_a_smooth_one_would(effect):
    owner, smooth, rough, z = WAYS[effect]
    sharp = beyond(framed({"type": smooth}, z), owner) > 0
    assert 0.02 < sharp.mean() < 0.5
    np.testing.assert_array_equal(beyond(framed(rough, z), owner) > 0, sharp)
    assert ((beyond(framed(rough, z), owner, effect) > 0) != sharp).mean() > 0.05


@pytest.mark.parametrize("effect", WAYS)
def test_the_direct_light_of_a_rough_lobe_stays(effect):
    owner, _, rough, z = WAYS[effect]
    scene = framed(rough, z)
    expected = lit(scene, POINT["position"], lambda _: 4.0)
    found = picture(scene, owner)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(picture(scene, (owner, effect)), found, rtol=1e-6)


# ---- In the limit there is nothing to distribute: the integrator `whitted`


def lens(radius):
    return camera() | {"type": "thinlens", "aperture_radius": radius, "focus_distance": 3.0}


def small(radius):
    return light("sphere", center=[0.7, 2, 1]) | {
        "radius": radius,
        "emitter": {"type": "area", "radiance": 1 / (np.pi * radius**2)},
    }


def metal(alpha):
    return ball({"type": "roughconductor", "alpha": alpha})


LIMITS = {  # from a size to a scene, its limit, a size close to it and one far from it
    "light": (
        lambda radius: stage(ball=ball(GREY), light=small(radius)),
        lambda: stage(ball=ball(GREY), light={"type": "point", "position": [0.7, 2, 1], "intensity": 1.0}),
        (1e-3, 0.4),
    ),
    "roughness": (
        lambda alpha: stage(floor=checker(), ball=metal(alpha), light=panel(3.0)),
        lambda: stage(floor=checker(), ball=ball({"type": "conductor"}), light=panel(3.0)),
        (1e-3, 0.3),
    ),
    "aperture": (
        lambda radius: stage(lens(radius), floor=checker(), ball=ball(GREY), light=POINT),
        lambda: stage(floor=checker(), ball=ball(GREY), light=POINT),
        (1e-4, 0.3),
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_is_whitteds_picture(name):
    scene, limit, (close, far) = LIMITS[name]
    wanted = effects.spell(tuple(e for e in effects.NAMES if e != "interreflection"))
    made = {"type": "distribution", "effects": wanted, "max_depth": 3}
    truth = renders(limit(), {"type": "whitted", "max_depth": 3})
    assert_same(renders(scene(close), made), truth)
    assert Difference.of(renders(scene(far), made), truth).ratio > 1


# ---- What isn't called for leaves no trace

BLACK = {"type": "diffuse", "reflectance": 0.0}


def far_lamp(size):
    """A ball of light far away and out of view."""
    emitter = {"type": "area", "radiance": 2000 / size**2}
    return {"type": "sphere", "center": [10, 100, 30], "radius": size, "emitter": emitter}


SINGLE = {  # scenes that call for one effect beside antialiasing, and the kinds of rays that these send out
    "hard shadows alone": (lambda: stage(light=POINT), [], {"shadow"}),
    "soft_shadows": (
        lambda: stage(light=light("rectangle", to_world=face_down([0.5, 3, 1], 0.3), bsdf=BLACK)),
        ["soft_shadows"],
        {"shadow"},
    ),
    "reflection": (
        lambda: stage(floor={"type": "conductor"}, sky=EMITTERS["constant"]()),
        ["reflection"],
        {"reflection"},
    ),
    "interreflection": (
        lambda: stage(ball=ball(GREY), light=far_lamp(0.05)),
        ["interreflection"],
        {"shadow", "interreflection"},
    ),
}


@pytest.mark.parametrize("name", SINGLE)
def test_what_is_not_called_for_leaves_no_trace(name):
    make, called, kinds = SINGLE[name]
    scene = make()
    auto, everything = (whitted.render(scene, "distribution", spp=4, effects=e) for e in ("auto", "all"))
    assert [effect for effect in auto.effects if effect != "antialiasing"] == called
    assert {kind for kind, count in auto.rays.items() if count} == kinds | {"eye"}
    assert auto.kernel["operations"] < 0.9 * everything.kernel["operations"]
    ours, theirs = (renders(scene, {"type": "distribution", "effects": e}) for e in ("auto", "all"))
    assert_same(ours, theirs)


def test_the_branches_of_mirrors_go_with_reflection():
    scene = stage(ball=ball({"type": "conductor"}), light=POINT)
    with_it, without = (whitted.render(scene, "distribution", spp=1, effects=e) for e in ("reflection", ""))
    assert without.kernel["operations"] < 0.8 * with_it.kernel["operations"]
    assert without.rays["reflection"] == 0
    assert with_it.rays["reflection"] > 0


def test_the_plan_goes_with_the_picture():
    scene = stage(light=POINT)
    found = whitted.render(scene, "distribution", spp=2)
    stats, header = found.to_dict(), found.picture().header
    assert stats["effects"] == ["antialiasing"]
    assert [one["effect"] for one in stats["plan"]] == list(effects.NAMES)
    assert header["effects"] == "antialiasing"
    assert header["plan"] == effects.as_json(found.plan)
