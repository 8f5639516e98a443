"""How inlets add layers of particles and outlets count them: the engine's entries, the rules."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable, engine_table
from libmpm._src.base.values import Checker, nearest
from libmpm._src.boundaries.flows import MOST_PARTICLES, Flow, Inflow, Outflow
from libmpm._src.output.series import Series
from libmpm._src.scene.places import initial_gravity, vertical_axis
from libmpm._src.sensors.engine_sensors import ParticleTracker, Sensor
from libmpm._src.shapes.boxes import Box, DomainWalls, Solid, faces_of
from libmpm._src.shapes.filling import body_lattice
from libmpm._src.shapes.lattices import lattice

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["OUTFLOW", "Layer", "Traffic", "check_flows", "flow_entries", "flow_rows", "keep_room"]
__all__ += ["ids_kept", "layer", "zones"]

Array = npt.NDArray[np.float64]

#: How the policy of a particle that left through an outlet begins; the outlet's name follows.
OUTFLOW = "outflow:"

#: Cells beyond the domain that the nodes of a zone reach.
_BEYOND = 64

#: Parts of a cell by which the body may begin beside the face.
_GAP = 0.5


@dataclass(frozen=True)
class Layer:
    """What an inlet adds at a time.

    points   m, (n, d)   from the lower corner, half a `spacing` inside the face
    area     m²          of the face for each of them (m in 2D)
    spacing  m           from layer to layer
    """

    points: Array
    area: float
    spacing: float

    @property
    def wetted(self) -> float:
        """Area of the layer, m² (m in 2D)."""
        return self.area * len(self.points)


def _side(face: str) -> tuple[int, bool]:
    """Return the axis of a face, and whether it is the upper one."""
    return "xyz".index(face[0]), face[1] == "+"


def _body(scene: SceneData, flow: Inflow) -> tuple[int, Body]:
    names = [b.name for b in scene.bodies]
    number = names.index(flow.body)
    return number, scene.bodies[number]


def layer(scene: SceneData, flow: Inflow, mass: float) -> Layer:
    """Return the layer of an inlet into a body whose particles have this mass, kg."""
    _, body = _body(scene, flow)
    axis, upper = _side(flow.face)
    d, dx = scene.dimension, scene.cell_size
    low = [0.0] * d
    high = [n * dx for n in scene.cells]
    if flow.level is not None:
        v = vertical_axis(scene)
        surface = flow.level - scene.lower[v]
        ends = low if initial_gravity(scene)[v] > 0 else high
        ends[v] = surface
    across = [a for a in range(d) if a != axis]
    counts = None
    if isinstance(body.shape, Box) and body.lattice is not None:
        # As far apart as those that are there.
        step = [(b - a) / n for a, b, n in zip(*_grid(scene, body), strict=True)]
        counts = [max(1, round((high[a] - low[a]) / step[a])) for a in range(d)]
    grid = lattice(low, high, dx, body.particles_per_cell, counts)
    area = float(np.prod([(high[a] - low[a]) / grid.shape[a] for a in across]))
    spacing = mass / (body.material.parameters()["density"] * area)
    columns: list[Array] = [grid.axis(a) for a in range(d)]
    columns[axis] = np.array([high[axis] - 0.5 * spacing if upper else 0.5 * spacing])
    mesh = np.meshgrid(*columns, indexing="ij")
    points = np.stack([m.reshape(-1) for m in mesh], axis=1)
    if flow.bed is not None:
        points = points[flow.bed.distance(points + np.asarray(scene.lower)) > 0]
    return Layer(points, area, spacing)


def _grid(
    scene: SceneData, body: Body
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[int, ...]]:
    found = body_lattice(scene, body)
    return found.lower, found.upper, found.shape


def ids_kept(scene: SceneData, counts: Mapping[str, int]) -> dict[str, int]:
    """Return the number of ids of every body, from that of its particles at the start."""
    kept = dict(counts)
    for name in {f.body for _, f in _of_kind(scene, Inflow)}.intersection(counts):
        given = [f.max_particles for _, f in _of_kind(scene, Inflow) if f.body == name]
        most = min((n for n in given if n is not None), default=MOST_PARTICLES)
        kept[name] = max(most, counts[name])
    return kept


def keep_room(scene: SceneData, body: Body, described: Mapping[str, Any]) -> dict[str, Any]:
    """Return the "id_count" of a body that inlets add to, and nothing for others."""
    if not any(f.body == body.name for _, f in _of_kind(scene, Inflow)):
        return {}
    return {"id_count": ids_kept(scene, {body.name: described["count"]})[body.name]}


def _of_kind(scene: SceneData, kind: type[Any]) -> Iterator[tuple[str, Any]]:
    return ((p.name, p.flow) for p in scene.flows if isinstance(p.flow, kind))


def _speed(speed: float | TimeTable) -> TimeTable:
    return speed if isinstance(speed, TimeTable) else TimeTable((0.0,), (float(speed),))


def flow_entries(scene: SceneData, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the engine's "inlets" and "outlets", those that there are."""
    found: dict[str, list[dict[str, Any]]] = {"inlets": [], "outlets": []}
    for name, flow in _of_kind(scene, Inflow):
        number, body = _body(scene, flow)
        made = layer(scene, flow, bodies[number]["particle_mass"])
        found["inlets"].append({
            "name": name,
            "body": number,
            "face": flow.face,
            "spacing": made.spacing,
            "points": made.points,
            "pressure": _pressure(scene, flow, body, made.points),
            "velocity": engine_table(_speed(flow.velocity)),
            "next_id": bodies[number]["count"],
        })  # fmt: skip
    for name, flow in _of_kind(scene, Outflow):
        found["outlets"].append({"name": name, "face": flow.face})
    return {kind: entries for kind, entries in found.items() if entries}


