"""The bounded lights of a scene, taken apart into rectangles, triangles, disks and spheres as far as they can be.

Shapes are recognised by what lies on them where, so that transforms and flipped normals need no care of their own.
Left out: sampling; see the files named after the shapes.
"""

from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

RECTANGLE, TRIANGLE, DISK, SPHERE, POINT, MITSUBA = range(6)
LATTICE = 64  # places along each side at which a texture is looked at
PROBES = 256  # samples that measure what is not known of an emitter
TOLERANCE = 1e-4  # relative, within which a shape counts as flat, round or rectangular


@dataclass
class Primitives:
    """Bounded lights as NumPy arrays of N entries.

    ``kind``; ``emitter``, its number in the scene; ``radiance`` [N, C], C the colours of the variant (1 if spectral);
    ``geometry`` [N, 9], three vectors: corner and edges of a rectangle; corners of a triangle; centre, normal and
    (radius, 0, 0) of a disk; centre and (radius, side, 0) of a sphere, where ``side`` is 1 if it emits outwards and -1
    if inwards; place, normal (0 if it shines all around) and (intensity over radiance, 0, 0) of a point. Rectangles,
    triangles and disks emit to the side of ``cross(edges)`` or of the normal. The rest is what `LightTree` wants:
    boxes [N, 3], ``power``, and cones of normals.
    """

    kind: np.ndarray
    emitter: np.ndarray
    radiance: np.ndarray
    geometry: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    power: np.ndarray
    axis: np.ndarray
    cos_spread: np.ndarray
    shape: np.ndarray  # the registry number of the shape that each is part of, 0 if of none
    only_met: (
        bool  # there are emitters besides that can't be sampled: only rays that meet them find their light
    )

    def __len__(self):
        return len(self.kind)


class _Part(NamedTuple):
    """One primitive of a shape; ``normal`` is 0 if it has many."""

    kind: int
    geometry: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    area: float
    normal: tuple = (0, 0, 0)


def primitives_of(scene, as_points=False):
    """Return the `Primitives` of an ``mi.Scene``: of every emitter that isn't infinitely far away.

    With ``as_points`` an emitter that rays could meet becomes a point at its centre, of the same power: with the
    intensity of a Lambertian surface if it is flat, else the same in all directions.
    """
    rows, met = [], False
    shapes = {shape.emitter().ptr: shape for shape in scene.shapes() if shape.emitter() is not None}
    for number, emitter in enumerate(scene.emitters()):
        flags, shape = int(emitter.flags()), shapes.get(emitter.ptr)
        if flags & mi.EmitterFlags.Infinite:
            continue
        if (shape is None and flags & mi.EmitterFlags.Surface) or (
            shape is not None and not _has_area(shape)
        ):
            met = True
            continue
        on = registry_number(shape) if shape is not None else 0
        if shape is None or is_delta(emitter):
            rows.append((number, on, np.ones(1), _whole(emitter, shape), _power(emitter)))
            continue
        is_uniform = not flags & mi.EmitterFlags.SpatiallyVarying
        radiance = mean_radiance(emitter, shape)
        parts = _taken_apart(shape) if is_uniform or as_points else None
        if as_points:
            parts = [_point(shape, parts)]
        for part in parts or [_whole(emitter, shape)]:
            rows.append((number, on, radiance, part, np.pi * part.area * radiance.mean()))
    return _table(rows, met and not as_points)


def _has_area(shape):
    """Whether Mitsuba can sample positions on a shape, and a hit tells where on it."""
    if shape.class_name() == "EllipsoidsMesh":
        return False  # a hit doesn't tell its triangle
    try:
        return float(np.ravel(shape.surface_area())[0]) > 0
    except RuntimeError:  # not implemented
        return False


def is_delta(emitter):
    """Whether no ray can meet the emitter."""
    return bool(int(emitter.flags()) & (mi.EmitterFlags.DeltaPosition | mi.EmitterFlags.DeltaDirection))


def registry_number(shape):
    """Return the number (``int``) under which Dr.Jit knows a shape: the value of a pointer to it."""
    return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])


