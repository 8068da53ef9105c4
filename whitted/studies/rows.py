"""Rows of a study's tables, and its pictures, from what they stand for."""

import hashlib
import json

import numpy as np

from whitted import image
from whitted.studies.cells import digest


def cell_picture(cell, pixels):
    """Return the `whitted.image.Picture` of a cell: radiance, and the facts of its making."""
    header = {
        "samplesPerPixel": cell.spp,
        "seed": cell.seed,
        "integrator": cell.method.label,
        "variant": cell.variant,
        "sceneHash": cell.scene.hash,
        "effects": ",".join(cell.method.simulated),
        "key": cell.key,
        **{f"{name}Version": number for name, number in cell.versions.items()},
    }
    return image.Picture(image.layer_channels("", pixels), header)


def image_hash(pixels):
    """Return the SHA-256 of an array's values as float32, row by row."""
    return hashlib.sha256(np.ascontiguousarray(pixels, np.float32).tobytes()).hexdigest()


def scene_row(scene):
    """Return the row of a `whitted.studies.cells.Scene`, a dict."""
    row = {
        "label": scene.label,
        "hash": scene.hash,
        "path": scene.scene,
        "define": json.dumps(scene.define),
        "sensor": scene.sensor,
        "width": scene.width,
        "height": scene.height,
    }
    return {"id": digest([scene.hash, scene.sensor, scene.width, scene.height])} | row


def method_row(scene, method):
    """Return the row of a `whitted.studies.cells.Method` on a scene, a dict."""
    row = {
        "scene": scene_row(scene)["id"],
        "label": method.label,
        "integrator": json.dumps(method.integrator),
        "sampler": method.sampler,
        "effects": method.effects,
        "simulated": json.dumps(method.simulated),
        "plan_seconds": method.plan_seconds,
    }
    return {"id": digest([row["scene"], method.integrator, method.sampler, method.effects])} | row


def cell_row(cell, scene, method):
    """Return the row of a planned `whitted.studies.cells.Cell`, a dict, from the ids of its scene and method."""
    return {
        "key": cell.key,
        "role": cell.role,
        "scene": scene,
        "method": method,
        "spp": cell.spp,
        "replicate": cell.replicate,
        "seed": cell.seed,
        "variant": cell.variant,
        "versions": json.dumps(cell.versions),
        "wanted": 1,
        "status": "planned",
    }
