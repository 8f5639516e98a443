"""Taichi's usual MLS-MPM step on the benchmark case of ``libmpm bench``, on the same machine.

The same cube of water collapses in the same box: 8 particles per cell, sound speed
c0 = 10 sqrt(2 g H), time step 0.3 dx / c0, quadratic B-splines, affine transfer, one loop over
particles with 27 atomic adds and one that gathers. Single precision, J stored, no F-bar, particles
placed in the order of their cells and never sorted, as the scripts of its users have it.

Run:  python benchmarks/taichi_mls_mpm.py --particles 100000 --steps 10000 --json results.jsonl
Needs the package ``taichi``; libmpm does not depend on it.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import shlex
import sys
import time
from pathlib import Path

import numpy as np
import taichi as ti

GRAVITY, HEIGHT, DENSITY, EXPONENT = 9.81, 1.0, 1000.0, 7.15
PAD = 3  # nodes outside the walls


def lattice(cells: int) -> np.ndarray:
    """Return 8 points in each of cells^3 cells, cell by cell, in units of the cell size."""
    inner = np.stack(np.meshgrid(*[(0.25, 0.75)] * 3, indexing="ij"), -1).reshape(-1, 3)
    outer = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return (outer[:, None] + inner[None]).reshape(-1, 3)


def measure(particles: int, steps: int, threads: int) -> dict[str, object]:
    """Run the case and return the line that is recorded."""
    ti.init(arch=ti.cpu, cpu_max_num_threads=threads, default_fp=ti.f32)
    cells = max(2, round((particles / 8) ** (1 / 3)))
    dx = HEIGHT / cells
    sound = 10 * math.sqrt(2 * GRAVITY * HEIGHT)
    dt = 0.3 * dx / sound
    shape = (2 * cells + 2 * PAD, cells + 2 * PAD, math.ceil(1.25 * cells) + 2 * PAD)
    points = lattice(cells) + PAD
    n = len(points)
    mass = DENSITY * dx**3 / 8
    volume = dx**3 / 8
    stiffness = DENSITY * sound**2 / EXPONENT

    x = ti.Vector.field(3, ti.f32, n)
    v = ti.Vector.field(3, ti.f32, n)
    affine = ti.Matrix.field(3, 3, ti.f32, n)
    ratio = ti.field(ti.f32, n)
    grid_v = ti.Vector.field(3, ti.f32, shape)
    grid_m = ti.field(ti.f32, shape)
    x.from_numpy((points * dx).astype(np.float32))
    ratio.fill(1.0)

    @ti.kernel
    def clear():
        for node in ti.grouped(grid_m):
            grid_v[node] = ti.Vector([0.0, 0.0, 0.0])
            grid_m[node] = 0.0

    @ti.kernel
    def deposit():
        for p in x:
            base = (x[p] / dx - 0.5).cast(int)
            fx = x[p] / dx - base
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]
            pressure = stiffness * (ti.pow(ratio[p], -EXPONENT) - 1.0)
            stress = dt * 4.0 / (dx * dx) * volume * ratio[p] * pressure
            q = mass * affine[p] + ti.Matrix.identity(ti.f32, 3) * stress
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = ti.Vector([i, j, k])
                weight = w[i][0] * w[j][1] * w[k][2]
                distance = (offset - fx) * dx
                grid_v[base + offset] += weight * (mass * v[p] + q @ distance)
                grid_m[base + offset] += weight * mass

    @ti.kernel
    def update():
        for node in ti.grouped(grid_m):
            if grid_m[node] > 0:
                u = grid_v[node] / grid_m[node]
                u[2] -= dt * GRAVITY
                for a in ti.static(range(3)):
                    if node[a] <= PAD:
                        u[a] = ti.max(u[a], 0.0)
                    if node[a] >= shape[a] - PAD:
                        u[a] = ti.min(u[a], 0.0)
                grid_v[node] = u

    @ti.kernel
    def gather():
        for p in x:
            base = (x[p] / dx - 0.5).cast(int)
            fx = x[p] / dx - base
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]
            u = ti.Vector([0.0, 0.0, 0.0])
            b = ti.Matrix.zero(ti.f32, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = ti.Vector([i, j, k])
                weight = w[i][0] * w[j][1] * w[k][2]
                g = grid_v[base + offset]
                u += weight * g
                b += 4.0 / dx * weight * g.outer_product(offset - fx)
            v[p] = u
            affine[p] = b
            x[p] += dt * u
            ratio[p] *= 1.0 + dt * b.trace()

    def advance(count: int) -> float:
        began = time.perf_counter()
        for _ in range(count):
            clear()
            deposit()
            update()
            gather()
        ti.sync()
        return time.perf_counter() - began

    advance(2)  # compiles
    tenth = steps // 10
    first = advance(tenth)
    middle = advance(steps - 2 * tenth)
    last = advance(tenth)
    if not np.isfinite(x.to_numpy()).all():
        raise SystemExit("the run is not finite; nothing was measured")
    seconds = first + middle + last
    name = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            name = line.partition(":")[2].strip()
            break
    return {
        "case": "collapse",
        "code": f"taichi {'.'.join(map(str, ti.__version__))}",
        "particles": n,
        "particles_per_cell": 8,
        "precision": "single",
        "fbar": "none",
        "steps": steps,
        "particle_steps_per_s": n * steps / seconds,
        "first_tenth": n * tenth / first,
        "last_tenth": n * tenth / last,
        "seconds": seconds,
        "state": f"first {steps} steps of the collapse, never sorted, no output",
        "device": f"{name}, {threads} threads",
        "command": shlex.join(["python", *sys.argv]),
    }


def main() -> None:
    """Measure, print the line and append it to a file if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    line = json.dumps(measure(arguments.particles, arguments.steps, arguments.threads))
    print(line)
    if arguments.json is not None:
        with arguments.json.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


if __name__ == "__main__":
    main()
