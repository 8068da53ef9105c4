"""The scenes of the distributed effects: their three sizes, and what the first comment of each claims to be exact.

Seeds are fixed. Had they been drawn at random, a comparison of means with their closed form would fail for correct code
at 5 standard errors, so with 6e-7 for each of some 100 means, and this file with less than 1e-4.
"""

import importlib.util
import re
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np
import pytest
from effect_scenes import (
    FRONTS,
    MIXED,
    PIXELS,
    SINGLE,
    SIZES,
    agree,
    defaults_of,
    floor_point,
    irradiance_samples,
    lambert,
    lens_chi_square,
    load,
    seen,
    sizes_of,
    text_of,
)
from scipy import stats

import whitted
from whitted.scene import shipped

OBJECTS = {
    "integrator",
    "sensor",
    "film",
    "sampler",
    "rfilter",
    "bsdf",
    "texture",
    "shape",
    "emitter",
    "spectrum",
}


def test_these_are_shipped():
    assert set(SINGLE + MIXED) <= set(shipped())


@pytest.mark.parametrize("name", SINGLE + MIXED)
def test_file(name):
    text = text_of(name)
    assert text.startswith("<!--\n")
    comment = text[: text.index("-->")]
    assert all(part in comment for part in ("\nWhat is in it: ", "\nSource: ", "\nShows: ", "\nExact: "))
    assert max(map(len, text.splitlines())) <= 122
    assert shipped()[name].endswith(".")
    defaults = defaults_of(name)
    assert defaults["integrator"] == "distribution"
    assert {"width", "height", "spp", "max_depth"} <= defaults.keys()
    assert defaults["width"] == defaults["height"] == "256"
    names = [element.get("id") for element in ElementTree.fromstring(text).iter() if element.tag in OBJECTS]
    assert all(re.fullmatch("[a-z0-9_]+", identifier or "") for identifier in names)
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", SINGLE)
def test_medium_is_the_default(name):
    sizes = sizes_of(name)
    assert tuple(sizes) == SIZES
    assert len({frozenset(values) for values in sizes.values()}) == 1
    assert sizes["medium"].items() <= defaults_of(name).items()


SUBJECT = dict(zip(SINGLE, ["soft_shadows", "soft_shadows", *SINGLE[2:]], strict=True))


@pytest.mark.parametrize("name", SINGLE)
def test_one_effect_alone(name):
    """Lights and rough surfaces count as several effects; of the rest each scene calls for its subject only."""
    for size in SIZES:
        plan = whitted.plan(load(name, size, integrator="distribution"), costs=False)
        assert SUBJECT[name] in plan
        for other in {"depth_of_field", "motion_blur", "interreflection"} - {SUBJECT[name]}:
            assert other not in plan
        if SUBJECT[name] in ("depth_of_field", "interreflection"):
            assert plan.effects == ["antialiasing", SUBJECT[name]]


@pytest.mark.parametrize("name", SINGLE + MIXED)
def test_pictures(name):
    images = []
    for size in SIZES if name in SINGLE else SIZES[:1]:
        scene = load(name, size)
        film = scene.sensors()[0].film()
        assert list(film.size()) == [32, 32]
        assert film.rfilter().is_box_filter()
        images.append(np.array(mi.render(scene, spp=64, seed=0)))
        assert np.isfinite(images[-1]).all()
        assert 0.05 < images[-1].mean() < 1
    # the same seeds, so that pictures of equal parameters would be the same
    for a, b in pairwise(images):
        assert np.abs(a - b).mean() > 0.02 * a.mean()


def shadow_edge(size, x, spp=1 << 14, height=1.0):
    """Whether irradiance across the plate's shadow in ``soft_shadows`` is that of the light less what the plate covers.

    ``height`` is the plate's height in the closed form.
    """
    values = {key: float(value) for key, value in sizes_of("soft_shadows")[size].items()}
    half, points = values["light_size"], floor_point(x, 1.13)
    low, high = np.array([-3 - half, 4, 0.6 - half]), np.array([-3 + half, 4, 0.6 + half])
    # from a point the plate covers its projection onto the light's plane
    covered = [
        points + (np.array(corner) - points) * (4 / height)
        for corner in ([0, height, 0.7], [0.6, height, 1.3])
    ]
    covered = lambert(points, np.maximum(low, covered[0]), np.minimum(high, covered[1]))
    samples = irradiance_samples(load("soft_shadows", size), points, spp)
    return agree(samples, values["light_radiance"] * (lambert(points, low, high) - covered))


