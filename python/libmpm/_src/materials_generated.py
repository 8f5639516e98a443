"""Materials, generated from the compiled core; do not edit.

Change the C++ header of the material, build, and run ``python tools/generate_materials.py``.
"""

from __future__ import annotations

import math
from typing import ClassVar

from libmpm._src.parameters import Column, Entry, Material, Parameter
from libmpm._src.values import value

__all__ = ["FixedCorotated", "TaitFluid"]


@value
class TaitFluid(Material):
    """Weakly compressible fluid, Tait-Murnaghan law in j = 1 - J.

    ============  ======  =====  =========  =======  ==============================================
    parameter     symbol  unit   range      default  meaning
    ============  ======  =====  =========  =======  ==============================================
    density       ρ       kg/m³  > 0        1000     density at zero pressure
    bulk_modulus  K       Pa     > 0        2.2e+09  bulk modulus at zero pressure; the sound speed
                                                     is √(K/ρ)
    exponent      γ       1      ≥ 1, ≤ 20  7.15     growth of the bulk modulus with pressure
    viscosity     μ       Pa·s   ≥ 0        0.001    dynamic viscosity
    ============  ======  =====  =========  =======  ==============================================

    Particles store: j (volume loss 1 - J, positive in compression).
    Volume smoothing (`FBar`) is on by default.
    Source: Bonus (2023), sections 5.4 and 5.12.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.TaitFluid"
    table: ClassVar[Entry] = Entry(
        name="TaitFluid",
        summary="Weakly compressible fluid, Tait-Murnaghan law in j = 1 - J",
        source="Bonus (2023), sections 5.4 and 5.12",
        needs="volume",
        columns=(
            Column(
                name="j",
                components=1,
                meaning="volume loss 1 - J, positive in compression",
                unit="1",
            ),
        ),
        fbar=True,
        parameters=(
            Parameter(
                name="density",
                symbol="ρ",
                unit="kg/m³",
                default=1000.0,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="density at zero pressure",
            ),
            Parameter(
                name="bulk_modulus",
                symbol="K",
                unit="Pa",
                default=2200000000.0,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="bulk modulus at zero pressure; the sound speed is √(K/ρ)",
            ),
            Parameter(
                name="exponent",
                symbol="γ",
                unit="1",
                default=7.15,
                lower=1.0,
                upper=20.0,
                lower_open=False,
                upper_open=False,
                meaning="growth of the bulk modulus with pressure",
            ),
            Parameter(
                name="viscosity",
                symbol="μ",
                unit="Pa·s",
                default=0.001,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="dynamic viscosity",
            ),
        ),
    )

    density: float = 1000.0
    bulk_modulus: float = 2200000000.0
    exponent: float = 7.15
    viscosity: float = 0.001


@value
class FixedCorotated(Material):
    """Hyperelastic solid, fixed corotated energy.

    ==============  ======  =====  ===========  ========  ======================
    parameter       symbol  unit   range        default   meaning
    ==============  ======  =====  ===========  ========  ======================
    density         ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus  E       Pa     > 0          required  Young's modulus
    poissons_ratio  ν       1      > -1, < 0.5  0.3       Poisson's ratio
    ==============  ======  =====  ===========  ========  ======================

    Particles store: H (displacement gradient F - I).
    No volume smoothing (`FBar`).
    Source: Bonus (2023), section 5.7.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.FixedCorotated"
    table: ClassVar[Entry] = Entry(
        name="FixedCorotated",
        summary="Hyperelastic solid, fixed corotated energy",
        source="Bonus (2023), section 5.7",
        needs="deformation_gradient",
        columns=(
            Column(
                name="H",
                components=9,
                meaning="displacement gradient F - I",
                unit="1",
            ),
        ),
        fbar=False,
        parameters=(
            Parameter(
                name="density",
                symbol="ρ",
                unit="kg/m³",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="density at zero strain",
            ),
            Parameter(
                name="youngs_modulus",
                symbol="E",
                unit="Pa",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="Young's modulus",
            ),
            Parameter(
                name="poissons_ratio",
                symbol="ν",
                unit="1",
                default=0.3,
                lower=-1.0,
                upper=0.5,
                lower_open=True,
                upper_open=True,
                meaning="Poisson's ratio",
            ),
        ),
    )

    density: float
    youngs_modulus: float
    poissons_ratio: float = 0.3
