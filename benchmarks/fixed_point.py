"""What integer sums on the nodes of a GPU do to long runs: three cases on one device and precision.

Every case of `CASES` appends a JSON line per checkpoint. Its values are parts of a scale of the
case; H is the depth of the tank or the height of the column, c0 = 10 sqrt(2 g H), and time steps
are 0.3 dx / c0 except for the bar's own.

Run:  python benchmarks/fixed_point.py --device cuda:0 --precision single --json FILE
      python benchmarks/fixed_point.py --device cpu --precision double --steps 100000 --cases tank
      python benchmarks/fixed_point.py --compare FILE

`--compare` prints a Markdown table per case: at each step the values of the CPU in double
precision, and below them what the newest line of every other device, precision and pipeline
differs by. That is relative to the value, and for the columns of `PLAIN`, marked Δ, the difference
itself: they are errors, drifts, speeds or energies that may be zero.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import shlex
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import libmpm
from libmpm import boundaries, sensors, shapes
from libmpm._src.cli import bench
from libmpm._src.cli.bench import COURANT, DENSITY, GRAVITY, HEIGHT, SOUND

# The script beside this one, and through it the scenes of the tests.
fbar_forms: Any = importlib.import_module("fbar_forms")
scenes: Any = fbar_forms.scenes

Line = dict[str, Any]
FULL = DENSITY * GRAVITY * HEIGHT  # ρ g H, Pa
FALL = math.sqrt(HEIGHT / GRAVITY)  # sqrt(H / g), s
#: Tank: width and depth in cells, steps at which it is sampled, samples of the node speeds.
WIDTH, LAYERS, CHECKPOINTS, SAMPLES = 8, 40, (10_000, 100_000, 300_000, 1_000_000), 20
#: Bar: density in kg/m³, modulus in Pa, length and height in m; the speed is 1 m/s.
BAR, MODULUS, LENGTH, THICK = 1000.0, 1e6, 0.5, 0.1
#: Collapse: the box and the column in cells, samples in sqrt(H / g), number of wave gauges.
BOX, COLUMN, TIMES, GAUGES = (64, 32), (24, 24), (1, 2, 4, 8, 16, 24, 32), 8
PLAIN = {"speed", "profile", "bed", "volume", "mass", "lift", "momentum", "kinetic", "elastic"}


class Run:
    """A simulation on the device asked for, and the wall time that its steps took."""

    def __init__(
        self, arguments: argparse.Namespace, scene: libmpm.Scene, time_step: float | None = None
    ) -> None:
        """Make the simulation; nothing has run yet."""
        self.simulation = libmpm.Simulation(
            scene, device=arguments.device, precision=arguments.precision,
            pipeline=arguments.pipeline, threads=arguments.threads, time_step=time_step,
        )  # fmt: skip
        self.seconds = 0.0
        self.body = self.simulation.particles[scene.bodies[0].name]

    def advance(self, until: int) -> None:
        """Go on to step `until`."""
        began = time.perf_counter()
        self.simulation.step(until - self.simulation.steps)
        self.seconds += time.perf_counter() - began

    def momentum(self) -> NDArray[np.float64]:
        """Return the sum over the nodes, kg m/s."""
        grid = self.simulation.grid
        return np.asarray(grid["mass"] @ grid["velocity"])

    def mass_error(self) -> float:
        """Return the mass on the grid relative to that of the particles, less one."""
        return float(np.sum(self.simulation.grid["mass"]) / np.sum(self.body["mass"]) - 1)

    def line(self, case: str, values: dict[str, float]) -> Line:
        """Return what a checkpoint writes; `seconds` are those of all steps so far."""
        simulation = self.simulation
        return {
            "case": case,
            "backend": simulation.device.partition(":")[0],
            "device": bench._device(simulation),
            "precision": simulation.precision,
            "pipeline": simulation.pipeline,
            "particles": len(self.body),
            "steps": simulation.steps,
            "time": simulation.time,
            "seconds": self.seconds,
            "values": {name: float(value) for name, value in values.items()},
            "commit": bench.commit(),
            "version": simulation.version,
            "command": shlex.join(["python", *sys.argv]),
        }


# ---- cases --------------------------------------------------------------------------------------


def late_speed(run: Run, until: int) -> float:
    """Go on to step `until`; return the rms node speed, m/s, over the last tenth of the steps."""
    tenth = min(until // 10, until - run.simulation.steps)
    squares = []
    for k in range(1, SAMPLES + 1):
        run.advance(until - tenth + tenth * k // SAMPLES)
        squares.append(np.mean(np.sum(run.simulation.grid["velocity"] ** 2, axis=1)))
    return math.sqrt(np.mean(squares))


def tank(arguments: argparse.Namespace) -> Iterator[Line]:
    """Water at rest: what creeps in over a million steps.

    speed of the nodes, rms over the last tenth of the steps, parts of sqrt(g H); profile and bed:
    rms over layers of the layer's mean pressure error, and the lowest layer's, parts of ρ g H;
    volume: drift of the sum; mass: grid to particles, less one; lift of the centre of mass, cells.
    """
    scene = fbar_forms.make("default", LAYERS, WIDTH, COURANT)
    dx = scene.cell_size
    run = Run(arguments, scene, COURANT * dx / SOUND)
    volume, height = np.sum(run.body["volume"]), np.mean(run.body["position"][:, 1])
    for until in sorted({n for n in CHECKPOINTS if n < arguments.steps} | {arguments.steps}):
        speed = late_speed(run, until)
        error = fbar_forms.errors(run.simulation.engine, LAYERS, scene.bodies[0].material)
        values = {
            "speed": speed / math.sqrt(GRAVITY * HEIGHT),
            "profile": error["profile"],
            "bed": error["bed"],
            "volume": np.sum(run.body["volume"]) / volume - 1,
            "mass": run.mass_error(),
            "lift": (np.mean(run.body["position"][:, 1]) - height) / dx,
        }
        yield run.line("tank", values)


def bar(arguments: argparse.Namespace) -> Iterator[Line]:
    """Elastic bar against a wall, as tests/validation/test_bar_impact.py measures it.

    contact: time with at least half of v A sqrt(ρ E), parts of 2 sqrt(m / k); peak: the largest
    force, parts of v A sqrt(ρ E); rebound: velocity of the centre of mass at the end, parts of v;
    momentum: error of what bar and wall have together, parts of m v.
    """
    duration, expected = 2 * LENGTH * math.sqrt(BAR / MODULUS), THICK * math.sqrt(BAR * MODULUS)
    run = Run(arguments, scenes.bar(BAR, modulus=MODULUS))
    first = run.momentum()
    run.advance(math.ceil((0.02 + 1.5 * duration) / run.simulation.dt))
    values = {"rebound": np.mean(run.body["velocity"][:, 0]), "mass": run.mass_error()}
    last = run.momentum()
    # The grid shows the velocities of the coming step; the load cell learns of it in that step.
    run.advance(run.simulation.steps + 1)
    moment, length, pushed = scenes.force(run.simulation)
    force, half = -pushed[:, 0], expected / 2
    above = np.flatnonzero(force > half)
    ends = [(above[0] - 1, above[0]), (above[-1] + 1, above[-1])]
    start, end = (np.interp(half, force[[i, j]], moment[[i, j]]) for i, j in ends)
    missing = last - first + np.sum(pushed * length[:, None], axis=0)
    values |= {
        "contact": (end - start) / duration,
        "peak": np.max(force) / expected,
        "momentum": np.linalg.norm(missing) / (BAR * LENGTH * THICK),
    }
    yield run.line("bar", values)


def column() -> libmpm.Scene:
    """Return the scene of the collapse: a closed box with slip walls and a column on the left."""
    dx = HEIGHT / COLUMN[1]
    width, roof = (n * dx for n in BOX)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(width, roof), gravity=(0, -GRAVITY),
        name="collapse",
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(COLUMN[0] * dx, HEIGHT)),
        material=bench.water(),
        particles_per_cell=4,
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    for k in range(GAUGES):
        gauge = sensors.WaveGauge(position=((k + 0.5) * width / GAUGES,), interval=0.05 * FALL)
        scene.add_sensor(name=f"gauge {k}", sensor=gauge)
    return scene


def collapse(arguments: argparse.Namespace) -> Iterator[Line]:
    """Column that collapses in a closed box, hits the far wall and sloshes until it has settled.

    kinetic, elastic and potential energy, parts of M g H / 2; x and y of the centre of mass and the
    front, parts of H; pressure: the largest |p|, parts of ρ g H; volume: change of the sum; level:
    mean of the gauges over the last tenth of the time, parts of the depth of the volume at rest.
    """
    scene = column()
    time_step = COURANT * scene.cell_size / SOUND
    run = Run(arguments, scene, time_step)
    mass, volume = run.body["mass"], np.sum(run.body["volume"])
    whole = np.sum(mass) * GRAVITY * HEIGHT / 2
    for until in TIMES:
        run.advance(round(until * FALL / time_step))
        read = run.body.read(["position", "pressure", "kinetic_energy", "elastic_energy", "volume"])
        centre = np.average(read["position"], axis=0, weights=mass)
        values = {
            "kinetic": np.sum(read["kinetic_energy"]) / whole,
            "elastic": np.sum(read["elastic_energy"]) / whole,
            "potential": 2 * centre[1] / HEIGHT,
            "x": centre[0] / HEIGHT,
            "y": centre[1] / HEIGHT,
            "front": np.max(read["position"][:, 0]) / HEIGHT,
            "pressure": np.max(np.abs(read["pressure"])) / FULL,
            "volume": np.sum(read["volume"]) / volume - 1,
            "mass": run.mass_error(),
        }
        if until == TIMES[-1]:
            series = [run.simulation.sensors[f"gauge {k}"] for k in range(GAUGES)]
            late = [s.values[s.time > 0.9 * run.simulation.time] for s in series]
            values["level"] = np.mean(np.concatenate(late)) * scene.upper[0] / volume
        yield run.line("collapse", values)


Case = Callable[[argparse.Namespace], Iterator[Line]]
CASES: dict[str, Case] = {case.__name__: case for case in (tank, bar, collapse)}


# ---- comparison ---------------------------------------------------------------------------------


def tables(lines: list[Line]) -> str:
    """Return the values of the CPU in double precision and how the other lines differ."""
    found: dict[str, dict[int, dict[str, Line]]] = {}
    for line in lines:
        machine = "{backend} {precision}, {pipeline}".format(**line)
        found.setdefault(line["case"], {}).setdefault(line["steps"], {})[machine] = line
    out = []
    for case, checkpoints in found.items():
        every = [line for machines in checkpoints.values() for line in machines.values()]
        names = list(dict.fromkeys(name for line in every for name in line["values"]))
        titles = [f"Δ {name}" if name in PLAIN else name for name in names]
        out.append("| " + " | ".join([case, "steps", *titles]) + " |")
        out.append("| --- |" + " ---: |" * (1 + len(names)))
        for steps, machines in sorted(checkpoints.items()):
            reference = next((m for m in machines if m.startswith("cpu double")), None)
            if reference is None:
                out.append(f"| no line of the CPU in double precision | {steps:,} |")
                continue
            base = machines.pop(reference)["values"]
            rows = [(reference, [f"{base[n]:.5g}" if n in base else "" for n in names])]
            for machine, line in machines.items():
                value = line["values"]
                rows.append((machine, [
                    f"{(value[n] - base[n]) / (1 if n in PLAIN else abs(base[n]) or 1):+.1e}"
                    if n in base and n in value else "" for n in names
                ]))  # fmt: skip
            out += [f"| {m} | {steps:,} | " + " | ".join(cells) + " |" for m, cells in rows]
        out.append("")
    return "\n".join(out)


def main() -> int:
    """Run the cases and append their lines to a file if asked, or compare the lines of one."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--device", default="cuda:0", help="cpu, cuda or cuda:N")
    parser.add_argument("--precision", default="single", help="single or double")
    parser.add_argument("--pipeline", default="auto", help="auto, fused or two-pass")
    parser.add_argument("--threads", type=int, default=1, help="of the CPU")
    parser.add_argument("--steps", type=int, default=CHECKPOINTS[-1], help="of the tank")
    parser.add_argument("--cases", default=",".join(CASES), help="default: %(default)s")
    parser.add_argument("--json", type=Path, help="append the lines to this file")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="run nothing; print tables")
    arguments = parser.parse_args()
    if arguments.compare is not None:
        text = arguments.compare.read_text(encoding="utf-8")
        print(tables([json.loads(line) for line in text.splitlines() if line]))
        return 0
    chosen = arguments.cases.split(",")
    if unknown := [name for name in chosen if name not in CASES]:
        parser.error(f"no case {', '.join(unknown)}; expected some of {', '.join(CASES)}")
    failed = False
    for name in chosen:
        try:
            for line in CASES[name](arguments):
                print(json.dumps(line), flush=True)
                if arguments.json is not None:
                    with arguments.json.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(line) + "\n")
        except libmpm.Error:
            traceback.print_exc()
            failed = True
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
