"""Rays that leave surfaces: meshes of all sizes near 0 and far from it, narrow gaps, thin slabs, inner corners."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.geometry import triangle
from whitted.hardcases.arrays import vector
from whitted.hardcases.case import Errors, case
from whitted.hardcases.meshes import icosphere, load_mesh
from whitted.offsets import Offsets

FAMILY = "leaving surfaces"
RAYS = 1 << 14
LEAST = 1e-4  # the distance from which on a hit counts, as lectures have it
DIRECTION = np.array([1, 0.3, -0.7])  # in which things lie that aren't at 0
PLACES = (0.0, 1e2, 1e4)  # in sizes of the thing
SCALES = (1e-6, 1e-3, 1.0, 1e3, 1e6)
ETA = 1.5


class Faces:
    """A closed mesh as a scene, whose intersection is watertight, and as triangles for the textbook form."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = np.float32(vertices), faces
        self.scene = load_mesh(self.vertices, faces, robust=True)
        self.offsets = Offsets(self.scene)

    def ours(self, si, direction):
        """The ray that the toolkit lets leave."""
        return mi.Ray3f(self.offsets.origin(si, direction), direction)

    def met_again(self, si, d):
        """Whether rays that leave it meet it, ``bool`` [N]: by ours, the textbook form, Mitsuba's offset."""
        return (
            self.is_met(self.ours(si, d)),
            self.is_met_beyond_least(si.p, d),
            self.is_met(si.spawn_ray(d)),
        )

    def is_met(self, ray):
        """Whether rays meet the mesh, ``bool`` [N]."""
        return np.array(self.scene.ray_test(ray))

    def is_met_beyond_least(self, o, d):
        """Whether rays meet it at a distance that a textbook counts, by its test, ``bool`` [N]."""
        corners = [mi.Float(np.ravel(self.vertices[:, of_faces].T)) for of_faces in self.faces]

        def step(face, met):
            at = (dr.gather(mi.Vector3f, one, face) for one in corners)
            inside, t, _, _ = triangle.textbook_hit(o, d, *at)
            return face + 1, met | (inside & (t > LEAST))

        start = mi.UInt32(0), dr.zeros(mi.Bool, dr.width(d))
        count = dr.opaque(mi.UInt32, self.faces.shape[1])
        return np.array(dr.while_loop(start, lambda face, met: face < count, step, label="faces")[1])


def directions(rng, n, least=0.01):
    """Random directions about unit normals (``Normal3f`` [N]), at cosines from ``least`` on, ``Vector3f`` [N]."""
    count = dr.width(n)
    cosine, phi = rng.uniform(least, 1, count), rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    return dr.normalize(mi.Frame3f(n).to_world(vector([sine * np.cos(phi), sine * np.sin(phi), cosine])))


# ---- Closed meshes


def _shell(size, place, outside):
    """An icosphere, points on it that rays from within have met, and directions to one side of it."""
    vertices, faces = icosphere(1)
    centre = (place * size * DIRECTION)[:, None]
    mesh = Faces(size * vertices + centre, faces)
    rng = np.random.default_rng(22)
    o = np.float32(centre + size * rng.uniform(-0.2, 0.2, (3, RAYS)))
    d = vector(rng.standard_normal((3, RAYS)))
    si = mesh.scene.ray_intersect(mi.Ray3f(mi.Point3f(o), dr.normalize(d)))
    assert dr.all(si.is_valid())
    return mesh, si, directions(rng, si.n if outside else -si.n)


def _met(size, place, outside):
    """Whether rays meet the mesh: by ours, the textbook form, Mitsuba's offset."""
    mesh, si, d = _shell(size, place, outside)
    return mesh.met_again(si, d)


@case(
    "22", FAMILY, unit="of the rays",
    sweep=("size", SCALES), tolerance=0,
    why="it is convex; also 1e2 and 1e4 sizes away from 0", source="PharrJakobHumphreys2023",
)  # fmt: skip
def leaving_a_mesh(size):
    """Rays that leave a convex mesh and meet it again."""
    found = [_met(size, place, outside=True) for place in PLACES]
    return Errors(*(max(np.mean(form) for form in forms) for forms in zip(*found, strict=True)))


@case(
    "22", FAMILY, unit="of the rays",
    sweep=("size", SCALES), tolerance=0,
    why="it is closed; also 1e2 and 1e4 sizes away from 0", source="PharrJakobHumphreys2023",
)  # fmt: skip
def entering_a_mesh(size):
    """Rays that enter a closed mesh and don't meet it again."""
    found = [_met(size, place, outside=False) for place in PLACES]
    return Errors(*(max(np.mean(~form) for form in forms) for forms in zip(*found, strict=True)))


