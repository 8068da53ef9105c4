"""Reflection, refraction, Fresnel's shares and narrow lobes: laws that hold for every input, in both precisions."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from whitted import microfacet, optics

COUNT = 1000  # inputs that one of the ten examples of each law stands for
PRECISIONS = ("single", "double")
UNIT = {"single": 2.0**-24, "double": 2.0**-53}

seeds = st.integers(0, 2**32 - 1)
etas = st.one_of(st.floats(0.2, 5), st.floats(1 - 1e-6, 1 + 1e-6), st.sampled_from([1.0, 1e-4, 1e4]))
law = settings(
    max_examples=10, deadline=None, database=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def vector(precision):
    return mi.Vector3f if precision == "single" else mi.Vector3d


def number(precision):
    return mi.Float if precision == "single" else mi.Float64


def rounded(x, precision):
    return np.asarray(x, np.float32 if precision == "single" else np.float64)


def exact(x):
    return np.longdouble(np.array(x))


def norm(x):
    return np.sqrt((x * x).sum(0))


def unit_vectors(rng, precision):
    x = rng.standard_normal((3, COUNT))
    return rounded(x / norm(x), precision)


def incident(rng, precision, most=1.0):
    """Directions of all angles, and normals, the sine of the angle at most ``most``; many near 0 and near there."""
    n = rng.standard_normal((3, COUNT))
    n /= norm(n)
    along = np.cross(n, rng.standard_normal((3, COUNT)), axis=0)
    along /= norm(along)
    small = 10.0 ** rng.uniform(-8, 0, COUNT)
    sine = most * np.where(rng.random(COUNT) < 0.5, small, 1 - small * 0.99)
    d = along * sine - n * np.sqrt((1 - sine) * (1 + sine))
    return rounded(d, precision), rounded(n, precision)


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds)
def test_reflection_is_its_own_inverse(precision, seed):
    rng = np.random.default_rng(seed)
    V, u = vector(precision), UNIT[precision]
    d, n = V(unit_vectors(rng, precision)), V(unit_vectors(rng, precision))
    once = optics.reflect(d, n)
    assert norm(exact(optics.reflect(once, n)) - exact(d)).max() < 16 * u
    assert np.abs(norm(exact(once)) - norm(exact(d))).max() < 8 * u
    across = (exact(n) * (exact(once) + exact(d))).sum(0)
    assert np.abs(across).max() < 8 * u
    same = np.cross(exact(n), exact(once) - exact(d), axis=0)
    assert norm(same).max() < 8 * u


def refracted(precision, seed, eta):
    """Directions, normals, the refracted directions, the index as rounded, and u; up to 0.9 of the critical sine."""
    rng = np.random.default_rng(seed)
    eta = rounded(eta, precision)
    V, u = vector(precision), UNIT[precision]
    d, n = (V(x) for x in incident(rng, precision, min(1, 0.9 * float(eta))))
    return d, n, optics.refract(d, n, number(precision)(eta)), eta, u


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds, eta=etas)
def test_snells_law(precision, seed, eta):
    d, n, t, eta, u = refracted(precision, seed, eta)
    before, behind = (np.cross(exact(n), exact(v), axis=0) for v in (d, t))
    assert norm(before - eta * behind).max() < 2 * 2 * u * max(1, eta) * np.sqrt(3)  # each component to 2 ulp
    assert np.abs(norm(exact(t)) - 1).max() < 8 * u
    assert ((exact(n) * exact(t)).sum(0) < 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds, eta=etas)
def test_refraction_back_is_the_inverse(precision, seed, eta):
    d, n, t, eta, u = refracted(precision, seed, eta)
    back = -exact(optics.refract(-t, -n, number(precision)(1) / number(precision)(eta)))
    cos, cos_t = (-(exact(n) * exact(v)).sum(0) for v in (d, t))
    tangent = np.sqrt(np.maximum(1 - cos**2, 0)) / cos
    bound = 16 * u * (1 + eta * cos_t / cos + tangent)
    near = cos > 1e3 * np.sqrt(u)  # nearer to total reflection a rounding decides
    assert (norm(back - exact(d)) / bound)[near].max() < 1


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds)
def test_nothing_is_refracted_beyond_the_critical_angle(precision, seed):
    rng = np.random.default_rng(seed)
    d, n = (vector(precision)(x) for x in incident(rng, precision))
    sine = norm(np.cross(exact(d), exact(n), axis=0))
    eta = rounded(sine * (1 - 1e-6), precision)
    total = np.array(dr.isnan(optics.refract(d, n, number(precision)(eta)).x))
    assert total[sine > 1e-3].all()


def angles(rng, precision):
    """Cosines of all angles, many near 0 and 1."""
    small = 10.0 ** rng.uniform(-10, 0, COUNT)
    return rounded(np.where(rng.random(COUNT) < 0.5, small, 1 - 0.5 * small), precision)


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds, eta=etas)
def test_shares_of_light(precision, seed, eta):
    F, u = number(precision), UNIT[precision]
    cos = angles(np.random.default_rng(seed), precision)
    R, T = (np.array(share, np.float64) for share in optics.fresnel(F(cos), F(eta)))
    assert ((R >= 0) & (R <= 1) & (T >= 0) & (T <= 1)).all()
    assert np.abs(exact(R) + exact(T) - 1).max() <= u
    r_s, r_p = (np.array(r, np.float64) for r in optics.amplitudes(F(cos), F(eta)))
    assert np.abs((r_s**2 + r_p**2) / 2 - R).max() < 20 * u


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds, eta=st.floats(1.0, 1e4))
def test_shares_are_the_same_from_both_sides(precision, seed, eta):
    F, u = number(precision), UNIT[precision]
    eta, cos = rounded(eta, precision), angles(np.random.default_rng(seed), precision)
    inside = rounded(np.sqrt(1 - (1 - exact(cos)) * (1 + exact(cos)) / exact(eta) ** 2), precision)
    sine2 = (1 - exact(inside)) * (1 + exact(inside)) * exact(eta) ** 2
    some = sine2 < 1 - 1e6 * u  # nearer to total reflection a rounding decides
    cos = rounded(np.sqrt(1 - sine2[some]), precision)
    there = optics.fresnel(F(cos), F(eta))
    back = optics.fresnel(F(inside[some]), 1 / F(eta))
    bound = 64 * u * (1 + (exact(eta) / exact(cos)) ** 2)  # the reciprocal is rounded, and turns the ray
    for one, other in zip(there, back, strict=True):
        assert (np.abs(exact(one) - exact(other)) / bound).max(initial=0) < 1


@pytest.mark.parametrize("precision", PRECISIONS)
def test_shares_at_the_ends(precision):
    F = number(precision)
    R, T = optics.fresnel(F([0, 0, 0, 1, 1, 0.5, 0.5]), F([1, 1.5, 0.5, 1, 3, 1, 0.5]))
    assert R.numpy().tolist() == [0, 1, 1, 0, 0.25, 0, 1]
    assert T.numpy().tolist() == [1, 0, 0, 1, 0.75, 1, 0]
    R, T = optics.textbook_fresnel(F([1, 0.5]), F([3, 0.5]))
    assert R[0] == 0.25
    assert T[0] == 0.75
    assert np.isnan(R[1])


@law
@given(seed=seeds, eta=st.floats(1.001, 4.0))
def test_slab_conserves_energy(seed, eta):
    F, rng = mi.Float64, np.random.default_rng(seed)
    cos = angles(rng, "double")
    back, through = optics.slab(F(cos), F(eta), F(0))
    assert np.abs(np.array(back + through) - 1).max() < 32 * UNIT["double"]
    depth = rng.exponential(size=COUNT)
    back, through = (np.array(x) for x in optics.slab(F(cos), F(eta), F(depth)))
    assert (back + through < 1).all()
    R, T = (np.array(x) for x in optics.fresnel(F(cos), F(eta)))
    bounces = np.arange(200)[:, None]
    a = np.exp(-depth)
    assert np.abs(through - (T * T * a * (R * a) ** (2 * bounces)).sum(0)).max() < 1e-3
    plain = np.array(optics.textbook_slab(F(cos), F(eta), F(depth)))
    fair = T > 1e-3
    np.testing.assert_allclose(plain[:, fair], np.array([back, through])[:, fair], rtol=1e-10)


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds)
def test_absorbed_share(precision, seed):
    depth = rounded(10.0 ** np.random.default_rng(seed).uniform(-30, 2, COUNT), precision)
    found = exact(optics.absorbed(number(precision)(depth)))
    assert np.abs(found / -np.expm1(-exact(depth)) - 1).max() < 16 * UNIT[precision]


@law
@given(seed=seeds, exponent=st.floats(0, 8))
def test_directions_of_a_lobe_map_back_to_the_square(seed, exponent):
    u = np.float32(np.random.default_rng(seed).uniform(1e-3, 1 - 1e-3, (2, COUNT)))
    n = mi.Float(10**exponent)
    w = optics.square_to_power_cosine(mi.Point2f(u), n)
    assert np.abs(norm(exact(w)) - 1).max() < 8 * UNIT["single"]
    np.testing.assert_allclose(np.array(optics.power_cosine_to_square(w, n)), u, atol=1e-5)


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds, exponent=st.floats(0, 8))
def test_power_of_a_cosine(precision, seed, exponent):
    n = rounded(10**exponent, precision)
    fall = np.random.default_rng(seed).uniform(0, 20, COUNT)
    versine = rounded(-np.expm1(-fall / n), precision)
    some = versine < 1
    truth = np.exp(exact(n) * np.log1p(-exact(versine[some])))
    found = exact(optics.power_cosine(number(precision)(versine), number(precision)(n)))[some]
    assert np.abs(found / truth - 1).max() < 100 * UNIT[precision]


@pytest.mark.parametrize("precision", PRECISIONS)
@law
@given(seed=seeds, exponent=st.floats(-4, 0))
def test_ggx(precision, seed, exponent):
    alpha = rounded(10**exponent, precision)
    rng = np.random.default_rng(seed)
    v, phi = rng.uniform(0, 0.99, COUNT), rng.uniform(0, 2 * np.pi, COUNT)
    tangent = float(alpha) * np.sqrt(v / (1 - v))
    m = rounded(
        [np.cos(phi) * tangent, np.sin(phi) * tangent, np.ones(COUNT)] / np.hypot(1, tangent), precision
    )
    x, y, z = exact(m)
    square, a = x * x + y * y + z * z, exact(alpha)
    truth = square**2 / (np.pi * a**2 * ((x * x + y * y) / a**2 + z * z) ** 2)
    V, F, u = vector(precision), number(precision), UNIT[precision]
    assert np.abs(exact(microfacet.ggx(V(m), F(alpha))) / truth - 1).max() < 20 * u
    loss = 16 * u / exact(alpha) ** 2  # of the textbook's form
    if loss < 0.1:
        assert np.abs(exact(microfacet.textbook_ggx(V(m), F(alpha))) / truth - 1).max() < 8 * loss
