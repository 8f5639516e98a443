"""One CUDA device a process, over NCCL: the bits of one device, and errors that end all.

Expected duration: 90 s on two GPUs.
"""

from __future__ import annotations

import numpy as np
import pytest
from python.test_ranks_gpu import SCENES, by, plane

import libmpm
from libmpm._src.run.backends import cuda_status
from python import test_flow
from support import jobs
from support.jobs import well

pytestmark = pytest.mark.gpu

HEAD = """
import os, threading
import numpy as np
import libmpm
from libmpm import boundaries, materials, shapes
from python import test_flow
from python import test_ranks_gpu as scenes
folder = os.environ["FOLDER"]
def make(scene, device="cuda", **options):
    return libmpm.Simulation(scene, device=device, ranks="processes", **options)
def keep(sim, name):
    for body in sim.particles:
        found = sim.gather(body, "position", "velocity", "stress")
        if found is not None:
            np.savez(f"{folder}/{name} {body}.npz", **found)
"""


@pytest.fixture(autouse=True)
def on_two_devices():
    if len(cuda_status().devices) < 2:
        pytest.skip("needs two CUDA devices")


def run(code, folder, ranks=2, **environment):
    return jobs.run(ranks, jobs.script(HEAD, code), folder, **environment)


def assert_same(folder, name, one):
    """What the processes have kept is bit by bit what one device has."""
    for body in one.particles:
        found = np.load(folder / f"{name} {body}.npz")
        own = one.gather(body, "position", "velocity", "stress")
        for key in own:
            differ = np.any(np.reshape(found[key] != own[key], (len(own[key]), -1)), axis=1)
            assert not differ.any(), f"{name}: {body} {key}: {differ.sum()} of {len(differ)}"


def test_bits_of_one(tmp_path):
    """Every scene of `test_ranks_gpu.py`, after few steps and after many."""
    code = """
        for name, (build, options) in scenes.SCENES.items():
            sim = make(build(), **options)
            assert sim.ranks == 2 and sim.device == f"cuda:{sim.rank}"
            sim.step(5)
            keep(sim, f"{name} 5")
            sim.step(395)
            keep(sim, f"{name} 400")
            assert sim.statistics["migrated"] > 0 or name == "lone particles"
            assert sim.statistics["bytes_of_sums"] > 0
            if sim.rank == 0:
                values = {n: s.values for n, s in sim.sensors.items()}
                np.savez(f"{folder}/{name} series.npz", **values)
            del sim
    """
    well(run(code, tmp_path))
    for name, (build, options) in SCENES.items():
        one = libmpm.Simulation(build(), device="cuda:0", **options)
        one.step(5)
        assert_same(tmp_path, f"{name} 5", one)
        one.step(395)
        assert_same(tmp_path, f"{name} 400", one)
        series = np.load(tmp_path / f"{name} series.npz")
        for sensor in one.sensors:
            a, b = one.sensors[sensor].values, series[sensor]
            size = np.nanmax(np.abs(a), initial=0)
            assert np.allclose(a, b, rtol=0, atol=1e-10 * size, equal_nan=True), (name, sensor)


def test_new_cuts_and_inlets(tmp_path):
    """A collapse from a corner that is dealt anew, and water that comes in layer by layer."""
    code = """
        for transfer in ("APIC", "AFLIP"):
            plane = scenes.plane(**scenes.by(transfer))
            sim = make(plane, guard=None)  # fast water that a guard may see or not
            for _ in range(4):
                sim.step(500)
            assert sim.statistics["rebalances"] > 0
            keep(sim, transfer)
            del sim
        sim = make(test_flow.channel(3, speed=1.5, draws=1.5))
        sim.run(until=0.3, progress=False)
        keep(sim, "channel")
    """
    well(run(code, tmp_path))
    for transfer in ("APIC", "AFLIP"):
        one = libmpm.Simulation(plane(**by(transfer)), device="cuda:0", guard=None)
        for _ in range(4):
            one.step(500)
        assert_same(tmp_path, transfer, one)
    one = libmpm.Simulation(test_flow.channel(3, speed=1.5, draws=1.5), device="cuda:0")
    one.run(until=0.3, progress=False)
    assert one.inflow["inlet"].values[-1][0] > 0
    assert one.outflow["outlet"].values[-1][0] > 0
    assert_same(tmp_path, "channel", one)


