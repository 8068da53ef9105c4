"""What the benchmarks share: ratios of medians with their intervals, kept results, plain tables."""

import argparse
import json
import os
import platform
from pathlib import Path

import numpy as np

FOLDER = Path("out/benchmarks")
RESAMPLES = 10_000


def threads():
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0))


def machine():
    """The processor's name and the number of threads, in words."""
    name = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            name = line.split(":", 1)[1].strip()
            break
    return f"{name}, {threads()} threads"


def ratio(a, b, seed=0):
    """The ratio of the medians of ``a`` and ``b``, taken in turn, with its bootstrap 95 % interval.

    Turns are resampled whole, so that what slows both of a turn doesn't widen the interval.
    """
    turns = np.random.default_rng(seed).integers(0, len(a), (RESAMPLES, len(a)))
    a, b = np.asarray(a), np.asarray(b)
    resampled = np.median(a[turns], axis=1) / np.median(b[turns], axis=1)
    low, high = np.percentile(resampled, [2.5, 97.5])
    return np.median(a) / np.median(b), low, high


def table(rows):
    """Print rows of text in columns; the first row is the head."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def verdict(value, target):
    """Say whether a ratio meets its target."""
    return f"{'met' if value <= target else 'MISSED'} (at most {target:g})"


def main(name, measure, show):
    """Show what was measured before; measure first where nothing was, or where ``--force`` says so."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--force", action="store_true", help="measure again")
    kept = FOLDER / f"{name}.json"
    if parser.parse_args().force or not kept.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        found = {"machine": machine()} | measure()
        kept.write_text(json.dumps(found, indent=1) + "\n")
    show(json.loads(kept.read_text()))
