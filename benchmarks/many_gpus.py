"""What several devices do with one scene: weak and strong scaling, and water that mixes.

Each case runs on the first 1, 2, 4 ... of the devices that are given and appends a JSON line for
each. Rates are wall time over the steps after the first ones; bytes are those of a step, of all
ranks, that are sent to others or read by them (sums added in place: added there, at most). Cases on
several devices say what part of the rate a device has of one alone in the same process
(`efficiency`), where that was run.

Run:  python benchmarks/many_gpus.py --devices cuda:0 cuda:1 --json FILE
      python benchmarks/many_gpus.py --cases weak strong --seconds 10 --fbar default
      LIBMPM_RANK_WAIT=flags python benchmarks/many_gpus.py ...
      python benchmarks/many_gpus.py --processes ...    # one process a device, over NCCL
      srun -n 8 python benchmarks/many_gpus.py --processes ...    # on many hosts: all 8 alone
      python benchmarks/many_gpus.py --devices cpu cpu --scale 1e-4 --steps 40
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import json
import math
import os
import shlex
import socket
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import libmpm
from libmpm._src.cli.bench import COURANT, GRAVITY, HEIGHT, SOUND, collapse, commit, water
from libmpm._src.run.backends import core
from libmpm._src.run.rank_messages import Link

Line = dict[str, Any]
Sized = tuple[libmpm.Scene, float]
CHUNK = 50  # steps between two looks at the clock
WARM = 20  # steps that are not measured
WAITS = os.environ.get("LIBMPM_RANK_WAIT", "events")  # how devices wait for each other
LAUNCHED = any(
    name in os.environ for name in ("RANK", "OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID")
)
STARTED = "MANY_GPUS_STARTED"  # set for the processes that this script has started


def slosh(
    particles: int, lengths: int, fbar: str, *, bodies: int = 1, transfer: str | None = None
) -> Sized:
    """Return a tank of `lengths` cubes of water in a row, about `particles` each, and a time step.

    The water starts with a twentieth of the speed of sound along the row, runs up at its end and
    comes back: it crosses every cut that is not along the row. Each cube adds the same work. It is
    one body, or as many `bodies` one behind the other: ids of one body have 32 bits. `transfer`
    replaces the default one.
    """
    n = max(4, round((particles / 8) ** (1 / 3)))
    dx = HEIGHT / n
    scene = libmpm.Scene(
        dimension=3, cell_size=dx, lower=(0, 0, 0),
        upper=((lengths * n + n // 4) * dx, n * dx, (n + n // 2) * dx),
        gravity=(0, 0, -GRAVITY), name="slosh",
        method=None if transfer is None else libmpm.Method(transfer=transfer),
    )  # fmt: skip
    ends = [round(k * lengths * n / bodies) * dx for k in range(bodies + 1)]
    for k in range(bodies):
        scene.add_body(
            name=f"water-{k}" if bodies > 1 else "water",
            shape=libmpm.shapes.Box(lower=(ends[k], 0, 0), upper=(ends[k + 1], n * dx, n * dx)),
            material=water(), particles_per_cell=8, velocity=(0.05 * SOUND, 0, 0),
            hydrostatic=n * dx, fbar="default" if fbar == "default" else None,
        )  # fmt: skip
    slip = libmpm.boundaries.Slip()
    scene.add_boundary(name="walls", shape=libmpm.shapes.DomainWalls(), response=slip)
    return scene, COURANT * dx / SOUND


def devices_named(names: list[str]) -> list[str]:
    """Return what the devices are, for the line."""
    if all(name == "cpu" for name in names):
        return ["CPU"] * len(names)
    try:
        command = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
        found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
        listed = found.stdout.strip().splitlines()
        return [listed[int(name.partition(":")[2] or 0)] for name in names]
    except (OSError, IndexError, subprocess.SubprocessError):
        return list(names)


def job() -> Link:
    """Return the link of this process to the others of its job."""
    return Link.of_job(core())


def digest(simulation: libmpm.Simulation) -> str:
    """Return a hash of positions and ids, in the order of the ids."""
    total = hashlib.sha256()
    for name in simulation.particles:
        body = simulation.gather(name, "position")
        if body is None:
            return ""
        ids = np.asarray(body["id"])
        order = np.argsort(ids)
        if not (ids[order] == ids[order[0]] + np.arange(len(ids))).all():
            raise RuntimeError("a particle is lost or there twice")
        total.update(np.ascontiguousarray(np.asarray(body["position"])[order]).tobytes())
    return total.hexdigest()[:16]


class Runner:
    """Runs scenes on some of the devices, one at a time, and makes their lines."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Take the options of the command."""
        self.arguments = arguments
        self.command = shlex.join(["python", *sys.argv])
        self._alone: dict[str, float] = {}

    def size(self, particles: float) -> int:
        """Return a number of particles after scaling."""
        return max(8, round(particles * self.arguments.scale))

    def counts(self) -> list[int]:
        """Return how many devices to take, one after another."""
        if self.arguments.processes and LAUNCHED:
            return [job().ranks]
        most = len(self.arguments.devices)
        return [n for n in self.arguments.counts or (1, 2, 4, 8) if n <= most]

    def run(
        self,
        case: str,
        sized: Sized,
        ranks: int,
        steps: int,
        *,
        bits: bool = False,
        partition: libmpm.Partition | None = None,
    ) -> Line:
        """Run a scene on the first `ranks` devices until the steps or the seconds are over.

        With `bits` all steps are made, and positions digested; with a `partition` of its own all
        steps are made, and the most uneven share at the end of a chunk is told.
        """
        scene, time_step = sized
        names = self.arguments.devices[:ranks]
        began = time.perf_counter()
        where: dict[str, Any] = {"device": names[0] if ranks == 1 else names}
        if self.arguments.processes:
            mine = names[int(os.environ["RANK"])] if STARTED in os.environ else None
            kind = names[0].partition(":")[0]
            where = {"device": mine or kind, "ranks": "processes"}
        simulation = libmpm.Simulation(
            scene,
            time_step=time_step,
            precision=self.arguments.precision,
            partition=partition,
            **where,
        )
        names = simulation._assembly.backend.devices
        try:
            _ = simulation.engine
            constructed = time.perf_counter()
            simulation.step(min(WARM, steps))
            before, at = simulation.statistics, simulation.timings
            started = time.perf_counter()
            marks = [(0, 0.0)]
            shares = [float(before.get("imbalance", 1.0))]
            whole = bits or partition is not None
            while marks[-1][0] < steps:
                over = not whole and marks[-1][1] >= self.arguments.seconds
                if simulation._shared.agreed("over" if over else ""):
                    break
                simulation.step(min(CHUNK, steps - marks[-1][0]))
                marks.append((simulation.steps - WARM, time.perf_counter() - started))
                if partition is not None:
                    shares.append(float(simulation.statistics.get("imbalance", 1.0)))
            done, seconds = marks[-1]
            after = simulation.statistics
            count = sum(simulation.totals())
            rate = count * done / seconds

            def since(name: str) -> float:
                return float(after.get(name, 0.0)) - float(before.get(name, 0.0))

            def part(first: int, last: int) -> float:
                (a, s), (b, t) = marks[first], marks[last]
                return count * (b - a) / (t - s)

            line = {
                "case": case,
                "devices": names,
                "hardware": devices_named(names),
                "ranks": ranks,
                "ranks_as": "processes" if self.arguments.processes else "threads",
                "waits": None
                if "cpu" in names or ranks == 1 or self.arguments.processes
                else WAITS,
                "sums": None if "cpu" in names or ranks == 1 else "packed",
                "particles": count,
                "particles_per_cell": scene.bodies[0].particles_per_cell,
                "fbar": str(scene.bodies[0].fbar),
                "precision": simulation.precision,
                "pipeline": simulation.pipeline,
                "cells": list(scene.cells),
                "steps": done,
                "seconds": seconds,
                "step_s": seconds / done,
                "particle_steps_per_s": rate,
                "particle_steps_per_s_per_device": rate / ranks,
                "first_chunk": part(0, 1),
                "last_chunk": part(-2, -1),
                "bytes_a_step": since("bytes_of_sums") / done,
                "shared_blocks": after.get("shared_blocks", 0),
                "migrated_a_step": since("migrated") / done,
                "sorts": since("sorts"),
                "tables": since("tables"),
                "sort_s": simulation.timings.get("sort", 0.0) - at.get("sort", 0.0),
                "tables_s": simulation.timings.get("tables", 0.0) - at.get("tables", 0.0),
                "rebalances": after.get("rebalances", 0),
                "imbalance": after.get("imbalance", 1.0),
                "most_imbalance": max(shares) if partition is not None else None,
                "partition": None if partition is None else repr(partition),
                "grid_blocks": after.get("blocks"),
                "planned_bytes": simulation.plan.memory_total,
                "most_bytes_held": after.get("most_bytes_held"),
                "construction_s": constructed - began,
                "digest": (digest(simulation) or None) if bits else None,
                "commit": commit(),
                "version": libmpm.__version__,
                "command": self.command,
            }
        finally:
            del simulation
            gc.collect()
        key = f"{case} {line['fbar']}"
        if ranks == 1:
            self._alone[key] = rate
        if key in self._alone:
            line["efficiency"] = rate / ranks / self._alone[key]
        return line


