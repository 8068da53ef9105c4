"""Where is Mitsuba 3.9.1 wrong, and what does `distribution` say there? Each case against a closed form.

Writes a table, and a figure to out/ and docs/images. What was measured is kept in out/reference_defects.json;
``--force`` measures again, ``--small`` takes a smaller Cornell box and writes no figure to docs/images.
"""

import argparse
import json
import shutil
from pathlib import Path

import defect_scenes
import matplotlib
import mitsuba as mi
import numpy as np
from scipy import stats

from whitted import files

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FOLDER = Path("out")
DOCS = Path(__file__).parents[1] / "docs" / "images"
SMALL = {"side": 24, "spp": 64, "replicates": 4}
COLOURS = {"path": "#d55e00", "direct": "#e69f00", "volpath": "#56b4e9", "distribution": "black"}
PANES = ("null", "mask 0.5", "thin glass")


def measure(small):
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    names = ("small_spheres", "gap_at_light", "contact", "transparent", "blends", "hidden", "film_sums")
    found = {name: getattr(defect_scenes, name)() for name in names}
    found["correlations"] = defect_scenes.correlations()
    return found | {"cornell_means": defect_scenes.cornell_means(**(SMALL if small else {}))}


def worst(found, name, relative):
    """The largest error of one integrator, absolute or relative, and the x where it is."""
    truth = np.array(found["truth"])
    errors = np.abs(np.array(found[name]) - truth) / (truth if relative else 1)
    return errors.max(), found["x"][int(errors.argmax())]


def table(found):
    """Print the largest error of each integrator in each case."""
    what = {
        "small_spheres": ("ball light of radius / distance x: radiance of the floor", True),
        "gap_at_light": ("blocker at x of 10 before a point light: light that passes", False),
        "contact": ("widest gap at distance x from the origin that lets light pass", False),
        "transparent": (f"light behind {', '.join(PANES)} (x = 0, 1, 2): what passes", False),
        "blends": ("blend of mirror and diffuse, weight x: radiance", True),
        "hidden": ("ball behind a hidden light at x of the way: radiance", True),
        "film_sums": ("sky of one radiance, x samples in one pass: radiance", True),
    }
    for name, (words, relative) in what.items():
        print(f"{words}; largest {'relative ' if relative else ''}error")
        for integrator in COLOURS:
            if integrator in found[name]:
                error, x = worst(found[name], integrator, relative)
                print(f"  {integrator:14} {error:9.2g}  at x = {x:.2g}")
    print("largest correlation of two of the first eight numbers of a sample; truth 0")
    for name, value in found["correlations"].items():
        print(f"  {name:14} {value:9.4f}")
    print(
        "Cornell box, 8 segments, mean of the picture relative to path with the samplers but ldsampler [95 %]"
    )
    for label, (value, half) in cornell(found).items():
        print(f"  {label:18} {100 * value:+.3f} % +- {100 * half:.3f}")


def cornell(found):
    """Return each mean relative to that of `path` with all samplers but `ldsampler`, and half its 95 % interval."""
    values = np.array(list(found["cornell_means"].values()))
    labels, count = list(found["cornell_means"]), values.shape[1]
    means, errors = values.mean(axis=1), values.std(axis=1, ddof=1) / np.sqrt(count)
    chosen = [label.startswith("path") and "ldsampler" not in label for label in labels]
    truth = np.average(means[chosen], weights=1 / errors[chosen] ** 2)
    half = stats.t.ppf(0.975, count - 1) * errors / truth
    return dict(zip(labels, zip(means / truth - 1, half, strict=True), strict=True))


def lines(axis, found, change=lambda y, truth: y, **style):
    """Draw one line for each integrator."""
    for name, colour in COLOURS.items():
        if name in found:
            y = change(np.array(found[name]), np.array(found["truth"]))
            own = name == "distribution"
            marker = (
                {"marker": "o", "markersize": 4, "zorder": 3}
                if own
                else {"marker": "x", "markersize": 8, "zorder": 4}
            )
            axis.plot(found["x"], y, color=colour, label=name, **marker, linewidth=1.4, **style)


