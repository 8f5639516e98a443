"""The run loop: splitting, reading, interrupting, faults, removed particles, devices."""

from __future__ import annotations

import signal
import sys

import numpy as np
import pytest

import libmpm
from libmpm._src.run import backends
from python import fake_engine


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


def simulate(**changes):
    return libmpm.Simulation(fake_engine.small_scene(), device="cpu", **changes)


def state(sim):
    arrays = [sim.particles[b][n] for b in sim.particles for n in ("position", "velocity")]
    arrays += [s.values for s in sim.sensors.values()] + [s.time for s in sim.sensors.values()]
    return b"".join(a.tobytes() for a in arrays) + np.float64(sim.time).tobytes()


def test_run_stops_at_the_first_boundary_past_the_time():
    sim = simulate(time_step=0.003)
    sim.run(until=0.01, progress=False)
    assert (sim.steps, sim.time) == (4, pytest.approx(0.012))
    sim.run(until=0.01, progress=False)
    assert sim.steps == 4


def test_portions_reading_frames_and_checkpoints_change_no_bit(tmp_path):
    whole = simulate()
    whole.run(until=0.2, progress=False)
    split = simulate(
        output=libmpm.Output(tmp_path / "out", frame_interval=0.013, checkpoint_interval=0.05)
    )
    split.step(7)
    assert len(split.particles["water"]["position"]) == 216
    split.run(until=0.1, progress=False)
    split.save_checkpoint(tmp_path / "one.npz")
    _ = split.grid["velocity"]
    split.step(3)
    split.run(until=0.2, progress=False)
    assert state(split) == state(whole)


def test_nothing_is_allocated_before_first_use(core, monkeypatch):
    def refuse(*arguments):
        raise AssertionError("allocated")

    monkeypatch.setattr(core.Engine, "__init__", refuse)
    sim = simulate()
    assert sim.time == 0.0
    assert sim.plan.particles == 280
    assert "tank" in repr(sim)


def test_particles_are_sorted_by_id_and_in_world_coordinates():
    scene = fake_engine.small_scene(origin=(1e4, 0, -5), lower=(3, 0, 0), upper=(4, 1, 1))
    sim = libmpm.Simulation(scene, device="cpu")
    block = sim.particles["block"]
    ids = block["id"]
    assert ids.dtype == np.uint64
    assert (ids == np.arange(216, 280)).all()
    position = block["position"]
    assert position.dtype == np.float64
    np.testing.assert_allclose(position.min(axis=0), [1e4 + 3.625, 0.625, -4.375], rtol=1e-12)
    assert block["velocity"].shape == (64, 3)
    assert block["stress"].shape == (64, 3, 3)
    np.testing.assert_allclose(sim.grid["position"][0], [1e4 + 3.5, 0.5, -4.5])
    read = block.read(["id", "pressure"])
    np.testing.assert_allclose(read["pressure"], 1e3 * (position[:, 2] + 5))
    with pytest.raises(KeyError, match="did you mean 'velocity'"):
        block["velocty"]
    with pytest.raises(KeyError, match="no body 'watr'"):
        sim.particles["watr"]


def test_sensors_have_time_values_components_and_units():
    scene = fake_engine.small_scene(origin=(100, 200, 300))
    sim = libmpm.Simulation(scene, device="cpu")
    sim.run(until=0.1, progress=False)
    load = sim.sensors["load"]
    assert load.values.shape == (len(load.time), 3) == (10, 3)
    assert load.components == ("force_x", "force_y", "force_z")
    assert load.units == ("N", "N", "N")
    assert len(sim.sensors["gauge"]) == sim.steps
    # Levels and tracked positions are world coordinates, velocities are not shifted.
    assert sim.sensors["gauge"].values[0, 0] == pytest.approx(301, abs=0.1)
    track = sim.sensors["track"]
    assert track.values[0, :3] == pytest.approx([102, 202, 302], abs=0.2)
    assert abs(track.values[0, 3:6] - 2).max() < 0.3


def test_interrupt_stops_at_a_step_and_run_continues(core, tmp_path):
    core.Engine.delay = 2e-3
    whole, sim = simulate(), simulate(output=tmp_path / "out")
    with pytest.raises(KeyboardInterrupt):
        sim.run(until=0.4, progress=lambda state: signal.raise_signal(signal.SIGINT))
    assert 0 < sim.time < 0.4
    assert len(sim.sensors["gauge"]) == sim.steps
    assert '"interrupted"' in (tmp_path / "out" / "log.json").read_text()
    core.Engine.delay = 0.0
    sim.run(until=0.4, progress=False)
    whole.run(until=0.4, progress=False)
    assert state(sim) == state(whole)


