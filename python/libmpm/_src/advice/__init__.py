"""Advice on a scene's numerical settings, from the shipped atlas of measurements."""
