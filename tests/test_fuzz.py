"""Scenes mutated at random: the command ends each in a picture or in one line. ``make fuzz`` does more of them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import fuzz
import pytest
from fuzz_mutations import mutant
from fuzz_scenes import scenes
from whitted_scenes import films

COUNT = 200


def test_each_mutant_ends_in_a_picture_or_in_one_line(tmp_path):
    options = f"--first 0 --count {COUNT} --quick --keep {tmp_path}".split()
    command = [sys.executable, fuzz.__file__, *options]
    # its folder by name, since Python's safe path leaves a script's own folder out
    environment = os.environ | {"PYTHONPATH": str(Path(fuzz.__file__).parent)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.stderr == ""
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("\n") == 1
    assert done.stdout.startswith("seeds 0 to ")


@pytest.fixture(scope="module")
def texts():
    return scenes()


def test_a_seed_makes_the_same_mutant_each_time(texts):
    first, again = (mutant(17, texts) for _ in range(2))
    assert first == again
    assert first.changes
    assert first != mutant(18, texts)


def test_each_mutation_comes_up(texts):
    changes = " ".join(change for seed in range(300) for change in mutant(seed, texts).changes)
    for word in (
        " became 'nan'",
        "'-0'",
        "dropped",
        "doubled",
        "put into",
        "lost",
        "swapped",
        "refers to 'none'",
    ):
        assert word in changes


def test_the_scenes_have_all_filters(texts):
    for name in films():
        assert any(f'<rfilter type="{name}"' in text for text in texts.values())


ENDINGS = [
    (0, "", "picture"),
    (4, "whitted: 3 samples weren't finite and are left out\n", "picture"),
    (2, "whitted: warn: [Sphere] odd\nwhitted: error: a.xml:3: wrong\n", "error"),
    (2, "", "not one line"),
    (2, "whitted: error: a\nb\n", "not one line"),
    (2, "whitted: error: a\nwhitted: error: b\n", "not one line"),
    (0, "jit_free(): unknown address\n", "not one line"),
    (2, "whitted: error: sphere.cpp:33: wrong\n", "a place in the code"),
    (70, "whitted: internal error: KeyError: a\n", "exit 70"),
    (-signal.SIGABRT, "", "abort (SIGABRT)"),
    (fuzz.NOT_FINITE, "", "picture that isn't finite"),
]


@pytest.mark.parametrize(("code", "text", "kind"), ENDINGS)
def test_endings_are_told_apart(code, text, kind):
    assert fuzz.judge(code, text) == kind


def test_what_does_not_end_is_killed():
    with subprocess.Popen(["sleep", "100"]) as child:
        assert fuzz.wait(child.pid, 0.1) is None
        child.returncode = 0  # it is gone
    with subprocess.Popen(["false"]) as child:
        assert fuzz.wait(child.pid, 10) == 1 << 8
        child.returncode = 1