def test_fault_names_body_particles_step_onset_and_remedy(core, tmp_path):
    core.Engine.fail_at = 9
    sim = simulate(output=tmp_path)
    with pytest.raises(libmpm.NumericalError) as caught:
        sim.run(until=1, progress=False)
    for part in ("'water'", "3, 7", "step 9", "0.009 s", "since step 4", "lower Method.cfl"):
        assert part in str(caught.value)
    assert '"failed"' in (tmp_path / "log.json").read_text()
    assert len(sim.sensors["gauge"]) == 9


def test_removed_particles_are_listed(core, tmp_path):
    core.Engine.leave_at = 5
    sim = simulate(output=tmp_path)
    gone = sim.engine.attribute(0, "id")[:2].tolist()
    with pytest.warns(libmpm.ModelWarning, match="2 particles left the domain"):
        sim.step(10)
    rows = (tmp_path / "removed.csv").read_text().splitlines()
    assert rows[0] == "step,body,id,policy,x [m],y [m],z [m]"
    assert [row.split(",")[:4] for row in rows[1:]] == [
        ["5", "water", str(i), "delete"] for i in gone
    ]
    assert len(sim.particles["water"]) == 214


def test_progress_reports_time_and_speed():
    seen = []
    simulate().run(until=0.05, progress=seen.append)
    assert seen[-1].time >= 0.05
    assert seen[-1].rate > 0


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("cuda", "is not available: .*use device='cpu'"),
        ("gpu", "expected 'auto', 'cpu', 'cuda'"),
        ("cuda:x", "expected 'auto'"),
        (["cuda:0", "cuda:1"], "is not available: .*use device='cpu'"),
        (["cpu", "cuda:0"], "several devices share a scene where all"),
        (["cuda:0", "cuda:x"], "several devices share a scene where all"),
        ([], "several devices share a scene where all"),
    ],
)
def test_missing_devices_are_named(monkeypatch, device, message):
    status = backends.CudaStatus(None, (), "built without CUDA")
    monkeypatch.setattr(backends, "cuda_status", lambda: status)
    with pytest.raises(libmpm.DeviceError, match=message):
        libmpm.Simulation(fake_engine.small_scene(), device=device)


def test_devices_found_are_listed(monkeypatch):
    found = ({"index": 0, "name": "H"},)
    monkeypatch.setattr(backends, "cuda_status", lambda: backends.CudaStatus(None, found, ""))
    with pytest.raises(libmpm.DeviceError, match="found cuda:0 H"):
        backends.select("cuda:3")
    assert backends.select("auto").name == "cuda:0"
    with pytest.raises(libmpm.DeviceError, match="'cuda:3' does not exist; found cuda:0 H"):
        backends.select(["cuda:0", "cuda:3"])
    twice = backends.select(["cuda:0", "cuda:0"])
    assert (twice.ranks, twice.indices, twice.devices) == (2, (0, 0), ["cuda:0", "cuda:0"])


def test_bad_precision_and_bad_arguments_are_named():
    with pytest.raises(libmpm.SceneError, match="mixed"):
        simulate(precision="mixed")
    with pytest.raises(libmpm.SceneError, match="pipeline"):
        simulate(pipeline="three-pass")
    with pytest.raises(ValueError, match="number of steps"):
        simulate().step(-1)
    with pytest.raises(ValueError, match="until is nan"):
        simulate().run(until=float("nan"))


@pytest.mark.parametrize(
    ("error", "status"), [(ValueError("mine"), "failed"), (SystemExit(3), "interrupted")]
)
def test_an_error_of_a_callback_is_in_the_record(core, tmp_path, error, status):
    core.Engine.delay = 2e-3
    sim = simulate(output=tmp_path / "out")

    def callback(state):
        raise error

    with pytest.raises(type(error)):
        sim.run(until=0.4, progress=callback)
    text = (tmp_path / "out" / "log.json").read_text()
    assert f'"{status}"' in text and '"finished"' not in text
    assert f"{type(error).__name__}: {error}" in text