def _pressure(scene: SceneData, flow: Inflow, body: Body, points: Array) -> Array | None:
    """Return ρ g depth of points (n, d) below the level of an inlet, Pa."""
    level = body.hydrostatic if flow.level is None else flow.level
    gravity = initial_gravity(scene)
    strength = float(np.linalg.norm(gravity))
    if level is None or strength == 0 or not body.material.table.stores_volume:
        return None
    up = -gravity / strength
    # That of an inlet is a coordinate, that of a body a height against gravity.
    top = level if flow.level is None else level * up[vertical_axis(scene)]
    height = sum(x * u for x, u in zip((points + np.asarray(scene.lower)).T, up, strict=True))
    density = body.material.parameters()["density"]
    return np.asarray(density * strength * np.maximum(top - height, 0.0))


def zones(scene: SceneData) -> list[dict[str, Any]]:
    """Return the engine's boundaries that lead the zones of inlets and outlets.

    A sticky box holds its inside and one layer of nodes around it, so it is a cell thinner.
    """
    found = []
    for placed in scene.flows:
        flow: Any = placed.flow
        if flow.velocity is None:
            continue
        axis, upper = _side(flow.face)
        speed = _speed(flow.velocity)
        low = [-_BEYOND] * scene.dimension
        high = [n + _BEYOND for n in scene.cells]
        if upper:
            low[axis] = scene.cells[axis] - flow.zone + 1
        else:
            high[axis] = flow.zone - 1
        time, value = speed.arrays()
        vectors = np.zeros((len(time), scene.dimension))
        vectors[:, axis] = value if isinstance(flow, Inflow) != upper else -value
        held = {"kind": "sticky", "static_friction": 0.0, "dynamic_friction": 0.0, "linear": False}
        found.append({
            "name": placed.name,
            "kind": "box",
            "lower": low,
            "upper": high,
            "faces": {face: dict(held) for face in faces_of(scene.dimension)},
            "start": 0.0,
            "end": np.inf,
            "velocity": {"time": time, "value": vectors, "end": speed.end},
        })  # fmt: skip
    return found


# Rules ----------------------------------------------------------------------------------------


def check_flows(scene: SceneData, problems: list[str], doubts: list[str]) -> None:
    """Report what is wrong with the inlets and outlets of a scene."""
    if not scene.flows:
        return
    taken: dict[str, str] = {}
    sensors = [s.name for s in scene.sensors]
    for placed in scene.flows:
        check = Checker(f"flow '{placed.name}'")
        flow: Any = placed.flow
        if placed.name in sensors:
            check.fail("a sensor has the same name; expected names of their own for their series")
        if scene.grid is not None:
            check.fail(
                "inlets and outlets are not built for grids of functions; expected a scene of "
                "square or cubic cells; leave grid out"
            )
        elif flow.face not in faces_of(scene.dimension):
            check.fail(
                f"face is '{flow.face}' in {scene.dimension}D; expected one of "
                f"{', '.join(faces_of(scene.dimension))}"
            )
        else:
            _check_place(check, scene, flow)
            if flow.face in taken:
                check.fail(f"face '{flow.face}' is that of flow '{taken[flow.face]}'; expected one "
                           "flow a face; remove one of them")  # fmt: skip
            taken[flow.face] = placed.name
            if isinstance(flow, Inflow):
                _check_inflow(check, scene, placed.name, flow, doubts)
        problems += check.problems
    for one in scene.sensors:
        _check_tracker(scene, one.name, one.sensor, problems)
    if scene.start is not None and any(_of_kind(scene, Inflow)):
        problems.append(
            "flows: the scene continues from a checkpoint, which one with an Inflow cannot; "
            "expected a separate run; use Simulation.resume to continue the same scene"
        )


