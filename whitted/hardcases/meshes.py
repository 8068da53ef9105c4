"""A closed mesh, and rays that aim at what its triangles share."""

import mitsuba as mi
import numpy as np

GOLDEN = (1 + 5**0.5) / 2


def icosphere(levels):
    """Return vertices of the unit sphere, ``float64`` [3, V], and 20 * 4^levels faces, outside first, int [3, F]."""
    v = [(-1, GOLDEN, 0), (1, GOLDEN, 0), (-1, -GOLDEN, 0), (1, -GOLDEN, 0)]
    v = np.array([np.roll(p, k) for k in range(3) for p in v], float)
    # Each face is a triple of vertices at the distance of an edge, 2
    distance = np.linalg.norm(v[:, None] - v[None], axis=-1)
    touching = np.isclose(distance, 2)
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if touching[i, j] and touching[j, k] and touching[i, k]
    ]
    v, faces = list(v), np.array(faces)
    for _ in range(levels):
        v, faces = _divided(v, faces)
    v = np.array(v)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    inwards = np.linalg.det(v[faces]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return v.T, faces.T


def rays_at_edges(vertices, faces, count, seed=0):
    """Return rays from near the middle of a mesh to random points of its edges, and the triangles that they may meet.

    Args:
        vertices, faces: ``float32`` [3, V], int [3, F].
        count: of rays, N.
        seed: ``int``.

    Returns:
        o, d (unit), ``float32`` [3, N]; and int [K, N]: the faces around both ends of the edge, -1 beyond the last.
    """
    rng = np.random.default_rng(seed)
    edges = np.unique(
        np.sort(np.concatenate([faces[[0, 1]], faces[[1, 2]], faces[[2, 0]]], axis=1), axis=0), axis=1
    )
    around = _faces_around(faces, vertices.shape[1])
    near = _padded([sorted(around[a] | around[b]) for a, b in edges.T])
    chosen = rng.integers(edges.shape[1], size=count)
    a, b = (vertices[:, end].astype(np.float64) for end in edges[:, chosen])
    u = rng.random(count)
    return *_aimed(rng, vertices, a + u * (b - a)), near[:, chosen]


def rays_at_vertices(vertices, faces, count, seed=0):
    """Return rays to random vertices; the arguments and the result are those of `rays_at_edges`."""
    rng = np.random.default_rng(seed)
    near = _padded([sorted(of) for of in _faces_around(faces, vertices.shape[1])])
    chosen = rng.integers(vertices.shape[1], size=count)
    return *_aimed(rng, vertices, vertices[:, chosen].astype(np.float64)), near[:, chosen]


def mesh_of(vertices, faces, **parts):
    """Return an ``mi.Mesh`` of vertices [3, V] and faces [3, F]; ``parts`` are dicts of its BSDF and its emitter."""
    properties = mi.Properties()
    for name, part in parts.items():
        properties[name] = mi.load_dict(part)
    mesh = mi.Mesh("mesh", np.shape(vertices)[1], np.shape(faces)[1], props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.float32(np.ravel(np.transpose(vertices)))
    parameters["faces"] = np.uint32(np.ravel(np.transpose(faces)))
    parameters.update()
    return mesh


def load_mesh(vertices, faces, robust=False):
    """Return an ``mi.Scene`` with the mesh alone; ``robust``: with Embree's watertight, slower intersection."""
    mesh = mesh_of(vertices, faces)
    return mi.load_dict({"type": "scene", "mesh": mesh, "embree_use_robust_intersections": robust})


def _aimed(rng, vertices, target):
    """Rays to ``target`` from a box around the middle of the mesh, of a fifth of its size."""
    low, high = vertices.min(axis=1).astype(np.float64), vertices.max(axis=1).astype(np.float64)
    o = np.float32((low + high)[:, None] / 2 + 0.1 * (high - low).max() * rng.uniform(-1, 1, target.shape))
    d = target - o
    return o, np.float32(d / np.linalg.norm(d, axis=0))


def _divided(vertices, faces):
    """Each triangle cut into four at the middles of its edges."""
    middles = {}

    def middle(a, b):
        key = (min(a, b), max(a, b))
        if key not in middles:
            m = vertices[a] + vertices[b]
            middles[key] = len(vertices)
            vertices.append(m / np.linalg.norm(m) * np.linalg.norm(vertices[a]))
        return middles[key]

    made = []
    for a, b, c in faces:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        made += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return vertices, np.array(made)


def _faces_around(faces, count):
    """The faces of each vertex, a list of sets."""
    around = [set() for _ in range(count)]
    for number, corners in enumerate(faces.T):
        for corner in corners:
            around[corner].add(number)
    return around


def _padded(lists):
    length = max(map(len, lists))
    return np.array([one + [-1] * (length - len(one)) for one in lists]).T
