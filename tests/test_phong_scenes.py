"""The BSDF `phong` in scenes: textures, edits, adapters, variants, and pictures by Mitsuba's `path`.

Had the fixed seeds been drawn at random, correct code would fail here with 0.08 %: 8 statistical tests of level 1e-4.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from phong_oracle import LOBES, context, direction, formula, interaction, make, register
from scipy import stats
from whitted_scenes import camera, transform

import whitted
from whitted.errors import UsageError

LEVEL = 1e-4


@pytest.fixture(autouse=True)
def registered(llvm_ad_rgb):
    register()


def test_every_parameter_takes_a_texture():
    def checker(a, b):
        return {"type": "checkerboard", "color0": a, "color1": b}

    exponents = mi.Bitmap(np.float32([[[5], [80]]]))
    bsdf = make(
        diffuse_reflectance=checker(0.2, 0.4),
        specular_reflectance=checker(0.1, 0.5),
        shininess={"type": "bitmap", "bitmap": exponents, "raw": True, "filter_type": "nearest"},
    )
    wi, wo = direction(0.5), direction(-0.4)
    for uv, (kd, ks, n) in {(0.2, 0.2): (0.2, 0.1, 5), (0.7, 0.2): (0.4, 0.5, 80)}.items():
        found = np.array(bsdf.eval(context(), interaction(wi, uv), mi.Vector3f(wo)))
        np.testing.assert_allclose(found[:, 0], formula("phong", kd, ks, n, wi, wo), rtol=1e-5)
    assert mi.has_flag(bsdf.flags(0), mi.BSDFFlags.SpatiallyVarying)
    plain = make()
    assert not mi.has_flag(plain.flags(), mi.BSDFFlags.SpatiallyVarying)
    front = +mi.BSDFFlags.FrontSide
    assert plain.flags(0) == mi.BSDFFlags.DiffuseReflection | front
    assert plain.flags(1) == mi.BSDFFlags.GlossyReflection | front


def test_parameters_can_be_edited():
    bsdf = make(shininess=10.0)
    parameters = mi.traverse(bsdf)
    assert {name.split(".")[0] for name in parameters.keys()} == {  # noqa: SIM118, no dict
        "diffuse_reflectance",
        "specular_reflectance",
        "shininess",
    }
    parameters["shininess.value"] = 40.0
    parameters.update()
    wi, wo = direction(0.5), direction(-0.4)
    found = np.array(bsdf.eval(context(), interaction(wi), mi.Vector3f(wo)))[0]
    np.testing.assert_allclose(found, formula("phong", 0.5, 0.2, 40, wi, wo), rtol=1e-5)
    assert "shininess" in str(bsdf)


def test_derivatives_are_finite_and_right():
    bsdf = make(shininess=10.0)
    parameters = mi.traverse(bsdf)
    n = mi.Float(10)
    dr.enable_grad(n)
    parameters["shininess.value"] = n
    parameters.update()
    wi, wo = direction(0.5), np.stack([direction(-0.4), direction(1.5), direction(2.0)])
    value = bsdf.eval(context(), interaction(np.repeat(wi[None], 3, 0)), mi.Vector3f(np.float32(wo).T))[0]
    dr.forward(n)
    step = 1e-4
    expected = [formula("phong", 0.5, 0.2, 10 + s * step, wi[None], wo) for s in (1, -1)]
    np.testing.assert_allclose(dr.grad(value), (expected[0] - expected[1]) / (2 * step), rtol=1e-3, atol=1e-8)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"shininess": 0.0}, "shininess is 0; accepted are finite numbers above 0"),
        ({"shininess": -3.0}, "shininess is -3; accepted are finite numbers above 0"),
        ({"shininess": float("nan")}, "shininess is nan; accepted are finite numbers above 0"),
        ({"shininess": float("inf")}, "shininess is inf; accepted are finite numbers above 0"),
        ({"diffuse_reflectance": -0.1}, "diffuse_reflectance is -0.1; accepted are 0 to 1"),
        ({"specular_reflectance": float("nan")}, "specular_reflectance is nan; accepted are 0 to 1"),
        ({"lobe": "ward"}, "lobe is 'ward'; accepted are phong and blinn"),
    ],
)
def test_values_out_of_range_are_refused(wrong, named):
    with pytest.raises(RuntimeError, match=f"UsageError: {named}"):
        make(**wrong)


def test_a_refusal_is_one_line_with_its_place(tmp_path):
    path = tmp_path / "bad.xml"
    text = '<scene version="3.0.0">\n<bsdf type="phong"><float name="shininess" value="-3"/></bsdf></scene>'
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        whitted.load(path)
    assert (
        str(caught.value) == f"{path}:2: bsdf 'phong': shininess is -3; accepted are finite numbers above 0"
    )


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_other_variants(variant):
    mi.set_variant(variant)
    try:
        register()
        wi, wo = direction(0.5), direction(-0.4)
        for lobe in LOBES:
            bsdf = make(lobe, diffuse_reflectance=0.3, specular_reflectance=0.6, shininess=20.0)
            si = interaction(wi)
            si.wavelengths = dr.full(type(si.wavelengths), 550, 1)
            found = np.array(bsdf.eval(context(), si, mi.Vector3f(wo)))
            np.testing.assert_allclose(found, formula(lobe, 0.3, 0.6, 20, wi, wo), rtol=1e-5)
            _, weight = bsdf.sample(context(), si, mi.Float(0.9), mi.Point2f(0.2, 0.4))
            assert np.isfinite(np.array(weight)).all()
    finally:
        mi.set_variant("llvm_ad_rgb")


# ---- Inside Mitsuba's adapters


def bump():
    flat = mi.Bitmap(np.zeros((4, 4, 1), np.float32))
    return {"type": "bitmap", "bitmap": flat, "raw": True}


def nested(kind, child):
    """The adapter as a dict, and what it makes of the value of the child."""
    grey = {"type": "diffuse", "reflectance": 0.3}
    adapters = {
        "twosided": ({"nested": child}, 1.0, 0.0),
        "mask": ({"nested": child, "opacity": 0.4}, 0.4, 0.0),
        "blendbsdf": ({"a": child, "b": grey, "weight": 0.25}, 0.75, 0.25 * 0.3 / np.pi),
        "bumpmap": ({"nested": child, "bump": bump()}, 1.0, 0.0),
    }
    properties, share, rest = adapters[kind]
    return {"type": kind, **properties}, share, rest


ADAPTERS = ("twosided", "mask", "blendbsdf", "bumpmap")


@pytest.mark.parametrize("kind", ADAPTERS)
def test_value_inside_an_adapter(kind):
    description, share, rest = nested(kind, {"type": "phong", "shininess": 20.0})
    wi, wo = direction(0.5), direction(-0.4)
    si = interaction(wi)
    si.sh_frame, si.dp_du, si.dp_dv = mi.Frame3f([0, 0, 1]), mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    found = np.array(mi.load_dict(description).eval(context(), si, mi.Vector3f(wo)))
    expected = share * formula("phong", 0.5, 0.2, 20, wi, wo) + rest * wo[2]
    np.testing.assert_allclose(found, np.full((3, 1), expected), rtol=1e-5)


def stage(bsdf):
    """A ball of radius 0.5 at the origin under a square light."""
    panel = {
        "type": "rectangle",
        "to_world": transform().translate([0.5, 2, 1]).rotate([1, 0, 0], 90).scale(0.6),
        "emitter": {"type": "area", "radiance": 5.0},
    }
    ball = {"type": "sphere", "radius": 0.5, "bsdf": bsdf}
    return mi.load_dict({"type": "scene", "sensor": camera(), "ball": ball, "panel": panel}, optimize=False)


XML = """
<scene version="3.0.0">
    <bsdf type="twosided" id="paint">
        <bsdf type="phong">
            <rgb name="diffuse_reflectance" value="0.1, 0.2, 0.3"/>
            <texture name="shininess" type="checkerboard"><float name="color0" value="5"/></texture>
            <string name="lobe" value="blinn"/>
        </bsdf>
    </bsdf>
    <shape type="sphere"><ref id="paint"/></shape>
    <emitter type="constant"/>
