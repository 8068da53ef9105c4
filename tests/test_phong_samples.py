"""The samples of the BSDF `phong` have the density that it states.

Seeds are fixed. Had they been drawn at random, correct code would fail here with a probability of at most 0.4 %: each
of 37 statistical tests has the level 1e-4.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from phong_oracle import ANGLES, LOBES, albedo, context, direction, glossy, interaction, register, spherical
from scipy import stats

LEVEL = 1e-4


@pytest.fixture(autouse=True)
def registered(llvm_ad_rgb):
    register()


def chi_square(domain, sample, density, **options):
    test = mi.chi2.ChiSquareTest(domain, sample, density, sample_dim=3, **options)
    return test, test.run(significance_level=LEVEL, quiet=True)


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [1, 10, 100])
@pytest.mark.parametrize("degrees", [0, 45, 85])
def test_distribution_of_the_samples(lobe, n, degrees):
    extra = {"type": "phong", "lobe": lobe, "shininess": float(n), "specular_reflectance": 0.4}
    wi = [float(x) for x in direction(np.radians(degrees), 0.7)]
    sample, density = mi.chi2.BSDFAdapter("phong", extra, wi=wi)
    options = {"sample_count": 400_000, "res": 101 if n < 100 else 201, "ires": 8}
    test, passed = chi_square(mi.chi2.SphericalDomain(), sample, density, **options)
    assert passed, test.messages


class Tangent:
    """The plane that touches the sphere of directions at the lobe's axis, in units of the lobe's width."""

    def __init__(self, axis, width, extent):
        self.frame, self.width, self.extent = mi.Frame3f(axis), width, extent

    def bounds(self):
        return mi.ScalarBoundingBox2f([-self.extent] * 2, [self.extent] * 2)

    def aspect(self):
        return 1

    def map_forward(self, p):
        x, y = p.x * self.width, p.y * self.width
        return self.frame.to_world(mi.Vector3f(x, y, dr.sqrt(1 - x * x - y * y)))

    def map_backward(self, w):
        # from a difference, as the frame alone would round directions to 1e-7
        v = self.frame.to_local(w - self.frame.n)
        return mi.Vector2f(v.x, v.y) / self.width


def narrow_test(lobe, n, degrees, factor=1.0):
    extra = {"type": "phong", "lobe": lobe, "shininess": n}
    wi = mi.ScalarVector3f(direction(np.radians(degrees), 0.7))
    sample, density = mi.chi2.BSDFAdapter("phong", extra, wi=wi, ctx=context(component=1))
    domain = Tangent(mi.reflect(wi), n**-0.5, 6 if lobe == "phong" else 12)

    def per_area(w):
        return factor * density(w) * domain.width**2 / dr.abs(dr.dot(w, domain.frame.n))

    return chi_square(domain, sample, per_area, sample_count=400_000, res=120, ires=5)


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [1e3, 1e5])
@pytest.mark.parametrize("degrees", [0, 45, 70])
def test_distribution_of_the_samples_of_a_narrow_lobe(lobe, n, degrees):
    test, passed = narrow_test(lobe, n, degrees)
    assert passed, test.messages


def test_a_wrong_density_would_be_noticed():
    """The factor n + 2 of the value in place of the density's n + 1; a lobe chosen otherwise than stated."""
    n = 10.0
    extra = {"type": "phong", "shininess": n, "diffuse_reflectance": 0.0}
    options = {"sample_count": 400_000, "ires": 8}
    sample, density = mi.chi2.BSDFAdapter("phong", extra, wi=[0.6, 0.0, 0.8])
    wrong = lambda w: density(w) * (n + 2) / (n + 1)  # noqa: E731
    assert chi_square(mi.chi2.SphericalDomain(), sample, density, **options)[1]
    assert not chi_square(mi.chi2.SphericalDomain(), sample, wrong, **options)[1]
    more_diffuse = mi.chi2.BSDFAdapter("phong", extra | {"diffuse_reflectance": 0.01}, wi=[0.6, 0.0, 0.8])[1]
    assert not chi_square(mi.chi2.SphericalDomain(), sample, more_diffuse, **options)[1]
    assert not narrow_test("phong", 1e3, 45, factor=1.05)[1]


@pytest.mark.parametrize("lobe", LOBES)
def test_weights_average_to_the_albedo(lobe):
    rng = np.random.default_rng(7)
    bsdf, count = glossy(lobe, 20), 100_000
    for theta in ANGLES[[1, 3, 4]]:
        si = interaction(np.repeat(direction(theta)[None], count, 0))
        v = mi.Point2f(np.float32(rng.uniform(size=(2, count))))
        weight = np.array(bsdf.sample(context(component=1), si, mi.Float(0.5), v)[1][0], np.float64)
        t = (weight.mean() - albedo(bsdf, lobe, 20, theta)[0]) / (weight.std() / np.sqrt(count))
        assert abs(t) < stats.norm.isf(LEVEL / 2)


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [1e6, 1e7, 1e8, 1e20, 1e30])
def test_huge_shininess_is_a_mirror(lobe, n):
    rng = np.random.default_rng(8)
    bsdf = glossy(lobe, n)
    for theta in ANGLES[:4]:
        wi = np.float32(np.repeat(direction(theta)[None], 2000, 0))
        v = mi.Point2f(np.float32(rng.uniform(size=(2, 2000))))
        bs, weight = bsdf.sample(context(), interaction(wi), mi.Float(0.5), v)
        assert np.isfinite(np.array(bs.pdf)).all()
        mirror = wi.T * np.float32([[-1], [-1], [1]])
        assert np.abs(np.array(bs.wo) - mirror).max() < 12 / np.sqrt(n) + 1e-6
        expected = np.cos(theta) if lobe == "phong" else np.cos(theta) ** 2
        np.testing.assert_allclose(np.array(weight)[0], expected, rtol=0.03)
        elsewhere = np.array(
            bsdf.eval(context(), interaction(wi), mi.Vector3f(np.float32(spherical(rng, 2000)).T))
        )
        assert np.isfinite(elsewhere).all()
