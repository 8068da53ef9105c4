"""Do two sets of replicate images have the same expectation?

Welch's test on pixels and on tiles [JungHanikaDachsbacher2020], its null distribution taken from permuting
the replicates' labels. The statistic is studentised, so that the two sides may differ in variance
[ChungRomano2013], and a small cell's variance is raised by its neighbours' [TusherTibshiraniChu2001].
Agreement asks for more than an unrejected hypothesis: the interval of the bias lies inside a tolerance
[Schuirmann1987]. Left out: false discovery rates, and the shape of the distributions.
"""

import math
from dataclasses import dataclass, field
from statistics import NormalDist

import numpy as np

SIZES = (1, 4, 8, 16)  # sides of the cells, in pixels
TILE = 16  # side of the tiles that have a tolerance
DARK = 0.2  # biases are relative to the channel's mean there, but at least to this share of the image's mean
QUIET = 1e-5  # relative standard errors below this are float32 rounding, not noise
ROUNDING = 1e-4  # noise-free cells may differ by this much, relative: the same sums in another order
FLOOR = 0.1  # of the picture's mean variance: quieter neighbourhoods are no evidence of quiet cells
POWER = 0.9  # probability with which the smallest detectable bias is found
MOST = 1 << 18  # cells times channels: finer grids are left out, since they cost most and see least
CHUNK = 1 << 20  # values of a block of permutations: 4 MB for each temporary array, about a core's cache


@dataclass(frozen=True)
class Bias:
    """Relative bias of ``a`` against ``b`` with its interval, where that reaches furthest from zero."""

    value: float
    low: float
    high: float
    channel: int = 0
    box: tuple = ()  # x, y, width, height in pixels; empty for the whole image

    def inside(self, tolerance):
        """Whether the interval lies within ``[-tolerance, tolerance]``."""
        return -tolerance <= self.low and self.high <= tolerance

    def to_dict(self):
        """Return the numbers for JSON."""
        place = {"box": list(self.box)} if self.box else {}
        return {"value": self.value, "interval": [self.low, self.high], "channel": self.channel, **place}


@dataclass(frozen=True)
class Assessment:
    """What `assess` found: ``verdict`` is ``agree``, ``differ`` or ``undecided``."""

    verdict: str
    reason: str
    image: Bias
    tile: Bias  # the tile whose interval reaches furthest from zero
    p_value: dict  # by test
    threshold: float  # a test rejects where its p-value does not exceed this
    smallest_detectable: float  # relative bias of the image mean, found with probability POWER
    smallest_detectable_tile: float  # likewise, of the noisiest tile
    permutations: int
    nonfinite: tuple  # pixels with a value that is no number, in a and in b; left out of both
    means: tuple = field(repr=False)  # the two mean images, (H, W, C)


