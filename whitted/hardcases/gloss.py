"""Narrow lobes: Phong's of large exponents, GGX of small roughness, and what is left of the light."""

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.stats import qmc

from whitted import microfacet, optics
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case

FAMILY = "gloss"
LANES = 1 << 15
EXPONENTS = (1e1, 1e2, 1e4, 1e5, 1e6, 1e7, 1e8)


def relative(found, truth):
    """The relative error [N]."""
    return np.float64(np.array(found)) / truth - 1


def interaction(cosine, count=LANES):
    """An interaction of which light comes in, and is sought, at a cosine to the normal, with its ``wi`` as exact."""
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    wi = np.float32([np.sqrt(1 - cosine**2), 0, cosine])
    si.wi = mi.Vector3f(wi)
    si.t, si.n, si.sh_frame = mi.Float(1), mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Vector3f(0, 0, 1))
    return si, np.longdouble(wi)[:, None]


def samples(bsdf, si):
    """Samples of a BSDF at evenly spread numbers, and their weights."""
    u = np.float32(qmc.Sobol(3, scramble=True, seed=47).random(LANES).T)
    u = np.minimum(u, np.float32(1 - U))
    return bsdf.sample(mi.BSDFContext(), si, mi.Float(u[0]), mi.Point2f(u[1:]))


# ---- Phong's exponent


@case(
    "43", FAMILY, unit="relative", sweep=("exponent", EXPONENTS), tolerance=8 * U,
    why="the logarithm by 3 u and the quotient by 2 u, of which the root takes half; the sine of phi, and a product",
    source="LafortuneWillems1994",
)  # fmt: skip
def sampled_angle(n):
    """The sine of the angle that is sampled with the density of cos^n."""
    u, n = np.float32(np.random.default_rng(43).random(LANES)), np.float32(n)
    truth = np.sqrt(-np.expm1(2 * np.log1p(-np.longdouble(u)) / (np.longdouble(n) + 1)))
    some = truth > 0

    def error(form):
        x, y, _ = np.float64(np.array(form(mi.Point2f(mi.Float(u), 0.3), mi.Float(n))))
        return np.hypot(x, y)[some] / truth[some] - 1

    return Errors(error(optics.square_to_power_cosine), error(optics.textbook_square_to_power_cosine))


@case(
    "43", FAMILY, unit="relative", sweep=("exponent", EXPONENTS), tolerance=100 * U,
    why="4 u of an exponent that reaches -20, and as much again of the exponential and its factors",
    source="LafortuneWillems1994",
)  # fmt: skip
def power_of_a_cosine(n):
    """The power cos^n, down to e^-20."""
    n = np.float32(n)
    versine = np.float32(
        -np.expm1(-np.random.default_rng(44).uniform(0, min(20, 5 * n), LANES) / np.float64(n))
    )
    truth = np.exp(np.longdouble(n) * np.log1p(-np.longdouble(versine)))
    stable = optics.power_cosine(mi.Float(versine), mi.Float(n))
    plain = optics.textbook_power_cosine(1 - mi.Float(versine), mi.Float(n))
    return Errors(relative(stable, truth), relative(plain, truth))


# ---- Roughness


@case(
    "44", FAMILY, unit="relative", sweep=("roughness", (1.0, 1e-1, 1e-2, 1e-3, 1e-4)), tolerance=20 * U,
    why="6 u of the squares, the quotient, the sum and the product, squared, and 4 u of the normal's length",
    source="WalterEtAl2007",
)  # fmt: skip
def smooth_ggx(alpha):
    """The density of microscopic normals, at those that it is high for."""
    rng, alpha = np.random.default_rng(44), np.float32(alpha)
    u, phi = rng.uniform(0, 0.99, LANES), rng.uniform(0, 2 * np.pi, LANES)
    tangent = np.float64(alpha) * np.sqrt(u / (1 - u))
    m = np.float32([np.cos(phi) * tangent, np.sin(phi) * tangent, np.ones(LANES)] / np.hypot(1, tangent))
    x, y, z = np.longdouble(m)
    square, a = x * x + y * y + z * z, np.longdouble(alpha)
    truth = square**2 / (np.pi * a**2 * ((x * x + y * y) / a**2 + z * z) ** 2)
    reference = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, mi.Float(alpha), False)
    return Errors(
        relative(microfacet.ggx(mi.Vector3f(m), mi.Float(alpha)), truth),
        relative(microfacet.textbook_ggx(mi.Vector3f(m), mi.Float(alpha)), truth),
        relative(reference.eval(mi.Vector3f(m)), truth),
    )


def smooth_sky():
    """A sky whose radiance is 1 plus a quarter of a direction's coordinates' sum."""
    rows, columns = 64, 128
    theta = np.pi * (np.arange(rows)[:, None] + 0.5) / rows
    phi = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    value = 1 + 0.25 * (np.sin(theta) * (np.cos(phi) + np.sin(phi)) + np.cos(theta))
    return {"type": "envmap", "bitmap": mi.Bitmap(np.float32(np.repeat(value[..., None], 3, axis=2)))}


