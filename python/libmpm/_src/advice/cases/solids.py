"""Reference cases without water: blocks on an incline, a beam, and those of grains and dominoes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import Slab, advance, method_of, solid_choices
from libmpm._src.advice.cases.dominoes import CASES as _DOMINOES
from libmpm._src.advice.cases.grains import CASES as _GRAINS
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Separable, Slip, Sticky
from libmpm._src.materials.generated import FixedCorotated
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.boxes import Box, DomainWalls

__all__ = ["CASES"]

Parameters = Mapping[str, Any]

# ---- incline ------------------------------------------------------------------------------------

_BLOCK_DENSITY, _BLOCK_HEIGHT, _SLOPE_GRAVITY = 1000.0, 0.4, 9.81

#: Friction of the five tracks, parts of tan θ: two that slide by the closed form, two beside the
#: limit, which are reported, and one that holds.
_RATIOS = (0.0, 0.5, 0.95, 1.05, 1.2)
_TRAVEL = 50  # cells, of the block at 0.5 tan θ


def _track(ratio: float) -> str:
    return f"{ratio:g}".replace(".", "-")


def _modulus() -> float:
    """Return Young's modulus at which the block's own weight strains it by 1e-3, Pa."""
    return _BLOCK_DENSITY * _SLOPE_GRAVITY * _BLOCK_HEIGHT / 1e-3


def _ramp() -> float:
    """Return how long gravity grows: twenty of the block's lowest periods, s."""
    return 20 * 4 * _BLOCK_HEIGHT * math.sqrt(_BLOCK_DENSITY / _modulus())


def _slid(time: float, p: Parameters, ratio: float) -> float:
    """Return s = a (t² / 2) with what the ramp T of gravity takes, a (t T / 2 - T² / 6), m."""
    theta, ramp = math.radians(p["angle"]), _ramp()
    a = _SLOPE_GRAVITY * math.sin(theta) * (1 - ratio)
    return a * (time * time / 2 - time * ramp / 2 + ramp * ramp / 6)


def _incline(p: Parameters, options: Options) -> Scene:
    """Five blocks, each on a slab with a friction of its own; gravity is turned by the angle."""
    dx = _BLOCK_HEIGHT / p["cells"]
    slab = Slab(dx, p["slab"] * dx)
    theta = math.radians(p["angle"])
    long, pitch = 2 * p["cells"], p["cells"] + 5
    # Without friction a block slides twice as far as at 0.5 tan θ.
    across = 2 + long + math.ceil(2.1 * _TRAVEL) + 4
    down = slab.vector(_SLOPE_GRAVITY * math.sin(theta), -_SLOPE_GRAVITY * math.cos(theta))
    scene = Scene(
        name="incline",
        dimension=slab.dimension,
        cell_size=dx,
        lower=slab.vector(0.0, 0.0),
        upper=slab.vector(across * dx, pitch * len(_RATIOS) * dx, slab.thickness),
        gravity=TimeTable((0.0, _ramp()), (slab.vector(0.0, 0.0), down)),
        method=method_of(options, 0.4),
    )
    for k, ratio in enumerate(_RATIOS):
        top = (pitch * k + 2) * dx
        friction = ratio * math.tan(theta)
        scene.add_boundary(
            name=f"incline-{_track(ratio)}",
            # Beyond the sides: where the box ended there, its nearest face would be its side.
            shape=Box(
                lower=slab.vector(0.0, top - 2 * dx, -3 * dx),
                upper=slab.vector(across * dx, top, slab.thickness + 3 * dx),
            ),
            response=Separable(static_friction=friction, dynamic_friction=friction),
        )
        scene.add_body(
            name=f"block-{_track(ratio)}",
            shape=slab.box((2 * dx, top), ((2 + long) * dx, top + _BLOCK_HEIGHT)),
            material=FixedCorotated(
                density=_BLOCK_DENSITY, youngs_modulus=_modulus(), poissons_ratio=0.3
            ),
            **solid_choices(options),
        )
    if slab.thickness:
        sides = DomainWalls(faces=("z-", "z+"))
        scene.add_boundary(name="sides", shape=sides, response=Slip(cell="held"))
    return scene


