"""Pins: vertices of elements that are held or driven, and the force of a body on them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import Scene, SceneError, boundaries, materials, sensors, shapes
from libmpm._src.output.checkpoint import load_checkpoint, save_checkpoint
from libmpm.grids import Pin, Traction
from support import element_cases as cases
from support.element_load_cases import ramp
from support.element_pins import bar, moved, pinned_cantilever, stretched_bar

FAST: dict[str, Any] = {"device": "cpu", "precision": "double"}
#: A scheme's name, and what it is given.
TRANSFERS: dict[str, dict[str, Any]] = {
    "APIC": {}, "FLIP": {}, "AFLIP": {"flip": 0.95}, "NFLIP": {"flip": 0.9},
    "ASFLIP": {"flip": 0.95, "shift_max": 0.3, "shift_min": 0.05, "critical_ratio": 1.0},
}  # fmt: skip


def by(scheme: str) -> libmpm.Method:
    return libmpm.Method(transfer=libmpm.methods.Transfer(scheme=scheme, **TRANSFERS[scheme]))


@pytest.mark.parametrize("scheme", TRANSFERS)
@pytest.mark.parametrize("d", [2, 3])
def test_pinned_vertices_are_where_their_pins_are(d: int, scheme: str) -> None:
    """To rounding, after any number of steps, whatever the transfer and the body's velocity."""
    way = [0.004, -0.002, 0.001][:d]
    pins = (Pin(face="x-"), Pin(face="x+", motion=moved(0.01, way)))
    scene = bar(
        d,
        pins,
        method=by(scheme),
    )
    sim = libmpm.Simulation(scene, **FAST)
    body = sim.particles["bar"]
    rest = body["position"]
    first, last = (np.abs(rest[:, 0] - x) < 1e-9 for x in (rest[:, 0].min(), rest[:, 0].max()))
    assert first.sum() == last.sum() == 9 ** (d - 1)
    for until in (0.003, 0.02):
        sim.run(until=until, progress=False)
        now = body["position"] - rest
        share = 0.5 * (1 - math.cos(math.pi * sim.time / 0.01)) if sim.time < 0.01 else 1.0
        assert np.abs(now[first]).max() < 1e-12
        # The table has 64 straight parts.
        assert now[last] == pytest.approx(np.tile(share * np.array(way), (last.sum(), 1)),
                                          rel=0, abs=2e-6)  # fmt: skip
        assert np.ptp(now[last], axis=0).max() < 1e-12
    assert 0.2 * way[0] < now[~(first | last), 0].mean() < way[0]


@pytest.mark.parametrize("scheme", TRANSFERS)
def test_momentum_is_what_gravity_and_pins_have_given(scheme: str) -> None:
    """Step by step and to rounding: the pins' push is all that is missing of the weight."""
    pins = (Pin(face="x-"), Pin(face="x+", components=("y",)))
    scene = bar(2, pins, gravity=(3.0, -9.81),
                method=by(scheme))  # fmt: skip
    for k in (0, 1):
        scene.add_sensor(name=f"pin {k}", sensor=sensors.PinForce(body="bar", pin=k))
    sim = libmpm.Simulation(scene, **FAST, time_step=1e-4)
    sim.step(201)
    force = np.array([[sim.sensors[f"pin {k}"][f"force_{a}"] for a in "xy"] for k in (0, 1)])
    assert np.isnan(force[:, :, 0]).all() and np.isfinite(force[:, :, 1:]).all()
    assert (force[1, 0, 1:] == 0).all()
    weight = sim.particles["bar"]["mass"].sum() * np.array([3.0, -9.81])
    pushed = force[:, :, 1:].sum(axis=(0, 2)) * 1e-4
    # Velocities of nodes that are read have the coming step's gravity.
    grid = (sim.grid["mass"][:, None] * sim.grid["velocity"]).sum(axis=0)
    assert grid == pytest.approx(202e-4 * weight - pushed, rel=1e-9, abs=1e-9)


def test_a_fast_pin_shortens_the_step() -> None:
    """No vertex crosses more than half a cell in one, as no node does; where it is stays exact."""
    everywhere = Pin(
        within=shapes.Box(lower=(0, 0), upper=(0.9, 0.5)), motion=moved(5e-3, [0.15, 0])
    )
    sim = libmpm.Simulation(bar(2, (everywhere,)), **FAST, time_step=3e-4)
    body, dx = sim.particles["bar"], sim.scene.cell_size
    rest = body["position"]
    ways, times, before = [], [0.0], rest
    while sim.time < 5.5e-3:
        sim.step(1)
        now = body["position"]
        ways.append(np.abs(now - before).max() / dx)
        times.append(sim.time)
        before = now
    assert max(ways) < 0.55
    assert min(np.diff(times)) < 0.95 * 3e-4
    assert now - rest == pytest.approx(np.tile([0.15, 0.0], (len(rest), 1)), abs=1e-12)


