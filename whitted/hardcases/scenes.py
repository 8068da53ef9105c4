"""Whole scenes: of any size and anywhere, placed by many, stretching or mirroring transforms, glass in glass.

What Mitsuba's dielectrics are told is what lies on both sides of a surface, ``int_ior`` and ``ext_ior``; nothing keeps
account of what a ray is inside of. So things that touch share one surface with both indices. Two surfaces in one place
are one of both, and the camera is inside of what the first surface says it is.
"""

import functools

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.meshes import icosphere, mesh_of

FAMILY = "scenes"
WHITTED = {"type": "whitted", "max_depth": 12, "min_contribution": 0.0}
DISTRIBUTION = {"type": "distribution", "effects": "all", "max_depth": 6}
SIZE, SPP = 16, 16  # of pictures


def place():
    """The transform that leaves all in its place."""
    return mi.ScalarTransform4f()


def film(width=SIZE, height=SIZE):
    """A film without a filter."""
    return {"type": "hdrfilm", "width": width, "height": height, "component_format": "float32"} | {
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }


def picture(things, integrator, spp=SPP):
    """Return what an integrator makes of a scene (dict of things), ``float64`` [height, width, 3]."""
    from whitted.passes import render

    scene = mi.load_dict({"type": "scene"} | things, optimize=False)
    return np.float64(render(scene, integrator, spp=spp).mean)


# ---- Of any size, and anywhere


def _still_life(size, distance):
    """A glass cube, a diffuse one and a glass ball on a floor under a panel; ``distance`` from 0 in sizes."""
    centre = size * distance * np.array([1, 0.3, -0.7])
    at = place().translate(centre.tolist()).scale(size)
    eye, target = centre + size * np.array([0.3, 1.8, 4.5]), centre + size * np.array([0, 0.6, 0])
    glass, grey = {"type": "dielectric"}, {"type": "diffuse", "reflectance": 0.6}

    def cube(x, z, degrees, bsdf):
        placed = at.translate([x, 0.5, z]).rotate([0, 1, 0], degrees).scale(0.45)
        return {"type": "cube", "to_world": placed, "bsdf": bsdf}

    panel = at.translate([0.5, 3, 1]).rotate([1, 0, 0], 90).scale(0.7)
    return {
        "sensor": {"type": "perspective", "fov": 40, "near_clip": 1e-3 * size, "far_clip": 1e3 * size}
        | {"to_world": place().look_at(eye.tolist(), target.tolist(), [0, 1, 0]), "film": film()},
        "floor": {"type": "rectangle", "to_world": at.rotate([1, 0, 0], -90).scale(3), "bsdf": grey},
        "panel": {"type": "rectangle", "to_world": panel, "emitter": {"type": "area", "radiance": 4.0}},
        "glass": cube(0.8, 0, 30, glass),
        "grey": cube(-0.9, 0.2, -20, grey),
        "ball": {"type": "sphere", "to_world": at.translate([0, 0.5, 1]).scale(0.4), "bsdf": glass},
    }


@functools.cache
def _seen(name, size=1.0, distance=0.0):
    integrators = {"whitted": WHITTED, "distribution": DISTRIBUTION}
    return picture(_still_life(size, distance), integrators.get(name, {"type": name, "max_depth": 6}))


def _difference(*changed):
    """The mean difference of the still life from that of size 1 at 0, relative."""
    found = {
        name: np.abs(_seen(name, *changed) - _seen(name)).mean() / _seen(name).mean()
        for name in ("whitted", "distribution", "path")
    }
    return Errors(ours=[found["whitted"], found["distribution"]], reference=found["path"])


