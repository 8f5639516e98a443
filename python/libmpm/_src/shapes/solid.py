"""`Solid`: what every solid can do, and the arithmetic of points that they share.

All arithmetic is by columns of single numbers, never by products of matrices: a point's distance
has the same bits whichever other points it is asked for with.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import Value
from libmpm._src.errors import SceneError

if TYPE_CHECKING:
    from libmpm._src.shapes.combined import Difference, Intersection, Union

__all__ = ["Array", "Bounds", "Corner", "GivenPoints", "Shape", "Solid"]
__all__ += ["box_distance", "dot", "from_box", "length", "slab", "unit"]

Array = npt.NDArray[np.float64]
Corner = tuple[float, ...]
Bounds = tuple[Corner, Corner]


class Shape(Value):
    """Base of all shapes."""


class GivenPoints(Shape):
    """Base of the shapes whose points are given one by one: particles of a file, vertices."""

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        raise NotImplementedError

    @property
    def count(self) -> int:
        """Number of points."""
        raise NotImplementedError

    def positions(self) -> Array:
        """Return the positions (n, d), m."""
        raise NotImplementedError

    def total_volume(self) -> float:
        """Return the volume that all points stand for, m³ (m² in 2D)."""
        raise NotImplementedError

    def bounds(self) -> Bounds:
        """Return the corners of the smallest straight box around the points, m."""
        p = self.positions()
        return tuple(p.min(axis=0).tolist()), tuple(p.max(axis=0).tolist())


class Solid(Shape):
    """Base of the shapes that have an inside, known by the signed distance to their surface.

    Solids are put together by `a | b` (either), `a & b` (both) and `a - b` (a without b), moved by
    `moved`, turned by `turned` and laid out in rows by `repeated`. They fill bodies and serve as
    boundaries. Coordinates are in m relative to the scene's `origin`; in 2D a solid is a plane
    figure of unit thickness.
    """

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        raise NotImplementedError

    def bounds(self) -> Bounds:
        """Return lower and upper corner, (d,) m each, of a straight box around the solid.

        An end may be ±inf. Of primitives the box is the smallest one.
        """
        raise NotImplementedError

    def volume(self) -> float | None:
        """Return the volume in m³ (area in m² in 2D) where a formula gives it; else None."""
        return None

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one; so of all but open
        meshes."""
        return True

    def distance(self, points: npt.ArrayLike) -> Array:
        """Return the signed distance (n,) of points (n, d) from the surface, m; negative inside.

        Of primitives it is exact. Of combinations the sign is exact and the magnitude never above
        the true one. Raises `SceneError`.
        """
        p = np.asarray(points, dtype=np.float64)
        if p.ndim != 2 or p.shape[1] != self.dimension:
            raise SceneError(
                f"{self._label()}: distance is asked for points of shape {p.shape}; expected "
                f"(n, {self.dimension}), one row a point"
            )
        return self._distance(p)

    def _distance(self, p: Array) -> Array:
        """Return the signed distance of points (n, d) that have been checked."""
        raise NotImplementedError

    def _contains(self, p: Array) -> npt.NDArray[np.bool_]:
        """Return which points (n, d) lie inside, as the sign of the distance says.

        Asked are those in the solid's box alone; solids that know an inside without a distance
        say so in `_inside`.
        """
        if not self.bounding:
            return self._inside(p)
        found = self._in_box(p)
        found[found] = self._inside(p[found])
        return found

    def _in_box(self, p: Array, spare: float = 0.0) -> npt.NDArray[np.bool_]:
        """Return which points (n, d) lie in the solid's box or at most `spare` m beside it."""
        found = np.ones(len(p), dtype=np.bool_)
        for x, low, high in zip(p.T, *self.bounds(), strict=True):
            if np.isfinite(low) or np.isfinite(high):
                found &= (x >= low - spare) & (x <= high + spare)
        return found

    def _inside(self, p: Array) -> npt.NDArray[np.bool_]:
        """Return which points (n, d) lie inside."""
        return np.asarray(self._distance(p) < 0)

    def __or__(self, other: Solid) -> Union:
        """Return what is in either solid."""
        from libmpm._src.shapes.combined import Union

        return Union(parts=(self, other)) if isinstance(other, Solid) else NotImplemented

    def __and__(self, other: Solid) -> Intersection:
        """Return what is in both solids."""
        from libmpm._src.shapes.combined import Intersection

        return Intersection(parts=(self, other)) if isinstance(other, Solid) else NotImplemented

    def __sub__(self, other: Solid) -> Difference:
        """Return what is in this solid and not in the other."""
        from libmpm._src.shapes.combined import Difference

        if not isinstance(other, Solid):
            return NotImplemented
        return Difference(whole=self, without=other)

    @keywords_only("shapes.Solid.moved", 1)
    def moved(self, by: Sequence[float]) -> Solid:
        """Return the solid moved by (d,) m."""
        from libmpm._src.shapes.transformed import Moved

        return Moved(shape=self, by=by)

    @keywords_only("shapes.Solid.turned", 3)
    def turned(
        self, angle: float, axis: str | None = None, about: Sequence[float] | None = None
    ) -> Solid:
        """Return the solid turned by `angle` degrees, by the right-hand rule.

        From x to y in 2D; in 3D about "x", "y" or "z" (None = "z"). The point `about` (d,) m, the
        fulcrum, stays where it is; None = the middle of `bounds`.
        """
        from libmpm._src.shapes.transformed import Turned

        return Turned(shape=self, angle=angle, axis=axis, about=about)

    @keywords_only("shapes.Solid.repeated", 2)
    def repeated(self, counts: Sequence[int], spacing: Sequence[float]) -> Solid:
        """Return `counts` (d,) copies on each axis, `spacing` (d,) m apart; the first is here."""
        from libmpm._src.shapes.transformed import Repeated

        return Repeated(shape=self, counts=counts, spacing=spacing)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what can be worked out again."""
        fields = dataclasses.fields(self)  # type: ignore[arg-type]
        return {f.name: self.__dict__[f.name] for f in fields}


def dot(columns: Sequence[Array], vector: Sequence[float]) -> Array:
    """Return the projection of points, given by columns (n,), onto a vector."""
    total = columns[0] * vector[0]
    for column, v in zip(columns[1:], vector[1:], strict=True):
        total = total + column * v
    return np.asarray(total)


def length(columns: Sequence[Array]) -> Array:
    """Return the lengths (n,) of vectors given by columns."""
    total = columns[0] * columns[0]
    for column in columns[1:]:
        total = total + column * column
    return np.asarray(np.sqrt(total))


def unit(vector: Sequence[float]) -> Corner:
    """Return a vector at length 1."""
    size = math.sqrt(math.fsum(x * x for x in vector))
    if not size > 1e-150:  # squares that are no numbers any more
        most = max(map(abs, vector))
        vector = [x / most for x in vector]
        size = math.hypot(*vector)
    return tuple(x / size for x in vector)


def from_box(beyond: Sequence[Array]) -> Array:
    """Return the distance from a box of points that lie so far beyond its faces, per axis."""
    outside = length([np.maximum(q, 0.0) for q in beyond])
    nearest = beyond[0]
    for q in beyond[1:]:
        nearest = np.maximum(nearest, q)
    return np.asarray(outside + np.minimum(nearest, 0.0))


def slab(x: Array, low: float, high: float) -> Array:
    """Return the signed distance (n,) of coordinates from an interval; either end may be inf."""
    return np.maximum(low - x, x - high)


def box_distance(p: Array, lower: Sequence[float], upper: Sequence[float]) -> Array:
    """Return the signed distance (n,) of points (n, d) from a straight box."""
    columns = zip(p.T, lower, upper, strict=True)
    return from_box([slab(x, low, high) for x, low, high in columns])
