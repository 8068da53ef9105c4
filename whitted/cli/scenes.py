"""``whitted scenes [NAME]``: list the shipped scenes, or print the XML of one."""

import sys

import click

from whitted.cli import options


@click.command("scenes")
@click.argument("name", required=False)
@options.verbose
def command(name):
    """List the shipped scenes; with NAME, print the XML of that one."""
    from whitted.scene import shipped, shipped_path

    if name is not None:
        sys.stdout.write(shipped_path(name).read_text(encoding="utf-8"))
        return
    summaries = shipped()
    width = max(map(len, summaries), default=0)
    for scene, summary in summaries.items():
        click.echo(f"{scene:{width}}  {summary}")
