"""Where a ray leaves a surface from: beside the computed point by the bound of its rounding errors, and no more.

Mitsuba moves the origin by 8.9e-5 (1 + max |p|), whatever the surface: 9 cm at 1,000, and more than the size of what is
smaller than 1e-4. The bound of a point on a triangle grows with its corners' coordinates along the normal alone, so
that it is all but 0 on a floor at y = 0. Source: [PharrJakobHumphreys2023], section 6.8, for the bounds and for
rounding away from the surface; here that of a triangle holds for all of its points, and is looked up. Left out: shapes
that are intersected by iteration (curves, ``sdfgrid``, ``ellipsoids``), which keep Mitsuba's offset.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.contents import shapes_of
from whitted.errors import UsageError
from whitted.lights.primitives import registry_number

RULES = ("bound", "mitsuba")
ULP = 2.0**-23  # the distance of neighbouring numbers, at most, relative
# Bits of a shape's entry: it has an error for each face; the distance counts too; the first one's number
FACES, CURVED, INDEX = 1 << 31, 1 << 30, (1 << 30) - 1
UNKNOWN = 0xFFFFFFFF
# Roundings of the square of the distance over the radius, in the solution of a quadratic equation in single precision:
# measured are 3 for cylinders and 9 for spheres in instances
QUADRATIC, INSTANCED = 8, 24
# Of a face's size, where the bound is 0: rays that begin in its very plane meet it if Embree is told to be robust
LEAST = 2.0**-40
MITSUBA = 1500 * 2.0**-24  # its epsilon


def check_rule(rule):
    """Raise ``UsageError`` for a name that isn't one of `RULES`."""
    if rule not in RULES:
        raise UsageError(f"offset is {rule!r}; accepted are {' and '.join(RULES)}")


def gamma(operations):
    """Return the bound of the relative error after so many roundings in single precision."""
    return operations * 2.0**-24 / (1 - operations * 2.0**-24)


class Offsets:
    """The rounding errors of points on the surfaces of a scene, along the normal.

    Args:
        scene: ``mi.Scene``.
        rule: one of ``RULES``; ``mitsuba`` takes Mitsuba's for all shapes, to compare with it to the last bit.
    """

    def __init__(self, scene, rule="bound"):
        self.rule = rule
        if rule == "mitsuba":
            return
        nested = _nested(scene)
        entries, squares, errors, count = {}, {}, [np.zeros(2)], 2  # the first is that of what isn't met
        for shape in scene.shapes():
            found = _instance_error(shape, nested) if _is_instance(shape) else _error(shape)
            if found is not None:
                bits, error, square = found
                number = registry_number(shape)
                entries[number], squares[number] = bits + count, square
                errors.append(error)
                count += len(error)
        self.has_instances = bool(nested)
        self.all_known = len(entries) == len(scene.shapes())
        self.has_curved = any(entry & CURVED for entry in entries.values())
        self.has_squares = any(squares.values())
        first = np.full(max(entries, default=0) + 1, 0 if self.all_known else UNKNOWN, np.uint32)
        of_square = np.zeros(max(len(first), 2))
        for number, entry in entries.items():
            first[number], of_square[number] = entry, squares[number]
        self.first, self.shapes = mi.UInt32(first.tolist()), dr.opaque(mi.UInt32, len(first))
        self.squares = mi.Float(of_square.tolist())
        self.errors = mi.Float(np.concatenate(errors).tolist())

    def origin(self, si, direction):
        """Return the ``Point3f`` [N] from which a ray in a world-space ``direction`` leaves a surface.

        Args:
            si: ``SurfaceInteraction3f`` [N], valid in the lanes that count.
            direction: ``Vector3f`` [N], of any length.
        """
        if self.rule == "mitsuba":
            return si.spawn_ray(direction).o
        step = dr.mulsign(si.n, dr.dot(si.n, direction)) * self._error(si)
        o = si.p + step
        return o + dr.select(step == 0, 0, dr.mulsign(dr.abs(o) * ULP, step))

    def _error(self, si):
        """The bound of the error of ``si.p`` along the normal (``Float``)."""
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        if self.has_instances:
            instance = dr.reinterpret_array(mi.UInt32, si.instance)
            shape = dr.select(instance != 0, instance, shape)
        inside = shape < self.shapes
        entry = dr.gather(mi.UInt32, self.first, shape, inside)
        known = inside if self.all_known else inside & (entry != UNKNOWN)
        index = (entry & INDEX) + dr.select(entry >= FACES, si.prim_index, 0)
        error = dr.gather(mi.Float, self.errors, index, known)
        if self.has_curved:
            error += dr.select((entry & CURVED) != 0, gamma(6) * si.t, 0)
        if self.has_squares:
            error += dr.gather(mi.Float, self.squares, shape, inside) * dr.square(si.t)
        if self.all_known:
            return error
        return dr.select(known, error, MITSUBA * (1 + dr.max(dr.abs(si.p))))


