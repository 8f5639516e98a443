"""The state of a checkpoint taken apart, for a run with other bodies that continues from it."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.values import warned_already
from libmpm._src.errors import CheckpointError, SceneError
from libmpm._src.output.checkpoint import Checkpoint, load_checkpoint
from libmpm._src.run import backends
from libmpm._src.run.engine_spec import lower
from libmpm._src.scene.data import SceneData
from libmpm._src.scene.old_defaults import with_old_defaults
from libmpm._src.scene.parts import Body
from libmpm._src.scene.places import new_bodies, snap
from libmpm._src.scene.scene_file import SceneReader
from libmpm._src.scene.start import Start
from libmpm._src.sensors import tallied
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.filling import BOXES, caught_in, place_of
from libmpm._src.shapes.oriented_boxes import Extent, TurnedBox

__all__ = ["Snapshot", "caught", "check_new_boundaries", "displaced", "id_ranges", "inside"]
__all__ += ["remaining", "snapshot", "take_apart"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Snapshot:
    """The state of a checkpoint in terms that do not depend on how it was stored.

    bodies     name -> ids above the body's first (n,), positions in m from the lower corner (n, d),
               what its particles store (n, k)
    cell       cells (m, d) that the nodes with mass are centres of; `sums` (m,) by channel
    time_step  s, for which the sums hold the stress
    frozen     particles that have left the domain and are not taken along, by body
    sensors    where the run's sensors were, as in a saved state
    """

    time: float
    step: int
    time_step: float
    bodies: Mapping[str, tuple[npt.NDArray[np.int64], Array, Array]]
    cell: npt.NDArray[np.int64]
    sums: Mapping[str, Array]
    frozen: Mapping[str, int]
    sensors: Mapping[str, npt.NDArray[Any]]
    #: What `displaced` has found for some new bodies.
    gone: dict[Any, npt.NDArray[np.bool_]] = field(default_factory=dict)

    def velocity(self) -> Array:
        """Return the nodal velocities before gravity and boundaries, (m, d), m/s."""
        axes = "xyz"[: self.cell.shape[1]]
        return np.stack([self.sums[f"momentum_{a}"] / self.sums["mass"] for a in axes], axis=1)

    def averages(self) -> dict[str, Array]:
        """Return F-bar's nodal averages (m,) by the channel of their sum.

        And the velocities before forces of transfers that store some, m/s.
        """
        found = {}
        for name, total in self.sums.items():
            if name.startswith("plain_momentum_"):
                found[name] = total / self.sums["mass"]
            if not name.startswith("mass*"):
                continue
            weight = self.sums.get(f"mass:{name.partition(':')[2]}", self.sums["mass"])
            found[name] = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)
        return found

    def cut(self, first: Sequence[int], cells: Sequence[int], cell_size: float) -> Snapshot:
        """Return what lies in a box of whole cells: particles, and the nodes that they reach.

        `first` (d,) is its lowest cell, `cells` (d,) how many there are, `cell_size` m the
        edge of a cell. Nodal velocities stay what they were with the particles that are cut off
        (design/branches.md, 3).
        """
        low, high = np.asarray(first), np.asarray(first) + np.asarray(cells)
        bodies = {}
        for name, (ids, position, state) in self.bodies.items():
            home = np.floor(position / cell_size)
            kept = np.all((home >= low) & (home < high), axis=1)
            bodies[name] = (ids[kept], position[kept] - low * cell_size, state[kept])
        near = np.all((self.cell >= low - 1) & (self.cell <= high), axis=1)
        sums = {name: total[near] for name, total in self.sums.items()}
        return Snapshot(
            self.time, self.step, self.time_step, bodies, self.cell[near] - low, sums, self.frozen,
            {},
        )  # fmt: skip

    def tiled(self, start: Start, axis: int, cells: int, cell_size: float) -> Snapshot:
        """Return the copies of `start` side by side, each `cells` further along an axis.

        What particles deposit moves with them, so the sums of the whole are those of the copies,
        added where they share nodes. Copy k has the ids k n ≤ id < (k + 1) n of a body of n ids.
        """
        tiles = start.tiles
        bodies = {}
        for body in start.bodies:
            ids, position, state = self.bodies[body.name]
            copy = np.repeat(np.arange(tiles, dtype=np.int64), len(ids))
            moved = np.tile(position, (tiles, 1))
            moved[:, axis] += copy * (cells * cell_size)
            number = np.tile(ids, tiles) + copy * (body.ids // tiles)
            bodies[body.name] = (number, moved, np.tile(state, (tiles, 1)))
        every = np.tile(self.cell, (tiles, 1))
        every[:, axis] += np.repeat(np.arange(tiles), len(self.cell)) * cells
        cell, owner = np.unique(every, axis=0, return_inverse=True)
        owner = owner.reshape(-1)
        sums: dict[str, Array] = {
            name: np.bincount(owner, np.tile(total, tiles), len(cell)).astype(np.float64)
            for name, total in self.sums.items()
        }
        return Snapshot(
            self.time, self.step, self.time_step, bodies, cell, sums, self.frozen, {},
        )  # fmt: skip


def id_ranges(scene: SceneData) -> Iterator[tuple[str, int, int, float]]:
    """Yield name, first id, number of ids and particle mass (kg) of every body of a scene."""
    for body in _shell(scene, None)["bodies"]:
        yield body["name"], body["first_id"], body["id_count"], body["particle_mass"]


def _shell(scene: SceneData, time_step: float | None) -> dict[str, Any]:
    """Return the specification of an engine that is made to load a state."""
    precision = "double" if scene.grid is None else "auto"
    with warned_already():
        return lower(scene, precision=precision, time_step=time_step, shell=True)


def take_apart(checkpoint: Checkpoint) -> Snapshot:
    """Return the state of a checkpoint of any backend and precision.

    An engine in double precision on the CPU loads it: no bit of a narrower number is lost.
    """
    scene = SceneReader(SceneData, with_old_defaults(checkpoint.header["scene"])).read()
    specification = _shell(scene, checkpoint.header["time_step"]) | checkpoint.stored_as()
    engine = backends.core().Engine(specification)
    try:
        have = tallied.state_names(checkpoint.header, scene.sensors)
        time, step = float(checkpoint.header["time"]), int(checkpoint.header["step"])
        engine.load(tallied.fitted(checkpoint.state, have, specification["sensors"], time, step))
    except SceneError as error:
        raise CheckpointError(f"the checkpoint's state does not fit its scene: {error}") from error
    bodies, frozen = {}, {}
    for i, body in enumerate(specification["bodies"]):
        read = engine.attributes(i, ["id", "position", "state", "frozen"])
        left = read["frozen"] != 0
        if scene.method.leaving != "stop":
            # Those that have left since the last sort are taken out at the next one.
            cell = np.floor(read["position"] / scene.cell_size)
            left |= np.any((cell < 0) | (cell >= np.asarray(scene.cells)), axis=1)
        order = np.argsort(read["id"], kind="stable")
        order = order[~left[order]]
        ids = read["id"][order].astype(np.int64) - body["first_id"]
        bodies[body["name"]] = (ids, read["position"][order], read["state"][order])
        frozen[body["name"]] = int(np.count_nonzero(left))
    sums = engine.sums()
    cell = sums.pop("cell")
    kept = ("sensor_next", "sensor_last", "sensor_first", "load_impulse")
    sensors = {name: checkpoint.state[name] for name in kept} | {"names": np.array(have)}
    return Snapshot(engine.time, engine.step, engine.time_step, bodies, cell, sums, frozen, sensors)


@functools.lru_cache(maxsize=1)
def _read(start: Start, cells: int, cell_size: float, _version: tuple[int, int] | None) -> Snapshot:
    start.check_file()
    whole = take_apart(load_checkpoint(Path(start.checkpoint)))
    if start.first_cell is not None and start.cut_cells is not None:
        whole = whole.cut(start.first_cell, start.cut_cells, cell_size)
    if start.tiles == 1:
        return whole
    return whole.tiled(start, "xyz".index(str(start.axis)), cells, cell_size)


def _version_of(path: str) -> tuple[int, int] | None:
    """Return what tells a file from one written over it later; None of a missing one."""
    try:
        status = Path(path).stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


def snapshot(scene: SceneData) -> Snapshot:
    """Return the state that a scene continues from, tiled where it is; the last one is kept."""
    start = scene.start
    assert start is not None
    cells = 0 if start.axis is None else scene.cells["xyz".index(start.axis)] // start.tiles
    return _read(start, cells, scene.cell_size, _version_of(start.checkpoint))


def displaced(scene: SceneData, body: Body) -> npt.NDArray[np.bool_]:
    """Return which particles of a restored body, in order of ids, new bodies take the place of.

    Raises `SceneError` where a new body lies in particles that it does not displace.
    """
    state = snapshot(scene)
    # Bodies of the run itself have taken their place at its start and may have moved since.
    added = new_bodies(scene)
    key = body.name, tuple((repr(b.shape), b.subtract_from) for b in added)
    if key not in state.gone:
        state.gone[key] = _displaced(scene, state, body, added)
    return state.gone[key]


def _displaced(
    scene: SceneData, state: Snapshot, body: Body, added: list[Body]
) -> npt.NDArray[np.bool_]:
    position = state.bodies[body.name][1]
    if len(position) == 0:
        raise SceneError(
            f"body '{body.name}': none of its particles is left at {state.time:g} s; "
            "expected some where bodies are added or the run is tiled; branch from an earlier "
            "checkpoint"
        )
    gone = np.zeros(len(position), dtype=bool)
    slack = 1e-9 * scene.cell_size
    # Each new body looks at its own slice of the first axis.
    order = np.argsort(position[:, 0], kind="stable")
    along = position[order, 0]

    def caught_by(other: Body, allowance: float) -> npt.NDArray[np.int64]:
        if not isinstance(other.shape, BOXES):
            return caught_in(scene, other, position, allowance)
        place = place_of(scene, other)
        low, high = place.bounds() if isinstance(place, TurnedBox) else place
        first, last = np.searchsorted(along, [low[0] - slack, high[0] + slack])
        near = order[first:last]
        return near[inside(place, position[near], allowance)]

    for other in added:
        if body.name in other.subtract_from:
            gone[caught_by(other, slack)] = True
    problems = []
    for other in added:
        if body.name in other.subtract_from:
            continue
        caught = int(np.count_nonzero(~gone[caught_by(other, -slack)]))
        if caught:
            problems.append(
                f"body '{other.name}': {caught} particles of body '{body.name}' lie inside it at "
                f"{state.time:g} s; expected none; subtract_from=('{body.name}',) takes "
                "them out, or move it"
            )
    if problems:
        raise SceneError(problems)
    if gone.all():
        raise SceneError(
            f"body '{body.name}': the new bodies displace all of its {len(gone)} particles; "
            "expected some to remain"
        )
    return gone


def remaining(scene: SceneData, body: Body) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Return ids above the body's first, positions and state of what is not displaced."""
    ids, position, state = snapshot(scene).bodies[body.name]
    if scene.start is not None and len(scene.bodies) > len(scene.start.bodies):
        kept = ~displaced(scene, body)
        ids, position, state = ids[kept], position[kept], state[kept]
    return ids, position, state


