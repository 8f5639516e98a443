"""Scenes that go on from a checkpoint: their file, their values, and runs that follow on them.

Expected duration: 3 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import json
import pickle
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.output.checkpoint import load_header
from libmpm._src.run import checkpoint_state as snapshots
from support.branches import (
    DX,
    THIN,
    WOOD,
    add_far,
    assert_close,
    assert_same,
    box,
    flume,
    saved,
    simulate,
    surge,
    trunk_and_scene,
    turned,
)
from support.devices import device  # noqa: F401


def test_files_that_are_not_the_trunk(tmp_path):
    trunk, scene = trunk_and_scene(tmp_path)
    path = tmp_path / "trunk.npz"
    unchanged = libmpm.Scene.from_dict(scene.to_dict())
    add_far(scene)
    simulate(scene).step(1)
    content = path.read_bytes()
    trunk.step(5)
    saved(trunk, tmp_path)
    # Another file under the name, also where this process has read the first one.
    for changed in (scene, unchanged):
        with pytest.raises(libmpm.CheckpointError, match=r"is not the checkpoint.*SHA-256 begins"):
            simulate(changed).step(1)
    path.unlink()
    for changed in (scene, unchanged):
        with pytest.raises(libmpm.CheckpointError, match="cannot be read"):
            simulate(changed).step(1)
    with pytest.raises(libmpm.CheckpointError, match="does not exist"):
        libmpm.Scene.from_checkpoint(path)
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(libmpm.CheckpointError, match="truncated or damaged"):
        libmpm.Scene.from_checkpoint(path)
    path.write_bytes(content)
    simulate(scene).step(1)  # the same content again


def test_the_newest_of_a_run(tmp_path):
    output = libmpm.Output(tmp_path, checkpoint_interval=0.02)
    run = simulate(surge(), output=output)
    run.run(until=0.07, progress=False)
    files = sorted((tmp_path / "checkpoints").iterdir())
    scene = libmpm.Scene.from_checkpoint(tmp_path)
    assert scene.start.checkpoint == str(files[-1].absolute())
    assert scene.start.step == load_header(files[-1])[0]["step"]
    files[-1].write_bytes(files[-1].read_bytes()[:-100])
    with pytest.warns(libmpm.ModelWarning, match="an older one is used"):
        scene = libmpm.Scene.from_checkpoint(tmp_path)
    assert scene.start.checkpoint == str(files[-2].absolute())
    (tmp_path / "empty").mkdir()
    with pytest.raises(libmpm.CheckpointError, match="holds no checkpoint"):
        libmpm.Scene.from_checkpoint(tmp_path / "empty")


@pytest.mark.filterwarnings("ignore:.*left the domain.*:libmpm.ModelWarning")
@pytest.mark.parametrize("leaving", ["freeze", "delete"])
@pytest.mark.parametrize("waiting", [True, False])
def test_particles_that_have_left(tmp_path, leaving, waiting):
    """They are counted in a warning, also those that no sort has taken out yet."""
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0, 0), upper=(1.6, 0.8), gravity=(0.0, -9.81),
        method=libmpm.Method(leaving=leaving),
    )  # fmt: skip
    scene.add_body(name="block", shape=box(2, (0.2, 0.1), (0.4, 0.4)), material=WOOD)
    trunk = simulate(scene)
    begun = len(trunk.particles["block"])
    for _ in range(400):
        trunk.step(1)
        read = trunk.engine.attributes(0, ["id", "position", "frozen"])
        outside = read["position"][:, 1] < 0
        late = int((outside & (read["frozen"] == 0)).sum())
        gone = begun - len(outside) + int(read["frozen"].sum())
        if late if waiting else gone and not late:
            break
    assert (late > 0) == waiting and gone + late < begun
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    assert len(simulate(scene).particles["block"]["id"]) == len(outside)  # all that it had
    scene.add_body(name="new", shape=box(2, (1.0, 0.5), (1.2, 0.6)), material=WOOD)
    branch = simulate(scene)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        branch.step(0)
    left = int(outside.sum())
    text = f"parent run removed {{'block': {left}}} particles that left its domain"
    # Files of other tests may be closed, with a warning, while this one listens.
    told = [str(w.message) for w in found if issubclass(w.category, libmpm.ModelWarning)]
    assert [text in message for message in told] == ([True] if left else [])
    np.testing.assert_array_equal(branch.particles["block"]["id"], np.sort(read["id"][~outside]))
    branch.step(1)


def test_nothing_left_of_a_body_is_named(tmp_path):
    scene = surge(solid=None, leaving="delete", faces=("x-", "x+", "y-"))
    scene.add_body(
        name="log", shape=box(2, (1.0, 0.7), (1.2, 0.8)), material=WOOD, velocity=(0.0, 5.0)
    )
    trunk = simulate(scene)
    with pytest.warns(libmpm.ModelWarning):
        trunk.run(until=0.1, progress=False)
    assert len(trunk.particles["log"]) == 0
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    simulate(scene).step(1)
    add_far(scene)
    with pytest.raises(libmpm.SceneError, match="body 'log': none of its particles is left"):
        simulate(scene).step(1)


@THIN
def test_scenes_with_a_start_are_values(tmp_path):
    trunk = simulate(flume(1, tracked=290))
    trunk.step(3)
    path = saved(trunk, tmp_path)
    scene = libmpm.Scene.from_checkpoint(path, tiles=3, axis="y")
    scene.add_body(
        name="log",
        shape=shapes.Box(lower=(0.5, 0.1, 0.3), upper=(0.6, 0.2, 0.4)),
        material=WOOD,
        subtract_from=("water",),
    )
    scene.save(tmp_path / "scene.json")
    copies = [
        libmpm.Scene.from_dict(scene.to_dict()),
        libmpm.Scene.from_dict(json.loads(json.dumps(scene.to_dict()))),
        libmpm.Scene.load(tmp_path / "scene.json"),
        pickle.loads(pickle.dumps(scene)),
    ]
    for copy in copies:
        assert copy == scene
        assert copy.start == scene.start
        assert copy.to_dict() == scene.to_dict()
    assert scene != libmpm.Scene.from_checkpoint(path, tiles=3, axis="y")
    two = libmpm.Scene.from_checkpoint(path, tiles=2, axis="y")
    assert two != libmpm.Scene.from_checkpoint(path)
    assert [(b.name, b.first_id, b.ids) for b in scene.start.bodies] == [
        ("water", 0, 3 * 288), ("sand", 3 * 288, 3 * 48)
    ]  # fmt: skip
    branch = simulate(copies[2])
    branch.step(2)
    assert branch.steps == 5
    # The plan wants no file and counts what the trunk had.
    path.unlink()
    plan = scene.plan(device="cpu", until=1.0)
    assert plan.particles == 3 * (288 + 48) + plan.body("log")["particles"]
    assert plan.time_step == branch.dt


def test_a_branch_outlives_its_trunk_file(tmp_path):
    """Resumed after the trunk's file is gone, and gone on from in its turn."""
    _, scene = trunk_and_scene(tmp_path)
    scene.add_body(name="rock", shape=turned(2), material=WOOD, subtract_from=("water",))
    output = libmpm.Output(tmp_path / "run", checkpoint_interval=0.02)
    branch = simulate(scene, output=output)
    branch.run(until=branch.time + 0.05, progress=False)
    (tmp_path / "trunk.npz").unlink()
    snapshots._read.cache_clear()
    resumed = libmpm.Simulation.resume(tmp_path / "run")
    assert resumed.scene == branch.scene
    assert 60 < resumed.steps < branch.steps
    resumed.step(branch.steps - resumed.steps)
    assert_same(branch, resumed)
    path = saved(branch, tmp_path, "branch.npz")
    second = libmpm.Scene.from_checkpoint(path)
    assert [b.name for b in second.start.bodies] == ["water", "solid", "rock"]
    again = simulate(second)
    add_far(third := libmpm.Scene.from_checkpoint(path))
    further = simulate(third)
    for sim in (branch, again, further):
        sim.step(30)
    assert_same(branch, again)
    assert_close(branch, further, "cpu", "double", 30)
    assert further.displaced == {}


