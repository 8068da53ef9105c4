"""Errors that a user can act on: each is one clear line."""

import difflib


class UsageError(Exception):
    """The input is wrong: a missing file, an unknown name, a number out of range. The command exits 2."""


class BackendError(Exception):
    """The machine lacks something, such as a usable LLVM; the line says what to install. The command exits 1."""


def nearest(name, names):
    """Return a clause such as ``; did you mean 'glass'?`` for the closest of ``names``, or say what there is."""
    names = sorted(names)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    if close:
        return "; did you mean " + " or ".join(f"'{c}'" for c in close) + "?"
    return "; there are: " + ", ".join(names) if names else ""
