"""How far a render is, and a bar that shows it on a terminal."""

from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """The state of a render after a pass.

    Attributes:
        passes: how many there were.
        spp: samples per pixel so far.
        goal: samples per pixel at the end, or None where another limit ends it.
        seconds: wall time so far.
        error: relative root mean square error of the picture as estimated, or None.
        fraction: how much is done by the limit that is nearest, 0 to 1.
    """

    passes: int
    spp: int
    goal: int | None
    seconds: float
    error: float | None
    fraction: float


@contextmanager
def bar(title):
    """Show a progress bar on standard error if that is a terminal; yield the function to call with ``Progress``.

    Where it is no terminal None is yielded, and nothing is shown.
    """
    import sys

    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TextColumn("{task.fields[state]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with RichProgress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(title, total=1.0, state="")

        def report(progress):
            samples = f"pass {progress.passes}: {progress.spp}" + (
                f" of {progress.goal}" if progress.goal else ""
            )
            error = "" if progress.error is None else f", error {100 * progress.error:.2g} %"
            shown.update(task, completed=progress.fraction, state=f"{samples} spp{error}")

        yield report