def _table(rows, only_met):
    parts = [part for *_, part, _ in rows]
    normals = np.array([part.normal for part in parts], np.float64).reshape(-1, 3)
    colours = 1 if mi.is_monochromatic or mi.is_spectral else 3
    return Primitives(
        kind=np.array([part.kind for part in parts], np.uint32),
        emitter=np.array([number for number, *_ in rows], np.uint32),
        radiance=np.array([np.broadcast_to(radiance[:colours], colours) for _, _, radiance, *_ in rows]),
        geometry=np.array([part.geometry for part in parts], np.float64).reshape(-1, 9),
        lower=np.array([part.lower for part in parts], np.float64).reshape(-1, 3),
        upper=np.array([part.upper for part in parts], np.float64).reshape(-1, 3),
        power=np.array([_choosable(power) for *_, power in rows], np.float64),
        axis=np.where(normals.any(1, keepdims=True), normals, (0, 0, 1)),
        cos_spread=np.where(normals.any(1), 1.0, -1.0),
        shape=np.array([on for _, on, *_ in rows], np.uint32),
        only_met=only_met,
    )


def mean_radiance(emitter, shape):
    """Return the mean radiance of an area light on a shape, one value for each colour (``float64``)."""
    is_uniform = not int(emitter.flags()) & mi.EmitterFlags.SpatiallyVarying
    places = shape.sample_position(0.0, _points(1) if is_uniform else _lattice())
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(places.p))
    si.p, si.n, si.uv, si.wi = places.p, places.n, places.uv, mi.Vector3f(0, 0, 1)
    if mi.is_spectral:
        si.wavelengths = mi.sample_rgb_spectrum(mi.Spectrum(0.125, 0.375, 0.625, 0.875))[0]
    found = np.array(emitter.eval(si, True), np.float64)
    return np.atleast_1d(found.reshape(found.shape[0], -1).mean(1))


def _power(emitter):
    """The power of an emitter, as the mean weight of the rays that leave it."""
    u = _points(PROBES, 5)
    _, weight = emitter.sample_ray(0.0, u[0], mi.Point2f(u[1], u[2]), mi.Point2f(u[3], u[4]))
    power = float(np.mean(np.array(weight, np.float64)))
    return power if power > 0 else 1.0  # a light that is never chosen would be missed


def _choosable(power):
    """The power by which a light is chosen, also where its radiance is no number somewhere."""
    return power if np.isfinite(power) else 1.0


def _points(count, dimensions=2):
    """The same random points each time."""
    u = np.random.default_rng(0).random((dimensions, count), np.float32)
    return mi.Point2f(u) if dimensions == 2 else [mi.Float(row) for row in u]


def _lattice():
    """The middles of the cells of a regular grid."""
    middles = (np.arange(LATTICE) + 0.5) / LATTICE
    x, y = np.meshgrid(middles, middles)
    return mi.Point2f(x.ravel().tolist(), y.ravel().tolist())


def _whole(emitter, shape):
    """An emitter that is left to Mitsuba, with the bounds of its shape or of the rays that leave it."""
    if shape is not None:
        box = shape.bbox()
        area = float(np.ravel(shape.surface_area())[0])
        return _Part(MITSUBA, np.zeros(9), np.array(box.min), np.array(box.max), area)
    u = _points(PROBES, 5)
    ray, _ = emitter.sample_ray(0.0, u[0], mi.Point2f(u[1], u[2]), mi.Point2f(u[3], u[4]))
    origin = np.array(ray.o)
    return _Part(MITSUBA, np.zeros(9), origin.min(1), origin.max(1), 0.0)


def _point(shape, parts):
    """All of a shape as one point: at the centre of its flat parts, else of its bounds."""
    n = np.array(shape.sample_position(0.0, _points(PROBES)).n, np.float64)
    if parts and all(part.kind == TRIANGLE for part in parts):
        area = sum(part.area for part in parts)
        centre = sum(part.area * part.geometry.reshape(3, 3).mean(0) for part in parts) / area
    else:
        box, area = shape.bbox(), float(np.ravel(shape.surface_area())[0])
        centre = (np.array(box.min, np.float64) + np.array(box.max, np.float64)) / 2
    is_flat = np.abs(n - n[:, :1]).max() < TOLERANCE
    normal, intensity = (n[:, 0], area) if is_flat else (np.zeros(3), area / 4)
    return _Part(
        POINT, np.concatenate([centre, normal, [intensity, 0, 0]]), centre, centre, area, tuple(normal)
    )


