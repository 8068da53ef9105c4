"""What a BSDF does apart from scattering smoothly: its perfectly specular and its straight-through lobes.

Mitsuba draws one lobe at random; a ray tree needs all of them with their exact weights. A plain BSDF gives a lobe
when it is sampled with that component alone. The adapters don't: ``mask`` ignores the component, a ``twosided``
with one child doubles its components, ``blendbsdf`` passes the request on to children that may be masks. So these
three are taken apart here and their children are asked.
"""

import drjit as dr
import mitsuba as mi

from whitted.contents import objects_of
from whitted.errors import UsageError


def component_flags(bsdf):
    """Return the flags of each component of ``bsdf`` as a list of ``int``."""
    return [int(bsdf.flags(i)) for i in range(bsdf.component_count())]


def _sides(bsdf):
    """The front and the back child of a ``twosided`` adapter."""
    children = objects_of(bsdf)
    return children["brdf_0"], children.get("brdf_1", children["brdf_0"])


def _facing_front(si):
    """The interaction as the back side's BSDF wants it: mirrored so that ``wi`` is in the upper hemisphere."""
    si = mi.SurfaceInteraction3f(si)
    si.wi.z = dr.abs(si.wi.z)
    return si


def _opacity(bsdf, si, active):
    return dr.clip(objects_of(bsdf)["opacity"].eval_1(si, active), 0, 1)


def _blend(bsdf, si, active):
    """The two children of a ``blendbsdf``, each with its weight."""
    children = objects_of(bsdf)
    weight = dr.clip(children["weight"].eval_1(si, active), 0, 1)
    return (children["bsdf_0"], 1 - weight), (children["bsdf_1"], weight)


def count(bsdf):
    """Return how many delta lobes ``bsdf`` has at most at one point."""
    name = bsdf.class_name()
    if name == "TwoSidedBRDF":
        return max(map(count, _sides(bsdf)))
    if name == "MaskBSDF":
        return count(objects_of(bsdf)["nested_bsdf"]) + 1
    if name == "BlendBSDF":
        children = objects_of(bsdf)
        return count(children["bsdf_0"]) + count(children["bsdf_1"])
    return sum(bool(flags & mi.BSDFFlags.Delta) for flags in component_flags(bsdf))


def check_supported(bsdf):
    """Raise ``UsageError`` if the delta lobes of ``bsdf`` can't be told apart."""
    adapters = {"TwoSidedBRDF", "MaskBSDF", "BlendBSDF"}
    for child in objects_of(bsdf).values():
        if not isinstance(child, mi.BSDF):
            continue
        if child.class_name() in adapters and bsdf.class_name() not in adapters and count(child):
            raise UsageError(
                f"bsdf '{bsdf.id()}': a {child.class_name()} inside a {bsdf.class_name()} can't be split into "
                "its specular lobes; put the adapter outside"
            )
        check_supported(child)


def delta_lobes(bsdf, si, active):
    """Return the delta lobes of one BSDF instance, each ``(wo, weight, eta, kind)``.

    Args:
        bsdf: an ``mi.BSDF`` (not a pointer array: call it through ``drjit.dispatch``).
        si: ``SurfaceInteraction3f`` [N].
        active: ``Bool`` [N].

    Returns:
        A list of at most ``count(bsdf)`` tuples: direction in the local frame (``Vector3f``), throughput
        (``Spectrum``; 0 where the lobe is absent), relative index of refraction along the path (``Float``), and
        the one of Mitsuba's flags ``DeltaReflection``, ``DeltaTransmission`` and ``Null`` that it has (``int``).
    """
    name = bsdf.class_name()
    if name == "MaskBSDF":
        opacity = _opacity(bsdf, si, active)
        nested = delta_lobes(objects_of(bsdf)["nested_bsdf"], si, active)
        return [(wo, weight * opacity, eta, kind) for wo, weight, eta, kind in nested] + [
            (-si.wi, mi.Spectrum(1 - opacity), mi.Float(1), int(mi.BSDFFlags.Null))
        ]
    if name == "BlendBSDF":
        return [
            (wo, weight * share, eta, kind)
            for child, share in _blend(bsdf, si, active)
            for wo, weight, eta, kind in delta_lobes(child, si, active)
        ]
    if name == "TwoSidedBRDF":
        return _twosided_lobes(bsdf, si, active)
    return [
        _component(bsdf, index, flags, si, active)
        for index, flags in enumerate(component_flags(bsdf))
        if flags & mi.BSDFFlags.Delta
    ]


def _component(bsdf, index, flags, si, active):
    """One delta component of a plain BSDF."""
    context = mi.BSDFContext()
    context.component = index
    bs, weight = bsdf.sample(context, si, mi.Float(0.5), mi.Point2f(0.5), active)
    present = active & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
    weight = dr.select(present, weight, 0)
    kinds = (mi.BSDFFlags.Null, mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission)
    return bs.wo, weight, bs.eta, next(int(kind) for kind in kinds if flags & kind)


def _twosided_lobes(bsdf, si, active):
    front = si.wi.z > 0
    mirrored = _facing_front(si)
    sides = [
        delta_lobes(child, mirrored, active & mask)
        for child, mask in zip(_sides(bsdf), (front, ~front), strict=True)
    ]
    absent = (mi.Vector3f(0, 0, 1), mi.Spectrum(0), mi.Float(1), 0)
    lobes = []
    for slot in range(max(map(len, sides))):
        (wo, weight, eta, _), (wo_b, weight_b, eta_b, _) = (
            s[slot] if slot < len(s) else absent for s in sides
        )
        wo = mi.Vector3f(dr.select(front, wo, wo_b))
        wo.z = dr.mulsign(wo.z, si.wi.z)
        weight, eta = dr.select(front, weight, weight_b), dr.select(front, eta, eta_b)
        lobes.append((wo, weight, eta, int(mi.BSDFFlags.DeltaReflection)))  # a twosided BSDF can't transmit
    return lobes


