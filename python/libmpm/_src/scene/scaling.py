"""`Scene.scaled`: Froude and Froude-Cauchy scaling, driven by the declared unit of every field.

Materials bring theirs in a table. A field without a declaration cannot be scaled.
"""

from __future__ import annotations

import ast
import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import FIXED, OWNER, TEXT, declared
from libmpm._src.base.formulas import Field
from libmpm._src.base.values import Checker, Value, shown
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import Material
from libmpm._src.scene.data import HEAD, SceneData
from libmpm._src.scene.scene_file import SceneReader

__all__ = ["HALF_POWERS", "OUTSIDE", "VOLUME", "Scaling", "scale_scene"]

S = TypeVar("S", bound=SceneData)

#: Unit of a volume: m³, of which a plane scene has m².
VOLUME = "mᵈ"

#: Unit of an inertia: kg·m², in a plane scene of a metre's thickness.
INERTIA = "kg·m²"

#: Twice the power of the length ratio λ that a quantity takes where density and gravity stay:
#: m → λ, s → λ^½, kg → λ³.
HALF_POWERS: dict[str, int] = {
    TEXT: 0, "1": 0, "%": 0, "°": 0, "degrees": 0, "rad": 0, "cells": 0,
    "m": 2, "m²": 4, "m³": 6, "m³/s": 5, "m²/s": 3, "1/m": -2,
    "s": 1, "1/s": -1, "rad/s": -1, "°/s": -1, "m/s": 1, "m/s²": 0, "rad/s²": -2,
    "kg": 6, "kg/m": 4, "kg/m³": 0, "N": 6, "N/m": 4, "J": 8, "kg·m²": 10, "Pa": 2, "Pa/s": 1,
}  # fmt: skip

#: Values that never are part of a scene: recipes that make bodies, and ratios.
OUTSIDE = frozenset(
    {
        "DebrisField", "Froude", "Guard", "Partition", "Piece", "Placement", "Prototype",
        "SpreadAngles", "UniformAngles",
    }
)  # fmt: skip


@dataclass(frozen=True)
class Scaling:
    """What a length ratio makes of every quantity, with density and gravity kept.

    Lengths × λ, velocities and times × λ^½, masses and forces × λ³, stresses that are given as
    loads or states × λ. Of materials, what is in Pa is × λ with `cauchy` and stays without; what is
    in Pa·s is × λ^1.5 with `reynolds` and stays without (Pa·sⁿ: × λ^(1 + n/2)).

    Kept are Froude's number v/√(gL) always, Cauchy's ρv²/K with `cauchy` (else × λ), Reynolds'
    ρvL/μ with `reynolds` (else × λ^1.5). Of a plane scene, `dimension` 2, masses and forces are per
    metre of thickness and × λ². Source: Bonus (2023) 7.2, 7.3.
    """

    length_ratio: float
    cauchy: bool = False
    reynolds: bool = False
    dimension: int = 3

    def __post_init__(self) -> None:
        """Check the ratio; raises `SceneError`."""
        check = Checker("Scene.scaled")
        ratio = check.number(
            "length_ratio", self.length_ratio, lower=0, lower_open=True,
            remedy="new length over old one, 0.1 for a model at 1:10",
        )  # fmt: skip
        for name in ("cauchy", "reynolds"):
            if not isinstance(getattr(self, name), bool):
                check.fail(f"{name} is {getattr(self, name)!r}; expected True or False")
        check.finish()
        object.__setattr__(self, "length_ratio", ratio)

    def power(self, half: float) -> float:
        """Return λ^(half/2); exact where λ is a power of four."""
        found: float = math.sqrt(self.length_ratio) ** half
        return found

    def factor(self, unit: str) -> float:
        """Return the factor of a quantity in `unit`, one of `HALF_POWERS`."""
        if unit == VOLUME:
            return self.power(2 * self.dimension)
        if unit == INERTIA:
            return self.power(2 * (self.dimension + 2))
        return self.power(HALF_POWERS[unit])

    def material(self, unit: str, index: float = 1.0) -> float:
        """Return the factor of a material's parameter; `index` is n where the unit is Pa·sⁿ."""
        if unit == "Pa":
            return self.factor("Pa") if self.cauchy else 1.0
        if unit in ("Pa·s", "Pa·sⁿ"):
            n = 1.0 if unit == "Pa·s" else index
            return self.power(2 + n) if self.reynolds else 1.0
        return self.factor(unit)

    def ratios(self) -> dict[str, float]:
        """Return new over old of the common quantities and groups."""
        modulus, viscosity = self.material("Pa"), self.material("Pa·s")
        return {
            "length": self.factor("m"),
            "velocity": self.factor("m/s"),
            "time": self.factor("s"),
            "mass": self.factor("kg") if self.dimension == 3 else self.factor("kg/m"),
            "force": self.factor("N") if self.dimension == 3 else self.factor("N/m"),
            "pressure": self.factor("Pa"),
            "moduli and strengths": modulus,
            "viscosity": viscosity,
            "Froude number": 1.0,
            "Cauchy number": self.factor("Pa") / modulus,
            "Reynolds number": self.power(3) / viscosity,
        }

    def __str__(self) -> str:
        """Return the ratios as a table."""
        kind = "Froude-Cauchy" if self.cauchy else "Froude"
        lines = [f"{kind} scaling by {self.length_ratio:g}: new over old"]
        lines += [f"  {name:<21} {ratio:.6g}" for name, ratio in self.ratios().items()]
        return "\n".join(lines)

    # Values ----------------------------------------------------------------------------------

    def value(self, item: Value, unit: str = TEXT) -> Any:
        """Return a value with every field scaled; `unit` is that of a table's or formula's rows."""
        if isinstance(item, Field):
            made = [_scaled_formula(c, self.length_ratio, self.factor(unit)) for c in _texts(item)]
            return Field(components=made)
        if isinstance(item, Material):
            return self._material(item)
        kind = type(item).__name__
        known = {name: says.scaled_as for name, says in declared(type(item)).items()}
        changed = {}
        for field in dataclasses.fields(item):  # type: ignore[arg-type]
            if field.name not in known:
                raise SceneError(
                    f"Scene.scaled: the unit of {kind}.{field.name} is not known; expected a "
                    "declaration of the field by libmpm._src.base.declarations.given; add it, or "
                    "leave the value out"
                )
            own = unit if known[field.name] == OWNER else known[field.name]
            changed[field.name] = self.item(getattr(item, field.name), own, f"{kind}.{field.name}")
        return type(item)(**changed)

    def item(self, item: Any, unit: str, label: str) -> Any:
        """Return a number, a value, or a list or mapping of them, scaled."""
        if isinstance(item, Value):
            return self.value(item, unit)
        if isinstance(item, Mapping):
            return {key: self.item(one, unit, label) for key, one in item.items()}
        if isinstance(item, list | tuple):
            return tuple(self.item(one, unit, label) for one in item)
        if item is None or isinstance(item, str | bool) or callable(item):
            if unit == FIXED and item is not None:
                raise SceneError(
                    f"Scene.scaled: {label} is {shown(item)}, a file with its own lengths; "
                    "expected a scene without one; scale the scene that wrote it, or "
                    "give the geometry as values"
                )
            return item
        whole = isinstance(item, int) or (isinstance(item, np.ndarray) and item.dtype.kind in "iu")
        if whole and HALF_POWERS.get(unit) == 0:
            return item
        if unit == TEXT:
            raise SceneError(
                f"Scene.scaled: {label} is {shown(item)} and has no unit; expected one in its "
                "declaration by libmpm._src.base.declarations.given"
            )
        return item * self.factor(unit)

    def _material(self, item: Material) -> Material:
        have = item.parameters()
        index = have.get("index", 1.0)
        scaled: dict[str, Any] = {
            p.name: have[p.name] * self.material(p.unit, index) for p in item.table.parameters
        }
        # What a material has beside its table, as Rigid its inertia.
        for name, says in declared(type(item)).items():
            if name not in scaled:
                label = f"{type(item).__name__}.{name}"
                scaled[name] = self.item(getattr(item, name), says.scaled_as, label)
        return dataclasses.replace(item, **scaled)  # type: ignore[type-var]

    # Scenes ----------------------------------------------------------------------------------

    def scene(self, scene: S) -> S:
        """Return the scene with everything scaled; raises `SceneError`."""
        if scene.start is not None:
            raise SceneError(
                f"Scene.scaled: the scene continues from {scene.start.checkpoint}, whose particles "
                "cannot be scaled; expected a scene that does not; scale the scene that wrote the "
                "checkpoint, run it, and continue from there"
            )
        if scene.dimension != self.dimension:
            return dataclasses.replace(self, dimension=scene.dimension).scene(scene)
        data = scene.to_dict()
        for key in HEAD:
            if key in data:
                made = self.item(getattr(scene, key), HEAD[key].scaled_as, f"Scene.{key}")
                data[key] = made.to_dict() if isinstance(made, Value) else made
        for kind, parts in scene._parts().items():
            made = [self.value(part).to_dict() for part in parts]
            data[kind] = [{k: v for k, v in part.items() if k != "type"} for part in made]
        return SceneReader(type(scene), data).read()


