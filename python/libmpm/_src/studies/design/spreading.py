"""Where debris go, and what holds them: displacement, spreading and friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from libmpm._src.moved import renamed
from libmpm._src.studies.design.formula import Example, Numbers, Symbol, formula

#: Names of version 0.1.
__getattr__ = renamed(__name__, {"Friction": "DebrisFriction"})

__all__ = [
    "DEBRIS_FRICTION",
    "NAITO_ANGLE",
    "DebrisFriction",
    "naito_half_width",
    "nistor_displacement",
    "nistor_spreading",
    "spreading_angle",
]

#: Half of the angle of the cone of Naito et al. (2014), radians; 22.5 degrees.
NAITO_ANGLE = math.radians(22.5)

_COUNT = Symbol("N", "1", "number of debris", lower=1, whole=True, stated=(3, 6))
_WASEDA = "Waseda flume and its model containers, N = 3 to 6; not for a prototype"


@dataclass(frozen=True)
class DebrisFriction:
    """Coulomb friction of debris on a floor, static and dynamic alike."""

    dry: float
    """Coefficient on a dry floor."""
    dry_deviation: float
    """What is stated behind ± for the dry coefficient."""
    wet: float
    """Coefficient on a wet floor."""


#: Friction of the two debris of Park et al. (2021), from table 9.1 of Bonus (2023).
DEBRIS_FRICTION = {
    "HDPE": DebrisFriction(dry=0.66, dry_deviation=0.07, wet=0.38),
    "wood": DebrisFriction(dry=1.28, dry_deviation=0.13, wet=0.71),
}


@formula(
    "Δ_long = 3.58 − 0.09 N",
    unit="m",
    symbols={"count": _COUNT},
    validity=_WASEDA,
    source="Bonus (2023) eq. 8.1, after Nistor et al. (2017a)",
    examples=[Example({"count": 3}, "3.31"), Example({"count": 6}, "3.04")],
)
def nistor_displacement(*, count: Numbers) -> Any:
    """Return the median displacement of debris along the flow."""
    return 3.58 - 0.09 * count


@formula(
    "±θ = 3.69° + 0.80° N",
    unit="rad",
    symbols={"count": _COUNT},
    validity=_WASEDA,
    source="Bonus (2023) eq. 8.2, after Nistor et al. (2017a)",
    examples=[Example({"count": 3}, "0.1063"), Example({"count": 6}, "0.1482")],
)
def nistor_spreading(*, count: Numbers) -> Any:
    """Return the bound of the spreading angle to either side; 6.09° and 8.49° for 3 and 6."""
    return np.radians(3.69 + 0.80 * count)


@formula(
    "θ = arctan(Δ_lat / Δ_long)",
    unit="rad",
    symbols={
        "lateral": Symbol("Δ_lat", "m", "displacement across the flow"),
        "longitudinal": Symbol(
            "Δ_long", "m", "displacement along the flow", lower=0, lower_open=True
        ),
    },
    validity="definition",
    source="Bonus (2023) eq. 8.2",
    examples=[Example({"lateral": 0.3531, "longitudinal": 3.31}, "0.1063", True)],
)
def spreading_angle(*, lateral: Numbers, longitudinal: Numbers) -> Any:
    """Return the spreading angle of a debris, with the sign of its lateral displacement."""
    return np.arctan(lateral / longitudinal)


@formula(
    "b = |x| tan 22.5°",
    unit="m",
    symbols={"distance": Symbol("x", "m", "distance from the source, along or against the flow")},
    validity="shipping containers; conservative, forward and backward",
    source="Naito et al. (2014) as cited in Bonus (2023) 8.5.3 (degrees left out in print)",
    examples=[Example({"distance": 3.31}, "1.371", True)],
)
def naito_half_width(*, distance: Numbers) -> Any:
    """Return half the width of the cone in which debris from a source must be expected."""
    return np.abs(distance) * math.tan(NAITO_ANGLE)
