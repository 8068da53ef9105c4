"""Put two stores together: cells rendered on several machines, or at several times."""

import os
import shutil

from whitted.errors import UsageError


def merge(store, other):
    """Take over what another store has and this one lacks.

    A cell that both have done with different bits is marked in ``same_bits``; ours stays.

    Args:
        store: `Store` that is open for writing.
        other: `Store`.
    """
    ours = {row["key"]: row for row in store.query("SELECT * FROM cells")}
    theirs = other.query("SELECT * FROM cells")
    for row in [r for r in theirs if r["picture"]] + other.query(
        "SELECT picture FROM reference_pictures UNION SELECT picture FROM shares"
    ):
        target = store.folder / row["picture"]
        if not target.exists():
            _copy(other.folder / row["picture"], target)
    with store.transaction():
        for table in ("environments", "scenes", "methods"):
            for row in other.query(f"SELECT * FROM {table}"):
                store.insert(table, row, "OR IGNORE")
        for row in theirs:
            _merge_cell(store, ours.get(row["key"]), row)
        numbers = {
            row["id"]: store.insert("runs", _without_id(row)).lastrowid
            for row in other.query("SELECT * FROM runs")
        }
        for row in other.query("SELECT * FROM attempts"):
            store.insert("attempts", _without_id(row) | {"run": numbers[row["run"]]})
        for table in ("timings", "reference_pictures", "errors", "shares"):
            for row in other.query(f"SELECT * FROM {table}"):
                store.insert(table, row, "OR IGNORE")


def _merge_cell(store, ours, theirs):
    """Take over a cell that the other store has done and this one hasn't; compare those that both have."""
    if ours is None:
        store.insert("cells", theirs | {"wanted": 0})
    elif theirs["status"] == "done" and ours["status"] != "done":
        kept = ("status", "message", "environment", "picture", "image_hash", "same_bits", "finished")
        store.update("cells", theirs["key"], "key", **{name: theirs[name] for name in kept})
    elif theirs["status"] == "done" and theirs["image_hash"] != ours["image_hash"]:
        store.update("cells", theirs["key"], "key", same_bits=0)


def _without_id(row):
    return {name: value for name, value in row.items() if name != "id"}


def _copy(source, target):
    """Copy a picture, whole or not at all."""
    temporary = target.with_suffix(".part")
    try:
        shutil.copyfile(source, temporary)
        os.replace(temporary, target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise UsageError(f"cannot copy {source} to {target}: {error.strerror.lower()}") from error
