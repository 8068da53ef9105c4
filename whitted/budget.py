"""How many samples of a kind to take at the first hit, and whether a closed form pays: tried out on a few pixels.

One more shadow ray or ray into a lobe costs less than one more sample of the pixel, but takes off only a part of the
noise, and what is stratified with the pixel's position is less so if it is split. How these add up depends on the
scene, so the noise of some numbers is measured. The costs are counted in rays, not in seconds, so that a scene has one
plan. Source: [ArvoKirk1990] for the question.
"""

import dataclasses

import numpy as np

COUNTS = (2, 4, 8, 16)
LANES = 1 << 19  # samples of a trial
USUAL, MANY = 64, 256  # samples per pixel: for which the noise is measured, and up to where its order
ORDERS = 1.0, 1.5  # of convergence: of independent samples, and of joint ones where much is smooth
# Of a ray of each kind, with all that is done for it, in those of a shadow ray: about the seconds on our scenes
COSTS = {"eye": 3.0, "shadow": 1.0, "reflection": 5.0, "transmission": 5.0, "interreflection": 5.0}
CLOSED_COST = 0.5  # of a light's unoccluded irradiance, likewise, by the seconds on `soft_shadows`
ERRORS = 2.73  # standard errors by which more samples have to be better than one: 95 % for eight tries
KINDS = ("lobes", "light")


def closed_form(pilot, plan):
    """Decide whether it pays to know unoccluded light: what that takes off the noise, at equal cost.

    Args:
        pilot, plan: as for `share_out`.

    Returns:
        The plan's ``closed_form`` and ``closed_reason``, a dict; empty where there is no choice.
    """
    lights = pilot.world.lights("soft_shadows" not in plan)
    if not pilot.world.knows_unoccluded(lights):
        return {}
    plans = (dataclasses.replace(plan, closed_form=choice) for choice in (True, False))
    known, sampled = (_noise(pilot, plan, {}, USUAL) for plan in plans)
    slower = CLOSED_COST * lights.bounded.count / sampled.cost
    less = 1 - known.variance / sampled.variance if sampled.variance else 0.0
    said = f"in closed form it would have {100 * less:.3g} % less variance in {100 * slower:.2g} % more time"
    return {"closed_form": (1 - less) * (1 + slower) < 1, "closed_reason": said}


def share_out(pilot, plan):
    """Return how many samples of each kind, ``light`` and ``lobes``, give the least noise at equal cost.

    Args:
        pilot: `whitted.pilot.Pilot`; its integrator takes from the plan those numbers that are ``auto``.
        plan: `whitted.effects.Plan`.
    """
    counts = dict.fromkeys(KINDS, 1)
    wanted = [kind for kind, is_wanted in _wanted(pilot, plan).items() if is_wanted]
    if not wanted:
        return counts
    first, later = (_noise(pilot, plan, counts, spp) for spp in (USUAL, MANY))
    if not first.variance or not later.variance:
        return counts
    order = np.log(first.variance / later.variance) / np.log(MANY / USUAL)
    order = float(np.clip(order, *ORDERS))
    for kind in wanted:
        best = first
        for count in COUNTS:
            tried = _noise(pilot, plan, counts | {kind: count}, USUAL)
            if tried.to_equal_cost(order).mean() >= best.to_equal_cost(order).mean():
                break
            best = tried
        gain = first.to_equal_cost(order) - best.to_equal_cost(order)
        if gain.mean() > ERRORS * gain.std() / np.sqrt(gain.size):
            counts, first = best.counts, best
    return counts


@dataclasses.dataclass(frozen=True)
class _Noise:
    """The squared differences of some pixels between two renders (float64 [N]), and the cost of a sample."""

    counts: dict
    squares: np.ndarray
    cost: float

    @property
    def variance(self):
        """The mean variance of a pixel."""
        return float(self.squares.mean()) / 2

    def to_equal_cost(self, order):
        """What the squares would be with as many samples as have the cost 1."""
        return self.squares * self.cost**order


def _noise(pilot, plan, counts, spp):
    """Measure the noise with some numbers of samples, from two renders of the same pixels."""
    plan = dataclasses.replace(plan, samples=counts)
    a, b = (pilot.pixels(plan, seed, LANES // spp, spp) for seed in (0, 1))
    cost = sum(COSTS[kind] * count.numpy().mean(dtype=np.float64) for kind, count in pilot.world.rays.items())
    return _Noise(counts, np.nan_to_num(np.square(a - b), posinf=0.0), float(cost))


def _wanted(pilot, plan):
    """Which kinds a sample may have several of."""
    lights = pilot.world.lights("soft_shadows" not in plan)
    return {
        "lobes": any(effect in plan for effect in ("gloss", "translucency", "interreflection")),
        "light": any(group.needs_point or group.needs_choice for group in lights.groups),
    }
