"""``whitted trace``: what it passes on, prints, writes and refuses."""

import json
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import pytest

import whitted
from whitted import cli

SCENE = """<scene version="3.0.0">
    <integrator type="whitted"/>
    <sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/></film>
    </sensor>
    <shape type="sphere" id="ball"/>
</scene>"""
NODE = {
    "id": 0,
    "parent": None,
    "kind": "eye",
    "depth": 0,
    "origin": [0, 0, 0],
    "direction": [0, 0, 1],
    "distance": None,
    "position": None,
    "shape": None,
    "bsdf": None,
    "throughput": [1.0] * 3,
    "emitted": [0.5] * 3,
    "direct": [0.0] * 3,
    "contribution": [0.5] * 3,
    "dropped": None,
    "shadow": [],
}


@pytest.fixture
def trace(tmp_path, monkeypatch, capfd):
    """Return a function that runs the command; it gives the exit code, both outputs and the calls made."""
    (tmp_path / "scene.xml").write_text(SCENE)
    calls = []

    def fake(scene, pixel, **options):
        calls.append((pixel, options))
        tree = SimpleNamespace(pixel=pixel, radiance=[0.5] * 3, nodes=[NODE])
        tree.to_dict = lambda: {"pixel": list(pixel), "nodes": tree.nodes}
        return tree

    monkeypatch.setitem(vars(whitted), "trace", fake)

    def run(*arguments):
        with pytest.raises(SystemExit) as stopped:
            cli.main(["trace", str(tmp_path / "scene.xml"), *arguments])
        return stopped.value.code, *capfd.readouterr(), calls

    return run


def test_text(trace):
    code, out, err, calls = trace("--pixel", "7,5", "--seed", "3", "--integrator", "whitted:max_depth=3")
    assert (code, err) == (0, "")
    assert out.splitlines()[1].split() == ["E", "1", "escaped", "0.5"]
    ((pixel, options),) = calls
    assert pixel == (7, 5)
    assert options["seed"] == 3
    assert type(options["integrator"]).__name__ == "WhittedIntegrator"


def test_json_and_drawing(trace, tmp_path):
    code, out, _, _ = trace("--pixel", "0, 0", "--json", "-o", str(tmp_path / "tree.svg"))
    assert code == 0
    assert json.loads(out)["nodes"] == [NODE]
    assert ET.parse(tmp_path / "tree.svg").getroot().tag.endswith("svg")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "--pixel"),
        (("--pixel", "1"), "'1' is not of the form X,Y"),
        (("--pixel", "1.5,2"), "X,Y"),
        (("--pixel", "8,0"), "8,0 is outside the film: X is 0 to 7, Y is 0 to 5"),
        (("--pixel", "0,6"), "outside the film"),
        (("--pixel", "-1,0"), "outside the film"),
        (("--pixel", "0,0", "-o", "no/such/folder/a.svg"), "no/such/folder"),
        (("--pixel", "0,0", "-o", "a.png"), ".svg"),
        (("--pixel", "0,0", "-s", "1"), "one sensor"),
        (("--pixel", "0,0", "--integrator", "witted"), "whitted"),
    ],
)
def test_usage_errors(trace, arguments, complaint):
    code, out, err, calls = trace(*arguments)
    assert (code, out) == (2, "")
    assert complaint in err
    assert err.count("\n") == 1
    assert calls == []
