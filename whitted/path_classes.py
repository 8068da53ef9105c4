r"""Which classes of light paths two integrators estimate, and whether that makes a difference on a scene.

Paths are words in Heckbert's notation [Heckbert1990]: E the eye, S a perfectly specular reflection or
refraction, D every other lobe, L the light. Straight passages through null, mask and thin surfaces are not
counted. An integrator may declare a regular expression over these letters as its attribute ``estimates``;
without it, ``E (S | D)* L`` is taken. Where two expressions differ, paths are sampled on the scene, and
those that carry light and belong to one expression only are named. Media are left out, and so is the
truncation at ``max_depth``: words up to the smaller one are compared, and what lies beyond is left to the
statistics.
"""

import math
import re
from dataclasses import asdict, dataclass, field

import numpy as np

from whitted.replicates import box_sensor

EVERYTHING = "E (S | D)* L"
PATHS = 1 << 17  # sampled; a class that one path in 30 000 meets is missed with probability 1.3 %
LONGEST = 12  # interactions followed; a longer class rarely occurs without a shorter one
NULLS = 16  # straight passages followed on the way to a light
_LETTERS = {1: "D", 2: "S"}


@dataclass(frozen=True)
class Classes:
    """Whether two integrators estimate the same paths of a scene; if not, ``reason`` says which differ."""

    comparable: bool
    reason: str = ""
    shares: dict = field(default_factory=dict)  # word -> share of the radiance, of the words on one side only
    paths: int = 0  # how many were sampled

    def to_dict(self):
        """Return the numbers for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Estimate:
    """What an integrator estimates: the expression, its depth (None: no limit) and its shadow rays."""

    expression: str
    max_depth: int | None
    crosses_null: bool  # shadow rays pass null, mask and thin surfaces

    def holds(self, word):
        """Whether a word such as ``EDL`` belongs to the expression."""
        return re.fullmatch(self.expression.replace(" ", ""), word) is not None


def estimate(integrator):
    """Return the `Estimate` of an ``mi.Integrator``."""
    text = describe(integrator)
    expression = getattr(integrator, "estimates", None)
    depth = getattr(integrator, "max_depth", None)
    if depth is None and (printed := re.search(r"max_depth\s*=\s*(-?\d+)", text)):
        depth = int(printed[1])
    if depth is not None and not 0 <= depth < 2**31:
        depth = None
    return Estimate(expression or EVERYTHING, depth, expression is not None or text.startswith("Volumetric"))


def describe(integrator):
    """Return an integrator's name and parameters on one line."""
    try:
        text = " ".join(str(integrator).split())
    except RuntimeError:  # a Python plugin without to_string
        text = type(integrator).__name__
    return text.replace("[ ", "[").replace(" ]", "]").replace("4294967295", "-1")


def has_null(scene):
    """Whether an ``mi.Scene`` has a surface that lets light pass straight through."""
    import mitsuba as mi

    bsdfs = (shape.bsdf() for shape in scene.shapes())
    return any(bsdf is not None and mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null) for bsdf in bsdfs)


def compare_classes(scene, sensor, a, b, *, seed=0, paths=PATHS):
    """Decide whether two integrators estimate the same paths of a scene, as `Classes`.

    Args:
        scene, sensor: ``mi.Scene`` and ``mi.Sensor``.
        a, b: ``mi.Integrator``; two without a declared expression are always comparable.
        seed: of the sampled paths.
        paths: how many to sample. A class that is not found carries light on less than about 4.6 / ``paths``
            of them (99 % confidence).
    """
    sides = estimate(a), estimate(b)
    if sides[0].expression == sides[1].expression and sides[0].crosses_null == sides[1].crosses_null:
        return Classes(True)
    if all(getattr(integrator, "estimates", None) is None for integrator in (a, b)):
        return Classes(True)
    depth = min([side.max_depth for side in sides if side.max_depth is not None], default=LONGEST + 1)
    found, through_null = _sample(scene, sensor, min(depth - 1, LONGEST), seed, paths)
    total = sum(found.values())
    alone = {w: v for w, v in found.items() if sides[0].holds(w) != sides[1].holds(w)}
    shares = {" ".join(w): v / total for w, v in sorted(alone.items(), key=lambda item: -item[1])}
    if shares:
        named = ", ".join(f"{word} ({_percent(share)})" for word, share in list(shares.items())[:3])
        more = f" and {len(shares) - 3} more" if len(shares) > 3 else ""
        expressions = " against ".join(side.expression for side in sides)
        return Classes(False, f"{expressions}: only one side has {named} of the light{more}", shares, paths)
    if sides[0].crosses_null != sides[1].crosses_null and any(
        all(s.holds(w) for s in sides) for w in through_null
    ):
        reason = (
            "light passes null, mask or thin surfaces on its way to others, and only one side's shadow rays "
        )
        return Classes(False, reason + "let it: take volpath as the reference", {}, paths)
    return Classes(True, f"{paths} sampled paths found no light that only one side estimates", {}, paths)


