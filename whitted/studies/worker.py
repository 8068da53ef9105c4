"""The process of a worker: how it is set up, and what machine it is on."""

import hashlib
import json
import os
import platform
import signal
import threading

FEATURES = (
    "sse4_2",
    "avx",
    "avx2",
    "fma",
    "avx512f",
    "avx512vl",
    "avx512dq",
    "neon",
    "asimd",
    "sve",
)  # of vectors
PROBE = {"type": "path", "max_depth": 4}


def start():
    """Set up a spawned process: it ends with its parent, and leaves the keyboard's interrupts to it."""
    import multiprocessing

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    quiet()


def quiet():
    """Let Mitsuba tell errors alone: samplers that round numbers have been asked which they take."""
    import mitsuba as mi

    import whitted  # noqa: F401, it finds LLVM

    mi.set_log_level(mi.LogLevel.Error)


def environment(variant):
    """Return what this machine is, a dict of the columns of ``environments`` but its ``id``."""
    from whitted import _backend
    from whitted.results import versions

    _backend.activate(variant)
    return {
        "host": platform.node(),
        "cpu": _cpu()[0],
        "features": " ".join(_cpu()[1]),
        "cores": cores(),
        "memory": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        "system": platform.platform(),
        "versions": json.dumps(versions()),
        "probe": _probe(),
    }


def cores():
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def run(function, threads, arguments):
    """Call a function with a number of Dr.Jit's threads; what a worker is asked to do comes this way."""
    quiet()
    import drjit as dr

    if dr.thread_count() != threads:
        dr.set_thread_count(threads)
    return function(*arguments)


def _end_with(parent):
    parent.join()
    os._exit(1)


def _cpu():
    """The processor's model, and its vector features."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            facts = dict(
                line.split(":", 1) for line in file.read().split("\n\n")[0].splitlines() if ":" in line
            )
    except OSError:
        return platform.processor() or platform.machine(), []
    facts = {name.strip(): value.strip() for name, value in facts.items()}
    present = (facts.get("flags") or facts.get("Features") or "").split()
    return facts.get("model name", platform.machine()), [name for name in FEATURES if name in present]


def _probe():
    """The hash of a small picture that takes a few bounces: equal where pictures have equal bits."""
    import mitsuba as mi

    from whitted.film import Window
    from whitted.sampler_passes import SamplerPasses
    from whitted.scene import load

    scene = load("cornell_box", width=16, height=16).mitsuba
    sampler = mi.load_dict({"type": "independent"})
    window = Window(0, 0, 16, 16)
    passes = SamplerPasses(mi.load_dict(PROBE), scene, scene.sensors()[0], sampler, window, 0, 16)
    passes.run()
    return hashlib.sha256(passes.moments().sums.tobytes()).hexdigest()[:24]
