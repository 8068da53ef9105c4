"""A warp of the unit square that follows the cosine at the receiver, given in the square's corners.

Source: [Hart2020], for warping the numbers that a sampler by solid angle is fed with. Left out: factors other than
the cosine.
"""

import drjit as dr
import mitsuba as mi

FLOOR = 0.02  # smallest weight relative to the largest, which bounds the estimate where the cosine isn't the integrand
CORNER = (
    0.86  # a linear function on a disk is fitted best, on the square that makes the disk, by its values here
)


def corner_weights(cosines):
    """Return the weights of the warp, four ``Float`` with mean 1, in the order in which the cosines come.

    Args:
        cosines: four ``Float`` [N] in the corners (0, 0), (1, 0), (0, 1), (1, 1). Where none is positive the weights
            are all 1.
    """
    highest = dr.maximum(dr.maximum(cosines[0], cosines[1]), dr.maximum(cosines[2], cosines[3]))
    raised = [dr.select(highest > 0, dr.maximum(cosine, FLOOR * highest), 1) for cosine in cosines]
    scale = 4 / (raised[0] + raised[1] + raised[2] + raised[3])
    return [weight * scale for weight in raised]


def bilinear(u, weights):
    """Draw a point of the unit square with a density that is bilinear between the weights in its corners.

    Args:
        u: ``Point2f`` [N], uniform in [0, 1)^2.
        weights: four ``Float`` [N], positive with mean 1, of ``corner_weights``.

    Returns:
        ``Point2f`` [N] in [0, 1]^2.
    """
    w00, w10, w01, w11 = weights
    y = _linear(u.y, w00 + w10, w01 + w11)
    return mi.Point2f(_linear(u.x, dr.lerp(w00, w01, y), dr.lerp(w10, w11, y)), y)


def bilinear_pdf(t, weights):
    """Return the density (``Float`` [N]) with which ``bilinear`` draws the point ``t`` of the unit square."""
    w00, w10, w01, w11 = weights
    return dr.lerp(dr.lerp(w00, w10, t.x), dr.lerp(w01, w11, t.x), t.y)


def _linear(u, a, b):
    """A number in [0, 1] whose density is linear from ``a`` to ``b``, both positive and possibly the same."""
    return dr.minimum(u * (a + b) / (a + dr.sqrt(dr.lerp(a * a, b * b, u))), 1)