@pytest.mark.parametrize("cells", [2, 4, 8])
def test_a_bar_between_pins_pulls_with_its_stiffness(cells: int) -> None:
    """E A ε over the length of the bar itself; held nodes make it half a cell longer."""
    found = stretched_bar(cells)
    assert found["force at held end"] == pytest.approx(1.0, abs=1e-3)
    assert found["force at driven end"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("cells", "above"), [(2, 0.04), (4, 0.012)])
def test_a_pinned_beam_vibrates_as_its_mesh_alone(cells: int, above: float) -> None:
    """The grid's functions are some of the mesh's: from above, and closer with more cells."""
    found = pinned_cantilever(cells)["over the mesh alone"]
    assert 0.999 < found < 1 + above


def test_a_pin_takes_a_load_at_the_other_end() -> None:
    """The reaction of a cantilever is the force at its end and no more."""
    pull, period = 14.0, 1 / cases.timoshenko(0.5, 0.1, 1e6, 0.0, 1000.0, True)
    load = Traction(face="x+", value=ramp((0.0, -pull), 4 * period))
    scene = bar(2, (Pin(face="x-"),))
    scene.replace("bar", tractions=(load,))
    scene.add_sensor(name="pin", sensor=sensors.PinForce(body="bar", interval=period / 200))
    sim = libmpm.Simulation(scene, **FAST)
    sim.run(until=6 * period, progress=False)
    series = sim.sensors["pin"]
    late = series.time > 4 * period
    assert float(series["force_y"][late].mean()) == pytest.approx(-pull * 0.1, rel=2e-3)


def test_bits_of_pins(tmp_path: Path) -> None:
    """Threads, ranks and runs that are resumed on either have the same, sensors too."""
    pins = (Pin(face="x-"), Pin(face="x+", motion=moved(0.01, [0.01, 0.005])))
    scene = bar(2, pins, gravity=(0.0, -9.81))
    for k in (0, 1):
        sensor = sensors.PinForce(body="bar", pin=k, interval=7e-4)
        scene.add_sensor(name=f"pin {k}", sensor=sensor)
    one = libmpm.Simulation(scene, **FAST, threads=1)
    one.step(120)
    two = libmpm.Simulation(scene, **FAST, threads=2)
    two.step(71)
    two.save_checkpoint(tmp_path / "middle")
    two = libmpm.Simulation.resume(tmp_path / "middle")
    two.step(49)
    # Both pins' vertices are shared between ranks.
    flat = libmpm.Partition(cuts="y", rebalance_above=None)
    ranks = libmpm.Simulation(scene, device=["cpu"] * 2, precision="double", partition=flat)
    ranks.step(71)
    ranks.save_checkpoint(tmp_path / "ranks")
    ranks.step(49)
    again = libmpm.Simulation.resume(tmp_path / "ranks", device=["cpu"] * 3, partition=None)
    again.step(49)
    alone = libmpm.Simulation.resume(tmp_path / "ranks", device="cpu")
    alone.step(49)
    expected = cases.state_of(one)
    for sim in (two, ranks, again, alone):
        for key, array in cases.state_of(sim).items():
            np.testing.assert_array_equal(array, expected[key])
        for name in one.sensors:
            late = one.sensors[name].values[-len(sim.sensors[name].values) :]
            assert np.nanmax(np.abs(late)) > 0
            np.testing.assert_array_equal(sim.sensors[name].values, late)


def test_a_state_of_an_earlier_version_goes_on_on_one_rank(tmp_path: Path) -> None:
    """Its pins were among what rigid bodies were told: one number an axis, to rounding."""
    scene = bar(2, (Pin(face="x-"),), gravity=(0.0, -9.81))
    scene.add_sensor(name="pin", sensor=sensors.PinForce(body="bar", interval=7e-4))
    one = libmpm.Simulation(scene, **FAST)
    one.step(71)
    one.save_checkpoint(tmp_path / "now")
    saved = load_checkpoint(tmp_path / "now")
    whole = np.asarray(saved.state.pop("pin_impulse")).reshape(2, 3).sum(axis=1)
    saved.state["rigid_told"] = np.array([*whole, np.nan])
    save_checkpoint(tmp_path / "earlier", saved)
    again = libmpm.Simulation.resume(tmp_path / "earlier")
    for sim in (one, again):
        sim.step(49)
    series = again.sensors["pin"].values
    late = one.sensors["pin"].values[-len(series) :]
    assert series == pytest.approx(late, rel=1e-12, nan_ok=True)
    with pytest.raises(libmpm.Error, match="which had it on one rank, and goes on on 2 ranks"):
        libmpm.Simulation.resume(tmp_path / "earlier", device=["cpu"] * 2).step(1)


def test_pins_cost_nothing_where_there_are_none() -> None:
    with_pins, without = (bar(2, p).plan(precision="double") for p in ((Pin(face="x-"),), ()))
    vertices = bar(2, ()).bodies[0].shape.count
    # Of each vertex which pin has it, of those that are pinned their number, pin, mass and push.
    pinned = 9 * (4 + 4 + 8 + 2 * 8)
    assert with_pins.memory["particles"] - without.memory["particles"] == 5 * vertices + pinned


