"""What a study of 10^5 cells on 100 machines would cost, from measured parts, and where it would first break.

The coordinator's work for each cell (planning, handing out, taking in, writing, errors) is measured with cells that
are not rendered, and set against the time of workers that render each for a given time.
``python experiments/benchmarks/study_scale.py`` prints a table; it takes three minutes of a quiet machine. Left out: the
network between machines; bytes are counted instead.
"""

import pickle
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from whitted.stats.metrics import METRICS
from whitted.studies.cells import Method, Part, Scene, cells_of, interleaved
from whitted.studies.coordinator import assembled
from whitted.studies.queue import Queue, Task
from whitted.studies.specification import read
from whitted.studies.store import Store

CELLS, MACHINES, SECONDS = 100_000, 100, 10.0  # of a cell's rendering
PLANNED = 20_000  # measured, and scaled up
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


def planning():
    """Return seconds for each cell: keys and order; rows; handing out."""
    spec, scene, methods = study(128, PLANNED // (len(SPP) * 10))
    begin = time.perf_counter()
    _, turns = cells_of(spec, scene, methods, methods[0], {"whitted": "0"})
    cells = interleaved([turns], 0)
    keys = {cell.key for cell in cells}
    made = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "s", write=True) as store:
        store.begin({})
        store.plan(cells)
        planned = time.perf_counter()
        queue = Queue([Task.of(cell) for cell in cells])
        while queue:
            queue.drop(queue.take("one", True, True))
        given = time.perf_counter()
    count = len(keys)
    return (made - begin) / count, (planned - made) / count, (given - planned) / count


def finishing(side):
    """Return seconds to take in a cell, by step, and the bytes that travel."""
    spec, scene, methods = study(side, 2)
    _, turns = cells_of(spec, scene, methods, methods[0], {"whitted": "0"})
    cells = turns[0][:TURNS]
    rng = np.random.default_rng(0)
    result = {
        "sums": rng.random((side, side, 3)),
        "weights": np.ones((side, side)),
        "timings": [TIMING],
        "same_bits": True,
    }
    part = Part(0, 0, side, side, 0, 1)
    truth = rng.random((side, side, 3)).astype(np.float32)
    steps = {name: [] for name in ("unpickle", "put together", "write", "mse", "flip")}
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "s", write=True) as store:
        run = store.begin({})
        store.plan(cells)
        machine = store.add_environment(MACHINE)
        for cell in cells:
            sent = pickle.dumps(result)
            marks = [time.perf_counter()]
            received = pickle.loads(sent)
            marks.append(time.perf_counter())
            picture = assembled(cell, {part: received})
            marks.append(time.perf_counter())
            attempt = store.attempt(run, cell.key, "one")
            store.finish(attempt, cell, picture, received["timings"], machine, 1, True)
            marks.append(time.perf_counter())
            for name in ("mse", "flip"):
                METRICS[name](picture, truth)
                marks.append(time.perf_counter())
            for name, a, b in zip(steps, marks, marks[1:], strict=False):
                steps[name].append(b - a)
        size = sum(path.stat().st_size for path in (Path(folder) / "s/pictures").iterdir()) / len(cells)
    return {name: statistics.median(values) for name, values in steps.items()}, len(sent), size


def main():
    keys, rows, given = planning()
    print(
        f"planning, for each cell: keys and order {1e6 * keys:.0f} us, rows {1e6 * rows:.0f} us, queue {1e6 * given:.0f} us"
    )
    print(f"  {CELLS} cells: {CELLS * (keys + rows + given):.0f} s before the first begins")
    rendering = CELLS * SECONDS / MACHINES
    print(f"rendering, {SECONDS:g} s for each cell on {MACHINES} machines: {rendering / 3600:.1f} h")
    for side in SIZES:
        steps, sent, size = finishing(side)
        listed = ", ".join(f"{name} {1000 * value:.1f} ms" for name, value in steps.items())
        print(
            f"{side}x{side}, taking in a cell: {listed}; {sent / 1e6:.1f} MB travel, {size / 1e6:.2f} MB kept"
        )
        for metrics in (("mse",), ("mse", "flip")):
            own = sum(value for name, value in steps.items() if name != "flip" or "flip" in metrics)
            load = f"{CELLS * own / 3600:.1f} h in all, fully busy from {SECONDS / own:.0f} machines on"
            print(f"  with {' and '.join(metrics)}: {load}")
        print(f"  {CELLS * size / 1e9:.0f} GB kept, {MACHINES * sent / SECONDS / 1e6:.0f} MB/s travel")


if __name__ == "__main__":
    main()
