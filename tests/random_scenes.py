"""Scenes put together at random from what `distribution` is tried with one by one."""

import mitsuba as mi
import numpy as np
from distribution_bsdfs import BSDFS, chosen_point_by_point
from test_lobes import made
from whitted_scenes import EMITTERS, GREY, bitmap, camera, transform

SHAPES = ("sphere", "disk", "rectangle", "cube", "cylinder")
DEPTHS = (2, 3, 4, 6, -1)


class Maker:
    """Random parts of a scene; a ``seed`` makes the same scene each time."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def chance(self, probability):
        return self.random.random() < probability

    def among(self, things):
        things = list(things)
        return things[self.random.integers(len(things))]

    def placed(self, low, high, size):
        """A transform to somewhere in a box, turned, of a size from an interval, mostly as long as wide."""
        to_world = transform().translate(self.random.uniform(low, high).tolist())
        to_world = to_world.rotate(self._axis(), self.random.uniform(0, 360))
        return to_world.scale(float(np.exp(self.random.uniform(*np.log(size)))))

    def stretch(self):
        return self.random.uniform(0.4, 1, 3).tolist() if self.chance(0.4) else 1.0

    def _axis(self):
        axis = self.random.normal(size=3)
        return (axis / np.linalg.norm(axis)).tolist()

    def bsdf(self):
        if self.chance(0.4):
            return {
                "type": "diffuse",
                "reflectance": {"type": "rgb", "value": self.random.uniform(0, 0.9, 3).tolist()},
            }
        if self.chance(0.3):
            kind = self.among(("roughconductor", "roughdielectric", "roughplastic", "phong"))
            if kind == "phong":
                return {"type": kind, "shininess": float(10 ** self.random.uniform(0, 3))}
            return {"type": kind, "alpha": float(10 ** self.random.uniform(-2, 0))}
        return made(chosen_point_by_point(BSDFS[self.among(BSDFS)]))

    def radiance(self):
        if self.chance(0.2):
            return {"type": "bitmap", "bitmap": bitmap(), "raw": True, "filter_type": "nearest"}
        return {
            "type": "rgb",
            "value": (self.random.uniform(0.2, 1, 3) * 10 ** self.random.uniform(0, 1)).tolist(),
        }

    def shape(self):
        kind = self.among(SHAPES)
        stretch = self.stretch() if kind in ("disk", "rectangle", "cube") else 1.0
        to_world = self.placed([-1.5, 0.1, -1.5], [1.5, 1.8, 1.5], (0.1, 0.8)).scale(stretch)
        return {"type": kind, "to_world": to_world, "bsdf": self.bsdf(), "flip_normals": self.chance(0.2)}

    def light(self):
        if self.chance(0.5):
            kind = self.among(SHAPES)
            stretch = self.stretch() if kind in ("disk", "rectangle", "cube") else 1.0
            to_world = self.placed([-2, 1, -2], [2, 3, 2], (0.1, 1)).scale(stretch)
            return {
                "type": kind,
                "to_world": to_world,
                "emitter": {"type": "area", "radiance": self.radiance()},
            }
        return EMITTERS[self.among(name for name in EMITTERS if "area" not in name and name not in SKIES)]()

    def sensor(self):
        made = camera(size=16)
        if self.chance(0.3):
            made |= {
                "type": "thinlens",
                "aperture_radius": float(self.random.uniform(0, 0.3)),
                "focus_distance": 4.5,
            }
        elif self.chance(0.1):
            made |= {"type": "orthographic", "to_world": made["to_world"] @ transform().scale(2)}
            del made["fov"]
        return made

    def scene(self):
        """Return an ``mi.Scene``."""
        things = {"sensor": self.sensor()}
        if self.chance(0.85):
            to_world = transform().rotate([1, 0, 0], -90).scale(2.5)
            bsdf = GREY if self.chance(0.6) else self.bsdf()
            things["floor"] = {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}
        for number in range(self.random.integers(0, 7)):
            things[f"shape{number}"] = self.shape()
        for number in range(self.among((0, 1, 1, 1, 2, 3, 12))):
            things[f"light{number}"] = self.light()
        if self.chance(0.4):
            things["sky"] = EMITTERS[self.among(SKIES)]()
        return mi.load_dict({"type": "scene", **things}, optimize=False)

    def parameters(self):
        """Return properties of `distribution`, and those of Mitsuba's integrator that mean the same."""
        common = {"max_depth": self.among(DEPTHS)}
        if self.chance(0.2):
            common["rr_depth"] = int(self.random.integers(1, 8))
        own = {"effects": self.among(("auto", "all"))}
        if self.chance(0.3):
            own["tree_depth"] = int(self.random.integers(0, 5))
        for name in ("light_samples", "gloss_samples", "interreflection_samples"):
            if self.chance(0.3):
                own[name] = self.among((2, 3, 8, "auto"))
        if self.chance(0.3):
            own["direct_light"] = self.among(("rays", "lights", "both"))
        if self.chance(0.2):
            own["offset"] = "mitsuba"
        if self.chance(0.3):
            own["closed_form"] = self.among((True, False))
        return common | own, common


SKIES = ("constant", "envmap", "sunsky", "sunsky, with sun")
