"""What one device does with more than the plain collapse: materials, sparse scenes, memory, size.

Every case of `CASES` runs scenes in the manner of ``libmpm bench`` and appends a JSON line for each
of them: the fields of its `Result`, and the case's own numbers. Rates are wall time over the steps
after the first one. Where a case compares, what it compares with runs in the same process.

Run:  python benchmarks/one_gpu.py --device cuda:0 --json FILE
      python benchmarks/one_gpu.py --device cpu --scale 1e-3 --steps 20
      python benchmarks/one_gpu.py --cases huge --particles 1e9

`first-step` counts the start of CUDA only in a process of its own or as the first case; memory is
most exact with `--cases memory` and `--cases huge` alone.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import itertools
import json
import math
import os
import resource
import shlex
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from one_gpu_scenes import add, domain, place, sand, solid, solids

import libmpm
from libmpm._src.cli.bench import COURANT, DENSITY, GRAVITY, HEIGHT, SOUND, collapse, timed, water

Line = dict[str, Any]
Sized = tuple[libmpm.Scene, float]
APIC = libmpm.Method(transfer="APIC")
AFLIP = libmpm.Method(transfer=libmpm.methods.Transfer(scheme="AFLIP", flip=0.95))
EDGE = 4  # cells of a block of the grid on each axis
BLOCKS, BLOCK = (6, 4), (8, 5, 4)  # how many float, and their size in cells


def used(device: str) -> int | None:
    """Return the bytes in use on "cuda:N" by all processes; None where that cannot be told."""
    index = int(device.partition(":")[2] or 0)
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    command = ["nvidia-smi", "-i", visible.split(",")[index] if visible else str(index)]
    command += ["--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
        return int(found.stdout) * 2**20
    except (OSError, ValueError, subprocess.SubprocessError):
        return None


@contextmanager
def watch(device: str) -> Iterator[Line]:
    """Yield what at the end holds the most memory in use beyond that at the start, bytes.

    The device is asked every 0.1 s. The host's is this process's own, and too high if something
    before the start took more.
    """
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    before = None if device == "cpu" else used(device)
    found: Line = {}
    done = threading.Event()

    def sample(start: int) -> None:
        found.update(device_bytes_before=start, device_bytes_taken=0, samples=0)
        while not done.is_set():
            taken = (used(device) or 0) - start
            found["device_bytes_taken"] = max(found["device_bytes_taken"], taken)
            found["samples"] += 1
            done.wait(0.1)

    thread = None if before is None else threading.Thread(target=sample, args=(before,))
    if thread is not None:
        thread.start()
    try:
        yield found
    finally:
        done.set()
        if thread is not None:
            thread.join()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        found["host_bytes_taken"] = max(0, peak - pages * resource.getpagesize())


class Runner:
    """Runs scenes on the device, one at a time, and makes their lines."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Take the options of the command."""
        self.arguments = arguments
        self.command = shlex.join(["python", *sys.argv])
        self.runs = 0  # in this process
        self._dense: dict[tuple[int, int], float] = {}

    def size(self, particles: float) -> int:
        """Return a number of particles after scaling."""
        return max(8, round(particles * self.arguments.scale))

    def steps(self, wanted: int) -> int:
        """Return the case's number of steps, or the one asked for."""
        return self.arguments.steps or wanted

    def run(
        self, case: str, sized: Sized, steps: int, state: str, *,
        places: NDArray[np.float64] | None = None,
        read: Callable[[libmpm.Simulation], Line] | None = None,
        each_tenth: Callable[[int, float], object] | None = None, **options: Any,
    ) -> Line:  # fmt: skip
        """Run a scene and return its line; nothing of the simulation is left afterwards.

        `read` takes further numbers from it at its end; `options` are those of `Simulation`.
        """
        scene, time_step = sized
        options = {"device": self.arguments.device, "time_step": time_step, **options}
        self.runs += 1
        simulation = None
        try:
            began = time.perf_counter()
            simulation = libmpm.Simulation(scene, **options)
            if places is not None:
                place(simulation, places)
            _ = simulation.engine  # constructed when first asked for
            constructed = time.perf_counter()
            simulation.step(1)
            stepped = time.perf_counter()
            result = timed(
                simulation, steps, case=case, state=f"{state}; {steps} steps after the first",
                command=self.command, each_tenth=each_tenth,
            )  # fmt: skip
            statistics = simulation.statistics
            line = asdict(result) | {
                "construction_s": constructed - began,
                "first_step_s": stepped - began,
                "first_in_process": self.runs == 1,
                "step_s": result.seconds / steps,
                "cells": list(scene.cells),
                "sorts": statistics.get("sorts"),
                "grid_blocks": statistics.get("blocks"),
                "held_bytes": statistics.get("bytes"),
                "most_bytes_used": statistics.get("most_bytes_used"),
                "most_bytes_held": statistics.get("most_bytes_held"),
            }
            return line | ({} if read is None else read(simulation))
        finally:
            del simulation
            gc.collect()

    def warm(self) -> None:
        """Start the device, so that no measurement or sample of memory contains it."""
        self.run("warm-up", collapse(self.size(1e5)), 10, "")

    def against_dense(self, line: Line) -> Line:
        """Return a line with its rate relative to the collapse of as many in single precision."""
        key = line["particles"], line["steps"]
        if key not in self._dense:
            dense = self.run("dense", collapse(key[0]), key[1], "collapse")
            self._dense[key] = dense["particle_steps_per_s"]
        ratio = line["particle_steps_per_s"] / self._dense[key]
        return line | {"dense_particle_steps_per_s": self._dense[key], "rate_to_dense": ratio}


