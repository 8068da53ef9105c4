"""What a Whitted tree gives up is estimated without bias, and with an honest error.

Seeds are fixed. Had they been drawn at random, each test here would fail for correct code with the probability that
its docstring names.
"""

import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from whitted_scenes import camera, transform

import whitted

SEEDS = [100003 * k + 7 for k in range(48)]
DEEP = 24


def glass_room():
    """Two glass balls before a mirror under lights without extent: a deep tree, and no noise but the pixel's."""

    def ball(x, radius, **glass):
        return {
            "type": "sphere",
            "center": [x, radius, 0],
            "radius": radius,
            "bsdf": {"type": "dielectric", **glass},
        }

    floor = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.6, 0.4]}}
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": camera(),
            "floor": {
                "type": "rectangle",
                "to_world": transform().rotate([1, 0, 0], -90).scale(3),
                "bsdf": {"type": "twosided", "nested": floor},
            },
            "mirror": {
                "type": "rectangle",
                "to_world": transform().translate([0, 1, -1.2]).scale(2),
                "bsdf": {"type": "conductor", "specular_reflectance": 0.9},
            },
            "left": ball(-0.7, 0.6),
            "right": ball(0.7, 0.6, int_ior=1.8),
            "point": {"type": "point", "position": [1, 3, 2], "intensity": 8.0},
            "sky": {"type": "constant", "radiance": 0.3},
        },
        optimize=False,
    )


def luminance(image):
    return image.astype(np.float64) @ [0.212671, 0.715160, 0.072169]


def rendered(scene, seed, max_depth, min_contribution, spp=16):
    integrator = {"type": "whitted", "max_depth": max_depth, "min_contribution": min_contribution}
    return whitted.render(scene, integrator, spp=spp, seed=seed)


ACCOUNTS = {"by_depth": (3, 0.0), "by_cutoff": (DEEP, 0.05)}


@pytest.fixture(scope="module")
def losses():
    """By account: the losses claimed, their claimed errors, the maps of the loss, and what was truly lost."""
    mi.set_variant("llvm_ad_rgb")
    scene = glass_room()
    found = {}
    for account, (max_depth, min_contribution) in ACCOUNTS.items():
        claims, errors, maps, truths = [], [], [], []
        for seed in SEEDS:
            cut = rendered(scene, seed, max_depth, min_contribution)
            facts = cut.to_dict()["truncation"][account]
            whole = rendered(scene, seed, DEEP, 0.0)  # the same eye rays and, at each node, the same numbers
            claims.append(facts["radiance_lost"])
            errors.append(facts["radiance_lost_error"])
            maps.append(cut.lost)
            truths.append(luminance(whole.mean) - luminance(cut.mean))
        found[account] = tuple(map(np.array, (claims, errors, maps, truths)))
    return found


@pytest.mark.parametrize("account", ACCOUNTS)
def test_the_loss_is_estimated_without_bias(losses, account):
    """4 sigma between the claims and the truths of 48 seeds: 2e-4, by Student's t of 47 degrees."""
    claims, _, _, truths = losses[account]
    truth = truths.mean((1, 2))
    assert truth.mean() > 1e-3, "there is something to lose"
    difference = claims - truth
    t = difference.mean() / difference.std(ddof=1) * np.sqrt(len(SEEDS))
    assert abs(t) < 4
    assert difference.std(ddof=1) / np.sqrt(len(SEEDS)) < 0.2 * truth.mean(), "the test has power"


@pytest.mark.parametrize("account", ACCOUNTS)
def test_the_claimed_error_of_the_loss_is_honest(losses, account):
    """The spread of 48 claims against what is claimed, by a chi-square of 47 degrees: 1e-4.

    The claim is an upper bound, since samples of one pixel are spread more evenly than at random.
    """
    claims, errors, _, truths = losses[account]
    ratio = np.var(claims - truths.mean((1, 2)), ddof=1) / np.mean(errors**2)
    assert ratio < stats.chi2.isf(1e-4, len(SEEDS) - 1) / (len(SEEDS) - 1)
    assert ratio > 0.1


@pytest.mark.parametrize("account", ACCOUNTS)
def test_the_map_of_the_loss_is_where_light_is_lost(losses, account):
    """By tiles of 4x4 pixels, 16 tests by Student's t of 47 degrees: 1e-4 each."""
    _, _, maps, truths = losses[account]
    tiles = (maps - truths).reshape(len(SEEDS), 4, 4, 4, 4).mean((2, 4)).reshape(len(SEEDS), -1)
    error = tiles.std(0, ddof=1) / np.sqrt(len(SEEDS))
    t = tiles.mean(0) / np.maximum(error, 1e-9)
    assert np.abs(t).max() < stats.t.isf(5e-5, len(SEEDS) - 1)


@pytest.mark.parametrize("account", ACCOUNTS)
def test_only_the_account_at_fault_is_charged(account):
    max_depth, min_contribution = ACCOUNTS[account]
    found = rendered(glass_room(), 1, max_depth, min_contribution, spp=32).to_dict()["truncation"]
    assert found[account]["throughput_dropped"] > 5e-3
    assert found[account]["radiance_lost"] > 1e-3
    other = found["by_cutoff" if account == "by_depth" else "by_depth"]
    assert other["throughput_dropped"] < 1e-4
    assert other["radiance_lost"] < 1e-4


def test_more_depth_and_a_lower_cutoff_lose_less():
    scene = glass_room()
    by_depth = [
        rendered(scene, 1, depth, 0.0).to_dict()["truncation"]["by_depth"]["throughput_dropped"]
        for depth in (2, 3, 5, 8, 16)
    ]
    assert by_depth == sorted(by_depth, reverse=True)
    by_cutoff = [
        rendered(scene, 1, DEEP, cutoff).to_dict()["truncation"]["by_cutoff"]["throughput_dropped"]
        for cutoff in (0.3, 0.1, 0.01, 0.001)
    ]
    assert by_cutoff == sorted(by_cutoff, reverse=True)
