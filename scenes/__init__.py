"""Shipped scenes: Mitsuba XML files, each described by its first comment."""