def weak(runner: Runner) -> Iterator[Line]:
    """64 M particles a device, with F-bar and without."""
    transfer = runner.arguments.transfer
    name = "weak: 64 M each" if transfer is None else f"weak: 64 M each, {transfer}"
    for fbar in runner.arguments.fbar:
        for ranks in runner.counts():
            sized = slosh(runner.size(64e6), ranks, fbar, transfer=transfer)
            yield runner.run(name, sized, ranks, runner.arguments.steps or 1000)


def split(runner: Runner, particles: float, name: str) -> Iterator[Line]:
    """The same water on more and more devices."""
    for ranks in runner.counts():
        sized = slosh(runner.size(particles), 1, "default")
        yield runner.run(f"strong: {name} in all", sized, ranks, runner.arguments.steps or 2000)


def strong(runner: Runner) -> Iterator[Line]:
    """64 M in all."""
    yield from split(runner, 64e6, "64 M")


def large(runner: Runner) -> Iterator[Line]:
    """512 M in all."""
    yield from split(runner, 512e6, "512 M")


def capacity(runner: Runner) -> Iterator[Line]:
    """As many particles as are asked for on each device, on all of them, for 50 steps."""
    ranks = runner.counts()[-1]
    each = runner.size(runner.arguments.capacity)
    # One body for every two billion: ids have 32 bits.
    bodies = math.ceil(each * ranks / 2e9)
    sized = slosh(each, ranks, "default", bodies=bodies)
    yield runner.run(f"capacity: {each:.3g} each", sized, ranks, 50)


