"""Outer faces of meshes of elements that a load acts on, and what each vertex has of their area."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.solid import Array

__all__ = ["areas", "chosen_faces", "chosen_vertices", "shares"]

#: Of the longest edge: how far from a plane or beyond a box a vertex may be.
_SLACK = 1e-6


def chosen_faces(mesh: ElementMesh, face: str | None, within: Box | None) -> npt.NDArray[np.int64]:
    """Return vertices of outer faces, (k, d), in the order of `ElementMesh.surface`.

    `face` "x-", "x+", ...: those with all vertices at that end of the mesh's bounds. `within`:
    those with all vertices in a box or on its faces. Both: those of both.
    """
    surface = mesh.surface
    held = _answering(mesh, face, within)
    return surface[held[surface].all(axis=1)]


def chosen_vertices(
    mesh: ElementMesh, face: str | None, within: Box | None
) -> npt.NDArray[np.int64]:
    """Return the numbers of vertices, ascending: as `chosen_faces`, inner ones too."""
    return np.flatnonzero(_answering(mesh, face, within))


def _answering(mesh: ElementMesh, face: str | None, within: Box | None) -> npt.NDArray[np.bool_]:
    slack = _SLACK * mesh.longest_edge
    held = np.ones(mesh.count, dtype=bool)
    x = mesh.positions()
    if face is not None:
        axis, upper = "xyz".index(face[0]), face[1] == "+"
        end = x[:, axis].max() if upper else x[:, axis].min()
        held &= np.abs(x[:, axis] - end) <= slack
    if within is not None:
        held &= ((x >= np.asarray(within.lower) - slack)
                 & (x <= np.asarray(within.upper) + slack)).all(axis=1)  # fmt: skip
    return held


def areas(mesh: ElementMesh, faces: npt.NDArray[np.int64]) -> Array:
    """Return the area of each face at rest, (k,) m² (2D: its length, m)."""
    x = mesh.positions()
    one = x[faces[:, 1]] - x[faces[:, 0]]
    if mesh.dimension == 2:
        return np.asarray(np.linalg.norm(one, axis=1))
    two = x[faces[:, 2]] - x[faces[:, 0]]
    return np.asarray(0.5 * np.linalg.norm(np.cross(one, two), axis=1))


def shares(mesh: ElementMesh, faces: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], Array]:
    """Return vertices of faces, ascending, and the area of each, m² (2D: m).

    A d-th of each face's, as a load that is the same all over it has: ∫ N_a dA = A / d.
    """
    found = np.zeros(mesh.count)
    np.add.at(found, faces, (areas(mesh, faces) / mesh.dimension)[:, None])
    used = np.unique(faces)
    return used, found[used]
