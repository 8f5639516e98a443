"""Forms of F-bar on a tank at rest: which one stays in balance, and what it costs.

    python benchmarks/fbar_forms.py --output benchmarks/results/fbar_forms.jsonl

A 2D tank, 40 cells deep, starts in hydrostatic balance on a lattice, or with --jitter with every
particle off its place by up to that part of the particles' distance. For every form and precision,
and again with half the time step over the same time, one JSON line is appended to OUTPUT;
`--table OUTPUT` prints the table of the lines in it.

  bytes       per particle, and per node of the grid
  volume      drift of the summed volume, parts of the volume
  profile     rms over layers of cells of the layer's mean pressure error, parts of ρ g H
  bed, top    the lowest and the highest layer
  per particle  rms of the pressure error over particles
  stored      the same of the pressure that the stored volume ratio J would give
  balance     like profile, of p J: particles start at the distances of unloaded water, so that what
              holds the weight on the grid is p J, and p itself may be ρ g H / K too high at the bed
  level       change of the mean height of the particles, parts of H / 2: what the surface sinks
  speed       rms node speed over the last tenth of the steps, parts of sqrt(g H)
  growth      that speed over the last tenth up to --growth, divided by the same up to --steps
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from libmpm import FBar, boundaries
from support import scenes

DEPTH = 1.0
SAMPLES = 20  # of the node speeds, in the last tenth


def forms(cell_size, speed):
    """Name -> F-bar of the candidates; times are counted in crossings of a cell by sound."""
    crossing = cell_size / speed

    def length(ratio):
        return 0.5 * cell_size * np.sqrt(ratio / (1 - ratio))

    return {
        "none": None,
        "one-volume 35": FBar(form="one-volume", time=35 * crossing),
        "one-volume-gradient 10": FBar(time=10 * crossing),
        "one-volume-gradient 35": FBar(time=35 * crossing),
        "one-volume-gradient 100": FBar(time=100 * crossing),
        "two-volume 0.9": FBar(form="two-volume", length=length(0.9)),
        "two-volume 0.99": FBar(form="two-volume", length=length(0.99)),
        "stress-only 0.9": FBar(form="stress-only", ratio=0.9),
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


def node_speed(machine):
    v = machine.grid("velocity")
    return np.sqrt(np.mean(np.sum(v**2, axis=1)) / (scenes.GRAVITY * DEPTH))


def late_speed(machine, until):
    """Advance to step `until`; the rms node speed over the last tenth of all steps so far."""
    tenth = until // 10
    scenes.advance(machine, until - tenth - machine.step)
    squares = []
    for k in range(SAMPLES):
        scenes.advance(machine, tenth * (k + 1) // SAMPLES - tenth * k // SAMPLES)
        squares.append(node_speed(machine) ** 2)
    return float(np.sqrt(np.mean(squares)))


def errors(machine, layers, material):
    height = machine.attribute(0, "position")[:, 1]
    ratio = machine.attribute(0, "volume_ratio")
    pressure = machine.attribute(0, "pressure")
    full = scenes.WATER * scenes.GRAVITY * DEPTH
    expected = 1 - height / DEPTH
    gamma = material.exponent
    stored = material.bulk_modulus / gamma * np.expm1(-gamma * np.log(ratio))
    row = np.clip((height / DEPTH * layers).astype(int), 0, layers - 1)

    def layered(values):
        count = np.bincount(row, minlength=layers)
        return np.bincount(row, weights=values, minlength=layers) / np.maximum(count, 1)

    error = pressure / full - expected
    mean, balance = layered(error), layered(pressure * ratio / full - expected)
    return {
        "profile": float(np.sqrt(np.mean(mean**2))),
        "bed": float(mean[0]),
        "top": float(mean[-1]),
        "per_particle": float(np.sqrt(np.mean(error**2))),
        "stored": float(np.sqrt(np.mean((stored / full - expected) ** 2))),
        "balance": float(np.sqrt(np.mean(balance**2))),
        "level": float(2 * np.mean(height) / DEPTH - 1),
    }


def measure(name, fbar, precision, halved, growth, arguments):
    scene = make(fbar, arguments.cells, arguments.width, 0.15 if halved else 0.3)
    plan = scene.plan(device=arguments.device, precision=precision)
    spec = scenes.specification(scene, precision=precision)
    body, material = spec["bodies"][0], scene.bodies[0].material
    distance = scene.cell_size / np.sqrt(scene.bodies[0].particles_per_cell)
    random = np.random.default_rng(1).uniform(-1, 1, body["position"].shape)
    body["position"] = body["position"] + arguments.jitter * distance * random
    machine = scenes.engine(spec, arguments.device)
    result = {
        "case": "fbar-forms",
        "form": name,
        "precision": precision,
        "dt_halved": halved,
        "jitter": arguments.jitter,
        "particles": body["count"],
        "bytes_per_particle": plan.bytes_per_particle("water"),
        "bytes_per_node": plan.bytes_per_node,
        "commit": arguments.commit,
        "command": arguments.command,
    }
    volume = float(np.sum(machine.attribute(0, "volume_ratio")))
    try:
        speed = late_speed(machine, arguments.steps * (2 if halved else 1))
        now = float(np.sum(machine.attribute(0, "volume_ratio")))
        result |= {"steps": machine.step, "time": machine.time, "volume": now / volume - 1}
        result |= {**errors(machine, arguments.cells, material), "speed": speed, "growth": None}
        if growth and not halved:
            result["growth"] = late_speed(machine, arguments.growth) / speed
            result["late"] = errors(machine, arguments.cells, material)
    except AssertionError as stopped:
        result |= {"steps": machine.step, "time": machine.time, "failed": str(stopped)}
    return result


def table(results):
    columns = ("form", "fill", "precision", "Δt", "B/particle", "B/node", "volume", "profile",
               "bed", "top", "per particle", "stored", "balance", "level", "speed",
               "growth")  # fmt: skip
    lines = ["| " + " | ".join(columns) + " |", "|" + " --- |" * len(columns)]
    for r in results:
        cells = [
            r["form"],
            f"jitter {r['jitter']:g}" if r["jitter"] else "lattice",
            r["precision"],
            "½" if r["dt_halved"] else "1",
            f"{r['bytes_per_particle']:g}",
            f"{r['bytes_per_node']:g}",
        ]
        if "profile" in r:
            cells += [
                f"{r['volume']:+.1e}",
                f"{r['profile']:.2%}",
                *(f"{r[k]:+.2%}" for k in ("bed", "top")),
                f"{r['per_particle']:.2%}",
                f"{r['stored']:.2%}",
                f"{r['balance']:.2%}",
                f"{r['level']:+.2%}" if "level" in r else "",
                f"{r['speed']:.1e}",
                "" if r["growth"] is None else f"{r['growth']:.2f}",
            ]
        else:
            cells.append(f"stopped at step {r['steps']}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def commit():
    git = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    return subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--growth", type=int, default=400_000, help="last step of --growing")
    parser.add_argument("--growing", nargs="*", help="forms that run on to --growth", default=[
        "none", "one-volume 35", "one-volume-gradient 35"])  # fmt: skip
    parser.add_argument("--cells", type=int, default=40, help="depth in cells")
    parser.add_argument("--width", type=int, default=8, help="in cells")
    parser.add_argument("--jitter", type=float, default=0.0, help="parts of the distance")
    parser.add_argument("--precision", nargs="*", default=["double", "single"])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--forms", nargs="*", help="names; all when left out")
    parser.add_argument("--no-half", action="store_true", help="skip the runs with half the step")
    parser.add_argument("--output", type=Path, default=Path("fbar_forms.jsonl"))
    parser.add_argument("--table", type=Path, help="print the table of this file and stop")
    arguments = parser.parse_args()
    if arguments.table:
        print(table([json.loads(line) for line in arguments.table.read_text().splitlines()]))
        return
    arguments.commit = commit()
    arguments.command = " ".join(["python benchmarks/fbar_forms.py", *sys.argv[1:]])
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    sound = np.sqrt(scenes.stiffness(DEPTH) / scenes.WATER)
    for precision in arguments.precision:
        for name, fbar in forms(DEPTH / arguments.cells, sound).items():
            if arguments.forms and name not in arguments.forms:
                continue
            for halved in (False,) if arguments.no_half else (False, True):
                growth = name in arguments.growing
                line = json.dumps(measure(name, fbar, precision, halved, growth, arguments))
                with arguments.output.open("a") as file:
                    file.write(line + "\n")
                print(line, flush=True)


if __name__ == "__main__":
    main()
