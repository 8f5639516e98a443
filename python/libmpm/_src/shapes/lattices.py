"""Lattices of particles that fill a box, with holes where other bodies lie.

Everything here works in metres relative to the scene's lower corner, in float64, so moving a
scene by its origin changes no bit.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.oriented_boxes import Extent, TurnedBox

__all__ = ["Carved", "Lattice", "Points", "Rows", "Turned", "lattice", "points"]
__all__ += ["turned_lattice"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

#: How the points of a lattice follow from its coordinates; see `Points.runs`.
Runs: TypeAlias = "int | list[tuple[Array, Runs]]"

#: Part of a cell by which rounding may misplace a lattice point or a face.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Lattice:
    """Points at the centres of equal slices of a box; lengths in m.

    Of a turned box, `lower`, `upper` and the points are those of its own frame, whose zero is the
    centre; `frame` says where that is.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    shape: tuple[int, ...]
    frame: TurnedBox | None = None

    @property
    def count(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    @property
    def volume(self) -> float:
        """Volume of the box (area in 2D)."""
        return math.prod(b - a for a, b in zip(self.lower, self.upper, strict=True))

    @property
    def bounds(self) -> Array:
        """Lower and upper corner of the smallest straight box around it, (2, d), m."""
        found = (self.lower, self.upper) if self.frame is None else self.frame.bounds()
        return np.array(found, dtype=np.float64)

    def axis(self, a: int) -> Array:
        """Return the coordinates of the points on axis `a`, shape (shape[a],)."""
        n = self.shape[a]
        centres = np.arange(n, dtype=np.float64) + 0.5
        return np.asarray(self.lower[a] + centres * ((self.upper[a] - self.lower[a]) / n))


class Rows(Protocol):
    """Points that are made in pieces."""

    @property
    def count(self) -> int:
        """Number of points."""

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""


def lattice(
    lower: Sequence[float],
    upper: Sequence[float],
    cell_size: float,
    particles_per_cell: int,
    counts: Sequence[int] | None = None,
) -> Lattice:
    """Return the lattice of a box: nearest whole number of points to L k / Δx on each axis.

    k = particles_per_cell^(1/d); at least one point; ties go up. `counts` states
    the numbers instead.
    """
    if counts is not None:
        return Lattice(tuple(lower), tuple(upper), tuple(counts))
    k = particles_per_cell ** (1.0 / len(lower))
    # Finite, since all numbers of a scene lie between 1e-100 and 1e100.
    points = [(b - a) * k / cell_size for a, b in zip(lower, upper, strict=True)]
    # The allowance decides ties alike however the box's edges were rounded.
    shape = tuple(max(1, math.floor(n + 0.5 + _TOLERANCE)) for n in points)
    return Lattice(tuple(lower), tuple(upper), shape)


def turned_lattice(
    box: TurnedBox, cell_size: float, particles_per_cell: int, counts: Sequence[int] | None = None
) -> Lattice:
    """Return the lattice along the own axes of a turned box; see `lattice`."""
    low, high = [-0.5 * s for s in box.size], [0.5 * s for s in box.size]
    own = lattice(low, high, cell_size, particles_per_cell, counts)
    return Lattice(own.lower, own.upper, own.shape, box)


class Points:
    """The points of a lattice that lie in no hole, last axis fastest, made in pieces.

    axes    m, float64   coordinates on each axis
    holes   indices      per hole and axis, the half-open interval of points that it takes out

    Between two faces of holes all sections across the first axis are alike, so one stands for the
    whole run, and is itself of this class, with one axis fewer. What it holds grows with the
    number of holes and the length of the axes, not with the number of points.
    """

    def __init__(self, axes: Sequence[Array], holes: Sequence[Sequence[tuple[int, int]]]) -> None:
        """Cut the first axis into runs; without axes it is one point, or none if in a hole."""
        self._dimension = len(axes)
        self._runs: list[tuple[Array, Points]] = []
        self._start = [0]  # row at which each run begins, and the number of rows
        if not axes:
            self._start.append(0 if holes else 1)
            return
        faces = {0, len(axes[0])}.union(*(hole[0] for hole in holes))
        for low, high in pairwise(sorted(faces)):
            across = [hole[1:] for hole in holes if hole[0][0] <= low < hole[0][1]]
            self._runs.append((axes[0][low:high], Points(axes[1:], across)))
        self._start += accumulate(len(x) * section.count for x, section in self._runs)

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return self._dimension

    @property
    def count(self) -> int:
        """Number of points."""
        return self._start[-1]

    @property
    def runs(self) -> Runs:
        """Runs of coordinates on the first axis and the section across each, down to 1 or 0."""
        if not self._dimension:
            return self.count
        return [(x, section.runs) for x, section in self._runs]

    def __call__(self, first: int, last: int) -> Array:
        """Return `rows(first, last)`."""
        return self.rows(first, last)

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        _check_rows(first, last, self.count)
        result = np.empty((last - first, self._dimension), dtype=np.float64)
        self._fill(first, last, result)
        return result

    def _fill(self, first: int, last: int, out: Array) -> None:
        """Write points first ≤ i < last to the rows of `out`."""
        run = bisect_right(self._start, first) - 1
        while self._dimension and first < last:
            x, section = self._runs[run]
            end = min(last, self._start[run + 1])
            while first < end:
                k, inside = divmod(first - self._start[run], section.count)
                whole = 0 if inside else (end - first) // section.count
                n = whole * section.count or min(section.count - inside, end - first)
                rows, out, first = out[:n], out[n:], first + n
                if not whole:
                    rows[:, 0] = x[k]
                    section._fill(inside, inside + n, rows[:, 1:])
                    continue
                block = rows.reshape(whole, section.count, self._dimension)
                block[:, :, 0] = x[k : k + whole, None]
                section._fill(0, section.count, block[0, :, 1:])
                # Column by column: an innermost loop over a point's coordinates would be slow.
                for a in range(1, self._dimension):
                    block[1:, :, a] = block[0, :, a]
            run += 1


class Carved:
    """The points of a lattice that lie in no hole, where some holes are turned against it.

    axes       m, float64   coordinates on each axis
    holes      m            corners of a straight hole, or a box at any angle
    allowance  m            by which lower faces reach down and upper faces stay below

    A hole is convex, so it takes one interval out of every line along the last axis. What is held
    is those intervals in the numbering of the whole lattice, joined where they meet: some numbers
    for each line that a hole cuts, whatever the number of points.
    """

    def __init__(self, axes: Sequence[Array], holes: Sequence[Extent], allowance: float) -> None:
        self._whole = Points(axes, [])
        found = [_intervals(axes, hole, allowance) for hole in holes]
        begin, end = (np.concatenate(ends) for ends in zip(*found, strict=True))
        order = np.argsort(begin, kind="stable")
        begin, end = begin[order], np.maximum.accumulate(end[order])
        # One interval begins afresh where it lies beyond the ends of all before it.
        fresh = np.flatnonzero(begin[1:] > end[:-1]) + 1
        if len(begin):
            begin = begin[np.append(0, fresh)]
            end = end[np.append(fresh - 1, len(end) - 1)]
        self._begin, self._end = begin, end
        self._removed = np.append(0, np.cumsum(end - begin))
        # Of the points that remain, the number of the first one beyond each interval.
        self._beyond = begin - self._removed[:-1]

    @property
    def count(self) -> int:
        """Number of points."""
        return self._whole.count - int(self._removed[-1])

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        _check_rows(first, last, self.count)
        result = np.empty((last - first, self._whole.dimension), dtype=np.float64)
        if first < last:
            self._fill(first, last, result)
        return result

    def _fill(self, first: int, last: int, out: Array) -> None:
        """Write points first ≤ i < last, at least one, to the rows of `out`."""
        low, high = np.searchsorted(self._beyond, [first, last - 1], side="right").tolist()
        start = first + int(self._removed[low])
        stop = last + int(self._removed[high])
        if stop - start > 2 * (last - first):
            # Mostly holes: in halves, so that no more than twice the rows are made.
            middle = (first + last) // 2
            self._fill(first, middle, out[: middle - first])
            self._fill(middle, last, out[middle - first :])
            return
        if low == high:
            out[:] = self._whole.rows(start, stop)
            return
        inside = np.zeros(stop - start + 1, dtype=np.int8)
        inside[self._begin[low:high] - start] = 1
        inside[self._end[low:high] - start] = -1
        kept = np.cumsum(inside[:-1], dtype=np.int8) == 0
        np.compress(kept, self._whole.rows(start, stop), axis=0, out=out)


def _intervals(axes: Sequence[Array], hole: Extent, allowance: float) -> tuple[Numbers, Numbers]:
    """Return begin and end (n,) of what a hole takes out, in the numbering of the lattice."""
    low, high = hole.bounds() if isinstance(hole, TurnedBox) else hole
    if isinstance(hole, TurnedBox):
        # Wider than the hole by rounding; which points are inside is for the lines to say.
        low, high = [x - allowance for x in low], [x + 2 * allowance for x in high]
    ranges = [_inside(x, a, b, allowance) for x, a, b in zip(axes, low, high, strict=True)]
    lines = np.indices([b - a for a, b in ranges[:-1]]).reshape(len(axes) - 1, -1)
    lines += np.array([[a] for a, _ in ranges[:-1]])
    if isinstance(hole, TurnedBox):
        ends = hole.span([x[i] for x, i in zip(axes, lines, strict=False)], allowance)
        begin, end = (np.searchsorted(axes[-1], x) for x in ends)
    else:
        begin, end = (np.full(lines.shape[1], k) for k in ranges[-1])
    cut = end > begin
    lines, begin, end = lines[:, cut], begin[cut], end[cut]
    number = np.ravel_multi_index(tuple(lines), tuple(len(x) for x in axes[:-1])) * len(axes[-1])
    return number + begin, number + end


def _inside(x: Array, low: float, high: float, allowance: float) -> tuple[int, int]:
    """Return the half-open interval of the coordinates between two faces."""
    begin, end = np.searchsorted(x, [low - allowance, high - allowance])
    return int(begin), int(end)


def _check_rows(first: int, last: int, count: int) -> None:
    if not 0 <= first <= last <= count:
        raise IndexError(f"rows {first} to {last} of {count} points")


class Turned:
    """Points of the own frame of a turned box, brought to where the box is."""

    def __init__(self, own: Rows, box: TurnedBox) -> None:
        self._own = own
        self._box = box

    @property
    def count(self) -> int:
        """Number of points."""
        return self._own.count

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        own = self._own.rows(first, last)
        result = np.empty_like(own)
        # Not a product of matrices: how that rounds a row may depend on the rows around it.
        for b, (centre, row) in enumerate(zip(self._box.centre, self._box.axes, strict=True)):
            result[:, b] = sum(x * r for x, r in zip(own.T, row, strict=True)) + centre
        return result


def points(grid: Lattice, holes: Sequence[Extent], cell_size: float) -> Rows:
    """Return the points of a lattice that remain when those inside the holes are removed.

    A point on the lower faces of a hole is inside, one on its upper faces not; of a turned hole,
    its own faces.
    """
    axes = [grid.axis(a) for a in range(len(grid.shape))]
    allowance = _TOLERANCE * cell_size
    holes = [_seen_from(grid.frame, hole) for hole in holes]
    straight = [hole for hole in holes if not isinstance(hole, TurnedBox)]
    own: Rows
    if len(straight) < len(holes):
        own = Carved(axes, holes, allowance)
    else:
        taken = [
            [_inside(x, a, b, allowance) for x, a, b in zip(axes, low, high, strict=True)]
            for low, high in straight
        ]
        own = Points(axes, taken)
    return own if grid.frame is None else Turned(own, grid.frame)


def _seen_from(frame: TurnedBox | None, hole: Extent) -> Extent:
    """Return a hole in the frame of a lattice, as corners wherever it is straight there."""
    if frame is not None:
        box = hole if isinstance(hole, TurnedBox) else TurnedBox.straight(*hole)
        hole = box.seen_from(frame)
    return (hole.if_straight() or hole) if isinstance(hole, TurnedBox) else hole
