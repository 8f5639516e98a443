"""Sensors and outputs of ClaymoreUW."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from libmpm._src.base.values import nearest
from libmpm._src.compat.claymore.aliases import fold
from libmpm._src.compat.claymore.geometry import Fit
from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BodyRecord, SensorRecord
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors import attributes
from libmpm._src.sensors.engine_sensors import Sensor
from libmpm._src.sensors.python_sensors import GRID, AttributeTracker, GridSensor, ParticleSensor
from libmpm._src.shapes.boxes import Box

__all__ = ["make_sensors", "make_trackers", "output_names"]

#: Reductions that have no counterpart, with the remedy.
_REFUSED = {"subtract": "record two sensors and take the difference"}

#: Names of what the frames have, by what ClaymoreUW calls their components.
_FRAMES = {
    "position": ("position_x", "position_y", "position_z"),
    "id": ("id",),
    "mass": ("mass",),
    "volume": ("volume",),
    "velocity": ("velocity_x", "velocity_y", "velocity_z"),
    "speed": ("velocity_magnitude",),
    "volume_ratio": ("j", "jbar", "defgrad_determinant", "defgrad_determinant_fbar"),
    "pressure": ("pressure",),
}
_FRAME_OF = {fold(one): name for name, spellings in _FRAMES.items() for one in spellings}
_LIBRARY = {fold(name): name for name in attributes.names()}


def make_sensors(
    context: Context, records: Sequence[SensorRecord], fit: Fit
) -> list[tuple[str, Sensor]]:
    """Return the sensors of a file with names of their own."""
    found: list[tuple[str, Sensor]] = []
    names: set[str] = set()
    for one in records:
        sensor = _grid(context, one, fit) if one.grid else _particles(context, one, fit)
        if sensor is None:
            continue
        wanted = (one.name or f"{one.attribute.lower()}-1").replace("/", "-").strip()
        stem = wanted.removesuffix("-1")
        tries = itertools.chain([wanted], (f"{stem}-{i}" for i in itertools.count(2)))
        name = next(n for n in tries if n not in names)
        names.add(name)
        found.append((name, sensor))
    return found


def _statistic(context: Context, one: SensorRecord) -> Any:
    if one.operation in _REFUSED:
        context.fail(one.path, f"has operation '{one.operation}', which is refused: "
                     f"{_REFUSED[one.operation]}")  # fmt: skip
        return None
    return one.operation


def _grid(context: Context, one: SensorRecord, fit: Fit) -> Sensor | None:
    attribute: Any = fold(one.attribute)
    operation = _statistic(context, one)
    if attribute not in GRID:
        context.fail(f"{one.path}.attribute", f"is '{one.attribute}'; {nearest(attribute, GRID)}")
        return None
    if operation is None:
        return None
    lower, upper = list(one.lower), list(one.upper)
    axis, sign = one.direction
    for a in range(3):
        if upper[a] <= lower[a]:
            upper[a] = lower[a] + fit.cell_size
    if attribute == "force":
        # A face is held by the nodes half a cell before and behind it.
        lower[axis] -= fit.cell_size
        upper[axis] += fit.cell_size
        context.note(
            "sensors of force: a face is held by nodes on both sides of it, so their boxes are "
            "one cell longer at both ends, along the direction; a sample is the force in one step, "
            "a LoadCell gives the mean over its interval"
        )
    direction: Any = "xyz"[axis] + {0: "", 1: "+", -1: "-"}[sign]
    return GridSensor(
        attribute=attribute,
        operation=operation,
        direction=direction if GRID[attribute][1] else None,
        region=_region(lower, upper, fit),
        interval=one.interval,
    )


def _particles(context: Context, one: SensorRecord, fit: Fit) -> Sensor | None:
    operation = _statistic(context, one)
    name = _LIBRARY.get(fold(one.attribute))
    if name is None:
        context.fail(
            f"{one.path}.attribute",
            f"is '{one.attribute}'; {nearest(one.attribute, _LIBRARY.values())}",
        )
        return None
    if operation is None:
        return None
    lower, upper = list(one.lower), list(one.upper)
    for a in range(3):
        if upper[a] - lower[a] < fit.cell_size * (1 - 1e-6) and a != 1:
            # A gauge narrower than a cell would miss the particles between.
            middle = 0.5 * (lower[a] + upper[a])
            lower[a], upper[a] = middle - 0.5 * fit.cell_size, middle + 0.5 * fit.cell_size
            context.note(f"{one.path}: widened to one cell on axis {'xyz'[a]}")
        elif upper[a] <= lower[a]:
            upper[a] = lower[a] + fit.cell_size
    return ParticleSensor(
        attribute=name, operation=operation, region=_region(lower, upper, fit),
        interval=one.interval,
    )  # fmt: skip


def _region(lower: Sequence[float], upper: Sequence[float], fit: Fit) -> Box:
    """Return the box of a sensor; beyond a wall that has moved it goes with the wall."""
    high = [
        max(x, fit.upper[a]) if x >= fit.stated[a] - 1e-6 * fit.cell_size else x
        for a, x in enumerate(upper)
    ]
    return Box(lower=lower, upper=high)


def make_trackers(
    context: Context,
    scene: Scene,
    members: Sequence[tuple[BodyRecord, Sequence[str]]],
    counts: dict[str, int],
    interval: float,
) -> list[tuple[str, Sensor]]:
    """Return trackers of the particles that a file follows; numbers in it count from each body.

    `members` names the bodies of the scene that each body of the file became.
    """
    found: list[tuple[str, Sensor]] = []
    first: dict[str, int] = {}
    at = 0
    for body in scene.bodies:
        first[body.name] = at
        at += counts[body.name]
    for record, names in members:
        left = list(record.tracked)
        beyond = [i for i in left if i >= sum(counts[n] for n in names)]
        if beyond:
            context.note(
                f"{record.path}: track_particle_id {beyond} is beyond the body's particles"
            )
        base = 0
        for name in names:
            ids = [i - base for i in left if base <= i < base + counts[name]]
            base += counts[name]
            if not ids:
                continue
            body = next(b for b in scene.bodies if b.name == name)
            wanted = [_LIBRARY[fold(n)] for n in record.tracks if fold(n) in _LIBRARY]
            has = [n for n in wanted if attributes.refusal(n, body, scene) is None]
            for missing in set(record.tracks) - {n for n in record.tracks if fold(n) in _LIBRARY}:
                context.note(f"{record.path}: track_attribs '{missing}' is not known")
            for missing in [n for n in wanted if n not in has]:
                context.note(f"{record.path}: '{missing}' is left out; {body.name} has none")
            if has:
                tracker = AttributeTracker(
                    body=name, ids=tuple(first[name] + i for i in ids),
                    attributes=tuple(dict.fromkeys(has)), interval=interval,
                )  # fmt: skip
                found.append((f"track-{name}", tracker))
    return found


def output_names(context: Context, record: BodyRecord, scene: Scene, name: str) -> list[str]:
    """Return what the frames of a body hold: vectors where the file has their components."""
    body = next(b for b in scene.bodies if b.name == name)
    found: list[str] = []
    for given in record.output:
        key = fold(given)
        library = _LIBRARY.get(key)
        if key in _FRAME_OF:
            found.append(_FRAME_OF[key])
        elif library is None:
            context.note(f"{record.path}: output_attribs '{given}' is not known; left out")
        elif attributes.refusal(library, body, scene) is not None:
            table = body.material.table.name
            context.note(f"{record.path}: output_attribs '{given}' is left out; {table} has none")
        else:
            found.append(library)
    return [n for n in dict.fromkeys(found) if n not in ("position", "id")]
