"""Axes of large motion and strain: a square that turns, bodies that fly apart or together."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from extremes_axis import Axis, Trial, bounded, energies
from extremes_solids import DX, SOLIDS, YOUNG, axis, cells, domain, solid, wave_speed

import libmpm
from libmpm import sensors
from libmpm._src.base.formulas import Field

#: What ends a large strain.
EDGE = "J outside 0.05 to 20 is detected as compression or tension"
#: What ends it where flow takes up volume: nothing, and the body comes apart unsaid.
TORN = "; beyond J = 40 its particles share no node, and J is that of each alone"
EDGES = {
    "VonMises": "the elastic part of J (in 2D in the plane) outside 0.05 to 20 is named" + TORN,
    "LinearElastic": "its 1 + tr ε = 1 + ln J outside 0.05 to 20 is named" + TORN,
    "DruckerPrager": "its plastic volume has no upper end" + TORN,
    "CamClay": "its plastic volume has no upper end" + TORN,
}


def turning(turns: float, name: str = "NeoHookean", mach: float = 0.05) -> Trial:
    """A free square of 8 x 8 cells that spins: energy, size and momentum stay.

    The corners go at `mach` times the wave speed, which widens it by about 0.14 mach². It is let go
    unstretched and vibrates, which is lost in its first turns. Velocities are half a step behind
    places, so the sum of energies is off by half a step's change of the elastic one, up to a tenth.
    """
    half, wide = 4, 24
    rate = mach * wave_speed() / (half * math.sqrt(2) * DX)
    middle = wide / 2 * DX
    scene = domain("turning", (wide, wide))
    scene.add_body(
        name="square", shape=cells(8, 8, size=(8, 8)), material=solid(name),
        velocity=Field(
            components=(f"0 - {rate!r} * (y - {middle!r})", f"{rate!r} * (x - {middle!r})")
        ),
    )  # fmt: skip
    until = turns * 2 * math.pi / rate
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 100))
    begun: dict[str, Any] = {}

    def prepare(simulation: libmpm.Simulation) -> None:
        begun.update(simulation.particles["square"].read(["position", "velocity"]))

    def judge(simulation: libmpm.Simulation) -> str:
        columns = energies(simulation)
        total = columns["total"] / columns["total"][0]
        elastic = float(columns["elastic"].max() / columns["total"][0])
        read = simulation.particles["square"].read(["position", "velocity"])
        size, spin = [], []
        for part in (begun, read):
            r = part["position"] - part["position"].mean(axis=0)
            v = part["velocity"]
            size.append(float(np.sqrt((r**2).sum())))
            spin.append(float((r[:, 0] * v[:, 1] - r[:, 1] * v[:, 0]).sum()))
        away = float(np.abs(read["position"].mean(axis=0) - middle).max()) / DX
        return (
            bounded("energy, of its start", total.max(), 0.0, 1.01 + 0.1 * elastic)
            or bounded("energy at the end, of its start", total[-1], 0.9 - elastic, 1.05)
            or bounded("size, of its start", size[1] / size[0], 0.98, 1.05 + 0.2 * mach**2)
            or bounded("angular momentum, of its start", spin[1] / spin[0], 0.9, 1.02)
            or bounded("way of the middle, cells", away, 0.0, 0.5)
        )

    return Trial(scene=scene, until=until, judge=judge, prepare=prepare)


def strained(ratio: float, name: str = "NeoHookean", dimension: int = 2, steps: int = 400) -> Trial:
    """A soft body that flies apart, or together, alike in all directions, by its own inertia.

    Its stored volume ratio follows the volume of its particles' places; of `LinearElastic` that is
    1 + ln J. No energy comes in but that of the affine part, (Δx²/4) |C|² of every particle, which
    is 3/n² of the rest. `ratio` is about what is reached: some of the way is lost as it sets out.
    """
    n, way = 6, ratio ** (1 / dimension) - 1
    rate = math.copysign(1.0, way)
    speed = 1e-3 * n * DX  # of waves, m/s: no stress holds it
    room = math.ceil(max(1 + 1.1 * way, 1) * n) + 8
    room += room % 2
    middle = room / 2 * DX
    until = max(abs(way), 1e-3) / (0.95 if way > 0 else 0.86)
    scene = domain("strained", (room,) * dimension, cfl=speed * until / steps / DX)
    scene.add_body(
        name="body", shape=cells(*((room - n) / 2,) * dimension, size=(n,) * dimension),
        material=solid(name, young=YOUNG * (speed / wave_speed()) ** 2),
        velocity=Field(
            components=tuple(f"{rate!r} * ({a} - {middle!r})" for a in "xyz"[:dimension])
        ),
    )  # fmt: skip
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 50))
    spread: list[float] = []

    def prepare(simulation: libmpm.Simulation) -> None:
        spread.append(float(np.var(simulation.particles["body"]["position"], axis=0).sum()))

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["body"].read(["position", "volume_ratio"])
        volume = (float(np.var(read["position"], axis=0).sum()) / spread[0]) ** (dimension / 2)
        found = read["volume_ratio"] / volume
        if name == "LinearElastic":
            found = read["volume_ratio"] - math.log(volume)
        total = energies(simulation)["total"]
        return (
            bounded("mean volume, of the places'", float(found.mean()), 0.95, 1.05)
            or bounded("least volume, of the places'", float(found.min()), 0.8, 1.2)
            or bounded("largest volume, of the places'", float(found.max()), 0.8, 1.2)
            or bounded("energy, of its start", float(total.max() / total[0]), 0.0, 1.01 + 3 / n**2)
        )

    return Trial(scene=scene, until=until, judge=judge, prepare=prepare)


# ---- the axes -----------------------------------------------------------------------------------


AXES: tuple[Axis, ...] = (
    axis(
        "turns", "1", "of a free square; its corners go at Mach 0.05", 3.0, (1.0, 30.0),
        (1.0, 100.0), turning, limit=200.0, cheap=False,
    ),
    axis(
        "turns, to 1e4", "1", "of a free square; its corners go at Mach 0.05", 1e4, None,
        (1e4, 1e4), turning, limit=4000.0, on_demand=True, cheap=False, also=(1e4,),
    ),
    *(
        axis(
            f"turns of {name}", "1", "of such a square", 1.0, None, (1.0, 4.0),
            lambda v, name=name: turning(v, name), cheap=False,
            says="particles go along tangents, which widens a body by half the square of the angle "
            "of a step; laws that see det F resist, this one grows: by 1.1 % a turn here",
        )
        for name in ("Hypoelastic", "LinearElastic")
    ),
    axis(
        "spin", "Mach", "of the corners of a free square that turns ten times", 0.05, (0.01, 0.1),
        (0.01, 30.0), lambda v: turning(10.0, mach=v), cheap=False,
        says="it grows by ρ v²/E: 1 % at Mach 0.1",
    ),
    *(
        axis(
            f"volume ratio of {name}", "1", "a soft body that flies apart or together", 1.5,
            (0.5, 5.0), (0.005, 30.0 if name in EDGES else 100.0),
            lambda v, name=name: strained(v, name), says=EDGES.get(name, EDGE),
        )
        for name in SOLIDS
    ),
    axis(
        "volume ratio in 3D", "1", "a soft body that flies apart or together", 1.5, (0.5, 5.0),
        (0.005, 100.0), lambda v: strained(v, dimension=3), cheap=False, says=EDGE,
    ),
)  # fmt: skip