def _check_place(check: Checker, scene: SceneData, flow: Flow) -> None:
    axis, _ = _side(flow.face)
    if flow.zone >= scene.cells[axis]:
        check.fail(
            f"zone is {flow.zone} cells of {scene.cells[axis]}; expected fewer; use a longer domain"
        )
    for boundary in scene.boundaries:
        shape = boundary.shape
        if not isinstance(shape, DomainWalls):
            continue
        if shape.faces == "all" or flow.face in shape.faces:
            others = [f for f in faces_of(scene.dimension) if f != flow.face]
            check.fail(
                f"face '{flow.face}' is a wall of boundary '{boundary.name}'; expected an open "
                f"face; name the others with DomainWalls(faces={others})"
            )


def _check_inflow(
    check: Checker, scene: SceneData, name: str, flow: Inflow, doubts: list[str]
) -> None:
    names = [b.name for b in scene.bodies]
    if flow.body not in names:
        check.fail(f"body '{flow.body}' is unknown; {nearest(flow.body, names)}")
        return
    axis, upper = _side(flow.face)
    v, d = vertical_axis(scene), scene.dimension
    if flow.bed is not None and flow.bed.dimension != d:
        check.fail(f"bed is a shape in {flow.bed.dimension}D; expected one in {d}D")
        return
    if flow.level is not None:
        if axis == v:
            check.fail(
                f"level is {flow.level:g} m on face '{flow.face}', which is level itself; expected "
                "None; leave it out"
            )
            return
        if not scene.lower[v] < flow.level <= scene.upper[v]:
            check.fail(
                f"level is {flow.level:g} m; expected inside the domain, {scene.lower[v]:g} to "
                f"{scene.upper[v]:g} m on axis {v}"
            )
            return
    _, body = _body(scene, flow)
    if isinstance(body.shape, Box) and body.shape.dimension == d:
        end = body.shape.upper[axis] - scene.upper[axis] if upper else (
            scene.lower[axis] - body.shape.lower[axis])  # fmt: skip
        deep = body.shape.size[axis]
        if abs(end) > _GAP * scene.cell_size or deep < (flow.zone - _GAP) * scene.cell_size:
            check.fail(
                f"body '{body.name}' does not fill the zone of {flow.zone} cells inside face "
                f"'{flow.face}'; expected water there at the start; begin its box at the face"
            )
    if isinstance(body.velocity, tuple) and not check.problems:
        speed = float(np.asarray(_speed(flow.velocity).at(0.0)))
        along = body.velocity[axis] * (-1 if upper else 1)
        if abs(along - speed) > 0.05 * max(speed, abs(along)) + 1e-12:
            doubts.append(
                f"flow '{name}': body '{body.name}' begins with {along:g} m/s and the inlet with "
                f"{speed:g} m/s; the jump sends a surge into the domain; begin both alike, or let "
                "velocity grow by a TimeTable, unless the surge is what is wanted"
            )
    if check.problems:
        return
    # About as heavy as its particles will be: the layer begins half its spacing behind the face.
    density, cell = body.material.parameters()["density"], scene.cell_size**d
    made = layer(scene, flow, density * cell / body.particles_per_cell)
    if len(made.points) == 0:
        check.fail("no point of its layers lies outside the bed; expected some; raise the level")
        return
    inside = made.points + np.asarray(scene.lower)
    for boundary in scene.boundaries:
        shape = boundary.shape
        if not isinstance(shape, Solid) or shape.dimension != d or boundary.window[0] > 0:
            continue
        if boundary.bodies and flow.body not in boundary.bodies:
            continue
        hit = shape.distance(inside) < -1e-9 * scene.cell_size
        # A region of prescribed velocity keeps no particle out.
        if np.any(hit) and getattr(boundary.response, "kind", "") != "prescribed":
            check.fail(
                f"{int(hit.sum())} points of its layers lie in boundary '{boundary.name}'; "
                "expected none; give its shape as bed"
            )
    if not check.problems and isinstance(body.shape, Solid) and not isinstance(body.shape, Box):
        for depth in (0.5, flow.zone - 0.5):
            there = inside.copy()
            end = scene.upper[axis] if upper else scene.lower[axis]
            there[:, axis] = end + (-depth if upper else depth) * scene.cell_size
            if flow.bed is not None:
                there = there[flow.bed.distance(there) > scene.cell_size]
            filled = body.shape.distance(there) < 0.5 * scene.cell_size
            if len(there) and np.mean(filled) < 0.9:
                check.fail(
                    f"body '{body.name}' does not fill the zone of {flow.zone} cells inside face "
                    f"'{flow.face}'; expected water there at the start; begin it at the face"
                )
                return


