"""The pictures of the README: ``whitted_1980``, and one scene at 1, 2 and 3 bounces side by side.

``python experiments/figures.py [--force]`` writes them to docs/images; what is there is kept without ``--force``.
Labels are drawn by matplotlib, which the extra ``dev`` brings.
"""

import sys
from pathlib import Path

import whitted
from whitted import tonemap

FOLDER = Path(__file__).parents[1] / "docs" / "images"
HERO = {"width": 640, "height": 480}
HERO_SPP = 256
HERO_DEPTH = 12  # at 8 the mirror ball has a dark spot where it is seen through the shell: chains cut off
PANEL = {"width": 320, "height": 320}
PANEL_SPP = 128
BOUNCES = (1, 2, 3)


def hero(path):
    """Render the first picture."""
    picture = whitted.render(whitted.load("whitted_1980", max_depth=HERO_DEPTH, **HERO), spp=HERO_SPP)
    tonemap.write_png(path, picture.mean)


def bounces(path):
    """Render one scene to increasing depth; a path of ``n`` bounces has ``n + 1`` segments."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scene = whitted.load("whitted_1980", **PANEL)
    figure, axes = plt.subplots(1, len(BOUNCES), figsize=(9.8, 3.5), layout="constrained")
    for axis, count in zip(axes, BOUNCES, strict=True):
        picture = whitted.render(scene, f"whitted:max_depth={count + 1}", spp=PANEL_SPP)
        axis.imshow(tonemap.tone_map(picture.mean), interpolation="antialiased")
        axis.set_axis_off()
        plural = "" if count == 1 else "s"
        axis.set_title(f"{count} bounce{plural} (max_depth={count + 1})", fontsize=11)
    figure.savefig(path, dpi=100)


def main():
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, make in (("whitted_1980.png", hero), ("bounces.png", bounces)):
        path = FOLDER / name
        if not path.exists() or "--force" in sys.argv[1:]:
            make(path)
            print(path)


if __name__ == "__main__":
    main()
