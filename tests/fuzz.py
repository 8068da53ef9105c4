"""Render scenes whose XML is mutated at random: each ends in a picture of finite pixels, or in one line and exit 2.

Each mutant is rendered by the command line in a process of its own, so that an abort or an endless loop is seen. The
processes are forked from this one, which has imported everything and run nothing. ::

    python tests/fuzz.py                            2000 mutants of seeds from a random one on
    python tests/fuzz.py --first 0 --count 200      those of the seeds 0 to 199
    python tests/fuzz.py --seed 17 --keep FOLDER    one of them, whose scene, picture and messages stay in FOLDER
"""

import argparse
import collections
import os
import random
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

from fuzz_mutations import mutant
from fuzz_scenes import scenes, write_files

SIZE = 12  # pixels of a picture's side
LIMIT = 20  # seconds for one mutant
SLOW_LIMIT = 120  # for one whose effects are chosen: it compiles a dozen of kernels
MEMORY = 8 << 30  # bytes of addresses for one mutant
SHARE = 1 / 3  # of the mutants end in a picture at least, or the mutations are too rough to show much
PICTURE, ERROR = "picture", "error"
NOT_FINITE = 99  # exit code of a process whose picture has pixels that aren't finite


@dataclass
class Ending:
    """How a mutant ended: ``kind`` is ``picture``, ``error``, or what is wrong; ``message`` the last line said."""

    kind: str
    seconds: float
    message: str

    @property
    def is_good(self):
        return self.kind in (PICTURE, ERROR)


class Nursery:
    """Renders mutants in processes that are forked from this one, in a folder.

    This process runs no kernel, since Dr.Jit's workers don't survive a fork. One thread of its Python module sleeps
    from the import on, until another thread leaves it something to free, and isn't missed.
    """

    def __init__(self, folder):
        self.folder = folder
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        import whitted  # noqa: I001, first, as it finds LLVM
        import drjit as dr
        import mitsuba as mi
        import OpenEXR  # noqa: F401
        import whitted.cli.render
        import whitted.passes  # noqa: F401

        dr.set_thread_count(1)
        mi.set_variant("llvm_ad_rgb")
        threads = len(os.listdir("/proc/self/task"))
        if threads > 2:
            raise RuntimeError(f"there are {threads} threads, and a fork keeps one")
        warnings.filterwarnings("ignore", ".*multi-threaded", DeprecationWarning)  # from Python 3.12 on
        write_files(folder)

    def render(self, one):
        """Render a ``Mutant``; return its ``Ending``."""
        scene, out, err, picture = (
            self.folder / name for name in ("mutant.xml", "out.txt", "err.txt", "mutant.exr")
        )
        picture.unlink(missing_ok=True)
        scene.write_text(one.text, encoding="utf-8")
        size = f"--width {SIZE} --height {SIZE} --spp {one.spp}".split()
        limit = SLOW_LIMIT if one.is_slow else LIMIT
        begin = time.perf_counter()
        child = os.fork()
        if child == 0:
            run_child(["render", str(scene), "-o", str(picture), *size], out, err, picture)
        status = wait(child, limit)
        seconds = time.perf_counter() - begin
        if status is None:
            return Ending("hang", seconds, f"not done after {limit} s")
        text = err.read_text(errors="replace")
        return Ending(
            judge(os.waitstatus_to_exitcode(status), text), seconds, "".join(text.splitlines()[-1:])
        )


def run_child(arguments, out, err, picture):
    """Run the command line in this forked process, and end it."""
    code = 70
    try:
        for number, path in ((1, out), (2, err)):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(descriptor, number)
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        from whitted import cli

        try:
            cli.main(arguments)
        except SystemExit as done:
            code = done.code
        if code in (0, 4) and not is_finite(picture):
            code = NOT_FINITE
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def is_finite(picture):
    """Whether all colours of an EXR file are finite."""
    import numpy as np
    import OpenEXR

    with OpenEXR.File(str(picture)) as file:
        channels = file.channels()
        names = [name for name in channels if name in ("RGB", "RGBA", "R", "G", "B", "Y")]
        return bool(names) and all(np.isfinite(channels[name].pixels).all() for name in names)


def wait(child, limit):
    """Return the wait status of a child process, or None where it had to be killed after ``limit`` seconds."""
    descriptor = os.pidfd_open(child)
    try:
        done, _, _ = select.select([descriptor], [], [], limit)
        if not done:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    finally:
        os.close(descriptor)
    return status if done else None


def judge(code, text):
    """Return the kind of ending of a process: ``code`` is its exit code or minus a signal, ``text`` its messages."""
    if code < 0:
        return f"abort ({signal.Signals(-code).name})"
    if code == NOT_FINITE:
        return "picture that isn't finite"
    if code not in (0, 2, 4):
        return f"exit {code}"
    lines = text.splitlines()
    errors = sum(line.startswith("whitted: error: ") for line in lines)
    if errors != (code == 2) or not all(line.startswith("whitted: ") for line in lines):
        return "not one line"
    if re.search(r"Traceback|\.(cpp|h|py):\d", text):
        return "a place in the code"
    return ERROR if code == 2 else PICTURE


def run(seeds, count, folder, keep=None, quick=False):
    """Render ``count`` mutants of some seeds, and tell of those that end badly; return whether all is well.

    ``quick`` leaves out mutants that compile many kernels; ``keep`` is the folder where failing ones stay.
    """
    nursery, texts, kinds = Nursery(folder), scenes(), collections.Counter()
    for seed in seeds:
        one = mutant(seed, texts)
        if quick and one.is_slow:
            continue
        ending = nursery.render(one)
        kinds[ending.kind] += 1
        if count == 1 or not ending.is_good:
            print(f"seed {seed}, {one.scene}: {ending.kind}, {ending.seconds:.2f} s: {ending.message}")
            print(*(f"    {change}\n" for change in one.changes), sep="", end="", flush=True)
            if keep is not None:
                shutil.copytree(folder, keep if count == 1 else keep / str(seed), dirs_exist_ok=True)
        if kinds.total() == count:
            break
    print(f"seeds {seeds[0]} to {seed}:", ", ".join(f"{n} {kind}" for kind, n in kinds.most_common()))
    return kinds[PICTURE] + kinds[ERROR] == count and (count < 100 or kinds[PICTURE] >= SHARE * count)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2000, help="how many mutants")
    parser.add_argument("--first", type=int, help="the first one's seed, by default a random one")
    parser.add_argument("--seed", type=int, help="this mutant alone")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where failing mutants stay")
    parser.add_argument("--quick", action="store_true", help="leave out mutants that compile many kernels")
    arguments = parser.parse_args()
    first, count = arguments.first, arguments.count
    if arguments.seed is not None:
        first, count = arguments.seed, 1
    elif first is None:
        first = random.randrange(1 << 31)
    seeds = range(first, first + 10 * count)
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(not run(seeds, count, Path(folder), arguments.keep, arguments.quick))


if __name__ == "__main__":
    main()
