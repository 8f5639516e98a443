"""What bodies of elements cost on a GPU: in eight million particles of water, and beside particles.

    python benchmarks/elements_gpu.py [water] [block] [bars] [bars coarse] [--device cuda]
                                      [--scale 1.0] [--steps 1000]

`block`: one body of a million tetrahedra, h = dx/2, under the water. `bars`: 300 bars of 3 x 3 x 10
cells, h = dx/2, apart from each other, `bars coarse` with h = dx, `bars of particles` with eight
particles a cell. `water`: the water alone, first and again last. 3D, eight particles a cell, single
precision, default F-bar and transfers, all checks, sorts included, one time step for all. A line
each goes to benchmarks/results/elements_gpu.jsonl: seconds a step over the water's, and elements a
second in what they add.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np
from result_pages import append

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/elements_gpu.jsonl"
CELL = 0.05
WATER = materials.TaitFluid(bulk_modulus=2e6)
TIMBER = materials.NeoHookean(density=600, youngs_modulus=5e6, poissons_ratio=0.3)
CASES = ("water", "block", "bars", "bars coarse", "bars of particles")
BARS = 300


def size_of(scale: float) -> tuple[tuple[int, int, int], int]:
    """Return the tank's size and the depth of its water, cells."""
    deep = max(24, round(64 * scale ** (1 / 3)))
    cells = 1e6 * scale / deep
    wide = max(32, round(math.sqrt(cells / 2)))
    return (round(cells / wide), wide, deep + 24), deep


def tank(scale: float, without: shapes.Box | None = None) -> libmpm.Scene:
    """Return water that stands in a tank, but for a box."""
    size, deep = size_of(scale)
    upper = tuple(n * CELL for n in size)
    scene = libmpm.Scene(
        dimension=3, cell_size=CELL, lower=(0, 0, 0), upper=upper, gravity=(0, 0, -9.81)
    )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip(cell="held")
    )
    shape = shapes.Box(lower=(0, 0, 0), upper=(*upper[:2], deep * CELL))
    scene.add_body(
        name="water", shape=shape if without is None else shape - without, material=WATER,
        particles_per_cell=8, hydrostatic=deep * CELL,
    )  # fmt: skip
    return scene


def add_bars(scene: libmpm.Scene, size: tuple[int, int, int], deep: int, count: int,
             edge: float | None) -> None:  # fmt: skip
    """Add bars in rows that lie upon the water; `edge` in cells, None: of particles."""
    along, across = size[0] // 14, size[1] // 7
    layers = math.ceil(count / (along * across))
    for k in range(count):
        row, place = divmod(k, along * across)
        low = np.array([
            2 + 14 * (place % along), 2 + 7 * (place // along), deep + 2 + 6 * row
        ]) * CELL  # fmt: skip
        high = low + np.array([10, 3, 3]) * CELL
        if edge is None:
            scene.add_body(
                name=f"bar {k:03d}", shape=shapes.Box(lower=low, upper=high), material=TIMBER,
                particles_per_cell=8,
            )  # fmt: skip
        else:
            mesh = shapes.Tetrahedra.box(lower=low, upper=high, edge=edge * CELL)
            scene.add_body(name=f"bar {k:03d}", shape=mesh, material=TIMBER)
    assert 6 * layers < 24


def scene(case: str, scale: float) -> libmpm.Scene:
    """Return the scene of a case."""
    size, deep = size_of(scale)
    count = max(2, round(BARS * scale))
    if case == "block":
        # Six tetrahedra a cube of half a cell; as deep as the water at most.
        high = min(28, deep - 4)
        wide = max(4, round(math.sqrt(1e6 * scale / 48 / high)))
        low = np.array([4, 4, 2]) * CELL
        box = shapes.Box(lower=low, upper=low + np.array([wide, wide, high]) * CELL)
        made = tank(scale, without=box)
        mesh = shapes.Tetrahedra.box(lower=box.lower, upper=box.upper, edge=CELL / 2)
        made.add_body(name="block", shape=mesh, material=TIMBER)
        return made
    made = tank(scale)
    if case.startswith("bars"):
        edge = {"bars": 0.5, "bars coarse": 1.0}.get(case)
        add_bars(made, size, deep, count, edge)
    return made


def measure(case: str, given: argparse.Namespace) -> dict[str, float]:
    """Return what a case takes."""
    made = scene(case, given.scale)
    step = 0.3 * CELL / math.sqrt(1.1 * 5e6 / 600)
    began = time.monotonic()
    sim = libmpm.Simulation(made, device=given.device, precision="single", time_step=step)
    sim.step(50)
    ready = time.monotonic()
    sim.step(given.steps)
    seconds = time.monotonic() - ready
    particles = len(sim.particles["water"])
    return {
        "particles": particles, "elements": float(sim.plan.elements),
        "vertices or particles of solids": float(
            sum(len(sim.particles[b.name]) for b in made.bodies) - particles
        ),
        "ms_a_step": 1e3 * seconds / given.steps, "setup": round(ready - began, 2),
        "sorts": sim.statistics["sorts"],
    }  # fmt: skip


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("cases", nargs="*", metavar="case", help=", ".join(CASES))
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=RESULTS)
    given = parser.parse_args()
    unknown = set(given.cases) - set(CASES)
    if unknown:
        parser.error(f"{sorted(unknown)}: no such case; there are {', '.join(CASES)}")
    cases = ["water", *(c for c in given.cases or CASES if c != "water"), "water"]
    found = []
    for case in cases:
        found.append((case, measure(case, given)))
        print(*found[-1], flush=True)
    alone = min(values["ms_a_step"] for case, values in found if case == "water")
    for case, values in found:
        more = values["ms_a_step"] - alone
        line = {
            "case": case, "values": values, "over_water": round(values["ms_a_step"] / alone, 3),
            "device": given.device, "precision": "single", "steps": given.steps,
            "scale": given.scale, "commit": bench.commit(), "version": libmpm.__version__,
        }  # fmt: skip
        if values["elements"] > 0 and more > 0:
            line["element_steps_per_s"] = values["elements"] / (1e-3 * more)
        append(given.output, line)
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
