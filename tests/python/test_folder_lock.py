"""One run at a time writes into a folder: processes, hosts that cannot be asked, one process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from python.test_checkpoint import same_folders

import libmpm
from libmpm._src.cli.commands import ExitCode, main
from libmpm._src.output import folder_lock, locks
from libmpm._src.output.locks import Lock
from libmpm._src.output.sensor_file import read_sensors
from libmpm._src.scene.run_file import RunFile, RunSettings
from python import fake_engine

UNTIL = 0.2

SLOW = """
import sys
from python import fake_engine
fake_engine.install().Engine.delay = 4e-3
from libmpm._src.cli.commands import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


def write_command(folder):
    """Return the command line of a run of 200 steps with frames and checkpoints."""
    settings = RunSettings(until=UNTIL, frame_interval=0.05, checkpoint_interval=0.02)
    path = folder / "scene.json"
    path.write_text(json.dumps(RunFile(fake_engine.small_scene(), settings).to_dict()))
    out = folder / "out"
    command = ["run", str(path), "-o", str(out), "--quiet", "--no-picture", "--continue"]
    return [*command, "--device", "cpu"]


@pytest.fixture
def command(tmp_path):
    return write_command(tmp_path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of the same run that nobody disturbed."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "libmpm._core", fake_engine.module())
        assert main(write_command(folder)) == 0
    return folder / "out"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def begin(command, out):
    """Start a slow run in a process of its own and wait for its first checkpoint."""
    child = subprocess.Popen(
        [sys.executable, "-c", SLOW, *command],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    limit = time.monotonic() + 60
    while not list(out.glob("checkpoints/step_*.npz")) and time.monotonic() < limit:
        time.sleep(0.02)
    assert child.poll() is None
    return child


def content(out):
    return json.loads((out / folder_lock.LOCK).read_text())


def edit(out, **changes):
    (out / folder_lock.LOCK).write_text(json.dumps(content(out) | changes))


def test_a_second_run_is_refused_and_the_first_loses_nothing(command, out, whole, capsys):
    child = begin(command, out)
    for second in (command, ["resume", str(out), "--quiet"]):
        assert main(second) == ExitCode.OUTPUT
        said = capsys.readouterr().err
        assert f"{out} is being written by process {child.pid}; a second run" in said
    with pytest.raises(libmpm.OutputError, match=f"process {child.pid}"):
        libmpm.Simulation.resume(out, output=out).step(1)
    assert child.wait(timeout=60) == 0, child.stderr.read()
    assert not (out / folder_lock.LOCK).exists()
    assert len(read_sensors(out / "sensors.h5")["gauge"]) == 200
    assert same_folders(out, whole)
    capsys.readouterr()
    assert main(command) == 0
    assert "nothing to do" in capsys.readouterr().out


def test_after_a_kill_the_next_run_takes_over_at_once(command, out, whole, capsys):
    child = begin(command, out)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert content(out)["pid"] == child.pid
    began = time.monotonic()
    assert main(command) == 0
    assert time.monotonic() - began < locks.UNSIGNED
    assert "warning" not in capsys.readouterr().err
    assert not (out / folder_lock.LOCK).exists()
    assert same_folders(out, whole)


def test_the_lock_of_a_silent_host_is_taken_over_after_the_wait(command, out, whole, monkeypatch):
    child = begin(command, out)
    child.send_signal(signal.SIGKILL)
    child.wait()
    edit(out, place="another boot", host="node17")
    monkeypatch.setattr(locks, "STALE", 0.4)
    monkeypatch.setattr(folder_lock, "_LOOK", 0.05)
    match = rf"has the lock of process {child.pid} of node17, which .* no heartbeat for 0\.4 s"
    with pytest.warns(libmpm.ModelWarning, match=match):
        assert main(command) == 0
    assert same_folders(out, whole)


def test_the_lock_of_a_host_that_beats_is_respected(out, monkeypatch):
    """However long ago the heartbeat was by this host's clock: clocks are not compared."""
    out.mkdir()
    lock = Lock.acquire(out / folder_lock.LOCK)
    edit(out, place="another boot", host="node17")
    monkeypatch.setattr(folder_lock, "_LOOK", 0.05)
    over = threading.Event()

    def beat():
        stamp = 1000
        while not over.wait(0.1):
            stamp += 5
            os.utime(lock.path, (stamp, stamp))

    thread = threading.Thread(target=beat)
    thread.start()
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=out)
    try:
        with (
            pytest.warns(libmpm.ModelWarning, match="node17"),
            pytest.raises(libmpm.OutputError, match=r"written by process \d+ of node17; a second"),
        ):
            sim.step(1)
    finally:
        over.set()
        thread.join()
    assert sorted(p.name for p in out.iterdir()) == [folder_lock.LOCK]


def test_a_run_that_was_taken_over_writes_no_more(out, monkeypatch):
    """Its host slept, say: the folder belongs to who went on, and the error says so."""
    monkeypatch.setattr(locks, "HEARTBEAT", 0.02)
    sim = libmpm.Simulation(
        fake_engine.small_scene(), device="cpu",
        output=libmpm.Output(out, frame_interval=0.01, checkpoint_interval=0.05),
    )  # fmt: skip
    sim.run(until=0.1, progress=False)
    seen = {}

    def take_over(state):
        if not seen and state.time > 0.12:
            edit(out, token="another", host="node17", place="another boot")
            seen["log"] = (out / "log.json").read_text()
            seen["frames"] = sorted((out / "frames").iterdir())
            time.sleep(0.05)

    sim._assembly.backend.module.Engine.delay = 1e-3
    with pytest.raises(libmpm.OutputError, match="of node17 has taken it over; nothing more is"):
        sim.run(until=0.6, progress=take_over)
    assert (out / "log.json").read_text() == seen["log"]
    assert sorted((out / "frames").iterdir()) == seen["frames"]
    assert content(out)["token"] == "another"


def test_a_simulation_made_again_takes_the_folder_from_the_forgotten_one(out):
    """As in a notebook: the first one was stepped, not closed, and must not write again."""
    first = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=out)
    first.step(3)
    second = libmpm.Simulation(
        fake_engine.small_scene(), device="cpu", output=libmpm.Output(out, overwrite=True)
    )
    second.step(5)
    with pytest.raises(libmpm.OutputError, match="written by another run since this one stopped"):
        first.step(1)
    first.close()
    second.run(until=0.02, progress=False)
    assert len(read_sensors(out / "sensors.h5")["gauge"]) == 20
    with pytest.raises(libmpm.OutputError, match="written by another run since this one stopped"):
        first.run(until=0.1, progress=False)
    assert len(read_sensors(out / "sensors.h5")["gauge"]) == 20


