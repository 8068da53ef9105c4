"""Mitsuba plugins: samplers, one per file."""
