"""What evaluates sensors of particles: reductions, trackers, pressure probes, elevation gauges."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from libmpm._src.scene.data import SceneData
from libmpm._src.scene.places import vertical_axis
from libmpm._src.sensors import attributes
from libmpm._src.sensors.python_sensors import (
    AttributeTracker,
    ElevationGauge,
    ParticleSensor,
    PressureProbe,
)
from libmpm._src.sensors.reductions import Array, along, of_sums, reduce
from libmpm._src.sensors.sampler import (
    Sampler,
    axes_of,
    bodies_of,
    column_about,
    in_region,
    unit_in,
)
from libmpm._src.sensors.step_readings import Moment, gravity_at
from libmpm._src.sensors.tally_rows import Tally, added

__all__ = ["OfAttributes", "OfElevation", "OfParticles", "OfPressure", "quadratic_spline"]


def unit_after(unit: str, operation: str) -> str:
    """Return the unit of a reduction of values in `unit`."""
    if operation == "count":
        return "1"
    if operation == "variance" and unit != "1":
        return f"({unit})²" if len(unit) > 2 or "/" in unit else f"{unit}²"
    return unit


class OfParticles(Sampler):
    """Reduces an attribute over particles."""

    def __init__(self, scene: SceneData, sensor: ParticleSensor) -> None:
        """Take a sensor that has been checked."""
        self._sensor, self._scene = sensor, scene
        self._bodies = bodies_of(scene, sensor.body)
        self._vector = sensor.attribute in attributes.VECTORS
        name, operation = sensor.attribute, sensor.operation
        names = [name]
        if self._vector:
            names = [f"{name}_{a}" for a in sensor.direction or axes_of(scene) if a in "xyz"]
        self.columns = tuple(f"{n}_{operation}" for n in names)
        self.units = (unit_after(unit_in(scene, name), operation),) * len(names)

    def announce(self, moment: Moment) -> None:
        """Ask for the attribute, and for positions where there is a region."""
        region = self._sensor.region
        for i in self._bodies:
            if region is None:
                moment.want(i, (self._sensor.attribute,))
            else:
                moment.want(i, (self._sensor.attribute, "position"), region.bounds())

    def row(self, moment: Moment) -> list[float]:
        """Return one number, or one an axis."""
        sensor, parts = self._sensor, []
        for i in self._bodies:
            found = np.asarray(moment.attribute(i, sensor.attribute), dtype=np.float64)
            if sensor.region is not None:
                place = moment.places(i, sensor.attribute)
                found = found[in_region(sensor.region, place, self._scene.cell_size)]
            parts.append(found)
        values = np.concatenate(parts)
        if not self._vector:
            return [reduce(values, sensor.operation)]
        chosen = [sensor.direction] if sensor.direction else list(axes_of(self._scene))
        return [reduce(along(values, direction), sensor.operation) for direction in chosen]

    def rows(self, time: Array, tallies: Sequence[Tally], dt: Array) -> Array:
        """Return the numbers of samples (n, columns), of all bodies together."""
        found = added(tallies)
        n = len(self.columns)
        return of_sums(
            found.sums[:, :n],
            found.count[:, :n],
            found.low[:, :n],
            found.high[:, :n],
            self._sensor.operation,
        )


#: Cells about its last place in which a particle that is followed is looked for; further off it is
#: looked for everywhere. And the most particles that are looked for one by one.
_GOES_ON, _MOST_BOXES = 2.0, 64


class OfAttributes(Sampler):
    """Follows attributes of particles by id."""

    def __init__(self, scene: SceneData, sensor: AttributeTracker) -> None:
        """Take a sensor that has been checked."""
        self._sensor, self._cell_size = sensor, scene.cell_size
        (self._body,) = bodies_of(scene, sensor.body)
        #: Of those that were there at the last sample: ids, and places in the scene, m.
        self._last: tuple[NDArray[np.int64], Array] | None = None
        columns, units = [], []
        for i in sensor.ids:
            for name in sensor.attributes:
                vector = name in attributes.VECTORS
                parts = [f"{name}_{a}" for a in axes_of(scene)] if vector else [name]
                columns += [f"{part}:{i}" for part in parts]
                units += [unit_in(scene, name)] * len(parts)
        self.columns, self.units = tuple(columns), tuple(units)

    def announce(self, moment: Moment) -> None:
        """Ask for the attributes about the last places."""
        names = (*self._sensor.attributes, "position")
        if self._last is None or not len(self._last[1]):
            moment.want(self._body, names)
            return
        places, spare = self._last[1], _GOES_ON * self._cell_size
        if len(places) > _MOST_BOXES:
            within = places.min(axis=0) - spare, places.max(axis=0) + spare
            moment.want(self._body, names, within)
            return
        for place in places:
            moment.want(self._body, names, (place - spare, place + spare))

    def row(self, moment: Moment) -> Array:
        """Return the attributes of the first particle, then those of the next."""
        wanted = np.asarray(self._sensor.ids, dtype=np.int64)
        ids, at, there = self._find(moment, wanted)
        if self._last is not None and np.isin(self._last[0], wanted[~there]).any():
            # One has gone on further than was looked, or has left.
            moment.want(self._body, (*self._sensor.attributes, "position"))
            ids, at, there = self._find(moment, wanted)
        place = moment.in_scene(moment.attribute(self._body, "position"))
        self._last = wanted[there], place[at[there]]
        parts = []
        for name in self._sensor.attributes:
            values = np.asarray(moment.attribute(self._body, name), dtype=np.float64)
            values = values.reshape(len(ids), math.prod(values.shape[1:]))
            part = np.full((len(wanted), values.shape[1]), np.nan)
            part[there] = values[at[there]]
            parts.append(part)
        return np.concatenate(parts, axis=1).ravel()

    def _find(
        self, moment: Moment, wanted: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.bool_]]:
        """Return the ids that have been read, where wanted ones are among them, and which are."""
        ids = moment.attribute(self._body, "ID").astype(np.int64)
        at = np.searchsorted(ids, wanted)
        there = at < len(ids)
        there[there] = ids[at[there]] == wanted[there]
        return ids, at, there


def quadratic_spline(distance: Array) -> Array:
    """Return the quadratic B-spline of distances in spacings; its support is 1.5 on each side."""
    u = np.abs(distance)
    return np.where(u < 0.5, 0.75 - u**2, np.where(u < 1.5, 0.5 * (1.5 - u) ** 2, 0.0))


class OfPressure(Sampler):
    """Weighs pressures around a point."""

    columns = ("pressure",)
    units = ("Pa",)

    def __init__(self, scene: SceneData, sensor: PressureProbe) -> None:
        """Take a sensor that has been checked."""
        self._order = sensor.order
        self._bodies = bodies_of(scene, sensor.body)
        self._place = np.asarray(sensor.position, dtype=np.float64)
        cells = 1.5 if sensor.order == 0 else 2.0
        radius = cells * scene.cell_size if sensor.radius is None else sensor.radius
        self._spacing = radius / 1.5

    def announce(self, moment: Moment) -> None:
        """Ask for positions, volumes and pressures."""
        reach = 1.5 * self._spacing
        within = self._place - reach, self._place + reach
        for i in self._bodies:
            moment.want(i, ("position", "volume", "pressure"), within)

    def row(self, moment: Moment) -> list[float]:
        """Return the pressure at the point."""
        away, weights, pressures, slopes = [], [], [], []
        fluid, gravity = True, gravity_at(moment.scene, moment.time)
        for i in self._bodies:
            arrays, material = moment.arrays(i), moment.scene.bodies[i].material
            xi = (moment.in_scene(arrays["position"]) - self._place) / self._spacing
            near = np.all(np.abs(xi) < 1.5, axis=1)
            away.append(xi[near])
            weights.append(np.prod(quadratic_spline(xi[near]), axis=1) * arrays["volume"][near])
            pressures.append(arrays["pressure"][near])
            if near.any() and material.table.stores_volume:
                slopes.append((weights[-1] @ xi[near]) * material.parameters()["density"])
            elif near.any():
                fluid = False
        x, w, p = np.concatenate(away), np.concatenate(weights), np.concatenate(pressures)
        total = w.sum()
        if not total > 0:
            return [float("nan")]
        mean = float(w @ p / total)
        if self._order == 0:
            return [mean]
        if fluid:
            found = mean - float(sum(slopes) @ gravity) * self._spacing / float(total)
            # Above a surface the weight of a fluid that is not there is not taken off.
            return [max(found, min(mean, 0.0))]
        return [mean + _of_line(x, w, p)]


def _of_line(x: Array, w: Array, p: Array) -> float:
    """Return what a line of least squares has at 0 above its mean, with points x and weights w.

    0 where there are too few points for one.
    """
    if len(p) < 2 * (x.shape[1] + 1):
        return 0.0
    # Least squares of p = a + b (x - middle): a is the mean, and b follows from moments.
    total = w.sum()
    middle = w @ x / total
    from_middle = x - middle
    moment_matrix = (from_middle.T * w) @ from_middle / total
    # Points nearly on a plane leave the slope across it to noise.
    if np.linalg.eigvalsh(moment_matrix)[0] < 1e-3:
        return 0.0
    slope = np.linalg.solve(moment_matrix, (from_middle.T * w) @ (p - w @ p / total) / total)
    return -float(slope @ middle)


class OfElevation(Sampler):
    """Finds the highest material in a column."""

    columns = ("level",)
    units = ("m",)

    def __init__(self, scene: SceneData, sensor: ElevationGauge) -> None:
        """Take a sensor that has been checked."""
        self._sensor = sensor
        self._bodies = bodies_of(scene, sensor.body)
        self._vertical = vertical_axis(scene)
        up = attributes.upward(scene)[self._vertical]
        self._up = 1.0 if up >= 0 else -1.0
        self._level_axes = [a for a in range(scene.dimension) if a != self._vertical]
        self._radius = scene.cell_size if sensor.radius is None else sensor.radius

    def announce(self, moment: Moment) -> None:
        """Ask for positions, volumes and masses."""
        place = np.asarray(self._sensor.position)
        within = column_about(place, self._radius, self._level_axes)
        for i in self._bodies:
            moment.want(i, ("position", "volume", "mass"), within)

    def row(self, moment: Moment) -> list[float]:
        """Return the height, m of the world."""
        heights, masses, halves = [], [], []
        place = np.asarray(self._sensor.position)
        for i in self._bodies:
            arrays = moment.arrays(i)
            position = arrays["position"]
            flat = moment.in_scene(position)[:, self._level_axes] - place
            near = np.sum(flat**2, axis=1) < self._radius**2
            heights.append(self._up * position[near, self._vertical])
            masses.append(arrays["mass"][near])
            halves.append(0.5 * arrays["volume"][near] ** (1 / position.shape[1]))
        height, mass = np.concatenate(heights), np.concatenate(masses)
        if len(height) == 0:
            return [float("nan")]
        order = np.argsort(height, kind="stable")
        at = len(order) - 1
        if self._sensor.percentile is not None:
            below = np.cumsum(mass[order])
            share = self._sensor.percentile / 100 * below[-1]
            at = min(at, int(np.searchsorted(below, share * (1 - 1e-12))))
        top = order[at]
        return [self._up * float(height[top] + np.concatenate(halves)[top])]
