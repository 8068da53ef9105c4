"""What do soft shadows cost? Penumbrae alone, and a floor that sees the whole light nearly everywhere.

Error against samples per pixel and kernel seconds, of `distribution` and of Mitsuba's integrators with every sampler,
and error maps at equal time. `whitted` and `direct` estimate these pictures too, which have direct light alone.
``python experiments/soft_shadows.py [--small] [--force]``; figures go to out/comparison, the large ones to
docs/images, too.
"""

import comparison_figures

SCENES = (
    "soft_shadows",
    "open_floor",
)

if __name__ == "__main__":
    comparison_figures.run(SCENES)
