"""What a mesh of elements encloses, as a solid: for what must not lie inside it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.mesh_distance import TriangleTree
from libmpm._src.shapes.polygon import segments_distance
from libmpm._src.shapes.solid import Array, Bounds, Solid

__all__ = ["MeshInside"]


class MeshInside(Solid):
    """The inside of a mesh, by the distance from its outer faces; never part of a scene."""

    label = "shapes.ElementMesh"

    def __init__(self, mesh: ElementMesh) -> None:
        """Take a mesh; the tree of its faces is made when first asked for."""
        self.mesh = mesh

    def _content(self) -> tuple[Any, ...]:
        return (self.mesh,)

    def __getstate__(self) -> dict[str, Any]:
        """Return no parts: it is made of no other solids."""
        return {}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self.mesh.dimension

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around it, m."""
        return self.mesh.bounds()

    def volume(self) -> float:
        """Return the volume of all elements, m³ (m² in 2D)."""
        return self.mesh.total_volume()

    @cached_property
    def _tree(self) -> TriangleTree:
        return TriangleTree(self.mesh.positions()[self.mesh.surface])

    def _distance(self, p: Array) -> Array:
        if self.dimension == 2:
            ends = self.mesh.positions()[self.mesh.surface]
            return segments_distance(ends[:, 0], ends[:, 1], p[:, 0], p[:, 1])
        far = self._tree.distance(p)
        return np.where(self._inside(p), -far, far)

    def _inside(self, p: Array) -> npt.NDArray[np.bool_]:
        if self.dimension == 2:
            return super()._inside(p)
        return np.asarray(self._tree.winding(p) > 0.5)
