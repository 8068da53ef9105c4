"""How rough surfaces look for lights: the three ways have the same mean, and the pilot takes the cheaper one."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import whitted_scenes
from distribution_scenes import DISTRIBUTION, Difference, assert_same, gallery, panel, reference, renders
from whitted_scenes import EMITTERS, GREY, transform

import whitted
from whitted import techniques
from whitted.effects import TECHNIQUES
from whitted.world import World

METALS = {f"alpha{alpha}": {"type": "roughconductor", "alpha": alpha} for alpha in (0.03, 0.1, 0.3)}
METALS["plastic"] = {"type": "roughplastic", "alpha": 0.1}
METALS["glass"] = {"type": "roughdielectric", "alpha": 0.2}


def stage(bsdfs=METALS, **lights):
    balls = {
        f"ball{n}": {
            "type": "sphere",
            "center": [0.9 * (n % 3) - 0.9, 0.4 + 0.9 * (n // 3), 0],
            "radius": 0.4,
        }
        | {"bsdf": bsdf}
        for n, bsdf in enumerate(bsdfs.values())
    }
    return gallery(balls, **lights)


AREA = {"type": "area", "radiance": 4.0}
LIGHTS = {
    "one": lambda: {"panel": panel()},
    "few, and a point among them": lambda: {
        "panel": panel(),
        "lamp": {"type": "sphere", "center": [1.5, 2.5, 1.5], "radius": 0.3, "emitter": AREA},
        "point": EMITTERS["point"](),
        "sky": EMITTERS["constant"](),
    },
}


@pytest.mark.parametrize("lights", LIGHTS)
def test_the_three_ways_have_one_mean(lights):
    scene = stage(**LIGHTS[lights]())
    expected = renders(scene, reference(scene, max_depth=4), 256)
    for technique in TECHNIQUES:
        found = renders(
            scene, DISTRIBUTION | {"direct_light": technique}, 256 if technique == "both" else 1024
        )
        # Lights seen in a smooth metal by samples of the lights alone are rare and bright, as are small ones by rays
        assert_same(found, expected, 0.05 if technique == "both" else 0.1)


def test_light_that_only_rays_find_is_told():
    scene = stage(panel=panel())
    found = renders(scene, DISTRIBUTION | {"direct_light": "rays"}, 256)
    without = renders(scene, DISTRIBUTION | {"effects": "soft_shadows"}, 256)
    assert Difference.of(found, without).ratio > 1


@pytest.mark.parametrize(("name", "expected"), [("gloss", "both"), ("translucency", "rays")])
def test_the_pilot_takes_what_pays(name, expected):
    scene = whitted.load(name)
    plan = whitted.plan(scene, costs=False)
    assert plan.direct_light == expected
    assert "more variance" in str(plan)
    scene = scene.mitsuba
    fixed = mi.load_dict({"type": "distribution"}).fixed(plan)
    assert fixed.properties()["direct_light"] == expected


def test_the_excess_of_variance_is_that_of_the_pictures():
    """On a metal ball under a light, with numbers that are independent throughout."""
    scene = stage({"metal": {"type": "roughconductor", "alpha": 0.3}}, panel=panel())
    size, repeats = scene.sensors()[0].film().size(), 4000
    y, x = np.mgrid[: size[1], : size[0]]
    place = np.stack([(x.ravel() + 0.5) / size[0], (y.ravel() + 0.5) / size[1]]).astype(np.float32)
    ray, _ = scene.sensors()[0].sample_ray(0, 0.5, mi.Point2f(np.tile(place, repeats)), mi.Point2f(0.5))
    ray = mi.RayDifferential3f(ray)

    def variance(technique, seed):
        properties = {"effects": "soft_shadows+gloss", "max_depth": 2, "direct_light": technique}
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, dr.width(ray))
        L, *_ = mi.load_dict({"type": "distribution"} | properties).sample(scene, sampler, ray)
        return np.array(L, np.float64).reshape(3, repeats, -1).var(1, ddof=1).mean(1)

    measured = variance("rays", 1) - variance("both", 2)
    more, samples, rays = techniques.excess(World(scene), mi.Ray3f(ray), mi.Bool(True), seed=3)
    found = np.array([float(dr.mean(channel)[0]) for channel in more])
    np.testing.assert_allclose(found, measured, rtol=0.1)
    assert (found > 0).all()
    assert 0 < samples < 1 <= rays


@pytest.mark.parametrize("closed_form", [True, False])
def test_known_light_has_the_same_mean(closed_form):
    scene = stage(
        {"grey": GREY, "plastic": METALS["plastic"], "black": {"type": "diffuse", "reflectance": 0.0}},
        panel=panel(),
    )
    expected = renders(scene, reference(scene, max_depth=3), 256)
    options = {"closed_form": closed_form, "max_depth": 3}
    assert_same(renders(scene, DISTRIBUTION | options, 256), expected)


def test_where_light_is_known_there_is_no_noise():
    """A square light over a floor that nothing else covers: at the centres of pixels one sample is as good as many."""
    light = {"type": "rectangle", "to_world": transform().translate([0, 3, 0]).rotate([1, 0, 0], 90)}
    scene = whitted_scenes.stage(light=light | {"emitter": AREA})
    spread = {}
    for closed_form in (True, False):
        options = {"effects": "soft_shadows", "max_depth": 2, "closed_form": closed_form}
        integrator = mi.load_dict({"type": "distribution"} | options)
        pictures = [mi.render(scene, integrator=integrator, spp=1, seed=seed).numpy() for seed in (1, 2)]
        spread[closed_form] = np.abs(pictures[0] - pictures[1]).max() / pictures[0].mean()
    assert spread[True] < 1e-5
    assert spread[False] > 0.1


def test_unknown_ways_are_refused():
    with pytest.raises(RuntimeError, match="direct_light is 'ray'; accepted are auto, both, lights, rays"):
        mi.load_dict({"type": "distribution", "direct_light": "ray"})
    with pytest.raises(RuntimeError, match="closed_form is 'yes'; accepted are auto, true and false"):
        mi.load_dict({"type": "distribution", "closed_form": "yes"})
