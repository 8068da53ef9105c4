"""Is a point inside a plane polygon?"""

import drjit as dr

from whitted.geometry.arithmetic import difference_of_products


def textbook_inside(x, y, corners):
    """Return whether a horizontal line from the point crosses an odd number of edges, each with both of its ends.

    A line through a corner crosses two edges there, or one, or none, as it may: of points level with corners a fifth
    is judged wrong.

    Args:
        x, y: ``Float`` [N].
        corners: list of pairs of numbers, in order.

    Returns:
        ``Bool`` [N].
    """
    inside = x != x
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        level = ((ay <= y) & (y <= by)) | ((by <= y) & (y <= ay))
        crossing = ax + (y - ay) * (bx - ax) / (by - ay) if by != ay else x
        inside ^= level & (crossing > x)
    return inside


def inside(x, y, corners):
    """Return the same with each edge taken without its upper end, and the side of an edge by the sign of an area.

    Exact for coordinates whose differences are. The arguments and the result are those of `textbook_inside`.
    """
    number = type(x)
    found = x != x
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        upwards, downwards = (ay <= y) & (y < by), (by <= y) & (y < ay)
        area = difference_of_products(number(bx - ax), y - ay, x - ax, number(by - ay))
        found ^= (upwards & (area > 0)) | (downwards & (area < 0))
    return found


def project(p, n):
    """Return the two coordinates of a point [N] that are left when the one along which ``n`` is longest is dropped.

    Of equal components the first is dropped, so that all edges of a polygon drop the same.
    """
    size = dr.abs(n)
    drops_x = (size.x >= size.y) & (size.x >= size.z)
    drops_y = ~drops_x & (size.y >= size.z)
    return dr.select(drops_x, p.y, dr.select(drops_y, p.z, p.x)), dr.select(
        drops_x, p.z, dr.select(drops_y, p.x, p.y)
    )
