"""From a scene to the specification that the engine takes.

`design/engine-contract.md` in the sources describes the dictionary.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import shown
from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable, constant, engine_table
from libmpm._src.base.values import warn
from libmpm._src.boundaries.distance_field import lower_surface
from libmpm._src.boundaries.flow_layers import flow_entries, keep_room, zones
from libmpm._src.boundaries.responses import Prescribed
from libmpm._src.boundaries.wall_cells import by_caution, linear_by_default, strains_linearly
from libmpm._src.errors import SceneError
from libmpm._src.grids import placing
from libmpm._src.grids.shapes import Outline
from libmpm._src.materials.initial_stress import stored_stress
from libmpm._src.materials.material import wave_speed
from libmpm._src.materials.rigid import Rigid
from libmpm._src.methods.method import CROSSINGS, PACKING, FBar
from libmpm._src.run.choices import check_options, choose_precision
from libmpm._src.run.element_spec import mesh_part
from libmpm._src.run.hydrostatic import at_hand, still_water
from libmpm._src.scene.checks import validate
from libmpm._src.scene.checks_elements import faint_strains
from libmpm._src.scene.checks_sizes import check_numbers
from libmpm._src.scene.checks_time_steps import check_intervals, check_step, too_slow
from libmpm._src.scene.contact_fields import contact_entry, contact_sides
from libmpm._src.scene.places import extent_of, faces_present, initial_gravity, snap, vertical_axis
from libmpm._src.sensors import tallied
from libmpm._src.sensors.engine_sensors import (
    ContactLoad,
    LoadCell,
    ParticleTracker,
    PinForce,
    VelocityProbe,
    WaveGauge,
)
from libmpm._src.sensors.python_sensors import Sampled
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.filling import bounds_of, fill, relative

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body, Boundary, PlacedSensor
    from libmpm._src.scene.start import RestoredBody

__all__ = ["lower", "world_offset"]

#: From (first, last) to what is given for the particles first ≤ i < last of a body.
Rows = Callable[[int, int], npt.NDArray[np.float64]]

#: Cells beyond the domain that a box may reach; more would block nothing further.
_BEYOND = 64


def world_offset(scene: SceneData) -> npt.NDArray[np.float64]:
    """Return origin + lower, float64 (d,), m: add it to relative positions for world positions."""
    origin = np.asarray(scene.origin, dtype=np.float64)
    return origin + np.asarray(scene.lower, dtype=np.float64)


def lower(
    scene: SceneData,
    *,
    precision: str = "auto",
    pipeline: str = "auto",
    device_index: int = 0,
    threads: int = 0,
    shared_device: bool = False,
    time_step: float | None = None,
    with_particles: bool = True,
    shell: bool = False,
) -> dict[str, Any]:
    """Return the engine's specification of a scene.

    Positions are float64 in metres relative to `Scene.lower`; `Scene.origin` does not enter.
    `position` and `pressure` are functions that give the rows first ≤ i < last, so that nothing of
    the particles' size is allocated; without particles they are None. `time_step` in s overrides
    that of the scene's method. A `shell` has one particle in each body and the ids of all: for
    engines that load a state. Raises `SceneError`, warns as `Scene.validate`.
    """
    precision = choose_precision(scene, precision)
    problems = check_options(precision, pipeline, time_step=time_step, threads=threads)
    if scene.grid is not None and pipeline != "auto":
        problems.append(f"pipeline is {shown(pipeline)} on a grid of functions; expected 'auto'")
    if problems:
        raise SceneError(problems)
    validate(scene)
    fixed = scene.method.time_step if time_step is None else float(time_step)
    if fixed is not None or scene.grid is None:
        check_step(scene, fixed, precision)
    if scene.grid is None:
        check_intervals(scene, fixed)
        warn(too_slow(scene, fixed, precision) + faint_strains(scene, precision))
    bodies = []
    first = 0
    for body in scene.bodies:
        bodies.append(_body(scene, body, first, with_particles and not shell))
        bodies[-1] |= keep_room(scene, body, bodies[-1])
        if shell:
            _hollow(bodies[-1])
        first += bodies[-1].get("id_count", bodies[-1]["count"])
    if problems := check_numbers(scene, precision, bodies):
        raise SceneError(problems)
    sensors = [
        _sensor(scene, s, bodies)
        for s in scene.sensors
        if not isinstance(s.sensor, Sampled) or tallied.in_step(scene, s)
    ]
    linear = linear_by_default(scene)
    gravity = scene.gravity
    if not isinstance(gravity, TimeTable):
        gravity = constant(initial_gravity(scene).tolist())
    return (
        {
            "dimension": scene.dimension,
            "precision": precision,
            "device": device_index,
            "pipeline": pipeline,
            "shared_device": shared_device,
            "threads": threads,
            "cell_size": scene.cell_size,
            "cells": list(scene.cells),
            "gravity": engine_table(gravity),
            "cfl": scene.method.cfl,
            "time_step": fixed,
            "leaving": scene.method.leaving,
            "transfer": scene.transfer.scene_part(),
            "kernel": scene.method.kernel_choice.specification(),
            "bodies": bodies,
            "boundaries": [_boundary(scene, b, linear) for b in scene.boundaries] + zones(scene),
            "sensors": sensors,
        }
        | ({"deformed_nodes": True} if scene.method.kernel_choice.moved_nodes else {})
        | flow_entries(scene, bodies)
        | contact_entry(scene)
        | _added(scene, time_step, with_particles and not shell, sensors)
    )


def _added(
    scene: SceneData, time_step: float | None, with_particles: bool, sensors: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return what only some scenes have: a grid of functions, or another run to continue from."""
    if scene.grid is not None:
        return {"grid": scene.grid.specification()}
    start = scene.start
    if start is None or start.as_it_was(scene, time_step) or not with_particles:
        return {}
    from libmpm._src.run.checkpoint_state import snapshot

    found = snapshot(scene)
    kept: dict[str, Any] = {
        "sensor_next": np.zeros(0, dtype=np.int64),
        "sensor_last": np.zeros(0), "sensor_first": np.zeros(0), "load_impulse": np.zeros(0),
    }  # fmt: skip
    if found.sensors:
        own = {s.name for s in scene.sensors[: start.sensors]}
        kept = {name: np.asarray(found.sensors[name]) for name in kept}
        kept = tallied.fitted(
            kept, found.sensors["names"].tolist(), [s for s in sensors if s["name"] in own],
            found.time, found.step,
        )  # fmt: skip
    return {
        "start": {
            "time": found.time, "step": found.step, "time_step": found.time_step,
            "cell": found.cell, "velocity": found.velocity(), "averages": found.averages(), **kept,
        }
    }  # fmt: skip


