"""What sampling a light gives, whatever the light."""

from typing import NamedTuple


class LightSample(NamedTuple):
    """A sampled direction towards a light, in N lanes."""

    d: object  # Vector3f, unit
    target: object  # Point3f, where the shadow ray ends
    weight: object  # Spectrum, radiance over density; 0 where no light comes from
    pdf: object  # Float, per solid angle, the choice of the light included; 0 of delta lights
    shape: object  # UInt32, the registry number of the shape that the target lies on, 0 if on none
