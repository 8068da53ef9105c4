"""The shipped scenes: what all have in common, and what the first comment of each claims to be exact."""

import re
from pathlib import Path
from xml.etree import ElementTree

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import whitted
from whitted.scene import shipped, shipped_path

SCENES = (
    "cornell_box",
    "glass",
    "hard_shadows",
    "match_diffuse",
    "match_specular",
    "mirrors",
    "whitted_1980",
)
EFFECTS = (  # one effect each, and mixed; more on them in test_effect_scenes.py
    "depth_of_field",
    "gloss",
    "interreflection",
    "mixed_glass",
    "mixed_lens_penumbra",
    "open_floor",
    "pool_balls",
    "soft_shadows",
    "translucency",
)
OFFSET = 1e-3  # Mitsuba moves the origins of rays by up to 9e-5 (1 + max |coordinate|), along the normal
OBJECTS = {"integrator", "sensor", "film", "sampler", "rfilter", "bsdf", "texture", "shape", "emitter"}


def load(name, **defines):
    """Load in plain Mitsuba, as a user without this package would."""
    defines = {"integrator": "path", "width": 32, "height": 32} | defines
    text = {key: str(value) for key, value in defines.items()}
    return mi.load_file(str(shipped_path(name)), optimize=False, **text)


def radiance(scene, integrator, origin, target, spp=1):
    """The mean radiance along the rays from ``origin`` towards points, ``float64`` [rays, 3]."""
    target = np.atleast_2d(np.asarray(target, np.float32))
    origin = np.broadcast_to(np.asarray(origin, np.float32), target.shape)
    rays = len(target)
    point = mi.Point3f(np.repeat(origin, spp, 0).T)
    ray = mi.Ray3f(point, dr.normalize(mi.Point3f(np.repeat(target, spp, 0).T) - point))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, rays * spp)
    colour = integrator.sample(scene, sampler, mi.RayDifferential3f(ray))[0]
    return np.array(colour, np.float64).T.reshape(rays, spp, 3).mean(1)


def make(kind, **parameters):
    return mi.load_dict({"type": kind, **parameters})


def test_these_are_shipped():
    assert set(shipped()) == {*SCENES, *EFFECTS}


@pytest.mark.parametrize("name", SCENES + EFFECTS)
def test_file(name):
    text = Path(shipped_path(name)).read_text(encoding="utf-8")
    assert text.startswith("<!--\n")
    assert "Source: " in text[: text.index("-->")]
    assert shipped()[name].endswith(".")
    assert len(shipped()[name]) < 120
    root = ElementTree.fromstring(text)
    defaults = {element.get("name"): element.get("value") for element in root.findall("default")}
    assert {"width", "height", "spp", "integrator", "max_depth"} <= defaults.keys()
    assert defaults["integrator"] == ("whitted" if name in SCENES else "distribution")
    objects = [element for element in root.iter() if element.tag in OBJECTS]
    names = [element.get("id") for element in objects]
    assert None not in names
    assert len(set(names)) == len(names)
    assert all(re.fullmatch("[a-z0-9_]+", identifier) for identifier in names)


@pytest.mark.parametrize("name", SCENES)
def test_loads_in_plain_mitsuba(name):
    scene = load(name, spp=4)
    sensor = scene.sensors()[0]
    assert sensor.sampler().sample_count() == 4
    assert list(sensor.film().size()) == [32, 32]
    assert sensor.film().rfilter().is_box_filter()
    image = np.array(mi.render(scene, seed=0))
    assert image.shape == (32, 32, 3)
    assert np.isfinite(image).all()
    assert image.mean() > 0.05


@pytest.mark.parametrize("name", SCENES)
def test_own_integrator(name):
    render = whitted.render(whitted.load(name, width=32, height=32), spp=4)
    assert render.nonfinite == 0
    assert np.isfinite(render.mean).all()
    assert 0.05 < render.mean.mean() < 1


@pytest.mark.parametrize("name", ["glass", "hard_shadows", "mirrors"])
def test_only_delta_lights(name):
    scene = load(name)
    assert all(mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta) for emitter in scene.emitters())
    # so a ray has one value, whatever is drawn
    origin = mi.Point3f(np.array(scene.sensors()[0].world_transform().matrix)[:3, 3, 0])
    values = radiance(scene, make("whitted"), np.ravel(origin), [[0.1, 0.9, 0.2]] * 8)
    np.testing.assert_array_equal(values, values[:1].repeat(8, 0))


