"""The command ``whitted``: it finds the subcommand, loads that alone, and turns errors into one line.

Exit codes: 0, 1 and 3 and 4 as each subcommand says; 1 also where the machine lacks something; 2 for usage
errors; 70 for errors of our own; 130 when interrupted.
"""

import importlib
import os
import re
import sys

import click

from whitted.errors import BackendError, UsageError, nearest
from whitted.messages import complaint

SUBCOMMANDS = {
    "render": "Render the picture, with its standard error.",
    "plan": "Say which effects the scene calls for, why, and what each costs.",
    "check": "Test whether two integrators estimate the same image.",
    "compare": "Error metrics between two pictures.",
    "trace": "Draw the ray tree of one pixel.",
    "study": "Render a matrix of settings into a database.",
    "report": "Write a study's findings as one page.",
    "stability": "Run numerically hard cases, each against its truth.",
    "scenes": "List the shipped scenes; print one's XML.",
    "doctor": "Examine LLVM, variants, versions and cache, and test them.",
}


class Subcommands(click.Group):
    """A group whose subcommands are imported when they are called: their one-line helps are above."""

    def list_commands(self, ctx):
        """Return the names in the order of the table."""
        return list(SUBCOMMANDS)

    def get_command(self, ctx, name):
        """Import ``whitted.cli.NAME`` and return its ``command``."""
        if name not in SUBCOMMANDS:
            raise UsageError(f"no such subcommand {name!r}{nearest(name, SUBCOMMANDS)}")
        return importlib.import_module(f"whitted.cli.{name}").command

    def format_commands(self, ctx, formatter):
        """Write the table of subcommands."""
        with formatter.section("Subcommands"):
            formatter.write_dl(list(SUBCOMMANDS.items()))


def _print_version(ctx, param, value):
    if value and not ctx.resilient_parsing:
        from whitted import __version__

        click.echo(f"whitted {__version__}")
        ctx.exit()


@click.group(cls=Subcommands, subcommand_metavar="SUBCOMMAND ...", invoke_without_command=True)
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_version, help="Version."
)
@click.pass_context
def group(ctx):
    """Render Mitsuba scenes with Whitted and distribution ray tracing, measure the error, and prove it.

    SCENE is a path to a Mitsuba XML file or the name of a shipped scene.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


def main(args=None):
    """Run the command line ``args`` (by default the process's own) and exit with its code."""
    settings = {"verbose": False}  # set by -v
    try:
        _log_to_stderr()
        code = group.main(args, prog_name="whitted", standalone_mode=False, obj=settings)
        sys.stdout.flush()
    except Exception as error:
        if settings["verbose"]:
            import traceback

            traceback.print_exc()
        line, code = _explain(error)
        print(f"whitted: {line}", file=sys.stderr)
    except KeyboardInterrupt:
        print("whitted: interrupted", file=sys.stderr)
        code = 130
    sys.exit(code if isinstance(code, int) else 0)


def _explain(error):
    """Return the line and the exit code for an exception."""
    error = _root(error)
    if isinstance(error, click.Abort):
        return "interrupted", 130
    if isinstance(error, click.ClickException):
        command = error.ctx.info_name + ": " if getattr(error, "ctx", None) and error.ctx.parent else ""
        return f"error: {command}{_one_line(error.format_message())}", 2
    if isinstance(error, UsageError):
        return f"error: {_one_line(error)}", 2
    if isinstance(error, BackendError):
        return f"error: {_one_line(error)}", 1
    if isinstance(error, OSError) and error.filename is not None:
        return f"error: {os.fspath(error.filename)!s}: {error.strerror}", 2
    if line := complaint(error):
        return f"error: {line}", 2
    return f"internal error: {type(error).__name__}: {_one_line(error)} (-v shows where)", 70


def _root(error):
    """Return the exception for which Dr.Jit ended a loop or a call."""
    while isinstance(error, RuntimeError) and "encountered an exception" in str(error) and error.__cause__:
        error = error.__cause__
    return error


def _one_line(text):
    return " ".join(str(text).split())


def _log_to_stderr():
    """Send Mitsuba's warnings and errors to standard error: by default they go to standard output."""
    import mitsuba as mi

    class ToStderr(mi.Appender):
        def append(self, level, text):
            text = re.sub(r"^\S+ \S+ \w+ +", "", _one_line(text))  # date, time, level
            print(f"whitted: {level.name.lower()}: {text}", file=sys.stderr)

        def log_progress(self, *progress):
            pass

    logger = mi.logger()
    logger.clear_appenders()
    logger.add_appender(ToStderr())
    mi.set_log_level(mi.LogLevel.Warn)
