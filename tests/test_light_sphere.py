"""Sampling of spheres by solid angle: against closed forms in long double, point lights and its density."""

import mitsuba as mi
import numpy as np
import pytest
from lights import (
    EPS,
    LEVEL,
    moments,
    nodes,
    point,
    pooled_chi_square,
    random_numbers,
    random_units,
    single,
    unit,
    vector,
)

from whitted.lights import sphere, warp

NONE = (0, 0, 0)
AXIS = np.array([0.36, -0.48, 0.8])  # towards the centre


class Light:
    """A sphere with its centre at a distance along ``AXIS`` from the origin."""

    def __init__(self, distance, radius=1.0):
        self.centre, self.radius = single(distance * AXIS), float(single(radius))
        self.arguments = point(self.centre), mi.Float(self.radius)

    def __call__(self, name, p, n, u_or_q):
        return getattr(sphere, name)(*self.arguments, point(p), vector(n), u_or_q)

    def irradiance(self, n):
        return float(sphere.irradiance(*self.arguments, point(NONE), vector(n))[0])

    def truth(self, n):
        """The textbook's form of the irradiance, ``longdouble``, of a receiver at the origin."""
        n, centre = np.asarray(n, np.longdouble), np.asarray(self.centre, np.longdouble)
        distance = np.sqrt(centre @ centre)
        if distance < self.radius:
            return np.pi
        s = min(self.radius / distance, np.longdouble(1))
        cos = n @ centre / distance / np.sqrt(n @ n)
        if abs(cos) >= s:
            return float(max(np.pi * s * s * cos, 0))
        x, sin = np.sqrt(1 / (s * s) - 1), np.sqrt(1 - cos * cos)
        y = -x * cos / sin
        q = sin * np.sqrt(1 - y * y)
        return float((cos * np.arccos(y) - x * q) * s * s + np.arctan2(q, x))


def tilted(cos):
    """A normal at an angle with this cosine to ``AXIS``."""
    return single(cos * AXIS + np.sqrt(1 - cos * cos) * unit([0.48, 0.36, 0]))


PLACES = {  # distance over radius, cosine between the normal and the centre
    "small": (50, 0.6),
    "very small": (1e4, 0.6),
    "faced": (2, 1.0),
    "askew": (2, 0.7),
    "just above": (2, 0.51),
    "partly below": (2, 0.2),
    "mostly below": (2, -0.2),
    "close": (1.1, 0.8),
    "very close": (1.001, 0.3),
    "inside": (0.5, 0.3),
    "just inside": (0.99, -0.8),
    "at the centre": (0, 0.3),
}


@pytest.mark.parametrize("ratio", [2, 1e2, 1e3, 1e4, 1e5, 1e7])
def test_small_spheres_are_point_lights(ratio):
    """The irradiance is that of a point of intensity pi r^2 for any radius, and every estimate is it."""
    light, n = Light(3, 3 / ratio), tilted(0.6)
    exact = (
        np.pi * light.radius**2 * (n @ light.centre) / np.linalg.norm(light.centre) ** 3 / np.linalg.norm(n)
    )
    np.testing.assert_allclose(light.irradiance(n), exact, rtol=16 * EPS)
    _, d, _, pdf = light("sample", NONE, n, random_numbers(1000, 1))
    np.testing.assert_allclose(n @ np.array(d, np.float64) / np.array(pdf), exact, rtol=64 * EPS)


@pytest.mark.parametrize("ratio", [1.001, 2, 1e2, 1e3, 1e4, 1e5, 1e7])
def test_solid_angle(ratio):
    """Uniform density for no normal, at any radius."""
    light = Light(3, 3 / ratio)
    distance = np.linalg.norm(np.longdouble(light.centre))
    s = light.radius / distance
    exact = 2 * np.pi * s * s / (1 + np.sqrt(1 - s * s))
    pdf = np.array(light("sample", NONE, NONE, random_numbers(100, 1))[3])
    np.testing.assert_allclose(1 / pdf, np.float64(exact), rtol=8e-5 if ratio < 2 else 16 * EPS)


def test_solid_angle_needs_the_cosine_without_its_difference():
    """In single precision ``1 - cos`` is off by several percent at a radius of 1e-3 of the distance."""
    s = np.float32(1e-3)
    naive = 2 * np.pi * np.float64(1 - np.sqrt(1 - s * s))
    assert abs(naive / (np.pi * 1e-6) - 1) > 0.02
    light = Light(1, 1e-3)
    assert abs(1 / light("sample", NONE, NONE, random_numbers(1, 1))[3][0] / (np.pi * 1e-6) - 1) < 1e-6


