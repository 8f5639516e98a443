"""How low water can lie: the least height of the middle of a volume in what a domain leaves free.

Nothing that flows brings the middle of a volume lower than it lies when it fills the domain from
its lowest place up. Water whose particles creep together, while their stored volumes say that they
do not, gets below that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src.boundaries import Prescribed
from libmpm._src.checks import initial_gravity
from libmpm._src.shapes import Box
from libmpm._src.timetable import TimeTable

if TYPE_CHECKING:
    from libmpm._src.parts import Boundary
    from libmpm._src.scene import Scene

__all__ = ["Basin", "basin_of"]


@dataclass(frozen=True)
class Basin:
    """What is free of a domain, cut along gravity.

    bounds  (n + 1,) m           heights between which its cross-section is the same, ascending;
                                 against gravity, from the domain's lower corner
    areas   (n,) m² (2D: m)      cross-sections
    """

    bounds: npt.NDArray[np.float64]
    areas: npt.NDArray[np.float64]

    def lowest_middle(self, volume: float) -> tuple[float, float] | None:
        """Return the least height of the middle of a volume, m³ (2D: m²), and its floor, m.

        None where the volume is zero or more than there is room for.
        """
        room = self.areas * np.diff(self.bounds)
        below = np.concatenate(([0.0], np.cumsum(room)))
        if not 0 < volume < below[-1]:
            return None
        filled = np.clip(volume - below[:-1], 0.0, room)
        used = filled > 0
        thick = filled[used] / self.areas[used]
        middle = np.sum(filled[used] * (self.bounds[:-1][used] + 0.5 * thick)) / volume
        return float(middle), float(self.bounds[:-1][used][0])


def basin_of(scene: Scene) -> Basin | None:
    """Return what boundaries leave free of a domain; None where gravity is not along an axis.

    Boxes that stay where they are and let nothing in take their place away. Others, and surfaces of
    any shape, count as free: that is lower, never higher, than what water can fill.
    """
    if scene.grid is not None or isinstance(scene.gravity, TimeTable):
        return None
    gravity = np.asarray(initial_gravity(scene), dtype=float)
    along = np.flatnonzero(gravity)
    if len(along) != 1:
        return None
    axis = int(along[0])
    lower, upper = np.asarray(scene.lower, float), np.asarray(scene.upper, float)
    boxes = [_cells(scene, b.shape) for b in scene.boundaries if _stands(b)]  # type: ignore[arg-type]
    edges = [
        np.unique(np.clip([lower[a], upper[a], *(x[a] for box in boxes for x in box)],
                          lower[a], upper[a]))
        for a in range(len(lower))
    ]  # fmt: skip
    middles = np.meshgrid(*[0.5 * (e[1:] + e[:-1]) for e in edges], indexing="ij")
    free = np.ones(middles[0].shape, dtype=bool)
    for low, high in boxes:
        free &= ~np.logical_and.reduce(
            [(x > a) & (x < b) for x, a, b in zip(middles, low, high, strict=True)]
        )
    for a, edge in enumerate(edges):
        if a != axis:
            shape = np.ones(len(edges), dtype=int)
            shape[a] = -1
            free = free * np.diff(edge).reshape(shape)
    areas = free.sum(axis=tuple(a for a in range(len(edges)) if a != axis), dtype=float)
    bounds = edges[axis] - lower[axis]
    if gravity[axis] > 0:
        bounds, areas = -bounds[::-1], areas[::-1]
    return Basin(bounds, areas)


def _stands(boundary: Boundary) -> bool:
    """Whether it is a box on cell faces that keeps everything out all the time."""
    held = (boundary.motion, boundary.time, boundary.within)
    keeps = not any(isinstance(r, Prescribed) for r in boundary.responses)
    box = isinstance(boundary.shape, Box) and not boundary.is_surface and not boundary.bodies
    return box and keeps and all(x is None for x in held)


def _cells(scene: Scene, box: Box) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the corners of a box on the cell faces next to it."""
    lower = np.asarray(scene.lower, float)
    low, high = (
        lower + scene.cell_size * np.round((np.asarray(x, float) - lower) / scene.cell_size)
        for x in (box.lower, box.upper)
    )
    return low, high
