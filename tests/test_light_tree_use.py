"""Light trees in programs, the shape of the trees, and input that is degenerate or wrong."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from light_trees import probabilities, program, random_lights, random_receivers, sample

from whitted.lights.tree import LightTree
from whitted.lights.tree_build import WIDTH

# ---- Use in programs


@pytest.mark.parametrize("method", ["sample", "probability"])
def test_all_trees_share_one_kernel(method):
    hashes = set()
    for count in (2, WIDTH, 500):
        tree, p, n, u = program(count, count, 64)
        leaf = dr.arange(mi.UInt32, 64) % dr.opaque(mi.UInt32, count)
        dr.eval(leaf)
        dr.kernel_history_clear()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.eval(tree.sample(p, n, u) if method == "sample" else tree.probability(leaf, p, n))
        hashes |= {entry["hash"] for entry in dr.kernel_history([dr.KernelType.JIT])}
    assert len(hashes) == 1


def test_one_light_needs_no_loop():
    tree, p, n, u = program(1, 1, 64)
    with dr.scoped_set_flag(
        dr.JitFlag.SymbolicLoops, False
    ):  # a loop over evaluated arrays would evaluate them
        leaf, probability, rest, valid = tree.sample(p, n, u)
    assert valid.state == dr.VarState.Unevaluated
    np.testing.assert_array_equal(np.array(rest), np.array(u))
    np.testing.assert_array_equal(np.array(probability), np.array(valid))
    np.testing.assert_array_equal(np.array(tree.probability(leaf, p, n)), np.array(valid))
    assert 0 < np.array(valid).sum() < 64


def test_in_a_loop_as_outside():
    tree, p, n, u = program(1, 100, 256)

    def step(i, u, total, back):
        leaf, probability, u, valid = tree.sample(p, n, u, i < 2)
        total += dr.select(valid, probability, 0)
        return i + 1, u, total, back + tree.probability(leaf, p, n, valid)

    state = (mi.UInt32(0), u, mi.Float(0), mi.Float(0))
    _, _, total, back = dr.while_loop(state, lambda i, *_: i < 3, step)
    first, rest = tree.sample(p, n, u)[1:3]
    second = tree.sample(p, n, rest)[1]
    np.testing.assert_allclose(np.array(total), np.array(first + second), rtol=1e-6)
    np.testing.assert_allclose(np.array(back), np.array(total), rtol=1e-5)


def test_one_receiver_for_many_numbers_and_one_of_each():
    tree, _, _, u = program(2, 300, 128)
    point, normal = mi.Point3f(0.2, 0.3, 0.4), mi.Vector3f(0, 0, 1)
    wide = dr.zeros(mi.Float, 128)
    narrow = tree.sample(point, normal, u)
    for a, b in zip(narrow, tree.sample(point + wide, normal + wide, u), strict=True):
        np.testing.assert_array_equal(np.array(a), np.array(b))
    single = tree.sample(point, normal, mi.Float(np.array(u)[:1]))
    for a, b in zip(single, narrow, strict=True):
        np.testing.assert_array_equal(np.array(a)[:1], np.array(b)[:1])
    assert dr.width(tree.probability(mi.UInt32(3), point, normal)) == 1


def test_lanes_that_are_not_active_choose_nothing():
    tree, p, n, u = program(3, 50, 64)
    active = dr.arange(mi.UInt32, 64) % 2 == 0
    leaf, probability, _, valid = tree.sample(p, 0 * n, u, active)
    np.testing.assert_array_equal(np.array(valid), np.array(active))
    np.testing.assert_array_equal(np.array(probability) > 0, np.array(active))
    np.testing.assert_array_equal(np.array(tree.probability(leaf, p, 0 * n, active)) > 0, np.array(active))


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_other_variants(variant):
    expected = [np.array(a) for a in (lambda tree, *rest: tree.sample(*rest))(*program(4, 90, 64))]
    mi.set_variant(variant)
    tree, p, n, u = program(4, 90, 64)
    for a, b in zip(tree.sample(p, n, u), expected, strict=True):
        np.testing.assert_array_equal(np.array(a), b)


# ---- Degenerate and wrong input


@pytest.mark.parametrize("count", [2, WIDTH, 9, 1000])
def test_lights_in_one_place_share_evenly(count):
    place = np.full((count, 3), 0.7)
    tree = LightTree(place, place, np.ones(count), 0 * place, -np.ones(count), np.zeros(count))
    for p in (place[:1], place[:1] + 1, place[:1] * 1e20):
        found = probabilities(tree, np.float32(p), np.zeros((1, 3), np.float32))
        np.testing.assert_allclose(found.sum(), 1, rtol=1e-5)
        leaves = np.array(tree.child)[np.array(tree.is_leaf) > 0]
        assert sorted(leaves) == list(range(count))
        if count <= WIDTH:
            np.testing.assert_allclose(found, 1 / count, rtol=1e-5)


def test_receivers_in_lights_and_far_away_get_finite_probabilities():
    lights, points, _ = random_lights(60, 2, 0.2)
    places = np.concatenate(
        [points[:, 0], (lights[0] + lights[1]) / 2, 1e4 * points[:, 0], 1e25 * points[:, 0]]
    )
    found = probabilities(LightTree(*lights), np.float32(places), np.zeros_like(places, np.float32))
    assert np.isfinite(found).all()
    assert (found.sum(1) > 0.5).all()
    np.testing.assert_array_less(found.sum(1), 1 + 1e-5)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("count", [1, 2, 100])
def test_numbers_that_are_not_finite_choose_nothing_and_end(bad, count):
    lights, _, _ = random_lights(count, 2)
    tree = LightTree(*lights)
    fine, up = np.full((1, 3), 0.5), np.array([[0, 0, 1.0]])
    for p, n in ((fine * bad, up), (np.array([[0.5, bad, 0.5]]), 0 * up), (fine, up * [1, 1, bad])):
        with np.errstate(invalid="ignore"):
            p, n = np.float32(p), np.float32(n)
        leaf, probability, _, valid = sample(tree, p, n, [0.5])
        assert (leaf.tolist(), probability.tolist(), valid.tolist()) == ([0], [0], [False])
        assert (probabilities(tree, p, n) == 0).all()


def test_a_number_at_the_end_of_its_range_chooses_a_light():
    tree, p, n, _ = program(5, 700, 256)
    for u in (0.0, 1 - 2**-24):
        leaf, probability, rest, valid = (np.array(a) for a in tree.sample(p, 0 * n, mi.Float(u)))
        assert valid.mean() > 0.5
        assert (probability[valid] > 0).all()
        assert ((rest >= 0) & (rest < 1)).all()
        assert (leaf < 700).all()


def test_a_light_without_power_is_never_chosen():
    lights, _, _ = random_lights(50, 4)
    lights[2][::2] = 0
    p, n = random_receivers(100, 5)
    found = probabilities(LightTree(*lights), p, 0 * n)
    assert (found[:, ::2] == 0).all()
    dark = LightTree(*lights[:2], 0 * lights[2], *lights[3:])
    assert (probabilities(dark, p, 0 * n) == 0).all()
    assert not sample(dark, p, n, np.full(100, 0.5))[3].any()


def test_a_light_that_is_very_faint_has_some_probability():
    at = np.array([[0.0, 0, 1], [0, 0, 1.5]])
    tree = LightTree(at, at, [1, 1e-30], at, [-1, -1], [0, 0])
    found = probabilities(tree, np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32))
    assert 0 < found[0, 1] < 1e-6


@pytest.mark.parametrize(("order", "longest"), [("random", 8), ("line", 8), ("octaves", 18)])
def test_every_light_has_one_place_and_the_way_there_is_short(order, longest):
    """With 12 bins a cut takes off at least log2(12) of the 3 * 40 octaves, and three cuts make a level."""
    count = 10000
    rng = np.random.default_rng(1)
    at = rng.random((count, 3))
    if order == "line":
        at[:, 1:] = 0
    if order == "octaves":
        at = 2.0 ** -(40 * at)
    tree = LightTree(at, at, rng.random(count), at, -np.ones(count), np.zeros(count))
    parent, slot = np.array(tree.parent), np.array(tree.slot)
    assert len(set(slot.tolist())) == count
    np.testing.assert_array_equal(np.array(tree.child)[slot], np.arange(count))
    steps, nodes = 0, slot // WIDTH
    while nodes.any():
        nodes, steps = np.where(nodes > 0, parent[nodes] // WIDTH, 0), steps + 1
    assert steps <= longest


def test_children_lie_within_the_bounds_of_their_node():
    lights, _, _ = random_lights(3000, 6)
    tree = LightTree(*lights)
    centre, radius, axis, intensity, cosine, sine = np.split(
        np.array(tree.bounds, np.float64).reshape(-1, 12)[:, :10], [3, 4, 7, 8, 9], axis=1
    )
    parent = np.repeat(np.array(tree.parent)[:-1], WIDTH)
    below = (intensity[:, 0] > 0) & (np.arange(len(parent)) >= WIDTH)
    above = parent[below]
    gap = np.linalg.norm(centre[below] - centre[above], axis=1)
    assert (gap <= radius[above, 0] * (1 + 1e-5)).all()
    angle = np.arctan2(sine, cosine)[:, 0]
    between = np.arccos(np.clip((axis[below] * axis[above]).sum(1), -1, 1))
    is_cone = cosine[above, 0] > -1
    assert (between <= angle[above] + 1e-3)[is_cone].all()
    total = np.bincount(above, intensity[below, 0], len(parent))
    filled = total > 0
    np.testing.assert_allclose(total[filled], intensity[filled, 0], rtol=1e-5)


BAD = {
    "no light": lambda a: [x[:0] for x in a],
    "shapes": lambda a: [a[0][:2], *a[1:]],
    "flat array": lambda a: [a[0][:, 0], *a[1:]],
    "nan": lambda a: [a[0] * np.nan, *a[1:]],
    "infinite power": lambda a: [*a[:2], a[2] + np.inf, *a[3:]],
    "swapped": lambda a: [a[1], a[0], *a[2:]],
    "negative": lambda a: [*a[:2], -a[2], *a[3:]],
    "no axis": lambda a: [*a[:3], 0 * a[3], 0 * a[4], a[5]],
    "spread": lambda a: [*a[:4], a[4] + 3, a[5]],
    "emission": lambda a: [*a[:5], a[5] - 1.1],
}


@pytest.mark.parametrize("name", BAD)
def test_wrong_arguments_are_refused(name):
    lights, _, _ = random_lights(5, 1, kinds=("sphere",))
    with pytest.raises(ValueError, match="light tree"):
        LightTree(*BAD[name](list(lights)))
