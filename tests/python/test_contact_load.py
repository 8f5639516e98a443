"""`sensors.ContactLoad`: weights, impulses and friction against closed forms; bits, refusals."""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import contacts, sensors
from support import contact_scenes as cases
from support.contact_scenes import Runner
from support.devices import device  # noqa: F401

G = 9.81


@pytest.fixture
def run(device: str) -> Runner:
    """Return what makes a simulation on a device, in double precision unless said."""

    def made(scene: libmpm.Scene, **options: Any) -> libmpm.Simulation:
        return libmpm.Simulation(scene, device=device, **({"precision": "double"} | options))

    return made


def mean_of(simulation: libmpm.Simulation, name: str, component: str, start: float) -> float:
    """Return the mean of a component of a sensor's samples from a time on."""
    series = simulation.sensors[name]
    return float(series[component][series.time > start].mean())


def momentum(simulation: libmpm.Simulation, body: str) -> Any:
    """Return the momentum of a body, kg m/s."""
    mass, velocity = (simulation.particles[body][a] for a in ("mass", "velocity"))
    return (np.asarray(mass)[:, None] * np.asarray(velocity)).sum(axis=0)


def test_stack_presses_with_its_weight(run: Runner) -> None:
    weight = 0.01 * 1000 * G  # of one block, N/m
    scene = cases.stack()
    for name, pair in (
        ("all", None),
        ("middle on lowest", ("block 1", "block 0")),
        ("middle on upper", ("block 1", "block 2")),
        ("apart", ("block 0", "block 2")),
    ):
        load = sensors.ContactLoad(contact="stack", pair=pair, interval=0.02)
        scene.add_sensor(name=name, sensor=load)
    simulation = run(scene)
    rising = []
    for until in (0.2, 0.6):
        simulation.run(until=until)
        rising.append([momentum(simulation, f"block {k}")[1] for k in range(3)])
    # What rings yet: of the mean force the part that is not weight.
    rise = np.subtract(rising[1], rising[0]) / (0.4 * weight)
    middle, upper = 2 + rise[1] + rise[2], 1 + rise[2]

    def told(name: str, component: str = "force_y") -> float:
        return mean_of(simulation, name, component, 0.201) / weight

    # The lower one carries: the force on the second of a pair, which was added later.
    assert told("all") == pytest.approx(middle + upper, rel=1e-3)
    # At edges normals are turned by what is beside the face: their sizes add up to a bit more.
    assert middle + upper < told("all", "normal") < 1.01 * (middle + upper)
    assert told("middle on lowest") == pytest.approx(-middle, rel=1e-3)
    assert told("middle on upper") == pytest.approx(upper, rel=1e-3)
    assert max(abs(middle - 2), abs(upper - 1)) < 0.05
    assert np.all(simulation.sensors["apart"].values == 0)
    assert abs(told("all", "force_x")) < 1e-9
    # Friction holds, and takes nothing.
    assert abs(told("all", "friction_power")) < 1e-12


@pytest.mark.parametrize("interval", [0.0, 3e-3])
def test_blow_changes_momentum_by_its_impulse(run: Runner, interval: float) -> None:
    speed = 0.02 * cases.sound_speed(1e6, 0.3)
    scene = cases.discs(8, speed, impact=0.5, friction=0.2)
    scene.add_sensor(name="blow", sensor=sensors.ContactLoad(contact="discs", interval=interval))
    back = sensors.ContactLoad(contact="discs", pair=("right", "left"), interval=interval)
    scene.add_sensor(name="back", sensor=back)
    simulation = run(scene)
    before = {b: momentum(simulation, b) for b in ("left", "right")}
    # Until long after they have parted; a sample is due then.
    simulation.run(until=math.ceil((0.02 / speed + 0.08) / 3e-3) * 3e-3)
    series = simulation.sensors["blow"]
    assert np.all(series.values[-3:] == 0) and np.abs(series.values).max() > 0
    assert np.array_equal(series.values[:, :2], -simulation.sensors["back"].values[:, :2])
    for body, sign in (("right", 1), ("left", -1)):
        change = momentum(simulation, body) - before[body]
        found = [sign * series.impulse(f"force_{a}") for a in "xy"]
        np.testing.assert_allclose(found, change, rtol=0, atol=1e-12 * np.abs(before[body][0]))
    normal, tangential = (series.impulse(c) for c in ("normal", "tangential"))
    assert 0 < tangential <= 0.2 * normal * (1 + 1e-12)
    power = series["friction_power"]
    assert power.min() > -1e-12 * power.max() and power.max() > 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_sliding_block_has_coulomb_friction(run: Runner, dimension: int) -> None:
    friction, angle, g = 0.3, math.radians(30), 10.0
    scene = cases.slope(dimension, friction, cells=12 if dimension == 2 else 8)
    scene.add_sensor(name="sole", sensor=sensors.ContactLoad(contact="sole", interval=0.01))
    simulation = run(scene)
    simulation.run(until=0.65)
    start = cases.mean(simulation, "block", "position")[0]
    simulation.run(until=0.95)
    speed = (start - cases.mean(simulation, "block", "position")[0]) / 0.3
    normal = np.asarray(simulation.particles["block"]["mass"]).sum() * g * math.cos(angle)

    def told(component: str) -> float:
        return mean_of(simulation, "sole", component, 0.655)

    assert told("normal") == pytest.approx(normal, rel=0.03)
    # All nodes slide: to rounding of the ratio, whatever the normals are.
    assert told("tangential") == pytest.approx(friction * told("normal"), rel=1e-9)
    assert told("friction_power") == pytest.approx(told("tangential") * speed, rel=0.02)
    # On the slab, which is the second of the contact's names.
    up = "xyz"[dimension - 1]
    assert told(f"force_{up}") == pytest.approx(-normal, rel=0.03)
    assert told("force_x") == pytest.approx(-friction * normal, rel=0.08)


