"""Has a study's cells rendered: which worker does what and when, and what becomes of the results.

A cell whose seconds count has its machine to itself: it begins when nothing else runs there, and nothing begins
beside it. All of them run on machines of one kind. References come first, then timed cells, then the others. What a
lost worker had is done by another. The coordinator alone writes to the store, between cells, and never while a cell is
timed on its own machine. Left out: more than one cell at a time for each worker.
"""

import json
import time as clock
from collections import Counter, defaultdict
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass

from whitted.errors import UsageError
from whitted.studies import rendering, rows, worker
from whitted.studies.cells import REFERENCE
from whitted.studies.finishing import Reference, errors_of, finished
from whitted.studies.matrix import matrix_of
from whitted.studies.pools import WorkerLostError
from whitted.studies.queue import Queue, Task

TRIES = 3  # at a cell whose worker dies
POLL = 0.5  # seconds between looks at workers and signals
KIND = ("cpu", "features", "cores")  # machines with equal ones are of one kind


@dataclass(frozen=True)
class Outcome:
    """How a run ended: ``done``, ``stopped`` or ``failed``; the cells wanted, done before and done now.

    ``failures`` are pairs of a cell and why it failed.
    """

    outcome: str
    wanted: int
    before: int
    now: int
    failures: tuple
    notes: tuple


