"""`HeightField`: beds below a profile (2D) or a raster of heights (3D)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.arrays import real_array
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, shown, value
from libmpm._src.errors import SceneError
from libmpm._src.shapes.esri_grid import read_esri
from libmpm._src.shapes.polygon import polygon_distance, segment_distance2
from libmpm._src.shapes.raster_distance import PatchTree
from libmpm._src.shapes.solid import Array, Bounds, Solid, box_distance, length

__all__ = ["HeightField"]

#: Points looked at together; they are neighbours along the bed.
_PIECE = 4096


@value
class HeightField(Solid):
    """What lies below a bed: a profile in 2D, a raster in 3D.

    {fields}

    Between its points the bed is linear in 2D and bilinear in 3D. Without a `base` it is a bed
    without bottom that continues level beyond its edges. With one it is a block with upright sides
    that ends at them.

    The distance is exact, over steps and steep banks too. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.HeightField"

    x: Sequence[float] = given("rising places along x, two or more", unit="m", shape="(n,)")
    z: Sequence[float] | Sequence[Sequence[float]] = given(
        "height of the bed at x, or at x and y; in 2D along the second axis, y",
        unit="m",
        shape="(n,) | (n, m)",
    )
    y: Sequence[float] | None = given(
        "rising places along y; left out in 2D", default=None, unit="m", shape="(m,)"
    )
    base: float | None = given(
        "bottom of the solid; None = none", default=None, unit="m", range="below all z"
    )

    @classmethod
    @keywords_only("shapes.HeightField.from_list", 1)
    def from_list(
        cls, pairs: Sequence[Sequence[float]], *, base: float | None = None
    ) -> HeightField:
        """Return the bed through (x, z) pairs in m, in 2D; `base` as in the class."""
        try:
            rows = np.asarray(pairs, dtype=np.float64)
        except (OverflowError, TypeError, ValueError):
            rows = np.empty(0)
        if rows.ndim != 2 or rows.shape[1] != 2:
            raise SceneError(
                f"{cls.label}.from_list: pairs is {shown(pairs, 80)}; expected rows (x, z) in m"
            )
        return cls(x=rows[:, 0].tolist(), z=rows[:, 1].tolist(), base=base)

    @classmethod
    @keywords_only("shapes.HeightField.from_esri", 1)
    def from_esri(
        cls,
        path: str | Path,
        *,
        base: float | None = None,
        origin: Sequence[float] = (0.0, 0.0),
        fill: float | None = None,
    ) -> HeightField:
        """Read an ESRI ASCII grid (`.asc`) as a bed in 3D.

        =========  ====  =====  ===============================================================
        parameter  unit  shape  meaning
        =========  ====  =====  ===============================================================
        path       -     -      the file: ncols, nrows, xllcorner or xllcenter, yllcorner or
                                yllcenter, cellsize, optionally NODATA_value; then rows of
                                heights from north (largest y) to south
        base       m     -      as in the class
        origin     m     (2,)   subtracted from x and y of the file, which are often large
        fill       m     -      height where the file has no data; None = refused
        =========  ====  =====  ===============================================================

        Heights stand for the centres of the file's cells. The scene keeps the numbers, not the
        file. Raises `SceneError`.
        """
        check = Checker("shapes.HeightField.from_esri")
        origin = check.vector("origin", origin, lengths=(2,), unit="m")
        if fill is not None:
            fill = check.number("fill", fill, unit="m")
        check.finish()
        x, y, z = read_esri(Path(path), fill)
        x, y = x - float(origin[0]), y - float(origin[1])
        return cls(x=x.tolist(), y=y.tolist(), z=z.tolist(), base=base)

    def _check(self, check: Checker) -> dict[str, Any]:
        x = _rising(check, "x", self.x)
        y = None if self.y is None else _rising(check, "y", self.y)
        shape = (len(x),) if y is None else (len(x), len(y))
        z = _numbers(self.z)
        if z is None or z.shape != shape:
            have = "no table of numbers" if z is None else f"of shape {z.shape}"
            check.fail(
                f"z is {have}; expected {shape}, a height for every "
                f"{'x' if y is None else 'pair of x and y'}"
            )
            return {}
        bad = np.argwhere(~np.isfinite(z))
        if len(bad):
            check.fail(
                f"z has {len(bad)} heights that are no finite numbers, the first at {bad[0]}; "
                "expected m; fill the gaps first"
            )
            return {}
        base = self.base
        if base is not None:
            base = check.given("base", self, base)
            if base >= float(z.min()):
                check.fail(
                    f"base is {base:g} with the lowest height {float(z.min()):g}; expected below "
                    "it, in m"
                )
        return {"x": tuple(x.tolist()), "y": None if y is None else tuple(y.tolist()),
                "z": _tuples(z), "base": base}  # fmt: skip

    @property
    def dimension(self) -> int:
        """Number of axes: 2, or 3 with `y`."""
        return 2 if self.y is None else 3

    @cached_property
    def _places(self) -> list[Array]:
        places = [self.x] if self.y is None else [self.x, self.y]
        return [np.array(axis) for axis in places]

    @cached_property
    def _heights(self) -> Array:
        return np.array(self.z)

    def bounds(self) -> Bounds:
        """Return lower and upper corner, m; without `base` only the highest bed is finite."""
        top = float(self._heights.max())
        if self.base is None:
            d = self.dimension - 1
            return (-math.inf,) * (d + 1), (*(math.inf,) * d, top)
        ends = [(float(axis[0]), float(axis[-1])) for axis in self._places]
        return (*(a for a, _ in ends), self.base), (*(b for _, b in ends), top)

    def volume(self) -> float:
        """Return the volume between `base` and bed, m³ (m² in 2D); inf without `base`."""
        if self.base is None:
            return math.inf
        mean = self._heights - self.base
        for a, axis in enumerate(self._places):
            width = np.diff(axis)
            ahead, behind = mean.take(range(1, len(axis)), a), mean.take(range(len(axis) - 1), a)
            mean = 0.5 * (ahead + behind)
            mean = mean * (width if self.dimension == 2 else np.expand_dims(width, 1 - a))
        return math.fsum(mean.ravel())

    def height(self, place: npt.ArrayLike) -> Array:
        """Return the height of the bed (n,) at places (n, d - 1), m; level beyond its edges."""
        p = np.asarray(place, dtype=np.float64).reshape(-1, self.dimension - 1)
        return self._height([p[:, a] for a in range(self.dimension - 1)])

    def _cells(self, columns: Sequence[Array]) -> tuple[list[npt.NDArray[np.int64]], list[Array]]:
        """Return the cell on each axis in which points lie, and how far along it, 0 to 1."""
        cells, shares = [], []
        for c, axis in zip(columns, self._places, strict=True):
            i = np.clip(np.searchsorted(axis, c, side="right") - 1, 0, len(axis) - 2)
            cells.append(i)
            shares.append(np.clip((c - axis[i]) / (axis[i + 1] - axis[i]), 0.0, 1.0))
        return cells, shares

    def _height(self, columns: Sequence[Array]) -> Array:
        cells, shares = self._cells(columns)
        z = self._heights
        if self.dimension == 2:
            (i,), (t,) = cells, shares
            return np.asarray(z[i] * (1.0 - t) + z[i + 1] * t)
        (i, j), (t, s) = cells, shares
        near = z[i, j] * (1.0 - s) + z[i, j + 1] * s
        far = z[i + 1, j] * (1.0 - s) + z[i + 1, j + 1] * s
        return np.asarray(near * (1.0 - t) + far * t)

    def _distance(self, p: Array) -> Array:
        if self.dimension == 2:
            return self._profile_distance(p)
        x, y = self._places
        place = [np.clip(p[:, a], axis[0], axis[-1]) for a, axis in enumerate((x, y))]
        height = self._height(place)
        beside = [p[:, 0] - place[0], p[:, 1] - place[1]]
        # The bed right above or below, or at the edge, bounds how far the nearest place can be.
        far = self._patches.distance(p, length([*beside, p[:, 2] - height]))
        inside = p[:, 2] < height
        if self.base is not None:
            low, high = self.bounds()
            inside &= box_distance(p, low, (*high[:2], math.inf)) < 0
            under = length([*beside, p[:, 2] - self.base])
            far = np.minimum(far, under)
        for a, (axis, edges) in enumerate(zip((x, y), self._edges, strict=True)):
            for end, profile, outward in zip((axis[0], axis[-1]), edges, (-1.0, 1.0), strict=True):
                away = p[:, a] - end
                # Without base the bed goes on level beyond the edge; with one there is a side.
                here = np.abs(away) < far if self.base is not None else away * outward > 0
                rows = np.flatnonzero(here)
                if len(rows):
                    across = profile._profile_distance(p[rows][:, (1 - a, 2)])
                    if self.base is not None:
                        across = length([away[rows], np.maximum(across, 0.0)])
                    far[rows] = np.minimum(far[rows], np.abs(across))
        return np.where(inside, -far, far)

    @cached_property
    def _patches(self) -> PatchTree:
        x, y = self._places
        return PatchTree(x, y, self._heights)

    @cached_property
    def _edges(self) -> list[tuple[HeightField, HeightField]]:
        """The profiles of the bed at both ends of x and of y."""
        (x, y), z = self._places, self._heights
        along = [(y, z[0], z[-1]), (x, z[:, 0], z[:, -1])]
        return [
            (
                HeightField(x=axis.tolist(), z=low.tolist(), base=self.base),
                HeightField(x=axis.tolist(), z=high.tolist(), base=self.base),
            )
            for axis, low, high in along
        ]

    def _profile_distance(self, p: Array) -> Array:
        x, z = self._places[0], self._heights
        if self.base is not None:
            corners = [(x[0], self.base), *zip(x, z, strict=True), (x[-1], self.base)]
            return polygon_distance(np.array(corners)[::-1], p[:, 0], p[:, 1])
        result = p[:, 1] - self._height([p[:, 0]])
        order = np.argsort(p[:, 0], kind="stable")
        bed = np.stack([x, z], axis=1)
        start, end = bed[:-1], bed[1:]
        for first in range(0, len(order), _PIECE):
            rows = order[first : first + _PIECE]
            u, v = p[rows, 0], p[rows, 1]
            # The bed right above or below bounds how far along it the nearest place can be.
            reach = (1.0 + 1e-9) * np.abs(result[rows])
            i = max(0, int(np.searchsorted(x, (u - reach).min())) - 1)
            j = int(np.searchsorted(x, (u + reach).max())) + 1
            square = _level_ends(u, v, bed)
            if i < min(j, len(start)):
                square = np.minimum(square, segment_distance2(u, v, start[i:j], end[i:j]))
            result[rows] = np.copysign(np.sqrt(square), result[rows])
        return result


