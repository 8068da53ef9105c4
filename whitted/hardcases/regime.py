"""What the numbers of Mitsuba depend on: its version, how it offsets rays, whether denormal numbers are kept."""

import drjit as dr
import mitsuba as mi
import numpy as np

FAR = 1000.0  # from the origin, where the offset is looked at


def found():
    """Return a dict: ``mitsuba``, ``drjit``, ``variant``, ``llvm`` (versions), ``offset_at_0`` and ``offset_at_1000``
    (by which Mitsuba moves the origin of a ray off a surface there), ``keeps_denormals``.
    """
    return {
        "mitsuba": mi.__version__,
        "drjit": dr.__version__,
        "variant": mi.variant(),
        "llvm": ".".join(map(str, dr.detail.llvm_version())),
        "offset_at_0": _offset(0.0),
        "offset_at_1000": _offset(FAR),
        "keeps_denormals": bool(np.array(dr.opaque(mi.Float, 1e-39) * 0.5)[0] > 0),
    }


def _offset(x):
    """How far a ray that leaves a surface at (x, 0, 0) upwards begins above it."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p, si.n = mi.Point3f(x, 0, 0), mi.Normal3f(0, 0, 1)
    return float(np.array(si.spawn_ray(mi.Vector3f(0, 0, 1)).o.z)[0])
