"""What the hard cases share of single precision."""

import mitsuba as mi
import numpy as np

U = 2.0**-24  # the relative error of a rounding


def vector(x):
    """Return a Dr.Jit vector in single precision from [3, N]."""
    return mi.Vector3f(np.float32(x))