@pytest.mark.parametrize("added", [False, True])
@pytest.mark.parametrize("precisions", [("double", "single"), ("single", "double")])
def test_another_precision(tmp_path, device, precisions, added):
    """A trunk on the CPU, its branch on the other device and in the other precision."""
    first, second = precisions
    trunk = simulate(surge(), precision=first)
    trunk.step(70)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    if added:
        add_far(scene)
    branch = simulate(scene, device, second)
    assert branch.time == trunk.time
    for sim in (trunk, branch):
        sim.step(50)
    assert_close(trunk, branch, device, "single", 50)
    np.testing.assert_array_equal(branch.particles["water"]["id"], trunk.particles["water"]["id"])


def test_a_time_step_of_its_own(tmp_path):
    trunk, scene = trunk_and_scene(tmp_path)
    branch = simulate(scene, time_step=0.5 * trunk.dt)
    branch.step(3)
    assert branch.dt == 0.5 * trunk.dt


def test_grids_of_functions_are_refused(tmp_path):
    mesh = grids.Mesh.blocks(columns=2, rows=2, lower=(0, 0), upper=(1, 1))
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh))
    elastic = materials.Hypoelastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3)
    shape = shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6))
    scene.add_body(name="block", shape=shape, material=elastic, lattice=(8, 8))
    run = libmpm.Simulation(scene, threads=1)
    run.step(1)
    with pytest.raises(libmpm.SceneError, match=r"has a grid of functions.*Simulation\.resume"):
        libmpm.Scene.from_checkpoint(saved(run, tmp_path))


