"""`Scene.from_checkpoint`: scenes that go on from a checkpoint of another run.

Restored bodies keep their particles, their material's numbers and the velocities and averages that
the grid had. What is added deposits as at any start; design/branches.md says why this is exact.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.errors import CheckpointError, SceneError
from libmpm._src.materials.friction import with_cones
from libmpm._src.sensors.engine_sensors import Energy, ParticleTracker, WaveGauge
from libmpm._src.sensors.python_sensors import AttributeTracker
from libmpm._src.shapes.boxes import Box, OrientedBox

if TYPE_CHECKING:
    from libmpm._src.scene.scene import Scene

__all__ = ["RestoredBody", "Start", "digest_of", "scene_from_checkpoint"]

#: Part of a cell by which a box may miss the side of a slice and still go through it.
_THROUGH = 1e-6


@value
class RestoredBody(Value):
    """A body of the run before: its ids are first_id ≤ id < first_id + ids.

    Bodies of one number `stored_as` are stored as one in the checkpoint.
    """

    name: str
    first_id: int
    ids: int
    particle_mass: float
    stored_as: int

    def _label(self) -> str:
        return "Start: a body" if not isinstance(self.name, str) else f"Start: body '{self.name}'"

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "name": check.text("name", self.name),
            "first_id": check.integer("first_id", self.first_id),
            "ids": check.integer("ids", self.ids),
            "particle_mass": check.number(
                "particle_mass", self.particle_mass, lower=0, lower_open=True, unit="kg"
            ),
            "stored_as": check.integer("stored_as", self.stored_as),
        }


@value
class Start(Value):
    """Where a scene goes on from; made by `Scene.from_checkpoint`.

    `checkpoint` is the file and `digest` the SHA-256 of its content, `time` (s) and `step` the
    moment it was written. Of the scene's bodies, boundaries and sensors the first ones are the
    run's own: `bodies` in order, so many `boundaries` and so many `sensors`. `time_step` (s) is
    what that run was asked for, None the stable one. With `tiles` > 1 that many copies of its
    domain lie side by side along `axis`.
    """

    label: ClassVar[str] = "Start"

    checkpoint: str
    digest: str
    time: float
    step: int
    bodies: Sequence[RestoredBody]
    boundaries: int
    sensors: int
    time_step: float | None = None
    tiles: int = 1
    axis: str | None = None

    def _check(self, check: Checker) -> dict[str, Any]:
        tiles = check.integer("tiles", self.tiles, lower=1)
        if tiles > 1 or self.axis is not None:
            check.choice("axis", self.axis, ("x", "y", "z"))
        for name in ("checkpoint", "digest"):
            check.instance(name, getattr(self, name), (str,), "a text")
        bodies = sequence(self.bodies)
        if bodies is None or not all(isinstance(body, RestoredBody) for body in bodies):
            check.fail(f"bodies is {shown(self.bodies)}; expected what Scene.from_checkpoint gives")
            bodies = []
        step = self.time_step
        if step is not None:
            step = check.number("time_step", step, lower=0, lower_open=True, unit="s")
        return {
            "tiles": tiles,
            "bodies": tuple(bodies),
            "time": check.number("time", self.time, lower=0, unit="s"),
            "step": check.integer("step", self.step),
            "boundaries": check.integer("boundaries", self.boundaries),
            "sensors": check.integer("sensors", self.sensors),
            "time_step": step,
        }

    def restored(self, name: str) -> RestoredBody | None:
        """Return what the run before knew of a body; None of a new one."""
        return next((b for b in self.bodies if b.name == name), None)

    def check_file(self) -> None:
        """Raise `CheckpointError` unless the file is still the one that the scene was made from."""
        found = digest_of(Path(self.checkpoint))
        if found != self.digest:
            raise CheckpointError(
                f"{self.checkpoint} is not the checkpoint that the scene goes on from: its SHA-256 "
                f"begins with {found[:12]}, that of the scene with {self.digest[:12]}; make the "
                "scene again with Scene.from_checkpoint"
            )

    def as_it_was(self, scene: Scene, time_step: float | None) -> bool:
        """Return whether a run with this time step (s) can load the checkpoint's state as it is."""
        return (
            self.tiles == 1
            and time_step == self.time_step
            and len(scene.bodies) == len(self.bodies)
            and not self._kept_apart(scene)
        )

    def _kept_apart(self, scene: Scene) -> bool:
        """Return whether a new sensor asks for one of several bodies that were stored as one.

        Alike neighbours are stepped and saved together until a sensor wants one of them alone;
        the run then takes up its particles body by body.
        """
        asked = {
            s.sensor.body
            for s in scene.sensors[self.sensors :]
            if isinstance(s.sensor, Energy | WaveGauge)
        }
        return any(
            one.stored_as == two.stored_as and {one.name, two.name} & asked
            for one, two in itertools.pairwise(self.bodies)
        )


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file; raises `CheckpointError` if it cannot be read."""
    try:
        found = path.stat()
        return _digest(str(path), found.st_size, found.st_mtime_ns)
    except OSError as error:
        raise CheckpointError(
            f"{path} cannot be read: {error.strerror}; give a checkpoint that a run has written"
        ) from error


@functools.lru_cache(maxsize=64)
def _digest(path: str, size: int, changed: int) -> str:
    """Read the file once for each size and time of change: a study asks for every row."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def scene_from_checkpoint(path: Path, tiles: int, axis: str | None) -> Scene:
    """Return the scene of a checkpoint, which goes on from there; see `Scene.from_checkpoint`."""
    from libmpm._src.output.checkpoint import find_newest, load_header
    from libmpm._src.run.checkpoint_state import id_ranges
    from libmpm._src.scene.scene import Scene

    path, (header, stored_as) = find_newest(path, load_header)
    before = Scene.from_dict(with_cones(header["scene"]))
    check = Checker(f"Scene.from_checkpoint('{path}')")
    tiles = check.integer("tiles", tiles, lower=1, remedy="1 takes the run as it is")
    names = "xyz"[: before.dimension]
    if tiles > 1 or axis is not None:
        check.choice("axis", axis, tuple(names))
    if before.grid is not None:
        check.fail(
            "the run has a grid of functions; expected square or cubic cells; go on with "
            "Simulation.resume, or begin a scene of its own"
        )
    check.finish()
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
    data = before.to_dict()
    data.pop("start", None)
    if tiles > 1:
        data = _side_by_side(before, data, start, names.index(str(axis)))
    return Scene.from_dict(data | {"start": start.to_dict()})


