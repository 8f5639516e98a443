"""Checkpoints: what they hold, what damages them, and resuming into a folder."""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest

import libmpm
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output.frames import list_frames
from libmpm._src.output.sensor_file import read_sensors
from python import fake_engine


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


def output(folder, **changes):
    settings = {"frame_interval": 0.02, "checkpoint_interval": 0.05} | changes
    return libmpm.Output(folder, **settings)


def simulate(**changes):
    return libmpm.Simulation(fake_engine.small_scene(), device="cpu", **changes)


def same(a, b):
    """Tell whether two simulations hold the same bits, sensor series included."""
    assert (a.time, a.steps) == (b.time, b.steps)
    for body in a.particles:
        for name in ("id", "position", "velocity"):
            assert (a.particles[body][name] == b.particles[body][name]).all()
    for name in a.sensors:
        assert (a.sensors[name].time == b.sensors[name].time).all()
        # A gauge in the dry reads NaN.
        assert np.array_equal(a.sensors[name].values, b.sensors[name].values, equal_nan=True)
    return True


def same_folders(a, b):
    """Tell whether two runs left the same samples and frames."""
    first, second = read_sensors(a / "sensors.h5"), read_sensors(b / "sensors.h5")
    assert list(first) == list(second)
    for name, series in first.items():
        assert (series.time == second[name].time).all()
        assert (series.values == second[name].values).all()
        csv = f"{name}.csv"
        assert (a / "csv" / csv).read_text() == (b / "csv" / csv).read_text()
    one, two = list_frames(a / "frames"), list_frames(b / "frames")
    assert {k: list(v) for k, v in one.items()} == {k: list(v) for k, v in two.items()}
    for body, numbered in one.items():
        for index, path in numbered.items():
            assert path.read_bytes() == two[body][index].read_bytes()
        series = f"{body}.vtkhdf.series"
        assert (a / "frames" / series).read_text() == (b / "frames" / series).read_text()
    return True


def test_resume_is_bit_equal(tmp_path):
    whole, part = simulate(time_step=0.002), simulate(time_step=0.002)
    whole.run(until=0.3, progress=False)
    part.run(until=0.1, progress=False)
    part.save_checkpoint(tmp_path / "state.npz")
    again = libmpm.Simulation.resume(tmp_path / "state.npz")
    assert again.scene == part.scene
    assert (again.time, again.steps, again.precision) == (part.time, part.steps, "single")
    assert again.recorded_until() == 0.1
    again.run(until=0.3, progress=False)
    assert same(again, whole)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_engine_resumes_bit_equal_and_splits_freely(tmp_path, monkeypatch, scene, precision):
    """The compiled engine itself, with every kind of body, boundary and sensor."""
    monkeypatch.undo()
    whole = libmpm.Simulation(scene, device="cpu", precision=precision)
    whole.run(until=0.05, progress=False)
    split = libmpm.Simulation(
        scene, device="cpu", precision=precision,
        output=output(tmp_path, frame_interval=0.007, checkpoint_interval=0.02),
    )  # fmt: skip
    split.step(3)
    split.run(until=0.03, progress=False)
    _ = split.particles["water"]["stress"], split.grid["velocity"]
    again = libmpm.Simulation.resume(tmp_path)
    assert 0 < again.steps < split.steps
    split.run(until=0.05, progress=False)
    again.run(until=0.05, progress=False)
    assert same(split, whole)
    assert same(again, whole)


def test_two_generations_are_kept(tmp_path):
    sim = simulate(output=output(tmp_path))
    sim.run(until=0.3, progress=False)
    found = checkpoints.find_checkpoints(tmp_path / "checkpoints")
    assert [checkpoints.step_of(p) for p in found] == [300, 250]


def test_resuming_cuts_the_folder_to_the_checkpoint(tmp_path, core):
    whole = simulate(output=output(tmp_path / "whole"))
    whole.run(until=0.3, progress=False)
    folder = tmp_path / "part"
    core.Engine.leave_at = -1
    part = simulate(output=output(folder))
    part.run(until=0.23, progress=False)
    # What a kill may leave behind: unfinished files and rows past the checkpoint.
    (folder / "frames" / "water_000012.vtkhdf.part").write_bytes(b"half")
    (folder / "removed.csv").write_text("step,body,id,policy,x [m]\n7,w,1,delete,0\n222,w,2,delete")
    assert len(read_sensors(folder / "sensors.h5")["gauge"]) > 200
    again = libmpm.Simulation.resume(folder, output=output(folder))
    assert again.steps == 200
    again.step(0)
    assert len(read_sensors(folder / "sensors.h5")["gauge"]) == 200
    assert max(list_frames(folder / "frames")["water"]) == 10
    assert (folder / "removed.csv").read_text().splitlines()[1:] == ["7,w,1,delete,0"]
    assert not list(folder.rglob("*.part"))
    again.run(until=0.3, progress=False)
    assert same(again, whole)
    assert same_folders(folder, tmp_path / "whole")


def test_resuming_into_a_new_folder_keeps_all_samples(tmp_path):
    part = simulate(output=output(tmp_path / "old"))
    part.run(until=0.11, progress=False)
    again = libmpm.Simulation.resume(tmp_path / "old", output=output(tmp_path / "new"))
    again.run(until=0.2, progress=False)
    gauge = read_sensors(tmp_path / "new" / "sensors.h5")["gauge"]
    assert (gauge.time == again.sensors["gauge"].time).all()
    assert len(gauge) == 200
    assert list(list_frames(tmp_path / "new" / "frames")["water"]) == [6, 7, 8, 9, 10]


