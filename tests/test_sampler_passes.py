"""Mitsuba's integrators with our sums: the numbers are Mitsuba's own, and the bits don't vary."""

import mitsuba as mi
import numpy as np
import pytest

import whitted
from whitted.film import Window
from whitted.replicates import box_sensor, replicate
from whitted.sampler_passes import SamplerPasses

SIZE = 24
SAMPLERS = {
    "independent": 7,
    "stratified": 9,
    "multijitter": 12,
    "orthogonal": 9,
    "ldsampler": 8,
    "owen_sobol": 8,
}


@pytest.fixture(scope="module")
def scene():
    return whitted.load("depth_of_field", width=SIZE, height=SIZE).mitsuba


def picture(scene, name, spp, window=None, seed=5):
    path = mi.load_dict({"type": "path", "max_depth": 3})
    sampler = mi.load_dict({"type": name})
    sampler.set_sample_count(spp)
    window = window or Window(0, 0, SIZE, SIZE)
    passes = SamplerPasses(path, scene, scene.sensors()[0], sampler, window, seed, sampler.sample_count())
    passes.run()
    return passes.moments()


@pytest.mark.parametrize(("name", "spp"), SAMPLERS.items())
def test_each_sample_is_the_one_that_mitsuba_takes(scene, name, spp):
    path = mi.load_dict({"type": "path", "max_depth": 3})
    native = replicate(path, scene, box_sensor(scene.sensors()[0], name), seed=5, spp=spp)
    np.testing.assert_allclose(picture(scene, name, spp).mean(), native, rtol=2e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["independent", "owen_sobol"])
def test_several_passes_estimate_the_same_and_keep_a_sequence_whole(scene, name, monkeypatch):
    whole = picture(scene, name, 256).mean().astype(float)
    monkeypatch.setattr("whitted.sampler_passes.LANES", SIZE * SIZE * 16)
    parts = picture(scene, name, 256).mean().astype(float)
    spread = np.abs(parts - whole)
    if name == "owen_sobol":
        assert spread.max() < 1e-5
    else:
        assert 0 < spread.mean() < 0.1 * whole.mean()


def test_windows_have_numbers_of_their_own(scene):
    upper, lower = (picture(scene, "independent", 4, Window(0, y, SIZE, 12)).mean() for y in (0, 12))
    whole = picture(scene, "independent", 4).mean()
    assert upper.shape == (12, SIZE, 3)
    np.testing.assert_array_equal(upper, whole[:12])  # the first window's lanes are the whole's first
    assert (lower != whole[12:]).any()


def test_samples_that_are_no_numbers_are_left_out(scene):
    class Broken(mi.SamplingIntegrator):
        def sample(self, scene, sampler, ray, medium=None, active=True):
            u = sampler.next_1d()
            return mi.Color3f(mi.Float(2) / (u >= 0.5)) * (u >= 0.5), mi.Bool(True), []

    sampler = mi.load_dict({"type": "independent"})
    passes = SamplerPasses(
        Broken(mi.Properties()), scene, scene.sensors()[0], sampler, Window(0, 0, SIZE, SIZE), 0, 64
    )
    passes.run()
    moments = passes.moments()
    assert 20 < moments.weights.mean() < 44
    np.testing.assert_array_equal(moments.mean(), 2)


THREADS = """
from hashlib import sha256
import whitted, mitsuba as mi, drjit as dr
from whitted.film import Window
from whitted.sampler_passes import SamplerPasses
scene = whitted.load("soft_shadows", width=40, height=40).mitsuba
path = mi.load_dict({"type": "path", "max_depth": 3})
for threads in (1, 2, 3, 2):
    dr.set_thread_count(threads)
    sampler = mi.load_dict({"type": "independent"})
    passes = SamplerPasses(path, scene, scene.sensors()[0], sampler, Window(0, 0, 40, 40), 1, 225)
    passes.run()
    print(sha256(passes.moments().sums.tobytes()).hexdigest())
"""


def test_threads_change_no_bit_where_they_do_in_mitsubas_film(python):
    done = python(THREADS)
    assert done.returncode == 0, done.stderr
    assert len(set(done.stdout.split())) == 1
