"""What one device does with many small scenes at once, against one scene of their total size.

Every scene is its own `Simulation` with its own geometry, sensors and time step; threads of one
process, or several processes, take them. The engine gives up Python's lock while it runs, and on a
device every scene has a stream of its own. A line a form is printed and appended to `--json`;
`same_bits` says whether scenes end as they do alone, with `shared_device` both times.

Run:  python benchmarks/many_scenes.py --device cuda:0 --json FILE
      python benchmarks/many_scenes.py --device cpu --scenes 4 --particles 2000 --steps 50
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import shlex
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import libmpm
from libmpm._src.cli.bench import COURANT, GRAVITY, HEIGHT, SOUND, _device, commit, water

#: Length to height of the fills: no two neighbours are alike.
SHAPES = (1.0, 0.7, 1.3, 0.85, 1.5)


def scene(particles: int, index: int) -> tuple[libmpm.Scene, float]:
    """Return a collapse with a shape of its own, with a load cell and a gauge, and its step, s."""
    ratio = SHAPES[index % len(SHAPES)]
    high = max(4, round((particles / 8 / ratio) ** (1 / 3)))
    long, dx = round(ratio * high), HEIGHT / high
    result = libmpm.Scene(
        dimension=3, cell_size=dx, lower=(0, 0, 0), gravity=(0, 0, -GRAVITY),
        upper=((2 * long + index % 7) * dx, high * dx, (high + high // 4 + 1) * dx),
        name=f"collapse {index}",
    )  # fmt: skip
    box = libmpm.shapes.Box(lower=(0, 0, 0), upper=(long * dx, high * dx, high * dx))
    result.add_body(name="water", shape=box, material=water(), particles_per_cell=8)
    walls = libmpm.shapes.DomainWalls()
    result.add_boundary(name="walls", shape=walls, response=libmpm.boundaries.Slip())
    cell = libmpm.sensors.LoadCell(boundary="walls", faces=("x+",), interval=0.01)
    result.add_sensor(name="load", sensor=cell)
    place = (long * dx * 0.5, high * dx * 0.5)
    result.add_sensor(name="gauge", sensor=libmpm.sensors.WaveGauge(position=place, interval=0.01))
    return result, COURANT * dx / SOUND


def make(particles: int, index: int, device: str, shared: bool = True) -> libmpm.Simulation:
    """Return the simulation, constructed and one step into its run."""
    made, step = scene(particles, index)
    simulation = libmpm.Simulation(
        made, device=device, time_step=step, threads=1, shared_device=shared
    )
    simulation.step(1)
    return simulation


def digest(simulation: libmpm.Simulation) -> str:
    """Return a hash of all particles and samples."""
    arrays = simulation.particles["water"].read(["id", "position", "velocity", "volume_ratio"])
    found = hashlib.sha256()
    for name in sorted(arrays):
        found.update(arrays[name].tobytes())
    for series in simulation.series():
        found.update(series.time.tobytes() + series.values.tobytes())
    return found.hexdigest()


_ready: dict[int, libmpm.Simulation] = {}


def prepare(particles: int, index: int, device: str) -> int:
    """Make a scene where it will run; return its particles."""
    _ready[index] = made = make(particles, index, device)
    return sum(len(body) for body in made.particles.values())


def advance(index: int, steps: int) -> float:
    """Step a scene that is ready; return the time at which it was done."""
    _ready[index].step(steps)
    return time.time()


def result_of(index: int) -> str:
    """Return the hash of a scene that has run."""
    return digest(_ready[index])


def together(pool: list[Executor], arguments: argparse.Namespace) -> tuple[float, list[str]]:
    """Run all scenes on one-worker executors; return particle-steps/s and the hashes."""

    def on(index: int) -> Executor:
        return pool[index % len(pool)]

    every = range(arguments.scenes)
    made = [on(i).submit(prepare, arguments.particles, i, arguments.device) for i in every]
    particles = sum(future.result() for future in made)
    began = time.time()
    runs = [on(i).submit(advance, i, arguments.steps) for i in every]
    ended = max(future.result() for future in runs)
    hashes = [on(i).submit(result_of, i).result() for i in every]
    return particles * arguments.steps / (ended - began), hashes


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--device", default="auto")
    parser.add_argument("--scenes", type=int, default=64)
    parser.add_argument("--particles", type=int, default=100_000, help="of each scene, about")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--threads", default="16,64", help="numbers of threads to try")
    parser.add_argument("--processes", default="", help="numbers of processes to try")
    parser.add_argument("--check", type=int, default=8, help="scenes that are run alone as well")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()

    def report(form: str, rate: float, **more: Any) -> None:
        line = {"case": "many-scenes", "form": form, "particle_steps_per_s": rate} | more | {
            "scenes": arguments.scenes, "particles_each": arguments.particles,
            "steps": arguments.steps, "device": name, "precision": "single", "commit": commit(),
            "command": shlex.join(["python", *sys.argv]),
        }  # fmt: skip
        print(json.dumps(line), flush=True)
        if arguments.json is not None:
            with arguments.json.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")

    whole = make(arguments.particles * arguments.scenes, 0, arguments.device, shared=False)
    name = _device(whole)
    count = sum(len(body) for body in whole.particles.values())
    began = time.time()
    whole.step(arguments.steps)
    base = count * arguments.steps / (time.time() - began)
    report("one scene of the total size", base, share=1.0)
    del whole

    alone, spent, done = [], 0.0, 0
    for index in range(min(arguments.check, arguments.scenes)):
        one = make(arguments.particles, index, arguments.device)
        began = time.time()
        one.step(arguments.steps)
        spent += time.time() - began
        done += sum(len(body) for body in one.particles.values()) * arguments.steps
        alone.append(digest(one))
        del one
    report("one after another", done / spent, share=done / spent / base)

    spawn = multiprocessing.get_context("spawn")
    for kind, numbers in (("threads", arguments.threads), ("processes", arguments.processes)):
        for workers in [int(n) for n in numbers.split(",") if n]:
            pool: list[Executor] = [
                ThreadPoolExecutor(1) if kind == "threads" else
                ProcessPoolExecutor(1, mp_context=spawn)
                for _ in range(workers)
            ]  # fmt: skip
            rate, hashes = together(pool, arguments)
            same = hashes[: len(alone)] == alone
            report(f"{workers} {kind}", rate, share=rate / base, same_bits=same)
            _ready.clear()
            for one_worker in pool:
                one_worker.shutdown()


if __name__ == "__main__":
    main()
