"""Water in the gap below a block on a bed: what it presses, how far it lifts, what it costs.

    python benchmarks/uplift.py [--output FILE] [--only NAME]

A block of 10 by 5 cm (10 by 10 by 5 in space) stands in a tank, water beside it, held nodes,
K 0.1 MPa, one thread. `pressed`: uplift over ρ g d A, mean of 0.2 s after 0.5 s, and the rise
at their end, on a box on faces of cells or a surface whose plane is so many cells above one and
may lean; `lifted`: rise after 2 s beside that at which it would float; `carried`: friction of
a block in water of its own speed, less μ of what uplift leaves of its weight, over μ of all of
it; `afloat`: the same and the rise, in cells, of a block with contact that floats so many above
a bed; `cost`: time
of a step in space with uplift over that without, medians of five runs by turns. A line each goes to
benchmarks/results/uplift.jsonl.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
import warnings
from pathlib import Path
from typing import Any

from result_pages import append

import libmpm
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from support.uplift_scenes import (  # noqa: E402
    DENSITY,
    GRAVITY,
    HALF,
    HIGH,
    afloat,
    loads,
    stream,
    tank,
)


def rise(sim: libmpm.Simulation, rest: float) -> float:
    """Return how far the block's middle is above where it was, m."""
    return float(sim.particles["debris-1"]["position"][:, -1].mean()) - rest


def begun(scene: libmpm.Scene) -> tuple[libmpm.Simulation, float]:
    """Return a run of one thread and the height of the block's middle, m."""
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    return sim, float(sim.particles["debris-1"]["position"][:, -1].mean())


def pressed(
    cell: float,
    depth: float,
    contact: bool = False,
    dimension: int = 2,
    surface: float | None = None,
    slope: float = 0.0,
) -> dict[str, Any]:
    """Return uplift over ρ g d A of a block too heavy to lift, across the bed, rough on a slope."""
    scene = tank(cell, depth=depth, contact=contact, dimension=dimension, density=1500.0,
                 surface=surface, slope=slope, friction=2.0 if slope else 0.4)  # fmt: skip
    sim, rest = begun(scene)
    sim.run(until=0.7, progress=False)
    lean = math.hypot(1.0, slope)
    full = 1000 * GRAVITY * depth * (2 * HALF) ** (dimension - 1) * lean
    along, up = loads(sim, "bed-friction", 0.5)
    return {"uplift": (slope * along - up) / lean / full, "rise_mm": 1e3 * rise(sim, rest)}


def lifted(cell: float, density: float, depth: float, uplift: bool) -> dict[str, Any]:
    """Return how far a block is lifted, mm."""
    sim, rest = begun(tank(cell, density=density, depth=depth, uplift=uplift))
    sim.run(until=2.0, progress=False)
    # What it leaves fills the tank beside it: 0.6 m long, of which the block takes 0.1.
    floats = max(0.0, (depth * 0.5 / 0.6 + density / 1000 * HIGH * 0.1 / 0.6)
                 - density / 1000 * HIGH)  # fmt: skip
    return {"rise_mm": 1e3 * rise(sim, rest), "floats_mm": 1e3 * floats}


def carried(cell: float, depth: float, dimension: int) -> dict[str, Any]:
    """Return the error of friction over μ of the block's weight, and uplift over that weight."""
    sim, _ = begun(stream(cell, depth=depth, dimension=dimension))
    sim.run(until=0.1, progress=False)
    along, down = loads(sim, "bed-friction", 0.03)
    weight = DENSITY * GRAVITY * HIGH * (2 * HALF) ** (dimension - 1)
    rubs = along - 0.4 * max(0.0, weight + down)
    return {"friction_error": rubs / (0.4 * weight), "uplift_of_weight": -down / weight}


def floats(cell: float, off: float, dimension: int, surface: float | None) -> dict[str, Any]:
    """Return friction of a block that floats over μ of its weight, and its rise in cells."""
    sim, rest = begun(afloat(cell, off=off * cell, dimension=dimension, surface=surface))
    sim.run(until=0.2, progress=False)
    along, _ = loads(sim, "bed-friction", 0.05)
    weight = 648 * GRAVITY * HIGH * (2 * HALF) ** (dimension - 1)
    return {"friction": along / (0.7 * weight), "rise_cells": rise(sim, rest) / cell}


def cost(cell: float) -> dict[str, Any]:
    """Return seconds a step with uplift over those without."""
    found: dict[bool, list[float]] = {True: [], False: []}
    runs = {u: begun(tank(cell, dimension=3, uplift=u))[0] for u in found}
    for sim in runs.values():
        sim.step(20)
    for _ in range(5):
        for u, sim in runs.items():
            begin = time.perf_counter()
            sim.step(100)
            found[u].append((time.perf_counter() - begin) / 100)
    with_it, without = (statistics.median(found[u]) for u in (True, False))
    particles = sum(len(v) for v in runs[True].particles.values())
    return {"ratio": with_it / without, "step_s": without, "particles": particles}


def main() -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=ROOT / "benchmarks/results/uplift.jsonl")
    parser.add_argument("--only", default="", help="cases whose names begin so")
    given = parser.parse_args()
    cells = (0.025, 0.0125, 0.00625)
    cases: list[tuple[str, Any, dict[str, Any]]] = [
        ("pressed", pressed, {"cell": h, "depth": d, "contact": c})
        for c in (False, True) for h in cells for d in (0.02, 0.03, 0.045)
    ]  # fmt: skip
    cases.append(("pressed", pressed,
                  {"cell": 0.0125, "depth": 0.045, "contact": False, "dimension": 3}))  # fmt: skip
    cases += [
        ("pressed", pressed, {"cell": h, "depth": 0.045, "surface": place, "slope": slope})
        for h in cells
        for place, slope in (
            *((p, 0.0) for p in (0.0, 0.25, 0.5, 0.75)),
            *((p, s) for s in (0.01, 0.05, 0.2) for p in (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9)),
        )
    ]  # fmt: skip
    cases += [
        ("lifted", lifted, {"cell": h, "density": rho, "depth": 0.045, "uplift": u})
        for u in (False, True) for h in cells for rho in (300.0, 648.0, 987.0)
    ]  # fmt: skip
    cases += [
        ("carried", carried, {"cell": h, "depth": d, "dimension": n})
        for n, cells_of in ((2, cells), (3, cells[:2])) for h in cells_of
        for d in (0.025, 0.0375, 0.05)
    ]  # fmt: skip
    cases += [
        ("afloat", floats, {"cell": h, "off": off, "dimension": n, "surface": place})
        for n, cells_of in ((2, cells), (3, cells[1:2])) for h in cells_of for off in (0.5, 1.0)
        for place in (None, 0.25, 0.7)
    ]  # fmt: skip
    cases += [("cost", cost, {"cell": 0.0125})]
    for name, measure, arguments in cases:
        if not name.startswith(given.only):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", libmpm.ModelWarning)
            found = measure(**arguments)
        append(given.output, {"case": name, **arguments, **found, "commit": bench.commit(),
                              "version": libmpm.__version__})  # fmt: skip
        told = ", ".join(f"{k} {v}" for k, v in arguments.items())
        print(f"{name}: {told}:", ", ".join(f"{k} {v:.4g}" for k, v in found.items()), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
