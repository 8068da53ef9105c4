"""Rays and surfaces, textbook form and stable form: properties that hold for any input, in both precisions."""

from fractions import Fraction

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whitted.geometry import arithmetic, box, plane, polygon, sphere, triangle
from whitted.hardcases.meshes import icosphere

COUNT = 1 << 14  # values of one example, so that each property is tried more than 10^4 times
U = {"single": 2.0**-24, "double": 2.0**-53}
some = settings(max_examples=4, deadline=None, derandomize=True)
seeds = given(st.integers(0, 2**32 - 1))
precisions = pytest.mark.parametrize("precision", ["single", "double"])


def number(x, precision):
    return mi.Float32(np.float32(x)) if precision == "single" else mi.Float64(np.float64(x))


def vector(x, precision):
    return mi.Vector3f(np.float32(x)) if precision == "single" else mi.Vector3d(np.float64(x))


def wide(rng, *shape, decades=6):
    """Numbers of all sizes and either sign."""
    return rng.choice([-1, 1], shape) * 10 ** rng.uniform(-decades, decades, shape)


def directions(rng, count=COUNT):
    d = rng.standard_normal((3, count))
    return d / np.linalg.norm(d, axis=0)


def back(x):
    return np.array(x, np.longdouble)


# ---- Arithmetic


@precisions
@some
@seeds
def test_sums_and_products_and_their_errors_are_exact(precision, seed):
    rng = np.random.default_rng(seed)
    a, b = (number(wide(rng, COUNT), precision) for _ in range(2))
    for exact, (found, error) in (
        (lambda x, y: x + y, arithmetic.two_sum(a, b)),
        (lambda x, y: x * y, arithmetic.two_product(a, b)),
    ):
        rows = zip(*(np.array(x).tolist() for x in (a, b, found, error)), strict=True)
        for x, y, s, e in list(rows)[:1000]:
            assert exact(Fraction(x), Fraction(y)) == Fraction(s) + Fraction(e)


@precisions
@some
@seeds
def test_differences_of_products_have_the_right_sign_and_digits(precision, seed):
    """Products that are equal but for a rounding or two, as areas of triangles that a ray hits at an edge."""
    rng = np.random.default_rng(seed)
    a, b, c = (number(wide(rng, 2000, decades=2), precision) for _ in range(3))
    d = a * b / c
    found = arithmetic.difference_of_products(a, b, c, d)
    for *factors, value in zip(*(np.array(x).tolist() for x in (a, b, c, d, found)), strict=True):
        a_, b_, c_, d_ = map(Fraction, factors)
        exact = a_ * b_ - c_ * d_
        assert abs(Fraction(value) - exact) <= 3 * Fraction(U[precision]) * abs(exact)


@some
@seeds
def test_sums_of_products_are_as_in_double_precision(seed):
    rng = np.random.default_rng(seed)
    rows = np.float32(wide(rng, 6, COUNT, decades=3))
    found = arithmetic.sum_of_products(*((mi.Float(rows[i]), mi.Float(rows[i + 3])) for i in range(3)))
    products = np.longdouble(rows[:3]) * rows[3:]
    bound = 2.0**-24 * abs(products.sum(0)) + 2.0**-43 * abs(products).sum(0)
    assert (abs(np.array(found) - products.sum(0)) <= bound).all()


# ---- Spheres


@precisions
@some
@seeds
def test_hits_lie_on_the_sphere(precision, seed):
    rng = np.random.default_rng(seed)
    centre, radius = rng.uniform(-3, 3, (3, COUNT)), 10 ** rng.uniform(-3, 1, COUNT)
    o = centre + directions(rng) * radius * rng.uniform(0, 20, COUNT)
    d = centre + 0.9 * radius * directions(rng) - o
    o, d, centre = (vector(x, precision) for x in (o, d, centre))
    r = number(radius, precision)
    for t in sphere.roots(o, d, centre, r):
        p = back(sphere.on_surface(o + d * t, centre, r)) - back(centre)
        scale = abs(back(centre)).max(0) + radius
        assert (abs(np.sqrt((p * p).sum(0)) - back(r)) <= 8 * U[precision] * scale).all()
        # the hit itself is off by roundings of the way, of the coordinates, and where the sphere is grazed of both
        way = np.sqrt(((back(o) - back(centre)) ** 2).sum(0)) + 4 * scale
        q = back(o) + back(d) * back(t) - back(centre)
        assert (abs(np.sqrt((q * q).sum(0)) - back(r)) <= 64 * U[precision] * way).all()


