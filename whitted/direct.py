"""Direct light at a vertex: each group of lights is sampled, combined with the rays that the surface sends out itself.

Source: [Veach1997] for combining, [SzecsiSbertSzirmayKalos2004] for the unoccluded light as a control variate.
"""

import drjit as dr
import mitsuba as mi

from whitted.transport import when


def power_heuristic(pdf, other):
    """Return the weight (``Float`` in [0, 1]) of a sample of density ``pdf`` that has a competitor of ``other``."""
    pdf, other = dr.square(pdf), dr.square(other)
    return dr.select(pdf > 0, pdf / (pdf + other), 0)


class DirectLight:
    """The estimate of the light that reaches a vertex from the lights directly and is scattered along the ray back.

    Where the light of all bounded lights is known in closed form if nothing lies between, what is sampled is only what
    is missing from it: on a diffuse surface that is noise of visibility alone.

    Args:
        world: ``World``.
        lights: ``Lights``.
        draws: numbers, asked for effect ``light`` twice for each group: for the point and for the choice.
        si: ``SurfaceInteraction3f`` [N].
        node: ``UInt32`` [N], the vertex's node of the ray tree.
        albedo: ``Spectrum`` [N], the reflectance of the diffuse lobes; used where ``world.is_lambertian`` or where the
            closed form is.
        closed: ``Bool`` [N], where the closed form pays; None: nowhere.
        combined: which lights rays from here look for as well, so that both may share the estimate: None, or masks
            (``Bool`` [N]) for the plain lights (see ``Lights.is_plain``) and for the others.
        samples: how many of each group, ``int`` or ``UInt32`` [N].
        rays: how many rays go on from here, ``int`` or ``UInt32`` [N].
        rough: ``Bool`` [N], where the surface has rough lobes; None: nowhere.
        technique: how these find lights that their rays can meet, one of `effects.TECHNIQUES`.

    Attributes:
        shares: what the choice of a bounded light went by, see `Lights.shares`; known after ``estimate``.
    """

    def __init__(
        self,
        world,
        lights,
        draws,
        si,
        node,
        albedo,
        closed,
        combined=None,
        samples=1,
        rays=1,
        rough=None,
        technique="both",
    ):
        self.world, self.lights, self.draws = world, lights, draws
        self.si, self.node, self.combined = si, node, combined
        self.samples, self.rays = samples, rays
        self.rough, self.technique = rough, technique
        self.n = world.light_side(si)
        self.reflected = albedo * dr.inv_pi
        if closed is not None:
            closed = closed & ~dr.all(self.n == 0) & ~dr.all(albedo == 0)
            if technique == "rays":
                closed &= ~rough
        self.closed = closed

    def estimate(self, active):
        """Return the radiance (``Spectrum`` [N]); 0 where not ``active`` (``Bool`` [N])."""
        active = active & self.world.scatters(self.si)
        if self.technique == "rays" and not any(group.has_deltas for group in self.lights.groups):
            active = active & ~self.rough

        def lit(L, shares, rays, sampler):
            self.world.rays = dict(rays)
            response = None
            if self.rough is not None and self.technique != "rays":
                response = self.world.response(self.si, self.rough)
            self.shares = self.lights.shares(self.si.p, self.n, response)
            if self.closed is not None:
                L = when(self.closed, lambda L: L + self._unoccluded(active & self.closed), L)
            for number, group in enumerate(self.lights.groups):
                L += self._group(number, group, active)
            return L, self.shares if shares_type else None, self.world.rays, sampler

        shares_type = self.lights.shares_type
        none = shares_type(0) if shares_type else None
        L, self.shares, self.world.rays, _ = when(
            active, lit, mi.Spectrum(0), none, self.world.rays, self.draws.state
        )
        return L

    def _unoccluded(self, active):
        return self.reflected * self.lights.bounded.irradiance(self.si, self.n, active)

    def _group(self, number, group, active):
        """The mean of the samples of one group."""
        if self.technique == "rays" and not group.has_deltas:
            active = active & ~self.rough
        is_one = isinstance(self.samples, int) and self.samples == 1
        count = mi.UInt32(self.samples)

        def step(j, L, rays, sampler):
            self.world.rays = dict(rays)
            draws = self.draws if is_one else self.draws.part(j, count)
            u, choice = mi.Point2f(0.5), mi.Float(0.5)
            if group.needs_point:
                u = draws("light", self.node, 2 * number)
            if group.needs_choice:
                choice = draws("light", self.node, 2 * number + 1).x
            L = L + self._sample(group, u, choice, active)
            return j + 1, L, self.world.rays, sampler

        state = (mi.UInt32(0), mi.Spectrum(0), self.world.rays, self.draws.state)
        if is_one:
            _, L, self.world.rays, _ = step(*state)
            return L
        going = active & dr.full(mi.Bool, True, dr.width(active))
        _, L, self.world.rays, _ = dr.while_loop(
            state, lambda j, *_: going & (j < count), step, label="light samples"
        )
        return L / mi.Float(count)

    def _sample(self, group, u, choice, active):
        """The estimate from one sample of one group, less what is known of it."""
        sample = group.sample(self.si, self.n, u, choice, active, self.shares)
        dark = dr.all(sample.weight == 0)  # where there is no direction either
        scattered = self._scattered(group, sample, active)
        self.world.watch("light sample", sample.weight, self.si, active)
        self.world.watch("BSDF", scattered, self.si, active & ~dark)
        L = dr.select(active & ~dark, scattered * sample.weight, 0)
        lit = active & ~dr.all(L == 0)  # NaN, for which no comparison holds, is lit and counted
        passed = self.world.transmittance(self.si, sample.target, sample.shape, lit, inside=group.as_points)
        self.world.watch("transmittance", passed, self.si, lit)
        L = dr.select(lit, L * passed, 0)
        if group.is_closed and self.closed is not None:
            expected = self.reflected * dr.maximum(dr.dot(sample.d, self.n), 0) * sample.weight
            L -= dr.select(active & self.closed & ~dark, expected, 0)
        return L

    def _scattered(self, group, sample, active):
        """The BSDF times the cosine, and times the share that the sample has in the estimate beside rays from here."""
        if self.combined is None or not group.is_hittable:
            if self.world.is_lambertian:
                return self.reflected * dr.maximum(dr.dot(sample.d, self.n), 0)
            return self.si.bsdf().eval(mi.BSDFContext(), self.si, self.si.to_local(sample.d), active)
        value, density = self.si.bsdf().eval_pdf(
            mi.BSDFContext(), self.si, self.si.to_local(sample.d), active
        )
        share = power_heuristic(sample.pdf * self.samples, density * self.rays)
        if self.technique != "both":
            share = dr.select(self.rough, mi.Float(self.technique == "lights"), share)
        mask = self.combined[0] if group.is_plain else self.combined[1]
        return value * dr.select(mask & (sample.pdf > 0), share, 1)
