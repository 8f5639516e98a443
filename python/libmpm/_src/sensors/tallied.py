"""Sensors that are made of sums over particles, which the engine takes in its step.

A tally (include/mpm/kernels/tally.hpp) is one pass over a body's particles: six sums, counts and
extremes. Which sensors have them, what is asked of the engine, and its rows as columns of sums.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.schedule import due_index, due_time
from libmpm._src.errors import CheckpointError, SceneError
from libmpm._src.materials.rigid import Rigid
from libmpm._src.scene.data import SceneData
from libmpm._src.scene.parts import Body, PlacedSensor
from libmpm._src.sensors import attributes
from libmpm._src.sensors.engine_sensors import Sensor
from libmpm._src.sensors.python_sensors import BodyTracker, ParticleSensor, Sampled
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.sampler import ROUNDING, bodies_of
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.element_mesh import ElementMesh

__all__ = ["add_first_places", "described", "fitted", "in_step", "moments"]
__all__ += ["state_names"]

#: Attribute -> what a tally calls it.
_SCALARS = {
    "speed": "speed", "Velocity_Magnitude": "speed", "kinetic_energy": "kinetic_energy",
    "Elevation": "elevation", "volume": "volume", "Volume": "volume", "density": "density",
    "pressure": "pressure", "Pressure": "pressure", "volume_ratio": "volume_ratio",
    "J": "volume_ratio", "DefGrad_Determinant": "volume_ratio",
    "elastic_energy": "elastic_energy", "plastic_strain": "plastic_strain",
    "VonMisesStress": "von_mises",
}  # fmt: skip
#: Those that follow from a body's law.
_OF_LAW = {
    "volume", "density", "pressure", "volume_ratio", "elastic_energy", "plastic_strain",
    "von_mises", "stress",
}  # fmt: skip
_COMPONENTS = {
    f"StressCauchy_{row}{line}": 3 * i + j
    for i, row in enumerate("XYZ")
    for j, line in enumerate("XYZ")
}
_ALONG = {"Position": "position", "Velocity": "velocity"}

#: What a state has of each sensor.
_KEPT = ("sensor_next", "sensor_last", "sensor_first")


def _of_attribute(name: str, direction: str | None) -> dict[str, Any] | None:
    """Return what a tally of an attribute asks for; None where there is none."""
    if name in attributes.VECTORS:
        sign = {"+": 1, "-": -1}.get(direction[-1], 0) if direction else 0
        axis = "xyz".index(direction[0]) if direction else -1
        return {"of": name, "axis": axis, "sign": sign}
    if name in _SCALARS:
        return {"of": _SCALARS[name]}
    if name in _COMPONENTS:
        return {"of": "stress", "part": _COMPONENTS[name]}
    of, _, along = name.rpartition("_")
    known = of in _ALONG and along in ("X", "Y", "Z")
    return {"of": _ALONG[of], "axis": "XYZ".index(along)} if known else None


def _plain(body: Body) -> bool:
    return not isinstance(body.shape, ElementMesh) and not isinstance(body.material, Rigid)


def in_step(scene: SceneData, placed: PlacedSensor) -> bool:
    """Return whether the engine takes what a sensor of a scene is made of.

    The others are read at step boundaries: those of other regions than boxes, of attributes that
    are no sums, of spreads, which sums of squares would lose beside a mean, of bodies of elements;
    of scenes that continue from another run orientations that are not measured from where that run
    began.
    """
    sensor = placed.sensor
    if scene.grid is not None or not isinstance(sensor, ParticleSensor | BodyTracker):
        return False
    bodies = [scene.bodies[i] for i in bodies_of(scene, sensor.body)]
    if not bodies or not all(map(_plain, bodies)):
        return False
    if isinstance(sensor, BodyTracker):
        turns = "orientation" in sensor.quantities
        return "boundary_force" not in sensor.quantities and (
            not turns or _is_there_at_first(scene, placed.name, sensor.body)
        )
    asked = _of_attribute(sensor.attribute, sensor.direction)
    if asked is None or type(sensor.region) not in (type(None), Box):
        return False
    if sensor.operation in ("std", "variance"):
        return False
    return asked["of"] not in _OF_LAW or not any(b.material.added for b in bodies)


def _is_there_at_first(scene: SceneData, sensor: str, body: str) -> bool:
    """Return whether all particles of a tracker's body are where a run says that it began."""
    if any(getattr(f.flow, "body", None) == body for f in scene.flows):
        return False
    start = scene.start
    if start is None:
        return True
    own = [s.name for s in scene.sensors[: start.sensors]]
    return start.tiles == 1 and start.first_cell is None and sensor in own


def moments(quantities: Sequence[str], dimension: int) -> list[str]:
    """Return the tallies of which a tracker's quantities are made, `motion` first."""
    found = ["motion"]
    if "angular_velocity" in quantities:
        found.append("second")
    if {"angular_velocity", "orientation"} & set(quantities):
        found.append("spin")
    if "orientation" in quantities:
        found.append("turn")
        if dimension == 3:
            found.append("turn_rest")
    return found


