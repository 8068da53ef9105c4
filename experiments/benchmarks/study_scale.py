"""What a study of 10^5 cells on 100 machines would cost, from measured parts, and where it would first break.

The work that a worker has beside rendering (encoding, errors), and all that the coordinator has to do for a cell, are
measured with workers that answer at once, and set against a time of rendering.
``python experiments/benchmarks/study_scale.py`` prints a table; it takes a minute of a quiet machine. Left out: the
network between machines; bytes are counted instead.
"""

import statistics
import tempfile
import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np

from whitted import image
from whitted.studies import rendering, worker
from whitted.studies.cells import Method, Scene, cells_of, interleaved
from whitted.studies.coordinator import Coordinator
from whitted.studies.finishing import Reference, finished
from whitted.studies.pools import Worker
from whitted.studies.specification import read
from whitted.studies.store import Store

CELLS, MACHINES, SECONDS = 100_000, 100, 10.0  # of a cell's rendering
PLANNED, COORDINATED = 20_000, 1_000  # cells measured, and scaled up
SIZES = (128, 512)
TURNS = 9
SPP = tuple(1 << k for k in range(10))
TIMING = {
    "load": 0.0,
    "trace": 0.1,
    "compile": 0.0,
    "execute": 1.0,
    "total": 1.1,
    "compiled": 0,
    "from_disk": 0,
}
MACHINE = {
    "host": "h",
    "cpu": "c",
    "features": "",
    "cores": 1,
    "memory": 1,
    "system": "s",
    "versions": "{}",
    "probe": "",
}


def study(side, replicates):
    """Return a specification, its scene and ten methods."""
    spec = read(
        {
            "scenes": "soft_shadows",
            "integrators": ["path"],
            "spp": list(SPP),
            "replicates": replicates,
            "reference": {"integrator": "path", "spp": 64, "replicates": 2},
        }
    )
    scene = Scene("soft_shadows", "soft_shadows", {}, 0, side, side, "0" * 64)
    methods = [
        Method(
            f"path {i}",
            {"type": "path", "max_depth": i},
            "independent",
            None,
            (),
            None,
            {n: n for n in (*SPP, 64)},
        )
        for i in range(10)
    ]
    return spec, scene, methods


class Instant:
    """Workers on machines of their own that have each cell done when they are asked, see `whitted.studies.pools`."""

    def __init__(self, scene, methods, found):
        self.workers = [Worker(f"w{i}", f"h{i}", 1, 1) for i in range(MACHINES)]
        self.described = scene, [[method] for method in (*methods, methods[0])], {}
        self.found = found

    def submit(self, to, function, threads, *arguments):
        """Have the answer at once."""
        future = Future()
        answers = {
            rendering.describe: self.described,
            worker.environment: MACHINE,
            rendering.render_whole: self.found,
        }
        future.set_result(answers[function])
        return future


def planning():
    """Return seconds for each cell until the first begins: keys, order, rows."""
    spec, scene, methods = study(128, PLANNED // (len(SPP) * 10))
    begin = time.perf_counter()
    _, turns = cells_of(spec, scene, methods, methods[0], {})
    cells = interleaved([turns], 0)
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "s", write=True) as store:
        store.begin({})
        store.plan(cells)
    return (time.perf_counter() - begin) / len(cells)


def coordinating(side, found):
    """Return seconds of all that the coordinator does for a cell of which a worker gives ``found``."""
    spec, scene, methods = study(side, COORDINATED // (len(SPP) * 10))
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "s", write=True) as store:
        coordinator = Coordinator(store, Instant(scene, methods, found), spec)
        begin = time.perf_counter()
        outcome = coordinator.run()
        return (time.perf_counter() - begin) / outcome.now


def finishing(side):
    """Return seconds of what a worker does with a rendered cell, by step, and what it sends."""
    spec, scene, methods = study(side, 2)
    cells = cells_of(spec, scene, methods, methods[0], {})[1][0][:TURNS]
    sums = np.random.default_rng(0).random((side, side, 3))
    result = {"sums": sums, "weights": np.ones((side, side)), "timings": [TIMING], "same_bits": True}
    truth = image.Picture(image.layer_channels("", sums) | image.layer_channels("stderr", 0.01 * sums))
    reference = Reference({"id": "r"}, truth)
    taken = {"mse": [], "mse and flip": []}
    for cell in cells:
        for name, times in taken.items():
            begin = time.perf_counter()
            finished(cell, {cell.whole: result}, reference, name.split(" and "))
            times.append(time.perf_counter() - begin)
    found = finished(cells[0], {cells[0].whole: result}, None, ())
    return {name: statistics.median(times) for name, times in taken.items()}, found


def main():
    planned = planning()
    print(f"{CELLS} cells: {CELLS * planned:.0f} s before the first begins")
    print(
        f"rendering, {SECONDS:g} s for each cell on {MACHINES} machines: {CELLS * SECONDS / MACHINES / 3600:.1f} h"
    )
    for side in SIZES:
        steps, found = finishing(side)
        own, size = coordinating(side, found), len(found.file)
        listed = ", ".join(f"with {name} {1000 * value:.0f} ms" for name, value in steps.items())
        print(
            f"{side}x{side}: a worker encodes a cell {listed}; the coordinator has {1000 * own:.0f} ms of work with it"
        )
        print(
            f"  coordinator: {CELLS * own / 3600:.1f} h in all, fully busy from {SECONDS / own:.0f} machines on"
        )
        print(f"  {CELLS * size / 1e9:.0f} GB kept, {MACHINES * size / SECONDS / 1e6:.0f} MB/s arrive")


if __name__ == "__main__":
    main()
