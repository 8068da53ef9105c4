"""``whitted doctor``: what this machine has for the command to work, a one-second test, and what to do."""

import os
import platform
import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import click

from whitted import _backend
from whitted.cli import options
from whitted.errors import BackendError

PACKAGES = ("whitted", "mitsuba", "drjit", "numpy", "OpenEXR")
REFLECTANCE, IRRADIANCE = 0.5, 2.0
TOLERANCE = 1e-5  # relative: a few dozen roundings in single precision


@click.command("doctor")
@options.verbose
def command():
    """Examine LLVM, variants, versions and the kernel cache, and test them in a second.

    Exits with 1 where something is missing, and says what to do.
    """
    from rich.console import Console
    from rich.table import Table

    rows, advice = examine()
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for label, value in rows:
        table.add_row(label, value)
    console = Console(highlight=False, markup=False)
    console.print(table)
    for line in advice:
        console.print(f"to do: {line}", soft_wrap=True)
    return 1 if advice else 0


def examine():
    """Return the rows ``(label, text)`` of the report, and a list of what is to be done."""
    import drjit as dr
    import mitsuba as mi

    rows, advice = [("python", f"{platform.python_version()}, {sys.executable}")], []
    for package in PACKAGES:
        try:
            rows.append((package, metadata.version(package)))
        except metadata.PackageNotFoundError:
            rows.append((package, "missing"))
            advice.append(f"pip install {package}")
    version = dr.detail.llvm_version()
    library = os.environ.get(_backend.VARIABLE) or "found by Dr.Jit"
    rows.append(("LLVM", f"{'.'.join(map(str, version))}, {library}" if version[0] >= 0 else "none"))
    cuda = dr.has_backend(dr.JitBackend.CUDA)
    rows.append(("CUDA", "yes" if cuda else "no"))
    rows.append(("variants", ", ".join(name for name in mi.variants() if not name.startswith("scalar"))))
    rows.append(("CPU", f"{dr.thread_count()} threads, FMA: {_fma()}"))
    rows.append(("kernel cache", _cache()))
    try:
        _backend.check("llvm_ad_rgb")
        variant = "llvm_ad_rgb"
    except BackendError as error:
        variant = "cuda_ad_rgb" if cuda else None
        advice.append(str(error))
    if variant is not None:
        problem = run_self_test(variant)
        rows.append(("self-test", f"{variant}: {problem or 'passed'}"))
        if problem:
            advice.append(f"the self-test on {variant} failed; run {sys.executable} -c '{_code(variant)}'")
    return rows, advice


def run_self_test(variant, seconds=60):
    """Run `self_test` in another process, which may crash; return what went wrong, or an empty text."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", _code(variant)], capture_output=True, text=True, timeout=seconds
        )
    except subprocess.TimeoutExpired:
        return f"no result in {seconds} seconds"
    if done.returncode < 0:
        return f"crashed with {signal.Signals(-done.returncode).name}"
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    return lines[-1] if done.returncode else ""


def self_test(variant):
    """Render a diffuse wall under a directional light, and exit with a line if it is not as it should be.

    At normal incidence L = reflectance * irradiance / pi, in every pixel.
    """
    import math

    import mitsuba as mi

    _backend.activate(variant)
    wall = {"type": "diffuse", "reflectance": {"type": "rgb", "value": REFLECTANCE}}
    light = {"type": "rgb", "value": IRRADIANCE}
    look = mi.ScalarTransform4f().look_at(origin=[0, 0, 1], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "wall": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(10), "bsdf": wall},
        "light": {"type": "directional", "direction": [0, 0, -1], "irradiance": light},
        "sensor": {"type": "perspective", "to_world": look, "film": film},
        "integrator": {"type": "whitted"},
    }
    image = mi.render(mi.load_dict(scene, optimize=False), spp=1).numpy()[..., :3]
    expected = REFLECTANCE * IRRADIANCE / math.pi
    error = float(abs(image / expected - 1).max())
    if not error <= TOLERANCE:
        sys.exit(f"relative error {error:.2g}, {TOLERANCE:.0e} is allowed")


def _code(variant):
    return f'from whitted.cli import doctor; doctor.self_test("{variant}")'


def _fma():
    try:
        flags = Path("/proc/cpuinfo").read_text().split()
    except OSError:
        return "unknown"
    return "yes" if "fma" in flags or platform.machine() == "aarch64" else "no"


def _cache():
    """Return the folder of Dr.Jit's kernel cache, with its size."""
    folder = Path(os.environ.get("DRJIT_CACHE_DIR") or Path.home() / ".drjit")
    files = [path for path in folder.glob("*.bin") if path.is_file()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in files)
    return f"{folder}, {len(files)} kernels, {size / 2**20:.1f} MiB"
