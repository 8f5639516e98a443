"""Debris of the facilities: fields that float or stand, whole or one half of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.flumes.facility import Deviation
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.python_sensors import BodyTracker
from libmpm._src.shapes.boxes import OrientedBox
from libmpm._src.studies.debris.field import DebrisField
from libmpm._src.studies.debris.prototype import Piece

if TYPE_CHECKING:
    from libmpm._src.flumes.criteria import Signals

__all__ = [
    "FIELD_TEXT", "add_field", "carried_speed", "check_debris", "displacement", "first_contact",
    "lengthened", "pieces_at_rest", "scattered", "spread", "track", "upper_half", "widest_spread",
    "width_across",
]  # fmt: skip

#: What a field `debris` says of a field of one's own, for the facilities that may have one half.
FIELD_TEXT = (
    "a `debris.DebrisField` in the facility's coordinates, of half of it at y > 0 or each piece "
    "with its image"
)

#: Speed above which a piece counts as carried, m/s.
_CARRIED = 0.1
#: Largest shift of a piece of a field with a seed, in cells.
_SHIFT = 0.25
#: What counts as on the centreline, m.
_ON = 1e-9


def scattered(field: DebrisField, seed: int, cell_size: float, across: bool = True) -> DebrisField:
    """Return a field whose pieces are shifted at random by up to a quarter of a cell.

    Debris in a flow is chaotic: fields that differ in `seed` alone are repeats of one experiment.
    0 shifts nothing. Pieces above each other move together; `across` = False shifts along the flow
    alone. Gaps of less than half a cell are shared out: pieces never overlap. Without gaps all move
    as one.
    """
    if seed == 0:
        return field
    free = min(_SHIFT * cell_size, 0.49 * field.clearance)
    by = free if free > 0 else _SHIFT * cell_size
    random = np.random.default_rng(seed)
    shifts: dict[tuple[float, float], tuple[float, float]] = {}
    pieces = []
    for piece in field.pieces:
        at = (piece.x, piece.y) if free > 0 else (0.0, 0.0)
        if at not in shifts:
            x, y = random.uniform(-by, by, 2)
            shifts[at] = (round(float(x), 9), round(float(y), 9) if across else 0.0)
        x, y = shifts[at]
        pieces.append(replace(piece, x=piece.x + x, y=piece.y + y))
    corner = [a - by for a in field.corner]
    footprint = [a + 2 * by for a in field.footprint]
    return DebrisField(
        prototypes=field.prototypes, pieces=pieces, corner=corner, footprint=footprint,
        rotation=field.rotation, clearance=max(0.0, field.clearance - 2 * free - 1e-9),
    )  # fmt: skip


def check_debris(
    check: Checker, item: Any, names: Sequence[str], width: str
) -> str | DebrisField | None:
    """Return debris: None, the name of a layout, or a field, which half of a flume can have."""
    if item is None:
        return None
    if width in ("slice", "strip"):
        check.fail(f"debris in a {width} would be a bar across all of the flume; expected None; "
                   "use width='half' or 'full'")  # fmt: skip
    if isinstance(item, DebrisField):
        if width == "half":
            _check_half(check, item)
        return item
    if not isinstance(item, str) or item not in names:
        check.fail(f"debris is {shown(item, 80)}; {nearest(item, names)}, or give a "
                   "debris.DebrisField")  # fmt: skip
        return None
    return item


def _check_half(check: Checker, field: DebrisField) -> None:
    """Refuse a field that half of a flume would lose pieces of, add to, or could not cut."""
    mirrored = any(_across(field, piece)[1] <= _ON for piece in field.pieces)
    for piece in field.pieces:
        low, high = _across(field, piece)
        at = f"debris has a piece at ({piece.x:g}, {piece.y:g}) m"
        cut = low < -_ON and high > _ON
        if mirrored and not cut and not any(_is_image(piece, other) for other in field.pieces):
            check.fail(f"{at} without its image at ({piece.x:g}, {-piece.y:g}) m, with width "
                       "'half', which has what lies at y > 0 and its image; expected pieces at "
                       "y > 0 alone, or each with its image; use width='full'")  # fmt: skip
        elif cut and _turned(piece) is None:
            check.fail(f"{at} across the centreline, turned by {piece.angle:g} degrees, with "
                       "width 'half', which cuts it there; expected 0 or 90 degrees; use "
                       "width='full'")  # fmt: skip
        elif cut and abs(piece.y) > _ON:
            check.fail(f"{at} across the centreline and not in its middle, with width 'half', "
                       "which cuts it there; expected y 0; use width='full'")  # fmt: skip


def _across(field: DebrisField, piece: Piece) -> tuple[float, float]:
    """Return the lowest and the highest y of a piece, m."""
    kind, angle = field.prototypes[piece.prototype], math.radians(piece.angle)
    half = 0.5 * (kind.length * abs(math.sin(angle)) + kind.width * abs(math.cos(angle)))
    return piece.y - half, piece.y + half


def _turned(piece: Piece) -> bool | None:
    """Return whether a piece lies across the flow; None where neither along nor across."""
    if abs((piece.angle + 45.0) % 180.0 - 45.0) < 1e-6:
        return False
    return True if abs(piece.angle % 180.0 - 90.0) < 1e-6 else None


def _is_image(piece: Piece, other: Piece) -> bool:
    """Return whether two pieces are images of each other at the plane y = 0."""
    turn = (piece.angle + other.angle + 90.0) % 180.0 - 90.0
    apart = (turn, piece.x - other.x, piece.y + other.y, piece.elevation - other.elevation)
    return piece.prototype == other.prototype and max(map(abs, apart)) < 1e-6


def upper_half(field: DebrisField) -> tuple[Piece, ...]:
    """Return the pieces of which something lies at y > 0."""
    return tuple(piece for piece in field.pieces if _across(field, piece)[1] > _ON)


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
    lie along or across the flow. Raises `SceneError`.
    """
    if not half:
        return field.add_to(scene, elevation=elevation, subtract_from=displaces)
    names: list[str] = []
    digits = len(str(len(field)))
    for piece in upper_half(field):
        kind = field.prototypes[piece.prototype]
        turned = _turned(piece)
        middle, wide, long, angle = piece.y, kind.width, kind.length, piece.angle
        if turned is not None:
            low, high = _across(field, piece)
            middle, wide, angle = 0.5 * (max(low, 0.0) + high), high - max(low, 0.0), 0.0
            long = kind.width if turned else kind.length
        elif _across(field, piece)[0] < -_ON:
            raise SceneError(f"debris: a piece at ({piece.x:g}, {piece.y:g}) m is turned by "
                             f"{piece.angle:g} degrees across the centreline of half of a flume; "
                             "expected 0 or 90; use width='full'")  # fmt: skip
        shape = OrientedBox(
            centre=(piece.x, middle, elevation + piece.elevation + 0.5 * kind.height),
            size=(long, wide, kind.height),
            angle=angle,
        )
        names.append(scene.add_body(
            name=f"debris-{len(names) + 1:0{digits}}", shape=shape, material=kind.material,
            particles_per_cell=kind.particles_per_cell, subtract_from=displaces,
        ))  # fmt: skip
    return tuple(names)


