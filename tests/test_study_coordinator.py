"""Who renders what and when, with workers that are not there: they answer at once, die and come as they are told."""

import json
from collections import Counter
from concurrent.futures import Future

import numpy as np
import pytest
from studies import TOY

from whitted.errors import UsageError
from whitted.studies import rendering, worker
from whitted.studies.cells import Method, Scene
from whitted.studies.coordinator import Coordinator
from whitted.studies.finishing import finished
from whitted.studies.pools import Worker, WorkerLostError
from whitted.studies.specification import read
from whitted.studies.store import Store

SCENE = Scene("toy", "soft_shadows", {}, 0, 16, 16, "abc")
METHODS = [
    Method(name, {"type": name}, None, None, (), None, {n: n for n in (1, 4, 64)}) for name in ("a", "b")
]
FACTS = {"host": "h", "cpu": "x", "features": "avx", "cores": 4, "memory": 1, "system": "s"}
FACTS["versions"] = json.dumps({"whitted": "1"})


class Pool:
    """Workers by host that do a task when ``step`` is called; what runs is in ``running``, what ran in ``log``."""

    def __init__(self, **hosts):
        self.workers = [
            Worker(f"{host}-{i}", host, 4, 4 // count) for host, count in hosts.items() for i in range(count)
        ]
        self.running, self.log, self.cpu = [], [], {}
        self.fate = lambda worker, job: None  # an error, or None

    def submit(self, to, function, threads, *arguments):
        future = Future()
        if function is rendering.describe:
            future.set_result((SCENE, [[method] for method in (*METHODS, METHODS[0])], {"whitted": "1"}))
        elif function is worker.environment:
            facts = FACTS | {"host": to.host, "cpu": self.cpu.get(to.host, "x"), "probe": "p"}
            future.set_result(facts)
        else:
            cell = arguments[0]
            part = arguments[1] if function is rendering.render else cell.whole
            job = {"timed": cell.timed, "seed": cell.seed, "spp": cell.spp, "part": part, "cell": cell}
            job |= {"integrator": cell.method.integrator, "function": function}
            self.check(to, job, threads)
            self.running.append((future, to, job))
        return future

    def check(self, to, job, threads):
        beside = [(w, other) for _, w, other in self.running if w.host == to.host]
        assert not any(w.name == to.name for w, _ in beside), "a worker has two tasks"
        if job["timed"]:
            assert not beside, "a timed cell isn't alone"
            assert threads == to.cores
        else:
            assert not any(other["timed"] for _, other in beside), "something runs beside a timed cell"
            assert threads == to.share

    def step(self):
        future, to, job = self.running.pop(0)
        self.log.append((to, job))
        error = self.fate(to, job)
        if error is not None:
            future.set_exception(error)
            return
        part = job["part"]
        rng = np.random.default_rng([job["seed"], part.y])
        sums = rng.random((part.height, part.width, 3)) * job["spp"]
        timing = dict.fromkeys(("load", "trace", "compile", "execute", "total"), 0.1) | {
            "compiled": 0,
            "from_disk": 0,
        }
        weights = np.full((part.height, part.width), float(job["spp"]))
        result = {"sums": sums, "weights": weights, "timings": [timing], "same_bits": True}
        whole = job["function"] is rendering.render_whole
        future.set_result(finished(job["cell"], {part: result}, None, ()) if whole else result)


class Stepping(Coordinator):
    """Lets the workers go on only once all that are idle have been given something."""

    def _collect(self):
        if self.pool.running:
            self.pool.step()
        super()._collect()


@pytest.fixture
def run(tmp_path):
    def run(pool, stopped=lambda: False, **changes):
        with Store(tmp_path / "store", write=True) as store:
            outcome = Stepping(store, pool, read(TOY | changes), stopped=stopped).run()
            return outcome, {
                name: store.query(f"SELECT * FROM {name}") for name in ("cells", "attempts", "timings")
            }

    return run


def jobs(pool, timed):
    return [(worker, job) for worker, job in pool.log if job["timed"] is timed]


def test_references_are_shared_and_timed_cells_have_each_machine_to_themselves(run):
    pool = Pool(one=2, two=2)
    outcome, tables = run(pool, replicates=6, timed=4)
    assert outcome.outcome == "done"
    assert {worker.host for worker, _ in jobs(pool, True)} == {"one", "two"}
    assert len(jobs(pool, True)) == len(tables["timings"]) == 2 * 2 * 4
    assert {worker.name for worker, _ in jobs(pool, False)} == {"one-0", "one-1", "two-0", "two-1"}


def test_seconds_are_taken_on_machines_of_one_kind(run):
    pool = Pool(one=1, two=1, three=1)
    pool.cpu = {"three": "y"}
    outcome, _ = run(pool, replicates=4, timed=2)
    assert outcome.outcome == "done"
    assert {worker.host for worker, _ in jobs(pool, True)} == {"one", "two"}
    assert "three" in {worker.host for worker, _ in jobs(pool, False)}


def test_later_runs_take_seconds_on_the_kind_that_earlier_ones_did(run):
    first, second = Pool(one=1), Pool(two=1, three=1, four=1)
    second.cpu = {"two": "y", "three": "y"}
    run(first)
    run(second, replicates=5)
    assert {worker.host for worker, _ in jobs(second, True)} == {"four"}


def test_what_a_lost_worker_had_is_done_by_another(run):
    pool, lost = Pool(one=2), []

    def fate(worker, job):
        if worker.name == "one-0" and job["seed"] not in lost and len(lost) < 3:
            lost.append(job["seed"])
            return WorkerLostError("gone")
        return None

    pool.fate = fate
    outcome, tables = run(pool, timed=0)
    assert outcome.outcome == "done"
    assert Counter(row["outcome"] for row in tables["attempts"]) == {"done": len(tables["cells"]), "lost": 3}
    assert all(row["status"] == "done" for row in tables["cells"])


def test_a_cell_that_kills_its_workers_is_given_up_and_the_others_go_on(run):
    pool, deadly = Pool(one=2), []

    def fate(worker, job):
        if job["spp"] == 4:
            deadly.append(job["seed"])
        return WorkerLostError("its process ended") if deadly and job["seed"] == deadly[0] else None

    pool.fate = fate
    outcome, tables = run(pool)
    assert outcome.outcome == "failed"
    assert [message for _, message in outcome.failures] == ["its workers ended 3 times: its process ended"]
    assert sorted(row["status"] for row in tables["cells"])[-1] == "failed"
    assert Counter(row["status"] for row in tables["cells"])["failed"] == 1


def test_a_cell_that_fails_is_told_once_and_tried_again_next_time(run):
    pool = Pool(one=1)
    pool.fate = lambda worker, job: UsageError("no light") if job["integrator"]["type"] == "b" else None
    outcome, tables = run(pool)
    failed = [row for row in tables["cells"] if row["status"] == "failed"]
    assert {row["message"] for row in failed} == {"no light"}
    assert len(failed) == len(outcome.failures) == 6
    again = Pool(one=1)
    outcome, tables = run(again)
    assert (outcome.now, outcome.outcome) == (6, "done")
    assert {row["message"] for row in tables["cells"]} == {None}


def test_other_errors_are_told_with_their_kind(run):
    pool = Pool(one=1)
    pool.fate = lambda worker, job: MemoryError("too\nlarge")
    outcome, _ = run(pool)
    assert {message for _, message in outcome.failures} == {"MemoryError: too large"}


def test_parts_of_a_large_cell_are_shared_out_unless_it_is_timed(run, monkeypatch):
    from whitted.studies import cells

    monkeypatch.setattr(cells, "PART", 16 * 4)
    pool = Pool(one=4)
    _, tables = run(pool, timed=0)
    parts = Counter((job["seed"], job["part"].y, job["part"].start) for _, job in pool.log)
    assert set(parts.values()) == {1}
    assert len(parts) > len(tables["cells"])
    by_cell = Counter()
    for seed in {job["seed"] for _, job in pool.log}:
        by_cell[len({worker.name for worker, job in pool.log if job["seed"] == seed})] += 1
    assert max(by_cell) > 1
    timed = Pool(one=4)
    run(timed, seed=1)
    for seed in {job["seed"] for _, job in jobs(timed, True)}:
        assert len({worker.name for worker, job in timed.log if job["seed"] == seed}) == 1


def test_a_stop_finishes_what_is_begun_and_begins_nothing(run):
    pool = Pool(one=2)
    outcome, tables = run(pool, stopped=lambda: len(pool.log) >= 3)
    assert outcome.outcome == "stopped"
    assert {row["outcome"] for row in tables["attempts"]} == {"done"}
    assert 3 <= outcome.now <= 5
    assert run(Pool(one=2))[0].before == outcome.now


def test_workers_that_come_later_join_in(run):
    pool = Pool(one=1)
    late = Worker("two-0", "two", 4, 4)

    def fate(worker, job):
        if len(pool.log) == 4:
            pool.workers = [*pool.workers, late]

    pool.fate = fate
    run(pool)
    assert late in {worker for worker, _ in pool.log}


def test_a_worker_with_other_versions_is_left_out(run):
    pool = Pool(one=1, two=1)
    pool.cpu = {"two": "y"}
    submit = pool.submit

    def other(to, function, threads, *arguments):
        future = submit(to, function, threads, *arguments)
        if function is worker.environment:
            facts = future.result() | {"versions": json.dumps({"whitted": "2" if to.host == "two" else "1"})}
            future = Future()
            future.set_result(facts)
        return future

    pool.submit = other
    outcome, _ = run(pool)
    assert {worker.host for worker, _ in pool.log} == {"one"}
    assert outcome.notes == ("worker two-0 is left out: it has whitted 2, not 1",)
