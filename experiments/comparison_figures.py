"""Figures of a comparison: error against samples and against seconds; pictures with error maps at equal time."""

import shutil
from pathlib import Path

import comparison
import matplotlib
import numpy as np
from comparison import DEFAULTS, OURS, OWN, SAMPLERS

from whitted import tonemap

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DOCS = Path(__file__).parents[1] / "docs" / "images"
COLOURS = dict(
    zip((*SAMPLERS, OWN), ("#999999", "#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#8c5a2b"), strict=True)
)
STYLES = {  # of our own integrators
    OURS: {"color": "black", "marker": "o", "linewidth": 2.2},
    DEFAULTS: {
        "color": "black",
        "marker": "o",
        "linewidth": 1.4,
        "linestyle": "--",
        "markerfacecolor": "white",
    },
    "whitted": {"color": "#d55e00", "marker": "s", "linewidth": 1.4, "linestyle": ":"},
}
DECADES = 2.5  # of an error map


def errors(found, path):
    """Draw mean squared error against samples per pixel and kernel seconds, for each of Mitsuba's integrators."""
    made = comparison.curves(found)
    seconds, *_ = comparison.advantages(found, OURS)
    integrators = list(dict.fromkeys(label.rpartition(" ")[0] for label in comparison.mitsuba_pairs(found)))
    rows, columns = (2, len(integrators)) if len(integrators) > 1 else (1, 2)
    size = (3.5 * columns + 2.4, 3.4 * rows + 0.5)
    figure, axes = plt.subplots(rows, columns, figsize=size, sharey=True, layout="constrained", squeeze=False)
    grid = axes if rows == 2 else axes.T
    for column, integrator in enumerate(integrators):
        for row, name in enumerate(("samples per pixel", "kernel seconds")):
            axis = grid[row, column]
            lines = {label: style for label, style in STYLES.items() if label in made}
            for sampler, colour in COLOURS.items():
                lines[f"{integrator} {sampler}"] = {"color": colour, "marker": ".", "linewidth": 1.3}
            for label, style in lines.items():
                curve = made[label]
                x = curve.spp if row == 0 else curve.costs()
                own = label in STYLES
                _line(
                    axis, x, curve.band(), label if own else label.rpartition(" ")[2], style, 4 if own else 2
                )
            if row == 1:
                axis.axvline(seconds, color="0.6", linewidth=0.8, zorder=0, label="time compared")
            axis.set(xscale="log", yscale="log", xlabel=name)
            if row == 0:
                axis.set_xticks(comparison.SPP[: int(np.log2(axis.get_xlim()[1]) / 2)])
                axis.xaxis.set_major_formatter("{x:.0f}")
            axis.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
            axis.grid(which="major", color="0.9", linewidth=0.6)
            if row == 0 or rows == 1:
                axis.set_title(f"against Mitsuba's {integrator}", fontsize=10)
    for axis in axes[:, 0]:
        axis.set_ylabel("mean squared error")
    handles, labels = grid[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", frameon=False, fontsize=9)
    settings = found["settings"]
    figure.suptitle(
        f"{settings['scene']}, {settings['side']} x {settings['side']}, {len(found['turns'])} replicates, 95 % bands",
        fontsize=11,
    )
    _save(figure, path)


def _line(axis, x, band, label, style, order):
    mean, low, high = band.value, band.low, band.high
    floor = mean[mean > 0].min(initial=np.inf) / 10  # an interval may reach below 0, which has no logarithm
    axis.plot(x, mean, label=label, markersize=4, zorder=order, **style)
    axis.fill_between(
        x, np.maximum(low, floor), high, color=style["color"], alpha=0.18, linewidth=0, zorder=order - 1
    )


def maps(found, reference, path):
    """Draw pictures of some methods at equal time, and below each the root mean square error of its pixels."""
    made = comparison.maps(found, reference)
    seconds, *_ = comparison.advantages(found, OURS)
    size = (2.5 * (len(made) + 1) + 0.9, 5.9)
    figure, axes = plt.subplots(2, len(made) + 1, figsize=size, layout="constrained")
    highest = np.percentile([value["error"] for value in made.values()], 99.5)
    scale = matplotlib.colors.LogNorm(highest / 10**DECADES, highest, clip=True)
    for axis in axes.flat:
        axis.set_axis_off()
    axes[0, 0].imshow(tonemap.tone_map(reference), interpolation="nearest")
    axes[0, 0].set_title("reference", fontsize=10)
    for column, (label, value) in enumerate(made.items(), 1):
        axes[0, column].imshow(tonemap.tone_map(value["picture"]), interpolation="nearest")
        axes[0, column].set_title(f"{label}\n{value['spp']} samples per pixel", fontsize=10)
        shown = axes[1, column].imshow(value["error"], norm=scale, cmap="inferno", interpolation="nearest")
        rms = np.sqrt(np.mean(value["error"] ** 2))
        axes[1, column].set_title(f"RMSE {rms:.2g}", fontsize=10)
    axes[1, 0].text(
        0.5,
        0.5,
        f"{found['settings']['scene']}\n{seconds:.2g} kernel seconds each\n\n"
        "right: root mean\nsquare error of\neach pixel",
        ha="center",
        va="center",
        fontsize=10,
        transform=axes[1, 0].transAxes,
    )
    figure.colorbar(
        shown, ax=axes[1, :], label="error, linear radiance", shrink=0.9, aspect=22, extend="both", pad=0.01
    )
    _save(figure, path)


def _save(figure, path):
    figure.savefig(path, dpi=110)
    plt.close(figure)
    print(path)


def draw(found, reference):
    """Draw all figures of a scene under out/comparison; those of the large size are copied to docs/images."""
    settings = found["settings"]
    for name, make in (
        ("errors", lambda path: errors(found, path)),
        ("maps", lambda path: maps(found, reference, path)),
    ):
        path = comparison.FOLDER / f"{settings['scene']}_{settings['side']}_{name}.png"
        make(path)
        if settings["side"] == comparison.SIZES["large"].side:
            DOCS.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, DOCS / f"{settings['scene']}_{name}.png")


def run(scenes):
    """Measure scenes and draw them, as the command line says."""
    size, force = comparison.arguments()
    for scene in scenes:
        draw(*comparison.measure(scene, size, force))
