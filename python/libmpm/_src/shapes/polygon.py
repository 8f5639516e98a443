"""Plane polygons: exact distance, area, and whether edges cross."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.solid import Array, Corner

__all__ = ["area", "crossing", "polygon_distance", "segment_distance2"]
__all__ += ["segments_distance"]

#: Numbers in one piece of work, edges times points: what a core's cache holds.
_PIECE = 1 << 16


def segment_distance2(u: Array, v: Array, start: Array, end: Array) -> Array:
    """Return the least squared distance (n,) of points (u, v) from segments (m, 2), m²."""
    # Rows are edges: what runs along points is read in order, and the least taken row by row.
    eu, ev = (end - start).T[:, :, None]
    wu, wv = u - start[:, :1], v - start[:, 1:]
    t = wu * eu
    t += wv * ev
    t /= eu * eu + ev * ev
    np.clip(t, 0.0, 1.0, out=t)
    wu -= t * eu
    wv -= t * ev
    wu *= wu
    wv *= wv
    wu += wv
    return np.asarray(wu.min(axis=0))


def polygon_distance(corners: Array, u: Array, v: Array) -> Array:
    """Return the signed distance (n,) of points (u, v) from a simple polygon (m, 2), m.

    Exact: the nearest of its edges; inside by the parity of edges that a ray crosses.
    """
    return segments_distance(corners, np.roll(corners, -1, axis=0), u, v)


def segments_distance(start: Array, end: Array, u: Array, v: Array) -> Array:
    """Return the signed distance (n,) of points from what segments (m, 2) enclose, m.

    They close: of one polygon or several, one inside another a hole.
    """
    result = np.empty(len(u))
    step = max(1, _PIECE // len(start))
    for i in range(0, len(u), step):
        piece = slice(i, i + step)
        pu, pv = u[piece], v[piece]
        far = np.sqrt(segment_distance2(pu, pv, start, end))
        result[piece] = np.where(_inside(start, end, pu, pv), -far, far)
    return result


def _inside(start: Array, end: Array, u: Array, v: Array) -> npt.NDArray[np.bool_]:
    across = (start[:, 1:] <= v) != (end[:, 1:] <= v)
    rise = end[:, 1:] - start[:, 1:]
    slope = (end[:, :1] - start[:, :1]) / np.where(rise == 0, 1.0, rise)
    at = v - start[:, 1:]
    at *= slope
    at += start[:, :1]
    across &= u < at
    return np.asarray(np.logical_xor.reduce(across, axis=0))


def area(corners: Array) -> float:
    """Return the signed area of a polygon (m, 2), m²; positive anticlockwise."""
    x, y = (corners - corners[0]).T
    return 0.5 * math.fsum(x * np.roll(y, -1) - np.roll(x, -1) * y)


def crossing(corners: Array) -> tuple[Corner, Corner] | None:
    """Return the first corners of two edges of a polygon that cross or touch; None if none do."""
    start, end = corners, np.roll(corners, -1, axis=0)
    m = len(corners)
    for i in range(m - 2):
        others = np.arange(i + 2, m if i else m - 1)
        a, b, c, d = start[i], end[i], start[others], end[others]
        one, two = _side(a, b, c), _side(a, b, d)
        three, four = _side(c, d, a), _side(c, d, b)
        lower, upper = np.minimum(a, b), np.maximum(a, b)
        near = np.all((np.minimum(c, d) <= upper) & (np.maximum(c, d) >= lower), axis=1)
        hit = near & (one * two <= 0) & (three * four <= 0)
        if np.any(hit):
            j = int(others[np.argmax(hit)])
            return tuple(start[i].tolist()), tuple(start[j].tolist())
    return None


def _side(a: Array, b: Array, c: Array) -> Array:
    """Return on which side of lines a-b points c lie: the sign of the area they span."""
    a, b, c = np.atleast_2d(a), np.atleast_2d(b), np.atleast_2d(c)
    across = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return np.asarray(np.sign(across))
