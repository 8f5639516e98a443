"""What attacks have found: damaged files, forged states and odd arguments end by name."""

from __future__ import annotations

import json
import time

import h5py
import numpy as np
import pytest
from attack import forged

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.cli.info import about, text_of
from libmpm._src.output.checkpoint import find_checkpoints, load_checkpoint, save_checkpoint
from libmpm._src.output.export import export
from libmpm._src.output.frames import write_frame
from libmpm._src.output.hdf5_image import LIBVER, attributes_of, new_file, new_group
from libmpm._src.output.results import Frame
from libmpm._src.output.sensor_file import SensorFile, read_sensors
from libmpm._src.output.series import Series
from libmpm.compat import claymore
from support import fuzz_readers, fuzzing


def tank() -> libmpm.Scene:
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81))
    water = materials.TaitFluid(bulk_modulus=1e5)
    scene.add_body(name="w", shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.4)), material=water)
    scene.add_body(
        name="bar", shape=shapes.Box(lower=(0.6, 0.1), upper=(0.9, 0.4)),
        material=materials.FixedCorotated(density=800.0, youngs_modulus=1e5),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    return scene


@pytest.fixture
def saved(tmp_path):
    sim = libmpm.Simulation(tank(), device="cpu", threads=1, precision="double")
    sim.step(3)
    path = tmp_path / "saved.npz"
    sim.save_checkpoint(path)
    return path


@pytest.mark.parametrize(("entry", "value"), [("body0_state0", 1e300), ("body0_state0", 101.0),
                                              ("body1_state3", 1e300)])  # fmt: skip
def test_a_state_without_a_finite_pressure_is_refused(saved, entry, value):
    found = load_checkpoint(saved)
    found.state[entry] = np.array(found.state[entry])
    found.state[entry][2] = value
    save_checkpoint(saved, found)
    with pytest.raises(libmpm.CheckpointError, match=r"place 2.*state of"):
        np.asarray(libmpm.Simulation.resume(saved, device="cpu").particles["w"]["pressure"])


@pytest.mark.parametrize("offset", [-1.0, 0.6, 1.74])
def test_offsets_that_the_way_since_the_last_sort_does_not_explain_are_refused(saved, offset):
    """They put particles beyond the walls, where the run found them 39 steps later."""
    found = load_checkpoint(saved)
    found.state["body0_offset1"] = np.array(found.state["body0_offset1"])
    found.state["body0_offset1"][7] = offset
    save_checkpoint(saved, found)
    message = rf"offset1' has {offset:g} at place 7; expected at most 0\.51\d+ cells"
    with pytest.raises(libmpm.CheckpointError, match=message):
        libmpm.Simulation.resume(saved, device="cpu").step(1)


def test_particles_beyond_an_open_face_resume_as_they_were(tmp_path):
    """Between two sorts particles may lie outside; a checkpoint of that moment is a good one."""
    scene = libmpm.Scene(dimension=2, lower=(0, 0), upper=(1, 1), cell_size=0.1)
    scene.add_body(
        name="w", shape=shapes.Box(lower=(0.5, 0.3), upper=(0.9, 0.7)), fbar=None,
        material=materials.TaitFluid(bulk_modulus=1e5), velocity=(1.0, 0.0),
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", threads=1, precision="double")
    while np.asarray(sim.particles["w"]["position"])[:, 0].max() <= 1.0:
        sim.step(1)
    path = tmp_path / "outside.npz"
    sim.save_checkpoint(path)
    again = libmpm.Simulation.resume(path, device="cpu")
    assert again.steps == sim.steps
    ends = []
    for run in (sim, again):
        with pytest.raises(libmpm.NumericalError, match="left the domain") as caught:
            run.step(20)
        ends.append(str(caught.value))
    assert ends[0] == ends[1]


@pytest.mark.parametrize("time", [-np.inf, np.nan, 1e9, -1.0])
def test_samples_of_no_time_of_the_run_are_refused(saved, time):
    found = load_checkpoint(saved)
    times, *rest = found.sensors[0]
    times = np.array(times)
    times[-1] = time
    found.sensors[0] = (times, *rest)
    save_checkpoint(saved, found)
    with pytest.raises(libmpm.CheckpointError, match="sensor 0 has times"):
        np.asarray(libmpm.Simulation.resume(saved, device="cpu").particles["w"]["pressure"])


def test_threads_that_the_system_does_not_start_are_refused(monkeypatch):
    def refused(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("threading.Thread.start", refused)
    with pytest.raises(libmpm.DeviceError, match="0 of 1000 threads"):
        libmpm.Simulation(tank(), device="cpu", threads=1000).step(1)


def test_two_checkpoints_are_left_wherever_a_run_was_killed(tmp_path):
    """A run that is killed between a checkpoint and the removal of an older one leaves three."""
    settings = {"checkpoint_interval": 0.01, "frame_interval": None}
    folder = tmp_path / "run"
    with libmpm.Simulation(
        tank(), device="cpu", threads=1, output=libmpm.Output(folder, **settings)
    ) as sim:
        sim.run(until=0.05, progress=False)
    newest, older = find_checkpoints(folder / "checkpoints")
    extra = older.with_name("step_0000000001.npz")
    extra.write_bytes(older.read_bytes())
    with libmpm.Simulation.resume(folder, output=libmpm.Output(folder, **settings)) as sim:
        sim.run(until=0.05, progress=False)
    assert find_checkpoints(folder / "checkpoints") == [newest, older]


# Files of results -----------------------------------------------------------------------------


def make_files(folder):
    series = Series("load é", ("a", "b"), ("N", "N m"), {"kind": "load-cell", "interval": 0.1})
    series.append(np.arange(3.0), np.ones((3, 2)))
    SensorFile(folder / "s.h5", [series]).close()
    point = np.random.default_rng(1).random((50, 2))
    about = {"time": 0.1, "step": 3, "body": "w é", "index": 1, "version": "1"}
    write_frame(folder / "w_000001.vtkhdf", point, {"velocity": point}, about)
    return folder / "s.h5", folder / "w_000001.vtkhdf"


def test_checksums_guard_what_hdf5_follows(tmp_path):
    """No table of links, no head without a checksum, and no heap of texts, which never has one."""
    for path in make_files(tmp_path):
        raw = path.read_bytes()
        assert raw[8] == 2, "head of a file without a checksum"
        assert b"OHDR" in raw
        assert not any(mark in raw for mark in (b"GCOL", b"SNOD", b"HEAP"))


def test_damage_anywhere_in_a_file_of_results_ends_by_name(tmp_path):
    samples, frame = make_files(tmp_path)
    assert list(read_sensors(samples)) == ["load é"]
    assert Frame(frame, 2).metadata["body"] == "w é"
    rng = np.random.default_rng(5)
    refused = 0
    for path, read in ((samples, read_sensors), (frame, lambda p: dict(Frame(p, 2)))):
        whole = path.read_bytes()
        for _ in range(150):
            raw = bytearray(whole)
            # The heads lie first, most of the rest is data.
            for at in rng.integers(0, min(len(raw), 8000), 4):
                raw[at] ^= 1 << int(rng.integers(8))
            path.write_bytes(raw)
            refused += isinstance(fuzzing.answer(lambda r=read, p=path: r(p)), libmpm.Error)
    assert refused > 100


def test_files_open_for_writing_and_have_no_times_of_creation(tmp_path):
    """With every h5py: HDF5 before 2 wrote heads with a wrong checksum, and the time of day.

    `tools/check_dependencies.py floor` runs this with the oldest one.
    """
    for name in ("one", "two"):
        with new_file(tmp_path / name) as file:
            group = new_group(new_group(file, "über"), "inner")
            group.create_dataset("data", data=np.arange(3.0), maxshape=(None,), chunks=(8,))
        with h5py.File(tmp_path / name, "r+", libver=LIBVER, locking=False) as file:
            assert file["über/inner/data"][2] == 2
        if name == "one":
            time.sleep(1.1)  # a unit of those times
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_texts_of_older_files_are_read(tmp_path):
    with new_file(tmp_path / "old.h5") as file:
        file.attrs["name"] = "load é"
        file.attrs["units"] = ["N", "m"]
        assert attributes_of(file)["name"] == "load é"
        assert [str(u) for u in attributes_of(file)["units"]] == ["N", "m"]


def test_an_interval_of_no_length_in_a_log_exports(tmp_path):
    folder = tmp_path / "run"
    with libmpm.Simulation(
        tank(), device="cpu", threads=1, output=libmpm.Output(folder, frame_interval=0.01)
    ) as sim:
        sim.run(until=0.02, progress=False)
    log = json.loads((folder / "log.json").read_text())
    log["output"]["frame_interval"] = 10**400
    (folder / "log.json").write_text(json.dumps(log))
    assert export(folder, to="npz", output=tmp_path / "made")


# Files from outside -----------------------------------------------------------------------------

HEAD = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"


@pytest.mark.parametrize("text", ["", "ply\n", "ply\nformat ascii 1.0\n", HEAD])
def test_a_ply_that_is_cut_in_its_head_is_refused(tmp_path, text):
    pytest.importorskip("meshio")
    path = tmp_path / "shape.ply"
    path.write_text(text)
    for read in (
        lambda: shapes.SurfaceMesh(file=str(path)).volume(),
        lambda: grids.Mesh.load(path),
    ):
        assert isinstance(fuzzing.answer(read), libmpm.SceneError)


def claymore_with(tmp_path, change):
    document = json.loads((fuzz_readers.CLAYMORE / "flume.json").read_text())
    change(document)
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(document))
    return fuzzing.answer(lambda: claymore.load(path, motion_folder=fuzz_readers.CLAYMORE))


@pytest.mark.parametrize("number", [float("-inf"), float("nan"), -1, 0.5, 10**400])
def test_ids_of_tracked_particles_of_claymore_are_whole(tmp_path, number):
    def change(document):
        document["bodies"][0]["track_particle_id"] = [number]

    found = claymore_with(tmp_path, change)
    assert isinstance(found, libmpm.SceneError)
    assert "track_particle_id" in str(found)


@pytest.mark.parametrize("name", ["(" * 5000, "a\0b"])
def test_a_file_of_claymore_that_no_system_has_is_not_found(tmp_path, name):
    def change(document):
        document["boundaries"][3]["file"] = name

    found = claymore_with(tmp_path, change)
    assert isinstance(found, libmpm.SceneError)


# Odd arguments -----------------------------------------------------------------------------------


def test_arrays_where_a_word_is_asked_for(tmp_path):
    box = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1))
    with pytest.raises(libmpm.SceneError, match="axis"):
        shapes.afloat(shape=box, density=500, level=1, axis=np.zeros((2, 2)))
    with pytest.raises(libmpm.SceneError, match="overwrite"):
        libmpm.Output(tmp_path, overwrite=np.zeros((2, 2)))
    with pytest.raises(libmpm.SceneError, match=r"pieces.*5000"):
        law = materials.FixedCorotated(density=800.0, youngs_modulus=1e5)
        kind = libmpm.debris.Prototype(name="b", length=1, width=1, height=1, material=law)
        piece = libmpm.debris.Piece(x=0.0, y=0.0, angle=0.0)
        libmpm.debris.DebrisField(prototypes=[kind], pieces=[piece] * 6000, footprint=(1, 1))


