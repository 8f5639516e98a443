"""Stopping and going on: signals, the wall-clock limit, jobs that are submitted again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import libmpm
from libmpm._src.base.interrupts import asked_to_stop
from libmpm._src.cli.commands import ExitCode, main
from libmpm._src.cli.options import seconds as _seconds
from libmpm._src.scene.run_file import RunFile, RunSettings
from python import fake_engine


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


@pytest.fixture
def scene_file(tmp_path):
    """A scene file whose run writes frames and no checkpoints."""
    path = tmp_path / "scene.json"
    settings = RunSettings(until=0.1, frame_interval=0.02)
    path.write_text(json.dumps(RunFile(fake_engine.small_scene(), settings).to_dict()))
    return path


@pytest.fixture
def quiet(scene_file, tmp_path):
    """The command that runs the file."""
    out = str(tmp_path / "out")
    return ["run", str(scene_file), "-o", out, "--quiet", "--no-picture", "--device", "cpu"]


def log_of(folder):
    return json.loads((folder / "log.json").read_text())


SIGNALLED = """
import sys
from python import fake_engine
fake_engine.install().Engine.delay = 2e-3
from libmpm._src.cli.commands import main
sys.exit(main(sys.argv[1:]))
"""


def begin(command, out):
    """Start a slow run in a process of its own and wait for its second frame."""
    child = subprocess.Popen(
        [sys.executable, "-c", SIGNALLED, *command],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    limit = time.monotonic() + 30
    while not list(out.glob("frames/water_000002.vtkhdf")) and time.monotonic() < limit:
        time.sleep(0.02)
    return child


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 6), (signal.SIGUSR1, 6)],
)
def test_a_signal_stops_at_a_step_with_a_checkpoint(quiet, scene_file, tmp_path, number, code):
    out = tmp_path / "out"
    if number == signal.SIGINT:
        # Ctrl-C writes a checkpoint where the run writes any.
        document = json.loads(scene_file.read_text())
        document["run"]["checkpoint_interval"] = 1.0
        scene_file.write_text(json.dumps(document))
    child = begin([*quiet, "--until", "10"], out)
    child.send_signal(number)
    printed, _ = child.communicate(timeout=30)
    assert child.returncode == code
    log = log_of(out)
    assert log["status"] == "interrupted"
    assert (out / "checkpoints" / f"step_{log['steps']:010d}.npz").is_file()
    if code == 6:
        assert number.name in log["message"]
        assert f"libmpm resume {out}" in printed


def test_a_stopped_run_goes_on_to_the_bits_of_one_never_stopped(quiet, tmp_path):
    out = tmp_path / "out"
    child = begin([*quiet, "--until", "0.3"], out)
    child.send_signal(signal.SIGTERM)
    assert child.wait(timeout=30) == 6
    assert 0 < log_of(out)["steps"] < 300
    assert main(["resume", str(out), "--quiet", "--no-picture"]) == 0
    whole = [*quiet[:3], str(tmp_path / "whole"), *quiet[4:], "--until", "0.3"]
    assert main(whole) == 0
    one, two = libmpm.load(out), libmpm.load(tmp_path / "whole")
    assert one.frames["water"].indices == two.frames["water"].indices
    for name in two.sensors:
        np.testing.assert_array_equal(one.sensors[name].time, two.sensors[name].time)
        np.testing.assert_array_equal(one.sensors[name].values, two.sensors[name].values)
    for a, b in zip(one.frames["water"], two.frames["water"], strict=True):
        np.testing.assert_array_equal(a["position"], b["position"])


def test_a_run_without_guards_goes_on_without_them(quiet, tmp_path, monkeypatch):
    made = []
    begin_with = libmpm.Simulation.__init__

    def noted(self, *a, **k):
        begin_with(self, *a, **k)
        made.append(self.guard)

    monkeypatch.setattr(libmpm.Simulation, "__init__", noted)
    stopping = ["--until", "60", "--wall-limit", "0"]
    assert main([*quiet, *stopping, "--no-guard"]) == ExitCode.STOPPED
    resumed = ["resume", str(tmp_path / "out"), "--quiet", "--no-picture", *stopping]
    assert main(resumed) == ExitCode.STOPPED
    assert main([*quiet, "--overwrite", *stopping]) == ExitCode.STOPPED
    assert main([*resumed, "--no-guard"]) == ExitCode.STOPPED
    assert made == [None, None, libmpm.Guard(), None]


def test_the_wall_limit_stops_with_a_checkpoint(quiet, tmp_path, core, capsys):
    core.Engine.delay = 2e-3
    out = tmp_path / "out"
    began = time.monotonic()
    assert main([*quiet, "--until", "60", "--wall-limit", "1"]) == ExitCode.STOPPED
    # One step and the writing come after the limit; a minute of simulated time would take two.
    assert time.monotonic() - began < 15
    log = log_of(out)
    assert "wall limit" in log["message"]
    assert [p.name for p in out.glob("checkpoints/*")] == [f"step_{log['steps']:010d}.npz"]
    assert "stopped by wall limit" in capsys.readouterr().out
    core.Engine.delay = 0.0
    assert main(["resume", str(out), "--until", "1", "--quiet", "--no-picture"]) == 0
    assert log_of(out)["steps"] == 1000


def test_continue_starts_goes_on_and_leaves_a_finished_run_alone(
    quiet, tmp_path, core, capsys, monkeypatch
):
    out = tmp_path / "out"
    again = [*quiet, "--continue"]
    assert main([*again, "--wall-limit", "0"]) == ExitCode.STOPPED
    assert log_of(out)["steps"] == 0
    assert main(again) == 0
    assert log_of(out)["steps"] == 100
    written = (out / "sensors.h5").stat().st_mtime_ns
    assert main(again) == 0
    assert "nothing to do" in capsys.readouterr().out
    assert (out / "sensors.h5").stat().st_mtime_ns == written
    # A later end goes on from the same folder.
    assert main([*again, "--until", "0.12"]) == 0
    assert log_of(out)["steps"] == 120


def test_continue_starts_again_what_was_cut_off_without_a_checkpoint(quiet, tmp_path, core):
    out = tmp_path / "out"
    core.Engine.fail_at = 5
    assert main([*quiet, "--continue"]) == ExitCode.NUMERICAL
    core.Engine.fail_at = -1
    assert main([*quiet, "--continue"]) == 0
    assert log_of(out)["steps"] == 100


def test_continue_refuses_the_run_of_another_scene(quiet, scene_file, capsys):
    assert main(quiet) == 0
    document = json.loads(scene_file.read_text())
    document["gravity"] = [0, 0, -5]
    scene_file.write_text(json.dumps(document))
    assert main([*quiet, "--continue"]) == ExitCode.INPUT
    assert "another scene" in capsys.readouterr().err


def test_the_limit_is_told_in_python_too(core):
    core.Engine.delay = 1e-3
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu")
    assert sim.run(until=10, progress=False, wall_limit=0.3) is False
    assert sim.stopped == "wall limit"
    assert 0 < sim.time < 10
    core.Engine.delay = 0.0
    assert sim.run(until=1, progress=False) is True
    assert (sim.stopped, sim.steps) == ("", 1000)
    with pytest.raises(ValueError, match="wall_limit"):
        sim.run(until=2, wall_limit=-1)


def test_handlers_are_those_of_before_afterwards(quiet):
    before = [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGUSR1, signal.SIGINT)]
    assert main(quiet) == 0
    after = [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGUSR1, signal.SIGINT)]
    assert after == before
    assert asked_to_stop() == ""


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("3500", 3500.0), ("0.5", 0.5), ("01:02:03", 3723.0), ("2-00:00:10", 172810.0)],
)
def test_wall_limits_are_seconds_or_clock_times(text, seconds):
    assert _seconds(text) == seconds


@pytest.mark.parametrize("text", ["-1", "nan", "1:2", "00:61:00", "an hour"])
def test_what_is_no_time_is_refused(text, quiet, capsys):
    with pytest.raises(SystemExit) as end:
        main([*quiet, f"--wall-limit={text}"])
    assert end.value.code == ExitCode.INPUT
    assert "expected seconds, HH:MM:SS" in capsys.readouterr().err