def test_two_simulations_of_a_process_do_not_share_a_folder(out):
    first = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=out)
    said = []

    def other(state):
        if not said:
            second = libmpm.Simulation(
                fake_engine.small_scene(), device="cpu", output=libmpm.Output(out, overwrite=True)
            )
            with pytest.raises(libmpm.OutputError, match="another simulation of this process"):
                second.step(1)
            said.append(state.time)

    first.run(until=0.05, progress=other)
    assert said
    assert len(read_sensors(out / "sensors.h5")["gauge"]) == 50


def test_the_lock_of_a_study_serves_the_run_inside_it_alone(out):
    out.mkdir()
    lock = Lock.acquire(out / folder_lock.LOCK)
    made = lambda: libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=out)  # noqa: E731
    with folder_lock.lent(lock):
        sim = made()
        sim.run(until=0.01, progress=False)
    assert lock.beat(), "the run gave back a lock that was lent to it"
    lock.release()
    sim.run(until=0.02, progress=False)
    assert not (out / folder_lock.LOCK).exists()


def test_a_program_started_in_the_place_of_the_owner_takes_over(out):
    """`exec` keeps number and start of a process: the lock would look held for ever."""
    out.mkdir()
    Lock.acquire(out / folder_lock.LOCK)
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=out)
    sim.run(until=0.01, progress=False)
    assert not (out / folder_lock.LOCK).exists()
