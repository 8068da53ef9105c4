"""Values and sums: enormous and tiny radiance, values that are no numbers, long sums, weights that cancel, seeds."""

import itertools

import mitsuba as mi
import numpy as np

import whitted
from whitted import replicates
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.statistics import textbook_variance
from whitted.hardcases.walls import DIRECT, MOMENT, SIDE, by_path, eye, papered, wall
from whitted.stats.moments import LEAST_WEIGHT

FAMILY = "values and sums"
SMALLEST = 2.0**-126  # normal number: smaller ones count as 0
WIDE = ("mitchell", "catmullrom", "lanczos")  # filters with negative lobes


# ---- Radiance


@case(
    "83, R11", FAMILY,
    sweep=("radiance", (1e-30, 1e10, 1e20, 1e30, 2e38)), tolerance=2 * U,
    why="the picture is rounded to single precision, that of radiance 1 too", source="ChanGolubLeVeque1983",
)  # fmt: skip
def enormous_radiance(radiance):
    """The mean and its standard error at the edge of a bright wall, over the radiance, against those of radiance 1."""
    radiance = np.float64(np.float32(radiance))
    found, expected = (
        whitted.render(wall(float(value), size=0.53), DIRECT, spp=64) for value in (radiance, 1.0)
    )
    ours = np.inf
    if found.standard_error is not None:
        pairs = (found.mean, expected.mean), (found.standard_error, expected.standard_error)
        ours = np.array([a / radiance - b for a, b in pairs])
    halves = np.arange(64) % 2
    plain = textbook_variance(np.float32(radiance * halves)) / radiance**2 - halves.var(ddof=1)
    square = by_path(wall(float(radiance)), 64, MOMENT)[..., -3:]
    return Errors(ours=ours, textbook=plain, reference=square[..., 1] / radiance**2 - 1)


@case(
    "83", FAMILY, unit="of the bound",
    sweep=("reflectance of each mirror", (1e-15, 1e-18, 1e-19, 1e-20, 1e-22)), tolerance=1,
    why="4 roundings, or what is below the smallest normal number, 1.2e-38, which counts as 0", source="Higham2002",
)  # fmt: skip
def denormal_throughput(reflectance):
    """The sky of radiance 1 in two dark mirrors."""
    reflectance = np.float64(np.float32(reflectance))
    metal = {
        "type": "conductor",
        "material": "none",
        "specular_reflectance": {"type": "spectrum", "value": float(reflectance)},
    }
    mirrors = {
        f"mirror{k}": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().look_at(o, to, up),
            "bsdf": metal,
        }
        for k, (o, to, up) in enumerate(
            [([0, 0, 2], [1, 0, 1], [0, 1, 0]), ([2, 0, 2], [1, 1, 2], [0, 0, 1])]
        )
    }
    sensor = eye(4, "box") | {"fov": 10.0}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, "sky": {"type": "constant"}, **mirrors})
    found = whitted.render(scene, DIRECT | {"max_depth": 4, "effects": "reflection"}, spp=8)
    truth = reflectance**2
    return Errors(ours=(found.mean - truth) / max(4 * U * truth, SMALLEST))


@case(
    "83", FAMILY, unit="pixels and samples",
    sweep=("0: NaN, 1: infinity", (0.0, 1.0)), tolerance=0,
    why="samples that aren't finite are left out and counted", source="the radiance of the wall, 1",
)  # fmt: skip
def one_bad_texel(which):
    """How many pixels a texel spoils beside its own, and how many of its samples aren't counted."""
    texels = np.ones((SIDE, SIDE))
    texels[5, 9] = (np.nan, np.inf)[int(which)]
    scene = papered(texels, rfilter="gaussian")
    found = whitted.render(scene, DIRECT, spp=16)
    reference = by_path(scene, 16)
    spoilt = [np.sum(~(np.abs(image - 1) < 1e-5).all(-1)) for image in (found.mean, reference)]
    return Errors(ours=max(spoilt[0] - 1, 0) + abs(found.nonfinite - 16), reference=max(spoilt[1] - 1, 0))


# ---- Sums


@case(
    "84", FAMILY,
    sweep=("samples", (2.0**14, 2.0**17, 2.0**20)), tolerance=2 * U,
    why="sums of n numbers are right to n 2^-53; the mean is rounded", source="Higham2002",
)  # fmt: skip
def long_sum(count):
    """The mean of many samples of 0.1, relative."""
    scene, truth, count = wall(0.1, side=1), np.float64(np.float32(0.1)), int(count)
    running = np.cumsum(np.full(count, np.float32(0.1)), dtype=np.float32)[-1] / np.float32(count)
    ours, reference = whitted.render(scene, DIRECT, spp=count).mean, by_path(scene, count)
    return Errors(*(np.float64(mean) / truth - 1 for mean in (ours, running, reference)))