@some
@seeds
def test_both_forms_agree_where_nothing_cancels(seed):
    rng = np.random.default_rng(seed)
    o = 3 * directions(rng)
    o, d = vector(o, "double"), vector(0.5 * directions(rng) - o, "double")
    plain, stable = sphere.textbook_roots(o, d, 0, 1), sphere.roots(o, d, 0, 1)
    np.testing.assert_allclose(np.array(plain), np.array(stable), rtol=1e-13)


# ---- Planes


@precisions
@some
@seeds
def test_hits_lie_on_the_plane(precision, seed):
    rng = np.random.default_rng(seed)
    n, d = directions(rng), directions(rng)
    o, h = rng.uniform(-5, 5, (3, COUNT)), rng.uniform(-5, 5, COUNT)
    o, d, n, h = vector(o, precision), vector(d, precision), vector(n, precision), number(h, precision)
    t = back(plane.distance(o, d, n, h))
    slope = (back(n) * back(d)).sum(0)
    residual = (back(n) * (back(o) + t * back(d))).sum(0) - back(h)
    rounding = 8 * np.finfo(np.longdouble).eps * (abs(t) + 10)  # of the residual itself
    assert (abs(residual) <= 4 * U[precision] * abs(t * slope) + rounding).all()


# ---- Triangles


@precisions
@some
@seeds
def test_barycentric_coordinates_give_the_point_of_the_ray(precision, seed):
    rng = np.random.default_rng(seed)
    v = rng.uniform(-1, 1, (3, 3, COUNT))
    u = rng.dirichlet((1, 1, 1), COUNT).T
    o = 3 * directions(rng)
    d = np.einsum("kn,kin->in", u, v) - o
    o, d, *v = (vector(x, precision) for x in (o, d, *v))
    met, t, b1, b2 = (np.array(x) for x in triangle.hit(o, d, *v))
    assert met.mean() > 0.999, "aimed at the inside, but for what rounding does at edges"
    p = (1 - b1 - b2) * back(v[0]) + b1 * back(v[1]) + b2 * back(v[2])
    error = abs(p - back(o) - t * back(d)).max(0)
    n = np.cross(back(v[1]) - back(v[0]), back(v[2]) - back(v[0]), axis=0)
    slope = abs((n * back(d)).sum(0)) / np.linalg.norm(np.float64(n * n), axis=0) ** 0.5
    assert (error[met] <= 200 * U[precision] / np.maximum(slope[met], 1e-6)).all()
    assert ((b1 >= 0) & (b2 >= 0) & (b1 + b2 <= 1 + 4 * U[precision]))[met].all()


@some
@seeds
def test_a_closed_mesh_is_left_once_from_its_inside(seed):
    """Whatever the ray aims at: each of all triangles is tried."""
    rng = np.random.default_rng(seed)
    vertices, faces = icosphere(1)
    vertices = np.float32(vertices * 10 ** rng.uniform(-3, 3) + rng.uniform(-1, 1, (3, 1)))
    middle = vertices.mean(axis=1, dtype=np.float64)
    size = np.ptp(vertices)
    # towards vertices, edges, and anywhere
    corner = vertices[:, rng.integers(vertices.shape[1], size=COUNT)]
    ends = vertices[:, faces[:2, rng.integers(faces.shape[1], size=COUNT)]]
    edge = ends[:, 0] + rng.random(COUNT) * (ends[:, 1] - ends[:, 0])
    anywhere = middle[:, None] + directions(rng) * size
    target = np.choose(rng.integers(3, size=COUNT), [corner, edge, anywhere])
    o = np.float32(middle[:, None] + 0.2 * size * rng.uniform(-1, 1, (3, COUNT)))
    o, d = mi.Vector3f(o), mi.Vector3f(np.float32(target - o))
    count = mi.UInt32(0)
    for face in faces.T:
        met, t, *_ = triangle.hit(o, d, *(mi.Vector3f(*map(float, vertices[:, k])) for k in face))
        count += dr.select(met & (t > 0), mi.UInt32(1), 0)
    assert (np.array(count) == 1).all()


