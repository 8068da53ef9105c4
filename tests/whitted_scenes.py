"""Small scenes that several tests share."""

import mitsuba as mi


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
