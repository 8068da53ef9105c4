"""How much lower is the error of `distribution` than that of Mitsuba's integrators at the same kernel seconds?

Mean squared errors, each curve through its measured samples per pixel, at the longest time that all methods have
reached. "best" is the best of Mitsuba's unbiased pairs of integrator and sampler on that scene, `ldsampler` not among
them. A target is met if the lower end of the 95 % interval reaches it. ``--small`` takes minutes, the large size an
hour; what `experiments/soft_shadows.py` and the like have measured is not measured again.
"""

import sys
from pathlib import Path

import numpy as np
import timing

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the measurement is shared with the figures

import comparison

SCENES = ("soft_shadows", "open_floor", "gloss", "translucency", "depth_of_field", "interreflection")
EVEN = 1 / 1.1  # at most 1.1 times worse than the best, where nothing else is asked for
TO_BEST = {"open_floor": 20.0, "soft_shadows": 1.1}
DIRECT, OTHERWISE = 20.0, 5.0  # to the weakest, on scenes of direct light alone and on others
WORST_PIXELS = 0.05


def verdict(ratio, target):
    return f"{'met' if ratio.low >= target else 'MISSED'} (at least {target:.3g})"


def interval(ratio):
    return f"{ratio.value:.3g} [{ratio.low:.3g}, {ratio.high:.3g}]"


def ratios(measured):
    """The rows of the table at equal time."""
    head = ("scene", "integrator", "seconds", "best of Mitsuba", "best / ours [95 %]", "target")
    rows = [(*head, f"{comparison.WEAKEST} / ours", "target")]
    for name, (found, _) in measured.items():
        for ours in (comparison.OURS, comparison.DEFAULTS):
            seconds, best, to_best, to_weakest = comparison.advantages(found, ours)
            targets = TO_BEST.get(name, EVEN), DIRECT if found["depth"] == 2 else OTHERWISE
            row = (name, ours, f"{seconds:.3f}", best, interval(to_best), verdict(to_best, targets[0]))
            rows.append((*row, interval(to_weakest), verdict(to_weakest, targets[1])))
    return rows


def references(measured):
    """The rows of the table on what the errors are taken against."""
    bias_column = "distribution - Mitsuba's [its interval]"
    rows = [("scene", "Mitsuba's side", "variance of the reference / smallest error", bias_column, "tests")]
    for name, (found, _) in measured.items():
        reference = found["reference"]
        share = reference["variance"] / min(
            c.errors.mean(axis=0).min() for c in comparison.curves(found).values()
        )
        text = f"{share:.3f} {'' if 0 <= share < comparison.TENTH else '(MISSED, below 0.1)'}"
        low, high = reference["image"]["interval"]
        bias = f"{100 * reference['image']['value']:+.4f} % [{100 * low:+.4f}, {100 * high:+.4f}]"
        tests = f"{reference['verdict']}, p >= {min(reference['p_value'].values()):.2g}"
        rows.append((name, reference["of"], text, bias, tests))
    return rows


def bias_of(found, label):
    """The mean bias of the renders with the most samples, and its standard error."""
    values = np.array([turn[label][-1][2] for turn in found["turns"]])
    return values.mean(), values.std(ddof=1) / np.sqrt(len(values))


def limits(measured):
    """The rows of the table on where the noise of ours is, and on the bias of the sampler that is left out."""
    worst = f"squared error in the worst {WORST_PIXELS:.0%} of pixels"
    rows = [
        ("scene", "samples of light, gloss, interreflection", worst, "bias of ldsampler, in standard errors")
    ]
    for name, (found, reference) in measured.items():
        error = np.sort(comparison.maps(found, reference)[comparison.OURS]["error"].ravel() ** 2)[::-1]
        share = error[: int(WORST_PIXELS * error.size)].sum() / error.sum()
        bias, deviation = bias_of(found, f"path {comparison.BIASED}")
        samples = ", ".join(str(found["samples"][kind]) for kind in comparison.AUTO)
        rows.append(
            (name, samples, f"{share:.0%}", f"{bias / reference.mean():+.3%}, {bias / deviation:+.1f}")
        )
    return rows


def main():
    size, force = comparison.arguments()
    measured = {name: comparison.measure(name, size, force) for name in SCENES}
    side = comparison.SIZES[size].side
    print(f"{side}x{side}, {comparison.SIZES[size].turns} replicates; {timing.machine()}")
    for rows in (ratios(measured), references(measured), limits(measured)):
        print()
        timing.table(rows)


if __name__ == "__main__":
    main()
