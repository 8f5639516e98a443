"""Materials, generated from the compiled core; do not edit.

Change the C++ header of the material, build, and run ``python tools/generate_materials.py``.
"""
# ruff: noqa: E501  the texts are those of the headers

from __future__ import annotations

import math
from typing import ClassVar

from libmpm._src.base.declarations import given
from libmpm._src.base.values import value
from libmpm._src.materials.friction import Cone, FrictionalMaterial
from libmpm._src.materials.material import Column, Entry, Material, Parameter

__all__ = [
    "CamClay",
    "DruckerPrager",
    "FixedCorotated",
    "HerschelBulkleyFluid",
    "Hypoelastic",
    "LinearElastic",
    "NeoHookean",
    "StVenantKirchhoffHencky",
    "TaitFluid",
    "VonMises",
]


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
class HerschelBulkleyFluid(Material):
    """Mud or lahar: Herschel-Bulkley shear law over TaitFluid's volume law.

    =================  ======  =====  ==========  ========  ========================================
    parameter          symbol  unit   range       default   meaning
    =================  ======  =====  ==========  ========  ========================================
    density            ρ       kg/m³  > 0         required  density at zero pressure
    bulk_modulus       K       Pa     > 0         2.2e+09   bulk modulus at zero pressure; the sound
                                                            speed is √(K/ρ)
    exponent           γ       1      ≥ 1, ≤ 20   7.15      growth of the bulk modulus with pressure
    yield_stress       τ_y     Pa     ≥ 0         required  shear stress below which it only creeps
    consistency        k       Pa·sⁿ  ≥ 0         required  shear stress above the yield stress at
                                                            1/s; the plastic viscosity where n = 1
    index              n       1      ≥ 0.1, ≤ 2  1         flow index: 1 Bingham, less thins with
                                                            the shear rate, more thickens
    largest_viscosity  μ_max   Pa·s   > 0         required  bound of the viscosity at any rate, and
                                                            that of creep below the yield stress (m
                                                            = μ_max/τ_y after Papanastasiou); limits
                                                            the time step
    =================  ======  =====  ==========  ========  ========================================

    Particles store: j (volume loss 1 - J, positive in compression).
    Volume smoothing (`FBar`) is on by default.
    Source: Herschel and Bulkley (1926); Papanastasiou (1987); volume: Bonus (2023), section 5.12.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.HerschelBulkleyFluid"
    table: ClassVar[Entry] = Entry(
        name="HerschelBulkleyFluid",
        summary="Mud or lahar: Herschel-Bulkley shear law over TaitFluid's volume law",
        source="Herschel and Bulkley (1926); Papanastasiou (1987); volume: Bonus (2023), section 5.12",
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
                default=None,
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
                name="yield_stress",
                symbol="τ_y",
                unit="Pa",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="shear stress below which it only creeps",
            ),
            Parameter(
                name="consistency",
                symbol="k",
                unit="Pa·sⁿ",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="shear stress above the yield stress at 1/s; the plastic viscosity where n = 1",
            ),
            Parameter(
                name="index",
                symbol="n",
                unit="1",
                default=1.0,
                lower=0.1,
                upper=2.0,
                lower_open=False,
                upper_open=False,
                meaning="flow index: 1 Bingham, less thins with the shear rate, more thickens",
            ),
            Parameter(
                name="largest_viscosity",
                symbol="μ_max",
                unit="Pa·s",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="bound of the viscosity at any rate, and that of creep below the yield stress (m = μ_max/τ_y after Papanastasiou); limits the time step",
            ),
        ),
    )

    density: float
    bulk_modulus: float = 2200000000.0
    exponent: float = 7.15
    yield_stress: float
    consistency: float
    index: float = 1.0
    largest_viscosity: float


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
    Volume smoothing (`FBar`) is off unless given.
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
        fbar=True,
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


@value
class NeoHookean(Material):
    """Hyperelastic solid, compressible neo-Hookean energy.

    ==============  ======  =====  ===========  ========  ======================
    parameter       symbol  unit   range        default   meaning
    ==============  ======  =====  ===========  ========  ======================
    density         ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus  E       Pa     > 0          required  Young's modulus
    poissons_ratio  ν       1      > -1, < 0.5  0.3       Poisson's ratio
    ==============  ======  =====  ===========  ========  ======================

    Particles store: H (displacement gradient F - I).
    Volume smoothing (`FBar`) is off unless given.
    Source: Bonet and Wood (2008), section 6.4.3.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.NeoHookean"
    table: ClassVar[Entry] = Entry(
        name="NeoHookean",
        summary="Hyperelastic solid, compressible neo-Hookean energy",
        source="Bonet and Wood (2008), section 6.4.3",
        needs="deformation_gradient",
        columns=(
            Column(
                name="H",
                components=9,
                meaning="displacement gradient F - I",
                unit="1",
            ),
        ),
        fbar=True,
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


@value
class StVenantKirchhoffHencky(Material):
    """Hyperelastic solid, quadratic in the logarithmic strain.

    ==============  ======  =====  ===========  ========  ======================
    parameter       symbol  unit   range        default   meaning
    ==============  ======  =====  ===========  ========  ======================
    density         ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus  E       Pa     > 0          required  Young's modulus
    poissons_ratio  ν       1      > -1, < 0.5  0.3       Poisson's ratio
    ==============  ======  =====  ===========  ========  ======================

    Particles store: B (left Cauchy-Green tensor less the identity).
    Volume smoothing (`FBar`) is off unless given.
    Source: Bonus (2023), section 5.7; Hencky (1928).

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.StVenantKirchhoffHencky"
    table: ClassVar[Entry] = Entry(
        name="StVenantKirchhoffHencky",
        summary="Hyperelastic solid, quadratic in the logarithmic strain",
        source="Bonus (2023), section 5.7; Hencky (1928)",
        needs="elastic_strain",
        columns=(
            Column(
                name="B",
                components=6,
                meaning="left Cauchy-Green tensor less the identity",
                unit="1",
            ),
        ),
        fbar=True,
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


@value
class LinearElastic(Material):
    """Hooke's law in the small strain; for rotations and strains of a few thousandths.

    ==============  ======  =====  ===========  ========  ======================
    parameter       symbol  unit   range        default   meaning
    ==============  ======  =====  ===========  ========  ======================
    density         ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus  E       Pa     > 0          required  Young's modulus
    poissons_ratio  ν       1      > -1, < 0.5  0.3       Poisson's ratio
    ==============  ======  =====  ===========  ========  ======================

    Particles store: strain (small strain).
    Volume smoothing (`FBar`) does not apply.
    Source: Hooke's law.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.LinearElastic"
    table: ClassVar[Entry] = Entry(
        name="LinearElastic",
        summary="Hooke's law in the small strain; for rotations and strains of a few thousandths",
        source="Hooke's law",
        needs="elastic_strain",
        columns=(
            Column(
                name="strain",
                components=6,
                meaning="small strain",
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


@value
class VonMises(Material):
    """Elastic-plastic solid, von Mises yield with linear hardening.

    =================  ======  =====  ===========  ========  ===================================
    parameter          symbol  unit   range        default   meaning
    =================  ======  =====  ===========  ========  ===================================
    density            ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus     E       Pa     > 0          required  Young's modulus
    poissons_ratio     ν       1      > -1, < 0.5  0.3       Poisson's ratio
    yield_stress       σ_y     Pa     > 0          required  yield stress in uniaxial tension
                                                             (Kirchhoff)
    hardening_modulus  H       Pa     ≥ 0          0         growth of the yield stress with the
                                                             plastic strain
    =================  ======  =====  ===========  ========  ===================================

    Particles store: B (elastic left Cauchy-Green tensor less 1; 2D: and the strain e_zz),
    plastic_strain (accumulated equivalent plastic strain).
    Volume smoothing (`FBar`) is off unless given.
    Source: Simo (1992).

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.VonMises"
    table: ClassVar[Entry] = Entry(
        name="VonMises",
        summary="Elastic-plastic solid, von Mises yield with linear hardening",
        source="Simo (1992)",
        needs="elastic_strain",
        columns=(
            Column(
                name="B",
                components=6,
                meaning="elastic left Cauchy-Green tensor less 1; 2D: and the strain e_zz",
                unit="1",
            ),
            Column(
                name="plastic_strain",
                components=1,
                meaning="accumulated equivalent plastic strain",
                unit="1",
            ),
        ),
        fbar=True,
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
            Parameter(
                name="yield_stress",
                symbol="σ_y",
                unit="Pa",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="yield stress in uniaxial tension (Kirchhoff)",
            ),
            Parameter(
                name="hardening_modulus",
                symbol="H",
                unit="Pa",
                default=0.0,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="growth of the yield stress with the plastic strain",
            ),
        ),
    )

    density: float
    youngs_modulus: float
    poissons_ratio: float = 0.3
    yield_stress: float
    hardening_modulus: float = 0.0


@value
class DruckerPrager(FrictionalMaterial):
    """Sand: Drucker-Prager yield with cohesion, dilatancy and tension cut-off.

    =================  ======  =====  ===========  ========  =======================================
    parameter          symbol  unit   range        default   meaning
    =================  ======  =====  ===========  ========  =======================================
    density            ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus     E       Pa     > 0          required  Young's modulus
    poissons_ratio     ν       1      > -1, < 0.5  0.3       Poisson's ratio
    friction_angle     φ       °      ≥ 0, ≤ 89    30        friction angle in the test that `cone`
                                                             names, degrees
    cohesion           c       Pa     ≥ 0          0         cohesion
    dilatancy_angle    ψ       °      ≥ 0, ≤ 89    0         dilatancy angle, degrees; below the
                                                             friction angle in soils
    tension_cutoff     p_t     Pa     ≥ 0          0         largest mean tension; the apex c cot φ
                                                             bounds it in any case
    volume_correction  β       1      ≥ 0, ≤ 1     1         share of what opened in tension that
                                                             must close again
    cone               -       -      a name       None      test in which the angles hold: triaxial
                                                             compression or extension, or plane
                                                             strain; None = plane strain in 2D,
                                                             compression in 3D
    =================  ======  =====  ===========  ========  =======================================

    Particles store: B (elastic left Cauchy-Green tensor less 1; 2D: and the strain e_zz),
    plastic_strain (accumulated equivalent plastic shear strain), gap (logarithmic volume opened in
    tension that is still to close), dilation (logarithmic volume gained for good).
    Volume smoothing (`FBar`) does not apply.
    Source: Klár et al. (2016); Tampubolon et al. (2017); Bonus (2023), section 5.7.

    `cone` is one of "compression", "extension", "plane-strain". A cone is circular and can meet
    Mohr and Coulomb's surface in one test only: that of 30 degrees in triaxial compression acts as
    43.9 degrees in plane strain.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.DruckerPrager"
    table: ClassVar[Entry] = Entry(
        name="DruckerPrager",
        summary="Sand: Drucker-Prager yield with cohesion, dilatancy and tension cut-off",
        source="Klár et al. (2016); Tampubolon et al. (2017); Bonus (2023), section 5.7",
        needs="elastic_strain",
        columns=(
            Column(
                name="B",
                components=6,
                meaning="elastic left Cauchy-Green tensor less 1; 2D: and the strain e_zz",
                unit="1",
            ),
            Column(
                name="plastic_strain",
                components=1,
                meaning="accumulated equivalent plastic shear strain",
                unit="1",
            ),
            Column(
                name="gap",
                components=1,
                meaning="logarithmic volume opened in tension that is still to close",
                unit="1",
            ),
            Column(
                name="dilation",
                components=1,
                meaning="logarithmic volume gained for good",
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
            Parameter(
                name="friction_angle",
                symbol="φ",
                unit="°",
                default=30.0,
                lower=0.0,
                upper=89.0,
                lower_open=False,
                upper_open=False,
                meaning="friction angle in the test that `cone` names, degrees",
            ),
            Parameter(
                name="cohesion",
                symbol="c",
                unit="Pa",
                default=0.0,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="cohesion",
            ),
            Parameter(
                name="dilatancy_angle",
                symbol="ψ",
                unit="°",
                default=0.0,
                lower=0.0,
                upper=89.0,
                lower_open=False,
                upper_open=False,
                meaning="dilatancy angle, degrees; below the friction angle in soils",
            ),
            Parameter(
                name="tension_cutoff",
                symbol="p_t",
                unit="Pa",
                default=0.0,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="largest mean tension; the apex c cot φ bounds it in any case",
            ),
            Parameter(
                name="volume_correction",
                symbol="β",
                unit="1",
                default=1.0,
                lower=0.0,
                upper=1.0,
                lower_open=False,
                upper_open=False,
                meaning="share of what opened in tension that must close again",
            ),
        ),
    )

    density: float
    youngs_modulus: float
    poissons_ratio: float = 0.3
    friction_angle: float = 30.0
    cohesion: float = 0.0
    dilatancy_angle: float = 0.0
    tension_cutoff: float = 0.0
    volume_correction: float = 1.0
    cone: Cone | None = given(
        "test in which the angles hold: triaxial compression or extension, or plane strain; None "
        "= plane strain in 2D, compression in 3D",
        default=None,
        range="a name",
    )


@value
class CamClay(FrictionalMaterial):
    """Clay or snow: non-associative Cam-Clay with cohesion, hardening and softening.

    ==================  ======  =====  ===========  ========  ======================================
    parameter           symbol  unit   range        default   meaning
    ==================  ======  =====  ===========  ========  ======================================
    density             ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus      E       Pa     > 0          required  Young's modulus
    poissons_ratio      ν       1      > -1, < 0.5  0.3       Poisson's ratio
    log_plastic_volume  α₀      1      < 0          required  initial consolidation α, the logarithm
                                                              of the plastic volume ratio; the
                                                              pressure of first crushing is p₀ = K
                                                              (10⁻⁵ + sinh(-ξ α₀)), K = E / (3 (1 -
                                                              2 ν))
    friction_angle      φ       °      > 0, ≤ 89    30        friction angle in the test that `cone`
                                                              names, degrees
    cohesion_ratio      β       1      ≥ 0          0.5       largest mean tension in parts of p₀
    hardening_factor    ξ       1      > 0          0.8       growth of p₀ with the consolidation
    hardens             h       1      ≥ 0, ≤ 1     1         share of the flow that changes α: 1
                                                              hardens and softens, 0 keeps p₀
    cone                -       -      a name       None      test in which the angles hold:
                                                              triaxial compression or extension, or
                                                              plane strain; None = plane strain in
                                                              2D, compression in 3D
    ==================  ======  =====  ===========  ========  ======================================

    Particles store: B (elastic left Cauchy-Green tensor less 1; 2D: with its zz entry last),
    plastic_strain (accumulated equivalent plastic strain, volume included), consolidation (change
    of α; negative: harder than at the start), dilation (logarithmic volume gained for good).
    Volume smoothing (`FBar`) does not apply.
    Source: Gaume et al. (2018); Wolper et al. (2019).

    `cone` is one of "compression", "extension", "plane-strain". A cone is circular and can meet
    Mohr and Coulomb's surface in one test only: that of 30 degrees in triaxial compression acts as
    43.9 degrees in plane strain.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.CamClay"
    table: ClassVar[Entry] = Entry(
        name="CamClay",
        summary="Clay or snow: non-associative Cam-Clay with cohesion, hardening and softening",
        source="Gaume et al. (2018); Wolper et al. (2019)",
        needs="elastic_strain",
        columns=(
            Column(
                name="B",
                components=6,
                meaning="elastic left Cauchy-Green tensor less 1; 2D: with its zz entry last",
                unit="1",
            ),
            Column(
                name="plastic_strain",
                components=1,
                meaning="accumulated equivalent plastic strain, volume included",
                unit="1",
            ),
            Column(
                name="consolidation",
                components=1,
                meaning="change of α; negative: harder than at the start",
                unit="1",
            ),
            Column(
                name="dilation",
                components=1,
                meaning="logarithmic volume gained for good",
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
            Parameter(
                name="log_plastic_volume",
                symbol="α₀",
                unit="1",
                default=None,
                lower=-math.inf,
                upper=0.0,
                lower_open=True,
                upper_open=True,
                meaning="initial consolidation α, the logarithm of the plastic volume ratio; the pressure of first crushing is p₀ = K (10⁻⁵ + sinh(-ξ α₀)), K = E / (3 (1 - 2 ν))",
            ),
            Parameter(
                name="friction_angle",
                symbol="φ",
                unit="°",
                default=30.0,
                lower=0.0,
                upper=89.0,
                lower_open=True,
                upper_open=False,
                meaning="friction angle in the test that `cone` names, degrees",
            ),
            Parameter(
                name="cohesion_ratio",
                symbol="β",
                unit="1",
                default=0.5,
                lower=0.0,
                upper=math.inf,
                lower_open=False,
                upper_open=True,
                meaning="largest mean tension in parts of p₀",
            ),
            Parameter(
                name="hardening_factor",
                symbol="ξ",
                unit="1",
                default=0.8,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="growth of p₀ with the consolidation",
            ),
            Parameter(
                name="hardens",
                symbol="h",
                unit="1",
                default=1.0,
                lower=0.0,
                upper=1.0,
                lower_open=False,
                upper_open=False,
                meaning="share of the flow that changes α: 1 hardens and softens, 0 keeps p₀",
            ),
        ),
    )

    density: float
    youngs_modulus: float
    poissons_ratio: float = 0.3
    log_plastic_volume: float
    friction_angle: float = 30.0
    cohesion_ratio: float = 0.5
    hardening_factor: float = 0.8
    hardens: float = 1.0
    cone: Cone | None = given(
        "test in which the angles hold: triaxial compression or extension, or plane strain; None "
        "= plane strain in 2D, compression in 3D",
        default=None,
        range="a name",
    )


@value
class Hypoelastic(Material):
    """Linear elastic law in rates, Jaumann and Hill terms; for small steps.

    ==============  ======  =====  ===========  ========  ======================
    parameter       symbol  unit   range        default   meaning
    ==============  ======  =====  ===========  ========  ======================
    density         ρ       kg/m³  > 0          required  density at zero strain
    youngs_modulus  E       Pa     > 0          required  Young's modulus
    poissons_ratio  ν       1      > -1, < 0.5  0.3       Poisson's ratio
    ==============  ======  =====  ===========  ========  ======================

    Particles store: sigma (Cauchy stress; 2D: and the one out of the plane), dJ (volume change J -
    1).
    Volume smoothing (`FBar`) does not apply.
    Source: de Koster (2018), equations 2.4 and 2.40 to 2.45.

    Raises `SceneError` with every parameter out of range.
    """

    label: ClassVar[str] = "materials.Hypoelastic"
    table: ClassVar[Entry] = Entry(
        name="Hypoelastic",
        summary="Linear elastic law in rates, Jaumann and Hill terms; for small steps",
        source="de Koster (2018), equations 2.4 and 2.40 to 2.45",
        needs="stress",
        columns=(
            Column(
                name="sigma",
                components=6,
                meaning="Cauchy stress; 2D: and the one out of the plane",
                unit="Pa",
            ),
            Column(
                name="dJ",
                components=1,
                meaning="volume change J - 1",
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