def described(
    scene: SceneData, sensor: Sensor, bodies: Sequence[Mapping[str, Any]], origin: Array
) -> dict[str, Any]:
    """Return what an engine's specification says of a sensor that is `in_step`.

    `bodies` are those of the specification, `origin` (d,) m its lower corner in the world.
    """
    assert isinstance(sensor, ParticleSensor | BodyTracker)
    tallies = []
    for i in bodies_of(scene, sensor.body):
        body = bodies[i]
        bounds = np.asarray(body["bounds"], dtype=np.float64)
        whole = {
            "body": i, "first": body["first_id"], "count": body.get("id_count", body["count"]),
            "origin": origin, "up": attributes.upward(scene),
            "reference": bounds.reshape(2, -1).mean(axis=0),
        }  # fmt: skip
        if isinstance(sensor, BodyTracker):
            tallies += [whole | {"of": of} for of in moments(sensor.quantities, scene.dimension)]
            continue
        asked = _of_attribute(sensor.attribute, sensor.direction)
        assert asked is not None
        if isinstance(sensor.region, Box):
            spare = ROUNDING * scene.cell_size
            corner = np.asarray(scene.lower, dtype=np.float64)
            asked["lower"] = np.asarray(sensor.region.lower) - corner - spare
            asked["upper"] = np.asarray(sensor.region.upper) - corner + spare
        tallies.append(whole | asked)
    # A rounding error early, as all that is due.
    return {"kind": "tally", "interval": due_time(1, sensor.interval), "tallies": tallies}


def add_first_places(
    specification: dict[str, Any], memory: Mapping[str, Mapping[str, NDArray[Any]]]
) -> None:
    """Say where particles were at first, to the tallies that measure how a body has turned.

    `memory` is what sensors remember of a run that goes on, by their names. Raises
    `CheckpointError` where that is not a place for each particle.
    """
    bodies = specification["bodies"]
    for sensor in specification["sensors"]:
        tallies = sensor.get("tallies", [])
        if not any(t["of"] == "turn" for t in tallies):
            continue
        (tally,) = (t for t in tallies if t["of"] == "spin")
        count, known = tally["count"], memory.get(sensor["name"], {})
        if "first_place" in known:
            ids = np.asarray(known.get("first_id", ())) - tally["first"]
            rows = np.asarray(known["first_place"], dtype=np.float64)
            whole = ids.shape == (count,) and rows.shape == (count, len(tally["reference"]))
            if not (whole and np.isfinite(rows).all() and (np.sort(ids) == range(count)).all()):
                raise CheckpointError(
                    f"sensor '{sensor['name']}': the checkpoint has {rows.shape} first places of "
                    f"ids {ids.shape}; expected one for each of {count} particles; use the other "
                    "generation in its folder"
                )
        else:
            body = bodies[tally["body"]]
            read = getattr(body["position"], "rows", body["position"])
            if not callable(read):
                raise SceneError(
                    f"sensor '{sensor['name']}': the run that this scene continues from has no "
                    "sample of it to measure a rotation from; expected one; give the sensor to the "
                    "scene anew, under another name"
                )
            rows = np.asarray(read(0, body["count"]))
            ids = np.asarray(body.get("ids", np.arange(body["count"])))
        places = np.full((count, rows.shape[1]), np.nan)
        places[ids.astype(np.int64)] = rows
        tally["places"] = places.ravel()


def state_names(header: Mapping[str, Any], sensors: Sequence[PlacedSensor]) -> list[str]:
    """Return the names of the sensors that the state of a checkpoint has.

    `sensors` are those of its run. Earlier versions did not say: the state has those that no
    version evaluates in Python.
    """
    plain = [s.name for s in sensors if not isinstance(s.sensor, Sampled)]
    return list(header.get("engine_sensors", plain))


def fitted(
    state: Mapping[str, Any], have: Sequence[str], wanted: Sequence[Mapping[str, Any]],
    time: float, step: int,
) -> dict[str, Any]:  # fmt: skip
    """Return a saved state with the sensors of an engine's specification.

    Earlier versions took no tallies in their steps, and a scene that continues from another run
    takes others than that run: a state may have entries for them, or lack them. `have` are the
    names of the sensors of the state, `wanted` the entries of the specification that the run knew,
    `time` s and `step` those of the state.
    """
    if [s["name"] for s in wanted] == list(have):
        return dict(state)
    kept = {name: np.asarray(state.get(name, ())) for name in _KEPT}
    if any(len(values) != len(have) for values in kept.values()):
        return dict(state)  # which the engine refuses, and says why
    at = {name: i for i, name in enumerate(have)}
    rows: dict[str, list[float]] = {name: [] for name in _KEPT}
    for sensor in wanted:
        interval = sensor["interval"]
        # All that was due has been sampled when a state is saved.
        following = due_index(time, interval) + 1 if interval > 0 else step + 1
        own = {"sensor_next": following, "sensor_last": 0.0, "sensor_first": np.nan}
        if sensor["name"] in at:
            own = {name: kept[name][at[sensor["name"]]] for name in _KEPT}
        for name, value in own.items():
            rows[name].append(value)
    return dict(state) | {
        name: np.array(values, dtype=kept[name].dtype) for name, values in rows.items()
    }
