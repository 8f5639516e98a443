"""`Sphere`, `Cylinder`, `Cone`, `HalfSpace`, with an exact signed distance in closed form.

That of a solid of revolution is the distance in the plane of its section through the axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.shapes.polygon import polygon_distance
from libmpm._src.shapes.solid import (
    Array,
    Bounds,
    Corner,
    Solid,
    dot,
    from_box,
    length,
    slab,
    unit,
)

__all__ = ["Cone", "Cylinder", "HalfSpace", "Sphere"]


@value
class Sphere(Solid):
    """A ball; a disc in 2D.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Sphere"

    centre: Sequence[float] = given(
        "middle, relative to the scene's `origin`", unit="m", shape="(2|3,)"
    )
    radius: float = given("radius", unit="m", above=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "centre": check.given("centre", self),
            "radius": _radius(check, "radius", self.radius),
        }

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.centre)

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around it, m."""
        return (
            tuple(x - self.radius for x in self.centre),
            tuple(x + self.radius for x in self.centre),
        )

    def volume(self) -> float:
        """Return 4/3 π r³ in m³; π r² in 2D."""
        r = self.radius
        return math.pi * r * r if self.dimension == 2 else 4.0 / 3.0 * math.pi * r * r * r

    def _distance(self, p: Array) -> Array:
        away = [x - c for x, c in zip(p.T, self.centre, strict=True)]
        return np.asarray(length(away) - self.radius)


class _AboutAxis(Solid):
    """A solid of revolution about the line from `start` to `end`, in 3D."""

    start: Sequence[float]
    end: Sequence[float]

    def _ends(self, check: Checker, instead: str) -> dict[str, Any]:
        ends = {name: _ends_3d(check, name, getattr(self, name), instead)
                for name in ("start", "end")}  # fmt: skip
        if ends["start"] and ends["start"] == ends["end"]:
            check.fail(f"start and end are both {ends['start']!r}; expected apart, as they give "
                       "the axis")  # fmt: skip
        return ends

    @property
    def dimension(self) -> int:
        """Number of axes, 3."""
        return 3

    @cached_property
    def height(self) -> float:
        """Length of the axis, m."""
        return math.dist(self.start, self.end)

    @cached_property
    def _axis(self) -> Corner:
        return unit([b - a for a, b in zip(self.start, self.end, strict=True)])

    def _along_and_across(self, p: Array) -> tuple[Array, Array]:
        """Return the place of points along the axis from `start`, and their distance from it."""
        away = [x - c for x, c in zip(p.T, self.start, strict=True)]
        along = dot(away, self._axis)
        return along, length([x - along * e for x, e in zip(away, self._axis, strict=True)])

    def _discs(self, first: float, last: float) -> Bounds:
        """Return the bounds of two discs across the axis at its ends."""
        reach = [math.sqrt(max(0.0, 1.0 - e * e)) for e in self._axis]
        ends = list(zip(self.start, self.end, reach, strict=True))
        return (
            tuple(min(a - first * r, b - last * r) for a, b, r in ends),
            tuple(max(a + first * r, b + last * r) for a, b, r in ends),
        )


@value
class Cylinder(_AboutAxis):
    """A circular cylinder about any axis, in 3D.

    {fields}

    In 2D take a `Sphere` for a section across it, an `OrientedBox` for one along it. Raises
    `SceneError`.
    """

    label: ClassVar[str] = "shapes.Cylinder"

    start: Sequence[float] = given(
        "middle of one end, relative to the scene's `origin`", unit="m", shape="(3,)"
    )
    end: Sequence[float] = given("middle of the other end", unit="m", shape="(3,)")
    radius: float = given("radius", unit="m", above=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        ends = self._ends(check, "a Sphere (across it) or an OrientedBox (along it)")
        return ends | {"radius": _radius(check, "radius", self.radius)}

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around it, m."""
        return self._discs(self.radius, self.radius)

    def volume(self) -> float:
        """Return π r² h, m³."""
        return math.pi * self.radius**2 * self.height

    def _distance(self, p: Array) -> Array:
        along, across = self._along_and_across(p)
        return from_box([slab(along, 0.0, self.height), across - self.radius])


