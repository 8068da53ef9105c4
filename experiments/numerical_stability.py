"""Error of a hit on a sphere against its distance: the lecture's roots and the stable ones, both in single precision.

The truth is computed in double precision from the same rounded rays. ``--force`` computes anew; the numbers are kept in
out/numerical_stability.json, the figure is docs/images/numerical_stability.png.
"""

import argparse
import json
from pathlib import Path

import whitted

KEPT = Path("out/numerical_stability.json")
FIGURE = Path("docs/images/numerical_stability.png")
DISTANCES = [10 ** (exponent / 4) for exponent in range(2, 25)]  # radii
RAYS = 1 << 15
REACH = 0.9  # of the radius: how far from the centre rays pass at most


def measure():
    """Median and largest errors of the first hit, in radii, of each form at each distance."""
    import mitsuba as mi
    import numpy as np

    from whitted.geometry import sphere

    whitted.load("whitted_1980", width=16)  # sets the variant
    rng = np.random.default_rng(1)
    found = {"textbook": [], "stable": []}
    for distance in DISTANCES:
        target = rng.standard_normal((3, RAYS))
        target[2] = 0
        target *= REACH * np.sqrt(rng.random(RAYS)) / np.linalg.norm(target, axis=0)
        o = np.float32(np.broadcast_to([[0.0], [0.0], [-distance]], target.shape))
        d = target - np.float64(o)
        d = np.float32(d / np.linalg.norm(d, axis=0))
        truth = _truth(np.float64(o), np.float64(d))
        for name, roots in (("textbook", sphere.textbook_roots), ("stable", sphere.roots)):
            error = np.abs(np.array(roots(mi.Vector3f(o), mi.Vector3f(d), 0, 1)[0], np.float64) - truth)
            missed = float(np.mean(np.isnan(error)))
            median, largest = np.nanquantile(error, [0.5, 1.0])
            found[name].append({"median": float(median), "largest": float(largest), "missed": missed})
    return {"distances": DISTANCES, "errors": found}


def _truth(o, d):
    """The first root in double precision, with the discriminant from the closest approach."""
    import numpy as np

    a, b = (d * d).sum(0), -(o * d).sum(0)
    closest = ((o + b / a * d) ** 2).sum(0)
    return (b - np.sqrt(a * (1 - closest))) / a


def plot(found):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4.2), layout="constrained")
    for name, colour, label in (
        ("textbook", "#d55e00", r"$(-B - \sqrt{B^2 - 4AC}) / 2A$"),
        ("stable", "#0072b2", "discriminant from the closest approach"),
    ):
        errors = found["errors"][name]
        axis.plot(found["distances"], [e["median"] for e in errors], color=colour, label=f"{label}, median")
        axis.plot(
            found["distances"],
            [e["largest"] for e in errors],
            "--",
            color=colour,
            label="largest of the hits",
        )
    axis.plot(
        found["distances"],
        [2**-24 * x for x in found["distances"]],
        ":",
        color="0.4",
        label="half an ulp of t",
    )
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="distance of the sphere in radii",
        ylabel="error of the hit in radii",
        title="A ray meets a sphere, in single precision",
    )
    axis.grid(linewidth=0.3)
    axis.legend(fontsize=8)
    figure.savefig(FIGURE, dpi=130)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--force", action="store_true", help="compute anew")
    if parser.parse_args().force or not KEPT.exists():
        KEPT.parent.mkdir(parents=True, exist_ok=True)
        KEPT.write_text(json.dumps(measure(), indent=1) + "\n")
    plot(json.loads(KEPT.read_text()))
    print(FIGURE)


if __name__ == "__main__":
    main()
