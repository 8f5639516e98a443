"""What the laws of the method say, and what small scenes measure of it.

Four laws of Bonus (2023) and of numbers derived from it. Each function runs one point in 2D and
returns what the law predicts and what came out; `POINTS` lists all of them.

- smoothing: the F-bar ratio ψ is a length, ℓ = (Δx/2) √(ψ/(1-ψ)), whatever the time step: a wave of
  the volume keeps 1/(1 + (kℓ)²). With one stored volume it is a diffusion ψ Δx²/(4Δt).
- loss: one cycle takes (kΔx)²/4 of a PIC mode and (kΔx)⁴/40 of an APIC mode, times 1 - α.
- equilibrium: a tank filled at rest density presses 1 - (2/3) ρgH/K of ρgH²/2 on its side.
- acoustic: while nothing damps, gravity that sets in rings in it with the period 4H/c.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import libmpm
from libmpm import FBar, Method, boundaries, materials, sensors, shapes
from libmpm._src.advice.cases.settling import missing_depth
from libmpm._src.base.formulas import Field
from libmpm.methods import Transfer

Floats = npt.NDArray[np.float64]
Numbers = dict[str, float]

DENSITY = 1000.0  # kg/m³
GRAVITY = 10.0  # m/s²
DEPTH = 3.2  # m
STIFFNESS = 7.15  # γ of the equation of state

#: Water that is read of a slab: without so many waves at either end.
_ENDS = 1.0


@dataclass(frozen=True)
class Point:
    """One measurement of a law: what is chosen, and what runs it."""

    law: str
    chosen: dict[str, Any]
    measure: Callable[[dict[str, Any]], Numbers]


def water(modulus: float) -> Any:
    """Return inviscid water."""
    return materials.TaitFluid(
        density=DENSITY, bulk_modulus=modulus, viscosity=0.0, exponent=STIFFNESS
    )


def fitted(shape: Floats, values: Floats) -> float:
    """Return the amplitude of a shape in values."""
    return float(shape @ values / (shape @ shape))


# ---- waves in a free slab -----------------------------------------------------------------------


def slab(
    wave: int, waves: int, method: Method, *, dx: float, modulus: float, **body: Any
) -> libmpm.Scene:
    """Return water of some waves of `wave` cells, two cells high, free all around."""
    length = wave * waves
    scene = libmpm.Scene(
        name="slab", dimension=2, cell_size=dx, lower=(0.0, 0.0),
        upper=((length + 8) * dx, 10 * dx), method=method,
    )  # fmt: skip
    box = shapes.Box(lower=(4 * dx, 4 * dx), upper=((4 + length) * dx, 6 * dx))
    scene.add_body(name="water", shape=box, material=water(modulus), **body)
    return scene


def middle(x: Floats, wave: float) -> npt.NDArray[np.bool_]:
    """Return which particles are farther from the ends than a wave."""
    return (x > x.min() + _ENDS * wave) & (x < x.max() - _ENDS * wave)


def smoothing(chosen: dict[str, Any]) -> Numbers:
    """Let F-bar act on a cosine of the volume in water that stands still.

    A time step is so short that sound hardly moves: c Δt/Δx = 1e-6 or a quarter of it.
    """
    dx, modulus, size = 0.1, 1e6, 1e-5
    form, ratio, wave = chosen["form"], chosen["ratio"], chosen["wave"]
    step = chosen["step"] * 1e-6 * dx / math.sqrt(modulus / DENSITY)
    scene = slab(
        wave, 4, Method(time_step=step), dx=dx, modulus=modulus, fbar=FBar(form=form, ratio=ratio)
    )
    sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
    view = sim.particles["water"]
    x = view["position"][:, 0]
    k = 2 * math.pi / (wave * dx)
    shape = np.cos(k * (x - 4 * dx))
    view["pressure"] = modulus * size * shape
    inside = middle(x, wave * dx)
    two = form in ("two-volume", "split", "literal")
    name = "volume_ratio_smoothed" if two else "volume_ratio"

    def amplitude() -> float:
        return fitted(shape[inside], 1 - sim.particles["water"][name][inside]) / size

    theta = (k * dx) ** 2 / 4
    if two:
        sim.step(math.ceil(12 / (1 - ratio * (1 - theta))))
        kept = amplitude()
        length = math.sqrt(1 / kept - 1) / (k * dx)
        strength = math.sqrt(ratio / (1 - ratio))
        taken = math.sqrt(lost_by_sums("PIC", k * dx, 0.0, 2)) / (k * dx)
        return {"predicted": 0.5 * strength, "measured": length, "refined": taken * strength}
    plain = form == "one-volume"
    loss = theta if plain else (k * dx) ** 4 / 40
    sim.step(4)
    first, steps = amplitude(), math.ceil(min(0.5 / (ratio * loss), 4000))
    sim.step(steps)
    # A diffusivity D counts in Δx²/Δt where there is one, else the part that a pass takes away.
    unit = (k * dx) ** 2 if plain else (k * dx) ** 4
    taken = lost_by_sums("PIC" if plain else "APIC", k * dx, 1 - ratio, 2)
    return {
        "predicted": ratio * (0.25 if plain else 0.025),
        "measured": -math.log(amplitude() / first) / steps / unit,
        "refined": -math.log1p(-taken) / unit,
    }


def lost_by_law(scheme: str, theta: float, flip: float) -> float:
    """Return what the leading order says that a cycle takes."""
    loss = theta**2 / 4 if scheme in ("PIC", "PIC-FLIP") else theta**4 / 40
    return loss * (1 - flip)


def _spline(x: Floats) -> Floats:
    """Return the quadratic B-spline at distances in cells."""
    x = np.abs(x)
    return np.where(x < 0.5, 0.75 - x**2, 0.5 * np.maximum(1.5 - x, 0) ** 2)


def lost_by_sums(scheme: str, theta: float, flip: float, per_axis: int) -> float:
    """Return what a cycle takes of a wave over a lattice, by the sums over particles and nodes.

    In one dimension, since the wave and the lattice do not vary along the other: the largest
    eigenvalue of the map of a cell's velocities and slopes (v, C) of a Bloch wave. The laws are its
    leading orders for very many particles, but for one thing: the slope's transform at k + 2πn is
    of second order in k too, and takes 0.0012 (kΔx)⁴ off the 0.025 of APIC.
    """
    m = per_axis
    # Nodes are in the middle of cells; the particles of cells -1, 0 and 1 reach node 0.
    own = (np.arange(m) + 0.5) / m - 0.5
    cell = np.repeat((-1, 0, 1), m)
    place = cell + np.tile(own, 3)
    share = _spline(place) / _spline(place).sum() * np.exp(1j * theta * cell)
    affine = 0.0 if scheme in ("PIC", "PIC-FLIP") else 1.0
    spread = np.stack([share, -affine * share * place]).reshape(2, 3, m).sum(axis=1).ravel()
    away = np.array((-1, 0, 1)) - own[:, None]
    wave = np.exp(1j * theta * np.array((-1, 0, 1)))
    gathered = np.outer(_spline(away) @ wave, spread)
    slope = np.outer(4 * (_spline(away) * away) @ wave, spread)
    keep = np.hstack([np.eye(m), np.zeros((m, m))])
    step = np.vstack([gathered + flip * (keep - gathered), slope])
    # With a share that the grid cannot see, that share decays as α only: take the wave's own.
    value, vector = np.linalg.eig(step)
    start = np.exp(1j * theta * own)
    seen = np.abs(start.conj() @ vector[:m]) / np.linalg.norm(vector, axis=0)
    return float(1 - np.abs(value[np.argmax(seen)]))


def loss(chosen: dict[str, Any]) -> Numbers:
    """Let a shear wave decay in water without viscosity; nothing but the transfer takes of it.

    The time step is the stable one of that water, so that its stiffness decides how often a cycle
    happens.
    """
    wave, flip = chosen["wave"], chosen.get("flip", 0.0)
    scheme, dx = chosen["scheme"], chosen.get("cell_size", 0.1)
    modulus = chosen.get("modulus", 2.2e7)
    speed = math.sqrt(modulus / DENSITY)
    transfer = Transfer(scheme=scheme, **({"flip": flip} if flip else {}))
    theta = 2 * math.pi / wave
    k = theta / dx
    more: dict[str, Any] = {"particles_per_cell": chosen.get("particles", 4)}
    if chosen.get("jitter"):
        more["sampling"] = shapes.Jitter(share=chosen["jitter"], seed=1)
    field = Field(components=("0.0 * x", f"{1e-6 * speed!r} * sin({k!r} * x)"))
    scene = slab(
        wave, 4, Method(transfer=transfer, cfl=chosen.get("cfl", 0.4)), dx=dx, modulus=modulus,
        velocity=field, fbar=None, **more,
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
    x = sim.particles["water"]["position"][:, 0]
    inside = middle(x, wave * dx)
    crest = np.exp(1j * k * x[inside])

    def amplitude() -> float:
        return float(np.abs(sim.particles["water"]["velocity"][inside, 1] @ crest))

    expected = lost_by_law(scheme, theta, flip)
    sim.step(4)
    first, before = amplitude(), sim.time
    steps = math.ceil(min(max(0.4 / expected, 6), 2000))
    sim.step(steps)
    decay = -math.log(amplitude() / first)
    refined = lost_by_sums(scheme, theta, flip, math.isqrt(chosen.get("particles", 4)))
    if "cell_size" not in chosen:
        return {
            "predicted": expected,
            "measured": -math.expm1(-decay / steps),
            **({} if chosen.get("jitter") else {"refined": refined}),
        }
    # Per second: a viscosity of PIC, m²/s, and a rate of APIC, 1/s.
    rate, step = decay / (sim.time - before), (sim.time - before) / steps
    if scheme == "PIC":
        return {
            "predicted": speed * dx / (4 * chosen["cfl"]),
            "measured": rate / k**2,
            "refined": -math.log1p(-refined) / step / k**2,
        }
    return {
        "predicted": expected * speed / (chosen["cfl"] * dx),
        "measured": rate,
        "refined": -math.log1p(-refined) / step,
    }


# ---- a tank that gravity hits -------------------------------------------------------------------


def tank(
    cells: int, modulus: float, walls: str, method: Method, fbar: Any, interval: float
) -> libmpm.Scene:
    """Return four cells of water of rest density, H deep, eight cells of air above."""
    dx = DEPTH / cells
    scene = libmpm.Scene(
        name="tank", dimension=2, cell_size=dx, lower=(0.0, 0.0),
        upper=(4 * dx, DEPTH + 8 * dx), gravity=(0.0, -GRAVITY), method=method,
    )  # fmt: skip
    box = shapes.Box(lower=(0.0, 0.0), upper=(4 * dx, DEPTH))
    scene.add_body(name="water", shape=box, material=water(modulus), fbar=fbar)
    response = boundaries.Mirror() if walls == "mirrored" else boundaries.Slip(cell="held")
    faces = shapes.DomainWalls(faces=("x-", "x+", "y-"))
    scene.add_boundary(name="walls", shape=faces, response=response)
    load = sensors.LoadCell(boundary="walls", faces=("x-",), interval=interval)
    scene.add_sensor(name="load", sensor=load)
    return scene


def pressed(sim: libmpm.Simulation) -> tuple[Floats, Floats, Floats]:
    """Return ends and lengths of the samples, s, and the force on the side, parts of ρgH²/2."""
    series = sim.sensors["load"]
    time = np.asarray(series.time)
    length = np.diff(time, prepend=0.0)
    keep = length > 0
    full = 0.5 * DENSITY * GRAVITY * DEPTH**2
    return time[keep], length[keep], -np.asarray(series.values)[keep, 0] / full


def settled_force(compression: float) -> float:
    """Return the force at equilibrium by the equation of state, parts of ρgH²/2.

    Mass lies above mass: p = ρ g (H - Y) in the place Y before settling. A layer that was dY thick
    is J dY: F = ∫ p J dY, J = (1 + γ p/K)^(-1/γ).
    """
    y = (np.arange(20000) + 0.5) / 20000
    return float(2 * np.mean(y * (1 + STIFFNESS * compression * y) ** (-1 / STIFFNESS)))


def equilibrium(chosen: dict[str, Any]) -> Numbers:
    """Let the tank settle and read the mean force, of whole periods 4H/c, and its shift from 1.

    PIC takes the ringing away and leaves the place where it ends: the first mode falls to 2e-5.
    `refined` is the force by the equation of state, of the depth that held nodes leave.
    """
    cells, compression = chosen["cells"], chosen["compression"]
    modulus = DENSITY * GRAVITY * DEPTH / compression
    period = 4 * DEPTH / math.sqrt(modulus / DENSITY)
    method = Method(cfl=0.4, transfer=chosen["transfer"])
    fbar = "default" if chosen["fbar"] else None
    sim = libmpm.Simulation(
        tank(cells, modulus, chosen["walls"], method, fbar, period / 20),
        device="cpu", precision="double", threads=1,
    )  # fmt: skip
    # Of the first mode, k = π/2H, PIC's viscosity takes k² Δx²/(8 Δt) per second.
    steps = 11 * 8 * (2 * cells / math.pi) ** 2
    periods = chosen.get("periods") or math.ceil(steps * sim.plan.time_step / period)
    sim.run(until=(periods + chosen.get("over", 4)) * period, progress=False)
    time, length, force = pressed(sim)
    late = time > (periods + 1e-6) * period
    whole = range(periods, math.floor(time[-1] / period + 1e-6))
    swings = [np.ptp(force[(time > n * period) & (time <= (n + 1) * period)]) / 2 for n in whole]
    found = _mean(time[late], length[late], force[late], max(swings)) - 1
    # Averaging the volume over neighbours takes the misfit of the held cells away.
    lacks = missing_depth(cells) if chosen["walls"] == "held" and not chosen["fbar"] else 0.0
    part = 1 - lacks / cells
    return {
        "predicted": -2 / 3 * compression,
        "measured": found,
        "refined": part**2 * _ringing_force(part * compression, swings) - 1,
        "ringing": float(swings[-1]),
    }


def _mean(time: Floats, length: Floats, force: Floats, ringing: float) -> float:
    """Return the mean force; of one that rings, over whole swings between rises through 1."""
    if ringing < 1e-3:
        return float(np.average(force, weights=length))
    up = np.flatnonzero((force[:-1] < 1) & (force[1:] >= 1))
    # Samples are means over their lengths: the impulse is exact at their ends.
    impulse = np.concatenate([[0.0], np.cumsum(force * length)])
    ends = np.concatenate([[time[0] - length[0]], time])
    middle = time - length / 2
    rises = middle[up] + (1 - force[up]) / (force[up + 1] - force[up]) * np.diff(middle)[up]
    at = np.interp(rises[[0, -1]], ends, impulse)
    return float((at[1] - at[0]) / (rises[-1] - rises[0]))


def _ringing_force(compression: float, swings: list[float]) -> float:
    """Return the mean side force of a column that rings by so much in each of some periods.

    The mean of p stays ρ g (H - Y), that of p J does not: ringing freely from p = 0, by all of the
    settled force, p is that and waves whose mean square is half of its square, and the shift is 3/2
    of the settled one.
    """
    shift = settled_force(compression) - 1
    return 1 + shift * (1 + 0.5 * float(np.mean(np.minimum(swings, 1.0) ** 2)))


def ring(time: Floats, speed: float, depth: float) -> Floats:
    """Return the undamped force, parts of that of the full depth H, of a column `depth` deep.

    (ct/H)² up to ct = H, then 2 - (2 - ct/H)² up to 3 H, then (4 - ct/H)² up to 4 H.
    """
    s = np.mod(speed * time / depth, 4)
    force = np.where(s <= 1, s**2, np.where(s <= 3, 2 - (2 - s) ** 2, (4 - s) ** 2))
    return np.asarray((depth / DEPTH) ** 2 * force)


def acoustic(chosen: dict[str, Any]) -> Numbers:
    """Compare the ringing with the closed form: its period, and its largest error in one of them.

    `refined` is the period, and `error_refined` the error, of the depth that held nodes leave and
    of the speed at the mean pressure ρgH/2, c (1 + (γ + 1) ρgH/4K) in the place before settling.
    """
    cells, modulus = chosen["cells"], chosen["modulus"]
    speed = math.sqrt(modulus / DENSITY)
    period = 4 * DEPTH / speed
    sim = libmpm.Simulation(
        tank(cells, modulus, chosen["walls"], Method(cfl=0.3), None, 0.0),
        device="cpu", precision="double", threads=1,
    )  # fmt: skip
    sim.run(until=1.6 * period, progress=False)
    time, length, force = pressed(sim)
    at = time - length / 2
    first = at < period
    lacks = missing_depth(cells) if chosen["walls"] == "held" else 0.0
    depth = DEPTH * (1 - lacks / cells)
    faster = speed * (1 + (STIFFNESS + 1) / 4 * DENSITY * GRAVITY * DEPTH / modulus)
    # The force of the column, whatever its depth, rises through its mean at ct = H and 5 H.
    mean = (depth / DEPTH) ** 2
    up = np.flatnonzero((force[:-1] < mean) & (force[1:] >= mean))
    share = (mean - force[up]) / (force[up + 1] - force[up])
    rises = at[up] + share * (at[up + 1] - at[up])
    return {
        "predicted": period,
        "measured": float(rises[-1] - rises[0]),
        "refined": 4 * depth / faster,
        "error": float(np.abs(force - ring(at, speed, DEPTH))[first].max()),
        "error_refined": float(np.abs(force - ring(at, faster, depth))[first].max()),
    }


# ---- points -------------------------------------------------------------------------------------


def _smoothing() -> list[Point]:
    rows: list[dict[str, Any]] = [
        {"form": "two-volume", "ratio": ratio, "wave": wave, "step": step}
        for ratio, waves in ((0.25, (16,)), (0.9, (16, 32)), (0.99, (16, 32, 64)), (0.999, (96,)))
        for wave in waves
        for step in (1.0, 0.25)
    ]
    rows += [
        {"form": form, "ratio": ratio, "wave": 32, "step": step}
        for form, ratio in (("split", 0.99), ("literal", 0.99))
        for step in (1.0,)
    ]
    rows += [
        {"form": form, "ratio": ratio, "wave": 16, "step": step}
        for form in ("one-volume", "one-volume-gradient")
        for ratio, step in ((0.02, 1.0), (0.2, 1.0), (0.2, 0.25))
    ]
    return [Point("smoothing", row, smoothing) for row in rows]


def _loss() -> list[Point]:
    rows: list[dict[str, Any]] = [
        {"scheme": scheme, "wave": wave, "particles": 4}
        for scheme in ("PIC", "APIC")
        for wave in (8, 16, 32, 64)
    ]
    rows += [
        {"scheme": scheme, "wave": 16, "particles": n, **more}
        for scheme in ("PIC", "APIC")
        for n, more in ((1, {}), (9, {}), (16, {}), (4, {"jitter": 0.5}))
    ]
    rows += [
        {"scheme": scheme, "wave": 16, "particles": 4, "flip": flip}
        for scheme in ("PIC-FLIP", "AFLIP")
        for flip in (0.5, 0.9, 0.99)
    ]
    rows += [
        {"scheme": scheme, "wave": 32, "cell_size": dx, "cfl": 0.45, "modulus": modulus}
        for scheme in ("PIC", "APIC")
        for dx, modulus in ((0.0125, 2.2e5), (0.0125, 2.2e7), (0.0125, 2.2e9), (0.05, 2.2e9))
    ]
    return [Point("loss", row, loss) for row in rows]


def _equilibrium() -> list[Point]:
    common = {"transfer": "PIC", "fbar": False}
    rows: list[dict[str, Any]] = [
        {"cells": 32, "compression": compression, "walls": "mirrored", **common}
        for compression in (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
    ]
    rows += [
        {"cells": cells, "compression": 0.02, "walls": walls, **common}
        for walls, cells in (("mirrored", 16), ("mirrored", 64), ("held", 16), ("held", 32))
    ]
    rows += [
        {
            "cells": 32, "compression": 0.02, "walls": walls, "transfer": "APIC", "fbar": True,
            "periods": 40, "over": 80,
        }
        for walls in ("mirrored", "held")
    ]  # fmt: skip
    return [Point("equilibrium", row, equilibrium) for row in rows]


def _acoustic() -> list[Point]:
    rows: list[dict[str, Any]] = [
        {"cells": cells, "modulus": 2.2e8, "walls": walls}
        for walls in ("mirrored", "held")
        for cells in (16, 32, 64, 128)
    ]
    rows += [{"cells": 32, "modulus": modulus, "walls": "mirrored"} for modulus in (2.2e7, 2.2e9)]
    return [Point("acoustic", row, acoustic) for row in rows]


POINTS: tuple[Point, ...] = (*_smoothing(), *_loss(), *_equilibrium(), *_acoustic())