def test_a_pinned_scene_goes_through_a_file_and_is_scaled() -> None:
    pins = (Pin(face="x-", components=("x",)), Pin(within=shapes.Box(lower=(0.6, 0), upper=(1, 1)),
                                                   motion=moved(0.01, [0.02, 0.0])))  # fmt: skip
    scene = bar(2, pins)
    assert Scene.from_dict(scene.to_dict()) == scene
    small = scene.scaled(0.25).bodies[0].pins
    table = small[1].motion.table
    assert max(row[0] for row in table.value) == pytest.approx(0.005)
    assert table.time[-1] == pytest.approx(0.005)
    assert small[1].within.lower[0] == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("pins", "said"),
    [
        ((Pin(face="z-"),), r"pins\[0\]: face is 'z-' in 2D; expected x-, x\+, y-, y\+"),
        ((Pin(within=shapes.Box(lower=(0, 0), upper=(0.1, 0.1))),),
         r"pins\[0\]: no vertex of the mesh lies there .* the mesh reaches from"),
        ((Pin(face="x-"), Pin(face="y-")),
         r"pins\[1\]: 1 of its vertices, the first 0, are pins\[0\]'s too"),
        ((Pin(face="x-", components=("z",)),), r"components is \('z',\); expected axes of 2D"),
        ((Pin(face="x-", motion=boundaries.Displacement(
            libmpm.TimeTable([0.0, 1.0], [[0.0] * 3] * 2, end="hold"))),),
         r"pins\[0\]: motion has 3 numbers; expected 2, in m"),
    ],
)  # fmt: skip
def test_pins_that_are_refused(pins: Any, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        bar(2, pins).validate()


def test_what_has_no_pins_is_refused() -> None:
    with pytest.raises(SceneError, match="face and within are missing"):
        Pin()
    with pytest.raises(SceneError, match="components is 'xx'; expected 'all'"):
        Pin(face="x-", components="xx")
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_body(name="a", shape=shapes.Box(lower=(0.2, 0.2), upper=(0.5, 0.5)),
                   material=materials.NeoHookean(density=1000, youngs_modulus=1e5,
                                                 poissons_ratio=0.3),
                   pins=Pin(face="x-"))  # fmt: skip
    scene.add_sensor(name="s", sensor=sensors.PinForce(body="b"))
    with pytest.raises(SceneError) as error:
        scene.validate()
    for words in ("pins on a grid of square cells", "body 'b' has no pins"):
        assert words in str(error.value)


def pinned_wall(depth: float, length: float, modulus: float) -> Scene:
    """Return a wall four cells thick, pinned by its foot, before water in 8 cells of its depth."""
    cell = depth / 8
    upper = (round(1.6 / cell) * cell, round(1.0 / cell) * cell)
    scene = Scene(dimension=2, cell_size=cell, lower=(0, 0), upper=upper, gravity=(0, -9.81))
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(length, depth)), hydrostatic=depth,
        material=materials.TaitFluid(bulk_modulus=2e5),
    )  # fmt: skip
    scene.add_body(
        name="wall",
        shape=shapes.Triangles.box(lower=(0.8, 0), upper=(0.8 + 4 * cell, 0.8), edge=cell / 2),
        material=materials.NeoHookean(density=1000, youngs_modulus=modulus, poissons_ratio=0.3),
        pins=Pin(face="y-"),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_contact(name="face", between=("water", "wall"), law=libmpm.contacts.Fluid())
    scene.add_sensor(name="pin", sensor=sensors.PinForce(body="wall", interval=0.01))
    scene.add_sensor(name="load", sensor=sensors.ContactLoad(contact="face", interval=0.01))
    return scene


def test_a_pinned_wall_has_the_load_of_still_water_as_reaction() -> None:
    sim = libmpm.Simulation(pinned_wall(0.5, 0.8, 2e7), device="cpu")
    sim.run(until=1.5, progress=False)
    still = 0.5 * 1000 * 9.81 * 0.5**2
    for name in ("pin", "load"):
        series = sim.sensors[name]
        mean = series.values[series.time > 1, 0].mean()
        assert mean == pytest.approx(still, rel=0.005), name  # 1225.4 and 1225.4 of 1226.3 N/m


def test_a_surge_on_a_wall_that_bends_gives_its_foot_what_the_wall_does_not_keep() -> None:
    sim = libmpm.Simulation(pinned_wall(0.4, 0.4, 2e6), device="cpu")
    sim.run(until=0.8, progress=False)
    impulse = {}
    for name in ("pin", "load"):
        series = sim.sensors[name]
        width = np.diff(np.concatenate([[0.0], series.time]))
        impulse[name] = float(np.nansum(series.values[:, 0] * width))
    wall = sim.particles["wall"].read(["mass", "velocity"])
    kept = float((wall["mass"] * wall["velocity"][:, 0]).sum())
    assert abs(kept) > 0.002 * impulse["load"]  # it swings
    assert impulse["pin"] == pytest.approx(impulse["load"] - kept, rel=0.003)
