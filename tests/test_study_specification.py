"""A study's file is read as it is meant, and every mistake in it is one line that names the field."""

import pytest
from studies import TOY, toml

from whitted.errors import UsageError
from whitted.studies.specification import SIZES, Specification, read, shipped


def test_text_stands_for_an_entry_and_one_name_for_a_list():
    found = read(TOY | {"scenes": "glass", "integrators": "whitted", "samplers": "independent"})
    assert [scene.label for scene in found.scenes] == ["glass"]
    assert [entry.integrator for entry in found.integrators] == ["whitted"]
    assert found.samplers == ("independent",)


def test_a_size_is_laid_over_the_rest_table_by_table():
    spec = TOY | {"small": {"spp": [2], "reference": {"spp": 8}}, "paper": {"replicates": 9}}
    small, paper = (read(spec, size) for size in SIZES)
    assert (small.spp, small.replicates, small.reference.spp) == ((2,), 3, 8)
    assert small.reference.integrator == TOY["reference"]["integrator"]
    assert (paper.spp, paper.replicates, paper.reference.spp) == ((1, 4), 9, 64)


def test_a_scene_is_sought_beside_the_file(tmp_path):
    (tmp_path / "mine.xml").write_text("<scene/>")
    found = read(toml(tmp_path, scenes=["mine.xml", "glass"]))
    assert [scene.scene for scene in found.scenes] == [str(tmp_path / "mine.xml"), "glass"]


def test_a_dict_makes_an_equal_study():
    found = read(TOY)
    assert Specification.model_validate(found.to_dict()) == found


@pytest.mark.parametrize("name", sorted(shipped()))
@pytest.mark.parametrize("size", SIZES)
def test_shipped_studies_are_whole(name, size):
    found = read(name, size)
    assert found.title
    assert found.description
    assert found.replicates >= 8
    assert found.reference.spp * found.reference.replicates > 10 * max(found.spp)


def test_there_are_the_studies_that_are_promised():
    assert set(shipped()) == {"soft_shadows", "gloss", "depth_of_field", "whitted_vs_path", "samplers"}


MISTAKES = {
    "unknown metric": ({"metrics": ["mse", "relmse"]}, "relmse", "rel_mse"),
    "unknown field": ({"replicate": 4}, "replicate", "did you mean 'replicates'"),
    "unknown field of a table": ({"reference": TOY["reference"] | {"ssp": 1}}, "reference.ssp"),
    "missing reference": ({"reference": None}, "reference"),
    "no spp": ({"spp": []}, "spp"),
    "spp 0": ({"spp": [0]}, "spp.0", "greater than or equal to 1", "not 0"),
    "spp of text": ({"spp": ["many"]}, "spp.0"),
    "spp twice": ({"spp": [4, 4]}, "spp: 4 is there twice"),
    "one replicate": ({"replicates": 1}, "replicates"),
    "too many timed": ({"timed": 4}, "timed is 4, more than the 3"),
    "negative time": ({"time": -1.0}, "time", "greater than 0"),
    "time of text": ({"time": "an hour"}, "time"),
    "time that is no number": ({"time": float("nan")}, "time"),
    "no integrator": ({"integrators": []}, "integrators"),
    "the same integrator twice": ({"integrators": ["path", "path"]}, "'path' is there twice"),
    "width": ({"width": 0}, "width"),
    "a table for a size that is none": ({"small": 3}, "small: a table is needed"),
    "variant": ({"variant": "scalar_rgb"}, "variant"),
}


@pytest.mark.parametrize(("changes", "words"), [(c, w) for c, *w in MISTAKES.values()], ids=list(MISTAKES))
def test_a_mistake_is_one_line(changes, words):
    spec = {key: value for key, value in (TOY | changes).items() if value is not None}
    with pytest.raises(UsageError) as caught:
        read(spec)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_what_is_no_study_is_told(tmp_path):
    (tmp_path / "broken.toml").write_text("spp = [1,,]")
    for spec, words in (
        (tmp_path / "none.toml", "no such file"),
        (tmp_path, "a folder"),
        ("sampelrs", "did you mean 'samplers'"),
        (tmp_path / "broken.toml", "broken.toml"),
    ):
        with pytest.raises(UsageError, match=words):
            read(spec)
    with pytest.raises(UsageError, match="small and paper"):
        read(TOY, "large")
