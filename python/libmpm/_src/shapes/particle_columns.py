"""Particles in columns that reach evenly from surface to surface of a solid.

Lengths are in m, relative to the scene's lower corner, in float64, as in `lattices.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.solid import Array, Bounds, Solid

__all__ = ["Stacked"]

#: Part of a spacing to which surfaces are found, and by which rounding may misplace a line.
_TOLERANCE = 1e-9

#: Steps to a spacing with which a line is searched where it is near a surface.
_STEPS = 4

#: Lines looked at together.
_PIECE = 1 << 16

Numbers = npt.NDArray[np.int64]


class _Crossings(NamedTuple):
    """Where lines may cross a surface: between low and high, m; `inner` at low; (n,) each."""

    line: Numbers
    low: Array
    high: Array
    inner: npt.NDArray[np.bool_]


class Stacked:
    """The points of columns inside a solid and outside its holes.

    solid     scene          what is filled
    holes     scene          what is not
    axis                     along which the columns stand
    corner    m, (d,)        coordinates in the scene of the scene's lower corner
    spacing   m              between columns, the first half of it from the corner, and nearly
                             that between the points of one
    bounds    m, scene       of the solid, finite

    Each line has intervals inside; one of length l ≥ spacing / 2 takes n = round(l / spacing)
    points, at least one, at (k + 1/2) l / n. Distances that bound the true one are stepped along;
    of others, and near surfaces, a line is asked at four places to a spacing. Two numbers are held
    for each interval; rows are made in pieces.
    """

    def __init__(
        self,
        solid: Solid,
        holes: Sequence[Solid],
        axis: int,
        corner: Sequence[float],
        spacing: float,
        bounds: Bounds,
    ) -> None:
        self._solid = solid
        self._holes = tuple(holes)
        self._axis = axis
        self._corner = np.asarray(corner, dtype=np.float64)
        self._spacing = spacing
        low, high = (np.asarray(end, dtype=np.float64) - self._corner for end in bounds)
        self._across = [a for a in range(len(low)) if a != axis]
        ends = [(low[a] / spacing - 0.5, high[a] / spacing - 0.5) for a in self._across]
        self._first = [math.ceil(a - _TOLERANCE) for a, _ in ends]
        last = [math.floor(b + _TOLERANCE) + 1 for _, b in ends]
        self._shape = tuple(max(b - a, 0) for a, b in zip(self._first, last, strict=True))
        fine = spacing / _STEPS
        self._span = (float(low[axis]) - 0.5 * fine, float(high[axis]) + 0.5 * fine)
        found = [
            self._intervals(np.arange(first, min(first + _PIECE, math.prod(self._shape))))
            for first in range(0, math.prod(self._shape), _PIECE)
        ]
        empty = np.zeros(0)
        self._line = np.concatenate([np.zeros(0, dtype=np.int64), *(x[0] for x in found)])
        self._low = np.concatenate([empty, *(x[1] for x in found)])
        self._length = np.concatenate([empty, *(x[2] for x in found)])
        self._number = np.maximum(np.rint(self._length / spacing), 1.0)
        self._start = np.append(0, np.cumsum(self._number.astype(np.int64)))

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self._start[-1])

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        if not 0 <= first <= last <= self.count:
            raise IndexError(f"rows {first} to {last} of {self.count} points")
        number = np.arange(first, last)
        column = np.searchsorted(self._start, number, side="right") - 1
        share = (number - self._start[column] + 0.5) / self._number[column]
        return self._places(self._line[column], self._low[column] + share * self._length[column])

    def _places(self, line: Numbers, height: Array) -> Array:
        """Return points (n, d) of lines by their heights, m."""
        result = np.empty((len(line), len(self._corner)), dtype=np.float64)
        index = np.unravel_index(line, self._shape)
        for a, i, first in zip(self._across, index, self._first, strict=True):
            result[:, a] = (i + (first + 0.5)) * self._spacing
        result[:, self._axis] = height
        return result

    def _distance(self, line: Numbers, height: Array) -> Array:
        p = self._places(line, height) + self._corner
        far = self._solid.distance(p)
        for hole in self._holes:
            far = np.maximum(far, -hole.distance(p))
        return far

    def _intervals(self, line: Numbers) -> tuple[Numbers, Array, Array]:
        """Return line, lower end and length of the intervals of some lines, in their order."""
        found = self._crossings(line)
        place = self._refined(found)
        order = np.lexsort((place, found.line))
        of, place = found.line[order], place[order]
        # In and out by turns, as both ends of a line count as outside.
        low, length = place[::2], place[1::2] - place[::2]
        kept = length >= (0.5 - _TOLERANCE) * self._spacing
        return of[::2][kept], low[kept], length[kept]

    def _crossings(self, line: Numbers) -> _Crossings:
        """Walk along lines and return where they pass a surface."""
        low, high = self._span
        fine = self._spacing / _STEPS
        sure = self._solid.bounding and all(hole.bounding for hole in self._holes)
        at = np.full(len(line), low)
        far = self._distance(line, at)
        # What begins or ends inside does so at the end of the line.
        begun = far < 0
        parts = [_Crossings(line[begun], at[begun], at[begun], np.zeros(begun.sum(), dtype=bool))]
        while len(line):
            step = np.maximum(np.abs(far), fine) if sure else np.full(len(line), fine)
            then = np.minimum(at + step, high)
            now = self._distance(line, then)
            turned = (far < 0) != (now < 0)
            parts.append(_Crossings(line[turned], at[turned], then[turned], far[turned] < 0))
            done = then >= high
            open_ = done & (now < 0)
            ends = np.full(int(open_.sum()), high)
            parts.append(_Crossings(line[open_], ends, ends, np.ones(len(ends), dtype=bool)))
            line, at, far = line[~done], then[~done], now[~done]
        return _Crossings(*map(np.concatenate, zip(*parts, strict=True)))

    def _refined(self, found: _Crossings) -> Array:
        """Return the places of surfaces, m, by bisection."""
        low, high = found.low.copy(), found.high.copy()
        wide = np.flatnonzero(high - low > _TOLERANCE * self._spacing)
        while len(wide):
            middle = 0.5 * (low[wide] + high[wide])
            same = (self._distance(found.line[wide], middle) < 0) == found.inner[wide]
            low[wide] = np.where(same, middle, low[wide])
            high[wide] = np.where(same, high[wide], middle)
            wide = wide[high[wide] - low[wide] > _TOLERANCE * self._spacing]
        return np.asarray(0.5 * (low + high))
