"""How long does `whitted render whitted_1980` take, against POV-Ray on the same scene?

Both render 512x512 with one sample per pixel and as many threads, in turn, each as a process of its own. Wall time
is that of the whole process, start and writing of the picture included (ours also writes what `--continue` needs);
our kernels are compiled beforehand, as after the first run of a machine. The time of the kernel is compared with what
POV-Ray calls trace time. POV-Ray's scene is `povray/whitted_1980.pov`, twice: with the shell as a difference of two
spheres, which is the same optics, and as two nested spheres, which POV-Ray traces faster but without the inner
reflections; the ratios are those to the first.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import timing

SIZE = 512
TURNS = 15
WALL_TARGET = 0.8
KERNEL_TARGET = 0.2
WHITTED = Path(sys.executable).with_name("whitted")
SCENE = Path(__file__).with_name("povray") / "whitted_1980.pov"


def run(command, folder):
    """Run a command; return its wall time in seconds and what it wrote on standard error."""
    begin = time.perf_counter()
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    if done.returncode:
        sys.exit(f"{command[0]} failed: {done.stderr.strip()[-500:]}")
    return seconds, done.stderr


def whitted(folder):
    size = ("--width", SIZE, "--height", SIZE, "--spp", 1, "-t", timing.threads())
    wall, _ = run((WHITTED, "render", "whitted_1980", *size, "-o", "a.exr", "--stats", "a.json"), folder)
    stats = json.loads((folder / "a.json").read_text())
    return wall, stats["seconds"]["execute"]


def povray(folder, csg):
    options = (f"+W{SIZE}", f"+H{SIZE}", "-A", "-D", "-V", f"+WT{timing.threads()}", f"Declare=CSG={csg}")
    wall, log = run(("povray", f"+I{SCENE.resolve()}", "+Ob.png", *options), folder)
    return wall, float(re.search(r"Trace Time:.*\(([\d.]+) seconds\)", log)[1])


def measure():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whitted(folder)  # compiles the kernels, and reads all files once
        povray(folder, 1)
        turns = [(whitted(folder), povray(folder, 1), povray(folder, 0)) for _ in range(TURNS)]
    columns = np.array(turns).transpose(1, 2, 0).tolist()  # side, wall or kernel, turn
    return dict(zip(("whitted", "povray", "povray_spheres"), columns, strict=True))


def show(found):
    print(
        f"whitted_1980, {SIZE}x{SIZE}, 1 spp, medians of {len(found['whitted'][0])} turns; {found['machine']}\n"
    )
    rows = [("", "whitted", "POV-Ray", "ratio [95 %]", "target", "POV-Ray, nested spheres")]
    for i, (label, target) in enumerate(
        (("whole process", WALL_TARGET), ("kernel / trace time", KERNEL_TARGET))
    ):
        ours, theirs, nested = (found[side][i] for side in ("whitted", "povray", "povray_spheres"))
        value, low, high = timing.ratio(ours, theirs)
        other = np.median(nested)
        rows.append(
            (
                label,
                f"{np.median(ours):.3f} s",
                f"{np.median(theirs):.3f} s",
                f"{value:.2f} [{low:.2f}, {high:.2f}]",
                timing.verdict(value, target),
                f"{other:.3f} s, ratio {np.median(ours) / other:.2f}",
            )
        )
    timing.table(rows)


if __name__ == "__main__":
    if shutil.which("povray") is None:
        sys.exit("skipped: povray is not installed (Debian: apt install povray)")
    timing.main("povray", measure, show)