def small(runner: Runner) -> Iterator[Line]:
    """8 M in all."""
    yield from split(runner, 8e6, "8 M")


def spreading(runner: Runner) -> Iterator[Line]:
    """A dam break of 8 M across planes: with the cuts that it starts with, and moving ones."""
    for limit in (None, libmpm.Partition().rebalance_above):
        partition = libmpm.Partition(cuts="x", rebalance_above=limit)
        name = f"spreading: 8 M, cuts {'stay' if limit is None else 'move'}"
        sized = collapse(runner.size(8e6))
        steps = runner.arguments.mixing_steps
        yield runner.run(name, sized, runner.counts()[-1], steps, partition=partition)


def mixing(runner: Runner) -> Iterator[Line]:
    """A collapse of 1 M that runs long: ids checked, and the bits of one device."""
    first = None
    for ranks in runner.counts():
        sized = collapse(runner.size(1e6))
        steps = runner.arguments.mixing_steps
        line = runner.run("mixing: 1 M", sized, ranks, steps, bits=True)
        first = first or line["digest"]
        alone = runner.arguments.processes  # then `start_jobs` knows
        yield line if alone else line | {"bits_of_one": line["digest"] == first}


CASES: dict[str, Callable[[Runner], Iterator[Line]]] = {
    "mixing": mixing, "small": small, "strong": strong, "weak": weak, "large": large,
    "capacity": capacity, "spreading": spreading,
}  # fmt: skip


