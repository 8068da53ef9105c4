"""Random and low-discrepancy numbers for the dimensions that a ray is distributed over."""