# ---- Gaps and slabs


def _square(centre, x, y):
    """A parallelogram around ``centre`` with half sides x and y: vertices [3, 4], and faces [3, 2]."""
    corners = [centre - x - y, centre + x - y, centre + x + y, centre - x + y]
    return np.stack(corners, axis=1), np.array([[0, 0], [1, 2], [2, 3]])


def _joined(*meshes):
    """One mesh of several."""
    first = np.cumsum([0] + [vertices.shape[1] for vertices, _ in meshes])
    vertices = np.concatenate([vertices for vertices, _ in meshes], axis=1)
    return vertices, np.concatenate([faces + k for (_, faces), k in zip(meshes, first, strict=False)], axis=1)


@case(
    "23, R5", FAMILY, unit="of the rays",
    sweep=("distance from 0", (1.0, 1e1, 1e3, 1e5)), tolerance=0,
    why="the origin moves by 7 sqrt(3) u and an ulp, fewer than the 16 ulp to the blocker less its roundings",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def gap_above_a_tilted_floor(place):
    """Rays that miss a blocker at 16 units in the last place above a floor."""
    n = np.array([2.0, -1, 2]) / 3
    x, y = np.array([1.0, 2, 0]) / 5**0.5, np.array([-4.0, 2, 5]) / 45**0.5
    centre = place * DIRECTION
    floor = _square(centre, 0.5 * x, 0.5 * y)
    ulp = np.spacing(np.float32(np.abs(floor[0]).max()))
    blocker = _square(centre + 16 * float(ulp) * n, 2 * x, 2 * y)
    mesh = Faces(*_joined(floor, blocker))
    rng = np.random.default_rng(23)
    a, b = rng.uniform(-0.45, 0.45, (2, 1, RAYS))
    below = np.float32(
        centre[:, None] + a * x[:, None] + b * y[:, None] - 0.1 * max(place / 1e3, 1) * n[:, None]
    )
    ray = mi.Ray3f(mi.Point3f(below), vector(np.broadcast_to(n[:, None], below.shape)))
    si = mesh.scene.ray_intersect(ray)
    of_floor = np.array(si.is_valid() & (si.prim_index < 2))
    assert of_floor.mean() > 0.9
    up = dr.mulsign(mi.Vector3f(si.n), dr.dot(si.n, ray.d))
    forms = mesh.met_again(si, up)
    return Errors(*(np.mean(~met[of_floor]) for met in forms))


@case(
    "25", FAMILY, unit="of the rays",
    sweep=("thickness", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)), tolerance=0,
    why="the faces are at y = 0 and at y = -h, where the bound along the normal is 0 and 7 u h; at |p| = 1 and 1000",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def thin_slab(thickness):
    """Rays through a slab of glass that don't meet both of its faces."""
    found = [_through_slab(thickness, place) for place in (1.0, 1e3)]
    return Errors(*(max(np.mean(form != 2) for form in forms) for forms in zip(*found, strict=True)))


def _through_slab(thickness, place):
    """How many faces rays meet, ``int`` [N]: by ours, the textbook form, Mitsuba's offset."""
    x, y, z = np.eye(3)
    at = np.array([place, 0, 0])
    mesh = Faces(*_joined(_square(at, x, z), _square(at - thickness * y, x, z)))
    rng = np.random.default_rng(25)
    target = at[:, None] + np.concatenate([rng.uniform(-0.5, 0.5, (2, RAYS)), np.zeros((1, RAYS))])[[0, 2, 1]]
    d = vector(rng.uniform(-1, 1, (3, RAYS)) * [[1.0], [0], [1]] - y[:, None])
    d = dr.normalize(d)
    first = mesh.scene.ray_intersect(mi.Ray3f(mi.Point3f(np.float32(target)) - 0.25 * d, d))
    inwards = _refracted(d, 1 / ETA)

    def count(spawn):
        second = mesh.scene.ray_intersect(spawn(first, inwards))
        third = mesh.scene.ray_test(spawn(second, d), second.is_valid())
        return sum(np.array(met, int) for met in (first.is_valid(), second.is_valid(), third))

    inside = mesh.is_met_beyond_least(first.p, inwards)
    return count(mesh.ours), 1 + inside.astype(int), count(lambda si, d: si.spawn_ray(d))


def _refracted(d, relative):
    """Directions down through a level surface, by Snell's law."""
    x, z = d.x * relative, d.z * relative
    return mi.Vector3f(x, -dr.sqrt(1 - x * x - z * z), z)


@case(
    "17", FAMILY, unit="of the rays",
    sweep=("distance from 0", (1.0, 1e1, 1e3, 1e5)), tolerance=0,
    why="the bound holds for both, since both lie within the same box", source="PharrJakobHumphreys2023",
)  # fmt: skip
def coincident_surfaces(place):
    """Rays that leave one of two tilted squares in the same plane and meet the other."""
    n = np.array([2.0, -1, 2]) / 3
    x, y = np.array([1.0, 2, 0]) / 5**0.5, np.array([-4.0, 2, 5]) / 45**0.5
    size = max(place / 1e3, 1.0)
    centre = place * DIRECTION
    mesh = Faces(
        *_joined(_square(centre, size * x, size * y), _square(centre, size * (x + y), size * (x - y)))
    )
    rng = np.random.default_rng(17)
    a, b = size * rng.uniform(-0.9, 0.9, (2, 1, RAYS))
    above = np.float32(centre[:, None] + a * x[:, None] + b * y[:, None] + size * n[:, None])
    si = mesh.scene.ray_intersect(
        mi.Ray3f(mi.Point3f(above), vector(np.broadcast_to(-n[:, None], above.shape)))
    )
    assert dr.all(si.is_valid())
    up = vector(np.broadcast_to(n[:, None], above.shape))
    d = directions(rng, dr.mulsign(si.n, dr.dot(si.n, up)), least=0.1)
    forms = mesh.met_again(si, d)
    return Errors(*map(np.mean, forms))


# ---- Inner corners

CUBE = np.array([(x, y, z) for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)]).T
_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE_FACES = np.array([three for a, b, c, d in _SIDES for three in ((a, b, c), (a, c, d))]).T  # outside first
TETRAHEDRON = np.array([(1.0, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]).T
TETRAHEDRON_FACES = np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]).T


