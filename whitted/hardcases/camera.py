"""Cameras: lenses that are closed, out of focus or in it, narrow and wide views, and the footprints of pixels."""

from contextlib import contextmanager

import mitsuba as mi
import numpy as np

import whitted
from whitted.errors import UsageError
from whitted.film import Grid, Window, eye_rays
from whitted.geometry import plane
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.spheres import RAYS
from whitted.sampling.groups import Segments

FAMILY = "camera"
FOV = 40.0  # degrees
FOCUS = 2.0
WIDTH, HEIGHT = 64, 8  # pixels
PIXELS = WIDTH / (2 * np.tan(np.radians(FOV / 2)))  # per tangent of the angle to the axis
SPP = 2048
UNSEEN = 5  # samples of a share that all samples may miss, once in 150 pixels were they independent
EFFECTS = "antialiasing,depth_of_field"
APERTURE = 0.1


def camera(kind="thinlens", size=(WIDTH, HEIGHT), target=(0, 0, 1), **parameters):
    """The dict of a camera at 0 that looks along z, with a box filter."""
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    to_world = mi.ScalarTransform4f().look_at([0, 0, 0], list(target), [0, 1, 0])
    return {"type": kind, "fov": FOV, "to_world": to_world, "film": film} | parameters


def lens(radius, focus=FOCUS, **parameters):
    """The dict of a camera with a lens."""
    return camera(aperture_radius=radius, focus_distance=focus, **parameters)


@contextmanager
def quiet():
    """Keep Mitsuba's warnings back for a while: what is odd here is so on purpose."""
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        yield
    finally:
        mi.set_log_level(level)


def half_plane(sensor, z):
    """A scene of radiance 1 where x > 0, at the depth z."""
    to_world = mi.ScalarTransform4f().translate([2 * z, 0, z]).rotate([0, 1, 0], 180).scale([2 * z, 2 * z, 1])
    half = {"type": "rectangle", "to_world": to_world, "light": {"type": "area", "radiance": 1.0}}
    with quiet():
        return mi.load_dict({"type": "scene", "sensor": sensor, "half": half}, optimize=False)


def picture(scene, spp=SPP):
    """The `whitted.Render` through the lens."""
    return whitted.render(scene, {"type": "distribution", "max_depth": 1, "effects": EFFECTS}, spp=spp)


def rays_of(sensor, size=(WIDTH, HEIGHT), spp=16):
    """The eye rays of a picture: o, d, and where on the film, in pixels, ``float64`` [3, N], [3, N], [2, N]."""
    with quiet():
        sensor = mi.load_dict(sensor)
    grid = Grid(Window(0, 0, *size), 0, spp)
    ray, _, _, offset, active = eye_rays(sensor, size, grid, Segments(0), EFFECTS.split(","))
    x, y, *_ = grid.samples()
    active = np.array(active)
    film = np.array([x, y], np.float64) + np.array(offset, np.float64)
    return *(np.array(v, np.float64)[:, active] for v in (ray.o, ray.d)), film[:, active]


def seen_at(z, o, d):
    """Where on the film a pinhole sees the points that rays along z meet at a depth, in pixels [2, N]."""
    x, y = (o + (z - o[2]) / d[2] * d)[:2] / z * PIXELS
    return np.stack([WIDTH / 2 - x, HEIGHT / 2 - y])


def circle_of_confusion(z, radius=APERTURE, focus=FOCUS):
    """The radius in pixels of the disk in which a point at the depth z is seen."""
    return radius * abs(1 / focus - 1 / z) * PIXELS


def edge_profile(c):
    """What each column sees of a half plane from the middle of the picture on, blurred by a disk of radius c.

    A disk's share on one side of a line at u c from its middle is 1/2 + (u sqrt(1 - u^2) + asin u) / pi; the mean over
    a pixel is the difference of its integral.
    """
    u = np.clip((np.arange(WIDTH + 1) - WIDTH / 2) / c, -1, None)
    inside = np.minimum(u, 1)
    root = np.sqrt(1 - inside**2)
    integral = inside / 2 + (root - root**3 / 3 + inside * np.arcsin(inside)) / np.pi
    right = np.diff(c * np.where(u < 1, integral, u))
    return right[::-1]  # x points to the left of the picture


# ---- Lenses


