import os
import subprocess
import sys

import pytest

import whitted  # noqa: F401, finds LLVM before a test module loads drjit


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Sums of floats then have one order, and images are the same bits from run to run."""
    import drjit as dr

    dr.set_thread_count(1)


@pytest.fixture(autouse=True)
def llvm_ad_rgb(one_thread):
    import mitsuba as mi

    if mi.variant() != "llvm_ad_rgb":
        mi.set_variant("llvm_ad_rgb")


@pytest.fixture
def python(tmp_path):
    """Run a script in a fresh process, in an empty folder; variables of value None are unset."""

    def run(script, *arguments, **variables):
        environment = {**os.environ, "PYTHONSAFEPATH": "1"}
        environment.pop("DRJIT_LIBLLVM_PATH", None)
        environment.update({name: str(value) for name, value in variables.items() if value is not None})
        command = [sys.executable, "-c", script, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)

    return run
