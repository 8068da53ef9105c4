"""A cell's key is its content, its parts make it up, and the order mixes all methods in each turn."""

from dataclasses import replace

import numpy as np
import pytest

from whitted.studies import cells as module
from whitted.studies.cells import Cell, Method, Scene, cells_of, interleaved
from whitted.studies.finishing import assembled, summed
from whitted.studies.specification import read

SCENE = Scene("s", "soft_shadows", {}, 0, 16, 10, "abc")
OURS = Method("distribution", {"type": "distribution"}, None, "auto", (), 0.1, {1: 1, 4: 4, 64: 64})
PATH = Method("path", {"type": "path"}, "independent", None, (), None, {1: 1, 4: 4, 64: 64})
CELL = Cell("cell", SCENE, OURS, 4, 0, 99, "llvm_ad_rgb", {"whitted": "1"})
SPEC = {
    "scenes": "soft_shadows",
    "integrators": ["distribution", "path"],
    "spp": [1, 4],
    "replicates": 3,
    "timed": 2,
    "reference": {"integrator": "path", "spp": 64, "replicates": 2},
}


def made(**changes):
    spec = read(SPEC | changes)
    return cells_of(spec, SCENE, [OURS, PATH], PATH, {"whitted": "1"})


@pytest.mark.parametrize(
    "other",
    [
        replace(CELL, spp=8),
        replace(CELL, seed=1),
        replace(CELL, versions={"whitted": "2"}),
        replace(CELL, variant="llvm_ad_mono"),
        replace(CELL, method=PATH),
        replace(CELL, method=replace(OURS, integrator={"type": "distribution", "max_depth": 2})),
        replace(CELL, scene=replace(SCENE, hash="abd")),
        replace(CELL, scene=replace(SCENE, width=17)),
        replace(CELL, scene=replace(SCENE, sensor=1)),
    ],
)
def test_other_content_has_another_key(other):
    assert other.key != CELL.key


@pytest.mark.parametrize(
    "same",
    [
        replace(CELL, timed=False),
        replace(CELL, scene=replace(SCENE, label="other", scene="elsewhere.xml")),
        replace(CELL, method=replace(OURS, label="other", plan_seconds=3.0)),
    ],
)
def test_what_does_not_change_the_picture_does_not_change_the_key(same):
    assert same.key == CELL.key


def test_no_two_cells_share_a_seed_and_references_have_their_own():
    references, turns = made()
    seeds = [cell.seed for cell in references] + [cell.seed for turn in turns for cell in turn]
    assert len(set(seeds)) == len(seeds) == 2 + 3 * 4
    ladder = [cell.seed for turn in turns for cell in turn if cell.method is OURS and cell.spp == 4]
    assert (
        min(np.diff(sorted(ladder))) > 1 << 16
    )  # close seeds repeat stratified patterns, shifted by a pixel


def test_more_replicates_or_steps_leave_the_keys_there_were():
    before = {cell.key for turn in made()[1] for cell in turn}
    after = {cell.key for turn in made(replicates=5, spp=[1, 4, 64])[1] for cell in turn}
    assert before < after


def test_the_timed_ones_are_the_first():
    assert [cell.timed for turn in made()[1] for cell in turn] == [True] * 8 + [False] * 4
    assert all(cell.timed for turn in made(timed=None)[1] for cell in turn)


def test_steps_that_round_to_the_same_samples_are_one_cell():
    rounded = replace(PATH, accepted={1: 4, 4: 4, 64: 64})
    _, turns = cells_of(read(SPEC), SCENE, [rounded], PATH, {})
    assert [len(turn) for turn in turns] == [1, 1, 1]


def test_each_turn_has_every_setting_once_in_an_order_of_its_own():
    _, turns = made(replicates=8)
    order = interleaved([turns], seed=0)
    settings = [(cell.method.label, cell.spp) for cell in order]
    assert len({tuple(settings[i : i + 4]) for i in range(0, 32, 4)}) > 3
    assert all(len(set(settings[i : i + 4])) == 4 for i in range(0, 32, 4))
    assert [cell.replicate for cell in order] == sorted(cell.replicate for cell in order)
    assert interleaved([turns], seed=0) == order != interleaved([turns], seed=1)


@pytest.mark.parametrize(("size", "ranges"), [(1 << 27, 1), (400, 1), (64, 4)])
@pytest.mark.parametrize("method", [OURS, PATH])
def test_parts_cover_every_sample_of_every_pixel_once(method, size, ranges, monkeypatch):
    monkeypatch.setattr(module, "PART", size)
    cell = replace(CELL, method=method, spp=4)
    count = np.zeros((10, 16), int)
    for part in cell.parts:
        assert part.y % 4 == 0
        count[part.y : part.y + part.height, part.x : part.x + part.width] += part.stop - part.start
    assert (count == 4).all()
    starts = {part.start for part in cell.parts}
    assert len(starts) == (ranges if method is OURS else 1)  # Mitsuba's samplers can't begin in the middle


def test_parts_are_put_together_in_one_order_whatever_comes_first(monkeypatch):
    monkeypatch.setattr(module, "PART", 64)
    cell = replace(CELL, spp=4)
    rng = np.random.default_rng(0)
    results = {}
    for part in cell.parts:
        sums = rng.random((part.height, 16, 3)) * 10.0 ** rng.integers(0, 9)
        results[part] = {"sums": sums, "weights": np.ones((part.height, 16))}
    whole = assembled(cell, results)
    backwards = assembled(cell, dict(reversed(results.items())))
    np.testing.assert_array_equal(whole, backwards)
    expected = sum(results[part]["sums"] for part in cell.parts if part.y == 0) / 4
    np.testing.assert_allclose(whole[:4], expected, rtol=1e-6)


def test_seconds_of_parts_add_up_cold_and_warm():
    def timing(load, execute):
        return {"load": load, "execute": execute}

    cold = {"timings": [timing(1.0, 3.0), timing(None, 2.0)]}
    warm = {"timings": [timing(0.5, 2.5)]}
    assert summed([cold, warm]) == [timing(1.5, 5.5), timing(None, 4.5)]
    assert summed([warm, warm]) == [timing(1.0, 5.0)]
