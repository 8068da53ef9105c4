"""Denormal numbers count as zero while kernels run on the thread that asks for them, as on Dr.Jit's own threads.

Dr.Jit's threads flush denormals; where there is one thread, kernels run on the caller's, which may not. That changes
the last bits of a picture. The state is reached through the C library's ``fegetenv``. Left out: machines other than
x86-64 with glibc, where nothing is done.
"""

import ctypes
import platform
from contextlib import contextmanager
from functools import cache

FLUSH = 0x8040  # of MXCSR: denormal results are zero, denormal operands too
WORDS, MXCSR = 8, 7  # of glibc's fenv_t on x86-64


@contextmanager
def flushed():
    """Flush denormals to zero on this thread for a while; also a decorator. Nothing between may leave the thread."""
    library = _library()
    if library is None:
        yield
        return
    environment = (ctypes.c_uint32 * WORDS)()
    library.fegetenv(environment)
    before = environment[MXCSR] & FLUSH
    _set(library, FLUSH)
    try:
        yield
    finally:
        _set(library, before)


def _set(library, bits):
    environment = (ctypes.c_uint32 * WORDS)()
    library.fegetenv(environment)
    environment[MXCSR] = environment[MXCSR] & ~FLUSH | bits
    library.fesetenv(environment)


@cache
def _library():
    if platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc":
        return None
    return ctypes.CDLL("libm.so.6")