def _taken_apart(shape):
    """Return the primitives of a shape, or None if it has none of ours."""
    kinds = {"Rectangle": _rectangle, "Disk": _disk, "Sphere": _sphere}
    if shape.class_name() in kinds:
        return kinds[shape.class_name()](shape)
    return _triangles(shape) if shape.is_mesh() else None


def _at(shape, *positions):
    """Points [K, 3] and normals [K, 3] that the shape's parametrisation by area has at ``positions``."""
    found = shape.sample_position(0.0, mi.Point2f(np.array(positions, np.float32).T))
    return np.array(found.p, np.float64).T, np.array(found.n, np.float64).T


def _rectangle(shape):
    (o, x, y), (normal, *_) = _at(shape, (0, 0), (1, 0), (0, 1))
    ex, ey = x - o, y - o
    if not abs(ex @ ey) <= TOLERANCE * np.linalg.norm(ex) * np.linalg.norm(ey):
        return _triangles(shape)  # a parallelogram
    if np.cross(ex, ey) @ normal < 0:
        ex, ey = ey, ex
    corners = np.array([o, o + ex, o + ey, o + ex + ey])
    geometry = np.concatenate([o, ex, ey])
    area = float(np.linalg.norm(np.cross(ex, ey)))
    return [_Part(RECTANGLE, geometry, corners.min(0), corners.max(0), area, tuple(normal))]


def _triangles(shape):
    """The triangles of a mesh whose shading normals are those of its faces."""
    faces = shape.faces_buffer().numpy().reshape(-1, 3)
    corners = shape.vertex_positions_buffer().numpy().astype(np.float64).reshape(-1, 3)[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    normals = cross / np.maximum(length, 1e-300)
    if shape.has_vertex_normals() and not shape.has_face_normals():
        shading = shape.vertex_normals_buffer().numpy().astype(np.float64).reshape(-1, 3)[faces]
        cosines = np.einsum("fvk,fk->fv", shading, normals)
        if not ((np.abs(np.abs(cosines) - 1) < TOLERANCE) | (length == 0)).all():
            return None
        normals *= np.sign(cosines[:, :1])
    if shape.has_flipped_normals():
        normals = -normals
    parts = []
    for three, normal, turned, area in zip(corners, normals, cross, length[:, 0] / 2, strict=True):
        ordered = three if turned @ normal >= 0 else three[[0, 2, 1]]
        parts.append(_Part(TRIANGLE, ordered.ravel(), three.min(0), three.max(0), float(area), tuple(normal)))
    return parts


def _disk(shape):
    (centre, *rim), (normal, *_) = _at(shape, (0.5, 0.5), (1, 0.5), (0.5, 1), (0, 0.5))
    arms = np.array(rim) - centre
    radii = np.linalg.norm(arms, axis=1)
    if not (np.ptp(radii) <= TOLERANCE * radii[0] and abs(arms[0] @ arms[1]) <= TOLERANCE * radii[0] ** 2):
        return None  # an ellipse
    reach = radii[0] * np.sqrt(np.maximum(1 - normal**2, 0))
    geometry = np.concatenate([centre, normal, [radii[0], 0, 0]])
    return [_Part(DISK, geometry, centre - reach, centre + reach, np.pi * radii[0] ** 2, tuple(normal))]


def _sphere(shape):
    box = shape.bbox()
    lower, upper = np.array(box.min, np.float64), np.array(box.max, np.float64)
    # Not the box's middle and half its width, which for a small sphere far from the origin have few digits
    to_world = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)
    centre, radius = to_world[:3, 3], np.linalg.norm(to_world[:3, 0])
    beside = dr.zeros(mi.Interaction3f)
    beside.p = mi.Point3f(centre + np.array([0, 0, 3 * radius]))
    ds = shape.sample_direction(beside, mi.Point2f(0.5))  # tells the side right of mirrored spheres too
    side = 1.0 if (np.array(ds.p)[:, 0] - centre) @ np.array(ds.n)[:, 0] > 0 else -1.0
    geometry = np.concatenate([centre, [radius, side, 0], np.zeros(3)])
    return [_Part(SPHERE, geometry, lower, upper, 4 * np.pi * radius**2)]
