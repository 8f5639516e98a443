"""What grids of triangles and splines cost, measured for `triangular_grids.py`.

bar, column  error, time and memory of the large bar over one period and of the large column over
             one cycle: bases with about as many functions and particles. Errors are the root mean
             square over time at the middle, in parts of the largest value of the reference in one
             dimension. The energy drift is the change of the total between start and end, in parts
             of the largest kinetic energy. Velocities are half a step from positions, so the total
             also swings by parts of Δt ω, and at the end of the column's cycle not by zero.
particles    time of a step against particles, on one mesh
functions    time of a step against functions, with the same particles in each triangle
"""

import itertools
import os
import platform
import subprocess
import time
from functools import partial
from pathlib import Path

import numpy as np

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.cli import info
from support import triangular as t

PARTS = ("bar", "column", "particles", "functions")
PHASES = ("locate", "assemble", "watch", "step", "sensors")
SAMPLES = 400  # of the middle and of the energy over a run
PERIOD, CYCLE = 35.36, 0.4  # s
FIXED = {"bar": 0.02, "column": 5e-4}  # s
MASSES = {
    "consistent": grids.ConsistentMass(),
    "partial": grids.PartialMass(),
    "lumped": grids.LumpedMass(),
}

P1, PS, CUBIC = grids.Linear(), grids.PowellSabin(), grids.CubicPowellSabin()
#: Name -> basis or degrees, cells along and across, particles along and across. No particle starts
#: on a diagonal of its block: the power of 2 in its columns is not that in its rows.
BAR = {
    "P1, 16 blocks": (P1, (16, 1), (128, 6)),
    "P1, 26 blocks": (P1, (26, 1), (156, 4)),
    "PS, 8 blocks": (PS, (8, 1), (80, 8)),
    "cubic PS, 2 blocks": (CUBIC, (2, 1), (104, 6)),
    "B-splines 2 × 2, 24 spans": ((2, 2), (24, 1), (96, 6)),
    "B-splines 2 × 0, 24 spans": ((2, 0), (24, 1), (96, 6)),
    "B-splines 2 × 0, 76 spans": ((2, 0), (76, 1), (304, 2)),
}
COLUMN = {
    "P1, 4 blocks": (P1, (4, 1), (72, 16)),
    "P1, 13 blocks": (P1, (13, 1), (104, 12)),
    "PS, 4 blocks": (PS, (4, 1), (72, 16)),
    "cubic PS, 1 block": (CUBIC, (1, 1), (72, 16)),
    "cubic PS, 4 blocks": (CUBIC, (4, 1), (72, 16)),
    "B-splines 2 × 2, 12 spans": ((2, 2), (12, 1), (72, 16)),
    "B-splines 2 × 0, 12 spans": ((2, 0), (12, 1), (72, 16)),
    "B-splines 2 × 0, 40 spans": ((2, 0), (40, 1), (120, 10)),
}


def about(threads=0):
    """Return what every line says of the program and the processor."""
    git = [
        "git",
        "-C",
        str(Path(__file__).parent),
        "describe",
        "--always",
        "--dirty",
        "--exclude=*",
    ]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    name = platform.processor() or platform.machine()
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        for line in cpu.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    found = info.collect()
    return {
        "commit": commit or "installed",
        "device": name,
        "threads": threads or found.get("threads", os.cpu_count()),
        "omp_num_threads": os.environ.get("OMP_NUM_THREADS", ""),
        "version": found["version"],
    }


def jobs(arguments):
    """Yield a function for every measurement, which returns its line."""
    parts = arguments.only or PARTS
    for problem, bases in (("bar", BAR), ("column", COLUMN)):
        if problem not in parts:
            continue
        for name, mass, step in itertools.product(bases, MASSES, ("own", "fixed")):
            if (
                name in (arguments.bases or bases)
                and mass in (arguments.masses or MASSES)
                and step in (arguments.steps or (step,))
            ):
                yield partial(
                    trade_off, problem, name, mass, step, arguments.repeats, arguments.threads
                )
    if "particles" in parts:
        for name, side in itertools.product(("PS", "P1"), (4, 8, 16, 32)):
            yield partial(scaling, "particles", name, "direct", (16, 16), (side, side), arguments)
    if "functions" in parts:
        for name, solver in (("PS", "direct"), ("PS", "cg"), ("PS", "lumped"), ("P1", "direct")):
            for n in (1, 2, 4, 8, 16, 32):
                yield partial(scaling, "functions", name, solver, (2 * n, n), (8, 6), arguments)


# --- Trade-off ---


