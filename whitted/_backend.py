"""Point Dr.Jit at a libLLVM that works, before it looks for one, and refuse those that would crash.

Dr.Jit loads LLVM when ``drjit`` is first imported, from ``DRJIT_LIBLLVM_PATH`` or else the newest file under
``/usr/lib``. It accepts LLVM 15 and 16, and then aborts the whole process in the first kernel that takes a
minimum (``Cannot select: fminimum``). Left out: ``prepare`` judges a library by its name, so a
broken one with a good name is found by ``check``.
"""

import contextlib
import os
import re
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

from whitted.errors import BackendError, UsageError, nearest

OLDEST = 17  # the first LLVM that compiles what Dr.Jit 1.5 emits
DEFAULT_VARIANT = "llvm_ad_rgb"
PACKAGE = "karellen-llvm-core"
VARIABLE = "DRJIT_LIBLLVM_PATH"
SYSTEM_LIBRARIES = (
    ("/usr/lib", "llvm-*/lib/libLLVM[-.]*"),  # Debian, Ubuntu
    ("/usr/lib", "*-linux-gnu/libLLVM[-.]*"),
    ("/usr/lib64", "libLLVM[-.]*"),  # Fedora, openSUSE
    ("/usr/lib64", "llvm*/lib*/libLLVM[-.]*"),
    ("/usr/lib", "libLLVM[-.]*"),  # Arch
    ("/opt/homebrew/opt", "llvm*/lib/libLLVM[-.]*"),
    ("/usr/local/opt", "llvm*/lib/libLLVM[-.]*"),
)


def prepare():
    """Set ``DRJIT_LIBLLVM_PATH`` to the best libLLVM, unless the user has set it or Dr.Jit is loaded."""
    if "drjit" in sys.modules:
        return
    if not os.environ.get(VARIABLE):
        library = find_library()
        if library is not None:
            os.environ[VARIABLE] = str(library)
            return
    with _stderr_held() as held:
        import drjit as dr

        # What Dr.Jit writes where it finds no LLVM is left to `check`: it does not concern CUDA variants.
        held.discard = dr.detail.llvm_version()[0] < 0


def find_library():
    """Return the libLLVM of ``karellen-llvm-core``, else the newest usable one of the system, else None."""
    return _packaged_library() or _system_library()


def check(variant):
    """Refuse an LLVM variant on a machine where its first kernel would fail or abort the process.

    ``variant`` is the name of a Mitsuba variant; those that do not use LLVM always pass.

    Raises:
        BackendError: Dr.Jit has no LLVM, or one older than 17; the line says what to do.
    """
    if not (variant or "").startswith("llvm"):
        return
    import drjit as dr

    version = dr.detail.llvm_version()
    if version[0] < OLDEST:
        raise BackendError(_complaint(version, os.environ.get(VARIABLE), find_library()))


def activate(variant=None):
    """Set a Mitsuba variant on which our plugins can run; by default the active one, else ``llvm_ad_rgb``.

    Raises:
        UsageError: the variant does not exist or is scalar; the line lists the others.
        BackendError: the variant cannot run on this machine.
    """
    import mitsuba as mi

    variant = variant or mi.variant() or DEFAULT_VARIANT
    wavefront = [name for name in mi.variants() if not name.startswith("scalar")]
    if variant not in wavefront:
        why = "scalar variants cannot run our plugins" if variant.startswith("scalar") else "no such variant"
        raise UsageError(f"variant {variant!r}: {why}{nearest(variant, wavefront)}")
    check(variant)
    if variant != mi.variant():
        try:
            mi.set_variant(variant)
        except ImportError as error:
            line = str(error).strip().split("\n")[-1]
            raise BackendError(f"variant {variant!r} cannot run on this machine: {line}") from error


@contextlib.contextmanager
def _stderr_held():
    """Hold back what native code writes to stderr; let it out at the end unless ``discard`` is set."""
    held = SimpleNamespace(discard=False)
    try:
        stderr = os.dup(2)
    except OSError:  # a process without standard error
        yield held
        return
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield held
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            file.seek(0)
            if not held.discard:
                os.write(2, file.read())


def _complaint(version, path, better):
    """Return one line: which LLVM was met, why it does not do, and how to get one that does."""
    if version[0] >= 0:
        found = f"LLVM {'.'.join(map(str, version))} was loaded{f' from {path}' if path else ''}"
    elif path and not os.path.exists(path):
        found = f"{VARIABLE}={path} does not exist"
    elif path:
        found = f"{VARIABLE}={path} does not load as an LLVM that Dr.Jit can use"
    else:
        found = "no LLVM was found"
    line = f"{found}; the llvm_* variants need LLVM {OLDEST} or newer: "
    if better is None or (path and str(better) == path):
        return line + f"pip install {PACKAGE}" + (f" and unset {VARIABLE}" if path else "")
    if path:
        return line + f"unset {VARIABLE}, or set it to {better}"
    return line + f"import whitted before mitsuba and drjit, or set {VARIABLE}={better}"


def _packaged_library():
    """Return the libLLVM that ``karellen-llvm-core`` has put under an installation prefix, or None."""
    name = "libLLVM.dylib" if sys.platform == "darwin" else "libLLVM.so"
    library = Path(sys.prefix, "lib", name)
    if _usable(library):
        return library
    from importlib import metadata  # slow, and needed for an installation elsewhere only

    try:
        distribution = metadata.distribution(PACKAGE)
    except metadata.PackageNotFoundError:
        return None
    for file in distribution.files or []:
        library = Path(distribution.locate_file(file))
        if file.name == name and _usable(library):
            return library.resolve()
    return None


def _system_library():
    """Return the newest usable libLLVM of the system, or None."""
    found = [
        path for folder, pattern in SYSTEM_LIBRARIES for path in Path(folder).glob(pattern) if _usable(path)
    ]
    return max(found, key=_version, default=None)


def _usable(path):
    version = _version(path)
    return version is not None and version >= (OLDEST,) and path.is_file()


def _version(path):
    """Return the version that a library's real name or folder carries, such as (19, 1), or None."""
    real = os.path.realpath(path)
    match = re.search(r"libLLVM(?:-|\.so\.|\.)(\d+(?:\.\d+)*)", Path(real).name) or re.search(
        r"llvm(?:@|-)?/?(\d+(?:\.\d+)*)", str(Path(real).parent)
    )
    return tuple(int(part) for part in match[1].split(".")) if match else None