def picture(bsdf):
    """The picture (``float64``) of a plane under a smooth sky, by ``distribution``."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "sky": smooth_sky(),
            "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(100), "bsdf": bsdf},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0, -2, 2], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent"},
            },
        }
    )
    integrator = mi.load_dict({"type": "distribution", "max_depth": 3})
    return np.array(mi.render(scene, integrator=integrator, spp=16), np.float64)


@case(
    "45", FAMILY, unit="relative", sweep=("roughness", (1e-3, 1e-4)), tolerance=lambda alpha: 10 * alpha,
    why="what the sky changes over a lobe's width, in the mean of 16 samples, and the light lost is less",
    source="WalterEtAl2007",
)  # fmt: skip
def mirror_as_a_limit(alpha):
    """Each pixel of a smooth sky in a rough mirror, against a perfect one."""
    rough = {"type": "roughconductor", "material": "none", "alpha": alpha, "distribution": "ggx"}
    mirror = {"type": "conductor", "material": "none"}
    return Errors(ours=picture(rough) / picture(mirror) - 1)


@case(
    "46", FAMILY, unit="of the bound", sweep=("cosine", (0.9, 0.5, 0.1, 0.01)), tolerance=1,
    why="a direction is off by u, against a width of alpha cos: 4 u / (alpha cos)", source="WalterEtAl2007",
)  # fmt: skip
def density_of_a_sample(cosine):
    """The density reported with a sample, against that of its direction, for lobes of width 1e-4."""
    alpha = 1e-4
    n = np.float32(2 / alpha**2)
    si, wi = interaction(cosine)
    bound = 4 * U / (alpha * cosine)
    phong = mi.load_dict(
        {"type": "phong", "diffuse_reflectance": 0.0, "specular_reflectance": 1.0, "shininess": float(n)}
    )
    bs, _ = samples(phong, si)
    wo, mirror = np.longdouble(np.array(bs.wo)), wi * np.longdouble([[-1], [-1], [1]])
    wo, mirror = (v / np.sqrt((v * v).sum(0)) for v in (wo, mirror))
    versine = ((wo - mirror) ** 2).sum(0) / 2
    truth = (np.longdouble(n) + 1) / (2 * np.pi) * np.exp(np.longdouble(n) * np.log1p(-versine))
    up = (truth > 1e-3) & (wo[2] > 0)
    cos = dr.dot(bs.wo, mi.reflect(si.wi))
    plain = (float(n) + 1) / (2 * np.pi) * optics.textbook_power_cosine(cos, mi.Float(n))

    rough = mi.load_dict(
        {"type": "roughconductor", "material": "none", "alpha": alpha, "distribution": "ggx"}
    )
    other, _ = samples(rough, si)
    again = np.array(rough.pdf(mi.BSDFContext(), si, other.wo), np.float64)
    sampled = np.array(other.pdf, np.float64)
    reached = (sampled > 0) & (np.array(other.wo.z) > 0)
    return Errors(
        relative(bs.pdf, truth)[up] / bound,
        relative(plain, truth)[up] / bound,
        (again[reached] / sampled[reached] - 1) / bound,
    )


# ---- Energy

MITSUBA = {
    "diffuse": {"reflectance": 1.0},
    "conductor": {"material": "none"},
    "dielectric": {},
    "thindielectric": {},
    "roughconductor": {"material": "none", "alpha": 0.3, "distribution": "ggx"},
    "roughdielectric": {"alpha": 0.3, "distribution": "ggx"},
    "plastic": {"diffuse_reflectance": 1.0, "nonlinear": False},
    "roughplastic": {"diffuse_reflectance": 1.0, "alpha": 0.3},
    "principled": {"base_color": 1.0, "roughness": 0.3, "specular": 0.5},
    "principledthin": {"base_color": 1.0, "roughness": 0.3},
}


@case(
    "47", FAMILY, unit="of the light", sweep=("cosine", (1.0, 0.7, 0.3, 0.1, 0.03)), tolerance=1e-3,
    why="no surface may reflect more; the mean of 32768 samples", source="LafortuneWillems1994",
)  # fmt: skip
def furnace_of_samples(cosine):
    """By how much more light than arrives is scattered."""
    si, _ = interaction(cosine)

    def excess(described):
        bs, weight = samples(mi.load_dict(described), si)
        weight = np.array(weight[0] * dr.square(bs.eta), np.float64)  # radiance is denser inside of glass
        return max(np.mean(weight) - 1, 0.0)

    ours = [
        {
            "type": "phong",
            "lobe": lobe,
            "diffuse_reflectance": 1 - ks,
            "specular_reflectance": ks,
            "shininess": n,
        }
        for lobe in ("phong", "blinn")
        for ks, n in ((0.0, 1.0), (0.5, 10.0), (1.0, 1.0), (1.0, 1e3), (1.0, 1e8))
    ]
    theirs = [{"type": name} | parameters for name, parameters in MITSUBA.items()]
    return Errors(ours=[excess(one) for one in ours], reference=[excess(one) for one in theirs])


@case(
    "47", FAMILY, unit="of the light", sweep=("exponent", (1.0, 10.0, 1e3, 1e5, 1e8)), tolerance=1e-3,
    why="k_d + k_s at normal incidence; the mean of 32768 samples", source="Giesen2009",
)  # fmt: skip
def energy_of_phong(n):
    """What Phong's and Blinn's lobes of reflectance 0.3 and 0.6 scatter of light along the normal."""
    si, _ = interaction(1.0)
    errors = []
    for lobe in ("phong", "blinn"):
        reflectances = {"diffuse_reflectance": 0.3, "specular_reflectance": 0.6}
        _, weight = samples(mi.load_dict({"type": "phong", "lobe": lobe, "shininess": n} | reflectances), si)
        errors.append(np.mean(np.array(weight[0], np.float64)) - 0.9)
    return Errors(ours=errors)
