"""Frames: read back with VTK, schedule, chosen attributes, failures to write."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm._src.base.schedule import due_index, due_time
from libmpm._src.output import frames
from libmpm._src.output.atomic_files import TEMPORARY, file_name
from python import fake_engine


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


def read_with_vtk(path):
    """Return points and point data as VTK's own reader sees them."""
    reader = pytest.importorskip("vtkmodules.vtkIOHDF").vtkHDFReader()
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    points = data.GetPointData()
    arrays = {
        points.GetArrayName(i): support.vtk_to_numpy(points.GetArray(i))
        for i in range(points.GetNumberOfArrays())
    }
    position = np.empty((0, 3))
    if data.GetNumberOfPoints():
        position = support.vtk_to_numpy(data.GetPoints().GetData())
    return position, arrays, data


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [0, 1, 57])
def test_vtk_reads_back_the_same_bits(tmp_path, dimension, count):
    rng = np.random.default_rng(1)
    position = 1e5 + rng.random((count, dimension))
    attributes = {
        "velocity": rng.random((count, dimension)),
        "pressure": rng.random(count),
        "stress": rng.random((count, dimension, dimension)),
        "id": np.arange(count, dtype=np.uint64) + np.uint64(2**40),
    }
    path = tmp_path / "water_000003.vtkhdf"
    frames.write_frame(path, position, attributes, {"time": 0.25, "step": 7, "body": "water"})
    points, arrays, data = read_with_vtk(path)
    assert points.shape == (count, 3)
    assert (points[:, :dimension] == position).all()
    assert (points[:, dimension:] == 0).all()
    assert data.GetNumberOfCells() == count
    if count:
        assert (arrays["velocity"][:, :dimension] == attributes["velocity"]).all()
        assert (arrays["pressure"] == attributes["pressure"]).all()
        assert (arrays["stress"] == attributes["stress"].reshape(count, -1)).all()
        assert (arrays["id"] == attributes["id"]).all()
    own, about = frames.read_frame(path)
    assert (own["position"] == points).all()
    assert (about["time"], about["step"], about["body"]) == (0.25, 7, "water")


def test_frames_come_at_the_first_boundary_past_each_interval(tmp_path):
    output = libmpm.Output(tmp_path, frame_interval=0.025, attributes={"water": ["speed", "id"]})
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output, time_step=0.01)
    sim.run(until=0.1, progress=False)
    found = frames.list_frames(tmp_path / "frames")
    assert list(found) == ["water"]
    times = {k: frames.frame_time(path) for k, path in found["water"].items()}
    assert times == pytest.approx({0: 0.0, 1: 0.03, 2: 0.05, 3: 0.08, 4: 0.1})
    assert frames.read_series(tmp_path / "frames", "water") == times
    arrays, about = frames.read_frame(found["water"][4])
    assert set(arrays) == {"position", "speed", "id"}
    assert arrays["speed"].dtype == np.float32
    assert arrays["position"].dtype == np.float64
    assert (arrays["position"] == sim.particles["water"]["position"]).all()
    assert about["version"] == sim.version


def test_an_interval_below_the_step_gives_one_frame_a_step(tmp_path):
    output = libmpm.Output(tmp_path, frame_interval=0.003)
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output, time_step=0.01)
    sim.step(3)
    assert list(frames.list_frames(tmp_path / "frames")["block"]) == [0, 3, 6, 10]


def test_due_index_agrees_with_the_times_that_it_schedules():
    for interval in (0.1, 0.01, 1 / 3, 1e-3):
        for k in range(1, 2000, 7):
            due = due_time(k, interval)
            assert due_index(due, interval) == k
            assert due_index(np.nextafter(due, 0), interval) == k - 1
    assert due_index(0.3, 0.1) == 3


