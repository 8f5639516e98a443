"""Reference cases of loads and flows at structures: a gate, a slot, a surge, a surge with debris.

In the plane, SI units, per metre of thickness. What they are held to are balances: the energy
equation for what flows out, mass and momentum for what a surge does to the wall that stops it.
Reduced level on one core: gate 3 s, slot 6 s, surge 2 s, with debris 6 s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import advance, fluid_fbar, method_of, solid_choices
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Displacement, Separable, Slip
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls

__all__ = ["CASES"]

Parameters = Mapping[str, Any]

_WATER, _GRAVITY = 1000.0, 9.81  # kg/m³, m/s²
_CONTRACTED = 0.61  # of a sharp edge's jet: Kirchhoff's π/(π + 2)


def _water(depth: float, p: Parameters) -> TaitFluid:
    """Water whose bulk modulus is `stiffness` times 200 ρ g d."""
    modulus = 200 * _WATER * _GRAVITY * depth * p["stiffness"]
    return TaitFluid(density=_WATER, bulk_modulus=modulus, viscosity=0.0)


def _scene(
    p: Parameters, options: Options, name: str, upper: tuple[float, float], dx: float
) -> Scene:
    method = method_of(options, 0.3, p["flip"])
    return Scene(
        name=name,
        dimension=2,
        cell_size=dx,
        lower=(0.0, 0.0),
        upper=upper,
        gravity=(0.0, -_GRAVITY),
        method=replace(method, leaving="delete"),
    )


# ---- gate ---------------------------------------------------------------------------------------

_OPENING, _HEAD, _POOL = 0.1, 0.8, 2.0  # m: of the gate; depth and length of what is behind it


def _gate(p: Parameters, options: Options) -> Scene:
    """Water behind a plate that is raised by `cells` cells, and flows out over a dry bed."""
    dx = _OPENING / p["cells"]
    scene: Scene = _scene(p, options, "gate", (8.0, 1.2), dx)
    response = options.walls or Separable(cell=p["wall"])
    scene.add_body(
        name="water",
        shape=Box(lower=(0.0, 0.0), upper=(_POOL, _HEAD)),
        material=_water(_HEAD, p),
        hydrostatic=_HEAD,
        fbar=fluid_fbar(options),
    )
    scene.add_boundary(name="walls", shape=DomainWalls(faces=("x-", "y-")), response=response)
    thick = max(2, round(p["cells"] / 2)) * dx
    plate = Box(lower=(_POOL, _OPENING), upper=(_POOL + thick, 1.2))
    scene.add_boundary(name="gate", shape=plate, response=response)
    return scene


def _measure_gate(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Discharge over that of the energy equation, C a √(2 g h)/√(1 + C a/h), from 0.5 to 1 s."""
    dx, behind, head = _OPENING / p["cells"], [], []
    for _ in advance(simulation, (0.5, 1.0)):
        water = simulation.particles["water"]
        x, volume = water["position"][:, 0], water["mass"].astype(np.float64) / _WATER
        behind.append(float(volume[x <= _POOL + 2 * dx].sum()))
        head.append(float(volume[x < 1.0].sum()))
    level, jet = float(np.mean(head)), _CONTRACTED * _OPENING
    ideal = jet * math.sqrt(2 * _GRAVITY * level) / math.sqrt(1 + jet / level)
    return {"discharge": (behind[0] - behind[1]) / 0.5 / ideal}


# ---- slot ---------------------------------------------------------------------------------------

_LEVELS, _BASIN = (0.9, 0.5), 1.5  # m: on both sides, and the length of each
_SLOT = (0.15, 0.25)  # m, heights of its edges


