"""The ray tree of one pixel, written down ray by ray."""

import json
from collections import Counter
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import _backend, files, transport
from whitted.errors import UsageError
from whitted.film import Grid, Window, colours, cropped, eye_rays
from whitted.optics import bsdf_context
from whitted.sampling.draws import Draws
from whitted.sampling.groups import Replicates
from whitted.scene import as_scene
from whitted.scene import integrator as as_integrator

MAX_NODES = 100_000


@dataclass
class RayTree:
    """The rays of one sample of a pixel.

    Attributes:
        pixel: x, y.
        radiance: of the sample, three floats, linear: the sum of the nodes' contributions.
        nodes: list of dicts, parents first; ``whitted.words`` has the keys.
        scene, integrator: what was traced.
    """

    pixel: tuple
    radiance: list
    nodes: list
    scene: str = ""
    integrator: str = ""

    @property
    def rays(self):
        """The number of rays by kind; those given up aren't counted."""
        kinds = Counter(node["kind"] for node in self.nodes if node["dropped"] is None)
        return dict(kinds, shadow=sum(len(node["shadow"]) for node in self.nodes))

    def to_dict(self):
        """Return all of it as JSON can hold it."""
        return {
            "scene": self.scene,
            "integrator": self.integrator,
            "pixel": list(self.pixel),
            "radiance": self.radiance,
            "rays": self.rays,
            "nodes": self.nodes,
        }

    def __str__(self):
        """The tree as indented text."""
        from whitted.words import to_text

        return to_text(self)

    def _repr_svg_(self):
        """Draw the tree in a notebook."""
        from whitted.drawing import to_svg

        return to_svg(self)

    def write(self, path):
        """Write the drawing if ``path`` ends in ``.svg``, else JSON."""
        text = self._repr_svg_() if str(path).endswith(".svg") else json.dumps(self.to_dict(), indent=1)
        files.write(path, text)


def trace(scene, pixel, integrator=None, *, seed=0, sensor=0):
    """Trace the first sample of a pixel with ``whitted`` and write down every ray.

    Args:
        scene: ``Scene``, ``mi.Scene``, a path, or the name of a shipped scene.
        pixel: x, y, from the upper left.
        integrator: as for ``whitted.render``; it has to be ``whitted``.
        seed: ``int``, as for ``whitted.render``: the rays are those of its first sample.
        sensor: the sensor's number.

    Returns:
        ``RayTree``.

    Raises:
        UsageError: the pixel lies outside the film, the integrator has no tree, or the tree is too large.
    """
    scene = as_scene(scene)
    _backend.check(mi.variant())
    integrator, _ = as_integrator(integrator, scene.mitsuba)
    if not hasattr(integrator, "min_contribution"):
        raise UsageError("only the integrator 'whitted' has a ray tree; take --integrator whitted")
    camera = scene.mitsuba.sensors()[sensor]
    size = tuple(int(n) for n in camera.film().size())
    x, y = (int(n) for n in pixel)
    if not (0 <= x < size[0] and 0 <= y < size[1]):
        raise UsageError(f"pixel {x},{y} lies outside the film of {size[0]}x{size[1]} pixels")
    with dr.suspend_grad(), cropped(camera):
        plan = integrator.plan(integrator.world(scene.mitsuba), camera)
        grid = Grid(Window(x, y, 1, 1), 0, 1)
        ray, weight, draws, _, active = eye_rays(camera, size, grid, Replicates(seed, 1), plan)
        lane = dr.compress(active)
        ray, weight = dr.gather(mi.Ray3f, ray, lane), dr.gather(mi.Spectrum, weight, lane)
        numbers = (
            dr.gather(mi.UInt32, value, lane) for value in (draws.pixel, draws.index, draws.seed, draws.block)
        )
        recorder = _Recorder(integrator, scene.mitsuba, ray, weight, Draws(*numbers, draws.joint, draws.bits))
        recorder.grow()
    nodes = recorder.nodes
    radiance = np.sum([node["contribution"] for node in nodes], axis=0).tolist()
    return RayTree((x, y), radiance, nodes, scene.name, integrator.to_string())