def draw(found, path):
    """Draw a panel for each case."""
    figure, axes = plt.subplots(2, 4, figsize=(15.5, 7.3), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.12)
    axes = axes.ravel()

    lines(axes[0], found["small_spheres"], lambda y, truth: np.abs(y / truth - 1) + 1e-8)
    axes[0].set(xscale="log", yscale="log", ylim=(3e-9, 10), xlabel="radius / distance")
    axes[0].set(title="small ball light", ylabel="relative error of the radiance, plus 1e-8")
    lines(axes[1], found["gap_at_light"])
    axes[1].set(
        xscale="log", xlabel="distance of the blocker from the light", ylabel="share of light that passes"
    )
    axes[1].set(title="blocker before a light at 10; truth 0")
    lines(axes[2], found["contact"])
    axes[2].set_xscale("symlog", linthresh=10, linscale=0.6)
    axes[2].set_yscale("symlog", linthresh=1e-5, linscale=0.4)
    axes[2].set(ylim=(-1e-5, 30), title="contact shadow; truth 0", xlabel="distance from the origin")
    axes[2].set_ylabel("widest gap that leaks")
    lines(axes[4], found["blends"], lambda y, truth: y / truth - 1)
    axes[4].set(
        title="blend of mirror and diffuse", xlabel="weight of the diffuse one", ylabel="relative error"
    )
    lines(axes[5], found["hidden"], lambda y, truth: y / truth)
    axes[5].set(title="ball behind a hidden light", xlabel="share of the way", ylabel="radiance / truth")
    _bars(axes[3], found["transparent"])
    _cornell(axes[6], cornell(found))
    _correlations(axes[7], found["correlations"])
    for axis in axes:
        axis.title.set_fontsize(11)
        axis.grid(color="0.92", linewidth=0.6)
        axis.set_axisbelow(True)
    figure.legend(*_entries(axes), loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    print(path)


def _entries(axes):
    """Handles and labels of all panels, each label once."""
    found = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)


def _bars(axis, found):
    names = [name for name in COLOURS if name in found]
    for number, name in enumerate(names):
        x = np.arange(len(PANES)) + 0.27 * (number - 1)
        axis.bar(x, found[name], 0.24, color=COLOURS[name])
        for at, value in zip(x, found[name], strict=True):
            if value == 0:
                axis.text(at, 0.01, "0", color=COLOURS[name], ha="center")
    for number, truth in enumerate(found["truth"]):
        axis.plot([number - 0.45, number + 0.45], [truth, truth], color="#009e73", linewidth=2, label="truth")
    axis.set_xticks(range(len(PANES)), PANES)
    axis.set(title="point light behind a pane", ylabel="share of light that passes", ylim=(0, 1.1))


def _cornell(axis, means):
    for number, (label, (value, half)) in enumerate(means.items()):
        colour = COLOURS["distribution" if label == "distribution" else "path"]
        axis.errorbar(100 * value, number, xerr=100 * half, color=colour, marker="o", capsize=3)
    axis.axvline(0, color="#009e73", linewidth=1.5, zorder=0)
    axis.set_yticks(range(len(means)), means, fontsize=9)
    axis.invert_yaxis()
    axis.set(title="Cornell box, 95 % intervals", xlabel="mean against the unbiased samplers, %")


def _correlations(axis, found):
    axis.barh(range(len(found)), list(found.values()), color="0.6")
    axis.set_yticks(range(len(found)), found, fontsize=9)
    axis.invert_yaxis()
    axis.set(title="samplers; truth 0", xlabel="largest correlation, first 8 numbers")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--force", action="store_true", help="measure again")
    parser.add_argument("--small", action="store_true", help="a smaller Cornell box")
    chosen = parser.parse_args()
    name = "reference_defects_small" if chosen.small else "reference_defects"
    kept = FOLDER / f"{name}.json"
    if chosen.force or not kept.exists():
        FOLDER.mkdir(exist_ok=True)
        files.write(kept, json.dumps(measure(chosen.small), indent=1) + "\n")
    found = json.loads(kept.read_text())
    table(found)
    draw(found, FOLDER / f"{name}.png")
    if not chosen.small:
        DOCS.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(FOLDER / f"{name}.png", DOCS / f"{name}.png")


if __name__ == "__main__":
    main()
