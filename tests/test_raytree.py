"""The recorded ray tree is that of the picture: the same light, the same rays."""

import json

import numpy as np
import pytest

import whitted
from whitted.errors import UsageError

SIZE = {"width": 24, "height": 24}
PIXELS = [(8, 9), (10, 14), (14, 12), (2, 2), (12, 20)]


@pytest.fixture(scope="module")
def scene():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    return whitted.load("whitted_1980", **SIZE)


@pytest.mark.parametrize("integrator", ["whitted", "whitted:max_depth=3", "whitted:min_contribution=0.02"])
def test_the_contributions_sum_to_the_pixel(scene, integrator):
    picture = whitted.render(scene, integrator, spp=1, seed=7).mean
    for x, y in PIXELS:
        tree = whitted.trace(scene, (x, y), integrator, seed=7)
        np.testing.assert_allclose(tree.radiance, picture[y, x], rtol=1e-5, atol=1e-7)


def test_the_rays_are_those_that_are_counted(scene):
    for x, y in PIXELS:
        tree = whitted.trace(scene, (x, y), "whitted:max_depth=1")
        assert tree.rays == {"eye": 1, "shadow": 0}
        tree = whitted.trace(scene, (x, y))
        # carried-on branches, which only measure what is lost, are counted by a render and aren't in the tree
        counted = whitted.render(scene, "whitted", spp=1, crop=(x, y, 1, 1)).rays
        for kind, number in tree.rays.items():
            assert number <= counted[kind]


def test_rays_given_up_are_listed_with_the_reason(scene):
    deep = whitted.trace(scene, PIXELS[0], "whitted:max_depth=3,min_contribution=0")
    assert {node["dropped"] for node in deep.nodes} == {None, "depth"}
    faint = whitted.trace(scene, PIXELS[0], "whitted:max_depth=8,min_contribution=0.1")
    assert "cutoff" in {node["dropped"] for node in faint.nodes}
    for node in deep.nodes + faint.nodes:
        if node["dropped"]:
            assert node["contribution"] == [0.0, 0.0, 0.0]
            assert node["distance"] is None


@pytest.mark.parametrize("max_depth", [0, 1])
def test_a_tree_without_depth_is_the_eye_ray(scene, max_depth):
    tree = whitted.trace(scene, PIXELS[0], f"whitted:max_depth={max_depth}")
    assert tree.rays == {"eye": 1, "shadow": 0}
    assert {node["dropped"] for node in tree.nodes} == {None, "depth"}


def test_parents_come_first_and_weights_fall(scene):
    tree = whitted.trace(scene, PIXELS[0])
    for place, node in enumerate(tree.nodes):
        assert node["id"] == place
        if node["parent"] is not None:
            parent = tree.nodes[node["parent"]]
            assert parent["id"] < place
            assert node["depth"] == parent["depth"] + 1
    json.dumps(tree.to_dict())


def test_spectral_and_mono_trees(scene):
    import mitsuba as mi

    try:
        for variant in ("llvm_ad_mono", "llvm_ad_spectral"):
            mi.set_variant(variant)
            own = whitted.load("whitted_1980", **SIZE)
            picture = whitted.render(own, spp=1).mean
            for x, y in PIXELS:
                expected = np.broadcast_to(picture[y, x], 3)
                radiance = whitted.trace(own, (x, y)).radiance
                np.testing.assert_allclose(radiance, expected, rtol=0, atol=2e-6 * expected.max())
    finally:
        mi.set_variant("llvm_ad_rgb")


def test_bad_input_is_refused(scene):
    with pytest.raises(UsageError, match=r"24,3 lies outside the film of 24x24"):
        whitted.trace(scene, (24, 3))
    with pytest.raises(UsageError, match="whitted"):
        whitted.trace(scene, (1, 1), "path")
