"""A row of `contact.py`: 32 bars that a bore brings against a box, drawn apart afterwards."""

from __future__ import annotations

import itertools
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import libmpm
from libmpm import boundaries, contacts, materials, shapes

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support import contact_scenes as cases

Numbers = NDArray[np.float64]

CELL = 0.04  # m
LOG = (0.36, 0.12)  # m, 9 x 3 cells


def bore(touching: bool) -> libmpm.Scene:
    """Return 32 bars in a stack, a bore that carries them against a box, and room behind it."""
    scene = libmpm.Scene(
        dimension=2, cell_size=CELL, lower=(0, 0), upper=(7.6, 2.4), gravity=(0, -9.81)
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(2.4, 1.2)),
        material=materials.TaitFluid(bulk_modulus=4e5), hydrostatic=1.2,
    )  # fmt: skip
    for k in range(32):
        row, place = divmod(k, 8)
        low = np.array([2.6 + 0.44 * place, 0.12 * row])
        scene.add_body(
            name=f"bar {k:02d}", shape=shapes.Box(lower=tuple(low), upper=tuple(low + LOG)),
            material=cases.solid(4e5, 0.3, 600.0),
        )  # fmt: skip
    # With linear cells the lowest bar, on which others lie, is sheared until its energy grows.
    free = boundaries.Separable(static_friction=0.3, dynamic_friction=0.3, cell="held")
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=free)
    box = shapes.Box(lower=(6.12, 0), upper=(6.52, 1.2))
    scene.add_boundary(name="box", shape=box, response=free)
    if touching:
        scene.add_contact(
            name="bars", between=("bar *", "bar *"), law=contacts.Friction(static=0.4)
        )
        scene.add_contact(name="wet", between=("bar *", "water"), law=contacts.Fluid())
    return scene


def nearest(places: dict[str, Numbers]) -> dict[tuple[str, str], float]:
    """Return the distance of the nearest particles of each two bodies, m."""
    trees = {name: cKDTree(x) for name, x in places.items()}
    return {
        (a, b): float(trees[a].query(places[b])[0].min())
        for a, b in itertools.combinations(places, 2)
    }


def bars(touching: bool, until: float = 5.0) -> dict[str, float]:
    """32 bars that a bore has brought against a box; then they are drawn apart, in free space.

    Each is given a velocity in proportion to its place, as a whole, so that the places would grow
    to twice the distance in free flight. Two convex bodies beside each other then have three
    cells, the thickness of a bar, or more between them. They stick where it is less than half.
    """
    dx = CELL
    simulation = libmpm.Simulation(bore(touching), device="cpu", precision="single")
    names = [f"bar {k:02d}" for k in range(32)]
    start = {name: cases.mean(simulation, name, "position") for name in names}
    simulation.run(until=until, progress=False)
    places = {n: np.asarray(simulation.particles[n]["position"], dtype=float) for n in names}
    speeds = [np.linalg.norm(cases.mean(simulation, n, "velocity")) for n in names]
    before = nearest(places)
    # Within a cell of each other: particles lie a quarter of a cell behind their face.
    beside = [pair for pair, gap in before.items() if gap < 1.5 * dx]

    def from_box(x: Numbers) -> float:
        off = np.maximum(np.abs(x - (6.32, 0.6)) - (0.2, 0.6), 0)
        return float(np.linalg.norm(off, axis=1).min())

    middle = np.mean([x.mean(axis=0) for x in places.values()], axis=0)
    rate, room = 0.5, 4.0
    low = dx * np.floor((np.min([x.min(axis=0) for x in places.values()], axis=0) - room) / dx)
    high = dx * np.ceil((np.max([x.max(axis=0) for x in places.values()], axis=0) + room) / dx)
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=tuple(low), upper=tuple(high))
    folder = Path(tempfile.mkdtemp())
    for name, x in places.items():
        file = folder / f"{name}.csv"
        np.savetxt(file, x, delimiter=",", header="x,y", comments="")
        scene.add_body(
            name=name, shape=shapes.PointFile(file=str(file), volume=LOG[0] * LOG[1]),
            material=cases.solid(4e5, 0.3, 600.0),
            velocity=tuple(rate * (x.mean(axis=0) - middle)),
        )  # fmt: skip
    if touching:
        scene.add_contact(
            name="bars", between=("bar *", "bar *"), law=contacts.Friction(static=0.4)
        )
    drawn = libmpm.Simulation(scene, device="cpu", precision="single")
    drawn.run(until=1 / rate, progress=False)
    after = nearest({n: np.asarray(drawn.particles[n]["position"], dtype=float) for n in names})
    opened = [(after[pair] - before[pair]) / dx for pair in beside]
    return {
        "carried": float(np.mean([places[n].mean(axis=0)[0] - start[n][0] for n in names])),
        "fastest": float(max(speeds)),
        "at_box": float(sum(from_box(x) < 2 * dx for x in places.values())),
        "nearest": min(before.values()) / dx,
        "beside": float(len(beside)),
        "stick": float(sum(gap < 1.5 for gap in opened)),
        "least_opened": float(min(opened)),
        "mean_opened": float(np.mean(opened)),
    }
