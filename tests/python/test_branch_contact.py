"""Scenes that go on from a checkpoint with contacts: bodies that had one velocity part.

Expected duration: 5 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, contacts, materials, shapes
from support.branches import (
    BACKENDS,
    DIMENSIONS,
    DX,
    THIN,
    WOOD,
    assert_close,
    assert_same,
    box,
    flume,
    nodes,
    saved,
    simulate,
    surge,
)
from support.devices import device  # noqa: F401
from support.tolerances import ROUNDING


def surged(folder: Path, dimension: int = 2) -> libmpm.Scene:
    """Return what goes on from water that has come to the solid, between held walls.

    Along lines towards linear walls what sticks is not one field to rounding (design/contact.md).
    """
    scene = surge(dimension)
    scene.replace("walls", response=boundaries.Slip(cell="held"))
    trunk = simulate(scene)
    trunk.step(90)
    return libmpm.Scene.from_checkpoint(saved(trunk, folder))


def add_rock(scene: libmpm.Scene, law: contacts.ContactLaw | None = None) -> None:
    """A block in the flowing water, in whose way it is, with contact by `law`."""
    place = box(scene.dimension, (0.2, 0.05), (0.35, 0.2))
    scene.add_body(name="rock", shape=place, material=WOOD, subtract_from=("water",))
    if law is not None:
        scene.add_contact(name="rubs", between=("rock", "water"), law=law)


@BACKENDS
@DIMENSIONS
@pytest.mark.parametrize("transfer", ["APIC", libmpm.methods.Transfer(scheme="AFLIP", flip=0.95)])
def test_bodies_that_part_begin_with_the_velocities_that_they_shared(
    tmp_path, dimension, transfer, device, precision
):
    """Fields of one node add up to what the trunk had there: mass, momentum, F-bar's averages."""
    trunk = simulate(surge(dimension, transfer=transfer), device, precision)
    trunk.step(90)
    before = nodes(trunk)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path))
    scene.add_contact(name="afloat", between=("solid", "water"), law=contacts.Fluid())
    branch = simulate(scene, device, precision)
    after = nodes(branch)
    shared = {n for n, (m, _) in before.items() if m > 0}
    assert {n for n, (m, _) in after.items() if m > 0} == shared
    loose = {"cpu": 50, "cuda": 1000}[device] * ROUNDING[precision]
    heaviest = max(m for m, _ in before.values())
    fastest = max(np.abs(p).max() for _, p in before.values())
    for node in shared:
        assert after[node][0] == pytest.approx(before[node][0], abs=loose * heaviest)
        np.testing.assert_allclose(after[node][1], before[node][1], rtol=0, atol=loose * fastest)
    # They did share nodes, and part from there on.
    bodies = [branch.particles[b].read(["position", "velocity"]) for b in ("water", "solid")]
    cells = [{tuple(c) for c in np.floor(b["position"] / DX).astype(int)} for b in bodies]
    assert cells[0] & {(c[0] + d, *c[1:]) for c in cells[1] for d in (-2, -1, 0, 1, 2)}
    start = [trunk.particles[b]["velocity"] for b in ("water", "solid")]
    for found, was in zip(bodies, start, strict=True):
        np.testing.assert_allclose(found["velocity"], was, rtol=0, atol=0.05)
    for sim in (trunk, branch):
        sim.step(40)
    gone = np.abs(branch.particles["solid"]["velocity"] - trunk.particles["solid"]["velocity"])
    assert gone.max() > 1e-3


@BACKENDS
@DIMENSIONS
def test_bodies_that_stick_are_a_branch_without_contacts(tmp_path, dimension, device, precision):
    scene = surged(tmp_path, dimension)
    runs = []
    for law in (None, contacts.Stick()):
        one = libmpm.Scene.from_dict(scene.to_dict())
        add_rock(one, law)
        runs.append(simulate(one, device, precision))
        runs[-1].step(25)
    assert runs[0].displaced == runs[1].displaced != {}
    assert_close(*runs, device, precision, steps=25)


