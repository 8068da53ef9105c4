"""``whitted study``: what it prints, what it refuses in one line, and what it keeps when things go wrong."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from commands import refused
from studies import CELLS, TOY, command, contents, copied, finished, rows, toml, wait_for_pictures

from whitted.studies import schema
from whitted.studies.store import Store
from whitted.studies.study import study


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("command")
    spec = toml(folder)
    found = finished("study", spec, "-o", folder / "whole", "--export", folder / "cells.csv")
    return spec, folder / "whole", found


def test_it_says_what_it_did(whole):
    _, folder, (code, out, err) = whole
    assert (code, err) == (0, "")
    assert out == f"{folder}: {CELLS} of {CELLS} cells done, {CELLS} of them now\n"


def test_the_same_command_goes_on(whole):
    spec, folder, _ = whole
    assert finished("study", spec, "-o", folder)[:2] == (
        0,
        f"{folder}: {CELLS} of {CELLS} cells done, 0 of them now\n",
    )


def test_a_table_of_the_cells_is_exported(whole):
    import csv

    spec, folder, _ = whole
    with open(folder.parent / "cells.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == CELLS
    cells = [row for row in table if row["role"] == "cell"]
    assert all(float(row["mse"]) > 0 and float(row["seconds_execute"]) > 0 for row in cells)
    assert {row["method"] for row in cells} == {
        "distribution:max_depth=2",
        "path:max_depth=2, independent",
        "path:max_depth=2, owen_sobol",
    }
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    assert finished("study", spec, "-o", folder, "--export", folder.parent / "cells.parquet")[0] == 0
    found = parquet.read_table(folder.parent / "cells.parquet").to_pylist()
    assert [row["key"] for row in found] == [row["key"] for row in table]
    assert json.loads(found[0]["integrator"])["type"]
    assert found[0]["mse"] == pytest.approx(float(table[0]["mse"]))


REFUSED = {
    "no such study": (["sampelrs"], {}, "did you mean 'samplers'"),
    "unknown metric": (None, {"metrics": ["rmsee"]}, "did you mean", "rmse"),
    "impossible time": (None, {"time": -3.0}, "time", "greater than 0"),
    "unknown scene": (None, {"scenes": ["glas"]}, "did you mean 'glass'"),
    "unknown integrator": (None, {"integrators": ["paht"]}, "paht", "path"),
    "unknown property": (None, {"integrators": ["path:max_dept=2"]}, "max_dept"),
    "unknown sampler": (None, {"samplers": ["indepenent"]}, "did you mean 'independent'"),
    "unknown effect": (None, {"effects": ["glosss"]}, "did you mean 'gloss'"),
    "a reference that is none": (None, {"reference": TOY["reference"] | {"integrator": "pth"}}, "pth"),
    "the same scene twice": (None, {"scenes": ["glass", {"scene": "glass", "name": "g"}]}, "are the same"),
    "the same integrator twice": (
        None,
        {"integrators": ["path", {"integrator": "path", "name": "p"}]},
        "are the same",
    ),
    "an integrator without eye rays": (None, {"integrators": ["ptracer"]}, "does not follow eye rays"),
}


@pytest.mark.parametrize(
    ("spec", "changes", "words"), [(s, c, w) for s, c, *w in REFUSED.values()], ids=list(REFUSED)
)
def test_a_wrong_study_is_one_line(spec, changes, words, tmp_path):
    spec = spec or [toml(tmp_path, **changes)]
    refused(finished("study", *spec, "-o", tmp_path / "folder"), *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--time", "0"], ["--time"]),
        (["--time", "soon"], ["--time", "soon"]),
        (["--size", "huge"], ["--size", "small"]),
        (["--export", "cells.txt"], [".parquet or .csv"]),
        (["--export", "nowhere/cells.csv"], ["nowhere"]),
        (["--scheduler", "tcp://127.0.0.1:9"], ["no Dask scheduler answers"]),
        (["--merge", "nothing"], ["nothing", "no study lies there"]),
    ],
    ids=lambda value: value[0] if value[0].startswith("--") else "",
)
def test_a_wrong_option_is_one_line_and_keeps_what_is_there(whole, options, words, tmp_path):
    spec, folder, _ = whole
    before = contents(folder)
    refused(finished("study", spec, "-o", folder, *options, cwd=tmp_path), *words)
    assert contents(folder) == before


def test_a_wrong_folder_is_one_line(whole, tmp_path):
    spec, *_ = whole
    (tmp_path / "file").write_text("")
    refused(finished("study", spec, "-o", tmp_path / "a/b"), "does not exist")
    refused(finished("study", spec, "-o", tmp_path / "file"), "file")


def test_a_store_of_a_newer_version_is_left_alone(whole):
    spec, folder, _ = whole
    newer = copied(folder)
    with Store(newer, write=True) as store:
        store.database.execute(f"PRAGMA user_version = {schema.VERSION + 1}")
    before = contents(newer)
    refused(finished("study", spec, "-o", newer), f"version {schema.VERSION + 1}", f"up to {schema.VERSION}")
    assert contents(newer) == before


def test_a_damaged_store_is_told(whole):
    spec, folder, _ = whole
    damaged = copied(folder)
    for path in damaged.glob("study.db*"):
        path.write_bytes(b"no database at all" * 100)
    refused(finished("study", spec, "-o", damaged), "study.db")


def test_a_scene_that_changes_in_the_middle_fails_alone(tmp_path, monkeypatch):
    """The worker finds other bytes than those that the study was planned with."""
    from whitted import scene as scene_module
    from whitted.studies import study as study_module
    from whitted.studies.pools import LocalPool

    source = scene_module.shipped_path("soft_shadows").read_text() + "<!-- mine -->"
    (tmp_path / "mine.xml").write_text(source)
    spec = TOY | {"scenes": [{"scene": str(tmp_path / "mine.xml")}, "soft_shadows"]}

    class Meddling(LocalPool):
        def submit(self, to, function, threads, *arguments):
            if function.__name__ == "environment":
                (tmp_path / "mine.xml").write_text(source + "<!-- other -->")
                self.close()  # new processes load it anew
                self._executors.clear()
            return super().submit(to, function, threads, *arguments)

    monkeypatch.setattr(study_module, "LocalPool", Meddling)
    found = study(spec, tmp_path / "folder")
    assert found.outcome.outcome == "failed"
    assert found.count() == {"planned": 0, "done": CELLS, "failed": CELLS}
    assert {message for _, message in found.outcome.failures} == {
        "scene 'mine' has changed since the study began"
    }
    monkeypatch.undo()
    (tmp_path / "mine.xml").write_text(source)
    assert study(spec, tmp_path / "folder").count() == {"planned": 0, "done": 2 * CELLS, "failed": 0}


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 400 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("a file system can't be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_one_line_and_what_was_done_is_kept(whole, small_disk):
    spec, folder, _ = whole
    code, out, err = finished("study", spec, "-o", small_disk / "study")
    assert (code, out) == (2, "")
    assert err.startswith("whitted: error: ")
    assert err.count("\n") == 1
    assert "full" in err or "no space left" in err
    done = rows(small_disk / "study", "SELECT key, image_hash FROM cells WHERE status = 'done'")
    assert 0 < len(done) < CELLS
    assert set(done) < set(rows(folder, "SELECT key, image_hash FROM cells"))


def is_alive(pid):
    """Whether a process runs; one that is dead and not yet waited for has no command line."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes() != b""
    except OSError:
        return False


def test_the_workers_of_a_study_end_with_it(tmp_path):
    process = command("study", toml(tmp_path, replicates=200), "-o", tmp_path / "s")
    wait_for_pictures(tmp_path / "s", process)
    children = subprocess.run(
        ["pgrep", "-P", str(process.pid)], capture_output=True, text=True
    ).stdout.split()
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert children
    for _ in range(100):
        left = [pid for pid in children if is_alive(pid)]
        if not left:
            break
        time.sleep(0.05)
    assert not left
