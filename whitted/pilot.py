"""A short pilot of rays, for what the objects of a scene don't tell of the effects that it calls for.

Geometry first, which is cheap: does anything move, how far does the lens blur, do diffuse surfaces see each other, how
large are the lights seen from the surfaces. Where that leaves an effect close to nothing, the difference that it makes
to the radiance of the same samples. Left out: light on paths that fewer than one sample in 10^5 meets.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import techniques
from whitted.film import cropped, eye_rays, luminance
from whitted.sampling.draws import joint_dimensions
from whitted.sampling.groups import Segments
from whitted.sampling.sequences import hash4

SAMPLES, BOUND_SAMPLES = 1 << 18, 1 << 20  # for looks, and for the bound of what an effect changes
BOUNCES = 6
ERRORS, UNSEEN = 1.645, 3.0  # 95 %: standard errors, and how many rare events of a kind may not have come up
# Sizes from which on there is no need to look further
EVIDENT = {"interreflection": 0.01, "depth_of_field": 0.5, "soft_shadows": 0.02, "motion_blur": 0.0}
ON_EYE_RAYS = ("depth_of_field", "motion_blur")


class Pilot:
    """Measurements on one scene.

    Args:
        integrator: has ``estimate(world, ray, draws, plan, active)``.
        world: ``World``.
        sensor: ``mi.Sensor``.
    """

    def __init__(self, integrator, world, sensor):
        self.integrator, self.world, self.sensor = integrator, world, sensor
        self.size = tuple(int(n) for n in sensor.film().size())

    def judge(self, effect, called, negligible):
        """Return whether an effect is called for, the evidence, and the bound of what leaving it out changes, or None.

        Args:
            effect: one that can't be ruled out otherwise.
            called: the names of all such effects.
            negligible: the relative bound up to which an effect isn't called for.
        """
        look = getattr(self, f"_{effect}", None)
        if look is None:
            return True, "", None
        with dr.suspend_grad(), cropped(self.sensor):
            size, evidence = look()
            if size > EVIDENT[effect]:
                return True, evidence, None
            if size == 0 and effect in ON_EYE_RAYS:
                return False, evidence, None
            bound = self._difference(effect, frozenset(called))
        return not bound["relative"] <= negligible, evidence, bound

    def direct_light(self, called):
        """Return how the light at rough surfaces is best found, ``both`` or ``rays``, and why.

        Samples of the lights pay if they take off the variance more than they add to the time.
        """
        effects = frozenset(called)
        is_rough = self.world.flags & mi.BSDFFlags.Glossy
        if not (is_rough and effects & {"gloss", "translucency"} and self.world.lights().is_hittable):
            return "both", ""
        with dr.suspend_grad(), cropped(self.sensor):
            ray, weight, _, _, active = self._eye_rays(effects)
            more, samples, rays = techniques.excess(self.world, ray, active, seed=1)
            more = luminance(more * dr.square(weight), ray.wavelengths).numpy().astype(np.float64)
            first, second = self._luminance(effects), self._luminance(effects, seed=1)
        with np.errstate(invalid="ignore"):  # infinity less infinity
            both = _finite_mean(np.square(first - second)) / 2
        more = max(_finite_mean(more), 0) / both if both > 0 else np.inf
        slower = techniques.SAMPLE_COST * samples / rays
        saved = 100 * slower / (1 + slower)
        said = f"rays alone would have {100 * more:.3g} % more variance in {saved:.2g} % less time"
        return "rays" if more < slower else "both", said

    def pixels(self, plan, seed, count, spp):
        """Return the luminance of pixels chosen at random (float64 [count]), the same for all seeds.

        Args:
            plan: `whitted.effects.Plan`.
            seed: ``int``, of the samples.
            count: ``int``, number of pixels.
            spp: ``int``, samples of each.

        ``world.rays`` are those of these samples afterwards.
        """
        with dr.suspend_grad(), cropped(self.sensor):
            found = self._luminance(plan, seed, _Scattered(*self.size, count * spp, spp), counted=True)
        return found.reshape(count, spp).mean(1)

    def _difference(self, effect, called):
        """The upper bound of the mean change in radiance if an effect is left out, absolute and relative."""
        joint = joint_dimensions(called)  # the same numbers, whatever is left out
        grid = _Scattered(*self.size, BOUND_SAMPLES)
        on, off = (self._luminance(plan, grid=grid, joint=joint) for plan in (called, called - {effect}))
        finite = np.isfinite(on) & np.isfinite(off)
        if not finite.any():
            return {"radiance": np.inf, "relative": np.inf}
        change, mean = np.abs(on[finite] - off[finite]), on[finite].mean()
        seen = change.mean() + ERRORS * change.std() / np.sqrt(change.size)
        changing = finite if effect in ON_EYE_RAYS else finite & ~self._sees_light(grid)
        radiance = seen + UNSEEN / change.size * np.abs(on[changing]).max(initial=0)
        relative = radiance / mean if mean > 0 else (0.0 if radiance == 0 else np.inf)
        return {"radiance": float(radiance), "relative": float(relative)}

    def _sees_light(self, grid):
        """Which samples' eye rays meet a light, and so don't change with what follows: a bool array."""
        ray, *_, active = self._eye_rays(frozenset({"antialiasing", *ON_EYE_RAYS}), grid=grid)
        si = self.world.scene.ray_intersect(ray, active)
        return (si.emitter(self.world.scene, active) != None).numpy()  # noqa: E711

    def _luminance(self, plan, seed=0, grid=None, joint=None, counted=False):
        """The luminance of the pilot's samples, a float64 array [lanes of the grid]; ``world.rays``: theirs or none."""
        ray, weight, draws, _, active = self._eye_rays(plan, seed, grid)
        if joint is not None:
            draws.joint = joint
        self.world.count_rays(counted)
        found = self.integrator.estimate(self.world, ray, draws, plan, active)
        dr.eval(found["radiance"], self.world.rays)
        return luminance(found["radiance"] * weight, ray.wavelengths).numpy().astype(np.float64)

    def _eye_rays(self, plan, seed=0, grid=None):
        return eye_rays(self.sensor, self.size, grid or _Scattered(*self.size), Segments(seed), plan)

    # ---- Each of these returns a size and what to say of it

    def _motion_blur(self):
        position = mi.Point2f(np.random.default_rng(0).random((2, 256), np.float32))
        opened = self.sensor.shutter_open()
        first, last = (
            self.sensor.sample_ray_differential(time, 0.5, position, mi.Point2f(0.5))[0]
            for time in (opened, opened + self.sensor.shutter_open_time())
        )
        moved = float(dr.max(dr.maximum(dr.norm(last.o - first.o), dr.norm(last.d - first.d)))[0])
        return moved, "the camera moves" if moved else "nothing moves"

    def _depth_of_field(self):
        """How far rays through the lens are off those through its centre where these hit, in pixels."""
        centre, *_, active = self._eye_rays(frozenset())
        through_lens, *_ = self._eye_rays(frozenset({"depth_of_field"}))
        beside = self._beside()
        si = self.world.scene.ray_intersect(centre, active)
        far = 1e4 * float(dr.norm(self.world.scene.bbox().extents()))
        p = centre(dr.select(si.is_valid(), si.t, far))

        def off(ray):
            return dr.norm(ray(dr.dot(p - ray.o, centre.d) / dr.dot(ray.d, centre.d)) - p)

        pixels = (off(through_lens) / off(beside)).numpy()[active.numpy()]
        largest = float(np.nanmax(pixels, initial=0))
        return largest, f"rays through it are off by up to {largest:.2g} pixels"

    def _beside(self):
        """Eye rays through the centre of the lens, one pixel to the right of the pilot's."""
        x, y, *_ = _Scattered(*self.size).samples()
        position = (mi.Point2f(x + 1, y) + 0.5) * mi.ScalarPoint2f(1 / self.size[0], 1 / self.size[1])
        time = self.sensor.shutter_open()
        return self.sensor.sample_ray_differential(time, 0.5, position, mi.Point2f(0.5))[0]

    def _interreflection(self):
        """The share of rays from diffuse surfaces that meet another surface."""
        ray, *_, active = self._eye_rays(frozenset())
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(0, SAMPLES)
        context = mi.BSDFContext()

        def step(active, ray, was_diffuse, tries, hits, sampler):
            si = self.world.scene.ray_intersect(ray, active)
            met = active & si.is_valid()
            sample, weight = si.bsdf().sample(context, si, sampler.next_1d(), sampler.next_2d(), met)
            met &= ~dr.all(weight == 0)  # black surfaces don't count
            hits += dr.select(met & was_diffuse, mi.UInt32(1), 0)
            is_diffuse = met & mi.has_flag(sample.sampled_type, mi.BSDFFlags.Diffuse)
            tries += dr.select(is_diffuse, mi.UInt32(1), 0)
            return met, self.world.spawn(si, si.to_world(sample.wo)), is_diffuse, tries, hits, sampler

        start = (active, ray, mi.Bool(False), mi.UInt32(0), mi.UInt32(0), sampler)

        def bounded(bounce, *state):
            return bounce + 1, *step(*state)

        state = dr.while_loop(
            (mi.UInt32(0), *start), lambda bounce, active, *_: active & (bounce < BOUNCES), bounded
        )
        tries, hits = (int(dr.sum(count)[0]) for count in state[4:6])
        share = hits / tries if tries else 0.0
        return share, f"of {tries} rays from diffuse surfaces {100 * share:.2g} % meet a surface"

    def _soft_shadows(self):
        """The largest angle in radians in which a light is seen from a surface that the eye sees."""
        lights = self.world.lights()
        if lights.environment is not None or lights.only_met:
            return np.pi, "its angle may be large"
        ray, *_, active = self._eye_rays(frozenset())
        si = self.world.scene.ray_intersect(ray, active)
        receives = si.is_valid() & (si.emitter(self.world.scene) == None)  # noqa: E711
        p = np.array(si.p).T[receives.numpy()][:: SAMPLES >> 12]
        largest = max((_angle(p, *box) for box in lights.bounded.boxes), default=0.0)
        return largest, f"seen in an angle of up to {largest:.2g} rad"


