r"""The distribution of the normals of a rough surface, GGX, in a form that keeps its digits however smooth it is.

Source: [WalterEtAl2007]. In single precision the textbook form loses its digits as the surface gets smooth, all of them
at alpha = 1e-4. The rough BSDFs of a picture are Mitsuba's, which takes the stable form.
"""

import drjit as dr


def textbook_ggx(m, alpha):
    r"""Return the density of microscopic normals, as textbooks write it.

    .. math:: D = \frac{\alpha^2}{\pi (\cos^2\theta_m (\alpha^2 - 1) + 1)^2}

    Args:
        m: unit vector [N] in the frame of the surface, z > 0.
        alpha: ``Float`` in (0, 1], the roughness.

    Returns:
        ``Float`` > 0, area of microscopic surface for each area and solid angle.
    """
    a2 = alpha * alpha
    term = m.z * m.z * (a2 - 1) + 1
    return a2 / (dr.pi * term * term)


def ggx(m, alpha):
    r"""Return the same to a few roundings.

    .. math:: D = \frac{1}{\pi \alpha^2 ((m_x^2 + m_y^2) / \alpha^2 + m_z^2)^2}
    """
    slope = alpha * dr.fma(m.z, m.z, (dr.square(m.x) + dr.square(m.y)) / dr.square(alpha))
    return dr.inv_pi / dr.square(slope)
