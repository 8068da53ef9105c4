"""What do replicates cost? Error of 64 samples as one sequence, and as R independent ones of 64 / R samples.

The error is the spread of the picture over seeds, root mean square over pixels, so that no reference is needed. Beside
it stands the error that the render itself reports. Prints a table; the default of one sequence follows from it.
"""

import numpy as np

import whitted

SCENES = {
    "whitted_1980": {},
    "hard_shadows": {},
    "cornell_box": {"integrator": "whitted:max_depth=2"},
}
SPP = 64
REPLICATES = (1, 2, 4, 8, 16)
SEEDS = 24
SIZE = {"width": 128, "height": 128}


def measure(scene, replicates, **settings):
    """Return the true and the reported root mean square error."""
    pictures = [
        whitted.render(scene, spp=SPP, replicates=replicates, seed=seed, **settings) for seed in range(SEEDS)
    ]
    true = np.sqrt(np.mean(np.var([p.mean for p in pictures], axis=0, ddof=1)))
    return true, np.sqrt(np.mean([p.error["rmse_estimate"] ** 2 for p in pictures]))


def main():
    print(
        f"{SPP} spp, {SEEDS} seeds; error relative to that of one sequence (its reported error: an upper bound)"
    )
    print(f"{'scene':14} {'replicates':>10} {'error':>10} {'relative':>9} {'reported / true':>16}")
    for name, settings in SCENES.items():
        scene = whitted.load(name, **SIZE)
        base = None
        for replicates in REPLICATES:
            true, reported = measure(scene, replicates, **settings)
            base = base or true
            print(
                f"{name:14} {replicates:10d} {true:10.2e} {true / base:9.2f} {reported / true:16.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
