"""The folder of a study: a SQLite database for the rows, EXR files for the pictures.

A picture is written and flushed before the row that speaks of it, and a cell's rows are one transaction: killed at any
point, a store has its finished cells whole and no others. Only one process at a time writes to a store; any number may
read. The tables are those of `whitted.studies.schema`. Source: [SQLite] for the write-ahead log.
"""

import fcntl
import json
import sqlite3
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from whitted import files, image
from whitted.errors import UsageError
from whitted.studies import rows, schema
from whitted.studies.cells import digest

DATABASE, LOCK, PICTURES = "study.db", "study.lock", "pictures"


class Store:
    """A study's folder.

    Args:
        folder: the path; with ``write`` it is made if its parent is there.
        write: whether to write; then the store is locked until ``close``.

    Raises:
        UsageError: there is no store, another process writes to it, it is damaged, or of a newer version.
    """

    def __init__(self, folder, write=False):
        self.folder, self._lock = Path(folder), None
        if write:
            self._prepare()
        elif not (self.folder / DATABASE).is_file():
            raise UsageError(f"{folder}: no study lies there; `whitted study` makes one")
        self.database = None
        try:
            with self._explained():
                self._open(write)
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def close(self):
        """Close the database, and unlock the folder."""
        for held in (self.database, self._lock):
            if held is not None:
                held.close()

    def query(self, sql, *values):
        """Return the rows of a query, a list of dicts."""
        with self._explained():
            return [dict(row) for row in self.database.execute(sql, values)]

    def begin(self, specification):
        """Note that a run begins; return its number. What an earlier run's study wanted isn't wanted any more."""
        text = json.dumps(specification, sort_keys=True)
        with self.transaction():
            self.database.execute("UPDATE cells SET wanted = 0")
            self.database.execute("UPDATE reference_pictures SET wanted = 0")
            run = {"specification": text, "digest": digest(specification), "started": _now()}
            return self.insert("runs", run).lastrowid

    def end(self, run, outcome):
        """Note that a run has ended: ``done``, ``stopped`` or ``failed``."""
        with self.transaction():
            sql = "UPDATE runs SET ended = ?, outcome = ? WHERE id = ?"
            self.database.execute(sql, (_now(), outcome, run))

    def add_environment(self, facts):
        """Note a machine, a dict of the columns but ``id``; return its ``id``."""
        identity = digest(facts)
        with self.transaction():
            self.insert("environments", {"id": identity} | facts, "OR IGNORE")
        return identity

    def plan(self, cells):
        """Note cells that are wanted, with their scenes and methods; those that are there stay as they are."""
        with self.transaction():
            for cell in cells:
                scene, method = rows.scene_row(cell.scene), rows.method_row(cell.scene, cell.method)
                self.insert("scenes", scene, "OR IGNORE")
                self.insert("methods", method, "OR IGNORE")
                self.insert("cells", rows.cell_row(cell, scene["id"], method["id"]), "OR IGNORE")
                # What things are called may have changed
                self.update("scenes", scene["id"], label=scene["label"], path=scene["path"])
                self.update("methods", method["id"], label=method["label"])
                self.update("cells", cell.key, "key", wanted=1)

    def done(self):
        """Return the keys of the cells that are done, a set."""
        return {row["key"] for row in self.query("SELECT key FROM cells WHERE status = 'done'")}

    def attempt(self, run, key, worker):
        """Note that a worker begins a cell; return the attempt's number."""
        with self.transaction():
            row = {"cell": key, "run": run, "worker": worker, "started": _now()}
            return self.insert("attempts", row).lastrowid

    def give_up(self, attempt, key, outcome, message):
        """Note that an attempt has failed: ``failed`` for good, or ``lost``."""
        with self.transaction():
            self.update("attempts", attempt, ended=_now(), outcome=outcome, message=message)
            if outcome == "failed":
                self.update("cells", key, "key", status="failed", message=message)

    def finish(self, attempt, cell, found, environment, threads):
        """Store a finished cell.

        Args:
            attempt: its number.
            cell: `whitted.studies.cells.Cell`.
            found: `whitted.studies.finishing.Finished`.
            environment: its ``id``, or None if there are several.
            threads: of Dr.Jit.
        """
        path = self._write_picture(cell.key, found.file)
        with self.transaction():
            for timing in found.timings:
                warm = int(not timing["compiled"] + timing["from_disk"])
                row = {
                    "cell": cell.key,
                    "warm": warm,
                    "environment": environment,
                    "threads": threads,
                } | timing
                self.insert("timings", row, "OR REPLACE")
            for row in found.errors:
                self.insert("errors", row, "OR REPLACE")
            self.update(
                "cells",
                cell.key,
                "key",
                status="done",
                message=None,
                environment=environment,
                picture=path,
                image_hash=found.image_hash,
                same_bits=int(found.same_bits),
                finished=_now(),
            )
            self.update("attempts", attempt, ended=_now(), outcome="done")

    def pixels(self, path):
        """Return the radiance in a picture of the folder, ``float32`` [H, W, C]."""
        found = image.read(self.folder / path)
        return found.rgb if "R" in found.channels else found.rgb[..., :1]

    def picture(self, path):
        """Return a picture of the folder, `whitted.image.Picture`."""
        return image.read(self.folder / path)

    def add_reference(self, cells):
        """Make the reference picture of finished reference cells, unless it is there; return its row."""
        keys = sorted(cell.key for cell in cells)
        identity = digest(keys)
        known = self.query("SELECT * FROM reference_pictures WHERE id = ?", identity)
        if not known:
            self._make_reference(identity, cells, keys)
        with self.transaction():
            self.update("reference_pictures", identity, wanted=1)
        return self.query("SELECT * FROM reference_pictures WHERE id = ?", identity)[0]

    def add_errors(self, errors):
        """Store errors, dicts of the columns."""
        with self.transaction():
            for row in errors:
                self.insert("errors", row, "OR REPLACE")

    def add_shares(self, method, shares, file):
        """Store the noise shares of a method, as `whitted.noise.Shares.to_dict` has them, and their EXR file."""
        path = self._write_picture(f"shares-{method}", file)
        with self.transaction():
            for effect, found in shares["effects"].items():
                row = {"method": method, "effect": effect, "picture": path}
                row |= {name: shares[name] for name in ("spp", "evaluations")}
                for kind in ("total", "first"):
                    interval = found[kind]
                    row |= {
                        kind: interval["value"],
                        f"{kind}_low": interval["low"],
                        f"{kind}_high": interval["high"],
                    }
                self.insert("shares", row, "OR REPLACE")

    @contextmanager
    def transaction(self):
        """Do several things, or none of them."""
        with self._explained():
            self.database.execute("BEGIN IMMEDIATE")
            try:
                yield
            except BaseException:
                self.database.execute("ROLLBACK")
                raise
            self.database.execute("COMMIT")

    def insert(self, table, row, conflict=""):
        """Insert a row, a dict, within a transaction; ``conflict`` is SQL's ``OR IGNORE`` or ``OR REPLACE``."""
        names = ", ".join(f'"{name}"' for name in row)
        places = ", ".join("?" * len(row))
        return self.database.execute(
            f"INSERT {conflict} INTO {table} ({names}) VALUES ({places})", list(row.values())
        )

    def update(self, table, identity, column="id", **values):
        """Set columns of the row with an identity, within a transaction."""
        assignments = ", ".join(f'"{name}" = ?' for name in values)
        sql = f"UPDATE {table} SET {assignments} WHERE {column} = ?"
        self.database.execute(sql, [*values.values(), identity])

    def _write_picture(self, name, data):
        """Write the bytes of a picture, whole or not at all; return its path within the folder."""
        path = f"{PICTURES}/{name}.exr"
        files.write(self.folder / path, data)
        return path

    def _make_reference(self, identity, cells, keys):
        places = ", ".join("?" * len(keys))
        found = self.query(f"SELECT picture FROM cells WHERE key IN ({places}) ORDER BY key", *keys)
        pictures = np.stack([self.pixels(row["picture"]) for row in found]).astype(np.float64)
        mean = pictures.mean(0)
        stderr = pictures.std(0, ddof=1) / np.sqrt(len(pictures))
        channels = image.layer_channels("", mean) | image.layer_channels("stderr", stderr)
        header = {"samplesPerPixel": cells[0].spp * len(cells), "integrator": cells[0].method.label}
        path = self._write_picture(f"reference-{identity}", image.encode_exr(image.Picture(channels, header)))
        row = {
            "id": identity,
            "scene": rows.scene_row(cells[0].scene)["id"],
            "method": rows.method_row(cells[0].scene, cells[0].method)["id"],
            "spp": cells[0].spp,
            "replicates": len(cells),
            "variance": float(np.mean(stderr**2)),
            "mean": float(mean.mean()),
            "picture": path,
            "wanted": 1,
        }
        with self.transaction():
            self.insert("reference_pictures", row, "OR REPLACE")

    def _prepare(self):
        """Make the folder where it is missing, and lock it."""
        if not self.folder.parent.is_dir():
            raise UsageError(f"cannot write {self.folder}: the folder {self.folder.parent} does not exist")
        try:
            (self.folder / PICTURES).mkdir(parents=True, exist_ok=True)
            self._lock = open(self.folder / LOCK, "a+")  # noqa: SIM115, open as long as the store
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise UsageError(f"{self.folder}: another process is at work on this study") from error
        except OSError as error:
            raise UsageError(f"cannot write {self.folder}: {error.strerror.lower()}") from error

    def _open(self, write):
        path = self.folder / DATABASE
        mode = "rwc" if write else "ro"
        self.database = sqlite3.connect(
            f"file:{_quoted(path)}?mode={mode}", uri=True, isolation_level=None, timeout=30
        )
        self.database.row_factory = sqlite3.Row
        version = self.database.execute("PRAGMA user_version").fetchone()[0]
        if version > schema.VERSION:
            raise UsageError(
                f"{path}: a store of version {version}; this whitted knows versions up to {schema.VERSION}"
            )
        if not write:
            return
        for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
            self.database.execute(f"PRAGMA {pragma}")
        if version == 0:
            with self.transaction():
                for statement in schema.statements():
                    self.database.execute(statement)
                self.database.execute(f"PRAGMA user_version = {schema.VERSION}")

    @contextmanager
    def _explained(self):
        """Tell in one line what SQLite complains of."""
        try:
            yield
        except sqlite3.Error as error:
            raise UsageError(f"{self.folder / DATABASE}: {error}") from error


def _quoted(path):
    from urllib.parse import quote

    return quote(str(path.absolute()))


def _now():
    return datetime.now(UTC).isoformat(timespec="milliseconds")
