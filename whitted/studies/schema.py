"""The tables of a study's database, column by column: they are made, checked and documented from this one place.

A person who queries the database reads `describe`, the text of ``docs/store.md``.
"""

VERSION = 1  # ``PRAGMA user_version``; a store of a higher one is refused

# table: (what a row is, {column: (type and constraints, meaning)})
TABLES = {
    "runs": (
        "One call of `whitted study` on this folder.",
        {
            "id": ("INTEGER PRIMARY KEY", "number"),
            "specification": ("TEXT NOT NULL", "the study, JSON, sizes resolved"),
            "digest": ("TEXT NOT NULL", "of the specification; equal studies have equal ones"),
            "started": ("TEXT NOT NULL", "UTC, ISO 8601"),
            "ended": ("TEXT", "UTC; NULL while it runs, or if it was killed"),
            "outcome": (
                "TEXT",
                "`done`, `stopped` (by a signal or its time), `failed` (cells were left); or NULL",
            ),
        },
    ),
    "environments": (
        "A machine with its software, as a worker has found it.",
        {
            "id": ("TEXT PRIMARY KEY", "digest of the rest"),
            "host": ("TEXT NOT NULL", "the machine's name"),
            "cpu": ("TEXT NOT NULL", "model of the processor"),
            "features": ("TEXT NOT NULL", "vector features of the processor, in a row"),
            "cores": ("INTEGER NOT NULL", "that the process may use"),
            "memory": ("INTEGER NOT NULL", "bytes"),
            "system": ("TEXT NOT NULL", "operating system"),
            "versions": ("TEXT NOT NULL", "JSON: of whitted, mitsuba, drjit, numpy, python, llvm"),
            "probe": (
                "TEXT NOT NULL",
                "hash of a small fixed picture: where it is equal, pictures have equal bits",
            ),
        },
    ),
    "scenes": (
        "A scene at a size.",
        {
            "id": ("TEXT PRIMARY KEY", "digest of hash, sensor and size"),
            "label": ("TEXT NOT NULL", "as the study calls it"),
            "hash": (
                "TEXT NOT NULL",
                "SHA-256 of the XML, its includes, parameters and the files it refers to",
            ),
            "path": ("TEXT NOT NULL", "where it was, or the name of a shipped scene"),
            "define": ("TEXT NOT NULL", "JSON: parameters that were set"),
            "sensor": ("INTEGER NOT NULL", "the sensor's number"),
            "width": ("INTEGER NOT NULL", "pixels"),
            "height": ("INTEGER NOT NULL", "pixels"),
        },
    ),
    "methods": (
        "An integrator with a sampler or effects, on a scene.",
        {
            "id": ("TEXT PRIMARY KEY", "digest of scene, integrator, sampler and effects"),
            "scene": ("TEXT NOT NULL REFERENCES scenes", "its scene"),
            "label": ("TEXT NOT NULL", "as the study calls it"),
            "integrator": ("TEXT NOT NULL", "JSON: as for `mi.load_dict`, with nothing left to decide"),
            "sampler": ("TEXT", "of Mitsuba; NULL where the integrator has sequences of its own"),
            "effects": ("TEXT", "as asked for; NULL where there is no choice"),
            "simulated": ("TEXT NOT NULL", "JSON: the effects simulated, where the integrator tells"),
            "plan_seconds": ("REAL", "what deciding all that took; NULL where nothing was to be decided"),
        },
    ),
    "cells": (
        "One render: of the study (`cell`), or of what errors are taken against (`reference`).",
        {
            "key": ("TEXT PRIMARY KEY", "digest of scene, method, samples, seed, variant and versions"),
            "role": ("TEXT NOT NULL", "`cell` or `reference`"),
            "scene": ("TEXT NOT NULL REFERENCES scenes", "its scene"),
            "method": ("TEXT NOT NULL REFERENCES methods", "its method"),
            "spp": ("INTEGER NOT NULL", "samples per pixel"),
            "replicate": ("INTEGER NOT NULL", "its number; replicates differ in their seed alone"),
            "seed": ("INTEGER NOT NULL", "32 bits"),
            "variant": ("TEXT NOT NULL", "of Mitsuba"),
            "versions": ("TEXT NOT NULL", "JSON: of whitted, mitsuba and drjit, which the key depends on"),
            "wanted": ("INTEGER NOT NULL", "1 if the last run's study has it, 0 if only an earlier one"),
            "status": ("TEXT NOT NULL", "`planned`, `done` or `failed`"),
            "message": ("TEXT", "why it failed"),
            "environment": ("TEXT REFERENCES environments", "where it was rendered; NULL if in several"),
            "picture": ("TEXT", "path of the EXR file within the folder"),
            "image_hash": ("TEXT", "SHA-256 of the pixels: float32, row by row, R, G, B"),
            "same_bits": (
                "INTEGER",
                "0 if a second render, here or in a merged store, gave other bits; else 1",
            ),
            "finished": ("TEXT", "UTC, ISO 8601"),
        },
    ),
    "timings": (
        "The seconds of a cell that ran alone on its machine.",
        {
            "cell": ("TEXT NOT NULL REFERENCES cells", "its cell"),
            "warm": (
                "INTEGER NOT NULL",
                "0 where kernels were compiled or loaded from disk, 1 where they were there",
            ),
            "environment": ("TEXT NOT NULL REFERENCES environments", "the machine"),
            "threads": ("INTEGER NOT NULL", "of Dr.Jit"),
            "load": ("REAL", "loading the scene; about 0 where the process had it; NULL in a second render"),
            "trace": ("REAL NOT NULL", "building kernels in Python"),
            "compile": ("REAL NOT NULL", "compiling kernels"),
            "execute": ("REAL NOT NULL", "running kernels"),
            "total": ("REAL NOT NULL", "wall, loading left out"),
            "compiled": ("INTEGER NOT NULL", "kernels compiled"),
            "from_disk": ("INTEGER NOT NULL", "kernels loaded from Dr.Jit's cache"),
        },
    ),
    "reference_pictures": (
        "What errors of a scene are taken against: the mean of its reference cells.",
        {
            "id": ("TEXT PRIMARY KEY", "digest of the cells' keys"),
            "scene": ("TEXT NOT NULL REFERENCES scenes", "its scene"),
            "method": ("TEXT NOT NULL REFERENCES methods", "its method"),
            "spp": ("INTEGER NOT NULL", "samples per pixel of each cell"),
            "replicates": ("INTEGER NOT NULL", "number of cells"),
            "variance": (
                "REAL NOT NULL",
                "of a pixel's value, mean over pixels and channels: its own error, squared",
            ),
            "mean": ("REAL NOT NULL", "of all pixels and channels"),
            "picture": ("TEXT NOT NULL", "path of the EXR file, with its standard error"),
            "wanted": ("INTEGER NOT NULL", "1 if the last run's study has it"),
        },
    ),
    "errors": (
        "An error of a cell against a reference picture.",
        {
            "cell": ("TEXT NOT NULL REFERENCES cells", "its cell"),
            "reference": ("TEXT NOT NULL REFERENCES reference_pictures", "the picture compared with"),
            "metric": ("TEXT NOT NULL", "name, see `whitted.stats.metrics`"),
            "value": ("REAL NOT NULL", "as computed"),
            "reference_part": (
                "REAL",
                "what the reference's own noise adds to it, to be subtracted; NULL: not known",
            ),
        },
    ),
    "shares": (
        "The share of the variance that the draws for one effect cause, for the whole picture.",
        {
            "method": ("TEXT NOT NULL REFERENCES methods", "its method"),
            "effect": (
                "TEXT NOT NULL",
                "`pixel`, `lens`, `time`, `light`, `gloss`, `hemisphere`, `branch`, ...",
            ),
            "spp": ("INTEGER NOT NULL", "samples per pixel of an evaluation"),
            "evaluations": ("INTEGER NOT NULL", "pairs of renders that it was measured with"),
            "total": (
                "REAL NOT NULL",
                "total-order index; the ends of its 95 % interval are NULL where the data give none",
            ),
            "total_low": ("REAL", "lower end"),
            "total_high": ("REAL", "upper end"),
            "first": ("REAL NOT NULL", "first-order index, likewise"),
            "first_low": ("REAL", "lower end"),
            "first_high": ("REAL", "upper end"),
            "picture": ("TEXT NOT NULL", "path of the EXR file with the shares of each pixel"),
        },
    ),
    "attempts": (
        "One try at a cell, kept whatever came of it.",
        {
            "id": ("INTEGER PRIMARY KEY", "number"),
            "cell": ("TEXT NOT NULL REFERENCES cells", "its cell"),
            "run": ("INTEGER NOT NULL REFERENCES runs", "the call of `whitted study`"),
            "worker": ("TEXT NOT NULL", "which one"),
            "started": ("TEXT NOT NULL", "UTC, ISO 8601"),
            "ended": ("TEXT", "UTC; NULL if the coordinator was killed"),
            "outcome": ("TEXT", "`done`, `failed`, `lost` (the worker died), `stopped`, or NULL"),
            "message": ("TEXT", "why"),
        },
    ),
}
UNIQUE = {
    "timings": "cell, warm",
    "errors": "cell, reference, metric",
    "shares": "method, effect, spp",
}
INDEXED = {"cells": "scene, method, spp", "attempts": "cell"}