def test_a_document_with_nothing_left_is_broken_no_further():
    """The attack itself: it chose from places of which an earlier change had left none."""
    for documents in ({"a": {}}, {"a": {"x": 1}}, {"a": []}):
        for case in range(500):
            fuzzing.Breaker(documents, "0", case, True).broken()


def test_a_checkpoint_with_another_name_of_a_body_goes_on(tmp_path):
    """The attack itself: it read the body by the name that it had changed."""
    fuzz_readers.save_small_tank(tmp_path / "state.npz")
    found = load_checkpoint(tmp_path / "state.npz")
    found.header["scene"]["bodies"][0]["name"] = "all"
    save_checkpoint(tmp_path / "state.npz", found)
    broken = fuzzing.Broken(None, [], path=tmp_path / "state.npz")
    assert fuzz_readers.judge_state(broken) == "went on"


def test_a_state_with_an_element_inside_out_is_read_and_ends_as_its_run_does(tmp_path):
    """A run may save it: elements are judged as a step begins. The attack took it for a defect."""
    law = materials.NeoHookean(density=800.0, youngs_modulus=1e5)
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    bar = shapes.Triangles.box(lower=(0.2, 0.3), upper=(0.6, 0.5), edge=0.05)
    scene.add_body(name="bar", shape=bar, material=law, velocity=(0.1, 0.0))
    sim = libmpm.Simulation(scene, device="cpu", threads=1, precision="double")
    sim.step(3)
    sim.save_checkpoint(tmp_path / "saved.npz")
    found = load_checkpoint(tmp_path / "saved.npz")
    ids = np.array(found.state["body0_id"])
    ids[:2] = ids[1::-1]
    found.state["body0_id"] = ids
    save_checkpoint(tmp_path / "saved.npz", found)
    assert forged._judge(tmp_path / "saved.npz") == "stopped: NumericalError"
    again = libmpm.Simulation.resume(tmp_path / "saved.npz", device="cpu")
    view = again.particles["bar"]
    assert np.isfinite(view["position"]).all()
    assert (np.asarray(view["element_volume_ratio"]) <= 0).any()
    assert not np.isfinite(view["element_pressure"]).all()
    with pytest.raises(libmpm.NumericalError, match="turned inside out"):
        again.step(1)


