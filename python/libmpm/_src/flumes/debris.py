"""Debris of the facilities: fields that float or stand, whole or one half of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import SceneError
from libmpm._src.flumes.facility import Difference
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.python_sensors import BodyTracker
from libmpm._src.shapes.boxes import OrientedBox
from libmpm._src.studies.debris.field import DebrisField

if TYPE_CHECKING:
    from libmpm._src.flumes.criteria import Signals

__all__ = ["add_field", "carried_speed", "displacement", "lengthened", "spread", "track"]

#: Speed above which a piece counts as carried, m/s.
_CARRIED = 0.1


def add_field(
    scene: Scene,
    field: DebrisField,
    *,
    elevation: float,
    half: bool = False,
    displaces: Sequence[str] = ("water",),
) -> tuple[str, ...]:
    """Add the pieces of a field to a scene in space as bodies "debris-1", ...; return their names.

    With `half` what lies at y < 0 is left out, and pieces on the centreline are cut there: they
    must lie along or across the flow. Raises `SceneError`.
    """
    if not half:
        return field.add_to(scene, elevation=elevation, subtract_from=displaces)
    names: list[str] = []
    digits = len(str(len(field)))
    for piece in field.pieces:
        kind = field.prototypes[piece.prototype]
        turned = abs(piece.angle % 180.0 - 90.0) < 1e-6
        if not turned and abs(piece.angle % 180.0) > 1e-6:
            raise SceneError(f"debris: a piece is turned by {piece.angle:g} degrees in half of a "
                             "flume; expected 0 or 90; use width='full'")  # fmt: skip
        long, wide = (kind.width, kind.length) if turned else (kind.length, kind.width)
        low, high = piece.y - 0.5 * wide, piece.y + 0.5 * wide
        if high <= 1e-9:
            continue
        middle = 0.5 * (max(low, 0.0) + high)
        up = elevation + piece.elevation
        shape = OrientedBox(
            centre=(piece.x, middle, up + 0.5 * kind.height),
            size=(long, high - max(low, 0.0), kind.height),
            angle=0.0,
        )
        names.append(scene.add_body(
            name=f"debris-{len(names) + 1:0{digits}}", shape=shape, material=kind.material,
            particles_per_cell=kind.particles_per_cell, subtract_from=displaces,
        ))  # fmt: skip
    return tuple(names)


def lengthened(what: str, facility: float, scene: float) -> list[Difference]:
    """Return the difference of a length that was moved to faces of cells, if there is one."""
    if abs(facility - scene) < 1e-9:
        return []
    return [Difference(what, f"{facility:g} m", f"{scene:g} m", "on faces of cells")]


def track(scene: Scene, names: Sequence[str], interval: float = 0.05) -> None:
    """Add a tracker of each body under the body's name."""
    for name in names:
        scene.add_sensor(name=name, sensor=BodyTracker(body=name, interval=interval))


def _paths(signals: Signals) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (n,) s of the laboratory and centroids (pieces, 2, n), m, along and across."""
    names = [n for n in signals.names() if n.startswith("debris-")]
    time = signals.column(names[0], "centroid_x")[0]
    rows = [[signals.column(n, f"centroid_{a}")[1] for a in "xy"] for n in names]
    return time, np.array(rows)


def carried_speed(signals: Signals) -> float:
    """Return the mean speed of all pieces along the flow while they are carried, m/s."""
    time, paths = _paths(signals)
    speed = np.gradient(paths[:, 0], time, axis=1)
    moving = speed > _CARRIED
    return float(speed[moving].mean()) if moving.any() else math.nan


def displacement(signals: Signals) -> float:
    """Return the median of the pieces' way along the flow at the end of the run, m."""
    _, paths = _paths(signals)
    return float(np.median(paths[:, 0, -1] - paths[:, 0, 0]))


def spread(signals: Signals) -> float:
    """Return the median angle of the pieces' ways against the flow, degrees."""
    _, paths = _paths(signals)
    along, across = np.moveaxis(paths[:, :, -1] - paths[:, :, 0], 1, 0)
    return float(np.median(np.degrees(np.arctan2(across, along))))
