"""Geometry: `Box` for bodies and rigid boundaries, `DomainWalls` for the edge of the domain."""

from libmpm._src.shapes import Box, DomainWalls, Shape

__all__ = ["Box", "DomainWalls", "Shape"]
