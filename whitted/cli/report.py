"""``whitted report FOLDER -o F.html``: a study's findings as one page."""

import click

from whitted.cli import options


@click.command("report")
@click.argument("folder", metavar="FOLDER")
@options.output(".html", ".htm")
@click.option(
    "--error",
    "errors",
    multiple=True,
    type=click.FloatRange(0, min_open=True),
    metavar="E",
    help="Also tell the cheapest setting of this relative RMSE; may be repeated.",
)
@options.verbose
def command(folder, output, errors):
    """Write a study's report: one HTML file with plots, tables and pictures, which needs no network.

    By default it is FOLDER.html in the working folder.
    """
    from pathlib import Path

    from whitted.reports import page

    output = output or Path(f"{Path(folder).resolve().name}.html")
    page.write(folder, output, errors)
    click.echo(f"{output}: {output.stat().st_size / 1e6:.1f} MB")
