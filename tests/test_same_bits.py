"""The same settings give the same bits: again, in a crop, in two runs, on more threads; and edits are seen."""

import mitsuba as mi
import numpy as np
import pytest
from whitted_scenes import room

import whitted
from whitted.errors import UsageError
from whitted.film import Window

WHITTED = {"type": "whitted", "max_depth": 5}


def same(a, b):
    np.testing.assert_array_equal(a, b)


@pytest.fixture
def scene():
    return room()


@pytest.mark.parametrize("rfilter", ["box", "gaussian"])
def test_the_same_seed_gives_the_same_bits_and_another_does_not(rfilter):
    scene = room(rfilter)
    first, again, other = (whitted.render(scene, WHITTED, spp=9, seed=seed) for seed in (4, 4, 5))
    same(first.mean, again.mean)
    same(first.standard_error, again.standard_error)
    assert first.rays == again.rays
    assert (first.mean != other.mean).any()


THREADS = """
import sys
from hashlib import sha256
import whitted, mitsuba as mi, drjit as dr
mi.set_variant("llvm_ad_rgb")
sys.path.append(sys.argv[1])
from whitted_scenes import room
for threads in (1, 2, 2):
    dr.set_thread_count(threads)
    for rfilter in ("box", "gaussian"):
        picture = whitted.render(room(rfilter, size=48), "whitted", spp=20).mean
        alone = mi.render(room(rfilter, size=48), integrator=mi.load_dict({"type": "whitted"}), spp=20)
        print(rfilter, sha256(picture.tobytes()).hexdigest(), sha256(alone.numpy().tobytes()).hexdigest())
"""


def test_threads_change_no_bit(python, request):
    done = python(THREADS, request.path.parent)
    assert done.returncode == 0, done.stderr
    assert len(set(done.stdout.splitlines())) == 2


@pytest.mark.parametrize("rfilter", ["box", "gaussian", "lanczos"])
@pytest.mark.parametrize("crop", [(5, 3, 6, 9), (0, 0, 4, 4), (13, 15, 3, 1)])
def test_a_crop_is_the_same_bits_as_in_the_whole(rfilter, crop):
    x, y, width, height = crop
    part = np.s_[y : y + height, x : x + width]
    whole = whitted.render(room(rfilter), WHITTED, spp=9)
    asked = whitted.render(room(rfilter), WHITTED, spp=9, crop=crop)
    films_own = whitted.render(room(rfilter, crop=crop), WHITTED, spp=9)
    assert asked.window == films_own.window == Window(*crop)
    for found in (asked, films_own):
        same(found.mean, whole.mean[part])
        same(found.standard_error, whole.standard_error[part])


@pytest.mark.parametrize("rfilter", ["box", "gaussian"])
def test_mitsubas_own_render_call_crops_the_same_bits_too(rfilter):
    integrator = mi.load_dict(WHITTED)
    whole = np.array(mi.render(room(rfilter), integrator=integrator, spp=5))
    part = np.array(mi.render(room(rfilter, crop=(5, 3, 6, 9)), integrator=integrator, spp=5))
    same(part, whole[3:12, 5:11])


def test_mitsubas_own_render_call_takes_the_same_samples(scene):
    alone = np.array(mi.render(scene, integrator=mi.load_dict(WHITTED), spp=12, seed=3))
    np.testing.assert_allclose(alone, whitted.render(scene, WHITTED, spp=12, seed=3).mean, rtol=1e-5)


@pytest.mark.parametrize("replicates", [1, 5])
@pytest.mark.parametrize("rfilter", ["box", "gaussian"])
def test_samples_may_be_taken_in_two_runs(rfilter, replicates):
    scene = room(rfilter)
    options = {"replicates": replicates, "seed": 6}
    whole = whitted.render(scene, WHITTED, spp=64, **options)
    first = whitted.render(scene, WHITTED, spp=16, **options)
    both = whitted.render(scene, WHITTED, spp=48, resume=first, **options)
    assert both.spp == 64
    np.testing.assert_allclose(both.mean, whole.mean, rtol=1e-6)
    np.testing.assert_allclose(both.standard_error, whole.standard_error, rtol=1e-5)


@pytest.mark.parametrize(
    "changed", [{"seed": 1}, {"replicates": 2}, {"crop": (0, 0, 8, 8)}, {"integrator": "whitted:max_depth=2"}]
)
def test_samples_of_another_render_are_not_added(scene, changed):
    first = whitted.render(scene, "whitted", spp=4)
    with pytest.raises(UsageError, match="can't continue"):
        whitted.render(scene, **{"integrator": "whitted", "spp": 4, "resume": first, **changed})


def test_edits_of_the_scene_are_seen(scene):
    before = whitted.render(scene, WHITTED, spp=4).mean
    parameters = mi.traverse(scene)
    key = "panel.emitter.radiance.value"
    parameters[key] = parameters[key] * 2
    parameters.update()
    np.testing.assert_allclose(whitted.render(scene, WHITTED, spp=4).mean, 2 * before, rtol=1e-5)
    parameters["ball.to_world"] = mi.Transform4f().translate([0, 100, 0])
    parameters.update()
    moved = whitted.render(scene, WHITTED, spp=4)
    assert moved.rays["transmission"] == 0


def test_the_scene_is_left_as_it_was(scene):
    film = scene.sensors()[0].film()
    whitted.render(scene, WHITTED, spp=1, crop=(2, 2, 5, 5))
    assert list(film.crop_size()) == [16, 16]
    assert list(film.crop_offset()) == [0, 0]
    whitted.render(scene, "path", spp=1, crop=(2, 2, 5, 5))
    assert list(film.crop_size()) == [16, 16]
