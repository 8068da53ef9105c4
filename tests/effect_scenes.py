"""The scenes of the distributed effects in their sizes, and what `path` sees in them, beside the closed forms of it."""

import re
from pathlib import Path
from xml.etree import ElementTree

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import signal

import whitted
from whitted.scene import shipped_path

SINGLE = ("soft_shadows", "open_floor", "gloss", "depth_of_field", "translucency", "interreflection")
MIXED = ("pool_balls", "mixed_lens_penumbra", "mixed_glass")
SIZES = ("small", "medium", "large")
# of the boxes in depth_of_field: depth, and middle
FRONTS = {3: (-0.7644, -0.79), 4: (-0.364, -0.72), 6: (0.4805, -0.58), 12: (2.97, -0.16)}
SIDE, FINE, SPP = 256, 8, 256
PIXELS = SIDE / (2 * np.tan(np.radians(20)))  # per tangent of the angle to the axis
ROUNDING = 3e-5  # relative: parameters of six digits, and geometry in single precision


def text_of(name):
    return Path(shipped_path(name)).read_text(encoding="utf-8")


def defaults_of(name):
    root = ElementTree.fromstring(text_of(name))
    return {element.get("name"): element.get("value") for element in root.findall("default")}


def sizes_of(name):
    """The parameters of each size, as the first comment lists them: ``Sizes: small a=1 b=2; medium ...; large ....``"""
    listed = " ".join(re.search(r"^Sizes: (.*?)\.$", text_of(name), re.DOTALL | re.MULTILINE)[1].split())
    parts = (part.split() for part in listed.split("; "))
    return {size: dict(pair.split("=") for pair in pairs) for size, *pairs in parts}


def load(name, size="medium", **defines):
    defines = {"integrator": "path", "width": 32, "height": 32} | defines
    return whitted.load(name, **(sizes_of(name)[size] if name in SINGLE else {}) | defines).mitsuba


def seen(scene, origin, target, spp=1, max_depth=2):
    """What `path` gives along the rays from points towards points, ``float64`` [rays, spp, 3]."""
    origin, target = np.broadcast_arrays(
        *(np.atleast_2d(np.asarray(p, np.float32)) for p in (origin, target))
    )
    start, end = (mi.Point3f(np.repeat(p, spp, 0).T) for p in (origin, target))
    ray = mi.RayDifferential3f(mi.Ray3f(start, dr.normalize(end - start)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, len(target) * spp)
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth})
    colour = integrator.sample(scene, sampler, ray)[0]
    return np.array(colour, np.float64).T.reshape(len(target), spp, 3)


def agree(samples, expected, rounding=ROUNDING):
    """Whether the means of samples, [rays, spp, channels], are the expected [rays or 1, channels or 1]."""
    error = samples.std(1, ddof=1) / np.sqrt(samples.shape[1])
    return bool((np.abs(samples.mean(1) - expected) <= 5 * error + rounding * np.abs(expected)).all())


def floor_point(x, z):
    return np.stack(np.broadcast_arrays(x, 0.0, z), -1).reshape(-1, 3).astype(float)


def irradiance_samples(scene, points, spp):
    """Samples of the irradiance of points of the floor y = 0, in the first channel's reflectance."""
    start = points + np.array([0, 0.05, 0])
    ray = mi.Ray3f(mi.Point3f(start.T), mi.Vector3f(0, -1, 0))
    si = scene.ray_intersect(ray)
    reflectance = np.array(si.bsdf().eval_diffuse_reflectance(si), np.float64).T
    return seen(scene, start, points, spp)[..., :1] * np.pi / reflectance[:, None, :1]


def lambert(points, low, high):
    """The irradiance of points, [N, 3], that face up, by a horizontal rectangle of radiance 1 (Lambert's formula).

    ``low`` and ``high`` are its corners, [3] or [N, 3]; where they cross it is empty.
    """
    low, high = np.broadcast_to(low, points.shape), np.broadcast_to(high, points.shape)
    x, y, z = low[:, 0], low[:, 1], low[:, 2]
    right, far = np.maximum(high[:, 0], x), np.maximum(high[:, 2], z)
    corners = np.array([[x, y, z], [x, y, far], [right, y, far], [right, y, z]]).transpose(0, 2, 1) - points
    total = 0.0
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        normal = np.cross(a, b)
        length = np.linalg.norm(normal, axis=1)
        angle = np.arctan2(length, (a * b).sum(1))
        total = total + angle * normal[:, 1] / np.maximum(length, 1e-30)
    return np.abs(total)[:, None] / 2


def lens_window(depth, border, factor, aperture, spp):
    """The red channel of the middle of a box's front in ``depth_of_field``, at ``factor`` times the size."""
    half = int(0.07 * PIXELS) - 9 + border  # of what sees the front only, and not its frame
    centre = SIDE / 2 + np.array([1, -1]) * FRONTS[depth] / depth * PIXELS
    window = [*((np.round(centre) - half) * factor), *[2 * half * factor] * 2]
    size = SIDE * factor
    scene = whitted.load("depth_of_field", width=size, height=size, aperture_radius=aperture)
    options = {"spp": spp, "seed": 4, "crop": [int(v) for v in window]}
    return whitted.render(scene, "path:max_depth=2", **options).mean[..., 0].astype(float)


def lens_chi_square(depth, c, border=7):
    """The sum of squared deviations, of unit variance, of a box's front from its sharp picture blurred by a disk.

    ``c`` is the disk's radius in pixels. A pixel is the mean of ``SPP`` samples of one of two colours, so that
    its variance is known; the number of pixels that see both is returned, too.
    """
    picture = lens_window(depth, 0, 1, 0.1, SPP)
    sharp = lens_window(depth, border, FINE, 1e-6, 32)
    offset = np.arange(-border * FINE, border * FINE + 1)
    disk = (np.add.outer(offset**2, offset**2) <= (c * FINE) ** 2).astype(float)
    blurred = signal.fftconvolve(sharp, disk / disk.sum(), "valid")
    mean = blurred.reshape(len(picture), FINE, len(picture), FINE).mean((1, 3))
    variance = (mean - sharp.min()) * (sharp.max() - mean) / SPP
    mixed = variance > 0.05 * variance.max()
    return ((picture - mean)[mixed] ** 2 / variance[mixed]).sum(), mixed.sum()
