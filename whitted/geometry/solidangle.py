"""Solid angles of lights and the irradiance from them, as textbooks write them; `whitted.lights` has what keeps digits.

The receiver is at the origin.
"""

import drjit as dr

from whitted.geometry.arithmetic import plain_dot


def textbook_sphere(sine2):
    r"""Return the solid angle of a sphere, and the cosine of its angular radius.

    .. math:: \Omega = 2 \pi (1 - \cos \sigma), \quad \cos \sigma = \sqrt{1 - \sin^2 \sigma}

    1 - cos cancels for small ones: below a radius of 1e-3 of the distance it is off by several per cent, at 1e-4 it
    is 0.

    Args:
        sine2: ``Float`` [N], the square of the radius over the distance.
    """
    cosine = dr.sqrt(1 - sine2)
    return 2 * dr.pi * (1 - cosine), cosine


def textbook_sphere_irradiance(sine, cosine):
    r"""Return the irradiance from a sphere of radiance 1 whose middle is seen at a cosine of the normal.

    .. math:: E = \begin{cases} \pi \sin^2 \sigma \cos \theta & \cos \theta > \sin \sigma \\
        \sin^2 \sigma (\cos \theta \arccos y - x q) + \arctan (q / x) & |\cos \theta| < \sin \sigma \\
        0 & \text{else} \end{cases}

    with :math:`x = \sqrt{1 / \sin^2 \sigma - 1}`, :math:`y = -x \cot \theta`, :math:`q = \sin \theta \sqrt{1 - y^2}`.
    The terms cancel for small spheres, and rounding may leave roots of negative numbers, above all on the sphere.

    Args:
        sine: ``Float`` [N], of the angular radius.
        cosine: ``Float`` [N], of the angle between the normal and the middle.
    """
    sine2, sine_n = sine * sine, dr.sqrt(1 - cosine * cosine)
    x = dr.sqrt(1 / sine2 - 1)
    y = -x * cosine / sine_n
    q = sine_n * dr.sqrt(1 - y * y)
    cut = sine2 * (cosine * dr.acos(y) - x * q) + dr.atan(q / x)
    return dr.select(cosine > sine, dr.pi * sine2 * cosine, dr.select(cosine < -sine, 0, cut))


def textbook_disk_irradiance(x, h, radius):
    r"""Return the irradiance from a disk of radiance 1 that is parallel to the receiver.

    .. math:: E = \frac{\pi}{2} \left(1 - \frac{x^2 + h^2 - r^2}{\sqrt{(x^2 + h^2 + r^2)^2 - 4 r^2 x^2}} \right)

    The difference cancels from afar.

    Args:
        x: ``Float`` [N], the receiver's distance from the axis.
        h: ``Float`` [N], its distance from the plane.
        radius: ``Float`` [N].
    """
    total = x * x + h * h
    root = dr.sqrt(dr.square(total + radius * radius) - 4 * radius * radius * x * x)
    return dr.pi / 2 * (1 - (total - radius * radius) / root)


def textbook_rectangle(x0, x1, y0, y1, z):
    r"""Return the solid angle of the rectangle [x0, x1] x [y0, y1] at height z, by its angles [UrenaFajardoKing2013].

    .. math:: \Omega = \sum_i \gamma_i - 2 \pi, \quad \gamma_i = \arccos(-n_i \cdot n_{i + 1})

    with the unit normals of the planes through the edges. From afar the angles are nearly right ones, and all digits
    cancel at a hundred sizes.

    Args:
        x0, x1, y0, y1, z: ``Float`` [N].
    """
    # The components along z of the normals; neighbouring ones share no other
    slopes = [at * dr.rsqrt(z * z + at * at) for at in (-y0, x1, y1, -x0)]
    angles = [dr.acos(-a * b) for a, b in zip(slopes, [*slopes[1:], slopes[0]], strict=True)]
    return sum(angles) - 2 * dr.pi


def textbook_polygon_irradiance(corners, n):
    r"""Return the irradiance from a plane polygon of radiance 1 above the horizon [Lambert1760].

    .. math:: E = \frac{1}{2} \left| \sum_i \gamma_i\, n \cdot \frac{v_i \times v_{i + 1}}{|v_i \times v_{i + 1}|}
        \right|, \quad \gamma_i = \arccos \frac{v_i \cdot v_{i + 1}}{|v_i| |v_{i + 1}|}

    The arc cosine of a number near 1 has half of its digits, and the terms cancel for small polygons.

    Args:
        corners: list of vectors [N], as seen from the receiver.
        n: vector [N], unit.
    """
    total = 0
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        cross = type(a)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
        angle = dr.acos(plain_dot(a, b) / dr.sqrt(plain_dot(a, a) * plain_dot(b, b)))
        total = total + angle * plain_dot(n, cross) / dr.sqrt(plain_dot(cross, cross))
    return dr.abs(total) / 2
