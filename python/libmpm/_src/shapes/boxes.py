"""`Box`, `OrientedBox` and `DomainWalls`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.shapes.oriented_boxes import TurnedBox, rotation
from libmpm._src.shapes.solid import Array, Bounds, Shape, Solid, box_distance, dot, from_box

__all__ = ["FACES", "Box", "DomainWalls", "OrientedBox", "Shape", "Solid"]
__all__ += ["check_faces", "faces_of"]

#: Face names by axis: "x-" is the face at the lower end of the first axis.
FACES = ("x-", "x+", "y-", "y+", "z-", "z+")


def faces_of(dimension: int) -> tuple[str, ...]:
    """Return the face names of a box in 2 or 3 dimensions."""
    return FACES[: 2 * dimension]


def check_faces(check: Checker, faces: Any) -> Any:
    """Return "all" or a tuple of distinct face names in their usual order."""
    if isinstance(faces, str):
        if faces == "all":
            return faces
        faces = (faces,)
    items = sequence(faces)
    if items is None or not items:
        check.fail(f"faces is {shown(faces, 80)}; expected \"all\" or names such as ('x-', 'z+')")
        return "all"
    unknown = [f for f in items if f not in FACES]
    for face in unknown:
        check.fail(f"faces has {shown(face, 80)}; expected some of {', '.join(FACES)}")
    return tuple(f for f in FACES if f in items)


def _moved(
    label: str, dimension: int, by: Sequence[float], *points: Sequence[float]
) -> list[tuple[float, ...]]:
    """Return points moved by (d,) m; raises `SceneError`."""
    check = Checker(label)
    vector = check.vector("by", by, lengths=(dimension,), unit="m")
    check.finish()
    return [tuple(x + v for x, v in zip(point, vector, strict=True)) for point in points]


@value
class Box(Solid):
    """A box with faces normal to the axes, a rectangle in 2D.

    {fields}

    Coordinates are relative to the scene's `origin`. As a body the box is used exactly; as a
    boundary its faces move to the nearest cell faces, which the plan shows. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Box"

    lower: Sequence[float] = given("corner with the smallest coordinates", unit="m", shape="(2|3,)")
    upper: Sequence[float] = given(
        "opposite corner, greater than `lower` on every axis", unit="m", shape="(2|3,)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        lower = check.given("lower", self)
        upper = check.given("upper", self)
        if lower and upper and len(lower) != len(upper):
            check.fail(
                f"lower has {len(lower)} and upper {len(upper)} numbers; expected as many as "
                "the scene has dimensions in both"
            )
        else:
            for a, (low, high) in enumerate(zip(lower, upper, strict=False)):
                if low >= high:
                    check.fail(
                        f"upper[{a}] is {high:g} with lower[{a}] {low:g}; expected upper > lower; "
                        "swap them or give the box a width"
                    )
        return {"lower": lower, "upper": upper}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.lower)

    @property
    def size(self) -> tuple[float, ...]:
        """Edge lengths in m."""
        return tuple(b - a for a, b in zip(self.lower, self.upper, strict=True))

    def bounds(self) -> Bounds:
        """Return its corners, m."""
        return tuple(self.lower), tuple(self.upper)

    def volume(self) -> float:
        """Return the product of its edges, m³ (m² in 2D)."""
        return math.prod(self.size)

    def _distance(self, p: Array) -> Array:
        return box_distance(p, self.lower, self.upper)

    @keywords_only("shapes.Box.moved", 1)
    def moved(self, by: Sequence[float]) -> Box:
        """Return the box moved by (d,) m."""
        low, high = _moved("shapes.Box", self.dimension, by, self.lower, self.upper)
        return Box(lower=low, upper=high)

    @keywords_only("shapes.Box.turned", 3)
    def turned(
        self, angle: float, axis: str | None = None, about: Sequence[float] | None = None
    ) -> OrientedBox:
        """Return the box turned by `angle` degrees; see `Solid.turned`."""
        centre = tuple(0.5 * (a + b) for a, b in zip(self.lower, self.upper, strict=True))
        box = OrientedBox(centre=centre, size=self.size, angle=angle, axis=axis)
        return box._about(about)

    def turned_box(self) -> TurnedBox:
        """Return its geometry in the form that boxes at any angle have."""
        return TurnedBox.straight(self.lower, self.upper)


