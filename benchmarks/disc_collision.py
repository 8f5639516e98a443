"""Two elastic discs that collide: what each transfer loses of the energy, and whether they tear.

    python benchmarks/disc_collision.py            all rows, a minute on one thread
    python benchmarks/disc_collision.py --write    and the table of docs/method-tables.md

The collision of Sulsky, Chen and Schreyer (1994): radius 0.2 m, 1000 kg/m³, E 1000 Pa, ν 0.3, each
at (0.1, 0.1) m/s towards the other. One JSON line a row goes to
benchmarks/results/disc_collision.jsonl.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from result_pages import Line, append, filled, load, markdown

import libmpm
from libmpm import materials, sensors, shapes
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/disc_collision.jsonl"
PAGE = ROOT / "docs/method-tables.md"
MARKS = "<!-- table: benchmarks/disc_collision.py --write -->", "<!-- end of disc collision -->"

#: Cells a radius.
CELLS = (4, 8)
RADIUS, UNTIL = 0.2, 3.0

ROWS: dict[str, libmpm.methods.Transfer] = {
    "APIC": libmpm.methods.Transfer(),
    "PIC": libmpm.methods.Transfer(scheme="PIC"),
    "FLIP": libmpm.methods.Transfer(scheme="FLIP"),
    "PIC-FLIP 0.95": libmpm.methods.Transfer(scheme="PIC-FLIP", flip=0.95),
    "AFLIP 0.95": libmpm.methods.Transfer(scheme="AFLIP", flip=0.95),
    "NFLIP": libmpm.methods.Transfer(scheme="NFLIP"),
    "NFLIP 0.95": libmpm.methods.Transfer(scheme="NFLIP", flip=0.95),
    "NFLIP 0.9": libmpm.methods.Transfer(scheme="NFLIP", flip=0.9),
    "SFLIP 0.95, β 0 to 1": libmpm.methods.Transfer(scheme="SFLIP", flip=0.95, shift_max=1.0),
    "ASFLIP 0.95, β 0 to 1": libmpm.methods.Transfer(scheme="ASFLIP", flip=0.95, shift_max=1.0),
    "ASFLIP 0.999, β 0 to 0.025": libmpm.methods.Transfer(
        scheme="ASFLIP", flip=0.999, shift_max=0.025
    ),
    "ASFLIP 1, β 0.1": libmpm.methods.Transfer(
        scheme="ASFLIP", flip=1.0, shift_max=0.1, shift_min=0.1
    ),
    "ASFLIP 1, β 0.25": libmpm.methods.Transfer(
        scheme="ASFLIP", flip=1.0, shift_max=0.25, shift_min=0.25
    ),
    "XPIC 2": libmpm.methods.Transfer(scheme="XPIC", order=2),
    "FMPM 2": libmpm.methods.Transfer(scheme="FMPM", order=2),
    "FMPM 4": libmpm.methods.Transfer(scheme="FMPM", order=4),
}


def scene(transfer: libmpm.methods.Transfer, cells: int) -> libmpm.Scene:
    """Return the scene with so many cells a radius."""
    found = libmpm.Scene(
        dimension=2, cell_size=RADIUS / cells, lower=(0, 0), upper=(1, 1),
        method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    rubber = materials.NeoHookean(density=1000.0, youngs_modulus=1000.0, poissons_ratio=0.3)
    for name, centre, speed in (("left", 0.3, 0.1), ("right", 0.7, -0.1)):
        found.add_body(
            name=name, shape=shapes.Sphere(centre=(centre, centre), radius=RADIUS),
            material=rubber, velocity=(speed, speed),
        )  # fmt: skip
    found.add_sensor(name="energy", sensor=sensors.Energy(interval=0.02))
    return found


def measure(transfer: libmpm.methods.Transfer, cells: int) -> dict[str, float]:
    """Return the energy lost, and how far the furthest particle is from the middle, radii."""
    simulation = libmpm.Simulation(scene(transfer, cells), device="cpu", precision="double")
    simulation.run(until=UNTIL, progress=False)
    total = np.asarray(simulation.sensors["energy"].values)[:, :3].sum(axis=1)
    reach = 0.0
    for name in ("left", "right"):
        x = simulation.particles[name]["position"]
        reach = max(reach, float(np.linalg.norm(x - np.median(x, axis=0), axis=1).max()))
    return {"lost": float(1 - total[-1] / total[0]), "reach": reach / RADIUS}


def table(lines: list[Line]) -> str:
    """Return the table of the page: energy lost and reach, by transfer and cells."""
    newest = {(x["row"], x["cells"]): x["values"] for x in lines}
    rows = [["transfer", *(f"lost, {c} cells a radius" for c in CELLS),
             *(f"furthest particle, {c} cells" for c in CELLS)]]  # fmt: skip
    for name in ROWS:
        have = [newest.get((name, c)) for c in CELLS]
        rows.append([
            name,
            *("" if v is None else f"{100 * v['lost']:.0f} %" for v in have),
            *("" if v is None else f"{v['reach']:.2f} R" for v in have),
        ])  # fmt: skip
    return "\n".join(markdown(rows))


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--write", action="store_true", help="the table of the page too")
    arguments = parser.parse_args()
    done = {(x["row"], x["cells"]) for x in load(arguments.output)}
    for name, transfer in ROWS.items():
        for cells in CELLS:
            if (name, cells) in done:
                continue
            values = measure(transfer, cells)
            line = {"row": name, "cells": cells, "values": values, "commit": bench.commit(),
                    "version": libmpm.__version__}  # fmt: skip
            append(arguments.output, line)
            print(name, cells, values, flush=True)
    if arguments.write:
        text = filled(PAGE, *MARKS, table(load(arguments.output)))
        PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