class Coordinator:
    """One run of a study.

    Args:
        store: `whitted.studies.store.Store`, open for writing.
        pool: see `whitted.studies.pools`.
        specification: `whitted.studies.specification.Specification`.
        report: is called with the numbers of cells done and wanted, and the label of the last; or None.
        stopped: tells whether to begin nothing more.
    """

    def __init__(self, store, pool, specification, report=None, stopped=lambda: False):
        self.store, self.pool, self.spec = store, pool, specification
        self.report, self.stopped = report or (lambda *_: None), stopped
        self.machines = {}  # by worker's name: its environment's id and facts; None while that is asked for
        self.busy = {}  # by worker's name: future, worker, task, part
        self.timing = set()  # hosts on which a timed cell is rendered
        self.refused = set()  # names of workers with other versions
        self.holding = defaultdict(set)  # by worker's name: the ids of references that it has
        self.notes, self.failures = [], []
        self.references = {}  # by scene's label, those that are made
        self.metrics = tuple(dict.fromkeys(("mse", *specification.metrics)))  # reports are made of the first
        self.finished = 0

    def run(self):
        """Render what isn't done; return the `Outcome`."""
        self.begin = clock.monotonic()
        self.number = self.store.begin(self.spec.to_dict())
        self.matrix = matrix_of(self.spec, self.pool)
        self.store.plan(self.matrix.listed)
        done = self.store.done()
        tasks = [Task.of(cell) for cell in self.matrix.ordered if cell.key not in done]
        self.queue = Queue(tasks)
        self.wanted, self.before = len(self.matrix.ordered), len(self.matrix.ordered) - len(tasks)
        self.kind = self._timed_before()
        for scene in self.matrix.references:
            self._reference_done(scene)
        while self.queue or self.busy:
            if not self._is_over():
                self._give_out()
            elif not self.busy:
                break
            self._collect()
        for task in self.queue.begun:
            self.store.give_up(task.attempt, task.cell.key, "stopped", None)
        if not self._is_over():
            self._measure_shares()
        left = self.wanted - self.before - self.finished - len(self.failures)
        outcome = "stopped" if left else "failed" if self.failures else "done"
        self.store.end(self.number, outcome)
        return Outcome(
            outcome, self.wanted, self.before, self.finished, tuple(self.failures), tuple(self.notes)
        )

    def _is_over(self):
        """Whether nothing more is to begin."""
        return self.stopped() or (
            self.spec.time is not None and clock.monotonic() - self.begin >= self.spec.time
        )

    def _timed_before(self):
        """The kind of machine on which cells of this store have been timed, or None."""
        found = self.store.query(
            "SELECT cpu, features, cores FROM timings JOIN environments ON id = timings.environment"
            " JOIN cells ON key = cell WHERE wanted = 1 GROUP BY cpu, features, cores ORDER BY count(*) DESC"
        )
        return tuple(found[0].values()) if found else None

    def _give_out(self):
        """Give idle workers something to do."""
        for each in self.pool.workers:
            if each.name in self.busy or each.host in self.timing:
                continue
            if each.name not in self.machines:
                future = self.pool.submit(each, worker.environment, each.share, self.spec.variant)
                self.machines[each.name] = None
                self.busy[each.name] = (future, each, None, None)
            elif self.machines[each.name] is not None:
                self._give(each)

    def _give(self, each):
        """Give a worker whose machine is known a part of a cell, if there is one for it."""
        alone = not any(w.host == each.host for _, w, _, _ in self.busy.values())
        task = self.queue.take(each.name, self._may_time(each), alone)
        if task is None:
            return
        if task.attempt is None:
            task.attempt = self.store.attempt(self.number, task.cell.key, each.name)
        part = task.parts.pop(0)
        task.running += 1
        threads = each.cores if task.cell.timed else each.share
        if part == task.cell.whole:
            arguments = (rendering.render_whole, threads, task.cell, *self._reference_for(each, task.cell))
        else:
            arguments = (rendering.render, threads, task.cell, part)
        future = self.pool.submit(each, *arguments)
        self.busy[each.name] = (future, each, task, part)
        if task.cell.timed:
            self.timing.add(each.host)

    def _reference_for(self, each, cell):
        """The reference of a cell's scene, without its pixels where the worker has them, and the metrics."""
        reference = self.references.get(cell.scene.label) if cell.role != REFERENCE else None
        if reference is None:
            return None, None, self.metrics
        has = self.holding[each.name]
        sent = None if reference.id in has else reference
        has.add(reference.id)
        return reference.id, sent, self.metrics

    def _may_time(self, each):
        """Whether a worker's machine is of the kind on which cells are timed: at first the most common one."""
        kinds = {name: _kind(facts) for name, (_, facts) in self._known().items()}
        all_known = all(each.name in kinds or each.name in self.refused for each in self.pool.workers)
        if self.kind not in kinds.values() and all_known:
            self.kind = Counter(kinds.values()).most_common(1)[0][0]
        return kinds[each.name] == self.kind

    def _known(self):
        return {name: machine for name, machine in self.machines.items() if machine is not None}

    def _collect(self):
        """Wait for a worker, and take what is ready."""
        futures = [future for future, *_ in self.busy.values()]
        if not futures:
            clock.sleep(POLL)
            return
        wait(futures, POLL, FIRST_COMPLETED)
        for name, (future, each, task, part) in list(self.busy.items()):
            if not future.done():
                continue
            del self.busy[name]
            if task is None:
                self._machine_known(each, future)
            else:
                self._part_done(each, task, part, future)

    def _machine_known(self, each, future):
        """Take a worker's account of its machine; refuse one with other versions."""
        try:
            facts = future.result()
        except WorkerLostError:
            del self.machines[each.name]
            return
        found = json.loads(facts["versions"])
        other = next(
            (name for name, number in self.matrix.versions.items() if found.get(name) != number), None
        )
        if other is None:
            self.machines[each.name] = (self.store.add_environment(facts), facts)
            return
        self.refused.add(each.name)
        has = f"{other} {found.get(other)}, not {self.matrix.versions[other]}"
        self.notes.append(f"worker {each.name} is left out: it has {has}")

    def _part_done(self, each, task, part, future):
        """Take the result of a part, or what went wrong with it."""
        task.running -= 1
        if task.cell.timed:
            self.timing.discard(each.host)
        if task.failed:
            return
        try:
            task.results[part] = future.result()
        except WorkerLostError as error:
            self._lost(each, task, part, error)
        except Exception as error:
            self._failed(task, _line(error))
        else:
            task.environments.add(self.machines[each.name][0])
            if not task.parts and not task.running:
                self._finish(each, task)

    def _lost(self, each, task, part, error):
        """Have the part done again, unless its workers die of it."""
        self.machines.pop(each.name, None)
        self.holding.pop(each.name, None)
        task.lost += 1
        if task.lost >= TRIES:
            self._failed(task, f"its workers ended {TRIES} times: {error}")
            return
        self.store.give_up(task.attempt, task.cell.key, "lost", str(error))
        task.attempt = None
        self.queue.put_back(task, part)

    def _failed(self, task, message):
        task.failed = True
        self.queue.drop(task)
        self.failures.append((task.cell, message))
        self.store.give_up(task.attempt, task.cell.key, "failed", message)
        self._tell(task)

    def _finish(self, each, task):
        """Store a cell whose parts are all done, with its errors."""
        cell = task.cell
        found = task.results.get(cell.whole)
        if found is None:
            found = finished(cell, task.results, self.references.get(cell.scene.label), self.metrics)
        environment = next(iter(task.environments)) if len(task.environments) == 1 else None
        self.store.finish(task.attempt, cell, found, environment, each.cores)
        self.queue.drop(task)
        self.finished += 1
        if cell.role == REFERENCE:
            self._reference_done(cell.scene.label)
        self._tell(task)

    def _reference_done(self, label):
        """Once all cells of a scene's reference are done, make the reference, and take what errors are missing."""
        cells = self.matrix.references[label]
        if label in self.references or not {cell.key for cell in cells} <= self.store.done():
            return
        row = self.store.add_reference(cells)
        reference = self.references[label] = Reference(row, self.store.picture(row["picture"]))
        done = self.store.query(
            "SELECT key, picture FROM cells WHERE scene = ? AND role = 'cell' AND status = 'done' AND wanted = 1",
            row["scene"],
        )
        known = defaultdict(set)
        for error in self.store.query("SELECT cell, metric FROM errors WHERE reference = ?", row["id"]):
            known[error["cell"]].add(error["metric"])
        for cell in done:
            names = [name for name in self.metrics if name not in known[cell["key"]]]
            if names:
                pixels = self.store.pixels(cell["picture"])
                self.store.add_errors(errors_of(cell["key"], pixels, reference, names))

    def _measure_shares(self):
        """Have the noise shares of our own methods measured that aren't in the store, where the study asks for them."""
        count = self.spec.shares
        known = {
            row["method"]
            for row in self.store.query("SELECT method FROM shares WHERE evaluations = ?", count)
        }
        lacking = [
            (rows.method_row(scene, method)["id"], scene, method)
            for scene, method in self.matrix.own
            if count and rows.method_row(scene, method)["id"] not in known
        ]
        there = [each for each in self.pool.workers if each.name not in self.refused]
        asked = []
        for number, (identity, scene, method) in enumerate(lacking):
            each = there[number % len(there)]
            arguments = self.spec.variant, scene, method, count, self.spec.seed
            future = self.pool.submit(each, rendering.measure_shares, each.share, *arguments)
            asked.append((identity, f"{scene.label}: {method.label}", future))
        for identity, name, future in asked:
            try:
                shares, file = future.result()
            except Exception as error:
                self.notes.append(f"{name}: no noise shares: {_line(error)}")
            else:
                self.store.add_shares(identity, shares, file)

    def _tell(self, task):
        done = self.before + self.finished + len(self.failures)
        self.report(
            done, self.wanted, f"{task.cell.scene.label}: {task.cell.method.label}, {task.cell.spp} spp"
        )


def _kind(facts):
    return tuple(facts[name] for name in KIND)


def _line(error):
    text = " ".join(str(error).split())
    return text if isinstance(error, UsageError) else f"{type(error).__name__}: {text}"
