"""Where things of a scene are: vertical axis, blocked cells, planes, extents, counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Mirror
from libmpm._src.boundaries.wall_cells import linear_by_default, strains_linearly
from libmpm._src.grids import placing
from libmpm._src.grids.shapes import Outline
from libmpm._src.shapes.boxes import Box, DomainWalls, Solid, faces_of
from libmpm._src.shapes.filling import fill, relative

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body, Boundary

__all__ = ["Plane", "body_counts", "extent_of", "faces_present", "initial_gravity", "new_bodies"]
__all__ += ["linear_all_round", "planes", "snap", "vertical_axis"]

#: Part of a cell that rounding of coordinates may make.
_ROUNDING = 1e-6
#: Components of gravity below this part of the largest are rounding.
_RESIDUE = 1e-12


@dataclass(frozen=True)
class Plane:
    """An impermeable plane: where the scene states it and where the grid has it, in m.

    Coordinates are those of the scene. `shift` is effective - stated, in cells. `cell` says how the
    cells beside it strain: "held", "linear" or "mirror".
    """

    boundary: str
    face: str
    stated: float
    effective: float
    shift: float
    cell: str


def initial_gravity(scene: SceneData) -> npt.NDArray[np.float64]:
    """Return gravity at time 0, (d,), m/s²."""
    if isinstance(scene.gravity, TimeTable):
        return scene.gravity.at(0.0)
    gravity = np.array(scene.gravity, dtype=np.float64)
    # What g cos 90° leaves is no direction of its own.
    gravity[np.abs(gravity) < _RESIDUE * np.abs(gravity).max()] = 0.0
    return gravity


def vertical_axis(scene: SceneData) -> int:
    """Return the axis closest to gravity at time 0; the last one without gravity."""
    gravity = np.abs(initial_gravity(scene))
    return int(np.argmax(gravity)) if np.any(gravity > 0) else scene.dimension - 1


def snap(scene: SceneData, box: Box) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the cells that a box boundary blocks, lower ≤ i < upper: the nearest cell faces."""
    ends = []
    for corner in (box.lower, box.upper):
        # The allowance decides a face in the middle of a cell alike for every rounding.
        cells = relative(scene, corner) / scene.cell_size + 0.5 + _ROUNDING
        ends.append(tuple(math.floor(x) for x in cells.tolist()))
    return ends[0], ends[1]


def faces_present(scene: SceneData, boundary: Boundary) -> tuple[str, ...]:
    """Return the faces that a boundary has in this scene."""
    everything = faces_of(scene.dimension)
    shape = boundary.shape
    if isinstance(shape, Outline) or boundary.is_surface:
        return ()
    if isinstance(shape, DomainWalls) and shape.faces != "all":
        return tuple(f for f in everything if f in shape.faces)
    return everything


def extent_of(scene: SceneData, boundary: Boundary) -> tuple[list[float], list[float]]:
    """Return the corners of what a boundary's shape has inside the domain, m of the scene."""
    if not isinstance(boundary.shape, Solid):
        return list(scene.lower), list(scene.upper)
    low, high = boundary.shape.bounds()
    ends = (max, low, scene.lower), (min, high, scene.upper)
    if not boundary.is_surface:
        return list(low), list(high)
    first, last = ([pick(*x) for x in zip(a, b, strict=True)] for pick, a, b in ends)
    return first, last


def linear_all_round(scene: SceneData, boundary: Boundary) -> bool:
    """Return whether the cells beside all faces of a boundary strain linearly."""
    faces, known = faces_present(scene, boundary) or ("",), linear_by_default(scene)
    return all(strains_linearly(scene, boundary, face, known) for face in faces)


def planes(scene: SceneData) -> list[Plane]:
    """Return stated and effective plane of every wall and box face."""
    found: list[Plane] = []
    if scene.grid is not None:
        return found  # boundaries lie on edges of the grid, exactly
    linear = linear_by_default(scene)
    for boundary in scene.boundaries:
        if boundary.is_surface:
            continue  # exact wherever it is
        if isinstance(boundary.shape, Box):
            stated = (boundary.shape.lower, boundary.shape.upper)
            cells = snap(scene, boundary.shape)
        else:
            stated = (scene.lower, scene.upper)
            cells = ((0,) * scene.dimension, scene.cells)
        for face in faces_present(scene, boundary):
            axis, end = "xyz".index(face[0]), int(face[1] == "+")
            effective = scene.lower[axis] + cells[end][axis] * scene.cell_size
            shift = (effective - stated[end][axis]) / scene.cell_size
            response = boundary.response_at(face)
            cell = "mirror" if isinstance(response, Mirror) else "held"
            if strains_linearly(scene, boundary, face, linear):
                cell = "linear"
            found.append(Plane(boundary.name, face, stated[end][axis], effective, shift, cell))
    return found


def new_bodies(scene: SceneData) -> list[Body]:
    """Return the bodies that the run which the scene continues from did not have."""
    return [b for b in scene.bodies if scene.start is None or not scene.start.restored(b.name)]


def body_counts(scene: SceneData) -> list[int]:
    """Return the number of particles of every body; of a restored one no fewer than it has."""
    if scene.grid is not None:
        return [placing.place(scene, b).count for b in scene.bodies]
    counts = []
    for b in scene.bodies:
        before = None if scene.start is None else scene.start.restored(b.name)
        if before is None:
            counts.append(fill(scene, b).points.count)
        elif before.left is None or scene.start is None:
            counts.append(before.ids)
        else:
            counts.append(before.left * scene.start.tiles)
    return counts