</scene>
"""


def test_path_renders_it_from_xml():
    """Under a white sky nothing is brighter than the sky, and nothing darker than what the diffuse lobe reflects."""
    scene = mi.load_string(XML, optimize=False)
    sensor = mi.load_dict(camera())
    image = np.array(
        mi.render(scene, sensor=sensor, integrator=mi.load_dict({"type": "path"}), spp=512), np.float64
    )
    ball = image[7:9, 7:9].mean((0, 1))
    assert (ball > np.array([0.1, 0.2, 0.3]) * 0.95).all()
    assert (ball < np.array([0.3, 0.4, 0.5]) * 1.05).all()


@pytest.mark.parametrize("kind", ADAPTERS)
def test_path_renders_it_inside_an_adapter(kind):
    child = {"type": "phong", "shininess": 50.0, "specular_reflectance": 0.4}
    path = mi.load_dict({"type": "path", "max_depth": 2})
    image = np.array(mi.render(stage(nested(kind, child)[0]), integrator=path, spp=16))
    assert np.isfinite(image).all()
    assert image.max() > 0.05


# ---- A picture against a sum


EYE = np.array([0.3, 1.0, 4.0])
NORMALS = np.array(
    [[0.1, 0.9, 0.4], [0.2, 0.6, 0.8], [0, 0.1, 1], [0.15, 0.55, 0.85], [-0.6, 0.6, 0.5], [0.8, 0.5, 0.3]]
)


def lit_by_the_panel(lobe, n):
    """The radiance that points of the ball send to the eye, float64: the light's square summed up."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    x, z = np.meshgrid(0.5 + 0.6 * nodes, 1 + 0.6 * nodes)
    light = np.stack([x, np.full_like(x, 2.0), z], -1).reshape(-1, 3)
    area = np.outer(weights, weights).ravel() * 0.6**2
    found = []
    for normal in NORMALS / np.linalg.norm(NORMALS, axis=1, keepdims=True):
        p = 0.5 * normal
        across = np.cross(normal, [0.3, 0.5, -0.8])
        across /= np.linalg.norm(across)
        frame = np.stack([across, np.cross(normal, across), normal], 1)
        wi, to_light = EYE - p, light - p
        distance = np.linalg.norm(to_light, axis=1)
        wo = to_light / distance[:, None]
        value = formula(lobe, 0.3, 0.5, n, wi / np.linalg.norm(wi) @ frame, wo @ frame)
        found.append((5 * value * np.maximum(wo[:, 1], 0) / distance**2 * area).sum())
    return np.array(found)


