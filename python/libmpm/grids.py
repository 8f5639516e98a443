"""Grids of triangles and of splines for plane scenes, their functions, masses and tractions."""

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
from libmpm._src.grids.shapes import Traction

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
    "PowellSabin",
    "Projection",
    "SplineGrid",
    "Traction",
    "TriangularGrid",
    "convergence",
]
