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
        ray, one = self.ray, _floats(mi.Spectrum(1))[0]
        root = {"o": _floats(ray.o)[0], "d": _floats(ray.d)[0], "w": one, "eta": 1.0, "id": 0}
        level, depth = [root | {"parent": None, "kind": "eye"}], 0
        while level:
            if len(self.nodes) + len(level) > MAX_NODES:
                raise UsageError(f"the ray tree has more than {MAX_NODES} rays; lower max_depth")
            level, depth = self.visit(level, depth), depth + 1

    def visit(self, level, depth):
        """Trace the rays of one level, write them down, and return those of the next."""
        self.world = world = self.integrator.world(self.scene)  # counts rays per lane: one a level
        count = len(level)
        o, d, w = (np.array([ray[name] for ray in level], np.float32).T for name in "odw")
        w, ids = mi.Spectrum(w), mi.UInt32([ray["id"] for ray in level])
        eye = mi.Ray3f(mi.Point3f(o), mi.Vector3f(d), self.ray.time, self.ray.wavelengths)
        si = world.intersect(eye, mi.Bool(depth == 0), mi.Bool(True))
        hit = si.is_valid()
        goes_on = hit & (depth + 1 < self.integrator.max_depth)

        seen = hit | (depth > 0 or not world.hide_emitters)
        emitted = dr.select(seen, world.emission(si, seen), 0)
        shadows = [self.light(si, w, ids, emitter, goes_on) for emitter in range(len(world.emitters))]
        direct = sum((shadow.pop("radiance") for shadow in shadows), mi.Spectrum(0))
        if self.integrator.ambient is not None:
            direct += self.integrator.ambient.eval(si, goes_on) * world.diffuse_reflectance(si, goes_on)
        direct = dr.select(goes_on, direct, 0)

        facts = {
            "origin": _floats(eye.o, count),
            "direction": _floats(eye.d, count),
            "distance": _floats(si.t, count),
            "position": _floats(si.p, count),
            "throughput": self.throughputs(w, count),
            "emitted": self.colours(emitted, count),
            "direct": self.colours(direct, count),
            "contribution": self.colours(w * (emitted + direct), count),
        }
        hit, bsdf, first = _floats(hit, count) > 0, si.bsdf(), len(self.nodes)
        for i, ray in enumerate(level):
            node = {name: values[i].tolist() for name, values in facts.items()}
            node |= {
                "id": first + i,
                "parent": ray["parent"],
                "kind": ray["kind"],
                "depth": depth,
                "dropped": None,
            }
            node |= {"shape": None, "bsdf": None, "shadow": [_shadow(s, i) for s in shadows if s["lit"][i]]}
            node |= (
                {"shape": si.shape[i].id(), "bsdf": bsdf[i].id()}
                if hit[i]
                else {"distance": None, "position": None}
            )
            self.nodes.append(node)
        return self.branch(level, si, w, goes_on, depth + 1, first)

    def light(self, si, w, ids, emitter, active):
        """Sample one emitter from all vertices of the level."""
        light, count = self.world.emitters[emitter], dr.width(ids)
        active = active & mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Smooth)
        shadows = self.integrator.shadows
        ds, unshadowed, visible = transport.light_sample(
            self.world,
            si,
            self.draws,
            ids,
            emitter,
            active,
            shadows,
            bsdf_context(self.integrator.local_model),
        )
        return {
            "radiance": unshadowed * visible,
            "lit": _floats(dr.max(unshadowed), count) > 0,
            "emitter": light.id(),
            "is_finite": not int(light.flags()) & mi.EmitterFlags.Infinite,
            "target": _floats(ds.p, count),
            "direction": _floats(ds.d, count),
            "distance": _floats(ds.dist, count),
            "transmittance": _floats(dr.max(visible), count),
            "contribution": self.colours(w * unshadowed * visible, count),
        }

    def branch(self, level, si, w, goes_on, depth, first):
        """Return the rays of the next level; those that are given up are only written down."""
        count, rays = len(level), []
        goes_on = _floats(goes_on, count) > 0
        for slot, (wo, weight, eta, kind) in enumerate(self.world.delta_lobes(si, si.is_valid())):
            leaving = self.world.spawn(si, si.to_world(wo))
            o, d, throughput = (
                _floats(leaving.o, count),
                _floats(leaving.d, count),
                _floats(w * weight, count),
            )
            shown, eta = self.throughputs(w * weight, count), _floats(eta, count)
            reflects = _floats(mi.has_flag(kind, mi.BSDFFlags.DeltaReflection), count) > 0
            for i, ray in enumerate(level):
                relative = ray["eta"] * eta[i]
                share = throughput[i].max() * relative**2
                if not share > 0:
                    continue
                name = "reflection" if reflects[i] else "transmission"
                if goes_on[i] and share >= self.integrator.min_contribution:
                    number = (ray["id"] * self.world.branching + slot + 1) % 2**32
                    child = {"o": o[i], "d": d[i], "w": throughput[i], "eta": relative, "id": number}
                    rays.append(child | {"parent": first + i, "kind": name})
                    continue
                node = {"id": len(self.nodes), "parent": first + i, "kind": name, "depth": depth}
                node |= {"origin": o[i].tolist(), "direction": d[i].tolist(), "throughput": shown[i].tolist()}
                self.nodes.append(node | {"dropped": "cutoff" if goes_on[i] else "depth"} | _nothing())
        return rays

    def colours(self, radiance, count):
        """Return a ``Spectrum`` of radiance, as the sensor sees it, as [count, 3]."""
        seen = colours(radiance * self.weight, self.ray.wavelengths)
        return np.stack([_floats(c, count) for c in seen], axis=-1)

    def throughputs(self, w, count):
        """Return a throughput as [count, 3]; a spectral one as its mean, three times."""
        if mi.is_spectral:
            return np.repeat(_floats(dr.mean(w), count)[:, None], 3, axis=1)
        return np.stack([_floats(c, count) for c in colours(w, None)], axis=-1)


def _nothing():
    """What a ray that isn't traced meets."""
    nothing = dict.fromkeys(("distance", "position", "shape", "bsdf"))
    black = {name: [0.0] * 3 for name in ("emitted", "direct", "contribution")}
    return nothing | black | {"shadow": []}


def _shadow(shadow, i):
    """One shadow ray, as the list of nodes holds it."""
    is_finite = shadow["is_finite"]
    return {
        "emitter": shadow["emitter"],
        "target": shadow["target"][i].tolist() if is_finite else None,
        "direction": shadow["direction"][i].tolist(),
        "distance": float(shadow["distance"][i]) if is_finite else None,
        "transmittance": float(shadow["transmittance"][i]),
        "contribution": shadow["contribution"][i].tolist(),
    }


def _floats(value, count=1):
    """A Dr.Jit array as NumPy, ``count`` lanes first."""
    array = np.moveaxis(np.array(value, np.float64), -1, 0)
    return np.broadcast_to(array, (count, *array.shape[1:]))
