"""Trunks and branches: scenes that go on from a checkpoint, and how their runs are compared."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from support.tolerances import ROUNDING

BACKENDS = pytest.mark.parametrize(
    ("device", "precision"),
    [("cpu", "single"), ("cpu", "double")]
    + [pytest.param("cuda", p, marks=pytest.mark.gpu) for p in ("single", "mixed", "double")],
    indirect=["device"],
)
DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])

DX, WIDTH = 0.05, 0.1  # m; WIDTH across the flow, in 3D
BULK, DENSITY = 5e5, 1000.0
SOUND = (BULK / DENSITY) ** 0.5
FORMS: dict[str, Any] = {
    "none": None,
    "one-volume": libmpm.FBar(form="one-volume"),
    "one-volume-gradient": libmpm.FBar(),
    "two-volume": libmpm.FBar(form="two-volume", length=2 * DX),
    "stress-only": libmpm.FBar(form="stress-only"),
}
WATER = materials.TaitFluid(density=DENSITY, bulk_modulus=BULK)
WOOD = materials.FixedCorotated(density=700.0, youngs_modulus=2e5, poissons_ratio=0.3)
METAL = materials.VonMises(
    density=1500.0, youngs_modulus=2e5, poissons_ratio=0.3, yield_stress=500.0
)
SAND = materials.DruckerPrager(
    density=1500.0, youngs_modulus=2e5, poissons_ratio=0.3, friction_angle=30.0
)
#: Slices one cell thick are asked for.
THIN = pytest.mark.filterwarnings("ignore:.*thick on axis 1.*:libmpm.ModelWarning")


def box(dimension: int, low: tuple[float, float], high: tuple[float, float]) -> shapes.Box:
    """A box in the plane of the flow, across all of the width in 3D."""
    if dimension == 2:
        return shapes.Box(lower=low, upper=high)
    return shapes.Box(lower=(low[0], 0.0, low[1]), upper=(high[0], WIDTH, high[1]))


def surge(
    dimension: int = 2, *, fbar: Any = "default", solid: Any = WOOD, faces: Any = "all",
    leaving: str = "stop", transfer: Any = "APIC",
) -> libmpm.Scene:  # fmt: skip
    """A column of water that collapses over a solid; load cell and energy watch."""
    flat = dimension == 2
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=(1.6, 0.8) if flat else (1.6, WIDTH, 0.8),
        gravity=(0.0, -9.81) if flat else (0.0, 0.0, -9.81),
        method=libmpm.Method(leaving=leaving, transfer=transfer),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=box(dimension, (0.0, 0.0), (0.5, 0.4)), material=WATER, fbar=fbar
    )
    if solid is not None:
        scene.add_body(
            name="solid",
            shape=box(dimension, (0.65, 0.0), (0.85, 0.15)),
            material=solid,
            velocity=(-0.5,) + (0.0,) * (dimension - 1),
        )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=faces), response=boundaries.Slip()
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.017))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
    return scene


def simulate(scene: libmpm.Scene, device: str = "cpu", precision: str = "double", **changes: Any):
    return libmpm.Simulation(scene, device=device, precision=precision, threads=1, **changes)


def saved(sim: libmpm.Simulation, folder: Path, name: str = "trunk.npz") -> Path:
    sim.save_checkpoint(folder / name)
    return folder / name


def add_far(scene: libmpm.Scene, name: str = "far", material: Any = WOOD, at: float = 1.2) -> None:
    """A block in the air where nothing is near it."""
    shape = box(scene.dimension, (at, 0.6), (at + 0.2, 0.7))
    scene.add_body(name=name, shape=shape, material=material)


def trunk_and_scene(folder: Path, steps: int = 60, **arguments: Any):
    """A trunk on the CPU after some steps, and the scene that goes on from it."""
    trunk = simulate(surge(**arguments))
    trunk.step(steps)
    return trunk, libmpm.Scene.from_checkpoint(saved(trunk, folder))


def assert_same(a: libmpm.Simulation, b: libmpm.Simulation) -> None:
    """Bit for bit: time, all that particles have, all samples of the sensors of `a`."""
    assert (a.time, a.steps, a.dt) == (b.time, b.steps, b.dt)
    for body, view in a.particles.items():
        assert view.names == b.particles[body].names
        for name in view.names:
            np.testing.assert_array_equal(view[name], b.particles[body][name], f"{body} {name}")
    for name, series in a.sensors.items():
        np.testing.assert_array_equal(series.time, b.sensors[name].time, name)
        np.testing.assert_array_equal(series.values, b.sensors[name].values, name)


def assert_close(a, b, device: str, precision: str, steps: int, bodies=()) -> None:
    """The bodies of `a`, or those named, move in `b` as in `a`, but for rounding.

    Other orders of addition, from the start on: on the CPU relative to the largest value, on CUDA
    in parts of a cell and of the speed of sound a step, as its fixed-point sums round.
    """
    names = ("position", "velocity", "volume_ratio")
    for body, name in product(bodies or a.particles, names):
        first, second = a.particles[body][name], b.particles[body][name]
        if device == "cpu":
            bound = (20 if precision == "double" else 3) * ROUNDING[precision]
            bound *= np.abs(first).max()
        else:
            each = 1e-10 if precision == "double" else 1e-6 * steps
            bound = each * {"position": DX, "velocity": SOUND, "volume_ratio": 1.0}[name]
        assert np.abs(first - second).max() <= bound, (body, name)


def nodes(sim: libmpm.Simulation) -> dict[tuple[int, ...], tuple[float, np.ndarray]]:
    """Mass, kg, and momentum before gravity and walls, kg m/s, of every node with mass."""
    sums = sim.engine.sums()
    momentum = [sums[f"momentum_{a}"] for a in "xyz"[: sim.dimension]]
    return {
        tuple(cell): (mass, np.array(p))
        for cell, mass, *p in zip(sums["cell"].tolist(), sums["mass"], *momentum, strict=True)
    }


def weights(position: np.ndarray) -> list[list[tuple[tuple[int, ...], float, np.ndarray]]]:
    """For every particle its nodes, quadratic weights and the way from particle to node, m."""
    found = []
    for x in position / DX:
        home, rows = np.floor(x).astype(int), []
        for shift in product((-1, 0, 1), repeat=len(x)):
            node = home + shift
            way = node + 0.5 - x
            w = np.where(np.abs(way) < 0.5, 0.75 - way**2, 0.5 * (1.5 - np.abs(way)) ** 2)
            rows.append((tuple(node.tolist()), float(w.prod()), way * DX))
        found.append(rows)
    return found


def alike() -> libmpm.Scene:
    """Three blocks that are stepped as one, each with a velocity of its own."""
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0, 0), upper=(4, 1), gravity=(0.0, -9.81)
    )
    for k in range(3):
        add_alike(scene, k)
    return scene


def add_alike(scene: libmpm.Scene, k: int) -> None:
    scene.add_body(
        name=f"block {k}",
        shape=shapes.Box(lower=(0.25 + 0.5 * k, 0.6), upper=(0.45 + 0.5 * k, 0.8)),
        material=WOOD,
        velocity=(0.2 * k, 0.0),
    )


def flume(
    cells: int, *, fbar: Any = "default", tracked: int | None = None, transfer: Any = "APIC"
) -> libmpm.Scene:  # fmt: skip
    """A flume `cells` wide with water, a block of sand and a step; not at the origin."""
    wide = 0.1 + cells * DX

    def across(low: tuple[float, float], high: tuple[float, float]) -> shapes.Box:
        return shapes.Box(lower=(low[0], 0.1, low[1]), upper=(high[0], wide, high[1]))

    scene = libmpm.Scene(
        dimension=3, cell_size=DX, lower=(0.0, 0.1, 0.0), upper=(0.8, wide, 0.5),
        origin=(5.0, 6.0, 7.0), gravity=(0.0, 0.0, -9.81),
        method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    scene.add_body(name="water", shape=across((0.0, 0.0), (0.3, 0.3)), material=WATER, fbar=fbar)
    scene.add_body(name="sand", shape=across((0.35, 0.0), (0.5, 0.1)), material=SAND)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_boundary(
        name="step", shape=across((0.65, 0.0), (0.8, 0.1)), response=boundaries.Slip()
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", faces=("x-",)))
    if tracked is not None:
        ids = (tracked, tracked + 1)
        scene.add_sensor(name="track", sensor=sensors.ParticleTracker(body="sand", ids=ids))
    return scene


def turned(dimension: int) -> shapes.OrientedBox:
    """A box in the flowing water."""
    if dimension == 2:
        return shapes.OrientedBox(centre=(0.25, 0.15), size=(0.22, 0.12), angle=25.0)
    return shapes.OrientedBox(
        centre=(0.25, 0.05, 0.15), size=(0.22, 0.1, 0.12), angle=25.0, axis="y"
    )
