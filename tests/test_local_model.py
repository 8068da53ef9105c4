"""The classical illumination of the integrator `whitted`: its closed form, what it leaves alone, how it is named."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from phong_oracle import LOBES, power, register
from whitted_scenes import camera, transform

import whitted
from whitted import optics
from whitted.path_classes import compare_classes
from whitted.sampling.draws import Draws
from whitted.world import World

LIGHT, INTENSITY = np.array([0.5, 0.2, 2.5]), 3.0
POINTS = np.array([[0, 0, 0], [0.4, 0.1, 0], [-1.5, 2, 0], [1.0, 0.2, 0]])
# near the mirror direction of the light, further from it from point to point
EYES = POINTS + (LIGHT - POINTS) * [-1, -1, 1] + np.array([[0.02, 0, 0], [0.1, 0, 0], [0, 0.4, 0], [1, 0, 0]])
KD, KS = np.array([0.5, 0.3, 0.2]), np.array([0.3, 0.4, 0.1])


@pytest.fixture(autouse=True)
def registered(llvm_ad_rgb):
    register()


def rgb(values):
    return {"type": "rgb", "value": [float(x) for x in values]}


def phong(n=40.0, kd=KD, ks=KS, lobe="phong"):
    return {
        "type": "phong",
        "diffuse_reflectance": rgb(kd),
        "specular_reflectance": rgb(ks),
        "shininess": float(n),
        "lobe": lobe,
    }


def scene(bsdf, **things):
    light = {"type": "point", "position": list(LIGHT), "intensity": INTENSITY}
    floor = {"type": "rectangle", "to_world": transform().scale(10), "bsdf": bsdf}
    return mi.load_dict({"type": "scene", "light": light, "floor": floor, **things}, optimize=False)


def radiance(scene, origins=EYES, targets=POINTS, **properties):
    """What `whitted` finds along rays, [N, 3], bit by bit the same from call to call."""
    integrator = mi.load_dict({"type": "whitted", **properties})
    origins, targets = (mi.Point3f(np.float32(points).T) for points in (origins, targets))
    number = dr.arange(mi.UInt32, dr.width(targets))
    draws = Draws(number, dr.zeros(mi.UInt32, dr.width(targets)), mi.UInt32(3), number)
    ray = mi.Ray3f(origins, dr.normalize(targets - origins))
    found = integrator.estimate(World(scene), ray, draws)
    return np.array(found["radiance"]).T


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def classic(n, lobe="phong", kd=KD, ks=KS):
    """I (kd n.l + ks (r.v)^n) at the points, [4, 3]; I is the irradiance that faces the light, over pi."""
    to_light, to_eye = unit(LIGHT - POINTS), unit(EYES - POINTS)
    irradiance = INTENSITY / ((LIGHT - POINTS) ** 2).sum(1)
    highlight = [power(lobe, wi, wo, n) for wi, wo in zip(to_eye, to_light, strict=True)]
    return irradiance[:, None] / np.pi * (kd * to_light[:, 2:] + ks * np.array(highlight)[:, None])


# ---- The formula


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [1.0, 40.0, 5000.0])
def test_classical_illumination(lobe, n):
    lit = scene(phong(n, lobe=lobe))
    found = radiance(lit, local_model="classic")
    np.testing.assert_allclose(found, classic(n, lobe), rtol=2e-4)
    with_cosine = radiance(lit)
    assert (np.abs(with_cosine / classic(n, lobe) - 1) > 0.01).any()


def test_the_diffuse_part_is_that_of_the_bsdf():
    lit = scene(phong(ks=[0, 0, 0]))
    np.testing.assert_array_equal(radiance(lit, local_model="classic"), radiance(lit))
    np.testing.assert_allclose(radiance(lit), classic(40, ks=0), rtol=1e-5)


def test_a_light_behind_the_surface_gives_no_highlight():
    lit = scene(phong(1.0), occluder={"type": "sphere", "center": [0, 0, 50], "radius": 1.0})
    parameters = mi.traverse(lit)
    parameters["light.position"] = mi.Point3f(0.5, 0.2, -2.5)
    parameters.update()
    assert not radiance(lit, local_model="classic", shadows=False).any()


def test_ambient_and_shadows_are_as_before():
    lit = scene(phong())
    ambient = rgb([0.1, 0.2, 0.4])
    found = radiance(lit, local_model="classic", ambient=ambient)
    np.testing.assert_allclose(
        found - radiance(lit, local_model="classic"), np.tile(KD * [0.1, 0.2, 0.4], (4, 1)), rtol=1e-4
    )
    ball = {"type": "sphere", "center": list((POINTS[1] + LIGHT) / 2), "radius": 0.1}
    shadowed = radiance(scene(phong(), ball=ball), local_model="classic")
    assert not shadowed[1].any()
    np.testing.assert_array_equal(shadowed[2], radiance(lit, local_model="classic")[2])


def test_an_area_light_is_summed_up():
    """One of small extent, 1e-3 at distance 2.5, is a point light with the intensity radiance * area * cosine."""
    side = 1e-3
    to_world = transform().translate(list(LIGHT)).rotate([1, 0, 0], 180).scale(side)
    panel = {"type": "rectangle", "to_world": to_world, "emitter": {"type": "area", "radiance": 1e6}}
    floor = {"type": "rectangle", "to_world": transform().scale(10), "bsdf": phong()}
    lit = mi.load_dict({"type": "scene", "panel": panel, "floor": floor}, optimize=False)
    cos = unit(LIGHT - POINTS)[:, 2:]
    expected = classic(40) * (1e6 * (2 * side) ** 2 / INTENSITY) * cos
    np.testing.assert_allclose(radiance(lit, local_model="classic"), expected, rtol=5e-3)


# ---- Adapters and other BSDFs

GREY = {"type": "diffuse", "reflectance": 0.3}


def adapters():
    flat = {"type": "bitmap", "bitmap": mi.Bitmap(np.zeros((4, 4, 1), np.float32)), "raw": True}
    return {
        "twosided": ({"type": "twosided", "nested": phong()}, 1.0, 0.0),
        "mask": ({"type": "mask", "opacity": 0.4, "nested": phong()}, 0.4, 0.0),
        "blendbsdf": ({"type": "blendbsdf", "weight": 0.25, "a": phong(), "b": GREY}, 0.75, 0.25),
        "bumpmap": ({"type": "bumpmap", "bump": flat, "nested": phong()}, 1.0, 0.0),
        "all": (
            {
                "type": "mask",
                "opacity": 0.4,
                "m": {"type": "twosided", "n": {"type": "bumpmap", "b": flat, "n": phong()}},
            },
            0.4,
            0.0,
        ),
    }


@pytest.mark.parametrize("name", ["twosided", "mask", "blendbsdf", "bumpmap", "all"])
def test_inside_an_adapter(name):
    bsdf, share, rest = adapters()[name]
    expected = share * classic(40) + rest * classic(40, kd=0.3, ks=0)
    np.testing.assert_allclose(radiance(scene(bsdf), local_model="classic"), expected, rtol=1e-4)


OTHERS = {
    "diffuse": {},
    "plastic": {},
    "roughplastic": {},
    "conductor": {},
    "roughconductor": {"alpha": 0.3},
    "dielectric": {},
    "roughdielectric": {"alpha": 0.3},
    "thindielectric": {},
    "principled": {"roughness": 0.4},
    "principledthin": {"roughness": 0.4, "diff_trans": 0.5},
    "pplastic": {},
}


@pytest.mark.parametrize("kind", OTHERS)
def test_other_bsdfs_keep_their_own(kind):
    lit = scene({"type": kind, **OTHERS[kind]}, sky={"type": "constant", "radiance": 0.4})
    np.testing.assert_array_equal(radiance(lit, local_model="classic"), radiance(lit))


KERNELS = """
import gc, sys
import whitted, mitsuba as mi, drjit as dr
mi.set_variant("llvm_ad_rgb")
sys.path.append(sys.argv[1])
from phong_oracle import register
from test_local_model import phong, scene
from whitted_scenes import camera
register()

