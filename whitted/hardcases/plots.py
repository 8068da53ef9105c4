"""Errors against what is swept, a picture for each family of hard cases."""

import math

import numpy as np

from whitted.errors import UsageError

STYLES = {  # colours of [OkabeIto2008]
    "textbook": {"color": "#d55e00", "marker": "s", "linestyle": "--"},
    "ours": {"color": "#0072b2", "marker": "o", "linestyle": "-"},
    "reference": {"color": "#009e73", "marker": "D", "linestyle": ":"},
}
COLUMNS, SIZE = 3, (4.2, 3.3)  # inches of a panel


def plot(family, results, folder, labels):
    """Write FOLDER/FAMILY.png, a panel for each case that sweeps something; return the path, or None without one.

    Args:
        family: text.
        results: list of `whitted.hardcases.case.Result`.
        folder: ``Path``.
        labels: from the name of each form to how it is called.

    Raises:
        UsageError: matplotlib isn't installed, or the file can't be written.
    """
    pyplot = _pyplot()
    swept = [result for result in results if len(result.points) > 1]
    if not swept:
        return None
    rows = -(-len(swept) // COLUMNS)
    columns = min(COLUMNS, len(swept))
    figure, axes = pyplot.subplots(
        rows, columns, figsize=(SIZE[0] * columns, SIZE[1] * rows), squeeze=False, layout="constrained"
    )
    for axis in axes.flat[len(swept) :]:
        axis.set_visible(False)
    for axis, result in zip(axes.flat, swept, strict=False):
        _panel(axis, result, labels)
    path = folder / f"{family.replace(' ', '_')}.png"
    try:
        figure.savefig(path, dpi=150)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror.lower()}") from error
    finally:
        pyplot.close(figure)
    return path


def _panel(axis, result, labels):
    points = result.points
    x = np.array([point.value for point in points])
    logarithmic = (x > 0).all() and x.max() / x.min() > 20
    for form, style in STYLES.items():
        y = [getattr(point, form) for point in points]
        if any(value is not None for value in y):
            y = np.array([math.nan if value is None else value for value in y])
            axis.plot(x, np.where(np.isfinite(y), y, np.nan), label=labels[form], markersize=4, **style)
            beyond = x[np.isinf(y)]  # at the upper edge
            at_edge = {
                "transform": axis.get_xaxis_transform(),
                "clip_on": False,
                "linestyle": "",
                "marker": "^",
            }
            axis.plot(beyond, np.ones(len(beyond)), color=style["color"], **at_edge)
    axis.plot(x, [point.tolerance for point in points], color="0.4", linewidth=1, label="tolerance")
    positive = [v for point in points for v in (point.ours, point.tolerance) if v and math.isfinite(v)]
    axis.set_yscale("symlog", linthresh=min(positive, default=1.0) / 10)
    axis.set_xscale("log" if logarithmic else "linear")
    axis.set(xlabel=result.case.parameter, ylabel=result.case.unit, title=result.case.name.replace("_", " "))
    axis.grid(linewidth=0.3)
    axis.legend(fontsize=7)


def _pyplot():
    try:
        import matplotlib
    except ImportError as error:
        raise UsageError("plots need the package matplotlib: pip install 'whitted[plot]'") from error
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot
