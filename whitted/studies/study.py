"""A study as a user has it: run it, and ask what it has found."""

import html
import json
from contextlib import closing
from functools import cached_property
from pathlib import Path

from whitted import files
from whitted.interrupt import stop_on_signals
from whitted.studies import analysis, export, worker
from whitted.studies.coordinator import Coordinator
from whitted.studies.pools import LocalPool
from whitted.studies.specification import read
from whitted.studies.store import Store

CORES = 4  # of a local process where cells need not run alone: more speed up a small picture little


def study(spec, folder, *, size="small", scheduler=None, workers=None, time=None, progress=None):
    """Have a study's cells rendered, those that the folder lacks, and return the `Study`.

    SIGINT and SIGTERM end it after the cells at hand; called again, it goes on.

    Args:
        spec: path of a TOML file, the name of a shipped study, a dict, or a
            `whitted.studies.specification.Specification`.
        folder: where its database and pictures lie; it is made if its parent is there.
        size: ``small`` or ``paper``, which of the study's sizes.
        scheduler: address of a Dask scheduler, such as ``tcp://127.0.0.1:8786``, or a ``distributed.Client``; None
            renders in processes of this machine.
        workers: number of these processes; None: one for each four cores.
        time: seconds after which no further cell begins; None takes the study's.
        progress: is called with the numbers of cells done and wanted and the label of the last.

    Raises:
        UsageError: the study or a scene in it is wrong, or the folder can't be written; finished cells are kept.
        BackendError: there is no usable LLVM.
    """
    specification = read(spec, size)
    if time is not None:
        specification = type(specification).model_validate(specification.to_dict() | {"time": time})
    with (
        Store(folder, write=True) as store,
        closing(_pool(scheduler, workers)) as pool,
        stop_on_signals() as stopped,
    ):
        outcome = Coordinator(store, pool, specification, progress, stopped).run()
    return Study(folder, outcome)


class Study:
    """What lies in a study's folder.

    Args:
        folder: the path.
        outcome: `whitted.studies.coordinator.Outcome` of the run just ended, or None.

    Raises:
        UsageError: there is no study.
    """

    def __init__(self, folder, outcome=None):
        self.folder, self.outcome = Path(folder), outcome
        with Store(folder):
            pass

    @cached_property
    def specification(self):
        """The study of the last run, a dict."""
        with Store(self.folder) as store:
            rows = store.query("SELECT specification FROM runs ORDER BY id DESC LIMIT 1")
        return json.loads(rows[0]["specification"]) if rows else {}

    def rows(self):
        """Return a dict for each finished cell, see `whitted.studies.export.flat`."""
        with Store(self.folder) as store:
            return export.flat(store)

    def count(self):
        """Return how many cells are ``planned``, ``done`` and ``failed``, a dict."""
        with Store(self.folder) as store:
            sql = "SELECT status, count(*) AS number FROM cells WHERE wanted = 1 GROUP BY status"
            found = {row["status"]: row["number"] for row in store.query(sql)}
        return {status: found.get(status, 0) for status in ("planned", "done", "failed")}

    def to_dict(self):
        """Return what the study is, and its finished cells, for JSON."""
        return {"specification": self.specification, "count": self.count(), "cells": self.rows()}

    def write(self, path):
        """Write the finished cells as JSON, CSV or Parquet, by the path's suffix.

        Raises:
            UsageError: the file can't be written.
        """
        path = Path(path)
        if path.suffix.lower() == ".json":
            files.write(path, json.dumps(self.to_dict(), indent=2) + "\n")
        else:
            export.write(path, self.rows())

    def _repr_html_(self):
        """Show each method's error and seconds at the most samples."""
        count = self.count()
        title = html.escape(self.specification.get("title") or str(self.folder))
        head = f"<b>{title}</b><br>{count['done']} cells done, {count['planned']} to do, {count['failed']} failed"
        with Store(self.folder) as store:
            found = analysis.ladders(store)
        rows = [
            (
                scene,
                name,
                ladder.spp[-1],
                f"{max(ladder.errors[:, -1].mean(), 0) ** 0.5:.3g}",
                _seconds(ladder),
            )
            for scene, ladders in found.items()
            for name, ladder in ladders.items()
        ]
        cells = "".join(
            "<tr>" + "".join(f"<td>{html.escape(str(v))}</td>" for v in row) + "</tr>" for row in rows
        )
        names = "".join(f"<th>{name}</th>" for name in ("scene", "method", "spp", "RMSE", "seconds"))
        return f"{head}<table><tr>{names}</tr>{cells}</table>"


def _seconds(ladder):
    return "" if ladder.seconds is None else f"{ladder.curve.costs()[-1]:.3g}"


def _pool(scheduler, workers):
    if scheduler is None:
        return LocalPool(workers or max(worker.cores() // CORES, 1))
    from whitted.studies.cluster import DaskPool

    return DaskPool(scheduler)
