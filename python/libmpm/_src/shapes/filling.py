"""From the shape of a body to its particles: which lattice, which holes, which volume each.

Positions are in m relative to the scene's lower corner, as in `lattices.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src.base.axes import AXES
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.shapes import lattices
from libmpm._src.shapes.boxes import Box, OrientedBox
from libmpm._src.shapes.combined import Intersection, Union
from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.mesh_inside import MeshInside
from libmpm._src.shapes.oriented_boxes import Extent, TurnedBox
from libmpm._src.shapes.particle_columns import Stacked
from libmpm._src.shapes.particle_placement import Columns, Jitter, PoissonDisk, Sampling
from libmpm._src.shapes.particle_tiles import Jittered, Remaining, Tiled, lattice_tile, random_tile
from libmpm._src.shapes.solid import Array, Bounds, GivenPoints, Solid
from libmpm._src.shapes.volume import counted_volume, shared_bounds, volume_of

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["BOXES", "Filling", "body_lattice", "bounds_of", "caught_in", "fill", "geometry_of"]
__all__ += ["holes_of", "is_plain", "place_of", "relative", "solid_of"]

#: Shapes that a lattice of their own fills.
BOXES = (Box, OrientedBox)


@dataclass(frozen=True)
class Filling:
    """The particles of a body.

    points  m           positions
    bounds  m, (2, d)   corners of a box around them
    volume  m³          of `slices` particles together (m² in 2D); all have the same
    """

    points: lattices.Rows
    bounds: Array
    volume: float
    slices: int


class _Given:
    """Points of an array."""

    def __init__(self, position: Array) -> None:
        self._position = position

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self._position)

    def rows(self, first: int, last: int) -> Array:
        """Return points first ≤ i < last, shape (last - first, d), m; IndexError beyond `count`."""
        if not 0 <= first <= last <= self.count:
            raise IndexError(f"rows {first} to {last} of {self.count} points")
        return self._position[first:last]


def relative(scene: SceneData, point: Sequence[float]) -> npt.NDArray[np.float64]:
    """Return a point of the scene relative to its lower corner, float64 (d,), m."""
    return np.asarray(point, dtype=np.float64) - np.asarray(scene.lower, dtype=np.float64)


def geometry_of(shape: Box | OrientedBox) -> Extent:
    """Return the corners of a straight box, or the geometry of a turned one; m of the scene."""
    return shape.turned_box() if isinstance(shape, OrientedBox) else (shape.lower, shape.upper)


def place_of(scene: SceneData, body: Body) -> Extent:
    """Return where the box of a body is, relative to the scene's lower corner."""
    assert isinstance(body.shape, BOXES)
    place = geometry_of(body.shape)
    if isinstance(place, TurnedBox):
        return place.moved([-x for x in scene.lower])
    low, high = (relative(scene, corner).tolist() for corner in place)
    return low, high


def body_lattice(scene: SceneData, body: Body) -> lattices.Lattice:
    """Return the lattice that fills a box, relative to the scene's lower corner."""
    place = place_of(scene, body)
    if isinstance(place, TurnedBox):
        return lattices.turned_lattice(
            place, scene.cell_size, body.particles_per_cell, body.lattice
        )
    return lattices.lattice(*place, scene.cell_size, body.particles_per_cell, body.lattice)


def solid_of(shape: object) -> Solid | None:
    """Return a shape as a solid: itself, or what a mesh of elements encloses; None of others."""
    if isinstance(shape, ElementMesh):
        return MeshInside(shape)
    return shape if isinstance(shape, Solid) else None


def holes_of(scene: SceneData, body: Body) -> list[Body]:
    """Return the bodies that are subtracted from this one."""
    return [b for b in scene.bodies if body.name in b.subtract_from and b is not body]


def is_plain(scene: SceneData, body: Body) -> bool:
    """Return whether a body is a box filled by its plain lattice, with boxes alone for holes."""
    holes = holes_of(scene, body)
    plain = isinstance(body.shape, BOXES) and body.sampling is None
    return plain and all(isinstance(b.shape, BOXES) for b in holes)


def bounds_of(scene: SceneData, body: Body) -> Array:
    """Return the corners (2, d) of a box around a body, relative to the scene's lower corner, m."""
    if isinstance(body.shape, BOXES):
        return body_lattice(scene, body).bounds
    assert isinstance(body.shape, Solid | GivenPoints)
    return np.array([relative(scene, corner) for corner in body.shape.bounds()])


