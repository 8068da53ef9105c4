"""``whitted trace SCENE --pixel X,Y``: the ray tree of one pixel, as text, JSON and a drawing."""

import re

import click

from whitted.cli import options


def _parse_pixel(ctx, param, value):
    if not re.fullmatch(r"\s*-?\d+\s*,\s*-?\d+\s*", value):
        raise click.BadParameter(f"{value!r} is not of the form X,Y, two whole numbers.", ctx, param)
    return tuple(map(int, value.split(",")))


@click.command("trace")
@options.scene
@click.option(
    "--pixel",
    required=True,
    metavar="X,Y",
    callback=_parse_pixel,
    help="The pixel: column and row, counted from 0 at the upper left.",
)
@click.option("--integrator", metavar="NAME[:key=value,...]", help="Integrator.  [default: the scene's own]")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the random numbers.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON in place of text.")
@options.output(".svg")
@options.sensor
@options.defines
@options.variant
@options.verbose
def command(scene, pixel, integrator, seed, as_json, output, sensor, defines):
    """Trace one sample of a pixel, and print its ray tree; with -o FILE.svg, draw it too.

    The letters are those of the rays: E from the eye, R reflection, T transmission, S shadow.
    """
    import whitted
    from whitted import drawing, files, specification, words

    loaded = whitted.load(scene, **defines)
    options.check_sensor(loaded, sensor)
    _check_pixel(loaded, sensor, pixel)
    chosen, note = specification.integrator(integrator, loaded.mitsuba)
    if note:
        click.echo(f"whitted: {note}", err=True)
    tree = whitted.trace(loaded, pixel, integrator=chosen, seed=seed, sensor=sensor)
    if output is not None:
        files.write(output, drawing.to_svg(tree))
    if as_json:
        import json

        click.echo(json.dumps(tree.to_dict(), indent=1))
    else:
        click.echo(words.to_text(tree))


def _check_pixel(scene, sensor, pixel):
    """Refuse a pixel outside the film; the line says what is inside."""
    width, height = scene.mitsuba.sensors()[sensor].film().size()
    if not (0 <= pixel[0] < width and 0 <= pixel[1] < height):
        x, y = pixel
        inside = f"X is 0 to {width - 1}, Y is 0 to {height - 1}"
        raise click.BadParameter(f"{x},{y} is outside the film: {inside}.", param_hint="'--pixel'")
