"""Meshes of elements from lattices: boxes exactly, other solids by a lattice cut at the surface.

Boxes: each cube is cut into six tetrahedra (square: two triangles) that share its diagonal, the
cubes mirrored in turn along every axis, or all alike ("one-way").

Solids: a body-centred cubic lattice of tetrahedra (equilateral triangles in 2D), whose vertices
near the surface are moved onto it and whose elements across it are cut, after the isosurface
stuffing of Labelle and Shewchuk (2007). Diagonals of cut faces start at the deepest vertex.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from libmpm._src.base.text import listed
from libmpm._src.errors import SceneError
from libmpm._src.shapes.element_topology import Numbers, determinants, edges, faces, parts
from libmpm._src.shapes.solid import Array, Solid

__all__ = ["LONGEST", "cut_lattice", "structured"]

#: Share of an edge, long and short ones, from whose cut a vertex is moved there. The thinnest
#: element of 350 solids at random, turned and put together, had a height of 0.118 of its edge.
_SNAP = {2: (0.30, 0.30), 3: (0.30, 0.35)}
#: Spacing of the lattice in edges, so that no edge gets longer than √d of them.
_SPACING = {2: 0.9, 3: 1.1}
#: Longest edge of any mesh made here, in `edge`: √d.
LONGEST = {2: math.sqrt(2.0), 3: math.sqrt(3.0)}
#: Points of the lattice around a solid that can be looked at.
_MOST_POINTS = 3e7
#: Points looked at together.
_PIECE = 1 << 18


def structured(
    lower: Sequence[float], upper: Sequence[float], counts: Sequence[int], alternating: bool
) -> tuple[Array, Numbers]:
    """Return vertices and elements of a box cut into so many cubes on each axis."""
    d = len(counts)
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(lower, upper, counts, strict=True)]
    vertices = np.stack([x.ravel() for x in np.meshgrid(*axes, indexing="ij")], axis=1)
    cube = np.indices(counts).reshape(d, -1).T
    strides = np.append(np.cumprod([n + 1 for n in counts[:0:-1]])[::-1], 1).astype(np.int64)
    mirrored = cube % 2 if alternating else np.zeros_like(cube)
    elements = []
    for order in itertools.permutations(range(d)):
        # From one corner of the cube to the opposite one, an axis at a time.
        path = np.zeros((d + 1, d), dtype=np.int64)
        for step, axis in enumerate(order):
            path[step + 1 :, axis] = 1
        corner = cube[:, None] + np.where(mirrored[:, None] == 1, 1 - path, path)
        elements.append(corner @ strides)
    return vertices, np.stack(elements, axis=1).reshape(-1, d + 1)


def cut_lattice(solid: Solid, edge: float, label: str) -> tuple[Array, Numbers]:
    """Return vertices and elements of a solid of finite bounds; see the module text."""
    low, high = (np.array(end, dtype=np.float64) for end in solid.bounds())
    d = solid.dimension
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise SceneError(
            f"{label}: the solid has no end; expected finite bounds; cut it with "
            "`& shapes.Box(lower=..., upper=...)`"
        )
    spacing = _SPACING[d] * edge
    points = 2.0 * float(np.prod((high - low) / spacing + 3.0))
    size = " × ".join(f"{x:.4g}" for x in high - low)
    if not points <= _MOST_POINTS:
        raise SceneError(
            f"{label}: edge is {edge:g} with a solid of {size} m, a lattice of {points:.3g} "
            f"vertices; expected ≤ {_MOST_POINTS:.0e}; give a longer edge"
        )
    vertices, elements = (_equilateral if d == 2 else _body_centred)(low, high, spacing)
    return _cut(solid, vertices, elements, label, edge)


def _body_centred(low: Array, high: Array, a: float) -> tuple[Array, Numbers]:
    """Return cubes' corners and middles; tetrahedra of an edge and the middles beside it."""
    n = np.ceil((high - low) / a - 1e-9).astype(np.int64) + 2
    start = 0.5 * (low + high) - 0.5 * a * n
    corner = np.indices((n + 1).tolist()).reshape(3, -1).T
    middle = np.indices(n.tolist()).reshape(3, -1).T + 0.5
    of_corner = np.arange(math.prod((n + 1).tolist())).reshape(n + 1)
    of_middle = np.arange(math.prod(n.tolist())).reshape(n) + of_corner.size
    elements = []
    for axis in range(3):
        one = np.moveaxis(of_middle, axis, 0)
        plane = np.moveaxis(of_corner, axis, 0)[1:-1]
        ring = [plane[:, :-1, :-1], plane[:, 1:, :-1], plane[:, 1:, 1:], plane[:, :-1, 1:]]
        for k in range(4):
            four = np.stack([one[:-1], one[1:], ring[k], ring[(k + 1) % 4]], axis=-1)
            elements.append(four.reshape(-1, 4))
    return start + a * np.concatenate([corner, middle]), np.concatenate(elements)