def fill(scene: SceneData, body: Body) -> Filling:
    """Return the particles of a body; its shape has an end, and its holes are solids."""
    holes = holes_of(scene, body)
    if is_plain(scene, body):
        grid = body_lattice(scene, body)
        taken = [place_of(scene, b) for b in holes]
        points = lattices.points(grid, taken, scene.cell_size)
        # What is subtracted takes its mass along.
        return Filling(points, grid.bounds, grid.volume, grid.count)
    solids = tuple(solid_of(b.shape) for b in holes if b.shape.dimension == scene.dimension)
    solids = tuple(solid for solid in solids if solid is not None)
    spacing = scene.cell_size / body.particles_per_cell ** (1.0 / scene.dimension)
    shape, how = body.shape, body.sampling
    if isinstance(shape, GivenPoints):
        return _given(shape, solids, scene.lower, spacing)
    if isinstance(shape, BOXES) and not isinstance(how, Columns | PoissonDisk):
        return _box(scene.lower, body_lattice(scene, body), shape, solids, how, spacing)
    assert isinstance(shape, Solid)
    # Beyond the domain nothing may lie; one cell more shows whether it does.
    around = (
        tuple(x - scene.cell_size for x in scene.lower),
        tuple(x + scene.cell_size for x in scene.upper),
    )
    if isinstance(how, Columns):
        axis = _upright(scene) if how.axis is None else AXES.index(how.axis)
        return _columns(scene.lower, around, shape, solids, axis, spacing)
    return _solid(scene.lower, around, shape, solids, how, spacing)


def caught_in(
    scene: SceneData, body: Body, position: Array, allowance: float
) -> npt.NDArray[np.int64]:
    """Return which positions (n, d), m relative, lie in a body's solid; none in given points."""
    solid = solid_of(body.shape)
    if solid is None:
        return np.zeros(0, dtype=np.int64)
    low, high = bounds_of(scene, body)
    near = np.flatnonzero(np.all((position >= low) & (position <= high), axis=1))
    far = solid.distance(position[near] + np.asarray(scene.lower))
    return near[far <= allowance]


@lru_cache(maxsize=4)
def _given(
    shape: GivenPoints, holes: tuple[Solid, ...], corner: tuple[float, ...], spacing: float
) -> Filling:
    position = shape.positions() - np.asarray(corner)
    bounds = np.array([position.min(axis=0), position.max(axis=0)])
    points: lattices.Rows = _Given(position)
    if holes:
        points = Remaining(points, holes, corner, spacing)
    return Filling(points, bounds, shape.total_volume(), shape.count)


@lru_cache(maxsize=16)
def _box(
    corner: tuple[float, ...],
    grid: lattices.Lattice,
    shape: Box | OrientedBox,
    holes: tuple[Solid, ...],
    how: Sampling | None,
    spacing: float,
) -> Filling:
    axes = [grid.axis(a) for a in range(len(grid.shape))]
    points: lattices.Rows = lattices.Points(axes, [])
    if isinstance(how, Jitter):
        ends = zip(grid.lower, grid.upper, grid.shape, strict=True)
        points = Jittered(points, [(b - a) / n for a, b, n in ends], how)
    if grid.frame is not None:
        points = lattices.Turned(points, grid.frame)
    if not holes:
        return Filling(points, grid.bounds, grid.volume, grid.count)
    points = Remaining(points, holes, corner, spacing)
    return Filling(points, grid.bounds, _net_volume(shape, holes), max(1, points.count))


@lru_cache(maxsize=16)
def _solid(
    corner: tuple[float, ...],
    around: Bounds,
    shape: Solid,
    holes: tuple[Solid, ...],
    how: Sampling | None,
    spacing: float,
) -> Filling:
    jitter = how if isinstance(how, Jitter) else None
    tile = (
        random_tile(len(corner), how.seed)
        if isinstance(how, PoissonDisk)
        else lattice_tile(len(corner))
    )
    within = shared_bounds(shape.bounds(), around) or (corner, corner)
    points = Tiled(shape, holes, tile, corner, spacing, within, jitter)
    bounds = np.array(within) - np.asarray(corner)
    return Filling(points, bounds, _net_volume(shape, holes), max(1, points.count))


@lru_cache(maxsize=16)
def _columns(
    corner: tuple[float, ...],
    around: Bounds,
    shape: Solid,
    holes: tuple[Solid, ...],
    axis: int,
    spacing: float,
) -> Filling:
    within = shared_bounds(shape.bounds(), around) or (corner, corner)
    points = Stacked(shape, holes, axis, corner, spacing, within)
    bounds = np.array(within) - np.asarray(corner)
    return Filling(points, bounds, _net_volume(shape, holes), max(1, points.count))


def _upright(scene: SceneData) -> int:
    """Return the axis of gravity, where it is strongest; the last one without any."""
    table = scene.gravity
    rows = table.arrays()[1] if isinstance(table, TimeTable) else np.array([table])
    strength = np.abs(rows).max(axis=0)
    return int(np.argmax(strength)) if strength.any() else scene.dimension - 1


def _net_volume(shape: Solid, holes: tuple[Solid, ...]) -> float:
    """Return the volume of a solid less what holes take out of it, m³ (m² in 2D)."""
    whole = volume_of(shape)
    near = [hole for hole in holes if shared_bounds(shape.bounds(), hole.bounds())]
    if not near or not math.isfinite(whole):
        return whole
    taken = Union(parts=near) if len(near) > 1 else near[0]
    return whole - counted_volume(Intersection(parts=(shape, taken)))
