r"""Which random dimensions make the noise? Sobol' indices of a pixel's value by pick-freeze.

The value is a function :math:`f(x_1, \dots, x_k)` of independent groups of random numbers. With two independent samples
A and B of all of them, and :math:`A_B^g`, which is A with group g taken from B,

.. math::
    V = \tfrac12 E (f_A - f_B)^2, \qquad
    S_{T,g} = \tfrac1{2V} E (f_A - f_{A_B^g})^2, \qquad
    S_g = \tfrac1V E (f_B - c)(f_{A_B^g} - f_A)

:math:`S_g V` is the variance that would be left if all other groups were integrated exactly, :math:`(1 - S_{T,g}) V`
that if g alone were; what the first orders lack to 1 is interaction. Source: [Sobol2001] for the indices, [Jansen1999]
for the total, [SaltelliEtAl2010] for the first order. Left out: second orders, and Shapley effects.
"""

from dataclasses import dataclass

import numpy as np

from whitted.stats.intervals import Interval, bootstrap_t, mean

BLOCKS = 64  # evaluations between which intervals are taken, at most: more cost time and tell hardly more


@dataclass(frozen=True)
class Share:
    """The share of the variance that a group causes: with its interactions (``total``), and alone (``first``).

    Both are an `Interval`; estimates may lie outside [0, 1] by their error.
    """

    total: Interval
    first: Interval

    def to_dict(self):
        """Return the numbers for JSON."""
        return {"total": self.total.to_dict(), "first": self.first.to_dict()}


class Attribution:
    """Sums over evaluations, from which shares are taken; two of the same groups and pixels can be added.

    Args:
        groups: names of the groups.
    """

    def __init__(self, groups):
        self.groups = tuple(groups)
        self.count = 0
        self._variance = 0.0  # per pixel: of (f_A - f_B)^2 / 2, and of its square
        self._variance_squared = 0.0
        self._total = dict.fromkeys(
            self.groups, 0.0
        )  # likewise of (f_A - f_AB)^2 / 2, its square, the product
        self._total_squared = dict.fromkeys(self.groups, 0.0)
        self._product = dict.fromkeys(self.groups, 0.0)
        self._first = dict.fromkeys(self.groups, 0.0)
        self._rows = []  # per evaluation, sums over pixels: variance, totals, firsts

    def add(self, a, b, mixed):
        """Add a batch of evaluations.

        Args:
            a, b: [R, H, W], R >= 2, values of the two samples; those of different R are independent.
            mixed: dict from group to [R, H, W], values of a with that group taken from b.
        """
        a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
        count = len(a)
        # Centred by the mean of the batch's other evaluations: what is subtracted is independent of what it is from
        total = (a + b).sum(axis=0)
        centred = b - (total - a - b) / (2 * count - 2)
        variance = (a - b) ** 2 / 2
        rows = [variance.sum(axis=(1, 2))]
        self._variance = self._variance + variance.sum(axis=0)
        self._variance_squared = self._variance_squared + (variance**2).sum(axis=0)
        firsts = []
        for group in self.groups:
            change = np.asarray(mixed[group], np.float64) - a
            part, first = change**2 / 2, centred * change
            self._total[group] = self._total[group] + part.sum(axis=0)
            self._total_squared[group] = self._total_squared[group] + (part**2).sum(axis=0)
            self._product[group] = self._product[group] + (part * variance).sum(axis=0)
            self._first[group] = self._first[group] + first.sum(axis=0)
            rows.append(part.sum(axis=(1, 2)))
            firsts.append(first.sum(axis=(1, 2)))
        self.count += count
        self._rows.append(np.stack([*rows, *firsts], axis=1))

    def __add__(self, other):
        """Return the sums of both: the evaluations of one, then those of the other."""
        if self.groups != other.groups:
            raise ValueError(f"groups {self.groups} and {other.groups} differ")
        found = Attribution(self.groups)
        found.count = self.count + other.count
        found._rows = self._rows + other._rows
        found._variance = self._variance + other._variance
        found._variance_squared = self._variance_squared + other._variance_squared
        for name in ("_total", "_total_squared", "_product", "_first"):
            ours, theirs = getattr(self, name), getattr(other, name)
            setattr(found, name, {group: ours[group] + theirs[group] for group in self.groups})
        return found

    @property
    def variance(self):
        """The variance of each pixel, ``float64`` [H, W]."""
        return self._variance / self.count

    def total(self, group):
        """Return the total share of a group in each pixel, ``float64`` [H, W]; 0 where there is no variance."""
        return _ratio(self._total[group], self._variance)

    def first(self, group):
        """Return the share that a group causes alone in each pixel, likewise."""
        return _ratio(self._first[group], self._variance)

    def total_error(self, group):
        """Return the standard error of `total` in each pixel, by the linearised ratio, likewise."""
        share = self.total(group)
        squares = (
            self._total_squared[group] - 2 * share * self._product[group] + share**2 * self._variance_squared
        )
        scale = self.count / max(self.count - 1, 1)
        return _ratio(np.sqrt(scale * np.maximum(squares, 0)), self._variance)

    def shares(self, level=0.95, resamples=1999, seed=0):
        """Return the `Share` of each group in the whole picture, a dict, and the `Interval` of the interaction.

        A picture's share is that of the variances summed over its pixels. Intervals are bootstrap-t over evaluations,
        of which `BLOCKS` or more are put together in as many.
        """
        rows = np.concatenate(self._rows)
        if len(rows) > BLOCKS:
            edges = np.linspace(0, len(rows), BLOCKS, endpoint=False).astype(int)
            rows = np.add.reduceat(rows, edges)
        size = len(self.groups)

        def statistic(weights):
            sums = mean(rows, weights)
            with np.errstate(invalid="ignore"):
                found = sums[..., 1:] / sums[..., :1]
            interaction = 1 - found[..., size:].sum(axis=-1, keepdims=True)
            return np.concatenate([found, interaction], axis=-1)

        if not rows[:, 0].any():
            nothing = Interval(0.0, 0.0, 0.0, level)
            return {group: Share(nothing, nothing) for group in self.groups}, nothing
        found = bootstrap_t(statistic, len(rows), level=level, resamples=resamples, seed=seed)
        each = [
            Interval(*(float(v) for v in ends), level)
            for ends in zip(found.value, found.low, found.high, strict=True)
        ]
        return {group: Share(each[i], each[size + i]) for i, group in enumerate(self.groups)}, each[-1]


def _ratio(a, b):
    """``a / b``, 0 where there is no ``b``."""
    return np.divide(a, b, out=np.zeros_like(b), where=b > 0)