def _lost_in_corner(vertices, faces, around, distance):
    """Shares of rays that leave a closed mesh from points near the corner of three walls.

    The first two of ``around`` (the walls' inner unit normals) are at the distance, or a little less; the points lie on
    the third.
    """
    mesh = Faces(vertices, faces)
    rng = np.random.default_rng(28)
    n = np.array(around, np.float64)
    corner = np.linalg.solve(n, -np.array([_depth(vertices, one) for one in n]))[:, None]
    away = np.concatenate([distance * rng.uniform(0.6, 1, (2, RAYS)), np.zeros((1, RAYS))])
    p = corner + np.linalg.solve(n, away)
    back = n.sum(axis=0)[:, None] / 3 * 0.01
    o = np.float32(p + back)
    si = mesh.scene.ray_intersect(mi.Ray3f(mi.Point3f(o), dr.normalize(vector(p - o))))
    on_floor = np.array(dr.dot(si.n, vector(n[2][:, None])) < -0.9)
    assert on_floor.mean() > 0.9
    d = directions(rng, -si.n)
    forms = mesh.met_again(si, d)
    return Errors(*(np.mean(~met[on_floor]) for met in forms))


def _depth(vertices, inner):
    """How far a wall lies behind 0."""
    return -(inner @ vertices).min()


@case(
    "28", FAMILY, unit="of the rays",
    sweep=("distance from the walls", (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)), tolerance=0,
    why="the point is at most 7 u off, and moves along its own wall's normal alone", source="PharrJakobHumphreys2023",
)  # fmt: skip
def corner_of_a_cube(distance):
    """Rays that get out at the inner corner of a cube."""
    return _lost_in_corner(CUBE, CUBE_FACES, np.eye(3), distance)


@case(
    "28", FAMILY, unit="of the rays",
    sweep=("distance from the walls", (2e-6, 1e-5, 1e-4, 1e-3, 1e-2)), tolerance=0,
    why="the point is at most 7 sqrt(3) u off, and moves a third of 16 sqrt(3) u towards the other walls",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def corner_of_a_tetrahedron(distance):
    """Rays that get out at the inner corner of a tetrahedron, whose walls meet at 70 degrees."""
    walls = np.array([(1.0, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / 3**0.5
    return _lost_in_corner(TETRAHEDRON, TETRAHEDRON_FACES, walls, distance)
