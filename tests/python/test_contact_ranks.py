"""Bodies that touch on several ranks of the CPU: the bits of one, wherever and however it is cut.

Expected duration: 40 s.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from python.test_contact import slipping

import libmpm
from libmpm import boundaries, sensors, shapes
from support import contact_scenes as cases
from support import jobs
from support.between_ranks import between_ranks


def stack() -> libmpm.Scene:
    scene = cases.stack()
    scene.add_sensor(name="scale", sensor=sensors.LoadCell(boundary="floor", interval=1e-3))
    scene.add_sensor(name="between", sensor=sensors.ContactLoad(contact="stack", interval=1e-3))
    return scene


def dominoes() -> libmpm.Scene:
    scene = cases.dominoes(5)
    scene.add_sensor(name="tips", sensor=sensors.ContactLoad(contact="tips", interval=2e-3))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=2e-3))
    return scene


def floating() -> libmpm.Scene:
    scene = cases.floating(500.0)
    scene.add_sensor(name="lift", sensor=sensors.ContactLoad(contact="wet", interval=1e-3))
    for name, place in (("gauge", (0.15,)), ("beside", (0.05,))):
        scene.add_sensor(name=name, sensor=sensors.WaveGauge(position=place, interval=5e-3))
    probe = sensors.VelocityProbe(position=(0.15, 0.16), interval=5e-3)
    scene.add_sensor(name="probe", sensor=probe)
    return scene


def blows() -> libmpm.Scene:
    """Return blocks that fly into each other and slip on water, with what particles store."""
    scene = slipping()
    for name in ("blocks", "wet"):
        scene.add_sensor(name=name, sensor=sensors.ContactLoad(contact=name, interval=2e-3))
    return scene


def beside_lines() -> libmpm.Scene:
    """Return the same between linear walls and over a round sill, with the loads of both."""
    scene = slipping("linear")
    sill = shapes.Sphere(centre=(0.78, 0.0), radius=0.17)
    scene.add_boundary(name="sill", shape=sill, response=boundaries.Separable(cell="linear"))
    for name in ("walls", "sill"):
        scene.add_sensor(name=name, sensor=sensors.LoadCell(boundary=name, interval=2e-3))
    return scene


#: Scene, time until which it is run, s, and precision.
SCENES: dict[str, tuple[Callable[[], libmpm.Scene], float, str]] = {
    "stack": (stack, 0.06, "double"),
    "dominoes": (dominoes, 0.14, "single"),
    "floating": (floating, 0.04, "double"),
    "blows": (blows, 0.15, "double"),
    "beside lines": (beside_lines, 0.15, "single"),
}


_one: dict[str, libmpm.Simulation] = {}


def one(name: str) -> libmpm.Simulation:
    """Return the run on one rank, made once."""
    if name not in _one:
        make, until, precision = SCENES[name]
        _one[name] = libmpm.Simulation(make(), device="cpu", precision=precision, threads=1)
        _one[name].run(until=until)
    return _one[name]


def many(name: str, ranks: int, **options: Any) -> libmpm.Simulation:
    """Return a simulation of so many ranks, of a thread each."""
    make, _, precision = SCENES[name]
    return libmpm.Simulation(
        make(), device=["cpu"] * ranks, precision=precision, threads=ranks, **options
    )


def assert_alike(a: libmpm.Simulation, b: libmpm.Simulation, series: bool = True) -> None:
    assert (a.time, a.steps) == (b.time, b.steps)
    for body in a.scene.bodies:
        for attribute in ("position", "velocity", "stress"):
            x, y = (cases.by_id(s, body.name, attribute) for s in (a, b))
            assert np.array_equal(x, y), (body.name, attribute)
    for placed in a.scene.sensors if series else ():
        x, y = (s.sensors[placed.name] for s in (a, b))
        assert np.array_equal(x.time, y.time)
        np.testing.assert_allclose(
            x.values, y.values, rtol=0, atol=between_ranks(x), err_msg=placed.name
        )


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize(("ranks", "cuts"), [(2, "x"), (2, "y"), (3, "curve"), (4, "curve")])
def test_bits_of_one(name: str, ranks: int, cuts: str) -> None:
    simulation = many(name, ranks, partition=libmpm.Partition(cuts=cuts))
    assert simulation.ranks == ranks
    simulation.run(until=SCENES[name][1])
    assert simulation.engine.statistics()["contact_blocks"] > 0
    assert_alike(one(name), simulation)


@pytest.mark.parametrize("name", ["dominoes", "blows"])
def test_cuts_that_move_at_every_sort(name: str) -> None:
    partition = libmpm.Partition(cuts="curve", rebalance_above=0)
    simulation = many(name, 3, partition=partition)
    simulation.run(until=SCENES[name][1])
    told = simulation.engine.statistics()
    assert told["rebalances"] > 0 and told["migrated"] > 0
    assert_alike(one(name), simulation)


@pytest.mark.parametrize("name", ["dominoes", "floating"])
def test_resumed_on_another_number(tmp_path: Path, name: str) -> None:
    until = SCENES[name][1]
    three = many(name, 3)
    three.run(until=0.4 * until)
    three.save_checkpoint(tmp_path / "three.h5")
    two = libmpm.Simulation.resume(tmp_path / "three.h5", device=["cpu", "cpu"])
    two.run(until=0.7 * until)
    two.save_checkpoint(tmp_path / "two.h5")
    last = libmpm.Simulation.resume(tmp_path / "two.h5", device="cpu")
    last.run(until=until)
    # Series of several ranks are to rounding, whatever has been resumed.
    assert_alike(one(name), last)


def test_processes(tmp_path: Path) -> None:
    """Ranks that are processes tell each other what threads do."""
    head = "import os, numpy as np, libmpm\nfrom python.test_contact_ranks import SCENES\n"
    code = """
        make, until, precision = SCENES["blows"]
        sim = libmpm.Simulation(
            make(), device="cpu", ranks="processes", threads=1, precision=precision)
        sim.run(until=until)
        for body in sim.scene.bodies:
            all_of = sim.gather(body.name, "position", "velocity")
            if sim.rank == 0:
                np.savez(f"{os.environ['FOLDER']}/{body.name}.npz", **all_of)
    """
    jobs.well(jobs.run(2, jobs.script(head, code), tmp_path))
    for body in one("blows").scene.bodies:
        found = np.load(tmp_path / f"{body.name}.npz")
        for attribute in ("position", "velocity"):
            x = cases.by_id(one("blows"), body.name, attribute)
            assert np.array_equal(x, found[attribute][np.argsort(found["id"])])


def test_grid_is_that_of_one() -> None:
    simulation = many("floating", 2, partition=libmpm.Partition(cuts="x"))
    simulation.run(until=SCENES["floating"][1])
    grids = []
    for s in (one("floating"), simulation):
        place, mass, velocity = (np.asarray(s.grid[n]) for n in ("position", "mass", "velocity"))
        order = np.lexsort(place.T)
        grids.append((place[order], mass[order], velocity[order]))
    for x, y in zip(*grids, strict=True):
        assert np.array_equal(x, y)


def test_plan_says_ranks() -> None:
    plan = cases.dominoes(6).plan(device=["cpu", "cpu"])
    assert plan.ranks == 2
    assert plan.to_dict()["fields"] == 6


#: Bodies that change their ranks for as long as is asked for: LIBMPM_CONTACT_STEPS=20000.
STEPS = int(os.environ.get("LIBMPM_CONTACT_STEPS", "0"))


@pytest.mark.skipif(STEPS == 0, reason="long: LIBMPM_CONTACT_STEPS says how many steps")
def test_long_run() -> None:
    """A row that falls whole, cut along it, with new cuts at every sort."""
    alone = libmpm.Simulation(cases.dominoes(12), device="cpu", precision="single")
    ranks = libmpm.Simulation(
        cases.dominoes(12), device=["cpu"] * 4, precision="single",
        partition=libmpm.Partition(rebalance_above=0),
    )  # fmt: skip
    for simulation in (alone, ranks):
        simulation.step(STEPS)
    assert_alike(alone, ranks)
