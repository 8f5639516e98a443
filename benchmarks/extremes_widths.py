"""Axes of sizes: domains of one cell and of more than can be numbered, bodies of one particle and
of more than fit, and numbers at the ends of what a number type holds.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any

import numpy as np
from extremes_axis import Axis, Trial, bounded
from extremes_solids import (
    DENSITY,
    DX,
    GRAVITY,
    POISSON,
    YOUNG,
    axis,
    bar,
    cells,
    domain,
    solid,
    wave_speed,
)

import libmpm
from libmpm import boundaries


def flight(
    room: tuple[float, ...] = (24, 12), *, size: float = 4.0, per_cell: int | None = None,
    lattice: tuple[int, ...] | None = None, density: float = DENSITY, mach: float = 0.05,
    young: float | None = None, steps: int = 200,
) -> Trial:  # fmt: skip
    """A body of `size` cells flies freely in the middle of `room` cells: way, speed, J are known.

    It crosses at most 4 cells. `young` None keeps the wave speed.
    """
    d = len(room)
    scale = density / DENSITY if young is None else young / YOUNG
    material = solid(density=density, young=YOUNG * scale)
    c = wave_speed(YOUNG * scale, POISSON, density)
    speed = mach * c
    scene = domain("flight", tuple(round(n) for n in room), boundaries.Slip(cell="held"))
    low = tuple(math.floor(n / 2) - size / 2 for n in room)
    scene.add_body(
        name="body", shape=cells(*low, size=(size,) * d), material=material, lattice=lattice,
        velocity=(speed, *(0.0,) * (d - 1)), particles_per_cell=per_cell,
    )  # fmt: skip
    until = min(steps * 0.4 * DX / c, 4 * DX / speed)
    begun: list[Any] = []
    # Places are float64 from the corner of the domain.
    unit = float(np.spacing(room[0] * DX)) / DX

    def prepare(simulation: libmpm.Simulation) -> None:
        begun.append(simulation.particles["body"]["position"])

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["body"].read(["position", "velocity", "volume_ratio"])
        way = float((read["position"][:, 0] - begun[0][:, 0]).mean()) / DX
        straight = speed * simulation.time / DX
        off = read["velocity"] - np.eye(d)[0] * speed
        return (
            bounded("way, cells", way, 0.99 * straight - unit, 1.01 * straight + unit)
            or bounded("largest of v - v₀, of v₀", float(np.abs(off).max()) / speed, 0.0, 1e-3)
            or bounded("volume", float(read["volume_ratio"].mean()), 0.999, 1.001)
        )

    return Trial(scene=scene, until=until, judge=judge, prepare=prepare)


def column(widths: tuple[int, ...], high: int = 8) -> Trial:
    """A solid fills a domain so many cells wide, `high` cells of its height, under its weight.

    Between mirrored walls it swings about u = ρ g H²/(3 M) below its place, the mean of linear
    theory, with M the modulus of the pressure wave and ρ g H/M = 0.02, and so from 0 to 2 u.
    """
    d = len(widths) + 1
    height = high * DX
    modulus = DENSITY * GRAVITY * height / 0.02
    young = YOUNG * modulus / (DENSITY * wave_speed() ** 2)
    scene = domain(
        "column", (*widths, high + 2), boundaries.Mirror(), gravity=(*(0.0,) * (d - 1), -GRAVITY)
    )
    scene.add_body(
        name="body", shape=cells(*(0,) * d, size=(*widths, high)), material=solid(young=young)
    )
    period = 4 * height / math.sqrt(modulus / DENSITY)
    fallen: list[float] = []
    begun: list[float] = []

    def prepare(simulation: libmpm.Simulation) -> None:
        begun.append(float(simulation.particles["body"]["position"][:, -1].mean()))

    def watch(simulation: libmpm.Simulation) -> str:
        fallen.append(begun[0] - float(simulation.particles["body"]["position"][:, -1].mean()))
        return ""

    def judge(simulation: libmpm.Simulation) -> str:
        still = 0.02 * height / 3
        across = np.abs(simulation.particles["body"]["velocity"][:, :-1]).max()
        return (
            bounded("mean fall, of ρ g H²/(3 M)", float(np.mean(fallen)) / still, 0.8, 1.2)
            or bounded("largest fall, of ρ g H²/(3 M)", max(fallen) / still, 1.2, 2.3)
            or bounded("speed across, of the waves'", float(across) / wave_speed(young), 0, 1e-3)
        )

    return Trial(
        scene=scene, until=3 * period, judge=judge, prepare=prepare, watch=watch, pieces=60
    )


def apart(spacing: float) -> Trial:
    """Nine particles of a solid, `spacing` cells apart, fall freely: g t and g t²/2."""
    side = 3 * spacing
    room = math.ceil(side) + 8
    scene = domain("apart", (room, room), gravity=(0.0, -GRAVITY))
    scene.add_body(
        name="body", shape=cells(*((room - side) / 2 + 0.3,) * 2, size=(side, side)),
        material=solid(), lattice=(3, 3),
    )  # fmt: skip
    until = math.sqrt(2 * DX / GRAVITY)  # a cell

    def judge(simulation: libmpm.Simulation) -> str:
        v = simulation.particles["body"]["velocity"]
        fall = -v[:, 1] / (GRAVITY * simulation.time)
        return bounded("least speed, of g t", float(fall.min()), 0.98, 1.02) or bounded(
            "largest speed, of g t", float(fall.max()), 0.98, 1.02
        )

    return Trial(scene=scene, until=until, judge=judge)


def many(count: float) -> Trial:
    """A body of so many particles, of which only a few are run here: the rest must be refused."""
    room = math.ceil(math.sqrt(count / 4)) + 16
    size = math.sqrt(count / 4)
    trial = flight((room, room), size=size, steps=8)
    return replace(trial, pieces=1)


_axis = functools.partial(axis, group="geometry")


AXES: tuple[Axis, ...] = (
    _axis(
        "cells along an axis", "1", "of a domain that is empty but for a body that flies", 100,
        (16, 2e9), (16, 1e14), lambda v: flight((v, 12)), "integer",
        says="refused beyond 2^31 - 1024: cells are numbered with 32 bits along an axis",
    ),
    _axis(
        "cells of a square", "1", "cells along both edges of such a domain", 100, (16, 1e9),
        (16, 1e14), lambda v: flight((v, v)), "integer", says="1e9 are 1e18 nodes",
    ),
    _axis(
        "cells of a cube", "1", "cells along all edges of such a domain", 100, (16, 1e6),
        (16, 1e12), lambda v: flight((v, v, v), steps=50), "integer",
        says="refused from 2^63 blocks of 4 cells an edge on: 8.3e6 cells along each",
    ),
    _axis(
        "particles of a body", "1", "a body that flies", 100, None, (1, 1e5), many, "integer",
        also=(2.0**31, 2.0**32, 2.0**33, 1e12, 1e18), cheap=False,
        says="refused: as more than memory holds, or than 32 bits can number in a body",
    ),
    _axis(
        "width of a column, 2D", "cells", "a solid that fills it, under its weight", 4, (1, 16),
        (1, 64), lambda v: column((round(v),)), "integer",
    ),
    _axis(
        "width of a column, 3D", "cells", "along y, one cell along x", 2, (1, 8), (1, 16),
        lambda v: column((1, round(v))), "integer",
    ),
    _axis(
        "height of a column", "cells", "a solid one cell wide, under its weight", 8, (4, 32),
        (1, 128), lambda v: column((1,), round(v)), "integer",
    ),
    _axis(
        "size of a body", "cells", "a free body so wide and high", 4.0, (0.1, 8.0), (1e-12, 8.0),
        lambda v: flight(size=v), says="one particle below a cell; less mass than 1e-24 kg is "
        "refused in single precision",
    ),
    _axis(
        "particles per cell of a bar", "1", "that vibrates along itself", 4, (1, 64), (1, 512),
        lambda v: bar(per_cell=round(v)), "integer", cheap=False,
    ),
    _axis(
        "particles of a solid apart", "cells", "nine particles that fall freely", 0.5, (0.1, 8.0),
        (0.01, 1000.0), apart,
    ),
    _axis(
        "density", "kg/m³", "of a free body, at the same wave speed", DENSITY, (1.0, 1e5),
        (1e-300, 1e300), lambda v: flight(density=v),
        says="single precision holds particles of 1e-24 to 1e30 kg, double 1e-250 to 1e250 kg",
    ),
    _axis(
        "Young's modulus", "Pa", "of a bar that vibrates along itself", YOUNG, (1e3, 1e12),
        (1e-300, 1e300), lambda v: bar(young=v),
        says="single precision holds 1e-30 to 1e30 Pa, double 1e-250 to 1e250 Pa",
    ),
    _axis(
        "flight of a solid", "Mach", "of a free body", 0.05, (1e-3, 0.3), (1e-4, 1e6),
        lambda v: flight((60, 12), mach=v), says="no strain: a body may fly faster than its waves",
    ),
)  # fmt: skip