def _hollow(specification: dict[str, Any]) -> None:
    """Leave one particle of a body, in the middle of its bounds, and all ids; a mesh whole."""
    specification.setdefault("id_count", specification["count"])
    if "elements" not in specification:
        specification |= {"count": 1, "position": specification["bounds"].mean(0, keepdims=True)}


def _restored(scene: SceneData, body: Body, before: RestoredBody, fill: bool) -> dict[str, Any]:
    """Return a body that continues from another run, without those that new bodies displace."""
    result: dict[str, Any] = {
        "name": body.name,
        "material": body.material.table.name,
        "parameters": body.material.core_parameters(scene.dimension),
        "count": before.ids,
        "id_count": before.ids,
        "bounds": bounds_of(scene, body),
        "particle_mass": before.particle_mass,
        "first_id": before.first_id,
        "position": None,
        "velocity": np.zeros(scene.dimension),
        "pressure": None,
        "fbar": _fbar(scene, body),
        "transfer": (body.transfer or scene.transfer).body_part(),
    } | _over_cells(scene, body)
    if not fill:
        return result | before.of_cut(scene.start, scene.cells, scene.cell_size)
    from libmpm._src.run.checkpoint_state import remaining

    ids, position, state = remaining(scene, body)
    return result | {
        "count": len(ids),
        "bounds": np.array([position.min(axis=0), position.max(axis=0)]),
        "position": position,
        "ids": ids.astype(np.uint32),
        "state": state,
        "state_width": state.shape[1],
    }


def _body(scene: SceneData, body: Body, first: int, with_particles: bool) -> dict[str, Any]:
    if scene.grid is not None:
        return _body_on_functions(scene, body, first, with_particles)
    before = None if scene.start is None else scene.start.restored(body.name)
    if before is not None:
        assert scene.start is not None
        return _restored(scene, body, before, with_particles)
    filling = fill(scene, body)
    points = filling.points
    parameters = body.material.core_parameters(scene.dimension)
    mass = parameters["density"] * filling.volume / filling.slices
    pressure = None
    if body.hydrostatic is not None and with_particles:
        pressure = still_water(scene, body.hydrostatic, parameters["density"], at_hand(points))
    starts: dict[str, Any] = {}
    if body.stress is not None and with_particles and not isinstance(body.shape, ElementMesh):
        starts = stored_stress(scene, body, points.rows, points.count)
    return (
        {
            "name": body.name,
            "material": body.material.table.name,
            "parameters": parameters,
            "count": points.count,
            "bounds": filling.bounds,
            "particle_mass": mass,
            "first_id": first,
            "position": at_hand(points) if with_particles else None,
            "velocity": _velocity(scene, body, points.rows, points.count if with_particles else 0),
            "pressure": pressure,
            "fbar": _fbar(scene, body),
            "transfer": (body.transfer or scene.transfer).body_part(),
        }
        | starts
        | _velocity_gradient(scene, body, points.rows, points.count if with_particles else 0)
        | _over_cells(scene, body)
        | mesh_part(body, points)
        | (body.material.rigid_part(scene.dimension) if isinstance(body.material, Rigid) else {})
    )