def test_another_frame_interval_in_the_same_folder_is_refused(tmp_path):
    simulate(output=output(tmp_path)).run(until=0.11, progress=False)
    again = libmpm.Simulation.resume(tmp_path, output=output(tmp_path, frame_interval=0.03))
    with pytest.raises(libmpm.OutputError, match=r"every 0\.02 s.*0\.03 s"):
        again.step()


def test_a_truncated_checkpoint_is_named_and_the_older_one_taken(tmp_path):
    simulate(output=output(tmp_path)).run(until=0.12, progress=False)
    newest = checkpoints.find_checkpoints(tmp_path / "checkpoints")[0]
    content = newest.read_bytes()
    for size in (0, 10, len(content) // 2, len(content) - 1):
        newest.write_bytes(content[:size])
        with pytest.raises(libmpm.CheckpointError, match=f"{size} bytes.*truncated or damaged"):
            libmpm.Simulation.resume(newest)
    with pytest.warns(libmpm.ModelWarning, match="older one is used"):
        assert libmpm.Simulation.resume(tmp_path).steps == 50


def test_a_flipped_byte_is_noticed(tmp_path):
    sim = simulate()
    sim.step(3)
    path = tmp_path / "state.npz"
    sim.save_checkpoint(path)
    content = bytearray(path.read_bytes())
    place = content.index(sim.engine.save()["body0.position"].tobytes()) + 100
    content[place] ^= 1
    path.write_bytes(content)
    with pytest.raises(libmpm.CheckpointError, match="damaged"):
        libmpm.Simulation.resume(path)


def test_other_files_and_versions_are_named(tmp_path, monkeypatch):
    sim = simulate()
    monkeypatch.setattr(checkpoints, "FORMAT", 99)
    sim.save_checkpoint(tmp_path / "new.npz")
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "libmpm._core", fake_engine.module())
    with pytest.raises(libmpm.CheckpointError, match="format 99, written by libmpm 0"):
        libmpm.Simulation.resume(tmp_path / "new.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    (tmp_path / "text.npz").write_text("hello")
    for name in ("other.npz", "text.npz"):
        with pytest.raises(libmpm.CheckpointError, match="is not a complete checkpoint"):
            libmpm.Simulation.resume(tmp_path / name)
    with pytest.raises(libmpm.CheckpointError, match="does not exist"):
        libmpm.Simulation.resume(tmp_path / "none.npz")
    (tmp_path / "empty").mkdir()
    with pytest.raises(libmpm.CheckpointError, match="holds no checkpoint"):
        libmpm.Simulation.resume(tmp_path / "empty")


def test_a_state_of_another_engine_is_named(tmp_path, core, monkeypatch):
    sim = simulate()
    sim.save_checkpoint(tmp_path / "state.npz")

    def refuse(self, state):
        raise ValueError("body 0 has 3 columns, expected 4")

    monkeypatch.setattr(core.Engine, "load", refuse)
    again = libmpm.Simulation.resume(tmp_path / "state.npz")
    with pytest.raises(libmpm.CheckpointError, match=r"does not fit cpu.*expected 4"):
        again.step()


def test_a_failed_checkpoint_leaves_the_old_one(tmp_path, monkeypatch):
    sim = simulate()
    path = tmp_path / "state.npz"
    sim.save_checkpoint(path)
    before = path.read_bytes()

    def fail(*arguments, **named):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", fail)
    sim.step()
    with pytest.raises(libmpm.OutputError, match="disk or quota is full"):
        sim.save_checkpoint(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]
    shutil.rmtree(tmp_path)
    with pytest.raises(libmpm.OutputError):
        sim.save_checkpoint(path)


@pytest.mark.parametrize(
    "change",
    [
        {"volumes": ["%s%n"]},
        {"volumes": []},
        {"particles": [1, 2, 3]},
        {"seen": 3},
        {"smoothing": {"water": [1.0]}},
        {"unheard": 0},
        {"speed": None},
    ],
)
def test_what_a_guard_remembers_is_checked(tmp_path, change):
    sim = simulate()
    sim.step(3)
    path = tmp_path / "state.npz"
    sim.save_checkpoint(path)
    found = checkpoints.load_checkpoint(path)
    assert found.header["watch"]["step"] >= 0
    found.header["watch"] |= change
    checkpoints.save_checkpoint(path, found)
    with pytest.raises(libmpm.CheckpointError, match=f"watch.*{next(iter(change))}"):
        libmpm.Simulation.resume(path).step(1)


@pytest.mark.parametrize("body_of", [[[0], [0]], [0.5], [-1], [2**40]])
def test_numbers_of_bodies_are_checked(tmp_path, body_of):
    sim = simulate()
    sim.step(3)
    path = tmp_path / "state.npz"
    sim.save_checkpoint(path)
    found = checkpoints.load_checkpoint(path)
    found.state["body_of"] = np.array(body_of)
    checkpoints.save_checkpoint(path, found)
    with pytest.raises(libmpm.CheckpointError, match="body_of has"):
        libmpm.Simulation.resume(path).step(1)
