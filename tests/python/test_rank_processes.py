"""One rank a process: the bits of one, files as of one, errors and interrupts that end all.

Expected duration: 20 s.
"""

from __future__ import annotations

import json
import signal
import time

import numpy as np
import pytest

import libmpm
from libmpm._src.output import frames
from libmpm._src.run import backends
from python import fake_engine
from support import jobs
from support.between_ranks import between_ranks
from support.jobs import well

HEAD = """
import os, sys, warnings
import numpy as np
import libmpm
from libmpm import sensors
from python import fake_engine
folder = os.environ["FOLDER"]
def make(**more):
    return libmpm.Simulation(
        fake_engine.small_scene(), device="cpu", ranks="processes", threads=1, **more)
"""


def start(ranks, code, folder, **environment):
    return jobs.start(ranks, jobs.script(HEAD, code), folder, **environment)


def run(ranks, code, folder, **environment):
    return jobs.run(ranks, jobs.script(HEAD, code), folder, **environment)


@pytest.fixture
def one(tmp_path):
    output = libmpm.Output(tmp_path / "one", frame_interval=0.05, checkpoint_interval=0.05)
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", threads=1, output=output)
    sim.run(until=0.1, progress=False)
    return sim


def test_bits_and_files_of_one(one, tmp_path):
    """Particles, series, frames and the checkpoint are those of one process."""
    code = """
        sim = make(output=libmpm.Output(
            folder, frame_interval=0.05, checkpoint_interval=0.05))
        sim.run(until=0.1)
        assert sim.ranks == 2 and sim.rank == int(os.environ["RANK"])
        total = sim.totals()
        for i, body in enumerate(sim.particles):
            all_of = sim.gather(body, "position", "velocity", "stress")
            assert (all_of is None) == (sim.rank > 0)
            assert len(sim.particles[body]) <= total[i]
            if all_of is not None:
                assert len(all_of["id"]) == total[i]
                np.savez(f"{folder}/{body}.npz", **all_of)
        if sim.rank == 0:
            np.savez(f"{folder}/series.npz", **{n: s.values for n, s in sim.sensors.items()})
    """
    folder = tmp_path / "many"
    folder.mkdir()
    well(run(2, code, folder))
    for body in one.particles:
        found, own = (
            np.load(folder / f"{body}.npz"),
            one.gather(body, "position", "velocity", "stress"),
        )
        for name in own:
            assert (found[name] == own[name]).all(), (body, name)
    series = np.load(folder / "series.npz")
    for name in one.sensors:
        x, y = series[name], one.sensors[name].values
        apart = between_ranks(one.sensors[name])
        assert np.allclose(x, y, rtol=0, atol=apart, equal_nan=True), name
    listed = [frames.list_frames(f / "frames") for f in (tmp_path / "one", folder)]
    assert listed[0].keys() == listed[1].keys()
    for body, numbered in listed[0].items():
        assert numbered.keys() == listed[1][body].keys()
        for index, path in numbered.items():
            x, about = frames.read_frame(path)
            y, told = frames.read_frame(listed[1][body][index])
            assert (about["time"], about["step"]) == (told["time"], told["step"])
            for name in x:
                # Without ids, points are told apart by where they are.
                rows = [np.lexsort(a["position"].T) for a in (x, y)]
                assert (x[name][rows[0]] == y[name][rows[1]]).all(), (body, index, name)
            parts = list((folder / "frames" / "parts").glob(f"{body}_{index:06d}.*"))
            assert len(parts) == 2
    logs = [json.loads((f / "log.json").read_text()) for f in (tmp_path / "one", folder)]
    for key in ("status", "steps", "particles"):
        assert logs[0][key] == logs[1][key]
    # The checkpoint goes on in one process, and in three, with the same bits.
    again = libmpm.Simulation.resume(folder, device="cpu")
    again.run(until=0.15, progress=False)
    one.run(until=0.15, progress=False)
    for body in one.particles:
        x, y = (s.gather(body, "position", "stress") for s in (one, again))
        assert all((x[name] == y[name]).all() for name in x)
    code = """
        sim = libmpm.Simulation.resume(folder, device="cpu", ranks="processes")
        sim.run(until=0.15)
        for body in sim.particles:
            found = sim.gather(body, "position", "stress")
            if found is not None:
                np.savez(f"{folder}/{body}.npz", **found)
    """
    well(run(3, code, folder))
    for body in one.particles:
        found, own = np.load(folder / f"{body}.npz"), one.gather(body, "position", "stress")
        assert all((found[name] == own[name]).all() for name in own)


