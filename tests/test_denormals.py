"""One thread gives the bits of several, though it may keep denormal numbers where several flush them."""

import platform

import pytest

pytestmark = pytest.mark.skipif(
    platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc", reason="nothing is done elsewhere"
)

ONE_THREAD = """
import ctypes
import whitted, mitsuba as mi, drjit as dr
from whitted import denormals
mi.set_variant("llvm_ad_rgb")

def keep():
    environment = (ctypes.c_uint32 * 8)()
    libm = ctypes.CDLL("libm.so.6")
    libm.fegetenv(environment)
    environment[7] &= ~0x8040
    libm.fesetenv(environment)

def tiny():
    product = dr.opaque(mi.Float, 1e-20, 1000) * dr.opaque(mi.Float, 1e-20, 1000)
    return product.numpy()[0] > 0
"""


def test_they_are_flushed_within_and_kept_again_after(python):
    done = python(
        ONE_THREAD
        + """
dr.set_thread_count(1)
keep()
print(tiny())
with denormals.flushed():
    print(tiny())
    with denormals.flushed():
        pass
    print(tiny())
print(tiny())
"""
    )
    assert done.stdout.split() == ["True", "False", "False", "True"], done.stderr


def test_a_picture_that_meets_them_has_the_same_bits_on_any_number_of_threads(python):
    done = python(
        ONE_THREAD
        + """
from hashlib import sha256
from whitted.replicates import box_sensor, replicate
scene = whitted.load("soft_shadows", width=96, height=80).mitsuba
integrator = mi.load_dict({"type": "distribution", "max_depth": 3, "effects": "antialiasing+interreflection"})
sensor = box_sensor(scene.sensors()[0], "independent")
for threads in (1, 2, 3):
    dr.set_thread_count(threads)
    keep()
    print(sha256(replicate(integrator, scene, sensor, seed=12345, spp=4).tobytes()).hexdigest())
"""
    )
    assert len(set(done.stdout.split())) == 1, done.stdout + done.stderr
