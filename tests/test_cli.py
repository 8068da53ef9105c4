"""Every mistake on the command line ends with exit code 2 and one line on standard error."""

import sys
from types import SimpleNamespace

import click
import pytest
from commands import refused

from whitted import cli
from whitted.cli import doctor, options
from whitted.errors import BackendError
from whitted.scene import load, shipped, shipped_path


@pytest.fixture
def run(capfd, monkeypatch):
    """Run the command line in this process, with a subcommand ``probe`` that has all shared options."""

    @click.command("probe")
    @options.scene
    @options.variant
    @options.sensor
    @options.defines
    @options.output(".exr")
    @options.threads
    @options.verbose
    @click.option("--raise", "error")
    def probe(scene, sensor, defines, output, error):
        if error:
            raise {"bug": ValueError("a\nb"), "llvm": BackendError("no LLVM"), "stop": KeyboardInterrupt()}[
                error
            ]
        loaded = load(scene, **defines)
        options.check_sensor(loaded, sensor)
        print(loaded.name, sensor, defines, output)
        return 3

    monkeypatch.setitem(cli.SUBCOMMANDS, "probe", "All shared options.")
    monkeypatch.setitem(sys.modules, "whitted.cli.probe", SimpleNamespace(command=probe))

    def run(*arguments):
        with pytest.raises(SystemExit) as done:
            cli.main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return done.value.code, out, err

    return run


SCENE = next(iter(shipped()))

MISTAKES = {
    "rendr": ["no such subcommand 'rendr'", "'render'"],
    "--vrsion": ["--vrsion", "--version"],
    "probe": ["SCENE"],
    f"probe {SCENE} extra": ["extra"],
    f"probe {SCENE} --outptu a.exr": ["--outptu", "--output"],
    f"probe {SCENE}x": [f"'{SCENE}x'", f"'{SCENE}'"],
    "probe none.xml": ["none.xml: no such file"],
    f"probe {SCENE} -m llvm_ad_rbg": ["'llvm_ad_rbg'", "'llvm_ad_rgb'"],
    f"probe {SCENE} -m scalar_rgb": ["'scalar_rgb'", "cannot run"],
    f"probe {SCENE} -s -1": ["-s", "-1", "x>=0"],
    f"probe {SCENE} -s one": ["-s", "'one'", "integer"],
    f"probe {SCENE} -s 4": ["-s", "4", "one sensor, 0"],
    f"probe {SCENE} -t 0": ["-t", "0"],
    f"probe {SCENE} -D width": ["-D", "'width'", "key=value"],
    f"probe {SCENE} -D widht=3": ["-D widht", "'width'"],
    f"probe {SCENE} -D width=nan": ["width", "nan"],
    f"probe {SCENE} -o none/a.exr": ["-o", "'none'", "does not exist"],
    f"probe {SCENE} -o /": ["-o", "'/'", "folder"],
    f"probe {SCENE} -o a.jpg": ["-o", "'a.jpg'", ".exr"],
    f"scenes {SCENE}x": [f"'{SCENE}x'", f"'{SCENE}'"],
    "scenes a b": ["b"],
    "doctor a": ["a"],
}


@pytest.mark.parametrize(("line", "words"), MISTAKES.items(), ids=MISTAKES)
def test_mistakes_exit_with_2_and_one_line(run, line, words):
    refused(run(*line.split()), *words)


def test_options_reach_the_command(run, tmp_path):
    code, out, err = run(
        "probe",
        SCENE,
        "-s",
        0,
        "-D",
        "width=4",
        "-D",
        "height=2",
        "-o",
        tmp_path / "a.exr",
        "-t",
        1,
        "-m",
        "llvm_ad_rgb",
    )
    assert (code, err) == (3, "")
    assert out == f"{SCENE} 0 {{'width': '4', 'height': '2'}} {tmp_path}/a.exr\n"


def test_other_errors_are_one_line_too(run):
    assert run("probe", "x", "--raise", "bug")[::2] == (
        70,
        "whitted: internal error: ValueError: a b (-v shows where)\n",
    )
    assert run("probe", "x", "--raise", "llvm")[::2] == (1, "whitted: error: no LLVM\n")
    code, _, err = run("probe", "x", "--raise", "stop")
    assert code == 130
    assert err.endswith("whitted: interrupted\n")
    code, _, err = run("probe", "x", "--raise", "bug", "-v")
    assert code == 70
    assert "Traceback" in err


