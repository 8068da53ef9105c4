"""``whitted plan SCENE``: which effects the scene calls for and why, what each costs."""

import json

import click

from whitted.cli import options
from whitted.cli.check import EXIT


@click.command("plan")
@options.scene
@click.option(
    "--integrator", metavar="NAME[:key=value,...]", help="Integrator.  [default: the scene's own if ours]"
)
@click.option("--verify", is_flag=True, help="Check the picture against the one with all effects.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@options.variant
@options.sensor
@options.defines
@options.threads
@options.verbose
def command(scene, integrator, verify, as_json, sensor, defines):
    """Say which effects SCENE calls for, with the evidence, the numbers that one sample draws for each, the
    operations that it adds to the kernel, and its share of the kernel's time.

    With --verify the picture with these effects is checked against the one with all: it exits with 0 where they
    agree, 1 where they differ, 3 where that is undecided.
    """
    import whitted
    from whitted import planning

    loaded = whitted.load(scene, **defines)
    options.check_sensor(loaded, sensor)
    with options.notes():
        found = planning.plan(loaded, integrator, sensor=sensor)
    agreement = planning.verify(loaded, integrator, sensor=sensor) if verify else None
    if as_json:
        facts = found.to_dict() | ({"verify": agreement.to_dict()} if verify else {})
        click.echo(json.dumps(facts, indent=2))
    else:
        click.echo(str(found) + (f"\n{agreement}" if verify else ""))
    return EXIT[agreement.verdict] if verify else 0
