"""Distance from triangles and their winding number, by a tree of boxes around them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.solid import Array

__all__ = ["TriangleTree"]

Numbers = npt.NDArray[np.int64]

_CHILDREN = np.arange(2, dtype=np.int64)

#: Triangles in a leaf; pairs of point and node, and points, looked at together.
_LEAF = 4
_PAIRS = 1 << 21
_PIECE = 1 << 13

#: Radii of a node beyond which its triangles count as one dipole (Barill et al. 2018: 2 or more).
_FAR = 2.5


class TriangleTree:
    """Triangles (m, 3, 3) in m, halved again and again across the longest edge of their box.

    Node k of a level has the nodes 2k and 2k + 1 of the next one below it; a leaf has four
    triangles, the last one repeated where some are missing.
    """

    def __init__(self, triangles: Array) -> None:
        m = len(triangles)
        depth = max(0, int(np.ceil(np.log2(max(1.0, m / _LEAF)))))
        order = np.minimum(np.arange(_LEAF << depth), m - 1)
        weight = (np.arange(_LEAF << depth) < m).astype(np.float64)
        middle = triangles.mean(axis=1)
        for level in range(depth):
            rows = order.reshape(1 << level, -1)
            points = middle[rows]
            axis = np.argmax(points.max(axis=1) - points.min(axis=1), axis=1)
            keys = np.take_along_axis(points, axis[:, None, None], axis=2)[:, :, 0]
            sort = np.argsort(keys, axis=1, kind="stable")
            order = np.take_along_axis(rows, sort, axis=1).ravel()
            weight = np.take_along_axis(weight.reshape(rows.shape), sort, axis=1).ravel()
        self._depth = depth
        self._corners = triangles[order]
        self._weight = weight
        self._lower: list[Array] = []
        self._upper: list[Array] = []
        self._dipoles: list[tuple[Array, Array, Array]] = []
        self._frame = _frames(self._corners)
        edges = self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0]
        normal = 0.5 * np.cross(*edges) * weight[:, None]
        size = np.sqrt((normal * normal).sum(axis=1))
        centre = self._corners.mean(axis=1)
        for level in range(depth + 1):
            nodes = 1 << level
            points = self._corners.reshape(nodes, -1, 3)
            self._lower.append(points.min(axis=1))
            self._upper.append(points.max(axis=1))
            share = size.reshape(nodes, -1, 1)
            total = share.sum(axis=1)
            place = (share * centre.reshape(nodes, -1, 3)).sum(axis=1)
            place = np.where(total > 0, place / np.where(total > 0, total, 1.0), points[:, 0])
            reach = np.sqrt(((points - place[:, None]) ** 2).sum(axis=2).max(axis=1))
            self._dipoles.append((place, normal.reshape(nodes, -1, 3).sum(axis=1), reach))

    def distance(self, p: Array) -> Array:
        """Return the exact distance (n,) of points (n, 3) from the nearest triangle, m."""
        found = [self._nearest(p[i : i + _PIECE]) for i in range(0, len(p), _PIECE)]
        return np.asarray(np.sqrt(np.concatenate(found))) if found else np.zeros(0)

    def _nearest(self, p: Array) -> Array:
        # Down to one leaf first: its nearest triangle bounds what need be looked at.
        node: Numbers = np.zeros(len(p), dtype=np.int64)
        for level in range(1, self._depth + 1):
            left, right = (self._to_box(p, level, 2 * node + i) for i in (0, 1))
            node = 2 * node + (right < left)
        best = self._to_leaf(p, node)
        point = np.arange(len(p))
        node = np.zeros(len(p), dtype=np.int64)
        for level in range(1, self._depth + 1):
            point, node = np.repeat(point, 2), (2 * node[:, None] + _CHILDREN).ravel()
            box = self._to_box(p[point], level, node)
            near = box <= best[point] * (1.0 + 1e-9)
            point, node, box = point[near], node[near], box[near]
            if len(point) > _PAIRS and len(p) > 1:
                half = len(p) // 2
                return np.concatenate([self._nearest(p[:half]), self._nearest(p[half:])])
        if self._depth and len(point):
            # The nearest box of each point, whose triangles are likely to rule out most others.
            starts = np.flatnonzero(np.append(True, point[1:] != point[:-1]))
            least = np.repeat(
                np.minimum.reduceat(box, starts), np.diff(np.append(starts, len(point)))
            )
            first_of = np.flatnonzero(box <= least)
            found = self._to_leaf(p[point[first_of]], node[first_of])
            np.minimum.at(best, point[first_of], found)
            near = box <= best[point] * (1.0 + 1e-9)
            point, node = point[near], node[near]
        for first in range(0, len(point), _PAIRS // 8):
            some = slice(first, first + _PAIRS // 8)
            np.minimum.at(best, point[some], self._to_leaf(p[point[some]], node[some]))
        return best

    def _to_box(self, p: Array, level: int, node: Numbers) -> Array:
        """Return the squared distance of points (n, 3) from the box of a node each."""
        low, high = self._lower[level], self._upper[level]
        total = np.zeros(len(p))
        for a in range(3):
            away = np.maximum(low[node, a] - p[:, a], p[:, a] - high[node, a])
            away = np.maximum(away, 0.0)
            total += away * away
        return total

    def _to_leaf(self, p: Array, node: Numbers) -> Array:
        """Return the squared distance of points (n, 3) from the triangles of a leaf each."""
        best = np.full(len(p), np.inf)
        for i in range(_LEAF):
            best = np.minimum(best, _to_triangle(p, self._frame[_LEAF * node + i]))
        return best

    def winding(self, p: Array) -> Array:
        """Return how often the triangles wind around points (n, 3): 1 inside, 0 outside if closed.

        The sum of solid angles over 4 π (Jacobson et al. 2013), with distant triangles taken
        together as dipoles (Barill et al. 2018); good to about 0.01.
        """
        found = [self._winding(p[i : i + _PIECE]) for i in range(0, len(p), _PIECE)]
        return np.concatenate(found) if found else np.zeros(0)

    def _winding(self, p: Array) -> Array:
        total: Array = np.zeros(len(p))
        point = np.arange(len(p))
        node: Numbers = np.zeros(len(p), dtype=np.int64)
        for level in range(self._depth + 1):
            place, normal, reach = self._dipoles[level]
            away = place[node] - p[point]
            square = _dot(away, away)
            far = square > (_FAR * reach[node]) ** 2
            flux = _dot(normal[node[far]], away[far]) / square[far] ** 1.5
            total += np.bincount(point[far], flux, len(p))
            point, node = point[~far], node[~far]
            if level < self._depth:
                point, node = np.repeat(point, 2), (2 * node[:, None] + _CHILDREN).ravel()
        for i in range(_LEAF):
            row = _LEAF * node + i
            angle = _solid_angle(p[point], self._corners[row]) * self._weight[row]
            total += np.bincount(point, angle, len(p))
        return total / (4.0 * np.pi)


def _dot(one: Array, two: Array) -> Array:
    return one[:, 0] * two[:, 0] + one[:, 1] * two[:, 1] + one[:, 2] * two[:, 2]


def _cross(one: Array, two: Array) -> Array:
    a, b = one.T, two.T
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], axis=1
    )


def _frames(corners: Array) -> Array:
    """Return per triangle its first corner, three axes and the others in its plane, (m, 15).

    The first axis runs along an edge, the third across the plane; of a triangle without area,
    across any.
    """
    first = corners[:, 1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 0]
    long = np.sqrt(_dot(first, first))
    one = first / np.where(long > 0, long, 1.0)[:, None]
    one[long == 0] = (1.0, 0.0, 0.0)
    normal = _cross(one, other)
    size = np.sqrt(_dot(normal, normal))
    flat = size == 0
    # Any direction across the edge: that to the coordinate axis it follows least.
    normal[flat] = _cross(one[flat], np.eye(3)[np.argmin(np.abs(one[flat]), axis=1)])
    normal /= np.sqrt(_dot(normal, normal))[:, None]
    two = _cross(normal, one)
    plane = np.stack([long, _dot(other, one), _dot(other, two)], axis=1)
    return np.concatenate([corners[:, 0], one, two, normal, plane], axis=1)


def _to_triangle(p: Array, frame: Array) -> Array:
    """Return the squared distance (n,) of points (n, 3) from the triangle of a frame each.

    In the triangle's own axes: the height above its plane, and in it the distance from the
    nearest edge, zero inside.
    """
    f = frame.T
    away = [p[:, a] - f[a] for a in range(3)]
    x, y, z = (away[0] * f[k] + away[1] * f[k + 1] + away[2] * f[k + 2] for k in (3, 6, 9))
    long, u, v = f[12], f[13], f[14]
    inside = y >= 0
    t = np.clip(x, 0.0, long) - x
    nearest = t * t + y * y
    # The other corner lies above the first edge: inside is to the left of all three.
    for px, py, ex, ey in ((x - long, y, u - long, v), (x - u, y - v, -u, -v)):
        inside &= ex * py - ey * px >= 0
        square = ex * ex + ey * ey
        share = np.clip((px * ex + py * ey) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        dx, dy = px - share * ex, py - share * ey
        nearest = np.minimum(nearest, dx * dx + dy * dy)
    found: Array = z * z + np.where(inside & (v > 0), 0.0, nearest)
    return found


def _solid_angle(p: Array, corners: Array) -> Array:
    """Return the solid angles (n,) of triangles (n, 3, 3) from points; Van Oosterom 1983."""
    a, b, c = (corners[:, i] - p for i in range(3))
    la, lb, lc = (np.sqrt(_dot(x, x)) for x in (a, b, c))
    above = _dot(a, _cross(b, c))
    below = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
    return np.asarray(2.0 * np.arctan2(above, below))