def test_cornell_box_is_that_of_mitsuba():
    theirs = mi.cornell_box()
    theirs["sensor"]["film"] |= {"width": 32, "height": 32, "rfilter": {"type": "box"}}
    a = mi.render(mi.load_dict(theirs, optimize=False), seed=3, spp=64)
    b = mi.render(load("cornell_box"), seed=3, spp=64)
    np.testing.assert_allclose(np.array(b), np.array(a), rtol=2e-3, atol=1e-4)


def test_cornell_box_light():
    scene = load("cornell_box", light_radiance="1, 2, 3")
    value = radiance(scene, make("path", max_depth=1), [0, 0, 0], [0.05, 0.99, 0.02])
    np.testing.assert_allclose(value, [[1, 2, 3]])


def floor(x, z):
    return np.stack(np.broadcast_arrays(x, 0.0, z), -1).reshape(-1, 3)


RHO = 0.75 / np.pi


def seen_floor(points):
    """Radiance of points of the floor."""
    scene = load("hard_shadows")
    start = points + np.array([0, 0.05, 0])  # straight from above, and close: nothing comes between
    return radiance(scene, make("whitted", max_depth=2), start, points)


def test_hard_shadows_values():
    points = floor([0.3, 0.8, 0.0, -0.5], [0.8, 1.9, 2.4, 1.5])
    value = seen_floor(points)
    red = np.linalg.norm(points - [-5, 8, 3], axis=1)
    green = np.linalg.norm(points - [5, 7, 3], axis=1)
    np.testing.assert_allclose(value[2:, 0], (RHO * 250 * 8 / red**3)[2:], rtol=1e-4)
    np.testing.assert_allclose(value[1:, 1], (RHO * 240 * 7 / green**3)[1:], rtol=1e-4)
    np.testing.assert_allclose(value[1:, 2], RHO * 3.6 * 2 / 3, rtol=1e-4)


def test_hard_shadows_edge_of_the_plate():
    along, gap = np.linspace(-1.9, -0.1, 7), OFFSET
    inside = np.concatenate([floor(-2 + gap, along), floor(along, -2 + gap), floor(along, -gap)])
    outside = np.concatenate([floor(-2 - gap, along), floor(along, -2 - gap), floor(along, gap)])
    assert (seen_floor(inside)[:, 0] == 0).all()
    assert (seen_floor(outside)[:, 0] > 0.3).all()


def test_hard_shadows_edge_of_the_ball():
    points = floor(*np.random.default_rng(0).uniform([0, -1.5], [2.5, 2], (20_000, 2)).T)
    centre, direction = np.array([1.5, 0.8, 0.6]), np.array([1, 2, 2]) / 3
    distance = np.linalg.norm(np.cross(points - centre, direction), axis=1)
    value = seen_floor(points)[:, 2]
    np.testing.assert_array_equal(value[distance < 0.8 - OFFSET], 0)
    lit = (distance > 0.8 + OFFSET) & (distance < 0.95)
    np.testing.assert_allclose(value[lit], RHO * 2.4, rtol=1e-4)
    assert lit.sum() > 500


def test_mirrors_images_darken_geometrically():
    # a point of the back wall, straight and over 1, 2 and 3 reflections, each towards its image
    scene = load("mirrors")
    origin, point = np.array([1.0, 4.2, 4.0]), np.array([2.0, 4.3, -5.0])
    images = [point, point * [-1, 1, 1] + [6, 0, 0]]
    images.append(images[1] * [-1, 1, 1] - [6, 0, 0])
    images.append(images[2] * [-1, 1, 1] + [6, 0, 0])
    value = radiance(scene, make("whitted", max_depth=8), origin, np.array(images))
    assert (value > 0.01).all()
    np.testing.assert_allclose(value, value[:1] * 0.9 ** np.arange(4)[:, None], rtol=OFFSET)