@value
class Cone(_AboutAxis):
    """A circular cone or truncated cone about any axis, in 3D.

    {fields}

    In 2D take an `Extrusion` of its section. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Cone"

    start: Sequence[float] = given(
        "middle of the first end, relative to the scene's `origin`", unit="m", shape="(3,)"
    )
    end: Sequence[float] = given(
        "middle of the other end: the tip where `end_radius` is 0", unit="m", shape="(3,)"
    )
    radius: float = given("radius at `start`", unit="m", above=0)
    end_radius: float = given("radius at `end`", default=0.0, unit="m", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return self._ends(check, "an Extrusion of its section") | {
            "radius": _radius(check, "radius", self.radius),
            "end_radius": check.given("end_radius", self),
        }

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around it, m."""
        return self._discs(self.radius, self.end_radius)

    def volume(self) -> float:
        """Return π h (r² + r s + s²) / 3 with the radii r and s, m³."""
        r, s = self.radius, self.end_radius
        return math.pi * self.height * (r * r + r * s + s * s) / 3.0

    @cached_property
    def _profile(self) -> Array:
        """Its section through the axis: the nearest point lies in the plane of point and axis."""
        r, s, h = self.radius, self.end_radius, self.height
        top = [(s, h), (-s, h)] if s > 0 else [(0.0, h)]
        return np.array([(-r, 0.0), (r, 0.0), *top])

    def _distance(self, p: Array) -> Array:
        along, across = self._along_and_across(p)
        return polygon_distance(self._profile, across, along)


@value
class HalfSpace(Solid):
    """Everything on one side of a plane (of a line in 2D), without end.

    {fields}

    A body of it needs a `Box` around: `HalfSpace(...) & Box(...)`. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.HalfSpace"

    point: Sequence[float] = given(
        "any point of the plane, relative to the scene's `origin`", unit="m", shape="(2|3,)"
    )
    normal: Sequence[float] = given(
        "points out of the solid; any length but 0", unit="1", shape="(2|3,)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        point = check.given("point", self)
        normal = check.given("normal", self)
        if point and normal and len(point) != len(normal):
            check.fail(
                f"point has {len(point)} and normal {len(normal)} numbers; expected as many as "
                "the scene has dimensions in both"
            )
        if normal and not any(normal):
            check.fail("normal is zero; expected a direction that points out of the solid")
        return {"point": point, "normal": normal}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.point)

    @cached_property
    def _unit(self) -> Corner:
        return unit(self.normal)

    def bounds(self) -> Bounds:
        """Return the ends: finite on the one axis that the normal follows, ±inf elsewhere."""
        low, high = [-math.inf] * self.dimension, [math.inf] * self.dimension
        along = [a for a, n in enumerate(self.normal) if n]
        if len(along) == 1:
            a = along[0]
            (high if self.normal[a] > 0 else low)[a] = self.point[a]
        return tuple(low), tuple(high)

    def volume(self) -> float:
        """Return inf."""
        return math.inf

    def _distance(self, p: Array) -> Array:
        return dot([x - c for x, c in zip(p.T, self.point, strict=True)], self._unit)


def _radius(check: Checker, name: str, given: Any) -> float:
    return check.number(name, given, lower=0, lower_open=True, unit="m")


def _ends_3d(check: Checker, name: str, given: Any, instead: str) -> tuple[float, ...]:
    items = sequence(given)
    if items is not None and len(items) == 2:
        check.fail(f"{name} is {shown(given)}, in 2D; expected 3 numbers in m; in 2D use {instead}")
        return ()
    return check.vector(name, given, lengths=(3,), unit="m")