def scale_scene(
    scene: S, length_ratio: float, *, cauchy: bool = False, reynolds: bool = False
) -> S:
    """Return the scene in similitude; see `Scene.scaled`."""
    return Scaling(length_ratio, cauchy, reynolds).scene(scene)


# Formulas of coordinates -------------------------------------------------------------------------


def _texts(field: Field) -> tuple[str, ...]:
    return tuple(field.components)


def _scaled_formula(text: str, length: float, factor: float) -> str:
    """Return f · formula(x/λ, y/λ, z/λ) as a formula of the same grammar."""
    tree = _Coordinates(length).visit(ast.parse(text.strip(), mode="eval").body)
    return ast.unparse(_times(tree, factor))


def _number(node: ast.AST) -> float | None:
    """Return a plain number; None of anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    return None


def _rounded(number: float) -> float:
    """Return 1 for what is 1 to rounding, so that scaling there and back leaves no factor."""
    return 1.0 if abs(number - 1) < 1e-12 else number


class _Coordinates(ast.NodeTransformer):
    """Replaces x by x / λ, and x / a by x / (a λ)."""

    def __init__(self, length: float) -> None:
        self._length = length

    def _over(self, name: ast.expr, number: float) -> ast.expr:
        number = _rounded(number)
        return name if number == 1 else ast.BinOp(name, ast.Div(), ast.Constant(number))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._over(node, self._length) if node.id in AXES else node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        # The function's own name is no coordinate.
        node.args = [self.visit(argument) for argument in node.args]
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        below = _number(node.right)
        if (
            isinstance(node.op, ast.Div)
            and isinstance(node.left, ast.Name)
            and node.left.id in AXES
            and below is not None
        ):
            return self._over(node.left, below * self._length)
        self.generic_visit(node)
        return node


def _times(node: ast.expr, factor: float) -> ast.expr:
    """Return factor · node, taken into a leading number where there is one."""
    number = _number(node)
    if number is not None:
        return ast.Constant(number * factor)
    if factor == 1:
        return node
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        leading = _number(node.left)
        if leading is not None:
            return _times(node.right, _rounded(leading * factor))
    return ast.BinOp(ast.Constant(factor), ast.Mult(), node)
