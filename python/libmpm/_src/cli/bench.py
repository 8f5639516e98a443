"""`libmpm bench`: a cube of water collapses in a box twice as long.

8 particles per cell, sound speed c0 = 10 sqrt(2 g H), time step 0.3 dx / c0, wall time over the
first 10,000 steps with sorts and without output. `measure` is what `libmpm bench` runs; the scripts
under ``benchmarks/`` also take `collapse` and `timed` for cases of their own.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import platform
import shlex
import subprocess
import sys
import time as clock
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from libmpm._src.base.arguments import path_option
from libmpm._src.base.tables import pair_table
from libmpm._src.boundaries import responses
from libmpm._src.cli import info
from libmpm._src.errors import SceneError
from libmpm._src.materials.generated import TaitFluid
from libmpm._src.materials.material import Material
from libmpm._src.methods.method import FBar, Method
from libmpm._src.methods.smoothing import Smoothing
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.places import planes
from libmpm._src.scene.scene import Body, Scene
from libmpm._src.shapes import boxes

__all__ = ["Result", "add_arguments", "collapse", "measure", "run_command", "timed", "water"]

GRAVITY = 9.81
#: Edge of the cube, m; results do not depend on it, as all speeds scale with it.
HEIGHT = 1.0
DENSITY = 1000.0
#: Speed of sound c0 of the water, m/s.
SOUND = 10 * math.sqrt(2 * GRAVITY * HEIGHT)
#: Part of a cell that sound crosses in a step.
COURANT = 0.3
PARTICLES_PER_CELL = 8
FBAR_FORMS = ("default", "none", "one-volume-gradient", "one-volume", "two-volume", "stress-only")


@dataclass(frozen=True)
class Result:
    """One measurement; speeds in particle-steps/s, `phases` as shares of the engine's time."""

    case: str
    particles: int
    particles_per_cell: int
    precision: str
    fbar: str
    steps: int
    particle_steps_per_s: float
    first_tenth: float
    last_tenth: float
    seconds: float
    bytes_per_particle: float
    phases: dict[str, float]
    pipeline: str
    state: str
    device: str
    commit: str
    command: str
    version: str

    def line(self) -> str:
        """Return the measurement as one line of JSON."""
        return json.dumps(asdict(self))


def water() -> TaitFluid:
    """Return the material of the case."""
    return TaitFluid(density=DENSITY, bulk_modulus=DENSITY * SOUND**2)


def collapse(
    particles: int,
    fbar: str = "default",
    *,
    material: Material | None = None,
    particles_per_cell: int = PARTICLES_PER_CELL,
    lift: int = 0,
    method: Method | None = None,
    smoothing: Smoothing | None = None,
    cell: Literal["auto", "held", "linear"] = "auto",
) -> tuple[Scene, float]:
    """Return the scene with about `particles` particles, and its time step, s.

    `material` replaces the water, with a wave speed of `SOUND` or less; `lift` is the height in
    cells from which the cube falls first; `method` replaces the default one; `smoothing` over cells
    stands in place of F-bar; `cell` is that of the walls.
    """
    if particles < particles_per_cell:
        raise SceneError(f"bench: {particles} particles; expected {particles_per_cell} or more")
    if fbar not in FBAR_FORMS:
        raise SceneError(f"bench: fbar is {fbar!r}; expected one of {', '.join(FBAR_FORMS)}")
    cells = max(2, round((particles / particles_per_cell) ** (1 / 3)))
    dx = HEIGHT / cells
    # Head room for the splash against the far wall: it rises to the cube's height at most.
    roof = math.ceil(1.25 * cells) * dx
    scene = Scene(
        dimension=3,
        cell_size=dx,
        lower=(0, 0, 0),
        upper=(2 * cells * dx, cells * dx, roof + lift * dx),
        gravity=(0, 0, -GRAVITY),
        method=method,
        name="collapse",
    )
    form: Any = {"default": "default", "none": None}.get(fbar, fbar)
    if smoothing is not None:
        form = None
    if form not in ("default", None):
        form = FBar(form=form, length=dx) if form == "two-volume" else FBar(form=form)
    scene.add_body(
        name="water" if material is None else "solid",
        shape=boxes.Box(
            lower=(0, 0, lift * dx), upper=(cells * dx, cells * dx, (cells + lift) * dx)
        ),
        material=water() if material is None else material,
        particles_per_cell=particles_per_cell,
        fbar=form,
        smoothing=smoothing,
    )
    scene.add_boundary(name="walls", shape=boxes.DomainWalls(), response=responses.Slip(cell=cell))
    return scene, COURANT * dx / SOUND


