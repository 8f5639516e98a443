"""Meshes of solids by gmsh, where installed: shapes by OpenCASCADE, surface meshes filled."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

from libmpm._src.base.optional_packages import need
from libmpm._src.base.signals import ignore_broken_pipes
from libmpm._src.errors import SceneError
from libmpm._src.shapes.boxes import Box, OrientedBox
from libmpm._src.shapes.combined import Difference, Intersection, Union
from libmpm._src.shapes.element_lattices import LONGEST
from libmpm._src.shapes.element_topology import Numbers, longest_edges
from libmpm._src.shapes.primitives import Cone, Cylinder, Sphere
from libmpm._src.shapes.prisms import Extrusion, Wedge
from libmpm._src.shapes.solid import Array, Solid
from libmpm._src.shapes.surface_mesh import SurfaceMesh
from libmpm._src.shapes.transformed import Moved, Repeated, Turned

__all__ = ["has_gmsh", "knows", "mesh_by_gmsh"]

Tags = list[tuple[int, int]]

#: Length asked of the mesher, in `edge`: equilateral elements of the volume that a cube's sixths
#: (a square's halves) have.
_ASKED = {2: 1.07, 3: 1.12}
#: Times that a mesh with too long edges is made again, with shorter ones.
_TRIES = 6
#: Angle between triangles above which their edge is one of the surface, degrees.
_SHARP = 40.0
_OPTIONS = {
    "General.Terminal": 0, "General.NumThreads": 1, "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFromPoints": 0, "Mesh.MeshSizeFromCurvature": 0, "Mesh.MeshSizeMin": 0,
    "Mesh.Optimize": 1, "Mesh.OptimizeNetgen": 1, "Mesh.ElementOrder": 1,
}  # fmt: skip


def has_gmsh() -> bool:
    """Tell whether gmsh is installed."""
    return find_spec("gmsh") is not None


def knows(solid: Solid) -> bool:
    """Tell whether a solid can be described to gmsh."""
    if isinstance(solid, SurfaceMesh | Box | OrientedBox | Sphere | Cylinder | Cone | Wedge):
        return True
    if isinstance(solid, Union | Intersection):
        return all(_has_formula(part) for part in solid.parts)
    if isinstance(solid, Difference):
        return _has_formula(solid.whole) and _has_formula(solid.without)
    if isinstance(solid, Moved | Turned | Repeated):
        return _has_formula(solid.shape)
    return isinstance(solid, Extrusion)


def _has_formula(solid: Solid) -> bool:
    return knows(solid) and not isinstance(solid, SurfaceMesh)


def mesh_by_gmsh(solid: Solid, edge: float, label: str) -> tuple[Array, Numbers]:
    """Return vertices and elements of a solid; raises `SceneError`."""
    gmsh = need("gmsh", label, "elements")
    if not knows(solid):
        raise SceneError(
            f"{label}: {solid.label or type(solid).__name__} cannot be described to gmsh; expected "
            "boxes, spheres, cylinders, cones, wedges, extrusions, what is made of them, or a "
            "SurfaceMesh; use mesher='lattice'"
        )
    d = solid.dimension
    length = _ASKED[d] * edge
    said = ""
    for _ in range(_TRIES):
        try:
            # After a failure gmsh fills nothing more before it is started again.
            with _session(gmsh):
                vertices, elements = _attempt(gmsh, solid, length, label)
        except SceneError:
            raise
        except Exception as error:  # a coarse mesh of a curved surface may cross itself
            said, length = str(error), 0.8 * length
            continue
        longest = float(longest_edges(vertices, elements).max())
        if longest <= LONGEST[d] * edge * (1 + 1e-9):
            return vertices, elements
        said = f"its longest edge stays {longest:.4g} m"
        length *= max(0.7, 0.98 * LONGEST[d] * edge / longest)
    raise SceneError(
        f"{label}: gmsh could not mesh the solid with edge {edge:g} m: {said}; expected a closed "
        "solid; repair it, give a shorter edge, or use mesher='lattice'"
    )


def _attempt(gmsh: Any, solid: Solid, length: float, label: str) -> tuple[Array, Numbers]:
    """Return a mesh with edges of about `length`, m."""
    d = solid.dimension
    gmsh.option.setNumber("Mesh.MeshSizeMax", length)
    if isinstance(solid, SurfaceMesh):
        _surface(gmsh, solid, label)
    else:
        made = _shape(gmsh.model.occ, solid)
        # A union that does not overlap is one shape of several parts: the checks say so.
        gmsh.model.occ.synchronize()
        gmsh.model.occ.remove(list(set(gmsh.model.getEntities(d)) - set(made)), recursive=True)
        gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(d)
    return _found(gmsh, d, label)


@contextlib.contextmanager
def _session(gmsh: Any) -> Iterator[None]:
    """A model of our own; a session that was open stays as it was."""
    opened = not gmsh.isInitialized()
    if opened:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        ignore_broken_pipes()
    before = None if opened else gmsh.model.getCurrent()
    names = [*_OPTIONS, "Mesh.MeshSizeMax"]
    kept = {name: gmsh.option.getNumber(name) for name in names}
    for name, number in _OPTIONS.items():
        gmsh.option.setNumber(name, number)
    gmsh.model.add("libmpm")
    try:
        yield
    finally:
        gmsh.model.remove()
        for name, number in kept.items():
            gmsh.option.setNumber(name, number)
        if opened:
            gmsh.finalize()
        elif before is not None:
            gmsh.model.setCurrent(before)


def _found(gmsh: Any, d: int, label: str) -> tuple[Array, Numbers]:
    """Return the mesh that gmsh holds."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, corners = gmsh.model.mesh.getElementsByType(2 if d == 2 else 4)
    if not len(corners):
        raise SceneError(
            f"{label}: gmsh found no elements in the solid; expected a volume; repair the solid"
        )
    row = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    row[tags.astype(np.int64)] = np.arange(len(tags))
    elements = row[corners.astype(np.int64)].reshape(-1, d + 1)
    used, back = np.unique(elements, return_inverse=True)
    vertices = np.array(coordinates, dtype=np.float64).reshape(-1, 3)[used, :d]
    return vertices, back.reshape(elements.shape)


