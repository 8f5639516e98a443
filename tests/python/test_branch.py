"""Scenes that go on from a checkpoint: the motion of what goes on.

What must stay bit-equal is compared bit by bit; the rest with bounds from rounding or from a
formula that the test writes out. Expected duration: 6 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import json
from collections import defaultdict
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.output.frames import list_frames
from libmpm._src.output.sensor_file import read_sensors
from support.branches import (
    BACKENDS,
    DENSITY,
    DIMENSIONS,
    DX,
    FORMS,
    METAL,
    SAND,
    SOUND,
    WATER,
    WIDTH,
    WOOD,
    add_alike,
    add_far,
    alike,
    assert_close,
    assert_same,
    box,
    nodes,
    saved,
    simulate,
    surge,
    weights,
)
from support.devices import device  # noqa: F401

# ---- nothing added ------------------------------------------------------------------------------


@BACKENDS
@DIMENSIONS
@pytest.mark.parametrize(
    ("form", "solid"),
    [("none", SAND), ("one-volume", WOOD), ("one-volume-gradient", METAL), ("two-volume", None),
     ("stress-only", WOOD)],
)  # fmt: skip
def test_nothing_added_changes_no_bit(tmp_path, dimension, form, solid, device, precision):
    whole = simulate(surge(dimension, fbar=FORMS[form], solid=solid), device, precision)
    whole.step(70)
    time, load = whole.time, whole.sensors["load"]
    assert time - load.time[-1] > 0.2 * 0.017  # in the middle of an average
    scene = libmpm.Scene.from_checkpoint(saved(whole, tmp_path))
    branch = simulate(scene, device, precision)
    assert (branch.time, branch.steps) == (time, 70) == (scene.start.time, scene.start.step)
    for sim in (whole, branch):
        sim.step(30)
    assert_same(whole, branch)
    assert branch.displaced == {}
    if solid in (SAND, METAL):
        assert whole.particles["solid"]["plastic_strain"].max() > 0


def test_frames_and_samples_on_disk(tmp_path):
    def run(scene: libmpm.Scene, folder: str, until: float) -> libmpm.Simulation:
        output = libmpm.Output(tmp_path / folder, frame_interval=0.02)
        sim = simulate(scene, output=output)
        sim.run(until=until, progress=False)
        return sim

    run(surge(), "whole", 0.11)
    path = saved(run(surge(), "trunk", 0.05), tmp_path)
    branch = run(libmpm.Scene.from_checkpoint(path), "branch", 0.11)
    whole, ours = (list_frames(tmp_path / n / "frames")["water"] for n in ("whole", "branch"))
    # Number 2 is due at 0.04 s; a run begins with a frame of its first moment.
    assert (sorted(whole), sorted(ours)) == ([0, 1, 2, 3, 4, 5], [2, 3, 4, 5])
    for k in (3, 4, 5):
        assert ours[k].read_bytes() == whole[k].read_bytes()
    series = json.loads((tmp_path / "branch/frames/water.vtkhdf.series").read_text())["files"]
    assert series[0]["time"] == branch.scene.start.time
    first, second = (read_sensors(tmp_path / n / "sensors.h5") for n in ("whole", "branch"))
    for name in ("load", "energy"):
        np.testing.assert_array_equal(first[name].time, second[name].time)
        np.testing.assert_array_equal(first[name].values, second[name].values)


@BACKENDS
def test_new_boundaries_and_sensors_only_add(tmp_path, device, precision):
    """Until the water comes to the new box no bit differs; new sensors begin at the branch."""
    whole = simulate(surge(), device, precision)
    whole.step(70)
    start = whole.time
    scene = libmpm.Scene.from_checkpoint(saved(whole, tmp_path))
    scene.add_boundary(
        name="pier", shape=box(2, (1.2, 0.0), (1.4, 0.4)), response=boundaries.Sticky()
    )
    every = sensors.LoadCell(boundary="walls")
    scene.add_sensor(name="every", sensor=every)
    scene.add_sensor(name="mean", sensor=sensors.LoadCell(boundary="walls", interval=0.017))
    scene.add_sensor(name="pier", sensor=sensors.LoadCell(boundary="pier"))
    scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=(0.3,), interval=0.01))
    scene.add_sensor(name="water", sensor=sensors.Energy(body="water", interval=0.01))
    branch = simulate(scene, device, precision)
    for sim in (whole, branch):
        sim.step(60)
    assert whole.particles["solid"]["position"][:, 0].max() < 1.2 - 3 * DX
    assert_same(whole, branch)  # old sensors too: no gap, nothing twice
    assert np.all(branch.sensors["pier"].values == 0)

    gauge = branch.sensors["gauge"]
    assert gauge.time[0] == start
    assert branch.sensors["water"].values[0, 3] == 0  # dissipated since its first sample
    # The first mean is that of its own interval: what a cell of every step has taken since.
    each, mean = branch.sensors["every"], branch.sensors["mean"]
    assert each.time[0] > start
    lengths = np.diff(each.time, prepend=start)
    for k, (a, b) in enumerate(zip([start, *mean.time[:-1]], mean.time, strict=True)):
        within = (each.time > a) & (each.time <= b)
        impulse = (each.values[within] * lengths[within, None]).sum(axis=0)
        scale = np.abs(mean.values).max()
        np.testing.assert_allclose(mean.values[k], impulse / (b - a), rtol=0, atol=1e-12 * scale)
    assert len(mean.time) >= 2
    # The cell of the trunk took its sample over the branch: its time is in the old series.
    assert set(mean.time) <= set(branch.sensors["load"].time)

    for sim in (whole, branch):
        sim.run(until=0.45, progress=False)
    assert branch.sensors["pier"].values[:, 0].max() > 0
    assert np.any(branch.particles["water"]["position"] != whole.particles["water"]["position"])


def test_a_sensor_on_one_of_several_alike_bodies(tmp_path):
    """They are stored as one until a sensor wants one alone: then not the same bits, but motion."""
    trunk = simulate(alike())
    trunk.step(40)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    together = simulate(scene)
    scene.add_sensor(name="one", sensor=sensors.Energy(body="block 1"))
    apart = simulate(scene)
    for sim in (trunk, together, apart):
        sim.step(40)
    assert_same(trunk, together)
    assert_close(trunk, apart, "cpu", "double", 40)
    kinetic = apart.particles["block 1"]["kinetic_energy"].sum()
    assert apart.sensors["one"].values[-1, 0] == pytest.approx(kinetic, rel=1e-12)


# ---- bodies added -------------------------------------------------------------------------------


@BACKENDS
@DIMENSIONS
@pytest.mark.parametrize("new", ["solid", "fluid"])
def test_a_body_far_away_changes_nothing(tmp_path, dimension, new, device, precision):
    trunk = simulate(surge(dimension), device, precision)
    trunk.step(70)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    add_far(scene, material=WOOD if new == "solid" else WATER)
    branch = simulate(scene, device, precision)
    assert branch.dt == trunk.dt
    for sim in (trunk, branch):
        sim.step(100)
    assert_close(trunk, branch, device, precision, 100)
    ids = branch.particles["far"]["id"]
    first = sum(len(v) for v in trunk.particles.values())
    np.testing.assert_array_equal(ids, first + np.arange(len(ids)))
    fall = branch.time - scene.start.time
    drop = 0.65 - branch.particles["far"]["position"][:, -1].mean()
    assert drop == pytest.approx(0.5 * 9.81 * fall**2, rel=0.02)
    load, old = branch.sensors["load"], trunk.sensors["load"]
    np.testing.assert_array_equal(load.time, old.time)


@pytest.mark.parametrize("pipeline", ["fused", "two-pass"])
@pytest.mark.parametrize(
    ("form", "solid"),
    [(f, s) for f, s in product(FORMS, (None, SAND)) if (f, s) != ("stress-only", None)],
)
def test_every_form_goes_on_with_a_body_added(tmp_path, form, solid, pipeline):
    trunk = simulate(surge(2, fbar=FORMS[form], solid=solid), pipeline=pipeline)
    trunk.step(70)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    add_far(scene)
    branch = simulate(scene, pipeline=pipeline)
    for sim in (trunk, branch):
        sim.step(70)
    assert_close(trunk, branch, "cpu", "double", 70)
    np.testing.assert_allclose(
        trunk.sensors["load"].values, branch.sensors["load"].values,
        rtol=0, atol=1e-12 * np.abs(trunk.sensors["load"].values).max(),
    )  # fmt: skip


@pytest.mark.parametrize(
    "scheme", ["FLIP", "PIC-FLIP", "NFLIP", "AFLIP", "SFLIP", "ASFLIP", "XPIC"]
)
@pytest.mark.parametrize(
    ("dimension", "form", "solid"),
    [(2, "none", None), (2, "one-volume-gradient", WOOD), (2, "two-volume", SAND),
     (3, "one-volume", SAND)],
)  # fmt: skip
def test_transfers_that_store_velocities_go_on(tmp_path, scheme, dimension, form, solid):
    """Particles keep what they store, nodes the velocities before and after forces."""
    blend = {} if scheme in ("FLIP", "NFLIP", "XPIC") else {"flip": 0.95}
    transfer = libmpm.methods.Transfer(scheme=scheme, **blend)
    trunk = simulate(surge(dimension, fbar=FORMS[form], solid=solid, transfer=transfer))
    trunk.step(70)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    assert scene.transfer == transfer
    add_far(scene)
    branch = simulate(scene)
    for sim in (trunk, branch):
        sim.step(70)
    assert_close(trunk, branch, "cpu", "double", 70)


def test_a_transfer_whose_velocities_are_not_there(tmp_path):
    trunk = simulate(surge(2))
    trunk.step(10)
    data = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path)).to_dict()
    data["method"]["transfer"] = {"type": "Transfer", "scheme": "FLIP"}
    scene = libmpm.Scene.from_dict(data)
    add_far(scene)
    with pytest.raises(libmpm.SceneError, match=r"transfer of that run|this run stores"):
        simulate(scene).step(1)


@BACKENDS
def test_alike_bodies(tmp_path, device, precision):
    """Three of the trunk's are one in memory, two of the branch's another."""
    trunk = simulate(alike(), device, precision)
    trunk.step(50)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    for k in (4, 5):
        add_alike(scene, k)
    branch = simulate(scene, device, precision)
    whole = alike()
    for k in (4, 5):
        add_alike(whole, k)
    alone = simulate(whole, device, precision)
    branch.step(50)
    trunk.step(50)
    assert_close(trunk, branch, device, precision, 50)
    assert [len(v) for v in branch.particles.values()] == [64] * 5
    ids = np.concatenate([v["id"] for v in branch.particles.values()])
    np.testing.assert_array_equal(ids, np.arange(5 * 64))
    alone.step(50)  # the new ones fly as they do from the start of a run
    assert_close(alone, branch, device, precision, 50, bodies=("block 4", "block 5"))


def merged_branch(folder: Path) -> libmpm.Simulation:
    trunk = simulate(alike())
    trunk.step(10)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, folder))
    add_alike(scene, 4)
    branch = simulate(scene)
    branch.step(10)
    return branch


def test_a_branch_with_an_alike_body_resumes(tmp_path):
    branch = merged_branch(tmp_path)
    resumed = libmpm.Simulation.resume(saved(branch, tmp_path, "branch.npz"))
    for sim in (branch, resumed):
        sim.step(10)
    assert_same(branch, resumed)


@pytest.mark.parametrize("added", [0, 1])
def test_a_branch_of_a_branch_with_an_alike_body(tmp_path, added):
    branch = merged_branch(tmp_path)
    scene = libmpm.Scene.from_checkpoint(saved(branch, tmp_path, "branch.npz"))
    for k in range(added):
        add_alike(scene, 5 + k)
    again = simulate(scene)
    for sim in (branch, again):
        sim.step(10)
    assert_close(branch, again, "cpu", "double", 10)


# ---- another time step --------------------------------------------------------------------------


@DIMENSIONS
def test_the_stress_of_the_new_time_step(tmp_path, dimension):
    """Nodes get the impulse of the particles' stress for the difference of the steps, exactly.

    With f_i = -Σ_p V τ_p (4/Δx²) w_ip (x_i - x_p) the momentum becomes p_i + (Δt' - Δt) f_i, and
    Σ f_i = 0. A fixed-corotated block has no stress but that of its deformation.
    """
    flat = dimension == 2
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=(1.6, 0.8) if flat else (1.6, WIDTH, 0.8), gravity=(0.0,) * dimension,
    )  # fmt: skip
    scene.add_body(
        name="block",
        shape=box(dimension, (0.2, 0.2), (0.5, 0.4)),
        material=WOOD,
        velocity=libmpm.Field(components=("0.5*x",) + ("0",) * (dimension - 1)),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    trunk = simulate(scene)
    trunk.step(40)
    before = nodes(trunk)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    stiff = materials.FixedCorotated(density=700.0, youngs_modulus=2e7, poissons_ratio=0.3)
    add_far(scene, material=stiff)
    branch = simulate(scene)
    after = nodes(branch)
    change = branch.dt - trunk.dt
    assert change < -0.5 * trunk.dt

    block = trunk.particles["block"].read(["position", "stress", "volume"])
    force: dict[tuple[int, ...], np.ndarray] = defaultdict(lambda: np.zeros(dimension))
    for k, rows in enumerate(weights(block["position"])):
        impulse = block["volume"][k] * block["stress"][k] * (4 / DX**2)
        for node, w, way in rows:
            force[node] -= w * impulse @ way
    largest = max(np.abs(change * f).max() for f in force.values())
    assert largest > 1e-3 * max(np.abs(p).max() for _, p in before.values())
    for node, (mass, p) in before.items():
        assert after[node][0] == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose(
            after[node][1], p + change * force[node], rtol=0, atol=1e-11 * largest
        )
    total = sum(p for _, p in after.values()) - sum(p for _, p in before.values())
    assert np.abs(total).max() < 1e-11 * max(np.abs(p).max() for _, p in before.values())


@DIMENSIONS
@pytest.mark.parametrize("form", ["none", "one-volume-gradient"])
def test_a_tank_stays_at_rest_at_another_time_step(tmp_path, dimension, form):
    """Pressure for the old step against gravity for the new one would start all water upwards.

    At rest the sums hold the impulse Δt g of the pressure against gravity. A restart that took
    them as they are and added gravity for Δt' would leave every node with (Δt - Δt') g, upwards.
    With the impulse for the difference what is left is the tank's own acceleration times
    Δt - Δt', that of its faint ringing: less than a step of the trunk changes. Afterwards water is
    no faster than in the trunk, and the pressure differs by a small part of ρ c (Δt - Δt') g, the
    wave that a kick of that speed would send.
    """
    depth, flat = 0.5, dimension == 2
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=(0.6, 0.9) if flat else (0.6, WIDTH, 0.9),
        gravity=(0.0, -10.0) if flat else (0.0, 0.0, -10.0),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=box(dimension, (0.0, 0.0), (0.6, depth)),
        material=WATER,
        hydrostatic=depth,
        fbar=FORMS[form],
    )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip(cell="held")
    )
    trunk = simulate(scene)
    trunk.step(300)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    stiff = materials.FixedCorotated(density=500.0, youngs_modulus=4e7, poissons_ratio=0.2)
    scene.add_body(name="stiff", shape=box(dimension, (0.1, 0.7), (0.3, 0.8)), material=stiff)
    branch = simulate(scene)
    omitted = 10.0 * (trunk.dt - branch.dt)
    assert branch.dt < 0.15 * trunk.dt

    def fastest(sim: libmpm.Simulation) -> float:
        return float(np.abs(sim.particles["water"]["velocity"]).max())

    before = trunk.particles["water"]["velocity"]
    first = branch.particles["water"]["velocity"] - before
    assert np.abs(first).max() < 0.01 * omitted
    ahead = simulate(libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz"))
    ahead.step(1)
    step = ahead.particles["water"]["velocity"] - before
    assert np.abs(first).max() < np.abs(step).max()

    end, most, ours = trunk.time + 0.03, 0.0, 0.0
    while branch.time < end:
        branch.step(5)
        ours = max(ours, fastest(branch))
    while trunk.time < end:
        trunk.step(1)
        most = max(most, fastest(trunk))
    assert ours < 1.1 * most
    assert most < 0.2 * omitted
    wave = DENSITY * SOUND * omitted
    pressure = [sim.particles["water"]["pressure"] for sim in (trunk, branch)]
    assert np.abs(pressure[1] - pressure[0]).max() < 0.05 * wave
