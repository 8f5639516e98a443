"""A mesh of triangles as a value."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arrays import real_array
from libmpm._src.base.declarations import given
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, Value, keywords_only, shown, value
from libmpm._src.errors import SceneError
from libmpm._src.grids import sources
from libmpm._src.grids.sources import Arrays, Floats, Numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Mesh", "cross", "pairs"]

#: Smallest angle in degrees below which a triangle counts as a sliver.
_SLIVER = 10.0
#: Distance, in sizes of the mesh, within which two vertices are one.
_SAME = 1e-12
#: Distance, in sizes of the mesh, up to which a point beside the outline is inside.
_BESIDE = 1e-9


@value
class Mesh(Value):
    """A triangulation of a region of the plane.

    {fields}

    Corners are counter-clockwise; a clockwise triangle is turned by exchanging its last two. Every
    triangle has an area, and an edge belongs to one triangle or to two on opposite sides of it.
    Coordinates are relative to the scene's `origin`. Raises `SceneError` with every broken rule.

    `blocks`, `squares`, `delaunay` and `load` make meshes. Source: de Koster (2018) 3.5 and 4.1.
    """

    label: ClassVar[str] = "grids.Mesh"

    vertices: Sequence[Sequence[float]] | npt.NDArray[Any] = given(
        "positions, finite, no two the same, each used by a triangle", unit="m", shape="(n, 2)"
    )
    triangles: Sequence[Sequence[int]] | npt.NDArray[Any] = given(
        "vertex numbers 0 to n - 1 of the corners, m ≥ 1", shape="(m, 3)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        vertices = _vertices(check, self.vertices)
        triangles = _triangles(check, self.triangles)
        if vertices is None or triangles is None:
            return {}
        _check_duplicates(check, vertices)
        outside = ((triangles < 0) | (triangles >= len(vertices))).any(axis=1)
        if outside.any():
            last = len(vertices) - 1
            check.fail(
                f"triangles has numbers outside 0 to {last} in rows {marked(outside)}; expected "
                f"those of the {last + 1} vertices; count from 0"
            )
            return {}
        thin = sources.flat(vertices[triangles])
        if thin.any():
            check.fail(
                f"triangles {marked(thin)} have no area; expected corners that are not in a line; "
                "remove them or move a vertex"
            )
        unused = np.ones(len(vertices), dtype=bool)
        unused[triangles] = False
        if unused.any():
            check.fail(
                f"vertices {marked(unused)} belong to no triangle; expected each to be a corner; "
                "leave them out"
            )
        clockwise = _areas(vertices[triangles]) < 0
        triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
        _check_edges(check, triangles[~thin])
        return {
            "vertices": tuple(map(tuple, vertices.tolist())),
            "triangles": tuple(map(tuple, triangles.tolist())),
        }

    @classmethod
    @keywords_only("grids.Mesh.blocks")
    def blocks(
        cls, *, columns: int, rows: int, lower: Sequence[float], upper: Sequence[float]
    ) -> Mesh:
        """Cut a rectangle into equal blocks, each into four triangles by its centre.

        =============  ====  ======  ======================================================
        parameter      unit  range   meaning
        =============  ====  ======  ======================================================
        columns, rows  -     ≥ 1     number of blocks on the first and the second axis
        lower, upper   m     (2,)    opposite corners of the rectangle, upper > lower
        =============  ====  ======  ======================================================

        (columns + 1)(rows + 1) + columns · rows vertices: the corners of the blocks row by row,
        then the centres. Triangles block by block: bottom, right, top, left. Raises `SceneError`.
        Source: de Koster (2018) figure 4.2.
        """
        lattice = sources.check_lattice("grids.Mesh.blocks", columns, rows, lower, upper)
        return cls._of(sources.blocks(*lattice))

    @classmethod
    @keywords_only("grids.Mesh.squares")
    def squares(
        cls,
        *,
        columns: int,
        rows: int,
        lower: Sequence[float],
        upper: Sequence[float],
        diagonal: Literal["same", "alternate"] = "same",
    ) -> Mesh:
        """Cut a rectangle into equal smaller ones, each into two triangles by a diagonal.

        Arguments as of `blocks`. `diagonal`: "same" takes the rising diagonal everywhere,
        "alternate" the rising and the falling one in turn, like a chessboard (union jack).
        (columns + 1)(rows + 1) vertices row by row. Raises `SceneError`.
        Source: de Koster (2018) 3.6.
        """
        label = "grids.Mesh.squares"
        check = Checker(label)
        check.choice("diagonal", diagonal, ("same", "alternate"))
        check.finish()
        lattice = sources.check_lattice(label, columns, rows, lower, upper)
        return cls._of(sources.squares(*lattice, alternate=diagonal == "alternate"))

    @classmethod
    @keywords_only("grids.Mesh.delaunay", 1)
    def delaunay(cls, vertices: Sequence[Sequence[float]] | npt.NDArray[Any]) -> Mesh:
        """Triangulate the convex hull of vertices, (n, 2) in m with n ≥ 3.

        Delaunay's rule avoids slivers where the vertices allow it. Needs scipy:
        ``pip install libmpm[triangular]``. Raises `SceneError`, also without scipy.
        Source: de Koster (2018) 2.4.
        """
        return cls._of(sources.delaunay(vertices))

    @classmethod
    @keywords_only("grids.Mesh.load", 1)
    def load(cls, path: str | os.PathLike[str]) -> Mesh:
        """Read a mesh file (.msh, .vtk, .vtu, .xdmf, ...) with coordinates in m.

        Its two-dimensional cells must be straight triangles, in a plane of constant z. Lines and
        points are ignored, vertices that no triangle uses are dropped. Needs meshio:
        ``pip install libmpm[triangular]``. Raises `SceneError`, also without meshio.
        """
        arrays = sources.read(path)
        try:
            return cls._of(arrays)
        except SceneError as error:
            label = f"grids.Mesh.load: file '{path}'"
            raise SceneError(f"{label}: {problem}" for problem in error.problems) from error

    @classmethod
    def _of(cls, arrays: Arrays) -> Mesh:
        return cls(vertices=arrays[0], triangles=arrays[1])

    def __repr__(self) -> str:
        """Return a short description; the call that makes a mesh would be as long as its lists."""
        return f"<{self.label}: {len(self.vertices)} vertices, {len(self.triangles)} triangles>"

    def arrays(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Return vertices (n, 2) in m, float64, and triangles (m, 3), int64, as new arrays."""
        vertices = np.array(self.vertices, dtype=np.float64)
        return vertices, np.array(self.triangles, dtype=np.int64)

    def corners(self) -> npt.NDArray[np.float64]:
        """Return the corners of every triangle, counter-clockwise, (m, 3, 2) in m."""
        vertices, triangles = self.arrays()
        return vertices[triangles]

    def areas(self) -> npt.NDArray[np.float64]:
        """Return the area of every triangle, (m,) in m²."""
        return _areas(self.corners())

    @cached_property
    def area(self) -> float:
        """Area of the region, m²."""
        return float(self.areas().sum())

    @cached_property
    def lower(self) -> tuple[float, float]:
        """Smallest coordinate on each axis, m."""
        x, y = self.arrays()[0].min(axis=0).tolist()
        return x, y

    @cached_property
    def upper(self) -> tuple[float, float]:
        """Largest coordinate on each axis, m."""
        x, y = self.arrays()[0].max(axis=0).tolist()
        return x, y

    @cached_property
    def shortest_edge(self) -> float:
        """Length of the shortest edge, m."""
        return float(np.hypot(*np.moveaxis(self._edges(), 2, 0)).min())

    @cached_property
    def smallest_angle(self) -> float:
        """Smallest angle of a triangle, degrees, at most 60."""
        edges = self._edges()
        before = np.roll(edges, 1, axis=1)
        sine = np.abs(cross(before, edges))
        cosine = -(before * edges).sum(axis=2)
        return float(np.degrees(np.arctan2(sine, cosine)).min())

    def _edges(self) -> Floats:
        """Return the vector from every corner to the next one, (m, 3, 2) in m."""
        corners = self.corners()
        return np.roll(corners, -1, axis=1) - corners

    def outline(self) -> npt.NDArray[np.int64]:
        """Return the edges of one triangle only, (k, 2) vertex numbers, the region on the left."""
        edges, other = pairs(self.arrays()[1])
        return edges[other < 0]

    def contains(self, points: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return for points (n, 2) in m whether they are in the region or on its outline, (n,)."""
        from matplotlib.tri import Triangulation

        places = np.asarray(points, dtype=np.float64).reshape(-1, 2) - self.lower
        vertices, triangles = self.arrays()
        vertices -= self.lower
        triangulation = Triangulation(vertices[:, 0], vertices[:, 1], triangles)
        try:
            found: Any = triangulation.get_trifinder()
        except RuntimeError as error:
            raise SceneError(
                f"grids.Mesh: {str(error).lower()}; expected triangles that meet in whole edges "
                "and do not overlap; repair the mesh"
            ) from error
        inside = np.asarray(found(places[:, 0], places[:, 1]) >= 0)
        # The search may put a point of the outline on either side of it.
        reach = _BESIDE * float(np.hypot(*vertices.max(axis=0)))
        boxed = ((places >= -reach) & (places <= vertices.max(axis=0) + reach)).all(axis=1)
        left = np.flatnonzero(~inside & boxed)
        inside[left] = _beside(places[left], vertices[self.outline()], reach)
        return inside

    def doubts(self) -> list[str]:
        """Return what may spoil a result on this mesh, as texts for a `ModelWarning`."""
        if self.smallest_angle >= _SLIVER:
            return []
        return [
            f"{self.label}: the smallest angle is {self.smallest_angle:.3g} degrees; expected "
            f"{_SLIVER:g} or more, since slivers make the method unstable; move or remove vertices"
        ]

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the edges into matplotlib axes, new ones by default, and return the axes.

        `style` goes to ``Axes.triplot``, for instance ``color="k", linewidth=0.5``.
        """
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots()[1]
            ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        vertices, triangles = self.arrays()
        ax.triplot(vertices[:, 0], vertices[:, 1], triangles, **style)
        return ax


def _beside(places: Floats, edges: Floats, reach: float) -> npt.NDArray[np.bool_]:
    """Return for points (n, 2) whether one of the edges (k, 2, 2) is within reach, (n,).

    Edge by edge, of the points sorted along x those in the edge's box alone: the cost of many
    points far from the outline is that of sorting them.
    """
    found = np.zeros(len(places), dtype=bool)
    order = np.argsort(places[:, 0])
    x, y = places[order].T
    low, high = edges.min(axis=1) - 2 * reach, edges.max(axis=1) + 2 * reach
    first, last = np.searchsorted(x, low[:, 0]), np.searchsorted(x, high[:, 0], side="right")
    for (start, end), a, b, bottom, top in zip(
        edges, first, last, low[:, 1], high[:, 1], strict=True
    ):
        near = order[a:b][(y[a:b] >= bottom) & (y[a:b] <= top)]
        along, from_start = end - start, places[near] - start
        part = ((from_start * along).sum(axis=1) / (along**2).sum()).clip(0, 1)
        nearest = from_start - part[:, None] * along
        found[near] |= np.hypot(*nearest.T) <= reach
    return found


def pairs(triangles: Numbers) -> tuple[Numbers, Numbers]:
    """Return the directed edges (3 m, 2) of triangles, and for each the one in reverse or -1.

    Edge 3 t + k leads from corner k of triangle t to the next one. No edge may be there twice.
    """
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    key, reverse = _keys(edges), _keys(edges[:, ::-1])
    order = np.argsort(key)
    place = np.searchsorted(key[order], reverse).clip(max=len(key) - 1)
    other = order[place]
    return edges, np.where(key[other] == reverse, other, -1)


def _keys(edges: Numbers) -> Numbers:
    """Return one number for every pair of vertex numbers."""
    return np.asarray(edges[:, 0] * (edges.max() + 1) + edges[:, 1])


def cross(a: Floats, b: Floats) -> Floats:
    """Return a_x b_y - a_y b_x of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _areas(corners: Floats) -> Floats:
    """Return the areas of triangles (m, 3, 2), negative for clockwise ones."""
    return cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2


def _vertices(check: Checker, item: Any) -> Floats | None:
    try:
        array = real_array(item, "vertices").copy()
    except (OverflowError, TypeError, ValueError):
        check.fail(f"vertices is not a table of numbers: {shown(item, 80)}; expected (n, 2) in m")
        return None
    if array.ndim != 2 or array.shape[1] != 2 or len(array) < 3:
        check.fail(f"vertices has shape {array.shape}; expected (n, 2) in m with n ≥ 3")
        return None
    wrong = ~np.isfinite(array).all(axis=1)
    if wrong.any():
        check.fail(f"vertices {marked(wrong)} are not finite; expected two numbers in m")
        return None
    return array


def _triangles(check: Checker, item: Any) -> Numbers | None:
    try:
        array = np.array(item)
    except (OverflowError, TypeError, ValueError):
        array = np.array(None)
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3 or not len(array):
        check.fail(
            f"triangles has shape {array.shape} and type {array.dtype}; expected (m, 3) whole "
            "numbers of vertices with m ≥ 1"
        )
        return None
    return array.astype(np.int64)


def _check_duplicates(check: Checker, vertices: Floats) -> None:
    low = vertices.min(axis=0)
    near = (vertices - low) / (2 * _SAME * max(np.hypot(*(vertices.max(axis=0) - low)), 1e-300))
    # Two vertices within half a cell of each other share a cell of one of the four lattices.
    for shift in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)):
        _, number, count = np.unique(
            np.floor(near + shift), axis=0, return_inverse=True, return_counts=True
        )
        several = np.flatnonzero(count > 1)
        if len(several):
            same = number.reshape(-1) == several[0]
            x, y = vertices[int(np.argmax(same))].tolist()
            more = f", and {len(several) - 1} more places" if len(several) > 1 else ""
            check.fail(
                f"vertices {marked(same)} are all at ({x:g}, {y:g}) m{more}; expected different "
                "places; merge them into one"
            )
            return


def _check_edges(check: Checker, triangles: Numbers) -> None:
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    both, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    for a, b in both[count > 2][:5].tolist():
        check.fail(
            f"the edge of vertices {a} and {b} belongs to more than two triangles; expected one "
            "or two; remove what overlaps"
        )
    if (count > 2).any():
        return
    directed, count = np.unique(edges, axis=0, return_counts=True)
    for a, b in directed[count > 1][:5].tolist():
        check.fail(
            f"the two triangles at the edge of vertices {a} and {b} lie on the same side of it; "
            "expected no overlap; correct or remove one"
        )