@case(
    "81", FAMILY, unit="of the mean",
    sweep=("size", (2.0**-20, 1e-6, 1e6)), tolerance=lambda size: 0 if np.log2(size) % 1 == 0 else 1e-3,
    why="by powers of two all numbers scale exactly; else a few of 4096 samples may pass an edge on its other side",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def same_picture_at_any_size(size):
    """How a picture of glass, meshes and a ball changes when all is scaled."""
    return _difference(size)


@case(
    "81", FAMILY, unit="of the mean",
    sweep=("distance in sizes", (10.0, 100.0)), tolerance=1e-3,
    why="a few of 4096 samples pass an edge, which is off by u of the distance, on its other side; at 1000 more do",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def same_picture_far_from_0(distance):
    """How the same picture changes when all is moved."""
    return _difference(1.0, distance)


@case(
    "22, 70", FAMILY, unit="relative",
    sweep=("size", (1e-6, 1.0, 1e6)), tolerance=(20 + 2) * U,
    why="a sum of 20 terms; a ray that met its own wall twice or got out would add or lose more than 1e-6",
    source="geometric series",
)  # fmt: skip
def eye_in_a_box_of_mirrors(size):
    """The radiance in a box whose walls emit 1 and reflect a half, to depth 20, against 2 - 2^-19."""
    at = place().translate([100 * size, -30 * size, 70 * size]).scale(size).rotate([0.6, 0, 0.8], 33)
    box = {"type": "cube", "to_world": at, "flip_normals": True, "bsdf": {"type": "conductor"}}
    box["bsdf"]["specular_reflectance"] = 0.5
    box["emitter"] = {"type": "area", "radiance": 1.0}
    sensor = {"type": "perspective", "fov": 90, "near_clip": 1e-3 * size, "far_clip": 1e3 * size}
    sensor |= {"to_world": at.look_at([0.3, 0.2, 0.1], [-0.5, 1, 0.4], [0, 1, 0]), "film": film()}
    sensor["to_world"] = _without_scale(sensor["to_world"])
    path = {"type": "path", "max_depth": 20, "rr_depth": 100}
    forms = (
        picture({"sensor": sensor, "box": box}, integrator, spp=4) / (2 - 2.0**-19) - 1
        for integrator in (WHITTED | {"max_depth": 20}, path)
    )
    ours, reference = forms
    return Errors(ours=ours, reference=reference)


def _without_scale(to_world):
    matrix = np.array(to_world.matrix, np.float64)
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, 0])
    return mi.ScalarTransform4f(matrix)


# ---- Placed by transforms


def _screws(count):
    """Rotations (unit axis, degrees) and translations, a list."""
    rng = np.random.default_rng(82)
    axes = rng.standard_normal((count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    degrees, offsets = rng.uniform(-180, 180, count), rng.uniform(-1, 1, (count, 3))
    return [(axes[k].tolist(), float(degrees[k]), offsets[k].tolist()) for k in range(count)]


def _screw(axis, degrees, offset, dtype=np.float64):
    """The matrix of one, [4, 4], by the formula of Rodrigues."""
    x, y, z = np.asarray(axis, dtype)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype)
    angle = dtype(np.radians(degrees))
    matrix = np.eye(4, dtype=dtype)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    matrix[:3, 3] = offset
    return matrix


@case(
    "82", FAMILY, unit="of the largest element",
    sweep=("transforms", (1.0, 10.0, 100.0)), tolerance=U,
    why="multiplied in double precision, and rounded once",
    source="Higham2002",
)  # fmt: skip
def many_transforms(count):
    """The transform of a shape whose file says so many rotations and translations."""
    screws = _screws(int(count))
    exact = functools.reduce(lambda matrix, screw: _screw(*screw) @ matrix, screws, np.eye(4))
    plain = functools.reduce(
        lambda matrix, screw: _screw(*screw, np.float32) @ matrix, screws, np.eye(4, dtype=np.float32)
    )
    single = place()
    for axis, degrees, offset in screws:
        single = place().translate(offset).rotate(axis, degrees) @ single
    text = "".join(
        f"<rotate {_attributes(axis)} angle='{degrees!r}'/><translate {_attributes(offset)}/>"
        for axis, degrees, offset in screws
    )
    shape = f"<shape type='disk'><transform name='to_world'>{text}</transform></shape>"
    scene = mi.load_string(f"<scene version='3.0.0'>{shape}</scene>", optimize=False)
    loaded = np.array(mi.traverse(scene.shapes()[0])["to_world"].matrix).reshape(4, 4)
    forms = loaded, plain, np.array(single.matrix)
    return Errors(*(np.abs(form - exact) / np.abs(exact).max() for form in forms))


def _attributes(values):
    return " ".join(f"{name}='{value!r}'" for name, value in zip("xyz", values, strict=True))


def _stretched(ratio):
    return (
        place()
        .translate([1, 2, 3])
        .rotate([0.6, 0, 0.8], 40)
        .scale([1, 1 / ratio, 1])
        .rotate([0, 0.6, 0.8], 25)
    )


def _normals(ratio, to_scene):
    """How far normals of a stretched icosphere are off, in units of the bound: Mitsuba's, and M n.

    ``to_scene`` makes a scene of the transform, the vertices and the faces.
    """
    vertices, faces = icosphere(2)
    vertices = np.float32(vertices)
    to_world = _stretched(ratio)
    M = np.array(to_world.matrix, np.float64)
    corners = np.float64(vertices)[:, faces]  # [3, 3 of a face, F]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], axis=0)
    middle = M[:3, :3] @ corners.mean(axis=1) + M[:3, 3:]
    exact, plain = np.linalg.inv(M[:3, :3]).T @ n, M[:3, :3] @ n
    exact, plain = (v / np.linalg.norm(v, axis=0) for v in (exact, plain))
    o = np.float32(middle + 0.5 * exact)
    scene = to_scene(to_world, vertices, faces)
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(o), mi.Vector3f(np.float32(-exact))))
    assert dr.all(si.is_valid() & (si.prim_index == dr.arange(mi.UInt32, faces.shape[1])))
    return [np.linalg.norm(found - exact, axis=0) for found in (np.array(si.n, np.float64), plain)]