def is_lambertian(bsdf):
    """Whether ``bsdf`` is known to be diffuse and nothing else: `diffuse_reflectance` over pi, whatever the angles."""
    if bsdf.class_name() == "TwoSidedBRDF":
        return all(map(is_lambertian, _sides(bsdf)))
    return bsdf.class_name() == "SmoothDiffuse"


def is_black(bsdf):
    """Whether ``bsdf`` is known to scatter nothing, anywhere."""
    if bsdf.class_name() == "TwoSidedBRDF":
        return all(map(is_black, _sides(bsdf)))
    try:
        return is_lambertian(bsdf) and objects_of(bsdf)["reflectance"].max() == 0
    except RuntimeError:  # textures that vary don't tell
        return False


def scatter(bsdf, si, u, v, active):
    """Sample the smooth lobes of one BSDF instance.

    Args:
        bsdf, si, active: as for `delta_lobes`.
        u: ``Float`` [N] in [0, 1), chooses among the lobes.
        v: ``Point2f`` [N] in [0, 1)^2, the direction.

    Returns:
        ``BSDFSample3f``, and the throughput (``Spectrum``; 0 where there is no smooth lobe).
    """
    name = bsdf.class_name()
    if not count(bsdf):
        return bsdf.sample(mi.BSDFContext(), si, u, v, active)
    if name == "MaskBSDF":
        sample, weight = scatter(objects_of(bsdf)["nested_bsdf"], si, u, v, active)
        return sample, weight * _opacity(bsdf, si, active)
    if name == "BlendBSDF":
        return _scatter_blend(bsdf, si, u, v, active)
    if name == "TwoSidedBRDF":
        front, mirrored = si.wi.z > 0, _facing_front(si)
        (sample, weight), (sample_b, weight_b) = (
            scatter(child, mirrored, u, v, active & side)
            for child, side in zip(_sides(bsdf), (front, ~front), strict=True)
        )
        sample = dr.select(front, sample, sample_b)
        sample.wo.z = dr.mulsign(sample.wo.z, si.wi.z)
        return sample, dr.select(front, weight, weight_b)
    context = mi.BSDFContext()
    context.type_mask = +mi.BSDFFlags.Smooth
    sample, weight = bsdf.sample(context, si, u, v, active)
    smooth = active & mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth)
    return sample, dr.select(smooth, weight, 0)


def _scatter_blend(bsdf, si, u, v, active):
    """Sample that child of a ``blendbsdf`` which has smooth lobes, or one of both by their weights."""
    first, second = [(child, share) for child, share in _blend(bsdf, si, active)]
    smooth = [
        any(flags & mi.BSDFFlags.Smooth for flags in component_flags(child)) for child, _ in (first, second)
    ]
    if not all(smooth):
        child, share = second if smooth[1] else first
        sample, weight = scatter(child, si, u, v, active)
        return sample, weight * share
    takes_first = u < first[1]
    u = dr.select(takes_first, u / first[1], (u - first[1]) / second[1])
    sample, weight = scatter(first[0], si, u, v, active & takes_first)
    sample_b, weight_b = scatter(second[0], si, u, v, active & ~takes_first)
    return dr.select(takes_first, sample, sample_b), dr.select(takes_first, weight, weight_b)


def null_transmission(bsdf, si, active):
    """Return the ``Spectrum`` that passes straight through one BSDF instance (0 for a closed surface)."""
    name = bsdf.class_name()
    if name == "MaskBSDF":
        nested = null_transmission(objects_of(bsdf)["nested_bsdf"], si, active)
        return 1 - _opacity(bsdf, si, active) * (1 - nested)
    if name == "BlendBSDF":
        return sum(share * null_transmission(child, si, active) for child, share in _blend(bsdf, si, active))
    if any(flags & mi.BSDFFlags.Null for flags in component_flags(bsdf)):
        return bsdf.eval_null_transmission(si, active)
    return mi.Spectrum(0)


def diffuse_reflectance(bsdf, si, active):
    """Return the reflectance (``Spectrum``) of the diffuse lobes of one BSDF instance."""
    name = bsdf.class_name()
    if name == "MaskBSDF":
        return diffuse_reflectance(objects_of(bsdf)["nested_bsdf"], si, active) * _opacity(bsdf, si, active)
    if name == "BlendBSDF":
        return sum(
            share * diffuse_reflectance(child, si, active) for child, share in _blend(bsdf, si, active)
        )
    if name == "TwoSidedBRDF":
        front, back = (diffuse_reflectance(child, _facing_front(si), active) for child in _sides(bsdf))
        return dr.select(si.wi.z > 0, front, back)
    if is_lambertian(bsdf):
        return dr.select(si.wi.z > 0, bsdf.eval_diffuse_reflectance(si, active), 0)  # as it is, above 1 too
    if any(flags & mi.BSDFFlags.DiffuseReflection for flags in component_flags(bsdf)):
        lit = si.wi.z > 0
        return dr.select(lit, dr.clip(bsdf.eval_diffuse_reflectance(si, active & lit), 0, 1), 0)
    return mi.Spectrum(0)
