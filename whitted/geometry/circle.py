"""What two circles of a plane have in common."""

import drjit as dr

from whitted.geometry.arithmetic import two_sum

SMALL = 1.5  # radians, below which x - sin x is summed as a series


def textbook_lens_area(r, R, d):
    r"""Return the area of the lens in which two circles overlap, at a distance d of their centres.

    .. math:: A = r^2 \arccos \frac{d^2 + r^2 - R^2}{2 d r} + R^2 \arccos \frac{d^2 + R^2 - r^2}{2 d R}
        - \frac{1}{2} \sqrt{(-d + r + R) (d + r - R) (d - r + R) (d + r + R)}

    All digits cancel where the circles barely overlap.

    Args:
        r, R, d: ``Float`` [N], with \|R - r\| < d < R + r.
    """
    first = dr.acos((d * d + r * r - R * R) / (2 * d * r))
    second = dr.acos((d * d + R * R - r * r) / (2 * d * R))
    root = dr.sqrt((-d + r + R) * (d + r - R) * (d - r + R) * (d + r + R))
    return r * r * first + R * R * second - root / 2


def lens_area(r, R, d):
    r"""Return the same as the sum of two segments, :math:`\tfrac{r^2}{2} (\varphi - \sin \varphi)`.

    Half of each angle is the arc sine of half the common chord where that is small, the overlap r + R - d is exact, and
    small differences are summed as a series. The arguments and the result are those of `textbook_lens_area`.
    """
    s, error = two_sum(r, R)
    chord = dr.sqrt(((s - d) + error) * (d + (r - R)) * (d + (R - r)) * (d + s)) / (2 * d)
    return _segment(r, R, d, chord) + _segment(R, r, d, chord)


def _segment(r, R, d, chord):
    """What half the chord cuts off the circle of radius r."""
    sine, cosine = chord / r, ((d - R) * (d + R) + r * r) / (2 * d * r)
    small = dr.asin(
        dr.minimum(sine, 1)
    )  # Dr.Jit's arc tangent is off by up to 13 roundings, its arc sine by 3
    half = dr.select(sine < 0.7, dr.select(cosine > 0, small, dr.pi - small), dr.safe_acos(cosine))
    return r * r * _less_sine(2 * half) / 2


def _less_sine(x):
    """x - sin x."""
    x2, total = x * x, 0
    for k in range(17, 1, -2):
        total = x2 / (k * (k - 1)) * (1 - total)
    return dr.select(x < SMALL, x * total, x - dr.sin(x))
