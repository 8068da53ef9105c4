"""Does a ray meet a triangle, and where; as Moeller and Trumbore write it, and watertight.

A watertight test lets no ray pass between two triangles that share an edge: both judge it by the same numbers. Left
out: culling by side.
"""

import drjit as dr

from whitted.geometry.arithmetic import difference_of_products, plain_dot


def textbook_hit(o, d, v0, v1, v2):
    r"""Return the distance and the barycentric coordinates of v1 and v2 [MoellerTrumbore1997].

    .. math:: \begin{pmatrix} t \\ u \\ v \end{pmatrix} = \frac{1}{(d \times e_2) \cdot e_1}
        \begin{pmatrix} (s \times e_1) \cdot e_2 \\ (d \times e_2) \cdot s \\ (s \times e_1) \cdot d \end{pmatrix}

    with :math:`e_i = v_i - v_0` and :math:`s = o - v_0`. Each triangle judges a shared edge by numbers of its own: one
    ray in ten that aims at such an edge passes between both.

    Args:
        o: point [N].
        d: vector [N], of any length.
        v0, v1, v2: points [N].

    Returns:
        ``Bool`` [N], whether the ray's line meets the triangle, edges included; ``Float`` t, u, v.
    """
    e1, e2, s = v1 - v0, v2 - v0, o - v0
    p, q = _plain_cross(d, e2), _plain_cross(s, e1)
    inverse = 1 / plain_dot(p, e1)
    u, v = plain_dot(p, s) * inverse, plain_dot(q, d) * inverse
    return (u >= 0) & (v >= 0) & (u + v <= 1), plain_dot(q, e2) * inverse, u, v


def hit(o, d, v0, v1, v2):
    r"""Return the same, watertight, and with each crossing of a mesh counted once.

    The triangle is moved and sheared so that the ray becomes the z axis [WoopBenthinWald2013]; the signs of three areas
    in the plane decide. These are differences of two products, rounded once [JeannerodLouvetMuller2013], so that their
    signs are exact, where the paper falls back on double precision. On an edge or a corner the ray is taken to pass
    infinitely little to one side of it [EdelsbrunnerMucke1990]: of the triangles around it that face the ray one is
    met, so that a closed mesh is entered as often as it is left. Triangles without area are to be left out before, see
    `normal`: rounding may give them some. Coordinates less than 1e-19 apart underflow.

    The arguments and the result are those of `textbook_hit`; t, u and v are 0 where nothing is met.
    """
    number = type(d.x)
    x, y, z = _axes(d)
    dz = z(d)
    sx, sy, sz = x(d) / dz, y(d) / dz, 1 / dz
    corners = []
    for vertex in (v0, v1, v2):
        relative = vertex - o
        depth = z(relative)
        corners.append((dr.fma(-sx, depth, x(relative)), dr.fma(-sy, depth, y(relative)), depth * sz))
    areas = []
    left, right = number(1) == 1, number(1) == 1
    for k in range(3):
        (ax, ay, _), (bx, by, _) = corners[(k + 1) % 3], corners[(k + 2) % 3]
        area = difference_of_products(ax, by, ay, bx)
        areas.append(area)
        upwards, downwards = (by > ay) | ((by == ay) & (bx > ax)), (by < ay) | ((by == ay) & (bx < ax))
        left &= (area > 0) | ((area == 0) & upwards)
        right &= (area < 0) | ((area == 0) & downwards)
    total = areas[0] + areas[1] + areas[2]
    met = (left | right) & dr.isfinite(total)
    scale = dr.select(met, 1 / total, 0)
    t = (areas[0] * corners[0][2] + areas[1] * corners[1][2] + areas[2] * corners[2][2]) * scale
    return met, t, areas[1] * scale, areas[2] * scale


def normal(v0, v1, v2):
    """Return the unit normal [N] of triangles of any size that has an area; 0 where it has none.

    The edges are scaled to 1 first: their product would overflow beyond 1e19, and vanish below 1e-19.
    """
    e1, e2 = v1 - v0, v2 - v0
    size = dr.maximum(dr.max(dr.abs(e1)), dr.max(dr.abs(e2)))
    scale = dr.select(size > 0, 1 / size, 0)
    e1, e2 = e1 * scale, e2 * scale
    n = type(e1)(
        difference_of_products(e1.y, e2.z, e1.z, e2.y),
        difference_of_products(e1.z, e2.x, e1.x, e2.z),
        difference_of_products(e1.x, e2.y, e1.y, e2.x),
    )
    length = dr.norm(n)
    return n * dr.select(length > 0, 1 / length, 0)


def _plain_cross(a, b):
    """The cross product as a textbook writes it."""
    return type(a)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def _axes(d):
    """Functions that take a vector's components such that the third is the one along which ``d`` is longest."""
    size = dr.abs(d)
    is_x = (size.x >= size.y) & (size.x >= size.z)
    is_y = ~is_x & (size.y >= size.z)

    def third(v):
        return dr.select(is_x, v.x, dr.select(is_y, v.y, v.z))

    def first(v):
        return dr.select(is_x, v.y, dr.select(is_y, v.z, v.x))

    def second(v):
        return dr.select(is_x, v.z, dr.select(is_y, v.x, v.y))

    return first, second, third
