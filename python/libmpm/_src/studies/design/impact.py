"""Impact of a single debris: the elastic bar, and waves between two media."""

from __future__ import annotations

from typing import Any

import numpy as np

from libmpm._src.base.values import warn
from libmpm._src.studies.design.formula import Example, Numbers, Symbol, formula

__all__ = [
    "bar_duration",
    "bar_force",
    "bar_force_of_material",
    "bar_impulse",
    "bar_mass",
    "bar_stiffness",
    "impact_amplification",
    "impact_amplification_series",
    "reflection_coefficient",
    "transmission_coefficient",
]

AREA = Symbol("A", "m²", "area of impact", lower=0, lower_open=True)
DENSITY = Symbol("ρ", "kg/m³", "density of the debris", lower=0, lower_open=True)
LENGTH = Symbol("L", "m", "length of the debris", lower=0, lower_open=True)
MASS = Symbol("m", "kg", "mass of the debris", lower=0, lower_open=True)
MODULUS = Symbol("E", "Pa", "Young's modulus of the debris", lower=0, lower_open=True)
SPEED = Symbol("v", "m/s", "speed of impact", lower=0)
STIFFNESS = Symbol("k", "N/m", "stiffness of the debris", lower=0, lower_open=True)

_ELASTIC = "elastic prism that hits head-on in air, rigid wall"
_BAR = "Bonus (2023) eq. 6.1; ASCE/SEI 7-22 6.11, without its factors for importance and direction"
#: Strain v √(ρ/E) at the struck end above which the linear bar is no longer a good picture.
_STRAIN = 0.1

_LARGE_FLUME = {"mass": 2.4525, "stiffness": 8.0e6}


@formula(
    "m = ρ A L",
    unit="kg",
    symbols={"density": DENSITY, "area": AREA, "length": LENGTH},
    validity="prism",
    source="Bonus (2023) 6.2.1",
    examples=[Example({"density": 981, "area": 0.005, "length": 0.5}, "2.4525")],
)
def bar_mass(*, density: Numbers, area: Numbers, length: Numbers) -> Any:
    """Return the mass of a prismatic debris."""
    return density * area * length


@formula(
    "k = E A / L",
    unit="N/m",
    symbols={"youngs_modulus": MODULUS, "area": AREA, "length": LENGTH},
    validity=_ELASTIC,
    source=_BAR,
    examples=[Example({"youngs_modulus": 0.8e9, "area": 0.005, "length": 0.5}, "8.0e6")],
)
def bar_stiffness(*, youngs_modulus: Numbers, area: Numbers, length: Numbers) -> Any:
    """Return the axial stiffness of a prismatic debris."""
    return youngs_modulus * area / length


@formula(
    "t = 2 √(m / k)",
    unit="s",
    symbols={"mass": MASS, "stiffness": STIFFNESS},
    validity=_ELASTIC + "; the pulse is a step of this length",
    source=_BAR,
    examples=[Example(_LARGE_FLUME, "1.107e-3")],
)
def bar_duration(*, mass: Numbers, stiffness: Numbers) -> Any:
    """Return how long an elastic bar stays in contact, twice the travel time of a wave in it."""
    return 2 * np.sqrt(mass / stiffness)


@formula(
    "f = v √(m k)",
    unit="N",
    symbols={"mass": MASS, "stiffness": STIFFNESS, "velocity": SPEED},
    validity=_ELASTIC + "; a cushion of water makes the load much smaller",
    source=_BAR,
    examples=[Example(_LARGE_FLUME | {"velocity": 1.0}, "4429")],
)
def bar_force(*, mass: Numbers, stiffness: Numbers, velocity: Numbers) -> Any:
    """Return the force of an elastic bar, constant while it is in contact."""
    return velocity * np.sqrt(mass * stiffness)


@formula(
    "f = v A √(ρ E)",
    unit="N",
    symbols={
        "velocity": SPEED,
        "area": AREA,
        "density": DENSITY,
        "youngs_modulus": MODULUS,
    },
    validity=_ELASTIC + f"; strain v √(ρ/E) up to {_STRAIN:g}",
    source="Bonus (2023) eq. 6.2",
    examples=[
        Example({"velocity": 1, "area": 0.005, "density": 981, "youngs_modulus": 0.8e9}, "4429"),
        Example({"velocity": 1, "area": 0.005, "density": 500, "youngs_modulus": 1e6}, "111.80"),
        Example({"velocity": 1, "area": 0.005, "density": 2000, "youngs_modulus": 1e6}, "223.61"),
    ],
)
def bar_force_of_material(
    *, velocity: Numbers, area: Numbers, density: Numbers, youngs_modulus: Numbers
) -> Any:
    """Return the force of an elastic bar from its material; its length plays no part."""
    strain = np.max(velocity * np.sqrt(density / youngs_modulus), initial=0)
    if strain > _STRAIN:
        warn(
            [
                f"design.bar_force_of_material: the strain v √(ρ/E) is {strain:.3g}; "
                f"the formula is for small strains, up to {_STRAIN:g}"
            ]
        )
    return velocity * area * np.sqrt(density * youngs_modulus)


