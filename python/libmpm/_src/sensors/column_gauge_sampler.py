"""What evaluates a `ColumnGauge`."""

from __future__ import annotations

import numpy as np

from libmpm._src.scene.data import SceneData
from libmpm._src.scene.places import vertical_axis
from libmpm._src.sensors import attributes
from libmpm._src.sensors.column_gauge import ColumnGauge
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.sampler import Sampler, axes_of, bodies_of, column_about
from libmpm._src.sensors.step_readings import Moment

__all__ = ["OfColumn", "hat", "mean_column"]


def hat(away: Array, width: float) -> Array:
    """Return the product (n,) of hats of half width l of distances (n, k), each 1 - |x|/l or 0."""
    found: Array = np.prod(np.maximum(0.0, 1.0 - np.abs(away) / width), axis=1)
    return found


def mean_column(height: Array, velocity: Array, weight: Array) -> Array:
    """Return twice the mean height and the mean velocity, (1 + d,), of weighted particles."""
    total = weight.sum()
    if not total > 0:
        return np.full(1 + velocity.shape[1], np.nan)
    found: Array = np.concatenate([[2.0 * (weight @ height)], weight @ velocity]) / total
    return found


class OfColumn(Sampler):
    """Weighs the particles over a place."""

    def __init__(self, scene: SceneData, sensor: ColumnGauge) -> None:
        """Take a sensor that has been checked."""
        self._bodies = bodies_of(scene, sensor.body)
        self._vertical = axis = vertical_axis(scene)
        self._up = 1.0 if attributes.upward(scene)[axis] >= 0 else -1.0
        end = scene.lower[axis] if self._up > 0 else scene.upper[axis]
        self._bed = float(end if sensor.bed is None else sensor.bed)
        self._origin = float(scene.origin[axis])
        self._level_axes = [a for a in range(scene.dimension) if a != axis]
        self._place = None if sensor.position is None else np.asarray(sensor.position)
        self._width = scene.cell_size if sensor.width is None else sensor.width
        self.columns = ("level", *(f"velocity_{a}" for a in axes_of(scene)))
        self.units = ("m", *("m/s",) * scene.dimension)

    def announce(self, moment: Moment) -> None:
        """Ask for masses, positions and velocities."""
        within = None
        if self._place is not None:
            within = column_about(self._place, self._width, self._level_axes)
        for i in self._bodies:
            moment.want(i, ("mass", "position", "velocity"), within)

    def row(self, moment: Moment) -> Array:
        """Return level and velocity."""
        heights, velocities, weights = [], [], []
        for i in self._bodies:
            arrays = moment.arrays(i)
            position = moment.in_scene(arrays["position"])
            weight = np.asarray(arrays["mass"], dtype=np.float64)
            if self._place is not None:
                weight = weight * hat(position[:, self._level_axes] - self._place, self._width)
            near = weight > 0
            heights.append(self._up * (position[near, self._vertical] - self._bed))
            velocities.append(arrays["velocity"][near])
            weights.append(weight[near])
        found = mean_column(
            np.concatenate(heights), np.concatenate(velocities), np.concatenate(weights)
        )
        found[0] = self._origin + self._bed + self._up * found[0]
        return found