def kernels(scene, **properties):
    integrator = mi.load_dict({"type": "whitted", **properties})
    gc.collect()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        dr.eval(mi.render(scene, integrator=integrator, spp=1))
        return {entry["hash"] for entry in dr.kernel_history((dr.KernelType.JIT,))}

for bsdf in ({"type": "diffuse"}, phong()):
    lit = scene(bsdf, sensor=camera(size=8))
    default = kernels(lit)
    assert default == kernels(lit)
    print(kernels(lit, local_model="bsdf") == default, kernels(lit, local_model="classic") == default)
"""


def test_the_kernel_of_the_default_is_untouched(python, request):
    """In a process of its own, swept before each render: objects of scenes still alive have a part in kernels."""
    done = python(KERNELS, request.path.parent)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True", "True", "True", "False"]


# ---- That it is said


def test_not_comparable_with_path():
    lit = scene(phong(), sensor=camera(size=8))
    found = whitted.check(lit, "whitted:local_model=classic,max_depth=2", "path:max_depth=2")
    assert found.verdict == "not comparable"
    assert "P L" in found.reason
    assert "E D L" in found.reason


def test_comparable_where_nothing_differs():
    lit = scene(phong(), sensor=camera(size=8))
    bsdf, same, classical, again = (
        mi.load_dict({"type": "whitted", "local_model": model})
        for model in ("bsdf", "bsdf", "classic", "classic")
    )
    assert compare_classes(lit, lit.sensors()[0], bsdf, same).comparable
    assert compare_classes(lit, lit.sensors()[0], classical, again).comparable
    assert not compare_classes(lit, lit.sensors()[0], classical, bsdf).comparable


def test_the_model_is_named():
    assert "local_model=classic" in str(mi.load_dict({"type": "whitted", "local_model": "classic"}))
    with pytest.raises(RuntimeError, match="local_model is 'phong'; accepted are bsdf and classic"):
        mi.load_dict({"type": "whitted", "local_model": "phong"})


def test_a_context_asks_for_all_lobes_in_both_models():
    kinds = [kind for kind in dir(mi.BSDFFlags) if kind[0].isupper()]
    for model in optics.LOCAL_MODELS:
        context = optics.bsdf_context(model)
        assert optics.is_classic(context) == (model == "classic")
        assert all(context.is_enabled(getattr(mi.BSDFFlags, kind)) for kind in kinds[:1])
    taken = max(int(getattr(mi.BSDFFlags, kind)) for kind in kinds)
    assert taken < optics.CLASSIC, "the bit is free"
