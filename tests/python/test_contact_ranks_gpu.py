"""Bodies that touch on several CUDA devices, or several ranks of one device: the bits of one.

The scenes are those of `test_contact_ranks.py`. Expected duration: 120 s on two GPUs, 40 s on one.
"""

# ruff: noqa: F811  the fixture `pair` is imported

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from python.test_contact_ranks import SCENES, assert_alike

import libmpm
from libmpm._src.run.backends import cuda_status
from support import contact_scenes as cases
from support import jobs
from support.devices import pair  # noqa: F401

pytestmark = pytest.mark.gpu

_one: dict[tuple[str, str], libmpm.Simulation] = {}


def devices(ranks: int) -> list[str]:
    """Return so many ranks on the devices that there are."""
    found = len(cuda_status().devices)
    return [f"cuda:{k % found}" for k in range(ranks)]


def one(name: str, precision: str) -> libmpm.Simulation:
    """Return the run on one device, made once."""
    if (name, precision) not in _one:
        make, until, _ = SCENES[name]
        simulation = libmpm.Simulation(make(), device="cuda:0", precision=precision)
        simulation.run(until=until)
        _one[name, precision] = simulation
    return _one[name, precision]


def many(name: str, device: list[str], precision: str, **options: Any) -> libmpm.Simulation:
    """Return a simulation on these devices."""
    return libmpm.Simulation(SCENES[name][0](), device=device, precision=precision, **options)


@pytest.mark.parametrize(
    ("cuts", "precision"),
    [("x", "single"), ("y", "single"), ("curve", "single"), ("curve", "double")],
)
@pytest.mark.parametrize("name", list(SCENES))
def test_bits_of_one(name: str, cuts: str, precision: str, pair: list[str]) -> None:
    simulation = many(name, pair, precision, partition=libmpm.Partition(cuts=cuts))
    assert simulation.ranks == 2
    simulation.run(until=SCENES[name][1])
    assert simulation.engine.statistics()["contact_blocks"] > 0
    assert_alike(one(name, precision), simulation)


@pytest.mark.parametrize("name", ["dominoes", "floating"])
def test_mixed_precision(name: str, pair: list[str]) -> None:
    simulation = many(name, pair, "mixed")
    simulation.run(until=SCENES[name][1])
    assert_alike(one(name, "mixed"), simulation)


@pytest.mark.parametrize("ranks", [3, 4])
@pytest.mark.parametrize("name", ["dominoes", "blows"])
def test_cuts_that_move_at_every_sort(name: str, ranks: int) -> None:
    """Ranks that are neighbours and ranks that are not, on as many devices as there are."""
    partition = libmpm.Partition(cuts="curve", rebalance_above=0)
    simulation = many(name, devices(ranks), "single", partition=partition)
    simulation.run(until=SCENES[name][1])
    told = simulation.engine.statistics()
    assert told["rebalances"] > 0 and told["migrated"] > 0
    assert_alike(one(name, "single"), simulation)


@pytest.mark.parametrize("name", ["dominoes", "floating"])
def test_resumed_on_another_number(tmp_path: Path, name: str, pair: list[str]) -> None:
    until = SCENES[name][1]
    two = many(name, pair, "single")
    two.run(until=0.4 * until)
    two.save_checkpoint(tmp_path / "two.h5")
    three = libmpm.Simulation.resume(tmp_path / "two.h5", device=devices(3))
    three.run(until=0.7 * until)
    three.save_checkpoint(tmp_path / "three.h5")
    last = libmpm.Simulation.resume(tmp_path / "three.h5", device="cuda:0")
    last.run(until=until)
    assert_alike(one(name, "single"), last)


def test_grid_is_that_of_one(pair: list[str]) -> None:
    simulation = many("floating", pair, "double", partition=libmpm.Partition(cuts="x"))
    simulation.run(until=SCENES["floating"][1])
    grids = []
    for s in (one("floating", "double"), simulation):
        place, mass, velocity = (np.asarray(s.grid[n]) for n in ("position", "mass", "velocity"))
        order = np.lexsort(place.T)
        grids.append((place[order], mass[order], velocity[order]))
    for x, y in zip(*grids, strict=True):
        assert np.array_equal(x, y)


def test_row_that_falls_across_the_cut(pair: list[str]) -> None:
    """Bodies of a few blocks each, of which some lie on both sides of the cut."""
    scene = cases.dominoes(12)
    alone = libmpm.Simulation(scene, device="cuda:0", precision="single")
    ranks = libmpm.Simulation(scene, device=pair, precision="single")
    for simulation in (alone, ranks):
        simulation.step(8000)
    assert_alike(alone, ranks)


@pytest.mark.timeout(300)  # of a rank each, that start with their device
def test_processes(tmp_path: Path) -> None:
    """Ranks that are processes tell each other through NCCL what threads read in place."""
    if len(cuda_status().devices) < 2:
        pytest.skip("needs two CUDA devices")
    head = "import os, numpy as np, libmpm\nfrom python.test_contact_ranks import SCENES\n"
    code = """
        for name, (make, until, _) in SCENES.items():
            sim = libmpm.Simulation(make(), device="cuda", ranks="processes", precision="single")
            sim.run(until=until)
            for body in sim.scene.bodies:
                all_of = sim.gather(body.name, "position", "velocity")
                if sim.rank == 0:
                    np.savez(f"{os.environ['FOLDER']}/{name} {body.name}.npz", **all_of)
            if sim.rank == 0:
                values = {n: s.values for n, s in sim.sensors.items()}
                np.savez(f"{os.environ['FOLDER']}/{name} series.npz", **values)
            del sim
    """
    jobs.well(jobs.run(2, jobs.script(head, code), tmp_path))
    for name in SCENES:
        alone = one(name, "single")
        for body in alone.scene.bodies:
            found = np.load(tmp_path / f"{name} {body.name}.npz")
            for attribute in ("position", "velocity"):
                x = cases.by_id(alone, body.name, attribute)
                y = found[attribute][np.argsort(found["id"])]
                assert np.array_equal(x, y), (name, body.name, attribute)
        series = np.load(tmp_path / f"{name} series.npz")
        for sensor in alone.sensors:
            a, b = alone.sensors[sensor].values, series[sensor]
            size = np.nanmax(np.abs(a), initial=0)
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-10 * size, err_msg=sensor)
