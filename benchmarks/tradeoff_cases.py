"""The cases of the trade-off table: reference cases made small, and two with exact solutions.

A Lamé mode of a free square, u = cos(πx/a) sin(πy/a), v = -sin(πx/a) cos(πy/a), keeps every volume
and swings with ω = √2 π c_s/a whatever Poisson's ratio is; near 1/2 it measures locking. A free
square that spins measures what a method does to rotation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import libmpm
from libmpm import cases, materials, sensors, shapes
from libmpm._src.field import Field

Parameters = Mapping[str, Any]
DENSITY = 1000.0  # kg/m³
SHEAR_SPEED = 1.0  # m/s, c_s of the Lamé mode
SPIN = 1.0  # rad/s
GRAVITY = 9.81


def _solid(law: str, modulus: float, ratio: float) -> Any:
    """Return an elastic law by name; von Mises with a yield stress that is never reached."""
    more = {"yield_stress": modulus} if law == "VonMises" else {}
    made = getattr(materials, law)
    return made(density=DENSITY, youngs_modulus=modulus, poissons_ratio=ratio, **more)


def _free(name: str, p: Parameters, options: cases.Options, law: Any, velocity: Field) -> Any:
    """Return the scene of a free square of edge 1 m with some cells around it."""
    dx = 1.0 / p["cells"]
    low, high = -0.5 - p["margin"] * dx, 0.5 + p["margin"] * dx
    scene = libmpm.Scene(
        name=name, dimension=2, cell_size=dx, lower=(low, low), upper=(high, high),
        gravity=(0.0, 0.0), method=options.method,
    )  # fmt: skip
    chosen = {} if options.solid_fbar in ("case", None) else {"fbar": options.solid_fbar}
    box = shapes.Box(lower=(-0.5, -0.5), upper=(0.5, 0.5))
    scene.add_body(name="solid", shape=box, material=law, velocity=velocity, **chosen)
    return scene


# ---- Lamé mode ----------------------------------------------------------------------------------


def _period() -> float:
    """Return 2π/ω of the mode of a square of 1 m, s."""
    return math.sqrt(2) / SHEAR_SPEED


def _lame(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """The square at rest in shape, with the mode's velocity; shear strains of 0.35 %."""
    modulus = 2 * DENSITY * SHEAR_SPEED**2 * (1 + p["poissons_ratio"])
    speed = 0.005 * SHEAR_SPEED
    x, y = "pi * (x + 0.5)", "pi * (y + 0.5)"
    velocity = Field(
        components=(f"{speed} * cos({x}) * sin({y})", f"-{speed} * sin({x}) * cos({y})")
    )
    law = _solid(p["material"], modulus, p["poissons_ratio"])
    scene = _free("Lamé mode", p, options, law, velocity)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=_period() / 200))
    return scene


