"""`PlacedForce`: a force by mass that depends on the place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arrays import real_array
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, shown, value

__all__ = ["PlacedForce"]


@value
class PlacedForce(Value):
    """A force by mass besides gravity, linear between places along an axis.

    Before the first place and after the last one their values hold. Nodes take it from the
    particles, where they stand at the beginning of a step, and particles from the nodes:
    fᵢ = Σ m Nᵢ b(x). It is no part of the potential energy that sensors report.

    {fields}

    On the CPU. Raises `SceneError`.
    """

    label: ClassVar[str] = "PlacedForce"

    axis: Literal["x", "y", "z"] = given('"x", "y" or "z": along which it changes')
    place: Sequence[float] = given("strictly increasing, n ≥ 1", unit="m", shape="(n,)")
    value: Sequence[Sequence[float]] = given(
        "acceleration at these places", unit="m/s²", shape="(n,d)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        axis = check.choice("axis", self.axis, ("x", "y", "z"))
        place, rows = _array(check, "place", self.place, 1), _array(check, "value", self.value, 2)
        if check.problems:
            return {}
        if len(place) != len(rows):
            check.fail(f"value has {len(rows)} rows, place {len(place)}; expected as many")
        elif (np.diff(place) <= 0).any():
            check.fail(f"place is {shown(self.place)}; expected strictly increasing metres")
        elif rows.shape[1] not in (2, 3):
            check.fail(f"value has {rows.shape[1]} components; expected those of the scene, 2 or 3")
        return {
            "axis": axis,
            "place": tuple(place.tolist()),
            "value": tuple(tuple(row) for row in rows.tolist()),
        }

    def specification(self, lower: Sequence[float]) -> dict[str, Any]:
        """Return the engine's specification; places count from the domain's lower corner."""
        axis = "xyz".index(self.axis)
        return {
            "axis": axis,
            "place": np.asarray(self.place) - lower[axis],
            "value": np.asarray(self.value),
        }


def _array(check: Checker, name: str, given: Any, axes: int) -> npt.NDArray[np.float64]:
    try:
        array = real_array(given, name)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if array.ndim != axes or array.size == 0 or not np.isfinite(array).all():
        expected = "(n,) places" if axes == 1 else "(n, d) rows"
        check.fail(f"{name} is {shown(given)}; expected {expected} of finite numbers")
    return array
