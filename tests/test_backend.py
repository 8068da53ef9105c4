"""No state of LLVM on the machine may abort the process; where none works, one line says what to install."""

import ctypes.util
from pathlib import Path

import pytest

from whitted import _backend

KERNEL = """
import mitsuba as mi, drjit as dr
_backend.activate("llvm_ad_rgb")
assert dr.minimum(mi.Float(1, 2, 3), dr.arange(mi.Float, 3)).numpy().tolist() == [0, 1, 2]
print("worked", *dr.detail.llvm_version())
"""

# Runs the kernel, or prints one line: as the command does, but without the rest of it.
SCRIPT = (
    """
import sys
from whitted import _backend
from whitted.errors import BackendError
try:
"""
    + KERNEL.replace("\n", "\n    ")
    + """
except BackendError as error:
    sys.exit(str(error))
"""
)

# Where a machine has none of these, the tests of old libraries have no cases.
OLD = ("/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1", "/usr/lib/llvm-14/lib/libLLVM.so")
OLD = [Path(path) for path in OLD if Path(path).exists()]


def refused(done, mitsuba_first=False):
    assert done.returncode == 1
    assert "worked" not in done.stdout
    lines = done.stderr.strip().splitlines()
    if mitsuba_first:
        lines = [line for line in lines if not line.startswith("jit")]  # Dr.Jit wrote before we were there
    assert len(lines) == 1, done.stderr
    assert "pip install karellen-llvm-core" in done.stderr or "DRJIT_LIBLLVM_PATH" in done.stderr
    return done.stderr


def test_the_library_is_found_without_help(python):
    done = python(SCRIPT)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[1]) >= _backend.OLDEST


def test_a_good_library_of_the_user_wins(python):
    library = _backend.find_library().resolve()  # another name of the file that we would choose
    script = "import whitted, os; print(os.environ['DRJIT_LIBLLVM_PATH'])\n" + SCRIPT
    done = python(script, DRJIT_LIBLLVM_PATH=library)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == str(library)


def test_nonsense_of_the_user_is_refused_in_one_line(python, tmp_path):
    text = tmp_path / "libLLVM.so"
    text.write_text("no library")
    for path in ("/nonexistent/libLLVM.so", text, ctypes.util.find_library("m") or "libm.so.6", *OLD):
        line = refused(python(SCRIPT, DRJIT_LIBLLVM_PATH=path))
        assert str(path) in line


def test_an_empty_variable_counts_as_unset(python):
    assert python(SCRIPT, DRJIT_LIBLLVM_PATH="").returncode == 0


@pytest.mark.parametrize("library", [None, *OLD], ids=str)
def test_an_old_or_missing_library_is_refused_before_any_kernel(python, library):
    """As where Dr.Jit finds an old LLVM, or none: mitsuba comes first, and whitted cannot help any more."""
    first = "import mitsuba, os; os.environ.pop('DRJIT_LIBLLVM_PATH', None)\n"
    line = refused(python(first + SCRIPT, DRJIT_LIBLLVM_PATH=library or "/nonexistent"), True)
    assert "import whitted before mitsuba" in line


@pytest.mark.parametrize("library", OLD, ids=str)
def test_an_old_library_on_a_machine_without_a_better_one(python, library):
    script = "import mitsuba\nfrom whitted import _backend\n_backend.find_library = lambda: None\n" + SCRIPT
    assert "pip install karellen-llvm-core" in refused(python(script, DRJIT_LIBLLVM_PATH=library), True)


@pytest.mark.parametrize("library", OLD[:1], ids=str)
def test_an_active_variant_on_an_old_library_is_refused_on_import(python, library):
    script = "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); import whitted"
    done = python(script, DRJIT_LIBLLVM_PATH=library)
    assert done.returncode == 1
    assert "BackendError: LLVM 15" in done.stderr.splitlines()[-1]


def test_other_variants_need_no_llvm(python):
    done = python(
        "import whitted, mitsuba as mi; mi.set_variant('scalar_rgb'); from whitted import _backend\n"
        "_backend.check('cuda_ad_rgb'); print(mi.variant())",
        DRJIT_LIBLLVM_PATH="/nonexistent",
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.strip() == "scalar_rgb"


def test_versions_are_read_from_names(tmp_path):
    expected = {
        "lib/libLLVM-14.so.1": (14,),
        "lib/libLLVM.so.19.1": (19, 1),
        "llvm-18/lib/libLLVM.so": (18,),
        "Cellar/llvm/20.1.3/lib/libLLVM.dylib": (20, 1, 3),
        "opt/llvm@17/lib/libLLVM.dylib": (17,),
    }
    for name, version in expected.items():
        assert _backend._version(tmp_path / name) == version
    assert _backend._version(tmp_path / "lib/libm.so") is None


def test_the_newest_system_library_is_taken(tmp_path, monkeypatch):
    for name in (
        "llvm-9/lib/libLLVM.so",
        "llvm-14/lib/libLLVM.so",
        "llvm-17/lib/libLLVM.so",
        "libLLVM.so.20.1",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "llvm-17/lib/libLLVMSupport.a").touch()
    patterns = ((str(tmp_path), "llvm-*/lib/libLLVM[-.]*"), (str(tmp_path), "libLLVM[-.]*"))
    monkeypatch.setattr(_backend, "SYSTEM_LIBRARIES", patterns)
    assert _backend._system_library() == tmp_path / "libLLVM.so.20.1"
    (tmp_path / "libLLVM.so.20.1").unlink()
    assert _backend._system_library() == tmp_path / "llvm-17/lib/libLLVM.so"
    monkeypatch.setattr(_backend, "SYSTEM_LIBRARIES", ())
    assert _backend._system_library() is None


def test_unknown_scalar_and_unavailable_variants_are_refused(llvm_ad_rgb):
    from whitted.errors import UsageError

    with pytest.raises(UsageError, match="did you mean 'llvm_ad_rgb'"):
        _backend.activate("llvm_ad_rg")
    with pytest.raises(UsageError, match="scalar variants cannot run"):
        _backend.activate("scalar_rgb")