def test_a_branch_with_contact_resumes_to_the_bit_and_is_no_trunk(tmp_path):
    scene = surged(tmp_path)
    add_rock(scene, contacts.Fluid())
    branch = simulate(scene)
    branch.step(15)
    resumed = libmpm.Simulation.resume(saved(branch, tmp_path, "branch.npz"))
    for sim in (branch, resumed):
        sim.step(15)
    assert_same(branch, resumed)
    with pytest.raises(libmpm.SceneError, match="the run has contact 'rubs', and with it several"):
        libmpm.Scene.from_checkpoint(tmp_path / "branch.npz")


@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_begin_a_branch_with_contact_with_the_bits_of_one(tmp_path, ranks):
    scene = surged(tmp_path, 3)
    add_rock(scene, contacts.Fluid())
    scene.add_contact(name="wood", between=("rock", "solid"), law=contacts.Friction(static=0.3))
    runs = [libmpm.Simulation(scene, device=d, precision="double", threads=1)
            for d in ("cpu", ["cpu"] * ranks)]  # fmt: skip
    for sim in runs:
        sim.step(20)
    for body, name in itertools.product(runs[0].particles, ("id", "position", "velocity")):
        one, several = (sim.particles[body][name] for sim in runs)
        np.testing.assert_array_equal(one, several, f"{body} {name}")


@THIN
def test_a_block_slides_on_the_sand_of_a_tiled_slice(tmp_path):
    """Without friction it keeps its speed, which the sand under it takes where they share one."""
    trunk = simulate(flume(1))
    trunk.step(3)
    saved(trunk, tmp_path)
    speeds = []
    for sticks in (False, True):
        scene = libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz", tiles=4, axis="y")
        scene.add_body(
            name="block", material=WOOD, velocity=(0.3, 0.0, 0.0),
            shape=shapes.Box(lower=(0.4, 0.15, 0.1), upper=(0.5, 0.25, 0.2)),
        )  # fmt: skip
        if not sticks:
            scene.add_contact(
                name="slides", between=("block", "sand"), law=contacts.Friction(static=0.0)
            )
        sim = simulate(scene)
        sim.run(until=sim.time + 0.05, progress=False)
        speeds.append(float(sim.particles["block"]["velocity"][:, 0].mean()))
    # Sand that slumps pushes the block on.
    assert speeds[0] > 0.29 and speeds[1] < 0.27


@DIMENSIONS
@pytest.mark.parametrize("kind", ["elements", "rigid"])
def test_new_bodies_of_elements_and_rigid_ones_fall_beside_water_that_goes_on(
    tmp_path, dimension, kind
):
    scene = surged(tmp_path, dimension)
    whole = simulate(scene)
    across = (0.025,) * (dimension - 2)
    low, high = (1.2, *across, 0.4), (1.4, *(3 * y for y in across), 0.5)
    if kind == "elements":
        mesh = shapes.Triangles if dimension == 2 else shapes.Tetrahedra
        scene.add_body(name="debris", material=WOOD, shape=mesh.box(lower=low, upper=high, edge=DX))
    else:
        scene.add_body(
            name="debris", material=materials.Rigid(density=700.0),
            shape=shapes.Box(lower=low, upper=high),
        )  # fmt: skip
    branch = simulate(scene)
    begun = branch.time
    for sim in (whole, branch):
        sim.step(10)
    assert_same(branch, libmpm.Simulation.resume(saved(branch, tmp_path, "branch.npz")))
    # Velocities are those of the next step, whose gravity has acted.
    fallen = branch.particles["debris"]["velocity"][:, -1]
    np.testing.assert_allclose(fallen, -9.81 * (branch.time + branch.dt - begun), rtol=1e-9)
    for name in ("position", "velocity"):
        a, b = (sim.particles["water"][name] for sim in (whole, branch))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
