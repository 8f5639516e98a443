"""What boundaries do (`Sticky`, `Slip`, `Separable`, `Mirror`, `Prescribed`) and how they move.

`DecayLayer` says how the hold of a surface fades with the distance from it; `Displacement`,
`Travel` and `Rotation` move a shape. `Inflow` and `Outflow` let particles in and out through a
face of the domain; `riemann_inlet` gives those of a bore. `piston_stroke` and `stroke_from_file`
are places of a wave maker. `PlacedForce` is a force by mass that depends on the place.
"""

from libmpm._src.boundaries.flows import Bore, Flow, Inflow, Outflow, riemann_inlet
from libmpm._src.boundaries.responses import (
    DecayLayer,
    Displacement,
    Mirror,
    Prescribed,
    Response,
    Rotation,
    Separable,
    Slip,
    Sticky,
    Travel,
    decay_thickness,
)
from libmpm._src.boundaries.wave_makers import piston_stroke, stroke_from_file
from libmpm._src.scene.placed_force import PlacedForce

__all__ = [
    "Bore",
    "DecayLayer",
    "Displacement",
    "Flow",
    "Inflow",
    "Mirror",
    "Outflow",
    "PlacedForce",
    "Prescribed",
    "Response",
    "Rotation",
    "Separable",
    "Slip",
    "Sticky",
    "Travel",
    "decay_thickness",
    "piston_stroke",
    "riemann_inlet",
    "stroke_from_file",
]
