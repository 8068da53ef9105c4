"""Where Mitsuba 3.9.1 is known to be wrong, so that a comparison with it doesn't blame the other side.

Each was measured against a closed form, see `experiments/reference_defects.py`. Left out: the offset of rays, whose
effect `whitted.check` measures; `ldsampler`, which it doesn't use; and `hide_emitters`, of which `path` doesn't tell.
"""

import numpy as np

SMALL = 5e-3  # radius over distance of a sphere light, from which Mitsuba is off by more than about 0.3 %


def known_defects(scene, integrator):
    """Return what Mitsuba gets wrong on an ``mi.Scene`` when it renders it with an integrator, a tuple of sentences."""
    if hasattr(integrator, "estimate"):
        return ()
    from whitted.world import World

    world = World(scene)
    found = (_transparent(world, integrator), _small_sphere(world), _blend(world), _crowded(world))
    return tuple(sentence for sentence in found if sentence)


def _transparent(world, integrator):
    if world.is_transparent and "Volumetric" not in str(integrator):
        return "shadow rays stop at null, mask and thin surfaces; take volpath as the reference"
    return None


def _small_sphere(world):
    box = world.scene.bbox()
    for shape in world.scene.shapes():
        if shape.emitter() is None or shape.class_name() != "Sphere":
            continue
        low, high = np.array(shape.bbox().min), np.array(shape.bbox().max)
        centre, radius = (low + high) / 2, (high - low).max() / 2
        distance = np.linalg.norm(np.maximum(np.array(box.max) - centre, centre - np.array(box.min)))
        if radius < SMALL * distance:
            return (
                f"the density with which sphere lights are sampled loses its digits when they look small: "
                f"'{shape.id()}' has radius {radius:.2g} and is seen from up to {distance:.2g}"
            )
    return None


def _blend(world):
    import mitsuba as mi

    from whitted.contents import objects_of

    def blends(bsdf):
        children = [child for child in objects_of(bsdf).values() if isinstance(child, mi.BSDF)]
        flags = [int(child.flags()) for child in children]
        mixes = any(not f & mi.BSDFFlags.Smooth for f in flags) and any(
            f & mi.BSDFFlags.Smooth for f in flags
        )
        return (bsdf.class_name() == "BlendBSDF" and mixes) or any(map(blends, children))

    for bsdf in world.bsdfs:
        if blends(bsdf):
            return f"a blendbsdf of a specular and a scattering BSDF is sampled with wrong weights: '{bsdf.id()}'"
    return None


def _crowded(world):
    if world.is_crowded:
        return (
            "shadow rays end 0.09 % before the light, and something is as near to a light's surface as that"
        )
    return None