@pytest.mark.parametrize("ratio", [1.0001, 1.01, 1.5, 2, 10, 100, 1e3, 1e4])
def test_irradiance_cut_by_the_horizon(ratio):
    """Error relative to a surface that faces the light, and where the sphere's middle is above also to the truth."""
    light = Light(ratio)
    s = min(1 / ratio, 1)
    for part in np.linspace(-1.2, 1.2, 25):
        cos = np.clip(part * s, -1, 1)
        n = tilted(cos)
        truth = light.truth(n)
        error = abs(light.irradiance(n) - truth)
        assert error < 16 * EPS * np.pi * s * s
        if part > 0:
            assert error < 64 * EPS * max(ratio, 1 / np.sqrt(ratio - 1)) * truth


def test_published_numbers():
    light = Light(2, 0.5)
    for cos, E in ((0, 0.010619), (-0.1, 0.003197)):
        assert abs(light.irradiance(tilted(cos)) - E) < 1e-6
    assert abs(Light(1.01).irradiance(tilted(-0.5)) - 0.558277) < 2e-6


@pytest.mark.parametrize("cos", [-1, -0.5, 0, 0.3, 1])
def test_on_the_surface_and_inside(cos):
    """From outside the limit is half of what a receiver inside gets from all around, and of the cosine's share."""
    n = (0, np.sqrt(1 - cos * cos), cos)
    E = sphere.irradiance(mi.Point3f(0, 0, 1), mi.Float(1), point(NONE), vector(n))[0]
    assert abs(E - np.pi / 2 * (1 + cos)) < 16 * EPS
    for z in (0.999, 0.5, 0):
        inside = sphere.irradiance(mi.Point3f(0, 0, z), mi.Float(1), point(NONE), vector(n))[0]
        assert abs(inside - np.pi) < 4 * EPS


@pytest.mark.parametrize(
    "name", ["small", "very small", "faced", "askew", "just above", "inside", "just inside", "at the centre"]
)
def test_estimates_are_constant_above_the_horizon_and_inside(name):
    """Each is the irradiance itself."""
    ratio, cos = PLACES[name]
    light, n = Light(ratio), tilted(cos)
    u, _ = nodes(128)
    _, d, _, pdf = light("sample", NONE, n, u)
    estimate = np.array(d, np.float64).T @ n / np.array(pdf, np.float64)
    np.testing.assert_allclose(estimate, light.truth(n), rtol=3e-5)
    np.testing.assert_allclose(estimate.mean(), light.truth(n), rtol=1e-6)


@pytest.mark.parametrize("name", PLACES)
def test_estimates_have_the_irradiance_as_mean(name):
    """By quadrature, to which the horizon's kink costs accuracy; with the receiver's normal preferred and without."""
    ratio, cos = PLACES[name]
    light, n = Light(ratio), tilted(cos)
    for preference in (n, NONE):
        mean, _, _ = moments(light, NONE, n, preference, k=512)
        kink = ratio < 1 or abs(cos) * ratio < 1
        assert abs(mean / light.truth(n) - 1) < (3e-4 if kink else 1e-5)


def test_mean_needs_the_density_of_the_warp(monkeypatch):
    light, n = Light(2), tilted(0.2)
    monkeypatch.setattr(warp, "bilinear_pdf", lambda t, weights: 1)
    assert abs(moments(light, NONE, n)[0] / light.truth(n) - 1) > 0.1


def test_irradiance_needs_the_horizon():
    light = Light(2)
    assert abs(np.pi / 4 * 0.2 / light.truth(tilted(0.2)) - 1) > 0.1


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_point_direction_distance_and_density_agree(name, preferred):
    ratio, cos = PLACES[name]
    light = Light(ratio)
    n = tilted(cos) if preferred else NONE
    q, d, distance, pdf = light("sample", NONE, n, random_numbers(20_000, 3))
    back = light("pdf", NONE, n, q)
    q, d, distance, pdf, back = (np.array(a, np.float64) for a in (q, d, distance, pdf, back))
    gap = abs(ratio - 1) if ratio else 1  # to the surface, for which the rounding of a point counts
    reach = max(ratio, 1)
    assert (distance > 0).all()
    np.testing.assert_allclose(np.linalg.norm(q.T - light.centre, axis=-1), 1, rtol=16 * EPS * reach)
    np.testing.assert_allclose(distance * d, q, atol=16 * EPS * reach)
    np.testing.assert_allclose(np.linalg.norm(d, axis=0), 1, rtol=8 * EPS)
    seen = (q.T - light.centre) * -d.T
    assert (
        (seen.sum(-1) > -1e-3) == (ratio > 1)
    ).all()  # the near side from outside, the far side from inside
    np.testing.assert_allclose(
        back[pdf > 0.01], pdf[pdf > 0.01], rtol=(2000 if preferred else 8) * EPS * reach / gap
    )


