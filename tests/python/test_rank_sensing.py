"""Sensors that are evaluated in Python, of ranks that are processes: the bits of one process.

Expected duration: 15 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import materials, sensors, shapes
from support import jobs
from support.sensing_scenes import SOLID, busy_scene

HEAD = """
import os
import numpy as np
import libmpm
from python.test_rank_sensing import seen, watched
folder = os.environ["FOLDER"]
def make(**more):
    return libmpm.Simulation(
        watched(), device="cpu", ranks="processes", precision="double", threads=1, **more)
"""


def watched():
    """A block and a bar of elements that fall into water, and one of every sensor."""
    scene = busy_scene()
    mesh = shapes.Triangles.box(lower=(1.2, 0.52), upper=(1.6, 0.62), edge=0.05)
    scene.add_body(
        name="bar", shape=mesh, material=materials.FixedCorotated(**SOLID), velocity=(0.0, -2.0)
    )
    for attribute in ("element_stress_XX", "velocity"):
        bar = sensors.ParticleSensor(
            attribute=attribute, operation="std", body="bar", interval=0.01
        )
        scene.add_sensor(name=f"bar {attribute}", sensor=bar)
    for name in ("boundary_force", "orientation", "contact_force"):
        tracker = sensors.BodyTracker(body="block", quantities=(name,), interval=0.01)
        scene.add_sensor(name=name, sensor=tracker)
    for name in ("kinetic_energy", "volume_energy"):
        grid = sensors.GridSensor(attribute=name, operation="sum", interval=0.01)
        scene.add_sensor(name=name, sensor=grid)
    pair = sensors.ContactForce(body="block", by="water", interval=0.01)
    scene.add_sensor(name="pair", sensor=pair)
    own = sensors.Custom(function=seen, columns=("front", "nodes", "count"), interval=0.01)
    scene.add_sensor(name="own", sensor=own)
    # Of a region in which one rank alone has anything, and in which none has.
    for name, low in (("corner", 0.1), ("dry", 1.7)):
        region = shapes.Box(lower=(1.7, low), upper=(1.79, low + 0.09))
        mass = sensors.GridSensor(attribute="mass", operation="sum", region=region, interval=0.01)
        scene.add_sensor(name=name, sensor=mass)
    return scene


def seen(sim):
    """Front, nodes and particles: what a function of a user may look at."""
    place = sim.particles["water"]["position"]
    return place[:, 0].max(), len(sim.grid["mass"]), sum(len(p) for p in sim.particles.values())


def equal(found, series):
    name, values = series.name, found[series.name]
    np.testing.assert_array_equal(found[f"{name} times"], series.time, err_msg=name)
    np.testing.assert_array_equal(values, series.values, err_msg=name)


@pytest.mark.parametrize("ranks", [2, 3])
def test_bits_of_one(ranks, tmp_path):
    """On every rank, and in a run that goes on from its checkpoint."""
    one = libmpm.Simulation(watched(), device="cpu", precision="double", threads=1)
    one.run(until=0.1, progress=False)
    code = """
        sim = make(output=libmpm.Output(folder + "/run", checkpoint_interval=0.05))
        sim.run(until=0.06, progress=False)
        sim = libmpm.Simulation.resume(
            folder + "/run", ranks="processes", device="cpu", functions={"own": seen})
        sim.run(until=0.1, progress=False)
        series = {n: s.values for n, s in sim.sensors.items()}
        series |= {n + " times": s.time for n, s in sim.sensors.items()}
        np.savez(f"{folder}/{sim.rank}.npz", **series)
    """
    jobs.well(jobs.run(ranks, jobs.script(HEAD, code), tmp_path))
    for rank in range(ranks):
        found = np.load(tmp_path / f"{rank}.npz")
        for series in one.sensors.values():
            equal(found, series)
    assert np.isfinite(one.sensors["pair"].values).any()
    assert one.sensors["corner"].values[-1, 0] > 0
    assert one.sensors["dry"].values[-1, 0] == 0


@pytest.mark.parametrize(
    ("function", "word"),
    [("len(sim.device_arrays)", "'device_arrays' of the simulation is asked for"),
     ("fails(sim)", "mine")],
)  # fmt: skip
def test_a_function_that_fails_ends_all(function, word, tmp_path):
    """One that reads what is each process's own, and one that fails on one rank alone."""
    code = f"""
        def fails(sim):
            if os.environ["RANK"] == "1" and sim.steps > 2:
                raise libmpm.NumericalError("mine")
            return sim.time
        scene = watched()
        last = libmpm.sensors.Custom(function=lambda sim: {function}, columns="n")
        scene.add_sensor(name="last", sensor=last)
        sim = libmpm.Simulation(scene, device="cpu", ranks="processes", threads=1)
        try:
            sim.step(5)
        except libmpm.Error as error:
            print(error)
            raise SystemExit(7)
    """
    for status, out, error in jobs.run(2, jobs.script(HEAD, code), tmp_path):
        assert status == 7, error
        assert word in out