def grid_of(problem, basis, cells, mass):
    """Return a grid of a problem; one for the partially lumped column has an empty layer above."""
    along, across = cells
    case = t.LARGE_BAR if problem == "bar" else t.LARGE_COLUMN
    empty = int(problem == "column" and isinstance(mass, grids.PartialMass))
    if isinstance(basis, grids.Linear | grids.PowellSabin | grids.CubicPowellSabin):
        if problem == "bar":
            return t.blocks(along, across, case.length, case.height, basis, mass)
        return t.blocks(across, along, case.width, case.height, basis, mass, empty)
    if problem == "bar":
        upper, spans, degree = (case.length, case.height), (along, across), basis
    else:
        upper = (case.width, case.height * (along + empty) / along)
        spans, degree = (across, along + empty), basis[::-1]
    return grids.SplineGrid(lower=(0.0, 0.0), upper=upper, spans=spans, degree=degree, mass=mass)


def scene_of(problem, name, mass, step):
    """Return the scene and the time it runs to."""
    basis, cells, particles = (BAR if problem == "bar" else COLUMN)[name]
    grid = grid_of(problem, basis, cells, MASSES[mass])
    until = PERIOD if problem == "bar" else CYCLE
    options = {"time_step": None if step == "own" else FIXED[problem], "interval": until / SAMPLES}
    if problem == "bar":
        scene = t.bar(t.LARGE_BAR, grid, particles, **options)
    else:
        scene = t.column(t.LARGE_COLUMN, grid, particles[::-1], **options)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / SAMPLES))
    return scene, until


