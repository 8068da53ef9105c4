"""``whitted render SCENE``: the picture, with its standard error."""

import re
import time
from pathlib import Path

import click

from whitted.cli import options

PARTIAL, NONFINITE = 3, 4  # exit codes


def _parse_crop(ctx, param, value):
    if value is None:
        return None
    if not re.fullmatch(r"\s*\d+\s*(,\s*\d+\s*){3}", value):
        raise click.BadParameter(f"{value!r} is not of the form X,Y,W,H, four whole numbers.", ctx, param)
    return tuple(map(int, value.split(",")))


def _parse_earlier(ctx, param, value):
    if value is not None and not Path(value).is_file():
        raise click.BadParameter(f"there is no file {value!r}.", ctx, param)
    return value


_POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command("render")
@options.scene
@click.option(
    "--integrator", metavar="NAME[:key=value,...]", help="Integrator.  [default: the scene's own if ours]"
)
@click.option("--spp", type=click.IntRange(1, 2**31 - 1), help="Samples per pixel.  [default: the scene's]")
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Seed: the same seed gives the same bits."
)
@click.option(
    "--replicates",
    type=click.IntRange(1, 1024),
    default=1,
    show_default=True,
    help="Independent randomisations that give the error; 1 takes an upper bound from one sequence.",
)
@click.option("--time", "seconds", type=_POSITIVE, metavar="S", help="Stop after S seconds of rendering.")
@click.option(
    "--target-error", type=_POSITIVE, metavar="E", help="Stop at this relative RMSE of the picture."
)
@click.option(
    "--effects", metavar="auto|all|LIST", help="Effects to simulate.  [default: the integrator's, auto]"
)
@click.option("--width", type=click.IntRange(1, 65535), help="Width in pixels; the height follows.")
@click.option("--height", type=click.IntRange(1, 65535), help="Height in pixels; the width follows.")
@click.option("--crop", metavar="X,Y,W,H", callback=_parse_crop, help="Render these pixels only.")
@click.option(
    "--continue",
    "earlier",
    metavar="F",
    callback=_parse_earlier,
    help="Add samples to this picture: --spp more, by default those it lacks, else as many again.",
)
@click.option(
    "--shares",
    type=click.IntRange(4, 1 << 16),
    is_flag=False,
    flag_value=64,
    metavar="[N]",
    help="Also measure which effect makes the noise, with N evaluations, by default 64.",
)
@click.option("--stats", metavar="F.json", help="Write rays, seconds and errors as JSON.")
@click.option(
    "--debug-nonfinite",
    "debug",
    is_flag=True,
    help="Tell for each pixel which term at which surface wasn't finite.",
)
@click.option("--png", is_flag=True, help="Write a PNG too: values above 1 are cut, sRGB transfer function.")
@options.output(".exr")
@options.variant
@options.sensor
@options.defines
@options.threads
@options.verbose
def command(
    scene, integrator, earlier, stats, debug, png, output, sensor, defines, width, height, shares, **settings
):
    """Render SCENE to an EXR file with its standard error; by default NAME.exr in the working folder.

    With --shares it also has the share of each pixel's variance that an effect makes, and with --png their false
    colours are NAME.shares.png. Beside it lie the sums (NAME.moments.npz) with which --continue goes on. Exits with 3
    where the picture is partial (stopped by a signal, or by --time before --spp or --target-error was met), with 4
    where samples that aren't finite were met: these are left out, and told with their cause.
    """
    begin = time.perf_counter()
    import whitted
    from whitted import files, passes, results

    imported = time.perf_counter() - begin
    output = Path(output or earlier or f"{Path(scene).stem}.exr")
    for path in (output, stats):
        if path is not None:
            files.check_writable(path)
    loaded = whitted.load(scene, **defines)
    options.check_sensor(loaded, sensor)
    _resize(loaded.mitsuba.sensors()[sensor], width, height)
    resume = results.Render.read(earlier) if earlier else None
    measured = _measured_shares(loaded, integrator, sensor, shares, settings) if shares else None
    with options.notes():
        found = passes.render(
            loaded,
            integrator,
            spp=settings["spp"],
            time=settings["seconds"],
            target_error=settings["target_error"],
            effects=settings["effects"],
            seed=settings["seed"],
            replicates=settings["replicates"],
            crop=settings["crop"],
            sensor=sensor,
            resume=resume,
            progress=True,
        )
    found.shares = measured
    found.write(output)
    if png:
        from whitted import tonemap

        tonemap.write_png(output.with_suffix(".png"), found.picture().rgb)
        if found.shares:
            tonemap.write_png(output.with_suffix(".shares.png"), found.shares.false_colour())
    if stats is not None:
        facts = found.to_dict()
        facts["seconds"] = {"import": imported} | facts["seconds"]
        results.write_stats(stats, facts)
    click.echo(_summary(found, output))
    if found.shares:
        click.echo(str(found.shares))
    if found.nonfinite:
        _tell_nonfinite(found, debug)
    if found.partial:
        click.echo(f"whitted: stopped early, at {found.spp} samples per pixel; --continue goes on", err=True)
        return PARTIAL
    return NONFINITE if found.nonfinite else 0


def _tell_nonfinite(found, debug):
    """Say how many samples weren't finite, and why as far as it is known."""
    line = f"{found.nonfinite} samples weren't finite and are left out"
    if found.diagnosis:
        causes = ", ".join(f"{cause} ({count})" for cause, count in found.diagnosis.causes.most_common(3))
        line = f"{found.nonfinite} samples of {found.diagnosis.pixels} pixels weren't finite and are left out: {causes}"
    click.echo(f"whitted: {line}", err=True)
    if debug and found.diagnosis:
        click.echo(str(found.diagnosis), err=True)


def _measured_shares(scene, integrator, sensor, evaluations, settings):
    """What makes the noise of one sample, as `whitted.noise.Shares`."""
    from whitted.noise import noise_shares

    return noise_shares(
        scene,
        integrator,
        evaluations=evaluations,
        effects=settings["effects"],
        seed=settings["seed"],
        sensor=sensor,
        crop=settings["crop"],
    )


def _resize(sensor, width, height):
    """Give the film another size; of one number alone, the other follows by the film's proportions."""
    if width is None and height is None:
        return
    from whitted.film import resize

    own = [int(n) for n in sensor.film().size()]
    width = width or max(round(height * own[0] / own[1]), 1)
    height = height or max(round(width * own[1] / own[0]), 1)
    resize(sensor, width, height)


def _summary(found, output):
    """One line: the file, what it holds, what it took."""
    error = found.error["rmse_estimate"]
    quality = "" if error is None else f", standard error {error:.2g}"
    seconds = found.seconds["execute"]
    rays = sum(found.rays.values())
    speed = f", {rays / 1e6:.1f} M rays" if rays else ""
    size = f"{found.window.width}x{found.window.height}"
    return f"{output}: {size}, {found.spp} spp{quality}{speed}, {seconds:.2f} s"
