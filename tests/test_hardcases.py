"""The hard cases: each holds its tolerance, none of the catalogue is left out, and a wrong form is found out."""

import dataclasses
import functools
import itertools
import json
import math
import re
from pathlib import Path

import pytest
from commands import refused

import whitted
from whitted import cli
from whitted.errors import UsageError
from whitted.hardcases.case import FAMILIES, Case, Errors
from whitted.hardcases.families import LATER, chosen, families
from whitted.scene import shipped_path

ROOT = Path(__file__).parents[1]
CATALOGUE = {str(number) for number in range(1, 89)} | {f"R{number}" for number in range(1, 14)}
CASES = {case.name: case for case in chosen()}


@functools.cache
def result_of(name):
    return CASES[name].run()


def broken_by_textbook(name):
    return result_of(name).holds() and result_of(name).holds("textbook") is False


@pytest.mark.parametrize("name", CASES)
def test_every_case_holds(name):
    result = result_of(name)
    assert result.holds(), result.worst("ours")


# ---- The catalogue


def test_no_case_of_the_catalogue_is_left_out():
    covered = {number.strip() for case in CASES.values() for number in case.number.split(",")}
    later = {number for numbers in LATER.values() for number in numbers}
    assert covered | later >= CATALOGUE, sorted(CATALOGUE - covered - later)
    assert covered <= CATALOGUE
    assert not covered & later


def test_no_name_is_taken_by_two_cases():
    assert len(CASES) == sum(map(len, families().values()))


def test_every_case_names_its_source():
    """It is a key of the bibliography, or says in words what the truth was derived from."""
    keys = set(
        re.findall(r"^@\w+\{(\w+),", (ROOT / "references.bib").read_text(encoding="utf-8"), re.MULTILINE)
    )
    for case in CASES.values():
        is_key = re.fullmatch(r"\w*\d{4}\w*", case.source)
        assert case.source in keys if is_key else case.source.strip(), f"{case.name}: {case.source}"


def test_every_case_says_what_it_asks_and_why_so_well():
    for case in CASES.values():
        assert case.asks.strip(), case.name
        assert case.why.strip(), case.name
        assert bool(case.parameter) == bool(case.values), case.name


# ---- What they are worth


def test_textbook_forms_miss_tolerances_that_ours_hold():
    found = list(itertools.islice(filter(broken_by_textbook, CASES), 25))
    assert len(found) == 25


@pytest.mark.parametrize("name", ["far_sphere", "variance_far_below_the_mean"])
def test_a_wrong_form_is_found_out(name):
    case = CASES[name]
    mutant = dataclasses.replace(case, measure=lambda value: Errors(ours=case.measure(value).textbook))
    assert case.run().holds()
    assert not mutant.run().holds()


# ---- How errors are judged


def made(measure, tolerance=1.0, values=()):
    parameter = "x" if values else ""
    return Case("made", "0", "made", "nothing", "", parameter, values, tolerance, "", "", measure)


@pytest.mark.parametrize("error", [1.5, -1.5, [0.0, 2.0], math.nan, [0.0, math.nan], math.inf])
def test_errors_beyond_the_tolerance_break_a_case(error):
    assert not made(lambda: Errors(ours=error)).run().holds()


@pytest.mark.parametrize("error", [1.0, -1.0, [0.5, -1.0], [], True, 0])
def test_errors_within_the_tolerance_do_not(error):
    assert made(lambda: Errors(ours=error)).run().holds()


def test_the_worst_point_is_the_worst_against_its_tolerance():
    found = made(lambda x: Errors(ours=x, textbook=2 * x), lambda x: x**2, (1.0, 0.5, 4.0)).run()
    assert [found.worst(form).value for form in ("ours", "textbook")] == [0.5, 0.5]
    assert (found.worst("reference"), found.holds("reference")) == (None, None)
    assert not found.holds()


# ---- The command


@pytest.fixture
def run(capfd):
    """Run the command line in this process."""

    def run(*arguments):
        with pytest.raises(SystemExit) as done:
            cli.main(["stability", *map(str, arguments)])
        out, err = capfd.readouterr()
        return done.value.code, out, err

    return run


def test_json_has_every_number_of_a_case(run):
    code, out, err = run("--only", "footprint_of_a_pixel", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    (case,) = found["cases"]
    assert case.keys() >= {"number", "unit", "parameter", "points", "source", "why"}
    assert (case["case"], case["family"], case["holds"]) == ("footprint_of_a_pixel", "camera", True)
    assert 0 < case["error"] <= case["tolerance"] < case["reference_error"] < case["textbook_error"]
    assert found["holds"]
    assert found["regime"]["offset_at_1000"] > found["regime"]["offset_at_0"] > 0
    assert set(found["later"]) == set(LATER)


def test_a_family_is_shown_as_a_table(run):
    code, out, err = run("--only", "statistics")
    assert (code, err) == (0, "")
    for name in families()["statistics"]:
        assert name[:20] in out
    assert f"{len(families()['statistics'])} of {len(families()['statistics'])} cases hold" in out


def test_a_broken_case_ends_in_1(run, monkeypatch):
    monkeypatch.setitem(FAMILIES, "made", {"made": made(lambda: Errors(ours=math.inf))})
    code, out, _ = run("--only", "made", "--json")
    assert code == 1
    assert (json.loads(out)["cases"][0]["error"], json.loads(out)["holds"]) == ("inf", False)
    code, out, _ = run("--only", "made")
    assert code == 1
    assert "broken" in out
    assert "0 of 1 cases hold" in out


def test_unknown_cases_and_folders_are_refused(run, tmp_path):
    refused(run("--only", "far_spher"), "'far_spher'", "'far_sphere'")
    refused(run("--only", "nonsense"), "'nonsense'")
    refused(run("--only", "far_sphere", "--plot", tmp_path / "none"), "--plot", "no such folder")


def test_a_family_is_plotted(run, tmp_path):
    pytest.importorskip("matplotlib")
    code, _, err = run("--only", "variance_far_below_the_mean", "--plot", tmp_path)
    (path,) = tmp_path.iterdir()
    assert (code, path.name) == (0, "statistics.png")
    assert str(path) in err
    assert path.read_bytes()[:4] == b"\x89PNG"


def test_from_python():
    found = whitted.stability("variance_far_below_the_mean")
    assert found.holds
    assert [result.case.name for result in found.broken_by_textbook] == ["variance_far_below_the_mean"]
    assert "variance_far_below_the_mean" in found._repr_html_()


# ---- What the cases led to


def test_a_lens_that_is_focused_before_the_near_plane_is_refused_with_its_file(tmp_path):
    text = Path(shipped_path("depth_of_field")).read_text(encoding="utf-8")
    name, value = re.search(r'name="focus_distance" value="([^"]*)"', text)[0], '"0.001"'
    path = tmp_path / "lens.xml"
    path.write_text(text.replace(name, re.sub(r'value="[^"]*"', f"value={value}", name)), encoding="utf-8")
    with pytest.raises(
        UsageError, match=r"lens\.xml: focus_distance is 0\.001; accepted are near_clip, 0\.01"
    ):
        whitted.load(path)
