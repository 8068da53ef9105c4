"""The errors of a cell against its reference picture, and what the reference's own noise adds to them."""

import numpy as np

from whitted.stats.metrics import EPSILON, METRICS


def errors_of(key, pixels, reference, names):
    """Return rows of errors of a picture, a list of dicts.

    Args:
        key: the cell's.
        pixels: ``float32`` [H, W, C].
        reference: `Reference`.
        names: of metrics.
    """
    return [
        {
            "cell": key,
            "reference": reference.id,
            "metric": name,
            "value": float(METRICS[name](pixels, reference.pixels)),
            "reference_part": reference.part(name),
        }
        for name in names
    ]


class Reference:
    """A reference picture.

    Args:
        row: of ``reference_pictures``.
        picture: `whitted.image.Picture` with its standard error.
    """

    def __init__(self, row, picture):
        self.id, self.row = row["id"], row
        self.pixels = picture.rgb if "R" in picture.channels else picture.rgb[..., :1]
        stderr = picture.stderr if "R" in picture.channels else picture.stderr[..., :1]
        self.variance = np.square(stderr, dtype=np.float64)

    def part(self, metric):
        """Return what the reference's noise adds to a metric on average, or None where that isn't known."""
        if metric == "mse":
            return float(self.variance.mean())
        if metric == "rel_mse":
            R = np.asarray(self.pixels, np.float64)
            return float(np.mean(self.variance / (R**2 + EPSILON * R.mean() ** 2)))
        return 0.0 if metric == "bias" else None