def _error(shape):
    """What is known of a shape, or None.

    The bits of its entry; the bounds of the errors (``float64``) of its points along the normal; and what has to be
    added for each unit of the squared distance.
    """
    kind = _kind(shape)
    if kind == "mesh":
        return FACES, _face_errors(shape), 0.0
    if kind is None:
        return None
    box = shape.bbox()
    largest = np.maximum(np.abs(np.array(box.min)), np.abs(np.array(box.max))).astype(np.float64)
    square = QUADRATIC * 2.0**-24 / _radius(shape) if kind == "quadric" else 0.0
    return CURVED, np.array([gamma(6) * np.linalg.norm(largest)]), square


def _kind(shape):
    """How a shape is intersected: as a mesh, so that the distance is right to rounding, or by a quadratic equation."""
    if shape.is_mesh():
        return "mesh"
    kinds = {mi.ShapeType.Sphere: "exact", mi.ShapeType.Disk: "exact", mi.ShapeType.Cylinder: "quadric"}
    return {int(kind): word for kind, word in kinds.items()}.get(shape.shape_type())


def _radius(shape):
    """The smallest radius of a sphere, disk or cylinder."""
    to_world = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)
    return max(np.linalg.svd(to_world[:3, :3], compute_uv=False)[-1], 1e-30)


def _face_errors(mesh):
    """For each face ``gamma_7 |n| . max |v|``, with its unit normal and the largest coordinates of its corners.

    It isn't quite 0 unless the face is a point.
    """
    v = np.array(mesh.vertex_positions_buffer(), np.float64).reshape(-1, 3)
    corners = v[np.array(mesh.faces_buffer()).reshape(-1, 3)]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(n, axis=1, keepdims=True)
    n = np.divide(n, length, out=np.full_like(n, np.sqrt(1 / 3)), where=length > 0)
    size = np.abs(corners - np.roll(corners, 1, axis=1)).max(axis=(1, 2), initial=0.0)
    return np.maximum(gamma(7) * np.einsum("fi,fi->f", np.abs(n), np.abs(corners).max(axis=1)), LEAST * size)


def _is_instance(shape):
    return shape.class_name() == "Instance"


def _instance_error(instance, nested):
    """The same for all that an instance may show: errors in its own coordinates, and by the transform of these.

    There all curved shapes are met in single precision.
    """
    kinds = set(map(_kind, nested))
    if None in kinds:
        return None
    to_world = np.array(mi.traverse(instance)["to_world"].matrix, np.float64).reshape(4, 4)
    box = instance.bbox()
    low, high = np.array(box.min, np.float64), np.array(box.max, np.float64)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
    local = (corners - to_world[:3, 3]) @ np.linalg.inv(to_world[:3, :3]).T
    spread = np.abs(to_world[:3, :3]) @ np.abs(local).max(axis=0) + np.abs(to_world[:3, 3])
    square = 0.0
    if kinds & {"exact", "quadric"}:
        scales = np.linalg.svd(to_world[:3, :3], compute_uv=False)
        radius = min(_radius(shape) for shape in nested if _kind(shape) in ("exact", "quadric"))
        square = INSTANCED * 2.0**-24 * scales[0] / scales[-1] ** 2 / radius
    return CURVED, np.array([gamma(16) * np.linalg.norm(spread)]), square


def _nested(scene):
    """The shapes inside of shape groups."""
    outer = {shape.ptr for shape in scene.shapes()}
    return [shape for shape in shapes_of(scene) if shape.ptr not in outer and not _is_group(shape)]


def _is_group(shape):
    return shape.class_name() == "ShapeGroupPlugin"