def test_frames_open_in_vtk(one, tmp_path):
    """A frame of parts is one to VTK, from wherever it is opened."""
    pyvista = pytest.importorskip("pyvista")
    folder = tmp_path / "many"
    well(run(2, "make(output=libmpm.Output(folder, frame_interval=0.05)).run(until=0.06)", folder))
    for path in sorted((folder / "frames").glob("*_000001.vtkhdf")):
        mesh = pyvista.read(path)
        like = pyvista.read(tmp_path / "one" / "frames" / path.name)
        assert mesh.n_points == like.n_points > 0
        assert np.allclose(mesh.bounds, like.bounds, rtol=0, atol=0)
        assert set(mesh.point_data) == set(like.point_data)
    # Without its parts it is none: HDF5 alone would read zeros.
    for part in (folder / "frames" / "parts").glob(f"{path.stem}.*"):
        part.unlink()
    with pytest.raises(libmpm.OutputError, match="parts are missing"):
        frames.read_frame(path)


def test_only_who_asks(tmp_path):
    """What a launcher has set changes nothing for who does not ask for ranks."""
    code = """
        sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", threads=1)
        sim.step(2)
        assert sim.ranks == 1 and sim.rank == 0
        print(sum(sim.totals()))
    """
    told = well(run(1, code, tmp_path, RANK="3", WORLD_SIZE="8"))
    assert int(told[0][1]) > 0
    alone = libmpm.Simulation(fake_engine.small_scene(), device="cpu")
    with pytest.raises(libmpm.SceneError, match="expected 'processes'"):
        libmpm.Simulation(fake_engine.small_scene(), ranks="threads")
    with pytest.raises(libmpm.DeviceError, match="each has one device"):
        libmpm.Simulation(fake_engine.small_scene(), device=["cpu", "cpu"], ranks="processes")
    assert alone.ranks == 1


def test_each_has_its_device(monkeypatch):
    """By the launcher's number on this host, or the only device that a process sees."""

    class Job:
        """Rank 3 of four, the second on its host."""

        ranks, local_rank, others = 4, 1, ["", "cuda", 0]

        def tell(self, value):
            return [self.others, self.others, self.others, value]

    job = Job()
    monkeypatch.setattr(backends.Link, "of_job", classmethod(lambda cls, module: job))

    def see(count):
        found = tuple({"index": i, "name": "H"} for i in range(count))
        monkeypatch.setattr(backends, "cuda_status", lambda: backends.CudaStatus(None, found, ""))

    see(4)
    mine = backends.select_process("cuda")
    assert (mine.name, mine.index, mine.ranks, mine.link) == ("cuda:1", 1, 4, job)
    assert mine.devices == ["cuda:0", "cuda:0", "cuda:0", "cuda:1"]
    assert backends.select_process("cuda:2").index == 2
    see(1)
    assert backends.select_process("cuda").index == 0
    with pytest.raises(libmpm.DeviceError, match="rank 3: device 'cuda:1' does not exist"):
        backends.select_process("cuda:1")
    with pytest.raises(libmpm.DeviceError, match="rank 3 is on 'cpu' and rank 0 on 'cuda'"):
        backends.select_process("auto")
    job.others = ["no device today", None, None]
    with pytest.raises(libmpm.DeviceError, match="rank 0: no device today"):
        backends.select_process("cuda")


def test_one_that_fails_ends_all(tmp_path):
    """An error in Python on one rank reaches the others by name, and none hangs."""
    code = """
        sim = make()
        if sim.rank == 1:
            real = sim._shared.agreed
            def broken(word):
                if sim.steps > 20:
                    raise RuntimeError("no such luck")
                return real(word)
            sim._shared.agreed = broken
        sim.run(until=100.0)
    """
    told = run(2, code, tmp_path)
    assert all(code != 0 for code, _, _ in told)
    assert "rank 1: RuntimeError: no such luck" in told[0][2]
    assert "no such luck" in told[1][2]


