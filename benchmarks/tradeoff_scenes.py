"""Cases of the trade-off table that have exact solutions and are no reference cases.

A Lamé mode of a free square, u = cos(πx/a) sin(πy/a), v = -sin(πx/a) cos(πy/a), keeps every volume
and swings with ω = √2 π c_s/a whatever Poisson's ratio is; near 1/2 it measures locking. A free
square that spins measures what a method does to rotation. A free bar swings with the period 2 L/c,
and one that hits a wall leaves it after as long, as fast as it came (Saint-Venant). A block half as
dense as water floats with half of it under water (Archimedes). Two bars that meet end on do as one
at a wall, and a block that slides on another stops after v²/(2 μ g).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

import libmpm
from libmpm import boundaries, cases, materials, sensors, shapes
from libmpm._src.advice.cases.choices import energies
from libmpm._src.base.formulas import Field

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


def _swings(simulation: libmpm.Simulation, period: float, count: float) -> dict[str, float]:
    """Run for some periods; return the period, parts of the exact one, and the energy that is left.

    Kinetic and elastic energy are equal four times a period. The energy is the mean of the last
    period, parts of the kinetic energy at the start.
    """
    simulation.run(until=count * period, progress=False)
    time = np.asarray(simulation.sensors["energy"].time)
    columns = energies(simulation)
    excess, total = columns["kinetic"] - columns["elastic"], columns["kinetic"] + columns["elastic"]
    turn = np.flatnonzero(excess[:-1] * excess[1:] < 0)
    part = excess[turn] / (excess[turn] - excess[turn + 1])
    crossing = time[turn] + part * (time[turn + 1] - time[turn])
    # An overdamped mode has one crossing or none.
    enough = len(crossing) > 2
    spacing = np.mean(np.diff(crossing)) if enough else math.nan
    late = time > (count - 1) * period
    return {
        "period": float(4 * spacing / period),
        "energy_left": float(np.mean(total[late]) / columns["kinetic"][0]),
    }


def _read_lame(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Period and energy that is left of the Lamé mode."""
    return _swings(simulation, _period(), p["periods"])


def lame_case(name: str, ratio: float, cells: int, periods: float) -> cases.Case:
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
    # A corner swings 0.21 m beyond the edges at rest.
    roomy = {**p, "margin": max(p["margin"], math.ceil(p["cells"] / 4))}
    scene = _free("spin", roomy, options, _solid(p["material"], modulus, ratio), velocity)
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


# ---- bars ---------------------------------------------------------------------------------------

BAR_SPEED = 1.0  # m/s, of waves in a bar of 1 m


def _bar(p: Parameters, options: cases.Options, velocity: Any, low: float) -> libmpm.Scene:
    """Return the scene of a bar of 1 m that begins at x = 0, free but for its left end's wall.

    `low` is the lower bound of the domain along x, m. Poisson's ratio is 0, so that its waves are
    those of a line.
    """
    dx = 1.0 / p["cells"]
    room, thick = p["margin"] * dx, p["rows"] * dx
    scene = libmpm.Scene(
        name="bar", dimension=2, cell_size=dx, lower=(low, -room), upper=(1.0 + room, thick + room),
        gravity=(0.0, 0.0), method=options.method,
    )  # fmt: skip
    chosen = {} if options.solid_fbar in ("case", None) else {"fbar": options.solid_fbar}
    law = _solid(p["material"], DENSITY * BAR_SPEED**2, 0.0)
    box = shapes.Box(lower=(0.0, 0.0), upper=(1.0, thick))
    scene.add_body(name="solid", shape=box, material=law, velocity=velocity, **chosen)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01 / BAR_SPEED))
    return scene


