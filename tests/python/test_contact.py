"""Bodies with fields of velocities of their own: physics with known answers, readers, refusals.

Bounds are those of the comparison in `design/contact.md` where it has the case.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes
from support import contact_scenes as cases
from support.contact_scenes import Runner
from support.devices import device  # noqa: F401

#: Precision of a comparison between runs.
DOUBLE = "double"


@pytest.fixture
def run(device: str) -> Runner:
    """Return what makes a simulation on a device, in double precision unless said."""

    def made(scene: libmpm.Scene, **options: Any) -> libmpm.Simulation:
        return libmpm.Simulation(scene, device=device, **({"precision": DOUBLE} | options))

    return made


# Stick: the run of one field ----------------------------------------------------------------------


SCHEMES: dict[str, Any] = {
    "APIC": "APIC",
    "AFLIP": libmpm.methods.Transfer(scheme="AFLIP", flip=0.95),
    "PIC-FLIP": libmpm.methods.Transfer(scheme="PIC-FLIP", flip=0.9),
}


def meeting(
    transfer: str, dimension: int, law: contacts.ContactLaw | None, cell: Any = "held"
) -> libmpm.Scene:
    """Return three blocks of two materials, two of which are stepped as one, and water below."""
    d = dimension
    dx = 0.05
    side = (0.2,) * (d - 2)
    zero = (0.0,) * (d - 2)
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0.0,) * d, upper=(1.0, *side, 1.0),
        gravity=(0.0, *zero, -9.81), method=libmpm.Method(transfer=SCHEMES[transfer]),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, *zero, 0), upper=(1, *side, 0.2)),
        material=materials.TaitFluid(bulk_modulus=1e5),
    )  # fmt: skip
    for k, (x, z, speed) in enumerate(((0.1, 0.2, 3.0), (0.35, 0.2, 0.0), (0.6, 0.22, -3.0))):
        scene.add_body(
            name=f"block {k}",
            shape=shapes.Box(lower=(x, *zero, z), upper=(x + 0.2, *side, z + 0.2)),
            material=cases.solid(5e5 if k < 2 else 1e5, 0.3, 600.0),
            velocity=(speed, *zero, -1.0),
        )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(),
        response=boundaries.Separable(static_friction=0.3, dynamic_friction=0.2, cell=cell),
    )  # fmt: skip
    if law is not None:
        scene.add_contact(name="all", between=("*", "*"), law=law)
    return scene


@pytest.mark.parametrize("transfer", ["APIC", "AFLIP", "PIC-FLIP"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_what_sticks_is_one_field(run: Runner, transfer: str, dimension: int) -> None:
    one = run(meeting(transfer, dimension, None))
    several = run(meeting(transfer, dimension, contacts.Stick()))
    for simulation in (one, several):
        simulation.step(100)
    assert several.engine.statistics()["contact_blocks"] > 0
    for name in ("water", "block 0", "block 1", "block 2"):
        for attribute, scale in (("position", 1.0), ("velocity", 3.0)):
            a, b = (cases.by_id(s, name, attribute) for s in (one, several))
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * scale, err_msg=name)
    np.testing.assert_allclose(one.grid["mass"].sum(), several.grid["mass"].sum(), rtol=1e-13)
    # What hardly weighs is rounded by what sums are counted in: momenta, by the largest mass.
    part = (one.grid["mass"] / one.grid["mass"].max())[:, None]
    np.testing.assert_allclose(
        part * one.grid["velocity"], part * several.grid["velocity"], rtol=0, atol=1e-11
    )


# When two bodies touch ----------------------------------------------------------------------------


@pytest.mark.parametrize(("offset", "degrees"), [(0, 0), (0.25, 0), (0.5, 0), (0, 20), (0, 45)])
def test_faces_push_where_they_touch(run: Runner, offset: float, degrees: float) -> None:
    speed = 0.02 * cases.sound_speed(1e6, 0.0)
    gap, dx = 1.0, 1 / 16
    simulation = run(cases.approaching(offset, degrees, speed, gap))
    along = np.array([-math.sin(math.radians(degrees)), math.cos(math.radians(degrees))])
    start = cases.mean(simulation, "low", "velocity") @ along
    left: list[float] = []

    def see(s: libmpm.Simulation) -> bool:
        moved = (cases.mean(s, "high", "position") - cases.mean(s, "low", "position")) @ along
        if cases.mean(s, "low", "velocity") @ along < start * (1 - 1e-4):
            left.append(moved / dx - 8.0)
        return bool(left)

    cases.each_step(simulation, 2 * gap * dx / speed, see)
    assert left, "they have not touched"
    assert abs(left[0]) < 0.05


# Friction -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("dimension", [2, 3])
def test_block_on_a_slope(device: str, friction: float, dimension: int) -> None:
    g, angle = 10.0, math.radians(30)
    expected = g * (math.sin(angle) - friction * math.cos(angle))
    scene = cases.slope(dimension, friction, cells=12 if dimension == 2 else 8)
    found = cases.acceleration(scene, 0.65, 0.95, precision=DOUBLE, device=device)
    assert abs(found - expected) < 0.02 * g


def test_block_holds_where_friction_is_steeper_than_the_slope(run: Runner) -> None:
    simulation = run(cases.slope(2, 0.8))
    simulation.run(until=0.9)
    before = cases.mean(simulation, "block", "position")
    simulation.run(until=1.2)
    assert abs((cases.mean(simulation, "block", "position") - before)[0]) < 0.02 / 12
    assert abs(before[0] - 2.0) < 0.6 / 12


def test_more_bodies_at_a_node_than_are_kept_apart_is_a_fault(run: Runner) -> None:
    dx = 0.1
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(1, 1))
    for k in range(25):
        low = (0.4 + dx / 2 * (k // 5), 0.4 + dx / 2 * (k % 5))
        high = tuple(x + dx / 2 for x in low)
        shape = shapes.Box(lower=low, upper=high)
        scene.add_body(name=f"grain {k}", shape=shape, material=cases.solid())
    scene.add_contact(name="grains", between=("grain*", "grain*"), law=contacts.Friction())
    with pytest.raises(libmpm.NumericalError, match="too many bodies meet at a node"):
        run(scene).step(1)


# Blows and rest -----------------------------------------------------------------------------------


def test_discs_part_after_a_blow(run: Runner) -> None:
    speed = 0.005 * cases.sound_speed(1e6, 0.3)
    simulation = run(cases.discs(12, speed))
    mass = {b: len(simulation.particles[b]["id"]) for b in ("left", "right")}
    assert mass["left"] == mass["right"]
    simulation.run(until=0.01 / speed + 60 * 0.12 / cases.sound_speed(1e6, 0.3))
    left, right = (cases.mean(simulation, b, "velocity") for b in ("left", "right"))
    assert 0.93 < (right[0] - left[0]) / (2 * speed) < 1
    np.testing.assert_allclose(left + right, 0, atol=1e-12 * speed)


@pytest.mark.parametrize("touching", [True, False])
def test_bars_that_touch_come_apart_freely(run: Runner, touching: bool) -> None:
    """Four bars side by side, turned by 20°, drawn apart: only one field for all holds them."""
    dx, turn = 0.05, math.radians(20)
    axes = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(-1.5, -1.5), upper=(1.5, 1.5))
    speeds = {}
    for k, side in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        centre = (np.array(side) * (4.5 * dx, 1.5 * dx)) @ axes
        speeds[f"bar {k}"] = 0.5 * centre
        scene.add_body(
            name=f"bar {k}", material=cases.solid(4e5, 0.3, 600.0), velocity=tuple(0.5 * centre),
            shape=shapes.OrientedBox(centre=tuple(centre), size=(9 * dx, 3 * dx), angle=20.0),
        )  # fmt: skip
    if touching:
        law = contacts.Friction(static=0.4)
        scene.add_contact(name="bars", between=("bar*", "bar*"), law=law)
    simulation = run(scene)
    simulation.run(until=1.0)
    for name, speed in speeds.items():
        left = cases.mean(simulation, name, "velocity")
        if touching:  # nothing pulls: each keeps its momentum to rounding
            np.testing.assert_allclose(left, speed, atol=1e-10)
        else:
            assert np.linalg.norm(left) < 0.5 * np.linalg.norm(speed)


def test_stack_rests(run: Runner) -> None:
    simulation = run(cases.stack())
    start = [cases.mean(simulation, f"block {k}", "position") for k in range(3)]
    simulation.run(until=6.0)  # 33,000 steps
    for k in range(3):
        place = cases.mean(simulation, f"block {k}", "position")
        speed = np.abs(np.asarray(simulation.particles[f"block {k}"]["velocity"])).max()
        assert speed < 1e-5
        assert abs(place[0] - start[k][0]) < 0.02 * 0.1 / 6
        assert abs(place[1] - start[k][1]) < 0.2 * 0.1 / 6  # its own weight and that above


def test_row_of_dominoes_falls(run: Runner) -> None:
    count = 6
    simulation = run(cases.dominoes(count), precision="single")
    names = [f"domino {k:02d}" for k in range(count)]
    ends = {}
    for name in names:
        y = cases.by_id(simulation, name, "position")[:, 1]
        ends[name] = (y > np.quantile(y, 0.75), y < np.quantile(y, 0.25))
    peak = dict.fromkeys(names, 0.0)
    while simulation.time < 0.37:
        simulation.run(until=simulation.time + 0.01)
        for name in names:
            peak[name] = max(peak[name], cases.tilt(simulation, name, *ends[name]))
    assert all(math.degrees(angle) > 20 for angle in peak.values()), peak


@pytest.mark.parametrize("cell", ["held", "linear"])
def test_block_floats_as_deep_as_it_weighs(run: Runner, cell: str) -> None:
    simulation = run(cases.floating(500.0, cell=cell))
    found = []
    while simulation.time < 1.2:
        simulation.run(until=simulation.time + 0.02)
        if simulation.time > 0.5:
            found.append(cases.mean(simulation, "block", "position")[1])
    # The draught by the water that it displaces: level - (centre - side / 2).
    level = 0.2
    draught = (level - np.mean(found) + 0.05) / (0.1 / 8)
    assert abs(draught - 4) < 0.05


# What else knows of fields ------------------------------------------------------------------------


def measured(law: contacts.ContactLaw | None) -> libmpm.Scene:
    scene = meeting("APIC", 2, law)
    scene.add_sensor(name="floor", sensor=sensors.LoadCell(boundary="walls", faces=("y-",)))
    scene.add_sensor(name="probe", sensor=sensors.VelocityProbe(position=(0.5, 0.2)))
    scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=(0.5,)))
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    return scene


def test_sensors_of_what_sticks_are_those_of_one_field(run: Runner) -> None:
    series = []
    for law in (None, contacts.Stick()):
        simulation = run(measured(law))
        simulation.step(40)
        series.append(
            {k: np.asarray(simulation.sensors[k].values) for k in ("floor", "probe", "energy")}
        )
    for name, values in series[0].items():
        size = np.abs(values).max()
        np.testing.assert_allclose(values, series[1][name], rtol=0, atol=1e-10 * size, err_msg=name)


def test_load_cell_sees_what_a_stack_weighs(run: Runner) -> None:
    scene = cases.stack()
    scene.add_sensor(name="scale", sensor=sensors.LoadCell(boundary="floor", interval=0.02))
    simulation = run(scene)
    simulation.run(until=0.8)
    force = np.asarray(simulation.sensors["scale"].values)[-20:, 1].mean()
    assert abs(abs(force) / (3 * 0.01 * 1000 * 9.81) - 1) < 0.01


def test_contact_takes_energy_and_friction_more(run: Runner) -> None:
    left = {}
    for friction in (0.0, 0.1):
        scene = cases.discs(8, 0.2, impact=0.5, friction=friction)
        scene.add_sensor(name="energy", sensor=sensors.Energy(interval=1e-3))
        simulation = run(scene)
        simulation.run(until=0.2)
        total = np.asarray(simulation.sensors["energy"].values)[:, :3].sum(axis=1)
        assert total.max() <= total[0] * (1 + 1e-12)
        left[friction] = total[-1] / total[0]
    # Of discs that slide along each other: more than rounding of what an elastic blow takes.
    assert left[0.1] < left[0.0] - 0.03


def slipping(cell: Any = "held") -> libmpm.Scene:
    scene = meeting("AFLIP", 2, None, cell)
    scene.add_contact(
        name="blocks", between=("block*", "block*"), law=contacts.Friction(static=0.3, dynamic=0.2)
    )
    scene.add_contact(name="wet", between=("block*", "water"), law=contacts.Fluid())
    return scene


def assert_same_bits(a: libmpm.Simulation, b: libmpm.Simulation) -> None:
    for body in a.scene.bodies:
        for attribute in ("position", "velocity"):
            one, two = (cases.by_id(s, body.name, attribute) for s in (a, b))
            assert np.array_equal(one, two), (body.name, attribute)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_resumed_run_and_threads_have_the_same_bits(
    run: Runner, device: str, tmp_path: Path, precision: str
) -> None:
    whole = run(slipping(), precision=precision)
    whole.step(60)
    first = run(slipping(), precision=precision, threads=2)
    first.step(25)
    first.save_checkpoint(tmp_path / "half.h5")
    first.step(35)
    assert_same_bits(whole, first)
    second = libmpm.Simulation.resume(tmp_path / "half.h5", device=device)
    second.step(35)
    assert_same_bits(whole, second)


# The plan and what is refused ---------------------------------------------------------------------


def test_plan_says_fields_and_pairs() -> None:
    plan = cases.dominoes(6).plan(device="cpu")
    assert plan.device == "cpu"
    told = plan.to_dict()
    assert told["fields"] == 6
    assert told["contacts"][0]["pairs"] == "15"
    assert plan.kernels[:2] == ["update_grid", "contact"]
    assert "fields" in str(plan)
    plain = cases.dominoes(6)
    plain._contacts.clear()
    assert "fields" not in plain.plan(device="cpu").to_dict()


def test_scene_file_and_scaling_keep_contacts(tmp_path: Path) -> None:
    scene = cases.floating(500.0)
    scene.save(tmp_path / "scene.json")
    assert libmpm.Scene.load(tmp_path / "scene.json") == scene
    assert scene.scaled(0.25).contacts == scene.contacts
    assert "contacts" not in meeting("APIC", 2, None).to_dict()


@pytest.mark.parametrize(
    ("between", "law", "says"),
    [
        (("block 9", "block*"), contacts.Stick(), "is no body"),
        (("block 0", "block 0"), contacts.Stick(), "a body with itself"),
        (("block*", "*"), contacts.Friction(), "'water' is a fluid"),
        (("block 0", "block 1"), contacts.Fluid(), "neither is a fluid"),
    ],
)
def test_contacts_that_are_refused(
    between: tuple[str, str], law: contacts.ContactLaw, says: str
) -> None:
    scene = meeting("APIC", 2, None)
    scene.add_contact(name="c", between=between, law=law)
    with pytest.raises(libmpm.SceneError, match=says):
        scene.validate()


def test_one_law_for_a_pair() -> None:
    scene = meeting("APIC", 2, None)
    scene.add_contact(name="one", between=("block*", "block*"), law=contacts.Friction())
    scene.add_contact(name="two", between=("block 0", "block 1"), law=contacts.Stick())
    with pytest.raises(libmpm.SceneError, match="a pair of contact 'one' too"):
        scene.validate()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"transfer": "FMPM"}, "sweep over the grid"),
        ({"kernel": "cubic"}, "quadratic splines"),
    ],
)
def test_methods_that_are_refused(change: dict[str, Any], says: str) -> None:
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), method=libmpm.Method(**change)
    )
    for k in range(2):
        scene.add_body(
            name=f"b{k}", shape=shapes.Box(lower=(0.1 + 0.4 * k, 0.1), upper=(0.4 + 0.4 * k, 0.4)),
            material=cases.solid(),
        )  # fmt: skip
    scene.add_contact(name="c", between=("b0", "b1"), law=contacts.Friction())
    with pytest.raises(libmpm.SceneError, match=says):
        scene.validate()


def test_walls_bodies_and_sensors_that_are_refused() -> None:
    scene = meeting("APIC", 2, contacts.Stick())
    scene.add_boundary(
        name="mirror", shape=shapes.DomainWalls(faces=["x-"]), response=boundaries.Mirror()
    )
    scene.add_body(
        name="smooth", shape=shapes.Box(lower=(0.1, 0.7), upper=(0.3, 0.9)),
        material=cases.solid(), smoothing=libmpm.methods.Smoothing(method="C0"),
    )  # fmt: skip
    scene.add_sensor(name="force", sensor=sensors.ContactForce(body="block 0", by="block 1"))
    scene.add_sensor(name="nodes", sensor=sensors.GridSensor(attribute="force"))
    with warnings.catch_warnings(), pytest.raises(libmpm.SceneError) as error:
        warnings.simplefilter("ignore")
        scene.validate()
    told = " ".join(error.value.problems)
    for part in ("boundary 'mirror'", "body 'smooth'", "sensor 'force'", "sensor 'nodes'"):
        assert part in told


def test_continuing_from_a_run_with_contact_is_refused(run: Runner, tmp_path: Path) -> None:
    simulation = run(meeting("APIC", 2, contacts.Stick()))
    simulation.step(2)
    simulation.save_checkpoint(tmp_path / "c.h5")
    with pytest.raises(libmpm.SceneError, match="has contact 'all'"):
        libmpm.Scene.from_checkpoint(tmp_path / "c.h5")


# Bodies that boundaries hold ----------------------------------------------------------------------


def test_nothing_sinks_into_what_a_boundary_holds(run: Runner) -> None:
    """A block lies on a slab of prescribed velocity, which takes none of what contact gives it.

    Were both to share the approach as free bodies do, the block would sink by F Δt / m a step: by
    0.6 cells in a second.
    """
    dx = 1 / 12
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(2, 1.5), gravity=(0, -10.0)
    )  # fmt: skip
    for name, low, high in (
        ("slab", (0, 0), (2, 4 * dx)),
        ("block", (0.5, 4 * dx), (1.5, 10 * dx)),
    ):
        shape = shapes.Box(lower=low, upper=high)
        scene.add_body(name=name, shape=shape, material=cases.solid(1e6, 0.3))
    scene.add_contact(name="sole", between=("block", "slab"), law=contacts.Friction(static=0.5))
    still = libmpm.TimeTable(time=[0.0, 10.0], value=[[0.0, 0.0]] * 2)
    scene.add_boundary(
        name="hold", shape=shapes.Box(lower=(0, 0), upper=(2, 1)),
        response=boundaries.Prescribed(), motion=still, bodies=("slab",),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.ContactLoad(contact="sole", interval=0.01))
    scene.add_sensor(name="hold", sensor=sensors.LoadCell(boundary="hold", interval=0.01))
    simulation = run(scene)
    start = cases.mean(simulation, "block", "position")[1]
    simulation.run(until=1.0)
    heights = []
    while simulation.time < 1.2:
        simulation.run(until=simulation.time + 0.01)
        heights.append(cases.mean(simulation, "block", "position")[1])
    weight = 0.5 * 1000 * 10.0
    # Its own weight shortens it: by its mean stress on its half height, w h / 4 E'.
    own = weight * 0.5 / (4 * 1e6 / (1 - 0.3**2))
    assert start - np.mean(heights) == pytest.approx(own, abs=0.01 * dx)
    force = simulation.sensors["load"]["force_y"]
    assert force[-40:].mean() == pytest.approx(-weight, rel=0.02)
    # What the boundary is pushed by: the block, and the slab's own weight.
    slab = np.asarray(simulation.particles["slab"]["mass"]).sum() * 10.0
    held = simulation.sensors["hold"]["force_y"]
    np.testing.assert_allclose(held[5:], force[5:] - slab, rtol=0, atol=1e-9 * weight)


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["single", "double", "mixed"])
@pytest.mark.parametrize("name", ["dominoes", "stack", "floating", "bore", "turned"])
def test_a_cuda_device_does_what_the_cpu_does(name: str, precision: str) -> None:
    """Every particle, to what the grid's precision rounds: "mixed" has a single one."""
    made: dict[str, Callable[[], libmpm.Scene]] = {
        "dominoes": lambda: cases.dominoes(4),
        "stack": cases.stack,
        "floating": lambda: cases.floating(500.0, cell="linear"),
        "bore": lambda: slipping("linear"),
        "turned": lambda: cases.slope(3, 0.3, cells=6),
    }
    one = libmpm.Simulation(made[name](), device="cpu", precision="double")
    other = libmpm.Simulation(made[name](), device="cuda", precision=precision)
    steps = 150
    for simulation in (one, other):
        simulation.step(steps)
    assert other.time == pytest.approx(one.time, rel=1e-3)
    exact = precision == "double"
    cell = one.scene.cell_size
    for body in one.scene.bodies:
        a, b = (cases.by_id(s, body.name, "position") for s in (one, other))
        assert np.abs(a - b).max() < (1e-7 if exact else 2e-3) * cell, body.name
