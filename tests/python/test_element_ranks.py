"""Bodies of elements on several ranks of the CPU: the bits of one, wherever and however it is cut.

Expected duration: 15 s.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes
from libmpm._src.output import frames
from support import jobs
from support.element_cases import at_rest
from support.element_load_cases import ramp


def beam() -> libmpm.Scene:
    """Return a beam that one end's nodes hold, the other's pull, and a traction bends."""
    dx = 0.025
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(1.4, 0.6))
    load = libmpm.grids.Traction(
        face="y+", value=ramp((0.0, -4e3), 0.1),
        within=shapes.Box(lower=(0.5, 0.34), upper=(0.8, 0.36)),
    )  # fmt: skip
    mesh = shapes.Triangles.box(lower=(0.1, 0.25), upper=(1.2, 0.35), edge=dx / 2, volumes="vertex")
    scene.add_body(
        name="beam", shape=mesh, tractions=(load,),
        material=materials.NeoHookean(density=1000, youngs_modulus=1e6, poissons_ratio=0.45),
    )  # fmt: skip
    scene.add_boundary(
        name="clamp", shape=shapes.Box(lower=(0.1, 0.2), upper=(0.15, 0.4)), motion=at_rest(2),
        response=boundaries.Prescribed(),
    )  # fmt: skip
    scene.add_boundary(
        name="drive", shape=shapes.Box(lower=(1.15, 0.2), upper=(1.25, 0.4)),
        motion=libmpm.TimeTable([0, 0.02, 1], [[0, 0], [0.05, 0.1], [0.05, 0.1]], end="hold"),
        response=boundaries.Prescribed(),
    )  # fmt: skip
    for held in ("clamp", "drive"):
        cell = sensors.LoadCell(boundary=held, interval=2e-3)
        scene.add_sensor(name=f"load on {held}", sensor=cell)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=2e-3))
    for attribute, operation in (("element_von_mises", "max"), ("element_energy", "sum")):
        of_elements = sensors.ParticleSensor(
            body="beam", attribute=attribute, operation=operation, interval=5e-3
        )
        scene.add_sensor(name=attribute, sensor=of_elements)
    return scene


def heap() -> libmpm.Scene:
    """Return three copies of a mesh and one of sand, over water that a wall throws at them."""
    dx = 0.02
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(1.2, 0.6), gravity=(0, -9.81)
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(0.4, 0.2)),
        material=materials.TaitFluid(density=1000, bulk_modulus=4e5), velocity=(2.0, 0),
    )  # fmt: skip
    timber = materials.FixedCorotated(density=600, youngs_modulus=2e5, poissons_ratio=0.3)
    for k in range(3):
        low = (0.44 + 0.18 * k, 0.05)
        mesh = shapes.Triangles.box(lower=low, upper=(low[0] + 0.08, 0.25), edge=dx)
        scene.add_body(name=f"post {k}", shape=mesh, material=timber, velocity=(-0.5 * k, 0))
    sand = materials.DruckerPrager(
        density=1600, youngs_modulus=2e5, poissons_ratio=0.3, friction_angle=30, cohesion=500
    )
    mesh = shapes.Triangles.box(lower=(0.3, 0.3), upper=(0.7, 0.4), edge=dx / 2)
    scene.add_body(name="sand", shape=mesh, material=sand, velocity=(1.0, -1.0))
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    scene.add_contact(name="wet", between=("water", "post *"), law=contacts.Fluid(fill=0.7))
    scene.add_contact(name="posts", between=("post *", "post *"), law=contacts.Friction(static=0.3))
    scene.add_contact(name="sand", between=("sand", "post *"), law=contacts.Friction(static=0.3))
    for name in ("wet", "posts"):
        load = sensors.ContactLoad(contact=name, interval=2e-3)
        scene.add_sensor(name=f"load {name}", sensor=load)
    return scene


def bar() -> libmpm.Scene:
    """Return a bar in space that flows where it strikes a wall, one of particles beside it."""
    dx = 0.05
    scene = libmpm.Scene(dimension=3, cell_size=dx, lower=(0, 0, 0), upper=(1.4, 0.6, 0.6))
    metal = materials.VonMises(
        density=1000, youngs_modulus=1e6, poissons_ratio=0.3, yield_stress=1e4
    )
    mesh = shapes.Tetrahedra.box(lower=(0.1, 0.1, 0.1), upper=(0.9, 0.3, 0.3), edge=dx)
    scene.add_body(name="bar", shape=mesh, material=metal, velocity=(-3, 0.5, 0))
    scene.add_body(
        name="grains", shape=shapes.Box(lower=(0.9, 0.3, 0.3), upper=(1.2, 0.5, 0.5)),
        material=metal, velocity=(-3, 0, 0),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=2e-3))
    return scene


#: Scene, steps and precision.
SCENES: dict[str, tuple[Callable[[], libmpm.Scene], int, str]] = {
    "beam": (beam, 400, "double"),
    "heap": (heap, 300, "single"),
    "bar": (bar, 120, "single"),
}

_one: dict[str, libmpm.Simulation] = {}


def one(name: str) -> libmpm.Simulation:
    """Return the run on one rank, made once."""
    if name not in _one:
        make, steps, precision = SCENES[name]
        _one[name] = libmpm.Simulation(make(), device="cpu", precision=precision, threads=1)
        _one[name].step(steps)
    return _one[name]


def many(name: str, ranks: int, **options: Any) -> libmpm.Simulation:
    """Return a simulation of so many ranks, of a thread each."""
    make, _, precision = SCENES[name]
    return libmpm.Simulation(
        make(), device=["cpu"] * ranks, precision=precision, threads=ranks, **options
    )


def assert_alike(a: libmpm.Simulation, b: libmpm.Simulation, series: bool = True) -> None:
    """Compare all that particles, vertices and elements have, to the bit; series to rounding."""
    assert (a.time, a.steps) == (b.time, b.steps)
    for body in a.particles:
        names = a.particles[body].names
        assert names == b.particles[body].names
        x, y = (s.particles[body].read(names) for s in (a, b))
        for attribute in names:
            assert np.array_equal(x[attribute], y[attribute]), (body, attribute)
    for placed in a.scene.sensors if series else ():
        x, y = (s.sensors[placed.name] for s in (a, b))
        assert np.array_equal(x.time, y.time)
        size = np.abs(x.values).max()
        assert size > 0
        np.testing.assert_allclose(
            x.values, y.values, rtol=0, atol=1e-9 * size, err_msg=placed.name
        )


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize(("ranks", "cuts"), [(2, "x"), (3, "curve"), (4, "curve")])
def test_bits_of_one(name: str, ranks: int, cuts: str) -> None:
    simulation = many(name, ranks, partition=libmpm.Partition(cuts=cuts))
    simulation.step(SCENES[name][1])
    assert simulation.engine.statistics()["bytes_of_vertices"] > 0
    assert_alike(one(name), simulation)


@pytest.mark.parametrize("name", ["heap", "bar"])
def test_cuts_that_move_at_every_sort(name: str) -> None:
    simulation = many(name, 3, partition=libmpm.Partition(cuts="curve", rebalance_above=0))
    simulation.step(SCENES[name][1])
    told = simulation.engine.statistics()
    assert told["rebalances"] > 0 and told["migrated"] > 0
    assert_alike(one(name), simulation)


def test_scenes_say_what_they_mean() -> None:
    """Elements have flowed, copies are stepped together, and loads are carried."""
    assert one("bar").particles["bar"]["element_plastic_strain"].max() > 0.01
    assert one("heap").particles["sand"]["element_plastic_strain"].max() > 1e-3
    assert "bytes_of_vertices" not in one("heap").engine.statistics()
    assert np.ptp(one("beam").particles["beam"]["position"][:, 1]) > 0.11


@pytest.mark.parametrize("name", ["beam", "bar"])
def test_resumed_on_another_number(tmp_path: Path, name: str) -> None:
    steps = SCENES[name][1]
    three = many(name, 3)
    three.step(steps // 3)
    three.save_checkpoint(tmp_path / "three.h5")
    two = libmpm.Simulation.resume(tmp_path / "three.h5", device=["cpu", "cpu"])
    two.step(steps // 3)
    two.save_checkpoint(tmp_path / "two.h5")
    last = libmpm.Simulation.resume(tmp_path / "two.h5", device="cpu")
    last.step(steps - 2 * (steps // 3))
    assert_alike(one(name), last, series=False)


def test_processes(tmp_path: Path) -> None:
    """What is gathered, written and saved by processes is that of one, meshes in one file."""
    head = "import os, numpy as np, libmpm\nfrom python.test_element_ranks import SCENES\n"
    code = """
        folder = os.environ["FOLDER"]
        make, steps, precision = SCENES["bar"]
        output = libmpm.Output(
            folder + "/run", frame_interval=0.01, checkpoint_interval=0.01,
            attributes={"bar": ("element_stress", "element_plastic_strain", "stress", "velocity")})
        sim = libmpm.Simulation(
            make(), device="cpu", ranks="processes", threads=1, precision=precision, output=output)
        sim.run(until=0.02)
        mine = sim.particles["bar"]
        here = np.isfinite(mine["element_energy"]).sum()
        assert 0 < here < len(mine["element_energy"])
        names = ("position", "velocity", "element_stress", "element_plastic_strain")
        found = sim.gather("bar", *names)
        if found is not None:
            np.savez(folder + "/bar.npz", **found)
        assert sum(sim._shared.link.tell(int(here))) == len(mine["element_energy"])
    """
    make, _, precision = SCENES["bar"]
    output = libmpm.Output(
        tmp_path / "one", frame_interval=0.01,
        attributes={"bar": ("element_stress", "element_plastic_strain", "stress", "velocity")},
    )  # fmt: skip
    alone = libmpm.Simulation(make(), device="cpu", precision=precision, threads=1, output=output)
    alone.run(until=0.02, progress=False)
    jobs.well(jobs.run(2, jobs.script(head, code), tmp_path))
    found = np.load(tmp_path / "bar.npz")
    own = alone.gather("bar", *[n for n in found.files if n != "id"])
    assert own is not None
    for name in found.files:
        assert np.array_equal(found[name], own[name]), name
    listed = [
        frames.list_frames(folder / "frames")["bar"]
        for folder in (tmp_path / "one", tmp_path / "run")
    ]
    assert listed[0].keys() == listed[1].keys() and len(listed[0]) > 1
    for index, path in listed[0].items():
        x, y = (frames.read_frame(f)[0] for f in (path, listed[1][index]))
        assert x.keys() == y.keys()
        assert all(np.array_equal(x[name], y[name]) for name in x), index
        with h5py.File(path) as a, h5py.File(listed[1][index]) as b:
            for name in ("Connectivity", "Points"):
                assert np.array_equal(a[f"VTKHDF/{name}"][:], b[f"VTKHDF/{name}"][:])
    again = libmpm.Simulation.resume(tmp_path / "run", device="cpu")
    again.run(until=0.03, progress=False)
    alone.run(until=0.03, progress=False)
    assert_alike(alone, again, series=False)


def test_plan_says_ranks() -> None:
    plan = beam().plan(device=["cpu", "cpu"])
    assert plan.ranks == 2
    assert plan.elements == one("beam").plan.elements