def test_whitted_1980_values():
    black = load("whitted_1980", sky="0, 0, 0")
    points = np.array([[-2.5, 0, 3.5], [-3.5, 0, 2.5], [-2.5, 0, 2.5]])
    value = radiance(black, make("whitted"), points + np.array([0, 0.5, 0]), points)
    r = np.linalg.norm(points - [-300, 900, 800], axis=1)
    red, yellow = np.array([0.62, 0.045, 0.03]), np.array([0.80, 0.66, 0.06])
    expected = 5.4e6 * 900 / (np.pi * r**3)
    is_red = value[:, 1] < 0.2
    np.testing.assert_allclose(value, np.where(is_red[:, None], red, yellow) * expected[:, None], rtol=1e-4)
    assert list(is_red) == [is_red[0], is_red[0], not is_red[0]]
    sky = radiance(load("whitted_1980"), make("whitted"), [0, 3, 9], [0, 20, 0])
    np.testing.assert_allclose(sky, [[0.07, 0.13, 0.40]], rtol=1e-6)


def test_whitted_1980_dark_spot_ends_at_depth_12():
    scene = load("whitted_1980", width=128, height=128, fov=38, highlight=0)
    deep, deeper, default = (
        np.array(make("whitted", max_depth=depth, min_contribution=0.0).render(scene, seed=0, spp=16))
        for depth in (12, 14, 8)
    )
    spot = (slice(60, 66), slice(72, 77))
    assert default[spot].mean() < 0.7 * deep[spot].mean()
    assert deeper[spot].mean() == pytest.approx(deep[spot].mean(), rel=0.05)
    assert (np.abs(deeper - deep) < 0.01).mean() > 0.999


BOX = ("top", "front", "back", "left", "right", "bottom")


