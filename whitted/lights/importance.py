"""How much light may come from what is known by its bounds alone: the weight of a choice among lights.

Source: [EstevezKulla2018] for bounds with cones of normals, [PharrJakobHumphreys2023], section 12.6.3, for the angles
that bound the cosines. Of the cosines that the bounds allow the mean is taken rather than the largest, which comes
nearer to the irradiance where the bounds are wide.
"""

import drjit as dr
import mitsuba as mi

MARGIN = 1e-3  # of a cosine: single precision loses up to 4e-4, in sqrt(1 - c**2) of c near 1
DEFENCE = 0.2  # of the largest cosine allowed, the least that its mean counts as; tried from 0.02 to 0.5
BESIDE = 0.05  # of the cosine, what is added to the response to light from the centre
FAINTEST = (
    1e-20  # least importance of what may contribute; the strongest light's is about 0.1 amid the lights
)


def importance(bounds, p, n, response=None):
    r"""Return the importance (``Float`` [M]) of what lies within some bounds for a receiver; 0 for NaN.

    The importance of a power Phi is

    ``Phi / (pi sin^2 theta_e) * mean cosine at the light * mean cosine at the receiver / d^2``,

    where ``d`` is the distance of the centre of its bounding sphere, but at least ``radius / sqrt(3)``: the mean of
    ``1 / distance^2`` over a ball, seen from its centre, is ``3 / radius^2``. Each cosine is thought of as even over
    the range that the sphere and the cone of normals allow, and counts as 0 below 0. The importance is 0 only where
    one of these ranges ends below 0, or that at the light below ``cos theta_e``: then no light comes from the node.
    Of a small light it is the irradiance, but for a factor common to all: ``Phi / (4 pi) cos / d^2`` of a point, and
    ``Phi / pi cos cos / d^2`` of a flat diffuse one. Cosines below `MARGIN` count as `MARGIN`.

    Args:
        bounds: 11 ``Float`` [M or 1]: centre and radius of the bounding sphere; axis of the cone of normals, and the
            intensity, which is the first factor; cosine and sine of the cone's half angle, ``cos theta_e``.
        p: ``Point3f`` [M].
        n: ``Vector3f`` [M], unit: light comes from the side that it points to; or 0: from all sides.
        response: a mask and a ``Float`` [M], the BSDF times the cosine for light from the centre, which takes the place
            of the mean cosine at the receiver where the mask is set.
    """
    x, y, z, radius, *axis, intensity, cos_spread, sin_spread, cos_emission = bounds[:11]
    w = mi.Vector3f(x - p.x, y - p.y, z - p.z)
    d2, r2 = dr.squared_norm(w), radius * radius
    is_inside = d2 <= r2
    inverse = dr.rsqrt(dr.maximum(d2, r2))
    w = w * inverse
    sin_box = dr.select(is_inside, 0, radius * inverse)  # inside, the centre may be seen in any direction
    cos_box = dr.select(is_inside, -1, dr.safe_sqrt(1 - sin_box * sin_box))
    box, cone = (cos_box, sin_box), (cos_spread, sin_spread)
    at_receiver, most_at_receiver = _mean_cosine(dr.dot(n, w), box)
    at_light, most_at_light = _mean_cosine(-dr.dot(mi.Vector3f(axis), w), cone, box)
    is_one_sided = ~(dr.squared_norm(n) == 0)  # also for NaN
    lit = (intensity > 0) & (most_at_light > cos_emission - MARGIN)
    lit = lit & (~is_one_sided | (most_at_receiver > -MARGIN))
    at_receiver = dr.select(is_one_sided, at_receiver, 1)
    if response is not None:  # light beside the centre may find more
        is_known, value = response
        at_receiver = dr.select(is_known, value + BESIDE * at_receiver, at_receiver)
    found = intensity * at_light * at_receiver / dr.maximum(d2, r2 / 3)
    return dr.select(lit & (found < dr.inf), dr.maximum(found, FAINTEST), 0)


def _mean_cosine(cosine, *spreads):
    """Return the mean of ``max(0, x)`` for ``x`` even between the cosines that an angle may have, and the largest.

    The angle has ``cosine`` but may be off by the angles ``spreads``, given as pairs of cosine and sine.
    """
    most, least = cosine, -cosine
    for cos_b, sin_b in spreads:
        most, least = _cos_difference(most, cos_b, sin_b), _cos_difference(least, cos_b, sin_b)
    high, low = dr.maximum(most, MARGIN), -least
    crossing = high * dr.maximum(high / (2 * (high - low)), DEFENCE)
    return dr.select(low >= 0, (low + high) / 2, crossing), most


def _cos_difference(cos_a, cos_b, sin_b):
    """``cos(max(0, a - b))`` of angles in [0, pi]."""
    return dr.select(cos_a > cos_b, 1, cos_a * cos_b + dr.safe_sqrt(1 - cos_a * cos_a) * sin_b)
