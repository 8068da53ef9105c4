"""The ray tree once more, breadth first: a slow and plain version of the integrator `whitted` to check it against.

Whole levels of the tree are evaluated one after the other as arrays, compacted with NumPy; there is no symbolic loop,
no virtual call (BSDFs and emitters are gone through one by one, under masks), and no stack. The numbers are the
same draws, named by the node of the tree. Adapters are taken apart by what they were made of: `mask`, `blend` and
`twosided` keep a note of it.
"""

from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.offsets import Offsets
from whitted.sampling.draws import Draws

KINDS = ("eye", "shadow", "reflection", "transmission")
_made_of = {}  # from the address of an adapter to (kind, parts, amount, the adapter itself)


def mask(nested, opacity):
    """Return a `mask` of a BSDF; ``opacity`` is a number or a texture."""
    return _note("mask", [nested], opacity, {"nested": nested, "opacity": opacity})


def blend(first, second, weight):
    """Return a `blendbsdf`; ``weight``, a number or a texture, is the second one's."""
    return _note("blendbsdf", [first, second], weight, {"first": first, "second": second, "weight": weight})


def twosided(front, back=None):
    """Return a `twosided` BSDF."""
    children = {"front": front} if back is None else {"front": front, "back": back}
    return _note("twosided", [front, back or front], None, children)


def _note(kind, parts, amount, properties):
    made = mi.load_dict({"type": kind, **properties})
    _made_of[made.ptr] = (kind, parts, amount, made)
    return made


def _amount(amount, si, active):
    return mi.Float(amount) if isinstance(amount, int | float) else amount.eval_1(si, active)


def lobe_count(bsdf):
    """Return how many delta lobes a BSDF has at most."""
    kind, parts, *_ = _made_of.get(bsdf.ptr, ("plain", []))
    if kind == "twosided":
        return max(map(lobe_count, parts))
    if kind != "plain":
        return sum(map(lobe_count, parts)) + (kind == "mask")
    return sum(mi.has_flag(bsdf.flags(i), mi.BSDFFlags.Delta) for i in range(bsdf.component_count()))


def lobes(bsdf, si, active):
    """Return the delta lobes of a BSDF: (direction, weight, relative index, is a reflection)."""
    kind, parts, amount, _ = _made_of.get(bsdf.ptr, ("plain", [], None, None))
    if kind == "mask":
        opacity = _amount(amount, si, active)
        found = [(wo, w * opacity, eta, reflects) for wo, w, eta, reflects in lobes(parts[0], si, active)]
        return [*found, (-si.wi, mi.Spectrum(1 - opacity), mi.Float(1), False)]
    if kind == "blendbsdf":
        share = _amount(amount, si, active)
        shares = (1 - share, share)
        return [
            (wo, w * share, eta, reflects)
            for part, share in zip(parts, shares, strict=True)
            for wo, w, eta, reflects in lobes(part, si, active)
        ]
    if kind == "twosided":
        return _lobes_of_two_sides(parts, si, active)
    return [
        _component(bsdf, i, si, active)
        for i in range(bsdf.component_count())
        if mi.has_flag(bsdf.flags(i), mi.BSDFFlags.Delta)
    ]


def _component(bsdf, i, si, active):
    context = mi.BSDFContext()
    context.component = i
    bs, weight = bsdf.sample(context, si, 0.5, mi.Point2f(0.5), active)
    weight = dr.select(active & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta), weight, 0)
    return bs.wo, weight, bs.eta, bool(mi.has_flag(bsdf.flags(i), mi.BSDFFlags.DeltaReflection))


def _lobes_of_two_sides(parts, si, active):
    turned = mi.SurfaceInteraction3f(si)
    turned.wi = mi.Vector3f(si.wi.x, si.wi.y, abs(si.wi.z))
    behind = si.wi.z <= 0
    front, back = lobes(parts[0], turned, active & ~behind), lobes(parts[1], turned, active & behind)
    nothing = (mi.Vector3f(0, 0, 1), mi.Spectrum(0), mi.Float(1), True)
    found = []
    for slot in range(max(len(front), len(back))):
        wo, w, eta, _ = front[slot] if slot < len(front) else nothing
        wo_back, w_back, eta_back, _ = back[slot] if slot < len(back) else nothing
        wo_back = mi.Vector3f(wo_back.x, wo_back.y, -wo_back.z)
        found.append(
            (
                dr.select(behind, wo_back, wo),
                dr.select(behind, w_back, w),
                dr.select(behind, eta_back, eta),
                True,
            )
        )
    return found