@value
class OrientedBox(Solid):
    """A box turned by an angle, a turned rectangle in 2D, for bodies.

    {fields}

    A body is filled by a lattice along the box's own axes, with as many particles as an equal `Box`
    and the exact total mass; the lattice is turned in double precision, exactly at multiples of 90
    degrees. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.OrientedBox"

    centre: Sequence[float] = given(
        "middle of the box, relative to the scene's `origin`", unit="m", shape="(2|3,)"
    )
    size: Sequence[float] = given("edge lengths along its own axes, > 0", unit="m", shape="(2|3,)")
    angle: float = given(
        'by which its own axes are turned, by the right-hand rule; from x to y in 2D and about "z"',
        unit="degrees",
    )
    axis: str | None = given(
        '"x", "y" or "z"; None = "z". Left out in 2D', default=None, range="a name"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        centre = check.given("centre", self)
        size = check.given("size", self)
        if centre and size and len(centre) != len(size):
            check.fail(
                f"centre has {len(centre)} and size {len(size)} numbers; expected as many as the "
                "scene has dimensions in both"
            )
        for a, length in enumerate(size):
            if length <= 0:
                check.fail(f"size[{a}] is {length:g}; expected > 0 m; give the box a width")
        axis = self.axis
        if axis is not None and len(size) == 2:
            check.fail(
                f"axis is {shown(axis)} in 2D, where the angle is in the plane; leave it out"
            )
        elif axis is not None:
            axis = check.choice("axis", axis, AXES)
        elif len(size) == 3:
            axis = "z"
        angle = check.given("angle", self)
        return {"centre": centre, "size": size, "angle": angle, "axis": axis}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.size)

    @property
    def lower(self) -> tuple[float, ...]:
        """Lower corner of the smallest `Box` around it, m."""
        return self.turned_box().bounds()[0]

    @property
    def upper(self) -> tuple[float, ...]:
        """Upper corner of the smallest `Box` around it, m."""
        return self.turned_box().bounds()[1]

    @property
    def corners(self) -> tuple[tuple[float, ...], ...]:
        """Its 4 or 8 corners, m; the last of its own axes fastest."""
        return tuple(self.turned_box().corners())

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around it, m."""
        return self.turned_box().bounds()

    def volume(self) -> float:
        """Return the product of its edges, m³ (m² in 2D)."""
        return math.prod(self.size)

    def _distance(self, p: Array) -> Array:
        box = self.turned_box()
        away = [x - c for x, c in zip(p.T, box.centre, strict=True)]
        return from_box([np.abs(dot(away, box.own(a))) - 0.5 * s for a, s in enumerate(self.size)])

    @keywords_only("shapes.OrientedBox.moved", 1)
    def moved(self, by: Sequence[float]) -> OrientedBox:
        """Return the box moved by (d,) m."""
        (centre,) = _moved("shapes.OrientedBox", self.dimension, by, self.centre)
        return dataclasses.replace(self, centre=centre)

    @keywords_only("shapes.OrientedBox.turned", 3)
    def turned(
        self, angle: float, axis: str | None = None, about: Sequence[float] | None = None
    ) -> Solid:
        """Return the box turned by `angle` degrees; see `Solid.turned`."""
        if self.dimension == 3 and (axis or "z") != self.axis:
            return super().turned(angle, axis, self.centre if about is None else about)
        by = dataclasses.replace(self, angle=angle, axis=axis)._about(about)
        return dataclasses.replace(by, angle=self.angle + by.angle)

    def _about(self, fulcrum: Sequence[float] | None) -> OrientedBox:
        """Return the box with its centre carried round a fulcrum by its angle."""
        if fulcrum is None:
            return self
        (back,) = _moved(self.label, self.dimension, fulcrum, (0.0,) * self.dimension)
        away = [c - f for c, f in zip(self.centre, back, strict=True)]
        rows = rotation(self.dimension, self.angle, self.axis)
        centre = tuple(
            f + sum(r * x for r, x in zip(row, away, strict=True))
            for f, row in zip(back, rows, strict=True)
        )
        return dataclasses.replace(self, centre=centre)

    def turned_box(self) -> TurnedBox:
        """Return its geometry in the form that boxes at any angle have."""
        axes = rotation(self.dimension, self.angle, self.axis)
        return TurnedBox(tuple(self.centre), tuple(self.size), axes)


@value
class DomainWalls(Shape):
    """Walls on faces of the scene's domain, impermeable exactly at `Scene.lower` and `upper`.

    {fields}

    Through a face without a wall
    particles leave the domain; `Method.leaving` says what happens then. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.DomainWalls"

    faces: Literal["all"] | Sequence[str] = given(
        '"all", or some of "x-", "x+", "y-", "y+", "z-", "z+"', default="all"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        return {"faces": check_faces(check, self.faces)}