def _as_instance(to_world, vertices, faces):
    group = {"type": "shapegroup", "mesh": mesh_of(vertices, faces)}
    instance = {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": "group"}}
    return mi.load_dict({"type": "scene", "group": group, "instance": instance})


@case(
    "79", FAMILY, unit="in length",
    sweep=("ratio", (1.0, 10.0, 100.0)), tolerance=lambda ratio: 16 * U * ratio,
    why="roundings of the normal, of its transform and of its length, stretched by the ratio",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def normals_of_a_stretched_instance(ratio):
    """The normals of an instance that is stretched unevenly."""
    return Errors(*_normals(ratio, _as_instance))


@case(
    "80", FAMILY, unit="in length",
    tolerance=16 * U, why="roundings of the normal, of its transform and of its length",
    source="PharrJakobHumphreys2023",
)  # fmt: skip
def normals_of_mirrored_instances():
    """The normals that mirrored spheres and cubes are shaded with, in instances; Mitsuba's: mirrored by themselves."""
    mirror = place().scale([-1, 1, 1])
    rng = np.random.default_rng(80)
    o = rng.standard_normal((3, 1000))
    o = np.float32(3 * o / np.linalg.norm(o, axis=0))
    of_sphere = np.float64(o) / np.linalg.norm(o, axis=0)
    of_cube = np.where(np.abs(o) == np.abs(o).max(axis=0), np.sign(o), 0)
    ours, reference = [], []
    for kind, normal in (("sphere", of_sphere), ("cube", of_cube)):
        group = {"type": "shapegroup", "shape": {"type": kind}}
        instance = {"type": "instance", "to_world": mirror, "group": {"type": "ref", "id": "group"}}
        ours.append(_shading_normals({"group": group, "instance": instance}, o) - normal)
        reference.append(_shading_normals({"shape": {"type": kind, "to_world": mirror}}, o) - normal)
    return Errors(ours=np.linalg.norm(ours, axis=1), reference=np.linalg.norm(reference, axis=1))


def _shading_normals(things, o):
    """Those of what rays from points towards 0 meet, ``float64`` [3, N]."""
    ray = mi.Ray3f(mi.Point3f(o), dr.normalize(mi.Vector3f(-o)))
    scene = mi.load_dict({"type": "scene"} | things)  # is kept until all is computed
    return np.array(scene.ray_intersect(ray).sh_frame.n, np.float64)


# ---- Glass in glass


def _from_above(columns):
    """A camera that looks straight down on squares side by side, a pixel each, and a light above it."""
    half = columns / 2
    to_world = place().translate([half, 0, 1]).rotate([0, 1, 0], 180).scale([half, half, 1])
    sensor = {"type": "orthographic", "to_world": to_world, "near_clip": 0.01, "film": film(columns, 1)}
    lamp = place().translate([half, 0, 2]).rotate([1, 0, 0], 180).scale(4 * half)
    light = {"type": "rectangle", "to_world": lamp, "emitter": {"type": "area", "radiance": 1.0}}
    return {"sensor": sensor, "light": light}


def _face(column, z, inside, outside):
    bsdf = {"type": "dielectric", "int_ior": inside, "ext_ior": outside}
    return {"type": "rectangle", "to_world": place().translate([column + 0.5, 0, z]).scale(0.5), "bsdf": bsdf}


INSIDE = (1.0, 1.33, 1.4, 1.49)


@functools.cache
def _reflectances(outside):
    """Those of squares of glass of the indices `INSIDE`, by the renderer, ``float64`` [4]."""
    squares = {f"square{k}": _face(k, 0, index, outside) for k, index in enumerate(INSIDE)}
    return picture(_from_above(len(INSIDE)) | squares, WHITTED, spp=1)[0, :, 0]


@case(
    "38", FAMILY, unit="relative",
    sweep=("index inside", INSIDE), tolerance=lambda index: 4 * U * index / (1.5 - index) + 8 * U,
    why="the relative index is rounded twice, and 1 minus it squared",
    source="HallGreenberg1983",
)  # fmt: skip
def touching_dielectrics(index):
    """The reflectance of what is in glass of index 1.5; textbook: entered and left as if all were in air."""
    n = np.float64(np.float32(index))
    exact = ((n - 1.5) / (n + 1.5)) ** 2
    column = INSIDE.index(index)
    return Errors(*(_reflectances(outside)[column] / exact - 1 for outside in (1.5, 1.0)))


GAPS = (1e-1, 1e-3, 1e-5, 1e-7)


@functools.cache
def _reflected_by_gaps(offset):
    faces = {}
    for k, gap in enumerate(GAPS):
        faces[f"glass{k}"], faces[f"water{k}"] = _face(k, 0, 1.0, 1.5), _face(k, -gap, 1.33, 1.0)
    return picture(_from_above(len(GAPS)) | faces, WHITTED | {"offset": offset}, spp=1)[0, :, 0]


@case(
    "38", FAMILY, unit="relative",
    sweep=("width of the gap", GAPS), tolerance=32 * U,
    why="two reflectances, to 16 u and 24 u of themselves, and a series", source="HallGreenberg1983",
)  # fmt: skip
def gap_between_dielectrics(gap):
    """The light reflected by glass and water with a layer of air between; Mitsuba's: with its offset."""
    water = np.float64(np.float32(1.33))
    above, below = (0.5 / 2.5) ** 2, ((water - 1) / (water + 1)) ** 2
    exact = above + (1 - above) ** 2 * below / (1 - above * below)
    column = GAPS.index(gap)
    ours, reference = (_reflected_by_gaps(offset)[column] / exact - 1 for offset in ("bound", "mitsuba"))
    return Errors(ours=ours, reference=reference)


@case(
    "38, 70", FAMILY, unit="relative",
    sweep=("place in radii", (0.0, 0.3, 0.6)), tolerance=32 * U,
    why="a sum of 12 terms, each with a few roundings", source="Veach1997",
)  # fmt: skip
def eye_in_a_ball_of_glass(at):
    """The radiance in a ball of glass under a sky of 1, where nothing is reflected totally, against eta^2."""
    to_world = place().look_at([at, 0, 0], [at, 0.3, 1], [0, 1, 0])
    sensor = {"type": "perspective", "fov": 60, "near_clip": 1e-3, "to_world": to_world, "film": film(8, 8)}
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    things = {"sky": {"type": "constant", "radiance": 1.0}, "ball": {"type": "sphere", "bsdf": glass}}
    return Errors(ours=picture({"sensor": sensor} | things, WHITTED, spp=1) / 2.25 - 1)


# ---- Triangles without area


def square(half, y, spoilt, down=False, **parts):
    """Return a level mesh, face up or down; ``spoilt``: with triangles without area, in a point and on a line.

    ``parts`` are its BSDF and its emitter.
    """
    vertices = [(-half, y, -half), (half, y, -half), (half, y, half), (-half, y, half), (0, y, 0)]
    faces = np.array([(0, 2, 1), (0, 3, 2), (1, 1, 1), (0, 4, 2), (3, 3, 1)][: 5 if spoilt else 2])
    faces = faces[:, ::-1] if down else faces
    return mesh_of(np.transpose(vertices), faces.T, **parts)


def _on_a_floor(spoilt):
    sensor = {"type": "perspective", "fov": 40, "film": film(8, 8)}
    sensor["to_world"] = place().look_at([0.3, 1.8, 4.5], [0, 0.6, 0], [0, 1, 0])
    panel = place().translate([0.5, 2, 0.5]).rotate([1, 0, 0], 90).scale(0.5)
    return {
        "sensor": sensor,
        "floor": square(3, 0, spoilt, bsdf={"type": "diffuse", "reflectance": 0.6}),
        "ball": {"type": "sphere", "center": [0, 0.5, 0], "radius": 0.4, "bsdf": {"type": "dielectric"}},
        "panel": {"type": "rectangle", "to_world": panel, "emitter": {"type": "area", "radiance": 4.0}},
    }


@case(
    "14", FAMILY, unit="of the mean",
    tolerance=0, why="what has no area is never met", source="WoopBenthinWald2013",
)  # fmt: skip
def triangles_without_area_in_a_picture():
    """How a picture changes when its floor gets triangles without area."""
    errors = []
    for integrator in (WHITTED, DISTRIBUTION):
        plain, spoilt = (picture(_on_a_floor(bad), integrator) for bad in (False, True))
        errors.append(np.abs(spoilt - plain).max() / plain.mean())
    return Errors(ours=errors)
