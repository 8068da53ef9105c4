r"""Phong's model as a BSDF that conserves energy: a diffuse and a glossy lobe, in Phong's or in Blinn's form.

Source: [LafortuneWillems1994] for the modified Phong model, which is [Phong1975] times a cosine and normalised;
[Blinn1977] for the half vector, [Giesen2009] for its normalisation. Left out: Fresnel's factor, and shadowing.
"""

import math
import textwrap

import drjit as dr
import mitsuba as mi

from whitted import optics
from whitted.errors import UsageError

TEXTURES = ("diffuse_reflectance", "specular_reflectance", "shininess")
DIFFUSE, GLOSSY = range(2)  # components


class PhongBSDF(mi.BSDF):
    r"""Modified Phong reflection (``phong``).

    ======================== ================ ============================================================ =======
    parameter                type             meaning                                                      default
    ======================== ================ ============================================================ =======
    ``diffuse_reflectance``  texture          :math:`k_d`                                                  0.5
    ``specular_reflectance`` texture          :math:`k_s`                                                  0.2
    ``shininess``            float or texture the exponent :math:`n` > 0; texels below 0 count as 0        30
    ``lobe``                 string           ``phong``: about the mirror direction; ``blinn``: the half   phong
                                              vector about the normal
    ======================== ================ ============================================================ =======

    With :math:`\alpha` the angle between :math:`\omega_o` and the mirror direction of :math:`\omega_i`, and
    :math:`\theta_h` the angle between their half vector and the normal,

    .. math::
        f_\mathrm{phong} = \frac{k_d}{\pi} + k_s \frac{n + 2}{2 \pi} \cos^n \alpha, \quad
        f_\mathrm{blinn} = \frac{k_d}{\pi} + k_s \frac{(n + 2)(n + 4)}{8 \pi (2^{-n/2} + n)} \cos^n \theta_h

    * Energy: at normal incidence :math:`k_d + k_s` is reflected, and nowhere more. Where the two exceed 1 in a
      colour, both are divided by their sum.
    * Reciprocal. Only the front reflects: put it into a ``twosided`` for both sides.
    * Samples are drawn from the lobes, chosen in proportion to their reflectances; those of the glossy lobe that
      point below the surface are lost, and their share of the density with them.
    * Where the local model of ``whitted`` is ``classic``, the value is that of the classical illumination,
      :math:`(k_d \cos \theta_o + k_s \cos^n \alpha) / \pi`, which doesn't conserve energy.

    .. code-block:: xml

        <bsdf type="phong">
            <rgb name="diffuse_reflectance" value="0.6, 0.1, 0.1"/>
            <float name="specular_reflectance" value="0.3"/>
            <float name="shininess" value="100"/>
        </bsdf>
    """

    def __init__(self, props):
        super().__init__(props)
        self.diffuse_reflectance = props.get_texture("diffuse_reflectance", 0.5)
        self.specular_reflectance = props.get_texture("specular_reflectance", 0.2)
        self.shininess = props.get_texture("shininess", 30.0)
        self.lobe = props.get("lobe", "phong")
        if self.lobe not in LOBES:
            raise UsageError(f"lobe is {self.lobe!r}; accepted are {' and '.join(LOBES)}")
        for name in TEXTURES:
            _check(name, getattr(self, name))

        def flags(kind, *textures):
            varies = any(texture.is_spatially_varying() for texture in textures)
            return kind | mi.BSDFFlags.FrontSide | (mi.BSDFFlags.SpatiallyVarying if varies else 0)

        both = self.diffuse_reflectance, self.specular_reflectance  # each lobe's share depends on both
        self.m_components = [
            flags(mi.BSDFFlags.DiffuseReflection, *both),
            flags(mi.BSDFFlags.GlossyReflection, *both, self.shininess),
        ]
        self.m_flags = self.m_components[DIFFUSE] | self.m_components[GLOSSY]

    def sample(self, ctx, si, sample1, sample2, active=True):
        """Sample a direction of one lobe; see ``mi.BSDF``."""
        kd, ks, n = self._parameters(si, active)
        is_glossy = sample1 < _glossy_share(ctx, kd, ks)
        glossy = LOBES[self.lobe].sample(si.wi, optics.square_to_power_cosine(sample2, n))
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(is_glossy, glossy, mi.warp.square_to_cosine_hemisphere(sample2))
        bs.eta = 1
        bs.sampled_component = dr.select(is_glossy, mi.UInt32(GLOSSY), mi.UInt32(DIFFUSE))
        bs.sampled_type = dr.select(
            is_glossy, mi.UInt32(+mi.BSDFFlags.GlossyReflection), mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
        )
        value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
        return bs, dr.select(bs.pdf == 0, 0, value / bs.pdf)  # NaN stays NaN

    def eval(self, ctx, si, wo, active=True):
        """Return the BSDF times the cosine, or the classical illumination; see ``mi.BSDF``."""
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        """Return the density of ``sample``; see ``mi.BSDF``."""
        return self.eval_pdf(ctx, si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        """Return ``eval`` and ``pdf``; see ``mi.BSDF``."""
        kd, ks, n = self._parameters(si, active)
        has_diffuse, has_glossy = _enabled(ctx)
        power, normalisation, glossy_pdf = LOBES[self.lobe].evaluate(si.wi, wo, n)
        glossy = power * dr.inv_pi if optics.is_classic(ctx) else normalisation * power * wo.z
        cosine_pdf = wo.z * dr.inv_pi
        value, pdf = mi.Spectrum(0), mi.Float(0)
        if has_diffuse:
            value += kd * cosine_pdf
        if has_glossy:
            value += ks * glossy
        if has_diffuse or has_glossy:
            share = _glossy_share(ctx, kd, ks)
            pdf = (1 - share) * cosine_pdf + share * glossy_pdf
        active = active & (si.wi.z > 0) & (wo.z > 0)
        return dr.select(active, value, 0), dr.select(active, pdf, 0)

    def eval_diffuse_reflectance(self, si, active=True):
        """Return the reflectance of the diffuse lobe; see ``mi.BSDF``."""
        return self._parameters(si, active)[0]

    def traverse(self, callback):
        """Show the textures to ``mi.traverse``."""
        for name in TEXTURES:
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def to_string(self):
        """Return the parameters on several lines."""
        values = [f"{name} = {getattr(self, name)}" for name in (*TEXTURES, "lobe")]
        return "PhongBSDF[\n" + textwrap.indent(",\n".join(values), "  ") + "\n]"

    def _parameters(self, si, active):
        """Return both reflectances (``Spectrum``), scaled so that their sum is at most 1, and the exponent."""
        kd, ks = self.diffuse_reflectance.eval(si, active), self.specular_reflectance.eval(si, active)
        most = dr.maximum(kd + ks, 1)
        return kd / most, ks / most, dr.maximum(self.shininess.eval_1(si, active), 0)


class _Phong:
    """The lobe about the mirror direction of ``wi``."""

    @staticmethod
    def sample(wi, about_z):
        """Return the direction that corresponds to one about the z axis."""
        return mi.Frame3f(mi.reflect(wi)).to_world(about_z)

    @staticmethod
    def evaluate(wi, wo, n):
        """Return the power of the cosine, the factor that normalises it, and the density of the samples."""
        versine = optics.versine(wo, mi.reflect(wi))
        pdf = optics.square_to_power_cosine_pdf(versine, n)
        return optics.power_cosine(versine, n), (n + 2) * dr.inv_two_pi, pdf


class _Blinn:
    """The lobe of the half vector about the normal."""

    @staticmethod
    def sample(wi, about_z):
        """Return the direction whose half vector with ``wi`` is ``about_z``."""
        return mi.reflect(wi, about_z)

    @staticmethod
    def evaluate(wi, wo, n):
        """Return what the other lobe returns."""
        both = wi + wo
        length = dr.norm(both)  # twice the cosine between wi and the half vector
        versine = (dr.square(both.x) + dr.square(both.y)) / (length * (length + both.z))
        normalisation = (n + 2) / (8 * dr.pi) * ((n + 4) / (dr.exp2(-n / 2) + n))
        pdf = optics.square_to_power_cosine_pdf(versine, n) / (2 * length)
        return optics.power_cosine(versine, n), normalisation, pdf


LOBES = {"phong": _Phong, "blinn": _Blinn}


def _enabled(ctx):
    """Whether the diffuse and the glossy lobe are asked for."""
    return (
        ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, DIFFUSE),
        ctx.is_enabled(mi.BSDFFlags.GlossyReflection, GLOSSY),
    )


def _glossy_share(ctx, kd, ks):
    """Return the probability (``Float``) with which the glossy lobe is sampled."""
    has_diffuse, has_glossy = _enabled(ctx)
    if not (has_diffuse and has_glossy):
        return mi.Float(has_glossy)
    kd, ks = dr.mean(kd), dr.mean(ks)
    return dr.select(kd + ks == 0, 0.5, ks / (kd + ks))


def _check(name, texture):
    """Raise ``UsageError`` if the mean of a texture is out of range; some textures don't know theirs."""
    try:
        mean = mi.Float(texture.mean())[0]
    except RuntimeError:
        return
    if not (0 <= mean < math.inf) or (name == "shininess" and mean == 0):
        accepted = "finite numbers above 0" if name == "shininess" else "0 to 1"
        raise UsageError(f"{name} is {mean:g}; accepted are {accepted}")


mi.register_bsdf("phong", PhongBSDF)