@pytest.mark.parametrize("integrator", ["distribution", "whitted", "path"])
def test_what_mitsuba_complains_of_while_rendering_is_a_mistake_of_the_scene(run, tmp_path, integrator):
    """A mesh without texture coordinates cannot shine through a texture, which Mitsuba says inside of the loop."""
    (tmp_path / "light.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 -1\n1 0 -1\n0 1 -1\n3 0 1 2\n"
    )
    path = tmp_path / "light.xml"
    path.write_text(
        f'<scene version="3.0.0"><integrator type="{integrator}"/><sensor type="perspective"/>'
        '<shape type="rectangle"><transform name="to_world"><translate z="2"/></transform></shape>'
        '<shape type="ply"><string name="filename" value="light.ply"/><emitter type="area">'
        '<texture name="radiance" type="checkerboard"/></emitter></shape></scene>'
    )
    refused(run("render", path, "-o", tmp_path / "a.exr"), "Mesh", "UV coordinates")


def test_mitsuba_logs_to_standard_error(run, tmp_path):
    path = tmp_path / "stretched.xml"
    path.write_text(
        '<scene version="3.0.0"><sensor type="perspective"/><shape type="sphere"><transform name="to_world">'
        '<scale x="2"/></transform></shape></scene>'
    )
    code, out, err = run("probe", path)
    assert code == 3
    assert out.startswith("stretched 0")
    assert out.count("\n") == 1
    assert err.startswith("whitted: warn: [Sphere]")
    assert err.count("\n") == 1


def test_help_and_version(run):
    import whitted

    assert run("--version") == (0, f"whitted {whitted.__version__}\n", "")
    for arguments in ((), ("--help",)):
        code, out, err = run(*arguments)
        assert (code, err) == (0, "")
        for name in cli.SUBCOMMANDS:
            assert f"\n  {name}" in out


def test_scenes_are_listed_and_printed(run):
    code, out, err = run("scenes")
    assert (code, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines()] == list(shipped())
    assert run("scenes", SCENE) == (0, shipped_path(SCENE).read_text(), "")


def test_the_doctor_finds_this_machine_well(run):
    code, out, err = run("doctor")
    assert (code, err) == (0, "")
    for label in ("python", "mitsuba", "drjit", "LLVM", "variants", "kernel cache"):
        assert f"\n{label} " in f"\n{out}"
    assert "llvm_ad_rgb: passed" in out


def test_the_doctor_reports_a_crash_and_what_to_do(monkeypatch, run):
    monkeypatch.setattr(doctor, "_code", lambda variant: "import os; os.abort()")
    code, out, _ = run("doctor")
    assert code == 1
    assert "crashed with SIGABRT" in out
    assert "to do: the self-test" in out


def test_the_doctor_examines_a_machine_without_llvm(python):
    script = "from whitted.cli import main; main(['doctor'])"
    done = python(script, DRJIT_LIBLLVM_PATH="/nonexistent")
    assert done.returncode == 1
    assert done.stderr == ""
    assert "to do: DRJIT_LIBLLVM_PATH=/nonexistent does not exist" in done.stdout


def test_the_command_without_llvm_ends_in_one_line(python):
    script = f"from whitted.cli import main; main(['render', '{SCENE}'])"
    done = python(script, DRJIT_LIBLLVM_PATH="/nonexistent")
    assert done.returncode == 1
    assert done.stderr.startswith("whitted: error: DRJIT_LIBLLVM_PATH=/nonexistent does not exist")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [["--help"], ["scenes"]])
def test_start_up_imports_only_what_is_needed(python, arguments):
    script = (
        "import sys\nfrom whitted.cli import main\ntry: main(sys.argv[1:])\nexcept SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    loaded = set(python(script, *arguments).stderr.split())
    assert not loaded & {
        "numpy",
        "scipy",
        "OpenEXR",
        "colour",
        "rich",
        "whitted.passes",
        "whitted.cli.render",
    }