def _angle(p, lower, upper):
    """The largest angle in radians in which a box is seen from points [N, 3]."""
    distance = np.linalg.norm(np.maximum(np.maximum(lower - p, p - upper), 0), axis=1).min(initial=np.inf)
    return float(2 * np.arctan2(np.linalg.norm(upper - lower) / 2, distance))


class _Scattered:
    """Samples of pixels at random, with the interface of `whitted.film.Grid`; by default one of each."""

    start = 0

    def __init__(self, width, height, lanes=SAMPLES, spp=1):
        self.width, self.height, self.spp = width, height, spp
        self.lanes = self.count = lanes

    def samples(self):
        """Return x and y (``Int32``), the sample's number, the block's, and who is active."""
        lane = dr.arange(mi.UInt32, self.lanes)
        spp = dr.opaque(mi.UInt32, self.spp)
        choice = lane // spp
        a, b, *_ = hash4(choice, mi.UInt32(1), mi.UInt32(2), mi.UInt32(3))
        x, y = a % dr.opaque(mi.UInt32, self.width), b % dr.opaque(mi.UInt32, self.height)
        number = lane - choice * spp + choice // (self.width * self.height) * spp
        return mi.Int32(x), mi.Int32(y), number, lane // 16, dr.full(mi.Bool, True, self.lanes)


def _finite_mean(values):
    """The mean of the values that are finite, a float; 0 if none is."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else 0.0
