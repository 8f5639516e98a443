"""Grids of triangles and of splines for plane scenes; tractions and pins of bodies."""

from libmpm._src.grids.bases import (
    ConsistentMass,
    CubicPowellSabin,
    Lagrange,
    Linear,
    LumpedMass,
    PartialMass,
    PowellSabin,
)
from libmpm._src.grids.convergence import Convergence, convergence
from libmpm._src.grids.functions import Functions
from libmpm._src.grids.grid import SplineGrid, TriangularGrid
from libmpm._src.grids.mesh import Mesh
from libmpm._src.grids.projection import Projection
from libmpm._src.grids.shapes import Pin, Traction

__all__ = [
    "ConsistentMass",
    "Convergence",
    "CubicPowellSabin",
    "Functions",
    "Lagrange",
    "Linear",
    "LumpedMass",
    "Mesh",
    "PartialMass",
    "Pin",
    "PowellSabin",
    "Projection",
    "SplineGrid",
    "Traction",
    "TriangularGrid",
    "convergence",
]
