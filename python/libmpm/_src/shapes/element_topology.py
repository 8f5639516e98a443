"""Measures and neighbours of simplices: volumes, heights, faces, parts; triangles and tetrahedra.

Arrays alone: vertices (n, d), m; elements (m, d + 1), rows of `vertices`.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.solid import Array

__all__ = ["Faces", "Numbers", "determinants", "doubles", "edges", "faces", "longest_edges"]
__all__ += ["parts", "qualities"]

Numbers = npt.NDArray[np.int64]

#: Elements that are looked at together.
_PIECE = 1 << 18


class Faces(NamedTuple):
    """Faces of elements, edges in 2D: one for each element and corner left out, element by element.

    number   (m (d + 1),)   of the face; faces of two elements have one
    times    (faces,)       elements that have it
    side     (m (d + 1),)   +1 or -1: from which side of the face the element sees it
    corners  (m (d + 1), d) vertices, the element behind them
    """

    number: Numbers
    times: Numbers
    side: Numbers
    corners: Numbers


def determinants(vertices: Array, elements: Numbers) -> Array:
    """Return det D_m, (m,): d! times the volume, negative where the orientation is."""
    found = np.empty(len(elements))
    for first in range(0, len(elements), _PIECE):
        x = vertices[elements[first : first + _PIECE]]
        e = (x[:, 1:] - x[:, :1]).transpose(1, 2, 0)
        if len(e) == 2:
            one = e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0]
        else:
            one = (
                e[0, 0] * (e[1, 1] * e[2, 2] - e[1, 2] * e[2, 1])
                - e[0, 1] * (e[1, 0] * e[2, 2] - e[1, 2] * e[2, 0])
                + e[0, 2] * (e[1, 0] * e[2, 1] - e[1, 1] * e[2, 0])
            )
        found[first : first + _PIECE] = one
    return found


def longest_edges(vertices: Array, elements: Numbers) -> Array:
    """Return the longest edge of each element, (m,) m."""
    best = np.zeros(len(elements))
    for i, j in itertools.combinations(range(elements.shape[1]), 2):
        away = vertices[elements[:, i]] - vertices[elements[:, j]]
        best = np.maximum(best, np.einsum("ij,ij->i", away, away))
    return np.asarray(np.sqrt(best))


def qualities(vertices: Array, elements: Numbers) -> Array:
    """Return the shortest height of each element over its longest edge, (m,).

    0.87 and 0.82 of an equilateral triangle and tetrahedron, 0.5 and 0.41 of the halves and sixths
    of squares and cubes.
    """
    d = vertices.shape[1]
    longest = longest_edges(vertices, elements)
    if d == 2:
        widest = longest
    else:
        widest = np.zeros(len(elements))
        for out in range(4):
            a, b, c = (vertices[elements[:, i]] for i in range(4) if i != out)
            normal = np.cross(b - a, c - a)
            widest = np.maximum(widest, np.sqrt(np.einsum("ij,ij->i", normal, normal)))
    # Volume = base times height over d, base = what the cross product says over (d - 1)!.
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.abs(determinants(vertices, elements)) / widest
        return np.nan_to_num(height / longest)


def edges(elements: Numbers) -> Numbers:
    """Return the edges of elements, (k, 2), each once, the smaller number first."""
    pairs = [elements[:, [i, j]] for i, j in itertools.combinations(range(elements.shape[1]), 2)]
    both = np.sort(np.concatenate(pairs), axis=1)
    n = int(both.max()) + 1
    key = np.unique(both[:, 0] * n + both[:, 1])
    return np.stack([key // n, key % n], axis=1)


def faces(elements: Numbers) -> Faces:
    """Return the faces of elements of positive orientation."""
    d = elements.shape[1] - 1
    # Leaving out corner k turns the sense with k: these have the element behind them.
    ways = {2: ((1, 2), (2, 0), (0, 1)), 3: ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))}[d]
    corners = elements[:, np.array(ways)].reshape(-1, d)
    order = np.argsort(corners, axis=1, kind="stable")
    ranked = np.take_along_axis(corners, order, axis=1)
    n = int(elements.max()) + 1
    number = ranked[:, 0]
    for a in range(1, d):
        key = number * n + ranked[:, a]
        number = np.unique(key, return_inverse=True)[1].ravel()
    # Even permutations are seen from one side, odd ones from the other.
    inversions = sum(order[:, i] > order[:, j] for i, j in itertools.combinations(range(d), 2))
    side = 1 - 2 * (np.asarray(inversions) % 2)
    return Faces(number, np.bincount(number), side, corners)


def parts(count: int, found: Faces) -> Numbers:
    """Return the number of the part of each element, (m,), counted by their first elements.

    Elements are of one part where faces lead from one to the other: what hangs together by a
    vertex alone (in 3D an edge) is a hinge, not a part.
    """
    per = len(found.number) // count
    element = np.repeat(np.arange(count), per)
    order = np.argsort(found.number, kind="stable")
    same = np.flatnonzero(np.diff(found.number[order]) == 0)
    one, two = element[order[same]], element[order[same + 1]]
    label = np.arange(count)
    while True:
        low = np.minimum(label[one], label[two])
        new = label.copy()
        # The label of a label too: long bodies join in few rounds.
        for end in (one, two):
            np.minimum.at(new, label[end], low)
            np.minimum.at(new, end, low)
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    return np.unique(label, return_inverse=True)[1].ravel()


def doubles(vertices: Array, tolerance: float) -> Numbers:
    """Return for each vertex the first one at its place, (n,); itself where there is none.

    Vertices are at one place where they round to one multiple of `tolerance`, m.
    """
    if tolerance <= 0 or not math.isfinite(tolerance):
        raise ValueError("doubles: the tolerance is no length")
    # Away from round numbers, where coordinates tend to lie.
    key = np.floor(vertices / tolerance + 0.381966)
    order = np.lexsort(key.T)
    same = np.zeros(len(order), dtype=bool)
    same[1:] = np.all(key[order[1:]] == key[order[:-1]], axis=1)
    group = np.cumsum(~same) - 1
    first = np.full(int(group[-1]) + 1, len(vertices))
    np.minimum.at(first, group, order)
    found = np.empty(len(vertices), dtype=np.int64)
    found[order] = first[group]
    return found