def _over_cells(scene: SceneData, body: Body) -> dict[str, Any]:
    """Return what is done between the parts of a body's step, where there is any."""
    told: dict[str, Any] = {}
    if body.smoothing is not None:
        told["smoothing"] = body.smoothing.specification(body.material.table.stores_volume)
    if body.assumed is not None:
        told["assumed"] = body.assumed.specification()
    if body.damping > 0:
        told["damping"] = body.damping
    if body.force is not None:
        told["force"] = body.force.specification(scene.lower)
    return told


def _velocity(scene: SceneData, body: Body, position: Rows, count: int) -> npt.NDArray[np.float64]:
    """Return the velocity of a body (d,), or of each of so many particles (count, d), m/s."""
    if not isinstance(body.velocity, Field):
        return np.array(body.velocity, dtype=np.float64)
    if count == 0:
        return np.zeros(scene.dimension)
    where = f"body '{body.name}': velocity"
    return body.velocity.at(position(0, count) + np.asarray(scene.lower), where)


def _velocity_gradient(scene: SceneData, body: Body, position: Rows, count: int) -> dict[str, Any]:
    """Return the gradient of a field of velocities, 1/s, where the transfer deposits it.

    (count, d, d), [:, c, a] = ∂v_c/∂x_a; (d, d) where it is the same everywhere to rounding, and
    nothing where it is zero.
    """
    transfer = body.transfer or scene.transfer
    if not isinstance(body.velocity, Field) or not transfer.affine or count == 0:
        return {}
    where = f"body '{body.name}': velocity"
    points = position(0, count) + np.asarray(scene.lower)
    found = body.velocity.gradient(points, scene.cell_size, where)
    most = float(np.abs(found).max())
    if most == 0:
        return {}
    if float(np.ptp(found, axis=0).max()) <= 1e-9 * most:
        found = found.mean(axis=0)
    return {"velocity_gradient": found}


def _body_on_functions(
    scene: SceneData, body: Body, first: int, with_particles: bool
) -> dict[str, Any]:
    placed = placing.place(scene, body)
    low = np.asarray(scene.lower, dtype=np.float64)
    position = placed.position - low
    n = placed.count
    parameters = body.material.core_parameters(scene.dimension)
    density = parameters["density"]

    def rows(first: int, last: int) -> npt.NDArray[np.float64]:
        return position[first:last]

    result: dict[str, Any] = {
        "name": body.name,
        "material": body.material.table.name,
        "parameters": parameters,
        "count": n,
        "bounds": np.array([position.min(axis=0), position.max(axis=0)]),
        "particle_mass": density * float(placed.volume.sum()) / n,
        "first_id": first,
        "position": None,
        "velocity": _velocity(scene, body, rows, n if with_particles else 0),
        "pressure": None,
        "fbar": {"form": "none", "time": 0.0, "ratio": 0.0},
    }
    if not with_particles:
        return result
    result |= {"position": rows, "volume": placed.volume}
    if body.hydrostatic is not None:
        result["pressure"] = still_water(scene, body.hydrostatic, density, rows)
    if isinstance(body.stress, Field):
        result["stress"] = body.stress.at(placed.position, f"body '{body.name}': stress")
    elif body.stress is not None:
        result["stress"] = np.tile(np.asarray(body.stress, dtype=np.float64), (n, 1))
    tractions = []
    for traction in body.tractions:
        which, length = placing.traction_rows(scene, body, traction)
        value = traction.value
        table = value if isinstance(value, TimeTable) else constant(value)
        tractions.append(
            {"particles": which.tolist(), "length": length, "value": engine_table(table)}
        )
    return result | {"tractions": tractions}


def _fbar(scene: SceneData, body: Body) -> dict[str, Any]:
    choice = body.fbar
    if choice == "default":
        given = body.material.table.stores_volume and body.smoothing is None
        choice = FBar() if given else None
    if choice is None:
        return {"form": "none", "time": 0.0, "ratio": 0.0}
    time, ratio = choice.time or 0.0, choice.ratio or 0.0
    if choice.length is not None:
        # ψ = 4ℓ²/(Δx² + 4ℓ²): Bonus (2023) 5.59 as a filter of length ℓ.
        square = 4.0 * choice.length**2
        ratio = square / (scene.cell_size**2 + square)
    elif not time and not ratio:
        speed = wave_speed(body.material)
        assert speed is not None  # the scene's checks refuse it
        time = CROSSINGS * scene.cell_size / speed
    packing = {option: getattr(choice, option) for option in PACKING}
    return {"form": choice.form, "time": time, "ratio": ratio, **packing}