def test_unknown_names_and_bodies_are_refused_before_the_run(tmp_path):
    scene = fake_engine.small_scene()
    output = libmpm.Output(
        tmp_path / "a", frame_interval=1, attributes={"water": ["preasure"], "wood": ["id"]}
    )
    with pytest.raises(libmpm.SceneError) as caught:
        libmpm.Simulation(scene, device="cpu", output=output).step()
    assert len(caught.value.problems) == 2
    assert not (tmp_path / "a").exists()
    with pytest.raises(libmpm.SceneError, match="frame_interval is 0"):
        libmpm.Output(tmp_path, frame_interval=0)


def test_earlier_results_are_kept_unless_told(tmp_path):
    scene = fake_engine.small_scene()
    output = libmpm.Output(tmp_path, frame_interval=0.001)
    libmpm.Simulation(scene, device="cpu", output=output).step(5)
    with pytest.raises(libmpm.OutputError, match="holds the results of an earlier run"):
        libmpm.Simulation(scene, device="cpu", output=output).step(1)
    again = libmpm.Output(tmp_path, frame_interval=0.001, overwrite=True)
    libmpm.Simulation(scene, device="cpu", output=again).step(2)
    assert list(frames.list_frames(tmp_path / "frames")["water"]) == [0, 1, 2]


def test_names_unfit_for_files_stay_apart(tmp_path):
    assert file_name("water") == "water"
    assert len({file_name(n) for n in ("a/b", "a_b", "..", "ä", "a%2Fb")}) == 5
    path = frames.frame_path(tmp_path, "a/b", 2)
    frames.write_frame(path, np.zeros((1, 3)), {}, {"time": 0.0, "step": 0})
    assert frames.list_frames(tmp_path) == {"a/b": {2: path}}
    frames.write_series(tmp_path, "a/b", {2: 0.5})
    listed = json.loads((tmp_path / "a%2Fb.vtkhdf.series").read_text())
    assert listed["files"] == [{"name": path.name, "time": 0.5}]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_named(tmp_path):
    tmp_path.chmod(0o500)
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=tmp_path / "out")
    with pytest.raises(libmpm.OutputError, match="choose a folder that you may write to"):
        sim.step()


def test_a_file_in_the_way_is_named(tmp_path):
    (tmp_path / "out").write_text("")
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=tmp_path / "out")
    with pytest.raises(libmpm.OutputError, match=r"out.*file stands where a folder is needed"):
        sim.step()


FULL = """
import resource, sys
from python import fake_engine
fake_engine.install()
import libmpm
output = libmpm.Output(sys.argv[1], frame_interval=1e-3)
sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output)
sim.step(5)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
try:
    sim.step(5)
except libmpm.OutputError as error:
    print(error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
sim.step(10 - sim.steps)
sim.close()
print("went on", sim.steps)
"""


def test_a_full_disk_is_an_error_that_the_run_survives(tmp_path):
    """A file size limit fails writes half-way, as a full disk does."""
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert f"cannot write {tmp_path}" in done.stdout
    assert "size limit" in done.stdout
    assert "went on 10" in done.stdout
    found = frames.list_frames(tmp_path / "frames")["water"]
    assert list(found) == list(range(11))
    assert not list(Path(tmp_path).rglob("*.part"))


def test_resume_removes_parts_that_come_later(tmp_path):
    """Of ranks as processes, also where the folder holds no checkpoint."""
    output = libmpm.Output(tmp_path / "run", frame_interval=0.05)
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output)
    sim.run(until=0.1, progress=False)
    sim.save_checkpoint(tmp_path / "state.npz")
    sim.close()
    parts = tmp_path / "run" / "frames" / "parts"
    parts.mkdir()
    last = due_index(sim.time, 0.05)
    kept = parts / f"water_{last:06d}.0001.vtkhdf"
    gone = [parts / f"water_{last + 1:06d}.0001.vtkhdf", parts / f"water{TEMPORARY}"]
    for path in (kept, *gone):
        path.touch()
    again = libmpm.Simulation.resume(tmp_path / "state.npz", device="cpu", output=output)
    again.run(until=again.time, progress=False)
    assert list(parts.iterdir()) == [kept]
