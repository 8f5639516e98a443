"""Reading meshes of elements: whatever meshio reads, and tables of vertices and elements."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from libmpm._src.base.values import shown
from libmpm._src.errors import SceneError
from libmpm._src.shapes.element_topology import Numbers, determinants, doubles, faces, parts
from libmpm._src.shapes.mesh_file import is_without_end
from libmpm._src.shapes.solid import Array

__all__ = ["read_mesh", "read_tables", "tidied"]

#: Cells by meshio's names that hold an element, by dimension; of curved ones the corners count.
_CELLS = {2: ("triangle", "triangle6", "triangle7"), 3: ("tetra", "tetra10")}
#: Cells of a mesh that say nothing of its volume.
_BESIDE = {
    2: ("vertex", "line", "line3"),
    3: ("vertex", "line", "line3", "triangle", "triangle6", "triangle7", "quad", "quad8", "quad9"),
}


def read_mesh(path: str | Path, dimension: int, label: str) -> tuple[Array, Numbers]:
    """Return vertices and elements in a file; raises `SceneError`."""
    if not isinstance(path, str | Path) or not str(path):
        raise SceneError(f"{label}: path is {shown(path)}; expected the path of a file")
    what = f"{label}: file '{path}'"
    try:
        if not Path(path).is_file():
            raise SceneError(f"{what} is not there; expected a mesh; give a path from here")
        if is_without_end(Path(path)):
            raise SceneError(f"{what} is cut; expected a head, vertices and cells; write it again")
        found = importlib.import_module("meshio").read(path)
    except SceneError:
        raise
    # Readers of many formats raise whatever they come upon, one of them SystemExit.
    except (Exception, SystemExit) as error:
        raise SceneError(
            f"{what} cannot be read as a mesh: {error}; expected a format of meshio (.msh, .vtk, "
            ".vtu, .inp, ...); write it again, or as tables, for read_tables"
        ) from error
    cells = [(b.type, np.asarray(b.data, dtype=np.int64)) for b in found.cells if len(b.data)]
    wanted = _CELLS[dimension]
    others = {kind for kind, _ in cells} - {*wanted, *_BESIDE[dimension]}
    if others:
        raise SceneError(
            f"{what} has cells of type {', '.join(sorted(others))}; expected {wanted[0]}s; mesh "
            f"it again with {wanted[0]}s, or split the cells in the mesher"
        )
    blocks = [data[:, : dimension + 1] for kind, data in cells if kind in wanted]
    if not blocks:
        kinds = ", ".join(sorted({kind for kind, _ in cells})) or "nothing"
        raise SceneError(
            f"{what} has {kinds} and no {wanted[0]}; expected a mesh of the inside; fill a surface "
            "by fill(solid=shapes.SurfaceMesh(file=...), edge=...)"
        )
    points = np.array(found.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < dimension:
        raise SceneError(f"{what} has points of shape {points.shape}; expected (n, {dimension})")
    if dimension == 2 and points.shape[1] == 3:
        if np.ptp(points[:, 2]) > 0:
            raise SceneError(
                f"{what} has points from z = {points[:, 2].min():g} to {points[:, 2].max():g}; "
                "expected a plane mesh of one z; use Tetrahedra, or a plane mesh"
            )
        points = points[:, :2]
    return points, np.concatenate(blocks)


def read_tables(
    vertices: str | Path, elements: str | Path, dimension: int, first: int, label: str
) -> tuple[Array, Numbers]:
    """Return vertices and elements of two text files, a row each; raises `SceneError`."""
    points = _table(vertices, dimension, "vertices", label)
    rows = _table(elements, dimension + 1, "elements", label)
    if not (rows == np.rint(rows)).all():
        raise SceneError(
            f"{label}: file '{elements}' has numbers that are not whole; expected vertex numbers"
        )
    return points, rows.astype(np.int64) - first


def _table(path: str | Path, columns: int, what: str, label: str) -> Array:
    # A whole number would be a file that is open already, and closed here.
    if not isinstance(path, str | Path) or not str(path):
        raise SceneError(f"{label}: {what} is {shown(path)}; expected the path of a file")
    try:
        with open(path, encoding="utf-8") as file:
            head = file.readline()
        named = _is_text(head.replace(",", " ").split())
        found = np.loadtxt(path, delimiter="," if "," in head else None, skiprows=named, ndmin=2)
    except (OSError, ValueError, TypeError) as error:
        raise SceneError(
            f"{label}: file '{path}' of the {what} cannot be read: {error}; expected a row of "
            f"{columns} numbers for each; write it so"
        ) from error
    if found.shape[1] != columns or not len(found) or not np.isfinite(found).all():
        raise SceneError(
            f"{label}: file '{path}' of the {what} has an array of shape {found.shape}; expected "
            f"(n, {columns}) finite numbers; leave other columns out"
        )
    return found


def _is_text(words: list[str]) -> int:
    try:
        return int(not [float(word) for word in words])
    except ValueError:
        return int(not words[0].startswith("#"))


def tidied(
    vertices: Array, elements: Numbers, *, weld: bool, part: int | None, label: str
) -> tuple[Array, Numbers]:
    """Return a mesh as read without loose vertices; welded; one of its parts.

    Parts are counted from the largest. Raises `SceneError`.
    """
    inside = ((elements >= 0) & (elements < len(vertices))).all()
    if not inside or not np.isfinite(vertices).all():
        return vertices, elements  # the checks say so
    if weld:
        size = float(np.ptp(vertices, axis=0).max())
        if size > 0:
            elements = doubles(vertices, 1e-6 * size)[elements]
    if part is not None:
        if isinstance(part, bool) or not isinstance(part, int) or part < 0:
            raise SceneError(
                f"{label}: part is {shown(part)}; expected a whole number ≥ 0, or None"
            )
        right = elements.copy()
        turned = determinants(vertices, right) < 0
        right[turned] = right[turned][:, [*range(right.shape[1] - 2), -1, -2]]
        which = parts(len(right), faces(right))
        sizes = np.bincount(which)
        if part >= len(sizes):
            raise SceneError(
                f"{label}: part is {part} of a mesh with {len(sizes)}; expected 0 to "
                f"{len(sizes) - 1}, from the largest"
            )
        elements = elements[which == np.argsort(-sizes, kind="stable")[part]]
    used, back = np.unique(elements, return_inverse=True)
    return vertices[used], np.asarray(back).reshape(elements.shape)