@case(
    "65", FAMILY, unit="of the bound",
    sweep=("aperture radius", (0.0, 1e-6, 1e-3, 1e-1)), tolerance=1,
    why="the circle of confusion, and roundings of the place on the film, 4 u of its width",
    source="CookPorterCarpenter1984",
)  # fmt: skip
def closing_lens(radius):
    """Where rays through a lens meet a plane out of focus, against the pinhole's, a lens of radius 0 included."""
    o, d, film = rays_of(lens(radius))
    error = np.hypot(*(seen_at(4.0, o, d) - film))
    return Errors(ours=error / (circle_of_confusion(4.0, radius) + 4 * U * WIDTH))


@case(
    "65", FAMILY, unit="samples",
    sweep=("aperture radius", (0.0, 1e-6)), tolerance=1,
    why="the edge moves by 2e-5 pixels, so that less than one of 2048 samples changes sides",
    source="CookPorterCarpenter1984",
)  # fmt: skip
def picture_through_a_closed_lens(radius):
    """By how many samples a pixel differs from that of a pinhole with the same samples."""
    pinhole = picture(half_plane(camera("perspective"), 4.0)).mean
    return Errors(ours=SPP * (picture(half_plane(lens(radius), 4.0)).mean - pinhole))


def _profile_error(z):
    """The error of a picture of an edge at the depth z, over its bound."""
    far = max(1e4, 10 * z)
    found = picture(half_plane(lens(APERTURE, far_clip=far), z))
    error = np.abs(found.mean - edge_profile(circle_of_confusion(z))[:, None])
    return error / (5 * found.standard_error + UNSEEN / SPP)


@case(
    "66", FAMILY, unit="of the bound",
    sweep=("depth", (0.5, 1.0, 1.5, 3.0, 4.0, 16.0)), tolerance=1,
    why="5 standard errors, as rendered; and 5 samples, where so few show no spread", source="PotmesilChakravarty1982",
)  # fmt: skip
def edge_out_of_focus(z):
    """The blur of an edge: a disk's, of radius A |1/F - 1/z| W / (2 tan(fov / 2)) pixels."""
    return Errors(ours=_profile_error(z))


@case(
    "67", FAMILY, unit="pixels",
    sweep=("aperture radius", (1e-3, 1e-2, 1e-1, 1.0, 1e1)),
    tolerance=lambda radius: 4 * U * (WIDTH + radius / FOCUS * PIXELS),
    why="roundings of the place on the film, and of the ray from the lens", source="CookPorterCarpenter1984",
)  # fmt: skip
def plane_in_focus(radius):
    """How far from its place on the film a point in focus is seen through any part of the lens."""
    o, d, film = rays_of(lens(radius))
    return Errors(ours=np.hypot(*(seen_at(FOCUS, o, d) - film)))


@case(
    "68", FAMILY, unit="of the bound",
    sweep=("depth", (1e2, 1e4, 1e6, 1e9)), tolerance=1,
    why="5 standard errors, as rendered; and 5 samples, where so few show no spread", source="PotmesilChakravarty1982",
)  # fmt: skip
def edge_far_behind_the_focus(z):
    """The blur of an edge that is far away: its radius tends to A W / (2 F tan(fov / 2))."""
    return Errors(ours=_profile_error(z))


@case(
    "68", FAMILY, unit="pixels",
    sweep=("focus distance", (1e2, 1e6, 1e12, 1e18)),
    tolerance=lambda focus: APERTURE / focus * PIXELS + 4 * U * WIDTH,
    why="the circle of confusion at infinity, and roundings of the place on the film", source="PotmesilChakravarty1982",
)  # fmt: skip
def focus_far_away(focus):
    """How far apart directions are in which a point of the film looks through the lens."""
    _, d, film = rays_of(lens(APERTURE, focus))
    return Errors(ours=np.hypot(*(seen_at(1.0, 0 * d, d) - film)))


@case(
    "69", FAMILY, unit="without a word",
    sweep=("focus distance", (-1.0, 0.0, 1e-3, 1e20)), tolerance=0,
    why="nothing in view could be in focus, or squares of distances overflow", source="near_clip <= F <= 1e18",
)  # fmt: skip
def focus_before_the_near_plane(focus):
    """Whether a picture is made through a lens that is focused behind it, on it, before near_clip or beyond 1e18."""
    scene = half_plane(lens(APERTURE, focus), 4.0)
    try:
        picture(scene, spp=8)
    except UsageError as error:
        return Errors(ours="\n" in str(error), reference=True)
    return Errors(ours=True, reference=True)


# ---- Views


