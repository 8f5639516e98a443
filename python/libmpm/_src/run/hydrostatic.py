"""Pressures of water at rest, and rows of positions that the engine can make itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src.scene.places import initial_gravity
from libmpm._src.shapes.lattices import Points, Rows, Runs

if TYPE_CHECKING:
    from collections.abc import Callable

    from libmpm._src.scene.data import SceneData

    #: From (first, last) to what is given for the particles first ≤ i < last of a body.
    Asked = Callable[[int, int], npt.NDArray[np.float64]]

__all__ = ["StillWater", "at_hand", "still_water"]


def at_hand(points: Rows) -> Asked:
    """Return the rows of points; those of a plain lattice say what it is, as `runs`."""
    return points if isinstance(points, Points) else points.rows


@dataclass(frozen=True)
class StillWater:
    """Rows of p = strength · max(top - x · up, 0), (n,), Pa, of particles at x.

    strength  Pa/m   weight of a volume
    top       m      of the level, along `up`
    up        (d,)   against gravity, of length 1
    position         rows of x, (n, d), m
    """

    strength: float
    top: float
    up: npt.NDArray[np.float64]
    position: Asked

    @property
    def runs(self) -> Runs | None:
        """The lattice that the positions are, see `Points.runs`; None for others."""
        return self.position.runs if isinstance(self.position, Points) else None

    def __call__(self, first: int, last: int) -> npt.NDArray[np.float64]:
        """Return the pressures of particles first ≤ i < last."""
        # Not a product of matrices: how that rounds a row may depend on the rows around it.
        height = sum(x * u for x, u in zip(self.position(first, last).T, self.up, strict=True))
        return np.asarray(self.strength * np.maximum(self.top - height, 0.0))


def still_water(scene: SceneData, level: float, density: float, position: Asked) -> StillWater:
    """Return rows of p = ρ g depth below the level, m of the scene, and zero above it."""
    gravity = initial_gravity(scene)
    strength = float(np.linalg.norm(gravity))
    up = -gravity / strength
    top = level - float(np.dot(up, np.asarray(scene.lower, dtype=np.float64)))
    return StillWater(density * strength, top, up, position)