def seen(scene, integrator, spp):
    """Mean and standard error of the radiance along rays from the eye to the points."""
    points = 0.5 * NORMALS / np.linalg.norm(NORMALS, axis=1, keepdims=True)
    ends = mi.Point3f(np.float32(np.repeat(points, spp, 0)).T)
    ray = mi.RayDifferential3f(mi.Point3f(EYE), dr.normalize(ends - mi.Point3f(EYE)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, len(points) * spp)
    L = np.array(integrator.sample(scene, sampler, ray)[0][0], np.float64).reshape(len(points), spp)
    return L.mean(1), L.std(1) / np.sqrt(spp)


@pytest.mark.parametrize("name", ["path", "whitted"])
@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [30.0, 500.0])
def test_a_ball_under_an_area_light(lobe, n, name):
    bsdf = {
        "type": "phong",
        "lobe": lobe,
        "diffuse_reflectance": 0.3,
        "specular_reflectance": 0.5,
        "shininess": n,
    }
    mean, error = seen(stage(bsdf), mi.load_dict({"type": name, "max_depth": 2}), 40_000)
    expected = lit_by_the_panel(lobe, n)
    assert expected.max() > 2 * expected.min()
    limit = stats.norm.isf(LEVEL / 2 / len(NORMALS))
    assert (np.abs(mean - expected) < limit * error + 1e-5 * expected).all()
    assert (np.abs(mean - lit_by_the_panel(lobe, 3 * n)) > limit * error).any()
