"""What a field is made of: prototypes, and the pieces placed after them."""

from __future__ import annotations

from typing import Any, ClassVar

from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import Material

__all__ = ["Piece", "Prototype", "check_prototypes"]


@value
class Prototype(Value):
    """A kind of debris: a rectangular prism of one material.

    ==================  ====  ========  ========================================================
    parameter           unit  range     meaning
    ==================  ====  ========  ========================================================
    length              m     > 0       edge that the angle of a piece refers to
    width               m     > 0       horizontal edge across it
    height              m     > 0       vertical edge
    material            -     material  a value of `libmpm.materials`
    name                -     text      for tables and legends
    particles_per_cell  1     ≥ 1       None = 2 per axis
    ==================  ====  ========  ========================================================

    The set 𝔻 = {ρ, E, A, L} of Bonus (2023) 10.1 is in material, width, height and length. Raises
    `SceneError`.
    """

    label: ClassVar[str] = "debris.Prototype"

    length: float
    width: float
    height: float
    material: Material
    name: str = "debris"
    particles_per_cell: int | None = None

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("material", self.material, (Material,), "a value of libmpm.materials")
        found: dict[str, Any] = {
            edge: check.number(edge, getattr(self, edge), lower=0, lower_open=True, unit="m")
            for edge in ("length", "width", "height")
        }
        if self.particles_per_cell is not None:
            number = check.integer("particles_per_cell", self.particles_per_cell, lower=1)
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

    =========  =======  =====  ==================================================================
    parameter  unit     range  meaning
    =========  =======  =====  ==================================================================
    prototype  1        ≥ 0    number of its prototype in the field
    x, y       m        -      middle in the plan; x is along the flow
    angle      degrees  -      of the long edge against x, counterclockwise
    elevation  m        -      of the bottom above that of the field
    =========  =======  =====  ==================================================================

    Raises `SceneError`.
    """

    label: ClassVar[str] = "debris.Piece"

    prototype: int = 0
    x: float
    y: float
    angle: float = 0.0
    elevation: float = 0.0

    def _check(self, check: Checker) -> dict[str, Any]:
        found: dict[str, Any] = {"prototype": check.integer("prototype", self.prototype)}
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