@case(
    "84", FAMILY,
    sweep=("samples per pixel", (1.0, 2.0)), tolerance=2 * U,
    why="the mean is rounded, whatever the weights, which are summed up in double precision",
    source="MitchellNetravali1988",
)  # fmt: skip
def constant_through_negative_lobes(spp):
    """A wall of radiance 0.1 through filters whose weights may cancel, relative."""
    truth, errors = np.float64(np.float32(0.1)), []
    for rfilter in WIDE:
        scene = wall(0.1, side=64, rfilter=rfilter)
        errors.append([whitted.render(scene, DIRECT, spp=int(spp)).mean, by_path(scene, int(spp))])
    ours, reference = np.array(errors).swapaxes(0, 1) / truth - 1
    return Errors(ours=ours, reference=reference)


def _largest_sum(rfilter):
    """The largest sum of magnitudes that the weights of one sample in each pixel can have."""
    reach = int(np.ceil(rfilter.radius() - 0.5))
    x = np.linspace(-0.5, 0.5, 257) + np.arange(-reach, reach + 1)[:, None]
    values = np.abs(rfilter.eval(mi.Float(np.float32(x.ravel())))).reshape(x.shape)
    return values.max(axis=1).sum() ** 2


@case(
    "84", FAMILY, unit="of the bound", tolerance=1,
    why="half the sum of the weights' magnitudes over the least weight that is divided by",
    source="MitchellNetravali1988",
)  # fmt: skip
def noise_through_negative_lobes():
    """How far from 1/2 pixels of one sample are that see a wall of zeros and ones."""
    texels = np.random.default_rng(84).integers(0, 2, (512, 512))
    errors = []
    for rfilter in WIDE:
        scene = papered(texels, 128, rfilter)
        bound = 0.5 * _largest_sum(scene.sensors()[0].film().rfilter()) / LEAST_WEIGHT
        found = whitted.render(scene, DIRECT, spp=1)
        plain = found.moments.sums[0, ..., :3] / found.moments.weights[0, ..., None]
        errors.append([np.abs(image - 0.5).max() / bound for image in (found.mean, plain, by_path(scene, 1))])
    return Errors(*np.max(errors, axis=0))


# ---- Seeds


def _patterns(seed, pixels, spp):
    """The strata of the samples of each pixel, a set, of a stratified sampler with this seed."""
    sampler = mi.load_dict({"type": replicates.SAMPLER, "sample_count": spp})
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, pixels * spp)
    strata = np.int32(np.float64(sampler.next_2d()) * spp)
    return {pattern.tobytes() for pattern in strata.reshape(2, pixels, spp).transpose(1, 0, 2)}


@case(
    "R8", FAMILY, unit="pixels",
    sweep=("samples per pixel", (64.0, 144.0, 256.0)), tolerance=2,
    why="of 4096^2 pairs of hashes of 32 bits 0.004 meet by chance in a pair of pictures", source="Kensler2013",
)  # fmt: skip
def seeds_of_replicates(spp):
    """How many pixels of two of eight pictures have one pattern of strata, seeds being multiples of spp, or ours."""
    spp, found = int(spp), []
    for seeds in (replicates.seeds(0, 0, 8), range(0, 8 * spp, spp)):
        patterns = [_patterns(seed, 4096, spp) for seed in seeds]
        found.append(max(len(a & b) for a, b in itertools.combinations(patterns, 2)))
    return Errors(*found)


# ---- Clipping


@case(
    "R9", FAMILY,
    sweep=("distance", (1e1, 2e4, 1e9)), tolerance=0,
    why="the ball fills the view, and nothing is computed from its distance", source="the radiance of the ball, 1",
)  # fmt: skip
def ball_beyond_the_far_plane(distance):
    """A ball of light that fills the view, between clip planes that hold it; by Mitsuba with those that are preset."""
    light = {"type": "area", "radiance": 1.0}
    ball = {"type": "sphere", "center": [0, 0, distance], "radius": distance / 2, "light": light}
    clipped, whole = (
        mi.load_dict({"type": "scene", "sensor": eye(4, "box", **clip) | {"fov": 10.0}, "ball": ball})
        for clip in ({}, {"near_clip": distance / 10, "far_clip": distance * 2})
    )
    return Errors(ours=whitted.render(whole, DIRECT, spp=8).mean - 1, reference=by_path(clipped, 8) - 1)
