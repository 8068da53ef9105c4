"""A study's cells as one flat table, for pandas, polars or a spreadsheet."""

import csv
import io
import json
from collections import defaultdict

from whitted import files
from whitted.errors import UsageError

SUFFIXES = (".parquet", ".csv")
CELL = (
    "SELECT key, role, scenes.label AS scene, methods.label AS method, sampler, methods.effects AS effects, integrator,"
    " spp, replicate, seed, variant, width, height, scenes.hash AS scene_hash, image_hash, same_bits, picture,"
    " finished, environment, cells.versions AS versions FROM cells JOIN scenes ON scenes.id = cells.scene"
    " JOIN methods ON methods.id = cells.method WHERE status = 'done' AND wanted = 1"
    " ORDER BY role, scenes.label, methods.label, spp, replicate"
)
SECONDS = ("load", "trace", "compile", "execute", "total")


def flat(store):
    """Return a dict for each finished cell of a `whitted.studies.store.Store`.

    Beside the columns of ``cells`` there are ``seconds_*`` of the warm and ``cold_seconds_*`` of the cold render, None
    where they don't count; each metric by its name, and ``METRIC_reference_part``; and the machine's ``cpu``.
    """
    timings, errors = defaultdict(dict), defaultdict(dict)
    for row in store.query("SELECT * FROM timings"):
        prefix = "seconds_" if row["warm"] else "cold_seconds_"
        timings[row["cell"]] |= {prefix + name: row[name] for name in SECONDS} | {"threads": row["threads"]}
    sql = "SELECT errors.* FROM errors JOIN reference_pictures ON id = reference WHERE wanted = 1"
    for row in store.query(sql):
        errors[row["cell"]][row["metric"]] = row["value"]
        errors[row["cell"]][row["metric"] + "_reference_part"] = row["reference_part"]
    machines = {row["id"]: row for row in store.query("SELECT id, host, cpu FROM environments")}
    cells = store.query(CELL)
    times = [prefix + name for prefix in ("seconds_", "cold_seconds_") for name in SECONDS]
    names = ["threads", *times, *sorted({name for found in errors.values() for name in found})]
    empty = dict.fromkeys(names)
    found = []
    for cell in cells:
        machine = machines.get(cell["environment"], {"host": None, "cpu": None})
        facts = {"host": machine["host"], "cpu": machine["cpu"]}
        found.append(cell | facts | empty | timings[cell["key"]] | errors[cell["key"]])
    return found


def check(path):
    """Find out whether `write` would work, before the hours of work whose result it takes.

    Raises:
        UsageError: the suffix is none of ``SUFFIXES``, the folder is missing, or a package is.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"cannot export to {path}: its name must end in {' or '.join(SUFFIXES)}")
    files.check_writable(path)
    if path.suffix.lower() == ".parquet":
        _pyarrow()


def write(path, rows):
    """Write rows as Parquet or CSV, by the suffix of the path; lists and dicts in them as JSON.

    Raises:
        UsageError: the file can't be written.
    """
    check(path)
    rows = [{name: _plain(value) for name, value in row.items()} for row in rows]
    files.write(path, _parquet(rows) if path.suffix.lower() == ".parquet" else _csv(rows))


def _csv(rows):
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _parquet(rows):
    pyarrow, parquet = _pyarrow()
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.Table.from_pylist(rows), sink)
    return sink.getvalue().to_pybytes()


def _pyarrow():
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise UsageError(
            "Parquet needs the package pyarrow: pip install 'whitted[parquet]', or export to .csv"
        ) from error
    return pyarrow, parquet


def _plain(value):
    return json.dumps(value) if isinstance(value, (list, dict)) else value