def _equilateral(low: Array, high: Array, a: float) -> tuple[Array, Numbers]:
    """Return rows of equilateral triangles, every second row moved by half an edge."""
    pitch = np.array([a, math.sqrt(3.0) * a])
    n = np.ceil((high - low) / pitch - 1e-9).astype(np.int64) + 2
    start = 0.5 * (low + high) - 0.5 * pitch * n
    corner = np.indices((n + 1).tolist()).reshape(2, -1).T
    middle = np.indices(n.tolist()).reshape(2, -1).T + 0.5
    of_corner = np.arange(math.prod((n + 1).tolist())).reshape(n + 1)
    of_middle = np.arange(math.prod(n.tolist())).reshape(n) + of_corner.size
    left, right = of_corner[:-1], of_corner[1:]
    before, after = of_middle[:-1], of_middle[1:]
    inner = of_corner[1:-1]
    three = [
        (left[:, :-1], right[:, :-1], of_middle), (left[:, 1:], right[:, 1:], of_middle),
        (before, after, inner[:, :-1]), (before, after, inner[:, 1:]),
    ]  # fmt: skip
    elements = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in three]
    return start + pitch * np.concatenate([corner, middle]), np.concatenate(elements)


def _distance(solid: Solid, points: Array) -> Array:
    pieces = [solid.distance(points[i : i + _PIECE]) for i in range(0, len(points), _PIECE)]
    return np.concatenate(pieces) if pieces else np.zeros(0)


def _cut(
    solid: Solid, vertices: Array, elements: Numbers, label: str, edge: float
) -> tuple[Array, Numbers]:
    """Return the part of a lattice inside a solid."""
    far = _distance(solid, vertices)
    elements = elements[(far[elements] < 0).any(axis=1)]
    if not len(elements):
        raise SceneError(
            f"{label}: edge is {edge:g}, and no vertex of the lattice lies inside the solid; "
            "expected several across its thinnest part; give a shorter edge"
        )
    across = edges(elements)
    across = across[(far[across[:, 0]] < 0) != (far[across[:, 1]] < 0)]
    across = np.where((far[across[:, 0]] < 0)[:, None], across, across[:, ::-1])
    inner, outer = vertices[across[:, 0]], vertices[across[:, 1]]
    share = _cuts(solid, inner, outer)
    places = inner + share[:, None] * (outer - inner)
    long = np.sqrt(np.einsum("ij,ij->i", outer - inner, outer - inner))
    state = np.where(far < 0, -1, 1)
    vertices = _snap(vertices, state, across, share, places, long)
    alive = (state[across[:, 0]] < 0) & (state[across[:, 1]] > 0)
    across, places = across[alive], places[alive]
    # Cuts come after the lattice; the deepest vertices are the first of all.
    order = np.argsort(far, kind="stable")
    rank = np.empty(len(far), dtype=np.int64)
    rank[order] = np.arange(len(far))
    vertices = np.concatenate([vertices[order], places])
    state, across, elements = state[order], rank[across], rank[elements]
    inside = _clip(elements, state, across)
    used, back = np.unique(inside, return_inverse=True)
    vertices, inside = vertices[used], back.reshape(inside.shape)
    _check_whole(vertices, inside, label, edge)
    return vertices, inside


def _check_whole(vertices: Array, elements: Numbers, label: str, edge: float) -> None:
    """Refuse what a lattice too coarse has lost or taken apart."""
    if not len(elements):
        raise SceneError(
            f"{label}: edge is {edge:g}, and nothing is left of the solid; expected several edges "
            "across its thinnest part; give a shorter edge"
        )
    right = elements.copy()
    turned = determinants(vertices, right) < 0
    right[turned] = right[turned][:, [*range(right.shape[1] - 2), -1, -2]]
    sizes = np.bincount(parts(len(right), faces(right)))
    if len(sizes) > 1:
        raise SceneError(
            f"{label}: edge is {edge:g}, and the mesh comes apart into {len(sizes)} parts of "
            f"{listed(np.sort(sizes)[::-1].tolist())} elements; expected one; give a shorter edge "
            "where the solid is thin, and each part of a solid of several a body of its own"
        )


def _cuts(solid: Solid, inner: Array, outer: Array) -> Array:
    """Return where edges from inside to outside cross the surface, as a share of them, (k,).

    By halving: the sign of the distance is exact, its magnitude may not be.
    """
    low, high = np.zeros(len(inner)), np.ones(len(inner))
    for _ in range(30):
        middle = 0.5 * (low + high)
        within = _distance(solid, inner + middle[:, None] * (outer - inner)) < 0
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return 0.5 * (low + high)


