"""`SurfaceMesh`: solids enclosed by a surface mesh (STL, OBJ, PLY, ...)."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.base.declarations import given
from libmpm._src.base.file_digest import file_state
from libmpm._src.base.values import Checker, value
from libmpm._src.errors import SceneError
from libmpm._src.shapes.mesh_distance import TriangleTree
from libmpm._src.shapes.mesh_file import Surface, read_surface
from libmpm._src.shapes.shape_files import check_file
from libmpm._src.shapes.solid import Array, Bounds, Solid

__all__ = ["SurfaceMesh"]


@value
class SurfaceMesh(Solid):
    """What a surface mesh in a file encloses, in 3D.

    {fields}

    Corners that are equal are one. The magnitude of the distance is exact, to the triangles; the
    sign follows from winding numbers. A mesh that is inside out as a whole is turned round. Of a
    healed one the surface across a hole is not among the triangles: there `distance` may jump.

    The scene refers to the file, which must stay where it is, unchanged. Needs trimesh or meshio:
    `pip install libmpm[mesh]`. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.SurfaceMesh"

    file: str = given(
        ".stl, .obj, .ply or .off, read by trimesh; what else meshio reads (.inp, .msh, "
        ".vtk, .vtu, ...): its triangles and quadrilaterals, or the outside of its solid "
        "elements",
        range="a path",
    )
    scale: float = given(
        "factor on the coordinates of the file, to m", default=1.0, unit="1", above=0, scales="m"
    )
    offset: Sequence[float] | None = given(
        "added to them after that; None = zero", default=None, unit="m", shape="(3,)"
    )
    heal: str | None = given(
        '"winding" takes an open or badly oriented mesh: inside is where the triangles wind '
        "around a point more than half (Jacobson et al. 2013); None = refused",
        default=None,
        range="a name",
    )
    sha256: str | None = given(
        "64, of the file; None = as it is now, then kept in the scene", default=None, range="digits"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        file, digest = check_file(check, self.file, self.sha256)
        scale = check.given("scale", self)
        offset: tuple[float, ...] = (0.0, 0.0, 0.0)
        if self.offset is not None:
            offset = check.given("offset", self)
        if self.heal is not None:
            check.choice("heal", self.heal, ("winding",))
        if digest is not None and not check.problems:
            try:
                surface = read_surface(*file_state(file))
            except SceneError as error:
                check.problems += error.problems
            else:
                if self.heal is None and not surface.closed:
                    check.fail(_defects(file, surface))
        return {"file": file, "scale": scale, "offset": offset, "sha256": digest}

    @property
    def _surface(self) -> Surface:
        return read_surface(*file_state(self.file))

    @property
    def _tree(self) -> TriangleTree:
        assert self.offset is not None  # checked
        return _tree(file_state(self.file), self.scale, tuple(self.offset))

    @property
    def dimension(self) -> int:
        """Number of axes, 3."""
        return 3

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one: where it is closed."""
        return self._surface.closed

    def report(self) -> dict[str, int]:
        """Return numbers of what the file has.

        "triangles"; "collapsed" ones, left out; "open_edges", which an odd number of triangles
        have; "flipped_edges", whose triangles do not agree on the orientation; "parts".
        """
        found = self._surface
        return {
            "triangles": len(found.faces),
            "collapsed": found.collapsed,
            "open_edges": found.open_edges,
            "flipped_edges": found.flipped,
            "parts": found.parts,
        }

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around the triangles, m."""
        corners = self._surface.triangles.reshape(-1, 3) * self.scale + np.asarray(self.offset)
        return tuple(corners.min(axis=0).tolist()), tuple(corners.max(axis=0).tolist())

    def volume(self) -> float | None:
        """Return the volume of a closed mesh of one part, m³; None of others, which may overlap."""
        surface = self._surface
        if not surface.closed or surface.parts > 1:
            return None
        return abs(surface.volume()) * self.scale * self.scale * self.scale

    def _distance(self, p: Array) -> Array:
        far = self._tree.distance(p)
        return np.where(self._inside(p), -far, far)

    def _inside(self, p: Array) -> npt.NDArray[np.bool_]:
        turns = self._tree.winding(p)
        return np.asarray((turns if self._surface.volume() >= 0 else -turns) > 0.5)


@functools.lru_cache(maxsize=4)
def _tree(state: tuple[str, int, int], scale: float, offset: tuple[float, ...]) -> TriangleTree:
    return TriangleTree(read_surface(*state).triangles * scale + np.asarray(offset))


def _defects(file: str, surface: Surface) -> str:
    found = []
    if surface.open_edges:
        found.append(f"{surface.open_edges} open edges")
    if surface.flipped:
        found.append(f"{surface.flipped} edges whose triangles are oriented differently")
    return (
        f"file '{file}': the mesh has {' and '.join(found)} among {len(surface.faces)} triangles; "
        'expected a closed surface; repair it, or use heal="winding", which decides by winding '
        "numbers what is inside"
    )
