"""A wall that is a light, before an eye, and its picture by Mitsuba."""

import mitsuba as mi
import numpy as np

from whitted.hardcases.camera import camera

SIDE = 16  # pixels
DIRECT = {"type": "distribution", "max_depth": 1, "effects": "antialiasing"}
PATH = {"type": "path", "max_depth": 2}
MOMENT = {"type": "moment", "nested": PATH}


def eye(side, rfilter, **parameters):
    """The dict of a camera that sees 45 degrees to each side, for Mitsuba's integrators too."""
    made = camera("perspective", (side, side), fov=90.0, **parameters)
    made["film"] |= {"rfilter": {"type": rfilter}, "pixel_format": "rgb", "component_format": "float32"}
    return made


def wall(radiance, size=1.5, side=SIDE, rfilter="box"):
    """A scene: a square wall at distance 1, of half the ``size``, that is a light."""
    to_world = mi.ScalarTransform4f().translate([0, 0, 1]).rotate([0, 1, 0], 180).scale([size, size, 1])
    light = {"type": "rectangle", "to_world": to_world, "light": {"type": "area", "radiance": radiance}}
    return mi.load_dict({"type": "scene", "sensor": eye(side, rfilter), "wall": light}, optimize=False)


def papered(texels, side=SIDE, rfilter="box"):
    """A wall whose texels, [N, N], fill the picture exactly."""
    image = np.repeat(np.float32(texels)[..., None], 3, axis=-1)
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(image), "raw": True, "filter_type": "nearest"}
    return wall(texture, 1.0, side, rfilter)


def by_path(scene, spp, integrator=PATH):
    """The picture by Mitsuba, ``float64`` [H, W, C]."""
    return np.float64(mi.load_dict(integrator).render(scene, spp=spp))
