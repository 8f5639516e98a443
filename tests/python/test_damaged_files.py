"""Every reader and every command is fed damaged files: it goes on and says so, or names the file.

The default run takes a part of all combinations; `pytest -m slow` takes all, several times.
"""

from __future__ import annotations

import contextlib
import json
import random
import shutil
import sys
import warnings

import pytest

import libmpm
from libmpm._src.cli.commands import ExitCode, main
from libmpm._src.output.locks import Lock
from libmpm._src.pictures.animate import RunFrames
from libmpm._src.scene.run_file import RunFile, RunSettings
from python import fake_engine
from support.damage import cases, damage

FILES = [
    "scene.json", "log.json", "plan.txt", "sensors.h5", "removed.csv", "lock", "csv/gauge.csv",
    "frames/water_000001.vtkhdf", "frames/water_000003.vtkhdf", "frames/water.vtkhdf.series",
    "checkpoints/step_0000000100.npz", "checkpoints/step_0000000050.npz",
    "frames", "csv", "checkpoints",
]  # fmt: skip

QUIET = ["--until", "0.12", "--quiet", "--no-picture", "--device", "cpu"]
COMMANDS = {
    "info": ["info", "OUT"],
    "info of a checkpoint": ["info", "OUT/checkpoints/step_0000000100.npz"],
    "json": ["info", "OUT", "--json"],
    "csv": ["export", "OUT", "--to", "csv"],
    "npz": ["export", "OUT", "--to", "npz", "--one-file"],
    "vtkhdf": ["export", "OUT", "--to", "vtkhdf", "--attributes", "pressure"],
    "export of a checkpoint": ["export", "OUT/checkpoints/step_0000000100.npz", "--to", "csv"],
    "resume": ["resume", "OUT", *QUIET],
    "resume elsewhere": ["resume", "OUT", "-o", "NEW", *QUIET],
    "continue": ["run", "OUT/../scene.json", "-o", "OUT", "--continue", *QUIET],
    "overwrite": ["run", "OUT/../scene.json", "-o", "OUT", "--overwrite", *QUIET],
    "run": ["run", "OUT/scene.json", "-o", "NEW", *QUIET],
    "check": ["check", "OUT/scene.json"],
    "plan": ["plan", "OUT/scene.json", "--device", "cpu"],
}


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a run with everything that a run writes."""
    folder = tmp_path_factory.mktemp("whole")
    settings = RunSettings(until=0.1, frame_interval=0.03, checkpoint_interval=0.05)
    source = RunFile(fake_engine.small_scene(), settings)
    (folder / "scene.json").write_text(json.dumps(source.to_dict()))
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = fake_engine.module()
        made.Engine.leave_at = 20
        patch.setitem(sys.modules, "libmpm._core", made)
        command = ["run", str(folder / "scene.json"), "-o", str(folder / "out")]
        assert main([*command, *QUIET[2:]]) == 0
    lock = Lock.acquire(folder / "out" / "lock")
    content = json.loads(lock.path.read_text())
    lock.path.write_text(json.dumps(content | {"pid": 2**22 + 1}))
    return folder


def read_all(out):
    """Read everything that `libmpm.load` offers."""
    results = libmpm.load(out)
    _ = repr(results), results.log, results.checkpoints
    for call in (
        lambda: [results.sensors[name].values for name in results.sensors],
        lambda: [(f.times, f.at(0.05)["velocity"]) for f in results.frames.values()],
        lambda: [frame["position"] for f in results.frames.values() for frame in f],
        lambda: results.scene,
        lambda: (run := RunFrames(out, None, 100)) and [run.dots(i, "speed") for i in run.indices],
    ):
        with contextlib.suppress(libmpm.Error):
            call()


def go_on(out):
    """Resume in Python, in its own folder and from what another scene may begin with."""
    with contextlib.suppress(libmpm.Error):
        libmpm.Scene.from_checkpoint(out)
    sim = libmpm.Simulation.resume(out, output=libmpm.Output(out, frame_interval=0.03))
    sim.run(until=0.11, progress=False)


CALLS = {"load": read_all, "go on": go_on}


def judge(out, file, kind, call, seed):
    """Damage a file and make a call: no exception but libmpm's own, no code of the unexpected."""
    damage(out / file, kind, random.Random(f"{file} {kind} {seed}"))
    try:
        if call in CALLS:
            with contextlib.suppress(libmpm.Error):
                CALLS[call](out)
            return
        new = out.parent / "new"
        words = [w.replace("OUT", str(out)).replace("NEW", str(new)) for w in COMMANDS[call]]
        code = main(words)
        assert code in (ExitCode.DONE, ExitCode.INPUT, ExitCode.OUTPUT), f"exit code {code}"
    except (Exception, SystemExit) as error:
        raise AssertionError(f"{file} {kind}, {call}, seed {seed}: {error!r}") from error


def judge_all(whole, tmp_path, drawn, seed=0):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number, (file, kind, call) in enumerate(drawn):
            place = tmp_path / str(number)
            shutil.copytree(whole, place)
            judge(place / "out", file, kind, call, seed)
            shutil.rmtree(place)


def test_a_damaged_folder_is_read_as_far_as_it_is_whole(whole, tmp_path, capsys):
    judge_all(whole, tmp_path, cases(FILES, [*COMMANDS, *CALLS], 60))
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_all_damages_of_a_folder(whole, tmp_path, seed):
    judge_all(whole, tmp_path, cases(FILES, [*COMMANDS, *CALLS], None), seed)
