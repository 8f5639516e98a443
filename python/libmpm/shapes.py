"""Geometry of bodies and boundaries.

`Box` for bodies and rigid boundaries, `DomainWalls` for the edge of the domain; on a grid of
`libmpm.grids` also `Cells` and `Points` for bodies and `Outline` for boundaries.
"""

from libmpm._src.shapes import Box, DomainWalls, Shape
from libmpm._src.triangular.shapes import Cells, Outline, Points

__all__ = ["Box", "Cells", "DomainWalls", "Outline", "Points", "Shape"]
