"""White furnaces: balls of every BSDF under a sky of 1, which none may outshine."""

import mitsuba as mi
import numpy as np

from whitted.hardcases.case import Errors, case
from whitted.hardcases.scenes import DISTRIBUTION, FAMILY, film, place

APART, ACROSS = 11, 80  # of balls of radius 1, and pixels from one to the next


def _conserving():
    """BSDFs that absorb nothing, or little, a dict; Mitsuba's ``principled`` ones don't conserve energy."""

    def mirrorlike(alpha, model="beckmann"):
        return {"type": "roughconductor", "alpha": alpha, "distribution": model}

    white = {"type": "diffuse", "reflectance": 1.0}
    rough = {"alpha": 0.3, "diffuse_reflectance": 1.0}
    return {
        "diffuse": white,
        "conductor": {"type": "conductor"},
        "dielectric": {"type": "dielectric"},
        "thindielectric": {"type": "thindielectric"},
        "plastic": {"type": "plastic", "diffuse_reflectance": 1.0},
        "roughplastic": {"type": "roughplastic"} | rough,
        "pplastic": {"type": "pplastic"} | rough,
        "roughconductor": mirrorlike(0.1),
        "roughconductor, ggx": mirrorlike(0.5, "ggx"),
        "roughdielectric": {"type": "roughdielectric", "alpha": 0.1},
        "roughdielectric, ggx": {"type": "roughdielectric", "alpha": 0.5, "distribution": "ggx"},
        "phong": {"type": "phong"},
        "hair": {"type": "hair", "eumelanin": 0.0, "pheomelanin": 0.0},
        "mask": {"type": "mask", "opacity": 0.5, "nested": mirrorlike(0.2)},
        "blendbsdf": {"type": "blendbsdf", "weight": 0.4, "first": white, "second": mirrorlike(0.2)},
        "twosided": {"type": "twosided", "nested": mirrorlike(0.3)},
        "null": {"type": "null"},
    }


def _bent():
    """BSDFs under a normal map that tilts the normal by 60 degrees."""
    tilted = 0.5 + 0.5 * np.array([np.sin(np.pi / 3), 0, np.cos(np.pi / 3)])
    texture = {"type": "rawconstant", "value": tilted.tolist()}
    nested = _conserving()
    names = ("diffuse", "roughplastic", "roughconductor", "roughdielectric", "dielectric")
    return {name: {"type": "normalmap", "normalmap": texture, "nested": nested[name]} for name in names}


def _excess(bsdfs):
    """By how much balls under a sky of 1 are brighter than it, of 1e-3 and four standard errors, [balls]."""
    from whitted.passes import render

    count, half = len(bsdfs), APART * len(bsdfs) / 2
    balls = {
        f"ball{k}": {"type": "sphere", "center": [APART * k, 0, 0], "bsdf": bsdf}
        for k, bsdf in enumerate(bsdfs.values())
    }
    to_world = place().look_at([half - APART / 2, 0, 5], [half - APART / 2, 0, 0], [0, 1, 0])
    pixel = APART / ACROSS
    rows = round(2.2 / pixel)
    sensor = {
        "type": "orthographic",
        "to_world": to_world.scale([half, half, 1]),
        "film": film(ACROSS * count, rows),
    }
    sky = {"type": "constant", "radiance": 1.0}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, "sky": sky} | balls, optimize=False)
    found = render(scene, DISTRIBUTION | {"max_depth": 12, "rr_depth": 100}, spp=16)
    x, y = ((np.arange(n) + 0.5 - n / 2) * pixel for n in (ACROSS, rows))
    inside = (np.abs(x)[None] + pixel / 2) ** 2 + (np.abs(y)[:, None] + pixel / 2) ** 2 < 1
    mean, error = (
        np.float64(one)[..., 1].reshape(rows, count, ACROSS).swapaxes(0, 1)[:, inside]
        for one in (found.mean, found.standard_error)
    )
    noise = np.sqrt((error**2).sum(axis=1)) / inside.sum()
    return np.maximum(mean.mean(axis=1) - 1, 0) / (1e-3 + 4 * noise)


@case(
    "47", FAMILY, unit="of the bound",
    tolerance=1, why="no more light leaves than arrives: 1e-3 and four standard errors", source="Veach1997",
)  # fmt: skip
def white_furnace():
    """By how much balls of each BSDF are brighter than the sky of 1 around them."""
    return Errors(ours=_excess(_conserving()))


@case(
    "27", FAMILY, unit="of the bound",
    tolerance=1, why="the same: what would leave below the surface is not followed as if it left above",
    source="Veach1997",
)  # fmt: skip
def bent_normals_in_a_furnace():
    """By how much balls with a normal map of 60 degrees are brighter than the sky of 1 around them."""
    return Errors(ours=_excess(_bent()))
