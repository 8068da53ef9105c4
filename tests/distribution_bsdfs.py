"""The BSDFs with which `distribution` is tried: Mitsuba's plugins and nestings of them, in groups for one scene."""

import mitsuba as mi
import numpy as np
from test_lobes import (
    NESTED,
    PLUGINS,
    bent_normal,
    blend,
    bumps,
    conductor,
    diffuse,
    made,
    mask,
    plastic,
    twosided,
)
from whitted_scenes import transform

roughdielectric = {"type": "roughdielectric", "alpha": 0.3}
roughconductor = {"type": "roughconductor", "alpha": 0.2}
roughplastic = {"type": "roughplastic", "alpha": 0.2}
MORE = {
    "blend(diffuse, roughconductor)": blend(diffuse, roughconductor),
    "blend(roughdielectric, plastic)": blend(roughdielectric, plastic),
    "blend(conductor, diffuse)": blend(conductor, diffuse),
    "bumpmap(plastic)": {"type": "bumpmap", "arbitrary": bumps, "nested": plastic},
    "bumpmap(roughconductor)": {"type": "bumpmap", "arbitrary": bumps, "nested": roughconductor},
    "mask(roughdielectric)": mask(roughdielectric),
    "mask(roughplastic)": mask(roughplastic, 0.7),
    "normalmap(roughdielectric)": {"type": "normalmap", "normalmap": bent_normal, "nested": roughdielectric},
    "twosided(roughplastic)": twosided(roughplastic),
    "twosided(roughplastic, diffuse)": twosided(roughplastic, diffuse),
}
BSDFS = PLUGINS | NESTED | MORE
BEHIND = {"twosided(conductor, plastic)", "twosided(roughplastic, diffuse)"}  # seen from the back
GROUPS = {
    "specular": [
        "conductor",
        "dielectric",
        "bumpmap",
        "normalmap",
        "blendbsdf",
        "twosided(conductor)",
        "twosided(normalmap)",
        "bumpmap(conductor)",
        "normalmap(bumpmap)",
    ],
    "rough": [
        "diffuse",
        "roughconductor",
        "roughplastic",
        "pplastic",
        "normalmap(twosided(diffuse))",
        "blend(diffuse, roughconductor)",
        "bumpmap(roughconductor)",
        "twosided(roughplastic)",
        "twosided(roughplastic, diffuse)",
    ],
    "rough and transmitting": [
        "roughdielectric",
        "principled",
        "principledthin",
        "normalmap(roughdielectric)",
    ],
    "specular and smooth": [
        "plastic",
        "twosided",
        "twosided(conductor, plastic)",
        "twosided(diffuse, conductor)",
        "twosided(plastic, diffuse)",
        "twosided(bumpmap)",
        "bumpmap(plastic)",
        "blend(dielectric, plastic)",
        "blend(normalmap, bumpmap)",
    ],
    "straight through": [
        "null",
        "thindielectric",
        "circular",
        "polarizer",
        "retarder",
        "mask",
        "hair",
        "mask(twosided)",
        "mask(mask)",
    ],
    "masks": [
        "mask(dielectric)",
        "mask(thindielectric)",
        "mask(textured)",
        "mask(normalmap)",
        "mask(roughdielectric)",
        "mask(roughplastic)",
        "blend(null, dielectric)",
        "blend(blend(null, conductor), dielectric)",
    ],
    "blends": [
        "mask(blend)",
        "blend(mask, conductor)",
        "blend(blend, mask)",
        "blend(twosided, twosided)",
        "blend(conductor, diffuse)",
        "blend(roughdielectric, plastic)",
    ],
}


def chosen_point_by_point(spec, scale=331):
    """Return a BSDF's dict in which a ``blendbsdf`` is one child or the other in stripes finer than pixels.

    Of a blend of specular and smooth children Mitsuba weighs the samples wrongly where both have a share.
    """
    spec = spec() if callable(spec) else spec
    if not isinstance(spec, dict):
        return spec
    spec = {name: chosen_point_by_point(value, scale * 1.137) for name, value in spec.items()}
    if spec.get("type") == "blendbsdf" and isinstance(spec["weight"], float):
        assert spec["weight"] == 0.4
        stripes = mi.Bitmap(np.float32([0, 1, 0, 1, 0]).reshape(1, 5, 1))
        to_uv = transform().scale([scale, 1, 1])
        spec["weight"] = {
            "type": "bitmap",
            "bitmap": stripes,
            "raw": True,
            "filter_type": "nearest",
            "to_uv": to_uv,
        }
    return spec


def group(name, prepare=lambda spec: spec):
    """Return the BSDFs of a group as a dict from name to ``mi.BSDF``, their dicts passed through ``prepare`` before."""
    return {one: made(prepare(BSDFS[one])) for one in GROUPS[name]}