def straight_through(bsdf, si, active):
    """Return the share of light that passes a surface as if it weren't there."""
    kind, parts, amount, _ = _made_of.get(bsdf.ptr, ("plain", [], None, None))
    if kind == "mask":
        opacity = _amount(amount, si, active)
        return opacity * straight_through(parts[0], si, active) + (1 - opacity)
    if kind == "blendbsdf":
        share = _amount(amount, si, active)
        first, second = (straight_through(part, si, active) for part in parts)
        return (1 - share) * first + share * second
    if kind == "plain" and mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null):
        return bsdf.eval_null_transmission(si, active)
    return mi.Spectrum(0)


@dataclass
class Found:
    """What the trees of N lanes found: radiance [N, C], and [N] each of the rest."""

    radiance: np.ndarray
    alpha: np.ndarray
    dropped_by_depth: np.ndarray
    dropped_by_cutoff: np.ndarray
    rays: dict = field(default_factory=dict)


class Oracle:
    """The ray trees of a scene.

    Args:
        scene: ``mi.Scene``; its adapters are made by the functions above.
        max_depth, min_contribution: as the integrator has them.
        mistake: one that is made on purpose: "fresnel" gives all delta lobes a weight of 1, "light" gives
            each light the numbers of the next.
    """

    def __init__(self, scene, max_depth=8, min_contribution=1 / 1024, mistake=None):
        self.scene, self.max_depth, self.min_contribution = scene, max_depth, min_contribution
        self.mistake, self.offsets = mistake, Offsets(scene)
        self.bsdfs = list({shape.bsdf().ptr: shape.bsdf() for shape in scene.shapes()}.values())
        self.branching = max(map(lobe_count, self.bsdfs), default=0)

    def estimate(self, ray, draws, active=True):
        """Return what the trees below eye rays find, as `Found`."""
        width = max(dr.width(ray), dr.width(active))
        active = mi.Bool(active) & (self.max_depth > 0)
        lanes = np.flatnonzero(np.broadcast_to(np.array(active), (width,)))
        self.found = Found(
            np.zeros((width, dr.size_v(mi.Spectrum))), *(np.zeros(width) for _ in range(3)), rays={}
        )
        self.found.rays = {kind: np.zeros(width) for kind in KINDS}
        self.found.rays["eye"][lanes] = 1
        self.found.alpha[lanes] = 1
        self.ray, self.draws, self.pending = ray, draws, []
        level = {
            "lane": mi.UInt32(lanes.astype(np.uint32)),
            "o": mi.Point3f(ray.o),
            "d": mi.Vector3f(ray.d),
            "w": dr.full(mi.Spectrum, 1, width),
            "eta": dr.full(mi.Float, 1, width),
            "id": dr.zeros(mi.UInt32, width),
            "clear": dr.full(mi.Bool, True, width),
        }
        level = {name: value if name == "lane" else _take(value, lanes) for name, value in level.items()}
        depth = 0
        while dr.width(level["lane"]):
            level = self._visit(level, depth)
            depth += 1
        return self.found

    def _visit(self, level, depth):
        """Account for what one level of rays meets; return the next level."""
        lane = level["lane"]
        ray = mi.Ray3f(
            level["o"],
            level["d"],
            dr.gather(mi.Float, self._wide(self.ray.time), lane),
            [],
        )
        if dr.size_v(self.ray.wavelengths):
            ray.wavelengths = dr.gather(type(self.ray.wavelengths), self.ray.wavelengths, lane)
        si = self.scene.ray_intersect(ray)
        dr.eval(si)
        hit = si.is_valid()
        self._add("radiance", lane, level["w"] * self._emission(si))
        if self.scene.environment() is None:
            escaped = dr.select(~hit & level["clear"], dr.mean(level["w"]), 0)
            self._add("alpha", lane, -escaped)

        within = depth + 1 < self.max_depth
        if within:
            self._add("radiance", lane, level["w"] * self._direct_light(si, hit, level))
        children = []
        for slot, (wo, weight, eta, reflects, clear) in enumerate(self._children(si, hit)):
            child = {
                "lane": lane,
                "w": level["w"] * weight,
                "eta": level["eta"] * eta,
                "id": level["id"] * self.branching + (slot + 1),
                "clear": level["clear"] & clear,
            }
            child["d"] = si.to_world(wo)
            child["o"] = self.offsets.origin(si, child["d"])
            share = dr.max(child["w"]) * dr.square(child["eta"])
            throughput = dr.mean(child["w"]) * dr.square(child["eta"])
            present = hit & (share > 0)
            if not within:
                self._add("dropped_by_depth", lane, dr.select(present, throughput, 0))
                continue
            followed = present & (share >= self.min_contribution)
            self._add("dropped_by_cutoff", lane, dr.select(present & ~followed, throughput, 0))
            self._count("reflection", lane, followed & reflects)
            self._count("transmission", lane, followed & ~reflects)
            children.append((child, followed & dr.full(mi.Bool, True, dr.width(lane))))
        self._settle(children)
        if not children:
            return {"lane": mi.UInt32()}
        children = [
            {name: _take(value, np.flatnonzero(followed.numpy())) for name, value in child.items()}
            for child, followed in children
        ]
        return {name: _joined([child[name] for child in children]) for name in level}

    def _emission(self, si):
        L, seen = mi.Spectrum(0), si.emitter(self.scene)
        for emitter in self.scene.emitters():
            meets = seen == mi.EmitterPtr(emitter)
            L = L + dr.select(meets, emitter.eval(si, meets), 0)
        return L

    def _direct_light(self, si, hit, level):
        lane, L = level["lane"], mi.Spectrum(0)
        draws = Draws(
            dr.gather(mi.UInt32, self.draws.pixel, lane),
            dr.gather(mi.UInt32, self.draws.index, lane),
            dr.gather(mi.UInt32, self._wide(self.draws.seed), lane),
            mi.UInt32(0),
        )
        for number, emitter in enumerate(self.scene.emitters()):
            u = draws("light", level["id"], number + (self.mistake == "light"))
            ds, weight = emitter.sample_direction(si, u, hit)
            value = mi.Spectrum(0)
            for bsdf, here in self._instances(si, hit):
                if mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth):
                    f = bsdf.eval(mi.BSDFContext(), si, si.to_local(ds.d), here)
                    value = value + dr.select(here, f * weight, 0)
            lit = hit & (ds.pdf != 0) & dr.any(value != 0)
            self._count("shadow", lane, lit)
            L = L + dr.select(lit, value * self._visibility(si, ds.p, lit), 0)
        return L

    def _visibility(self, si, target, active):
        passed = mi.Spectrum(1)
        ray = self._towards(si, target)
        while True:
            dr.eval(passed, active, ray)
            if not dr.any(active):
                return passed
            met = self.scene.ray_intersect(ray, active)
            active = active & met.is_valid()
            for bsdf, here in self._instances(met, active):
                passed = dr.select(here, passed * straight_through(bsdf, met, here), passed)
            active = active & dr.any(passed != 0)
            ray = self._towards(met, target)

    def _towards(self, si, target):
        """The ray to a point, but for the last bit of the way."""
        ray = mi.Ray3f(self.offsets.origin(si, target - si.p), target - si.p)
        ray.d, ray.maxt = dr.normalize(target - ray.o), dr.norm(target - ray.o) * (1 - 1e-3)
        return ray

    def _children(self, si, hit):
        """Return `branching` lobes, those of the BSDF that each lane has met."""
        slots = [
            [mi.Vector3f(0, 0, 1), mi.Spectrum(0), mi.Float(1), mi.Bool(True), mi.Bool(False)]
            for _ in range(self.branching)
        ]
        for bsdf, here in self._instances(si, hit):
            for slot, (wo, weight, eta, reflects) in zip(slots, lobes(bsdf, si, here), strict=False):
                if self.mistake == "fresnel":
                    weight = dr.select(weight != 0, mi.Spectrum(1), 0)
                straight = dr.all(wo == -si.wi) & ~mi.Bool(reflects)
                new = (wo, weight, eta, mi.Bool(reflects), straight)
                slot[:] = [dr.select(here, a, b) for a, b in zip(new, slot, strict=True)]
        return slots

    def _instances(self, si, active):
        met = si.bsdf()
        return [(bsdf, active & (met == mi.BSDFPtr(bsdf))) for bsdf in self.bsdfs]

    def _wide(self, value):
        return value + dr.zeros(type(value), len(self.found.alpha))

    def _add(self, name, lane, value):
        self.pending.append((getattr(self.found, name), lane, value))

    def _count(self, kind, lane, active):
        self.pending.append((self.found.rays[kind], lane, mi.UInt32(active)))

    def _settle(self, children):
        """Evaluate what a level has found, all in one kernel, and add it up by lane."""
        dr.eval(self.pending, children)
        for sums, lane, value in self.pending:
            value = np.array(value, np.float64)
            np.add.at(sums, lane.numpy(), np.broadcast_to(value, (*value.shape[:-1], dr.width(lane))).T)
        self.pending.clear()


def _take(value, which):
    """Return the entries of an array of Dr.Jit at the positions in a NumPy array."""
    width = int(which.max()) + 1 if len(which) else 1
    if dr.width(value) == 1:
        value = dr.select(dr.full(mi.Bool, True, width), value, value)
    return dr.gather(type(value), value, mi.UInt32(which.astype(np.uint32)))


def _joined(parts):
    return type(parts[0])(np.concatenate([np.array(part) for part in parts], axis=-1))