@pytest.mark.parametrize("size", SIZES)
def test_penumbra_is_the_visible_part_of_the_light(size):
    width = 2 / 3 * float(sizes_of("soft_shadows")[size]["light_size"])
    x = 1.8 + width * np.linspace(-0.4, 0.6, 11)
    assert shadow_edge(size, x)
    assert not shadow_edge(size, x, height=1.02)


@pytest.mark.parametrize("size", SIZES)
def test_penumbra_has_its_width(size):
    half = float(sizes_of("soft_shadows")[size]["light_size"])
    scene, gap = load("soft_shadows", size), 1e-3
    inside, outside = (
        irradiance_samples(scene, floor_point([1.8 + side * (half / 3 + gap)], 1.13), 1 << 14)
        for side in (-1, 1)
    )
    assert (outside > 0).all()
    assert (inside == 0).all() == (size != "large")  # then the light is larger than the plate's umbra is wide
    within = irradiance_samples(
        scene, floor_point([1.8 - half / 3 + 0.03 * half, 1.8 + half / 3 - 0.03 * half], 1.13), 1 << 14
    )
    assert (within == 0).any(1).all()
    assert (within > 0).any(1).all()


@pytest.mark.parametrize("size", SIZES)
def test_open_floor_irradiance(size):
    values = {key: float(value) for key, value in sizes_of("open_floor")[size].items()}
    half, radiance = values["light_size"], values["light_radiance"]
    q = np.hypot(half, 3)
    irradiance = 4 * radiance * half / q * np.arctan(half / q)
    assert irradiance == pytest.approx(4.5, rel=1e-5)
    samples = irradiance_samples(load("open_floor", size), floor_point(1e-3, 1e-3), 1 << 16)
    assert agree(samples, irradiance)
    assert (samples > 0).all()
    solid_angle = 4 * np.arcsin((half / q) ** 2)  # a right pyramid's: the receiver's cosine left out
    assert not agree(samples, radiance * solid_angle)