def _free_bar(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """A free bar with the velocity of its first mode; strains of 0.5 %."""
    velocity = Field(components=(f"{0.005 * BAR_SPEED} * cos(pi * x)", "0"))
    return _bar(p, options, velocity, -p["margin"] / p["cells"])


def _read_free_bar(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Period, parts of 2 L/c, and energy that is left."""
    return _swings(simulation, 2.0 / BAR_SPEED, p["periods"])


def _impact(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """The bar touches the wall and moves towards it at a hundredth of its waves' speed."""
    scene = _bar(p, options, (-0.01 * BAR_SPEED, 0.0), 0.0)
    wall = shapes.DomainWalls(faces=("x-",))
    scene.add_boundary(name="wall", shape=wall, response=boundaries.Separable())
    return scene


def _read_impact(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Contact time, parts of 2 L/c, and restitution, from the velocity of the centre of mass.

    It turns at a constant rate while the wave goes to the free end and back, from -v to v: between
    the halves of both lies half of the contact.
    """
    speed = 0.01 * BAR_SPEED
    time, mean = [0.0], [-1.0]
    for until in np.linspace(0.0, p["until"] / BAR_SPEED, 201)[1:]:
        simulation.run(until=float(until), progress=False)
        time.append(simulation.time)
        mean.append(float(simulation.particles["solid"]["velocity"][:, 0].mean()) / speed)
    rising = np.maximum.accumulate(mean)
    begin, end = (float(np.interp(half, rising, time)) for half in (-0.5, 0.5))
    return {
        "contact": (end - begin) * BAR_SPEED if rising[-1] > 0.5 else math.nan,
        "restitution": float(np.mean(mean[-20:])),
    }


_BAR_SIZE = {"cells": 48, "rows": 4, "margin": 4, "material": "FixedCorotated"}
BAR_CASE = cases.Case(
    name="bar",
    title="Free bar that swings along its axis",
    source="d'Alembert: period 2 L/c",
    levels={"reduced": _BAR_SIZE | {"periods": 6.0}},
    bounds={},
    build=_free_bar,
    measure=_read_free_bar,
)
IMPACT_CASE = cases.Case(
    name="bar-impact",
    title="Bar that hits a rigid wall",
    source="Saint-Venant: contact 2 L/c, restitution 1",
    levels={"reduced": _BAR_SIZE | {"until": 3.5}},
    bounds={},
    build=_impact,
    measure=_read_impact,
)


def _pair(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """Two bars that touch and move towards each other: what each does at a wall, by symmetry."""
    scene = _bar(p, options, (-0.01 * BAR_SPEED, 0.0), -1.0 - p["margin"] / p["cells"])
    box = shapes.Box(lower=(-1.0, 0.0), upper=(0.0, p["rows"] / p["cells"]))
    law = scene.bodies[0].material
    scene.add_body(name="left", shape=box, material=law, velocity=(0.01 * BAR_SPEED, 0.0))
    return scene


PAIR_CASE = cases.Case(
    name="bar-pair",
    title="Two bars that meet end on",
    source="Saint-Venant: contact 2 L/c, restitution 1",
    levels={"reduced": _BAR_SIZE | {"until": 3.5}},
    bounds={},
    build=_pair,
    measure=_read_impact,
)

# ---- block that slides on another ---------------------------------------------------------------

SLIDING, START = 0.3, 1.0  # μ; m/s


def _slide(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """A block twice as long as high on a long one that the floor holds."""
    length, high = 0.4, 0.2  # m
    dx = length / p["cells"]
    scene = libmpm.Scene(
        name="sliding-block", dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(1.2, 0.6),
        gravity=(0.0, -GRAVITY), method=options.method,
    )  # fmt: skip
    law = _solid("FixedCorotated", 1e6, 0.3)
    base = shapes.Box(lower=(0.1, 0.0), upper=(1.1, high))
    block = shapes.Box(lower=(0.2, high), upper=(0.2 + length, 2 * high))
    scene.add_body(name="base", shape=base, material=law)
    scene.add_body(name="block", shape=block, material=law, velocity=(START, 0.0))
    floor = shapes.DomainWalls(faces=("y-",))
    scene.add_boundary(name="floor", shape=floor, response=boundaries.Sticky())
    return scene


def _read_slide(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Way of the block over the base until it rests, parts of v²/(2 μ g)."""

    def apart() -> float:
        places = [simulation.particles[b]["position"][:, 0].mean() for b in ("block", "base")]
        return float(places[0] - places[1])

    start = apart()
    simulation.run(until=p["until"], progress=False)
    return {"distance": (apart() - start) / (START**2 / (2 * SLIDING * GRAVITY))}


SLIDE_CASE = cases.Case(
    name="sliding-block",
    title="Block that slides on another",
    source="Coulomb: v²/(2 μ g)",
    levels={"reduced": {"cells": 8, "until": 0.6}},
    bounds={},
    build=_slide,
    measure=_read_slide,
)

# ---- floating block -----------------------------------------------------------------------------

BLOCK, BASIN, DEPTH = 0.4, 1.2, 0.6  # m: edge of the block, width and depth of the water
HEAVE = 2 * math.pi * math.sqrt(BLOCK / GRAVITY)  # s, with as much water moved as the block weighs


def _floating(p: Parameters, options: cases.Options) -> libmpm.Scene:
    """The block afloat at its draft, at rest; water is strained by 0.5 % at the bed."""
    dx = BLOCK / p["cells"]
    scene = libmpm.Scene(
        name="floating-block", dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(BASIN, BASIN),
        gravity=(0.0, -GRAVITY), method=options.method,
    )  # fmt: skip
    water = materials.TaitFluid(density=DENSITY, bulk_modulus=200 * DENSITY * GRAVITY * DEPTH)
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(BASIN, DEPTH)),
        material=water,
        fbar=None if options.fbar == "case" else options.fbar,
        hydrostatic=DEPTH,
    )
    chosen = {} if options.solid_fbar in ("case", None) else {"fbar": options.solid_fbar}
    corner = ((BASIN - BLOCK) / 2, DEPTH - BLOCK / 2)
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=corner, upper=(corner[0] + BLOCK, corner[1] + BLOCK)),
        material=materials.FixedCorotated(
            density=DENSITY / 2, youngs_modulus=5e5, poissons_ratio=0.3
        ),
        subtract_from=("water",),
        **chosen,
    )
    walls = shapes.DomainWalls(faces=("x-", "x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=boundaries.Slip())
    return scene


def _read_floating(simulation: libmpm.Simulation, p: Parameters) -> dict[str, float]:
    """Draft, parts of half an edge, the mean of the last heave, and its swing.

    Where the base sinks by b, the level rises by b B/(W - B), so that the draft grows by b W/(W-B).
    """
    block = simulation.particles["block"]
    start = block["position"]
    base = start[:, 1] < start[:, 1].min() + 1e-6
    begin = float(start[base, 1].mean())
    sunk = []
    for until in p["until"] + HEAVE * np.linspace(-1.0, 0.0, 41):
        simulation.run(until=float(until), progress=False)
        sunk.append(begin - float(block["position"][base, 1].mean()))
    part = BASIN / (BASIN - BLOCK) / (BLOCK / 2)
    return {"draft": 1 + part * float(np.mean(sunk)), "swing": part * float(np.ptp(sunk)) / 2}


FLOATING_CASE = cases.Case(
    name="floating-block",
    title="Block half as dense as water, afloat",
    source="Archimedes: draft of half an edge",
    levels={"reduced": {"cells": 8, "until": 4.0}},
    bounds={},
    build=_floating,
    measure=_read_floating,
)
