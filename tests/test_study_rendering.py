"""What workers render: parts that make up the whole bit for bit, whoever does them; and slopes as theory has them."""

import pytest
from studies import TOY

from whitted.errors import UsageError
from whitted.stats.convergence import slope
from whitted.studies import cells as cells_module
from whitted.studies import rendering
from whitted.studies.analysis import ladders
from whitted.studies.cells import Cell
from whitted.studies.finishing import assembled, finished
from whitted.studies.specification import SceneEntry
from whitted.studies.store import Store
from whitted.studies.study import study

CHOICES = [
    {"integrator": spec, "label": spec, "samplers": ("independent",), "effects": ("auto",), "spp": (1, 12)}
    for spec in ("distribution:max_depth=3", "whitted", "path:max_depth=3")
]


@pytest.fixture(scope="module")
def described():
    return rendering.describe("llvm_ad_rgb", SceneEntry(scene="soft_shadows"), (20, 14), CHOICES)


def cell_of(described, number, spp=12, timed=False):
    scene, methods, versions = described
    return Cell("cell", scene, methods[number][0], spp, 0, 1234, "llvm_ad_rgb", versions, timed)


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("size", [20 * 12 * 4, 20 * 4 * 5])
def test_parts_are_the_same_bits_in_any_order(described, number, size, monkeypatch):
    monkeypatch.setattr(cells_module, "PART", size)
    cell = cell_of(described, number)
    parts = cell.parts
    assert len(parts) >= 4
    forwards = {part: rendering.render(cell, part) for part in parts}
    rendering._load.cache_clear()  # as in another process
    backwards = {part: rendering.render(cell, part) for part in reversed(parts)}
    assert finished(cell, forwards, None, ()).image_hash == finished(cell, backwards, None, ()).image_hash


@pytest.mark.parametrize("number", [0, 1])
def test_windows_of_our_integrators_are_the_whole(described, number, monkeypatch):
    cell = cell_of(described, number)
    whole = assembled(cell, {cell.whole: rendering.render(cell, cell.whole)})
    monkeypatch.setattr(cells_module, "PART", 20 * 12 * 4)
    parts = assembled(cell, {part: rendering.render(cell, part) for part in cell.parts})
    assert (parts == whole).all()


def test_a_render_tells_cold_from_warm_and_has_the_same_bits(described):
    found = rendering.render(cell_of(described, 2, spp=1, timed=True), cell_of(described, 2, spp=1).whole)
    again = rendering.render(cell_of(described, 2, spp=1, timed=True), cell_of(described, 2, spp=1).whole)
    assert found["same_bits"]
    assert [bool(timing["compiled"] + timing["from_disk"]) for timing in again["timings"]] == [False]
    assert len(found["timings"]) in (1, 2)


def test_the_pictures_are_those_of_the_integrators(described):
    """One and the other within noise, and within much less than the picture is bright."""
    means = [
        assembled(cell, {cell.whole: rendering.render(cell, cell.whole)}).mean()
        for cell in (cell_of(described, n) for n in (0, 2))
    ]
    assert means[0] == pytest.approx(means[1], rel=0.03)


def test_a_sampler_that_rounds_tells_what_it_takes():
    choice = CHOICES[2] | {"samplers": ("orthogonal", "multijitter"), "spp": (1, 10)}
    _, (methods,), _ = rendering.describe("llvm_ad_rgb", SceneEntry(scene="soft_shadows"), (8, 8), [choice])
    assert [method.accepted for method in methods] == [{1: 4, 10: 25}, {1: 1, 10: 12}]


@pytest.mark.parametrize(
    ("entry", "size", "words"),
    [
        (SceneEntry(scene="soft_shadows", sensor=3), (8, 8), "no sensor 3; it has 1"),
        (SceneEntry(scene="soft_shadow"), (8, 8), "did you mean 'soft_shadows'"),
        (SceneEntry(scene="soft_shadows", define={"sp": 3}), (8, 8), "sp"),
    ],
)
def test_a_wrong_scene_is_one_line(entry, size, words):
    with pytest.raises(UsageError, match=words):
        rendering.describe("llvm_ad_rgb", entry, size, CHOICES[:1])


def test_independent_samples_have_slope_a_half_and_low_discrepancy_points_a_steeper_one(tmp_path):
    spec = TOY | {"scenes": "interreflection", "integrators": ["path:max_depth=3"], "spp": [4, 16, 64, 256]}
    spec |= {"replicates": 16, "timed": 0, "width": 24, "metrics": ["mse"]}
    spec |= {
        "reference": {"integrator": "path:max_depth=3", "sampler": "owen_sobol", "spp": 4096, "replicates": 4}
    }

    found = study(spec, tmp_path / "slopes")
    with Store(found.folder) as store:
        (scene,) = ladders(store).values()
    slopes = {
        name.split(", ")[1]: slope(of.spp, of.errors, of.variance).interval for name, of in scene.items()
    }
    assert slopes["independent"].holds(-0.5), slopes
    assert slopes["owen_sobol"].high < -0.55, slopes
