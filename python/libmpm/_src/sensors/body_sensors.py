"""What evaluates `BodyTracker` and `ContactForce`: motion and loads of a body as a whole."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.scene.data import SceneData
from libmpm._src.sensors.grid_sensors import boundary_forces
from libmpm._src.sensors.python_sensors import BodyTracker
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.sampler import Sampler, axes_of, bodies_of
from libmpm._src.sensors.step_readings import Moment, gravity_at, stores_velocity
from libmpm._src.sensors.tallied import moments
from libmpm._src.sensors.tally_rows import Tally

__all__ = ["OfBody", "angles", "gravity_impulse", "quaternions", "turn_rates"]

#: Share of moments about a fixed point by which those about the centroid may be wrong.
_ROUNDING = 2e-15

#: Parts of a time table's span for its integral, beside its own points.
_PARTS = 32


def angles(moment: Array) -> Array:
    """Return the angle, rad in (-π, π], that turns points best into others, (n,).

    `moment` (n, 2, 2) is Σ m X xᵀ of their places X and x from their centroids.
    """
    m = moment
    return np.arctan2(m[:, 0, 1] - m[:, 1, 0], m[:, 0, 0] + m[:, 1, 1])


def quaternions(moment: Array) -> Array:
    """Return the unit quaternions (w, x, y, z), w ≥ 0, that turn points best into others, (n, 4).

    `moment` (n, 3, 3) as of `angles`. They are the eigenvectors of the largest eigenvalues of
    Horn's (1987) symmetric matrices.
    """
    m = moment
    trace = np.trace(m, axis1=1, axis2=2)
    away = np.stack(
        [m[:, 1, 2] - m[:, 2, 1], m[:, 2, 0] - m[:, 0, 2], m[:, 0, 1] - m[:, 1, 0]], axis=1
    )
    horn = np.empty((len(m), 4, 4))
    horn[:, 0, 0] = trace
    horn[:, 0, 1:] = horn[:, 1:, 0] = away
    horn[:, 1:, 1:] = m + m.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
    found = np.linalg.eigh(horn)[1][:, :, -1]
    return np.asarray(np.where(found[:, :1] >= 0, found, -found))


def turn_rates(spin: Array, squares: Array, noise: Array | float = 0.0) -> Array:
    """Return I⁻¹ L, (n, 1) in 2D, (n, 3) in 3D, rad/s; NaN where points do not tell it.

    `spin` (n, 1 or 3) is Σ m x × v and `squares` (n, d, d) is Σ m x xᵀ from their centroids, right
    to `noise` (n,).
    """
    trace = np.trace(squares, axis1=1, axis2=2)
    if spin.shape[1] == 1:
        with np.errstate(invalid="ignore", divide="ignore"):
            rate: Array = np.where((trace > noise)[:, None], spin / trace[:, None], np.nan)
            return rate
    tensor = trace[:, None, None] * np.eye(3) - squares
    # Points on a line spin about it unseen.
    seen = np.linalg.eigvalsh(tensor)[:, 0] > np.maximum(2e-12 * trace, noise)
    found = np.full(spin.shape, np.nan)
    found[seen] = np.linalg.solve(tensor[seen], spin[seen][:, :, None])[:, :, 0]
    return found


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


def _turn_rate(away: Array, velocity: Array, mass: Array) -> Array:
    """Return I⁻¹ L of points (n, d) about 0, (1,) in 2D, (3,) in 3D, rad/s."""
    spin = mass @ _across(away, velocity)
    return np.asarray(turn_rates(spin[None], ((away * mass[:, None]).T @ away)[None])[0])


def _across(a: Array, b: Array) -> Array:
    """Return a × b of vectors (n, d), (n, 1) in 2D, (n, 3) in 3D."""
    if a.shape[1] == 2:
        return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])[:, None]
    return np.cross(a, b)


def _outer(a: Array, b: Array) -> Array:
    """Return a bᵀ of vectors (n, d), (n, d, d)."""
    return a[:, :, None] * b[:, None, :]


def _squares(sums: Array, d: int) -> Array:
    """Return Σ x xᵀ (n, d, d) of the sums x x, y y, z z, x y, x z, y z."""
    places = ((0, 3), (3, 1)) if d == 2 else ((0, 3, 4), (3, 1, 5), (4, 5, 2))
    return sums[:, np.array(places)]


def _turn(found: Mapping[str, Tally], centre: Array, count: Array) -> Array:
    """Return the moments of `angles`, (n, d, d), of places now about `centre` (n, d)."""
    d = centre.shape[1]
    first = found["spin"].sums[:, 3 : 3 + d] / count
    rows = [found["turn"].sums] + ([found["turn_rest"].sums[:, :d]] if d == 3 else [])
    moment = np.concatenate(rows, axis=1)[:, : d * d].reshape(-1, d, d)
    away = count[:, :, None] * _outer(first, centre)
    return np.where(np.abs(moment - away) > _ROUNDING * np.abs(away), moment - away, 0)


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
        #: Of the last sample: what tells its particles from others, momentum, and its time.
        self._before: tuple[Array, Array, float] | None = None

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
                found = _turn_rate(away, velocity - momentum / total, mass)
            elif name == "orientation":
                found = self._orientation(arrays["id"].astype(np.int64), away, mass)
            elif name == "contact_force":
                present = np.array([zlib.crc32(arrays["id"].tobytes())])
                found = self._contact(present, momentum, total, moment.velocity_time)
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
        # Of places that have not changed it is symmetric to the bit.
        moment = np.sum(weight[:, None, None] * _outer(start, now), axis=0)
        return np.asarray(self._turning(moment[None])[0])

    def _turning(self, moment: Array) -> Array:
        """Return orientations (n, 1 or 4) that go on from the last one, by moments of `angles`."""
        before = self._turned
        if moment.shape[1] == 2:
            # One after the other: no bit depends on how many samples come at once.
            turned: list[list[float]] = []
            last = float(angles(moment)[0]) if before is None else float(before[0])
            for angle in angles(moment).tolist():
                last = angle + 2 * math.pi * round((last - angle) / (2 * math.pi))
                turned.append([last])
            found = np.array(turned)
        else:
            found = quaternions(moment)
            ahead = np.concatenate([found[:1] if before is None else before[None], found[:-1]])
            signs = np.where(np.sum(ahead * found, axis=1) < 0, -1.0, 1.0)
            found = np.cumprod(signs)[:, None] * found
        self._turned = np.asarray(found[-1])
        return np.asarray(found)

    def rows(self, time: Array, tallies: Sequence[Tally], dt: Array) -> Array:
        """Return the quantities of samples (n, columns), from sums over particles."""
        there = tallies[0].count[:, 0] > 0
        found = np.full((len(time), len(self.columns)), np.nan)
        if there.any():
            kept = [t.of(there) for t in tallies]
            found[there] = self._of_sums(time[there], kept, dt[there])
        return found

    def _of_sums(self, time: Array, tallies: Sequence[Tally], dt: Array) -> Array:
        """Return the quantities of samples with particles, all of one mass."""
        assert self.summed is not None
        d, origin = self._scene.dimension, np.asarray(self.summed.origin)
        found = dict(zip(moments(self._chosen, d), tallies, strict=True))
        motion = found["motion"]
        count = motion.count[:, :1]
        centre, velocity = motion.sums[:, :d] / count, motion.sums[:, 3 : 3 + d] / count
        mass = self.summed.particle_mass * count
        columns = []
        for name in self._chosen:
            if name == "centroid":
                columns.append(centre + np.asarray(self.summed.reference) + origin)
            elif name == "velocity":
                columns.append(velocity)
            elif name == "momentum":
                columns.append(mass * velocity)
            elif name == "extent":
                columns += [motion.low[:, :d] + origin, motion.high[:, :d] + origin]
            elif name == "angular_velocity":
                across = _across(centre, velocity)
                spin = found["spin"].sums[:, : across.shape[1]] - count * across
                whole = _squares(found["second"].sums, d)
                squares = whole - count[:, :, None] * _outer(centre, centre)
                noise = _ROUNDING * np.trace(whole, axis1=1, axis2=2)
                columns.append(turn_rates(spin, squares, noise))
            elif name == "orientation":
                columns.append(self._turning(_turn(found, centre, count)))
            else:
                particles = np.concatenate([count, motion.ids], axis=1)
                now = time + (0.0 if stores_velocity(self._scene) else dt)
                each = zip(particles, mass * velocity, mass[:, 0], now, strict=True)
                columns.append(
                    np.array([self._contact(p, v, float(m), float(t)) for p, v, m, t in each])
                )
        return np.concatenate(columns, axis=1)

    def _contact(self, particles: Array, momentum: Array, mass: float, now: float) -> Array:
        """Return the mean force since the sample before, NaN where particles have come or gone.

        `particles` are numbers that tell whether they are the same.
        """
        before, self._before = self._before, (particles, momentum, now)
        # What leaves or enters takes its momentum along, which is no force.
        if before is None or not now > before[2] or not np.array_equal(before[0], particles):
            return np.full(len(momentum), np.nan)
        pull = mass * gravity_impulse(self._scene, before[2], now)
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
            particles, momentum, time = self._before
            found |= {"particles": particles, "momentum": momentum, "then": np.array(time)}
        if self.summed is not None and self.summed.places is not None:
            # For runs that continue from this one.
            places = self.summed.places
            ids = self.summed.first_id + np.arange(len(places), dtype=np.int64)
            found |= {"first_id": ids, "first_place": places}
        return found

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take up what the first and the last sample left."""
        if "first_id" in state:
            self._first = state["first_id"], state["first_place"]
        if "turned" in state:
            self._turned = state["turned"]
        if "momentum" in state:
            # Earlier versions call a checksum of the ids so.
            particles = state["particles"] if "particles" in state else state["present"]
            self._before = np.atleast_1d(particles), state["momentum"], float(state["then"])
