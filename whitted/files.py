"""Files that are whole or absent: written beside their place, flushed to disk, then renamed.

An interrupted or failed write leaves the old file as it was. Every failure is a ``UsageError`` of one line
that names the path and the cause.
"""

import contextlib
import os
import secrets
import stat
from pathlib import Path

from whitted.errors import UsageError


def read(path):
    """Return the ``bytes`` of a file.

    Raises:
        UsageError: there is no such file, or it can't be read.
    """
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {path}: {_cause(error)}") from error


def write(path, data):
    """Put ``data`` (``bytes``, or ``str`` as UTF-8) at ``path``, in one step for whoever reads it.

    The temporary file lies in the same folder, named ``.whitted-*.tmp``. Links are followed and an old file's
    permissions are kept. Devices and pipes, such as ``/dev/stdout``, are written directly.

    Raises:
        UsageError: the folder is missing or read-only, ``path`` is a folder, the disk is full, ...
    """
    data = data.encode() if isinstance(data, str) else data
    target, mode = _target(path)
    try:
        if mode is not None and not stat.S_ISREG(mode):
            with open(target, "wb") as file:
                file.write(data)
            return
        temporary = _temporary(target)
        try:
            with open(temporary, "xb") as file:
                if mode is not None:
                    os.fchmod(file.fileno(), stat.S_IMODE(mode))
                file.write(data)
                file.flush()
                os.fsync(file.fileno())  # a full disk may show only here
            os.replace(temporary, target)
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        _sync_folder(target.parent)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {_cause(error)}") from error


def check_writable(path):
    """Find out whether ``write(path, ...)`` would work, before the hours of work whose result it takes.

    A disk that fills up later is not foreseen.

    Raises:
        UsageError: as ``write``.
    """
    target, mode = _target(path)
    if mode is not None and not stat.S_ISREG(mode):
        return
    temporary = _temporary(target)
    try:
        with open(temporary, "xb"):
            pass
        temporary.unlink()
    except OSError as error:
        raise UsageError(f"cannot write {path}: {_cause(error)}") from error


def _target(path):
    """Return the path with its links followed, and the mode of what is there now, or None."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        mode = None
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot write {path}: {_cause(error)}") from error
    if mode is not None and stat.S_ISDIR(mode):
        raise UsageError(f"cannot write {path}: it is a folder")
    if mode is not None and not stat.S_ISREG(mode):
        return Path(path), mode
    target = Path(os.path.realpath(path))
    if mode is not None and not os.access(
        target, os.W_OK, effective_ids=os.access in os.supports_effective_ids
    ):
        raise UsageError(f"cannot write {path}: the file there is read-only")
    if not target.parent.is_dir():
        folder = os.path.dirname(path) or target.parent
        raise UsageError(f"cannot write {path}: the folder {folder} does not exist")
    return target, mode


def _temporary(target):
    return target.with_name(f".whitted-{secrets.token_hex(6)}.tmp")


def _sync_folder(folder):
    """Make a rename last through a power cut, on file systems that let a folder be flushed."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _cause(error):
    return (getattr(error, "strerror", None) or str(error)).lower()
