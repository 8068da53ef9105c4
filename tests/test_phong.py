"""The BSDF `phong`: its numbers, its values against the formula in float64, and its energy."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from phong_oracle import (
    ANGLES,
    HALF,
    LOBES,
    NARROW,
    albedo,
    context,
    direction,
    formula,
    glossy,
    interaction,
    make,
    near_lobe,
    normalisation,
    register,
    relative_error,
    spherical,
)

from whitted import optics


@pytest.fixture(autouse=True)
def registered(llvm_ad_rgb):
    register()


# ---- Numbers


def test_logarithm_and_exponential_near_zero():
    x = np.float32(
        np.concatenate([-np.logspace(-30, np.log10(1 - HALF), 50_001), np.logspace(-30, 0, 10_001)])
    )
    assert relative_error(optics.log1p(mi.Float(x)), np.log1p(np.float64(x))).max() < 3 * 2 * HALF
    x = np.float32(np.concatenate([-np.logspace(-30, np.log10(80), 50_001), np.logspace(-30, 0, 10_001)]))
    assert relative_error(optics.expm1(mi.Float(x)), np.expm1(np.float64(x))).max() < 4 * 2 * HALF
    assert optics.log1p(mi.Float(-1))[0] == -np.inf


def sampled_angle(w):
    x, y, z = np.array(w, np.float64)
    return np.arctan2(np.hypot(x, y), z)


def textbook_angle(u, n):
    cos = dr.power(1 - u, 1 / (n + 1))
    return np.arctan2(np.array(dr.sqrt(dr.maximum(1 - cos * cos, 0)), np.float64), np.array(cos, np.float64))


@pytest.mark.parametrize("n", NARROW)
def test_sampled_angles_keep_their_digits(n):
    u = np.float32(np.random.default_rng(1).uniform(size=100_000))
    log_cos = np.log1p(-np.float64(u)) / (n + 1)
    expected = np.arctan2(np.sqrt(-np.expm1(2 * log_cos)), np.exp(log_cos))
    w = optics.square_to_power_cosine(mi.Point2f(mi.Float(u), 0.3), mi.Float(n))
    assert relative_error(sampled_angle(w), expected).max() < 4 * HALF
    if n >= 1e6:  # and the textbook's don't
        assert np.median(relative_error(textbook_angle(mi.Float(u), mi.Float(n)), expected)) > 5e-3


@pytest.mark.parametrize("n", NARROW)
def test_densities_keep_their_digits(n):
    versine = np.float32(-np.expm1(-np.random.default_rng(2).uniform(0, min(20, 10 * n), 100_000) / n))
    expected = (n + 1) / (2 * np.pi) * np.exp(n * np.log1p(-np.float64(versine)))
    found = optics.square_to_power_cosine_pdf(mi.Float(versine), mi.Float(n))
    assert relative_error(found, expected).max() < 60 * HALF  # the exponent reaches -20
    if n >= 1e6:
        textbook = (n + 1) / (2 * np.pi) * np.array(dr.power(1 - mi.Float(versine), mi.Float(n)), np.float64)
        assert relative_error(textbook, expected).max() > 1e-2


@pytest.mark.parametrize("n", NARROW)
def test_directions_map_back_to_the_square(n):
    u = np.float32(np.random.default_rng(3).uniform(1e-3, 1 - 1e-3, (2, 10_000)))
    back = optics.power_cosine_to_square(
        optics.square_to_power_cosine(mi.Point2f(u), mi.Float(n)), mi.Float(n)
    )
    np.testing.assert_allclose(np.array(back), u, atol=1e-5)


# ---- Values


@pytest.mark.parametrize("n", NARROW)
@pytest.mark.parametrize("lobe", LOBES)
def test_value_is_that_of_the_formula(lobe, n):
    rng = np.random.default_rng(4)
    bsdf = make(lobe, diffuse_reflectance=0.3, specular_reflectance=0.6, shininess=n)
    for wi in np.float64(np.float32(direction(ANGLES))):
        wo = near_lobe(lobe, wi, n, rng, 2000)
        wo = np.float64(np.float32(np.concatenate([wo, spherical(rng, 2000)])))
        found = np.array(bsdf.eval(context(), interaction(wi), mi.Vector3f(wo.T)), np.float64)
        expected = formula(lobe, 0.3, 0.6, n, wi, wo)
        lit = expected > 0
        assert lit.sum() > 1000
        assert not found[:, ~lit].any()
        # where the half vector is far from both directions, its own rounding counts
        tolerance = 1e-5 if lobe == "phong" else 1e-5 + 4 * HALF * np.sqrt(40 * n)
        assert relative_error(found[:, lit], expected[lit]).max() < tolerance


@pytest.mark.parametrize("lobe", LOBES)
def test_reciprocal(lobe):
    rng = np.random.default_rng(5)
    a, b = (np.float32(spherical(rng, 4000)) for _ in range(2))
    a[:, 2], b[:, 2] = np.abs(a[:, 2]), np.abs(b[:, 2])
    for n in (1.0, 30.0, 1e4):
        b[:2000] = near_lobe(lobe, np.float64(a[0]), n, rng, 2000)
        above = b[:, 2] > 0
        a[:2000] = a[0]
        values = []
        for bsdf_context in (context(), optics.bsdf_context("classic")):
            bsdf = make(lobe, shininess=n)
            there = np.array(bsdf.eval(bsdf_context, interaction(a), mi.Vector3f(b.T)))[0] / b[:, 2]
            back = np.array(bsdf.eval(bsdf_context, interaction(b), mi.Vector3f(a.T)))[0] / a[:, 2]
            values.append(np.abs(there / np.where(above, back, 1) - 1)[above].max())
        assert values[0] < 1e-6
        assert values[1] > 0.1  # the classical model, without a cosine at its highlight, isn't


@pytest.mark.parametrize("lobe", LOBES)
def test_sample_eval_and_pdf_agree(lobe):
    rng = np.random.default_rng(6)
    u = mi.Float(np.float32(rng.uniform(size=4000)))
    v = mi.Point2f(np.float32(rng.uniform(size=(2, 4000))))
    rgb = {"type": "rgb", "value": [0.5, 0.3, 0.1]}
    bsdf = make(lobe, diffuse_reflectance=rgb, specular_reflectance=0.4, shininess=50.0)
    kinds = mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.GlossyReflection
    contexts = {
        (0, 1): [context()],
        (0,): [context(component=0), context(type_mask=kinds[0])],
        (1,): [context(component=1), context(type_mask=kinds[1])],
        (): [context(component=2), context(type_mask=mi.BSDFFlags.Delta)],
    }
    si = interaction(np.float32(np.repeat(direction(ANGLES[3:4]), 4000, 0)))
    wo = mi.Vector3f(np.float32(spherical(rng, 4000)).T)
    parts = []
    for components, alike in contexts.items():
        for ctx in alike:
            bs, weight = bsdf.sample(ctx, si, u, v)
            value, pdf = (np.array(x) for x in bsdf.eval_pdf(ctx, si, bs.wo))
            np.testing.assert_array_equal(np.array(bsdf.eval(ctx, si, bs.wo)), value)
            np.testing.assert_array_equal(np.array(bsdf.pdf(ctx, si, bs.wo)), pdf)
            np.testing.assert_array_equal(np.array(bs.pdf), pdf)
            np.testing.assert_allclose(np.array(weight) * pdf, value, rtol=1e-6)
            valid = pdf > 0
            assert valid.sum() > 1000 if components else not valid.any()
            assert set(np.unique(np.array(bs.sampled_component)[valid])) == set(components)
            expected = np.array([+kind for kind in kinds])[np.array(bs.sampled_component)]
            np.testing.assert_array_equal(np.array(bs.sampled_type), expected)
            np.testing.assert_allclose(np.linalg.norm(np.array(bs.wo), axis=0), 1, atol=1e-6)
        parts.append(np.array(bsdf.eval(alike[0], si, wo)))
    np.testing.assert_allclose(parts[1] + parts[2], parts[0], rtol=1e-6)
    assert not parts[3].any()


def test_the_back_is_black():
    bsdf, below = make(), direction(np.pi - ANGLES)
    for wi, wo in ((below, -below), (-below, below), (below, below)):
        value, pdf = bsdf.eval_pdf(context(), interaction(wi), mi.Vector3f(np.float32(wo).T))
        assert not np.array(value).any()
        assert not np.array(pdf).any()
    _, weight = bsdf.sample(context(), interaction(below), mi.Float([0.1, 0.9] * 3), mi.Point2f(0.3, 0.4))
    assert not np.array(weight).any()


# ---- Energy


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [1e-2, 0.3, 1, 2, 4, 10, 100, 1e3, 1e5])
def test_no_more_is_reflected_than_arrives(lobe, n):
    """Exactly all at normal incidence, and less at each angle further from it."""
    found = np.array([albedo(glossy(lobe, n), lobe, n, theta)[0] for theta in ANGLES])
    assert found[0] == pytest.approx(1, abs=2e-4)
    assert (np.diff(found) < 2e-4).all()
    assert found.max() <= 1 + 1e-3


@pytest.mark.parametrize("n", [1, 3, 10])
def test_the_usual_factor_of_blinns_lobe_would_reflect_too_much(n):
    exact = (n + 2) * (n + 4) / (8 * np.pi * (2 ** (-n / 2) + n))
    usual = (n + 8) / (8 * np.pi)
    assert albedo(glossy("blinn", n), "blinn", n, 0.0)[0] * usual / exact > 1 + 1e-3


@pytest.mark.parametrize("lobe", LOBES)
def test_without_the_cosine_too_much_is_reflected(lobe):
    n, classic = 30.0, optics.bsdf_context("classic")
    scale = np.pi * normalisation(lobe, n)
    assert albedo(glossy(lobe, n), lobe, n, ANGLES[2], classic)[0] * scale > 1.1 * np.cos(ANGLES[2])
    assert scale * albedo(glossy(lobe, n), lobe, n, ANGLES[1], classic)[0] > 1 + 1e-3


def test_reflectances_that_exceed_1_together_are_scaled_down():
    red = {"type": "rgb", "value": [0.9, 0.4, 0.0]}
    bsdf = make(diffuse_reflectance=red, specular_reflectance=0.6, shininess=10.0)
    diffuse = np.array(bsdf.eval_diffuse_reflectance(interaction([0, 0, 1])))[:, 0]
    np.testing.assert_allclose(diffuse, [0.6, 0.4, 0], rtol=1e-6)
    found = albedo(bsdf, "phong", 10.0, 0.0, context(component=1))
    np.testing.assert_allclose(found, [0.4, 0.6, 0.6], rtol=1e-4)
