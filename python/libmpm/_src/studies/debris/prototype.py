"""What a field is made of: prototypes, and the pieces placed after them."""

from __future__ import annotations

from typing import Any, ClassVar

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import Material

__all__ = ["MOST_PIECES", "Piece", "Prototype", "check_prototypes"]

#: Pieces of a field: every two are compared.
MOST_PIECES = 5_000


@value
class Prototype(Value):
    """A kind of debris: a rectangular prism of one material.

    {fields}

    The set 𝔻 = {ρ, E, A, L} of Bonus (2023) 10.1 is in material, width, height and length. Raises
    `SceneError`.
    """

    label: ClassVar[str] = "debris.Prototype"

    length: float = given("edge that the angle of a piece refers to", unit="m", above=0)
    width: float = given("horizontal edge across it", unit="m", above=0)
    height: float = given("vertical edge", unit="m", above=0)
    material: Material = given("a value of `libmpm.materials`", range="material")
    name: str = given("for tables and legends", default="debris", range="text")
    particles_per_cell: int | None = given(
        "None = 2 per axis", default=None, unit="1", low=1, whole=True
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("material", self.material, (Material,), "a value of libmpm.materials")
        found: dict[str, Any] = {
            edge: check.number(edge, getattr(self, edge), lower=0, lower_open=True, unit="m")
            for edge in ("length", "width", "height")
        }
        if self.particles_per_cell is not None:
            number = check.given("particles_per_cell", self)
            found["particles_per_cell"] = number
        return found | {"name": check.text("name", self.name)}

    @property
    def plan_area(self) -> float:
        """Length × width, m²."""
        return self.length * self.width

    @property
    def cross_section(self) -> float:
        """Width × height, m²: the A of the debris set, which a bar hits head-on with."""
        return self.width * self.height

    @property
    def mass(self) -> float:
        """Mass of one piece, kg."""
        return float(self.material.parameters()["density"] * self.plan_area * self.height)


@value
class Piece(Value):
    """A piece of debris in a field.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "debris.Piece"

    prototype: int = given(
        "number of its prototype in the field", default=0, unit="1", low=0, whole=True
    )
    x: float = given("middle of its plan, along the flow", unit="m")
    y: float = given("middle of its plan, across the flow", unit="m")
    angle: float = given(
        "of the long edge against x, counterclockwise", default=0.0, unit="degrees"
    )
    elevation: float = given("of the bottom above that of the field", default=0.0, unit="m")

    def _check(self, check: Checker) -> dict[str, Any]:
        found: dict[str, Any] = {"prototype": check.given("prototype", self)}
        for name, unit in (("x", "m"), ("y", "m"), ("angle", "degrees"), ("elevation", "m")):
            found[name] = check.number(name, getattr(self, name), unit=unit)
        return found


def check_prototypes(label: str, given: Any) -> tuple[Prototype, ...]:
    """Return one prototype or several as a tuple; raises `SceneError`."""
    items = [given] if isinstance(given, Prototype) else sequence(given)
    if not items or not all(isinstance(p, Prototype) for p in items):
        raise SceneError(
            f"{label}: prototypes is {shown(given)}; expected a debris.Prototype, or several"
        )
    return tuple(items)