def cone_cells(light, ratio, k, parts):
    """The points of the sphere in the middles of parts of k x k cells that have the same solid angle each.

    Returns:
        The points [k * parts, k * parts, 3], the solid angle of a cell, and from points to cells.
    """
    s = 1 / ratio if ratio > 1 else 0
    height = s * s / (1 + np.sqrt(1 - s * s)) if ratio > 1 else 2
    x = unit(np.cross(AXIS, [0.3, 0.1, 0.2]))
    y, axis = np.cross(AXIS, x), unit(AXIS)
    middle = (np.arange(k * parts) + 0.5) / (k * parts)
    cap, phi = np.meshgrid(height * middle, 2 * np.pi * middle, indexing="ij")
    sin = np.sqrt(cap * (2 - cap))
    d = (1 - cap)[..., None] * axis + (sin * np.cos(phi))[..., None] * x + (sin * np.sin(phi))[..., None] * y
    b = d @ light.centre
    root = np.sqrt(np.maximum(light.radius**2 - light.centre @ light.centre + b * b, 0))
    q = d * (b - root if ratio > 1 else b + root)[..., None]

    def cell(d):
        across = np.stack([d @ x, d @ y])
        z = d @ axis
        cap = np.where(z > 0, (across**2).sum(0) / (1 + abs(z)), 1 - z)
        i = np.clip(cap / height * k, 0, k - 1).astype(int)
        return i, np.clip(np.arctan2(across[1], across[0]) / (2 * np.pi) % 1 * k, 0, k - 1).astype(int)

    return q, 2 * np.pi * height / k**2, cell


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("preferred", [False, True])
def test_samples_follow_the_density(name, preferred):
    """24 tests of level 1e-4: 0.24 %; the density integrates to 1."""
    ratio, cos = PLACES[name]
    if name == "very small":  # in doubles the cells' points are on it only to 1e-8 of the distance
        ratio = 1e3
    light, count, k, parts = Light(ratio), 100_000, 12, 16
    n = tilted(cos) if preferred else NONE
    q, omega, cell = cone_cells(light, ratio, k, parts)
    pdf = np.array(light("pdf", NONE, n, point(q.reshape(-1, 3))), np.float64)
    mass = pdf.reshape(k, parts, k, parts).mean((1, 3)) * omega
    assert abs(mass.sum() - 1) < 1e-3
    counts = np.zeros((k, k))
    np.add.at(counts, cell(np.array(light("sample", NONE, n, random_numbers(count, 5))[1], np.float64).T), 1)
    assert pooled_chi_square(counts.ravel(), mass.ravel() * count) > LEVEL
    if preferred and (ratio < 3):
        assert pooled_chi_square(counts.ravel(), np.full(k * k, count / k**2)) < 1e-10  # they aren't uniform


@pytest.mark.parametrize("cos", [0.4, 0.2, 0, -0.2])
def test_spread_where_the_horizon_cuts(cos):
    """Less than with a uniform density, whatever part is left."""
    light, n = Light(2), tilted(cos)
    _, spread, _ = moments(light, NONE, n)
    _, uniform, _ = moments(light, NONE, n, NONE)
    assert spread < 0.8 * uniform


def test_many_directions_and_sizes_at_once():
    """Geometry and receivers that differ from lane to lane."""
    count = 5000
    rng = np.random.default_rng(9)
    ratio = 1 + 10 ** rng.uniform(-2, 4, count)
    n, way = single(random_units(count, 1)), random_units(count, 2)
    centre = single(way * ratio[:, None])
    arguments = point(centre), mi.Float(np.ones(count, np.float32)), point(np.zeros((count, 3))), vector(n)
    q, d, _, pdf = sphere.sample(*arguments, random_numbers(count, 4))
    back = np.array(sphere.pdf(*arguments, q), np.float64)
    cos = (n * unit(centre)).sum(-1)
    whole = cos > 1.001 / np.linalg.norm(centre, axis=-1) + 1e-5
    estimate = (n * np.array(d, np.float64).T).sum(-1) / np.array(pdf, np.float64)
    exact = np.pi * cos / (centre**2).sum(-1)
    assert 1000 < whole.sum() < 4000
    np.testing.assert_allclose(estimate[whole], exact[whole], rtol=2e-4)
    np.testing.assert_allclose(np.array(sphere.irradiance(*arguments))[whole], exact[whole], rtol=1e-3)
    np.testing.assert_allclose(back[whole], np.array(pdf)[whole], rtol=1e-3)