def test_energy_lost_is_what_friction_takes(run: Runner) -> None:
    scene = cases.slope(2, 0.3)
    scene.add_sensor(name="sole", sensor=sensors.ContactLoad(contact="sole", interval=0.01))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
    simulation = run(scene)
    simulation.run(until=0.95)
    sole, energy = simulation.sensors["sole"], simulation.sensors["energy"]
    # Gravity is that of the slope, and its potential is too, from 0.501 s on.
    span = sole.time > 0.605
    taken = float((sole["friction_power"][span] * 0.01).sum())
    at = [int(np.argmin(np.abs(energy.time - t))) for t in (0.6, sole.time[-1])]
    lost = energy["dissipated"][at[1]] - energy["dissipated"][at[0]]
    assert taken > 0
    assert taken == pytest.approx(lost, rel=0.05)


def test_water_carries_what_floats(run: Runner) -> None:
    scene = cases.floating(500.0)
    scene.add_sensor(name="lift", sensor=sensors.ContactLoad(contact="wet", interval=0.01))
    simulation = run(scene)
    simulation.run(until=1.2)
    # On the water, which is the second of the contact's names; frictionless.
    assert mean_of(simulation, "lift", "force_y", 0.4) == pytest.approx(-500 * 0.01 * G, rel=0.01)
    for component in ("tangential", "friction_power"):
        assert np.abs(simulation.sensors["lift"][component]).max() < 1e-12 * 500 * 0.01 * G


@pytest.mark.parametrize("precision", ["single", "double"])
def test_series_of_split_and_resumed_runs_have_the_same_bits(
    run: Runner, device: str, tmp_path: Path, precision: str
) -> None:
    def scene() -> libmpm.Scene:
        made = cases.dominoes(3)
        made.add_sensor(name="tips", sensor=sensors.ContactLoad(contact="tips", interval=0.004))
        return made

    whole = run(scene(), precision=precision)
    whole.run(until=0.12)
    first = run(scene(), precision=precision, threads=2)
    first.run(until=0.0613)  # between two samples
    first.save_checkpoint(tmp_path / "half.h5")
    second = libmpm.Simulation.resume(tmp_path / "half.h5", device=device)
    second.run(until=0.12)
    assert np.abs(whole.sensors["tips"].values).max() > 0
    assert np.array_equal(whole.sensors["tips"].values, second.sensors["tips"].values)


def test_first_and_second_are_those_of_the_contact(run: Runner) -> None:
    """Whichever was added first, the force is that on the second name's bodies."""
    found = []
    for between in (("left", "right"), ("right", "left")):
        scene = cases.discs(6, 0.02 * cases.sound_speed(1e6, 0.3))
        scene._contacts.clear()
        scene.add_contact(name="discs", between=between, law=contacts.Friction())
        scene.add_sensor(name="blow", sensor=sensors.ContactLoad(contact="discs", interval=0.01))
        simulation = run(scene)
        simulation.run(until=0.06)
        found.append(simulation.sensors["blow"]["force_x"])
    assert np.abs(found[0]).max() > 0
    assert np.array_equal(found[0], -found[1])


@pytest.mark.parametrize(
    ("load", "says"),
    [
        ({"contact": "tip"}, "contact 'tip' is unknown; did you mean 'tips'"),
        ({"contact": "stuck"}, "is of Stick"),
        ({"contact": "tips", "pair": ("domino 00", "domino 9")}, "'domino 9', which is no body"),
        ({"contact": "stuck", "pair": ("domino 00", "domino 01")}, "does not name"),
    ],
)
def test_what_is_refused(load: dict[str, Any], says: str) -> None:
    scene = cases.dominoes(4)
    scene._contacts.clear()
    scene.add_contact(name="tips", between=("*00", "*01"), law=contacts.Friction())
    scene.add_contact(name="stuck", between=("*02", "*03"), law=contacts.Stick())
    scene.add_sensor(name="load", sensor=sensors.ContactLoad(**load))
    with pytest.raises(libmpm.SceneError, match=says):
        scene.validate()


def test_pairs_that_are_none() -> None:
    for pair in ("ab", ("a",), ("a", "a"), ("a", "b", "c")):
        with pytest.raises(libmpm.SceneError, match=r"pair is .* expected the names of two bodies"):
            sensors.ContactLoad(contact="c", pair=pair)
    scene = cases.floating(500.0)
    scene._contacts.clear()
    scene.add_sensor(name="load", sensor=sensors.ContactLoad(contact="wet"))
    with pytest.raises(libmpm.SceneError, match="contact 'wet' is unknown; the scene has none"):
        scene.validate()
