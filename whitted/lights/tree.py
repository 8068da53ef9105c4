"""The choice of one light among many, with about the probability of its share in the unshadowed irradiance.

Source: [EstevezKulla2018] for a tree of bounds with cones of normals and the descent with one random number,
[PharrJakobHumphreys2023], section 12.6.3, for the angles that bound the cosines. Here a node has eight children, so
that up to eight lights are weighted one by one; and of the cosines that the bounds allow the mean is taken rather than
the largest, which comes nearer to the irradiance where the bounds are wide. Left out: the choice of several lights
where the bounds are too wide for one.
"""

import drjit as dr
import mitsuba as mi

from whitted.lights.importance import importance
from whitted.lights.tree_build import WIDTH, Lights, build


class LightTree:
    """A tree over N bounded lights, given by their bounds alone.

    A node's share is that of its `importance` among its siblings.

    Args:
        lower, upper: ``float64`` [N, 3], corners of boxes that hold the lights.
        power: ``float64`` [N], not negative, in any unit. A light of power 0 is never chosen.
        axis: ``float64`` [N, 3], middle of the cone of the normals, of any length; it may be 0 if they fill the sphere.
        cos_spread: ``float64`` [N] in [-1, 1], cosine of the cone's half angle: 1 for a flat light, -1 for a sphere, a
            point, or a light with two sides.
        cos_emission: ``float64`` [N] in [-1, 1], cosine of the angle theta_e from a normal in which light leaves: 0 for
            diffuse emission. It bounds the light, but in the formula it is 90 degrees at most.

    Raises:
        ValueError: there is no light, shapes don't agree, a number is not finite or out of its range.
    """

    def __init__(self, lower, upper, power, axis, cos_spread, cos_emission):
        lights = Lights(lower, upper, power, axis, cos_spread, cos_emission)
        self.count = lights.count
        bounds, *numbers = build(lights)
        # By way of lists, as an array of NumPy's would be used in place, and kernels depend on how memory is aligned
        self.bounds = mi.Float(bounds.ravel().tolist())
        self.child, self.is_leaf, self.parent, self.slot = (mi.UInt32(a.tolist()) for a in numbers)

    def sample(self, p, n, u, active=True):
        """Choose a light for a receiver.

        Args:
            p: ``Point3f`` [M].
            n: ``Vector3f`` [M], unit: light comes from the side that it points to; or 0: from all sides.
            u: ``Float`` [M] in [0, 1).
            active: ``Bool`` [M].

        Returns:
            The light's number (``UInt32`` [M] in [0, N)); its probability (``Float`` [M] in (0, 1], 0 where not valid);
            a ``Float`` [M] in [0, 1) that is even given the choice, of the digits of ``u`` that the choice leaves; and
            ``valid`` (``Bool`` [M]): false where no light comes from what was come to, or ``p`` or ``n`` is not finite.
        """
        p, n, u, active = mi.Point3f(p), mi.Vector3f(n), mi.Float(u), mi.Bool(active)
        if self.count == 1:
            valid = self._only_light(p, n, active)
            return mi.UInt32(0), dr.select(valid, mi.Float(1), 0), u, valid

        def descend(p, n, node, probability, u, valid, going):
            weights = self._weights(node, p, n, going)
            total = sum(weights)
            target = u * total
            slot, weight, start, end = mi.UInt32(0), mi.Float(0), mi.Float(0), mi.Float(0)
            for number, w in enumerate(
                weights
            ):  # the last one that isn't 0 and doesn't start beyond the target
                taken = (w > 0) & (end <= target)
                slot = dr.select(taken, number, slot)
                weight = dr.select(taken, w, weight)
                start = dr.select(taken, end, start)
                end = end + w
            found = going & (weight > 0)
            rest = dr.clip((target - start) / weight, 0, dr.one_minus_epsilon(mi.Float))
            u = dr.select(found, rest, u)
            probability = dr.select(found, probability * (weight / total), probability)
            slot = slot + WIDTH * node
            node = dr.select(found, dr.gather(mi.UInt32, self.child, slot, found), node)
            reached = found & (dr.gather(mi.UInt32, self.is_leaf, slot, found) != 0)
            return p, n, node, probability, u, valid | reached, found & ~reached

        state = (p, n, mi.UInt32(0), mi.Float(1), u, mi.Bool(False), active)
        state = dr.while_loop(state, lambda *state: state[-1], descend, label="light tree")
        _, _, leaf, probability, u, valid, _ = state
        return dr.select(valid, leaf, 0), dr.select(valid, probability, 0), u, valid

    def probability(self, leaf, p, n, active=True):
        """Return the probability (``Float`` [M] in [0, 1]) with which `sample` chooses a given light.

        Over all lights it adds up to the probability that the choice is valid.

        Args:
            leaf: ``UInt32`` [M] in [0, N), the light's number.
            p, n, active: as for `sample`; 0 is returned in inactive lanes.
        """
        p, n, leaf, active = mi.Point3f(p), mi.Vector3f(n), mi.UInt32(leaf), mi.Bool(active)
        if self.count == 1:
            return dr.select(self._only_light(p, n, active), mi.Float(1), 0)

        def ascend(p, n, slot, probability, going):
            node, place = slot // WIDTH, slot % WIDTH
            weights = self._weights(node, p, n, going)
            own = mi.Float(0)
            for number, w in enumerate(weights):
                own = dr.select(place == number, w, own)
            share = dr.select(own > 0, own / sum(weights), 0)
            probability = dr.select(going, probability * share, probability)
            going = going & (node != 0) & (own > 0)
            return p, n, dr.gather(mi.UInt32, self.parent, node, going), probability, going

        slot = dr.gather(mi.UInt32, self.slot, leaf, active)
        state = (p, n, slot, mi.Float(1), active)
        *_, probability, _ = dr.while_loop(state, lambda *state: state[-1], ascend, label="light tree, up")
        return dr.select(active, probability, 0)

    def _only_light(self, p, n, active):
        return active & (self._importance(mi.UInt32(0), p, n, active) > 0)

    def _weights(self, node, p, n, active):
        return [self._importance(WIDTH * node + number, p, n, active) for number in range(WIDTH)]

    def _importance(self, slot, p, n, active):
        """Return the importance (``Float``) of what is in a slot: 0 if the slot is empty."""
        rows = (dr.gather(mi.Vector4f, self.bounds, 3 * slot + row, active) for row in range(3))
        return importance([number for row in rows for number in row], p, n)
