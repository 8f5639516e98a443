"""Particles in solids: tiles of a lattice or of random points, as far as they lie inside.

Lengths are in m, relative to the scene's lower corner, in float64, as in `lattices.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from libmpm._src.base.optional_packages import need
from libmpm._src.shapes.lattices import Rows
from libmpm._src.shapes.particle_placement import Jitter
from libmpm._src.shapes.solid import Array, Bounds, Solid

__all__ = ["Jittered", "Remaining", "Tile", "Tiled", "lattice_tile", "moves", "random_tile"]

#: Part of a spacing by which rounding may misplace a point or a surface.
_TOLERANCE = 1e-9

#: Points looked at together, and the most that are made at a time.
_PIECE = 1 << 18

#: Points of a lattice tile along one axis, by dimension.
_EDGE = {2: 32, 3: 8}

#: Least distance of random points as part of the edge of their tile: about a thousand of them.
_RADIUS = {2: 0.0255, 3: 0.085}


@dataclass(frozen=True)
class Tile:
    """Points that are repeated: `edge` and `points` (n, d) in spacings."""

    edge: float
    points: Array

    @property
    def margin(self) -> float:
        """Half the diagonal, in spacings: how far a point can be from the middle of its tile."""
        return 0.5 * self.edge * math.sqrt(self.points.shape[1])


@lru_cache(maxsize=2)
def lattice_tile(dimension: int) -> Tile:
    """Return a tile of points at the centres of slices, one a slice."""
    n = _EDGE[dimension]
    points = np.indices((n,) * dimension).reshape(dimension, -1).T.astype(np.float64)
    return Tile(float(n), points + 0.5)


@lru_cache(maxsize=8)
def random_tile(dimension: int, seed: int) -> Tile:
    """Return a periodic tile of Poisson-disk points with one of them a slice on average.

    Points of SciPy's sampler that are too close across the edges are taken out, and the gaps filled
    by points thrown at random.
    """
    qmc = need("scipy.stats.qmc", "shapes.PoissonDisk", "mesh")
    radius = _RADIUS[dimension]
    rng = np.random.default_rng(seed)
    points = np.zeros((0, dimension))
    for point in qmc.PoissonDisk(dimension, radius=radius, rng=rng).fill_space():
        if _is_far(points, point, radius):
            points = np.vstack([points, point])
    spatial = need("scipy.spatial", "shapes.PoissonDisk", "mesh")
    for _ in range(20):
        thrown = rng.random((2048, dimension))
        away, _ = spatial.cKDTree(points, boxsize=1.0).query(thrown)
        for point in thrown[away >= radius]:
            if _is_far(points, point, radius):
                points = np.vstack([points, point])
    edge = len(points) ** (1.0 / dimension)
    return Tile(edge, points * edge)


def _is_far(points: Array, point: Array, radius: float) -> bool:
    away = np.abs(points - point)
    away = np.minimum(away, 1.0 - away)
    return bool(((away * away).sum(axis=1) >= radius**2).all())


def moves(number: npt.NDArray[np.int64], dimension: int, jitter: Jitter) -> Array:
    """Return random moves (n, d), in spacings, of the lattice points of these numbers.

    SplitMix64 (Steele, Lea and Flood 2014) of a counter: no point knows of another.
    """
    axes = np.arange(dimension, dtype=np.uint64)
    state = number.astype(np.uint64)[:, None] * np.uint64(dimension) + axes
    with np.errstate(over="ignore"):
        state = _mixed(np.array([jitter.seed], dtype=np.uint64)) + state
        bits = _mixed(state * np.uint64(0x9E3779B97F4A7C15))
    return ((bits >> np.uint64(11)).astype(np.float64) * 2.0**-53 - 0.5) * jitter.share


def _mixed(z: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    with np.errstate(over="ignore"):
        z = z + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


class Tiled:
    """The points of repeated tiles that lie inside a solid and in no hole.

    solid     scene          what is filled
    holes     scene          what is not
    corner    m, (d,)        coordinates in the scene of the scene's lower corner
    spacing   m              edge of a slice; the first point of a lattice is half of it from
                             the corner
    bounds    m, scene       of the solid, finite
    jitter                   moves of the points of a lattice

    A point on a face that looks down an axis is inside, one on a face that looks up is not. A tile
    whose middle is further from all surfaces than its corners is taken or left as a whole; of the
    others one bit is held for every point, and one number for every tile. Memory and time follow
    the surface; rows are made in pieces.
    """

    def __init__(
        self,
        solid: Solid,
        holes: Sequence[Solid],
        tile: Tile,
        corner: Sequence[float],
        spacing: float,
        bounds: Bounds,
        jitter: Jitter | None = None,
    ) -> None:
        self._tile = tile
        self._spacing = spacing
        self._jitter = jitter
        self._corner = np.asarray(corner, dtype=np.float64)
        step = tile.edge * spacing
        ends = [[(x - c) / step for x, c in zip(end, corner, strict=True)] for end in bounds]
        self._first = np.array([math.floor(x - _TOLERANCE) for x in ends[0]], dtype=np.int64)
        last = np.array([math.ceil(x + _TOLERANCE) for x in ends[1]], dtype=np.int64)
        self._shape = tuple(np.maximum(last - self._first, 0).tolist())
        self._masks: dict[int, npt.NDArray[np.uint8]] = {}
        counts = self._sort_out(solid, holes)
        self._start = np.append(0, np.cumsum(counts))

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self._start[-1])

    @cached_property
    def _margin(self) -> float:
        """How far a point can be from the middle of its tile, m."""
        share = 0.5 * self._jitter.share if self._jitter else 0.0
        wider = self._tile.margin + share * math.sqrt(len(self._first))
        return (1.0 + _TOLERANCE) * self._spacing * wider

    def _sort_out(self, solid: Solid, holes: Sequence[Solid]) -> npt.NDArray[np.int64]:
        """Return how many points of each tile remain; keep masks of those that are cut."""
        n = len(self._tile.points)
        total = math.prod(self._shape)
        counts = np.zeros(total, dtype=np.int64)
        sure = solid.bounding and all(hole.bounding for hole in holes)
        group = max(1, _PIECE // n)
        for first in range(0, total, _PIECE):
            tiles = np.arange(first, min(total, first + _PIECE))
            if sure:
                middle = (self._index(tiles) + 0.5) * (self._tile.edge * self._spacing)
                far = solid.distance(middle + self._corner)
                for hole in holes:
                    far = np.maximum(far, -hole.distance(middle + self._corner))
                counts[tiles[far < -self._margin]] = n
                tiles = tiles[np.abs(far) <= self._margin]
            for i in range(0, len(tiles), group):
                some = tiles[i : i + group]
                kept = self._inside(self._points(some), solid, holes).reshape(len(some), n)
                counts[some] = kept.sum(axis=1)
                for k, mask in zip(some.tolist(), kept, strict=True):
                    if mask.any() and not mask.all():
                        self._masks[k] = np.packbits(mask)
        return counts

    def _inside(self, p: Array, solid: Solid, holes: Sequence[Solid]) -> npt.NDArray[np.bool_]:
        p = p + (self._corner + _TOLERANCE * self._spacing)
        kept = solid._contains(p)
        for hole in holes:
            here = np.flatnonzero(kept)
            kept[here] = ~hole._contains(p[here])
        return kept

    def _index(self, tiles: npt.NDArray[np.int64]) -> Array:
        """Return where tiles lie, in tiles from the scene's lower corner, (n, d)."""
        index = np.stack(np.unravel_index(tiles, self._shape), axis=1)
        return (index + self._first).astype(np.float64)

    def _points(self, tiles: npt.NDArray[np.int64]) -> Array:
        """Return all points of tiles, (tiles · n, d), m."""
        local = self._tile.points
        d = local.shape[1]
        p = (self._index(tiles)[:, None] * self._tile.edge + local).reshape(-1, d)
        if self._jitter is not None:
            number = (tiles[:, None] * len(local) + np.arange(len(local))).ravel()
            p = p + moves(number, d, self._jitter)
        return np.asarray(p * self._spacing)

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        if not 0 <= first <= last <= self.count:
            raise IndexError(f"rows {first} to {last} of {self.count} points")
        n, d = self._tile.points.shape
        result = np.empty((last - first, d), dtype=np.float64)
        tile = int(np.searchsorted(self._start, first, side="right")) - 1
        group = max(1, _PIECE // n)
        at = first
        while at < last:
            beyond = int(np.searchsorted(self._start, last, side="left"))
            end = min(tile + group, beyond)
            tiles = tile + np.flatnonzero(np.diff(self._start[tile : end + 1]))
            if len(tiles):
                p = self._points(tiles)[self._kept(tiles)]
                skip = at - int(self._start[tile])
                take = min(last - at, len(p) - skip)
                result[at - first : at - first + take] = p[skip : skip + take]
                at += take
            tile = end
        return result

    def _kept(self, tiles: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        n = len(self._tile.points)
        kept = np.ones((len(tiles), n), dtype=bool)
        for row, k in enumerate(tiles.tolist()):
            mask = self._masks.get(k)
            if mask is not None:
                kept[row] = np.unpackbits(mask, count=n)
        return kept.ravel()


class Jittered:
    """Points of a lattice of slices, each moved within its own slice; see `Jitter`."""

    def __init__(self, own: Rows, spacing: Sequence[float], jitter: Jitter) -> None:
        self._own = own
        self._spacing = spacing
        self._jitter = jitter

    @property
    def count(self) -> int:
        """Number of points."""
        return self._own.count

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        p = self._own.rows(first, last)
        return p + moves(np.arange(first, last), p.shape[1], self._jitter) * self._spacing


class Remaining:
    """Points that lie in no hole; `corner` (d,) m is the scene's lower corner in the scene.

    One bit is held for every point of a piece in which some are missing.
    """

    def __init__(
        self, own: Rows, holes: Sequence[Solid], corner: Sequence[float], spacing: float
    ) -> None:
        self._own = own
        self._masks: list[npt.NDArray[np.uint8] | None] = []
        counts = []
        away = np.asarray(corner, dtype=np.float64) + _TOLERANCE * spacing
        for first in range(0, own.count, _PIECE):
            p = own.rows(first, min(own.count, first + _PIECE)) + away
            kept = np.ones(len(p), dtype=bool)
            for hole in holes:
                here = np.flatnonzero(kept)
                kept[here] = ~hole._contains(p[here])
            counts.append(int(np.count_nonzero(kept)))
            self._masks.append(None if kept.all() else np.packbits(kept))
        self._start = np.append(0, np.cumsum(np.array(counts, dtype=np.int64)))

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self._start[-1])

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        if not 0 <= first <= last <= self.count:
            raise IndexError(f"rows {first} to {last} of {self.count} points")
        found = []
        begin = int(np.searchsorted(self._start, first, side="right")) - 1
        stop = int(np.searchsorted(self._start, last, side="left"))
        for piece in range(begin, max(begin, stop) if first < last else begin):
            low = max(first - int(self._start[piece]), 0)
            high = min(last, int(self._start[piece + 1])) - int(self._start[piece])
            base = piece * _PIECE
            mask = self._masks[piece]
            if mask is None:
                found.append(self._own.rows(base + low, base + high))
                continue
            n = min(_PIECE, self._own.count - base)
            kept = np.flatnonzero(np.unpackbits(mask, count=n))[low:high]
            if len(kept):
                whole = self._own.rows(base + int(kept[0]), base + int(kept[-1]) + 1)
                found.append(whole[kept - kept[0]])
        return np.concatenate(found) if found else self._own.rows(0, 0)
