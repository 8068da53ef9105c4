"""What a scene calls for: each effect that is distributed or branched over, with the evidence for it or against it.

Decided from flags and properties of the scene's objects; where these can't decide, a pilot of rays does, see
`whitted.pilot`. Left out: effects of participating media.
"""

import dataclasses
import html
import json
import re

import numpy as np

from whitted.errors import UsageError, nearest

NAMES = (
    "antialiasing",
    "soft_shadows",
    "reflection",
    "refraction",
    "gloss",
    "translucency",
    "interreflection",
    "depth_of_field",
    "motion_blur",
)
DIMENSIONS = {"antialiasing": 2, "soft_shadows": 2, "gloss": 2, "translucency": 2, "interreflection": 2}
DIMENSIONS |= {"depth_of_field": 2, "motion_blur": 1, "reflection": 0, "refraction": 0}
NEGLIGIBLE = 1e-4  # of the picture's mean: what an effect may change at most to be left out
# How rough surfaces find the lights that their rays can meet
TECHNIQUES = {
    "both": "rays and by sampling the lights",
    "lights": "sampling the lights",
    "rays": "rays alone",
}
# What becomes of light that nothing covers, where it is known
CLOSED_FORM = {True: "taken in closed form", False: "sampled"}
LISTED = 3  # names given as evidence


@dataclasses.dataclass(frozen=True)
class Finding:
    """Whether a scene calls for an effect.

    ``dimensions`` are the numbers that one sample draws for it (at each vertex); ``bound``, where a pilot decided,
    the 95 % upper bound of what leaving it out changes: ``radiance`` (mean absolute, luminance), ``relative`` to the
    mean.
    ``cost``, where it was measured: the ``operations`` that the effect adds to the kernel, its ``share_of_time``.
    """

    effect: str
    called_for: bool
    evidence: str
    bound: dict | None = None
    cost: dict | None = None

    @property
    def dimensions(self):
        """Numbers drawn for the effect by one sample at one vertex."""
        return DIMENSIONS[self.effect] if self.called_for else 0

    def to_dict(self):
        """Return the entry of ``whitted plan --json``."""
        names = ("effect", "called_for", "evidence", "dimensions", "bound")
        return {name: getattr(self, name) for name in names} | (self.cost or {})


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is simulated of a scene, and why: one `Finding` for each of `NAMES`; ``in`` asks for an effect's name."""

    scene: str
    findings: tuple
    # Of the kernel made from it, where that was measured: ``operations``, and in comparison with all effects
    # ``operations_of_all`` and the ratio ``time_to_all``
    kernel: dict = dataclasses.field(default_factory=lambda: {"operations": None})
    # At the first hit, of "light" and "lobes", where a pilot tried them out
    samples: dict = dataclasses.field(default_factory=dict)
    direct_light: str | None = (
        None  # how rough surfaces find the lights, one of `TECHNIQUES`, where there is a choice
    )
    reason: str = ""  # for that, where a pilot measured it
    closed_form: bool | None = None  # of unoccluded light on diffuse surfaces, where there is a choice
    closed_reason: str = ""  # likewise

    @property
    def effects(self):
        """The names of the effects called for, a list."""
        return [finding.effect for finding in self.findings if finding.called_for]

    @property
    def techniques(self):
        """How it is simulated, a dict: ``samples``; ``direct_light`` and ``closed_form``, each with its reason."""
        names = ("samples", "direct_light", "reason", "closed_form", "closed_reason")
        return {name: getattr(self, name) for name in names}

    def without(self, effects, reason):
        """Return the plan without some effects."""
        left_out = (Finding(f.effect, False, reason) if f.effect in effects else f for f in self.findings)
        return dataclasses.replace(self, findings=tuple(left_out))

    def __contains__(self, effect):
        return effect in self.effects

    def __getitem__(self, effect):
        return next(finding for finding in self.findings if finding.effect == effect)

    def to_dict(self):
        """Return the JSON of ``whitted plan --json``."""
        found = [finding.to_dict() for finding in self.findings]
        return {"scene": self.scene, "effects": found, "kernel": self.kernel} | self.techniques

    def __str__(self):
        rows = [("effect", "called for", "numbers", "operations", "time", "evidence")]
        for finding in self.findings:
            operations = share = ""
            if finding.cost:
                operations = f"{finding.cost['operations']:+d}"
                share = f"{100 * finding.cost['share_of_time']:.0f} %"
            is_called = "yes" if finding.called_for else "no"
            rows.append(
                (
                    finding.effect,
                    is_called,
                    str(finding.dimensions or ""),
                    operations,
                    share,
                    finding.evidence,
                )
            )
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        shared = ", ".join(f"{count} of {kind}" for kind, count in self.samples.items())
        head = self.scene
        if self.kernel["operations"]:
            head += (
                f": a kernel of {self.kernel['operations']} operations, with all effects it is of "
                f"{self.kernel['operations_of_all']}; {self.kernel['time_to_all']:.2f} of the time of that"
            )
        if shared:
            lines.append(f"samples at the first hit: {shared}")
        if self.reason:
            lines.append(f"rough surfaces find lights by {TECHNIQUES[self.direct_light]}: {self.reason}")
        if self.closed_reason:
            lines.append(f"unoccluded light is {CLOSED_FORM[self.closed_form]}: {self.closed_reason}")
        return "\n".join([head, *lines])

    def _repr_html_(self):
        return f"<pre>{html.escape(str(self))}</pre>"


