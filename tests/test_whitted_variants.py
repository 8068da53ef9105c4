"""`whitted` alone, nested, from XML and dicts, in each variant, with gradients, and through kernel caches."""

import gc

import mitsuba as mi
import numpy as np
import pytest
from pictures import same_light
from whitted_scenes import camera, room, transform

import whitted

VARIANTS = ["llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral"]
SHORT = {"type": "whitted", "max_depth": 4}


@pytest.fixture
def variant(request):
    mi.set_variant(request.param)
    yield request.param
    mi.set_variant("llvm_ad_rgb")


every_variant = pytest.mark.parametrize("variant", VARIANTS, indirect=True)


def image(scene, integrator, **options):
    return np.array(mi.render(scene, integrator=mi.load_dict(integrator), **options), np.float64)


# ---- Ways to call it


def test_from_xml_as_from_a_dict():
    xml = """
    <scene version="3.0.0">
        <integrator type="whitted">
            <integer name="max_depth" value="3"/>
            <float name="min_contribution" value="0.01"/>
            <boolean name="shadows" value="false"/>
            <boolean name="hide_emitters" value="true"/>
            <rgb name="ambient" value="0.1 0.2 1.4"/>
        </integrator>
        <shape type="sphere"/>
        <sensor type="perspective">
            <transform name="to_world"><lookat origin="0 0 5" target="0 0 0" up="0 1 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
        </sensor>
    </scene>"""
    scene = mi.load_string(xml, optimize=False)
    made = scene.integrator()
    assert (made.max_depth, made.min_contribution, made.shadows, made.hide_emitters) == (3, 0.01, False, True)
    ambient = {"type": "rgb", "value": [0.1, 0.2, 1.4]}
    same = {
        "type": "whitted",
        "max_depth": 3,
        "min_contribution": 0.01,
        "shadows": False,
        "hide_emitters": True,
    }
    found = np.array(mi.render(scene, spp=4))
    np.testing.assert_array_equal(found, np.float32(image(scene, same | {"ambient": ambient}, spp=4)))
    assert found[..., 2].max() == pytest.approx(0.7, rel=1e-3)
    assert "max_depth=3" in str(made)


def test_unknown_properties_are_refused():
    with pytest.raises(RuntimeError, match="max_dept"):
        mi.load_dict({"type": "whitted", "max_dept": 3})


@pytest.mark.parametrize("nested", ["moment", "aov"])
def test_nested_in_mitsubas_integrators_it_gives_the_same_mean(nested):
    outer = {"type": nested, "inner": SHORT} | ({"aovs": "depth:depth"} if nested == "aov" else {})
    same_light(room(), SHORT, outer, channels=slice(0, 3))


def test_nested_in_moment_its_second_moment_is_that_of_its_samples():
    inner = image(room(), {"type": "moment", "inner": SHORT}, spp=64)
    mean, second = inner[..., 3:6], inner[..., 6:9]
    assert (second >= mean**2 - 1e-4).all()
    assert (second > mean**2 + 1e-3).any()


def test_nested_with_many_lights():
    """The looped code path draws from a sampler, whose state the loop carries."""
    panels = {
        f"panel{i}": {
            "type": "rectangle",
            "to_world": transform().translate([i - 2, 2.5, 1]).rotate([1, 0, 0], 90).scale(0.3),
            "emitter": {"type": "area", "radiance": 1.0 + i},
        }
        for i in range(6)
    }
    floor = {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(3)}
    scene = mi.load_dict({"type": "scene", "sensor": camera(), "floor": floor, **panels}, optimize=False)
    same_light(scene, SHORT, {"type": "moment", "inner": SHORT}, channels=slice(0, 3))


# ---- Variants


@pytest.mark.parametrize("variant", VARIANTS[1:], indirect=True)
def test_in_other_variants_it_agrees_with_path(variant):
    scene = room(ball={"type": "roughconductor", "material": "Au"})
    same_light(scene, SHORT | {"max_depth": 2}, {"type": "path", "max_depth": 2}, spp=256)


def coloured(**film):
    """Coloured glass and a coloured mirror in a coloured room, lit by the sky alone."""
    glass = {"type": "dielectric", "specular_transmittance": {"type": "rgb", "value": [0.3, 0.6, 0.9]}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": camera(**film),
            "glass": {"type": "sphere", "center": [-0.5, 0.7, 0], "radius": 0.5, "bsdf": glass},
            "gold": {
                "type": "sphere",
                "center": [0.7, 0.7, 0],
                "radius": 0.5,
                "bsdf": {"type": "conductor", "material": "Au"},
            },
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.5, 0.7]}},
        },
        optimize=False,
    )


@every_variant
def test_specular_chains_agree_with_path_in_each_variant(variant):
    """Nothing scatters, so that `path` estimates the same light at each depth."""
    whitted = {"type": "whitted", "max_depth": 5, "min_contribution": 0.0}
    same_light(coloured(), whitted, {"type": "path", "max_depth": 5}, spp=256)


@pytest.mark.parametrize("variant", ["llvm_ad_spectral"], indirect=True)
def test_films_of_spectra(variant):
    band = {"type": "spectrum", "value": [(400, 0.0), (500, 1.0), (600, 0.0)]}
    film = {"type": "specfilm", "band": band, "width": 16, "height": 16, "rfilter": {"type": "box"}}
    sensor = camera() | {"film": film}
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor,
            "gold": {
                "type": "sphere",
                "center": [0, 0.7, 0],
                "radius": 0.6,
                "bsdf": {"type": "roughconductor"},
            },
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.5, 0.7]}},
        },
        optimize=False,
    )
    same_light(scene, SHORT | {"max_depth": 2}, {"type": "path", "max_depth": 2}, spp=256)