def _percent(share):
    return f"{100 * share:.2g} %"


def _sample(scene, sensor, longest, seed, paths):
    """Follow random paths; return radiance by word, of all and of those that end across a null surface."""
    import drjit as dr
    import mitsuba as mi

    camera = box_sensor(sensor, "independent")
    sampler = camera.sampler()
    sampler.seed(seed, paths)
    time = camera.shutter_open() + sampler.next_1d() * camera.shutter_open_time()
    ray, throughput = camera.sample_ray(time, sampler.next_1d(), sampler.next_2d(), sampler.next_2d())
    word = dr.full(mi.UInt32, 1, paths)  # base 4, a leading 1
    active, specular = dr.full(mi.Bool, True, paths), dr.full(mi.Bool, True, paths)
    length = dr.zeros(mi.UInt32, paths)
    context, found, through_null = mi.BSDFContext(), {}, {}
    for _ in range(longest + NULLS):
        si = scene.ray_intersect(ray, active)
        # Emission: after D it belongs to the sampled light below
        emitter = si.emitter(scene, active)
        glow = active & specular & (emitter != None)  # noqa: E711, lanes of pointers
        _add(found, word, dr.select(glow, throughput * emitter.eval(si, glow), 0))
        # Direct light
        bsdf = si.bsdf(ray)
        active &= si.is_valid() & (length < longest)
        smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        ds, weight = scene.sample_emitter_direction(si, sampler.next_2d(), False, smooth)
        light = throughput * weight * bsdf.eval(context, si, si.to_local(ds.d), smooth)
        light = dr.select(smooth & (ds.pdf > 0), light, 0)
        clear, crossed = _visible(scene, si, ds, dr.any(light > 0))
        _add(found, word * 4 + 1, dr.select(clear & ~crossed, light, 0))
        _add(through_null, word * 4 + 1, dr.select(clear & crossed, light, 0))
        # Branch
        sample, weight = bsdf.sample(context, si, sampler.next_1d(), sampler.next_2d(), active)
        throughput *= weight
        null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        active &= dr.any(throughput > 0)
        word = dr.select(null, word, word * 4 + dr.select(delta, mi.UInt32(2), mi.UInt32(1)))
        length += dr.select(null, mi.UInt32(0), mi.UInt32(1))
        specular = dr.select(null, specular, delta)
        ray = si.spawn_ray(si.to_world(sample.wo))
        dr.eval(ray, throughput, word, length, active, specular, sampler)
        if not dr.any(active):
            break
    return found, through_null


def _visible(scene, si, ds, active):
    """Return whether nothing opaque lies between, and whether a null surface does."""
    import drjit as dr
    import mitsuba as mi

    origin, crossed, opaque = si, dr.zeros(mi.Bool, dr.width(active)), dr.zeros(mi.Bool, dr.width(active))
    for _ in range(NULLS):
        hit = scene.ray_intersect(origin.spawn_ray_to(ds.p), active)
        active &= hit.is_valid()
        null = active & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.Null)
        opaque |= active & ~null
        crossed |= null
        active, origin = null, hit
        dr.eval(active, opaque, crossed, origin)
        if not dr.any(active):
            break
    return ~opaque, crossed


def _add(found, words, radiance):
    """Add the mean radiance of each word, which ends on a light, to the dict ``found``."""
    import drjit as dr

    values = np.array(dr.mean(radiance), np.float64)
    words = np.array(words)
    carrying = (values > 0) & np.isfinite(values)
    names, index = np.unique(words[carrying], return_inverse=True)
    for name, value in zip(names, np.bincount(index, values[carrying]) / len(words), strict=True):
        text = f"E{_spell(int(name))}L"
        found[text] = found.get(text, 0.0) + float(value)


def _spell(word):
    letters = (math.floor(math.log2(word)) // 2) if word > 1 else 0
    return "".join(_LETTERS[word >> 2 * i & 3] for i in reversed(range(letters)))
