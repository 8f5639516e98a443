"""How a panel looks at a scene: along an axis, or from above one corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["OBLIQUE", "View"]

Array = NDArray[np.float64]

#: The name of the view from above a corner, beside planes such as "xz".
OBLIQUE = "3d"

#: Angles of that view, degrees: from the first horizontal axis, and above the horizon.
_AZIMUTH, _ELEVATION = -62.0, 24.0


@dataclass(frozen=True)
class View:
    """A parallel projection: unit vectors (d,) to the right, up, and towards the viewer.

    In two dimensions nothing is towards the viewer.
    """

    right: Array
    up: Array
    towards: Array

    @classmethod
    def along(cls, dimension: int, first: int, second: int) -> View:
        """Look at the plane of two axes, the first to the right and the second up."""
        unit = np.eye(dimension)
        towards = np.cross(unit[first], unit[second]) if dimension == 3 else np.zeros(2)
        return cls(unit[first], unit[second], towards)

    @classmethod
    def oblique(cls, vertical: int) -> View:
        """Look at a scene in space from above, past its first corner."""
        flat = [a for a in range(3) if a != vertical]
        azimuth, elevation = np.radians(_AZIMUTH), np.radians(_ELEVATION)
        towards, upright = np.zeros(3), np.eye(3)[vertical]
        towards[flat[0]] = np.cos(elevation) * np.cos(azimuth)
        towards[flat[1]] = np.cos(elevation) * np.sin(azimuth)
        towards[vertical] = np.sin(elevation)
        right = np.cross(upright, towards)
        if vertical == 1:  # axes x, z and y up are left-handed: look from the other side
            towards[flat[1]] *= -1
            right = np.cross(upright, towards)
        right /= np.linalg.norm(right)
        return cls(right, np.cross(towards, right), towards)

    @property
    def deep(self) -> bool:
        """Whether something can be behind something else."""
        return bool(np.any(self.towards))

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return points (n, d) as (n, 2) m of the picture and their depth (n,) m."""
        points = np.asarray(points, np.float64)
        flat = np.stack([points @ self.right, points @ self.up], axis=1)
        return flat, points @ self.towards
