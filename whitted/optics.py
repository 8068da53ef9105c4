r"""Mirrors, glass and power-cosine lobes: as textbooks write them, and in forms that keep their digits.

* Reflection, refraction, Fresnel's coefficients, a slab of glass: from squares and square roots, written so that
  nothing cancels. Source: [BornWolf1999]. Left out: polarisation, metals. A picture's directions and shares of light
  are those of Mitsuba's BSDFs, which take 1 - R for what is transmitted.
* Phong's and Blinn's lobes, however narrow: source [Phong1975] and [Blinn1977] for the models, [LafortuneWillems1994]
  for sampling. In float32 ``cos**n`` loses its digits as ``n`` grows, 4 % at n = 1e6, since 1 - cos is about 1/n there
  while the cosine is stored to 6e-8. So a lobe is given the versine 1 - cos, and powers are taken of it. Left out:
  anisotropic lobes.

All but the sampled directions take single and double precision.
"""

import drjit as dr
import mitsuba as mi

from whitted.geometry.arithmetic import difference_of_products, plain_dot, sum_of_products, two_product

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


# ---- Mirrors and glass


def textbook_reflect(d, n):
    """Return d - 2 (d . n) n, which is longer or shorter than d where n is no unit vector to the last digit."""
    return d - n * (2 * plain_dot(d, n))


def reflect(d, n):
    """Return the mirror image (vector [N], of the length of d) of a direction d at a surface of normal n."""
    return d - n * (2 * dr.dot(d, n) / dr.dot(n, n))


def textbook_refract(d, n, eta):
    r"""Return the refracted direction, as lectures write Snell's law.

    .. math:: \theta = \arccos(-d \cdot n), \quad \theta_t = \arcsin(\sin\theta / \eta), \quad
        t = \sin\theta_t \frac{d + \cos\theta\, n}{\sin\theta} - \cos\theta_t\, n

    The arc cosine loses half of the digits near normal incidence, and there the fraction is 0 / 0.

    Args:
        d: unit vector [N], towards the surface.
        n: unit normal [N] on the side that d comes from.
        eta: ``Float`` > 0, the refractive index behind the surface relative to that before it.

    Returns:
        Unit vector [N]; NaN where all is reflected.
    """
    cos = -plain_dot(d, n)
    theta = dr.acos(cos)
    theta_t = dr.asin(dr.sin(theta) / eta)
    return (d + n * cos) * (dr.sin(theta_t) / dr.sin(theta)) - n * dr.cos(theta_t)


def refract(d, n, eta):
    r"""Return the refracted direction to a few roundings, at all angles and indices.

    .. math:: m = n \times d, \quad t = (m \times n - n \sqrt{\eta^2 - |m|^2}) / \eta

    The part along the surface is taken from products whose differences are rounded once, and the root from the smaller
    one of sine and cosine. Neither vector needs to have the length 1 to the last digit. Where eta is 1 the direction
    stays as it is. The arguments and the result are those of `textbook_refract`.
    """
    m = type(d)(
        difference_of_products(n.y, d.z, n.z, d.y),
        difference_of_products(n.z, d.x, n.x, d.z),
        difference_of_products(n.x, d.y, n.y, d.x),
    )
    cos = sum_of_products((d.x, n.x), (d.y, n.y), (d.z, n.z))
    sin2, cos2, nn = dr.squared_norm(m), dr.square(cos), dr.dot(n, n)
    scale = 1 / (sin2 + cos2)  # of the squared lengths
    below = eta * eta - sin2 * scale
    below = dr.select(cos2 < sin2, dr.fma(eta, eta, -1) + cos2 * scale, below)
    along = dr.cross(m, n) * dr.sqrt(scale / nn)
    return dr.select(eta == 1, d, (along - n * dr.sqrt(below / nn)) / eta)


def textbook_fresnel(cos, eta):
    r"""Return the reflected and the transmitted share of unpolarised light, as textbooks write Fresnel's equations.

    .. math:: \cos\theta_t = \sqrt{1 - (1 - \cos^2\theta) / \eta^2}, \quad
        r_s = \frac{\cos\theta - \eta \cos\theta_t}{\cos\theta + \eta \cos\theta_t}, \quad
        r_p = \frac{\eta \cos\theta - \cos\theta_t}{\eta \cos\theta + \cos\theta_t}, \quad
        R = \frac{r_s^2 + r_p^2}{2}, \quad T = 1 - R

    R loses its digits where the index is near 1, T where R is near 1.

    Args:
        cos: ``Float`` in [0, 1], of the angle of incidence.
        eta: ``Float`` > 0, the refractive index behind the surface relative to that before it.

    Returns:
        R and T, ``Float`` in [0, 1]; NaN where all is reflected.
    """
    r_s, r_p = textbook_amplitudes(cos, eta)
    R = (r_s * r_s + r_p * r_p) / 2
    return R, 1 - R


def textbook_amplitudes(cos, eta):
    """Return the r_s and r_p of `textbook_fresnel`."""
    cos_t = dr.sqrt(1 - (1 - cos * cos) / (eta * eta))
    return (cos - eta * cos_t) / (cos + eta * cos_t), (eta * cos - cos_t) / (eta * cos + cos_t)


