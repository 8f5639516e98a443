"""Geometry of bodies and boundaries.

`Box` for bodies and rigid boundaries, `OrientedBox` for bodies at any angle, `DomainWalls` for the
edge of the domain; on a grid of `libmpm.grids` also `Cells` and `Points` for bodies and `Outline`
for boundaries.
"""

from libmpm._src.shapes import Box, DomainWalls, OrientedBox, Shape
from libmpm._src.triangular.shapes import Cells, Outline, Points

__all__ = ["Box", "Cells", "DomainWalls", "OrientedBox", "Outline", "Points", "Shape"]
