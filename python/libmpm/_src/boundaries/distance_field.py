"""Boundaries of any shape: their signed distance on a lattice of its own, for the engine.

The lattice is kept in blocks of 8 cells an edge, and of these only the ones that the surface and
its layer pass through, with the distances at their corners; blocks deep inside are named alone. So
what a boundary costs follows its surface, not the domain (`mpm/data/distance_field.hpp`).
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable, engine_table
from libmpm._src.base.values import warn
from libmpm._src.boundaries.covered_faces import Covers, covers_of, motion_of, moves
from libmpm._src.boundaries.responses import DecayLayer, Prescribed
from libmpm._src.boundaries.wall_cells import strains_linearly
from libmpm._src.errors import SceneError
from libmpm._src.shapes.solid import Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["FIELD_EDGE", "DistanceField", "distance_field", "layer_of", "motion_of", "reach_of"]

#: Lattice cells along the edge of a block of distances.
FIELD_EDGE = 8

#: Cells behind a surface where it is known how far in a node is; further in it is held whole.
_DEPTH = 4.0

#: Cells around the domain that its particles can see.
_RIM = 3

#: Points whose distance is asked for at a time.
_PIECE = 1 << 20

#: Blocks that one boundary may have to look through, and bytes of the distances of those it keeps.
_MOST_BLOCKS, _MOST_BYTES = 1 << 26, 4 << 30

#: Seconds of work above which its estimate is given first; points of which the rate is a measure;
#: and distances that a point beside what covers the surface costs, on average.
_LONG, _MEASURED, _BESIDE_COVERS = 20.0, 1000, 20

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Distances of a boundary, in the frame of the scene's lower corner.

    keys     int64 (b, d)     blocks of lattice cells, ascending
    place    int32 (b,)       which block of values; -1 deep inside
    values   float32 (m, 9^d) distances at the corners of lattice cells, in lattice cells
    origin   (d,) m, spacing m of the lattice
    """

    keys: npt.NDArray[np.int64]
    place: npt.NDArray[np.int32]
    values: npt.NDArray[np.float32]
    origin: Array
    spacing: float

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        found: int = self.keys.shape[0] * 12 + self.values.nbytes
        return found

    def bounds(self) -> tuple[Array, Array]:
        """Return the corners of all its blocks, m."""
        edge = FIELD_EDGE * self.spacing
        low = self.origin + self.keys.min(axis=0) * edge
        return low, self.origin + (self.keys.max(axis=0) + 1) * edge


def layer_of(boundary: Boundary) -> DecayLayer:
    """Return the decay layer of a surface: its own, or the default one."""
    return boundary.layer or DecayLayer()


def distance_field(scene: SceneData, boundary: Boundary) -> DistanceField:
    """Return the distances of a boundary; raises `SceneError` where nothing of it is near."""
    assert isinstance(boundary.shape, Solid)
    spacing = boundary.spacing or scene.cell_size
    layer = layer_of(boundary)
    band = layer.thickness * scene.cell_size + 2 * spacing
    if strains_linearly(scene, boundary, ""):
        # Whether another wall is near is asked four cells before a surface.
        band = max(band, 4 * scene.cell_size + spacing)
    region = _region(scene, boundary, band)
    # The same shape is asked for by the plan, the check and the engine.
    covers, found = covers_of(scene, boundary), None
    # What walls cover whole acts where they do.
    for seen in (covers, covers.nothing()):
        key = json.dumps(boundary.shape.to_dict(), sort_keys=True) + seen.key
        found = found or _sampled(_Shape(key, boundary.shape, seen), scene.lower, spacing, band,
                                  _DEPTH * scene.cell_size, region)  # fmt: skip
    if found is None:
        raise SceneError(
            f"boundary '{boundary.name}': no part of {type(boundary.shape).__name__} is within "
            f"{band:.3g} m of the domain; expected to reach into it; move it"
        )
    return found


