"""Outlines of meshes of elements in a plane: edges of triangles, silhouettes, sections."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.pictures.outlines import Plane

__all__ = ["mesh_lines"]

Array = NDArray[np.float64]


def mesh_lines(mesh: ElementMesh, plane: Plane) -> Array:
    """Return pieces of the outline of a mesh as pairs of points (k, 2, 2) m of the picture.

    In 2D its outer edges; in 3D where a cut meets its surface, without one its silhouette: edges of
    the surface between a face that looks here and one that looks away.
    """
    surface = mesh.surface
    if plane.hidden is None:
        return _flat(plane, mesh.vertices[surface])
    if plane.cut is not None:
        return _flat(plane, _section(mesh.vertices[surface], plane.hidden, plane.cut[plane.hidden]))
    x = mesh.vertices[surface]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])[:, plane.hidden]
    here = np.tile(normal > 0, 3)
    edges = np.sort(np.concatenate([surface[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    order = np.lexsort(edges.T)
    edges, here = edges[order], here[order]
    first = np.flatnonzero(np.r_[True, (edges[1:] != edges[:-1]).any(axis=1)])
    looks = np.add.reduceat(here.astype(int), first)
    count = np.diff(np.r_[first, len(edges)])
    rim = (looks > 0) & (looks < count)
    return _flat(plane, mesh.vertices[edges[first[rim]]])


def _flat(plane: Plane, ends: Array) -> Array:
    """Return ends (k, 2, d) m of the scene as they lie in the picture."""
    d = ends.shape[-1]
    return plane.flat(ends.reshape(-1, d)).reshape(-1, 2, 2)


def _section(faces: Array, axis: int, at: float) -> Array:
    """Return where triangles (k, 3, 3) meet the plane across an axis, (n, 2, 3)."""
    high = faces[:, :, axis] > at
    some = faces[high.any(axis=1) & ~high.all(axis=1)]
    high = some[:, :, axis] > at
    # The corner that is alone on its side, first.
    alone = np.argmax(high == (high.sum(axis=1) == 1)[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    corner = np.take_along_axis(some, order[:, :, None], axis=1)
    ends = []
    for other in (1, 2):
        rise = corner[:, other, axis] - corner[:, 0, axis]
        share = (at - corner[:, 0, axis]) / np.where(rise == 0, 1.0, rise)
        ends.append(corner[:, 0] + share[:, None] * (corner[:, other] - corner[:, 0]))
    return np.stack(ends, axis=1)
