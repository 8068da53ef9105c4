"""The bounds and the children of a light tree's nodes, built from the root down, all nodes of a level at once.

Source: [EstevezKulla2018] for the cost of a split, the surface area orientation heuristic. Two things are
different: the area is that of the sphere around the box, which the importance goes by and which isn't 0 for points in a
line; and a cone of normals is replaced, in the cost only, by the cone that normals of the same mean fill evenly, since
means add up over bins.
"""

import numpy as np

WIDTH = 8  # children of a node, a power of two
BINS = 12  # along each axis, between which a node may be split
NEAREST = 1e-6  # of the root's radius: nodes are no smaller, which bounds the importance
NARROWEST = 1e-4  # squared sine of the angle of emission, at least
WEAKEST = 1e-30  # intensity of a light with any power, at least, so that it isn't 0 in single precision
ROUNDING = 1e-6  # relative, by which radii are enlarged for single precision


def orientation_measure(cos_spread, cos_emission):
    """Integrate over the sphere the cosine to the nearest normal of a cone, as in [EstevezKulla2018].

    ``2 pi (1 - cos theta_o) + 2 pi integral from theta_o to min(theta_o + theta_e, pi) of cos(t - theta_o) sin t dt``

    Args:
        cos_spread: array in [-1, 1], cosine of the cone's half angle theta_o.
        cos_emission: array in [-1, 1], cosine of the angle theta_e from a normal in which light leaves; of it, 90
            degrees are counted at most.

    Returns:
        An array, in sr: pi for a flat diffuse light, 4 pi for a sphere.
    """
    spread = np.arccos(cos_spread)
    reach = np.minimum(spread + np.arccos(np.maximum(cos_emission, 0)), np.pi)
    rim = np.cos(spread) - np.cos(2 * reach - spread) + 2 * (reach - spread) * np.sin(spread)
    return 2 * np.pi * (1 - np.cos(spread)) + np.pi / 2 * rim


class Lights:
    """What a light tree is made of, checked: the arguments of `LightTree`."""

    def __init__(self, lower, upper, power, axis, cos_spread, cos_emission):
        arrays = [np.asarray(a, np.float64) for a in (lower, upper, power, axis, cos_spread, cos_emission)]
        self.lower, self.upper, power, axis, self.cos_spread, self.cos_emission = arrays
        self.count = n = power.size
        if n == 0 or [a.shape for a in arrays] != [(n, 3), (n, 3), (n,), (n, 3), (n,), (n,)]:
            raise ValueError(f"light tree: no light, or shapes that don't agree: {[a.shape for a in arrays]}")
        if not all(np.isfinite(a).all() for a in arrays):
            raise ValueError("light tree: a number is not finite")
        if (self.lower > self.upper).any() or (power < 0).any():
            raise ValueError("light tree: a box has its corners swapped, or a power is negative")
        if (np.abs(np.stack([self.cos_spread, self.cos_emission])) > 1).any():
            raise ValueError("light tree: a cosine is outside [-1, 1]")
        length = np.linalg.norm(axis, axis=1, keepdims=True)
        if ((length[:, 0] == 0) & (self.cos_spread > -1)).any():
            raise ValueError("light tree: an axis is 0")
        self.axis = axis / np.where(length > 0, length, 1)
        self.power = power / (power.max() or 1)
        sin2_emission = 1 - np.maximum(self.cos_emission, 0) ** 2
        self.intensity = self.power / (np.pi * np.maximum(sin2_emission, NARROWEST))
        self.centre = self.lower / 2 + self.upper / 2
        self.mean_normal = self.axis * ((1 + self.cos_spread) / 2)[:, None]  # if they fill their cone evenly