def _region(scene: SceneData, boundary: Boundary, band: float) -> tuple[tuple[float, ...], ...]:
    """Return the corners between which distances can matter, m of the scene."""
    assert isinstance(boundary.shape, Solid)
    low, high = (list(map(float, x)) for x in boundary.shape.bounds())
    low, high = [x - band for x in low], [x + band for x in high]
    rim = _RIM * scene.cell_size
    inside_low = [x - rim for x in scene.lower]
    inside_high = [x + rim for x in scene.upper]
    if moves(boundary):
        table, of_places = motion_of(boundary)
        if boundary.rotation is None and table is not None and of_places:
            # Where the domain has been, seen from the shape.
            way = table.arrays()[1]
            ends = [(-way.max(axis=0)).tolist(), (-way.min(axis=0)).tolist()]
            inside_low = [x + min(0.0, e) for x, e in zip(inside_low, ends[0], strict=True)]
            inside_high = [x + max(0.0, e) for x, e in zip(inside_high, ends[1], strict=True)]
        elif all(map(math.isfinite, (*low, *high))):
            return tuple(low), tuple(high)
        else:
            raise SceneError(
                f"boundary '{boundary.name}': {type(boundary.shape).__name__} has no end and moves "
                "by a velocity or turns; expected a bounded shape; intersect it with a shapes.Box "
                "(shape & box), or move it by a Displacement"
            )
    low = [max(a, b) for a, b in zip(low, inside_low, strict=True)]
    high = [min(a, b) for a, b in zip(high, inside_high, strict=True)]
    return tuple(low), tuple(high)


