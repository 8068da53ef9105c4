"""What does interreflection cost? The Cornell box, up to 8 segments.

Error against samples per pixel and kernel seconds, of `distribution` and of Mitsuba's integrators with every sampler,
and error maps at equal time. `whitted` and `direct` are left out: they estimate direct light alone. ``python
experiments/interreflection.py [--small] [--force]``; figures go to out/comparison, the large ones to docs/images, too.
"""

import comparison_figures

SCENES = ("interreflection",)

if __name__ == "__main__":
    comparison_figures.run(SCENES)
