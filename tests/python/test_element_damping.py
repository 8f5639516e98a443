"""Numerical damping of elements: what it takes of a wave, what it leaves alone, and the same bits.

Expected duration: 20 s.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import materials, sensors, shapes
from libmpm.grids import Pin
from support import element_cases as cases
from support.element_pins import DENSITY, MODULUS, bar

FAST: dict[str, Any] = {"device": "cpu", "precision": "double"}
CELLS, LONG = 4, 0.5


def ringing(damping: float, cfl: float = 0.3) -> libmpm.Simulation:
    """Return a bar that was let go at 1 % of speed along itself, pinned at one end."""
    made = bar(2, (Pin(face="x-"),), CELLS, method=libmpm.Method(cfl=cfl, transfer=aflip()))
    wave = math.sqrt(MODULUS / DENSITY)
    low = float(np.asarray(made.bodies[0].shape.vertices)[:, 0].min())
    # The first mode: a quarter of a wave.
    field = libmpm.Field(
        components=(f"{0.01 * wave!r} * sin({0.5 * math.pi / LONG!r} * (x - {low!r}))", "0")
    )
    made.replace("bar", velocity=field, damping=damping)
    made.add_sensor(name="energy", sensor=sensors.Energy(interval=0.02 * LONG / wave))
    return libmpm.Simulation(made, **FAST)


def aflip() -> libmpm.methods.Transfer:
    """Return the transfer that itself takes least."""
    return libmpm.methods.Transfer(scheme="AFLIP", flip=0.999)


def kept(damping: float) -> float:
    """Return the part of its energy that the bar has after three periods."""
    sim = ringing(damping)
    period = 4 * LONG / math.sqrt(MODULUS / DENSITY)
    sim.run(until=3 * period, progress=False)
    series = sim.sensors["energy"]
    whole = series["kinetic"] + series["elastic"]
    return float(whole[-1] / whole[0])


@pytest.mark.parametrize("damping", [0.05, 0.2])
def test_a_mode_loses_what_the_viscosity_takes(damping: float) -> None:
    """Of ratio ζ = ξ Δx ω / c: energy falls by exp(-2 ζ ω t), beside what the transfer takes."""
    ratio = damping * (0.1 / CELLS) * 0.5 * math.pi / LONG
    expected = math.exp(-2 * ratio * 3 * 2 * math.pi)
    assert kept(damping) / kept(0.0) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("d", [2, 3])
def test_turning_and_flying_are_left_alone(d: int) -> None:
    """No rate, no stress: the momentum of vertices and the energy of an undamped block.

    But for what its corners strain as they begin to turn, a part in 10^5.
    """
    found = []
    for damping in (0.0, 0.5):
        made = libmpm.Scene(dimension=d, cell_size=0.1, lower=(0,) * d, upper=(3,) * d)
        mesh = (shapes.Triangles if d == 2 else shapes.Tetrahedra).box(
            lower=(1.0,) * d, upper=(1.6,) * d, edge=0.1
        )
        turn = libmpm.Field(components=("0.1 - (y - 1.3)", "0.1 + (x - 1.3)", "0.1")[:d])
        made.add_body(
            name="block", shape=mesh, velocity=turn, damping=damping,
            material=materials.NeoHookean(density=1000, youngs_modulus=1e6, poissons_ratio=0.3),
        )  # fmt: skip
        sim = libmpm.Simulation(made, **FAST)
        sim.run(until=0.5, progress=False)
        body = sim.particles["block"]
        m, x, v = (body[n] for n in ("mass", "position", "velocity"))
        angular = float((m * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum())
        found.append((angular, float(0.5 * (m[:, None] * v**2).sum())))
    assert found[1][0] == pytest.approx(found[0][0], rel=1e-5)
    assert found[1][1] == pytest.approx(found[0][1], rel=1e-3)


def test_bits(tmp_path: Path) -> None:
    """Threads, ranks and a run that is resumed have the bits of one."""
    one = ringing(0.3)
    one.step(150)
    expected = cases.state_of(one)
    half = ringing(0.3)
    half.step(70)
    half.save_checkpoint(tmp_path / "half")
    half = libmpm.Simulation.resume(tmp_path / "half")
    half.step(80)
    ranks = libmpm.Simulation(one.scene, device=["cpu"] * 3, precision="double")
    ranks.step(150)
    for other in (half, ranks):
        for key, array in cases.state_of(other).items():
            np.testing.assert_array_equal(array, expected[key])


def test_costs_nothing_where_there_is_none() -> None:
    with_it, without = (
        ringing(damping).plan.memory["particles"] for damping in (0.1, 0.0)
    )  # fmt: skip
    vertices = bar(2, (), CELLS).bodies[0].shape.count
    assert with_it - without == 2 * 8 * vertices


@pytest.mark.gpu
def test_on_a_device() -> None:
    """The energy of the CPU, step by step."""
    runs = [ringing(0.2), libmpm.Simulation(ringing(0.2).scene, device="cuda", precision="double")]
    for run in runs:
        run.step(400)
    a, b = (run.sensors["energy"] for run in runs)
    for name in ("kinetic", "elastic"):
        assert np.abs(a[name] - b[name]).max() < 1e-7 * np.abs(a[name]).max()