def _read_lame(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Period by the times at which kinetic and elastic energy are equal, and energy that is left.

    They are equal four times a period. The energy is the mean of the last period.
    """
    simulation.run(until=p["periods"] * _period(), progress=False)
    series = simulation.sensors["energy"]
    time = np.asarray(series.time)
    columns = dict(zip(series.components, np.asarray(series.values).T, strict=True))
    excess, total = columns["kinetic"] - columns["elastic"], columns["kinetic"] + columns["elastic"]
    turn = np.flatnonzero(excess[:-1] * excess[1:] < 0)
    part = excess[turn] / (excess[turn] - excess[turn + 1])
    crossing = time[turn] + part * (time[turn + 1] - time[turn])
    # An overdamped mode has one crossing or none.
    enough = len(crossing) > 2
    spacing = np.mean(np.diff(crossing)) if enough else math.nan
    late = time > (p["periods"] - 1) * _period()
    return {
        "period": float(4 * spacing / _period()),
        "energy_left": float(np.mean(total[late]) / columns["kinetic"][0]),
    }


def _lame_case(name: str, ratio: float, cells: int, periods: float) -> cases.Case:
    own = {
        "cells": cells, "margin": 4, "periods": periods, "poissons_ratio": ratio,
        "material": "FixedCorotated",
    }  # fmt: skip
    return cases.Case(
        name=name,
        title=f"Lamé mode of a free square, ν = {ratio:g}",
        source="Lamé (1866): ω = √2 π c_s/a, no change of volume, no traction",
        levels={"reduced": own},
        bounds={},
        build=_lame,
        measure=_read_lame,
    )


# ---- spin ---------------------------------------------------------------------------------------


def _spin(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """A square that spins once in 2π s; waves are 20 times as fast as its corners."""
    fastest = 20 * SPIN * math.sqrt(0.5)
    ratio = 0.3
    modulus = DENSITY * fastest**2 * (1 + ratio) * (1 - 2 * ratio) / (1 - ratio)
    velocity = Field(components=(f"-{SPIN} * y", f"{SPIN} * x"))
    scene = _free("spin", p, options, _solid(p["material"], modulus, ratio), velocity)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.1 / SPIN))
    return scene


def _read_spin(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Angle turned, parts of ω t, and growth of the mean distance from the middle."""

    def place() -> Any:
        x = simulation.particles["solid"]["position"]
        return (x[:, 0] + 1j * x[:, 1]) - complex(*x.mean(axis=0))

    start = before = place()
    angle, until = 0.0, p["turns"] * 2 * math.pi / SPIN
    pieces = 8 * math.ceil(p["turns"])
    for k in range(pieces):
        simulation.run(until=until * (k + 1) / pieces, progress=False)
        now = place()
        angle += float(np.angle(np.sum(now * before.conj())))
        before = now
    size = float(np.sqrt(np.mean(np.abs(before) ** 2) / np.mean(np.abs(start) ** 2)))
    return {"angle": angle / (SPIN * simulation.time), "swelling": size - 1}


SPIN_CASE = cases.Case(
    name="spin",
    title="Free elastic square that spins",
    source="rigid rotation; waves are 20 times as fast as the corners",
    levels={
        "reduced": {"cells": 12, "margin": 6, "turns": 1.0, "material": "FixedCorotated"},
    },
    bounds={},
    build=_spin,
    measure=_read_spin,
)


# ---- the table's cases --------------------------------------------------------------------------


@dataclass(frozen=True)
class Measured:
    """A case with its sizes and what the table shows of it.

    `expected` are the exact or measured numbers that errors count from, by value. `energy` gives
    what a change of energy counts in, J/m, from the parameters and the energy at the start; None
    where gravity grows or friction takes energy, so that it says nothing.
    """

    case: cases.Case
    kind: str  # "water" or "solid"
    cfl: float
    sizes: Mapping[str, Mapping[str, Any]]  # "small" and "device"
    expected: Mapping[str, float]
    shown: Mapping[str, tuple[str, str]]  # value -> heading, format
    energy: Callable[[Parameters, float], float] | None = None
    interval: float = 0.0  # s, of the energy where the case has no such sensor
    state: str = ""
    materials: bool = field(default=False)
    boundary: str = ""  # that options may change: "walls" or "layer"

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.case.name


def _kinetic(p: Parameters, start: float) -> float:
    """A body that starts undeformed and without weight has kinetic energy only."""
    return start


def _flow(p: Parameters, start: float) -> float:
    """Kinetic energy of the vortex at the start."""
    return DENSITY / 4


def _fall(p: Parameters, start: float) -> float:
    """Energy that the column sets free until it lies on the bed, as the case itself counts."""
    a = p["width"]
    return 0.5 * DENSITY * GRAVITY * (a * (2 * a) ** 2 - 5 * a * (0.4 * a) ** 2)


def _weight(p: Parameters, start: float) -> float:
    depth = p["depth"]
    return 0.5 * DENSITY * p["gravity"] * depth**2 * p["width"] * depth / p["cells"]


MEASURED: tuple[Measured, ...] = (
    Measured(
        case=cases.case("vortex"), kind="water", cfl=0.4, energy=_flow,
        sizes={"small": {"cells": 24, "turnovers": 1.0}, "device": {"cells": 96, "turnovers": 1.0}},
        expected={"kinetic_left": 1.0},
        shown={"kinetic_left": ("vortex: energy left", ".2f")},
        state="smooth flow, closed box", boundary="walls",
    ),
    Measured(
        case=cases.case("dam-break"), kind="water", cfl=0.4, energy=_fall,
        sizes={"small": {"cells": 16, "until": 6.0}, "device": {"cells": 40, "until": 6.0}},
        expected={"front_speed": 1.16, "energy_gain": 0.0},
        shown={"front_speed": ("dam break: front, error", "+.1%")},
        state="free surface, splash against a wall",
    ),
    Measured(
        case=cases.case("tank"), kind="water", cfl=0.3, energy=_weight, interval=0.05,
        sizes={
            "small": {"steps": 6_000, "jitter": 0.1},
            "device": {"steps": 5_000, "jitter": 0.1},
        },
        expected={"noise": 0.0, "checkerboard": 0.0, "speed": 0.0, "profile": 0.0},
        shown={
            "noise": ("tank: pressure, rms error", ".3f"),
            "checkerboard": ("tank: checkerboard", ".4f"),
            "speed": ("tank: speed", ".0e"),
        },
        state="at rest, particles off their lattice by up to 0.1 cells", boundary="walls",
    ),
    Measured(
        case=cases.case("slope-basin"), kind="water", cfl=0.4,
        sizes={"small": {"cells": 16, "until": 6.0}, "device": {"cells": 32, "until": 6.0}},
        expected={"speed": 0.0, "level_low": 0.0},
        shown={
            "level_low": ("slope: lowest level, cells", "+.2f"),
            "speed": ("slope: speed", ".0e"),
        },
        state="at rest above a bed of 10 degrees", boundary="layer",
    ),
    Measured(
        case=_lame_case("mode", 0.3, 20, 6.0), kind="solid", cfl=0.4, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 64}},
        expected={"period": 1.0, "energy_left": 1.0},
        shown={
            "period": ("mode, ν 0.3: period, error", "+.2%"),

        },
        state="small vibration, free edges", materials=True,
    ),
    Measured(
        case=_lame_case("mode-incompressible", 0.499, 12, 3.0), kind="solid", cfl=0.4,
        energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 32}},
        expected={"period": 1.0, "energy_left": 1.0},
        shown={"period": ("mode, ν 0.499: period, error", "+.1%")},
        state="small vibration, nearly incompressible", materials=True,
    ),
    Measured(
        case=SPIN_CASE, kind="solid", cfl=0.4, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 24}},
        expected={"angle": 1.0, "swelling": 0.0},
        shown={
            "angle": ("spin: angle, error", "+.2%"),
            "swelling": ("spin: swelling", "+.1%"),
        },
        state="rotation by one turn", materials=True,
    ),
    Measured(
        case=cases.case("beam"), kind="solid", cfl=0.4,
        sizes={
            "small": {"cells": 4, "youngs_modulus": 2e6, "ramp": 2.0},
            "device": {"cells": 6, "youngs_modulus": 2e6, "ramp": 2.0},
        },
        expected={"deflection_ratio": 1.0},
        shown={"deflection_ratio": ("beam: deflection, error", "+.1%")},
        state="bending under weight",
    ),
    Measured(
        case=cases.case("incline"), kind="solid", cfl=0.4,
        sizes={"small": {"cells": 4, "angle": 31.0}, "device": {"cells": 8, "angle": 31.0}},
        expected={
            "distance_ratio_0": 1.0, "distance_ratio_0.5": 1.0, "distance_ratio_0.95": 1.0,
            "creep_1.2": 0.0,
        },
        shown={
            "distance_ratio_0.5": ("incline, μ/tan θ = 0.5: distance, error", "+.1%"),
            "distance_ratio_0.95": ("0.95: distance, error", "+.0%"),
        },
        state="blocks that slide with friction",
    ),
)  # fmt: skip
