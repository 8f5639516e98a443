"""Real kills at random moments of a run, then resume and compare with a run never stopped."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
import warnings

import pytest
from python.test_checkpoint import output, same_folders

import libmpm
from libmpm._src.output.frames import list_frames
from libmpm._src.output.sensor_file import read_sensors
from python import fake_engine

UNTIL = 0.5

RUN = """
import sys
from python import fake_engine
core = fake_engine.install()
core.Engine.delay = 5e-4
import libmpm
from python.test_checkpoint import output
sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output(sys.argv[1]))
sim.step(1)
print("started", flush=True)
sim.run(until=0.5, progress=False)
"""


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a run that nobody stopped."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "libmpm._core", fake_engine.module())
        sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output(folder))
        sim.step(1)
        sim.run(until=UNTIL, progress=False)
        sim.close()
    return folder


def start(folder):
    child = subprocess.Popen(
        [sys.executable, "-c", RUN, str(folder)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stdout is not None
    assert child.stdout.readline() == "started\n"
    return child


@pytest.mark.parametrize("seed", range(6))
def test_a_kill_loses_at_most_the_frame_in_flight(tmp_path, whole, seed):
    child = start(tmp_path)
    time.sleep(random.Random(seed).uniform(0.0, 0.6))
    child.send_signal(signal.SIGKILL)
    child.wait()
    reference = read_sensors(whole / "sensors.h5")
    for name, series in read_sensors(tmp_path / "sensors.h5").items():
        count = len(series)
        assert (series.time == reference[name].time[:count]).all()
        assert (series.values == reference[name].values[:count]).all()
    for body, numbered in list_frames(tmp_path / "frames").items():
        assert list(numbered) == list(range(len(numbered)))
        for path in numbered.values():
            assert path.read_bytes() == (whole / "frames" / path.name).read_bytes(), body
    if not list((tmp_path / "checkpoints").glob("step_*.npz")):
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # A doubt about the scene, not about its files: said at every start.
        warnings.filterwarnings("ignore", "boundary 'walls' carries a load cell in water")
        again = libmpm.Simulation.resume(tmp_path, output=output(tmp_path))
    again.run(until=UNTIL, progress=False)
    again.close()
    assert same_folders(tmp_path, whole)


def test_samples_are_in_the_file_within_a_second(tmp_path):
    child = start(tmp_path)
    # The loop flushes twice a second; the margin is for a busy machine.
    time.sleep(1.0)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert len(read_sensors(tmp_path / "sensors.h5")["gauge"]) > 50


def test_sigint_leaves_a_checkpoint_to_go_on_from(tmp_path, whole):
    child = start(tmp_path)
    time.sleep(0.2)
    child.send_signal(signal.SIGINT)
    child.wait(timeout=20)
    log = (tmp_path / "log.json").read_text()
    assert '"interrupted"' in log
    again = libmpm.Simulation.resume(tmp_path, output=output(tmp_path))
    assert f'"steps": {again.steps},' in log
    again.run(until=UNTIL, progress=False)
    assert same_folders(tmp_path, whole)