def _level_ends(u: Array, v: Array, bed: Array) -> Array:
    """Return the squared distance from the level rays that lengthen a profile."""
    before, after = np.maximum(u - bed[0, 0], 0.0), np.maximum(bed[-1, 0] - u, 0.0)
    down, up = v - bed[0, 1], v - bed[-1, 1]
    found: Array = np.minimum(before * before + down * down, after * after + up * up)
    return found


def _numbers(given: Any) -> Array | None:
    try:
        return real_array(given, "a height field")
    except (OverflowError, TypeError, ValueError):
        return None


def _rising(check: Checker, name: str, given: Any) -> Array:
    found = _numbers(given)
    if found is None or found.ndim != 1 or len(found) < 2:
        check.fail(f"{name} is {shown(given, 80)}; expected two or more numbers in m")
        return np.zeros(0)
    wrong = np.flatnonzero(~(np.diff(found) > 0))
    if not np.isfinite(found).all():
        check.fail(f"{name} has numbers that are not finite; expected m")
    elif len(wrong):
        i = int(wrong[0])
        check.fail(
            f"{name}[{i + 1}] is {found[i + 1]:g} after {found[i]:g}; expected rising numbers; "
            "sort the points, and give a step two places slightly apart"
        )
    return found


def _tuples(z: Array) -> tuple[Any, ...]:
    return tuple(tuple(r) if isinstance(r, list) else r for r in z.tolist())
