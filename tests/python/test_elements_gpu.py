"""Bodies of elements on CUDA devices: the CPU's numbers, and on several ranks the bits of one.

The scenes are those of `test_element_ranks.py`. Expected duration: 60 s on two GPUs, 40 s on one.
"""

# ruff: noqa: F811  the fixture `pair` is imported

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from python.test_element_ranks import SCENES, assert_alike
from python.test_pins import TRANSFERS, by

import libmpm
from libmpm import materials, sensors, shapes
from libmpm._src.run.backends import cuda_status
from libmpm.grids import Pin
from support.devices import pair  # noqa: F401
from support.element_pins import bar as pinned_bar
from support.element_pins import moved

pytestmark = pytest.mark.gpu

#: Of places over the cell, velocities and stresses over the largest of any body: of the same steps
#: as the CPU's. The heap meets by contact, which branches before its last step.
CLOSE = {"double": 1e-7, "mixed": 2e-3, "single": 2e-3}
BEFORE_BRANCHES = {"beam": 400, "heap": 60, "bar": 120}
STEPS = {name: steps for name, (_, steps, _) in SCENES.items()}

_one: dict[tuple[str, str, str, int], libmpm.Simulation] = {}


def made(name: str, device: Any, precision: str, **options: Any) -> libmpm.Simulation:
    """Return a simulation of the scene."""
    return libmpm.Simulation(SCENES[name][0](), device=device, precision=precision, **options)


def one(name: str, device: str, precision: str, steps: int = 0) -> libmpm.Simulation:
    """Return the run on one device, made once."""
    key = (name, device, precision, steps or STEPS[name])
    if key not in _one:
        _one[key] = made(name, device, precision)
        _one[key].step(key[-1])
    return _one[key]


def devices(ranks: int) -> list[str]:
    """Return so many ranks on the devices that there are."""
    found = len(cuda_status().devices)
    return [f"cuda:{k % found}" for k in range(ranks)]


@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
@pytest.mark.parametrize("name", SCENES)
def test_numbers_of_the_cpu(name: str, precision: str) -> None:
    steps = BEFORE_BRANCHES[name]
    expected, found = one(name, "cpu", "double", steps), one(name, "cuda:0", precision, steps)
    close, dx = CLOSE[precision], expected.scene.cell_size
    assert found.time == pytest.approx(expected.time, rel=1e-4 if precision != "double" else 1e-9)
    of_elements = ("velocity", "element_stress", "element_pressure", "element_energy")
    largest = {
        attribute: max(np.abs(p[attribute]).max() for p in expected.particles.values()
                       if attribute in p.names) for attribute in of_elements
    }  # fmt: skip
    for body in expected.particles:
        a, b = expected.particles[body], found.particles[body]
        assert a.names == b.names
        far = np.abs(a["position"] - b["position"]).max(axis=1) / dx
        # Single particles of a splash go their own ways.
        assert np.quantile(far, 0.99 if "element_stress" not in a.names else 1.0) < close, body
        if "element_stress" not in a.names:
            continue
        for attribute, size in largest.items():
            assert size > 0
            error = np.abs(a[attribute] - b[attribute]).max() / size
            assert error < 30 * close, (body, attribute)
    for placed in expected.scene.sensors:
        a, b = (s.sensors[placed.name] for s in (expected, found))
        n = min(len(a.time), len(b.time))
        assert abs(len(a.time) - len(b.time)) <= 1 and n > 2
        size = np.abs(a.values[:n]).max() + (placed.name == "load posts")  # they have not met yet
        assert np.abs(a.values[:n] - b.values[:n]).max() < 30 * close * size, placed.name


@pytest.mark.parametrize("scheme", TRANSFERS)
def test_pins(scheme: str) -> None:
    """Held and driven vertices are where their pins are, and these are pushed as on the CPU.

    Two ranks that share the vertices of both pins have the bits of one.
    """
    found = []
    for device in ("cpu", "cuda", devices(2)):
        cut = libmpm.Partition(cuts="y", rebalance_above=None) if len(device) == 2 else None
        pins = (Pin(face="x-"), Pin(face="x+", motion=moved(0.01, [0.004, -0.002])))
        scene = pinned_bar(2, pins, gravity=(0.0, -9.81), method=by(scheme))
        for k in (0, 1):
            sensor = sensors.PinForce(body="bar", pin=k, interval=5e-4)
            scene.add_sensor(name=f"pin {k}", sensor=sensor)
        sim = libmpm.Simulation(
            scene, device=device, precision="double", time_step=1e-4, partition=cut
        )
        rest = in_order(sim)
        first, last = (np.abs(rest[:, 0] - x) < 1e-9 for x in (rest[:, 0].min(), rest[:, 0].max()))
        sim.step(201)
        now = in_order(sim) - rest
        assert np.abs(now[first]).max() < 1e-12
        assert now[last] == pytest.approx(np.tile([0.004, -0.002], (last.sum(), 1)), abs=1e-9)
        found.append([now, *(sim.sensors[f"pin {k}"].values[1:] for k in (0, 1))])
    for a, b, c in zip(*found, strict=True):
        assert np.abs(a - b).max() < 1e-7 * np.abs(a).max()
        np.testing.assert_array_equal(b, c)


