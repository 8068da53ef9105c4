"""`whitted plan` and `whitted render --effects`: what they print, write and refuse.

The verdict of --verify has a fixed seed; it would be another for 1 % of the seeds.
"""

import json

import pytest
from commands import refused

import whitted
from whitted import cli, effects, image
from whitted.scene import shipped

SMALL = ["-D", "width=12", "-D", "height=12"]
KEYS = {"effect", "called_for", "evidence", "dimensions", "bound"}


@pytest.fixture
def run(capfd, tmp_path, monkeypatch):
    """Run the command line in this process, in an empty folder; return its exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as done:
            cli.main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return done.value.code or 0, out, err

    return run


def assert_schema(facts):
    assert {"scene", "effects", "kernel"} <= facts.keys()
    assert [one["effect"] for one in facts["effects"]] == list(effects.NAMES)
    for one in facts["effects"]:
        assert one.keys() >= KEYS
        assert isinstance(one["called_for"], bool)
        assert one["evidence"]
        assert one["dimensions"] == (effects.DIMENSIONS[one["effect"]] if one["called_for"] else 0)
        assert one["bound"] is None or one["bound"].keys() == {"radiance", "relative"}
        assert ("operations" in one) == ("share_of_time" in one) == one["called_for"]
    assert facts["kernel"]["operations"] > 0


# ---- plan


def test_json_verified(run):
    code, out, _ = run("plan", "hard_shadows", *SMALL, "--json", "--verify")
    assert code == 0
    facts = json.loads(out)
    assert_schema(facts)
    assert facts["scene"] == "hard_shadows"
    verdict = facts["verify"]
    assert verdict["verdict"] == "agree"
    ours, everything = verdict["integrators"]
    called = [one["effect"] for one in facts["effects"] if one["called_for"]]
    assert f"effects={'+'.join(called)}," in ours
    assert f"effects={'+'.join(effects.NAMES)}," in everything


def test_text(run):
    code, out, _ = run("plan", "hard_shadows", *SMALL, "--integrator", "distribution:max_depth=2")
    assert code == 0
    rows = [line.split() for line in out.splitlines()]
    assert rows[0][0] == "hard_shadows:"
    called = {row[0]: row[1] for row in rows[2:]}
    assert list(called) == list(effects.NAMES)
    assert called["antialiasing"] == "yes"
    assert called["soft_shadows"] == called["interreflection"] == "no"


WRONG = {
    "plan hard_shadow": ["'hard_shadow'", "'hard_shadows'"],
    "plan none.xml": ["none.xml: no such file"],
    "plan hard_shadows -s 3": ["-s", "3"],
    "plan hard_shadows --integrator path": ["effects can't be chosen", "distribution"],
    "plan hard_shadows --integrator distribution:effects=glos": ["'glos'", "'gloss'"],
    "plan hard_shadows --integrator distribution:tree_depth=99": ["tree_depth", "99", "0 to 64"],
    "plan hard_shadows --effects all": ["--effects"],
    "render hard_shadows --integrator distribution --effects glos": ["'glos'", "'gloss'"],
    "render hard_shadows --integrator whitted --effects all": ["effects can't be chosen", "distribution"],
    "render hard_shadows --integrator path --effects auto": ["effects can't be chosen", "distribution"],
}


@pytest.mark.parametrize(("line", "words"), WRONG.items(), ids=WRONG)
def test_mistakes_exit_with_2_and_one_line(run, tmp_path, line, words):
    refused(run(*line.split()), *words)
    assert not list(tmp_path.iterdir())


# ---- render --effects


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        (None, ["antialiasing"]),
        ("auto", ["antialiasing"]),
        ("all", list(effects.NAMES)),
        ("gloss, antialiasing", ["antialiasing", "gloss"]),
        ("interreflection", ["interreflection"]),
    ],
)
def test_the_effects_of_a_render_are_written_down(run, tmp_path, wanted, expected):
    choice = [] if wanted is None else ["--effects", wanted]
    made = [
        "--integrator",
        "distribution:max_depth=2",
        *choice,
        "--spp",
        2,
        "--stats",
        "a.json",
        "-o",
        "a.exr",
    ]
    code, _, err = run("render", "hard_shadows", *SMALL, *made)
    assert code == 0, err
    facts = json.loads((tmp_path / "a.json").read_text())
    assert facts["effects"] == expected
    assert [one["effect"] for one in facts["plan"]] == list(effects.NAMES)
    assert [one["effect"] for one in facts["plan"] if one["called_for"]] == expected
    header = image.read(tmp_path / "a.exr").header
    assert header["effects"] == ",".join(expected)
    assert json.loads(header["plan"]) == facts["plan"]
    assert header["directLight"] == facts["techniques"]["direct_light"] == "both"
    assert header["closedForm"] == ""


# ---- Shipped scenes


@pytest.mark.parametrize("name", sorted(set(effects.NAMES) & set(shipped())))
def test_a_shipped_scene_calls_for_what_it_is_named_after(name):
    scene = whitted.load(name, width=32, height=32)
    found = whitted.plan(scene, "distribution", costs=False)
    assert found.scene == name
    assert {"antialiasing", name} <= set(found.effects)


def test_a_scene_of_point_lights_calls_for_no_soft_shadows():
    scene = whitted.load("hard_shadows", width=32, height=32)
    assert "soft_shadows" not in whitted.plan(scene, costs=False)
