"""How much of a render's time goes into tracing its rays?

On `interreflection` the kernel of `distribution` is compared with that of a bare loop, which traces rays of the same
kinds from the same pixels, and does hardly anything else: eye rays, at each surface a ray to the light and one in a
random direction; no BSDF and no emitter is asked. The nearer the times for one ray, the less is to be gained by
anything but fewer or better rays.
"""

import whitted  # noqa: I001, first, since it finds LLVM before drjit looks for one

import drjit as dr
import mitsuba as mi
import numpy as np
import timing

from whitted.kernels import timed

SCENE, SIDE, SPP, TURNS = "interreflection", 256, 64, 9
LIGHT = (0.3, 1.9, 0.6)  # of the spot


def bare(scene, seed, depth):
    """Trace the rays of each lane; return how many, and how many of them went to the light unhindered."""
    lanes = SIDE * SIDE * SPP
    random = mi.PCG32(lanes, initstate=seed)
    pixel = dr.arange(mi.UInt32, lanes) // SPP
    x, y = pixel % SIDE, pixel // SIDE
    position = (mi.Point2f(x, y) + mi.Point2f(random.next_float32(), random.next_float32())) / SIDE
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.0, position, mi.Point2f(0.5))

    def step(number, active, ray, rays, lit, random):
        si = scene.ray_intersect(ray, active)
        rays += dr.select(active, mi.UInt32(1), 0)
        active &= si.is_valid() & (number + 1 < depth)
        free = ~scene.ray_test(si.spawn_ray_to(mi.Point3f(LIGHT)), active)
        lit += dr.select(active & free, mi.UInt32(1), 0)  # else the compiler would leave the ray out
        rays += dr.select(active, mi.UInt32(1), 0)
        d = mi.warp.square_to_cosine_hemisphere(mi.Point2f(random.next_float32(), random.next_float32()))
        return number + 1, active, si.spawn_ray(si.to_world(d)), rays, lit, random

    state = (mi.UInt32(0), mi.Bool(True), mi.Ray3f(ray), mi.UInt32(0), mi.UInt32(0), random)
    return dr.while_loop(state, lambda number, active, *_: active, step, label="bare")[3:5]


def render(scene, integrator, seed):
    return integrator.render(scene, seed=seed, spp=SPP)


def measure():
    mi.set_variant("llvm_ad_rgb")
    loaded = whitted.load(SCENE, width=SIDE, height=SIDE)
    scene, depth = loaded.mitsuba, int(loaded.mitsuba.integrator().max_depth)
    sides = {
        "distribution": mi.load_dict({"type": "distribution", "max_depth": depth}),
        "path": mi.load_dict({"type": "path", "max_depth": depth}),
    }
    ours = sides["distribution"]
    sides["distribution"] = ours.fixed(ours.plan(ours.world(scene), scene.sensors()[0]))
    limit = dr.opaque(mi.UInt32, depth)
    seconds = {name: [] for name in (*sides, "bare")}
    for turn in range(TURNS + 1):
        for name, integrator in sides.items():
            seconds[name].append(timed(render, scene, integrator, turn)[1])
        (count, _), taken = timed(bare, scene, dr.opaque(mi.UInt64, turn), limit)
        seconds["bare"].append(taken)
    rays = {"bare": int(np.sum(count.numpy(), dtype=np.int64))}
    rays["distribution"] = sum(whitted.render(loaded, sides["distribution"], spp=SPP).rays.values())
    return {"seconds": {name: taken[1:] for name, taken in seconds.items()}, "rays": rays}


def show(found):
    print(f"{found['machine']}; {SCENE}, {SIDE}x{SIDE}, {SPP} samples, medians of {TURNS}\n")
    rows = [("", "rays in millions", "seconds", "ns per ray", "time to that of bare rays [95 %]")]
    for name, seconds in found["seconds"].items():
        rays, median = found["rays"].get(name), np.median(seconds)
        value, low, high = timing.ratio(seconds, found["seconds"]["bare"])
        counted = (f"{rays / 1e6:.1f}", f"{1e9 * median / rays:.1f}") if rays else ("", "")
        rows.append((name, counted[0], f"{median:.3f}", counted[1], f"{value:.2f} [{low:.2f}, {high:.2f}]"))
    timing.table(rows)


if __name__ == "__main__":
    timing.main("rays", measure, show)
