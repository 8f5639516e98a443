"""Similitude: what a length scale makes of every other quantity."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, value
from libmpm._src.studies.design.formula import Example, Numbers, Symbol, formula

__all__ = ["RATIOS", "Froude", "elastic_impact_ratio", "mach_ratio", "prototype_time"]

SCALE = Symbol("λ", "1", "prototype length over model length", lower=0, lower_open=True)

#: Power of the length scale, and what the quantity is, by the name of the ratio.
RATIOS: dict[str, tuple[float, str]] = {
    "length": (1.0, "lengths"),
    "velocity": (0.5, "velocities"),
    "time": (0.5, "times"),
    "mass": (3.0, "masses"),
    "force": (3.0, "forces"),
    "impulse": (3.5, "impulses"),
    "pressure": (1.0, "pressures and stresses"),
    "power": (3.5, "powers"),
    "stiffness": (1.0, "moduli E and K [Pa] that full elastic similitude asks for"),
    "spring_stiffness": (2.0, "stiffnesses E A / L [N/m] of full elastic similitude"),
    "sound_speed": (0.5, "wave speeds of full elastic similitude"),
}


def _power(name: str) -> Any:
    exponent, meaning = RATIOS[name]

    def ratio(self: Froude) -> float:
        return float(self.scale**exponent)

    ratio.__doc__ = f"Prototype over model of {meaning}: λ^{exponent:g}."
    return property(ratio)


@value(kw_only=False)
class Froude(Value):
    """Froude similitude with equal density and gravity: prototype over model of every quantity.

    {fields}

    `length` λ, `velocity` and `time` λ^½, `mass` and `force` λ³, `impulse` and `power` λ^3.5,
    `pressure` λ. `stiffness` λ and `sound_speed` λ^½ are what the materials must have besides for
    waves in them to scale too (tandem Froude-Cauchy, λ_C = √λ_B = √λ_L); with the model's own
    materials they are 1. Multiply a model's number by the ratio to get the prototype's. Raises
    `SceneError`. Source: Bonus (2023) eq. 7.2 and 7.3.
    """

    label: ClassVar[str] = "design.Froude"

    scale: float = given(
        "λ = prototype length / model length, 40 for a 1:40 model", unit="1", above=0
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        remedy = "prototype over model, 40 for a 1:40 model"
        return {"scale": check.given("scale", self, remedy=remedy)}

    length = _power("length")
    velocity = _power("velocity")
    time = _power("time")
    mass = _power("mass")
    force = _power("force")
    impulse = _power("impulse")
    pressure = _power("pressure")
    power = _power("power")
    stiffness = _power("stiffness")
    spring_stiffness = _power("spring_stiffness")
    sound_speed = _power("sound_speed")


@formula(
    "T_p = T_m √λ",
    unit="s",
    symbols={"time": Symbol("T_m", "s", "time in the model"), "scale": SCALE},
    validity="Froude similitude",
    source="Bonus (2023) 8.5.1",
    examples=[Example({"time": 2.75, "scale": 40}, "17.4")],
)
def prototype_time(*, time: Numbers, scale: Numbers) -> Any:
    """Return how long something in a model takes at the prototype, such as an inundation."""
    return time * np.sqrt(scale)


@formula(
    "Ma_p / Ma_m = √(λ / λ_B)",
    unit="1",
    symbols={
        "scale": SCALE,
        "modulus_ratio": Symbol("λ_B", "1", "ratio of moduli", lower=0, lower_open=True),
    },
    validity="Froude similitude, equal densities; 1 in tandem Froude-Cauchy similitude",
    source="Bonus (2023) 7.7.2, λ_C = √λ_B",
    examples=[
        Example({"scale": 10, "modulus_ratio": 1}, "3.16"),
        Example({"scale": 10, "modulus_ratio": 10}, "1"),
    ],
)
def mach_ratio(*, scale: Numbers, modulus_ratio: Numbers = 1.0) -> Any:
    """Return by how much the prototype's Mach number exceeds the model's."""
    return np.sqrt(scale / modulus_ratio)


@formula(
    "f_p / f_m = λ^2.5 √λ_E",
    unit="1",
    symbols={
        "scale": SCALE,
        "modulus_ratio": Symbol("λ_E", "1", "ratio of moduli", lower=0, lower_open=True),
    },
    validity="f = v A √(ρE); λ^2.5 for the same material, λ³ for λ_E = λ",
    source="Bonus (2023) 7.7.2",
    examples=[
        Example({"scale": 10, "modulus_ratio": 1}, "316.2", True),
        Example({"scale": 10, "modulus_ratio": 10}, "1000", True),
    ],
)
def elastic_impact_ratio(*, scale: Numbers, modulus_ratio: Numbers = 1.0) -> Any:
    """Return the ratio of bar impact forces under Froude similitude."""
    return scale**2.5 * np.sqrt(modulus_ratio)
