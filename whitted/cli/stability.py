"""``whitted stability``: the hard cases, each against its truth."""

import json
from contextlib import contextmanager
from pathlib import Path

import click

from whitted.cli import options
from whitted.errors import UsageError

BROKEN = 1  # exit code
WIDTH = 132  # of the table


@click.command("stability")
@click.option("--only", metavar="FAMILY|CASE", help="Run one family of cases, or one case.")
@click.option(
    "--plot",
    "folder",
    type=Path,
    metavar="FOLDER",
    help="Plot the errors against what is swept, one PNG for each family.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@options.verbose
def command(only, folder, as_json):
    """Run numerically hard cases, each against its truth: a closed form, or a computation of higher precision.

    The table has the worst error of the formula as textbooks write it, of ours, and of Mitsuba's own where it has one,
    each with the value of what is swept, and the tolerance. Exits with 1 where ours misses one.
    """
    from whitted.hardcases.run import stability

    if folder is not None and not folder.is_dir():
        raise UsageError(f"--plot {folder}: no such folder")
    with _status() as progress:
        found = stability(only, progress=progress)
    if folder is not None:
        for path in found.plot(folder):
            click.echo(f"whitted: wrote {path}", err=True)
    if as_json:
        click.echo(json.dumps(found.to_dict(), indent=2))
    else:
        _print(found)
    return 0 if found.holds else BROKEN


@contextmanager
def _status():
    """Show on a terminal's standard error which case runs; yield the function to call with its name."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with console.status("hard cases") as status:
        yield status.update


def _print(found):
    from rich.console import Console
    from rich.table import Table

    from whitted.hardcases.run import LABELS

    console = Console(width=WIDTH, highlight=False)
    families = dict.fromkeys(result.case.family for result in found.results)
    for family in families:
        table = Table(title=family, title_justify="left", box=None, pad_edge=False, expand=True)
        table.add_column("number", max_width=7)
        table.add_column("case, and what is asked", ratio=1)
        for name in (*LABELS.values(), "tolerance"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("", min_width=6)
        for result in found.results:
            if result.case.family == family:
                table.add_row(*_row(result))
        console.print(table)
        console.print()
    if found.forms:
        console.print(_forms(found.forms))
        console.print()
    console.print(_summary(found))


def _row(result):
    """The texts of a case's row."""
    from whitted.hardcases.run import shown_tolerance

    case = result.case
    asks = f"{case.asks} ({case.unit})" if case.unit else case.asks
    verdict = "holds" if result.holds() else "[bold red]broken[/]"
    errors = [_error(result, form) for form in ("textbook", "ours", "reference")]
    return case.number, f"{case.name}\n[dim]{asks}[/]", *errors, shown_tolerance(result), verdict


def _error(result, form):
    """The worst error of a form, with where that was."""
    from whitted.hardcases.run import shown

    point, error = result.worst(form), shown(result, form)
    if point is None:
        return error
    if not result.holds(form):
        error = f"[red]{error}[/]"
    return error if point.value is None else f"{error} [dim]@ {point.value:g}[/]"


def _forms(forms):
    """The table of what stable forms cost and gain."""
    from rich.table import Table

    table = Table(
        title="textbook and stable forms", title_justify="left", box=None, pad_edge=False, expand=True
    )
    for name in ("what is computed", "precision"):
        table.add_column(name)
    for name in ("textbook", "stable", "time", "digits, textbook", "digits, stable"):
        table.add_column(name, justify="right", no_wrap=True)
    for cost in forms:
        ratio = cost.stable_ns / cost.textbook_ns
        times = f"{cost.textbook_ns:.2g} ns", f"{cost.stable_ns:.2g} ns", f"x {ratio:.2f}"
        digits = f"{cost.textbook_digits:.1f}", f"{cost.stable_digits:.1f}"
        table.add_row(cost.pair, cost.precision, *times, *digits)
    return table


def _summary(found):
    """What came of it, in words."""
    held = sum(bool(result.holds()) for result in found.results)
    lines = [f"{held} of {len(found.results)} cases hold"]
    if broken := len(found.broken_by_textbook):
        lines[0] += f"; the textbook form misses the tolerance of {broken} that ours holds"
    missed = sum(result.holds("reference") is False for result in found.results)
    if missed:
        lines[0] += f", Mitsuba that of {missed}"
    regime = found.regime
    lines.append(
        f"Mitsuba {regime['mitsuba']} moves the origin of a ray off a surface by {regime['offset_at_0']:.3g} at 0, by"
        f" {regime['offset_at_1000']:.3g} at a distance of 1000"
    )
    return "\n".join(lines)
