"""The BSDF `phong` as a formula in float64, and what the tests of it share."""

import importlib
import sys

import drjit as dr
import mitsuba as mi
import numpy as np

LOBES = ("phong", "blinn")
NARROW = [1.0, 10.0, 1e2, 1e4, 1e6, 1e8]
ANGLES = np.radians([0, 20, 45, 70, 85, 89.9])
HALF = 2**-24  # rounding error of float32


def register():
    """Register the plugin for the active variant, as its entry point does."""
    name = "whitted.bsdfs.phong"
    importlib.reload(sys.modules[name]) if name in sys.modules else importlib.import_module(name)


def make(lobe="phong", **properties):
    return mi.load_dict({"type": "phong", "lobe": lobe, **properties})


def glossy(lobe, shininess, **properties):
    return make(
        lobe, diffuse_reflectance=0.0, specular_reflectance=1.0, shininess=float(shininess), **properties
    )


def context(component=None, type_mask=None):
    ctx = mi.BSDFContext()
    if component is not None:
        ctx.component = component
    if type_mask is not None:
        ctx.type_mask = +type_mask
    return ctx


def interaction(wi, uv=(0.5, 0.5)):
    si = dr.zeros(mi.SurfaceInteraction3f, np.atleast_2d(wi).shape[0])
    si.wi = mi.Vector3f(np.atleast_2d(np.float32(wi)).T)
    si.uv = mi.Point2f(uv)
    return si


def direction(theta, phi=0.0):
    theta, phi = np.broadcast_arrays(np.float64(theta), phi)
    sin = np.sin(theta)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)], -1)


def spherical(rng, count):
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def lobe_frame(wi):
    """The mirror direction of ``wi``, in the plane y = 0, and two directions across: columns [3, 3]."""
    r = wi * [-1, -1, 1]
    y = np.array([0.0, 1, 0])
    return np.stack([np.cross(y, r), y, r], 1)


def near_lobe(lobe, wi, n, rng, count):
    """Directions that the lobe reaches: cos^n of them is distributed over (e^-20, 1)."""
    versine = -np.expm1(-rng.uniform(0, 20, count) / n)
    sin, phi = np.sqrt(versine * (2 - versine)), rng.uniform(0, 2 * np.pi, count)
    about = np.stack([sin * np.cos(phi), sin * np.sin(phi), 1 - versine], -1)
    if lobe == "phong":
        return about @ lobe_frame(wi).T
    return 2 * (about @ wi)[:, None] * about - wi


def power(lobe, wi, wo, n):
    """cos^n of the lobe's angle, ``float64``; the cosine by the versine, as its digits would not suffice either."""
    if lobe == "phong":
        a, b = wi * [-1, -1, 1], wo
    else:
        a, b = np.float64([0, 0, 1]), wi + wo
    a, b = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (a, b))
    versine = ((a - b) ** 2).sum(-1) / 2
    with np.errstate(divide="ignore"):
        return np.where(versine < 1, np.exp(n * np.log1p(-np.minimum(versine, 1))), 0)


def normalisation(lobe, n):
    if lobe == "phong":
        return (n + 2) / (2 * np.pi)
    return (n + 2) * (n + 4) / (8 * np.pi * (2.0 ** (-n / 2) + n))


def formula(lobe, kd, ks, n, wi, wo):
    """The BSDF times the cosine, in float64."""
    value = kd / np.pi + ks * normalisation(lobe, n) * power(lobe, wi, wo, n)
    return np.where((wi[..., 2] > 0) & (wo[..., 2] > 0), value * wo[..., 2], 0)


def relative_error(found, expected):
    return np.abs(np.float64(found) / expected - 1)


def albedo(bsdf, lobe, n, theta, ctx=None):
    """The reflected share of light from the angle ``theta``: `eval` summed up in float64 along the lobe."""
    nodes, weights = np.polynomial.legendre.leggauss(128)
    u, phi = (nodes + 1) / 2, (np.arange(128) + 0.5) * np.pi / 64
    versine = -np.expm1(np.log(u) / (n + 1))[:, None]
    sin, phi = np.broadcast_arrays(np.sqrt(versine * (2 - versine)), phi)
    about = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.broadcast_to(1 - versine, sin.shape)], -1)
    density = (n + 1) / (2 * np.pi) * (1 - versine) ** n
    wi = direction(theta)
    if lobe == "phong":
        wo = about @ lobe_frame(wi).T
    else:
        cos = about @ wi
        wo = 2 * cos[..., None] * about - wi
        density = np.where(cos > 0, density / (4 * np.abs(cos)), np.inf)
    si = interaction(np.repeat(wi[None], sin.size, 0))
    value = np.array(
        bsdf.eval(ctx or context(), si, mi.Vector3f(np.float32(wo).reshape(-1, 3).T)), np.float64
    )
    return (value.reshape(3, *sin.shape) / density * weights[:, None] / 2).sum((1, 2)) / 128
