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


def direct_light(world, lights, si, draws, node, albedo, closed, combined, samples, lobes, active):
    """Estimate the light that the groups of ``lights`` send to ``si`` and that is scattered along the ray back.

    Where the light of all bounded lights is known in closed form if nothing lies between, what is sampled is only what
    is missing from it: on a diffuse surface that is noise of visibility alone.

    Args:
        world, si, draws, node: as for `transport.direct_light`.
        lights: ``Lights``.
        albedo: ``Spectrum`` [N], the reflectance of the diffuse lobes; used where ``world.is_lambertian``, or the
            light of all bounded lights is known.
        closed: ``Bool`` [N], where the closed form pays.
        combined: which lights rays from here look for as well, so that both share the estimate: masks
            (``Bool`` [N]) for the plain ones (see ``Lights.is_plain``) and for the others.
        samples: how many of each group, ``int`` or ``UInt32`` [N].
        lobes: how many rays go on from here, ``int`` or ``UInt32`` [N].
        active: ``Bool`` [N].

    Returns:
        ``Spectrum`` [N], radiance.
    """
    active = active & mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Smooth)

    def estimate(L, rays, sampler):
        world.rays = dict(rays)
        n = world.light_side(si)
        reflected = albedo * dr.inv_pi
        known = active & closed & ~dr.all(n == 0)
        if lights.is_closed:
            L = when(known, lambda L: L + reflected * lights.bounded.irradiance(si, n, known), L)
        for number, group in enumerate(lights.groups):
            L += _group(
                world, group, number, si, n, reflected, known, draws, node, combined, samples, lobes, active
            )
        return L, world.rays, sampler

    L, world.rays, _ = when(active, estimate, mi.Spectrum(0), world.rays, draws.state)
    return L


def _group(world, group, number, si, n, reflected, known, draws, node, combined, samples, lobes, active):
    """The estimate of one group: the mean of its samples."""
    is_one = isinstance(samples, int) and samples == 1
    count = mi.UInt32(samples)

    def step(j, L, rays, sampler):
        world.rays = dict(rays)
        part = None if is_one else (j, count)
        u = draws("light", node, 2 * number, part) if group.needs_point else mi.Point2f(0.5)
        choice = draws("light", node, 2 * number + 1, part).x if group.needs_choice else mi.Float(0.5)
        L = L + _sample(world, group, si, n, reflected, known, u, choice, combined, samples, lobes, active)
        return j + 1, L, world.rays, sampler

    state = (mi.UInt32(0), mi.Spectrum(0), world.rays, draws.state)
    if is_one:
        _, L, world.rays, _ = step(*state)
        return L
    going = active & dr.full(mi.Bool, True, dr.width(active))
    _, L, world.rays, _ = dr.while_loop(state, lambda j, *_: going & (j < count), step, label="light samples")
    return L / mi.Float(count)


def _sample(world, group, si, n, reflected, known, u, choice, combined, samples, lobes, active):
    """The estimate from one sample of one group, less what is known of it."""
    sample = group.sample(si, n, u, choice, active)
    wo, context = si.to_local(sample.d), mi.BSDFContext()
    if group.is_hittable and combined is not None:
        value, density = si.bsdf().eval_pdf(context, si, wo, active)
        mask = combined[0] if group.is_plain else combined[1]
        weight = power_heuristic(sample.pdf * samples, density * lobes)
        value *= dr.select(mask & (sample.pdf > 0), weight, 1)
    elif world.is_lambertian:
        value = reflected * dr.maximum(dr.dot(sample.d, n), 0)
    else:
        value = si.bsdf().eval(context, si, wo, active)
    dark = dr.all(sample.weight == 0)  # where there is no direction either
    L = dr.select(active & ~dark, value * sample.weight, 0)
    lit = active & ~dr.all(L == 0)  # NaN, for which no comparison holds, is lit and counted
    L = dr.select(
        lit, L * world.transmittance(si, sample.target, sample.shape, lit, inside=group.as_points), 0
    )
    if group.is_closed:
        expected = reflected * dr.maximum(dr.dot(sample.d, n), 0) * sample.weight
        L -= dr.select(known & ~dark, expected, 0)
    return L