@every_variant
def test_ambient_light_is_a_uniform_sky_without_shadows(variant):
    """A floor under a sky of the same colour, nothing above it: an exact closed form in rgb, and here for all."""
    colour = {"type": "rgb", "value": [0.2, 0.3, 0.5]}
    floor = {
        "type": "rectangle",
        "to_world": transform().rotate([1, 0, 0], -90).scale(300),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.9, 0.5, 0.2]}},
    }
    down = camera() | {"to_world": transform().look_at([0, 2, 0.1], [0, 0, 0], [0, 0, 1])}
    bare = mi.load_dict({"type": "scene", "sensor": down, "floor": floor}, optimize=False)
    under_sky = mi.load_dict(
        {"type": "scene", "sensor": down, "floor": floor, "sky": {"type": "constant", "radiance": colour}},
        optimize=False,
    )
    spp = 64
    lit = image(under_sky, SHORT, spp=spp * 16).mean((0, 1))
    ambient = image(bare, SHORT | {"ambient": colour}, spp=spp).mean((0, 1))
    np.testing.assert_allclose(ambient, lit, rtol=0.01)
    if variant == "llvm_ad_rgb":
        np.testing.assert_allclose(ambient, [0.18, 0.15, 0.1], rtol=1e-5)


@every_variant
def test_render_in_each_variant(variant):
    done = whitted.render(room(), SHORT, spp=8)
    assert done.variant == variant
    assert done.mean.shape == (16, 16, 1 if "mono" in variant else 3)
    assert done.standard_error.shape == done.mean.shape
    alone = image(room(), SHORT, spp=8)
    np.testing.assert_allclose(done.mean, alone[..., : done.mean.shape[-1]], rtol=1e-4, atol=1e-5)
    assert done.to_dict()["truncation"]["by_depth"]["throughput_dropped"] > 0


def test_variants_take_turns_in_one_process():
    pictures = {}
    try:
        for name in (*VARIANTS, *VARIANTS):
            mi.set_variant(name)
            pictures.setdefault(name, []).append(whitted.render(room(), SHORT, spp=2).mean)
    finally:
        mi.set_variant("llvm_ad_rgb")
    for first, again in pictures.values():
        np.testing.assert_array_equal(first, again)


REFUSED = """
import sys
import whitted, mitsuba as mi
mi.set_variant(sys.argv[1])
try:
    scene = mi.load_dict({"type": "scene", "integrator": {"type": "whitted"}, "ball": {"type": "sphere"},
        "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}})
    mi.render(scene, spp=1)
except Exception as error:
    while error.__cause__:
        error = error.__cause__
    print(type(error).__name__, str(error).splitlines()[0])
"""


@pytest.mark.parametrize(
    ("name", "says"),
    [("scalar_rgb", "whitted"), ("llvm_ad_spectral_polarized", "polarised")],
)
def test_variants_that_cannot_work_say_so(python, name, says):
    if name not in mi.variants():
        pytest.skip(f"this Mitsuba has no variant {name}")
    done = python(REFUSED, name)
    assert done.returncode == 0, done.stderr
    assert says in done.stdout


# ---- Gradients


@pytest.fixture
def with_gradients():
    import drjit as dr

    scene = room()
    parameters = mi.traverse(scene)
    key = "floor.bsdf.reflectance.value"
    dr.enable_grad(parameters[key])
    parameters.update()
    return scene, parameters, key


def test_a_parameter_with_gradients_does_no_harm_in_the_primal(with_gradients):
    expected = image(room(), SHORT, spp=4)
    scene, *_ = with_gradients
    np.testing.assert_array_equal(image(scene, SHORT, spp=4), expected)
    np.testing.assert_allclose(whitted.render(scene, SHORT, spp=4).mean, expected, rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(np.array(mi.load_dict(SHORT).render(scene, spp=4)), np.float32(expected))


def test_gradients_are_refused_with_one_clear_error(with_gradients):
    import drjit as dr

    scene, parameters, _ = with_gradients
    picture = mi.render(scene, parameters, integrator=mi.load_dict(SHORT), spp=4)
    with pytest.raises(RuntimeError) as caught:
        dr.backward(dr.mean(picture, axis=None))
    error = caught.value
    while error.__cause__:
        error = error.__cause__
    assert "whitted has no gradients" in str(error)


# ---- Kernels


def test_depths_may_change_in_one_process(python):
    """The size of local memory is no part of the key under which Dr.Jit finds a compiled kernel again."""
    depths = (8, 50, 8, 3, 128, 20)
    script = """
import sys
from hashlib import sha256
import whitted, mitsuba as mi, drjit as dr
mi.set_variant("llvm_ad_rgb")
dr.set_thread_count(1)
sys.path.append(sys.argv[1])
from whitted_scenes import room
for depth in map(int, sys.argv[2:]):
    image = mi.render(room(), integrator=mi.load_dict({"type": "whitted", "max_depth": depth}), spp=4)
    print(depth, sha256(image.numpy().tobytes()).hexdigest())
"""
    from pathlib import Path

    together = python(script, Path(__file__).parent, *depths)
    assert together.returncode == 0, together.stderr
    found = set(together.stdout.splitlines())
    assert len(found) == len(set(depths))
    for depth in (8, 50):
        alone = python(script, Path(__file__).parent, depth)
        assert set(alone.stdout.splitlines()) <= found


def test_one_kernel_serves_all_values_of_parameters_and_seeds():
    gc.collect()  # objects of other scenes, while they live, are part of a kernel's virtual calls
    scene = room()
    whitted.render(scene, SHORT, spp=4)
    for options in ({"max_depth": 3}, {"min_contribution": 0.1}, {"max_depth": 5}):
        again = whitted.render(scene, SHORT | options, spp=4, seed=3)
        assert again.kernel["cache_hit"]
