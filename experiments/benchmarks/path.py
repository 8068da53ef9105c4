"""How long does `whitted` take, and how noisy is it, against Mitsuba's `path` at the same depth and samples per pixel?

Times are those of the kernels on whitted_1980 (Dr.Jit's `execution_time`, after compilation), the two integrators in
turn. The two don't estimate the same picture (`path` has the light that the shell throws on the floor), so that the
error of each is taken against its own converged picture. Both use a box filter; `path` draws from Mitsuba's independent
sampler, its default, and `whitted` from its own sequence.
"""

import whitted  # noqa: I001, first, since it finds LLVM before drjit looks for one

import mitsuba as mi
import numpy as np
import timing

from whitted.kernels import timed

DEPTH = 8
SIZE = 512
TURNS = 15
TIMED_SPP = (1, 16)
TARGET = 0.8
ERROR_SIZE = 256
ERROR_SPP = 16
REPLICATES = 16
REFERENCE_SPP, PASS_SPP = 2048, 64  # the reference's own noise adds 0.4 % to an error
SIDES = ("whitted", "path")


def load(size):
    """The scene with each integrator, from the scene's own XML."""
    options = {"width": size, "height": size, "max_depth": DEPTH}
    scenes = {side: whitted.load("whitted_1980", integrator=side, **options).mitsuba for side in SIDES}
    return {side: (scene, scene.integrator()) for side, scene in scenes.items()}


def render(scene, integrator, seed, spp):
    return np.array(integrator.render(scene, seed=seed, spp=spp), np.float64)


def measure_times():
    scenes, found = load(SIZE), {}
    for spp in TIMED_SPP:
        seconds = {side: [] for side in SIDES}
        for turn in range(TURNS + 1):
            for side, (scene, integrator) in scenes.items():
                seconds[side].append(timed(render, scene, integrator, turn, spp)[1])
        found[str(spp)] = {side: taken[1:] for side, taken in seconds.items()}  # the first compiles
    return found


def measure_errors():
    """Root mean square errors of single renders, of each side."""
    found = {}
    for side, (scene, integrator) in load(ERROR_SIZE).items():
        passes = REFERENCE_SPP // PASS_SPP
        reference = sum(render(scene, integrator, 1000 + i, PASS_SPP) for i in range(passes)) / passes
        renders = (render(scene, integrator, i, ERROR_SPP) for i in range(REPLICATES))
        found[side] = [float(np.sqrt(np.mean((image - reference) ** 2))) for image in renders]
    return found


def measure():
    mi.set_variant("llvm_ad_rgb")
    return {"seconds": measure_times(), "errors": measure_errors()}


def show(found):
    print(f"whitted_1980, max_depth {DEPTH}; {found['machine']}\n")
    rows = [("", *SIDES, "ratio [95 %]", "target")]
    for spp, seconds in found["seconds"].items():
        label = f"kernels, {SIZE}x{SIZE}, {spp} spp, medians of {len(seconds['path'])}"
        rows.append((label, *row(seconds, 1000, "{:.1f} ms", TARGET)))
    label = f"RMSE, {ERROR_SIZE}x{ERROR_SIZE}, {ERROR_SPP} spp, medians of {len(found['errors']['path'])}"
    rows.append((label, *row(found["errors"], 1, "{:.4f}", 1)))
    timing.table(rows)
    spp = str(ERROR_SPP)
    work = [np.median(found["seconds"][spp][side]) * np.median(found["errors"][side]) ** 2 for side in SIDES]
    print(f"\nTime to the same error (seconds times squared error), ratio: {work[0] / work[1]:.3f}")


def row(values, scale, form, target):
    medians = [form.format(scale * np.median(values[side])) for side in SIDES]
    value, low, high = timing.ratio(*(values[side] for side in SIDES))
    return *medians, f"{value:.2f} [{low:.2f}, {high:.2f}]", timing.verdict(value, target)


if __name__ == "__main__":
    timing.main("path", measure, show)
