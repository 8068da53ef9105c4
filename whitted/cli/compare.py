"""``whitted compare A.exr B.exr``: error metrics between two pictures."""

import json

import click

from whitted.cli import options
from whitted.errors import UsageError

MEANING = {
    "mse": "mean squared error",
    "rmse": "its root",
    "rel_mse": "relative MSE, epsilon 0.01 mean(B)^2",
    "mae": "mean absolute error",
    "smape": "symmetric relative error, epsilon 0.01 mean(B)",
    "p99": "99 % of the absolute errors are below",
    "psnr": "dB, peak 1",
    "bias": "mean of A - B",
    "rel_bias": "relative to the mean of B",
    "bias_error": "standard error of the bias",
    "unbiased_mse": "MSE less the noise of both; may be negative",
    "nonfinite": "pixels left out, values that are no numbers",
}


@click.command("compare")
@click.argument("a", metavar="A.exr")
@click.argument("b", metavar="B.exr")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@options.verbose
def command(a, b, as_json):
    """Print error metrics of picture A against picture B, with the standard errors that they carry."""
    from whitted import image
    from whitted.stats import metrics

    pictures = [image.read(path) for path in (a, b)]
    if pictures[0].rgb.shape != pictures[1].rgb.shape:
        sizes = " and ".join(
            f"{path} is {p.width}x{p.height}" for path, p in zip((a, b), pictures, strict=True)
        )
        raise UsageError(f"the pictures differ in size: {sizes}")
    try:
        found = metrics.compare(*(p.rgb for p in pictures), *(p.stderr for p in pictures))
    except ValueError as error:
        raise UsageError(f"{a} and {b}: {error}") from error
    if as_json:
        click.echo(json.dumps({"a": a, "b": b, **found.to_dict()}, indent=2))
    else:
        _print(found)


def _print(found):
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None)
    for name, justify in (("metric", "left"), ("value", "right"), ("meaning", "left")):
        table.add_column(name, justify=justify, no_wrap=True)
    for name, meaning in MEANING.items():
        value = getattr(found, name)
        if value is None:
            value, meaning = "-", meaning + " (the pictures carry none)" * (name == "bias_error")
        table.add_row(name, value if isinstance(value, str) else f"{value:.6g}", meaning)
    Console(width=100).print(table)
