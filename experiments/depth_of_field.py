"""What does depth of field cost? A lens, hard shadows, and nothing else that is random.

Error against samples per pixel and kernel seconds, of `distribution` and of Mitsuba's integrators with every sampler,
and error maps at equal time. The sun is a delta light, so that `direct` with 0 and with 1 BSDF sample differ in time
only. ``python experiments/depth_of_field.py [--small] [--force]``; figures go to out/comparison, the large ones to
docs/images, too.
"""

import comparison_figures

SCENES = ("depth_of_field",)

if __name__ == "__main__":
    comparison_figures.run(SCENES)
