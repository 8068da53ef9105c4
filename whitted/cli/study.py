"""``whitted study SPEC.toml|NAME -o FOLDER``: a matrix of renders into a database."""

from pathlib import Path

import click

from whitted.cli import options

PARTIAL, FAILED = 3, 2  # exit codes


@click.command("study")
@click.argument("spec", metavar="SPEC.toml|NAME")
@click.option("-o", "--output", "folder", required=True, metavar="FOLDER", help="The study's folder.")
@click.option(
    "--size",
    type=click.Choice(["small", "paper"]),
    default="small",
    show_default=True,
    help="The study's size.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Render on the Dask cluster of this scheduler.")
@click.option(
    "--workers",
    type=click.IntRange(1, 256),
    help="Processes on this machine.  [default: one for each four cores]",
)
@click.option(
    "--time",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Begin no cell after S seconds; the same command goes on.",
)
@click.option(
    "--merge", "others", multiple=True, metavar="FOLDER", help="First take over another store's cells."
)
@click.option("--export", metavar="F.parquet|F.csv", help="Write the finished cells as one table.")
@options.verbose
def command(spec, folder, size, scheduler, workers, time, others, export):
    """Render a study's cells into FOLDER: a SQLite database, and EXR pictures.

    SPEC is a TOML file or the name of a shipped study: soft_shadows, gloss, depth_of_field, whitted_vs_path, samplers.
    The same command goes on after any stop, and renders only what is missing. A cell whose seconds count runs alone.
    Exits with 3 where cells are left because of a signal or --time, with 2 where some failed.
    """
    from whitted.studies import export as table
    from whitted.studies.merging import merge
    from whitted.studies.store import Store
    from whitted.studies.study import study

    if export is not None:
        table.check(Path(export))
    for other in others:
        with Store(other) as source, Store(folder, write=True) as target:
            merge(target, source)
    with _Bar() as report:
        found = study(
            spec, folder, size=size, scheduler=scheduler, workers=workers, time=time, progress=report
        )
    outcome = found.outcome
    for cell, message in outcome.failures:
        place = f"{cell.scene.label}: {cell.method.label}, {cell.spp} spp, replicate {cell.replicate}"
        click.echo(f"whitted: failed: {place}: {message}", err=True)
    for note in outcome.notes:
        click.echo(f"whitted: {note}", err=True)
    if export is not None:
        found.write(export)
    done = outcome.before + outcome.now
    click.echo(f"{folder}: {done} of {outcome.wanted} cells done, {outcome.now} of them now")
    if outcome.outcome == "stopped":
        click.echo("whitted: stopped early; the same command goes on", err=True)
        return PARTIAL
    return FAILED if outcome.failures else 0


class _Bar:
    """A bar on standard error while cells are rendered; silent where that is no terminal."""

    def __enter__(self):
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
        self.bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self.task = self.bar.add_task("references", total=None)
        self.bar.start()
        return lambda done, total, label: self.bar.update(
            self.task, completed=done, total=total, description=label
        )

    def __exit__(self, *error):
        self.bar.stop()