Case = Callable[[Runner], Iterator[Line]]


def first_step(runner: Runner) -> Iterator[Line]:
    """Seconds from ``Simulation(...)`` to the first step done; the first run also starts CUDA."""
    for size in (1e6, 1e6, 8e6):
        sized = collapse(runner.size(size))
        yield runner.run("first-step", sized, runner.steps(100), "collapse")


def materials(runner: Runner) -> Iterator[Line]:
    """Every material: water with F-bar and without, sand, solids."""
    size, steps = runner.size(8e6), runner.steps(4000)
    lift = round(0.1 * collapse(size)[0].cells[1])
    falls = "cube that falls by a tenth of its height and rebounds"
    cases = [
        ("water", collapse(size), "collapse"),
        ("water without F-bar", collapse(size, "none"), "collapse"),
        ("sand", collapse(size, material=sand(), method=APIC), "collapse"),
    ]
    for material in solids():
        cases.append((type(material).__name__, collapse(size, material=material, lift=lift), falls))
    for name, sized, state in cases:
        yield runner.run(f"materials: {name}", sized, steps, state)


def solid_methods(runner: Runner) -> Iterator[Line]:
    """Solids with F-bar, and with transfers that store velocities: rate to APIC without F-bar."""
    size, steps = runner.size(8e6), runner.steps(2000)
    lift = round(0.1 * collapse(size)[0].cells[1])
    falls = "cube that falls by a tenth of its height and rebounds"
    for material in (solid(), sand()):
        kind, plain = type(material).__name__, 0.0
        forms = ("none", "two-volume") if kind == "FixedCorotated" else ("none",)
        for method, form, pipeline in itertools.product((APIC, AFLIP), forms, ("auto", "phased")):
            scheme = method.transfer_choice.scheme
            sized = collapse(size, form, material=material, lift=lift, method=method)
            case = f"solid-methods: {kind}, {scheme}, F-bar {form}, {pipeline}"
            line = runner.run(case, sized, steps, falls, pipeline=pipeline)
            plain = plain or line["particle_steps_per_s"]
            yield line | {"rate_to_plain": line["particle_steps_per_s"] / plain}
    for beside, kind in ((solid(), "solid"), (solids()[1], "neo-Hookean")):
        plain = 0.0
        for method in (APIC, AFLIP):
            sized = cubes(runner.size(4e6), ("water", "solid"), method, beside)
            case = f"solid-methods: water and {kind}, {method.transfer_choice.scheme}"
            line = runner.run(case, sized, steps, "solid and water side by side")
            plain = plain or line["particle_steps_per_s"]
            yield line | {"rate_to_plain": line["particle_steps_per_s"] / plain}