def tell(line: Line, file: Path | None) -> None:
    """Print a line, and append it to a file."""
    text = json.dumps(line)
    print(text, flush=True)
    if file:
        with file.open("a", encoding="utf-8") as to:
            to.write(text + "\n")


def start_jobs(arguments: argparse.Namespace) -> int:
    """Run the cases in jobs of one process a device, for one number of devices after another."""
    failed = 0
    alone: dict[str, Line] = {}
    for count in Runner(arguments).counts():
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        made = []
        for rank in range(count):
            told = {
                "RANK": str(rank), "LOCAL_RANK": str(rank), "WORLD_SIZE": str(count),
                "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, STARTED: "1",
            }  # fmt: skip
            output = subprocess.PIPE if rank == 0 else subprocess.DEVNULL
            made.append(
                subprocess.Popen(
                    [sys.executable, *sys.argv], env=os.environ | told, stdout=output, text=True
                )
            )
        assert made[0].stdout is not None
        for text in made[0].stdout:
            line = json.loads(text)
            key = f"{line['case']} {line.get('fbar')}"
            if "error" not in line and count == 1:
                alone[key] = line
            if "error" not in line and key in alone:
                rates = (line, alone[key])
                each, one = (r["particle_steps_per_s_per_device"] for r in rates)
                line["efficiency"] = each / one
                if line["digest"]:
                    line["bits_of_one"] = line["digest"] == alone[key]["digest"]
            tell(line, arguments.json)
        codes = [process.wait() for process in made]
        failed |= int(any(codes))
    return failed


def main() -> int:
    """Run the chosen cases; a case that fails says so in a line and the others go on."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--devices", nargs="+", default=["cuda:0", "cuda:1"])
    parser.add_argument("--counts", nargs="+", type=int, help="how many of them; 1 2 4 8")
    parser.add_argument(
        "--cases", nargs="+", choices=list(CASES), default=["mixing", "small", "strong", "weak"]
    )
    parser.add_argument("--fbar", nargs="+", choices=["default", "none"],
                        default=["default", "none"], help="forms that `weak` takes")  # fmt: skip
    parser.add_argument("--transfer", help="of `weak`, such as FLIP; default: the scene's own")
    parser.add_argument("--precision", default="single")
    parser.add_argument("--scale", type=float, default=1.0, help="factor on all sizes")
    parser.add_argument("--steps", type=int, help="at most, of the scaling cases")
    parser.add_argument("--mixing-steps", type=int, default=4000)
    parser.add_argument("--seconds", type=float, default=20.0, help="of a run at most")
    parser.add_argument(
        "--capacity", type=float, default=2e9, help="particles on each device, of that case"
    )
    parser.add_argument("--json", type=Path, help="file to append lines to")
    parser.add_argument(
        "--processes",
        action="store_true",
        help="one process a device: those of a launcher, or of this script",
    )
    arguments = parser.parse_args()
    if arguments.processes and not LAUNCHED:
        return start_jobs(arguments)
    runner = Runner(arguments)
    rank = 0
    if arguments.processes:
        rank = job().rank
    failed = 0
    for name in arguments.cases:
        lines = CASES[name](runner)
        try:
            for line in lines:
                if rank == 0:
                    tell(line, None if STARTED in os.environ else arguments.json)
        except Exception as error:
            traceback.print_exc()
            print(json.dumps({"case": name, "error": str(error)}), flush=True)
            failed = 1
            if arguments.processes:
                break  # the job has ended with it
    return failed


if __name__ == "__main__":
    sys.exit(main())
