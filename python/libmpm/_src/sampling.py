"""Filling a shape with particles.

Everything here works in metres relative to the scene's lower corner, in float64, so moving a
scene by its origin changes no bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Lattice", "count", "lattice", "positions"]

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
    lower: Sequence[float], upper: Sequence[float], cell_size: float, particles_per_cell: int
) -> Lattice:
    """Return the lattice of a box: nearest whole number of points to L k / Δx on each axis.

    k = particles_per_cell^(1/d); at least one point; ties go up.
    """
    k = particles_per_cell ** (1.0 / len(lower))
    # The allowance decides ties alike however the box's edges were rounded.
    shape = tuple(
        max(1, math.floor((b - a) * k / cell_size + 0.5 + _TOLERANCE))
        for a, b in zip(lower, upper, strict=True)
    )
    return Lattice(tuple(lower), tuple(upper), shape)


def _masks(
    grid: Lattice, holes: Sequence[tuple[Sequence[float], Sequence[float]]], cell_size: float
) -> list[list[npt.NDArray[np.bool_]]]:
    """Return, per hole and axis, which lattice coordinates lie in the hole's interval."""
    allowance = _TOLERANCE * cell_size
    return [
        [
            (x >= low[a] - allowance) & (x < high[a] - allowance)
            for a, x in enumerate(grid.axis(a) for a in range(len(grid.shape)))
        ]
        for low, high in holes
    ]


def _kept(
    grid: Lattice, masks: list[list[npt.NDArray[np.bool_]]], row: int
) -> npt.NDArray[np.bool_]:
    """Return which points of one slice of the first axis remain, shape grid.shape[1:]."""
    kept = np.ones(grid.shape[1:], dtype=bool)
    for mask in masks:
        if mask[0][row]:
            inside = mask[1]
            if len(mask) == 3:
                inside = mask[1][:, None] & mask[2][None, :]
            kept &= ~inside
    return kept


def count(
    grid: Lattice, holes: Sequence[tuple[Sequence[float], Sequence[float]]], cell_size: float
) -> int:
    """Return how many points remain when those inside the holes (lower, upper) are removed."""
    if not holes:
        return grid.count
    masks = _masks(grid, holes, cell_size)
    return sum(int(np.count_nonzero(_kept(grid, masks, i))) for i in range(grid.shape[0]))


def positions(
    grid: Lattice, holes: Sequence[tuple[Sequence[float], Sequence[float]]], cell_size: float
) -> Array:
    """Return the remaining points, shape (count, d), last axis fastest."""
    axes = [grid.axis(a) for a in range(len(grid.shape))]
    result = np.empty((*grid.shape, len(axes)), dtype=np.float64)
    for a, x in enumerate(axes):
        result[..., a] = x.reshape([-1 if b == a else 1 for b in range(len(axes))])
    if holes:
        masks = _masks(grid, holes, cell_size)
        kept = np.stack([_kept(grid, masks, i) for i in range(grid.shape[0])])
        return np.ascontiguousarray(result[kept])
    return result.reshape(-1, len(axes))