def bar_reference(case, when, place, columns):
    """Return displacement and velocity in one dimension where a particle of so many started.

    The nearest to the middle is half a distance off, where waves of twice the frequency are felt.
    """
    cells = 2 * columns * (400 // (2 * columns) + 1)  # a node at every particle
    return case.lagrangian(when, cells=cells, place=place / case.length)


def reference(problem, place, when, particles):
    """Return displacement and velocity at the place of the middle particle."""
    if problem == "bar":
        return bar_reference(t.LARGE_BAR, when, place[0], particles[0])
    cells = 2 * particles[0] * (400 // (2 * particles[0]) + 1)  # a node at every particle
    return t.LARGE_COLUMN.lagrangian(when, cells=cells, place=place[1] / t.LARGE_COLUMN.height)


def trade_off(problem, name, mass, step, repeats=1, threads=0):
    """Run one row of the trade-off and return its line."""
    scene, until = scene_of(problem, name, mass, step)
    best = None
    for _ in range(repeats):
        simulation = libmpm.Simulation(scene, threads=threads)
        error = ""
        began = time.perf_counter()
        try:
            _ = simulation.engine
            ready = time.perf_counter()
            simulation.run(until=until, progress=False)
        except libmpm.SceneError as refusal:
            return {
                "case": problem, "basis": name, "mass": mass, "step": step, "until": until,
                "error": str(refusal).splitlines()[0],
            }  # fmt: skip
        except libmpm.NumericalError as fault:
            error = str(fault).splitlines()[0]
        seconds = time.perf_counter() - ready
        if best is None or seconds < best[0]:
            best = seconds, ready - began, simulation
    seconds, setup, simulation = best
    count = simulation.statistics
    particles = (BAR if problem == "bar" else COLUMN)[name][2]
    line = {
        "case": problem,
        "basis": name,
        "mass": mass,
        "step": step,
        "until": until,
        "end": simulation.time,
        "error": error,
        "functions": int(count["functions"]),
        "cells": int(count["cells"]),
        "particles": particles[0] * particles[1],
        "steps": simulation.steps,
        "seconds": seconds,
        "setup_s": setup,
        "bytes": int(count["bytes"]),
        "timings": {k: simulation.timings.get(k, 0.0) for k in PHASES},
    }
    seen, axis = simulation.sensors["middle"], 0 if problem == "bar" else 1
    place = seen.values[0, :2]
    u, v = reference(problem, place, seen.time, particles)
    energy = simulation.sensors["energy"].values
    return line | {
        "displacement_rms": t.rms(seen.values[:, axis] - place[axis] - u, u),
        "velocity_rms": t.rms(seen.values[:, 2 + axis] - v, v),
        "energy_drift": float(energy[-1, :3].sum() - energy[0, :3].sum())
        / float(energy[:, 0].max()),
    }


# --- Scaling ---


def block_of_soil(basis, mass, blocks, per_block):
    """Return a rectangle full of an elastic body between slippery walls, in a standing wave."""
    columns, rows = blocks
    grid = t.blocks(columns, rows, columns * 1.0, rows * 1.0, basis, mass)
    scene = libmpm.Scene(grid=grid, method=libmpm.Method(), name="block of soil")
    scene.add_body(
        name="soil",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(columns * 1.0, rows * 1.0)),
        lattice=(per_block[0] * columns, per_block[1] * rows),
        material=materials.Hypoelastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3),
        velocity=libmpm.Field(components=(f"sin(pi * x / {columns})", "0")),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


def scaling(case, name, solver, blocks, per_block, arguments):
    """Time steps of a full rectangle; construction and the first steps are not timed."""
    mass = grids.LumpedMass() if solver == "lumped" else grids.ConsistentMass(solver=solver)
    scene = block_of_soil({"PS": PS, "P1": P1}[name], mass, blocks, per_block)
    simulation = libmpm.Simulation(scene, threads=arguments.threads)
    began = time.perf_counter()
    _ = simulation.engine
    simulation.step(4)
    setup = time.perf_counter() - began
    began = time.perf_counter()
    simulation.step(4)
    # A multiple of 4, as the stable step is watched at every fourth.
    steps = 4 * max(1, round(0.1 / (time.perf_counter() - began)))
    best = None
    for _ in range(max(3, arguments.repeats)):
        before, began = simulation.timings, time.perf_counter()
        simulation.step(steps)
        seconds = time.perf_counter() - began
        if best is None or seconds < best[0]:
            after = simulation.timings
            best = seconds, {k: (after.get(k, 0.0) - before.get(k, 0.0)) / steps for k in PHASES}
    count = simulation.statistics
    particles = blocks[0] * blocks[1] * per_block[0] * per_block[1]
    return {
        "case": case,
        "basis": name,
        "solver": solver,
        "blocks": list(blocks),
        "per_block": list(per_block),
        "triangles": int(count["cells"]),
        "functions": int(count["functions"]),
        "particles": particles,
        "steps": steps,
        "step_s": best[0] / steps,
        "timings": best[1],
        "setup_s": setup,
        "iterations": int(count["solver_iterations"]),
        "bytes": int(count["bytes"]),
    }


def exponent(lines, against, most=None):
    """Return the slope of log(time of a step), by least squares over the largest `most`."""
    chosen = sorted(lines, key=lambda r: r[against])[-(most or len(lines)) :]
    x, y = (np.log([r[k] for r in chosen]) for k in (against, "step_s"))
    return float(np.polyfit(x, y, 1)[0])


# --- Tables ---


def _table(columns, rows):
    yield "| " + " | ".join(columns) + " |"
    yield "|" + " --- |" * len(columns)
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def _trade_off_row(r):
    first = [r["basis"], r["mass"], r["step"]]
    if "end" not in r:
        return [*first, *[""] * 8, r["error"]]
    return [
        *first,
        f"{r['functions']}",
        f"{r['particles']:,}",
        f"{r['steps']:,}",
        f"{r['seconds']:.3f}",
        f"{r['bytes'] / 1024:.0f}",
        f"{r['displacement_rms']:.2%}",
        f"{r['velocity_rms']:.2%}",
        f"{r['energy_drift']:+.2%}",
        f"stops at {r['end']:.3g} s" if r["error"] else "",
    ]


def _scaling_row(r):
    parts = [f"{1e3 * r['timings'][k]:.3f}" for k in PHASES[:-1]]
    return [
        r["basis"],
        r["solver"],
        f"{r['triangles']:,}",
        f"{r['functions']:,}",
        f"{r['particles']:,}",
        f"{1e3 * r['step_s']:.3f}",
        *parts,
        f"{1e9 * r['step_s'] / r['particles']:.0f}",
        f"{r['iterations']}" if r["solver"] == "cg" else "",
        f"{r['bytes'] / 2**20:.1f}",
        f"{r['setup_s']:.2f}",
    ]


def tables(lines):
    """Return the tables of all lines as Markdown."""
    out = []
    for problem, what in (("bar", "Bar, one period"), ("column", "Column, one cycle")):
        rows = [_trade_off_row(r) for r in lines if r["case"] == problem]
        if rows:
            out += [f"### {what}", ""]
            out += _table(
                ("functions on", "mass", "step", "functions", "particles", "steps", "seconds",
                 "KiB", "displacement", "velocity", "energy", ""), rows,
            )  # fmt: skip
            out.append("")
    for case in ("particles", "functions"):
        own = [r for r in lines if r["case"] == case]
        if not own:
            continue
        out += [f"### Time of a step against {case}", ""]
        out += _table(
            ("basis", "solver", "triangles", "functions", "particles", "step, ms", *PHASES[:-1],
             "ns a particle", "iterations", "MiB", "set up, s"), map(_scaling_row, own),
        )  # fmt: skip
        kinds = sorted({(r["basis"], r["solver"]) for r in own})
        found = []
        for kind in kinds:
            same = [r for r in own if (r["basis"], r["solver"]) == kind]
            if len(same) > 2:
                slopes = (exponent(same, case), exponent(same, case, 3))
                found.append([*kind, *(f"{s:.2f}" for s in slopes)])
        out += ["", *_table(("basis", "solver", "exponent, all", "largest three"), found), ""]
    return "\n".join(out)
