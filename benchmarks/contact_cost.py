"""What contact costs: water with blocks that have fields of velocities of their own, and without.

    python benchmarks/contact_cost.py [pile] [apart] [--device cuda] [--scale 1.0] [--steps 1000]

`pile`: a bore of four million particles runs into 2,000 blocks of 2,016 particles in a pile, all of
which may touch each other and the water. `apart`: eight million particles of water and 24 blocks
that float in it, apart from each other. 3D, eight particles a cell, single precision, default
F-bar, all checks, sorts included. `--device cuda:0,cuda:1`: on several. `--scale` is of the numbers
of particles and blocks. Each case runs without contacts, then with; a line each goes to
benchmarks/results/contact_cost.jsonl.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np
from result_pages import append

import libmpm
from libmpm import boundaries, contacts, materials, shapes
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/contact_cost.jsonl"
CELL = 0.05
WATER = materials.TaitFluid(bulk_modulus=2e6)
TIMBER = materials.FixedCorotated(density=600, youngs_modulus=5e6, poissons_ratio=0.3)


def tank(size: tuple[int, int, int]) -> libmpm.Scene:
    """Return an empty tank of so many cells."""
    upper = tuple(n * CELL for n in size)
    scene = libmpm.Scene(
        dimension=3, cell_size=CELL, lower=(0, 0, 0), upper=upper, gravity=(0, 0, -9.81)
    )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip(cell="held")
    )
    return scene


def block(scene: libmpm.Scene, k: int, corner: tuple[int, int, int]) -> None:
    """Add a block of 6 x 6 x 7 cells."""
    low = tuple(c * CELL for c in corner)
    high = tuple((c + n) * CELL for c, n in zip(corner, (6, 6, 7), strict=True))
    shape = shapes.Box(lower=low, upper=high)
    scene.add_body(name=f"block {k:04d}", shape=shape, material=TIMBER, particles_per_cell=8)


def pile(scale: float) -> libmpm.Scene:
    """Return a column of water that breaks beside a pile."""
    count = max(4, round(2000 * scale))
    across = max(2, round(math.sqrt(count / 5)))
    layers = 5
    length = math.ceil(count / (across * layers))
    width, cells = 8 * across, round(5e5 * scale)
    deep = 60
    long = math.ceil(cells / (width * deep))
    scene = tank((long + 8 * length + 40, width, deep + 20))
    column = shapes.Box(lower=(0, 0, 0), upper=(long * CELL, width * CELL, deep * CELL))
    scene.add_body(
        name="water", shape=column, material=WATER, particles_per_cell=8, hydrostatic=deep * CELL,
    )  # fmt: skip
    for k in range(count):
        x, rest = divmod(k, across * layers)
        z, y = divmod(rest, across)
        block(scene, k, (long + 1 + 8 * x + z % 2, 1 + 8 * y, 7 * z))
    return scene


def apart(scale: float) -> libmpm.Scene:
    """Return water at rest with blocks that float in its surface."""
    deep, width = 50, 100
    long = math.ceil(1e6 * scale / (deep * width))
    scene = tank((long, width, deep + 12))
    hulls = []
    for k in range(24):
        x, y = divmod(k, 4)
        corner = (round(long * (x + 0.5) / 6) - 3, 12 + 25 * y, deep - 4)
        block(scene, k, corner)
        hulls.append(scene.bodies[-1].shape)
    sea = shapes.Box(lower=(0, 0, 0), upper=(long * CELL, width * CELL, deep * CELL))
    scene.add_body(
        name="water", shape=shapes.Difference(whole=sea, without=shapes.Union(parts=tuple(hulls))),
        material=WATER, particles_per_cell=8, hydrostatic=deep * CELL,
    )  # fmt: skip
    return scene


def main() -> None:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("cases", nargs="*", default=["pile", "apart"])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=RESULTS)
    given = parser.parse_args()
    for case in given.cases:
        seconds = {}
        for touching in (False, True):
            scene = {"pile": pile, "apart": apart}[case](given.scale)
            if touching:
                solid = contacts.Friction(static=0.4, dynamic=0.3)
                scene.add_contact(name="solids", between=("block*", "block*"), law=solid)
                scene.add_contact(name="wet", between=("block*", "water"), law=contacts.Fluid())
            names = given.device.split(",")
            device = names if len(names) > 1 else names[0]
            sim = libmpm.Simulation(scene, device=device, precision="single")
            sim.step(100)
            begun = time.monotonic()
            sim.step(given.steps)
            seconds[touching] = time.monotonic() - begun
            line = {
                "case": case, "contact": touching, "particles": sum(sim.totals()),
                "bodies": len(scene.bodies), "steps": given.steps,
                "seconds": round(seconds[touching], 3), "time": sim.time,
                "device": sim.device, "ranks": sim.ranks,
                "state": f"steps 100 to {100 + given.steps}",
                "times_without": round(seconds[touching] / seconds[False], 3),
                "speed": float(np.abs(sim.particles["water"]["velocity"]).max()),
                "commit": bench.commit(), "version": libmpm.__version__,
            }  # fmt: skip
            append(given.output, line)
            print(line, flush=True)
            del sim


if __name__ == "__main__":
    main()
