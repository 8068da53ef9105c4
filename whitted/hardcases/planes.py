"""Rays and planes, triangles, polygons and boxes: nearly parallel, at shared edges, thin, without area, enormous."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.geometry import box, frame, plane, polygon, triangle
from whitted.hardcases.arrays import U, vector
from whitted.hardcases.case import Errors, case
from whitted.hardcases.meshes import icosphere, load_mesh, rays_at_edges, rays_at_vertices

FAMILY = "planes, triangles, boxes"
RAYS = 1 << 15


# ---- Planes


@case(
    "9", FAMILY, unit="relative",
    sweep=("slope", (1.0, 1e-2, 1e-4, 1e-6)), tolerance=lambda slope: 4 * U,
    why="two sums in twice the precision, and a division", source="OgitaRumpOishi2005",
)  # fmt: skip
def nearly_parallel_plane(slope):
    """The distance to a tilted plane along a ray of slope s to it."""
    rng = np.random.default_rng(9)
    n = rng.standard_normal((3, RAYS))
    n = np.float32(n / np.linalg.norm(n, axis=0))
    along = np.cross(n, rng.standard_normal((3, RAYS)), axis=0)
    along /= np.linalg.norm(along, axis=0)
    d = np.float32(along - slope * np.float64(n))
    o = np.float32(rng.uniform(-1, 1, (3, RAYS)))
    h = np.float32((np.float64(n) * o).sum(0) - rng.uniform(0.1, 1, RAYS))
    exact = [np.longdouble(x) for x in (n, o, d, h)]
    t = (exact[3] - (exact[0] * exact[1]).sum(0)) / (exact[0] * exact[2]).sum(0)
    arguments = vector(o), vector(d), vector(n), mi.Float(h)
    return Errors(*(np.array(form(*arguments)) / t - 1 for form in (plane.distance, plane.textbook_distance)))


# ---- Triangles

_FORMS = (triangle.hit, triangle.textbook_hit)


def _missed(aim, offset):
    """The shares of rays that meet nothing: by ours, the textbook form, and Embree as Mitsuba uses it by default."""
    vertices, faces = _icosphere(offset)
    o, d, near = aim(vertices, faces, RAYS, seed=10)
    shares = [np.mean(_hits(form, o, d, vertices, faces, near) == 0) for form in _FORMS]
    escaped = ~load_mesh(vertices, faces).ray_test(mi.Ray3f(mi.Point3f(o), vector(d)))
    return Errors(*shares, np.mean(np.array(escaped)))


def _icosphere(offset):
    vertices, faces = icosphere(3)
    return np.float32(vertices + np.array([[offset], [0], [0]])), faces


def _hits(form, o, d, vertices, faces, near):
    """How many of the triangles ``near`` it each ray meets, int [N]."""
    count = mi.UInt32(0)
    for face in near:
        corners = [vector(vertices[:, of_faces[face]]) for of_faces in faces]
        met, t, _, _ = form(vector(o), vector(d), *corners)
        count += dr.select(met & (t > 0) & mi.Bool(face >= 0), mi.UInt32(1), 0)
    return np.array(count)


@case(
    "10, 11, R6", FAMILY, unit="of the rays",
    sweep=("distance of the mesh from 0", (0.0, 1e1, 1e3)), tolerance=0,
    why="both triangles judge an edge by the same numbers, whose signs are exact", source="WoopBenthinWald2013",
)  # fmt: skip
def watertight_edges(offset):
    """Rays from inside that aim at shared edges and pass a closed mesh."""
    return _missed(rays_at_edges, offset)


@case(
    "10, 11, R6", FAMILY, unit="of the rays",
    sweep=("distance of the mesh from 0", (0.0, 1e1, 1e3)), tolerance=0,
    why="both triangles judge an edge by the same numbers, whose signs are exact", source="WoopBenthinWald2013",
)  # fmt: skip
def watertight_vertices(offset):
    """The same at shared vertices."""
    return _missed(rays_at_vertices, offset)


@case(
    "12", FAMILY, unit="of the rays",
    sweep=("distance of the mesh from 0", (0.0, 1e1, 1e3)), tolerance=0,
    why="a ray at an edge is taken to pass to one side of it, the same for all", source="EdelsbrunnerMucke1990",
)  # fmt: skip
def edges_met_once(offset):
    """Rays that meet the mesh at an edge or a vertex other than once."""
    vertices, faces = _icosphere(offset)
    aimed = [aim(vertices, faces, RAYS, seed=12) for aim in (rays_at_edges, rays_at_vertices)]
    return Errors(
        *(
            max(np.mean(_hits(form, o, d, vertices, faces, near) != 1) for o, d, near in aimed)
            for form in _FORMS
        )
    )


@case(
    "13", FAMILY, unit="of the rays",
    sweep=("height", (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)), tolerance=lambda height: 16 * U / height,
    why="the hit moves by roundings of the distance 1, a share of 4 u / h of the height, at two sides and a corner",
    source="WoopBenthinWald2013",
)  # fmt: skip
def sliver(height):
    """Wrong decisions at a triangle of base 1 and height h."""
    rng = np.random.default_rng(13)
    corners = np.float32([[0, 1, 0.3], [0, 0, height], [1, 1, 1]])
    target = np.float32([rng.random(RAYS), height * rng.uniform(-0.5, 1.5, RAYS), np.ones(RAYS)])
    o = np.float32(np.broadcast_to([[0.2], [0.1], [0.0]], target.shape))
    d = target - o
    expected = _inside_exactly(o, d, corners)
    found = [
        np.array(form(vector(o), vector(d), *map(mi.Vector3f, corners.T.tolist()))[0]) for form in _FORMS
    ]
    return Errors(*(np.mean(one != expected) for one in found))


def _inside_exactly(o, d, corners):
    """Whether rays meet a triangle, in ``longdouble``, whose 64 bits hold these signs unless they are hit to 1e-12."""
    o, d = np.longdouble(o), np.longdouble(d)
    v = np.longdouble(corners)[:, :, None] - o[:, None]
    areas = [
        np.einsum("in,in->n", np.cross(v[:, a], v[:, b], axis=0), d) for a, b in ((0, 1), (1, 2), (2, 0))
    ]
    return np.logical_and.reduce([a >= 0 for a in areas]) | np.logical_and.reduce([a <= 0 for a in areas])


@case(
    "14", FAMILY, unit="of the rays",
    sweep=("distance of its corners from 0", (1.0, 1e2, 1e4)), tolerance=0,
    why="it has no area", source="WoopBenthinWald2013",
)  # fmt: skip
def triangle_without_area(size):
    """Rays that meet a triangle whose corners are on one line."""
    rng = np.random.default_rng(14)
    corners = np.float32([[size, 0, 1], [size + 0.5, 0.5, 1], [size + 1, 1, 1]])
    u = rng.random(RAYS)
    target = np.float64(corners[0])[:, None] + u * np.float64(corners[2] - corners[0])[:, None]
    o = np.float32(np.broadcast_to([[size], [0.7], [0.0]], target.shape))
    d = np.float32(target - o)
    corners_of = [*map(mi.Vector3f, corners.tolist())]
    found = [np.array(form(vector(o), vector(d), *corners_of)[0]) for form in _FORMS]
    found[0] &= bool(
        dr.any(triangle.normal(*corners_of) != 0)
    )  # what structures leave out when they are built
    scene = load_mesh(corners.T, np.array([[0], [1], [2]]))
    return Errors(
        *(np.mean(one) for one in found),
        np.mean(np.array(scene.ray_test(mi.Ray3f(mi.Point3f(o), vector(d))))),
    )


@case(
    "15", FAMILY, unit="of the rays",
    sweep=("which", (0.0, 1.0)), tolerance=0,
    why="that triangle is never met, all others as before", source="WoopBenthinWald2013",
)  # fmt: skip
def corner_that_is_no_number(which):
    """Wrong hits on a mesh of which one triangle has a corner that is no number."""
    bad = (np.nan, np.inf)[int(which)]
    vertices, faces = _icosphere(0.0)
    broken = np.concatenate([vertices, [[bad], [0.0], [0.0]]], axis=1).astype(np.float32)
    o, d, near = rays_at_edges(vertices, faces, RAYS, seed=15)
    with_bad = np.concatenate([faces, [[0], [1], [vertices.shape[1]]]], axis=1)
    found = []
    for form in _FORMS:
        before = _hits(form, o, d, vertices, faces, near)
        after = _hits(
            form, o, d, broken, with_bad, np.concatenate([near, np.full((1, RAYS), faces.shape[1])])
        )
        found.append(np.mean(before != after))
    whole, hurt = load_mesh(vertices, faces), load_mesh(broken, with_bad)
    rays = mi.Ray3f(mi.Point3f(o), vector(d))
    t = [np.array(scene.ray_intersect_preliminary(rays).t) for scene in (whole, hurt)]
    return Errors(*found, np.mean(t[0] != t[1]))


@case(
    "16", FAMILY, unit="of its length",
    sweep=("size", (1e-30, 1e-20, 1e-10, 1.0, 1e10, 1e18, 1e20, 1e30)), tolerance=8 * U,
    why="a product of scaled edges, and its length", source="JeannerodLouvetMuller2013",
)  # fmt: skip
def normal_of_an_enormous_triangle(size):
    """The normal of a triangle with coordinates of this size, against (0, 0, 1)."""
    corners = np.float32([[0, 0, 0], [size, 0, 0], [0.3 * size, size, 0]])
    a, b, c = (mi.Vector3f(*map(float, corner)) for corner in corners)
    forms = triangle.normal(a, b, c), dr.normalize(dr.cross(b - a, c - a))
    scene = load_mesh(corners.T, np.array([[0], [1], [2]]))
    ray = mi.Ray3f(mi.Point3f(0.4 * size, 0.3 * size, -size), mi.Vector3f(0, 0, 1))
    n = np.array(scene.ray_intersect(ray).n).ravel()
    up = np.array([0, 0, 1])
    return Errors(*(np.linalg.norm(np.array(n).ravel() - up) for n in forms), np.linalg.norm(n - up))


# ---- Polygons


def star(points=7, outer=1000, inner=400):
    """The integer corners of a star, a list of pairs."""
    angles = np.pi * np.arange(2 * points) / points
    radii = np.where(np.arange(2 * points) % 2, inner, outer)
    return [
        (round(float(r * np.sin(a))), round(float(r * np.cos(a)))) for r, a in zip(radii, angles, strict=True)
    ]


@case(
    "18", FAMILY, unit="of the points",
    tolerance=0, why="areas of whole numbers below 2^11 are exact", source="Haines1994",
)  # fmt: skip
def inside_a_star():
    """Wrong decisions at a star of 14 corners, for points level with its corners."""
    corners = star()
    rng = np.random.default_rng(18)
    y = rng.choice([corner[1] for corner in corners], 20000)
    x = rng.integers(-1000, 1001, 20000)
    expected, on_edge = np.array([_inside_star(int(a), int(b), corners) for a, b in zip(x, y, strict=True)]).T
    forms = (
        form(mi.Float(np.float32(x)), mi.Float(np.float32(y)), corners)
        for form in (polygon.inside, polygon.textbook_inside)
    )
    return Errors(*(np.mean((np.array(found) != expected)[~on_edge]) for found in forms))


def _inside_star(x, y, corners):
    """Whether a point lies inside, and whether on an edge, in whole numbers."""
    inside = False
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        area = (bx - ax) * (y - ay) - (x - ax) * (by - ay)
        if area == 0 and min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
            return False, True
        if (ay <= y < by and area > 0) or (by <= y < ay and area < 0):
            inside = not inside
    return inside, False


@case(
    "19", FAMILY, unit="of the points",
    sweep=("normal's error in ulp", (-1.0, 0.0, 1.0)), tolerance=0,
    why="either of two equal axes may be dropped, one for the whole polygon", source="Haines1994",
)  # fmt: skip
def inside_on_a_plane_of_45_degrees(ulps):
    """Wrong decisions at a star on a plane whose normal has two equal components, one of them rounded."""
    corners = star()
    rng = np.random.default_rng(19)
    a, b = rng.integers(-1000, 1001, (2, 20000))
    expected, on_edge = np.array([_inside_star(int(u), int(v), corners) for u, v in zip(a, b, strict=True)]).T
    n = mi.Vector3f(1.0, 1.0 + 2 * ulps * U, 0.0)

    def projected(u, v):
        return polygon.project(
            mi.Vector3f(mi.Float(np.float32(u)), mi.Float(np.float32(-u)), mi.Float(np.float32(v))), n
        )

    flat = [tuple(float(x[0]) for x in projected(np.array([u]), np.array([v]))) for u, v in corners]
    found = np.array(polygon.inside(*projected(a, b), flat))
    return Errors(np.mean((found != expected)[~on_edge]))


@case(
    "21", FAMILY, unit="of 1",
    sweep=("angle to -z", (1.0, 0.1, 1e-2, 1e-3, 1e-4, 0.0)), tolerance=8 * U,
    why="four roundings in a component, of products of at most 1, twice in a product", source="DuffEtAl2017",
)  # fmt: skip
def frame_around_a_normal(angle):
    """How far two vectors across a unit normal are from unit length and right angles."""
    phi = np.random.default_rng(21).uniform(0, 2 * np.pi, RAYS)
    n = vector([np.sin(angle) * np.cos(phi), np.sin(angle) * np.sin(phi), -np.cos(angle) + 0 * phi])

    def error(s, t):
        s, t, m = (np.array(v, np.float64) for v in (s, t, n))
        pairs = (s, s, 1), (t, t, 1), (s, t, 0), (s, m, 0), (t, m, 0)
        return max(np.abs((x * y).sum(0) - value).max() for x, y, value in pairs)

    return Errors(error(*frame.basis(n)), error(*frame.textbook_basis(n)), error(*mi.coordinate_system(n)))


# ---- Boxes


@case(
    "20", FAMILY, unit="of the rays",
    sweep=("distance of the box from 0", (0.0, 1.0, 1e3)), tolerance=0,
    why="a closed box holds its faces", source="Ize2013",
)  # fmt: skip
def ray_in_the_face_of_a_box(offset):
    """Rays along a face of a box, in its plane, that are said to miss it."""
    rng = np.random.default_rng(20)
    low, high = mi.Point3f(-1, -1, offset), mi.Point3f(1, 1, offset + 1)
    angle = rng.uniform(0, 2 * np.pi, RAYS)
    target = rng.uniform(-0.9, 0.9, (2, RAYS))
    side = offset + rng.integers(2, size=RAYS)
    d = np.float32([np.cos(angle), np.sin(angle), 0 * angle])
    o = np.float32([*(target - 5 * np.stack([np.cos(angle), np.sin(angle)])), side])
    spans = (form(mi.Point3f(o), vector(d), low, high) for form in (box.span, box.textbook_span))
    return Errors(*(np.mean(~np.array(begin <= end)) for begin, end in spans))
