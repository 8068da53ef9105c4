"""A study ends with the same keys, pictures and errors however often it was stopped, and renders nothing twice."""

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from studies import (
    CELLS,
    TOY,
    command,
    contents,
    copied,
    finished,
    rendered_twice,
    rows,
    toml,
    wait_for_pictures,
)

from whitted import image
from whitted.errors import UsageError
from whitted.studies import store as store_module
from whitted.studies.merging import merge
from whitted.studies.store import Store
from whitted.studies.study import Study, study


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A toy study that ran through."""
    folder = tmp_path_factory.mktemp("studies") / "whole"
    return study(TOY, folder)


def test_every_cell_is_done_once(whole):
    assert whole.count() == {"planned": 0, "done": CELLS, "failed": 0}
    assert whole.outcome.outcome == "done"
    assert not rendered_twice(whole.folder)
    assert rows(whole.folder, "SELECT DISTINCT outcome FROM attempts") == [("done",)]
    assert rows(whole.folder, "SELECT outcome FROM runs") == [("done",)]


def test_errors_are_those_of_the_pictures_against_the_mean_of_the_references(whole):
    pictures = [
        p for (p,) in rows(whole.folder, "SELECT picture FROM cells WHERE role = 'reference' ORDER BY key")
    ]
    pixels = np.stack([image.read(whole.folder / path).rgb for path in pictures]).astype(float)
    found = rows(whole.folder, "SELECT variance, mean, picture FROM reference_pictures")
    variance, mean, path = found[0]
    assert variance == pytest.approx(pixels.var(0, ddof=1).mean() / 3, rel=1e-5)
    assert mean == pytest.approx(pixels.mean(), rel=1e-6)
    stderr = image.read(whole.folder / path).stderr
    np.testing.assert_allclose(stderr, pixels.std(0, ddof=1) / np.sqrt(3), rtol=1e-4, atol=1e-9)
    key, value, part = rows(
        whole.folder, "SELECT cell, value, reference_part FROM errors WHERE metric = 'mse' LIMIT 1"
    )[0]
    cell = image.read(whole.folder / f"pictures/{key}.exr").rgb
    assert value == pytest.approx(np.mean((cell - pixels.mean(0)) ** 2), rel=1e-5)
    assert part == pytest.approx(variance, rel=1e-5)


def test_seconds_are_told_apart_cold_and_warm(whole):
    found = rows(
        whole.folder, "SELECT cell, warm, trace, compile, execute, total, compiled, from_disk FROM timings"
    )
    warm = [row for row in found if row[1]]
    assert {row[0] for row in warm} == set(cell_keys(whole.folder))
    assert all(row[3] == 0 and row[6] == 0 and row[7] == 0 for row in warm)
    assert all(row[6] + row[7] > 0 for row in found if not row[1])
    assert all(0 < row[4] < row[5] and row[2] + row[3] + row[4] <= row[5] * 1.001 for row in found)
    environments = rows(whole.folder, "SELECT cores, probe FROM environments")
    assert len(environments) == 1
    assert environments[0][0] >= 1


def cell_keys(folder):
    return [key for (key,) in rows(folder, "SELECT key FROM cells WHERE role = 'cell'")]


def test_again_there_is_nothing_to_do(whole):
    folder = copied(whole.folder)
    again = study(TOY, folder)
    assert (again.outcome.now, again.outcome.before) == (0, CELLS)
    assert contents(folder) == contents(whole.folder)


def test_more_replicates_and_steps_are_added_to_what_is_there(whole):
    folder = copied(whole.folder)
    more = study(TOY | {"replicates": 4, "spp": [1, 4, 9], "metrics": ["mse", "smape"]}, folder)
    assert (more.outcome.before, more.outcome.wanted) == (CELLS, 3 + 3 * 3 * 4)
    assert not rendered_twice(folder)
    count = rows(folder, "SELECT metric, count(*) FROM errors GROUP BY metric")
    assert dict(count) == {"mse": 36, "smape": 36, "rel_mse": 18}


def test_without_timed_cells_no_seconds_are_kept_and_the_bits_are_the_same(whole, tmp_path):
    beside = study(TOY | {"timed": 0, "replicates": 40}, tmp_path / "beside", workers=2)
    assert not rows(beside.folder, "SELECT * FROM timings")
    assert set(contents(whole.folder)["cells"]) < set(contents(beside.folder)["cells"])
    assert len(rows(beside.folder, "SELECT DISTINCT worker FROM attempts")) == 2


def test_some_are_timed_alone_and_the_others_run_beside(tmp_path):
    found = study(TOY | {"timed": 2}, tmp_path / "some", workers=2)
    timed = rows(found.folder, "SELECT DISTINCT replicate FROM cells JOIN timings ON cell = key ORDER BY 1")
    assert timed == [(0,), (1,)]
    spans = rows(
        found.folder,
        "SELECT started, ended, key IN (SELECT cell FROM timings) FROM attempts JOIN cells ON key = cell ORDER BY 1",
    )
    alone = [(a, b) for a, b, is_timed in spans if is_timed]
    assert not [(a, s) for a, b in alone for s, e, _ in spans if (s, e) != (a, b) and s < b and e > a]


def test_noise_shares_of_our_own_methods_are_measured_once(tmp_path):
    spec = TOY | {"shares": 8, "effects": ["auto", "all"]}
    found = study(spec, tmp_path / "shares")
    shares = rows(
        found.folder, "SELECT label, effect, total, picture FROM shares JOIN methods ON id = method"
    )
    assert {label for label, *_ in shares} == {
        f"distribution:max_depth=2, effects {e}" for e in ("auto", "all")
    }
    assert {effect for _, effect, *_ in shares} >= {"pixel", "light"}
    picture = image.read(found.folder / shares[0][3])
    assert f"share.{shares[0][1]}.Y" in picture.channels
    assert "noiseShares" in picture.header
    before = {path: path.stat().st_mtime_ns for path in found.folder.glob("pictures/shares-*")}
    study(spec, found.folder)
    assert before == {path: path.stat().st_mtime_ns for path in found.folder.glob("pictures/shares-*")}


def test_time_ends_it_and_the_same_call_goes_on(tmp_path, whole):
    folder = tmp_path / "short"
    short = study(TOY, folder, time=1e-3)
    assert short.outcome.outcome == "stopped"
    assert 0 < short.count()["planned"] <= CELLS
    study(TOY, folder)
    assert contents(folder) == contents(whole.folder)
    assert not rendered_twice(folder)


def killed(folder, spec, kills, seed):
    """Begin a study again and again, and kill it: at a random moment, or at one after it has done another cell.

    Returns:
        The number of cells done at each kill.
    """
    rng = random.Random(seed)
    done = [0]
    for number in range(kills):
        process = command("study", spec, "-o", folder)
        if number % 2:
            wait_for_pictures(folder, process, done[-1] + 1)
        time.sleep(rng.uniform(0, 1))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        if os.path.exists(folder / "study.db"):
            done.append(rows(folder, "SELECT count(*) FROM cells WHERE status = 'done'")[0][0])
    return done


@pytest.mark.parametrize(
    ("kills", "replicates"), [(4, 10), pytest.param(20, 80, marks=pytest.mark.long)], ids=["4", "20"]
)
def test_killed_at_random_it_ends_as_one_that_ran_through(tmp_path, kills, replicates):
    spec = toml(tmp_path, replicates=replicates)
    through, stopped = tmp_path / "through", tmp_path / "stopped"
    assert finished("study", spec, "-o", through)[0] == 0
    done = killed(stopped, spec, kills, seed=kills)
    code, _, err = finished("study", spec, "-o", stopped)
    assert code == 0, err
    assert contents(stopped) == contents(through)
    assert not rendered_twice(stopped)
    assert len(set(done)) > 1, f"no kill came in the middle: {done}"


@pytest.mark.parametrize("when", ["before the picture", "before the row", "before the commit"])
def test_a_write_that_is_cut_off_loses_its_cell_alone(whole, when, tmp_path, monkeypatch):
    folder = tmp_path / "cut"
    count = [0]

    class Power(BaseException):
        pass

    def cut(original, *arguments, **keywords):
        count[0] += 1
        if count[0] == 9:
            raise Power
        return original(*arguments, **keywords)

    finish = Store.finish
    targets = {
        "before the picture": (store_module.files, "write"),
        "before the row": (Store, "transaction"),
        "before the commit": (Store, "update"),
    }
    place, name = targets[when]
    original = getattr(place, name)

    def finishing(self, *arguments, **keywords):
        with monkeypatch.context() as patch:
            patch.setattr(place, name, lambda *a, **k: cut(original, *a, **k))
            return finish(self, *arguments, **keywords)

    monkeypatch.setattr(Store, "finish", finishing)
    with pytest.raises(Power):
        study(TOY, folder)
    monkeypatch.undo()
    study(TOY, folder)
    assert contents(folder) == contents(whole.folder)
    assert not rendered_twice(folder)


def test_a_signal_ends_it_after_the_cell_at_hand(tmp_path):
    spec = toml(tmp_path, replicates=60)
    process = command("study", spec, "-o", tmp_path / "s")
    wait_for_pictures(tmp_path / "s", process, 3)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 3
    assert "the same command goes on" in err
    assert rows(tmp_path / "s", "SELECT DISTINCT outcome FROM attempts") == [("done",)]
    assert rows(tmp_path / "s", "SELECT outcome FROM runs") == [("stopped",)]


def test_two_halves_merge_into_the_whole(tmp_path, whole):
    one = study(TOY | {"replicates": 2}, tmp_path / "one")
    two = study(TOY | {"spp": [4], "integrators": ["path:max_depth=2"]}, tmp_path / "two")
    with Store(two.folder) as source, Store(one.folder, write=True) as target:
        merge(target, source)
    merged = study(TOY, one.folder)
    assert merged.outcome.now == CELLS - (3 + 6 * 2) - 2
    assert contents(one.folder) == contents(whole.folder)
    assert all((one.folder / path).is_file() for (path,) in rows(one.folder, "SELECT picture FROM cells"))
    assert rows(one.folder, "SELECT min(same_bits) FROM cells") == [(1,)]


def test_a_merge_tells_where_the_bits_differ(tmp_path, whole):
    ours, theirs = copied(whole.folder), copied(whole.folder)
    key = cell_keys(ours)[0]
    with Store(theirs, write=True) as other, other.transaction():
        other.update("cells", key, "key", image_hash="0" * 64)
    with Store(theirs) as source, Store(ours, write=True) as target:
        merge(target, source)
    assert rows(ours, "SELECT key FROM cells WHERE same_bits = 0") == [(key,)]


def test_one_at_a_time(whole):
    with Store(whole.folder, write=True), pytest.raises(UsageError, match="another process is at work"):
        Store(whole.folder, write=True)
    Study(whole.folder)  # any number may read


def test_it_shows_itself(whole):
    shown = whole._repr_html_()
    assert all(
        text in shown for text in ("toy", f"{CELLS} cells done", "path:max_depth=2, owen_sobol", "<td>4</td>")
    )
    assert whole.to_dict()["count"]["done"] == CELLS
    assert whole.specification["replicates"] == 3


def test_a_script_needs_no_main_guard(tmp_path, whole):
    script = tmp_path / "script.py"
    script.write_text(f"import whitted\nprint('once')\nprint(whitted.study({TOY!r}, 'study').count())\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"once\n{whole.count()}\n"
    assert contents(tmp_path / "study") == contents(whole.folder)
