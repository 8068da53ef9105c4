"""A study that takes seconds, and what tests ask of its store."""

import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing, suppress
from pathlib import Path

TOY = {
    "title": "toy",
    "scenes": [{"scene": "soft_shadows", "name": "toy"}],
    "integrators": ["distribution:max_depth=2", "path:max_depth=2"],
    "samplers": ["independent", "owen_sobol"],
    "spp": [1, 4],
    "replicates": 3,
    "width": 16,
    "metrics": ["mse", "rel_mse"],
    "reference": {"integrator": "path:max_depth=2", "spp": 64, "replicates": 3},
}
CELLS = 3 + 3 * 2 * 3  # of the reference, and of three methods at two steps of the ladder


def rows(folder, sql, *values):
    """Return the rows of a query on a store, tuples, read by SQLite alone."""
    with closing(sqlite3.connect(f"file:{folder}/study.db?mode=ro", uri=True)) as database:
        return database.execute(sql, values).fetchall()


def contents(folder):
    """Return what a study has found that doesn't depend on time and place."""
    return {
        "cells": rows(folder, "SELECT key, status, image_hash, same_bits FROM cells ORDER BY key"),
        "errors": rows(folder, "SELECT cell, reference, metric, value FROM errors ORDER BY 1, 2, 3"),
        "references": rows(folder, "SELECT id, variance, mean FROM reference_pictures ORDER BY 1"),
    }


def rendered_twice(folder):
    """Return the keys of cells with an attempt that began after they were done."""
    return rows(
        folder,
        "SELECT cell FROM attempts JOIN cells ON key = cell"
        " WHERE attempts.started > cells.finished OR (SELECT count(*) FROM attempts AS other"
        " WHERE other.cell = key AND other.outcome = 'done') > 1",
    )


def toml(folder, **changes):
    """Write the toy study, with changes, as a TOML file; return its path."""
    path = Path(folder) / "toy.toml"
    lines, tables = [], []
    for key, value in (TOY | changes).items():
        if isinstance(value, dict):
            tables += [f"[{key}]", *(f"{k} = {_value(v)}" for k, v in value.items())]
        else:
            lines.append(f"{key} = {_value(value)}")
    path.write_text("\n".join(lines + tables) + "\n")
    return path


def command(*arguments, **options):
    """Start ``whitted`` in a process of its own; return its ``Popen``, with its output as text."""
    line = [sys.executable, "-c", "from whitted.cli import main; main()", *map(str, arguments)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def finished(*arguments, **options):
    """Run ``whitted`` to its end; return exit status, standard output and standard error."""
    process = command(*arguments, **options)
    out, err = process.communicate(timeout=300)
    return process.returncode, out, err


def wait_for_pictures(folder, process, count=1):
    """Wait until a study that a process renders has a number of pictures, or the process has ended."""
    while process.poll() is None:
        with suppress(FileNotFoundError):
            if sum(name.endswith(".exr") for name in os.listdir(folder / "pictures")) >= count:
                return
        time.sleep(0.02)


def copied(folder):
    """Return the path of a copy of a study's folder, in a new folder."""
    target = Path(tempfile.mkdtemp(dir=Path(folder).parent)) / "copy"
    shutil.copytree(folder, target)
    return target


def _value(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)
