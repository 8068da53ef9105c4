"""Options that subcommands share, as decorators; the letters mean what they do in Mitsuba's command."""

import contextlib
import os
import re
import warnings
from pathlib import Path

import click

from whitted import _backend


def scene(command):
    """Add the argument SCENE, text; `whitted.load` resolves it."""
    return click.argument("scene", metavar="SCENE")(command)


def variant(command):
    """Add ``-m``: the variant is made active before the command runs, and is no argument of it."""

    def activate(ctx, param, value):
        if value is not None and not ctx.resilient_parsing:
            _backend.activate(value)

    return click.option(
        "-m",
        "--variant",
        metavar="VARIANT",
        expose_value=False,
        callback=activate,
        help="Mitsuba variant, llvm_* or cuda_*.  [default: llvm_ad_rgb]",
    )(command)


def sensor(command):
    """Add ``-s``, as the int ``sensor``; `check_sensor` compares it with the scene."""
    return click.option(
        "-s",
        "--sensor",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Index of the sensor.",
    )(command)


def defines(command):
    """Add ``-D``, as the dict ``defines`` of texts."""

    def parse(ctx, param, values):
        found = {}
        for item in values:
            key, equals, value = item.partition("=")
            if not equals or not re.fullmatch(r"\w+", key):
                raise click.BadParameter(f"{item!r} is not of the form key=value.", ctx, param)
            found[key] = value
        return found

    return click.option(
        "-D",
        "--define",
        "defines",
        multiple=True,
        metavar="KEY=VALUE",
        callback=parse,
        help="Set a parameter of the scene; may be repeated.",
    )(command)


def output(*suffixes):
    """Return a decorator that adds ``-o``, as the path ``output`` or None, with one of the suffixes if any
    are given.

    The folder must exist and be writable, so that a mistyped path is found before the work and not after it.
    """

    def check(ctx, param, value):
        if value is None:
            return None
        path = Path(value)
        if path.is_dir():
            raise click.BadParameter(f"{value!r} is a folder; a file is needed.", ctx, param)
        if not path.parent.is_dir():
            raise click.BadParameter(f"the folder {str(path.parent)!r} does not exist.", ctx, param)
        if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
            raise click.BadParameter(f"{value!r} cannot be written.", ctx, param)
        if suffixes and path.suffix.lower() not in suffixes:
            raise click.BadParameter(f"{value!r} does not end in {' or '.join(suffixes)}.", ctx, param)
        return path

    return click.option("-o", "--output", metavar="FILE", callback=check, help="The file to write.")


def threads(command):
    """Add ``-t``: Dr.Jit's threads are set before the command runs, and are no argument of it."""

    def set_count(ctx, param, value):
        if value is not None and not ctx.resilient_parsing:
            import drjit as dr

            dr.set_thread_count(value)

    return click.option(
        "-t",
        "--threads",
        type=click.IntRange(1, 4096),
        expose_value=False,
        callback=set_count,
        help="CPU threads.  [default: all]",
    )(command)


def verbose(command):
    """Add ``-v``: more of Mitsuba's log, and tracebacks; it is no argument of the command."""

    def set_verbose(ctx, param, value):
        if value and not ctx.resilient_parsing:
            import mitsuba as mi

            ctx.ensure_object(dict)["verbose"] = True
            mi.set_log_level(mi.LogLevel.Info)

    return click.option(
        "-v",
        "--verbose",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=set_verbose,
        help="Tell more, with tracebacks.",
    )(command)


@contextlib.contextmanager
def notes():
    """Print what is warned of as one line each on standard error."""

    def show(message, category, filename, lineno, file=None, line=None):
        click.echo(f"whitted: {message}", err=True)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def check_sensor(scene, index):
    """Refuse a sensor index that the `whitted.Scene` does not have.

    Raises:
        click.BadParameter: the index is too large; the line says how many sensors there are.
    """
    count = len(scene.mitsuba.sensors())
    if index >= count:
        have = "one sensor, 0" if count == 1 else f"{count} sensors, 0 to {count - 1}"
        raise click.BadParameter(
            f"{index} is too large: {scene.name} has {have}.", param_hint="'-s' / '--sensor'"
        )
