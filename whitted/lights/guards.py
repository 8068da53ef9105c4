"""What keeps lights without area, lights seen edge on and lights that are touched from giving NaN or infinity."""

import drjit as dr


def sampled(origin, offset, v, density):
    """Put together what a light's ``sample`` returns; no comparison holds for NaN, so it ends here.

    Args:
        origin: ``Point3f`` [N or 1], a point of the light.
        offset: ``Vector3f`` [N], from it to the sampled point.
        v: ``Vector3f`` [N], from the receiver to the sampled point.
        density: ``Float`` [N], by solid angle.

    Returns:
        The sampled point, the unit direction to it, the distance and the density; where the density isn't positive
        and finite, ``origin``, 0, 0 and 0.
    """
    distance = dr.norm(v)
    good = (density > 0) & (density < dr.inf) & (distance > 0) & (distance < dr.inf)
    q = origin + dr.select(good, offset, 0)
    return q, dr.select(good, v / distance, 0), dr.select(good, distance, 0), dr.select(good, density, 0)


def usable(density):
    """Return a density (``Float``) where it is positive and finite, else 0."""
    return dr.select((density > 0) & (density < dr.inf), density, 0)
