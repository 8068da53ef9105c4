"""The equations of glass: critical and grazing angles, indices near 1 and far from it, slabs, absorption.

Ours are those of `whitted.optics`; what a picture shows of glass is what Mitsuba's BSDFs say, the reference here.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import optics
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case

FAMILY = "reflection and refraction"
LANES = 1 << 15
GLASS = np.float32(1.5)
OF_R, OF_T = 20 * U, 12 * U  # the roundings of `optics.fresnel`, relative

FRESNEL = (
    "g by 1.5 u, differences by 2 u, four sums and products, of which three are squared: 20 u in R, 12 u in T"
)
REFRACTION = (
    "the sine has 8 roundings, which tan of the refracted angle carries into the cosine: 8 u (1 + tan)"
)


def exact(cos, eta):
    """R and T of Fresnel's equations, ``longdouble`` [N]; 1 and 0 where all is reflected."""
    cos, eta = np.longdouble(cos), np.longdouble(eta)
    g = np.sqrt(np.maximum(eta**2 - (1 - cos) * (1 + cos), 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        r_s = (1 - eta) * (1 + eta) / (cos + g) ** 2
        r_p = (eta - 1) * (eta + 1) * ((eta**2 + 1) * cos**2 - 1) / (eta**2 * cos + g) ** 2
        T = 2 * g * cos * (1 / (cos + g) ** 2 + eta**2 / (eta**2 * cos + g) ** 2)
    total = (g == 0) | (cos == 0)
    return np.where(total, eta != 1, (r_s**2 + r_p**2) / 2), np.where(total, eta == 1, T)


def relative(found, truth):
    """The relative error [N]; where the truth is 0, the absolute one."""
    return (np.float64(np.array(found)) - truth) / np.where(truth == 0, 1, truth)


def shares(cos, eta):
    """R and T by ours, the textbook's form and Mitsuba's, three pairs."""
    cos, eta = mi.Float(cos), mi.Float(eta)
    R = mi.fresnel(cos, eta)[0]
    return optics.fresnel(cos, eta), optics.textbook_fresnel(cos, eta), (R, 1 - R)


def uniform(lower, upper, seed):
    """Numbers in single precision [N]."""
    return np.float32(np.random.default_rng(seed).uniform(lower, upper, LANES))


def incident(angle, seed):
    """Unit vectors at some angles (``float64`` [N]) to unit normals of all directions: d and n (``float32`` [3, N])."""
    rng = np.random.default_rng(seed)
    n = rng.standard_normal((3, LANES))
    n /= np.linalg.norm(n, axis=0)
    along = np.cross(n, rng.standard_normal((3, LANES)), axis=0)
    along /= np.linalg.norm(along, axis=0)
    return np.float32(along * np.sin(angle) - n * np.cos(angle)), np.float32(n)


def refracted(d, n, eta):
    """The refracted direction and the tangent of its angle, ``longdouble``."""
    d, n, eta = np.longdouble(d), np.longdouble(n), np.longdouble(eta)
    d, n = (v / np.sqrt((v * v).sum(0)) for v in (d, n))
    m = np.cross(n, d, axis=0)
    sine, below = np.sqrt((m * m).sum(0)), np.sqrt(eta**2 - (m * m).sum(0))
    return (np.cross(m, n, axis=0) - n * below) / eta, sine / below


def refraction_errors(d, n, eta):
    """The errors of the refracted directions, of the bound 8 u (1 + tan)."""
    truth, tangent = refracted(d, n, eta)
    vectors = mi.Vector3f(d), mi.Vector3f(n)
    _, cos_t, _, eta_ti = mi.fresnel(-dr.dot(*vectors), mi.Float(eta))
    found = (
        optics.refract(*vectors, mi.Float(eta)),
        optics.textbook_refract(*vectors, mi.Float(eta)),
        mi.refract(-vectors[0], mi.Normal3f(vectors[1]), cos_t, eta_ti),
    )
    bound = np.float64(8 * U * (1 + tangent))
    return Errors(*(np.linalg.norm(np.float64(np.array(v)) - truth, axis=0) / bound for v in found))


# ---- The critical angle


@case(
    "29", FAMILY, unit="of the bound", sweep=("distance", (1e-1, 1e-3, 1e-5, 1e-7)), tolerance=1,
    why="what R changes when the cosine does by an ulp, and 20 u of the formula", source="BornWolf1999",
)  # fmt: skip
def critical_angle(distance):
    """The reflected share R out of glass where the cosine is a share e below and above that of the critical angle."""
    eta = uniform(0.3, 0.95, 29)
    critical = np.sqrt((1 - np.float64(eta)) * (1 + np.float64(eta)))
    cos = np.float32(np.concatenate([critical * (1 - distance), critical * (1 + distance)]))
    eta = np.concatenate([eta, eta])
    R, _ = exact(cos, eta)
    neighbours = [exact(np.nextafter(cos, np.float32(end)), eta)[0] for end in (0, 1)]
    bound = np.maximum(*(np.abs(other - R) for other in neighbours)) + OF_R
    return Errors(*((np.float64(np.array(found)) - R) / bound for found, _ in shares(cos, eta)))


@case(
    "29", FAMILY, unit="of the rays", tolerance=0,
    why="eta^2 + cos^2 - 1 is rounded once", source="BornWolf1999",
)  # fmt: skip
def total_reflection():
    """Whether all is reflected, where the cosine is within 16 ulp of that of the critical angle."""
    eta = uniform(0.3, 0.95, 30)
    critical = np.float32(np.sqrt((1 - np.float64(eta)) * (1 + np.float64(eta))))
    cos = np.float32(critical + np.spacing(critical) * np.random.default_rng(1).integers(-16, 17, LANES))
    expected = exact(cos, eta)[1] == 0
    (_, T), (textbook, _), _ = shares(cos, eta)
    found = T == 0, dr.isnan(textbook), mi.fresnel(mi.Float(cos), mi.Float(eta))[1] == 0
    return Errors(*(np.mean(np.array(total) != expected) for total in found))


@case(
    "29", FAMILY, unit="of the bound", sweep=("distance", (1e-1, 1e-2, 1e-3, 1e-4)), tolerance=1,
    why=REFRACTION, source="BornWolf1999",
)  # fmt: skip
def refraction_near_the_critical_angle(distance):
    """The direction out of glass where the sine is a share e below that of the critical angle."""
    eta = uniform(0.3, 0.95, 31)
    return refraction_errors(*incident(np.arcsin(eta * np.float64(1 - distance)), 29), eta)


@case(
    "29", FAMILY, unit="of the bound", sweep=("angle", (1.5, 0.1, 1e-3, 1e-5, 0.0)), tolerance=1,
    why=REFRACTION, source="BornWolf1999",
)  # fmt: skip
def refraction_near_the_normal(angle):
    """The direction into glass."""
    return refraction_errors(*incident(np.full(LANES, angle), 32), GLASS)


@case(
    "32", FAMILY, unit="of the bound", sweep=("eta", (1e-3, 1e-2, 1e-1, 1e1, 1e3, 1e6)), tolerance=1,
    why=REFRACTION, source="BornWolf1999",
)  # fmt: skip
def refraction_at_extreme_indices(eta):
    """The direction at a surface of relative index eta, up to 0.99 of the sine of the critical angle."""
    angle = np.random.default_rng(33).uniform(0, np.arcsin(0.99 * min(eta, 1)), LANES)
    return refraction_errors(*incident(angle, 33), np.float32(eta))


# ---- Fresnel's shares


@case(
    "30", FAMILY, unit="relative", sweep=("cosine", (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)), tolerance=OF_T,
    why=FRESNEL + "; in half of the lanes by less than 1 u", source="BornWolf1999",
)  # fmt: skip
def grazing_transmission(cosine):
    """The transmitted share T = 1 - R into glass near grazing incidence; at a cosine of 0 it is 0."""
    cos = uniform(0.9 * cosine, cosine, 30)
    _, T = exact(cos, GLASS)
    return Errors(*(relative(found, T) for _, found in shares(cos, GLASS)))


@case(
    "31", FAMILY, unit="relative", sweep=("contrast", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 0.0)), tolerance=OF_R,
    why=FRESNEL, source="BornWolf1999",
)  # fmt: skip
def hardly_any_contrast(contrast):
    """The reflected share R up to 85 degrees where the index is 1 + e; at 1 it is 0."""
    cos, eta = np.cos(np.radians(uniform(0, 85, 31))), np.float32(1 + contrast)
    R, _ = exact(cos, eta)
    return Errors(*(relative(found, R) for found, _ in shares(cos, eta)))


@case(
    "32", FAMILY, unit="relative", sweep=("eta", (1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6)), tolerance=OF_T,
    why=FRESNEL, source="BornWolf1999",
)  # fmt: skip
def transmission_at_extreme_indices(eta):
    """The transmitted share near normal incidence, 4 eta / (eta + 1)^2 along the normal."""
    sine = min(eta, 1) * np.random.default_rng(32).uniform(0, 0.9, LANES)
    cos = np.float32(np.sqrt((1 - sine) * (1 + sine)))
    _, T = exact(cos, np.float32(eta))
    return Errors(*(relative(found, T)[T > 0] for _, found in shares(cos, np.float32(eta))))


@case(
    "32", FAMILY, unit="of R", sweep=("eta", (1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6)), tolerance=1e-7,
    why="R is 1 - T, a rounding", source="BornWolf1999",
)  # fmt: skip
def reflection_at_extreme_indices(eta):
    """The reflected share along the normal, ((eta - 1) / (eta + 1))^2."""
    eta = np.float32(eta)
    R, _ = exact(np.float32(1), eta)
    return Errors(*(np.float64(np.array(found)) - R for found, _ in shares(1, eta)))


@case(
    "33", FAMILY, unit="of the amplitude", sweep=("eta", (1 / 1.5, 1.0001, 1.5, 4.0, 100.0)), tolerance=4 * U,
    why="the difference that vanishes is rounded once, the products in it by 2 u, its factor is at most 1",
    source="BornWolf1999",
)  # fmt: skip
def brewsters_angle(eta):
    """The reflected amplitude of light polarised in the plane of incidence, within 16 ulp of Brewster's angle."""
    eta = np.float32(eta)
    cos = np.float32(np.cos(np.arctan(np.float64(eta))) * (1 + U * np.arange(-32, 33, 2)))
    c, e = np.longdouble(cos), np.longdouble(eta)
    below = np.sqrt(1 - (1 - c) * (1 + c) / e**2)
    truth = (e * c - below) / (e * c + below)
    forms = optics.amplitudes, optics.textbook_amplitudes
    return Errors(*(np.float64(np.array(form(mi.Float(cos), mi.Float(eta))[1])) - truth for form in forms))


# ---- Slabs and absorption


@case(
    "35", FAMILY, unit="relative", sweep=("cosine", (1.0, 0.5, 1e-1, 1e-2, 1e-4, 1e-6)), tolerance=4 * OF_T,
    why="T twice, of 12 u each, and as much in the sum R (1 - a) + T, and ten further roundings",
    source="the geometric series",
)  # fmt: skip
def slab_at_a_grazing_angle(cosine):
    """What a clear slab of glass transmits, all reflections inside added up: (1 - R) / (1 + R)."""
    cos = uniform(0.9 * cosine, cosine, 35)
    R, T = exact(cos, GLASS)
    forms = optics.slab, optics.textbook_slab
    return Errors(
        *(relative(form(mi.Float(cos), mi.Float(GLASS), mi.Float(0))[1], T / (1 + R)) for form in forms)
    )


@case(
    "35", FAMILY, unit="relative", sweep=("depth", (1e-8, 1e-6, 1e-4, 1e-2, 1.0, 10.0)),
    tolerance=lambda x: 4 * OF_T + x * U,
    why="T twice, of 12 u each, and as much in the sum R (1 - a) + T, ten further roundings, and u x of the exponent",
    source="the geometric series",
)  # fmt: skip
def absorbing_slab(depth):
    """What a slab of glass transmits that absorbs, at cosines from 0.01 to 0.001."""
    cos, depth = uniform(1e-3, 1e-2, 36), np.float32(depth)
    R, T = exact(cos, GLASS)
    x = np.longdouble(depth)
    truth = T**2 * np.exp(-x) / ((T - R * np.expm1(-x)) * (1 + R * np.exp(-x)))
    forms = optics.slab, optics.textbook_slab
    return Errors(
        *(relative(form(mi.Float(cos), mi.Float(GLASS), mi.Float(depth))[1], truth) for form in forms)
    )


@case(
    "39", FAMILY, unit="relative", sweep=("depth", (1e-30, 1e-6, 1e-3, 0.1, 1.0, 10.0)), tolerance=8 * U,
    why="2 exp(x/2) sinh(x/2): each to 2 u, and a product", source="Beer's law",
)  # fmt: skip
def absorbed_share(depth):
    """The share 1 - exp(-x) that a medium of optical depth x absorbs."""
    x = uniform(0.9 * depth, depth, 39)
    truth = -np.expm1(-np.longdouble(x))
    return Errors(
        *(relative(form(mi.Float(x)), truth) for form in (optics.absorbed, optics.textbook_absorbed))
    )


@case(
    "39", FAMILY, unit="relative", sweep=("depth", (1e-6, 1.0, 10.0, 80.0)), tolerance=2 * U,
    why="an ulp of the exponential", source="Beer's law",
)  # fmt: skip
def transmitted_share(depth):
    """The share exp(-x) that passes."""
    x = uniform(0.9 * depth, depth, 40)
    return Errors(relative(dr.exp(mi.Float(-x)), np.exp(-np.longdouble(x))))


@case(
    "39", FAMILY, unit="relative", sweep=("depth", (0.1, 1.0, 10.0)), tolerance=lambda x: 50 * U * (1 + x),
    why="50 u of the factors, and of the sum of depths x", source="Beer's law",
)  # fmt: skip
def absorbing_segments(depth):
    """The share that passes 50 segments of optical depth x together: by the sum of depths, and factor by factor."""
    x = np.float32(depth / 25 * np.random.default_rng(41).random((50, LANES // 8)))
    truth = np.exp(-np.longdouble(x).sum(0))
    total, product = mi.Float(0), mi.Float(1)
    for segment in x:
        total += mi.Float(segment)
        product *= dr.exp(-mi.Float(segment))
    return Errors(relative(dr.exp(-total), truth), relative(product, truth))
