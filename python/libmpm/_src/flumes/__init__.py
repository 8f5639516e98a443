"""Facilities as values: their scenes, their instruments, what was measured there."""