def cubes(
    particles: int, chosen: tuple[str, ...], method: libmpm.Method | None = None,
    beside: Any = None,
) -> Sized:  # fmt: skip
    """Return the scene of a cube of water that leans on one of a solid, or of one of them.

    `beside` is the solid in place of a fixed corotated one.
    """
    n = max(2, round((particles / 8) ** (1 / 3)))
    scene = domain("cubes", HEIGHT / n, (3 * n, n, math.ceil(1.25 * n)), method)
    if "water" in chosen:
        add(scene, "water", water(), (n, 0, 0), (n, n, n))
    if "solid" in chosen:
        add(scene, "solid", beside or solid(), (0, 0, 0), (n, n, n))
    return scene, COURANT * scene.cell_size / SOUND


def two_materials(runner: Runner) -> Iterator[Line]:
    """Water and a solid in one scene, and each alone: time of the step to the sum of both."""
    size, steps = runner.size(4e6), runner.steps(4000)
    alone = 0.0
    for chosen in (("solid",), ("water",)):
        name = f"two-materials: {chosen[0]} alone"
        line = runner.run(name, cubes(size, chosen), steps, "cube beside empty space")
        alone += line["step_s"]
        yield line
    sized = cubes(size, ("solid", "water"))
    line = runner.run("two-materials: both", sized, steps, "solid and water side by side")
    yield line | {"time_to_sum_alone": line["step_s"] / alone}


