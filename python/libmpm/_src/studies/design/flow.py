"""Loads and numbers of the flow: drag, Froude, Mach, Cauchy and Iribarren."""

from __future__ import annotations

from typing import Any

import numpy as np

from libmpm._src.studies.design.formula import Example, Numbers, Symbol, formula

__all__ = [
    "cauchy_number",
    "drag_force",
    "froude_number",
    "mach_number",
    "sound_speed",
    "surf_similarity",
]

DENSITY = Symbol("ρ", "kg/m³", "density", lower=0, lower_open=True)
MODULUS = Symbol("K", "Pa", "bulk modulus (Young's modulus for a bar)", lower=0, lower_open=True)
SPEED = Symbol("u", "m/s", "speed of the flow", lower=0)
VELOCITY = Symbol("u", "m/s", "velocity of the flow")

_WATER = {"bulk_modulus": 2.2e9, "density": 1000}
_CASE = {"density": 1000}


@formula(
    "F = ½ ρ C A u |u|",
    unit="N",
    symbols={
        "density": Symbol("ρ", "kg/m³", "density of the fluid", lower=0, lower_open=True),
        "coefficient": Symbol("C", "1", "drag coefficient", lower=0),
        "area": Symbol("A", "m²", "submerged area across the flow", lower=0),
        "velocity": VELOCITY,
    },
    validity="steady flow; C 0.8 to 1.45 for the raised box; the force has the sign of u",
    source="Bonus (2023) eq. 7.1",
    examples=[
        Example(_CASE | {"coefficient": 0.8, "area": 0.278, "velocity": 1.4}, "218.0"),
        Example(_CASE | {"coefficient": 1.45, "area": 0.278, "velocity": 1.0}, "201.6"),
    ],
)
def drag_force(*, density: Numbers, coefficient: Numbers, area: Numbers, velocity: Numbers) -> Any:
    """Return the drag of a flow on a body."""
    return 0.5 * density * coefficient * area * velocity * np.abs(velocity)


@formula(
    "Fr = u / √(g L)",
    unit="1",
    symbols={
        "velocity": SPEED,
        "length": Symbol("L", "m", "length, of a flow its depth", lower=0, lower_open=True),
        "gravity": Symbol("g", "m/s²", "gravity", lower=0, lower_open=True),
    },
    validity="ratio of inertia to gravity",
    source="Bonus (2023) eq. 7.2",
    examples=[Example({"velocity": 1.3, "length": 0.528}, "0.571", True)],
)
def froude_number(*, velocity: Numbers, length: Numbers, gravity: Numbers = 9.81) -> Any:
    """Return the Froude number."""
    return velocity / np.sqrt(gravity * length)


@formula(
    "c = √(K / ρ)",
    unit="m/s",
    symbols={"bulk_modulus": MODULUS, "density": DENSITY},
    validity="small pressure waves; in a bar with E for K",
    source="Bonus (2023) eq. 7.3",
    examples=[
        Example(_WATER, "1483"),
        Example({"bulk_modulus": 1e6, "density": 500}, "44.7"),
    ],
)
def sound_speed(*, bulk_modulus: Numbers, density: Numbers) -> Any:
    """Return the speed of pressure waves."""
    return np.sqrt(bulk_modulus / density)


@formula(
    "Ma = u / √(K / ρ)",
    unit="1",
    symbols={"velocity": SPEED, "bulk_modulus": MODULUS, "density": DENSITY},
    validity="compressibility is commonly left out below 0.1, in steady flow",
    source="Bonus (2023) eq. 7.3, there called the Cauchy number",
    examples=[
        Example({"velocity": 5.5} | _WATER, "0.004"),
        Example({"velocity": 17.5} | _WATER, "0.012"),
    ],
)
def mach_number(*, velocity: Numbers, bulk_modulus: Numbers, density: Numbers) -> Any:
    """Return the Mach number."""
    return velocity / np.sqrt(bulk_modulus / density)


@formula(
    "Ca = ρ u² / K",
    unit="1",
    symbols={"velocity": SPEED, "bulk_modulus": MODULUS, "density": DENSITY},
    validity="the square of the Mach number",
    source="standard; Bonus (2023) eq. 7.3 has its root",
    examples=[Example({"velocity": 5.5} | _WATER, "1.375e-5", True)],
)
def cauchy_number(*, velocity: Numbers, bulk_modulus: Numbers, density: Numbers) -> Any:
    """Return the Cauchy number, the ratio of inertia to elastic force."""
    return density * velocity**2 / bulk_modulus


@formula(
    "ξ = tan β / √(H / L)",
    unit="1",
    symbols={
        "slope": Symbol("tan β", "1", "slope of the bed, rise over run", lower=0, lower_open=True),
        "height": Symbol("H", "m", "height of the wave", lower=0, lower_open=True),
        "wavelength": Symbol("L", "m", "length of the wave", lower=0, lower_open=True),
    },
    validity="plane slope; whether H and L are offshore or local must be said with the number",
    source="standard (Iribarren); discussed without a formula in Bonus (2023) 7.7.2",
    examples=[Example({"slope": 1 / 12, "height": 1.0, "wavelength": 36.0}, "0.5", True)],
)
def surf_similarity(*, slope: Numbers, height: Numbers, wavelength: Numbers) -> Any:
    """Return the surf similarity (Iribarren number) of a wave on a slope."""
    return slope / np.sqrt(height / wavelength)