def test_transfers_that_store_velocities(tmp_path):
    """AFLIP has the bits of one process."""
    code = """
        scene = fake_engine.small_scene(
            method=libmpm.Method(transfer=libmpm.methods.Transfer(scheme="AFLIP", flip=0.97)))
        sim = libmpm.Simulation(scene, device="cpu", ranks="processes", threads=1)
        sim.run(until=0.1)
        for body in sim.particles:
            found = sim.gather(body, "position", "velocity", "stress")
            if found is not None:
                np.savez(f"{folder}/{body}.npz", **found)
    """
    well(run(2, code, tmp_path))
    transfer = libmpm.methods.Transfer(scheme="AFLIP", flip=0.97)
    scene = fake_engine.small_scene(method=libmpm.Method(transfer=transfer))
    one = libmpm.Simulation(scene, device="cpu", threads=1)
    one.run(until=0.1)
    for body in one.particles:
        found = np.load(tmp_path / f"{body}.npz")
        own = one.gather(body, "position", "velocity", "stress")
        for name in own:
            assert (found[name] == own[name]).all(), (body, name)


@pytest.mark.parametrize("scheme", ["XPIC", "FMPM"])
def test_transfers_that_sweep_the_grid(scheme, tmp_path):
    """Whoever reads does so alone: before the first step, after others, of a resumed run."""
    code = f"""
        scene = fake_engine.small_scene(
            method=libmpm.Method(transfer=libmpm.methods.Transfer(scheme="{scheme}", order=3)))
        sim = libmpm.Simulation(scene, device="cpu", ranks="processes", threads=1)
        def read(sim):
            alone = sim.particles["water"]["velocity"] if sim.rank == 1 else None
            return sim.gather("water", "position", "velocity")
        first = read(sim)
        sim.run(until=0.05)
        sim.save_checkpoint(folder + "/half.npz")
        sim = libmpm.Simulation.resume(folder + "/half.npz", ranks="processes")
        half = read(sim)
        sim.run(until=0.1, wall_limit=0)
        assert sim.stopped == "wall limit"
        read(sim)
        sim.run(until=0.1)
        last = read(sim)
        assert sim.statistics["bytes_of_sums"] > 0
        if sim.rank == 0:
            for name, found in {{"first": first, "half": half, "last": last}}.items():
                np.savez(f"{{folder}}/{{name}}.npz", **found)
    """
    well(run(2, code, tmp_path))
    transfer = libmpm.methods.Transfer(scheme=scheme, order=3)
    scene = fake_engine.small_scene(method=libmpm.Method(transfer=transfer))
    one = libmpm.Simulation(scene, device="cpu", threads=1)
    for name, until in ("first", 0.0), ("half", 0.05), ("last", 0.1):
        if until > 0:
            one.run(until=until)
        own, found = one.gather("water", "position", "velocity"), np.load(tmp_path / f"{name}.npz")
        for attribute in own:
            assert (found[attribute] == own[attribute]).all(), (name, attribute)


def test_smoothing_over_cells(tmp_path):
    code = """
        sim = libmpm.Simulation(
            fake_engine.smoothed_scene("F0AL1"), device="cpu", ranks="processes", threads=1)
        sim.run(until=0.15)
        assert sim.particle_count(0) > 0, "water lies on all ranks"
        found = sim.gather("water", "position", "velocity", "stress")
        if found is not None:
            np.savez(f"{folder}/water.npz", **found)
        print(sim.smoothing["water"]["energy_change"].sum())
    """
    told = {out for _, out, _ in well(run(2, code, tmp_path))}
    assert len(told) == 1
    one = libmpm.Simulation(fake_engine.smoothed_scene("F0AL1"), device="cpu", threads=1)
    one.run(until=0.15)
    own = one.gather("water", "position", "velocity", "stress")
    found = np.load(tmp_path / "water.npz")
    for name in own:
        assert (found[name] == own[name]).all(), name
    change = one.smoothing["water"]["energy_change"].sum()
    assert float(told.pop()) == pytest.approx(change, rel=1e-6)


