"""Where cells are rendered: worker processes of this machine, each with its share of the threads.

A pool has ``workers``, a list of `Worker` that may change while it runs; ``submit``, which gives a
``concurrent.futures.Future``; and ``close``. A future of a worker that has died raises `WorkerLostError`. Processes are
spawned, since a fork would copy Dr.Jit's threads' locks without the threads.
"""

import multiprocessing
import os
import sys
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass

from whitted.studies import worker


class WorkerLostError(Exception):
    """The worker's process has ended before its task was done."""


@dataclass(frozen=True)
class Worker:
    """A process that renders, on a host with so many cores, of which it has its share when others are at work."""

    name: str
    host: str
    cores: int
    share: int


class LocalPool:
    """Spawned processes of this machine.

    Args:
        count: of processes.
    """

    HOST = "local"

    def __init__(self, count):
        total = worker.cores()
        self.workers = [Worker(f"local-{i}", self.HOST, total, max(total // count, 1)) for i in range(count)]
        self._executors, self._pids = {}, []

    def submit(self, to, function, threads, *arguments):
        """Have a worker call a function that can be pickled, with a number of Dr.Jit's threads."""
        future = Future()
        if to.name not in self._executors:
            context = multiprocessing.get_context("spawn")
            self._executors[to.name] = ProcessPoolExecutor(1, context, worker.start)
            with _without_main():
                self._pids.append(self._executors[to.name].submit(os.getpid))
        done = self._executors[to.name].submit(worker.run, function, threads, arguments)
        done.add_done_callback(lambda done: self._pass_on(to, done, future))
        return future

    def close(self):
        """End the processes, in the middle of what they do."""
        own = {pid.result() for pid in self._pids if pid.done() and not (pid.cancelled() or pid.exception())}
        for process in multiprocessing.active_children():
            if process.pid in own:
                process.kill()
        for executor in self._executors.values():
            executor.shutdown(cancel_futures=True)

    def _pass_on(self, to, done, future):
        error = done.exception() if not done.cancelled() else WorkerLostError("cancelled")
        if isinstance(error, BrokenProcessPool):
            self._executors.pop(to.name, None)  # the next task gets a new process
            error = WorkerLostError("its process ended")
        if error is None:
            future.set_result(done.result())
        else:
            future.set_exception(error)


@contextmanager
def _without_main():
    """Start processes that don't run the user's script again, as spawned ones do: nothing in it is needed there."""
    main = sys.modules["__main__"]
    hidden = {name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)}
    main.__spec__ = None
    try:
        yield
    finally:
        vars(main).update(hidden)
