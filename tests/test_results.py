"""What a render gives back: facts for JSON, the picture's file, a picture for a notebook."""

import base64
import json

import numpy as np
import pytest

import whitted
from whitted import image
from whitted.results import Render

FACTS = {
    *("scene", "integrator", "variant", "width", "height", "spp", "seed", "effects", "rays", "seconds"),
    *("kernel", "truncation", "nonfinite", "error", "versions"),
}


@pytest.fixture(scope="module")
def render():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    return whitted.render(whitted.load("whitted_1980", width=24, height=16), spp=16, seed=3)


def test_the_facts_keep_their_schema(render):
    facts = json.loads(json.dumps(render.to_dict()))
    assert set(facts) >= FACTS
    assert set(facts["rays"]) == {"eye", "shadow", "reflection", "transmission", "interreflection"}
    assert set(facts["seconds"]) == {"load", "trace", "compile", "execute", "total"}
    assert set(facts["kernel"]) == {"operations", "cache_hit"}
    assert set(facts["truncation"]) == {"by_depth", "by_cutoff"}
    for account in facts["truncation"].values():
        assert set(account) == {"throughput_dropped", "radiance_lost", "radiance_lost_error"}
    assert set(facts["error"]) == {"rmse_estimate", "standard_error_mean", "kind"}
    assert facts["effects"] == ["antialiasing", "soft_shadows", "reflection", "refraction"]
    assert facts["versions"] == render.versions
    assert facts["rays"]["eye"] == 24 * 16 * 16


def test_the_file_holds_what_the_render_holds(render, tmp_path):
    path = tmp_path / "a.exr"
    render.write(path)
    picture = image.read(path)
    np.testing.assert_array_equal(picture.rgb, render.mean)
    np.testing.assert_array_equal(picture.stderr, render.standard_error)
    np.testing.assert_array_equal(picture.channels["lost.Y"], render.lost)
    assert np.all(picture.channels["spp.Y"] == 16)
    header = picture.header
    assert header["samplesPerPixel"] == 16
    assert header["seed"] == 3
    assert header["variant"] == "llvm_ad_rgb"
    assert header["sceneHash"] == render.scene_hash
    assert header["mitsubaVersion"] == render.versions["mitsuba"]
    assert {"renderTimeSeconds", "compileTimeSeconds", "integrator", "effects"} <= set(header)


def test_a_render_read_back_goes_on_as_if_it_had_not_stopped(render, tmp_path):
    scene = whitted.load("whitted_1980", width=24, height=16)
    whitted.render(scene, spp=6, seed=3).write(tmp_path / "a.exr")
    more = whitted.render(scene, spp=10, seed=3, resume=Render.read(tmp_path / "a.exr"))
    assert more.spp == 16
    np.testing.assert_allclose(more.mean, render.mean, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(more.standard_error, render.standard_error, rtol=1e-3, atol=1e-6)


def test_a_notebook_shows_a_picture(render):
    html = render._repr_html_()
    data = html.split("base64,")[1].split('"')[0]
    assert base64.b64decode(data).startswith(b"\x89PNG")


def test_a_crop_lies_in_the_whole_picture(tmp_path):
    scene = whitted.load("whitted_1980", width=24, height=16)
    whitted.render(scene, spp=1, crop=(3, 5, 7, 4)).write(tmp_path / "c.exr")
    picture = image.read(tmp_path / "c.exr")
    assert (picture.width, picture.height) == (7, 4)
    assert tuple(picture.offset) == (3, 5)
    assert tuple(picture.full_size) == (24, 16)


def test_going_on_ends_by_the_limits_given_now(tmp_path):
    scene = whitted.load("hard_shadows", width=16, height=16)
    first = whitted.render(scene, spp=4)
    assert whitted.render(scene, resume=first).spp == 8
    assert whitted.render(scene, spp=3, resume=first).spp == 7
    assert whitted.render(scene, target_error=1e-3, resume=first).spp > 8
    assert whitted.render(scene, time=0.3, resume=first).spp > 8
