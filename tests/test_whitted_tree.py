"""The ray tree of `whitted`, depth first in one symbolic loop, is that of an independent breadth-first version.

Nothing here is random: both draw the same numbers, so that images agree to rounding and ray counts exactly.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from oracle import KINDS, Oracle, blend, mask, twosided

from whitted.film import Grid, Window, eye_rays
from whitted.sampling.draws import Draws
from whitted.sampling.groups import Replicates
from whitted.world import World

SIZE = 16


class Unaudited(Draws):
    """Draws by which no branch that was given up is ever carried on."""

    def audit(self, node):
        return mi.Float(0.999)


def transform():
    return mi.ScalarTransform4f()


def bsdf(**properties):
    return mi.load_dict(properties)


def dielectric(eta=1.5):
    return bsdf(type="dielectric", int_ior=eta)


def diffuse(r, g, b):
    return bsdf(type="diffuse", reflectance={"type": "rgb", "value": [r, g, b]})


def checkerboard(low, high):
    scale = transform().scale([6, 6, 1])
    return mi.load_dict({"type": "checkerboard", "color0": low, "color1": high, "to_uv": scale})


def point(x, y, z, intensity=6.0):
    return {"type": "point", "position": [x, y, z], "intensity": intensity}


def panel():
    return {
        "type": "rectangle",
        "to_world": transform().translate([-1, 3.5, 0.5]).rotate([1, 0, 0], 90).scale(0.7),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [5, 4, 3]}},
    }


def environment():
    rows = np.linspace(0.1, 1.5, 8 * 4 * 3, dtype=np.float32).reshape(4, 8, 3)
    return {"type": "envmap", "bitmap": mi.Bitmap(rows)}


def camera():
    return {
        "type": "perspective",
        "fov": 45,
        "to_world": transform().look_at([0.3, 1.6, 5], [0, 0.7, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}},
    }


def with_spheres(left, right, floor=None, **others):
    """Two spheres on a floor under a point light."""
    floor = floor or diffuse(0.7, 0.5, 0.3)
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": camera(),
            "floor": {
                "type": "rectangle",
                "to_world": transform().rotate([1, 0, 0], -90).scale(4),
                "bsdf": floor,
            },
            "left": {"type": "sphere", "center": [-0.8, 0.8, 0], "radius": 0.75, "bsdf": left},
            "right": {"type": "sphere", "center": [0.8, 0.7, 0.5], "radius": 0.65, "bsdf": right},
            "point": point(2, 3, 2),
            **others,
        },
        optimize=False,
    )


def glass():
    return with_spheres(
        dielectric(1.5), dielectric(1.3), panel=panel(), sky={"type": "constant", "radiance": 0.2}
    )


def image_lit():
    return with_spheres(dielectric(1.5), bsdf(type="conductor"), sky=environment())


def masked():
    textured = mask(dielectric(), checkerboard(0.2, 0.9))
    return with_spheres(textured, mask(diffuse(0.2, 0.6, 0.4), 0.6), panel=panel())


def masked_twosided():
    holes = mask(twosided(bsdf(type="conductor")), 0.5)
    return with_spheres(holes, mask(dielectric(), 0.3), floor=mask(diffuse(0.5, 0.5, 0.5), 0.7))


def thin():
    thin = bsdf(type="thindielectric")
    pane = {"type": "rectangle", "to_world": transform().translate([1, 2, 1]).scale(0.8), "bsdf": thin}
    return with_spheres(thin, bsdf(type="plastic"), pane=pane, panel=panel())


def four_children():
    two = blend(dielectric(1.5), dielectric(1.2), 0.4)
    return with_spheres(
        two, blend(dielectric(), diffuse(0.8, 0.2, 0.2), checkerboard(0.3, 0.8)), panel=panel()
    )


def nested():
    """A blend of a mask, itself in a mask: five children."""
    deep = mask(blend(mask(dielectric(), 0.8), bsdf(type="plastic"), 0.5), 0.9)
    return with_spheres(deep, twosided(bsdf(type="conductor"), bsdf(type="plastic")))


def null_surfaces():
    return with_spheres(bsdf(type="null"), dielectric(), floor=twosided(bsdf(type="plastic")))


def many_lights():
    """More emitters than are unrolled, of five kinds."""
    return with_spheres(
        mask(dielectric(), 0.7),
        bsdf(type="roughconductor", alpha=0.3),
        second=point(-3, 2, 1),
        panel=panel(),
        spot={
            "type": "spot",
            "to_world": transform().look_at([0, 4, 3], [0, 0, 0], [0, 1, 0]),
            "intensity": 20.0,
        },
        sun={"type": "directional", "direction": [0.3, -1, -0.5], "irradiance": 0.8},
        sky={"type": "constant", "radiance": 0.1},
    )


SCENES = [
    glass,
    image_lit,
    masked,
    masked_twosided,
    thin,
    four_children,
    nested,
    null_surfaces,
    many_lights,
]


def eye(scene, spp=2, seed=3):
    """Return eye rays, unaudited draws and the active lanes."""
    grid = Grid(Window(0, 0, SIZE, SIZE), 0, spp)
    ray, _, draws, _, active = eye_rays(
        scene.sensors()[0], (SIZE, SIZE), grid, Replicates(seed, 1), {"antialiasing"}
    )
    return ray, Unaudited(draws.pixel, draws.index, draws.seed, draws.block), active


def walked(scene, rays, **properties):
    """Return what the integrator finds: arrays by name, and ray counts by kind."""
    ray, draws, active = rays
    world = World(scene)
    world.count_rays()
    found = mi.load_dict({"type": "whitted", **properties}).estimate(world, ray, draws, active=active)
    dr.eval(found, world.rays)
    width = max(dr.width(ray), dr.width(active))

    def array(value):
        value = np.array(value)
        return np.broadcast_to(value, (*value.shape[:-1], width)).T

    return {name: array(v) for name, v in found.items()}, {kind: array(world.rays[kind]) for kind in KINDS}


def assert_same(scene, rays, max_depth, min_contribution):
    found, counts = walked(scene, rays, max_depth=max_depth, min_contribution=min_contribution)
    truth = Oracle(scene, max_depth, min_contribution).estimate(*rays)
    assert difference(found["radiance"], truth.radiance) < 1e-6
    for name in ("alpha", "dropped_by_depth", "dropped_by_cutoff"):
        np.testing.assert_allclose(found[name], getattr(truth, name), rtol=1e-5, atol=1e-6)
    for kind in KINDS:
        np.testing.assert_array_equal(counts[kind], truth.rays[kind], err_msg=kind)
    return truth


def difference(image, truth):
    """The largest difference relative to a pixel's value or, in dark ones, to the mean."""
    scale = np.maximum(np.abs(truth), np.abs(truth).mean())
    return np.max(np.abs(image - truth) / np.maximum(scale, np.finfo(np.float32).tiny))


@pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)
@pytest.mark.parametrize("min_contribution", [1 / 64, 0])
def test_tree_is_the_breadth_first_one(make, min_contribution):
    scene = make()
    max_depth = 5 if Oracle(scene).branching > 3 else 8
    truth = assert_same(scene, eye(scene), max_depth, min_contribution)
    assert truth.radiance.mean() > 0.01
    assert truth.rays["reflection"].sum() + truth.rays["transmission"].sum() > 100
    assert (truth.dropped_by_cutoff.max() > 0) == (min_contribution > 0)


@pytest.mark.parametrize("max_depth", [*range(9), 12])
def test_every_depth(max_depth):
    scene = glass()
    truth = assert_same(scene, eye(scene, spp=1), max_depth, 0)
    assert truth.rays["shadow"].any() == (max_depth > 1)


@pytest.mark.parametrize(
    ("make", "width"),
    [(four_children, 1), (four_children, 16), (four_children, 17), (four_children, 1000), (many_lights, 1)],
)
def test_every_width_of_the_wavefront(make, width):
    """Dr.Jit works in packets of up to 16 lanes, and treats arrays of width 1 in ways of its own."""
    scene, rng = make(), np.random.default_rng(width + 5)
    target = rng.uniform([-1.2, 0.2, -0.5], [-0.4, 1.4, 0.5], (width, 3)).T.astype(np.float32)
    o = mi.Point3f(0.3, 1.6, 5) + dr.zeros(mi.Point3f, width)
    ray = mi.Ray3f(o, dr.normalize(mi.Point3f(target) - o))
    number = dr.arange(mi.UInt32, width)
    draws = Unaudited(number, dr.zeros(mi.UInt32, width), mi.UInt32(7), number)
    truth = assert_same(scene, (ray, draws, dr.full(mi.Bool, True, width)), 5, 0)
    assert truth.radiance.any()


@pytest.mark.parametrize("make", [glass, masked], ids=lambda make: make.__name__)
def test_following_what_was_dropped_leaves_the_picture_alone(make):
    """One in 16 of the branches given up is carried on to measure the loss: no bit of the picture hangs on it."""
    scene = make()
    ray, draws, active = eye(scene)
    without, few = walked(scene, (ray, draws, active), max_depth=4)
    audited = Draws(draws.pixel, draws.index, draws.seed, draws.block)
    with_audits, more = walked(scene, (ray, audited, active), max_depth=4)
    for name in ("radiance", "alpha", "dropped_by_depth", "dropped_by_cutoff"):
        np.testing.assert_array_equal(without[name], with_audits[name], err_msg=name)
    assert not without["lost_by_depth"].any()
    assert with_audits["lost_by_depth"].any()
    assert sum(map(np.sum, few.values())) < sum(map(np.sum, more.values()))


@pytest.mark.parametrize("mistake", ["fresnel", "light"])
def test_a_wrong_factor_is_noticed(mistake):
    scene = glass()
    rays = eye(scene)
    found, _ = walked(scene, rays, max_depth=6, min_contribution=0)
    wrong = Oracle(scene, 6, 0, mistake=mistake).estimate(*rays)
    assert difference(found["radiance"], wrong.radiance) > 1e-2


def test_a_depth_that_is_off_by_one_is_noticed():
    scene = glass()
    rays = eye(scene)
    found, counts = walked(scene, rays, max_depth=6, min_contribution=0)
    for max_depth in (5, 7):
        wrong = Oracle(scene, max_depth, 0).estimate(*rays)
        assert difference(found["radiance"], wrong.radiance) > 1e-4
        assert counts["transmission"].sum() != wrong.rays["transmission"].sum()