def _measure_incline(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Distances when the block at 0.5 tan θ has slid 50 cells by the closed form.

    A block that holds is followed over the second half of the run, in cells per second.
    """

    def place() -> dict[float, float]:
        blocks = ((r, simulation.particles[f"block-{_track(r)}"]) for r in _RATIOS)
        return {r: float(b["position"][:, 0].mean()) for r, b in blocks}

    dx = simulation.scene.cell_size
    a = _SLOPE_GRAVITY * math.sin(math.radians(p["angle"])) * 0.5
    end = _ramp() / 2 + math.sqrt(2 * _TRAVEL * dx / a - _ramp() ** 2 / 12)
    first = place()
    (half, middle), (time, last) = ((t, place()) for t in advance(simulation, (end / 2, end)))
    values = {}
    for ratio in _RATIOS:
        if ratio < 1:
            slid = last[ratio] - first[ratio]
            values[f"distance_ratio_{ratio:g}"] = slid / _slid(time, p, ratio)
        else:
            creep = (last[ratio] - middle[ratio]) / (time - half)
            values[f"creep_{ratio:g}"] = abs(creep) / dx
    return values


_INCLINE_BOUNDS = {
    "distance_ratio_0": Bound(0.97, 1.03, "1", "g sin θ t² / 2, ±3 % over 50 cells"),
    "distance_ratio_0.5": Bound(0.97, 1.03, "1", "g (sin θ - μ cos θ) t² / 2, ±3 % over 50 cells"),
    "creep_1.2": Bound(0.0, 0.1, "cells/s", "holds at 1.2 tan θ"),
}

_INCLINE = Case(
    name="incline",
    title="Blocks on an incline with Coulomb friction",
    source="Coulomb's law; sliding block",
    # `angle` in degrees; `cells` in the height of a block twice as long.
    levels={
        # 2,560 particles, 1.4e4 steps at 4.76 degrees and 6e3 at 31: 3.5e7 particle-steps, 4 s.
        "reduced": {"angle": 4.76, "cells": 8, "slab": 0},
        # 6.6e5 particles, 2.8e4 steps: 1.8e10 particle-steps.
        "full": {"angle": 4.76, "cells": 32, "slab": 8},
    },
    bounds={"reduced": _INCLINE_BOUNDS, "full": _INCLINE_BOUNDS},
    build=_incline,
    measure=_measure_incline,
)

# ---- beam ---------------------------------------------------------------------------------------

_SPAN, _DEPTH, _BEAM_DENSITY, _FULL_GRAVITY = 10.0, 1.0, 100.0, 9.81


def _deflection(modulus: float) -> tuple[float, float]:
    """Return the mid-span deflection of the clamped beam under its weight, m.

    First w L⁴ / (384 E I) + w L² / (8 A_s G) (Bonus 2023, 6.11, G = E / 2 at ν = 0, A_s = 5/6 A);
    second with the stretch of the axis: w L⁴ / E = 384 I δ + (π⁴ / 4) A δ³ and the same shear.
    """
    inertia, area = _DEPTH**3 / 12, _DEPTH
    load = _BEAM_DENSITY * _FULL_GRAVITY * _DEPTH
    shear = load * _SPAN**2 / (8 * 5 / 6 * area * modulus / 2)
    bending = load * _SPAN**4 / (384 * modulus * inertia)
    stretched = np.roots([math.pi**4 / 4 * area, 0.0, 384 * inertia, -load * _SPAN**4 / modulus])
    root = float(stretched[np.abs(stretched.imag) < 1e-9].real[0])
    return bending + shear, root + shear


def _beam(p: Parameters, options: Options) -> Scene:
    """A beam between two rigid walls; gravity grows with the square of the time, then holds."""
    dx = _DEPTH / p["cells"]
    slab = Slab(dx, p["slab"] * dx)
    room = math.ceil(1.5 * _deflection(p["youngs_modulus"])[1] / dx) * dx + 4 * dx
    ramp = np.linspace(0, 1, 41)
    gravity = TimeTable(ramp * p["ramp"], _FULL_GRAVITY * ramp**2)
    upper = (_SPAN, _DEPTH + room + 4 * dx)
    scene = slab.scene("beam", (0.0, 0.0), upper, gravity, method_of(options, 0.4))
    scene.add_body(
        name="beam",
        shape=slab.box((0.0, room), (_SPAN, room + _DEPTH)),
        material=FixedCorotated(
            density=_BEAM_DENSITY, youngs_modulus=p["youngs_modulus"], poissons_ratio=0.0
        ),
        **solid_choices(options),
    )
    ends = DomainWalls(faces=("x-", "x+"))
    scene.add_boundary(name="ends", shape=ends, response=Sticky())
    if slab.thickness:
        scene.add_boundary(
            name="sides", shape=DomainWalls(faces=("z-", "z+")), response=Slip(cell="held")
        )
    return scene


def _measure_beam(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Mean deflection of the middle cells over the last second; gravity is whole before."""
    beam = simulation.particles["beam"]
    x = beam["position"]
    middle = np.abs(x[:, 0] - _SPAN / 2) < simulation.scene.cell_size
    level, found = x[middle, 1].mean(), []
    for _ in advance(simulation, p["ramp"] + np.linspace(0.5, 1.5, 41)):
        found.append(level - beam["position"][middle, 1].mean())
    linear, stretched = _deflection(p["youngs_modulus"])
    deflection = float(np.mean(found))
    return {
        "deflection": deflection,
        "deflection_ratio": deflection / stretched,
        "linear_ratio": deflection / linear,
        "swing": float(np.ptp(found)) / stretched,
    }


_BEAM_BOUNDS = {
    "deflection_ratio": Bound(0.94, 1.06, "1", "clamped beam with membrane force, ±6 %")
}

_BEAM = Case(
    name="beam",
    title="A clamped beam under its own weight",
    source="Bonus (2023), 6.6, the beam alone; beam theory",
    # `cells` in the beam's depth of 1 m; `ramp` in s.
    levels={
        # 1,440 particles, 5.8e4 steps: 8.4e7 particle-steps, 8 s.
        "reduced": {"youngs_modulus": 5e7, "cells": 6, "slab": 0, "ramp": 4.0},
        # 200 x 20 x 4 cells, 1.28e5 particles, 3.3e5 steps: 4.2e10 particle-steps.
        "full": {"youngs_modulus": 5e7, "cells": 20, "slab": 4, "ramp": 8.0},
    },
    bounds={"reduced": _BEAM_BOUNDS, "full": _BEAM_BOUNDS},
    build=_beam,
    measure=_measure_beam,
)

CASES: tuple[Case, ...] = (_INCLINE, _BEAM, *_GRAINS, *_DOMINOES)
