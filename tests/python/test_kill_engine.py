"""Real kills of the compiled engine: what is left opens, and resuming ends in the same bits."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import libmpm
from libmpm._src.output.frames import list_frames, read_frame
from libmpm._src.output.sensor_file import read_sensors

pytest.importorskip("libmpm._core")

UNTIL = 3.0

RUN = """
import sys
from python.test_kill_engine import scene, output
import libmpm
sim = libmpm.Simulation(scene(), device="cpu", threads=1, output=output(sys.argv[1]))
sim.step(1)
print("started", flush=True)
sim.run(until=3.0, progress=False)
"""


def scene():
    """A puddle that sloshes against a post, about a second of wall time until `UNTIL`."""
    made = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(2.0, 1.0), gravity=(0, -9.81)
    )
    made.add_body(
        name="water",
        shape=libmpm.shapes.Box(lower=(0, 0), upper=(0.6, 0.5)),
        material=libmpm.materials.TaitFluid(bulk_modulus=5e5),
    )
    made.add_boundary(
        name="walls", shape=libmpm.shapes.DomainWalls(), response=libmpm.boundaries.Slip()
    )
    made.add_boundary(
        name="post",
        shape=libmpm.shapes.Box(lower=(1.4, 0), upper=(1.5, 0.4)),
        response=libmpm.boundaries.Separable(),
    )
    made.add_sensor(name="load", sensor=libmpm.sensors.LoadCell(boundary="post", interval=0.005))
    return made


def output(folder):
    """Frames and checkpoints often enough for a kill to meet them."""
    return libmpm.Output(
        folder, frame_interval=0.1, checkpoint_interval=0.2, attributes={"water": ["velocity"]}
    )


def positions(simulation):
    """Positions of the water by id."""
    return simulation.particles["water"]["position"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder and last positions of a run that nobody stopped, and how long it took."""
    folder = tmp_path_factory.mktemp("whole")
    began = time.perf_counter()
    simulation = libmpm.Simulation(scene(), device="cpu", threads=1, output=output(folder))
    simulation.step(1)
    simulation.run(until=UNTIL, progress=False)
    simulation.close()
    return folder, positions(simulation), time.perf_counter() - began


@pytest.mark.parametrize("seed", range(4))
def test_a_killed_run_goes_on_to_the_same_bits(tmp_path, whole, seed):
    folder, last, seconds = whole
    child = subprocess.Popen(
        [sys.executable, "-c", RUN, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "started\n"
    time.sleep(random.Random(seed).uniform(0.1, 0.9) * seconds)
    child.send_signal(signal.SIGKILL)
    child.wait()
    series, reference = (
        read_sensors(tmp_path / "sensors.h5")["load"],
        read_sensors(folder / "sensors.h5")["load"],
    )
    count = len(series)
    assert (series.time == reference.time[:count]).all()
    assert (series.values == reference.values[:count]).all()
    for number, path in list_frames(tmp_path / "frames")["water"].items():
        there = list_frames(folder / "frames")["water"][number]
        here_points, there_points = (read_frame(p)[0]["position"] for p in (path, there))
        assert np.array_equal(here_points, there_points)
    if not list((tmp_path / "checkpoints").glob("step_*.npz")):
        return
    again = libmpm.Simulation.resume(tmp_path, output=output(tmp_path))
    again.run(until=UNTIL, progress=False)
    again.close()
    assert np.array_equal(positions(again), last)
    resumed = read_sensors(tmp_path / "sensors.h5")["load"]
    assert np.array_equal(resumed.time, reference.time)
    assert np.array_equal(resumed.values, reference.values)
