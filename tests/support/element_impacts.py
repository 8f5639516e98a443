"""The bar of the UW WASIRF flume against a rigid wall (Bonus 2023, 6.2.2): particles, elements.

Shared by tests and `benchmarks/elements.py`.
"""

from __future__ import annotations

import math

import numpy as np

import libmpm
from libmpm import boundaries, sensors, shapes
from support.element_cases import Array, Numbers, mesh_of, solid

#: Length and side of the bar, m; density, kg/m³; modulus, Pa; Poisson's ratio; speed, m/s; gap, m.
LONG, SIDE, DENSITY, MODULUS, RATIO, SPEED, GAP = 0.1016, 0.0254, 1000.0, 1e7, 0.4, 0.58, 0.01
#: v A √(ρE), N (37.42): largest force of ASCE 7's step and of an undamped half-sine.
FORCE = SPEED * SIDE**2 * math.sqrt(DENSITY * MODULUS)
#: 2 L √(ρ/E), s: duration of the step. That of the half-sine, π √(m/k), is π/2 times as long.
STEP = 2 * LONG * math.sqrt(DENSITY / MODULUS)
#: The printed bands: durations of the step and of the half-sine, ms (2.03, 3.19).
DURATIONS = 1e3 * STEP, 1e3 * STEP * math.pi / 2
#: Samples of the force are that long, s; a peak is a mean over ten of them.
_SAMPLE, _SMOOTH = 2e-5, 10
#: A wall counts as loaded above this part of `FORCE`.
_LOADED = 0.05


def wasirf_scene(
    edge: float = 0.5, scheme: str = "PIC-FLIP", flip: float = 0.0, cells: int = 8,
    gap: float = GAP, volumes: str | None = None,
) -> libmpm.Scene:  # fmt: skip
    """Return a quarter of the bar between its planes of symmetry, `gap` (m) before the wall x-.

    No gravity. `edge` in cells (infinite = particles, 8 a cell); 8 cells on its side are 3.175 mm,
    the source's. `flip` is its α; APIC is AFLIP with 0, PIC is PIC-FLIP with 0.
    """
    dx = SIDE / cells
    wide = (cells // 2 + 4) * dx
    scene = libmpm.Scene(
        dimension=3, cell_size=dx, lower=(0, 0, 0),
        upper=((math.ceil((gap + LONG) / dx) + 4) * dx, wide, wide),
        method=libmpm.Method(cfl=0.3, transfer=libmpm.methods.Transfer(scheme=scheme, flip=flip)),
    )  # fmt: skip
    scene.add_body(
        name="bar",
        shape=mesh_of((gap, 0, 0), (gap + LONG, SIDE / 2, SIDE / 2), edge * dx, volumes=volumes),
        material=solid("FixedCorotated", DENSITY, MODULUS, RATIO), velocity=(-SPEED, 0, 0),
    )  # fmt: skip
    scene.add_boundary(name="wall", shape=shapes.DomainWalls(faces=("x-",)),
                       response=boundaries.Separable())  # fmt: skip
    scene.add_boundary(name="middle", shape=shapes.DomainWalls(faces=("y-", "z-")),
                       response=boundaries.Mirror())  # fmt: skip
    cell = sensors.LoadCell(boundary="wall", interval=_SAMPLE)
    scene.add_sensor(name="force", sensor=cell)
    return scene


def pulse(time: Array, force: Array) -> Numbers:
    """Return what a force (N) on the wall over time (s) is beside the printed models.

    `force`: largest mean over 0.2 ms over `FORCE`. `duration`: ms above a twentieth of it;
    `at_half`: above half of it (step 2.03, half-sine 2.13). `impulse`: over 2 m v.
    """
    mean = np.convolve(force, np.full(_SMOOTH, 1 / _SMOOTH), mode="valid")
    lasts = {}
    for name, part in (("duration", _LOADED), ("at_half", 0.5)):
        loaded = time[force > part * FORCE]
        lasts[name] = 1e3 * float(loaded[-1] - loaded[0]) if len(loaded) else 0.0
    twice = 2 * DENSITY * LONG * SIDE**2 * SPEED
    return {
        "force": float(mean.max()) / FORCE,
        **lasts,
        "impulse": float((force * np.diff(time, prepend=0.0)).sum()) / twice,
    }


def wasirf_bar(
    edge: float = 0.5, flip: float = 0.0, scheme: str = "PIC-FLIP", cells: int = 8,
    gap: float = GAP, volumes: str | None = None, precision: str = "double",
) -> Numbers:  # fmt: skip
    """Return force, duration (ms) and impulse of the bar's impact: `pulse`, and its rebound.

    `rebound` is the speed afterwards over that before. Runs from the start to the duration of the
    half-sine after faces would meet without a grid, whose functions let them meet earlier.
    """
    scene = wasirf_scene(edge, scheme, flip, cells, gap, volumes)
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    sim.run(until=gap / SPEED + 0.5 * math.pi * STEP, progress=False)
    series = sim.sensors["force"]
    force = -4 * series.values[:, list(series.components).index("force_x")]
    body = sim.particles["bar"].read(["mass", "velocity"])
    after = float((body["mass"] * body["velocity"][:, 0]).sum() / body["mass"].sum())
    return pulse(np.asarray(series.time), force) | {
        "rebound": after / SPEED, "steps": float(sim.steps),
    }  # fmt: skip