def test_a_number_that_was_taken_out_again_is_no_reason_to_refuse():
    """The attack itself: a later change may remove what an earlier one has made infinite."""
    documents = {"a": {"x": [1.0, 2.0], "name": "n", "z": {"y": 3.0}}}
    for case in range(3000):
        broken = fuzzing.Breaker(documents, "0", case, False).broken()
        if broken.refuse and not broken.deep:
            assert "nan" in str(broken.said) or "inf" in str(broken.said)
            found = (fuzzing.at(broken.document, way) for way in fuzzing.places(broken.document))
            assert any(isinstance(x, float) and not np.isfinite(x) for x in found)


@pytest.mark.parametrize("bodies", [None, True, 3, "w"])
def test_bodies_that_are_no_list_are_refused_by_a_checkpoint(saved, bodies):
    found = load_checkpoint(saved)
    found.header["scene"]["bodies"] = bodies
    save_checkpoint(saved, found)
    with pytest.raises(libmpm.Error):
        libmpm.Simulation.resume(saved, device="cpu")


def test_a_box_of_more_cells_than_numbers_go_is_refused():
    """The largest box in the smallest cells that a scene takes: 1e616 particles."""
    with pytest.raises(libmpm.SceneError, match="cell_size is 1e-300; expected ≥ 1e-100 m"):
        libmpm.Scene(dimension=2, cell_size=1e-300, lower=(0, 0), upper=(1e-299, 1e-299))
    ends = {"lower": (0, 0, 0), "upper": (1e-99, 1e-99, 1e-99)}
    scene = libmpm.Scene(dimension=3, cell_size=1e-100, **ends)
    scene.add_body(
        name="w", shape=shapes.Box(lower=(0, 0, 0), upper=(9e99, 9e99, 9e99)),
        material=materials.TaitFluid(bulk_modulus=1e5), particles_per_cell=2**62,
    )  # fmt: skip
    with pytest.raises(libmpm.SceneError, match=r"'w': [0-9]{20}… particles; expected ≤ [0-9]+ in"):
        scene.validate()


def test_a_rate_beyond_all_floats_is_shown(tmp_path):
    libmpm.Simulation(tank(), device="cpu", output=tmp_path / "run").run(
        until=0.002, progress=False
    )
    log = json.loads((tmp_path / "run" / "log.json").read_text())
    log["particle_steps_per_s"] = 10**400
    (tmp_path / "run" / "log.json").write_text(json.dumps(log))
    assert "inf particle-steps/s" in text_of(about(tmp_path / "run"))


def test_places_of_a_document_however_deep():
    deep: list = []
    for _ in range(5000):
        deep = [deep, 1]
    assert sum(1 for _ in fuzzing.places(deep)) == 10_000
    copy = fuzzing.copied({"a": deep, "b": [1]})
    copy["b"][0] = 2
    assert len(copy["a"]) == 2 and copy["a"] is not deep