@formula(
    "I = 2 m v",
    unit="N·s",
    symbols={"mass": MASS, "velocity": SPEED},
    validity="elastic rebound; force times duration of the bar",
    source="from eq. 6.1, f t",
    examples=[Example({"mass": 2.4525, "velocity": 1}, "4.905")],
)
def bar_impulse(*, mass: Numbers, velocity: Numbers) -> Any:
    """Return the impulse of an elastic rebound."""
    return 2 * mass * velocity


_PACZKOWSKI = "Bonus (2023) eq. {}, after Paczkowski et al. (2012)"
_REFLECTION = Symbol("R", "1", "reflection coefficient", lower=-1, upper=1)
_TERMS = Symbol("n", "1", "highest power kept", lower=0, upper=10_000, whole=True)
_POWERS = "R ≤ 0.8, the value stated for shipping containers; beyond, the powers left out count"


def _ratio(symbol: str, meaning: str) -> Symbol:
    return Symbol(symbol, "1", f"{meaning} of the two media", lower=0, lower_open=True)


@formula(
    "R = (ρ̄ c̄ Ā − 1) / (ρ̄ c̄ Ā + 1)",
    unit="1",
    symbols={
        "density_ratio": _ratio("ρ̄", "ratio of densities"),
        "speed_ratio": _ratio("c̄", "ratio of wave speeds"),
        "area_ratio": _ratio("Ā", "ratio of areas"),
    },
    validity="one-dimensional elastic waves; −1 ≤ R ≤ 1 (printed 1 ≤ R ≤ 1)",
    source=_PACZKOWSKI.format("7.4"),
    examples=[Example({"density_ratio": 1, "speed_ratio": 3, "area_ratio": 1}, "0.5", True)],
)
def reflection_coefficient(
    *, density_ratio: Numbers, speed_ratio: Numbers, area_ratio: Numbers = 1.0
) -> Any:
    """Return the part of a wave's force that a change of medium throws back."""
    impedance = density_ratio * speed_ratio * area_ratio
    return (impedance - 1) / (impedance + 1)


@formula(
    "T = 1 − R",
    unit="1",
    symbols={"reflection": _REFLECTION},
    validity="as R",
    source=_PACZKOWSKI.format("7.4"),
    examples=[Example({"reflection": 0.5}, "0.5", True)],
)
def transmission_coefficient(*, reflection: Numbers) -> Any:
    """Return the part of a wave's force that passes on."""
    return 1 - reflection


_AMPLIFIED = {
    "reflection": Symbol("R", "1", "reflection coefficient", lower=-1, upper=1, stated=(-1, 0.8)),
    "terms": _TERMS,
}
_AMPLIFICATIONS = [
    Example({"reflection": 0.43}, "2.51"),
    Example({"reflection": 0.5}, "2.99"),
    Example({"reflection": 0.556}, "3.48"),
    Example({"reflection": 0.8}, "7.66"),
]


@formula(
    "F̄ = 1 + 2R + 2R² + … + 2Rⁿ",
    unit="1",
    symbols=_AMPLIFIED,
    validity=_POWERS,
    source=_PACZKOWSKI.format("7.5") + ", n = 8",
    examples=_AMPLIFICATIONS,
)
def impact_amplification_series(*, reflection: Numbers, terms: Numbers = 8) -> Any:
    """Return by how much reflected waves raise the force of impact, term by term."""
    most = int(np.max(terms, initial=0))
    total = np.ones(np.broadcast_shapes(np.shape(reflection), np.shape(terms)))
    for power in range(1, most + 1):
        total = total + np.where(power <= terms, 2 * reflection**power, 0.0)
    return total


@formula(
    "F̄ = 1 + 2R (1 − Rⁿ) / (1 − R)",
    unit="1",
    symbols=_AMPLIFIED,
    validity=_POWERS,
    source="the sum of eq. 7.5; 1 + 2n at R = 1",
    examples=_AMPLIFICATIONS,
)
def impact_amplification(*, reflection: Numbers, terms: Numbers = 8) -> Any:
    """Return by how much reflected waves raise the force of impact, in closed form."""
    whole = np.equal(reflection, 1)
    safe = np.where(whole, 0.0, reflection)
    return np.where(whole, 1 + 2 * terms, 1 + 2 * safe * (1 - safe**terms) / (1 - safe))