def commit() -> str:
    """Return the revision of the source tree that this module lies in, or "installed"."""
    folder = Path(__file__).resolve().parent
    try:
        found = subprocess.run(
            ["git", "-C", str(folder), "rev-parse", "--short=12", "HEAD"],
            capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
        changed = subprocess.run(
            ["git", "-C", str(folder), "status", "--porcelain", "--untracked-files=no"],
            capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return "installed"
    return found.stdout.strip() + ("+changes" if changed.stdout.strip() else "")


def _device(simulation: Simulation) -> str:
    found = info.collect()
    if simulation.device == "cpu":
        name = platform.processor() or platform.machine()
        for line in _lines("/proc/cpuinfo"):
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
        threads = simulation.threads or found["threads"]
        return f"{name}, {threads} threads, {found['instruction_set']}"
    index = int(simulation.device.partition(":")[2])
    return str(found["devices"][index]["name"])


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def measure(
    *,
    particles: int = 100_000,
    precision: str = "single",
    device: str = "auto",
    steps: int = 10_000,
    fbar: str = "default",
    pipeline: str = "auto",
    threads: int = 0,
    walls: Literal["auto", "held", "linear"] = "auto",
    command: str = "",
) -> Result:
    """Run the case and return the measurement; construction and sampling are not timed."""
    scene, time_step = collapse(particles, fbar, cell=walls)
    simulation = Simulation(
        scene, device=device, precision=precision, pipeline=pipeline, threads=threads,
        time_step=time_step,
    )  # fmt: skip
    state = f"first {steps} steps of the collapse, sorts included, no output, {_cells(scene)} walls"
    return timed(simulation, steps, state=state, command=command)


def timed(
    simulation: Simulation,
    steps: int,
    *,
    case: str = "collapse",
    state: str = "",
    command: str = "",
    each_tenth: Callable[[int, float], object] | None = None,
) -> Result:
    """Advance a simulation and return the measurement; construction is not timed.

    `each_tenth` receives steps and seconds so far. Per cell and F-bar are those of the first body.
    """
    if steps < 10:
        raise SceneError(f"bench: {steps} steps; expected 10 or more, one for each tenth")
    count = sum(len(body) for body in simulation.particles.values())
    before = simulation.timings
    bounds = [round(i * steps / 10) for i in range(11)]
    marks = [clock.perf_counter()]
    for low, high in itertools.pairwise(bounds):
        simulation.step(high - low)
        marks.append(clock.perf_counter())
        if each_tenth is not None:
            each_tenth(high, marks[-1] - marks[0])
    after = simulation.timings
    spent = {k: v - before.get(k, 0.0) for k, v in after.items()}
    total = sum(spent.values()) or 1.0
    seconds = marks[-1] - marks[0]
    body = simulation.scene.bodies[0]
    return Result(
        case=case,
        particles=count,
        particles_per_cell=body.particles_per_cell,
        precision=simulation.precision,
        fbar=_form(body),
        steps=steps,
        particle_steps_per_s=count * steps / seconds,
        first_tenth=count * bounds[1] / (marks[1] - marks[0]),
        last_tenth=count * (bounds[10] - bounds[9]) / (marks[10] - marks[9]),
        seconds=seconds,
        bytes_per_particle=simulation.plan.memory_total / count,
        phases={k: v / total for k, v in spent.items()},
        pipeline=simulation.pipeline,
        state=state,
        device=_device(simulation),
        commit=commit(),
        command=command or shlex.join(["libmpm", *sys.argv[1:]]),
        version=simulation.version,
    )


def _cells(scene: Scene) -> str:
    """Return how the cells beside the walls strain: "held" or "linear"."""
    return planes(scene)[0].cell


def _form(body: Body) -> str:
    """Return the F-bar form that ran, also where it was left to the default."""
    if body.fbar == "default":
        return FBar().form if body.material.table.stores_volume else "none"
    return "none" if body.fbar is None else body.fbar.form


def describe(result: Result) -> str:
    """Return the measurement as text."""
    phases = ", ".join(
        f"{name} {share:.1%}"
        for name, share in sorted(result.phases.items(), key=lambda item: -item[1])
    )
    rows = [
        ("case", f"{result.case}: {result.state}"),
        ("particles", f"{result.particles:,}, {result.particles_per_cell} per cell"),
        ("precision", f"{result.precision}, F-bar {result.fbar}, pipeline {result.pipeline}"),
        ("device", result.device),
        ("speed", f"{result.particle_steps_per_s:.3e} particle-steps/s ({result.seconds:.2f} s)"),
        ("first tenth", f"{result.first_tenth:.3e} particle-steps/s"),
        ("last tenth", f"{result.last_tenth:.3e} particle-steps/s"),
        ("memory", f"{result.bytes_per_particle:.1f} bytes per particle in all"),
        ("phases", phases or "not measured"),
    ]
    return pair_table(rows, 12)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``libmpm bench``."""
    parser.add_argument("--particles", type=int, default=100_000, help="about this many")
    parser.add_argument("--precision", default="single", help="single, mixed or double")
    parser.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--fbar", default="default", help=", ".join(FBAR_FORMS))
    parser.add_argument("--pipeline", default="auto", help="auto, fused, two-pass or phased")
    parser.add_argument("--walls", default="auto", help="cells beside them: auto, held or linear")
    parser.add_argument("--threads", type=int, default=0, help="CPU threads; 0 = default")
    parser.add_argument("--json", type=path_option, help="append the JSON line to this file")


def run_command(arguments: argparse.Namespace) -> int:
    """Measure, print the result and its JSON line, and append the line to a file if asked."""
    result = measure(
        particles=arguments.particles,
        precision=arguments.precision,
        device=arguments.device,
        steps=arguments.steps,
        fbar=arguments.fbar,
        pipeline=arguments.pipeline,
        threads=arguments.threads,
        walls=arguments.walls,
    )
    if arguments.json is not None:
        from libmpm._src.output.atomic_files import writing

        # Before it is printed: who reads that may have gone (`| head`).
        with writing(arguments.json), arguments.json.open("a", encoding="utf-8") as file:
            file.write(result.line() + "\n")
    print(describe(result))
    print(result.line())
    return 0
