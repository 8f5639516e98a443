"""`Sampler`, the base of what evaluates a sensor: columns, what it reads, a row, its memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.scene.data import SceneData
from libmpm._src.sensors import attributes
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.step_readings import Box, Moment
from libmpm._src.sensors.tally_rows import Tally
from libmpm._src.shapes.solid import Solid

__all__ = ["ROUNDING", "Sampler", "SummedBody", "axes_of", "bodies_of", "column_about"]
__all__ += ["in_region", "unit_in"]

#: Part of a cell by which a point may miss a region and still count: rounding of coordinates.
ROUNDING = 1e-6


@dataclass(frozen=True)
class SummedBody:
    """What a sampler has to know of a body that the engine sums over.

    particle_mass    kg    of each particle (2D: kg/m)
    reference (d,)   m     from which moments are taken, from the lower corner
    origin (d,)      m     the lower corner in the world
    first_id               of its particles
    places (n, d)    m     where they were at first, None where nobody asks
    """

    particle_mass: float
    reference: Array
    origin: Array
    first_id: int
    places: Array | None = None


class Sampler:
    """Evaluates one sensor. `columns` and `units` name what `row` returns."""

    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    #: Time, s, of a sample that the step boundary after it completes; None: none is open.
    again_after: float | None = None
    #: Of a sampler whose samples the engine sums: the body, where there is one alone.
    summed: SummedBody | None = None

    def announce(self, moment: Moment) -> None:
        """Tell the moment what `row` will read of particles."""

    def row(self, moment: Moment) -> Sequence[float] | Array | None:
        """Return one sample; None where it goes on to the next step (`again_after`)."""
        raise NotImplementedError

    def rows(self, time: Array, tallies: Sequence[Tally], dt: Array) -> Array:
        """Return samples (n, columns) from what the engine has summed (`tallied.in_step`).

        At times (n,) s, before steps (n,) s; tallies in the order of `tallied.described`.
        """
        raise NotImplementedError

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what a resumed run needs besides the series."""
        return {}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take up what `state` returned."""


def bodies_of(scene: SceneData, body: str | None) -> list[int]:
    """Return the numbers of the bodies that a sensor asks for; None is all."""
    return [i for i, b in enumerate(scene.bodies) if body is None or b.name == body]


def in_region(region: Solid | None, points: Array, cell_size: float) -> NDArray[np.bool_]:
    """Return which points (n, d) of the scene are in a region or on its surface."""
    if region is None or len(points) == 0:
        return np.ones(len(points), dtype=np.bool_)
    # Of many points most are in none of a scene's regions: their boxes tell first.
    spare = ROUNDING * cell_size
    inside = region._in_box(points, spare)
    inside[inside] = region.distance(points[inside]) <= spare
    return inside


def column_about(place: Array, reach: float, axes: Sequence[int]) -> Box:
    """Return the column of a scene that is less than `reach` from a place along its level axes."""
    low, high = np.full(1 + len(axes), -np.inf), np.full(1 + len(axes), np.inf)
    low[list(axes)], high[list(axes)] = place - reach, place + reach
    return low, high


def axes_of(scene: SceneData) -> str:
    """Return the names of the axes."""
    return "xyz"[: scene.dimension]


def unit_in(scene: SceneData, name: str) -> str:
    """Return the unit of an attribute; in 2D what is summed is per metre of thickness."""
    found = attributes.find(name)
    unit = attributes.ENGINE[name] if found is None else found.unit
    return {"kg": "kg/m", "m³": "m²", "J": "J/m"}.get(unit, unit) if scene.dimension == 2 else unit
