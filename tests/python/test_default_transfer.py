"""The transfer of scenes that name none: by what they weigh.

Expected duration: 5 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, methods, sensors, shapes

LOADS = methods.Transfer(scheme="AFLIP", flip=0.95)
PLAIN = methods.Transfer()


def pool(response=None, weighed=True, material=None, **given):
    """Return a little of something before a wall that is weighed, or not."""
    scene = libmpm.Scene(
        dimension=2,
        cell_size=0.1,
        lower=(0.0, 0.0),
        upper=(1.0, 0.8),
        gravity=(0.0, -9.81),
        **given,
    )
    scene.add_body(
        name="body", shape=shapes.Box(lower=(0.0, 0.0), upper=(0.4, 0.4)),
        material=material or materials.TaitFluid(bulk_modulus=1e5),
    )  # fmt: skip
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=response or boundaries.Slip()
    )
    if weighed:
        scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.01))
    return scene


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, LOADS),
        ({"weighed": False}, PLAIN),
        (
            {
                "material": materials.NeoHookean(
                    density=900.0, youngs_modulus=1e5, poissons_ratio=0.3
                )
            },
            PLAIN,
        ),
        ({"response": boundaries.Mirror()}, PLAIN),
        ({"method": libmpm.Method(kernel="cubic")}, PLAIN),
        ({"method": libmpm.Method(transfer="APIC")}, PLAIN),
        ({"method": libmpm.Method(transfer="FLIP")}, methods.Transfer(scheme="FLIP")),
    ],
)
def test_is_chosen_by_what_is_weighed(given, expected):
    assert pool(**given).transfer == expected


def test_runs_as_the_one_that_is_named():
    """The same bits; a file of the scene still leaves the choice to the scene."""
    runs = [pool(), pool(method=libmpm.Method(transfer=LOADS))]
    runs.append(libmpm.Scene.from_dict(runs[0].to_dict()))
    assert runs[0].to_dict()["method"]["transfer"] is None
    sims = [libmpm.Simulation(scene, device="cpu") for scene in runs]
    for sim in sims:
        sim.step(50)
    first = sims[0].particles["body"]
    for sim in sims[1:]:
        for name in ("position", "velocity"):
            assert np.array_equal(first[name], sim.particles["body"][name])


def test_a_branch_keeps_what_its_run_had(tmp_path):
    """What is weighed from then on does not change what particles carry."""
    sim = libmpm.Simulation(pool(weighed=False), device="cpu")
    sim.step(10)
    sim.save_checkpoint(tmp_path / "at.npz")
    branch = libmpm.Scene.from_checkpoint(tmp_path / "at.npz")
    branch.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.01))
    assert branch.transfer == PLAIN
