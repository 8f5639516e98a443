"""What a feature costs what does not use it: nothing, and this measures it.

Pairs of scenes run in turns, A B A B ...: the benchmark's collapsing water, and the same water in a
scene that has something which does not concern it. The ratio of the median times should be one
within the spread of the repetitions, and the bytes per particle and node are compared exactly. 64
particles of a material without a fused form are such a feature for the water beside them; there
its F-bar alone takes one more channel of the grid.

Run:  python benchmarks/unused_features.py --particles 30000 --steps 200 --rounds 5 --json FILE
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import libmpm
from libmpm._src.cli.bench import collapse, commit

#: Another body is a channel more for F-bar, so the bytes of a node differ.
SMALL_BLOCK = "64 particles of CamClay beside the water"


def add_dry_box(scene: libmpm.Scene) -> None:
    """A box boundary that the water does not reach."""
    _, height, _ = scene.upper
    edge = scene.cell_size
    x = scene.upper[0]
    scene.add_boundary(
        name="box",
        shape=libmpm.shapes.Box(
            lower=(x - 4 * edge, 0.25 * height, 0.25 * height),
            upper=(x - 2 * edge, 0.5 * height, 0.5 * height),
        ),
        response=libmpm.boundaries.Separable(),
    )


def add_late_gate(scene: libmpm.Scene) -> None:
    """A boundary whose time window opens after the run."""
    x, y, z = scene.upper
    scene.add_boundary(
        name="gate",
        shape=libmpm.shapes.Box(lower=(0.5 * x, 0, 0), upper=(0.5 * x + 4 * scene.cell_size, y, z)),
        response=libmpm.boundaries.Sticky(),
        time=(1e6, 2e6),
    )


def add_slow_sensors(scene: libmpm.Scene) -> None:
    """Sensors that take their first sample and no other."""
    middle = tuple(0.25 * c for c in scene.upper)
    scene.add_sensor(
        name="probe", sensor=libmpm.sensors.VelocityProbe(position=middle, interval=1e6)
    )
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy(interval=1e6))


def add_small_block(scene: libmpm.Scene) -> None:
    """64 particles of a material without a fused form, away from the water."""
    edge = scene.cell_size
    x, y, _ = scene.upper
    scene.add_body(
        name="block",
        shape=libmpm.shapes.Box(
            lower=(x - 4 * edge, y - 4 * edge, 0), upper=(x - 2 * edge, y - 2 * edge, 2 * edge)
        ),
        # Its waves are slower than those of the water.
        material=libmpm.materials.CamClay(
            density=1000.0, youngs_modulus=1e6, log_plastic_volume=-0.02
        ),
    )


CASES: dict[str, Callable[[libmpm.Scene], None]] = {
    "a box that the water does not reach": add_dry_box,
    "a boundary that acts later": add_late_gate,
    "sensors that are not due": add_slow_sensors,
    SMALL_BLOCK: add_small_block,
}


def timed(scene: libmpm.Scene, time_step: float, steps: int, device: str) -> tuple[float, Any]:
    """Return seconds of `steps` steps after a warm-up, and the plan."""
    simulation = libmpm.Simulation(scene, device=device, time_step=time_step)
    simulation.step(max(1, steps // 10))
    began = time.perf_counter()
    simulation.step(steps)
    return time.perf_counter() - began, simulation.plan


def compare(name: str, particles: int, steps: int, rounds: int, device: str) -> dict[str, object]:
    """Run both scenes of a case in turns and return the line that is recorded."""
    seconds: dict[str, list[float]] = {"without": [], "with": []}
    sizes: dict[str, tuple[int, int]] = {}
    for _ in range(rounds):
        for key in seconds:
            scene, time_step = collapse(particles)
            if key == "with":
                CASES[name](scene)
            spent, plan = timed(scene, time_step, steps, device)
            seconds[key].append(spent)
            sizes[key] = (plan.bytes_per_particle("water"), plan.bytes_per_node)
    medians = {key: statistics.median(values) for key, values in seconds.items()}
    ratios = [b / a for a, b in zip(seconds["without"], seconds["with"], strict=True)]
    return {
        "case": f"unused: {name}",
        "particles": particles,
        "steps": steps,
        "device": device,
        "time_ratio": medians["with"] / medians["without"],
        "time_ratio_range": [min(ratios), max(ratios)],
        "bytes_per_particle": [sizes["without"][0], sizes["with"][0]],
        "bytes_per_node": [sizes["without"][1], sizes["with"][1]],
        "commit": commit(),
        "command": shlex.join(["python", *sys.argv]),
    }


def main() -> None:
    """Compare every case, print the lines and append them to a file if asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--particles", type=int, default=30_000)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--case", choices=CASES, help="one case alone")
    parser.add_argument("--json", type=Path)
    a = parser.parse_args()
    for name in CASES if a.case is None else (a.case,):
        result = compare(name, a.particles, a.steps, a.rounds, a.device)
        line = json.dumps(result)
        print(line)
        if a.json is not None:
            with a.json.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        sizes = (
            ("bytes_per_particle",)
            if name == SMALL_BLOCK
            else ("bytes_per_particle", "bytes_per_node")
        )
        if any(len(set(result[size])) != 1 for size in sizes):
            raise SystemExit(f"{name}: the plan counts bytes for something that is not used")


if __name__ == "__main__":
    main()
