"""Geometry of bodies and boundaries.

Solids have an inside, a signed distance and bounds: `Box`, `OrientedBox`, `Sphere`, `Cylinder`,
`Cone`, `Wedge`, `HalfSpace`, `Extrusion`, `HeightField`, `Mesh`. They are put together by `a | b`,
`a & b` and `a - b` (`Union`, `Intersection`, `Difference`), moved, turned and repeated by methods
(`Moved`, `Turned`, `Repeated`). `basin` is what water fills above a bed,
`afloat` puts a body where it floats. `PointFile` takes the
particles of a body from a file; `Columns`, `Jitter` and `PoissonDisk` are ways to place those of
a solid.

`DomainWalls` is the edge of the domain, for boundaries; on a grid of `libmpm.grids` there are also
`Cells` and `Points` for bodies and `Outline` for boundaries.
"""

from libmpm._src.geometry.afloat import Afloat, afloat
from libmpm._src.geometry.arranged import Moved, Repeated, Turned
from libmpm._src.geometry.choices import Columns, Jitter, PoissonDisk, Sampling
from libmpm._src.geometry.combined import Difference, Intersection, Union
from libmpm._src.geometry.fill import basin
from libmpm._src.geometry.height_field import HeightField
from libmpm._src.geometry.mesh import SurfaceMesh
from libmpm._src.geometry.point_file import PointFile
from libmpm._src.geometry.primitives import Cone, Cylinder, HalfSpace, Sphere
from libmpm._src.geometry.prisms import Extrusion, Wedge
from libmpm._src.geometry.solid import Shape, Solid
from libmpm._src.shapes import Box, DomainWalls, OrientedBox
from libmpm._src.triangular.shapes import Cells, Outline, Points

#: What a surface mesh encloses; files name it "SurfaceMesh", as "Mesh" is that of `libmpm.grids`.
Mesh = SurfaceMesh

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
    "Mesh",
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
    "Turned",
    "Union",
    "Wedge",
    "afloat",
    "basin",
]
