"""Volumes of solids that no formula gives, counted by ever finer cubes."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import Any

import numpy as np

from libmpm._src.shapes.mesh_inside import MeshInside
from libmpm._src.shapes.solid import Array, Bounds, Solid
from libmpm._src.shapes.surface_mesh import SurfaceMesh

__all__ = ["counted_volume", "overlap_depth", "shared_bounds", "volume_of"]

#: Boxes in the finest step, fewer of what is slow to ask; points looked at together.
_BUDGET = {2: 1 << 15, 3: 1 << 19}
_BUDGET_OF_MESH = 1 << 16
_PIECE = 1 << 18


def volume_of(solid: Solid) -> float:
    """Return the volume of a solid of finite bounds, m³ (m² in 2D), by formula or counted."""
    found = solid.volume()
    return counted_volume(solid) if found is None else found


@lru_cache(maxsize=64)
def counted_volume(solid: Solid) -> float:
    """Return the volume of a solid, m³ (m² in 2D), counted by boxes.

    Boxes whose middle is further from the surface than their corners count as a whole or not at
    all; the others are halved on every axis while there are no more than 2^19 of them (2^16 of
    meshes, 2^15 in 2D). Of the last ones a share counts that is linear in the distance of the
    middle; over a plane surface its error averages out. Meshes that may have surfaces inside them
    are asked at random places of the last boxes instead. The error is about 0.01 %, 0.1 % of
    meshes.
    """
    budget = _budget(solid)
    low, high = (np.array(end) for end in solid.bounds())
    size = high - low
    if not np.all(np.isfinite(size)):
        return math.inf
    if not np.all(size > 0):
        return 0.0
    d = solid.dimension
    children = np.array(list(itertools.product((-0.25, 0.25), repeat=d)))
    sure = solid.bounding
    # Boxes of nearly equal edges to begin with, at most 8 on an axis.
    first = np.ceil(size / size.max() * 8.0).astype(int)
    edge = size / first
    middle = low + (np.indices(first).reshape(d, -1).T + 0.5) * edge
    volume = 0.0
    while True:
        far = _distances(solid, middle)
        if sure:
            open_ = np.abs(far) <= 0.5 * (1.0 + 1e-9) * float(np.sqrt((edge * edge).sum()))
            volume += float(np.prod(edge)) * int(np.count_nonzero(~open_ & (far < 0)))
            middle, far = middle[open_], far[open_]
        if len(middle) << d > budget or len(middle) == 0:
            break
        middle = (middle[:, None] + children * edge).reshape(-1, d)
        edge = 0.5 * edge
    if any(mesh.volume() is None for mesh in _meshes(solid)):
        rng = np.random.default_rng(0)
        within = _distances(solid, middle + (rng.random(middle.shape) - 0.5) * edge) < 0
        return volume + float(np.prod(edge)) * int(np.count_nonzero(within))
    # By the shortest edge: boxes that touch a face of the solid from within count in full.
    share = np.clip(0.5 - far / float(edge.min()), 0.0, 1.0)
    return volume + float(np.prod(edge)) * math.fsum(share)


def shared_bounds(one: Bounds, two: Bounds) -> Bounds | None:
    """Return the corners of what two straight boxes share; None if nothing."""
    low = tuple(max(pair) for pair in zip(one[0], two[0], strict=True))
    high = tuple(min(pair) for pair in zip(one[1], two[1], strict=True))
    return (low, high) if all(a < b for a, b in zip(low, high, strict=True)) else None


def overlap_depth(one: Solid, two: Solid, within: Bounds, spacing: float) -> float:
    """Return how deep the deepest of a lattice of points is in both of two solids, m; ≤ 0 if none.

    The points are `spacing` m apart, or further where that would be too many.
    """
    low, high = (np.array(end) for end in within)
    size = high - low
    budget = min(_budget(one), _budget(two))
    step = max(spacing, float(np.prod(size) / budget) ** (1.0 / len(size)))
    shape = np.maximum(np.ceil(size / step), 1).astype(int)
    count = math.prod(shape.tolist())
    deepest = -math.inf
    for first in range(0, count, _PIECE):
        number = np.arange(first, min(count, first + _PIECE))
        index = np.stack(np.unravel_index(number, tuple(shape.tolist())), axis=1)
        p = low + (index + 0.5) * (size / shape)
        far = one.distance(p)
        near = np.flatnonzero(far < 0)
        if len(near):
            far = np.maximum(far[near], two.distance(p[near]))
            deepest = max(deepest, -float(far.min()))
    return deepest


def _meshes(item: Any) -> list[SurfaceMesh | MeshInside]:
    """Return the meshes of which a solid is made."""
    if isinstance(item, SurfaceMesh | MeshInside):
        return [item]
    if isinstance(item, Solid):
        item = tuple(item.__getstate__().values())
    if not isinstance(item, tuple) or not any(isinstance(x, Solid | tuple) for x in item):
        return []
    return [mesh for x in item if isinstance(x, Solid | tuple) for mesh in _meshes(x)]


def _budget(solid: Solid) -> int:
    return _BUDGET_OF_MESH if _meshes(solid) else _BUDGET[solid.dimension]


def _distances(solid: Solid, p: Array) -> Array:
    pieces = [solid.distance(p[i : i + _PIECE]) for i in range(0, len(p), _PIECE)]
    return np.concatenate(pieces) if pieces else np.zeros(0)
