"""Figures of a study for papers: error against seconds and samples with 95 % bands, and noise shares, as PDF and PNG.

``python experiments/study_figures.py FOLDER [OUTPUT]`` reads a study's folder (``whitted study NAME -o FOLDER``), or
makes that of ``soft_shadows`` in out/studies where none is named; files go to OUTPUT, by default FOLDER/figures. The
numbers are those of ``whitted report``.
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

import whitted
from whitted.reports.plots import DASHES, EFFECTS, PALETTE
from whitted.studies.analysis import analyse
from whitted.studies.store import Store

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DEFAULT = Path("out/studies/soft_shadows")
SIZE = (3.4, 2.7)  # inches of a panel: one column of a paper
MARKERS = "osD^Px*h"
LINES = {
    "solid": "-",
    "dash": "--",
    "dot": ":",
    "dashdot": "-.",
    "longdash": (0, (8, 3)),
    "longdashdot": (0, (8, 3, 1, 3)),
}
STYLE = {"font.size": 8, "axes.linewidth": 0.6, "pdf.fonttype": 42, "legend.frameon": False}


def errors(scene, styles):
    """Return the figure of a scene's root mean square errors, against seconds where they are known, and samples."""
    timed = all(ladder.seconds is not None for ladder in scene.ladders.values())
    names = (["kernel seconds"] if timed else []) + ["samples per pixel"]
    figure, axes = plt.subplots(
        1,
        len(names),
        figsize=(SIZE[0] * len(names), SIZE[1]),
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for axis, name in zip(axes[0], names, strict=True):
        for label, ladder in scene.ladders.items():
            x = ladder.spp if name == "samples per pixel" else ladder.curve.costs()
            band = ladder.curve_of_samples.band()
            value, low, high = (np.sqrt(np.maximum(v, 0)) for v in (band.value, band.low, band.high))
            shown = value > 0
            axis.fill_between(
                x[shown], low[shown], high[shown], color=styles[label]["color"], alpha=0.2, linewidth=0
            )
            axis.plot(x[shown], value[shown], label=label, markersize=3.5, linewidth=1.1, **styles[label])
        axis.axhline(np.sqrt(scene.reference["variance"]), color="0.5", linewidth=0.7, linestyle=":")
        axis.set(xscale="log", yscale="log", xlabel=name)
        axis.grid(linewidth=0.3)
    axes[0, 0].set_ylabel("RMSE")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=7)
    return figure


def shares(scene):
    """Return the figure of what makes the noise of each method, or None where that wasn't measured."""
    if not scene.shares:
        return None
    figure, axis = plt.subplots(figsize=(2 * SIZE[0], 0.8 + 0.25 * len(scene.shares)), layout="constrained")
    left = np.zeros(len(scene.shares))
    for effect, colour in EFFECTS.items():
        rows = [[row["first"] for row in found if row["effect"] == effect] for found in scene.shares.values()]
        width = np.array([max(row[0], 0) if row else 0 for row in rows])
        if effect == "interaction":
            width = np.maximum(1 - left, 0)
        if width.any():
            axis.barh(list(scene.shares), width, left=left, color=colour, label=effect)
            left += width
    axis.set(xlim=(0, 1), xlabel="share of the variance")
    axis.invert_yaxis()
    figure.legend(loc="outside upper center", ncols=5, fontsize=7)
    return figure


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT
    if len(sys.argv) < 2:
        folder.parent.mkdir(parents=True, exist_ok=True)
        whitted.study(folder.name, folder)
    output = Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "figures"
    output.mkdir(parents=True, exist_ok=True)
    with Store(folder) as store:
        scenes = analyse(store)
    labels = dict.fromkeys(label for scene in scenes for label in scene.ladders)
    styles = {
        label: {
            "color": PALETTE[i % len(PALETTE)],
            "linestyle": LINES[DASHES[i % len(DASHES)]],
            "marker": MARKERS[i % len(MARKERS)],
        }
        for i, label in enumerate(labels)
    }
    plt.rcParams.update(STYLE)
    for scene in scenes:
        for name, figure in (("errors", errors(scene, styles)), ("shares", shares(scene))):
            if figure is None:
                continue
            for suffix in ("pdf", "png"):
                path = output / f"{scene.label}_{name}.{suffix}"
                figure.savefig(path, dpi=200)
                print(path)
            plt.close(figure)


if __name__ == "__main__":
    main()
