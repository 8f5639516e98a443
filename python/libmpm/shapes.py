"""Geometry of bodies and boundaries.

Solids have an inside, a signed distance and bounds: `Box`, `OrientedBox`, `Sphere`, `Cylinder`,
`Cone`, `Wedge`, `HalfSpace`, `Extrusion`, `HeightField`, `SurfaceMesh`. They are put together by
`a | b`, `a & b` and `a - b` (`Union`, `Intersection`, `Difference`), moved, turned and repeated by
methods (`Moved`, `Turned`, `Repeated`). `basin` is what water fills above a bed,
`afloat` puts a body where it floats. `PointFile` takes the
particles of a body from a file; `Tetrahedra` and `Triangles` are bodies of finite elements, whose
vertices move with the grid; `Columns`, `Jitter` and `PoissonDisk` are ways to place those of
a solid.

`DomainWalls` is the edge of the domain, for boundaries; on a grid of `libmpm.grids` there are also
`Cells` and `Points` for bodies and `Outline` for boundaries.
"""

from libmpm._src.grids.shapes import Cells, Outline, Points
from libmpm._src.moved import renamed
from libmpm._src.shapes.afloat import Afloat, afloat
from libmpm._src.shapes.basin import basin
from libmpm._src.shapes.boxes import Box, DomainWalls, OrientedBox
from libmpm._src.shapes.combined import Difference, Intersection, Union
from libmpm._src.shapes.element_mesh import Tetrahedra, Triangles
from libmpm._src.shapes.height_field import HeightField
from libmpm._src.shapes.particle_placement import Columns, Jitter, PoissonDisk, Sampling
from libmpm._src.shapes.point_file import PointFile
from libmpm._src.shapes.primitives import Cone, Cylinder, HalfSpace, Sphere
from libmpm._src.shapes.prisms import Extrusion, Wedge
from libmpm._src.shapes.solid import Shape, Solid
from libmpm._src.shapes.surface_mesh import SurfaceMesh
from libmpm._src.shapes.transformed import Moved, Repeated, Turned

#: Names of version 0.1; `libmpm.grids.Mesh` is one of triangles in the plane.
__getattr__ = renamed(__name__, {"Mesh": "SurfaceMesh"})

__all__ = [
    "Afloat",
    "Box",
    "Cells",
    "Columns",
    "Cone",
    "Cylinder",
    "Difference",
    "DomainWalls",
    "Extrusion",
    "HalfSpace",
    "HeightField",
    "Intersection",
    "Jitter",
    "Moved",
    "OrientedBox",
    "Outline",
    "PointFile",
    "Points",
    "PoissonDisk",
    "Repeated",
    "Sampling",
    "Shape",
    "Solid",
    "Sphere",
    "SurfaceMesh",
    "Tetrahedra",
    "Triangles",
    "Turned",
    "Union",
    "Wedge",
    "afloat",
    "basin",
]