def build(lights):
    """Build the tree of some ``Lights``; node ``i`` has the slots from ``WIDTH * i``, and node 0 is the root.

    Returns:
        ``bounds`` [slots, 12]: centre, radius; axis, intensity; cosine and sine of the cone's half angle, cosine of the
        angle of emission, 0. ``child`` [slots], the number of a light where ``is_leaf`` [slots], else of a node.
        ``parent`` [nodes + 1], the slot that each node is in, and ``slot`` [N], the slot that each light is in.
    """
    order, start, stop = np.arange(lights.count), np.array([0]), np.array([lights.count])
    levels, parent, made = [], [np.array([0])], 1
    while len(start):
        first = made - len(start)
        owner, start, stop = _children(lights, order, start, stop)
        slot = WIDTH * (first + owner) + np.arange(len(owner)) - np.searchsorted(owner, owner)
        is_leaf = stop - start == 1
        child = np.where(is_leaf, order[start], made + np.cumsum(~is_leaf) - 1)
        levels.append((slot, child, is_leaf, _bounds(lights, order, start, stop)))
        start, stop = start[~is_leaf], stop[~is_leaf]
        parent.append(slot[~is_leaf])
        made += len(start)
    slot, child, is_leaf, bounds = (np.concatenate(column) for column in zip(*levels, strict=True))
    by_slot = []
    for column in (_scaled(lights, bounds), child, is_leaf.astype(int)):
        by_slot.append(np.zeros((WIDTH * made, *column.shape[1:]), column.dtype))
        by_slot[-1][slot] = column
    slot_of_light = np.zeros(lights.count, int)
    slot_of_light[child[is_leaf]] = slot[is_leaf]
    parent.append(np.array([0]))  # an array of one entry would be taken for a number, in a kernel of its own
    return *by_slot, np.concatenate(parent), slot_of_light


def _children(lights, order, start, stop):
    """Cut segments of ``order`` into up to ``WIDTH`` each, and rearrange it; return whose they are and the new ends."""
    owner = np.arange(len(start))
    is_small = stop - start <= WIDTH
    alone = _positions(start[is_small], stop[is_small])
    owner_alone = np.repeat(owner[is_small], (stop - start)[is_small])
    owner, start, stop = owner[~is_small], start[~is_small], stop[~is_small]
    for _ in range(WIDTH.bit_length() - 1):
        middle = _split(lights, order, start, stop)
        owner = np.repeat(owner, 2)
        start, stop = np.stack([start, middle], 1).ravel(), np.stack([middle, stop], 1).ravel()
        kept = stop > start
        owner, start, stop = owner[kept], start[kept], stop[kept]
    owner, start = np.concatenate([owner, owner_alone]), np.concatenate([start, alone])
    stop = np.concatenate([stop, alone + 1])
    by_owner = np.argsort(owner, kind="stable")
    return owner[by_owner], start[by_owner], stop[by_owner]


def _positions(start, stop):
    """The positions in the segments, one segment after the other."""
    size = stop - start
    return np.arange(size.sum()) + np.repeat(start - np.cumsum(size) + size, size)


def _joined(order, start, stop):
    """The lights in the segments, one segment after the other, the segment of each, and where each segment begins."""
    size = stop - start
    return order[_positions(start, stop)], np.repeat(np.arange(len(size)), size), np.cumsum(size) - size


