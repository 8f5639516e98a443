"""`Material`: what every law has, by the table in the compiled core.

The table gives name, symbol, unit, default, range and meaning of every parameter. Validation,
messages and documentation are derived from it; `materials_generated.py` holds the classes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from libmpm._src.base.values import Checker, Value

__all__ = ["Column", "Entry", "Material", "Parameter", "flows_at_constant_volume"]
__all__ += ["wave_speed"]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of a material: SI unit, default (None = required) and range."""

    name: str
    symbol: str
    unit: str
    default: float | None
    lower: float
    upper: float
    lower_open: bool
    upper_open: bool
    meaning: str

    @property
    def range(self) -> str:
        """The range in words of mathematics, for instance ``> 0``."""
        parts = []
        if self.lower > -math.inf:
            parts.append(f"{'>' if self.lower_open else '≥'} {self.lower:g}")
        if self.upper < math.inf:
            parts.append(f"{'<' if self.upper_open else '≤'} {self.upper:g}")
        return ", ".join(parts) or "any"


@dataclass(frozen=True, kw_only=True)
class Column:
    """One quantity that a material stores on each of its particles."""

    name: str
    components: int
    meaning: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class Entry:
    """The table entry of a material."""

    name: str
    summary: str
    source: str
    needs: str
    columns: tuple[Column, ...]
    fbar: bool
    parameters: tuple[Parameter, ...]

    @property
    def stores_volume(self) -> bool:
        """Whether particles carry a volume ratio (and no deformation gradient)."""
        return self.needs == "volume"


#: What a range alone does not tell a user, by parameter.
_REMEDIES = {
    "density": "densities are in kg/m³, 1000 for water",
    "poissons_ratio": (
        "at 0.5 the solid is incompressible: its bulk modulus E/(3(1 - 2ν)) and its wave speed "
        "are infinite, so no time step is small enough; use 0.49 or less"
    ),
    "youngs_modulus": "give it in Pa, for instance 1e9 for wood",
    "bulk_modulus": "give it in Pa, 2.2e9 for water; less is softer and allows longer time steps",
    "exponent": "water has 7.15",
    "consistency": "give it in Pa·sⁿ; with index=1 it is the plastic viscosity in Pa·s",
    "index": "1 is a Bingham fluid; muds have 0.3 to 1",
    "largest_viscosity": (
        "ten to a hundred times the viscosity where it flows; more needs shorter steps"
    ),
    "viscosity": "give it in Pa·s, 0.001 for water, 0 for none",
}


class Material(Value):
    """Base of all materials. `table` holds the entry of the compiled core."""

    table: ClassVar[Entry]
    #: Whether the law was compiled at run time (`materials.from_header`).
    added: ClassVar[bool] = False

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            p.name: check.number(
                p.name,
                getattr(self, p.name),
                lower=p.lower,
                upper=p.upper,
                lower_open=p.lower_open,
                upper_open=p.upper_open,
                unit=p.unit,
                remedy=_REMEDIES.get(p.name, ""),
            )
            for p in self.table.parameters
        }

    def parameters(self) -> dict[str, float]:
        """Return every parameter by name, in SI units."""
        return {p.name: getattr(self, p.name) for p in self.table.parameters}

    def core_parameters(self, dimension: int) -> dict[str, float]:
        """Return every parameter as the compiled core takes it in 2 or 3 dimensions, SI units."""
        return self.parameters()


#: Laws that flow and keep the volume as they do.
_ISOCHORIC = ("VonMises",)


def flows_at_constant_volume(material: Material) -> bool:
    """Tell whether a law flows and keeps its volume, so that linear elements lock as it does."""
    return material.table.name in _ISOCHORIC and not material.added


def wave_speed(material: Material) -> float | None:
    """Return the speed of the fastest small wave in m/s, or None if it is not known here.

    Fluids: c₀ = √(K/ρ). Solids: c = √(E(1 - ν) / ((1 + ν)(1 - 2ν)ρ)), the pressure wave.
    """
    try:
        return _wave_speed(material.parameters())
    except ZeroDivisionError:
        return math.inf  # a density so small that products with it are zero


def _wave_speed(have: Mapping[str, float]) -> float | None:
    density = have["density"]
    if "bulk_modulus" in have:
        return math.sqrt(have["bulk_modulus"] / density)
    if "youngs_modulus" in have and "poissons_ratio" in have:
        e, nu = have["youngs_modulus"], have["poissons_ratio"]
        return math.sqrt(e * (1 - nu) / ((1 + nu) * (1 - 2 * nu) * density))
    return None