def _check_tracker(scene: SceneData, name: str, sensor: Sensor, problems: list[str]) -> None:
    """Refuse to follow all particles of a body whose number grows."""
    if not isinstance(sensor, ParticleTracker) or sensor.ids != "all":
        return
    if any(f.body == sensor.body for _, f in _of_kind(scene, Inflow)):
        problems.append(
            f"sensor '{name}': ids is 'all' of body '{sensor.body}', which an Inflow adds to; "
            "expected a list of ids; name those to follow"
        )


# What the plan and the simulation show ----------------------------------------------------------


def flow_rows(scene: SceneData, spacings: Mapping[str, float]) -> list[tuple[str, ...]]:
    """Return a row for each inlet and outlet: name, face, what it does.

    `spacings` are those of the bodies' particles, m: (mass / density)^(1/d).
    """
    rows: list[tuple[str, ...]] = []
    for placed in scene.flows:
        flow: Any = placed.flow
        text = "what crosses it is taken out"
        if isinstance(flow, Inflow):
            _, body = _body(scene, flow)
            density = body.material.parameters()["density"]
            made = layer(scene, flow, density * spacings[flow.body] ** scene.dimension)
            text = (
                f"{len(made.points)} particles into '{flow.body}' every {made.spacing:.4g} m, "
                f"{made.wetted:.4g} m{'²' if scene.dimension == 3 else ''} of water"
            )
        if flow.velocity is not None:
            value = np.asarray(_speed(flow.velocity).value, dtype=np.float64)
            ends = f"{value.min():g}" if value.min() == value.max() else (
                f"{value.min():g} to {value.max():g}")  # fmt: skip
            text += f"; {flow.zone} cells led at {ends} m/s"
        rows.append((placed.name, flow.face, text))
    return rows


class Traffic:
    """The series of a run's inlets and outlets: particles, mass and volume since its start."""

    columns = ("particles", "mass", "volume")

    def __init__(self, scene: SceneData, state: Mapping[str, Any] | None) -> None:
        """Make them, with what a saved state has of them."""
        self.inflow: dict[str, Series] = {}
        self.outflow: dict[str, Series] = {}
        units = ("1", "kg", "m³") if scene.dimension == 3 else ("1", "kg/m", "m²")
        for placed in scene.flows:
            incoming = isinstance(placed.flow, Inflow)
            attributes = {"kind": "inflow" if incoming else "outflow", "interval": 0.0}
            series = Series(placed.name, self.columns, units, attributes)
            (self.inflow if incoming else self.outflow)[placed.name] = series
        for series in self.series:
            time, values = _keys(series)
            if state is not None and time in state:
                series.append(state[time], state[values])

    @property
    def series(self) -> list[Series]:
        """All of them, inlets first."""
        return [*self.inflow.values(), *self.outflow.values()]

    def take(self, engine: Any) -> None:
        """Add what came and went in the engine since the last call."""
        if not self.inflow and not self.outflow:
            return
        kinds = {"inlet": list(self.inflow.values()), "outlet": list(self.outflow.values())}
        for kind, number, time, _step, *amounts in engine.flows():
            series = kinds[kind][number]
            before = series.since(len(series) - 1)[1][0] if len(series) else np.zeros(3)
            series.append(np.array([time]), (before + np.asarray(amounts))[np.newaxis])

    def state(self) -> dict[str, Any]:
        """Return them in the form of a saved state."""
        found: dict[str, Any] = {}
        for series in self.series:
            time, values = _keys(series)
            found |= {time: series.time, values: series.values}
        return found


def _keys(series: Series) -> tuple[str, str]:
    """Return the names of a series' times and values in a saved state."""
    return f"flow:{series.name}:time", f"flow:{series.name}:values"
