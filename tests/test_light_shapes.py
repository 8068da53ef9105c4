"""What holds for all shapes of light: nothing that isn't finite, and any way of calling gives the same."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from lights import point, random_numbers, random_units, unit, vector

from whitted.lights import disk, rectangle, sphere, triangle

MODULES = {"rectangle": rectangle, "triangle": triangle, "disk": disk, "sphere": sphere}


def geometry(name, scale=1.0, flat=1.0):
    """A light of a size at a distance of 1; with ``flat`` 0 it has no area."""
    o = np.array([0.2, -0.3, 1.0])
    x, y = scale * np.array([1.0, 0, 0]), scale * flat * np.array([0, 0.8, 0.6])
    return {
        "rectangle": (point(o), vector(x), vector(y)),
        "triangle": (point(o), point(o + x), point(o + y)),
        "disk": (point(o), mi.Vector3f(0, -0.6, 0.8), mi.Float(scale * flat)),
        "sphere": (point(o), mi.Float(scale * flat)),
    }[name]


RECEIVERS = {  # degenerate ones
    "on a corner, the middle or the centre": [(0.2, -0.3, 1)],
    "on the light": [(0.3, -0.3 + 0.08, 1 + 0.06), (0.3, -0.3, 1), (0.4, -0.22, 1.06)],
    "in its plane": [(2, -0.3, 1), (0.2, -1.1, 0.4), (-3, -0.3 + 0.8, 1.6)],
    "almost in its plane": [(2, -0.3, 1 + 1e-7), (0.2, -1.1, 0.4000002), (0.3, -0.2200001, 1.06)],
    "far": [(1e6, 0, 0), (0, 1e8, 1e8), (1e15, 1e15, 0)],
}
NORMALS = [(0, 0, 0), (0, 0, 1), (0, 0, -1), (1, 0, 0), tuple(unit([0.3, -0.5, 0.2]))]


def everything(name, arguments, p, n, u):
    """All numbers that the functions of a shape return, and the densities."""
    module = MODULES[name]
    q, d, distance, pdf = module.sample(*arguments, p, n, u)
    back = module.pdf(*arguments, p, n, q)
    numbers = [*q, *d, distance, pdf, back, module.irradiance(*arguments, p, n)]
    return (
        np.array([np.array(a, np.float64) + np.zeros(dr.width(u)) for a in numbers]),
        np.array(pdf),
        np.array(back),
    )


@pytest.mark.parametrize("name", MODULES)
@pytest.mark.parametrize("receiver", RECEIVERS)
@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3, 1e-12])
def test_degenerate_receivers_give_finite_numbers(name, receiver, scale):
    u = random_numbers(200, 1)
    for p in RECEIVERS[receiver]:
        for n in NORMALS:
            numbers, pdf, back = everything(name, geometry(name, scale), point(p), vector(n), u)
            assert np.isfinite(numbers).all(), (p, n)
            assert (pdf >= 0).all()
            assert (back >= 0).all()


@pytest.mark.parametrize("name", MODULES)
@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_lights_without_area_are_not_sampled(name, scale):
    """Of no size at all, or with one extent 0."""
    u = random_numbers(200, 1)
    for p in ((0, 0, 0), (0.2, -0.3, 1), (1, 2, 3)):
        for n in NORMALS:
            numbers, pdf, back = everything(name, geometry(name, scale, flat=0), point(p), vector(n), u)
            assert np.isfinite(numbers).all(), (p, n)
            assert (pdf == 0).all()
            assert (back == 0).all()
            assert (numbers[-1] == 0).all()


@pytest.mark.parametrize("name", [name for name in MODULES if name != "sphere"])
def test_lights_edge_on_are_not_sampled(name):
    arguments = {
        "rectangle": (point((1, -1, 0)), vector((1, 0, 0)), vector((0, 2, 0))),
        "triangle": (point((1, -1, 0)), point((2, -1, 0)), point((1, 1, 0))),
        "disk": (point((2, 0, 0)), mi.Vector3f(0, 0, 1), mi.Float(1)),
    }[name]
    for n in NORMALS:
        numbers, pdf, back = everything(name, arguments, point((0, 0, 0)), vector(n), random_numbers(200, 1))
        assert np.isfinite(numbers).all()
        assert (pdf == 0).all()
        assert (back == 0).all()
        assert (abs(numbers[-1]) < 1e-6).all()


@pytest.mark.parametrize("name", MODULES)
@pytest.mark.parametrize("scale", [2.0**-20, 2.0**-10, 2.0**13, 2.0**20])
def test_scale_changes_nothing(name, scale):
    """With all lengths scaled, irradiance and density stay what they are."""
    arguments, p, n = lanes(name, 500)
    larger = [scale * a if k == 0 or not (name == "disk" and k == 1) else a for k, a in enumerate(arguments)]
    u = random_numbers(500, 8)
    here, pdf, _ = everything(name, arguments, p, n, u)
    there, scaled, _ = everything(name, larger, scale * p, n, u)
    np.testing.assert_allclose(scaled, pdf, rtol=1e-6)
    np.testing.assert_allclose(there[-1], here[-1], rtol=1e-6)
    np.testing.assert_allclose(there[3:6], here[3:6], atol=1e-6)


@pytest.mark.parametrize("name", MODULES)
def test_extreme_numbers(name):
    """Zero and the largest number below one give points of the light with a density, or with the density 0."""
    ends = np.float32([0, 1e-8, 0.5, 1 - 2.0**-24])
    u = mi.Point2f(*np.meshgrid(ends, ends)[0].reshape(1, -1), *np.meshgrid(ends, ends)[1].reshape(1, -1))
    for n in NORMALS[:2]:
        numbers, pdf, back = everything(name, geometry(name), point((0, 0, 0)), vector(n), u)
        assert np.isfinite(numbers).all()
        usable = pdf > 1e-4
        assert usable.any()
        np.testing.assert_allclose(back[usable], pdf[usable], rtol=1e-3)


def lanes(name, count):
    """Lights, receivers and normals that differ from lane to lane."""
    rng = np.random.default_rng(4)
    o, x = rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    y = np.cross(x, rng.normal(size=(count, 3)))
    arguments = {
        "rectangle": (point(o), vector(x), vector(y)),
        "triangle": (point(o), point(o + x), point(o + y)),
        "disk": (point(o), vector(unit(x)), mi.Float(np.float32(rng.exponential(size=count)))),
        "sphere": (point(o), mi.Float(np.float32(rng.exponential(size=count)))),
    }[name]
    n = random_units(count, 6)
    n[::5] = 0
    return arguments, point(rng.normal(size=(count, 3))), vector(n)


@pytest.mark.parametrize("name", MODULES)
def test_a_symbolic_loop_and_a_condition_give_the_same(name):
    count = 1000
    arguments, p, n = lanes(name, count)
    module, u = MODULES[name], random_numbers(count, 2)
    q, _, _, pdf = module.sample(*arguments, p, n, u)
    total = 2 * (pdf + module.pdf(*arguments, p, n, q) + module.irradiance(*arguments, p, n))

    def body(k, total, p, n, u, *arguments):
        def step(total, p, n, u, *arguments):
            q, _, _, pdf = module.sample(*arguments, p, n, u)
            return total + pdf + module.pdf(*arguments, p, n, q) + module.irradiance(*arguments, p, n)

        total = dr.if_stmt((total, p, n, u, *arguments), k < 2, step, lambda total, *_: total)
        return k + 1, total, p, n, u, *arguments

    state = (dr.zeros(mi.UInt32, count), dr.zeros(mi.Float, count), p, n, u, *arguments)
    looped = dr.while_loop(state, lambda k, *_: k < 3, body)[1]
    np.testing.assert_allclose(np.array(looped), np.array(total), rtol=1e-5)


@pytest.mark.parametrize("name", MODULES)
def test_many_lights_at_once_are_sampled_as_each_alone(name):
    arguments, p, n = lanes(name, 50)
    u = random_numbers(50, 2)
    together, _, _ = everything(name, arguments, p, n, u)
    for k in (0, 23, 49):

        def lane(a, k=k):
            return dr.gather(type(a), a, dr.opaque(mi.UInt32, k))

        alone, _, _ = everything(name, [lane(a) for a in arguments], lane(p), lane(n), lane(u))
        np.testing.assert_allclose(alone[:, 0], together[:, k], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", MODULES)
def test_another_light_takes_the_same_kernel(name):
    """Geometry that is data stays data."""

    def kernels(scale):
        arguments = geometry(name, scale)
        dr.make_opaque(arguments)
        p, n, u = point((0.1, 0, 0)), mi.Vector3f(0, 0, 1), random_numbers(64, 1)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            dr.eval(MODULES[name].sample(*arguments, p, n, u), MODULES[name].irradiance(*arguments, p, n))
            return {kernel["hash"] for kernel in dr.kernel_history((dr.KernelType.JIT,))}

    assert kernels(1.0) == kernels(0.5)


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_other_variants_give_the_same(variant):
    def numbers():
        return [
            everything(
                name, geometry(name), point((0, 0, 0.1)), vector((0, 0.6, 0.8)), random_numbers(50, 1)
            )[0]
            for name in MODULES
        ]

    here = numbers()
    mi.set_variant(variant)
    np.testing.assert_allclose(numbers(), here, rtol=1e-6)
