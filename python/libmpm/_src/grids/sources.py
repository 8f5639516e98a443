"""Vertices and triangles of regular meshes, of point clouds and of mesh files."""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker
from libmpm._src.errors import SceneError
from libmpm._src.shapes.mesh_file import is_without_end

__all__ = ["Arrays", "blocks", "check_lattice", "delaunay", "flat", "read", "squares"]

Floats = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Arrays = tuple[Floats, Numbers]

#: Twice the area of a triangle, in squares of its longest edge, up to which it has none.
_FLAT = 1e-9
#: The same for triangles on the hull of points, which need not be there.
_ROUNDED = 1e-5
#: Part of the size of a mesh by which a plane may bulge.
_PLANE = 1e-9
#: Cells of a file that are no part of the plane but of its outline.
_IGNORED = ("vertex", "line")


def flat(corners: Floats, part: float = _FLAT) -> npt.NDArray[np.bool_]:
    """Return which triangles, corners (m, 3, 2), are too thin to have an area, shape (m,)."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = (edges**2).sum(axis=2).max(axis=1)
    twice = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    return np.asarray(~(np.abs(twice) > part * longest))


#: Rectangles of a regular mesh; they take some hundred bytes each.
_MOST_BLOCKS = 10_000_000


def check_lattice(
    label: str, columns: Any, rows: Any, lower: Any, upper: Any
) -> tuple[int, int, Floats, Floats]:
    """Return the converted arguments of a regular mesh; raises `SceneError`."""
    check = Checker(label)
    columns = check.integer("columns", columns, lower=1)
    rows = check.integer("rows", rows, lower=1)
    low = check.vector("lower", lower, lengths=(2,), unit="m")
    high = check.vector("upper", upper, lengths=(2,), unit="m")
    for a, (x, y) in enumerate(zip(low, high, strict=False)):
        if x >= y:
            check.fail(f"upper[{a}] is {y:g} with lower[{a}] {x:g}; expected upper > lower")
    if columns * rows > _MOST_BLOCKS:
        check.fail(
            f"columns × rows is {columns * rows}; expected ≤ {_MOST_BLOCKS} blocks, which fit into "
            "memory; use fewer"
        )
    check.finish()
    return columns, rows, np.array(low), np.array(high)


def _lattice(columns: int, rows: int, lower: Floats, upper: Floats) -> tuple[Floats, Numbers]:
    """Return points (n, 2), first axis fastest, and corners (rows · columns, 4) of rectangles."""
    x = np.linspace(lower[0], upper[0], columns + 1)
    y = np.linspace(lower[1], upper[1], rows + 1)
    points = np.column_stack([np.tile(x, rows + 1), np.repeat(y, columns + 1)])
    j, i = np.divmod(np.arange(rows * columns), columns)
    first = j * (columns + 1) + i
    corners = np.stack([first, first + 1, first + columns + 2, first + columns + 1], axis=1)
    return points, corners


def blocks(columns: int, rows: int, lower: Floats, upper: Floats) -> Arrays:
    """Cut every rectangle into four triangles by its centre: bottom, right, top, left."""
    points, corners = _lattice(columns, rows, lower, upper)
    centres = (points[corners[:, 0]] + points[corners[:, 2]]) / 2
    centre = len(points) + np.arange(len(corners))
    parts = [np.stack([corners[:, k], corners[:, (k + 1) % 4], centre], axis=1) for k in range(4)]
    return np.concatenate([points, centres]), np.stack(parts, axis=1).reshape(-1, 3)


def squares(columns: int, rows: int, lower: Floats, upper: Floats, alternate: bool) -> Arrays:
    """Cut every rectangle into two triangles by a diagonal, the rising one where i + j is even."""
    points, corners = _lattice(columns, rows, lower, upper)
    rising = corners[:, [0, 1, 2, 0, 2, 3]]
    if alternate:
        j, i = np.divmod(np.arange(rows * columns), columns)
        odd = ((i + j) % 2 == 1)[:, None]
        rising = np.where(odd, corners[:, [0, 1, 3, 1, 2, 3]], rising)
    return points, rising.reshape(-1, 3)


def delaunay(vertices: Any) -> Arrays:
    """Triangulate the convex hull of points (n, 2) by Delaunay's rule."""
    label = "grids.Mesh.delaunay"
    spatial = need("scipy.spatial", label)
    try:
        points = np.asarray(vertices, dtype=np.float64)
    except (OverflowError, RecursionError, TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise SceneError(
            f"{label}: vertices has shape {points.shape}; expected (n, 2) numbers in m, n ≥ 3"
        )
    if not np.isfinite(points).all():
        row = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise SceneError(f"{label}: vertices[{row}] is not finite; expected two numbers in m")
    # Coordinates far from zero would cost the triangulation its digits.
    near = points - points.min(axis=0)
    try:
        found = spatial.Delaunay(near)
    except spatial.QhullError as error:
        raise SceneError(
            f"{label}: the {len(points)} vertices lie on a line; expected some beside it; add them"
        ) from error
    triangles = found.simplices.astype(np.int64)
    # Points in a row on the hull, rounded as files have them, are joined by triangles that are thin
    # to that rounding: they go from the hull inwards, as far as there are any.
    thin, stays = flat(near[triangles], _ROUNDED), np.ones(len(triangles), dtype=bool)
    while True:
        outer = (found.neighbors < 0) | ~stays[found.neighbors]
        goes = stays & thin & outer.any(axis=1)
        if not goes.any():
            return points, triangles[stays]
        stays &= ~goes


def read(path: str | os.PathLike[str]) -> Arrays:
    """Read the triangles of a mesh file, without the vertices that none of them uses."""
    label = f"grids.Mesh.load: file '{path}'"
    meshio = need("meshio", "grids.Mesh.load")
    if not Path(path).is_file():
        raise SceneError(f"{label} does not exist; expected a mesh file; correct the path")
    if is_without_end(Path(path)):
        raise SceneError(f"{label} is cut; expected counts, vertices, triangles; write it again")
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            found = meshio.read(path)
    # Readers raise what they like at a damaged file; meshio itself prints and ends the program.
    except (Exception, SystemExit) as error:
        why = " ".join(said.getvalue().split()) or str(error)
        raise SceneError(
            f"{label} cannot be read ({why}); expected a format of meshio; write it as .msh or .vtk"
        ) from error
    check = Checker(label)
    parts = []
    for block in found.cells:
        if block.type == "triangle":
            parts.append(np.asarray(block.data, dtype=np.int64))
        elif not block.type.startswith(_IGNORED):
            check.fail(
                f"has {len(block.data)} cells of type '{block.type}'; expected 'triangle' only; "
                "export straight three-cornered cells"
            )
    triangles = np.concatenate(parts) if parts else np.empty((0, 3), dtype=np.int64)
    if len(triangles) == 0:
        check.fail("has no cells of type 'triangle'; expected one or more")
        check.finish()
    points = np.asarray(found.points, dtype=np.float64)
    used, numbers = np.unique(triangles, return_inverse=True)
    if used[0] < 0 or used[-1] >= len(points):
        check.fail(
            f"has triangles of points {used[0]} to {used[-1]} and {len(points)} points; expected "
            "numbers of points; write the file again"
        )
        check.finish()
    points = points[used]
    if points.shape[1] > 2:
        spread = np.ptp(points, axis=0)
        if spread[2] > _PLANE * spread.max():
            check.fail(
                f"has z from {points[:, 2].min():g} to {points[:, 2].max():g} m; expected one "
                "value; turn the mesh into the x-y plane"
            )
    check.finish()
    return points[:, :2], numbers.reshape(triangles.shape)
