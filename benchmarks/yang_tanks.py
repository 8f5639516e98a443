"""Tanks of water at rest, along the grid and across it: Yang (2016) 5.1, by method and resolution.

    python benchmarks/yang_tanks.py                           the runs that are missing, one thread
    python benchmarks/yang_tanks.py --only "45 deg 16 cells"  some of them
    python benchmarks/yang_tanks.py --list                    what is missing, and its size
    python benchmarks/yang_tanks.py --page                    tables and figure of the page

3.2 m of water, K 2.2e9 Pa, double precision, linear functions as deposits modify them, FLIP,
Courant 0.1. At 0 degrees walls hold nodes, at 45 degrees the grid is turned about the tank's lower
left corner and walls are decay layers "quadratic". C0 and the F forms go with means over cells, NB
with means at nodes; "cell means" are those without smoothing, "none" is neither, F-bar the default.

One JSON line a run is appended to --output; no run begins after --budget seconds of wall time. Most
runs that last 3 s have `SOFT` for K, a hundredth: rho g H / K = 0.15 %, and a tenth of the steps.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from result_pages import append, load

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.cli import bench
from libmpm.analysis import Signal

RESULTS = Path(__file__).resolve().parent / "results" / "yang_tanks.jsonl"
WIDTH = 3.2  # m, and depth
WEIGHT = 1e4 * WIDTH**2  # N/m
REAL, SOFT = 2.2e9, 2.2e7  # Pa
SHORT, LONG = 0.3, 3.0  # s
METHODS = ("none", "F-bar", "cell means", "C0", "F0AL1", "F0", "NB")


@dataclass(frozen=True)
class Job:
    """A run: degrees of the grid, cells a length, particles a cell and axis, method, K, time."""

    degrees: int
    cells: int
    per_axis: int
    method: str
    bulk_modulus: float
    until: float

    @property
    def name(self) -> str:
        """What tells runs apart."""
        return (
            f"{self.degrees} deg {self.cells} cells {self.per_axis} x {self.per_axis} "
            f"{self.method} K={self.bulk_modulus:g} {self.until:g} s"
        )

    @property
    def time_step(self) -> float:
        """Courant number 0.1."""
        return 0.1 * WIDTH / self.cells / math.sqrt(self.bulk_modulus / 1000)

    @property
    def updates(self) -> float:
        """Steps times particles."""
        return self.until / self.time_step * (self.cells * self.per_axis) ** 2


def jobs() -> list[Job]:
    """Return all runs, the cheap ones first."""
    found = [
        Job(degrees, cells, 3, method, modulus, until)
        for degrees in (0, 45)
        for cells in (4, 8, 16)
        for method in METHODS
        for modulus, until in ((REAL, SHORT), (SOFT, LONG))
    ]
    # Across the grid: more particles, and as long as the source.
    found += [Job(45, 8, 6, method, REAL, SHORT) for method in METHODS]
    found += [Job(45, 8, 3, method, REAL, LONG) for method in METHODS]
    found += [Job(0, 16, 3, method, REAL, LONG) for method in ("none", "F0AL1")]
    return sorted(found, key=lambda job: (job.updates, -job.degrees, job.until))


def choices(method: str) -> dict[str, Any]:
    """Return what a body takes of a method."""
    means = libmpm.methods.AssumedFields(over="node" if method == "NB" else "cell")
    if method == "none":
        return {"fbar": None}
    if method == "F-bar":
        return {}
    if method == "cell means":
        return {"fbar": None, "assumed": means}
    smoothing = libmpm.methods.Smoothing(method=method)  # type: ignore[arg-type]
    return {"smoothing": smoothing, "assumed": means}


class Tank:
    """Scene of a run, and what it measures."""

    def __init__(self, job: Job, folder: Path) -> None:
        """Fill the tank in equilibrium."""
        self.job = job
        angle = math.radians(job.degrees)
        self.along = np.array([math.cos(angle), -math.sin(angle)])  # the floor, in the grid's axes
        self.up = np.array([math.sin(angle), math.cos(angle)])
        size, n = WIDTH / job.cells, job.cells * job.per_axis
        at = (np.arange(n) + 0.5) * WIDTH / n
        x, y = (c.ravel()[:, None] for c in np.meshgrid(at, at))
        file = folder / "water.npy"
        np.save(file, x * self.along + y * self.up)
        # Nodes are the centres of cells: the tank's lower left corner is one.
        reach = np.array([[-1.0, -1.0], [4.2, 4.6]] if angle == 0 else [[-2.4, -4.4], [6.8, 6.0]])
        low, high = (np.sign(reach) * (np.ceil(np.abs(reach) / size - 1e-9) + 0.5)) * size
        scene = libmpm.Scene(
            dimension=2, cell_size=size, lower=tuple(low), upper=tuple(high),
            gravity=tuple(-10 * self.up),
            method=libmpm.Method(
                transfer="FLIP", kernel=libmpm.methods.Kernel(name="linear", modified=True),
                time_step=job.time_step,
            ),
        )  # fmt: skip
        scene.add_body(
            name="water",
            shape=shapes.PointFile(file=str(file), particle_volume=(WIDTH / n) ** 2),
            material=materials.TaitFluid(
                density=1000, bulk_modulus=job.bulk_modulus, viscosity=1e-3
            ),
            hydrostatic=WIDTH,
            **choices(job.method),
        )
        if angle == 0:
            self._hold_nodes(scene, low, high, size)
        else:
            self._hold_layers(scene)
        self.interval = job.until / 600
        scene.add_sensor(
            name="load", sensor=sensors.LoadCell(boundary="floor", interval=self.interval)
        )
        self.sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)

    @staticmethod
    def _hold_nodes(
        scene: libmpm.Scene, low: npt.NDArray[Any], high: npt.NDArray[Any], size: float
    ) -> None:
        # The last nodes that a wall holds lie on its plane.
        walls = {
            "floor": (tuple(low), (high[0], 0.5 * size), "y"),
            "left": (tuple(low), (0.5 * size, high[1]), "x"),
            "right": ((WIDTH - 0.5 * size, low[1]), tuple(high), "x"),
        }
        still = libmpm.TimeTable((0.0,), ((0.0, 0.0),))
        for name, (lower, upper, normal) in walls.items():
            scene.add_boundary(
                name=name, shape=shapes.Box(lower=lower, upper=upper), motion=still,
                response=boundaries.Prescribed(components=normal),
            )  # fmt: skip

    def _hold_layers(self, scene: libmpm.Scene) -> None:
        walls = {
            "floor": (np.zeros(2), self.up),
            "left": (np.zeros(2), self.along),
            "right": (WIDTH * self.along, -self.along),
        }
        for name, (point, normal) in walls.items():
            scene.add_boundary(
                name=name, shape=shapes.HalfSpace(point=tuple(point), normal=tuple(normal)),
                response=boundaries.Separable(), layer=boundaries.DecayLayer(function="quadratic"),
            )  # fmt: skip

    def values(self) -> dict[str, Any]:
        """Return h_eq (5.1), R_b (5.2), particles outside and the pressure of the lowest cells."""
        water = self.sim.particles["water"]
        x, y = water["position"] @ self.along, water["position"] @ self.up
        # At 0 degrees a particle may stand on a wall, to rounding.
        slack = 1e-6 * WIDTH / self.job.cells
        outside = (x < -slack) | (x > WIDTH + slack) | (y < -slack)
        size = WIDTH / self.job.cells
        lowest = y < size
        series = self.sim.sensors["load"]
        ratio = Signal(
            time=series.time, value=-series.values[:, :2] @ self.up, sampling="mean"
        ).normalised(WEIGHT)
        found: dict[str, Any] = {
            "h_eq": 2 * float(y.mean()),
            "outside": int(outside.sum()),
            "bed_pressure": float(water["pressure"][lowest].mean() / (1e4 * (WIDTH - size / 2))),
            "speed": float(np.sqrt((water["velocity"] ** 2).sum(axis=1).mean())),
        }
        if len(ratio.time) > 11:
            even = ratio.resampled(self.interval)
            mean = even.moving_mean(11, trim=1)
            late = mean.value[mean.time > 0.05]
            found |= {"R_b_L2": float(even.l2_error(1.0))}
            if len(late):
                found |= {"R_b_least": float(late.min()), "R_b_most": float(late.max())}
        return found


def measure(job: Job) -> dict[str, Any]:
    """Run a job and return its line; one that a guard or a fault ends says when."""
    line: dict[str, Any] = {"name": job.name, **asdict(job), "device": "cpu"}
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        tank = Tank(job, Path(folder))
        outside, ended = 0, None
        try:
            for until in np.linspace(0, job.until, 11)[1:]:
                tank.sim.run(until=float(until), progress=False)
                outside = max(outside, tank.values()["outside"])
        except libmpm.Error as error:
            ended = str(error).splitlines()[0]
        line |= {
            "particles": (job.cells * job.per_axis) ** 2,
            "steps": tank.sim.steps,
            "pipeline": tank.sim.pipeline,
            "seconds": round(time.perf_counter() - began, 2),
        }
        if ended is not None:
            line |= {"failed": ended, "reached": tank.sim.time}
        else:
            found = tank.values() | {"outside": outside}
            line["values"] = {k: float(f"{x:.8g}") for k, x in sorted(found.items())}
        return line | {"commit": bench.commit(), "version": tank.sim.version}


def missing(output: Path, only: str) -> Iterator[Job]:
    """Return the runs that a file lacks, and whose names have a part."""
    have = {line["name"] for line in load(output)}
    return (job for job in jobs() if job.name not in have and only in job.name)


def main() -> int:
    """Run the tanks, or write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="part of the names of runs")
    parser.add_argument("--budget", type=float, default=600.0, help="s of wall time")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--page", action="store_true", help="write tables and figure")
    a = parser.parse_args()
    if a.page:
        import yang_tanks_page

        yang_tanks_page.write(a.output)
        return 0
    chosen = list(missing(a.output, a.only))
    until = time.monotonic() + a.budget
    for job in chosen:
        if a.list:
            print(f"{job.name:48} {job.updates / 1e6:,.1f} M updates")
            continue
        if time.monotonic() > until:
            print(f"{job.name:48} no time left; give the command again")
            continue
        line = measure(job)
        append(a.output, line)
        print(f"{job.name:48} {line['steps']:,} steps in {line['seconds']:.0f} s "
              f"{line.get('failed') or line['values']}", flush=True)  # fmt: skip
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
