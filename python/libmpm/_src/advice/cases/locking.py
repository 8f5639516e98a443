"""Reference case of an almost incompressible solid: Cook's membrane.

Without F-bar each particle asks for its own volume to stay, which are more conditions than the grid
has velocities: the body bends too little, and its pressure is noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import advance, method_of, rms
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Sticky
from libmpm._src.materials.generated import FixedCorotated
from libmpm._src.methods.method import FBar
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.boxes import Box, DomainWalls

__all__ = ["CASES"]

Parameters = Mapping[str, Any]
Floats = npt.NDArray[np.float64]

_WIDTH, _ROOT, _TIP = 48.0, 44.0, 16.0  # m: width, height at the clamped and at the loaded edge
_AREA = _WIDTH * (_ROOT + _TIP) / 2
_YOUNG, _DENSITY = 1e6, 1000.0
#: Upward, m/s²: so small that strains stay below 0.5 % and the small-strain solution holds.
_GRAVITY = 0.003
#: The plate that loads the right edge by its weight, a third of the membrane's, which the reference
#: has too: as stiff as the membrane, and far from incompressible, so that it needs no F-bar.
_PLATE, _PLATE_RATIO, _PLATE_LOAD = 6.0, 0.3, 1 / 3

#: Mean lift of the plate by small strains, parts of ρ g / E: Taylor-Hood elements Q2-Q1, 8 to 24 a
#: side extrapolated (`tests/validation/test_locking.py`).
LIFT = 17935.0

#: Depth in cells, behind the plane of the wall, at which a body must end to behave as if clamped
#: there. The only linear field of nodes that vanishes on the held ones starts half a cell behind
#: the plane, and its strain is weak in the first cell, ε = 2 s² (3/2 - s) a (design/walls.md). A
#: bar that starts at s₀ behaves as one of the length S²/E with S = n - 1/2, E = n - 1 + e and
#: e = ∫ ε² ds / a² from s₀ to 1, that is n - e + O(1/n): as long as it is where s₀ = e.
CLAMP = 0.364

#: Period of a mass that sinks by the lift under its weight, s; the membrane's is a tenth shorter.
PERIOD = 2 * math.pi * math.sqrt(LIFT * _DENSITY / _YOUNG)


def _bottom(x: float) -> float:
    """Return the lower edge at a distance from the clamp; the loaded edge is straight."""
    return _ROOT / _WIDTH * min(x, _WIDTH)


def _cook(p: Parameters, options: Options) -> Scene:
    """Columns of boxes that fill the trapezoid with equal particles, and the plate.

    With 7 q columns and particles 2/q m high, each column is two particles lower than the one
    before and has exactly its part of the area: (22 q - 1) - 2 k particles.
    """
    dx, q = _WIDTH / p["cells"], p["fill"]
    left, below = CLAMP * dx, 3 * dx
    span = math.ceil((left + _WIDTH + _PLATE) / dx) + 3
    rise = math.ceil(60.0 / dx) + 6
    load = TimeTable((0.0, PERIOD), ((0.0, 0.0), (0.0, _GRAVITY)))
    scene = Scene(
        name="cook",
        dimension=2,
        cell_size=dx,
        lower=(0.0, 0.0),
        upper=(span * dx, rise * dx),
        gravity=load,
        method=method_of(options, p["cfl"]),
    )
    material = FixedCorotated(
        density=_DENSITY, youngs_modulus=_YOUNG, poissons_ratio=p["poissons_ratio"]
    )
    fbar = _FBAR if options.solid_fbar == "case" else options.solid_fbar
    wide, high = _WIDTH / (7 * q), 2.0 / q
    for k in range(7 * q):
        x, count = (k + 0.5) * wide, 22 * q - 1 - 2 * k
        low = below + _bottom(x)
        scene.add_body(
            name=f"column-{k}",
            shape=Box(
                lower=(left + k * wide, low), upper=(left + (k + 1) * wide, low + count * high)
            ),
            material=material,
            lattice=(1, count),
            fbar=fbar,
        )
    edge = left + _WIDTH
    scene.add_body(
        name="plate",
        shape=Box(lower=(edge, below + _ROOT), upper=(edge + _PLATE, below + _ROOT + _TIP)),
        material=FixedCorotated(
            density=_DENSITY * _PLATE_LOAD * _AREA / (_PLATE * _TIP),
            youngs_modulus=_YOUNG,
            poissons_ratio=_PLATE_RATIO,
        ),
        lattice=(max(1, round(_PLATE / wide)), 8 * q),
    )
    scene.add_boundary(name="clamp", shape=DomainWalls(faces=("x-",)), response=Sticky())
    return scene


def _measure_cook(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Mean lift of the plate over two periods, Hann's window, and the pressure at the end.

    Of a swing whose period is 0.9 to 1.1 of the estimate the ramp leaves a tenth, and the window
    4 % of that.
    """
    plate = simulation.particles["plate"]
    level = float(plate["position"][:, 1].mean())
    samples = (np.arange(80) + 0.5) / 80
    lifts = []
    for _ in advance(simulation, PERIOD * (1 + 2 * samples)):
        lifts.append(float(plate["position"][:, 1].mean()) - level)
    lift = float(np.average(lifts, weights=np.sin(np.pi * samples) ** 2))
    jumps, pressures = [], []
    for k in range(7 * p["fill"]):
        pressure = simulation.particles[f"column-{k}"]["pressure"]
        # What alternates from one particle to the next above it.
        jumps.append((pressure[:-2] - 2 * pressure[1:-1] + pressure[2:]) / 4)
        pressures.append(pressure)
    scale = LIFT * _DENSITY * _GRAVITY / _YOUNG
    traction = _PLATE_LOAD * _DENSITY * _GRAVITY * _AREA / _TIP
    return {
        "lift_ratio": lift / scale,
        "swing": float(np.ptp(lifts)) / scale,
        "checkerboard": rms(np.concatenate(jumps)) / traction,
        "pressure": rms(np.concatenate(pressures)) / traction,
    }


_FBAR = FBar()

_BOUNDS = {"lift_ratio": Bound(0.97, 1.03, "1", "small strains with mixed elements, ±3 %")}

_COOK = Case(
    name="cook",
    title="Cook's membrane, almost incompressible: lift of the loaded edge, noise of the pressure",
    source="Cook (1974); small strains with mixed elements",
    # `cells` in the width; `fill`: 7 columns of particles each, 3 for 16 cells (q of `_cook`).
    levels={
        # 1,017 particles, 4.3e4 steps: 4.3e7 particle-steps, 15 s.
        "reduced": {"cells": 16, "fill": 3, "poissons_ratio": 0.4999, "cfl": 0.8},
        # 4,020 particles, 8.6e4 steps: 3.5e8 particle-steps, 2 min of one core.
        "full": {"cells": 32, "fill": 6, "poissons_ratio": 0.4999, "cfl": 0.8},
    },
    bounds={"reduced": _BOUNDS, "full": _BOUNDS},
    build=_cook,
    measure=_measure_cook,
)

CASES: tuple[Case, ...] = (_COOK,)