def fresnel(cos, eta):
    r"""Return the reflected and the transmitted share of unpolarised light, each to a few roundings.

    .. math:: g = \sqrt{\eta^2 + \cos^2\theta - 1}, \quad
        T = 2 g \cos\theta \left[\frac{1}{(\cos\theta + g)^2}
        + \frac{\eta^2}{(\eta^2 \cos\theta + g)^2}\right]

    R is that of `amplitudes`; of the two the larger one is 1 less the other. The arguments and the result are those of
    `textbook_fresnel`, for eta from 1e-9 to 1e9, but R = 1 and T = 0 where all is reflected.
    """
    g = _scaled_cosine(cos, eta)
    across, along = cos + g, eta * eta * cos + g
    r_s, r_p = amplitudes(cos, eta)
    R = (dr.square(r_s) + dr.square(r_p)) / 2
    T = 2 * g * cos * (1 / dr.square(across) + dr.square(eta / along))
    T = dr.select(across == 0, 1 - R, T)
    return dr.select(R < T, R, 1 - T), dr.select(R < T, 1 - R, T)


def amplitudes(cos, eta):
    r"""Return the r_s and r_p of unpolarised light.

    .. math:: r_s = \frac{1 - \eta^2}{(\cos\theta + g)^2}, \quad
        r_p = \frac{(\eta^2 - 1) (\eta^2 \cos^2\theta + \cos^2\theta - 1)}{(\eta^2 \cos\theta + g)^2}

    with the g of `fresnel`: the differences of the textbook form are divided out. Where all is reflected, and at a
    cosine of 0, both have the magnitude 1, unless eta is 1, where they are 0. Both are 0 to rounding at their zeros
    alone.
    """
    g = _scaled_cosine(cos, eta)
    contrast = dr.fma(eta, eta, -1)
    high, low = two_product(eta, cos)
    brewster = sum_of_products((high, high), (2 * high, low), (cos, cos), (-1, type(cos)(1)))
    r_s = -contrast / dr.square(cos + g)
    r_p = contrast * brewster / dr.square(eta * eta * cos + g)
    total = (g == 0) | (cos == 0)
    limit = dr.select(contrast == 0, type(cos)(0), -dr.sign(contrast))
    return dr.select(total, limit, r_s), dr.select(total, limit, r_p)


def _scaled_cosine(cos, eta):
    """Return eta times the cosine of the refracted angle (``Float``); 0 where all is reflected."""
    return dr.sqrt(dr.maximum(sum_of_products((eta, eta), (cos, cos), (-1, type(cos)(1))), 0))


def textbook_slab(cos, eta, depth):
    r"""Return what a slab reflects and transmits, all reflections inside added up, as textbooks write the sum.

    .. math:: a = e^{-\tau}, \quad T_\infty = \frac{(1 - R)^2 a}{1 - R^2 a^2}, \quad R_\infty = R + R a T_\infty

    Light is unpolarised after each reflection.

    Args:
        cos, eta: as in `textbook_fresnel`, of the first surface.
        depth: ``Float`` >= 0, the optical depth along the refracted ray, once through.

    Returns:
        The reflected and the transmitted share, ``Float``.
    """
    R, _ = textbook_fresnel(cos, eta)
    a = dr.exp(-depth)
    through = (1 - R) * (1 - R) * a / (1 - R * R * a * a)
    return R + R * a * through, through


def slab(cos, eta, depth):
    """Return the same to a few roundings: 1 - R a is R (1 - a) + T, whose terms are both positive."""
    R, T = fresnel(cos, eta)
    a = dr.exp(-depth)
    lost = R * absorbed(depth) + T
    through = dr.select(T == 0, 0, T * (T / lost) * a / (1 + R * a))
    return R + R * a * through, through


def textbook_absorbed(depth):
    """Return the share 1 - exp(-depth) that a medium of an optical depth absorbs."""
    return 1 - dr.exp(-depth)


def absorbed(depth):
    """Return the same (``Float`` in [0, 1]) to a few roundings, for depths (``Float``) from 0 on."""
    return dr.select(depth < 1, -expm1(-dr.minimum(depth, 1)), 1 - dr.exp(-depth))


# ---- Power-cosine lobes


def log1p(x):
    """Return log(1 + x), to 2e-7 relative, for a ``Float`` in [-1, 1]; at -1 it is -inf."""
    return dr.select(x < -0.5, dr.log(1 + x), 2 * dr.atanh(x / (2 + x)))


def expm1(x):
    """Return exp(x) - 1, to 2e-7 relative, for a ``Float`` in [-80, 80]."""
    return 2 * dr.exp(x / 2) * dr.sinh(x / 2)


def versine(a, b):
    """Return 1 - cos (``Float`` in [0, 2]) of the angle between two unit vectors (``Vector3f``)."""
    return dr.squared_norm(a - b) / 2


def textbook_power_cosine(cos, n):
    """Return the power of a cosine (``Float`` in [0, 1])."""
    return dr.power(cos, n)


def power_cosine(versine, n):
    """Return max(cos, 0)^n.

    Args:
        versine: ``Float`` in [0, 2], 1 - cos.
        n: ``Float``, 0 to 1e30.

    Returns:
        ``Float`` in [0, 1].
    """
    in_front = dr.minimum(versine, 1 - dr.epsilon(versine))  # keeps the derivative finite
    return dr.select(versine < 1, dr.exp(n * log1p(-in_front)), 0)


def textbook_square_to_power_cosine(u, n):
    """Return the direction of `square_to_power_cosine`, the sine by the square of the cosine, as textbooks have it."""
    cos = dr.power(1 - u.x, 1 / (n + 1))
    sin, phi = dr.sqrt(dr.maximum(1 - cos * cos, 0)), dr.two_pi * u.y
    return mi.Vector3f(sin * dr.cos(phi), sin * dr.sin(phi), cos)


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