def check_new_boundaries(scene: SceneData) -> None:
    """Refuse boxes added to a scene that continues where its particles are; raises `SceneError`."""
    start = scene.start
    assert start is not None
    problems = []
    for boundary in scene.boundaries[start.boundaries :]:
        if not isinstance(boundary.shape, Box):
            continue
        if not boundary.window[0] <= start.time < boundary.window[1]:
            continue
        problems += [
            f"boundary '{boundary.name}': {count} particles of body '{name}' lie inside it at "
            f"{start.time:g} s; expected none; run the trunk with it, or move it"
            for name, count in caught(scene, boundary.shape).items()
        ]
    if problems:
        raise SceneError(problems)


def caught(scene: SceneData, box: Box) -> dict[str, int]:
    """Return how many particles lie in a box where a scene continues, by bodies that have any."""
    assert scene.start is not None
    corners = [[i * scene.cell_size for i in corner] for corner in snap(scene, box)]
    found = {}
    for body in scene.start.bodies:
        position = snapshot(scene).bodies[body.name][1]
        count = int(np.count_nonzero(inside((corners[0], corners[1]), position, 0.0)))
        if count:
            found[body.name] = count
    return found


def inside(hole: Extent, position: Array, allowance: float) -> npt.NDArray[np.bool_]:
    """Return which positions (n, d), m, lie in a box at any angle; faces count by `allowance`."""
    box = hole if isinstance(hole, TurnedBox) else TurnedBox.straight(*hole)
    result = np.ones(len(position), dtype=bool)
    for a, edge in enumerate(box.size):
        own = sum(
            (position[:, b] - box.centre[b]) * box.axes[b][a] for b in range(position.shape[1])
        )
        result &= np.abs(own) <= 0.5 * edge + allowance
    return result