def test_checkpoints_and_frames(tmp_path):
    """A run that processes began goes on in them, on one device, and as threads on two."""
    code = """
        sim = make(scenes.slosh("default"),
                   output=libmpm.Output(folder + "/run", frame_interval=0.02))
        sim.step(100)
        sim.save_checkpoint(folder + "/two.npz")
        keep(sim, "before")
        sim.run(until=0.05, progress=False)
        again = libmpm.Simulation.resume(folder + "/two.npz", ranks="processes")
        assert again.device == f"cuda:{again.rank}"
        again.step(100)
        keep(again, "after")
    """
    well(run(code, tmp_path))
    one = libmpm.Simulation(SCENES["F-bar"][0](), device="cuda:0")
    one.step(100)
    assert_same(tmp_path, "before", one)
    one.step(100)
    assert_same(tmp_path, "after", one)
    for device, ranks in (("cuda:0", 1), (None, 2)):
        sim = libmpm.Simulation.resume(tmp_path / "two.npz", device=device)
        assert sim.ranks == ranks
        sim.step(100)
        assert_same(tmp_path, "after", sim)
    assert len(list((tmp_path / "run" / "frames").glob("water_*.vtkhdf"))) >= 2


def test_one_that_fails_ends_all(tmp_path):
    """An error of one, in Python and in the engine, and one that is gone: none hangs."""
    code = """
        sim = make(scenes.slosh())
        sim.step(50)
        if sim.rank == 1:
            real = sim._shared.agreed
            def broken(word):
                if sim.steps > 200:
                    raise RuntimeError("no such luck")
                return real(word)
            sim._shared.agreed = broken
        sim.run(until=100.0, progress=False)
    """
    told = run(code, tmp_path)
    assert all(code != 0 for code, _, _ in told)
    assert "rank 1: RuntimeError: no such luck" in told[0][2]
    code = """
        scene = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(3.2, 3.2),
                             gravity=(0, 0))
        for name, x, speed in (("left", 8, (0.0, 0.0)), ("right", 48, (4.0, 0.0))):
            scene.add_body(name=name, shape=scenes.box((x, 24), (x + 12, 36)), velocity=speed,
                           material=materials.FixedCorotated(density=1e3, youngs_modulus=1e5))
        make(scene).run(until=2.0, progress=False)
    """
    told = run(code, tmp_path)
    assert all(code != 0 and "left" in error for code, _, error in told)
    code = """
        sim = make(scenes.slosh())
        sim.step(50)
        if sim.rank == 1:  # most likely while the other's device waits for it
            threading.Timer(0.7, os._exit, (9,)).start()
        sim.run(until=100.0, progress=False)
    """
    told = run(code, tmp_path)
    assert [code for code, _, _ in told] == [1, 9]
    assert "rank 1 has ended" in told[0][2]


def test_what_cannot_be_is_named(tmp_path):
    """No NCCL, one device for two, one that is not there, a sensor that runs in Python."""
    told = run("make(scenes.slosh()).step(1)", tmp_path, LIBMPM_NCCL="/nowhere/libnccl.so.2")
    for code, _, error in told:
        assert code == 1
        assert "'/nowhere/libnccl.so.2'" in error
        assert "pip" in error
    told = run("make(scenes.slosh(), device='cuda:0').step(1)", tmp_path)
    assert all(code == 1 and "same CUDA device" in error for code, _, error in told)
    told = run("make(scenes.slosh(), device='cuda:77')", tmp_path)
    assert all(code == 1 and "'cuda:77' does not exist" in error for code, _, error in told)