def blocks(runner: Runner) -> Iterator[Line]:
    """Water that carries floating blocks of a solid: time of the step to that of the water alone.

    Fewer blocks where the surface is too small for all.
    """
    size, steps = runner.size(8e6), runner.steps(4000)
    alone = runner.run("blocks: water alone", collapse(size), steps, "collapse")
    yield alone
    scene, time_step = collapse(size)
    n = scene.cells[1]
    nx, ny = (max(1, min(k, n // (e + 2))) for k, e in zip(BLOCKS, BLOCK, strict=False))
    for i, j in itertools.product(range(nx), range(ny)):
        # Half the water's density, so half above the surface.
        x, y = (i + 0.5) * n / nx - 0.5 * BLOCK[0], (j + 0.5) * n / ny - 0.5 * BLOCK[1]
        low = round(x), round(y), n - BLOCK[2] // 2
        add(scene, f"block {i},{j}", solid(0.5 * DENSITY), low, BLOCK, subtract_from=("water",))
    line = runner.run("blocks: with blocks", (scene, time_step), steps, "collapse with blocks")
    yield line | {"floating": nx * ny, "time_to_water_alone": line["step_s"] / alone["step_s"]}


def particles_per_cell(runner: Runner) -> Iterator[Line]:
    """As many particles in more or fewer cells."""
    for number in (1, 8, 27, 64):
        sized = collapse(max(8 * number, runner.size(8e6)), particles_per_cell=number)
        yield runner.run("particles-per-cell", sized, runner.steps(1000), "collapse")


def sheet(runner: Runner) -> Iterator[Line]:
    """A film one cell thick that slides over the floor at the speed of a fall from the height."""
    steps = runner.steps(1000)
    width = max(4, round(math.sqrt(runner.size(1e6) / 8)))
    dx = collapse(8 * width**2)[0].cell_size
    slide = EDGE * math.ceil(0.1 * COURANT * steps / EDGE) + 2 * EDGE
    scene = domain("sheet", dx, (width + slide, width, 4 * EDGE))
    add(scene, "water", water(), (0, 0, 0), (width, width, 1), velocity=(0.1 * SOUND, 0, 0))
    line = runner.run("sheet", (scene, COURANT * dx / SOUND), steps, "film that slides")
    yield runner.against_dense(line)


def drops(
    runner: Runner, name: str, offsets: NDArray[np.float64], scattered: bool = False
) -> Iterator[Line]:
    """Drops in blocks of the grid, one in each; `offsets` in cells, (k, 3).

    A drop lies in one cell of its block, drawn at random, or each particle in a cell of its own.
    """
    steps = runner.steps(1000)
    side = max(2, round((runner.size(5e5) / len(offsets)) ** (1 / 3)))
    dx = collapse(max(8, side**3 * len(offsets)))[0].cell_size
    # They fly and fall together, as the collapse does, and reach no wall.
    fall = 0.5 * GRAVITY * (COURANT * steps / SOUND) ** 2 * dx
    drift = EDGE * math.ceil(1.1 * 0.02 * COURANT * steps / EDGE)
    low = np.array([EDGE, EDGE, EDGE * (math.ceil(1.1 * fall / EDGE) + 1)])
    scene = domain(name, dx, (low + (side + 1) * EDGE + [drift, drift, 0]).tolist())
    flight = (0.02 * SOUND, 0.02 * SOUND, 0.0)
    add(scene, "water", water(), low.tolist(), (side * EDGE,) * 3, velocity=flight)
    corners = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    cells = len(offsets) if scattered else 1
    cell = np.random.default_rng(1).integers(0, EDGE, (len(corners), cells, 3))
    places = (low + EDGE * corners + cell + offsets).reshape(-1, 3) * dx
    sized = scene, COURANT * dx / SOUND
    line = runner.run(name, sized, steps, "drops that fly", places=places)
    yield runner.against_dense(line | {"particles_per_cell": None, "blocks_at_start": side**3})


def spray(runner: Runner) -> Iterator[Line]:
    """Blocks that hold four particles each, in one cell or scattered."""
    offsets = np.array([(x, y, 0.5) for x in (0.25, 0.75) for y in (0.25, 0.75)])
    yield from drops(runner, "spray: drops", offsets)
    yield from drops(runner, "spray: scattered", offsets, scattered=True)


def lone(runner: Runner) -> Iterator[Line]:
    """Blocks that hold one particle each."""
    yield from drops(runner, "lone", np.array([(0.3, 0.45, 0.6)]))


def column(n: int, steps: int, factor: float) -> Sized:
    """Return water that spreads on a floor, far from other walls; `factor` more in volume."""
    # In cells; no front is faster than 2 sqrt(g H).
    reach = 2 * math.sqrt(GRAVITY * HEIGHT) * COURANT * steps / SOUND
    width = n + 2 * EDGE * math.ceil((reach + 4) / EDGE)
    cells = [round(k * factor ** (1 / 3)) for k in (width, width, math.ceil(1.25 * n))]
    scene = domain("column", HEIGHT / n, cells)
    # Aligned with the blocks of the grid alike.
    low = EDGE * ((cells[0] - n) // 2 // EDGE)
    add(scene, "water", water(), (low, low, 0), (n, n, n))
    return scene, COURANT * scene.cell_size / SOUND


def empty_domain(runner: Runner) -> Iterator[Line]:
    """The same water in a domain of 100 times the volume: ratio of step times, medians of three."""
    cells = collapse(runner.size(1e6))[0].cells[1]
    steps = runner.steps(1000)
    state = "cube that spreads on a floor and reaches no other wall; median of three"
    found: dict[str, list[Line]] = {"small": [], "large": []}
    for _ in range(3):
        for name, factor in (("small", 1.0), ("large", 100.0)):
            sized = column(cells, steps, factor)
            found[name].append(runner.run(f"empty-domain: {name}", sized, steps, state))
    small, large = (sorted(lines, key=lambda a: a["seconds"])[1] for lines in found.values())
    yield small
    large["volume_ratio"] = math.prod(large["cells"]) / math.prod(small["cells"])
    yield large | {"time_to_small": large["step_s"] / small["step_s"]}


def two_pass(runner: Runner) -> Iterator[Line]:
    """The form in two passes, in every precision."""
    for precision in ("single", "mixed", "double"):
        yield runner.run(
            f"two-pass: {precision}", collapse(runner.size(8e6)), runner.steps(1000), "collapse",
            precision=precision, pipeline="two-pass",
        )  # fmt: skip


def watched(runner: Runner, case: str, particles: int, steps: int, progress: bool) -> Line:
    """Return the line of a collapse with the plan's memory and the memory taken."""

    def report(done: int, seconds: float) -> None:
        print(f"{case}: {done} of {steps} steps in {seconds:.2f} s", flush=True)

    with watch(runner.arguments.device) as taken:
        line = runner.run(
            case, collapse(particles), steps, "collapse", each_tenth=report if progress else None,
            read=lambda simulation: {
                "plan_bytes": simulation.plan.memory_total,
                "plan_memory": dict(simulation.plan.memory),
                "plan_columns_per_particle": simulation.plan.bytes_per_particle("water"),
            },
        )  # fmt: skip
    for where in ("device", "host"):
        if f"{where}_bytes_taken" in taken:
            each = taken[f"{where}_bytes_taken"] / line["particles"]
            line[f"{where}_bytes_per_particle"] = each
    return line | taken


def memory(runner: Runner) -> Iterator[Line]:
    """Memory that the plan says, that the engine holds and that the device gives."""
    yield watched(runner, "memory", runner.size(64e6), runner.steps(200), False)


def huge(runner: Runner) -> Iterator[Line]:
    """As many particles as the device takes; the host should hold next to nothing."""
    size = runner.size(runner.arguments.particles)
    yield watched(runner, "huge", size, runner.steps(1000), True)


def reproducible(runner: Runner) -> Iterator[Line]:
    """SHA-256 of the positions, in the order of the ids, at the end of three runs."""

    def digest(simulation: libmpm.Simulation) -> Line:
        position = simulation.particles["water"]["position"]
        return {"sha256": hashlib.sha256(position.tobytes()).hexdigest()}

    size, steps = runner.size(1e6), runner.steps(3000)
    lines = [
        runner.run("reproducible", collapse(size), steps, "collapse", read=digest) for _ in range(3)
    ]
    found = [line["sha256"] for line in lines]
    yield lines[-1] | {"sha256": found, "equal": len(set(found)) == 1}


CASES: dict[str, Case] = {
    case.__name__.replace("_", "-"): case
    for case in (
        first_step, materials, solid_methods, two_materials, blocks, particles_per_cell, sheet,
        spray, lone, empty_domain, two_pass, reproducible, memory, huge,
    )
}  # fmt: skip
#: Numbers of single cases that the table shows.
SHOWN = [
    "rate_to_dense", "time_to_sum_alone", "time_to_water_alone", "time_to_small", "equal",
    "plan_bytes", "device_bytes_taken", "device_bytes_per_particle", "host_bytes_per_particle",
]  # fmt: skip


def table(lines: list[Line]) -> str:
    """Return the lines as a table for a terminal."""
    rows = [["case", "particles", "per cell", "steps", "particle-steps/s", "ms/step", "also"]]
    for line in lines:
        shown = list(SHOWN)
        if line["case"] in ("first-step", "memory", "huge"):
            shown += ["first_step_s", "held_bytes", "most_bytes_used", "most_bytes_held"]
        shown = [k for k in shown if line.get(k) is not None]  # a CPU has no memory of its own
        row = [line["case"], f"{line['particles']:,}", str(line["particles_per_cell"] or "")]
        row += [f"{line['steps']:,}", f"{line['particle_steps_per_s']:.3e}"]
        also = ", ".join(f"{k} {line[k]:.5g}" for k in shown)
        rows.append([*row, f"{1e3 * line['step_s']:.3f}", also])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def main() -> int:
    """Run the cases, append their lines to a file if asked, and print the table."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--device", default="cuda:0", help="cpu, cuda or cuda:N")
    parser.add_argument("--cases", default=",".join(CASES), help="default: %(default)s")
    parser.add_argument("--scale", type=float, default=1.0, help="of the numbers of particles")
    parser.add_argument("--steps", type=int, default=0, help="instead of each case's own; ≥ 10")
    parser.add_argument("--particles", type=float, default=2e9, help="of `huge`, before scaling")
    parser.add_argument("--json", type=Path, help="append the lines to this file")
    arguments = parser.parse_args()
    chosen = arguments.cases.split(",")
    if unknown := [name for name in chosen if name not in CASES]:
        parser.error(f"no case {', '.join(unknown)}; expected some of {', '.join(CASES)}")
    # Thin films and blocks are meant here.
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    runner, lines, failed = Runner(arguments), [], []
    for name in chosen:
        print(f"== {name}: {(CASES[name].__doc__ or '').splitlines()[0]}", flush=True)
        try:
            if name != "first-step":
                runner.warm()
            for line in CASES[name](runner):
                lines.append(line)
                print(json.dumps(line), flush=True)
                if arguments.json is not None:
                    with arguments.json.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(line) + "\n")
        except (libmpm.Error, MemoryError):
            traceback.print_exc()
            failed.append(name)
        gc.collect()
    print(table(lines))
    if failed:
        print(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
