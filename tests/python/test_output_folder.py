"""What a run does with a folder that holds other results, and with one that changes under it."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import sys

import pytest
from python.test_checkpoint import output, same_folders, simulate

import libmpm
from libmpm._src.cli.commands import ExitCode, main
from libmpm._src.output import writer
from libmpm._src.output.frames import list_frames, read_series
from libmpm._src.output.sensor_file import read_sensors
from libmpm._src.scene.run_file import RunFile, RunSettings
from python import fake_engine

UNTIL = 0.12


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


def finish(sim):
    sim.run(until=UNTIL, progress=False)
    sim.close()
    return sim.output.path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of runs: a whole one, one of another scene, one of other steps."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "libmpm._core", fake_engine.module())
        finish(simulate(output=output(folder / "whole")))
        finish(simulate(output=output(folder / "steps"), time_step=0.0009))
        other = fake_engine.small_scene(name="other", gravity=(0, 0, -1))
        finish(libmpm.Simulation(other, device="cpu", output=output(folder / "other")))
    return folder


@pytest.fixture
def folders(runs, tmp_path):
    """The same, copies of their own."""
    return shutil.copytree(runs, tmp_path / "runs")


def test_folders_that_nothing_is_written_to_are_not_made(tmp_path):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1), gravity=(0, -9.81))
    box = libmpm.shapes.Box(lower=(0, 0), upper=(0.5, 0.5))
    scene.add_body(name="water", shape=box, material=libmpm.materials.TaitFluid(bulk_modulus=1e6))

    def run(name, **settings):
        made = libmpm.Output(tmp_path / name, **settings)
        sim = libmpm.Simulation(scene, device="cpu", output=made)
        sim.run(until=0.002, progress=False)
        sim.close()
        return {p.name for p in (tmp_path / name).iterdir() if p.is_dir()}

    assert run("bare") == set()
    assert run("frames", frame_interval=0.001) == {"frames"}
    assert run("checkpoints", checkpoint_interval=0.001) == {"checkpoints"}
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy(interval=0.001))
    assert run("sensors") == {"csv"}
    found = libmpm.load(tmp_path / "bare")
    assert found.checkpoints == [] and list(found.frames) == []


def bytes_of(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).digest() for p in files}


# Results of other runs ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "said"),
    [("other", "the run of another scene ('other')"), ("steps", "another run of this scene (sens")],
)
def test_a_checkpoint_goes_on_in_its_own_folder_alone(folders, capsys, name, said):
    """Else the folder's later results are cut off, and the earlier ones are of another run."""
    source, there = folders / "whole" / "checkpoints" / "step_0000000100.npz", folders / name
    before = bytes_of(there)
    sim = libmpm.Simulation.resume(source, output=output(there))
    with pytest.raises(libmpm.OutputError, match="which this run would cut and mix") as caught:
        sim.run(until=UNTIL, progress=False)
    assert said in str(caught.value)
    assert str(there) in str(caught.value)
    command = ["resume", str(source), "-o", str(there), "--until", str(UNTIL), "--quiet",
               "--no-picture"]  # fmt: skip
    assert main(command) == ExitCode.OUTPUT
    assert said in capsys.readouterr().err
    assert bytes_of(there) == before
    assert main([*command, "--overwrite"]) == 0
    assert libmpm.load(there).scene == libmpm.load(folders / "whole").scene
    assert len(libmpm.load(there).sensors["gauge"]) == 120
    # Frames before the checkpoint are in the folder of the run that it came from.
    assert list(list_frames(there / "frames")["water"]) == [6]


def test_an_earlier_checkpoint_cuts_its_own_folder_and_needs_no_leave(folders, runs):
    source = folders / "whole" / "checkpoints" / "step_0000000050.npz"
    finish(libmpm.Simulation.resume(source, output=output(folders / "whole")))
    assert same_folders(folders / "whole", runs / "whole")


@pytest.mark.parametrize("damage", ["", "{", "[1]", '{"libmpm": 1}', None])
def test_whose_folder_it_is_the_checkpoints_say_too(folders, runs, damage):
    for name in ("whole", "other"):
        path = folders / name / "scene.json"
        path.unlink()
        if damage is not None:
            path.write_text(damage)
    source = shutil.copy(folders / "whole" / "checkpoints" / "step_0000000050.npz", folders)
    if damage == '{"libmpm": 1}':
        # A scene, but not this one: nothing tells that it was damaged.
        with pytest.raises(libmpm.OutputError, match="another scene"):
            finish(libmpm.Simulation.resume(source, output=output(folders / "whole")))
        return
    with pytest.warns(libmpm.ModelWarning, match="scene.json: .* checkpoint has the scene too"):
        finish(libmpm.Simulation.resume(source, output=output(folders / "whole")))
    assert same_folders(folders / "whole", runs / "whole")
    assert libmpm.load(folders / "whole").scene == fake_engine.small_scene()
    with (
        pytest.warns(libmpm.ModelWarning, match="scene.json"),
        pytest.raises(libmpm.OutputError, match="the run of another scene"),
    ):
        finish(libmpm.Simulation.resume(source, output=output(folders / "other")))


