"""The delta lobes that `whitted` follows are those that Mitsuba's BSDFs sample.

The truth is the full BSDF sampled 2^14 times, the number that chooses the lobe taken at equal steps: the mean weight
of the samples of one direction is exact to a step, so that nothing here fails by chance.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugins import of_kind

from whitted import lobes
from whitted.contents import bsdfs_of
from whitted.errors import UsageError
from whitted.world import World

SAMPLES = 1 << 14
STEP = 2 / SAMPLES

checkerboard = {"type": "checkerboard", "color0": 0.25, "color1": 0.75}
bent_normal = {"type": "rawconstant", "value": [0.6, 0.45, 0.95]}
dielectric = {"type": "dielectric", "specular_reflectance": {"type": "rgb", "value": [0.9, 0.6, 0.3]}}
conductor = {"type": "conductor", "material": "Au"}
plastic = {"type": "plastic"}
diffuse = {"type": "diffuse"}


def bumps():
    """Waves; a function, since there are no bitmaps before a variant is set."""
    u, v = np.meshgrid(np.arange(16), np.arange(16))
    height = (np.sin(u * 0.8) + np.cos(v * 0.6))[..., None].astype(np.float32)
    return {"type": "bitmap", "raw": True, "bitmap": mi.Bitmap(height)}


def made(spec):
    """Return the BSDF (or texture) of a dict, in which functions stand for what they return."""
    spec = spec() if callable(spec) else spec
    return mi.load_dict(
        {
            key: made(value) if isinstance(value, dict) or callable(value) else value
            for key, value in spec.items()
        }
    )


def mask(nested, opacity=0.3):
    return {"type": "mask", "opacity": opacity, "nested": nested}


def blend(first, second, weight=0.4):
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


def twosided(*sides):
    return {"type": "twosided"} | {f"side{i}": side for i, side in enumerate(sides)}


NOT_LOADED = {
    "measured": "needs a file of measurements; has one glossy lobe",
    "measured_polarized": "needs a file of measurements; polarised variants only",
}
PLUGINS = {
    "blendbsdf": blend(dielectric, conductor),
    "bumpmap": {"type": "bumpmap", "arbitrary": bumps, "nested": dielectric},
    "circular": {"type": "circular"},
    "conductor": conductor,
    "dielectric": dielectric,
    "diffuse": diffuse,
    "hair": {"type": "hair"},
    "mask": mask(diffuse),
    "normalmap": {"type": "normalmap", "normalmap": bent_normal, "nested": dielectric},
    "null": {"type": "null"},
    "plastic": plastic,
    "polarizer": {"type": "polarizer"},
    "pplastic": {"type": "pplastic"},
    "principled": {"type": "principled", "spec_trans": 0.5, "metallic": 0.2},
    "principledthin": {"type": "principledthin", "spec_trans": 0.5},
    "retarder": {"type": "retarder"},
    "roughconductor": {"type": "roughconductor"},
    "roughdielectric": {"type": "roughdielectric"},
    "roughplastic": {"type": "roughplastic"},
    "thindielectric": {"type": "thindielectric"},
    "twosided": twosided(plastic),
}
NESTED = {
    "mask(dielectric)": mask(dielectric),
    "mask(thindielectric)": mask({"type": "thindielectric"}),
    "mask(twosided)": mask(twosided(conductor)),
    "mask(mask)": mask(mask(plastic, 0.8), 0.6),
    "mask(blend)": mask(blend(dielectric, plastic)),
    "mask(textured)": mask(dielectric, checkerboard),
    "mask(normalmap)": mask(PLUGINS["normalmap"]),
    "blend(mask, conductor)": blend(mask(diffuse), conductor),
    "blend(dielectric, plastic)": blend(dielectric, plastic, checkerboard),
    "blend(null, dielectric)": blend({"type": "null"}, dielectric),
    "blend(blend, mask)": blend(blend(dielectric, diffuse), mask(conductor)),
    "blend(twosided, twosided)": blend(twosided(conductor), twosided(plastic)),
    "twosided(conductor)": twosided(conductor),
    "twosided(conductor, plastic)": twosided(conductor, plastic),
    "twosided(diffuse, conductor)": twosided(diffuse, conductor),
    "twosided(plastic, diffuse)": twosided(plastic, diffuse),
    "twosided(normalmap)": twosided({"type": "normalmap", "normalmap": bent_normal, "nested": conductor}),
    "twosided(bumpmap)": twosided({"type": "bumpmap", "arbitrary": bumps, "nested": plastic}),
    "normalmap(twosided(diffuse))": {
        "type": "normalmap",
        "normalmap": bent_normal,
        "nested": twosided(diffuse),
    },
    "bumpmap(conductor)": {"type": "bumpmap", "arbitrary": bumps, "nested": conductor},
    "normalmap(bumpmap)": {"type": "normalmap", "normalmap": bent_normal, "nested": PLUGINS["bumpmap"]},
    "blend(blend(null, conductor), dielectric)": blend(blend({"type": "null"}, conductor), dielectric),
    "blend(normalmap, bumpmap)": blend(PLUGINS["normalmap"], PLUGINS["bumpmap"]),
}
ALL = PLUGINS | NESTED
DIRECTIONS = [(0.1, 0.2, 0.9), (0.8, -0.3, 0.25), (-0.5, 0.3, -0.6), (0.2, 0.9, -0.15)]
UV = [(0.2, 0.3), (0.7, 0.3), (0.45, 0.8), (0.55, 0.6)]


def interaction(direction, uv, width):
    si = dr.zeros(mi.SurfaceInteraction3f, width)
    si.t = 1
    si.n = [0, 0, 1]
    si.sh_frame = mi.Frame3f([0, 0, 1])
    si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
    si.uv = mi.Point2f(uv)
    si.wi = dr.normalize(mi.Vector3f(direction))
    return si


def expected_lobes(spec, direction, uv):
    """Return the mean weight of each delta direction, from direction to weight.

    Adapters over a `blendbsdf` are taken apart here: Mitsuba 3.9.1 adds the density of a smooth child to that of
    a delta child, so that what it samples from such a blend is wrong.
    """
    si = interaction(direction, uv, 1)
    if spec["type"] == "blendbsdf":
        share = amount(spec["weight"], si)
        return mixed((spec["first"], 1 - share), (spec["second"], share), direction=direction, uv=uv)
    if spec["type"] == "mask" and spec["nested"]["type"] == "blendbsdf":
        opacity = amount(spec["opacity"], si)
        return mixed((spec["nested"], opacity), ({"type": "null"}, 1 - opacity), direction=direction, uv=uv)
    return sampled(made(spec), interaction(direction, uv, SAMPLES))


def amount(value, si):
    return value if isinstance(value, float) else float(made(value).eval_1(si)[0])


def mixed(*children, direction, uv):
    sums = {}
    for spec, share in children:
        for key, weight in expected_lobes(spec, direction, uv).items():
            sums[key] = sums.get(key, 0) + share * weight
    return sums


def sampled(bsdf, si):
    """Return what the BSDF itself samples."""
    rng = np.random.default_rng(1)
    first = mi.Float((np.arange(SAMPLES) + 0.5) / SAMPLES)
    bs, weight = bsdf.sample(mi.BSDFContext(), si, first, mi.Point2f(rng.random((2, SAMPLES))), True)
    is_delta = wide(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)).astype(bool)
    weight, wo, eta = wide(weight) / SAMPLES, wide(bs.wo), wide(bs.eta)
    return grouped(wo[is_delta], weight[is_delta], eta[is_delta])


def wide(value):
    """Return an array of Dr.Jit as ``float64`` with the lanes first."""
    value = np.array(value, np.float64)
    return np.broadcast_to(value, (*value.shape[:-1], SAMPLES)).T


def split(bsdf, si):
    """Return the same from the lobes that are followed."""
    found = lobes.delta_lobes(bsdf, si, mi.Bool(True))
    if not found:
        return {}
    weights = [np.array(weight, np.float64).T.reshape(-1, 3)[0] for _, weight, *_ in found]
    directions = [np.array(wo).T.reshape(-1, 3)[0] for wo, *_ in found]
    etas = [np.array(eta).ravel()[0] for _, _, eta, _ in found]
    return grouped(np.array(directions), np.array(weights), np.array(etas))


def grouped(directions, weights, etas):
    sums = {}
    for wo, weight, eta in zip(directions, weights, etas, strict=True):
        if weight.any():
            key = (*(round(float(c), 3) + 0.0 for c in wo), round(float(eta), 3))
            sums[key] = sums.get(key, 0) + weight
    return sums


@pytest.mark.parametrize("name", ALL)
def test_lobes_are_those_that_the_bsdf_samples(name):
    bsdf = made(ALL[name])
    lobes.check_supported(bsdf)
    seen = 0
    for direction, uv in zip(DIRECTIONS, UV, strict=True):
        expected = expected_lobes(ALL[name], direction, uv)
        found = split(bsdf, interaction(direction, uv, 1))
        for key in found.keys() | expected.keys():
            weights = found.get(key, np.zeros(3)), expected.get(key, np.zeros(3))
            np.testing.assert_allclose(*weights, atol=STEP, err_msg=str(key))
        seen = max(seen, len(found))
    assert seen <= lobes.count(bsdf)


def test_no_plugin_is_left_out():
    assert of_kind("BSDF") == PLUGINS.keys() | NOT_LOADED.keys()


STRAIGHT = {
    "null": 1,
    "mask": 0.7,
    "mask(mask)": 1 - 0.6 * 0.8,
    "mask(twosided)": 0.7,
    "blend(null, dielectric)": 0.6,
    "blend(mask, conductor)": 0.6 * 0.7,
    "blend(dielectric, plastic)": 0,
    "blend(blend, mask)": 0.4 * 0.7,
    "dielectric": 0,
    "twosided": 0,
    "hair": 0,
    "roughplastic": 0,
}


@pytest.mark.parametrize("name", STRAIGHT)
def test_light_passes_straight_through_by_the_share_that_is_known(name):
    bsdf = made(ALL[name])
    found = lobes.null_transmission(bsdf, interaction(DIRECTIONS[1], UV[1], 1), mi.Bool(True))
    np.testing.assert_allclose(np.array(found).ravel(), STRAIGHT[name], atol=1e-6)


@pytest.mark.parametrize(
    "name", ["null", "mask", "thindielectric", "mask(textured)", "polarizer", "circular"]
)
@pytest.mark.parametrize("direction", DIRECTIONS[::2])
def test_light_passes_straight_through_as_mitsuba_has_it(name, direction):
    bsdf = made(ALL[name])
    si = interaction(direction, UV[0], 1)
    found = lobes.null_transmission(bsdf, si, mi.Bool(True))
    expected = bsdf.eval_null_transmission(si)
    np.testing.assert_allclose(np.array(found).ravel(), np.array(expected).ravel(), atol=1e-6)
    assert np.array(found).any()


@pytest.mark.parametrize(
    "name", ["thindielectric", "mask(thindielectric)", "null", "mask(mask)", "blend(null, dielectric)"]
)
def test_shadow_rays_and_followed_rays_pass_alike(name):
    """The straight-through transmission is the weight of the null lobes together."""
    bsdf = made(ALL[name])
    si = interaction(DIRECTIONS[0], UV[0], 1)
    nulls = [
        np.array(w)
        for _, w, _, kind in lobes.delta_lobes(bsdf, si, mi.Bool(True))
        if kind == mi.BSDFFlags.Null
    ]
    through = np.array(lobes.null_transmission(bsdf, si, mi.Bool(True)))
    np.testing.assert_allclose(sum(nulls).ravel(), np.broadcast_to(through.ravel(), 3), atol=1e-6)


@pytest.mark.parametrize(
    ("outer", "inner"),
    [
        ("NormalMap", mask(dielectric)),
        ("NormalMap", blend(dielectric, plastic)),
        ("NormalMap", twosided(conductor)),
        ("BumpMap", mask(diffuse)),
    ],
)
def test_what_cannot_be_split_is_refused_by_name(outer, inner):
    shell = (
        {"type": "normalmap", "normalmap": bent_normal}
        if outer == "NormalMap"
        else {"type": "bumpmap", "arbitrary": bumps}
    )
    bsdf = made({**shell, "nested": inner})
    scene = mi.load_dict(
        {"type": "scene", "ball": {"type": "sphere", "bsdf": {"type": "mask", "the_coat": bsdf}}},
        optimize=False,
    )
    with pytest.raises(UsageError, match=f"the_coat.*{outer}"):
        World(scene)


def test_bsdfs_of_instances_are_found():
    scene = mi.load_dict(
        {
            "type": "scene",
            "group": {"type": "shapegroup", "ball": {"type": "sphere", "bsdf": mask(dielectric)}},
            "one": {"type": "instance", "group": {"type": "ref", "id": "group"}},
            "plain": {"type": "sphere", "bsdf": {"type": "conductor"}},
        },
        optimize=False,
    )
    assert {"MaskBSDF", "SmoothConductor"} <= {bsdf.class_name() for bsdf in bsdfs_of(scene)}
    assert World(scene).branching == 3
    assert World(scene).is_transparent


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("diffuse", [0.5, 0.5, 0.5]),
        ("mask", [0.15, 0.15, 0.15]),
        ("twosided(plastic, diffuse)", None),
        ("conductor", [0, 0, 0]),
        ("blend(blend, mask)", [0.5 * 0.6 * 0.4] * 3),
        ("roughconductor", [0, 0, 0]),
    ],
)
def test_diffuse_reflectance_is_that_of_the_diffuse_lobes(name, expected):
    bsdf = made(ALL[name])
    front, back = (interaction((0.1, 0.2, z), UV[0], 1) for z in (0.9, -0.9))
    if expected is None:
        assert np.array(lobes.diffuse_reflectance(bsdf, front, mi.Bool(True))).ravel()[0] > 0.2
        front, expected = back, [0.5, 0.5, 0.5]
    found = np.array(lobes.diffuse_reflectance(bsdf, front, mi.Bool(True))).ravel()
    np.testing.assert_allclose(np.broadcast_to(found, 3), expected, atol=1e-6)
