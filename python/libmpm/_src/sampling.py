"""Filling a shape with particles.

Everything here works in metres relative to the scene's lower corner, in float64, so moving a
scene by its origin changes no bit.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
import numpy.typing as npt

__all__ = ["Lattice", "Points", "lattice", "points"]

Array = npt.NDArray[np.float64]

#: Part of a cell by which rounding may misplace a lattice point or a face.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Lattice:
    """Points at the centres of equal slices of a box; lengths in m."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    shape: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    @property
    def volume(self) -> float:
        """Volume of the box (area in 2D)."""
        return math.prod(b - a for a, b in zip(self.lower, self.upper, strict=True))

    def axis(self, a: int) -> Array:
        """Return the coordinates of the points on axis `a`, shape (shape[a],)."""
        n = self.shape[a]
        centres = np.arange(n, dtype=np.float64) + 0.5
        return np.asarray(self.lower[a] + centres * ((self.upper[a] - self.lower[a]) / n))


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
    # The allowance decides ties alike however the box's edges were rounded.
    shape = tuple(
        max(1, math.floor((b - a) * k / cell_size + 0.5 + _TOLERANCE))
        for a, b in zip(lower, upper, strict=True)
    )
    return Lattice(tuple(lower), tuple(upper), shape)


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
    def count(self) -> int:
        """Number of points."""
        return self._start[-1]

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        if not 0 <= first <= last <= self.count:
            raise IndexError(f"rows {first} to {last} of {self.count} points")
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


def points(
    grid: Lattice, holes: Sequence[tuple[Sequence[float], Sequence[float]]], cell_size: float
) -> Points:
    """Return the points of a lattice that remain when those inside the holes are removed.

    A hole is (lower, upper), m; a point on its lower faces is inside, one on its upper faces not.
    """
    axes = [grid.axis(a) for a in range(len(grid.shape))]
    allowance = _TOLERANCE * cell_size

    def inside(x: Array, low: float, high: float) -> tuple[int, int]:
        begin, end = np.searchsorted(x, [low - allowance, high - allowance])
        return int(begin), int(end)

    taken = [
        [inside(x, a, b) for x, a, b in zip(axes, low, high, strict=True)] for low, high in holes
    ]
    return Points(axes, taken)
