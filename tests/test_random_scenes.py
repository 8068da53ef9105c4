"""`distribution` against Mitsuba on scenes put together at random: minutes long, and so apart (``pytest -m long``).

Shapes, BSDFs, emitters, sensors and properties meet here that no other test brings together. At a level of 1e-4 for
each scene equal integrators would be told apart in one of the 60 with a probability of 0.6 %; the seeds are fixed.
"""

import mitsuba as mi
import pytest
from distribution_scenes import reference
from random_scenes import Maker

import whitted

pytestmark = pytest.mark.long
SCENES, TOLD = 60, 20


def compared(seed, **changed):
    """Check one scene; ``changed`` are properties of the reference alone."""
    maker = Maker(seed)
    scene = maker.scene()
    ours, theirs = maker.parameters()
    sides = {"type": "distribution"} | ours, reference(scene, **theirs) | changed
    return whitted.check(scene, *map(mi.load_dict, sides), replicates=16, spp=64, level=1e-4)


@pytest.mark.parametrize("seed", range(SCENES))
def test_no_scene_is_told_apart(seed):
    found = compared(seed)
    assert found.verdict in ("agree", "undecided"), found


def test_direct_light_alone_is_told_apart():
    """Of the scenes in view some have light that comes by way of another surface."""
    told = [seed for seed in range(TOLD) if compared(seed, max_depth=2).verdict == "differ"]
    assert len(told) >= TOLD // 4, told
