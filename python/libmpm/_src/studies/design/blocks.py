"""Blocks of debris in a flow that hit a bridge: pulses, contact masses, plates and their width."""

from __future__ import annotations

from typing import Any

import numpy as np

from libmpm._src.studies.design.formula import Example, Numbers, Symbol, formula
from libmpm._src.studies.design.impact import DENSITY, LENGTH, MASS, MODULUS, SPEED

__all__ = [
    "block_force",
    "block_force_partial",
    "block_force_pulse",
    "block_force_two_areas",
    "contact_mass",
    "net_area",
    "plane_strain_modulus",
    "spread_height",
]

_YANG = "Yang (2016) eq. {}"
_CONTACT = Symbol("A_c", "m²", "area of contact", lower=0, lower_open=True)
_FRONT = Symbol("A_d", "m²", "area of the debris across the flow", lower=0, lower_open=True)
_POISSON = Symbol("ν", "1", "Poisson's ratio of the debris", lower=0, upper=0.5)
_PLANE = Symbol("E_l", "Pa", "modulus of the block in plane strain", lower=0, lower_open=True)
_HEIGHT = Symbol("h_d", "m", "height of the block", lower=0, lower_open=True)
_WIDTH = Symbol("t_d", "m", "width of the block along the structure", lower=0, lower_open=True)
_FACTOR = Symbol("c_I", "1", "coefficient of impact", lower=0)
_PULSE = Symbol("Δt", "s", "duration of the impact", lower=0, lower_open=True)

#: Block of the sources' example: 3 m/s, 1000 kg/m³, 10 GPa, ν 0.2, h_d 3 m.
_BLOCK: dict[str, float] = {"velocity": 3, "density": 1000, "modulus": 10e9 / 0.96}
_B1: dict[str, float] = {"velocity": 0.8645, "mass": 4.5, "duration": 5.5e-3}


@formula(
    "F = π m v / (2 Δt)",
    unit="N",
    symbols={"mass": MASS, "velocity": SPEED, "duration": _PULSE},
    validity="half-sine pulse that stops the debris; in the source's runs Δt told nothing of the "
    "force (printed masses ten times too small)",
    source=_YANG.format("6.2") + "; ASCE/SEI 7-10, without its coefficients",
    examples=[
        Example(_B1, "1.11e3"),
        Example({"velocity": 0.8645, "mass": 18, "duration": 3.75e-3}, "6.52e3"),
    ],
)
def block_force_pulse(*, mass: Numbers, velocity: Numbers, duration: Numbers) -> Any:
    """Return the peak of the half-sine pulse of a given length that takes all momentum."""
    return np.pi * mass * velocity / (2 * duration)


@formula(
    "m_c = m A_c / A_d",
    unit="kg",
    symbols={"mass": MASS, "contact_area": _CONTACT, "area": _FRONT},
    validity="prism; A_c ≤ A_d",
    source=_YANG.format("6.6"),
    examples=[Example({"mass": 18, "contact_area": 0.005, "area": 0.15}, "0.60")],
)
def contact_mass(*, mass: Numbers, contact_area: Numbers, area: Numbers) -> Any:
    """Return the mass of the part of a block that lies behind its contact."""
    return mass * contact_area / area


@formula(
    "F = c_I v √(E A_c ρ A_d)",
    unit="N",
    symbols={
        "velocity": SPEED,
        "contact_area": _CONTACT,
        "area": _FRONT,
        "density": DENSITY,
        "youngs_modulus": MODULUS,
        "coefficient": _FACTOR,
    },
    validity="stiffness of the part in contact, mass of the whole block: `bar_force` with "
    "k = E A_c / L; no effect of length; runs in water gave 1.2 to 2.4 times as much",
    source=_YANG.format("6.3 to 6.5") + " (the last printed without c_I)",
    examples=[
        Example(
            {
                "velocity": 0.8645,
                "contact_area": 0.05,
                "area": 0.15,
                "density": 200,
                "youngs_modulus": 0.03e9,
            },
            "5.80e3",
        ),
        Example(
            {
                "velocity": 0.8645,
                "contact_area": 0.005,
                "area": 0.15,
                "density": 800,
                "youngs_modulus": 0.03e9,
            },
            "3.67e3",
        ),
    ],
)
def block_force_two_areas(
    *,
    velocity: Numbers,
    contact_area: Numbers,
    area: Numbers,
    density: Numbers,
    youngs_modulus: Numbers,
    coefficient: Numbers = 1.0,
) -> Any:
    """Return the force of a block of which only a part comes into contact."""
    return coefficient * velocity * np.sqrt(youngs_modulus * contact_area * density * area)


@formula(
    "E_l = E / (1 − ν²)",
    unit="Pa",
    symbols={"youngs_modulus": MODULUS, "poissons_ratio": _POISSON},
    validity="free faces above and below, held along the width",
    source=_YANG.format("6.8"),
    examples=[Example({"youngs_modulus": 10e9, "poissons_ratio": 0.2}, "1.0417e10")],
)
def plane_strain_modulus(*, youngs_modulus: Numbers, poissons_ratio: Numbers) -> Any:
    """Return the modulus of a plate in plane strain that is free across its thickness."""
    return youngs_modulus / (1 - poissons_ratio**2)


