"""Lights and receivers to try light trees on, and what the trees say as NumPy arrays."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.lights.tree import LightTree


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_lights(count, seed, extent=0.1, kinds=("point", "sphere", "flat")):
    """Return the arguments of `LightTree` for lights in the unit cube, and points [count, 32, 3] with normals."""
    rng = np.random.default_rng(seed)
    kind = rng.choice(kinds, count)
    centre, axis, size = rng.random((count, 3)), unit(rng.normal(size=(count, 3))), extent * rng.random(count)
    size[kind == "point"] = 0
    around = unit(rng.normal(size=(count, 32, 3)))
    flat = (kind == "flat")[:, None, None]
    within = around - np.einsum("nij,nj->ni", around, axis)[..., None] * axis[:, None]
    points = centre[:, None] + size[:, None, None] * np.where(flat, within, around)
    normals = np.where(flat, axis[:, None], around)
    is_round = (kind == "sphere")[:, None]
    lower = np.where(is_round, centre - size[:, None], points.min(1))
    upper = np.where(is_round, centre + size[:, None], points.max(1))
    power = rng.exponential(size=count) ** 2
    bounds = (lower, upper, power, axis, np.where(kind == "flat", 1.0, -1.0), np.zeros(count))
    return bounds, points, np.where((kind == "point")[:, None, None], np.nan, normals)


def random_receivers(count, seed):
    """Return points and normals in and around the unit cube, ``float32`` [count, 3]."""
    rng = np.random.default_rng(seed)
    return np.float32(rng.random((count, 3)) * 1.6 - 0.3), np.float32(unit(rng.normal(size=(count, 3))))


def probabilities(tree, p, n):
    """Return the probability of each light for each receiver, ``float64`` [receivers, lights]."""
    p, n = (mi.Point3f(np.repeat(a, tree.count, 0).T) for a in (p, n))
    leaf = mi.UInt32(np.tile(np.arange(tree.count, dtype=np.uint32), dr.width(p) // tree.count))
    return np.array(tree.probability(leaf, p, mi.Vector3f(n)), np.float64).reshape(-1, tree.count)


def sample(tree, p, n, u):
    """Return `LightTree.sample` for arrays as arrays."""
    point = mi.Point3f(np.float32(p).reshape(-1, 3).T)
    normal = mi.Vector3f(np.float32(n).reshape(-1, 3).T)
    found = tree.sample(point, normal, mi.Float(np.float32(u)))
    return [np.broadcast_to(np.array(a), np.shape(u)) for a in found]


def irradiance(lights, p, n):
    """Return what lights as small as points send to receivers, ``float64`` [receivers, lights]."""
    lower, upper, power, axis, cos_spread, _ = lights
    w = (lower + upper)[None] / 2 - p[:, None].astype(np.float64)
    d2 = (w**2).sum(-1)
    w = unit(w)
    at_light = np.where(cos_spread == 1, np.maximum(-(w * axis).sum(-1), 0), 0.25)
    return power / np.pi * at_light * np.maximum((w * n[:, None]).sum(-1), 0) / d2


def shares(E):
    return E / E.sum(1, keepdims=True)


def program(seed, count, width):
    lights, _, _ = random_lights(count, seed)
    tree = LightTree(*lights)
    p, n = random_receivers(width, 20)
    u = np.random.default_rng(21).random(width, np.float32)
    p, n = (of(*(mi.Float(row.tolist()) for row in a.T)) for of, a in ((mi.Point3f, p), (mi.Vector3f, n)))
    return (
        tree,
        p,
        n,
        mi.Float(u.tolist()),
    )  # arrays of NumPy's may be aligned or not, which changes the kernel