def lengthened(what: str, facility: float, scene: float) -> list[Deviation]:
    """Return the difference of a length that was moved to faces of cells, if there is one."""
    if abs(facility - scene) < 1e-9:
        return []
    return [Deviation(what, f"{facility:g} m", f"{scene:g} m", "on faces of cells")]


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


def widest_spread(signals: Signals) -> float:
    """Return the largest angle of a piece's way against the flow, degrees, of either sign."""
    _, paths = _paths(signals)
    along, across = np.moveaxis(paths[:, :, -1] - paths[:, :, 0], 1, 0)
    return float(np.max(np.abs(np.degrees(np.arctan2(across, along)))))


def width_across(after: float, edge: float, columns: int) -> Callable[[Signals], float]:
    """Return what measures how wide the field is across the flow, in edges of a block.

    `after` s from when its blocks begin to move, counted as in the experiment, where `columns`
    blocks that touch were so many wide: gaps between blocks at the start are left out.
    """

    def measure(signals: Signals) -> float:
        time, paths = _paths(signals)
        speed = np.gradient(paths[:, 0], time, axis=1).mean(axis=0)
        if not (speed > _CARRIED).any():
            return math.nan
        begins = float(time[int(np.argmax(speed > _CARRIED))])
        if begins + after > time[-1]:
            return math.nan
        wide = np.ptp(paths[:, 1], axis=0)
        grown = float(np.interp(begins + after, time, wide)) - float(wide[0])
        return columns + grown / edge

    return measure


def first_contact(face: float, half: float, slack: float) -> Callable[[Signals], float]:
    """Return what measures when a piece comes first to a face across the flow at x, s.

    `half` m of a piece lie before its centroid; `slack` m is how far off bodies meet on a grid.
    """

    def measure(signals: Signals) -> float:
        time, paths = _paths(signals)
        near = (paths[:, 0] + half >= face - slack).any(axis=0)
        return float(time[int(np.argmax(near))]) if near.any() else math.nan

    return measure


def pieces_at_rest(low: float, high: float) -> Callable[[Signals], float]:
    """Return what counts the pieces whose centroid ends between two x, m."""

    def measure(signals: Signals) -> float:
        _, paths = _paths(signals)
        last = paths[:, 0, -1]
        return float(np.count_nonzero((last >= low) & (last <= high)))

    return measure