def seen_from_the_plinth(scene, rays=200_000):
    """Names of the shapes that random rays from the diffuse faces of ``match_diffuse`` hit."""
    random = np.random.default_rng(5)
    shapes = {shape.id(): shape for shape in scene.shapes()}
    faces = [shape for name, shape in shapes.items() if name.split("_")[0] in BOX]
    assert len(faces) == 9
    found = set()
    for face in faces:
        sample = mi.Point2f(random.random((2, rays // len(faces))))
        position = face.sample_position(0, sample)
        local = mi.warp.square_to_uniform_hemisphere(mi.Point2f(random.random((2, rays // len(faces)))))
        si = dr.zeros(mi.SurfaceInteraction3f, rays // len(faces))
        si.p, si.n = position.p, position.n
        hit = scene.ray_intersect(si.spawn_ray(mi.Frame3f(position.n).to_world(local)))
        for name, shape in shapes.items():
            if dr.any(hit.shape == mi.ShapePtr(shape)):
                found.add(name)
    return found


def reflects(shape):
    """Whether a shape reflects or refracts at all."""
    if not mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.DiffuseReflection):
        return True
    return float(np.max(np.array(mi.traverse(shape.bsdf())["reflectance.value"]))) > 0


def test_match_diffuse_faces_see_only_black():
    scene = load("match_diffuse")
    seen = seen_from_the_plinth(scene)
    assert {"dome", "window", "globe", "column_1", "beam_1", "ball_1"} <= seen
    assert not any(reflects(shape) for shape in scene.shapes() if shape.id() in seen)


def test_match_diffuse_lifted_ball_is_seen():
    assert "glass_ball" in seen_from_the_plinth(load("match_diffuse", glass_y=-0.7))


def same_draws(glass_y, size=128):
    """The largest change from ``max_depth`` 2 to 8 of ``path`` with the same draws, where no glass is seen."""
    scene = load("match_diffuse", glass_y=glass_y, width=size, height=size)
    sensor = scene.sensors()[0]
    at = np.stack(np.meshgrid(*[(np.arange(2 * size) + 0.5) / (2 * size)] * 2), -1).reshape(-1, 2)
    ray, _ = sensor.sample_ray(0, 0, mi.Point2f(at.T), mi.Point2f(0.5))
    glass = next(shape for shape in scene.shapes() if shape.id() == "glass_ball")
    hit = np.array(scene.ray_intersect(mi.Ray3f(ray)).shape == mi.ShapePtr(glass))
    hit = hit.reshape(size, 2, size, 2).any((1, 3))
    hit = sum(np.roll(hit, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)) > 0
    assert hit.sum() > 0.02 * size**2
    two, eight = (np.array(make("path", max_depth=depth).render(scene, seed=7, spp=1)) for depth in (2, 8))
    assert two[~hit].std() > 0.1
    return np.abs(two - eight)[~hit].max()


def test_match_diffuse_has_no_second_bounce():
    assert same_draws(glass_y=-0.9) < 1e-6
    assert same_draws(glass_y=-0.4) > 0.01


def tree(scene, ray, depth):
    """The radiance of a ray in ``match_specular``, by recursion over the laws of Snell and Fresnel in double."""
    total = np.zeros(3)
    si = scene.ray_intersect(ray)
    if depth == 0 or not si.is_valid():
        return total
    if si.emitter(scene) is not None:
        total += np.array(si.emitter(scene).eval(si), np.float64)
    n, d = np.array(si.n, np.float64), np.array(ray.d, np.float64)
    cosine = -float(d @ n)
    kind = si.shape.bsdf().id()
    if kind == "black" or (kind in ("mirror", "gold") and cosine <= 0):
        return total
    mirrored = si.spawn_ray(d + 2 * cosine * n)
    if kind in ("mirror", "gold"):
        return total + conductor(si.shape.bsdf(), cosine) * tree(scene, mirrored, depth - 1)
    eta = {"glass": 1.5, "bubble": 1 / 1.5}[kind]
    side, eta, cosine = (1, eta, cosine) if cosine > 0 else (-1, 1 / eta, -cosine)
    squared = 1 - (1 - cosine**2) / eta**2
    if squared <= 0:
        return total + tree(scene, mirrored, depth - 1)
    inner = np.sqrt(squared)
    s = (cosine - eta * inner) / (cosine + eta * inner)
    p = (eta * cosine - inner) / (eta * cosine + inner)
    reflectance = (s**2 + p**2) / 2
    refracted = si.spawn_ray(d / eta + side * (cosine / eta - inner) * n)
    # radiance times 1/eta^2 in the denser medium: cancels where the chain leaves the glass
    return (
        total
        + reflectance * tree(scene, mirrored, depth - 1)
        + (1 - reflectance) / eta**2 * tree(scene, refracted, depth - 1)
    )


def conductor(bsdf, cosine):
    """Fresnel's reflectance of a metal, by complex arithmetic."""
    parameters = mi.traverse(bsdf)
    tint = np.array(parameters["specular_reflectance.value"], np.float64)
    if "eta.value" not in parameters:
        return tint
    n = np.array(parameters["eta.value"]) + 1j * np.array(parameters["k.value"])
    inner = np.sqrt(1 - (1 - cosine**2) / n**2)
    s, p = (cosine - n * inner) / (cosine + n * inner), (n * cosine - inner) / (n * cosine + inner)
    return tint * (abs(s) ** 2 + abs(p) ** 2) / 2


def test_match_specular_is_the_sum_over_its_tree():
    # towards a glass ball, the bubble, the cube, the mirror ball, the gold ball, the plane mirror
    targets = [
        [-1.9, 1.2, 1.2],
        [0.8, 0.8, 2.0],
        [2.0, 0.8, 0.1],
        [0.4, 1.9, -1.2],
        [-2.6, 1.0, -1],
        [2, 2.5, -4],
    ]
    eye, depth = [0.2, 3.3, 8.6], 8
    with mi.variant_context("scalar_rgb"):
        scene = load("match_specular")
        rays = [mi.Ray3f(eye, dr.normalize(mi.Vector3f(target) - eye)) for target in targets]
        expected = np.array([tree(scene, ray, depth) for ray in rays])
    scene = load("match_specular")
    exact = radiance(scene, make("whitted", max_depth=depth, min_contribution=0.0), eye, targets)
    np.testing.assert_allclose(exact, expected, rtol=1e-3, atol=1e-4)
    mean = radiance(scene, make("path", max_depth=depth), eye, targets, spp=1 << 16)
    np.testing.assert_allclose(mean, expected, rtol=0.02, atol=2e-3)


def test_match_specular_has_only_specular_and_glowing_surfaces():
    for shape in load("match_specular").shapes():
        if mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.Smooth):
            assert shape.is_emitter()
            assert not reflects(shape)