def generator():
    path = Path(__file__).parents[1] / "experiments" / "make_scenes.py"
    spec = importlib.util.spec_from_file_location("make_scenes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_gloss_has_the_derived_numbers():
    text, derived = text_of("gloss"), generator().derived
    assert derived(text) == text
    changed = text.replace('<float name="radius" value="0.2"/>', '<float name="radius" value="0.25"/>')
    assert changed != text
    assert derived(changed) == text


@pytest.mark.parametrize("number", range(1, 5))
def test_gloss_plates_mirror_the_lights(number):
    scene, eye = load("gloss"), np.array([0.0, 2.0, 15.0])
    plate = next(shape for shape in scene.shapes() if shape.id() == f"plate_{number}")
    middle = plate.sample_position(0, mi.Point2f(0.5))
    c, n = (np.ravel(np.array(v, np.float64)) for v in (middle.p, middle.n))
    arriving = (c - eye) / np.linalg.norm(c - eye)

    def distance(n):
        """How far from the middle of the row of lights the mirrored ray passes."""
        mirrored = arriving - 2 * (arriving @ n) * n
        return np.linalg.norm(np.cross(c, mirrored))

    assert distance(n) < 1e-4
    tilt = np.radians(0.1)
    assert distance(n * np.cos(tilt) + np.cross([1, 0, 0], n) * np.sin(tilt)) > 1e-3


def test_gloss_light_in_a_smooth_plate():
    scene = load("gloss", alpha_1=0.001)
    light = next(shape for shape in scene.shapes() if shape.id() == "light_4")
    plate = next(shape for shape in scene.shapes() if shape.id() == "plate_1")
    eye, c = np.array([0, 2, 15.0]), np.ravel(plate.sample_position(0, mi.Point2f(0.5)).p)
    before, after = np.linalg.norm(c - eye), np.linalg.norm(c)
    radiance = seen(scene, eye, [3, 0, 0])[0]
    assert light.emitter() is not None
    assert radiance.mean() * 0.8**2 == pytest.approx(0.4, rel=1e-5)
    target = [3 * before / (before + after), c[1], c[2]]
    assert agree(seen(scene, eye, target, 1 << 12), 0.8 * radiance, rounding=1e-3)


@pytest.mark.parametrize("depth", FRONTS)
def test_circle_of_confusion(depth):
    """Pixels are independent and nearly normal, so that the sum follows chi-square's law; false alarms at 1e-5."""
    c = 0.1 * abs(1 / 6 - 1 / depth) * PIXELS
    assert c == pytest.approx({3: 5.86, 4: 2.93, 6: 0, 12: 2.93}[depth], abs=0.005)
    found, count = lens_chi_square(depth, c)
    assert count > 100
    assert 0.5e-5 < stats.chi2.sf(found, count) < 1 - 0.5e-5
    found, count = lens_chi_square(depth, 1.1 * c or 0.5)
    assert stats.chi2.sf(found, count) < 0.5e-5


def test_translucency_of_a_nearly_smooth_pane():
    scene = load("translucency", alpha=0.001)
    point = [1.5, -0.8, 0]  # on the rose band, between two rows of letters
    bare = seen(scene, [1.5, -0.8, 0.1], point)[0] * [[1, 1, 1]]
    reflectance = float(mi.fresnel(mi.Float(np.cos(np.radians(20))), 1.5)[0][0])
    assert reflectance == pytest.approx(0.04, abs=5e-4)
    # beside the refracted direction the lobe has tails: about alpha^2 / 0.05^2 of it reaches a letter
    for depth in (3, 4):
        samples = seen(scene, [1.5, -0.8, 9.5], point, 1 << 16, depth)
        assert agree(samples, (1 - reflectance) ** 2 * bare, rounding=5e-4)
        assert not agree(samples, (1 - reflectance) * bare, rounding=5e-4)


@pytest.mark.parametrize("size", SIZES)
def test_interreflection_direct_light(size):
    points, light = floor_point([-0.75, -0.6, -0.85], [0.3, 0.15, 0.4]), np.array([0.3, 1.9, 0.6])
    axis = np.array([-0.9, 0.6, 0]) - light
    r = np.linalg.norm(points - light, axis=1)[:, None]
    assert ((points - light) @ axis / np.linalg.norm(axis) > r[:, 0] * np.cos(np.radians(28))).all()
    value = seen(load("interreflection", size), points + np.array([0, 0.05, 0]), points)[:, 0]
    albedo = float(sizes_of("interreflection")[size]["albedo"])
    expected = albedo / np.pi * np.array([10.5, 10, 9.2]) * 1.9 / r**3
    np.testing.assert_allclose(value, expected, rtol=2e-4)
    assert not np.allclose(value, expected * r / 1.9, rtol=2e-4)  # the receiver's cosine left out


def test_interreflection_only_adds():
    gains = []
    for size in SIZES:
        scene = load("interreflection", size)
        two, eight = (
            np.array(mi.load_dict({"type": "path", "max_depth": depth}).render(scene, seed=2, spp=64))
            for depth in (2, 8)
        )
        assert (eight - two > -1e-5).all()  # of the same draws
        gains.append(eight.mean() / two.mean())
    assert 1.05 < gains[0] < gains[1] < gains[2]


def test_pool_balls_circles_of_confusion():
    scene = load("pool_balls", width=256, height=256)
    camera = scene.sensors()[0]
    parameters = mi.traverse(camera)
    inverse = np.linalg.inv(np.array(camera.world_transform().matrix, np.float64).reshape(4, 4))
    focus, radius = (float(np.ravel(v)[0]) for v in (camera.focus_distance(), parameters["aperture_radius"]))
    for point in ([-0.9, 0.75, 3.4], [0.4, 1, -5.4]):  # tip of the cue, front of the rail
        depth = (inverse @ [*point, 1])[2]
        c = radius * abs(1 / focus - 1 / depth) * 256 / (2 * np.tan(np.radians(18.5)))
        assert 0.8 < c < 1.3


def test_mixed_glass_panel_and_sky():
    scene = load("mixed_glass")
    panel = next(shape for shape in scene.shapes() if shape.id() == "light")
    position = panel.sample_position(0, mi.Point2f(np.random.default_rng(0).random((2, 4096))))
    points, normal = np.array(position.p).T, np.array(position.n).T
    value = seen(scene, points + 0.1 * normal, points)[:, 0]
    warm = value[:, 0] > 20
    np.testing.assert_allclose(value, np.where(warm[:, None], [36, 27, 18], [3, 4.2, 6]), rtol=1e-5)
    assert warm.mean() == pytest.approx(0.5, abs=0.05)
    np.testing.assert_allclose(seen(scene, [0, 3, 0], [0, 9, 0])[0, 0], [0.2, 0.29, 0.42], rtol=1e-5)
