"""Workers of a Dask cluster, on this machine or on others.

Scenes are read by the workers: their paths have to lead to the same files everywhere, or be names of shipped ones. A
worker that is gone has its cell done by another; one that comes later joins in. Left out: starting the cluster, which
is for ``dask scheduler``, ``dask worker --nthreads 1``, or a job queue.
"""

import threading
from collections import Counter
from concurrent.futures import Future

from whitted.errors import UsageError
from whitted.studies import worker
from whitted.studies.pools import Worker, WorkerLostError

LOOK = 0.25  # seconds between looks at who is there
PATIENCE = 10  # seconds to connect


class DaskPool:
    """The workers of a cluster; see `whitted.studies.pools`.

    Args:
        scheduler: address, or a ``distributed.Client``.

    Raises:
        UsageError: Dask isn't installed, nothing answers at the address, or there is no worker.
    """

    def __init__(self, scheduler):
        try:
            import distributed
        except ImportError as error:
            raise UsageError(
                "--scheduler needs the package distributed: pip install 'whitted[cluster]'"
            ) from error
        self._owned = isinstance(scheduler, str)
        try:
            self.client = distributed.Client(scheduler, timeout=PATIENCE) if self._owned else scheduler
        except (OSError, ValueError, TypeError) as error:
            raise UsageError(f"--scheduler {scheduler}: no Dask scheduler answers there") from error
        self._pending, self._lock = {}, threading.Lock()
        self._cores = {}
        self._closed = threading.Event()
        self._look()
        if not self.workers:
            self.close()
            raise UsageError(f"--scheduler {scheduler}: the cluster has no worker")
        self._watch = threading.Thread(target=self._keep_looking, daemon=True)
        self._watch.start()

    def submit(self, to, function, threads, *arguments):
        """Have a worker call a function that can be pickled, with a number of Dr.Jit's threads."""
        future = Future()
        try:
            done = self.client.submit(
                worker.run,
                function,
                threads,
                arguments,
                workers=[to.name],
                allow_other_workers=False,
                pure=False,
            )
        except ValueError:  # it is gone
            future.set_exception(WorkerLostError(f"{to.name} is gone"))
            return future
        with self._lock:
            self._pending[future] = (to.name, done)
        done.add_done_callback(lambda done: self._pass_on(done, future))
        return future

    def close(self):
        """Leave the cluster; what it is at is given up."""
        self._closed.set()
        with self._lock:
            for _, done in self._pending.values():
                done.cancel()
        if self._owned:
            self.client.close()

    def _look(self):
        """Find out who is there; what the others had is lost."""
        there = self.client.scheduler_info(n_workers=-1)["workers"]
        hosts = {name: info["host"] for name, info in there.items()}
        count = Counter(hosts.values())
        for name in there:
            if name not in self._cores:
                self._cores[name] = self.client.run(worker.cores, workers=[name]).get(name, 1)
        self.workers = [
            Worker(name, host, self._cores[name], max(self._cores[name] // count[host], 1))
            for name, host in sorted(hosts.items())
        ]
        with self._lock:
            lost = [(future, name) for future, (name, _) in self._pending.items() if name not in there]
        for future, name in lost:
            self._settle(future, error=WorkerLostError(f"{name} is gone"))

    def _keep_looking(self):
        while not self._closed.wait(LOOK):
            try:
                self._look()
            except (OSError, RuntimeError):  # closed meanwhile
                return

    def _pass_on(self, done, future):
        if done.status == "finished":
            self._settle(future, result=done.result())
        elif done.status == "error":
            self._settle(future, error=done.exception())
        else:
            self._settle(future, error=WorkerLostError(done.status))

    def _settle(self, future, result=None, error=None):
        """Give a future its outcome, if it has none yet."""
        with self._lock:
            entry = self._pending.pop(future, None)
        if entry is None:
            return
        if error is None:
            future.set_result(result)
            return
        import distributed

        if isinstance(error, distributed.scheduler.KilledWorker):
            error = WorkerLostError("its process ended")
        entry[1].cancel()
        future.set_exception(error)
