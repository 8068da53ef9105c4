"""Hard cases: numerically delicate situations, each with its truth, a tolerance that is derived, and its source."""
