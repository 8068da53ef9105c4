"""Mitsuba integrator plugins, one per file; each registers itself when it is imported."""