def test_bodies_that_the_trunk_stores_apart_stay_apart(tmp_path):
    """Alike but for their first pressure: a branch stores them as one, and its state says so."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(2.0, 1.0), gravity=(0, -9.81)
    )
    for name, left, level in (("a", 0.0, 0.4), ("b", 1.0, None)):
        scene.add_body(
            name=name, shape=shapes.Box(lower=(left, 0), upper=(left + 0.6, 0.4)),
            material=materials.TaitFluid(density=1000, bulk_modulus=1e5), hydrostatic=level,
        )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    trunk = simulate(scene)
    trunk.step(20)
    added = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    added.add_body(
        name="log", shape=shapes.Box(lower=(0.7, 0.7), upper=(0.9, 0.9)),
        material=materials.FixedCorotated(density=500, youngs_modulus=1e5, poissons_ratio=0.2),
    )  # fmt: skip
    branch = simulate(added)
    branch.step(10)
    path = saved(branch, tmp_path, "branch.npz")
    for again in (libmpm.Simulation.resume(path), simulate(libmpm.Scene.from_checkpoint(path))):
        again.step(10)
        assert [len(body) for body in again.particles.values()] == [96, 96, 16]
    branch.step(10)
    assert_same(branch, again)


def test_a_state_with_more_bodies_is_refused(tmp_path):
    trunk, _ = trunk_and_scene(tmp_path)
    state = dict(trunk.engine.save())
    count = len(trunk.particles)
    state[f"body{count}_id"] = np.zeros(1, dtype=np.uint32)
    with pytest.raises(libmpm.SceneError, match="more bodies than this scene"):
        trunk.engine.load(state)


def test_load_cells_do_not_depend_on_each_other(tmp_path):
    """A load cell on another boundary leaves the bits of the first one alone."""
    _, scene = trunk_and_scene(tmp_path)
    pier = shapes.Box(lower=(1.5, 0.0), upper=(1.6, 0.1))
    scene.add_boundary(name="pier", shape=pier, response=boundaries.Slip(), time=(1e3, 2e3))
    alone = simulate(scene)
    scene.add_sensor(name="second", sensor=sensors.LoadCell(boundary="pier", interval=0.0))
    both = simulate(scene)
    for sim in (alone, both):
        sim.step(40)
    first = next(s.name for s in alone.series() if s.attributes["kind"] == "load-cell")
    assert len(alone.sensors[first].time) > 0
    np.testing.assert_array_equal(alone.sensors[first].values, both.sensors[first].values)
    assert len(both.sensors["second"].time) == 40
    assert not both.sensors["second"].values.any()
