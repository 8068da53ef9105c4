"""All lights of a scene: the bounded ones together, and each infinite one."""

import drjit as dr
import mitsuba as mi

from whitted.lights.bounded import BoundedLights
from whitted.lights.infinite import infinite_lights


class Lights:
    """The lights of a scene, in groups that are sampled each by itself.

    Attributes:
        groups: a list of `BoundedLights` and of `InfiniteLight`.
        is_closed: the unoccluded irradiance of all bounded lights is known.
        is_hittable: a ray can meet some light.
        is_plain: at a diffuse surface none that a ray can meet needs a second technique.
        only_met: there are lights that can't be sampled, so that only rays that meet them find their light.

    Args:
        scene: ``mi.Scene``.
        as_points: area lights are points at their centres, and the environment lights nothing.
    """

    def __init__(self, scene, as_points=False):
        self.as_points = as_points
        bounded = BoundedLights(scene, as_points)
        self.infinite = infinite_lights(scene, as_points)
        self.bounded = bounded if bounded.count else None
        self.only_met = bounded.only_met
        self.shares_type = bounded.shares_type
        self.is_closed = bounded.is_closed
        self.groups = [*([bounded] if bounded.count else []), *self.infinite]
        hittable = [group for group in (bounded, *self.infinite) if group.is_hittable]
        self.is_hittable = bool(hittable)
        self.is_plain = all(group.is_plain for group in hittable)
        self.environment = next((light for light in self.infinite if light.is_hittable), None)

    def shares(self, p, n, response=None):
        """Return what the choice among the bounded lights goes by, see `BoundedLights.shares`."""
        return None if self.bounded is None else self.bounded.shares(p, n, response)

    def pdf(self, si, p, n, active, shares=None):
        """Return the density (``Float``) with which ``sample`` of its group at ``p`` finds the light at ``si``."""
        density = mi.Float(0)
        hit = si.is_valid()
        if self.bounded is not None and self.bounded.is_hittable:
            density = self.bounded.pdf(si, p, n, active & hit, shares)
        if self.environment is not None:
            density = dr.select(hit, density, self.environment.pdf(si, p, n, active & ~hit))
        return density

    def is_plain_at(self, si):
        """Return whether the light at ``si`` is sampled so well that diffuse surfaces need nothing else (``Bool``)."""
        if self.is_plain:
            return mi.Bool(True)
        bounded = mi.Bool(self.bounded is not None and self.bounded.is_plain)
        return dr.select(
            si.is_valid(), bounded, mi.Bool(self.environment is None or self.environment.is_plain)
        )
