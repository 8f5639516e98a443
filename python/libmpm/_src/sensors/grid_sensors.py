"""What evaluates `GridSensor`: the nodes of the grid, and what boundaries do to them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.scene.data import SceneData
from libmpm._src.sensors.particle_sensors import unit_after
from libmpm._src.sensors.python_sensors import GRID, GridSensor
from libmpm._src.sensors.reductions import Array, along, reduce
from libmpm._src.sensors.sampler import Sampler, axes_of, in_region
from libmpm._src.sensors.step_readings import REACH, Moment, Nodes, gravity_at

__all__ = ["OfGrid", "boundary_forces"]

#: Times the rounding of the grid's numbers below which momentum counts as untouched.
_ROUNDING = 8.0


def boundary_forces(moment: Moment, nodes: Nodes) -> Array:
    """Return what boundaries take from each node in the coming step, per time of it, (n, d), N.

    f = (p + m g Δt - m v)/Δt; what is only rounding is zero.
    """
    dt = moment.dt
    after = nodes.mass[:, None] * nodes.velocity
    pull = nodes.mass[:, None] * gravity_at(moment.scene, moment.time) * dt
    taken = nodes.momentum + pull - after
    single = moment.simulation.precision != "double"
    unit = float(np.finfo(np.float32 if single else np.float64).eps)
    size = np.abs(nodes.momentum).max(axis=1) + np.abs(pull).max(axis=1)
    size = size + np.abs(after).max(axis=1)
    return np.where(np.abs(taken) > _ROUNDING * unit * size[:, None], taken, 0.0) / dt


def volume_energy(lost: Array, stiffness: float, exponent: float) -> Array:
    """Return the energy per first volume, Pa, of fluids that have lost a part of it.

    Ψ = (K/γ)(J + J^(1-γ)/(γ-1) - γ/(γ-1)) with J = 1 - lost, whose slope is minus the pressure of
    `TaitFluid`; γ = 1 by its limit. Near 0 its series, which loses no digits.
    """
    j = 1 - lost
    small = np.abs(lost) < 1e-3
    third, fourth = (exponent + 1) / 6, (exponent + 1) * (exponent + 2) / 24
    series = stiffness * lost**2 * (0.5 + third * lost + fourth * lost**2)
    if abs(exponent - 1) < 1e-9:
        whole = stiffness * (j - 1 - np.log(j))
    else:
        less = exponent - 1
        whole = stiffness / exponent * (j + (j**-less - exponent) / less)
    return np.where(small, series, whole)


class OfGrid(Sampler):
    """Reduces a quantity over nodes."""

    def __init__(self, scene: SceneData, sensor: GridSensor) -> None:
        """Take a sensor that has been checked."""
        self._sensor, self._scene = sensor, scene
        unit, self._vector = GRID[sensor.attribute]
        if scene.dimension == 2:
            per = {"N": "N/m", "kg·m/s": "kg/s", "kg": "kg/m", "m³": "m²", "J": "J/m"}
            unit = per.get(unit, unit)
        names: list[str] = [sensor.attribute]
        if self._vector:
            axes = sensor.direction[0] if sensor.direction else axes_of(scene)
            names = [f"{sensor.attribute}_{a}" for a in axes]
        self.columns = tuple(f"{n}_{sensor.operation}" for n in names)
        self.units = (unit_after(unit, sensor.operation),) * len(names)
        d = scene.dimension
        self._before: tuple[NDArray[np.int64], Array, float] = (
            np.empty((0, d), np.int64), np.empty((0, d)), np.nan,
        )  # fmt: skip

    def announce(self, moment: Moment) -> None:
        """Ask for the nodes, and of volumes for the particles that reach them."""
        region, within = self._sensor.region, None
        moment.want_nodes(None if region is None else region.bounds())
        if self._sensor.attribute not in ("volume", "jbar", "volume_energy"):
            return
        if region is not None:
            low, high = (np.asarray(side) for side in region.bounds())
            spare = REACH * self._scene.cell_size
            within = low - spare, high + spare
        for i in self._whose_volumes():
            moment.want(i, ("position", "volume", "volume_ratio"), within)

    def row(self, moment: Moment) -> list[float]:
        """Return one number, or one an axis."""
        nodes = moment.nodes
        inside = in_region(self._sensor.region, nodes.position, self._scene.cell_size)
        values = self._values(moment, inside)
        operation = self._sensor.operation
        if not self._vector:
            return [reduce(values, operation)]
        chosen = [self._sensor.direction] if self._sensor.direction else axes_of(self._scene)
        return [reduce(along(values, direction), operation) for direction in chosen]

    def _values(self, moment: Moment, inside: NDArray[np.bool_]) -> Array:
        nodes = moment.nodes
        attribute = self._sensor.attribute
        if attribute == "mass":
            return nodes.mass[inside]
        if attribute == "velocity":
            return nodes.velocity[inside]
        if attribute == "momentum":
            found: Array = nodes.mass[inside, None] * nodes.velocity[inside]
            return found
        if attribute == "force":
            return boundary_forces(moment, moment.nodes)[inside]
        if attribute == "acceleration":
            return self._acceleration(moment, inside)
        if attribute == "volume_energy":
            return self._volume_energy(moment)[inside]
        if attribute in ("kinetic_energy", "kinetic_energy_before", "potential_energy"):
            return self._energy(moment, inside)
        volume, first = np.zeros(len(nodes.mass)), np.zeros(len(nodes.mass))
        for i in self._whose_volumes():
            parts = self._volumes(moment, i)
            volume, first = volume + parts[0], first + parts[1]
        if attribute == "volume":
            return volume[inside]
        held = inside & (first > 0)
        return volume[held] / first[held]

    def _whose_volumes(self) -> list[int]:
        """Return the bodies whose volumes count, by number."""
        fluids_alone = self._sensor.attribute == "volume_energy"
        bodies = enumerate(self._scene.bodies)
        return [i for i, b in bodies if b.material.table.stores_volume or not fluids_alone]

    @staticmethod
    def _volumes(moment: Moment, body: int) -> list[Array]:
        """Return Σ N_ip V_p and Σ N_ip V_p⁰ of a body at each node, m³."""
        arrays = moment.arrays(body)
        now, place = arrays["volume"], moment.relative(arrays["position"])
        return moment.nodes.spread(place, [now, now / arrays["volume_ratio"]])

    def _energy(self, moment: Moment, inside: NDArray[np.bool_]) -> Array:
        nodes = moment.nodes
        mass, attribute = nodes.mass[inside], self._sensor.attribute
        if attribute == "potential_energy":
            height = nodes.position[inside] - np.asarray(self._scene.lower)
            found: Array = -mass * (height @ gravity_at(self._scene, moment.time))
        elif attribute == "kinetic_energy":
            found = 0.5 * mass * np.sum(nodes.velocity[inside] ** 2, axis=1)
        else:
            found = 0.5 * np.sum(nodes.momentum[inside] ** 2, axis=1) / mass
        return found

    def _volume_energy(self, moment: Moment) -> Array:
        nodes = moment.nodes
        found = np.zeros(len(nodes.mass))
        for i in self._whose_volumes():
            values = self._scene.bodies[i].material.parameters()
            volume, first = self._volumes(moment, i)
            held = first > 0
            lost = 1 - volume[held] / first[held]
            found[held] += first[held] * volume_energy(
                lost, float(values["bulk_modulus"]), float(values["exponent"])
            )
        return found

    def _acceleration(self, moment: Moment, inside: NDArray[np.bool_]) -> Array:
        nodes, now = moment.nodes, moment.velocity_time
        cell, velocity, then = self._before
        row = nodes.find(cell)
        both = row >= 0
        row = row[both]
        change = (nodes.velocity[row] - velocity[both]) / (now - then)
        self._before = (nodes.cell[inside], nodes.velocity[inside], now)
        return change

    def state(self) -> dict[str, NDArray[Any]]:
        """Return nodes and velocities of the last sample, where accelerations need them."""
        if self._sensor.attribute != "acceleration":
            return {}
        cell, velocity, then = self._before
        return {"cell": cell, "velocity": velocity, "then": np.array(then)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take up the last sample."""
        if state:
            self._before = (state["cell"], state["velocity"], float(state["then"]))
