"""The load on the box of the Large Wave Flume, wave only, by cell, transfer and walls.

    python benchmarks/flume_load.py --cell 0.1 [--transfer APIC] [--walls linear] [--bed held]
                                    [--until 27] [--device cuda] [--budget SECONDS]
                                    [--flip 0.98] [--relaxation 10] [--shifting] [--density]

Half width, bed of the drawing, water in columns, K 2e6 Pa, box 1.016 x 1.016 x 0.615 m with its
underside at the still water, flume cut at x 70 m; measured time = run time + 15 s. Measured: peak
214 N (means of 0.1 s), impulse from 30 to 45 s 1217 N s. A minute on one H200 with cells of 0.1 m,
four with 0.05 m. One JSON line a run goes to benchmarks/results/flume_load.jsonl.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np
from result_pages import append

import libmpm
from libmpm import boundaries, materials, methods, sensors, shapes
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/flume_load.jsonl"
BED = [(-6, 0.0), (14.275, 0), (14.28, 0.226), (17.933, 0.226), (28.906, 1.1404), (43.536, 1.75),
       (80.106, 1.75), (87.46, 2.363)]  # fmt: skip
GAUGES = {"wg1": 14.0, "wg2": 32.294, "wg3": 36.139, "front": 43.6}
LEVEL, LENGTH = 2.0, 70.0
MODULUS = 2e6  # of the water, Pa


def scene(
    cell: float, transfer: str, walls: str, bed_cell: str, share: float = 0.95,
    relaxation: float | None = None, shifting: bool = False, density: bool = False,
) -> libmpm.Scene:  # fmt: skip
    """Return the flume; `share` is AFLIP's flip, `relaxation` F-bar's time in cell / wave speed."""
    width = round(1.83 / cell) * cell
    high = (-1.0 + math.ceil((LENGTH + 1) / cell) * cell, width, math.ceil(3.0 / cell) * cell)
    flip = {} if transfer in ("APIC", "FLIP") else {"flip": share}
    named = methods.Transfer(scheme=transfer, **flip) if transfer != "auto" else None  # type: ignore[arg-type]
    method = libmpm.Method(transfer=named)
    made = libmpm.Scene(
        dimension=3, cell_size=cell, lower=(-1.0, 0.0, 0.0), upper=high, gravity=(0, 0, -9.81),
        method=method,
    )  # fmt: skip
    profile = [*BED, (90, BED[-1][1]), (90, -2), (-6, -2)]
    bed = shapes.Extrusion(axis="y", lower=-1.0, upper=5.0, profile=profile)
    stroke = boundaries.piston_stroke(
        4.0, 0.2, 9.9303, until=40.0, dt=1 / 60, direction=(1.0, 0.0, 0.0)
    )
    start = float(stroke.at(0.0)[0])
    sea = shapes.basin(level=LEVEL, bed=bed, within=shapes.Box(lower=(0.0, 0, -1), upper=high))
    time = None if relaxation is None else relaxation * cell / math.sqrt(MODULUS / 1000)
    made.add_body(
        name="water", shape=sea, material=materials.TaitFluid(bulk_modulus=MODULUS),
        hydrostatic=LEVEL, sampling=shapes.Columns(),
        fbar=libmpm.FBar(time=time, shifting=shifting, density=density),
    )  # fmt: skip
    slip = boundaries.Slip(cell=walls)  # type: ignore[arg-type]
    made.add_boundary(name="bed", shape=bed, response=boundaries.Slip(cell=bed_cell))  # type: ignore[arg-type]
    made.add_boundary(
        name="piston", shape=shapes.Box(lower=(-5, -1, -1), upper=(-start, 3, 4)), response=slip,
        motion=boundaries.Displacement(stroke),
    )  # fmt: skip
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=slip)

    def on_cells(x: float) -> float:
        return round((x + 1.0) / cell) * cell - 1.0

    def lift(x: float) -> float:
        return round(x / cell) * cell

    box = shapes.Box(
        lower=(on_cells(43.8), 0.0, lift(2.0)), upper=(on_cells(44.816), lift(0.508), lift(2.615))
    )
    made.add_boundary(name="box", shape=box, response=boundaries.Separable(cell=walls))  # type: ignore[arg-type]
    made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="box", interval=1 / 120))
    for name, x in GAUGES.items():
        gauge = sensors.WaveGauge(position=(x, width - 0.2), interval=1 / 30, body="water")
        made.add_sensor(name=name, sensor=gauge)
    return made


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--cell", type=float, default=0.1, help="m")
    parser.add_argument("--transfer", default="auto")
    parser.add_argument("--flip", type=float, default=0.95, help="of AFLIP by name")
    parser.add_argument("--relaxation", type=float, help="of F-bar, in cell / wave speed; 35")
    parser.add_argument("--shifting", action="store_true", help="`FBar.shifting`")
    parser.add_argument("--density", action="store_true", help="`FBar.density`")
    parser.add_argument("--walls", choices=("auto", "held", "linear"), default="auto")
    parser.add_argument("--bed", choices=("auto", "held", "linear"), help="as the walls")
    parser.add_argument("--until", type=float, default=27.0, help="run time, s")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--budget", type=float, default=math.inf, help="of the clock, s")
    parser.add_argument("--keep", type=Path, help="checkpoint of a run whose budget ended")
    parser.add_argument("--output", type=Path, default=RESULTS)
    given = parser.parse_args()
    bed = given.bed or given.walls
    if given.keep and given.keep.exists():
        sim = libmpm.Simulation.resume(given.keep)
    else:
        of_water = (given.flip, given.relaxation, given.shifting, given.density)
        made = scene(given.cell, given.transfer, given.walls, bed, *of_water)
        sim = libmpm.Simulation(made, device=given.device)
    failed, begun = "", time.monotonic()
    try:
        while sim.time < given.until and time.monotonic() - begun < given.budget:
            sim.run(until=min(sim.time + 0.5, given.until), progress=False)
        if given.keep and sim.time < given.until:
            sim.save_checkpoint(given.keep)
    except libmpm.Error as error:
        failed = str(error)
    series = sim.sensors["load"]
    at, force = np.asarray(series.time), 2 * np.asarray(series["force_x"])  # both halves
    mean = np.convolve(force, np.full(12, 1 / 12), "same")
    crests = {}
    for name in GAUGES:
        level, when = (np.asarray(x) for x in (sim.sensors[name].values, sim.sensors[name].time))
        crests[name] = float(np.nanmax(level[:, 0]) - np.nanmean(level[when < 2, 0]))
    line = {
        "cell": given.cell, "transfer": given.transfer, "walls": given.walls, "bed": bed,
        "flip": sim.scene.transfer.flip, "relaxation": given.relaxation,
        "shifting": given.shifting, "density": given.density,
        "until": given.until, "reached": sim.time, "failed": failed, "device": given.device,
        "seconds": round(time.monotonic() - begun, 1),
        "particles": len(sim.particles["water"]), "peak": float(mean.max()),
        "impulse": float(force[(at > 15) & (at < 30)].sum() / 120), "crests": crests,
        "commit": bench.commit(), "version": libmpm.__version__,
    }  # fmt: skip
    append(given.output, line)
    print(line)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