def statements():
    """Return the SQL statements that make the tables."""
    made = []
    for table, (_, columns) in TABLES.items():
        fields = [f'"{name}" {kind}' for name, (kind, _) in columns.items()]
        fields += [f"UNIQUE ({UNIQUE[table]})"] if table in UNIQUE else []
        made.append(f"CREATE TABLE {table} (\n  " + ",\n  ".join(fields) + "\n)")
    return made + [f"CREATE INDEX {table}_by ON {table} ({columns})" for table, columns in INDEXED.items()]


def describe():
    """Return the tables as Markdown, the text of ``docs/store.md``."""
    lines = [
        "# The tables of a study's database",
        "",
        f"`study.db` in a study's folder, version {VERSION} (`PRAGMA user_version`). [studies.md](studies.md) has an"
        " example of a query. Times of day are UTC, durations seconds.",
    ]
    for table, (meaning, columns) in TABLES.items():
        lines += ["", f"## `{table}`", "", meaning, "", "| column | type | meaning |", "|---|---|---|"]
        for name, (kind, text) in columns.items():
            kind, _, other = kind.partition(" REFERENCES ")
            link = f" ([`{other}`](#{other}))" if other else ""
            lines.append(f"| `{name}` | {kind.replace(' NOT NULL', '')} | {text}{link} |")
        if table in UNIQUE:
            lines += ["", f"One row for each {UNIQUE[table]}."]
    return "\n".join(lines) + "\n"
