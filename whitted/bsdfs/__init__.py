"""Mitsuba BSDF plugins, one per file."""
