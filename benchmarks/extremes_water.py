"""Axes of water: one number of a gentle wave in a tank, or of a smaller scene, at its extremes.

The base scene is `extremes_tank.Tank()`. Its length, modulus and gravity go with the axis that is
pushed, so that ρ g H / K stays at or below 0.05.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from extremes_axis import Axis, Trial, bounded, energies, no_energy_gain
from extremes_tank import COMPRESSION, DENSITY, EXPONENT, GRAVITY, Tank

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.base.formulas import Field

# ---- smaller scenes -----------------------------------------------------------------------------

DX = 0.05  # m
MODULUS = 4e5  # Pa, of the base scene
SOUND = math.sqrt(MODULUS / DENSITY)  # m/s
REAL = 2.2e9  # Pa, of water


def _scene(name: str, cells: tuple[int, ...], walls: Any, **options: Any) -> libmpm.Scene:
    """Return an empty domain of so many cells with walls all round, no gravity unless given."""
    dx = options.pop("cell_size", DX)
    scene = libmpm.Scene(
        name=name, dimension=len(cells), cell_size=dx, lower=(0.0,) * len(cells),
        upper=tuple(n * dx for n in cells), method=libmpm.Method(cfl=options.pop("cfl", 0.4)),
        **options,
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    return scene


def _water(modulus: float = MODULUS) -> materials.TaitFluid:
    return materials.TaitFluid(density=DENSITY, bulk_modulus=modulus)


def _time_step(cfl: float = 0.4, dx: float = DX, modulus: float = MODULUS) -> float:
    return cfl * dx / math.sqrt(modulus / DENSITY)


def block(mach: float, part: float = 1.0, steps: int = 1000, per_cell: int = 4) -> Trial:
    """A free block of 4 cells that flies: its velocity, place and volume are known.

    It crosses 24 cells or flies for so many steps of `part` of the stable one.
    """
    speed = mach * SOUND
    scene = _scene("block", (32, 8), boundaries.Slip(cell="held"))
    scene.add_body(
        name="water", shape=shapes.Box(lower=(2 * DX, 2 * DX), upper=(6 * DX, 6 * DX)),
        material=_water(), velocity=(speed, 0.0), particles_per_cell=per_cell,
    )  # fmt: skip
    until = min(steps * part * _time_step(), 22 * DX / speed)

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["water"].read(["position", "velocity", "volume_ratio"])
        away = float(np.mean(read["position"][:, 0])) - 4 * DX
        other = read["velocity"] - (speed, 0.0)
        return (
            bounded("way, of v t", away / (speed * simulation.time), 0.95, 1.05)
            or bounded("rms of v - v₀, of v₀", float(np.sqrt(np.mean(other**2))) / speed, 0, 1e-3)
            or bounded("volume", float(np.mean(read["volume_ratio"])), 0.999, 1.001)
        )

    options = {} if part == 1 else {"time_step": part * _time_step()}
    return Trial(scene=scene, until=until, judge=judge, options=options)


def vortex(mach: float, per_cell: int = 4, loss: float = 0.0, cfl: float = 0.4) -> Trial:
    """Four vortices in a box of 16 x 16 cells that is full, at `loss` = 1 - J everywhere.

    Their kinetic energy falls and never grows, beyond 1 % of its start and what a compression of
    the whole by M² gives back.
    """
    cells, speed = 16, mach * SOUND
    scene = _scene("vortex", (cells, cells), boundaries.Mirror(), cfl=cfl)
    k = 2 * math.pi / (cells * DX)
    u = f"{speed!r} * sin({k!r} * x) * cos({k!r} * y)"
    v = f"-{speed!r} * cos({k!r} * x) * sin({k!r} * y)"
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(cells * DX, cells * DX)),
        material=_water(), velocity=Field(components=(u, v)), particles_per_cell=per_cell,
    )  # fmt: skip
    until = min(2000 * _time_step(), cells * DX / speed)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 50))

    def prepare(simulation: libmpm.Simulation) -> None:
        pressure = MODULUS / EXPONENT * math.expm1(-EXPONENT * math.log1p(-loss))
        count = len(simulation.particles["water"])
        simulation.particles["water"]["pressure"] = np.full(count, pressure)

    def judge(simulation: libmpm.Simulation) -> str:
        columns = energies(simulation)
        kinetic, total = columns["kinetic"], columns["total"]
        volume = float(np.mean(simulation.particles["water"]["volume_ratio"])) / (1 - loss)
        # Water that is stretched or pressed may turn a part of that energy into motion.
        released = 0.05 * abs(columns["elastic"][0]) if loss else 0.0
        most = 1.01 + released / kinetic[0]
        slack = 0.06 if loss else 0.01 + min(mach**2, 0.5)
        return (
            bounded("largest kinetic energy, of its start", kinetic.max() / kinetic[0], 0, most)
            or bounded("gain of energy", (total.max() - total[0]) / kinetic[0], -math.inf, 0.01)
            or bounded("volume, of its start", volume, 1 - slack, 1 + slack)
        )

    return Trial(scene=scene, until=until, judge=judge, prepare=None if loss == 0 else prepare)


def impact(speed: float, cfl: float = 0.4) -> Trial:
    """A block of 8 x 8 cells of water (2.2 GPa) thrown at a wall: energy does not grow."""
    scene = _scene("impact", (24, 24), boundaries.Slip(cell="held"), cfl=cfl)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(DX, 8 * DX), upper=(9 * DX, 16 * DX)),
        material=_water(REAL), velocity=(-speed, 0.0),
    )  # fmt: skip
    until = min(3000 * _time_step(cfl, modulus=REAL), 24 * DX / speed)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 100))
    judge = no_energy_gain(lambda columns: float(columns["kinetic"][0]))
    return Trial(scene=scene, until=until, judge=judge)


def lone(cfl: float, dimension: int = 2) -> Trial:
    """A particle alone, compressed by 1e-4: it breathes with ω² = 4 d K/(ρ Δx²) and must not grow.

    An explicit step is stable for ω Δt < 2, so for a Courant number below 1/√d.
    """
    scene = _scene("lone", (8,) * dimension, boundaries.Slip(cell="held"), cfl=cfl)
    low, high = (3.45 * DX,) * dimension, (3.95 * DX,) * dimension
    scene.add_body(
        name="water", shape=shapes.Box(lower=low, upper=high), material=_water(),
        lattice=(1,) * dimension, fbar=None,
    )  # fmt: skip
    seen: list[float] = []

    def prepare(simulation: libmpm.Simulation) -> None:
        simulation.particles["water"]["pressure"] = np.full(1, 1e-4 * MODULUS)

    def watch(simulation: libmpm.Simulation) -> str:
        seen.append(abs(1 - float(simulation.particles["water"]["volume_ratio"][0])))
        return ""

    def judge(simulation: libmpm.Simulation) -> str:
        return bounded("largest |1 - J|, of its start", max(seen) / 1e-4, 0.0, 10.0)

    return Trial(scene=scene, steps=2000, judge=judge, watch=watch, prepare=prepare, pieces=100)


def falling(
    off: float = 0.3, apart: float = 0.5, dimension: int = 2, cell_size: float = DX
) -> Trial:
    """Particles alone in their cells fall freely, `off` a face of a cell, `apart` cells apart.

    A node ε cells from the end of a particle's kernel has ε²/2 of its mass on every axis.
    """
    dx, count = cell_size, 3
    side = count * apart
    cells = math.ceil(side) + 8
    scene = _scene(
        "falling", (cells,) * dimension, boundaries.Slip(cell="held"), cell_size=dx,
        gravity=(0.0,) * (dimension - 1) + (-GRAVITY,),
    )  # fmt: skip
    half = side / 2 * dx
    middle = (cells // 2 + off) * dx
    scene.add_body(
        name="water", material=_water(MODULUS * dx / DX), lattice=(count,) * dimension,
        shape=shapes.Box(lower=(middle - half,) * dimension, upper=(middle + half,) * dimension),
    )  # fmt: skip
    until = math.sqrt(2 * dx / GRAVITY)  # a cell

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["water"].read(["position", "velocity"])
        t = simulation.time
        fallen = middle - float(np.mean(read["position"][:, -1]))
        speed = -float(np.mean(read["velocity"][:, -1]))
        return bounded("way, of g t²/2", fallen / (GRAVITY * t * t / 2), 0.97, 1.03) or bounded(
            "speed, of g t", speed / (GRAVITY * t), 0.98, 1.02
        )

    return Trial(scene=scene, until=until, judge=judge)


def film(thick: float, per_cell: int = 4) -> Trial:
    """A film so many cells thick and 8 wide lies on its bed: it stays there, at rest."""
    scene = _scene("film", (8, 8), boundaries.Mirror(), gravity=(0.0, -GRAVITY))
    rows = max(1, round(thick * math.sqrt(per_cell)))
    scene.add_body(
        name="water", material=_water(DENSITY * GRAVITY * DX / COMPRESSION),
        shape=shapes.Box(lower=(0.0, 0.0), upper=(8 * DX, thick * DX)),
        lattice=(round(8 * math.sqrt(per_cell)), rows), hydrostatic=thick * DX,
    )  # fmt: skip

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["water"].read(["position", "velocity", "volume_ratio"])
        scale = math.sqrt(GRAVITY * DX)
        return (
            bounded("rms speed", float(np.sqrt(np.mean(read["velocity"] ** 2))) / scale, 0, 1e-2)
            or bounded("highest particle", read["position"][:, 1].max() / DX, 0, max(thick, 0.5))
            or bounded("volume", float(np.mean(read["volume_ratio"])), 0.98, 1.01)
        )

    return Trial(scene=scene, steps=2000, judge=judge)


def slab(cells: int) -> Trial:
    """A 3D tank of 6 cells by 4 of water and so many thick, at rest between mirrors."""
    scene = _scene("slab", (6, cells, 7), boundaries.Mirror(), gravity=(0.0, 0.0, -GRAVITY))
    depth = 4 * DX
    scene.add_body(
        name="water", material=_water(DENSITY * GRAVITY * depth / COMPRESSION),
        shape=shapes.Box(lower=(0.0, 0.0, 0.0), upper=(6 * DX, cells * DX, depth)),
        hydrostatic=depth,
    )  # fmt: skip

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["water"].read(["position", "velocity", "volume_ratio"])
        speed = float(np.sqrt(np.mean(read["velocity"] ** 2))) / math.sqrt(GRAVITY * depth)
        middle = float(np.mean(read["position"][:, 2])) / depth
        return (
            bounded("rms speed", speed, 0.0, 1e-3)
            or bounded("height of the middle", middle, 0.48, 0.52, "H")
            or bounded("volume", float(np.mean(read["volume_ratio"])), 0.985, 1.005)
        )

    return Trial(scene=scene, steps=500, judge=judge)


def sampled(interval: float, cell_size: float = DX) -> Trial:
    """The tank with a sensor whose interval is so many time steps: its samples follow the rule."""
    tank = Tank(wide=8, deep=4, air=3, wave=0.0, cell_size=cell_size)
    every = interval * tank.time_step
    scene = tank.scene()
    scene.add_sensor(
        name="gauge", sensor=sensors.WaveGauge(position=(2 * cell_size,), interval=every)
    )
    steps = 200

    def judge(simulation: libmpm.Simulation) -> str:
        count = len(simulation.sensors["gauge"].time)
        expected = min(steps, steps / interval) + 1
        return bounded("number of samples", count, 0.95 * expected - 2, 1.05 * expected + 2)

    return Trial(scene=scene, steps=steps, judge=judge)


# ---- the axes -----------------------------------------------------------------------------------

BASE = Tank()
SMALL = Tank(wide=8, deep=4, air=3, wave=0.0)


def _tank(name: str, tank: Tank = BASE) -> Callable[[float], Trial]:
    """Return what builds the tank with one of its numbers changed."""
    whole = isinstance(getattr(BASE, name), int) and not isinstance(getattr(BASE, name), bool)
    return lambda value: replace(tank, **{name: round(value) if whole else value}).trial()


def _stiff(modulus: float, tank: Tank = BASE) -> Trial:
    """Build the tank with a bulk modulus; gravity falls where ρ g H/K would exceed 0.05."""
    largest = 0.05 * modulus / (DENSITY * tank.depth)
    return replace(tank, bulk_modulus=modulus, gravity=min(tank.gravity, largest)).trial()


def _heavy(gravity: float) -> Trial:
    if gravity == 0:
        return replace(BASE, gravity=0.0, bulk_modulus=MODULUS).trial()
    return replace(BASE, gravity=gravity).trial()


def _wide(cells: float, **other: int) -> Trial:
    return Tank(wide=round(cells), wave=0.0, **other).trial()


#: Of the warning about spray at too long a step.
ALONE = "a particle of fluid alone"

AXES: tuple[Axis, ...] = (
    Axis(
        "cfl", "1", "Method.cfl of the tank", 0.4, (0.01, 0.5), (1e-4, 10.0), "log", _tank("cfl"),
        says="many particles: stable to 1.0 and beyond; Method refuses more than 1",
    ),
    Axis(
        "cfl, lone particle, 2D", "1", "Method.cfl of a particle alone", 0.4, (0.01, 0.5),
        (1e-4, 10.0), "log", lone, says="exact: stable below 1/√2 = 0.707", warns=ALONE,
    ),
    Axis(
        "cfl, lone particle, 3D", "1", "Method.cfl of a particle alone", 0.4, (0.01, 0.5),
        (1e-4, 10.0), "log", lambda v: lone(v, 3), says="exact: stable below 1/√3 = 0.577",
        warns=ALONE,
    ),
    Axis(
        "bulk modulus", "Pa", "K; gravity falls with it below 8e4 Pa", MODULUS, (1e5, 1e10),
        (1e3, 1e11), "log", _stiff,
    ),
    Axis(
        "cell size", "m", "Δx; the tank and K grow with it", DX, (1e-3, 10.0), (1e-5, 100.0),
        "log", _tank("cell_size"),
    ),
    Axis(
        "distance from the origin", "m", "Scene.origin", 1.0, (1.0, 1e5), (1.0, 1e16), "log",
        _tank("origin"), says="positions are kept from the domain's corner; float64 else",
    ),
    Axis(
        "coordinates", "m", "Scene.lower", 1.0, (1.0, 1e5), (1.0, 1e16), "log", _tank("lower"),
        says="a domain is a whole number of cells, to 1e-6, in float64",
    ),
    Axis(
        "steps", "1", "a tank of 8 x 4 cells at rest", 1e3, (1e3, 1e6), (1e3, 1e6), "integer",
        lambda v: SMALL.rest(round(v)), limit=400.0, cheap=False,
    ),
    Axis(
        "steps, to 1e7", "1", "a tank of 8 x 4 cells at rest", 1e7, None, (1e7, 1e7), "integer",
        lambda v: SMALL.rest(round(v)), limit=4000.0, on_demand=True, cheap=False, also=(1e7,),
        warns="middle has sunk",
    ),
    Axis(
        "steps, stiff", "1", "the same with K = 1e10 Pa", 1e3, (1e3, 1e6), (1e3, 1e6), "integer",
        lambda v: replace(SMALL, bulk_modulus=1e10).rest(round(v)), limit=400.0, cheap=False,
        says="float32 with J stored would lose every increment below 3e-8; 1 - J is stored",
    ),
    Axis(
        "volume ratio, compressed", "1", "J everywhere in a full box with slow vortices", 0.999,
        (0.95, 0.999), (0.051, 0.999), "linear", lambda v: vortex(0.02, loss=1 - v),
    ),
    Axis(
        "volume ratio, expanded", "1", "J everywhere in a full box with slow vortices", 1.001,
        (1.001, 1.05), (1.001, 19.9), "log", lambda v: vortex(0.02, loss=1 - v),
    ),
    Axis(
        "compression", "1", "ρ g H/K of the tank", COMPRESSION, (1e-7, 0.05), (1e-14, 100.0),
        "log", _tank("compression"),
    ),
    Axis(
        "particles per cell", "1", "of the tank", 4, (1, 64), (1, 512), "integer",
        _tank("particles_per_cell"),
    ),
    Axis(
        "width, cells", "1", "a tank so wide, 8 cells deep, at rest", 4, (1, 16), (1, 64),
        "integer", _wide,
    ),
    Axis(
        "depth, cells", "1", "a tank so deep, 4 cells wide, at rest", 4, (1, 16), (1, 64),
        "integer", lambda v: Tank(wide=4, deep=round(v), wave=0.0).trial(),
    ),
    Axis(
        "air, cells", "1", "rows of air above the tank at rest; 0: it is full", 4, (1, 16),
        (1, 256), "integer", lambda v: Tank(air=round(v), wave=0.0).trial(), also=(0,),
    ),
    Axis(
        "thickness, cells", "1", "of a 3D tank of 6 cells by 4, at rest", 4, (1, 16), (1, 16),
        "integer", lambda v: slab(round(v)),
    ),
    Axis(
        "particles apart", "cells", "nine particles that fall freely", 0.5, (0.5, 8.0),
        (0.01, 1000.0), "log", lambda v: falling(apart=v),
    ),
    Axis(
        "nearly empty node", "cells", "how far the end of a kernel reaches, 3D, Δx = 1 mm", 0.3,
        (1e-6, 0.3), (1e-18, 0.3), "log", lambda v: falling(v, 1.0, 3, 1e-3),
    ),
    Axis(
        "flight", "Mach", "speed of a free block", 0.05, (1e-4, 0.3), (1e-12, 1e4), "log", block,
        says="float32 rounds a place to 3e-8 cells", warns="precision resolves",
    ),
    Axis(
        "flow", "Mach", "speed of vortices in a full box", 0.05, (1e-4, 0.3), (1e-8, 10.0), "log",
        vortex, says="beyond Mach 0.5 they collide and decay",
    ),
    Axis(
        "impact", "m/s", "a block of water (2.2 GPa) thrown at a wall", 10.0, (0.1, 440.0),
        (1e-3, 1e5), "log", impact, says="Mach 0.3 is 445 m/s",
    ),
    Axis(
        "gravity", "m/s²", "of the tank; K goes with it", GRAVITY, (1e-3, 1e4), (1e-25, 1e25),
        "log", _heavy, also=(0.0,),
    ),
    Axis(
        "viscosity", "Pa·s", "of the tank's water", 0.001, (1e-6, 1.0), (1e-12, 1e9), "log",
        _tank("viscosity"), also=(0.0,), says="a step is ≤ Δx²/(4 ν) and falls with it",
    ),
    Axis(
        "film", "cells", "thickness of a film on its bed", 1.0, (0.1, 1.0), (1e-12, 4.0), "log",
        film,
    ),
    Axis(
        "time step", "1", "a fixed one, parts of the stable one; a block at Mach 0.05", 1.0,
        (1e-3, 1.0), (1e-30, 100.0), "log", lambda v: block(0.05, v),
        says="refused above the stable step, and where slow material would not move",
    ),
    Axis(
        "sample interval", "steps", "of a wave gauge", 1.0, (1e-3, 100.0), (1e-30, 1e30), "log",
        sampled,
    ),
)  # fmt: skip


def _pair(name: str, other: str, build: Callable[[float], Trial]) -> Axis:
    """Return an axis within its envelope, with another number at an end of its own."""
    axis = next(a for a in AXES if a.name == name)
    assert axis.envelope is not None
    return replace(
        axis, name=f"{name}, {other}", meaning=f"{axis.meaning}; {other}", build=build,
        reach=axis.envelope, group="pairs of water", says="", also=(),
    )  # fmt: skip


AXES += tuple(
    _pair("bulk modulus", f"Δx = {dx:g} m", lambda v, dx=dx: _stiff(v, replace(BASE, cell_size=dx)))
    for dx in (1e-3, 10.0)
)
AXES += tuple(
    _pair("cell size", f"{far:g} m from the origin", _tank("cell_size", replace(BASE, **{by: far})))
    for by, far in (("lower", 1e5),)
)
AXES += tuple(
    _pair("cfl", f"{n} per cell", _tank("cfl", replace(BASE, particles_per_cell=n)))
    for n in (1, 64)
)
AXES += tuple(_pair("flow", f"{n} per cell", lambda v, n=n: vortex(v, n)) for n in (1, 64))
AXES += tuple(_pair("film", f"{n} per cell", lambda v, n=n: film(v, n)) for n in (1, 64))
AXES += (
    _pair(
        "particles per cell", "ρ g H/K = 0.05",
        _tank("particles_per_cell", replace(BASE, compression=0.05)),
    ),
    replace(
        _pair("sample interval", "Δx = 100 m", lambda v: sampled(v, 100.0)), reach=(1e-30, 1.0),
        says="refused where more than 1e5 samples fall due in a step",
    ),
    replace(
        _pair("impact", "cfl = 0.2", lambda v: impact(v, 0.2)), reach=(1e-3, 1e5),
        says="what breaks an impact is the Courant number of compressed water",
    ),
    replace(
        _pair("volume ratio, compressed", "cfl = 0.1", lambda v: vortex(0.02, 4, 1 - v, 0.1)),
        reach=(0.051, 0.999), says="0.1 J^-3.08 is 1.3 at 0.43",
    ),
)  # fmt: skip
