"""The transfer of scenes that name none: by what flows, and past what.

Expected duration: 5 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, methods, sensors, shapes

FLOWS = methods.Transfer(scheme="AFLIP", flip=0.99)
GRAINS = methods.Transfer(scheme="AFLIP", flip=0.95)
PLAIN = methods.Transfer()


def pool(response=None, structure=True, material=None, bed=None, moves=False, **given):
    """Return a little of something that falls over before a pier, or without."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.6, 0.8), gravity=(0.0, -9.81),
        **given,
    )  # fmt: skip
    scene.add_body(
        name="body", shape=shapes.Box(lower=(0.0, 0.0), upper=(0.4, 0.4)),
        material=material or materials.TaitFluid(bulk_modulus=1e5),
    )  # fmt: skip
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=response or boundaries.Slip()
    )
    if structure:
        pier = shapes.Box(lower=(0.8, 0.0), upper=(1.0, 0.5))
        scene.add_boundary(name="pier", shape=pier, response=boundaries.Separable())
    if bed is not None:
        scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
    if moves:
        away = shapes.Box(lower=(1.2, 0.0), upper=(1.4, 0.8))
        motion = boundaries.Travel((0.1, 0.0))
        scene.add_boundary(name="gate", shape=away, response=boundaries.Slip(), motion=motion)
    return scene


def solid():
    return materials.NeoHookean(density=900.0, youngs_modulus=1e5, poissons_ratio=0.3)


def sand():
    return materials.DruckerPrager(density=1600.0, youngs_modulus=1e6, poissons_ratio=0.3)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, FLOWS),
        ({"structure": False}, PLAIN),
        ({"structure": False, "bed": shapes.Box(lower=(-1.0, -1.0), upper=(2.0, 0.1))}, PLAIN),
        ({"structure": False, "bed": shapes.HalfSpace(point=(0, 0.1), normal=(-0.1, 1))}, PLAIN),
        ({"structure": False, "bed": shapes.Sphere(centre=(1.0, 0.1), radius=0.2)}, FLOWS),
        ({"structure": False, "moves": True}, PLAIN),
        ({"material": solid()}, PLAIN),
        ({"material": sand()}, GRAINS),
        ({"material": sand(), "structure": False}, GRAINS),
        ({"material": sand(), "response": boundaries.Mirror()}, PLAIN),
        ({"response": boundaries.Mirror()}, PLAIN),
        ({"method": libmpm.Method(kernel="cubic")}, PLAIN),
        ({"method": libmpm.Method(transfer="APIC")}, PLAIN),
        ({"method": libmpm.Method(transfer="FLIP")}, methods.Transfer(scheme="FLIP")),
    ],
)
def test_is_chosen_by_what_there_is(given, expected):
    assert pool(**given).transfer == expected


def test_runs_as_the_one_that_is_named():
    """The same bits, weighed or not; a file of the scene still leaves the choice to the scene."""
    runs = [pool(), pool(method=libmpm.Method(transfer=FLOWS))]
    runs.append(libmpm.Scene.from_dict(runs[0].to_dict()))
    runs[2].add_sensor(name="load", sensor=sensors.LoadCell(boundary="pier", interval=0.01))
    assert runs[0].to_dict()["method"]["transfer"] is None
    sims = [libmpm.Simulation(scene, device="cpu") for scene in runs]
    for sim in sims:
        sim.step(50)
    first = sims[0].particles["body"]
    for sim in sims[1:]:
        for name in ("position", "velocity"):
            assert np.array_equal(first[name], sim.particles["body"][name])


def test_a_branch_keeps_what_its_run_had(tmp_path):
    """A structure that is added does not change what particles carry."""
    sim = libmpm.Simulation(pool(structure=False), device="cpu")
    sim.step(10)
    sim.save_checkpoint(tmp_path / "at.npz")
    branch = libmpm.Scene.from_checkpoint(tmp_path / "at.npz")
    pier = shapes.Box(lower=(0.8, 0.0), upper=(1.0, 0.5))
    branch.add_boundary(name="pier", shape=pier, response=boundaries.Separable())
    assert branch.transfer == PLAIN
