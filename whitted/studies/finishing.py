"""From the parts of a cell to what is stored of it: its picture as a file, its seconds, and its errors.

It is done where the cell was rendered, if that was in one part, so that a study on many machines isn't held up where
the results come together.
"""

from dataclasses import dataclass

import numpy as np

from whitted import image
from whitted.stats.metrics import EPSILON, METRICS
from whitted.studies.rows import cell_picture, image_hash


@dataclass(frozen=True)
class Finished:
    """A cell that is done: the bytes of its EXR file, the pixels' hash, rows of timings and errors.

    ``same_bits`` tells whether a second render has given the same.
    """

    file: bytes
    image_hash: str
    timings: list
    errors: list
    same_bits: bool


def finished(cell, results, reference, names):
    """Return the `Finished` cell.

    Args:
        cell: `whitted.studies.cells.Cell`.
        results: by part, what `whitted.studies.rendering.render` has given.
        reference: `Reference` of the scene, or None: then there are no errors.
        names: of metrics.
    """
    picture = assembled(cell, results)
    return Finished(
        file=image.encode_exr(cell_picture(cell, picture)),
        image_hash=image_hash(picture),
        timings=summed(results.values()) if cell.timed else [],
        errors=errors_of(cell.key, picture, reference, names) if reference else [],
        same_bits=all(result["same_bits"] for result in results.values()),
    )


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


def assembled(cell, results):
    """Return a cell's picture, ``float32`` [H, W, C], from the results by `Part`; ranges are added in their order."""
    shape = (cell.scene.height, cell.scene.width)
    channels = next(iter(results.values()))["sums"].shape[-1]
    sums, weights = np.zeros((*shape, channels)), np.zeros(shape)
    for part in sorted(results, key=lambda part: (part.y, part.x, part.start)):
        window = np.s_[part.y : part.y + part.height, part.x : part.x + part.width]
        sums[window] += results[part]["sums"]
        weights[window] += results[part]["weights"]
    return np.divide(sums, weights[..., None], out=np.zeros_like(sums), where=weights[..., None] > 0).astype(
        np.float32
    )


def summed(results):
    """Return a cell's timings from those of its parts, a list of dicts: cold where any part was, and warm."""
    firsts = [result["timings"][0] for result in results]
    lasts = [result["timings"][-1] for result in results]
    whole = [_sum(lasts)]
    return [_sum(firsts), *whole] if any(len(result["timings"]) > 1 for result in results) else whole


def _sum(timings):
    return {
        name: None if timings[0][name] is None else sum(t[name] or 0 for t in timings) for name in timings[0]
    }