def assess(a, b, *, tolerance=0.01, tile_tolerance=0.05, level=0.01, permutations=None, seed=0):
    r"""Test whether two estimators have the same expectation, and bound how far apart they may be.

    With a cell's means :math:`m`, their squared standard errors :math:`e^2` between replicates, and
    :math:`\bar e^2`, that of the noisiest neighbourhood (0 for the image mean), the studentised difference

    .. math:: t = (m_a - m_b) / \sqrt{e_a^2 + e_b^2 + \bar e^2}

    is taken to a normal deviate :math:`z` by its Welch-Satterthwaite degrees of freedom. The tests are

    * ``max``: :math:`\max |z|` over cells and channels, for a few wrong cells (from 4x4 pixels on; a single
      pixel is too far from normal where the two sides differ in more than their mean);
    * ``sum``: :math:`\sum ((m_a - m_b)^2 - e_a^2 - e_b^2) / \bar e^2`, for many slightly wrong cells: its
      expectation is 0 for equal means whatever the distributions are [ChenQin2010];
    * ``image mean``: :math:`\max |z|` over its channels.

    The p-value of a maximum is the larger of the permutations' and Sidak's for normal deviates: the former
    is exact where both sides have one distribution, the latter where both are normal. Where one side alone
    is noisy and its replicates are strongly skewed neither holds; then take more samples. :math:`\bar e^2`
    keeps a cell in which one side has missed a rare event from counting as noise-free. Pixels without noise
    must agree to `ROUNDING`.

    Args:
        a: replicates, ``(R, H, W, C)``, linear radiance: independent randomisations of one estimator.
        b: replicates of the other, the reference; ``(R', H, W, C)``.
        tolerance: relative bias that the image mean may have, > 0.
        tile_tolerance: relative bias that a 16x16 tile may have, > 0.
        level: probability of a false alarm, in (0, 1), divided evenly among the tests.
        permutations: number of relabellings; by default 999, or as many as ``level`` needs.
        seed: of the permutations; equal seeds give equal results.

    Returns:
        An `Assessment`: ``differ`` where any test rejects, however small the difference; ``agree`` where none
        does and the intervals (confidence 1 - ``level``, all tiles together) lie within the tolerances.

    Raises:
        ValueError: the shapes do not match, or there are too few replicates for ``level``.
    """
    a, b = np.asarray(a, np.float32), np.asarray(b, np.float32)
    if a.ndim != 4 or a.shape[1:] != b.shape[1:]:
        raise ValueError(f"replicates must be (R, H, W, C) of one size, not {a.shape} and {b.shape}")
    shape = a.shape[1:3]
    grids = {size: _grid(shape, size) for size in SIZES}
    grids = {size: grid for size, grid in grids.items() if 1 < _count(grid) <= MOST // a.shape[3]}
    whole = _grid(shape, max(shape))
    threshold = level / (2 * len(grids) + 1 - (1 in grids))
    labels = _labels(len(a), len(b), permutations, threshold, seed)
    nonfinite, x = _blank_nonfinite(a, b)
    means = x[: len(a)].mean(0, dtype=np.float64), x[len(a) :].mean(0, dtype=np.float64)
    brightness = _brightness(*means)

    p_value, cells = {}, {}
    for size, grid in grids.items():
        around = _grid([len(edges) - 1 for edges in grid], 4 if size == 1 else 2)
        cells[size] = _Cells(_average(x, grid), len(a), brightness, around)
        largest, p_value[f"sum {size}x{size}"] = cells[size].test(labels)
        if size > 1:
            p_value[f"max {size}x{size}"] = largest
    cells["image"] = _Cells(_average(x, whole), len(a), brightness, None)
    p_value["image mean"], _ = cells["image"].test(labels)

    tiles, tile_grid = (cells[TILE], grids[TILE]) if TILE in grids else (cells["image"], whole)
    image, tile = cells["image"].bias(whole, level), tiles.bias(tile_grid, level)
    differing = next(iter(cells.values())).differing
    intervals = (image, tolerance), (tile, tile_tolerance)
    verdict, reason = _verdict(p_value, threshold, differing, nonfinite, *intervals)
    return Assessment(
        verdict=verdict,
        reason=reason,
        image=image,
        tile=tile,
        p_value=p_value,
        threshold=threshold,
        smallest_detectable=cells["image"].detectable(threshold),
        smallest_detectable_tile=tiles.detectable(threshold),
        permutations=len(labels) - 1,
        nonfinite=nonfinite,
        means=means,
    )


def relative_errors(a, b):
    """Return the difference's relative standard errors: of the image mean, and of the noisiest 16x16 tile.

    ``a`` and ``b`` are replicates as for `assess`, at least 2 of each; values that are no numbers count as 0.
    """
    a, b = np.nan_to_num(a, posinf=0, neginf=0), np.nan_to_num(b, posinf=0, neginf=0)
    brightness = _brightness(a.mean(0), b.mean(0))
    found = []
    for size in (max(a.shape[1:3]), TILE):
        grid = _grid(a.shape[1:3], size)
        cells = _Cells(_average(np.concatenate([a, b]), grid), len(a), brightness, None)
        found.append(cells.relative_error())
    return tuple(found)


def normal_deviate(t, dof):
    r"""Return the normal deviate with the tail probability of Student's ``t`` at ``dof`` degrees of freedom.

    :math:`z = \frac{8\nu+1}{8\nu+3} \sqrt{\nu \log(1 + t^2/\nu)}` [Wallace1959]; out to probabilities of
    1e-6 within 0.04 of the exact deviate for 7 degrees of freedom, and within 0.01 for 15 and more.
    """
    return (8 * dof + 1) / (8 * dof + 3) * np.sqrt(dof * np.log1p(np.minimum(t * t / dof, 1e300)))


def student_deviate(z, dof):
    """Return Student's t for a normal deviate ``z``: the inverse of `normal_deviate`."""
    scaled = z * (8 * dof + 3) / (8 * dof + 1)
    return np.sqrt(dof * np.expm1(scaled * scaled / dof))


class _Cells:
    """The replicates' means over cells, ``values`` (R, rows, columns, C); the first ``count`` are a's.

    ``around`` is the grid of neighbourhoods over the cells (None: none), whose variance is added to
    the cells' own.
    """

    def __init__(self, values, count, brightness, around):
        self.counts = count, len(values) - count
        self.brightness = brightness
        mean = values.mean(0, dtype=np.float64)
        sd = values.std(0, ddof=1, dtype=np.float64)
        sides = values[:count], values[count:]
        self.reference = sides[1].mean(0, dtype=np.float64)
        self.difference = sides[0].mean(0, dtype=np.float64) - self.reference
        shares = [side.var(0, ddof=1, dtype=np.float64) / len(side) for side in sides]
        self.error = np.sqrt(sum(shares))
        spread = sum(s**2 / (len(side) - 1) for s, side in zip(shares, sides, strict=True))
        self.dof = np.maximum(self.error**4 / np.maximum(spread, 1e-300), 1)
        pooled = sd**2 * sum(1 / n for n in self.counts)
        typical, noise = pooled, self.error**2
        if around:
            typical = np.maximum(_typical(pooled, mean, around), FLOOR * pooled.mean())
            noise = noise + _typical(noise, mean, around)
        size = np.maximum(abs(mean), 1e-3 * brightness)
        self.noisy = (sd > 0) & (noise > (QUIET * size) ** 2)
        self.differing = int((~self.noisy & (abs(self.difference) > ROUNDING * size)).sum())
        # float32 suffices for permuting once every cell has mean 0 and variance 1
        sd = sd[self.noisy]
        self._x = ((values[:, self.noisy] - mean[self.noisy]) / sd).astype(np.float32)
        typical = typical[self.noisy] / sd**2
        self._weight = (1 / typical).astype(np.float32)
        # beyond 1e6 a cell counts as noise-free beside its neighbours; float32 squares stay finite
        self._floor = (np.minimum(typical, 1e6) * (around is not None)).astype(np.float32)
        self._largest = np.zeros(1)

    def test(self, labels):
        """Return the p-values of ``max`` and ``sum``; the first row of ``labels`` is the true one."""
        largest, distance = np.zeros((2, len(labels)))
        width = self._x.shape[1]
        if not width:
            return 1.0, 1.0
        squares = self._x**2
        step = max(1, CHUNK // width)
        for i in range(0, len(labels), step):
            chosen = labels[i : i + step]
            z2, excess = self._statistics(chosen @ self._x, chosen @ squares)
            largest[i : i + step] = np.sqrt(z2.max(1))
            distance[i : i + step] = excess @ self._weight
        self._largest = largest
        t = self.difference[self.noisy] / np.maximum(self.error[self.noisy], 1e-100)
        z = normal_deviate(t, self.dof[self.noisy])
        return max(_p_value(largest), _sidak(z.max(), width)), _p_value(distance)

    def _statistics(self, sums, squares):
        """Return z^2 and d^2 - e^2 from a's sums and sums of squares of the standardised values."""
        n, m = self.counts
        a = (squares - sums * sums / n) / (n * (n - 1))
        b = ((n + m - 1) - squares - sums * sums / m) / (m * (m - 1))
        d2 = (sums * (1 / n + 1 / m)) ** 2
        v = np.maximum(a + b, 1e-9) + self._floor
        dof = v * v / (a * a / (n - 1) + b * b / (m - 1) + 1e-12)
        return ((8 * dof + 1) / (8 * dof + 3)) ** 2 * dof * np.log1p(d2 / v / dof), d2 - a - b

    def _quantile(self, level):
        """Return what max |z| exceeds with probability ``level`` under the null hypothesis."""
        permuted = np.sort(self._largest)[math.ceil((1 - level) * len(self._largest)) - 1]
        cells = max(1, self._x.shape[1])
        normal = -NormalDist().inv_cdf(-math.expm1(math.log1p(-level) / cells) / 2)
        return max(float(permuted), normal)

    def _scale(self):
        return np.maximum(abs(self.reference), DARK * self.brightness)

    def bias(self, grid, level):
        """Return the furthest-reaching of the cells' simultaneous intervals of confidence 1 - ``level``."""
        half = student_deviate(self._quantile(level), self.dof) * self.error
        scale = self._scale()
        reach = (abs(self.difference) + half) / scale
        y, x, channel = (int(i) for i in np.unravel_index(reach.argmax(), reach.shape))
        value, half = (float((v / scale)[y, x, channel]) for v in (self.difference, half))
        box = () if _count(grid) == 1 else _box(grid, y, x)
        return Bias(value, value - half, value + half, channel, box)

    def detectable(self, threshold):
        """Return the relative bias of the noisiest cell that is found with probability POWER."""
        z = self._quantile(threshold) + NormalDist().inv_cdf(POWER)
        return z * self.relative_error()

    def relative_error(self):
        """Return the relative standard error of the noisiest cell's difference."""
        return float((self.error / self._scale()).max())


def _brightness(a, b):
    """Return the mean that differences are relative to: the reference's, unless that is black."""
    return float(abs(b.mean())) or float(abs(a.mean())) or 1.0


def _verdict(p_value, threshold, differing, nonfinite, *intervals):
    rejected = [f"{name} (p = {p:.2g})" for name, p in p_value.items() if p <= threshold]
    if rejected:
        return "differ", "rejected by " + ", ".join(rejected)
    if differing:
        return "differ", f"{differing} values without noise differ"
    if any(nonfinite):
        return "undecided", f"values that are no numbers, in {nonfinite[0]} and {nonfinite[1]} pixels"
    for name, (bias, tolerance) in zip(("image", "worst tile"), intervals, strict=True):
        if not bias.inside(tolerance):
            return "undecided", f"the {name}'s bias may exceed {tolerance:g}: more samples are needed"
    return "agree", "no test rejects, and the bias lies within the tolerance"


def _labels(n, m, permutations, threshold, seed):
    """Return (1 + permutations, n + m) rows of 0 and 1, 1 marking a's; the first is the true labelling."""
    distinct = math.comb(n + m, n) / (2 if n == m else 1)
    if min(n, m) < 2 or distinct * threshold < 1:
        raise ValueError(f"{n} and {m} replicates are too few for p-values of {threshold:.2g}")
    permutations = permutations or max(999, math.ceil(1 / threshold))
    if (permutations + 1) * threshold < 1:
        raise ValueError(f"{permutations} permutations are too few for p-values of {threshold:.2g}")
    labels = np.zeros((permutations + 1, n + m), np.float32)
    labels[:, :n] = 1
    labels[1:] = np.random.default_rng(seed).permuted(labels[1:], axis=1)
    return labels


def _p_value(statistic):
    """Return the share of labellings whose statistic is at least the true one's, with room for rounding."""
    return float(np.mean(statistic >= statistic[0] * (1 - 1e-5)))


def _sidak(z, cells):
    """Return the probability that the largest of ``cells`` independent normal deviates exceeds ``z``."""
    tail = math.erfc(z / math.sqrt(2))
    return -math.expm1(cells * math.log1p(-min(tail, 1 - 1e-16)))


def _blank_nonfinite(a, b):
    """Return the counts of pixels with non-finite values, and all replicates with 0 in those pixels."""
    bad = [~np.isfinite(x).all(axis=(0, 3)) for x in (a, b)]
    x = np.concatenate([a, b])
    x[:, bad[0] | bad[1]] = 0
    return tuple(int(mask.sum()) for mask in bad), x


def _grid(shape, size):
    """Return the rows' and the columns' edges of nearly equal cells of side ``size``."""
    return [np.linspace(0, n, max(1, round(n / size)) + 1).round().astype(int) for n in shape]


def _count(grid):
    return math.prod(len(edges) - 1 for edges in grid)


def _box(grid, y, x):
    rows, columns = grid
    return int(columns[x]), int(rows[y]), int(columns[x + 1] - columns[x]), int(rows[y + 1] - rows[y])


def _average(x, grid):
    """Return the means of ``x`` (R, H, W, C) over the grid's cells."""
    for axis, edges in enumerate(grid, start=1):
        if len(edges) - 1 != x.shape[axis]:
            widths = np.diff(edges).reshape([-1 if i == axis else 1 for i in range(4)])
            x = np.add.reduceat(x, edges[:-1], axis=axis, dtype=np.float64) / widths
    return x


def _typical(variance, mean, around):
    """Return the mean variance (H, W, C) of the noisiest block among each cell's own and those next to it.

    The noisiest, because a rare event may have been missed throughout the cell's own block; scaled up where
    the cell is brighter than its block.
    """
    blocks = _average(variance[None], around)[0]
    padded = np.pad(blocks, ((1, 1), (1, 1), (0, 0)), "edge")
    rows, columns = blocks.shape[:2]
    blocks = np.max([padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)], axis=0)

    def spread(x):
        return x.repeat(np.diff(around[0]), axis=0).repeat(np.diff(around[1]), axis=1)

    power = mean * mean
    brighter = power / np.maximum(spread(_average(power[None], around)[0]), 1e-300)
    return spread(blocks) * np.maximum(1, brighter)
