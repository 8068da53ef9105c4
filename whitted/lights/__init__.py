"""Light shapes as seen from a point: sampling by solid angle, its density, and exact irradiance."""
