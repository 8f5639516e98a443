"""Walls of linear cells against the naive method, and what every wall has to be.

Expected duration: 30 s, nearly all of it the naive method.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

import libmpm
from support import scenes
from support.devices import device  # noqa: F401
from support.lines_reference import LinesReference
from support.tolerances import REFERENCE

SCENES = {
    "slip": {},
    "separable": {"separable": True},
    "gap of one": {"gap": 1},
    "gap of two": {"gap": 2},
    "gap of two, separable": {"gap": 2, "separable": True},
    "wide gap": {"gap": 5},
    "thin": {"thin": True},
    "on the floor, separable": {"separable": True, "walls_last": True},
}


@pytest.mark.parametrize("case", SCENES)
@pytest.mark.parametrize("dimension", [2, 3])
def test_as_the_naive_method(dimension, case, device):
    if case == "gap of two, separable" and device != "cpu":
        pytest.skip("lines without pressure, where the rounding of sums decides what is pressed")
    scene = scenes.narrow(dimension, **SCENES[case])
    steps = 40 if dimension == 2 else 6
    spec = scenes.specification(scene)
    machine, naive = scenes.engine(spec, device), LinesReference(spec)
    scenes.advance(machine, steps)
    naive.run(steps)
    for k in range(len(spec["bodies"])):
        expected = naive.velocity(k)[0]
        assert np.abs(scenes.by_id(machine, k, "position") - naive.position[k]).max() < (
            REFERENCE * naive.dx
        )
        assert np.abs(scenes.by_id(machine, k, "velocity") - expected).max() < (
            REFERENCE * np.abs(expected).max()
        )


@pytest.mark.parametrize("sunk", [0, 1, 2, 3])
@pytest.mark.parametrize("other", ["floor", "slab"])
@pytest.mark.parametrize("first", [True, False])
def test_water_rests_beside_a_box_that_stands_on_something(first, other, sunk, device):
    """Its lower face has nothing before it, and takes no node from the floor."""
    dx = 1 / 32
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(1.0, 0.75), gravity=(0, -9.81)
    )
    response = libmpm.boundaries.Separable(cell="linear")
    low = 0.0 if other == "floor" else 4 * dx
    scene.add_body(
        name="water", hydrostatic=0.25 + low, material=libmpm.materials.TaitFluid(bulk_modulus=1e5),
        shape=libmpm.shapes.Box(lower=(0.5, low), upper=(1.0, 0.25 + low)),
    )  # fmt: skip
    post = libmpm.shapes.Box(lower=(0.5 - 3 * dx, low - sunk * dx), upper=(0.5, 0.75))
    parts = {"post": post, "walls": libmpm.shapes.DomainWalls()}
    if other == "slab":
        parts["slab"] = libmpm.shapes.Box(lower=(0.0, 0.0), upper=(1.0, low))
    for name in parts if first else reversed(parts):
        scene.add_boundary(name=name, shape=parts[name], response=response)
    sim = libmpm.Simulation(scene, device=device)
    sim.step(1500)
    water = sim.particles["water"]
    assert np.asarray(water["position"])[:, 1].min() > low + 0.2 * dx
    assert np.abs(np.asarray(water["velocity"])).max() < 3e-3 * np.sqrt(9.81 * 0.25)


def flume(bed, transfer="APIC"):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(2.0, 1.0), gravity=(0.0, -9.81),
        method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=libmpm.shapes.Box(lower=(0.0, 0.3), upper=(2.0, 0.6)),
        material=libmpm.materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    response = libmpm.boundaries.Slip(cell="linear")
    scene.add_boundary(name="walls", shape=libmpm.shapes.DomainWalls(), response=response)
    scene.add_boundary(
        name="bed", shape=libmpm.shapes.HalfSpace(point=(0.0, 0.3), normal=(0.0, 1.0)),
        response=libmpm.boundaries.Slip(cell=bed),
    )  # fmt: skip
    return scene


@pytest.mark.parametrize(
    ("bed", "transfer", "words"),
    [("linear", "APIC", ()), ("held", "APIC", ()), ("linear", "FLIP", ("AFLIP",))],
)
def test_what_failed_in_a_flume_is_said(bed, transfer, words):
    said = [w for w in flume(bed, transfer).plan(until=0.1).warnings if "linear" in w]
    assert bool(said) == bool(words)
    assert all(word in said[0] for word in words)


@pytest.mark.parametrize("height", [0.126, 0.226, 0.28])
@pytest.mark.parametrize("cell", ["held", "linear"])
def test_a_floor_within_the_bed_holds_nothing(height, cell, device):
    """Water that swings above a bed up to 2.8 cells over the floor stays above the bed."""
    bed = libmpm.shapes.HalfSpace(point=(0.0, height), normal=(0.0, 1.0))
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(4.0, 2.5), gravity=(0.0, -9.81)
    )
    within = libmpm.shapes.Box(lower=(0.0, 0.0), upper=(4.0, 2.5))
    scene.add_body(
        name="water", shape=libmpm.shapes.basin(level=1.5, bed=bed, within=within),
        material=libmpm.materials.TaitFluid(bulk_modulus=1e6), hydrostatic=1.5,
        sampling=libmpm.shapes.Columns(), velocity=(0.4, 0.0),
    )  # fmt: skip
    scene.add_boundary(name="bed", shape=bed, response=libmpm.boundaries.Slip(cell=cell))
    walls = libmpm.boundaries.Slip(cell="linear")
    scene.add_boundary(name="walls", shape=libmpm.shapes.DomainWalls(), response=walls)
    simulation = libmpm.Simulation(scene, device=device)
    simulation.run(until=4.0, progress=False)
    lowest = np.asarray(simulation.particles["water"]["position"])[:, 1].min()
    assert lowest > height - 0.05 * scene.cell_size
