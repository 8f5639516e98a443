"""Loads and flows beside walls, by the wall's cell and the transfer, in finer and finer cells.

    python benchmarks/wall_loads.py [--cases gate bore deck basin]   20 minutes on one thread
    python benchmarks/wall_loads.py --write              and the tables of docs/boundaries.md

gate   the stream under a raised gate, of the discharge by the energy equation (contraction 0.61)
bore   the force on a piston that drives a bore, of ½ ρ g h₂² with h₂ by mass and momentum
deck   the force of a dam's bore on a deck one tenth of the dam thick, N/m, by modulus
basin  water at rest over a bed of 10, 30 and 45 degrees: speed, of √(g h), after 20,000 steps

All in the plane, single precision. One JSON line a run goes to benchmarks/results/wall_loads.jsonl;
what the file has is not run again.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from result_pages import Line, append, filled, load, markdown

import libmpm
from libmpm import boundaries, materials, methods, sensors, shapes
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/wall_loads.jsonl"
PAGE = ROOT / "docs/boundaries.md"
MARKS = "<!-- table: benchmarks/wall_loads.py --write -->", "<!-- end of wall loads -->"

WATER, GRAVITY = 1000.0, 9.81
CELLS = ("held", "linear")
TRANSFERS = {
    "APIC": methods.Transfer(scheme="APIC"),
    "FLIP": methods.Transfer(scheme="FLIP"),
    "AFLIP 0.95": methods.Transfer(scheme="AFLIP", flip=0.95),
}
Values = dict[str, float]


def scene_of(
    upper: tuple[float, float], cell: float, transfer: str | methods.Transfer, **more: Any
) -> libmpm.Scene:
    """Return an empty scene from (0, 0) on under gravity."""
    scheme = TRANSFERS[transfer] if isinstance(transfer, str) else transfer
    method = libmpm.Method(cfl=0.3, transfer=scheme, leaving="delete")
    return libmpm.Scene(
        dimension=2, cell_size=cell, lower=more.get("lower", (0.0, 0.0)), upper=upper,
        gravity=(0.0, -GRAVITY), method=method,
    )  # fmt: skip


def water(modulus: float) -> materials.TaitFluid:
    """Return water without viscosity."""
    return materials.TaitFluid(density=WATER, bulk_modulus=modulus, viscosity=0.0)


def run(scene: libmpm.Scene) -> libmpm.Simulation:
    """Return the simulation of a scene on one thread."""
    return libmpm.Simulation(scene, device="cpu", precision="single", threads=1)


def force(sim: libmpm.Simulation, since: float) -> tuple[float, float]:
    """Return the mean force on the load cell's boundary since a time, N/m."""
    series = sim.sensors["load"]
    time = np.asarray(series.time)
    length = np.diff(np.concatenate([[0.0], time]))
    late = time > since
    mean = (np.asarray(series.values)[late, :2] * length[late][:, None]).sum(axis=0)
    return tuple(mean / length[late].sum())


def gate(cell: str, transfer: str, across: int) -> Values:
    """Return the discharge under a gate 0.1 m open, water 0.8 m deep, 2 m long behind it."""
    opening, depth, length = 0.1, 0.8, 2.0
    dx = opening / across
    scene = scene_of((5.0, 1.2), dx, transfer)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(length, depth)),
        material=water(200 * WATER * GRAVITY * depth), hydrostatic=depth,
    )  # fmt: skip
    response = boundaries.Separable(cell=cell)  # type: ignore[arg-type]
    walls = shapes.DomainWalls(faces=("x-", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=response)
    thick = max(2, round(across / 2)) * dx
    plate = shapes.Box(lower=(length, opening), upper=(length + thick, 1.2))
    scene.add_boundary(name="gate", shape=plate, response=response)
    sim, behind, head = run(scene), [], []
    for time in (0.5, 1.0):
        sim.run(until=time, progress=False)
        x = sim.particles["water"]["position"][:, 0]
        behind.append((x <= length + 2 * dx).sum() * dx * dx / 4)
        head.append((x < 1.0).sum() * dx * dx / 4)
    level = float(np.mean(head))
    jet = 0.61 * opening
    ideal = jet * np.sqrt(2 * GRAVITY * level) / np.sqrt(1 + jet / level)
    return {"discharge": float((behind[0] - behind[1]) / 0.5 / ideal)}


def bore(cell: str, transfer: str, across: int) -> Values:
    """Return the force on a piston at 0.1 √(g h₁) through water 1 m deep."""
    dx, speed = 1.0 / across, 0.1 * np.sqrt(GRAVITY)
    low, high = 1.0, 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        found = (middle - 1) * np.sqrt(GRAVITY / 2 * (1 + 1 / middle))
        low, high = (middle, high) if found < speed else (low, middle)
    time = np.linspace(0.0, 3.0, 301)
    rise = np.clip(time * np.sqrt(GRAVITY) / 2, 0, 1)
    velocity = speed * rise**2 * (3 - 2 * rise)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    path = libmpm.TimeTable(time=tuple(time), value=tuple((x, 0.0) for x in way), end="hold")
    scene = scene_of((8.0, 2.0), dx, transfer)
    start = 8 * dx
    scene.add_body(
        name="water", shape=shapes.Box(lower=(start, 0.0), upper=(8.0, 1.0)),
        material=water(200 * WATER * GRAVITY), hydrostatic=1.0,
    )  # fmt: skip
    response = boundaries.Slip(cell=cell)  # type: ignore[arg-type]
    walls = shapes.DomainWalls(faces=("x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=response)
    scene.add_boundary(
        name="piston", shape=shapes.Box(lower=(-3.0, -1.0), upper=(start, 3.0)),
        response=response, motion=boundaries.Displacement(path),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="piston", interval=0.01))
    sim = run(scene)
    sim.run(until=2.25, progress=False)
    return {"force": -force(sim, 1.5)[0] / (0.5 * WATER * GRAVITY * low**2)}


def deck(cell: str, transfer: str, across: int, modulus: float = 1e6) -> Values:
    """Return mean force and peak of 50 ms on a deck 0.8 m by 0.1 m, 0.2 m over the bed."""
    dx = 0.1 / across
    scene = scene_of((6.0, 3.0), dx, transfer)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(2.0, 1.0)),
        material=water(modulus), hydrostatic=1.0,
    )  # fmt: skip
    response = boundaries.Separable(cell=cell)  # type: ignore[arg-type]
    walls = shapes.DomainWalls(faces=("x-", "x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=response)
    plate = shapes.Box(lower=(3.0, 0.2), upper=(3.8, 0.3))
    scene.add_boundary(name="deck", shape=plate, response=response)
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="deck", interval=0.01))
    sim = run(scene)
    sim.run(until=1.5, progress=False)
    x = np.asarray(sim.sensors["load"].values)[:, 0]
    return {
        "mean": float(force(sim, 0.5)[0]),
        "peak": float(np.convolve(x, np.full(5, 0.2), "same").max()),
    }


