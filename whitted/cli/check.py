"""``whitted check SCENE``: do two integrators estimate the same image?"""

import json
import sys

import click

from whitted.cli import options

EXIT = {"agree": 0, "differ": 1, "undecided": 3, "not comparable": 3}


@click.command("check")
@options.scene
@click.option(
    "--integrator",
    metavar="A[:key=value,...]",
    help="The integrator to test.  [default: the scene's own if it is ours]",
)
@click.option(
    "--reference",
    metavar="B[:key=value,...]",
    help="What to test it against.  [default: path or volpath, with A's max_depth]",
)
@click.option("--spp", type=click.IntRange(min=1), help="Samples per pixel of each replicate.")
@click.option(
    "--time",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Seconds of rendering.  [default: as the tolerance needs, at most 300]",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the samples.")
@click.option(
    "--tolerance",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.01,
    show_default=True,
    help="Relative bias that the image may have; a tile may have five times that.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@options.variant
@options.sensor
@options.defines
@options.threads
@options.verbose
def command(scene, integrator, reference, spp, time, seed, tolerance, as_json, sensor, defines):
    """Test whether two integrators estimate the same image of SCENE.

    Exits with 0 where they agree, 1 where they differ, 3 where that is undecided or they are not comparable.
    """
    from whitted.comparison import check
    from whitted.scene import load

    loaded = load(scene, **defines)
    options.check_sensor(loaded, sensor)
    with _Bar() as report:
        found = check(
            loaded,
            integrator,
            reference,
            spp=spp,
            time=time,
            seed=seed,
            tolerance=tolerance,
            sensor=sensor,
            progress=report,
        )
    click.echo(json.dumps(found.to_dict(), indent=2) if as_json else str(found))
    sys.exit(EXIT[found.verdict])


class _Bar:
    """A bar on standard error while replicates are rendered; silent where that is no terminal."""

    def __enter__(self):
        from rich.console import Console
        from rich.progress import Progress

        console = Console(stderr=True)
        self.bar = Progress(console=console, transient=True, disable=not console.is_terminal)
        self.task = self.bar.add_task("replicates", total=None)
        self.bar.start()
        return lambda done, total: self.bar.update(self.task, completed=done, total=total)

    def __exit__(self, *error):
        self.bar.stop()
