"""Stresses that bodies of elements begin with."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import Field, Scene, SceneError, materials, methods, shapes
from libmpm.grids import Pin
from support import element_cases as cases

FAST: dict[str, Any] = {"device": "cpu", "precision": "double"}
SPACE = (2e4, -1e4, 5e3, 3e3, -2e3, 4e3)


def block(d: int, stress: Any, law: str = "NeoHookean", method: Any = None, **more: Any) -> Scene:
    """Return a block that flies free, or whatever `more` makes of it."""
    scene = Scene(dimension=d, cell_size=0.1, lower=(0,) * d, upper=(1.6,) * d, method=method)
    scene.add_body(**({
        "name": "block", "shape": cases.mesh_of((0.5,) * d, (1.0,) * d, 0.1),
        "material": cases.solid(law, 1000.0, 1e6, 0.3), "stress": stress,
    } | more))  # fmt: skip
    return scene


@pytest.mark.parametrize("law", ["NeoHookean", "FixedCorotated", "StVenantKirchhoffHencky"])
@pytest.mark.parametrize("d", [2, 3])
def test_it_begins_with_its_stress(d: int, law: str) -> None:
    given = SPACE if d == 3 else (2e4, -1e4, 4e3)
    sim = libmpm.Simulation(block(d, given, law), **FAST)
    stress = sim.particles["block"]["element_stress"]
    matrix = np.array([[2e4, 4e3, -2e3], [4e3, -1e4, 3e3], [-2e3, 3e3, 5e3]])[:d, :d]
    assert stress == pytest.approx(np.broadcast_to(matrix, stress.shape), rel=1e-12)
    zz = 5e3 if d == 3 else 0.3 * (2e4 - 1e4)
    pressure = sim.particles["block"]["element_pressure"]
    assert pressure == pytest.approx(-(2e4 - 1e4 + zz) / 3, rel=1e-12)
    assert np.abs(sim.particles["block"]["element_energy"]).max() == 0


@pytest.mark.parametrize("volumes", ["element", "vertex"])
@pytest.mark.parametrize("d", [2, 3])
def test_what_it_gives_up_is_motion(d: int, volumes: str) -> None:
    """Forces are the derivative of the energy that is read: what a free block loses of one it has
    of the other but for what the transfer damps, and no momentum."""
    mesh = cases.mesh_of((0.5,) * d, (1.0,) * d, 0.05, volumes=volumes)
    flip = methods.Transfer(scheme="FLIP")
    method = libmpm.Method(transfer=flip, cfl=0.1)
    scene = block(d, SPACE if d == 3 else (2e4, -1e4, 4e3), method=method, shape=mesh)
    sim = libmpm.Simulation(scene, **FAST)
    body = sim.particles["block"]
    kinetic, stored = [], []
    for _ in range(12):
        sim.step(20)
        now = body.read(["mass", "velocity"])
        kinetic.append(0.5 * float((now["mass"][:, None] * now["velocity"] ** 2).sum()))
        stored.append(float(body["element_energy"].sum()))
        assert np.abs((now["mass"][:, None] * now["velocity"]).sum(axis=0)).max() < 1e-9
    assert max(kinetic) > 0.5
    total = (np.array(kinetic) + np.array(stored)) / max(kinetic)
    # The grid takes its share of motion that it cannot see, step by step, and gives none.
    assert -0.08 < total[0] < total.max() < 1e-6


def test_a_column_rests_under_its_own_weight() -> None:
    """σ_yy = -ρ g (H - y), ν = 0, beside the settlement ρ g H²/2E of one that begins without."""
    high, dx, modulus = 1.0, 0.05, 1e6
    scene = Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(0.8, 1.4), gravity=(0, -9.81))
    weight = Field(components=("0", f"-9810 * ({0.11 + high} - y)", "0"))
    scene.add_body(
        name="column", shape=cases.mesh_of((0.31, 0.11), (0.51, 0.11 + high), 0.5 * dx),
        material=cases.solid("NeoHookean", 1000.0, modulus, 0.0), stress=weight,
        pins=Pin(face="y-"),
    )  # fmt: skip
    sim = libmpm.Simulation(scene, **FAST)
    rest = sim.particles["column"]["position"]
    sim.run(until=8 * high / math.sqrt(modulus / 1000.0), progress=False)
    gone = np.abs(sim.particles["column"]["position"] - rest).max()
    settles = 1000.0 * 9.81 * high**2 / (2 * modulus)
    # Nodes beside the foot bear the weight of the pinned vertices, half an edge of column, which
    # shortens some two cells above it.
    borne = 1000.0 * 9.81 * 0.25 * dx * 2 * dx / modulus
    assert gone < 1.5 * borne < 4e-3 * settles


def test_a_strip_under_tension_sounds_as_a_stiff_string() -> None:
    """(1/2L) √(σ/ρ) (1 + 2 √e + (4 + π²/2) e), e = E I/(σ A L²), of clamped ends (Morse 1948)."""
    long, high, cells, tension, modulus = 1.0, 0.04, 4, 1e5, 1e6
    dx = high / cells
    stiff = modulus * high**2 / 12 / (tension * long**2)
    expected = math.sqrt(tension / 1000.0) / (2 * long)
    expected *= 1 + 2 * math.sqrt(stiff) + (4 + math.pi**2 / 2) * stiff
    scene = Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(1.2, 0.4),
                  method=libmpm.Method(cfl=0.4))  # fmt: skip
    scene.add_body(
        name="strip", shape=cases.mesh_of((0.1, 0.182), (0.1 + long, 0.182 + high), 0.5 * dx),
        material=cases.solid("NeoHookean", 1000.0, modulus, 0.0), stress=(tension, 0.0, 0.0),
        pins=(Pin(face="x-"), Pin(face="x+")),
    )  # fmt: skip
    sim = libmpm.Simulation(scene, **FAST)
    strip = sim.particles["strip"]
    rest = strip["position"]
    along = (rest[:, 0] - 0.1) / long
    velocity, slope = np.zeros_like(rest), np.zeros((len(rest), 2, 2))
    velocity[:, 1] = 0.02 * np.sin(math.pi * along)
    slope[:, 1, 0] = 0.02 * math.pi / long * np.cos(math.pi * along)
    strip["velocity"], strip["velocity_gradient"] = velocity, slope
    middle = np.abs(along - 0.5) < 0.01
    time, moved = [0.0], [0.0]
    while time[-1] < 1.6 / expected:
        sim.run(until=len(time) / (60 * expected), progress=False)
        time.append(sim.time)
        moved.append(float((strip["position"][middle, 1] - rest[middle, 1]).mean()))
    at, y = np.array(time), np.array(moved)
    turn = np.flatnonzero(y[1:-1] * y[2:] < 0) + 1
    zeros = at[turn] - y[turn] / (y[turn + 1] - y[turn]) * (at[turn + 1] - at[turn])
    assert 0.5 / float(np.diff(zeros[:3]).mean()) == pytest.approx(expected, rel=0.02)


def test_bits_of_stresses(tmp_path: Path) -> None:
    scene = cases.small_scene(2, stress=(1e4, 0.0, 2e3))
    one = libmpm.Simulation(scene, **FAST, threads=1)
    one.step(80)
    two = libmpm.Simulation(scene, **FAST, threads=2)
    two.step(37)
    two.save_checkpoint(tmp_path / "middle")
    two = libmpm.Simulation.resume(tmp_path / "middle")
    two.step(43)
    ranks = libmpm.Simulation(scene, device=["cpu"] * 3, precision="double")
    ranks.step(80)
    expected = cases.state_of(one)
    for other in (two, ranks):
        for key, array in cases.state_of(other).items():
            np.testing.assert_array_equal(array, expected[key])


def test_stresses_cost_nothing_where_there_are_none() -> None:
    elements = len(block(2, None).bodies[0].shape.elements)
    with_it, without = (block(2, s).plan(precision="double") for s in ((1e3, 0.0, 0.0), None))
    assert with_it.memory["particles"] - without.memory["particles"] == 4 * 8 * elements


@pytest.mark.parametrize(
    ("stress", "law", "said"),
    [
        (
            (1e4, 0.0, 0.0, 1e3),
            "NeoHookean",
            "stress has 4 components; expected 3: xx, yy, xy; zz follows",
        ),
        ((3e5, 0.0, 0.0), "NeoHookean", "stress is up to 300000 Pa; expected at most 0.25 of"),
        ((1e4, 0.0, 0.0), "VonMises", "VonMises, which would have to say whether it flows"),
    ],
)
def test_stresses_that_are_refused(stress: Any, law: str, said: str) -> None:
    more = {"yield_stress": 1e4} if law == "VonMises" else {}
    given = {"density": 1000.0, "youngs_modulus": 1e6, "poissons_ratio": 0.3} | more
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    with pytest.raises(SceneError, match=said):
        scene.add_body(
            name="b", shape=shapes.Triangles.box(lower=(0.2, 0.2), upper=(0.6, 0.6), edge=0.1),
            material=getattr(materials, law)(**given), stress=stress,
        )  # fmt: skip
        scene.validate()


def test_a_field_is_held_to_the_bound_of_a_constant() -> None:
    scene = block(2, Field(components=("1e6 * (x - 0.5)", "0", "0")))
    scene.validate()
    said = "stress is beyond 0.25 of Young's modulus, 250000 Pa, in .* elements, the first"
    with pytest.raises(SceneError, match=said):
        libmpm.Simulation(scene, **FAST)