def _split(lights, order, start, stop):
    """Rearrange each segment of ``order`` so that it can be cut in two where that costs least; return where."""
    if not len(start):
        return start
    members, owner, first = _joined(order, start, stop)
    centre = lights.centre[members]
    low = np.minimum.reduceat(centre, first)
    extent = np.maximum.reduceat(centre, first) - low
    relative = (centre - low[owner]) / np.where(extent > 0, extent, 1)[owner]
    bins = np.minimum((BINS * relative).astype(int), BINS - 1)
    keys = (owner[:, None] * BINS + bins).T
    cost = np.stack([_costs(lights, members, key, len(start)) for key in keys], 1)
    # Across its short side, a segment is split for a much lower cost only
    slimness = np.divide(extent.max(1, keepdims=True), extent, out=np.ones_like(extent), where=extent > 0)
    cost = (cost * slimness[..., None]).reshape(len(start), -1)
    axis, last = np.divmod(cost.argmin(1), BINS - 1)
    is_right = bins[np.arange(len(members)), axis[owner]] > last[owner]
    in_one_place = np.isinf(cost.min(1))
    halves = np.arange(len(members)) >= (first + (stop - start) // 2)[owner]
    is_right = np.where(in_one_place[owner], halves, is_right)
    order[_positions(start, stop)] = members[np.argsort(2 * owner + is_right, kind="stable")]
    return stop - np.add.reduceat(is_right, first, dtype=int)


def _costs(lights, members, key, count):
    """The cost of cutting each of ``count`` segments after each bin but the last, infinite where a side is empty.

    ``key`` is the bin of each of the members, with the bins of all segments numbered in turn. Returns an array
    [count, BINS - 1].
    """
    power, normal = lights.power[members], lights.mean_normal[members]
    columns = (None, power, *(power[:, None] * normal).T)
    sums = np.stack([np.bincount(key, column, count * BINS) for column in columns], 1)
    reach = np.arccos(lights.cos_emission[members])
    corners = np.hstack([-lights.lower[members], lights.upper[members], reach[:, None]])
    most = np.full((count * BINS, 7), -np.inf)
    np.maximum.at(most, key, corners)
    sums, most = sums.reshape(count, BINS, 5), most.reshape(count, BINS, 7)
    from_left, from_right = _cumulated(sums, most), _cumulated(sums[:, ::-1], most[:, ::-1])[:, ::-1]
    return from_left[:, :-1] + from_right[:, 1:]


def _cumulated(sums, most):
    """The cost of the first one, two, ... bins: power, squared diagonal and measure of the normals multiplied.

    ``sums`` [count, BINS, 5] of number, power, normals by power; ``most`` [count, BINS, 7] of box and angle.
    """
    number, power, *normal = np.moveaxis(np.cumsum(sums, 1), -1, 0)
    is_empty = number == 0
    most = np.where(is_empty[..., None], 0, np.maximum.accumulate(most, 1))
    diagonal2 = ((most[..., 3:6] + most[..., :3]) ** 2).sum(-1)
    mean = np.linalg.norm(np.stack(normal), axis=0) / np.where(power > 0, power, 1)
    measure = orientation_measure(np.clip(2 * mean - 1, -1, 1), np.cos(most[..., 6]))
    return np.where(is_empty, np.inf, power * diagonal2 * measure)


def _bounds(lights, order, start, stop):
    """Boxes, intensity and cones of segments: columns of a table, [segments, 12]."""
    members, owner, first = _joined(order, start, stop)
    axis = np.add.reduceat(lights.mean_normal[members], first)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(length > 0, axis / np.where(length > 0, length, 1), (0, 0, 1))
    cosine = np.einsum("ij,ij->i", axis[owner], lights.axis[members])
    spread = np.arccos(np.clip(cosine, -1, 1)) + np.arccos(lights.cos_spread[members])
    spread = np.minimum(np.maximum.reduceat(spread, first), np.pi)
    table = np.zeros((len(start), 12))
    table[:, :3] = np.minimum.reduceat(lights.lower[members], first)
    table[:, 3:6] = np.maximum.reduceat(lights.upper[members], first)
    table[:, 6] = np.add.reduceat(lights.intensity[members], first)
    table[:, 7:10] = axis
    table[:, 10] = spread
    table[:, 11] = np.minimum.reduceat(lights.cos_emission[members], first)
    return table


def _scaled(lights, table):
    """Turn boxes, intensity and cones into what is gathered, the unit of length being the radius of all lights."""
    lower, upper, intensity, axis, spread, cos_emission = np.split(table, [3, 6, 7, 10, 11], axis=1)
    root = np.linalg.norm(lights.upper.max(0) - lights.lower.min(0)) / 2 or 1.0
    centre = (lower / 2 + upper / 2).astype(np.float32).astype(np.float64)
    radius = np.linalg.norm(np.maximum(upper - centre, centre - lower), axis=1, keepdims=True)
    radius = np.maximum(radius * (1 + ROUNDING), NEAREST * root)
    intensity = np.where(intensity > 0, np.maximum(intensity * root**2, WEAKEST), 0)
    unused = np.zeros_like(spread)
    return np.hstack([centre, radius, axis, intensity, np.cos(spread), np.sin(spread), cos_emission, unused])