def _three(point: Any) -> tuple[float, float, float]:
    x = [*map(float, point), 0.0]
    return x[0], x[1], x[2]


def _shape(occ: Any, solid: Solid) -> Tags:
    """Describe a solid; return what it is made of in the end."""
    d = solid.dimension
    if isinstance(solid, Box):
        return _box(occ, solid.lower, solid.size)
    if isinstance(solid, OrientedBox):
        made = _box(occ, [-0.5 * s for s in solid.size], solid.size)
        _turn(occ, made, solid.angle, solid.axis, (0.0,) * d)
        occ.translate(made, *_three(solid.centre))
        return made
    if isinstance(solid, Sphere):
        centre, r = _three(solid.centre), solid.radius
        tag = occ.addDisk(*centre, r, r) if d == 2 else occ.addSphere(*centre, r)
        return [(d, tag)]
    if isinstance(solid, Cylinder | Cone):
        along = [b - a for a, b in zip(solid.start, solid.end, strict=True)]
        if isinstance(solid, Cylinder):
            return [(3, occ.addCylinder(*solid.start, *along, solid.radius))]
        return [(3, occ.addCone(*solid.start, *along, solid.radius, solid.end_radius))]
    if isinstance(solid, Wedge | Extrusion):
        return _prism(occ, solid)
    if isinstance(solid, Union | Intersection):
        first, *others = (_shape(occ, part) for part in solid.parts)
        for other in others:
            join = occ.fuse if isinstance(solid, Union) else occ.intersect
            first = join(first, other)[0]
        return first
    if isinstance(solid, Difference):
        made = occ.cut(_shape(occ, solid.whole), _shape(occ, solid.without))[0]
        return list(made)
    if isinstance(solid, Moved):
        made = _shape(occ, solid.shape)
        occ.translate(made, *_three(solid.by))
        return made
    if isinstance(solid, Turned):
        made = _shape(occ, solid.shape)
        _turn(occ, made, solid.angle, solid.axis, solid.about)
        return made
    assert isinstance(solid, Repeated)
    first = _shape(occ, solid.shape)
    copies = []
    steps = [[i * s for i in range(n)] for n, s in zip(solid.counts, solid.spacing, strict=True)]
    for by in list(itertools.product(*steps))[1:]:
        copies += occ.copy(first)
        occ.translate(copies[-len(first) :], *_three(by))
    return list(occ.fuse(first, copies)[0]) if copies else first


def _box(occ: Any, lower: Any, size: Any) -> Tags:
    if len(size) == 2:
        return [(2, occ.addRectangle(*_three(lower), *size))]
    return [(3, occ.addBox(*lower, *size))]


def _turn(occ: Any, made: Tags, angle: float, axis: str | None, about: Any) -> None:
    direction = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}[axis or "z"]
    occ.rotate(made, *_three(about), *direction, math.radians(angle))


def _prism(occ: Any, solid: Wedge | Extrusion) -> Tags:
    corners = np.zeros((len(solid._corners), 3))
    corners[:, list(solid._plane)] = solid._corners
    flat = solid.dimension == 2
    if not flat:
        corners[:, solid._third] = solid._ends[0]
    points = [occ.addPoint(*corner) for corner in corners.tolist()]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    face = [(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))]
    if flat:
        return face
    by = [0.0, 0.0, 0.0]
    by[solid._third] = solid._ends[1] - solid._ends[0]
    return [tag for tag in occ.extrude(face, *by) if tag[0] == 3]


def _surface(gmsh: Any, solid: SurfaceMesh, label: str) -> None:
    """Describe what a closed surface encloses, its faces found by the angles between triangles."""
    surface = solid._surface
    if not surface.closed:
        raise SceneError(
            f"{label}: the surface in '{solid.file}' has {surface.open_edges} open and "
            f"{surface.flipped} badly oriented edges; expected a closed one; repair it, or use "
            "mesher='lattice', which decides by winding numbers"
        )
    corners = surface.corners * solid.scale + np.asarray(solid.offset)
    model = gmsh.model
    tag = model.addDiscreteEntity(2)
    model.mesh.addNodes(2, tag, np.arange(1, len(corners) + 1), corners.ravel())
    model.mesh.addElementsByType(tag, 2, [], (surface.faces + 1).ravel())
    model.mesh.classifySurfaces(math.radians(_SHARP), True, True, math.pi)
    model.mesh.createGeometry()
    loop = model.geo.addSurfaceLoop([tag for _, tag in model.getEntities(2)])
    model.geo.addVolume([loop])
    model.geo.synchronize()