def parse(spec):
    """Return ``"auto"``, ``"all"``, or a tuple of names, for what a user wrote: a name, or several in a row or a list.

    Raises:
        UsageError: a name is unknown.
    """
    names = [name for name in re.split(r"[\s,+]+", spec) if name] if isinstance(spec, str) else list(spec)
    if names in (["auto"], ["all"]):
        return names[0]
    for name in names:
        if name not in NAMES:
            hint = nearest(name, (*NAMES, "auto", "all"))
            raise UsageError(
                f"effects: {name!r} is none of them{hint}; accepted are auto, all, or {', '.join(NAMES)}"
            )
    return tuple(name for name in NAMES if name in names)


def spell(effects):
    """Return what `parse` gave as text that `parse` accepts."""
    return effects if isinstance(effects, str) else "+".join(effects)


def check_choice(integrator):
    """Raise ``UsageError`` if an integrator simulates all it can, whatever the scene."""
    if not hasattr(integrator, "effects"):
        name = " ".join(str(integrator).split()).split("[")[0]
        raise UsageError(f"effects can't be chosen for {name}; take the integrator distribution")


def chosen(integrator, wanted):
    """Return an integrator like the given one that simulates other effects, or itself where ``wanted`` is None.

    Raises:
        UsageError: it has no choice, or a name is unknown.
    """
    import mitsuba as mi

    if wanted is None:
        return integrator
    check_choice(integrator)
    return mi.load_dict(integrator.properties() | {"effects": spell(parse(wanted))})


def decide(world, sensor, wanted="auto", max_depth=-1, name="scene", pilot=None):
    """Return the `Plan` for a scene.

    Args:
        world: ``World``.
        sensor: ``mi.Sensor``, or None: then nothing is said of lens and shutter.
        wanted: as `parse` gives it.
        max_depth: of paths, -1 for no limit.
        name: of the scene.
        pilot: a `whitted.pilot.Pilot` that measures what the objects don't tell, or None: then what isn't ruled out is
            called for.
    """
    if wanted == "all":
        return Plan(name, tuple(Finding(effect, True, "asked for: all") for effect in NAMES))
    if wanted != "auto":
        asked = {True: "asked for", False: "not asked for"}
        return Plan(name, tuple(Finding(e, e in wanted, asked[e in wanted]) for e in NAMES))
    scene = _Scene(world, sensor, max_depth)
    told = {effect: getattr(scene, effect)() for effect in NAMES}
    called = [effect for effect, (is_called, _) in told.items() if is_called]
    findings = []
    for effect, (is_called, evidence) in told.items():
        bound = None
        if is_called and pilot is not None:
            is_called, seen, bound = pilot.judge(effect, called, NEGLIGIBLE)
            evidence += f"; {seen}" if seen else ""
        findings.append(Finding(effect, is_called, evidence, bound))
    return Plan(name, tuple(findings))


