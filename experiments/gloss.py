"""What do blurred reflections and refractions cost? Rough plates under ball lights, letters behind frosted glass.

Error against samples per pixel and kernel seconds, of `distribution` and of Mitsuba's integrators with every sampler,
and error maps at equal time. `whitted` and `direct` are left out behind the glass: they estimate direct light alone.
``python experiments/gloss.py [--small] [--force]``; figures go to out/comparison, the large ones to docs/images, too.
"""

import comparison_figures

SCENES = (
    "gloss",
    "translucency",
)

if __name__ == "__main__":
    comparison_figures.run(SCENES)
