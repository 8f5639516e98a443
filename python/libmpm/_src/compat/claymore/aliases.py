"""Names in ClaymoreUW scene files: which spellings mean what, and which are ignored.

Everything here is data. Spellings are compared after `fold`: case, blanks, hyphens, underscores
and apostrophes do not count.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

__all__ = ["ALIASES", "CONTACTS", "DIRECTIONS", "DROPPED", "LAWS", "OBJECTS", "Names"]
__all__ += ["OPERATIONS", "REFUSED_LAWS", "REFUSED_OBJECTS", "SHAPES", "STATISTICS", "fold"]


def fold(name: str) -> str:
    """Return a name as it is compared."""
    return re.sub(r"[\s_\-'’.]+", "", name).casefold()


class Names(dict[str, str]):
    """What folded spellings mean; `spellings` are as they are written."""

    def __init__(self, groups: Mapping[str, str]) -> None:
        """Take meanings with their spellings, separated by commas."""
        rows = [(s, meaning) for meaning, text in groups.items() for s in text.split(", ")]
        self.spellings = [spelling for spelling, _ in rows]
        super().__init__((fold(spelling), meaning) for spelling, meaning in rows)


#: Other spellings of keys, by the one that the current program of the authors reads.
ALIASES: Mapping[str, tuple[str, ...]] = {
    "bodies": ("models",),
    "boundaries": ("grid-boundaries",),
    "grid-sensors": ("grid-targets",),
    "particle-sensors": ("particle-targets",),
    "meshes": ("mesh",),
    "default_dx": ("dx", "cell_size"),
    "default_dt": ("dt",),
    "time": ("initial_time",),
    "froude_scaling": ("froude_length_ratio",),
    "cfl": ("CFL",),
    "ppc": ("particles_per_cell",),
    "rho": ("density",),
    "poisson_ratio": ("poissons_ratio", "poisson", "nu"),
    "youngs_modulus": ("young_modulus", "E"),
    "bulk_modulus": ("bulk", "K"),
    "gamma": ("bulk_modulus_derivative",),
    "viscosity": ("dynamic_viscosity", "visco"),
    "tensile_yield_strength": ("yield_stress", "yield_strength"),
    "SandVolCorrection": ("volume_correction",),
    "hardeningOn": ("hardening_on", "hardening"),
    "friction_angle": ("phi",),
    "FBAR_psi": ("FBAR_ratio", "FBAR_antilocking_ratio"),
    "ASFLIP_alpha": ("alpha", "ASFLIP_velocity_ratio"),
    "ASFLIP_beta_min": ("beta_min", "ASFLIP_position_ratio_min"),
    "ASFLIP_beta_max": ("beta_max", "ASFLIP_position_ratio_max"),
    "file": ("motion_file", "filename"),
    "output_frequency": ("motion_freq", "motion_frequency", "frequency"),
    "scaling_factor": ("scaling", "scale"),
    "geometry": ("geometries",),
    "spacing": ("array_spacing",),
    "friction_static": ("static_friction",),
    "friction_dynamic": ("dynamic_friction",),
    "domain_start": ("start",),
    "domain_end": ("end",),
    "output_attribs": ("output_attributes", "attribs"),
    "track_attribs": ("track_attributes", "attribs"),
    "target_attribs": ("target_attributes",),
    "input_attribs": ("input_attributes",),
    "track_particle_id": ("track_particle_ids", "ids"),
}

_WATER = "what HydroUQ calls its choice of numbers that stand in the file too"
_SHOWN = "only shown"
_GPU = "the plan places the work on devices"

#: Keys that are known and change nothing, with the reason, by part of the file.
DROPPED: Mapping[str, Mapping[str, str]] = {
    "file": {
        "Application": "name of the program",
        "EventClassification": "HydroUQ's own",
        "subtype": "HydroUQ's own",
        "type": "HydroUQ's own",
        "example": "name of HydroUQ's example",
        "computer": _GPU,
        "outputs": "HydroUQ's own; bodies have theirs",
    },
    "simulation": {
        "gpuid": _GPU,
        "save_path": "the folder of the results is given when running",
        "save_suffix": "frames are VTKHDF",
        "particles_output_exterior_only": "frames have all particles",
        "info_rate": "the run reports by itself",
        "time_integration": "explicit is the only one",
        "froude_time_ratio": "the square root of the length ratio",
        "use_froude_scaling": "froude_scaling says it",
        "use_cauchy_scaling": "cauchy_bulk_ratio says it",
    },
    "body": {
        "color": _SHOWN,
        "type": "particles are the only kind that is read",
        "target_attribs": "a sensor names its own attribute",
        "body_preset": _WATER,
    },
    "output": {
        "exterior_only": "frames have all particles",
        "exterior_threshold": "frames have all particles",
        "target_attribs": "a sensor names its own attribute",
    },
    "material": {
        "type": "particles are the only kind that is read",
        "material_preset": _WATER,
    },
    "algorithm": {
        "type": "particles are the only kind that is read",
        "numerical_preset": _WATER,
    },
    "geometry": {
        "body_preset": _WATER,
        "facility": _WATER,
        "facility_dimensions": _WATER,
        "fill_flume_upto_SWL": "span says it",
        "track_particle_id": "a body's own track_particle_id is read",
        "domain_start": "no geometry has one",
        "domain_end": "no geometry has one",
        "padding": "cells around a distance file",
    },
    "boundary": {
        "type": "grid is the only kind",
        "preset": _WATER,
        "output_frequency": "the motion file has its own times",
        "toggle": "true",
    },
    "sensor": {
        "preset": _WATER,
        "summary": _WATER,
        "type": "the list says it",
    },
}

#: Contact -> response.
CONTACTS = Names(
    {
        "sticky": "sticky, stick, rigid, no-slip, fixed, fix, non-slip",
        "slip": "slip, roller, free-slip",
        "separable": "separable, seperable, separate, separatable, separating",
    }
)

#: Boundary object -> kind.
OBJECTS = Names(
    {
        "walls": "Walls, Wall, Domain Walls, Rigid Walls",
        "floor": "Floor",
        "box": "Box, Cube, Rigid Box, Structure",
        "sphere": "Sphere, Ball",
        "cylinder": "Cylinder, Column",
        "plane": "Plane, Surface",
        "bathymetry": "Bathymetry, Bath",
        "velocity": "Velocity, velocity_boundary",
        "lwf-ramp": (
            "OSU LWF, OSU Flume, OSU LWF Ramp, OSU LWF Bathymetry, OSU Ramp, OSU Bathymetry"
        ),
        "lwf-paddle": (
            "OSU Paddle, OSU LWF Paddle, OSU LWF Piston, OSU Piston, OSU Wave Maker, "
            "OSU LWF Wave Maker, Paddle, Piston"
        ),
        "twb-ramp": (
            "OSU TWB, OSU TWB Ramp, OSU TWB Bathymetry, OSU DWB, OSU DWB Ramp, OSU DWB Bathymetry"
        ),
        "twb-paddle": (
            "OSU TWB Paddle, OSU TWB Piston, OSU TWB Wave Maker, OSU DWB Paddle, OSU DWB Piston, "
            "OSU DWB Wave Maker"
        ),
        "usgs-ramp": "USGS Ramp, USGS Flume, USGS DFF, USGS DFF Ramp, USGS DFF Flume",
        "usgs-gate": "USGS Gate, USGS Gates, USGS DFF Gate, USGS DFF Gates",
        "wasirf-pump": "WASIRF Pump, UW WASIRF Pump, UW WASIRF",
        "harbor": "TOKYO Harbor, TOKYO Harbour, WU TWB Harbor, Waseda Harbor, WU TWB",
    }
)

#: Objects that are known and refused, with what to do.
REFUSED_OBJECTS = Names({})

#: Geometry object -> kind.
SHAPES = Names(
    {
        "box": "Box, Cube",
        "sphere": "Sphere, Ball",
        "cylinder": "Cylinder",
        "file": "File, Checkpoint",
        "bathymetry": "Bathymetry",
        "lwf": "OSU LWF, OSU LWF Water, OSU Flume",
        "twb": "OSU TWB, OSU TWB Water, OSU DWB, OSU DWB Water",
        # Facilities with a level bed, or in coordinates along it: what their span says is filled.
        "level": "WU TWB, WU TWB Water, UW WASIRF, WASIRF, UW WASIRF Water, USGS DFF, USGS Flume",
    }
)

#: What a geometry does to the body so far.
OPERATIONS = Names(
    {
        "add": "add, union",
        "subtract": "subtract, difference",
        "intersect": "intersect, intersection",
    }
)

#: Constitutive law -> material.
LAWS = Names(
    {
        "fluid": "JFluid, J-Bar Fluid, JBFluid, Fluid, Water, Liquid",
        "fixed-corotated": "FixedCorotated, FixedCorotational",
        "neo-hookean": "NeoHookean",
        "drucker-prager": "DruckerPrager, Sand",
        "cam-clay": "NACC, CamClay, Non-Associative Cam Clay",
        "von-mises": "VonMises",
    }
)

#: Laws that are known and refused, with what to do.
REFUSED_LAWS = Names(
    {
        "solid and pore water are not coupled here; describe the body as DruckerPrager (drained) "
        "or as a fluid": "CoupledUP, coupled, up, undrained",
        "bodies of finite elements are not read; describe the body by geometry, with "
        "FixedCorotated": "Meshed, FEM",
    }
)

#: Reduction of a sensor.
STATISTICS = Names(
    {
        "sum": "sum, add, addition, total",
        "max": "max, maximum",
        "min": "min, minimum",
        "count": "count, number",
        "mean": "average, averages, mean",
        "std": "stdev, std, standard deviation",
        "variance": "variance, var",
        "subtract": "subtract",
    }
)

#: Direction of a grid sensor -> axis and sign (0 = both).
DIRECTIONS: Mapping[str, tuple[int, int]] = {
    f"{axis}{sign}": (i, {"": 0, "+": 1, "-": -1}[sign])
    for i, axis in enumerate("xyz")
    for sign in ("", "+", "-")
}
