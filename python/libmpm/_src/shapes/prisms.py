"""`Wedge` and `Extrusion`: polygons, in 3D drawn out along an axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.shapes.polygon import area, crossing, polygon_distance
from libmpm._src.shapes.solid import Array, Bounds, Solid, from_box, slab

__all__ = ["Extrusion", "Wedge"]


class _Prism(Solid):
    """A polygon in the plane of two axes, in 3D drawn out along the third."""

    @property
    def _corners(self) -> Array:
        """The polygon, (m, 2), m."""
        raise NotImplementedError

    @property
    def _plane(self) -> tuple[int, int]:
        """The axes of the polygon's coordinates."""
        raise NotImplementedError

    @property
    def _ends(self) -> tuple[float, float]:
        """The ends along the third axis, m."""
        raise NotImplementedError

    @cached_property
    def _third(self) -> int:
        return 3 - sum(self._plane)

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around it, m."""
        low, high = [0.0] * self.dimension, [0.0] * self.dimension
        for a, x in zip(self._plane, self._corners.T, strict=True):
            low[a], high[a] = float(x.min()), float(x.max())
        if self.dimension == 3:
            low[self._third], high[self._third] = self._ends
        return tuple(low), tuple(high)

    def volume(self) -> float:
        """Return the area of the polygon, in 3D times its length; m³, m² in 2D."""
        long = self._ends[1] - self._ends[0] if self.dimension == 3 else 1.0
        return abs(area(self._corners)) * long

    def _distance(self, p: Array) -> Array:
        u, v = (p[:, a] for a in self._plane)
        flat = polygon_distance(self._corners, u, v)
        if self.dimension == 2:
            return flat
        return from_box([flat, slab(p[:, self._third], *self._ends)])


@value
class Wedge(_Prism):
    """A box cut along the diagonal of two of its faces: a ramp, a right-angled prism.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Wedge"

    lower: Sequence[float] = given("lower corner of the box around it", unit="m", shape="(2|3,)")
    upper: Sequence[float] = given("upper corner of the box around it", unit="m", shape="(2|3,)")
    high: str = given(
        '"x-", "x+", ... : where the ramp is highest; at the opposite face it is down to nothing',
        default="x+",
        range="a face",
    )
    up: str | None = given(
        'which way is up: the ramp stands on the opposite face; None = "y+" in 2D, "z+" in 3D',
        default=None,
        range="a face",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        lower = check.given("lower", self)
        upper = check.given("upper", self)
        if lower and upper and len(lower) != len(upper):
            check.fail(
                f"lower has {len(lower)} and upper {len(upper)} numbers; expected as many as "
                "the scene has dimensions in both"
            )
            return {}
        for a, (first, last) in enumerate(zip(lower, upper, strict=False)):
            if first >= last:
                check.fail(
                    f"upper[{a}] is {last:g} with lower[{a}] {first:g}; expected upper > lower"
                )
        faces = [axis + end for axis in AXES[: len(lower) or 3] for end in "-+"]
        up = check.choice("up", f"{faces[-1]}" if self.up is None else self.up, faces)
        high = check.choice("high", self.high, faces)
        if not check.problems and up[0] == high[0]:
            check.fail(f"high is '{high}' with up '{up}'; expected faces of two different axes")
        return {"lower": lower, "upper": upper, "high": high, "up": up}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.lower)

    @property
    def _plane(self) -> tuple[int, int]:
        assert self.up is not None
        return AXES.index(self.high[0]), AXES.index(self.up[0])

    @property
    def _ends(self) -> tuple[float, float]:
        return self.lower[self._third], self.upper[self._third]

    @cached_property
    def _corners(self) -> Array:
        assert self.up is not None
        (a, b), plus = self._plane, (self.high[1] == "+", self.up[1] == "+")
        thin, thick = (self.lower[a], self.upper[a])[:: 1 if plus[0] else -1]
        foot, top = (self.lower[b], self.upper[b])[:: 1 if plus[1] else -1]
        return np.array([(thin, foot), (thick, foot), (thick, top)])


@value
class Extrusion(_Prism):
    """A profile of straight edges, in 3D drawn out along an axis.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Extrusion"

    profile: Sequence[Sequence[float]] = given(
        "corners of a polygon in either sense, n ≥ 3, that does not cross itself; a last "
        "corner equal to the first is left out. In 3D in the plane of the two other axes, "
        "in their order: (y, z), (x, z) or (x, y)",
        unit="m",
        shape="(n, 2)",
    )
    axis: str | None = given(
        '"x", "y" or "z", along which it is drawn out; left out in 2D', default=None, range="a name"
    )
    lower: float | None = given("one end along the axis; left out in 2D", default=None, unit="m")
    upper: float | None = given(
        "other end along the axis; left out in 2D", default=None, unit="m", range="> lower"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        profile = _profile(check, self.profile)
        given = [name for name in ("axis", "lower", "upper") if getattr(self, name) is not None]
        if not given:
            return {"profile": profile}
        missing = [name for name in ("axis", "lower", "upper") if name not in given]
        if missing:
            check.fail(
                f"{' and '.join(given)} without {' and '.join(missing)}; expected all of axis, "
                "lower and upper in 3D, and none of them in 2D"
            )
            return {"profile": profile}
        lower = check.given("lower", self)
        upper = check.given("upper", self)
        if upper <= lower:
            check.fail(f"upper is {upper:g} with lower {lower:g}; expected upper > lower")
        axis = check.choice("axis", self.axis, AXES)
        return {"profile": profile, "axis": axis, "lower": lower, "upper": upper}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 without and 3 with an `axis`."""
        return 2 if self.axis is None else 3

    @property
    def _plane(self) -> tuple[int, int]:
        others = [a for a in range(3) if a != AXES.index(self.axis or "z")]
        return others[0], others[1]

    @property
    def _ends(self) -> tuple[float, float]:
        assert self.lower is not None and self.upper is not None
        return self.lower, self.upper

    @cached_property
    def _corners(self) -> Array:
        return np.array(self.profile)


def _profile(check: Checker, given: Any) -> tuple[tuple[float, ...], ...]:
    items = sequence(given)
    if items is None or len(items) < 3:
        check.fail(f"profile is {shown(given)}; expected three or more corners (u, v) in m")
        return ()
    before = len(check.problems)
    corners = [check.vector(f"profile[{i}]", c, lengths=(2,), unit="m")
               for i, c in enumerate(items)]  # fmt: skip
    if len(check.problems) > before:
        return ()
    if corners[0] == corners[-1]:
        corners = corners[:-1]
    if len(corners) < 3:
        check.fail(f"profile is {shown(given)}; expected three or more corners (u, v) in m")
        return ()
    for i, (one, two) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        if one == two:
            check.fail(f"profile[{i}] and the next corner are both {one!r}; leave one out")
            return ()
    both = crossing(np.array(corners))
    if both is not None:
        check.fail(
            f"profile: its edges from {both[0]!r} and from {both[1]!r} cross or touch; expected a "
            "polygon that does not cross itself; correct the order of the corners"
        )
    elif area(np.array(corners)) == 0:
        check.fail("profile: its corners lie on one line; expected an area > 0")
    return tuple(corners)