class _Scene:
    """What the objects of a scene tell about each effect: whether it may occur, and the evidence."""

    def __init__(self, world, sensor, max_depth):
        self.world, self.sensor = world, sensor
        self.depth = max_depth if max_depth >= 0 else 2**31

    def antialiasing(self):
        return True, "each pixel is an area of the picture"

    def soft_shadows(self):
        import mitsuba as mi

        lights = [
            e for e, is_area in zip(self.world.emitters, self.world.needs_sample, strict=True) if is_area
        ]
        if not lights:
            if not self.world.emitters:
                return False, "there is no emitter"
            return False, f"all emitters are delta: {_listed(self.world.emitters)}"
        if self.depth < 2:
            return False, f"max_depth = {self.depth}: no surface is lit"
        if not self.world.flags & mi.BSDFFlags.Smooth:
            return False, f"no surface scatters light, all are specular: {self._bsdfs()}"
        return True, f"light from an area: {_listed(lights)}"

    def reflection(self):
        return self._lobes("DeltaReflection", "GlossyReflection", "reflecting")

    def refraction(self):
        return self._lobes("DeltaTransmission", "GlossyTransmission", "refracting")

    def _lobes(self, delta, glossy, verb):
        import mitsuba as mi

        delta, glossy = (+getattr(mi.BSDFFlags, name) for name in (delta, glossy))
        found = [b for b in self.world.bsdfs if int(b.flags()) & delta and self.depth >= 2]
        found += [
            b for b in self.world.bsdfs if int(b.flags()) & glossy and self.depth >= 3 and b not in found
        ]
        if found:
            return True, f"{verb}: {_listed(found)}"
        if rough := [b for b in self.world.bsdfs if int(b.flags()) & (delta | glossy)]:
            return False, f"max_depth = {self.depth}: nothing is seen in {_listed(rough)}"
        return False, f"none is {verb}: {self._bsdfs()}"

    def gloss(self):
        return self._rough("GlossyReflection", "reflection")

    def translucency(self):
        return self._rough("GlossyTransmission", "transmission")

    def _rough(self, flag, what):
        import mitsuba as mi

        found = [b for b in self.world.bsdfs if mi.has_flag(b.flags(), getattr(mi.BSDFFlags, flag))]
        if not found:
            return False, f"no rough {what} lobe: {self._bsdfs()}"
        if self.depth < 2:
            return False, f"max_depth = {self.depth}: no surface is lit"
        return True, f"rough {what} lobe: {_listed(found)}"

    def interreflection(self):
        import mitsuba as mi

        found = [b for b in self.world.bsdfs if int(b.flags()) & mi.BSDFFlags.Diffuse]
        if not found:
            return False, f"no surface is diffuse: {self._bsdfs()}"
        if self.depth < 3:
            return False, f"max_depth = {self.depth}: light is scattered once at most"
        return True, f"diffuse: {_listed(found)}"

    def depth_of_field(self):
        if self.sensor is None:
            return True, "the eye rays are given"
        if not self.sensor.needs_aperture_sample():
            return False, f"{_name(self.sensor)} has no aperture"
        radius = _aperture(self.sensor)
        if radius is None:
            return True, f"{_name(self.sensor)} has an aperture"
        return radius > 0, f"aperture_radius = {radius:g}"

    def motion_blur(self):
        if self.sensor is None:
            return True, "the eye rays are given"
        open_for = float(np.ravel(self.sensor.shutter_open_time())[0])
        if not open_for > 0:
            return False, "shutter_open = shutter_close"
        return True, f"the shutter is open for {open_for:g}"

    def _bsdfs(self):
        return _listed(self.world.bsdfs)


def _aperture(sensor):
    """The radius of a lens as its parameters tell it, or None."""
    import mitsuba as mi

    parameters = mi.traverse(sensor)
    found = [key for key in parameters.keys() if key.split(".")[-1] == "aperture_radius"]  # noqa: SIM118
    return float(np.ravel(parameters[found[0]])[0]) if found else None


def _name(thing):
    """An object as a user knows it: its id, if it was given one, and its kind."""
    kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", thing.class_name()).lower()
    given = thing.id()
    return f"{kind} '{given}'" if given and not given.startswith(("_", "bsdf_", "emitter_")) else kind


def _listed(things):
    names = list(dict.fromkeys(map(_name, things)))
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return (", ".join(names[:LISTED]) + more) or "there is none"


def as_json(plan):
    """Return the findings of a plan on one line, for a picture's header."""
    return json.dumps(plan.to_dict()["effects"], separators=(",", ":"))
