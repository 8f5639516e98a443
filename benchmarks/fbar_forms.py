"""Forms of F-bar on a tank at rest: which one stays in balance, and what it costs.

    python benchmarks/fbar_forms.py --steps 100000 --growth 400000 --output results/fbar

A 2D tank, 40 cells deep, starts in hydrostatic balance. For every form, and again with half the
time step over the same time, one JSON line goes to OUTPUT.jsonl; OUTPUT.md gets the table.

  bytes       per particle, and per node of the grid
  volume      drift of the summed volume, parts of the volume
  profile     rms over layers of cells of the layer's mean pressure error, parts of ρ g H
  bed, top    the lowest and the highest layer
  per particle  rms of the pressure error over particles
  speed       rms node speed over the last tenth of the steps, parts of sqrt(g H)
  growth      that speed over the last tenth up to --growth, divided by the same up to --steps
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import libmpm
from libmpm import FBar, boundaries
from support import scenes

DEPTH = 1.0
SAMPLES = 20  # of the node speeds, in the last tenth


def forms(cell_size):
    """Name -> F-bar of the candidates."""
    return {
        "none": None,
        "one-volume": FBar(form="one-volume"),
        "one-volume, ratio 0.1": FBar(form="one-volume", ratio=0.1),
        "one-volume-gradient": FBar(form="one-volume-gradient"),
        "one-volume-gradient, ratio 0.1": FBar(form="one-volume-gradient", ratio=0.1),
        "two-volume, 1.5 cells": FBar(form="two-volume", length=1.5 * cell_size),
        "two-volume, 5 cells": FBar(form="two-volume", length=5 * cell_size),
        "stress-only": FBar(form="stress-only"),
    }


def make(fbar, layers, width, cfl):
    return scenes.tank(
        cells=(width, layers),
        cell_size=DEPTH / layers,
        modulus=scenes.stiffness(DEPTH),
        gravity=scenes.GRAVITY,
        fbar=fbar,
        cfl=cfl,
        at_rest=True,
        interval=1.0,
        response=boundaries.Slip(),
    )


def node_speed(sim):
    v = sim.grid["velocity"]
    return np.sqrt(np.mean(np.sum(v**2, axis=1)) / (scenes.GRAVITY * DEPTH))


def late_speed(sim, until):
    """Advance to step `until`; the rms node speed over the last tenth of all steps so far."""
    tenth = until // 10
    sim.step(until - tenth - sim.steps)
    squares = []
    for k in range(SAMPLES):
        sim.step(tenth * (k + 1) // SAMPLES - tenth * k // SAMPLES)
        squares.append(node_speed(sim) ** 2)
    return float(np.sqrt(np.mean(squares)))


def errors(sim, layers):
    body = sim.particles["water"].read(["position", "pressure"])
    height = body["position"][:, 1]
    scale = scenes.WATER * scenes.GRAVITY
    error = (body["pressure"] - scale * (DEPTH - height)) / (scale * DEPTH)
    row = np.clip((height / DEPTH * layers).astype(int), 0, layers - 1)
    mean = np.bincount(row, weights=error, minlength=layers)
    mean /= np.maximum(np.bincount(row, minlength=layers), 1)
    return {
        "profile": float(np.sqrt(np.mean(mean**2))),
        "bed": float(mean[0]),
        "top": float(mean[-1]),
        "per_particle": float(np.sqrt(np.mean(error**2))),
    }


def measure(name, fbar, arguments, halved):
    cfl = 0.15 if halved else 0.3
    scene = make(fbar, arguments.cells, arguments.width, cfl)
    sim = libmpm.Simulation(
        scene,
        device=arguments.device,
        precision=arguments.precision,
        threads=1,
    )
    volume = float(np.sum(sim.particles["water"]["volume_ratio"]))
    factor = 2 if halved else 1
    speed = late_speed(sim, arguments.steps * factor)
    now = float(np.sum(sim.particles["water"]["volume_ratio"]))
    result = {
        "case": "fbar-forms",
        "form": name,
        "dt_halved": halved,
        "steps": sim.steps,
        "time": sim.time,
        "particle_count": len(sim.particles["water"]),
        "precision": arguments.precision,
        "bytes_per_particle": sim.plan.bytes_per_particle("water"),
        "bytes_per_node": sim.plan.bytes_per_node,
        "volume": now / volume - 1,
        **errors(sim, arguments.cells),
        "speed": speed,
        "growth": None,
    }
    if arguments.growth > arguments.steps and not halved:
        result["growth"] = late_speed(sim, arguments.growth) / speed
        result["late"] = errors(sim, arguments.cells)
    return result


def table(results):
    columns = ("form", "Δt", "B/particle", "B/node", "volume", "profile", "bed", "top",
               "per particle", "speed", "growth")  # fmt: skip
    lines = ["| " + " | ".join(columns) + " |", "|" + " --- |" * len(columns)]
    for r in results:
        cells = [
            r["form"],
            "½" if r["dt_halved"] else "1",
            f"{r['bytes_per_particle']:g}",
            f"{r['bytes_per_node']:g}",
            f"{r['volume']:+.1e}",
            f"{r['profile']:.2%}",
            *(f"{r[k]:+.2%}" for k in ("bed", "top")),
            f"{r['per_particle']:.2%}",
            f"{r['speed']:.1e}",
            "" if r["growth"] is None else f"{r['growth']:.2f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--growth", type=int, default=400_000, help="0: no second stage")
    parser.add_argument("--cells", type=int, default=40, help="depth in cells")
    parser.add_argument("--width", type=int, default=4, help="in cells")
    parser.add_argument("--precision", default="double")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--forms", nargs="*", help="names; all when left out")
    parser.add_argument("--no-half", action="store_true", help="skip the runs with half the step")
    parser.add_argument("--output", type=Path, default=Path("fbar_forms"))
    arguments = parser.parse_args()
    results = []
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    with arguments.output.with_suffix(".jsonl").open("w") as lines:
        for name, fbar in forms(DEPTH / arguments.cells).items():
            if arguments.forms and name not in arguments.forms:
                continue
            for halved in (False,) if arguments.no_half else (False, True):
                results.append(measure(name, fbar, arguments, halved))
                lines.write(json.dumps(results[-1]) + "\n")
                lines.flush()
                print(json.dumps(results[-1]), flush=True)
    arguments.output.with_suffix(".md").write_text(table(results))
    print(table(results))


if __name__ == "__main__":
    main()
