r"""Power-cosine lobes, Phong's and Blinn's, in forms that keep their digits however narrow the lobe is.

Source: [Phong1975] and [Blinn1977] for the models, [LafortuneWillems1994] for sampling. In float32 ``cos**n`` loses
its digits as ``n`` grows, 4 % at n = 1e6, since 1 - cos is about 1/n there while the cosine is stored to 6e-8. So a
lobe is given the versine 1 - cos, and powers are taken of it. Left out: anisotropic lobes.
"""

import drjit as dr
import mitsuba as mi

LOCAL_MODELS = ("bsdf", "classic")
CLASSIC = 1 << 31  # a bit of a context's mask of lobes that no kind of lobe has in Mitsuba


def bsdf_context(local_model="bsdf"):
    """Return an ``mi.BSDFContext`` that asks a BSDF for all of its lobes.

    With ``"classic"`` those that know it answer with the classical, unnormalised illumination instead, see
    `is_classic`. The request passes through Mitsuba's adapters, and other BSDFs aren't concerned.
    """
    context = mi.BSDFContext()
    if local_model == "classic":
        context.type_mask |= CLASSIC
    return context


def is_classic(context):
    """Whether an ``mi.BSDFContext`` asks for the classical illumination."""
    return bool(context.type_mask & CLASSIC)


def log1p(x):
    """Return log(1 + x), to 2e-7 relative, for a ``Float`` in [-1, 1]; at -1 it is -inf."""
    return dr.select(x < -0.5, dr.log(1 + x), 2 * dr.atanh(x / (2 + x)))


def expm1(x):
    """Return exp(x) - 1, to 2e-7 relative, for a ``Float`` in [-80, 80]."""
    return 2 * dr.exp(x / 2) * dr.sinh(x / 2)


def versine(a, b):
    """Return 1 - cos (``Float`` in [0, 2]) of the angle between two unit vectors (``Vector3f``)."""
    return dr.squared_norm(a - b) / 2


def power_cosine(versine, n):
    """Return max(cos, 0)^n.

    Args:
        versine: ``Float`` in [0, 2], 1 - cos.
        n: ``Float``, 0 to 1e30.

    Returns:
        ``Float`` in [0, 1].
    """
    in_front = dr.minimum(versine, 1 - dr.epsilon(mi.Float))  # keeps the derivative finite
    return dr.select(versine < 1, dr.exp(n * log1p(-in_front)), 0)


def square_to_power_cosine(u, n):
    r"""Sample a direction of the upper hemisphere with density (n + 1) / (2 pi) cos^n.

    .. math::
        \log\cos\theta = \frac{\log(1 - u_1)}{n + 1}, \quad \sin^2\theta = 1 - e^{2\log\cos\theta}, \quad
        \phi = 2 \pi u_2

    Args:
        u: ``Point2f`` in [0, 1)^2.
        n: ``Float``, 0 to 1e30.

    Returns:
        ``Vector3f``, unit, z >= 0; the angle has a relative error of a few float32 roundings.
    """
    log_cos = log1p(-u.x) / (n + 1)
    sin = dr.sqrt(-expm1(2 * log_cos))
    sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
    return mi.Vector3f(sin * cos_phi, sin * sin_phi, dr.exp(log_cos))


def square_to_power_cosine_pdf(versine, n):
    """Return the density (``Float`` >= 0, per solid angle) of `square_to_power_cosine` at 1 - cos = ``versine``."""
    return (n + 1) * dr.inv_two_pi * power_cosine(versine, n)


def power_cosine_to_square(v, n):
    """Return the ``Point2f`` in [0, 1]^2 that `square_to_power_cosine` maps to the direction ``v``."""
    versine = (dr.square(v.x) + dr.square(v.y)) / (1 + v.z)
    phi = dr.atan2(v.y, v.x) * dr.inv_two_pi
    return mi.Point2f(-expm1((n + 1) * log1p(-versine)), dr.select(phi < 0, phi + 1, phi))