def _snap(
    vertices: Array, state: Numbers, across: Numbers, share: Array, places: Array, long: Array
) -> Array:
    """Return the vertices, those near a cut moved to the nearest one, and mark these in `state`."""
    of_long, of_short = _SNAP[vertices.shape[1]]
    limit = np.where(long > 1.05 * long.min(), of_long, of_short) if len(long) else long
    vertex = np.concatenate([across[:, 0], across[:, 1]])
    part = np.concatenate([share, 1.0 - share])
    away = part * np.concatenate([long, long])
    near = np.flatnonzero(part < np.concatenate([limit, limit]))
    near = near[np.lexsort((away[near], vertex[near]))]
    nearest = near[np.unique(vertex[near], return_index=True)[1]]
    vertices = vertices.copy()
    vertices[vertex[nearest]] = np.concatenate([places, places])[nearest]
    state[vertex[nearest]] = 0
    return vertices


def _clip(elements: Numbers, state: Numbers, across: Numbers) -> Numbers:
    """Return the parts of elements that are inside: state -1 inside, 0 on the surface, 1 outside.

    Row k of `across` is cut by vertex len(state) + k.
    """
    n, corners = len(state), elements.shape[1]
    key = across[:, 0] * n + across[:, 1]
    order = np.argsort(key)
    key = key[order]

    def cut(one: Numbers, two: Numbers) -> Numbers:
        return np.asarray(n + order[np.searchsorted(key, one * n + two)])

    # Within an element: inside first, then the surface, then outside, each by its number.
    elements = np.sort(elements, axis=1)
    kind = state[elements]
    elements, kind = elements[(kind < 0).any(axis=1)], kind[(kind < 0).any(axis=1)]
    by_kind = np.argsort(kind, axis=1, kind="stable")
    elements = np.take_along_axis(elements, by_kind, axis=1)
    kind = np.take_along_axis(kind, by_kind, axis=1)
    within, on, beyond = ((kind == k).sum(axis=1) for k in (-1, 0, 1))
    found = [elements[beyond == 0]]
    for flush in range(corners - 1):
        some = elements[(within == 1) & (on == flush) & (beyond == corners - 1 - flush)]
        cuts = [cut(some[:, 0], some[:, j]) for j in range(1 + flush, corners)]
        found.append(np.column_stack([some[:, : 1 + flush], *cuts]))
    if corners == 3:
        a, b, p = elements[(within == 2) & (beyond == 1)].T
        found += _quadrangle(a, b, cut(a, p), cut(b, p), ())
        return np.concatenate(found)
    a, b, z, p = elements[(within == 2) & (on == 1) & (beyond == 1)].T
    found += _quadrangle(a, b, cut(a, p), cut(b, p), (z,))
    a, b, p, q = elements[(within == 2) & (beyond == 2)].T
    found += _prism([a, cut(a, p), cut(a, q)], [b, cut(b, p), cut(b, q)])
    a, b, c, p = elements[(within == 3) & (beyond == 1)].T
    found += _prism([a, b, c], [cut(a, p), cut(b, p), cut(c, p)])
    return np.concatenate(found)


def _quadrangle(
    a: Numbers, b: Numbers, on_a: Numbers, on_b: Numbers, tip: tuple[Numbers, ...]
) -> list[Numbers]:
    """Return the halves of (a, b, on_b, on_a), with a before b, and the tip of a pyramid on it."""
    return [np.column_stack([a, b, on_b, *tip]), np.column_stack([a, on_b, on_a, *tip])]


#: Corners of a prism by the position of its first vertex, so that it comes to be corner 0.
_ROUND = np.array(
    [(0, 1, 2, 3, 4, 5), (1, 2, 0, 4, 5, 3), (2, 0, 1, 5, 3, 4),
     (3, 5, 4, 0, 2, 1), (4, 3, 5, 1, 0, 2), (5, 4, 3, 2, 1, 0)]
)  # fmt: skip


def _prism(bottom: list[Numbers], top: list[Numbers]) -> list[Numbers]:
    """Return the tetrahedra of prisms; diagonals of their sides start at the first vertex.

    Source: Dompierre et al. (1999), "How to subdivide pyramids, prisms and hexahedra".
    """
    corner = np.column_stack([*bottom, *top])
    corner = np.take_along_axis(corner, _ROUND[np.argmin(corner, axis=1)], axis=1)
    first = np.minimum(corner[:, 1], corner[:, 5]) < np.minimum(corner[:, 2], corner[:, 4])
    ways = {True: ((0, 1, 2, 5), (0, 1, 5, 4)), False: ((0, 1, 2, 4), (0, 4, 2, 5))}
    found = [corner[:, [0, 4, 5, 3]]]
    for choice, cuts in ways.items():
        found += [corner[first == choice][:, list(four)] for four in cuts]
    return found
