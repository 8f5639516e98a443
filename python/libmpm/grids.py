"""Grids of triangles and of splines for plane scenes, their functions and their mass matrices."""

from libmpm._src.triangular.bases import (
    ConsistentMass,
    CubicPowellSabin,
    Lagrange,
    Linear,
    LumpedMass,
    PartialMass,
    PowellSabin,
)
from libmpm._src.triangular.choices import SplineGrid, TriangularGrid
from libmpm._src.triangular.convergence import Convergence, convergence
from libmpm._src.triangular.functions import Functions
from libmpm._src.triangular.mesh import Mesh
from libmpm._src.triangular.projection import Projection

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
    "TriangularGrid",
    "convergence",
]
