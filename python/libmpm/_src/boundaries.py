"""How a boundary acts on material that touches it.

v is the velocity relative to the boundary, n the normal that points into the material.
"""

from __future__ import annotations

from typing import Any, ClassVar

from libmpm._src.values import Checker, Value, value

__all__ = ["Response", "Separable", "Slip", "Sticky"]


class Response(Value):
    """Base of all boundary responses."""

    #: Name of the response in the engine.
    kind: ClassVar[str]

    @property
    def friction(self) -> tuple[float, float]:
        """Static and dynamic coefficient of Coulomb friction."""
        return (0.0, 0.0)


@value
class Sticky(Response):
    """No relative motion at all: v = 0."""

    label: ClassVar[str] = "boundaries.Sticky"
    kind: ClassVar[str] = "sticky"


@value
class Slip(Response):
    """No relative motion along the normal, free along the face: v·n = 0.

    Material cannot come off such a face; use `Separable` where it may, or with friction.
    """

    label: ClassVar[str] = "boundaries.Slip"
    kind: ClassVar[str] = "slip"


@value
class Separable(Response):
    """Material may leave but not enter: v·n ≥ 0, with Coulomb friction while pressed on.

    =================  ====  =====  ===================================================
    parameter          unit  range  meaning
    =================  ====  =====  ===================================================
    static_friction    1     ≥ 0    sticks while tangential ≤ static · normal impulse
    dynamic_friction   1     ≥ 0    tangential = dynamic · normal impulse while sliding
    =================  ====  =====  ===================================================

    The static coefficient may not be below the dynamic one. Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Separable"
    kind: ClassVar[str] = "separable"

    static_friction: float = 0.0
    dynamic_friction: float = 0.0

    def _check(self, check: Checker) -> dict[str, Any]:
        remedy = "friction opposes sliding; use 0 for a smooth face"
        found = {
            name: check.number(name, getattr(self, name), lower=0, remedy=remedy)
            for name in ("static_friction", "dynamic_friction")
        }
        if found["static_friction"] < found["dynamic_friction"]:
            check.fail(
                f"static_friction is {found['static_friction']:g} with dynamic_friction "
                f"{found['dynamic_friction']:g}; expected static ≥ dynamic, or sliding would be "
                "harder than starting to slide; raise static_friction"
            )
        return found

    @property
    def friction(self) -> tuple[float, float]:
        """Static and dynamic coefficient of Coulomb friction."""
        return (self.static_friction, self.dynamic_friction)