def _view_error(fov, target):
    """The angles between eye rays and those of an exact pinhole, and how far rays are from unit length."""
    size = (1024, 16)
    sensor = camera("perspective", size, target, fov=fov)
    _, d, film = rays_of(sensor, size, 1)
    rotation = np.array(mi.load_dict(sensor).world_transform().matrix, np.float64).reshape(4, 4)[:3, :3]
    tangent = np.tan(np.radians(np.float64(np.float32(fov))) / 2) / (size[0] / 2)
    exact = np.stack([*(np.array([[size[0]], [size[1]]]) / 2 - film) * tangent, np.ones(film.shape[1])])
    exact = rotation @ exact
    exact /= np.linalg.norm(exact, axis=0)
    length = np.linalg.norm(d, axis=0)
    return np.linalg.norm(np.cross(exact, d / length, axis=0), axis=0), length - 1


def _view_bound(fov):
    half = np.radians(fov / 2)
    largest = 0.5 if fov > 90 else np.sin(2 * half) / 2
    return U * (4 + 4 * half * largest / np.sin(2 * half))


@case(
    "71", FAMILY, unit="radians",
    sweep=("field of view", (1e-3, 1e-1, 1.0, 40.0, 90.0, 170.0, 179.0)), tolerance=_view_bound,
    why="roundings of a direction, so that pixels below 6e-8 fall together; of the angle, which tan magnifies",
    source="Higham2002",
)  # fmt: skip
def narrow_and_wide_views(fov):
    """The angle between an eye ray and the exact one, of 1024 pixels in a field of view in degrees."""
    return Errors(ours=_view_error(fov, (0.3, 0.5, 0.8))[0])


@case(
    "71", FAMILY,
    sweep=("field of view", (1e-3, 1e-1, 1.0, 40.0, 90.0, 170.0, 179.0)), tolerance=8 * U,
    why="the normalisation 4 u, the rotation's entries and its products 2 u each", source="Higham2002",
)  # fmt: skip
def eye_rays_of_unit_length(fov):
    """How far the length of an eye ray is from 1."""
    return Errors(ours=_view_error(fov, (0.3, 0.5, 0.8))[1])


# ---- Ray differentials


@case(
    "72", FAMILY,
    sweep=("cosine", (1.0, 1e-1, 1e-2, 1e-3, 1e-4)), tolerance=12 * U,
    why="roundings of the distance, the quotient, its product, the difference and the last product", source="Igehy1999",
)  # fmt: skip
def footprint_of_a_pixel(cosine):
    """How far the hit on a plane moves from a pixel to the next, 1e-5 radians on, relative."""
    rng = np.random.default_rng(72)
    n = rng.standard_normal((3, RAYS))
    n /= np.linalg.norm(n, axis=0)
    side = np.cross(n, rng.standard_normal((3, RAYS)), axis=0)
    side /= np.linalg.norm(side, axis=0)
    d = np.sqrt(1 - cosine**2) * side - cosine * n
    step = np.cross(d, rng.standard_normal((3, RAYS)), axis=0)
    d_x = np.float32(d + 1e-5 * step / np.linalg.norm(step, axis=0))
    n, d, o = np.float32(n), np.float32(d), np.float32(rng.uniform(-1, 1, (3, RAYS)))
    h = np.float32((np.float64(n) * o).sum(0) - rng.uniform(0.1, 1, RAYS))
    truth = _footprint(*(np.longdouble(v) for v in (o, d, d_x, n, h)))
    arguments = *(mi.Vector3f(v) for v in (o, d, d_x, n)), mi.Float(h)
    found = [plane.textbook_footprint(*arguments), plane.footprint(*arguments), _partials(*arguments)]
    length = np.linalg.norm(np.float64(truth), axis=0)
    plain, stable, reference = (
        np.linalg.norm(np.array(v) - np.float64(truth), axis=0) / length for v in found
    )
    return Errors(ours=stable, textbook=plain, reference=reference)


def _footprint(o, d, d_x, n, h):
    hits = [o + (h - (n * o).sum(0)) / (n * v).sum(0) * v for v in (d, d_x)]
    return hits[1] - hits[0]


def _partials(o, d, d_x, n, h):
    """The same by Mitsuba's differentials of texture coordinates, from the hit as rounded."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(d))
    frame = mi.Frame3f(dr.normalize(n))
    si.n, si.p = mi.Normal3f(frame.n), mi.Point3f(o + plane.distance(o, d, n, h) * d)
    si.dp_du, si.dp_dv = frame.s, frame.t
    ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(o), d))
    ray.o_x = ray.o_y = mi.Point3f(o)
    ray.d_x = ray.d_y = d_x
    ray.has_differentials = True
    si.compute_uv_partials(ray)
    return si.duv_dx.x * si.dp_du + si.duv_dx.y * si.dp_dv
