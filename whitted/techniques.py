"""Whether it pays to sample the lights from rough surfaces, whose own rays may find them as well.

With ``F`` the light scattered to the eye from a direction, ``p`` the density of the surface's rays and ``q`` that of a
sample of the lights, the second moment of rays alone is the integral of ``F^2 / p``. Both techniques estimate it, as
they do that of ``F``, so that it is known even where no ray of the surface happens to meet the light; with the combined
estimate ``Z`` of the same samples

    E[F_q^2 / (p (p + q)) + F_p^2 / (p (p + q)) - Z^2]

is by how much the variance of rays alone is larger. Source: [Veach1997], chapter 9, for the weights.
"""

import drjit as dr
import mitsuba as mi

from whitted.direct import power_heuristic

VERTICES = 4  # along each path
# Of a sample of the lights at a rough surface, in rays followed: they make `gloss` 1.9 times as slow and `translucency`
# 1.7 times
SAMPLE_COST = 1.3


def excess(world, ray, active, seed):
    """Measure what sampling the lights at rough surfaces takes off the variance, and what it costs.

    Args:
        world: ``World`` whose lights can be met by rays.
        ray: ``Ray3f`` [N], eye rays.
        active: ``Bool`` [N].
        seed: ``int``.

    Returns:
        The excess of the second moment along each eye ray (``Spectrum`` [N]) if rays alone look for the lights; the
        samples of lights at rough surfaces, and the rays, per eye ray (``float``).
    """
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, dr.width(ray))
    lights, context = world.lights(), mi.BSDFContext()

    def step(number, active, si, w, more, samples, rays, sampler):
        rough = active & mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Glossy)
        n = world.light_side(si)
        shares = lights.shares(si.p, n, world.response(si, rough))
        Z, M = mi.Spectrum(0), mi.Spectrum(0)
        for group in lights.groups:
            sample = group.sample(si, n, sampler.next_2d(), sampler.next_1d(), rough, shares)
            lit = rough & (sample.pdf > 0)
            f, p = si.bsdf().eval_pdf(context, si, si.to_local(sample.d), lit)
            lit &= ~dr.all(f * sample.weight == 0)
            F = f * sample.weight * world.transmittance(si, sample.target, sample.shape, lit)
            Z += dr.select(lit, F * power_heuristic(sample.pdf, p), 0)
            M += dr.select(lit & (p > 0), dr.square(F * sample.pdf) / (p * (p + sample.pdf)), 0)
            samples += dr.select(rough, mi.UInt32(1), 0)

        bs, weight = si.bsdf().sample(context, si, sampler.next_1d(), sampler.next_2d(), active)
        active &= ~dr.all(weight == 0)
        onwards = world.spawn(si, si.to_world(bs.wo))
        following = world.scene.ray_intersect(onwards, active)
        rays += dr.select(active, mi.UInt32(1), 0)
        found = rough & active & ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        F = dr.select(found, weight * world.emission(following, found), 0)
        q = lights.pdf(following, si.p, n, found & ~dr.all(F == 0), shares)
        Z += F * power_heuristic(bs.pdf, q)
        M += dr.select(found, dr.square(F) * (bs.pdf / (bs.pdf + q)), 0)
        more += dr.square(w) * (M - dr.square(Z))
        return number + 1, active & following.is_valid(), following, w * weight, more, samples, rays, sampler

    si = world.scene.ray_intersect(ray, active)
    zeros = mi.Spectrum(0), mi.UInt32(0), dr.select(active, mi.UInt32(1), 0)
    state = (mi.UInt32(0), active & si.is_valid(), si, mi.Spectrum(1), *zeros, sampler)
    *_, more, samples, rays, _ = dr.while_loop(
        state, lambda number, active, *_: active & (number < VERTICES), step, label="techniques"
    )
    width = dr.width(ray)
    return more, float(dr.sum(samples)[0]) / width, float(dr.sum(rays)[0]) / width
