"""Two unit vectors at right angles to a third, without branches over its direction."""

import drjit as dr


def textbook_basis(n):
    r"""Return two vectors that make a right-handed frame with a unit normal [Frisvad2012].

    .. math:: b_1 = (1 - n_x^2 / (1 + n_z),\, -n_x n_y / (1 + n_z),\, -n_x), \quad
        b_2 = (-n_x n_y / (1 + n_z),\, 1 - n_y^2 / (1 + n_z),\, -n_y)

    Near to n = (0, 0, -1) the sum cancels: a tenth of a degree from it the vectors are off by a fifth.

    Args:
        n: unit vector [N].
    """
    a = 1 / (1 + n.z)
    b = -n.x * n.y * a
    vector = type(n)
    return vector(1 - n.x * n.x * a, b, -n.x), vector(b, 1 - n.y * n.y * a, -n.y)


def basis(n):
    """Return the same, with the sum taken on the side where it doesn't cancel [DuffEtAl2017]."""
    sign = dr.mulsign(type(n.x)(1), n.z)
    a = -1 / (sign + n.z)
    b = n.x * n.y * a
    vector = type(n)
    return vector(1 + sign * n.x * n.x * a, sign * b, -sign * n.x), vector(b, sign + n.y * n.y * a, -n.y)