def basin(cell: str, transfer: str, degrees: int) -> Values:
    """Return the speed of water at rest between two slopes, 16 cells deep, of √(g h)."""
    dx, rise = 1.0 / 16, np.tan(np.deg2rad(degrees))
    half = np.ceil(1 / rise / dx + 4) * dx
    scene = scene_of((half, 1 + 6 * dx), dx, transfer, lower=(-half, -4 * dx))
    normals = [np.array([side * rise, 1]) / np.hypot(rise, 1) for side in (-1.0, 1.0)]
    slopes = tuple(shapes.HalfSpace(point=(0.0, 0.0), normal=tuple(n)) for n in normals)
    bed = shapes.Union(parts=slopes)
    room = shapes.Box(lower=(-half, -4 * dx), upper=(half, 1 + 6 * dx))
    scene.add_body(
        name="water", shape=shapes.basin(level=1.0, bed=bed, within=room),
        material=water(200 * WATER * GRAVITY), hydrostatic=1.0, sampling=shapes.Columns(),
    )  # fmt: skip
    response = boundaries.Slip(cell=cell)  # type: ignore[arg-type]
    scene.add_boundary(name="bed", shape=bed, response=response)
    sim = run(scene)
    sim.step(20_000)
    return {"speed": float(np.sqrt((sim.grid["velocity"] ** 2).sum(axis=1).mean() / GRAVITY))}


#: What is varied beside wall and transfer, by case.
CASES: Mapping[str, tuple[Callable[..., Values], list[tuple[Any, ...]]]] = {
    "gate": (gate, [(2,), (4,), (8,)]),
    "bore": (bore, [(8,), (16,), (32,)]),
    "deck": (deck, [(2, 1e6), (2, 1e7), (2, 1e8), (4, 1e6), (4, 1e7), (8, 1e6)]),
    "basin": (basin, [(10,), (30,), (45,)]),
}


def tables(lines: list[Line]) -> str:
    """Return a table for each case: rows by wall and transfer."""
    newest = {(x["case"], x["cell"], x["transfer"], tuple(x["what"])): x["values"] for x in lines}
    heads = {
        "gate": ("discharge under a gate, of that by the energy equation", "cells in the opening"),
        "bore": ("force on a piston that drives a bore, of ½ ρ g h₂²", "cells a depth"),
        "deck": ("mean force of a bore on a deck, N/m", "cells thick, modulus Pa"),
        "basin": ("speed of water at rest over slopes, of √(g h)", "degrees"),
    }
    made = []
    for case, (_, choices) in CASES.items():
        name, unit = heads[case]
        rows = [[name, *(", ".join(f"{x:g}" for x in what) for what in choices)]]
        for transfer, cell in itertools.product(TRANSFERS, CELLS):
            found = [newest.get((case, cell, transfer, what)) for what in choices]
            if any(found):
                shown = ["" if v is None else f"{next(iter(v.values())):.3g}" for v in found]
                rows.append([f"{transfer}, {cell}", *shown])
        if len(rows) > 1:
            rows[0][0] += f" ({unit})"
            made += [*markdown(rows), ""]
    return "\n".join(made)


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--cases", nargs="*", choices=[*CASES], default=[*CASES])
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--write", action="store_true", help="the tables of the page too")
    arguments = parser.parse_args()
    done = {(x["case"], x["cell"], x["transfer"], tuple(x["what"]))
            for x in load(arguments.output)}  # fmt: skip
    for case in arguments.cases:
        measure, choices = CASES[case]
        for what, transfer, cell in itertools.product(choices, TRANSFERS, CELLS):
            if (case, cell, transfer, what) in done:
                continue
            values = measure(cell, transfer, *what)
            line = {"case": case, "cell": cell, "transfer": transfer, "what": list(what),
                    "values": values, "commit": bench.commit(),
                    "version": libmpm.__version__}  # fmt: skip
            append(arguments.output, line)
            print(case, cell, transfer, what, values, flush=True)
    if arguments.write:
        PAGE.write_text(filled(PAGE, *MARKS, tables(load(arguments.output))), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
