"""Design formulas for impacts, drag, similitude and spreading of debris, with their sources.

Functions take keyword arguments in SI units (angles in radians), numbers or arrays that broadcast,
and return a float or an array. Impossible values raise `SceneError`; values outside the range that
a source speaks of issue a `ModelWarning`. `formulas` lists all of them.
"""

from libmpm._src.moved import renamed
from libmpm._src.studies.design.blocks import (
    block_force,
    block_force_partial,
    block_force_pulse,
    block_force_two_areas,
    contact_mass,
    net_area,
    plane_strain_modulus,
    spread_height,
)
from libmpm._src.studies.design.contact import Impact, kelvin_voigt, kelvin_voigt_peak
from libmpm._src.studies.design.flow import (
    cauchy_number,
    drag_force,
    froude_number,
    mach_number,
    sound_speed,
    surf_similarity,
)
from libmpm._src.studies.design.formula import Example, Formula, Symbol, formula_table, formulas
from libmpm._src.studies.design.impact import (
    bar_duration,
    bar_force,
    bar_force_of_material,
    bar_impulse,
    bar_mass,
    bar_stiffness,
    impact_amplification,
    impact_amplification_series,
    reflection_coefficient,
    transmission_coefficient,
)
from libmpm._src.studies.design.similitude import (
    Froude,
    elastic_impact_ratio,
    mach_ratio,
    prototype_time,
)
from libmpm._src.studies.design.spreading import (
    DEBRIS_FRICTION,
    NAITO_ANGLE,
    DebrisFriction,
    naito_half_width,
    nistor_displacement,
    nistor_spreading,
    spreading_angle,
)

#: Names of version 0.1; `contacts.Friction` is a law of contact.
__getattr__ = renamed(__name__, {"Friction": "DebrisFriction"})

__all__ = [
    "DEBRIS_FRICTION",
    "NAITO_ANGLE",
    "DebrisFriction",
    "Example",
    "Formula",
    "Froude",
    "Impact",
    "Symbol",
    "bar_duration",
    "bar_force",
    "bar_force_of_material",
    "bar_impulse",
    "bar_mass",
    "bar_stiffness",
    "block_force",
    "block_force_partial",
    "block_force_pulse",
    "block_force_two_areas",
    "cauchy_number",
    "contact_mass",
    "drag_force",
    "elastic_impact_ratio",
    "formula_table",
    "formulas",
    "froude_number",
    "impact_amplification",
    "impact_amplification_series",
    "kelvin_voigt",
    "kelvin_voigt_peak",
    "mach_number",
    "mach_ratio",
    "naito_half_width",
    "net_area",
    "nistor_displacement",
    "nistor_spreading",
    "plane_strain_modulus",
    "prototype_time",
    "reflection_coefficient",
    "sound_speed",
    "spread_height",
    "spreading_angle",
    "surf_similarity",
    "transmission_coefficient",
]