def _boundary(scene: SceneData, boundary: Boundary, linear: bool) -> dict[str, Any]:
    faces = {}
    given = boundary.response
    # An outline or a surface has no faces: its one response stands under the first name.
    for face in (present := faces_present(scene, boundary)) or ("x-",):
        response = boundary.response_at(face)
        static, dynamic = response.friction
        faces[face] = {
            "kind": response.kind,
            "static_friction": static,
            "dynamic_friction": dynamic,
            "linear": strains_linearly(scene, boundary, face if present else "", linear),
            "cautious": by_caution(boundary, face if present else ""),
        }
        if isinstance(response, Prescribed):
            faces[face]["axes"] = response.axes(scene.dimension)
    result: dict[str, Any] = {"name": boundary.name, "kind": "domain"}
    if boundary.uplift:
        result["uplift"] = True
    if isinstance(boundary.shape, Outline):
        corner = np.asarray(scene.lower, dtype=np.float64)
        result["segments"] = boundary.shape.segments() - np.concatenate([corner, corner])
    if boundary.is_surface:
        result |= lower_surface(scene, boundary)
    elif isinstance(boundary.shape, Box):
        low, high = snap(scene, boundary.shape)
        if isinstance(given, Prescribed):
            # A region that ends with the domain has its rim too, where particles reach nodes.
            low = tuple(-_BEYOND if i <= 0 else i for i in low)
            high = tuple(
                n + _BEYOND if i >= n else i for i, n in zip(high, scene.cells, strict=True)
            )
        result |= {
            "kind": "box",
            "lower": [max(i, -_BEYOND) for i in low],
            "upper": [min(i, n + _BEYOND) for i, n in zip(high, scene.cells, strict=True)],
        }
    if boundary.within is not None:
        corners = (boundary.within.lower, boundary.within.upper)
        result["within"] = np.concatenate([relative(scene, corner) for corner in corners])
    if boundary.bodies:
        names = [b.name for b in scene.bodies]
        result["bodies"] = [names.index(name) for name in boundary.bodies]
    return result | {
        "faces": faces,
        "start": boundary.window[0],
        "end": boundary.window[1],
        "velocity": engine_table(m) if isinstance(m := boundary.motion, TimeTable) else None,
    }


def _sensor(scene: SceneData, placed: PlacedSensor, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    sensor = placed.sensor
    if isinstance(sensor, Sampled):
        said = tallied.described(scene, sensor, bodies, world_offset(scene))
        return {"name": placed.name} | said
    result: dict[str, Any] = {
        "name": placed.name,
        "kind": sensor.kind,
        "interval": sensor.interval,
    }
    if isinstance(sensor, LoadCell):
        index = [b.name for b in scene.boundaries].index(sensor.boundary)
        boundary = scene.boundaries[index]
        present = faces_present(scene, boundary)
        point = sensor.reference
        if point is None:
            reference = np.mean([relative(scene, x) for x in extent_of(scene, boundary)], axis=0)
        else:
            reference = relative(scene, point)
        chosen = (present or ("x-",)) if sensor.faces == "all" else sensor.faces
        return result | {"boundary": index, "faces": list(chosen), "reference": reference}
    if isinstance(sensor, ContactLoad):
        return result | contact_sides(scene, sensor)
    if isinstance(sensor, VelocityProbe):
        return result | {"position": relative(scene, sensor.position)}
    names = [b["name"] for b in bodies]
    body = getattr(sensor, "body", None)
    result["body"] = -1 if body is None else names.index(body)
    if isinstance(sensor, WaveGauge):
        axis = vertical_axis(scene)
        place = np.array(scene.lower, dtype=np.float64)
        place[[a for a in range(scene.dimension) if a != axis]] = sensor.position
        result |= {"position": relative(scene, place.tolist()), "axis": axis}
    elif isinstance(sensor, PinForce):
        result["pin"] = sensor.pin
    elif isinstance(sensor, ParticleTracker):
        of = bodies[result["body"]]
        first, n = of["first_id"], of.get("id_count", of["count"])
        every = sensor.ids == "all"
        ids = range(first, first + n) if every else sensor.ids
        result["ids"] = np.array(ids, dtype=np.uint64)
    return result
