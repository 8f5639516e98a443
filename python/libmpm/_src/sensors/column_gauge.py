"""`ColumnGauge`: weighs the particles of a column by a hat: twice the height of their centre."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, shown, value
from libmpm._src.sensors.engine_sensors import check_interval
from libmpm._src.sensors.python_sensors import Sampled

__all__ = ["ColumnGauge"]


@value
class ColumnGauge(Sampled):
    """Level of the material over a place, and its mean velocity, from hat-weighted particles.

    {fields}

    Columns "level", m in the world, "velocity_x" and so on, m/s:

        level = bed + 2 (Σ w h / Σ w), velocity = Σ w v / Σ w,
        w = m max(0, 1 - |x - x_g| / l), a product of hats with two horizontal axes,

    with the height h of a particle above the bed. That is the surface of water that stands on the
    bed without gaps; a hollow below a deck or a jet above it counts as it weighs. Without a
    `position` it is h_eq, the depth at which the body would be of one depth: 2 Σ m h / Σ m. Not-a-
    number where nothing is in reach. A sample reads masses, positions and velocities of the bodies.
    Raises `SceneError`.

    Source: Yang (2016) 5.1, eq. 5.1, and 5.2, where w is printed without the modulus.
    """

    label: ClassVar[str] = "sensors.ColumnGauge"
    kind: ClassVar[str] = "column-gauge"

    position: Sequence[float] | None = given(
        "horizontal place: every axis but that of gravity, in order; None = all particles "
        "count alike",
        default=None,
        unit="m",
        shape="(1|2,)",
    )
    width: float | None = given(
        "half width l of the hat; None = 1 cell", default=None, unit="m", above=0
    )
    bed: float | None = given(
        "where the column stands; None = lower end of the domain along gravity",
        default=None,
        unit="m",
        range="level",
        remedy="give the level of the bed",
    )
    body: str | None = given(
        "the body whose particles count; None = all", default=None, range="a name"
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        width, bed, place = self.width, self.bed, self.position
        if place is not None:
            place = check.given("position", self, place)
        elif width is not None:
            check.fail(
                f"width is {shown(width)} without a position, where all particles count "
                "alike; leave it "
                "out or give a position"
            )
        if width is not None:
            width = check.given("width", self, width)
        if bed is not None:
            bed = check.given("bed", self, bed)
        return {
            "position": place,
            "width": width,
            "bed": bed,
            "body": None if self.body is None else check.text("body", self.body),
            "interval": check_interval(check, self.interval),
        }
