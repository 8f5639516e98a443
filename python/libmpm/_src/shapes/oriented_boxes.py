"""Boxes at any angle: where their corners are, and how far two of them reach into each other.

Arithmetic is by single numbers, never by products of matrices, so that no library in between
decides how it rounds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = [
    "Extent",
    "TurnedBox",
    "close_pairs",
    "cosine_sine",
    "depth",
    "reach",
    "rotation",
]

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]


#: What rounding leaves of a zero in the product of two rotations.
_ROUNDING = 1e-12


def cosine_sine(
    angle: npt.ArrayLike,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return cosine and sine of angles in degrees, exact at multiples of 90."""
    degrees = np.asarray(angle, dtype=np.float64)
    quarter = np.round(degrees / 90.0)
    rest = np.radians(degrees - 90.0 * quarter)
    c, s = np.cos(rest), np.sin(rest)
    turns = np.mod(quarter, 4.0)
    return (
        np.select([turns == 0, turns == 1, turns == 2], [c, -s, -c], s),
        np.select([turns == 0, turns == 1, turns == 2], [s, c, -s], -c),
    )


def rotation(dimension: int, angle: float, axis: str | None = None) -> Matrix:
    """Return the rows of the rotation by `angle` degrees, by the right-hand rule about `axis`."""
    c, s = (float(x) for x in cosine_sine(angle))
    if dimension == 2:
        return (c, -s), (s, c)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis or "z"]
    rows = [[float(a == b) for b in range(3)] for a in range(3)]
    rows[first][first] = rows[second][second] = c
    rows[first][second], rows[second][first] = -s, s
    return tuple(tuple(row) for row in rows)