class _Recorder:
    """Grow a tree level by level, one lane for each ray, and write it down.

    Between levels a ray is a dict of numbers: ``o``, ``d``, ``w``, ``eta``, ``id`` as in ``transport.node_type``,
    ``parent`` (its place in the list) and ``kind``.
    """

    def __init__(self, integrator, scene, ray, weight, draws):
        self.integrator, self.scene, self.ray, self.draws = integrator, scene, ray, draws
        self.weight = weight  # of the eye ray; not part of the throughput, which the cutoff looks at
        self.nodes = []

    def grow(self):
        """Trace the tree below the eye ray."""
        ray, one = self.ray, mi.Spectrum(1)
        root = _numbers({"o": ray.o, "d": ray.d, "w": one}, 1)
        root = {name: value[0] for name, value in root.items()} | {"eta": 1.0, "id": 0}
        level, depth = [root | {"parent": None, "kind": "eye"}], 0
        while level:
            if len(self.nodes) + len(level) > MAX_NODES:
                raise UsageError(f"the ray tree has more than {MAX_NODES} rays; lower max_depth")
            level, depth = self.visit(level, depth), depth + 1

    def visit(self, level, depth):
        """Trace the rays of one level, write them down, and return those of the next."""
        self.world = world = self.integrator.world(self.scene)  # counts rays per lane: one a level
        count, first = len(level), len(self.nodes)
        o, d, w = (np.array([ray[name] for ray in level], np.float32).T for name in "odw")
        w, ids = mi.Spectrum(w), mi.UInt32([ray["id"] for ray in level])
        eye = mi.Ray3f(mi.Point3f(o), mi.Vector3f(d), self.ray.time, self.ray.wavelengths)
        # Data, not literals: one kernel serves all levels
        is_eye = dr.opaque(mi.Bool, depth == 0)
        within = dr.opaque(mi.Bool, depth + 1 < self.integrator.max_depth)
        si = world.intersect(eye, is_eye, mi.Bool(True))
        hit, bsdf = si.is_valid(), si.bsdf()
        goes_on = hit & within

        seen = hit | ~is_eye if world.hide_emitters else mi.Bool(True)
        emitted = dr.select(seen, world.emission(si, seen), 0)
        shadows = [self.light(si, w, ids, emitter, goes_on) for emitter in range(len(world.emitters))]
        direct = sum((shadow.pop("radiance") for shadow in shadows), mi.Spectrum(0))
        if self.integrator.ambient is not None:
            direct += self.integrator.ambient.eval(si, goes_on) * world.diffuse_reflectance(si, goes_on)
        direct = dr.select(goes_on, direct, 0)
        facts = {
            "origin": eye.o,
            "direction": eye.d,
            "distance": si.t,
            "position": si.p,
            "throughput": self.throughput(w),
            "emitted": self.colour(emitted),
            "direct": self.colour(direct),
            "contribution": self.colour(w * (emitted + direct)),
        }
        lobes = [self.leave(si, w, lobe) for lobe in world.delta_lobes(si, hit)]
        dr.eval(facts, shadows, lobes, hit, goes_on, si.shape, bsdf)  # all of the level in one kernel

        facts, hit, goes_on = (_numbers(found, count) for found in (facts, hit, goes_on))
        shadows = [_numbers(found, count) for found in shadows]
        lobes = [_numbers(found, count) for found in lobes]
        for i, ray in enumerate(level):
            node = {name: values[i].tolist() for name, values in facts.items()}
            node |= {"id": first + i, "parent": ray["parent"], "kind": ray["kind"], "depth": depth}
            node |= {"dropped": None, "shape": None, "bsdf": None}
            lit = zip(world.emitters, shadows, strict=True)
            node["shadow"] = [_shadow(light, found, i) for light, found in lit if found["unshadowed"][i] > 0]
            node |= (
                {"shape": si.shape[i].id(), "bsdf": bsdf[i].id()}
                if hit[i]
                else {"distance": None, "position": None}
            )
            self.nodes.append(node)
        return self.branch(level, lobes, goes_on, depth + 1, first)

    def light(self, si, w, ids, emitter, active):
        """Sample one emitter from all vertices of the level."""
        active = active & mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Smooth)
        shadows, context = self.integrator.shadows, bsdf_context(self.integrator.local_model)
        ds, unshadowed, visible = transport.light_sample(
            self.world, si, self.draws, ids, emitter, active, shadows, context
        )
        return {
            "radiance": unshadowed * visible,
            "unshadowed": dr.max(unshadowed),
            "target": ds.p,
            "direction": ds.d,
            "distance": ds.dist,
            "transmittance": dr.max(visible),
            "contribution": self.colour(w * unshadowed * visible),
        }

    def leave(self, si, w, lobe):
        """Follow a specular lobe from all vertices of the level."""
        wo, weight, eta, kind = lobe
        ray = self.world.spawn(si, si.to_world(wo))
        return {
            "o": ray.o,
            "d": ray.d,
            "w": w * weight,
            "shown": self.throughput(w * weight),
            "eta": eta,
            "reflects": mi.has_flag(kind, mi.BSDFFlags.DeltaReflection),
        }

    def branch(self, level, lobes, goes_on, depth, first):
        """Return the rays of the next level; those that are given up are only written down."""
        rays = []
        for slot, lobe in enumerate(lobes):
            for i, ray in enumerate(level):
                relative = ray["eta"] * lobe["eta"][i]
                share = lobe["w"][i].max() * relative**2
                if not share > 0:
                    continue
                name = "reflection" if lobe["reflects"][i] else "transmission"
                if goes_on[i] and share >= self.integrator.min_contribution:
                    number = (ray["id"] * self.world.branching + slot + 1) % 2**32
                    child = {part: lobe[part][i] for part in "odw"} | {"eta": relative, "id": number}
                    rays.append(child | {"parent": first + i, "kind": name})
                    continue
                node = {"id": len(self.nodes), "parent": first + i, "kind": name, "depth": depth}
                names = {"origin": "o", "direction": "d", "throughput": "shown"}
                node |= {name: lobe[part][i].tolist() for name, part in names.items()}
                self.nodes.append(node | {"dropped": "cutoff" if goes_on[i] else "depth"} | _nothing())
        return rays

    def colour(self, radiance):
        """Return a ``Spectrum`` of radiance as the sensor sees it, a list of three ``Float``."""
        return colours(radiance * self.weight, self.ray.wavelengths)

    def throughput(self, w):
        """Return a throughput as a list of three ``Float``; of a spectral one it is the mean, three times."""
        return [dr.mean(w)] * 3 if mi.is_spectral else colours(w, None)


def _nothing():
    """What a ray that isn't traced meets."""
    nothing = dict.fromkeys(("distance", "position", "shape", "bsdf"))
    black = {name: [0.0] * 3 for name in ("emitted", "direct", "contribution")}
    return nothing | black | {"shadow": []}


def _shadow(emitter, found, i):
    """One shadow ray, as the list of nodes holds it."""
    is_finite = not int(emitter.flags()) & mi.EmitterFlags.Infinite
    return {
        "emitter": emitter.id(),
        "target": found["target"][i].tolist() if is_finite else None,
        "direction": found["direction"][i].tolist(),
        "distance": float(found["distance"][i]) if is_finite else None,
        "transmittance": float(found["transmittance"][i]),
        "contribution": found["contribution"][i].tolist(),
    }


def _numbers(found, count):
    """Return an evaluated array, a list of them, or a dict of either, as NumPy with ``count`` lanes first."""
    if isinstance(found, dict):
        return {name: _numbers(value, count) for name, value in found.items()}
    if isinstance(found, list):
        return np.stack([_numbers(value, count) for value in found], axis=-1)
    array = np.moveaxis(np.array(found, np.float64), -1, 0)
    return np.broadcast_to(array, (count, *array.shape[1:]))