def _slot(p: Parameters, options: Options) -> Scene:
    """Two basins and a wall with a slot, under water on both sides."""
    dx = (_SLOT[1] - _SLOT[0]) / p["cells"]
    thick = max(2, round(p["cells"] / 2)) * dx
    right = _BASIN + thick
    scene: Scene = _scene(p, options, "slot", (round((right + _BASIN) / dx) * dx, 1.2), dx)
    response = options.walls or Separable(cell=p["wall"])
    sides = ((0.0, _BASIN), (right, scene.upper[0]))
    for name, (first, last), level in zip(("high", "low"), sides, _LEVELS, strict=True):
        scene.add_body(
            name=name,
            shape=Box(lower=(first, 0.0), upper=(last, level)),
            material=_water(_LEVELS[0], p),
            hydrostatic=level,
            fbar=fluid_fbar(options),
        )
    scene.add_boundary(name="walls", shape=DomainWalls(faces=("x-", "x+", "y-")), response=response)
    for name, (low, high) in {"sill": (0.0, _SLOT[0]), "wall": (_SLOT[1], 1.2)}.items():
        part = Box(lower=(_BASIN, low), upper=(right, high))
        scene.add_boundary(name=name, shape=part, response=response)
    return scene


def _measure_slot(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Discharge over C a √(2 g Δh) with the mean of the levels' differences, from 0.5 to 1.5 s."""
    dx = (_SLOT[1] - _SLOT[0]) / p["cells"]
    middle = _BASIN + 0.5 * max(2, round(p["cells"] / 2)) * dx
    wide = simulation.scene.upper[0] - middle
    high, root = [], []
    for _ in advance(simulation, np.linspace(0.5, 1.5, 11)):
        left = right = 0.0
        for body in simulation.particles.values():
            volume = body["mass"].astype(np.float64) / _WATER
            behind = body["position"][:, 0] <= middle
            left += float(volume[behind].sum())
            right += float(volume[~behind].sum())
        high.append(left)
        root.append(math.sqrt(max(left / _BASIN - right / wide, 0.0) * 2 * _GRAVITY))
    area = _CONTRACTED * (_SLOT[1] - _SLOT[0])
    return {"discharge": (high[0] - high[-1]) / (area * float(np.mean(root)))}


# ---- surge --------------------------------------------------------------------------------------

_STILL, _LENGTH, _START = 1.0, 12.0, 1.0  # m: depth, end of the flume, the piston at first
_FROUDE, _RAMP = 0.1, 6.0  # of the piston; its start in √(h/g)
_WINDOW = (1.0, 3.0)  # s after the bore is due at the wall, before the piston sends it back again


def _jump(depth: float, speed: float) -> float:
    """Return the depth behind a bore into water `depth` deep that gains `speed` there, m.

    Mass and momentum: u = (h₂ - h₁) √(g (1/h₁ + 1/h₂) / 2).
    """
    low, high = depth, 10.0 * depth
    for _ in range(80):
        middle = 0.5 * (low + high)
        found = (middle - depth) * math.sqrt(_GRAVITY * (1 / depth + 1 / middle) / 2)
        low, high = (middle, high) if found < speed else (low, middle)
    return 0.5 * (low + high)


_PISTON = _FROUDE * math.sqrt(_GRAVITY * _STILL)  # m/s
_BEHIND = _jump(_STILL, _PISTON)
#: What comes back from the wall stops the water behind the bore, which had the piston's speed.
_STOPPED = _jump(_BEHIND, _PISTON)
_FRONT = _PISTON * _BEHIND / (_BEHIND - _STILL)  # m/s, of the bore


def _surge(p: Parameters, options: Options, debris: bool = False) -> Scene:
    """A piston at a tenth of √(g h) drives a bore against the end of a flume; it may carry a block.

    The block floats half out of the water a metre before the wall.
    """
    dx = _STILL / p["cells"]
    scene: Scene = _scene(p, options, "surge-load", (_LENGTH, 2.5), dx)
    response = options.walls or Slip(cell=p["wall"])
    scene.add_body(
        name="water",
        shape=Box(lower=(_START, 0.0), upper=(_LENGTH, _STILL)),
        material=_water(_STILL, p),
        hydrostatic=_STILL,
        fbar=fluid_fbar(options),
    )
    if debris:
        size = 0.5 * _STILL
        low = (_LENGTH - 1.0 - size, _STILL - 0.5 * size)
        scene.add_body(
            name="block",
            shape=Box(lower=low, upper=(low[0] + size, low[1] + size)),
            material=FixedCorotated(density=0.5 * _WATER, youngs_modulus=1e6, poissons_ratio=0.3),
            subtract_from=("water",),
            **solid_choices(options),
        )
    scene.add_boundary(name="bed", shape=DomainWalls(faces=("y-",)), response=response)
    scene.add_boundary(name="wall", shape=DomainWalls(faces=("x+",)), response=response)
    time = np.linspace(0.0, 9.0, 901)
    share = np.clip(time * math.sqrt(_GRAVITY / _STILL) / _RAMP, 0.0, 1.0)
    speed = _PISTON * share**2 * (3 - 2 * share)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    stroke = TimeTable(
        time=tuple(map(float, time)), value=tuple((float(x), 0.0) for x in way), end="hold"
    )
    scene.add_boundary(
        name="piston",
        shape=Box(lower=(-3.0, -1.0), upper=(_START, 4.0)),
        response=response,
        motion=Displacement(stroke),
    )
    scene.add_sensor(name="load", sensor=LoadCell(boundary="wall", interval=0.01))
    return scene


def _measure_surge(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Load of the wall over ½ ρ g h₃², h₃ behind the bore that comes back, and the largest.

    The mean is over `_WINDOW`, the largest of means over 0.05 s.
    """
    due = (_LENGTH - _START) / _FRONT + 0.5 * _RAMP / math.sqrt(_GRAVITY / _STILL)
    for _ in advance(simulation, (due + _WINDOW[1],)):
        pass
    series = simulation.sensors["load"]
    force = series.values[:, 0] / (0.5 * _WATER * _GRAVITY * _STOPPED**2)
    late = (series.time > due + _WINDOW[0]) & (series.time <= due + _WINDOW[1])
    first = series.time < 0.1 * due
    return {
        "load": float(force[late].mean()),
        "peak": float(np.convolve(force, np.full(5, 0.2), "valid").max()),
        "still": float(force[first].mean() * (_STOPPED / _STILL) ** 2),
    }


def _surge_debris(p: Parameters, options: Options) -> Scene:
    return _surge(p, options, debris=True)


_ENERGY = "energy equation, jet contracted to π/(π + 2)"
_MOMENTUM = "mass and momentum: ½ ρ g h₃² behind the bore that comes back"
_FLOWS: dict[str, dict[str, Any]] = {
    "reduced": {"cells": 4, "flip": 0.95, "wall": "linear", "stiffness": 1.0},
    "full": {"cells": 16, "flip": 0.95, "wall": "linear", "stiffness": 1.0},
}
_SURGES: dict[str, dict[str, Any]] = {
    "reduced": {"cells": 8, "flip": 0.95, "wall": "linear", "stiffness": 1.0},
    "full": {"cells": 32, "flip": 0.95, "wall": "linear", "stiffness": 1.0},
}
_COARSE = f"{_ENERGY}; 0.88 and 0.95 with four cells in the opening"
_DISCHARGE = {
    "reduced": {"discharge": Bound(0.85, 1.1, "1", _COARSE)},
    "full": {"discharge": Bound(0.9, 1.1, "1", _ENERGY)},
}
_LOAD = {"load": Bound(0.97, 1.03, "1", _MOMENTUM), "still": Bound(0.99, 1.01, "1", "½ ρ g h²")}
_LOADS = {"reduced": _LOAD, "full": _LOAD}

CASES: tuple[Case, ...] = (
    Case(
        name="gate", title="A stream under a raised gate: discharge", source=_ENERGY,
        levels=_FLOWS, bounds=_DISCHARGE, build=_gate, measure=_measure_gate,
    ),
    Case(
        name="slot", title="A stream through a slot under water: discharge", source=_ENERGY,
        levels=_FLOWS, bounds=_DISCHARGE, build=_slot, measure=_measure_slot,
    ),
    Case(
        name="surge-load", title="A bore that a wall stops: its load", source=_MOMENTUM,
        levels=_SURGES, bounds=_LOADS, build=_surge, measure=_measure_surge,
    ),
    Case(
        name="surge-debris-load", title="A bore that brings a block to a wall: its load",
        source=_MOMENTUM, levels=_SURGES, bounds=_LOADS, build=_surge_debris,
        measure=_measure_surge,
    ),
)  # fmt: skip