@dataclass(frozen=True)
class TurnedBox:
    """A box of edges `size` (d,) m about `centre` (d,) m; column a of `axes` is its own axis a."""

    centre: Vector
    size: Vector
    axes: Matrix

    @classmethod
    def straight(cls, lower: Sequence[float], upper: Sequence[float]) -> TurnedBox:
        """Return the box between two corners, with its edges along the axes."""
        pairs = list(zip(lower, upper, strict=True))
        return cls(
            tuple(0.5 * (a + b) for a, b in pairs),
            tuple(b - a for a, b in pairs),
            rotation(len(pairs), 0.0),
        )

    @property
    def dimension(self) -> int:
        """Number of axes."""
        return len(self.centre)

    def own(self, a: int) -> Vector:
        """Return the direction of its own axis `a`."""
        return tuple(row[a] for row in self.axes)

    def bounds(self) -> tuple[Vector, Vector]:
        """Return lower and upper corner of the smallest straight box around it."""
        low, high = [], []
        for c, row in zip(self.centre, self.axes, strict=True):
            reach = 0.5 * sum(abs(r) * s for r, s in zip(row, self.size, strict=True))
            low.append(c - reach)
            high.append(c + reach)
        return tuple(low), tuple(high)

    def corners(self) -> list[Vector]:
        """Return the 2^d corners, the last of its own axes fastest."""
        found = []
        for ends in itertools.product((-0.5, 0.5), repeat=self.dimension):
            own = [e * s for e, s in zip(ends, self.size, strict=True)]
            found.append(self.to_outside(own))
        return found

    def to_outside(self, own: Sequence[float]) -> Vector:
        """Return a point given in its own frame, whose zero is the centre."""
        return tuple(
            c + sum(r * x for r, x in zip(row, own, strict=True))
            for c, row in zip(self.centre, self.axes, strict=True)
        )

    def moved(self, by: Sequence[float]) -> TurnedBox:
        """Return the box moved by (d,) m."""
        centre = tuple(c + x for c, x in zip(self.centre, by, strict=True))
        return TurnedBox(centre, self.size, self.axes)

    def seen_from(self, other: TurnedBox) -> TurnedBox:
        """Return the same box in the own frame of another one."""
        away = [a - b for a, b in zip(self.centre, other.centre, strict=True)]
        d = range(self.dimension)
        return TurnedBox(
            tuple(_dot(other.own(a), away) for a in d),
            self.size,
            tuple(tuple(_dot(other.own(a), self.own(b)) for b in d) for a in d),
        )

    def if_straight(self) -> tuple[Vector, Vector] | None:
        """Return its corners where it is turned by quarters alone, to rounding; else None."""
        for row in self.axes:
            if any(abs(x - round(x)) > _ROUNDING for x in row):
                return None
        exact = tuple(tuple(float(round(x)) for x in row) for row in self.axes)
        return TurnedBox(self.centre, self.size, exact).bounds()

    def span(
        self, line: Sequence[npt.NDArray[np.float64]], allowance: float
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return the ends between which lines along the last axis run inside, (n,) m each.

        `line` has the coordinates (n,) of the lines on every axis but the last. The lower end lies
        above the upper one where a line misses the box. All faces are moved by `allowance` against
        their own axes: a point on a lower face is then inside, one on an upper face outside,
        however they are rounded.
        """
        low, high = np.full(len(line[0]), -np.inf), np.full(len(line[0]), np.inf)
        for a, size in enumerate(self.size):
            own = self.own(a)
            across = np.zeros(len(line[0]))
            for x, c, r in zip(line, self.centre, own, strict=False):
                across += r * (x - c)
            first, last = -0.5 * size - allowance - across, 0.5 * size - allowance - across
            slope = own[-1]
            if abs(slope) <= _ROUNDING:
                outside = (first > 0) | (last <= 0)
                low[outside], high[outside] = np.inf, -np.inf
                continue
            ends = first / slope + self.centre[-1], last / slope + self.centre[-1]
            enter, leave = ends if slope > 0 else ends[::-1]
            low, high = np.maximum(low, enter), np.minimum(high, leave)
        return low, high


#: A straight box as (lower, upper) corners, or a box at any angle; m.
Extent = tuple[Sequence[float], Sequence[float]] | TurnedBox


def _dot(one: Sequence[float], two: Sequence[float]) -> float:
    return sum(x * y for x, y in zip(one, two, strict=True))


def _directions(one: TurnedBox, two: TurnedBox) -> Iterator[Vector]:
    """Yield the directions of which one separates two boxes that are apart."""
    d = range(one.dimension)
    yield from (box.own(a) for box in (one, two) for a in d)
    if one.dimension == 2:
        return
    for a, b in itertools.product(d, d):
        u, v = one.own(a), two.own(b)
        across = (
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        )
        length = math.sqrt(_dot(across, across))
        # Of parallel edges nothing is left but rounding; the faces decide for those.
        if length > _ROUNDING:
            yield tuple(x / length for x in across)


def depth(one: TurnedBox, two: TurnedBox) -> float:
    """Return how far two boxes must be moved to come apart, m; negative where they are apart.

    Two boxes are apart if and only if their shadows are, on the normal of a face or on the
    direction across two edges.
    """
    away = [b - a for a, b in zip(one.centre, two.centre, strict=True)]
    least = math.inf
    for n in _directions(one, two):
        reach = sum(
            0.5 * abs(_dot(n, box.own(a))) * size
            for box in (one, two)
            for a, size in enumerate(box.size)
        )
        least = min(least, reach - abs(_dot(n, away)))
    return least


def reach(one: Extent, two: Extent) -> tuple[float, str]:
    """Return how far two boxes reach into each other, m, ≤ 0 if apart, and that in words."""
    if isinstance(one, TurnedBox) or isinstance(two, TurnedBox):
        deep = depth(
            *(x if isinstance(x, TurnedBox) else TurnedBox.straight(*x) for x in (one, two))
        )
        return deep, f"{deep:.3g}"
    ends = zip(*one, *two, strict=True)
    shared = [min(high, top) - max(low, base) for low, high, base, top in ends]
    return min(shared), " × ".join(f"{x:.3g}" for x in shared)


def close_pairs(
    bounds: Sequence[tuple[Sequence[float], Sequence[float]]],
) -> Iterator[tuple[int, int]]:
    """Yield the pairs i < j of straight boxes, (lower, upper) each, that overlap."""
    low, high = np.array([b[0] for b in bounds]), np.array([b[1] for b in bounds])
    for i in range(len(bounds) - 1):
        shared = np.minimum(high[i], high[i + 1 :]) - np.maximum(low[i], low[i + 1 :])
        for j in np.flatnonzero(shared.min(axis=1) > 0):
            yield i, i + 1 + int(j)
