"""What evaluates `BodyTracker` and `ContactForce`: motion and loads of a body as a whole."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.scene.data import SceneData
from libmpm._src.sensors.grid_sensors import boundary_forces
from libmpm._src.sensors.python_sensors import BodyTracker
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.sampler import Sampler, axes_of, bodies_of
from libmpm._src.sensors.step_readings import Moment, gravity_at

__all__ = ["OfBody", "angle_of", "angular_velocity", "gravity_impulse", "quaternion_of"]

#: Parts of a time table's span for its integral, beside its own points.
_PARTS = 32


def angle_of(start: Array, now: Array, mass: Array) -> float:
    """Return the angle, rad in (-π, π], that turns points (n, 2) about 0 best into others."""
    cross = start[:, 0] * now[:, 1] - start[:, 1] * now[:, 0]
    return math.atan2(float(mass @ cross), float(mass @ np.sum(start * now, axis=1)))


def quaternion_of(start: Array, now: Array, mass: Array) -> Array:
    """Return the unit quaternion (w, x, y, z), w ≥ 0, that turns points (n, 3) best into others.

    It is the eigenvector of the largest eigenvalue of Horn's (1987) symmetric matrix.
    """
    m = (start * mass[:, None]).T @ now
    trace = np.trace(m)
    away = np.array([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])
    horn = np.empty((4, 4))
    horn[0, 0] = trace
    horn[0, 1:] = horn[1:, 0] = away
    horn[1:, 1:] = m + m.T - trace * np.eye(3)
    found = np.linalg.eigh(horn)[1][:, -1]
    return found if found[0] >= 0 else -found


def angular_velocity(away: Array, velocity: Array, mass: Array) -> Array:
    """Return I⁻¹ L of points (n, d) about 0, (1,) in 2D, (3,) in 3D, rad/s."""
    if away.shape[1] == 2:
        spin = away[:, 0] * velocity[:, 1] - away[:, 1] * velocity[:, 0]
        inertia = float(mass @ np.sum(away**2, axis=1))
        return np.array([float(mass @ spin) / inertia if inertia > 0 else np.nan])
    spin = mass @ np.cross(away, velocity)
    squares = (away * mass[:, None]).T @ away
    tensor = np.trace(squares) * np.eye(3) - squares
    if np.linalg.eigvalsh(tensor)[0] <= 1e-12 * np.trace(tensor):
        return np.full(3, np.nan)  # points on a line spin about it unseen
    return np.linalg.solve(tensor, spin)


def gravity_impulse(scene: SceneData, first: float, last: float) -> Array:
    """Return ∫ g dt, (d,), m/s."""
    if not isinstance(scene.gravity, TimeTable):
        return gravity_at(scene, first) * (last - first)
    own = scene.gravity.arrays()[0]
    times = np.linspace(first, last, _PARTS + 1)
    times = np.union1d(times, own[(own > first) & (own < last)])
    values = np.stack([scene.gravity.at(float(t)) for t in times])
    found: Array = np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(times)[:, None], axis=0)
    return found


class OfBody(Sampler):
    """Tracks one body."""

    def __init__(self, scene: SceneData, sensor: BodyTracker) -> None:
        """Take a sensor that has been checked."""
        self._scene, self._chosen = scene, tuple(sensor.quantities)
        (self._body,) = bodies_of(scene, sensor.body)
        d, axes = scene.dimension, axes_of(scene)
        force, momentum = ("N", "kg·m/s") if d == 3 else ("N/m", "kg/s")
        vectors = {
            "centroid": "m", "velocity": "m/s", "momentum": momentum, "contact_force": force,
            "boundary_force": force,
        }  # fmt: skip
        named: list[tuple[str, str]] = []
        for name in self._chosen:
            if name in vectors:
                named += [(f"{name}_{a}", vectors[name]) for a in axes]
            elif name == "extent":
                named += [(f"{end}_{a}", "m") for end in ("lower", "upper") for a in axes]
            elif name == "orientation":
                named += (
                    [("angle", "rad")] if d == 2 else [(f"quaternion_{q}", "1") for q in "wxyz"]
                )
            elif d == 2:
                named.append((name, "rad/s"))
            else:
                named += [(f"{name}_{a}", "rad/s") for a in axes]
        self.columns, self.units = (tuple(part) for part in zip(*named, strict=True))
        #: Of the first sample: ids, and places from the centroid, m.
        self._first: tuple[NDArray[np.int64], Array] | None = None
        self._turned: Array | None = None
        #: Of the last sample: a checksum of the ids, momentum, and its time.
        self._before: tuple[int, Array, float] | None = None

    def announce(self, moment: Moment) -> None:
        """Ask for masses, positions and velocities."""
        moment.want(self._body, ("mass", "position", "velocity"))

    def row(self, moment: Moment) -> list[float]:
        """Return the quantities, one after the other."""
        arrays = moment.arrays(self._body)
        mass, position = arrays["mass"], arrays["position"]
        velocity = arrays["velocity"]
        if len(mass) == 0:
            return [float("nan")] * len(self.columns)
        total = float(mass.sum())
        centroid, momentum = mass @ position / total, mass @ velocity
        away = position - centroid
        result: list[float] = []
        for name in self._chosen:
            if name == "centroid":
                found = centroid
            elif name == "velocity":
                found = momentum / total
            elif name == "momentum":
                found = momentum
            elif name == "extent":
                found = np.concatenate([position.min(axis=0), position.max(axis=0)])
            elif name == "angular_velocity":
                found = angular_velocity(away, velocity - momentum / total, mass)
            elif name == "orientation":
                found = self._orientation(arrays["id"].astype(np.int64), away, mass)
            elif name == "contact_force":
                found = self._contact(moment, arrays["id"], momentum, total)
            else:
                found = self._boundaries(moment, position, mass)
            result += np.asarray(found).tolist()
        return result

    def _orientation(self, ids: NDArray[np.int64], away: Array, mass: Array) -> Array:
        if self._first is None:
            self._first = ids, away
        known, places = self._first
        # Particles may have left since; centroids are those of the ones that are left.
        _, here, there = np.intersect1d(ids, known, assume_unique=True, return_indices=True)
        weight = mass[here]
        now = away[here] - weight @ away[here] / weight.sum()
        start = places[there] - weight @ places[there] / weight.sum()
        if away.shape[1] == 2:
            angle = angle_of(start, now, weight)
            if self._turned is not None:
                angle += 2 * math.pi * round((float(self._turned[0]) - angle) / (2 * math.pi))
            found = np.array([angle])
        else:
            found = quaternion_of(start, now, weight)
            if self._turned is not None and float(self._turned @ found) < 0:
                found = -found
        self._turned = found
        return found

    def _contact(self, moment: Moment, ids: NDArray[Any], momentum: Array, total: float) -> Array:
        now, before = moment.velocity_time, self._before
        # What leaves or enters takes its momentum along, which is no force.
        present = zlib.crc32(ids.tobytes())
        self._before = (present, momentum, now)
        if before is None or before[0] != present or not now > before[2]:
            return np.full(len(momentum), np.nan)
        pull = total * gravity_impulse(self._scene, before[2], now)
        return (momentum - before[1] - pull) / (now - before[2])

    def _boundaries(self, moment: Moment, position: Array, mass: Array) -> Array:
        """Return the force on the body: boundaries push back with what they take."""
        place = moment.relative(position)
        nodes = moment.nodes_about(place)
        (share,) = nodes.spread(place, [mass])
        found: Array = -(share / nodes.mass) @ boundary_forces(moment, nodes)
        return found

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what the first and the last sample left."""
        found: dict[str, NDArray[Any]] = {}
        if self._first is not None:
            found |= {"first_id": self._first[0], "first_place": self._first[1]}
        if self._turned is not None:
            found["turned"] = self._turned
        if self._before is not None:
            present, momentum, time = self._before
            found |= {"present": np.array(present), "momentum": momentum, "then": np.array(time)}
        return found

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take up what the first and the last sample left."""
        if "first_id" in state:
            self._first = state["first_id"], state["first_place"]
        if "turned" in state:
            self._turned = state["turned"]
        if "momentum" in state:
            self._before = int(state["present"]), state["momentum"], float(state["then"])
