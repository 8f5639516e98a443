"""A scene cut down to a box: its domain, and what of its boundaries and sensors is left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker
from libmpm._src.boundaries.responses import Displacement
from libmpm._src.errors import SceneError
from libmpm._src.scene.data import SceneData
from libmpm._src.scene.parts import Boundary, PlacedSensor
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.solid import Solid

__all__ = ["cells_within", "cut_parts", "require_particles"]

#: Part of a cell by which a face may miss the side of a cell.
_SLACK = 1e-6


def cells_within(
    check: Checker, before: SceneData, within: Box
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the lowest cell of a box in a scene's domain, and how many it has along each axis.

    The box is moved out to faces of cells and ends with the domain. Raises `SceneError`.
    """
    if before.flows:
        check.fail("within is given, but the run has flows through faces of its domain; expected "
                   "none; a cut has other faces")  # fmt: skip
    if len(within.lower) != before.dimension:
        check.fail(f"within has {len(within.lower)} axes; expected {before.dimension}, those of "
                   "the run")  # fmt: skip
    check.finish()
    first, cells = [], []
    for a in range(before.dimension):
        low, high = ((x - before.lower[a]) / before.cell_size for x in
                     (within.lower[a], within.upper[a]))  # fmt: skip
        begin = max(0, math.floor(low + _SLACK))
        end = min(before.cells[a], math.ceil(high - _SLACK))
        if end <= begin:
            check.fail(
                f"within spans {within.lower[a]:g} to {within.upper[a]:g} m along {'xyz'[a]}; "
                f"expected a part of the domain, {before.lower[a]:g} to {before.upper[a]:g} m"
            )
        first.append(begin)
        cells.append(end - begin)
    check.finish()
    return tuple(first), tuple(cells)


def cut_parts(
    before: SceneData, lower: Sequence[float], upper: Sequence[float]
) -> tuple[list[str], list[str]]:
    """Return the names of the boundaries and of the sensors that lie outside of a cut.

    A boundary is left out where it cannot come in: it stands, or moves by a table of places, and
    never meets the box. Sensors are left out whose place or region lies outside, that are part of a
    boundary left out, or that follow single particles.
    """
    boundaries = [b.name for b in before.boundaries if not _meets(b, lower, upper)]
    sensors = [
        s.name for s in before.sensors if not _can_sample(s, lower, upper, boundaries)
    ]  # fmt: skip
    return boundaries, sensors


def _meets(boundary: Boundary, lower: Sequence[float], upper: Sequence[float]) -> bool:
    """Return whether a boundary may ever have a part in a box."""
    shape = boundary.shape
    if isinstance(shape, DomainWalls) or not isinstance(shape, Solid):
        return True
    low, high = (np.array(x, np.float64) for x in shape.bounds())
    if boundary.rotation is not None:
        return True
    if isinstance(boundary.motion, Displacement):
        places = np.asarray(boundary.motion.table.arrays()[1], np.float64)
        low, high = low + places.min(axis=0), high + places.max(axis=0)
    elif boundary.motion is not None and not isinstance(boundary.motion, TimeTable):
        return True
    return bool(np.all(low < np.asarray(upper)) and np.all(high > np.asarray(lower)))


def _can_sample(
    placed: PlacedSensor, lower: Sequence[float], upper: Sequence[float], gone: Sequence[str]
) -> bool:
    """Return whether a sensor has something to look at in a box."""
    sensor: Any = placed.sensor
    if getattr(sensor, "boundary", None) in gone:
        return False
    ids = getattr(sensor, "ids", "all")
    if not (isinstance(ids, str) and ids == "all"):
        return False
    place = getattr(sensor, "position", None)
    if place is not None and not isinstance(place, str):
        # A gauge names the axes across the vertical one alone.
        return all(a <= x <= b for x, a, b in zip(place, lower, upper, strict=False))
    region = getattr(sensor, "region", None)
    if isinstance(region, Solid):
        low, high = region.bounds()
        return all(p < b and q > a for p, q, a, b in zip(low, high, lower, upper, strict=True))
    return True


def require_particles(path: str, left: dict[str, int]) -> None:
    """Refuse a cut in which a body of the run has no particle; raises `SceneError`."""
    empty = [name for name, n in left.items() if n == 0]
    if empty:
        raise SceneError([
            f"Scene.from_checkpoint('{path}'): body '{name}' has no particle within the cut; "
            "expected some of each body; widen it" for name in empty
        ])  # fmt: skip