class _Shape:
    """A shape with what covers it as a key of a cache: equal where what it is made of is."""

    def __init__(self, key: str, shape: Solid, covers: Covers) -> None:
        self.key = key
        self.shape = shape
        self.covers = covers

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Shape) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@functools.lru_cache(maxsize=16)
def _sampled(
    held: _Shape,
    corner: tuple[float, ...],
    spacing: float,
    band: float,
    depth: float,
    region: tuple[tuple[float, ...], ...],
) -> DistanceField | None:
    shape = held.shape
    d = len(corner)
    zero = np.asarray(corner, dtype=np.float64)
    edge = FIELD_EDGE * spacing
    first = [math.floor((x - z) / edge) for x, z in zip(region[0], corner, strict=True)]
    last = [math.ceil((x - z) / edge) for x, z in zip(region[1], corner, strict=True)]
    counts = [b - a for a, b in zip(first, last, strict=True)]
    if min(counts) <= 0:
        return None
    if math.prod(counts) > _MOST_BLOCKS:
        raise SceneError(
            f"{shape!r:.80}: {math.prod(counts)} blocks of {edge:g} m lie where it may be; "
            f"expected ≤ {_MOST_BLOCKS}; use a larger spacing or a smaller shape"
        )
    # Of blocks further off than half a diagonal no corner can be within the band.
    radius = 0.5 * edge * math.sqrt(d)
    near, deep = [], []
    whole, began = math.prod(counts), time.process_time()
    for start in range(0, whole, _PIECE):
        number = np.arange(start, min(start + _PIECE, whole))
        keys = np.stack(np.unravel_index(number, counts), axis=1) + np.array(first)
        away = shape.distance((keys + 0.5) * edge + zero)
        if not shape.bounding:  # its distance says nothing about what lies between points
            near.append(keys)
            continue
        near.append(keys[np.abs(away) <= radius + max(band, depth)])
        deep.append(keys[away < -(radius + max(band, depth))])
    keys, inside = np.concatenate(near), np.concatenate([np.zeros((0, d), dtype=int), *deep])
    each = (time.process_time() - began) / whole if whole >= _MEASURED else 0.0
    _bound_cost(held, (keys + 0.5) * edge + zero, radius, edge, each)
    corners = np.array(list(itertools.product(range(FIELD_EDGE + 1), repeat=d)))
    values, kept = [], []
    some = max(1, _PIECE // len(corners))
    for start in range(0, len(keys), some):
        here = keys[start : start + some]
        points, which = _distinct((here[:, None, :] * FIELD_EDGE + corners).reshape(-1, d))
        away = held.covers.seen(shape.distance, points * spacing + zero, spacing, depth)
        away = away[which].reshape(len(here), -1)
        reached = (away.min(axis=1) <= band) & (away.max(axis=1) >= -depth)
        inside = np.concatenate([inside, here[away.max(axis=1) < -depth]])
        kept.append(here[reached])
        values.append((away[reached] / spacing).astype(np.float32))
    named = np.concatenate([*kept, inside]) if kept else inside
    if len(named) == 0:
        return None
    shown = sum(len(x) for x in kept)
    place = np.full(len(named), -1, dtype=np.int32)
    place[:shown] = np.arange(shown)
    order = np.lexsort(named.T[::-1])
    table = np.concatenate(values) if values else np.zeros((0, len(corners)), dtype=np.float32)
    return DistanceField(named[order].astype(np.int64), place[order], table, np.zeros(d), spacing)


def _bound_cost(held: _Shape, middle: Array, radius: float, edge: float, each: float) -> None:
    """Refuse distances in too many blocks, warn of many with an estimate, before they are paid.

    `middle` (n, d) of the blocks and their `edge`, m; `each` is what a distance took, s.
    """
    n, d = middle.shape
    most = _MOST_BYTES // (4 * (FIELD_EDGE + 1) ** d)
    what = f"{held.shape!r:.80}: distances in {n:,} blocks of {edge:g} m"
    remedy = f"use a larger spacing than {edge / FIELD_EDGE:g} m, or a smaller shape"
    if n > most:
        raise SceneError(f"{what} are needed; expected ≤ {most:,}; {remedy}")
    points = FIELD_EDGE**d
    if not n * points * _BESIDE_COVERS * each > _LONG:
        return
    beside = int(np.count_nonzero(held.covers.may_cover(held.shape.distance, middle, radius)))
    seconds = each * points * (n + beside * (_BESIDE_COVERS - 1))
    if seconds > _LONG:
        warn([f"{what} will take about {seconds:.2g} s; expected ≤ {_LONG:g} s; {remedy}"])


def _distinct(
    index: npt.NDArray[np.int64],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the different rows of (n, d), and which of them each is: blocks share their faces."""
    low = index.min(axis=0)
    size = tuple(index.max(axis=0) - low + 1)
    if math.prod(map(int, size)) >= 2**62:
        return index, np.arange(len(index))
    number, which = np.unique(
        np.ravel_multi_index(tuple((index - low).T), size), return_inverse=True
    )
    return np.stack(np.unravel_index(number, size), axis=1) + low, which


def reach_of(
    scene: SceneData, boundary: Boundary, field: DistanceField
) -> tuple[list[int], list[int]]:
    """Return the cells lower ≤ i < upper whose nodes a surface may ever act on."""
    table, of_places = motion_of(boundary)
    if boundary.rotation is not None or (table is not None and not of_places):
        return [-_RIM] * scene.dimension, [n + _RIM for n in scene.cells]
    low, high = (np.asarray(corner, dtype=np.float64) for corner in field.bounds())
    if table is not None:  # between its rows it goes straight
        rows = np.asarray(table.value, dtype=np.float64)
        low, high = low + rows.min(axis=0), high + rows.max(axis=0)
    return (
        [max(-_RIM, math.floor(x / scene.cell_size)) for x in low],
        [min(n + _RIM, math.ceil(x / scene.cell_size))
         for x, n in zip(high, scene.cells, strict=True)],
    )  # fmt: skip


def lower_surface(scene: SceneData, boundary: Boundary) -> dict[str, Any]:
    """Return the engine's entries for a boundary of any shape."""
    field = distance_field(scene, boundary)
    low, high = reach_of(scene, boundary, field)
    layer = layer_of(boundary)
    table, of_places = motion_of(boundary)
    turning = boundary.rotation
    turn = None
    if turning is not None:
        angles = turning.radians()
        by_angle = angles is not None
        given = angles if by_angle else turning.rate
        numbers = given if isinstance(given, TimeTable) else TimeTable((0.0,), (float(given or 0),))
        turn = {"table": engine_table(numbers), "places": by_angle}
    corner = np.asarray(scene.lower, dtype=np.float64)
    # A prescribed region ends at its surface; its lattice needs no layer.
    whole = isinstance(boundary.response, Prescribed)
    return {
        "kind": "surface",
        "lower": low,
        "upper": high,
        "surface": {
            "keys": field.keys,
            "place": field.place,
            "values": field.values,
            "origin": field.origin,
            "spacing": field.spacing,
            "decay": "constrained" if whole else layer.function,
            "thickness": layer.thickness * scene.cell_size,
            "path": None if table is None else {"table": engine_table(table), "places": of_places},
            "turn": turn,
            "about": None if turning is None else np.asarray(turning.about) - corner,
            "axis": None if turning is None else np.asarray(turning.direction()),
        },
    }
