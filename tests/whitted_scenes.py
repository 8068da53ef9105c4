"""Small scenes that several tests share."""

import mitsuba as mi
import numpy as np


def films():
    """Return the reconstruction filters of Mitsuba."""
    return ["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"]


def transform():
    return mi.ScalarTransform4f()


def camera(rfilter="box", size=16, crop=None, **film):
    """Return a dict of a camera that looks at the origin from the front and above."""
    if crop:
        names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
        film |= dict(zip(names, crop, strict=True))
    return {
        "type": "perspective",
        "fov": 45,
        "to_world": transform().look_at([0.3, 1.8, 4.5], [0, 0.6, 0], [0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": size,
            "height": size,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": rfilter},
            **film,
        },
        "sampler": {"type": "independent", "sample_count": 4},
    }


def room(rfilter="box", size=16, crop=None, panel_in_view=False, ball=None):
    """A ball, of glass by default, on a coloured floor, both under a square light."""
    panel = transform().translate([0.5, 2.5, 1]).rotate([1, 0, 0], 90).scale(0.7)
    if panel_in_view:
        panel = transform().translate([0, 1, 0.9]).scale(0.5)
    floor = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.7, 0.5, 0.3]}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": camera(rfilter, size, crop),
            "floor": {
                "type": "rectangle",
                "to_world": transform().rotate([1, 0, 0], -90).scale(3),
                "bsdf": floor,
            },
            "ball": {
                "type": "sphere",
                "center": [0, 0.7, 0],
                "radius": 0.6,
                "bsdf": ball or {"type": "dielectric"},
            },
            "panel": {
                "type": "rectangle",
                "to_world": panel,
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [4, 4, 4]}},
            },
        },
        optimize=False,
    )


PATH = {"type": "path", "max_depth": 2}
VOLPATH = {"type": "volpath", "max_depth": 2}
WHITTED = {"type": "whitted", "max_depth": 2}
ROUGH = {"type": "roughconductor", "alpha": 0.3}
GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.4, 0.3]}}


def stage(sensor=None, floor=GREY, **things):
    """A floor under other things."""
    ground = {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(2.5), "bsdf": floor}
    return mi.load_dict(
        {"type": "scene", "sensor": sensor or camera(), "floor": ground, **things}, optimize=False
    )


def ball(bsdf=ROUGH):
    return {"type": "sphere", "center": [0, 0.6, 0], "radius": 0.5, "bsdf": bsdf}


def bitmap(width=8, height=4):
    rows = np.random.default_rng(2).uniform(0.2, 2, (height, width, 3)).astype(np.float32)
    return mi.Bitmap(rows)


def panel(radiance):
    to_world = transform().translate([0.5, 2, 1]).rotate([1, 0, 0], 90).scale(0.6)
    return {"type": "rectangle", "to_world": to_world, "emitter": {"type": "area", "radiance": radiance}}


def from_above(at=(0.5, 3, 1.5)):
    return transform().look_at(list(at), [0, 0, 0], [0, 1, 0])


def window():
    """An emitting square with one direction."""
    emitter = {"type": "directionalarea", "radiance": 5.0}
    to_world = transform().translate([0, 2, 0]).rotate([1, 0, 0], 90)
    return {"type": "rectangle", "to_world": to_world, "emitter": emitter}


EMITTERS = {
    "area": lambda: panel({"type": "rgb", "value": [5, 4, 3]}),
    "area, textured": lambda: panel(
        {"type": "bitmap", "bitmap": bitmap(), "raw": True, "filter_type": "nearest"}
    ),
    "constant": lambda: {"type": "constant", "radiance": 0.8},
    "directional": lambda: {"type": "directional", "direction": [0.3, -1, -0.5], "irradiance": 1.5},
    "directionalarea": window,
    "envmap": lambda: {"type": "envmap", "bitmap": bitmap()},
    "point": lambda: {"type": "point", "position": [1, 2, 1.5], "intensity": 4.0},
    "projector": lambda: {
        "type": "projector",
        "to_world": from_above(),
        "fov": 50,
        "irradiance": {"type": "bitmap", "bitmap": bitmap(), "raw": True},
    },
    "spot": lambda: {"type": "spot", "to_world": from_above(), "intensity": 9.0, "cutoff_angle": 30},
    "sunsky": lambda: {"type": "sunsky", "to_world": transform().rotate([1, 0, 0], -90), "sun_scale": 0.0},
    "sunsky, with sun": lambda: {"type": "sunsky", "to_world": transform().rotate([1, 0, 0], -90)},
}
NO_EMITTERS = {"timed_sunsky": "Mitsuba's own integrators fail on it in the llvm variants"}
