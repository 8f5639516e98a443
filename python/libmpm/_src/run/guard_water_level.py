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

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Prescribed
from libmpm._src.scene.places import faces_present, initial_gravity, snap
from libmpm._src.shapes.boxes import Box, DomainWalls

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

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


def basin_of(scene: SceneData) -> Basin | None:
    """Return what boundaries leave free of a domain; None where the level says nothing.

    That is where gravity changes or is not along an axis, and where the face that it points at is
    not walled: what falls through takes its middle out of the domain first. Boxes that stay where
    they are and let nothing in take their place away. Others, and surfaces of any shape, count as
    free: that is lower, never higher, than what water can fill.
    """
    if scene.grid is not None or isinstance(scene.gravity, TimeTable):
        return None
    gravity = initial_gravity(scene)
    along = np.flatnonzero(gravity)
    if len(along) != 1:
        return None
    axis = int(along[0])
    if not _floored(scene, f"{'xyz'[axis]}{'+' if gravity[axis] > 0 else '-'}"):
        return None
    boxes = [snap(scene, b.shape) for b in scene.boundaries if _stands(b)]  # type: ignore[arg-type]
    edges = [
        np.unique(np.clip([0, cells, *(x[a] for box in boxes for x in box)], 0, cells))
        for a, cells in enumerate(scene.cells)
    ]
    free = np.ones([len(edge) - 1 for edge in edges], dtype=bool)
    for low, high in boxes:
        free[tuple(
            slice(*np.searchsorted(edge, np.clip([a, b], 0, edge[-1])))
            for edge, a, b in zip(edges, low, high, strict=True)
        )] = False  # fmt: skip
    # Areas of the layers: sums over what lies across, one axis after another.
    dx = scene.cell_size
    areas = np.moveaxis(free, axis, 0).astype(float)
    for edge in reversed([edge for a, edge in enumerate(edges) if a != axis]):
        areas = areas @ (np.diff(edge) * dx)
    bounds = edges[axis] * dx
    if gravity[axis] > 0:
        bounds, areas = -bounds[::-1], areas[::-1]
    return Basin(bounds, areas)


def _keeps(boundary: Boundary) -> bool:
    """Whether a boundary is there all the time, stays, and keeps all bodies out."""
    held = (boundary.motion, boundary.time, boundary.within)
    keeps = not any(isinstance(r, Prescribed) for r in boundary.responses)
    return keeps and not boundary.bodies and all(x is None for x in held)


def _stands(boundary: Boundary) -> bool:
    """Whether it is a box on cell faces that keeps everything out all the time."""
    return isinstance(boundary.shape, Box) and not boundary.is_surface and _keeps(boundary)


def _floored(scene: SceneData, face: str) -> bool:
    """Whether a face of the domain is a wall that nothing leaves by."""
    walls = (b for b in scene.boundaries if isinstance(b.shape, DomainWalls) and _keeps(b))
    walled = any(face in faces_present(scene, b) for b in walls)
    return walled and not any(placed.flow.face == face for placed in scene.flows)
