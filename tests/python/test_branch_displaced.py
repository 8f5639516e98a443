"""Scenes that go on from a checkpoint: what new bodies take the place of, and who is in the way.

Expected duration: 2 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import json
from collections import defaultdict
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from support.branches import (
    BACKENDS,
    DIMENSIONS,
    WOOD,
    add_far,
    assert_same,
    box,
    nodes,
    saved,
    simulate,
    surge,
    trunk_and_scene,
    turned,
    weights,
)
from support.devices import device  # noqa: F401
from support.tolerances import ROUNDING


def lies_in(shape: shapes.OrientedBox, position: np.ndarray) -> np.ndarray:
    """Which positions lie in a box turned in the plane of the flow."""
    way = position - np.array(shape.centre)
    last = way.shape[1] - 1
    # About y the turn goes from z to x.
    angle = np.radians(shape.angle if last == 1 else -shape.angle)
    c, s = np.cos(angle), np.sin(angle)
    own = way.copy()
    own[:, 0] = c * way[:, 0] + s * way[:, last]
    own[:, last] = -s * way[:, 0] + c * way[:, last]
    return np.all(np.abs(own) < 0.5 * np.array(shape.size), axis=1)


@BACKENDS
@DIMENSIONS
def test_displaced_particles_and_their_momentum(tmp_path, dimension, device, precision):
    """Exactly those inside go, and with them what they carried at the nodes.

    The others bring their nodes' velocities along on the mass that they have themselves: the
    momentum of node i is v_i Σ m w_ip over what remains, so that the whole loses Σ m w_ip v_i of
    what was removed.
    """
    trunk = simulate(surge(dimension), device, precision)
    trunk.step(90)
    water = trunk.particles["water"].read(["id", "position", "mass"])
    before = nodes(trunk)
    gone = lies_in(turned(dimension), water["position"])
    assert 10 < gone.sum() < 0.3 * len(gone)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    scene.add_body(name="rock", shape=turned(dimension), material=WOOD, subtract_from=("water",))
    output = libmpm.Output(tmp_path / "run", checkpoint_interval=1.0)
    branch = simulate(scene, device, precision, output=output)
    assert branch.dt == trunk.dt
    after = nodes(branch)
    np.testing.assert_array_equal(branch.particles["water"]["id"], water["id"][~gone])
    assert branch.displaced == {"water": gone.sum()}

    mass = water["mass"][0]
    removed: dict[tuple[int, ...], float] = defaultdict(float)
    for rows in weights(water["position"][gone]):
        for node, w, _ in rows:
            removed[node] += mass * w
    loose = {"cpu": 50, "cuda": 1000}[device] * ROUNDING[precision]
    speed = max(np.abs(p / m).max() for m, p in before.values() if m > mass)
    carried = np.zeros(dimension)
    for node, (m, p) in before.items():
        carried += removed[node] * p / m
        # The rock is at rest and without stress: it brings mass and no momentum.
        found = after[node][1] if node in after else np.zeros(dimension)
        left = (m - removed[node]) * p / m
        np.testing.assert_allclose(found, left, rtol=0, atol=loose * speed * mass)
    total = [sum(p for _, p in n.values()) for n in (before, after)]
    np.testing.assert_allclose(
        total[0] - total[1], carried, rtol=0, atol=loose * np.abs(carried).max()
    )
    assert np.abs(carried).max() > 0.01 * np.abs(total[0]).max()

    branch.run(until=branch.time + 0.02, progress=False)
    log = json.loads((tmp_path / "run" / "log.json").read_text())
    assert log["displaced"] == {"water": gone.sum()}
    resumed = libmpm.Simulation.resume(saved(branch, tmp_path, "branch.npz"))
    assert resumed.displaced == branch.displaced
    for sim in (branch, resumed):
        sim.step(10)
    assert_same(branch, resumed)


def test_bodies_of_the_trunk_displace_no_more(tmp_path):
    """The block took the place of water at the trunk's start; then it moved and water came."""
    scene = surge(solid=None)
    rock = materials.FixedCorotated(density=3000.0, youngs_modulus=2e5, poissons_ratio=0.3)
    place = ((0.15, 0.2), (0.35, 0.35))
    scene.add_body(name="rock", shape=box(2, *place), material=rock, subtract_from=("water",))
    trunk = simulate(scene)
    trunk.run(until=0.3, progress=False)
    water = trunk.particles["water"]["position"]
    assert np.any(np.all((water > place[0]) & (water < place[1]), axis=1))
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    add_far(scene)
    branch = simulate(scene)
    branch.step(1)
    assert branch.displaced == {}
    np.testing.assert_array_equal(branch.particles["water"]["id"], trunk.particles["water"]["id"])


def test_the_energy_balance_steps_by_what_bodies_bring(tmp_path):
    trunk, scene = trunk_and_scene(tmp_path)
    add_far(scene)
    branch = simulate(scene)
    for sim in (trunk, branch):
        sim.run(until=0.12, progress=False)
    old, new = (s.sensors["energy"].values[-1] for s in (trunk, branch))
    mass = branch.particles["far"]["mass"].sum()
    # In the air it keeps what it had when it came: m g times the height of its middle.
    assert old[3] - new[3] == pytest.approx(mass * 9.81 * 0.65, rel=1e-3)


def test_what_is_in_the_way_is_named(tmp_path):
    trunk, scene = trunk_and_scene(tmp_path)
    water = trunk.particles["water"]["position"]

    def refused(add: Any) -> str:
        scene = libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz")
        add(scene)
        with pytest.raises(libmpm.SceneError) as error:
            simulate(scene).step(1)
        return str(error.value)

    inside = int(np.all((water > (0.1, 0.1)) & (water < (0.3, 0.2)), axis=1).sum())
    shape = box(2, (0.1, 0.1), (0.3, 0.2))
    text = refused(lambda s: s.add_body(name="rock", shape=shape, material=WOOD))
    assert f"body 'rock': {inside} particles of body 'water' lie inside it" in text
    assert "subtract_from=('water',)" in text
    everything = box(2, (0.0, 0.0), (1.6, 0.8))
    text = refused(
        lambda s: s.add_body(
            name="flood", shape=everything, material=WOOD, subtract_from=("water", "solid")
        )
    )
    assert f"body 'water': the new bodies displace all of its {len(water)} particles" in text
    response = boundaries.Slip()
    text = refused(lambda s: s.add_boundary(name="pier", shape=shape, response=response))
    assert f"boundary 'pier': {inside} particles of body 'water' lie inside it" in text
    # One that acts later may stand where water is now.
    scene.add_boundary(
        name="pier", shape=box(2, (0.1, 0.1), (0.3, 0.2)), response=response, time=(5.0, 6.0)
    )
    simulate(scene).step(1)


@pytest.mark.parametrize("window", [(0.0, 0.02), (0.03, 9.0)])
def test_a_new_body_and_the_windows_of_boundaries(tmp_path, window):
    """A gate that has opened is no longer in the way; one that has closed meanwhile is."""
    scene = surge(solid=None)
    gate = box(2, (1.0, 0.0), (1.2, 0.6))
    scene.add_boundary(name="gate", shape=gate, response=boundaries.Slip(), time=window)
    trunk = simulate(scene)
    trunk.run(until=0.05, progress=False)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    scene.add_body(name="raft", shape=box(2, (1.0, 0.4), (1.2, 0.5)), material=WOOD)
    if window[1] < trunk.time:
        simulate(scene).step(1)
        return
    with pytest.raises(libmpm.SceneError, match="gate"):
        simulate(scene).step(1)