def test_what_all_refuse_ends_nothing(tmp_path):
    """A fault, and what one rank has no room for, is raised on all; a study goes on after it."""
    code = """
        from libmpm import materials, shapes
        scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1), gravity=(0, 0))
        for name, x, speed in ("stays", 0.2, 0.0), ("leaves", 1.6, 1.0):
            scene.add_body(
                name=name, shape=shapes.Box(lower=(x, 0.3), upper=(x + 0.2, 0.6)),
                material=materials.TaitFluid(bulk_modulus=1e4), velocity=(speed, 0.0))
        def refused(kind, sim):
            try:
                sim.run(until=2.0)
            except kind as error:
                return str(error)
        print(refused(libmpm.NumericalError, libmpm.Simulation(
            scene, device="cpu", ranks="processes", threads=1)))
        small = make()
        if small.rank == 1:
            def broken():
                raise libmpm.CapacityError("no room")
            small._assembly._require_memory = broken
        print(refused(libmpm.CapacityError, small))
        again = make()
        again.run(until=0.02)
        print(again.steps)
    """
    told = [text.splitlines() for _, text, _ in well(run(2, code, tmp_path))]
    assert told[0][0] == told[1][0]
    assert "left the domain" in told[0][0]
    assert [lines[1] for lines in told] == ["rank 1: no room", "no room"]
    assert told[0][2] == told[1][2] != "0"


def test_guard_speaks_for_all(tmp_path):
    """What a guard finds is found by all ranks, in the words of one process."""
    code = """
        guard = libmpm.Guard(mach=0.01, every=10)
        more = {} if "ALONE" in os.environ else {"ranks": "processes"}
        sim = libmpm.Simulation(
            fake_engine.small_scene(), device="cpu", threads=1, guard=guard, **more)
        try:
            sim.run(until=1.0)
        except libmpm.NumericalError as error:
            print(error)
    """
    alone = well(run(1, code, tmp_path, ALONE="1"))[0][1]
    assert "relative to the body's mean" in alone
    assert [text for _, text, _ in well(run(2, code, tmp_path))] == [alone, alone]


def test_a_failed_save_ends_all(tmp_path):
    """Rank 0 writes for all, and the others wait for it."""
    (tmp_path / "file").touch()
    code = """
        sim = make()
        sim.step(1)
        sim.save_checkpoint(f"{folder}/file/state.npz")
    """
    told = run(2, code, tmp_path)
    assert [code for code, _, _ in told] == [1, 1]
    assert "rank 0: OutputError" in told[1][2]


def test_interrupt_reaches_who_waits(tmp_path):
    """Ctrl-C ends a wait for a rank that does something else."""
    code = """
        import time
        sim = make()
        link = sim._shared.link
        print("ready", flush=True)
        if sim.rank == 1:
            time.sleep(2.0)
        link.tell(1)  # what rank 0 had to say is here already
        link.tell(2)
    """
    made = start(2, code, tmp_path)
    for process in made:
        assert process.stdout.readline() == "ready\n"
    time.sleep(0.3)
    began = time.monotonic()
    made[0].send_signal(signal.SIGINT)
    told = [process.communicate(timeout=60)[1] for process in made]
    assert time.monotonic() - began < 10
    assert "KeyboardInterrupt" in told[0]
    assert "rank 0 was interrupted while it waited" in told[1]


def test_one_that_dies_ends_all(tmp_path):
    """A rank that is gone is named."""
    code = """
        sim = make()
        sim.step(5)
        if sim.rank == 1:
            os._exit(9)
        sim.run(until=100.0)
    """
    told = run(2, code, tmp_path)
    assert [code for code, _, _ in told] == [1, 9]
    assert "rank 1 has ended" in told[0][2]


def test_interrupt_of_one_stops_all(tmp_path):
    """Ctrl-C on one rank stops all at the same step."""
    code = """
        sim = make()
        sim.step(1)
        print("ready", flush=True)
        try:
            sim.run(until=1e6)
        except KeyboardInterrupt:
            print(sim.steps)
    """
    made = start(2, code, tmp_path)
    for process in made:
        assert process.stdout.readline() == "ready\n"
    time.sleep(0.5)
    made[1].send_signal(signal.SIGINT)
    steps = [process.communicate(timeout=60)[0] for process in made]
    assert steps[0] == steps[1] != ""


def test_who_does_not_come_is_named(tmp_path):
    """Rank 0 says who is missing and what it has read."""
    told = run(1, "make()", tmp_path, WORLD_SIZE="2", LIBMPM_MEETING_SECONDS="0.5")
    assert told[0][0] == 1
    assert "rank 1" in told[0][2]
    assert "WORLD_SIZE=2" in told[0][2]