@formula(
    "F = t_d v h_d √(ρ E_l)",
    unit="N",
    symbols={
        "velocity": SPEED,
        "height": _HEIGHT,
        "width": _WIDTH,
        "density": DENSITY,
        "modulus": _PLANE,
    },
    validity="whole front in contact, in air, rigid wall; runs of the source: L ≥ 2 h_d agreed, "
    "L = h_d about 15 % off",
    source=_YANG.format("6.9"),
    examples=[Example(_BLOCK | {"height": 3, "width": 1}, "29.05e6")],
)
def block_force(
    *, velocity: Numbers, height: Numbers, width: Numbers, density: Numbers, modulus: Numbers
) -> Any:
    """Return the force of a block that hits with its whole front, constant for 2 L √(ρ/E_l)."""
    return width * velocity * height * np.sqrt(density * modulus)


@formula(
    "F = v A_c' √(ρ E_l)",
    unit="N",
    symbols={
        "velocity": SPEED,
        "effective_area": Symbol(
            "A_c'", "m²", "effective area of contact, t_d h_c'", lower=0, lower_open=True
        ),
        "density": DENSITY,
        "modulus": _PLANE,
    },
    validity="part of the front in contact, in air; in water 1.25 to 1.35 times as much (source); "
    "solid blocks, no containers",
    source=_YANG.format("6.10"),
    examples=[Example(_BLOCK | {"effective_area": 1.5}, "14.52e6", True)],
)
def block_force_partial(
    *, velocity: Numbers, effective_area: Numbers, density: Numbers, modulus: Numbers
) -> Any:
    """Return the force of a block that hits with a part of its front."""
    return velocity * effective_area * np.sqrt(density * modulus)


@formula(
    "h_c' = h_c + min(a, L/5) + min(b, L/5), a, b = (h_d − h_c)/2 ± e",
    unit="m",
    symbols={
        "contact": Symbol("h_c", "m", "height of the contact", lower=0, lower_open=True),
        "height": _HEIGHT,
        "length": LENGTH,
        "eccentricity": Symbol("e", "m", "middle of the contact above that of the block"),
    },
    validity="a reading of tan θ = 5, the load spreading towards both free edges up to the far "
    "end: runs with 12 cells in h_d gave 6 % of h_d more to 18 % less (e at the edge, L > 9 m)",
    source="Yang (2016) 6.2.3; the construction is in figure 6.14 alone",
    examples=[
        Example({"contact": 1, "height": 3, "length": 3, "eccentricity": 0}, "2.2", True),
        Example({"contact": 1, "height": 3, "length": 3, "eccentricity": 1}, "1.6", True),
    ],
)
def spread_height(
    *, contact: Numbers, height: Numbers, length: Numbers, eccentricity: Numbers = 0.0
) -> Any:
    """Return the effective height of a partial contact, for `block_force_partial`."""
    free = np.maximum(height - contact, 0.0) / 2
    aside = np.minimum(np.abs(eccentricity), free)
    reach = length / 5
    inside = np.minimum(contact, height)
    return inside + np.minimum(free - aside, reach) + np.minimum(free + aside, reach)


@formula(
    "A = t_d min(b, d − h_d ρ / ρ_w)",
    unit="m²",
    symbols={
        "density": DENSITY,
        "height": _HEIGHT,
        "width": _WIDTH,
        "depth": Symbol("d", "m", "depth of the water", lower=0, lower_open=True),
        "clearance": Symbol("b", "m", "height of the deck's bottom above the bed", lower=0),
        "fluid_density": Symbol("ρ_w", "kg/m³", "density of the water", lower=0, lower_open=True),
    },
    validity="blocks afloat before they arrive, as wide as the flume; 0 where they touch the bed; "
    "peak load in N for A in m² about 782e3 A^3.56 in the source's flume alone (R² 0.94)",
    source="Yang (2016) table 6.2, A_if; its fit of the force has the power 3.55",
    examples=[
        Example(
            {"density": 200, "height": 0.15, "width": 1, "depth": 0.2, "clearance": 0.225},
            "0.170",
        ),
        Example(
            {"density": 800, "height": 0.15, "width": 1, "depth": 0.3384, "clearance": 0.225},
            "0.218",
        ),
    ],
)
def net_area(
    *,
    density: Numbers,
    height: Numbers,
    width: Numbers,
    depth: Numbers,
    clearance: Numbers,
    fluid_density: Numbers = 1000.0,
) -> Any:
    """Return the area that floating blocks below a deck leave to the flow."""
    below = np.minimum(clearance, depth - height * np.minimum(density / fluid_density, 1.0))
    return width * np.maximum(below, 0.0)