def _side_by_side(before: Scene, data: dict[str, Any], start: Start, axis: int) -> dict[str, Any]:
    """Return the scene whose domain is `start.tiles` times as wide along an axis."""
    low, high = before.lower[axis], before.upper[axis]
    slack = _THROUGH * before.cell_size
    # The number that the scene itself would have, whole cells above the lower side.
    wide = low + start.tiles * before.cells[axis] * before.cell_size
    problems = []

    def widened(what: str, shape: dict[str, Any]) -> dict[str, Any]:
        ends = shape["lower"][axis], shape["upper"][axis]
        if ends[0] > low + slack or ends[1] < high - slack:
            problems.append(
                f"{what}: its box spans {ends[0]:g} to {ends[1]:g} m on axis {axis}; expected "
                f"all of the slice, {low:g} to {high:g} m, where the run is tiled; run the trunk "
                "without it and add it to the tiled scene"
            )
        upper = list(shape["upper"])
        upper[axis] = max(wide, ends[1])
        return shape | {"upper": upper}

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
            if part["shape"]["type"] == Box.__name__ else part
            for part in data[kind]
        ]  # fmt: skip
    if problems:
        raise SceneError(problems)
    upper = list(before.upper)
    upper[axis] = wide
    return data | parts | {"upper": upper, "sensors": _renumbered(before, start)}


def _renumbered(before: Scene, start: Start) -> list[dict[str, Any]]:
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
