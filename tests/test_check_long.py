"""False alarms of `check` on real renders: minutes long, and so apart (``pytest -m long``)."""

import mitsuba as mi
import numpy as np
import pytest

from whitted.replicates import box_sensor, replicate, seeds
from whitted.stats.agreement import assess

pytestmark = pytest.mark.long
REPETITIONS, REPLICATES, SPP, LEVEL = 200, 16, 9, 0.01


def caustic(size=32):
    """A glass sphere under a small area light over a diffuse floor: `path` finds the caustic by luck only."""
    return {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "fov": 50,
            "to_world": mi.ScalarTransform4f().look_at([0, -4, 3], [0, 0, 0.3], [0, 0, 1]),
            "film": {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgb"},
        },
        "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(4)},
        "ball": {"type": "sphere", "center": [0, 0, 1], "radius": 0.6, "bsdf": {"type": "dielectric"}},
        "lamp": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().translate([0, 0, 4]).rotate([1, 0, 0], 180).scale(0.2),
            "emitter": {"type": "area", "radiance": 60.0},
        },
    }


def test_path_against_itself_keeps_the_level_on_caustics():
    """At a level of 1 % more than 6 alarms in 200 have a probability of 0.4 %."""
    scene = mi.load_dict(caustic())
    camera = box_sensor(scene.sensors()[0])
    path = mi.load_dict({"type": "path", "max_depth": 8})
    alarms = []
    for repetition in range(REPETITIONS):
        # its own block of replicates: 4 * REPLICATES seeds for each repetition
        plans = [seeds(side, 0, REPLICATES * REPETITIONS)[repetition::REPETITIONS] for side in range(2)]
        images = [np.array([replicate(path, scene, camera, s, SPP) for s in plan]) for plan in plans]
        found = assess(*images, level=LEVEL, seed=repetition)
        if found.verdict == "differ":
            alarms.append(found.reason)
    print(f"{len(alarms)} false alarms in {REPETITIONS}, level {LEVEL:g}")
    assert len(alarms) <= 6, alarms