def test_leave_to_overwrite_is_not_inherited(tmp_path, folders):
    """`--overwrite` of the run that wrote a checkpoint says nothing about another folder."""
    own = output(tmp_path / "own", overwrite=True)
    finish(simulate(output=own))
    again = libmpm.Simulation.resume(tmp_path / "own")
    assert not again.recorded_output().overwrite
    command = ["resume", str(tmp_path / "own"), "-o", str(folders / "other"), "--until", "0.2"]
    assert main([*command, "--quiet", "--no-picture"]) == ExitCode.OUTPUT


def test_a_scene_file_that_lies_there_is_not_replaced(tmp_path, capsys):
    """A folder with the scene file of somebody else is not a folder of results, nor empty."""
    folder = tmp_path / "a"
    folder.mkdir()
    for name, gravity in (("scene", -1.0), ("mine", -9.81)):
        scene = fake_engine.small_scene(gravity=(0, 0, gravity))
        (folder / f"{name}.json").write_text(
            json.dumps(RunFile(scene, RunSettings(until=0.01)).to_dict())
        )
    before = (folder / "scene.json").read_bytes()
    command = ["run", str(folder / "mine.json"), "-o", str(folder), "--quiet", "--no-picture"]
    assert main(command) == ExitCode.OUTPUT
    assert "holds a scene.json of another scene" in capsys.readouterr().err
    assert (folder / "scene.json").read_bytes() == before
    command[1] = str(folder / "scene.json")
    assert main(command) == 0


# Ctrl-C before the first step -----------------------------------------------------------------


@pytest.mark.parametrize("place", ["SensorFile", "frame_times", "clear"])
def test_an_interrupt_before_the_first_step_loses_nothing(tmp_path, monkeypatch, runs, place):
    """It comes while the folder is made, before the frame and the samples of the start."""
    real = getattr(writer, place)

    def interrupted(*arguments, **named):
        os.kill(os.getpid(), signal.SIGINT)
        return real(*arguments, **named)

    monkeypatch.setattr(writer, place, interrupted)
    sim = simulate(output=output(tmp_path / "out"))
    with pytest.raises(KeyboardInterrupt):
        sim.run(until=UNTIL, progress=False)
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "libmpm._core", fake_engine.module())
    assert 0 in list_frames(tmp_path / "out" / "frames")["water"]
    assert not (tmp_path / "out" / "lock").exists()
    finish(libmpm.Simulation.resume(tmp_path / "out", output=output(tmp_path / "out")))
    assert same_folders(tmp_path / "out", runs / "whole")


def test_a_checkpoint_of_the_start_without_a_frame_gets_it(tmp_path, runs):
    """As versions before left it, or a handler of the caller's own that raises at once."""
    sim = simulate(output=output(tmp_path / "out"))
    sim.step(0)
    sim._files.writer.checkpoint()
    sim.close()
    for path in (tmp_path / "out" / "frames").iterdir():
        path.unlink()
    finish(libmpm.Simulation.resume(tmp_path / "out", output=output(tmp_path / "out")))
    assert same_folders(tmp_path / "out", runs / "whole")


def test_an_interrupt_at_the_last_step_is_not_swallowed(tmp_path):
    sim = simulate(output=output(tmp_path / "out"))
    real = sim.engine.run

    def run(steps, until, wall):
        result = real(steps, until, wall)
        if sim.time >= 0.02:
            os.kill(os.getpid(), signal.SIGINT)
        return result

    sim.engine.run = run
    with pytest.raises(KeyboardInterrupt):
        sim.run(until=0.02, progress=False)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


# Files that are deleted while the run goes on -------------------------------------------------


@pytest.mark.parametrize("at", [0.05, UNTIL])
def test_what_is_deleted_during_a_run_is_written_again(tmp_path, runs, at):
    """By hand, or by a job that cleans up: nothing that is still known is missing at the end."""
    sim = simulate(output=output(tmp_path / "out"))
    sim.run(until=0.05, progress=False)

    def delete(state):
        if state.time >= at and not deleted:
            for name in ("sensors.h5", "scene.json", "csv/gauge.csv", "log.json"):
                (tmp_path / "out" / name).unlink()
            deleted.append(state)

    deleted = []
    with pytest.warns(libmpm.ModelWarning, match="sensors.h5 was deleted or replaced during the"):
        sim.run(until=UNTIL, progress=delete)
    assert deleted
    assert same_folders(tmp_path / "out", runs / "whole")
    assert libmpm.load(tmp_path / "out").log["status"] == "finished"


def test_frames_that_are_deleted_during_a_run_are_named(tmp_path, core):
    core.Engine.leave_at = 10
    sim = simulate(output=output(tmp_path / "out"))
    with pytest.warns(libmpm.ModelWarning, match="left the domain"):
        sim.run(until=0.05, progress=False)
    for name in ("water_000001", "water_000002", "block_000000"):
        (tmp_path / "out" / "frames" / f"{name}.vtkhdf").unlink()
    (tmp_path / "out" / "removed.csv").unlink()
    with pytest.warns(libmpm.ModelWarning, match=r"removed.csv and 3 more files that this run"):
        sim.run(until=0.07, progress=False)
    assert list(read_series(tmp_path / "out" / "frames", "water")) == [0, 3]
    assert len(read_sensors(tmp_path / "out" / "sensors.h5")["gauge"]) == 70
