"""`Scene.from_checkpoint`: scenes that continue from a checkpoint of another run.

Restored bodies keep their particles, their material's numbers and the velocities and averages that
the grid had. What is added deposits as at any start; design/branches.md says why this is exact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from libmpm._src.base.values import Checker, warn
from libmpm._src.errors import SceneError
from libmpm._src.scene.contact_fields import rigid_bodies
from libmpm._src.scene.cut import cells_within, cut_parts, require_particles
from libmpm._src.scene.data import SceneData
from libmpm._src.scene.old_defaults import with_old_defaults
from libmpm._src.scene.start import RestoredBody, Start, digest_of
from libmpm._src.sensors.engine_sensors import ParticleTracker
from libmpm._src.sensors.python_sensors import AttributeTracker
from libmpm._src.shapes.boxes import Box, OrientedBox
from libmpm._src.shapes.prisms import Extrusion
from libmpm._src.shapes.solid import Solid

__all__ = ["scene_from_checkpoint"]

S = TypeVar("S", bound=SceneData)
#: Lowest cell, and how many along each axis.
Cells = tuple[tuple[int, ...], tuple[int, ...]]

#: Part of a cell by which a box may miss the side of a slice and still go through it.
_THROUGH = 1e-6


def scene_from_checkpoint(
    path: Path,
    tiles: int,
    axis: str | None,
    within: Box | None = None,
    *,
    read: Callable[[dict[str, Any]], S],
) -> S:
    """Return the scene of a checkpoint, which continues from there; see `Scene.from_checkpoint`.

    `read` makes scenes of dictionaries.
    """
    from libmpm._src.output.checkpoint import find_newest, load_header
    from libmpm._src.run.checkpoint_state import id_ranges

    path, (header, stored_as) = find_newest(path, load_header)
    before = read(with_old_defaults(header["scene"]))
    check = Checker(f"Scene.from_checkpoint('{path}')")
    tiles = check.integer("tiles", tiles, lower=1, remedy="1 takes the run as it is")
    names = "xyz"[: before.dimension]
    if tiles > 1 or axis is not None:
        check.choice("axis", axis, tuple(names))
    if before.grid is not None:
        check.fail(
            "the run has a grid of functions; expected square or cubic cells; continue with "
            "Simulation.resume, or begin a new scene"
        )
    if before.contacts:
        check.fail(
            f"the run has contact '{before.contacts[0].name}', and with it several velocities a "
            "node; expected a run without contacts; go on with Simulation.resume, or begin a scene "
            "of its own"
        )
    if rigid := rigid_bodies(before):
        check.fail(
            f"the run has rigid body '{rigid[0]}', which is not built for scenes that continue "
            "from another; expected a run without any; go on with Simulation.resume, or begin a "
            "scene of its own"
        )
    if within is not None:
        check.instance("within", within, (Box,), "a shapes.Box, or None for all of the run")
    check.finish()
    cut = None if within is None else cells_within(check, before, within)
    bodies = [
        RestoredBody(
            name=name, first_id=tiles * first, ids=tiles * ids, particle_mass=mass,
            stored_as=stored,
        )
        for (name, first, ids, mass), stored in zip(id_ranges(before), stored_as, strict=True)
    ]  # fmt: skip
    start = Start(
        checkpoint=str(path.absolute()), digest=digest_of(path), time=float(header["time"]),
        step=int(header["step"]), bodies=bodies, boundaries=len(before.boundaries),
        sensors=len(before.sensors), time_step=header["time_step"], tiles=tiles,
        axis=axis if tiles > 1 else None,
    )  # fmt: skip
    data, transfer = before.to_dict(), before.transfer
    data.pop("start", None)
    if cut is not None:
        before, data, start = _cut_out(before, start, cut, read)
    if tiles > 1:
        data = _side_by_side(before, data, start, names.index(str(axis)))
    # What is added, a structure say, may not change what particles have kept so far.
    data["method"]["transfer"] = transfer.to_dict()
    return read(data | {"start": start.to_dict()})


def _cut_out(
    before: S, start: Start, cut: Cells, read: Callable[[dict[str, Any]], S]
) -> tuple[S, dict[str, Any], Start]:
    """Return the scene of what lies in some cells of a run, as JSON too, and where it starts."""
    from libmpm._src.output.checkpoint import load_checkpoint
    from libmpm._src.run.checkpoint_state import take_apart

    first, cells = cut
    h = before.cell_size
    lower = [a + n * h for a, n in zip(before.lower, first, strict=True)]
    upper = [a + n * h for a, n in zip(lower, cells, strict=True)]
    state = take_apart(load_checkpoint(Path(start.checkpoint))).cut(first, cells, h)
    left = {name: len(rows[0]) for name, rows in state.bodies.items()}
    require_particles(start.checkpoint, left)
    gone, blind = cut_parts(before, lower, upper)
    said = [f"boundary '{name}'" for name in gone] + [f"sensor '{name}'" for name in blind]
    if said:
        warn([f"Scene.from_checkpoint: {', '.join(said)} of the run lie outside of what is cut "
              "out of it and are left out"])  # fmt: skip
    data = before.to_dict()
    data.pop("start", None)
    data |= {"lower": lower, "upper": upper}
    data["boundaries"] = [b for b in data["boundaries"] if b["name"] not in gone]
    data["sensors"] = [s for s in data["sensors"] if s["name"] not in blind]
    bodies = [dataclasses.replace(one, left=left[one.name]) for one in start.bodies]
    start = dataclasses.replace(
        start, bodies=bodies, boundaries=len(data["boundaries"]), sensors=len(data["sensors"]),
        first_cell=first, cut_cells=cells,
    )  # fmt: skip
    return read(data), data, start


def _side_by_side(
    before: SceneData, data: dict[str, Any], start: Start, axis: int
) -> dict[str, Any]:
    """Return the scene whose domain is `start.tiles` times as wide along an axis."""
    low, high = before.lower[axis], before.upper[axis]
    slack = _THROUGH * before.cell_size
    # The number that the scene itself would have, whole cells above the lower side.
    wide = low + start.tiles * before.cells[axis] * before.cell_size
    problems = []

    def widened(what: str, shape: dict[str, Any]) -> dict[str, Any]:
        prism = shape["type"] == Extrusion.__name__
        ends = [shape[end] if prism else shape[end][axis] for end in ("lower", "upper")]
        if ends[0] > low + slack or ends[1] < high - slack:
            problems.append(
                f"{what}: its {'prism' if prism else 'box'} spans {ends[0]:g} to {ends[1]:g} m on "
                f"axis {axis}; expected all of the slice, {low:g} to {high:g} m, where the run is "
                "tiled; run the trunk without it and add it to the tiled scene"
            )
        if prism:
            return shape | {"upper": max(wide, ends[1])}
        upper = list(shape["upper"])
        upper[axis] = max(wide, ends[1])
        return shape | {"upper": upper}

    def is_wide(shape: dict[str, Any]) -> bool:
        kind = shape["type"]
        return bool(kind == Box.__name__ or
                    (kind == Extrusion.__name__ and shape["axis"] == "xyz"[axis]))  # fmt: skip

    for body in before.bodies:
        shape = body.shape
        if not isinstance(shape, OrientedBox):
            continue
        through = shape.lower[axis] <= low + slack and shape.upper[axis] >= high - slack
        if shape.axis != "xyz"[axis] or not through:
            problems.append(
                f"body '{body.name}': its turned box does not go straight through the slice on "
                f"axis {axis}; expected all of it, {low:g} to {high:g} m, where the run is tiled; "
                "run the trunk without it and add it to the tiled scene"
            )

    parts: dict[str, Any] = {}
    for kind, singular in (("bodies", "body"), ("boundaries", "boundary")):
        parts[kind] = [
            part | {"shape": widened(f"{singular} '{part['name']}'", part["shape"])}
            if is_wide(part["shape"]) else part
            for part in data[kind]
        ]  # fmt: skip
    for boundary in before.boundaries:
        solid = boundary.shape
        if isinstance(solid, Solid) and not is_wide(solid.to_dict()):
            ends = [end[axis] for end in solid.bounds()]
            if ends[0] > low + slack or ends[1] < wide - slack:
                problems.append(
                    f"boundary '{boundary.name}': its shape spans {ends[0]:g} to {ends[1]:g} m on "
                    f"axis {axis}; expected all of the tiles, {low:g} to {wide:g} m; make it as "
                    "wide in the trunk, or add it to the tiled scene"
                )
    if problems:
        raise SceneError(problems)
    upper = list(before.upper)
    upper[axis] = wide
    return data | parts | {"upper": upper, "sensors": _renumbered(before, start)}


def _renumbered(before: SceneData, start: Start) -> list[dict[str, Any]]:
    """Return the sensors of a tiled scene: ids of the run's own are those of the first copy."""
    result = []
    for placed in before.sensors:
        sensor = placed.sensor
        if isinstance(sensor, ParticleTracker | AttributeTracker) and sensor.ids != "all":
            body = start.restored(sensor.body)
            assert body is not None
            was = body.first_id // start.tiles
            ids = [body.first_id + int(i) - was for i in sensor.ids]
            sensor = dataclasses.replace(sensor, ids=ids)
        result.append({"name": placed.name, "sensor": sensor.to_dict()})
    return result