def in_order(sim: libmpm.Simulation) -> np.ndarray:
    """Return places of the bar's vertices by their ids."""
    read = sim.particles["bar"].read(["id", "position"])
    return read["position"][np.argsort(read["id"])]


def test_same_bits_again_and_resumed(tmp_path: Path) -> None:
    """Whatever the scheduling, and through a checkpoint; also through the CPU's memory."""
    for name in SCENES:
        again = made(name, "cuda:0", "single")
        again.step(STEPS[name] // 2)
        again.save_checkpoint(tmp_path / name)
        resumed = libmpm.Simulation.resume(tmp_path / name, device="cuda:0")
        resumed.step(STEPS[name] - STEPS[name] // 2)
        assert_alike(one(name, "cuda:0", "single"), resumed, series=False)


@pytest.mark.parametrize("name", SCENES)
def test_bits_of_one(name: str, pair: list[str]) -> None:
    simulation = made(name, pair, "single", partition=libmpm.Partition(cuts="x"))
    assert simulation.ranks == 2
    simulation.step(STEPS[name])
    assert simulation.engine.statistics()["bytes_of_vertices"] > 0
    assert_alike(one(name, "cuda:0", "single"), simulation)


@pytest.mark.parametrize("ranks", [3, 4])
@pytest.mark.parametrize("name", ["heap", "bar"])
def test_cuts_that_move_at_every_sort(name: str, ranks: int) -> None:
    partition = libmpm.Partition(cuts="curve", rebalance_above=0)
    simulation = made(name, devices(ranks), "single", partition=partition)
    simulation.step(STEPS[name])
    assert simulation.engine.statistics()["migrated"] > 0
    assert_alike(one(name, "cuda:0", "single"), simulation)


def test_resumed_on_another_number(tmp_path: Path) -> None:
    two = made("bar", devices(2), "single")
    two.step(40)
    two.save_checkpoint(tmp_path / "two")
    three = libmpm.Simulation.resume(tmp_path / "two", device=devices(3))
    three.step(STEPS["bar"] - 40)
    assert_alike(one("bar", "cuda:0", "single"), three, series=False)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_crushed_element_is_named(ranks: int) -> None:
    """As on the CPU: the element, its vertices, and no number that is none."""
    scene = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(1.2, 0.6))
    soft = materials.NeoHookean(density=1000, youngs_modulus=1e3, poissons_ratio=0.0)
    mesh = shapes.Triangles.box(lower=(0.3, 0.2), upper=(0.7, 0.4), edge=0.025)
    crush = moved(0.3, [-0.45, 0.0])
    scene.add_body(name="soft", shape=mesh, material=soft,
                   pins=(Pin(face="x-"), Pin(face="x+", motion=crush)))  # fmt: skip
    said = []
    for device in ("cpu", devices(ranks) if ranks > 1 else "cuda"):
        sim = libmpm.Simulation(scene, device=device, precision="double")
        with pytest.raises(libmpm.NumericalError, match="element") as error:
            sim.run(until=0.4, progress=False)
        assert np.isfinite(sim.particles["soft"]["position"]).all()
        said.append(str(error.value))
    named = [re.search(r"element (\d+) of vertices ([\d, ]+) has shrunk", text) for text in said]
    assert named[0] and named[1] and named[0].groups() == named[1].groups()


def test_energy_is_that_of_the_cpu() -> None:
    """Kinetic, elastic and potential energy of a body that swings, particles beside it."""
    for name in ("beam",):
        a, b = (one(name, d, "double").sensors["energy"] for d in ("cpu", "cuda:0"))
        for column in ("kinetic", "elastic"):
            assert np.abs(a[column]).max() > 0
            assert np.abs(a[column] - b[column]).max() < 1e-7 * np.abs(a[column]).max()
