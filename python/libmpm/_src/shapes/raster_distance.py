"""Distance from a surface of bilinear patches over a raster, by boxes around ever fewer of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.solid import Array

__all__ = ["PatchTree"]

Numbers = npt.NDArray[np.int64]

#: Points, and pairs of point and box, looked at together.
_PIECE = 1 << 13
_PAIRS = 1 << 20

#: Parts of a twisted patch that are searched for a place of their own.
_PARTS = 4

#: Part of a patch to which its nearest place is found, and steps that this may take.
_TOLERANCE = 1e-13
_STEPS = 100

_ACROSS = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])


class PatchTree:
    """Patches between places x (n,) and y (m,) with heights z (n, m), m, linear along x and y.

    Level k has boxes around 2^k × 2^k patches; besides the heights it keeps two numbers a box.
    """

    def __init__(self, x: Array, y: Array, z: Array) -> None:
        self._x, self._y, self._z = x, y, z
        corners = [z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]]
        low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
        self._low, self._high = [low], [high]
        while max(low.shape) > 1:
            low, high = _halved(low, np.minimum), _halved(high, np.maximum)
            self._low.append(low)
            self._high.append(high)
        self._ends = [
            [_box_ends(axis, level, size) for axis, size in zip((x, y), low.shape, strict=True)]
            for level, low in enumerate(self._low)
        ]

    def distance(self, p: Array, bound: Array) -> Array:
        """Return the distance (n,) of points (n, 3) from the nearest patch, m.

        `bound` (n,) is the distance from some place of the surface; no more is looked for.
        """
        square = bound * bound
        found = [
            self._nearest(p[i : i + _PIECE], square[i : i + _PIECE])
            for i in range(0, len(p), _PIECE)
        ]
        return np.sqrt(np.concatenate(found)) if found else np.zeros(0)

    def _nearest(self, p: Array, bound: Array) -> Array:
        top = len(self._low) - 1
        best = bound.copy()
        columns = tuple(np.ascontiguousarray(p.T))
        # Down to one patch first: how far it is rules out most of the others.
        i, j = np.zeros((2, len(p)), dtype=np.int64)
        for level in range(top - 1, -1, -1):
            point, i, j = self._children(level, np.arange(len(p)), i, j)
            away = self._to_box([c[point] for c in columns], level, i, j).reshape(-1, 4)
            row = 4 * np.arange(len(p)) + np.argmin(away, axis=1)
            i, j = i[row], j[row]
        best = np.minimum(best, self._to_patch(columns, i, j))
        done = i * len(self._y) + j
        point = np.arange(len(p))
        i, j = np.zeros((2, len(p)), dtype=np.int64)
        for level in range(top, -1, -1):
            if level < top:
                point, i, j = self._children(level, point, i, j)
                # A box beyond the edge was asked for as the last one before it.
                fresh = self._first_of(i, j)
                if level == 0:
                    fresh &= i * len(self._y) + j != done[point]
                point, i, j = point[fresh], i[fresh], j[fresh]
            away = self._to_box([c[point] for c in columns], level, i, j)
            near = away <= best[point] * (1.0 + 1e-9)
            point, i, j = point[near], i[near], j[near]
            if len(point) > _PAIRS and len(p) > 1:
                half = len(p) // 2
                return np.concatenate(
                    [self._nearest(p[:half], bound[:half]), self._nearest(p[half:], bound[half:])]
                )
        for first in range(0, len(point) if top else 0, _PAIRS):
            some = slice(first, first + _PAIRS)
            there = [c[point[some]] for c in columns]
            np.minimum.at(best, point[some], self._to_patch(there, i[some], j[some]))
        return best

    def _children(
        self, level: int, point: Numbers, i: Numbers, j: Numbers
    ) -> tuple[Numbers, Numbers, Numbers]:
        """Return the four boxes below each, four rows in turn; at the edges the last one again."""
        n, m = self._low[level].shape
        below = [np.minimum((2 * k[:, None] + across).ravel(), size - 1)
                 for k, across, size in zip((i, j), _ACROSS, (n, m), strict=True)]  # fmt: skip
        return np.repeat(point, 4), below[0], below[1]

    def _first_of(self, i: Numbers, j: Numbers) -> npt.NDArray[np.bool_]:
        """Return which rows name another box than the rows of the same four before them."""
        slot = np.arange(len(i)) % 4
        found: npt.NDArray[np.bool_] = ((i % 2) == slot // 2) & ((j % 2) == slot % 2)
        return found

    def _to_box(self, p: Sequence[Array], level: int, i: Numbers, j: Numbers) -> Array:
        """Return the squared distance of points, a column an axis, from a box of a level each."""
        ends, total = self._ends[level], np.zeros(len(i))
        place = i * self._low[level].shape[1] + j
        sides = [(ends[0], i), (ends[1], j), ((self._low[level], self._high[level]), place)]
        for column, ((low, high), k) in zip(p, sides, strict=True):
            away = np.maximum(low.take(k) - column, column - high.take(k))
            np.maximum(away, 0.0, out=away)
            total += away * away
        return total

    def _to_patch(self, p: Sequence[Array], i: Numbers, j: Numbers) -> Array:
        """Return the squared distance of points, a column an axis, from a patch each."""
        x, y, z = self._x, self._y, self._z
        here, across, along = z[i, j], z[i + 1, j], z[i, j + 1]
        return _ruled_distance2(
            (p[0] - x[i], p[1] - y[j], p[2] - here),
            (x[i + 1] - x[i], y[j + 1] - y[j]),
            (across - here, along - here),
            z[i + 1, j + 1] - across - along + here,
        )


class _Ruled:
    """Patches (u a, v b, u r + v s + u v q), 0 ≤ u, v ≤ 1, and a point each.

    Along v a patch is straight: for a given u the nearest v is known, and what is left is a
    function of u alone, of which this gives the slope.
    """

    def __init__(self, *columns: Array) -> None:
        self.columns = columns

    def of(self, rows: Numbers | npt.NDArray[np.bool_]) -> _Ruled:
        return _Ruled(*(c[rows] for c in self.columns))

    def at(self, u: Array) -> tuple[Array, Array]:
        """Return the squared distance at u and half its derivative by u."""
        px, py, pz, a, b, r, s, q = self.columns
        rise = s + u * q
        z = pz - u * r
        v = np.clip((py * b + z * rise) / (b * b + rise * rise), 0.0, 1.0)
        dx, dy, dz = px - u * a, py - v * b, z - v * rise
        return dx * dx + dy * dy + dz * dz, -(dx * a + dz * (r + v * q))


def _ruled_distance2(
    p: tuple[Array, Array, Array],
    size: tuple[Array, Array],
    rise: tuple[Array, Array],
    twist: Array,
) -> Array:
    """Return the squared distance (n,) of points from patches in coordinates from a corner each."""
    patch = _Ruled(*p, *size, *rise, twist)
    first, slope = patch.at(np.zeros(len(twist)))
    best = first
    # Without twist the patch is plane and its distance convex: there is one least place.
    for part in range(_PARTS):
        low, high = part / _PARTS, (part + 1) / _PARTS
        ahead, onward = patch.at(np.full(len(twist), high))
        best = np.minimum(best, ahead)
        rows = np.flatnonzero((slope < 0) & (onward > 0))
        if len(rows):
            found = _least(patch.of(rows), low, high, slope[rows], onward[rows])
            best[rows] = np.minimum(best[rows], found)
        slope = onward
    return best


def _least(patch: _Ruled, low: float, high: float, before: Array, after: Array) -> Array:
    """Return the least squared distance between two u, where its slope turns from < 0 to > 0.

    False position with the Illinois rule: the end that stays counts half.
    """
    n = len(before)
    result = np.full(n, np.inf)
    open_ = np.arange(n)
    a, b = np.full(n, low), np.full(n, high)
    side = np.zeros(n, dtype=np.int64)
    for _ in range(_STEPS):
        u = np.clip((a * after - b * before) / (after - before), a, b)
        square, slope = patch.at(u)
        result[open_] = np.minimum(result[open_], square)
        left = slope < 0
        before = np.where(left, slope, np.where(side == 1, 0.5 * before, before))
        after = np.where(left, np.where(side == -1, 0.5 * after, after), slope)
        moved = np.where(left, u - a, b - u)
        a, b = np.where(left, u, a), np.where(left, b, u)
        side = np.where(left, -1, 1)
        on = (slope != 0) & (b - a > _TOLERANCE) & (moved > 0)
        if not on.any():
            break
        a, b, before, after, side, open_ = (c[on] for c in (a, b, before, after, side, open_))
        patch = patch.of(on)
    return result


def _box_ends(axis: Array, level: int, size: int) -> tuple[Array, Array]:
    """Return the lower and upper ends (size,) of boxes of a level along an axis, m."""
    first = np.arange(size) << level
    return axis[first], axis[np.minimum(first + (1 << level), len(axis) - 1)]


def _halved(table: Array, of: np.ufunc) -> Array:
    """Return the least or greatest of each 2 × 2 entries; at the edges of what there is."""
    for axis in (0, 1):
        table = of.reduceat(table, np.arange(0, table.shape[axis], 2), axis=axis)
    return table