@precisions
@some
@seeds
def test_normals_are_unit_and_orthogonal_to_the_edges(precision, seed):
    rng = np.random.default_rng(seed)
    v0, v1, v2 = (vector(rng.uniform(-1, 1, (3, COUNT)), precision) for _ in range(3))
    n = back(triangle.normal(v0, v1, v2))
    assert (abs(np.sqrt((n * n).sum(0)) - 1) <= 4 * U[precision]).all()
    e1, e2 = back(v1 - v0), back(v2 - v0)
    lengths = [np.sqrt((e * e).sum(0)) for e in (e1, e2)]
    area = np.sqrt((np.cross(e1, e2, axis=0) ** 2).sum(0))
    for edge, length in zip((e1, e2), lengths, strict=True):
        bound = 8 * U[precision] * length * lengths[0] * lengths[1] / area
        assert (abs((n * edge).sum(0)) <= bound + 4 * U[precision] * length).all()


# ---- Boxes and polygons


@some
@seeds
def test_whoever_meets_a_box_meets_the_boxes_around_it(seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-1, 1, (3, COUNT))
    high = low + rng.choice([0, 1e-3, 1], (3, COUNT)) * rng.random((3, COUNT))
    outer_low, outer_high = low - rng.choice([0, 0.3], (3, COUNT)), high + rng.choice([0, 0.3], (3, COUNT))
    o = 4 * directions(rng)
    o = np.where(rng.random((3, COUNT)) < 0.2, low, o)  # in the plane of a face
    d = np.where(rng.random((3, COUNT)) < 0.2, 0, low + rng.random((3, COUNT)) * (high - low) - o)
    o, d = vector(o, "single"), vector(d, "single")
    inner = box.span(o, d, vector(low, "single"), vector(high, "single"))
    outer = box.span(o, d, vector(outer_low, "single"), vector(outer_high, "single"))
    met = np.array(inner[0] <= inner[1])
    assert met.mean() > 0.2
    assert np.array(outer[0] <= outer[1])[met].all()


@some
@seeds
def test_a_point_is_inside_one_of_two_polygons_that_share_an_edge(seed):
    rng = np.random.default_rng(seed)
    left, right = [(0, 0), (5, 0), (6, 4), (5, 9), (0, 9)], [(5, 0), (11, 0), (11, 9), (5, 9), (6, 4)]
    whole = [(0, 0), (5, 0), (11, 0), (11, 9), (5, 9), (0, 9)]
    x, y = (mi.Float(np.float32(rng.integers(-1, 13, COUNT) / 2)) for _ in range(2))
    a, b, both = (np.array(polygon.inside(x, y, corners)) for corners in (left, right, whole))
    assert not (a & b).any()
    assert ((a | b) == both).all()


@some
@seeds
def test_transforms_and_their_inverses_agree(seed):
    rng = np.random.default_rng(seed)
    axis, angle = directions(rng), rng.uniform(0, 360, COUNT)
    to_world = (
        mi.Transform4f()
        .translate(vector(rng.uniform(-1, 1, (3, COUNT)), "single"))
        .rotate(vector(axis, "single"), mi.Float(np.float32(angle)))
        .scale(vector(10 ** rng.uniform(-1, 1, (3, COUNT)), "single"))
    )
    p = mi.Point3f(np.float32(rng.uniform(-1, 1, (3, COUNT))))
    there = to_world @ p
    assert np.abs(np.array(to_world.inverse() @ there) - np.array(p)).max() <= 10 * 64 * 2.0**-24
