"""Reference cases of water alone: a tank at rest, sloshing, a dam break and a vortex.

Sources are sections of Bonus (2023) unless a case says otherwise. Scenes are planes x, y with
gravity along -y; on level "full" some are slabs. All are in SI units, per metre of thickness in 2D.
Reduced level on one core: tank 4 s, sloshing 8 s, dam break 1 s, vortex 1 s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import Slab, advance, energies, fluid_fbar, method_of, rms
from libmpm._src.advice.cases.coupled import CASES as _COUPLED
from libmpm._src.base.formulas import Field
from libmpm._src.boundaries.responses import Mirror, Response, Separable, Slip
from libmpm._src.materials.generated import TaitFluid
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import Energy, LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls

__all__ = ["CASES"]

Parameters = Mapping[str, Any]
Floats = npt.NDArray[np.float64]

_WATER = 1000.0  # kg/m³


def _stiffness(depth: float, gravity: float) -> float:
    """Return the bulk modulus whose wave speed is ten times the speed of a fall over `depth`."""
    return _WATER * 100 * 2 * gravity * depth


# ---- tank ---------------------------------------------------------------------------------------


def _tank(p: Parameters, options: Options) -> Scene:
    """Water in hydrostatic balance between slip walls, eight cells of air above."""
    cells, gravity = p["cells"], p["gravity"]
    dx = p["depth"] / cells
    method = method_of(options, 0.3)
    method = replace(method, cfl=method.cfl * p["time_step_factor"])
    slab = Slab(dx)
    width, bed = p["width"] * dx, p["offset"] * dx
    scene = slab.scene("tank", (0.0, 0.0), (width, p["depth"] + 8 * dx), gravity, method)
    common: dict[str, Any] = {
        "material": TaitFluid(density=_WATER, bulk_modulus=_stiffness(p["depth"], gravity)),
        "fbar": fluid_fbar(options),
        "hydrostatic": bed + p["depth"],
    }
    if p["jitter"] == 0:
        box = slab.box((0.0, bed), (width, bed + p["depth"]))
        scene.add_body(name="water", shape=box, **common)
    else:
        _add_disordered(scene, p, bed, common)
    walls = DomainWalls(faces=("x-", "x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=options.walls or Slip(cell="held"))
    return scene


def _add_disordered(scene: Scene, p: Parameters, bed: float, common: dict[str, Any]) -> None:
    """Add each particle of a lattice as a body, off its place by up to `jitter` < 0.12 cells.

    Particles beside a wall move only along it. A later box takes nothing from those that it
    overlaps, since it does not reach their middles; bodies that are alike are stepped as one.
    """
    shape = (2 * p["width"], 2 * p["cells"])
    place = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij"), axis=-1) / 2
    move = np.random.default_rng(1).uniform(-p["jitter"], p["jitter"], place.shape)
    move[[0, -1], :, 0] = 0
    move[:, 0, 1] = 0
    place = (place + move) * scene.cell_size + (0.0, bed)
    half = scene.cell_size / 4
    for i, k in np.ndindex(shape):
        before = ((i - 1, k - 1), (i - 1, k), (i - 1, k + 1), (i, k - 1))
        x, y = place[i, k]
        scene.add_body(
            name=f"water-{i}-{k}",
            shape=Box(lower=(x - half, y - half), upper=(x + half, y + half)),
            lattice=(1, 1),
            subtract_from=[f"water-{a}-{b}" for a, b in before if a >= 0 and 0 <= b < shape[1]],
            **common,
        )


def _read_tank(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Run and read errors of the pressure, parts of ρ g H, and speeds, parts of √(g H)."""
    steps = round(p["steps"] / p["time_step_factor"])
    tenth, samples, squares = steps // 10, 40, []
    sim.step(steps - tenth)
    for k in range(samples):
        sim.step(tenth * (k + 1) // samples - tenth * k // samples)
        squares.append(np.mean(np.sum(sim.grid["velocity"] ** 2, axis=1)))
    read = [b.read(["position", "pressure"]) for b in sim.particles.values()]
    place = np.concatenate([r["position"] for r in read]) / p["depth"]
    place[:, 1] -= p["offset"] / p["cells"]  # from where the fill began
    pressure = np.concatenate([r["pressure"] for r in read])
    scale = _WATER * p["gravity"] * p["depth"]
    error = pressure / scale - (1 - place[:, 1])
    cells, width = p["cells"], p["width"]
    column, row = (
        np.clip((place[:, a] * cells).astype(int), 0, n - 1) for a, n in ((0, width), (1, cells))
    )
    layer = _means(row, error, cells)
    cell = _means(column * cells + row, pressure / scale, width * cells).reshape(width, cells)
    # A field linear in the place has no part that alternates over two by two cells.
    alternating = (cell[:-1, :-1] - cell[1:, :-1] - cell[:-1, 1:] + cell[1:, 1:]) / 4
    return {
        "profile": rms(layer),
        "bed": float(abs(layer[0])),
        "surface": float(abs(layer[-1])),
        "speed": math.sqrt(float(np.mean(squares)) / (p["gravity"] * p["depth"])),
        "checkerboard": rms(alternating),
        "noise": rms(error),
        "level": float(2 * np.mean(place[:, 1]) - 1),
    }


def _means(index: npt.NDArray[np.int64], values: Floats, count: int) -> Floats:
    """Return the mean of the values of each index; zero where there are none."""
    members = np.bincount(index, minlength=count)
    return np.bincount(index, weights=values, minlength=count) / np.maximum(members, 1)


_AT_REST = {
    "profile": Bound(0.0, 0.01, "ρgH", "hydrostatic balance, rms of the layers' means"),
    "bed": Bound(0.0, 0.02, "ρgH", "hydrostatic balance, lowest layer of cells"),
    "surface": Bound(0.0, 0.02, "ρgH", "hydrostatic balance, highest layer of cells"),
    "speed": Bound(0.0, 1e-4, "√(gH)", "rest; rms of the nodes over the last tenth"),
}

_FILL = {
    "cells": 40,
    "width": 3,
    "depth": 1.0,
    "gravity": 9.81,
    "steps": 100_000,
    "time_step_factor": 1.0,
    "offset": 0.0,  # cells by which the fill starts above the bed
    "jitter": 0.0,  # cells by which particles are off their places at most
}

# "full" is 480 x 4e5 = 1.9e8 particle-steps, or 5.1e8 at width 8: the launches count, 10 s.
_TANK = Case(
    name="tank",
    title="Tank at rest: pressure, residual speed and checkerboard after many steps",
    source="ρg(H - y); Bonus (2023), 6.4",
    levels={"reduced": _FILL, "full": _FILL | {"steps": 400_000}},
    bounds={"reduced": _AT_REST, "full": _AT_REST},
    build=_tank,
    measure=_read_tank,
)


# ---- sloshing -----------------------------------------------------------------------------------

_LENGTH = 3.2  # m, of the tank and still-water depth


def _sloshing(p: Parameters, options: Options) -> Scene:
    """Columns of water two cells wide, from 3.3 m at the left to 3.1 m at the right.

    The side walls stand `gap` cells off the water. Mirrored walls meet it. Those that hold nodes
    (`mirror` False) strain the cells beside them by half: with `gap` 0 the period is 8 % short at
    Δx 0.1 and 3 % at 0.05, with half a cell it is right, and the misfit at the walls takes the
    motion away (design/fbar.md, 6).
    """
    dx = p["cell_size"]
    slab = Slab(dx, p["thickness"])
    gravity = 10.0
    away = p["gap"] * dx
    scene = slab.scene(
        "sloshing", (-away, 0.0), (_LENGTH + away, 1.5 * _LENGTH), gravity, method_of(options, 0.3)
    )
    columns = round(_LENGTH / dx) // 2
    for n in range(columns):
        level = _LENGTH + 0.1 - 0.2 * (n + 0.5) / columns
        scene.add_body(
            name=f"water-{n}",
            shape=slab.box((2 * n * dx, 0.0), (2 * (n + 1) * dx, level)),
            material=TaitFluid(density=_WATER, bulk_modulus=p["bulk_modulus"]),
            fbar=fluid_fbar(options),
            hydrostatic=level,
        )
    walls = DomainWalls(faces=slab.faces("x-", "x+", "y-"))
    scene.add_boundary(
        name="walls", shape=walls, response=Mirror() if p["mirror"] else Slip(cell="held")
    )
    return scene


def _read_sloshing(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Period and decay of the motion of the centre of mass along the tank."""

    masses = [math.prod(b.shape.size) for b in sim.scene.bodies if isinstance(b.shape, Box)]

    def away() -> float:
        place = [np.mean(body["position"][:, 0]) for body in sim.particles.values()]
        return float(np.average(place, weights=masses)) - _LENGTH / 2

    time, x = [0.0], [away()]
    for now in advance(sim, np.arange(1, 281) * 0.02):
        time.append(now)
        x.append(away())
    return swing(np.array(time), np.array(x))


def swing(t: npt.NDArray[np.float64], moved: npt.NDArray[np.float64]) -> dict[str, float]:
    """Return period, s, and amplitude after five half cycles over that at the start.

    NaN is what the history does not show: a period takes two passes through the middle.
    """
    turn = np.flatnonzero(moved[:-1] * moved[1:] < 0)
    if len(turn) < 2:
        return {"period": math.nan, "amplitude": math.nan}
    crossing = t[turn] + (t[turn + 1] - t[turn]) * moved[turn] / (moved[turn] - moved[turn + 1])
    half = np.mean(np.diff(crossing))
    # The motion turns round half-way between its zeros: five half cycles after the start.
    fifth = np.abs(moved[np.abs(t - 5 * half) < half / 2])
    there = t[-1] >= 5 * half
    return {
        "period": float(2 * half),
        "amplitude": float(fifth.max() / abs(moved[0])) if there else math.nan,
    }


def _sloshing_bounds(amplitude: float) -> dict[str, Bound]:
    """Return the bounds with the least amplitude left after five half cycles."""
    return {
        "period": Bound(0.98 * 2.0031, 1.02 * 2.0031, "s", "linear wave, Bonus (2023), 6.5"),
        "amplitude": Bound(amplitude, 1.02, "1", "inviscid: 1"),
    }


# "full" is 128 x 128 x 16 cells of 8 particles, 1.1e5 steps: 2.3e11 particle-steps, a minute.
_SLOSHING = Case(
    name="sloshing",
    title="First sloshing mode of a tank 3.2 m long and deep: period and decay",
    source="Bonus (2023), 6.5",
    levels={
        "reduced": {
            "cell_size": 0.1, "thickness": 0.0, "bulk_modulus": 2.2e7, "gap": 0.0, "mirror": True,
        },
        "full": {
            "cell_size": 0.025, "thickness": 0.4, "bulk_modulus": 2.2e7, "gap": 0.0, "mirror": True,
        },
    },
    bounds={"reduced": _sloshing_bounds(0.75), "full": _sloshing_bounds(0.95)},
    build=_sloshing,
    measure=_read_sloshing,
)  # fmt: skip


# ---- dam break ----------------------------------------------------------------------------------


def _dam_break(p: Parameters, options: Options) -> Scene:
    """A column a wide and 2a high at the left of a tank 5a long, walls that may be left."""
    a, gravity = p["width"], 9.81
    slab = Slab(a / p["cells"], p["thickness"])
    method = method_of(options, 0.4)
    scene = slab.scene("dam-break", (0.0, 0.0), (5 * a, 4 * a), gravity, method)
    scene.add_body(
        name="water",
        shape=slab.box((0.0, 0.0), (a, 2 * a)),
        material=TaitFluid(density=_WATER, bulk_modulus=_stiffness(2 * a, gravity)),
        fbar=fluid_fbar(options),
    )
    sides: dict[str, Response] = dict.fromkeys(("x-", "x+", "y-", "y+"), Separable(cell="held"))
    if p["thickness"]:
        sides |= {"z-": Slip(cell="held"), "z+": Slip(cell="held")}
    scene.add_boundary(name="walls", shape=DomainWalls(), response=sides)
    crossing = math.sqrt(a / (2 * gravity))
    cell = LoadCell(boundary="walls", faces=("x+",), interval=0.05 * crossing)
    scene.add_sensor(name="wall", sensor=cell)
    scene.add_sensor(name="energy", sensor=Energy(interval=0.05 * crossing))
    return scene


def _read_dam_break(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Front on the bed before it meets the wall, load of the wall after, and the energy.

    Times are in sqrt(a / 2g) and places in a. The front is the 99.5th percentile of the places of
    particles; its speed, from 1.5 a to 3 a, does not depend on how the column was released.
    """
    a, gravity = p["width"], 9.81
    crossing = math.sqrt(a / (2 * gravity))
    per_area = p["thickness"] or 1.0
    time, front = [], []
    for now in advance(sim, np.linspace(0.0, p["until"], 101)[1:] * crossing):
        time.append(now / crossing)
        front.append(np.percentile(sim.particles["water"]["position"][:, 0], 99.5) / a)
    reached = [float(np.interp(z, np.maximum.accumulate(front), time)) for z in (1.5, 3.0)]
    energy = energies(sim)["total"]
    # What the fall can set free: from 2a high and a wide to a/2.5 all over the bed.
    released = 0.5 * _WATER * gravity * per_area * (a * (2 * a) ** 2 - 5 * a * (0.4 * a) ** 2)
    load = np.asarray(sim.sensors["wall"].values)[:, 0] / per_area
    return {
        "front_speed": 1.5 / (reached[1] - reached[0]),
        "front_time": reached[1],
        "energy_gain": float(np.max(energy - energy[0]) / released),
        "energy_lost": float((energy[0] - energy[-1]) / released),
        "wall_force": float(np.max(load) / (0.5 * _WATER * gravity * (2 * a) ** 2)),
    }


_MARTIN = "Martin and Moyce (1952), column twice as high as wide, a = 2.25 in"
_DAM_BREAK_BOUNDS = {
    "energy_gain": Bound(-math.inf, 0.01, "of the fall's", "nothing does work on the water"),
    "front_speed": Bound(0.85 * 1.16, 1.15 * 1.16, "√(2ga)", _MARTIN),
}

# "full" is 160 x 320 x 16 cells of 8 particles, 6.5e6, 1.3e4 steps: 9e10 particle-steps.
_DAM_BREAK = Case(
    name="dam-break",
    title="Column of water released in a tank: front, energy, force on the far wall",
    source=_MARTIN,
    levels={
        "reduced": {"cells": 20, "width": 1.0, "thickness": 0.0, "until": 8.0},
        "full": {"cells": 160, "width": 1.0, "thickness": 0.1, "until": 8.0},
    },
    bounds={"reduced": _DAM_BREAK_BOUNDS, "full": _DAM_BREAK_BOUNDS},
    build=_dam_break,
    measure=_read_dam_break,
)


# ---- vortex -------------------------------------------------------------------------------------


def _vortex(p: Parameters, options: Options) -> Scene:
    """One vortex filling a box of slip walls, under pressure enough that nothing is in tension."""
    speed, gravity = 1.0, 1.0
    slab = Slab(1.0 / p["cells"])
    scene = slab.scene("vortex", (0.0, 0.0), (1.0, 1.0), gravity, method_of(options, 0.4))
    scene.add_body(
        name="water",
        shape=slab.box((0.0, 0.0), (1.0, 1.0)),
        material=TaitFluid(density=_WATER, bulk_modulus=_WATER * (20 * speed) ** 2, viscosity=0.0),
        velocity=Field(
            components=("sin(pi * x) * cos(pi * y)", "-cos(pi * x) * sin(pi * y)"),
        ),
        fbar=fluid_fbar(options),
        hydrostatic=1.0 + 2 * speed**2 / gravity,
    )
    scene.add_boundary(
        name="walls", shape=DomainWalls(), response=options.walls or Slip(cell="held")
    )
    scene.add_sensor(name="energy", sensor=Energy(interval=0.02))
    return scene


def _read_vortex(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Share of the kinetic energy that is left after the turnovers L/U, the mean of the last tenth.

    The time is that in which the fastest particle crosses the box.
    """
    until = p["turnovers"]
    sim.run(until=until, progress=False)
    series = sim.sensors["energy"]
    kinetic = np.asarray(series.values)[:, list(series.components).index("kinetic")]
    late = np.asarray(series.time) > 0.9 * until
    return {
        "kinetic_left": float(np.mean(kinetic[late]) / (_WATER / 4)),
        "kinetic_peak": float(np.max(kinetic) / (_WATER / 4)),
    }


_VORTEX_BOUNDS = {
    "kinetic_peak": Bound(0.0, 1.02, "of the start", "nothing does work on the water"),
}

# "full" is 512 x 512 cells of 4 particles, 5.1e4 steps: 5e10 particle-steps.
_VORTEX = Case(
    name="vortex",
    title="Taylor-Green vortex in a box of slip walls: what the method dissipates",
    source="Euler's equations: the flow is steady, its energy stays",
    levels={
        "reduced": {"cells": 32, "turnovers": 2.0},
        "full": {"cells": 512, "turnovers": 2.0},
    },
    bounds={"reduced": _VORTEX_BOUNDS, "full": _VORTEX_BOUNDS},
    build=_vortex,
    measure=_read_vortex,
)

CASES: tuple[Case, ...] = (_TANK, _SLOSHING, _DAM_BREAK, _VORTEX, *_COUPLED)
