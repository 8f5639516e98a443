"""Rigid bodies against closed forms and beside elastic ones: flight, slope, float, roll, impact.

    python benchmarks/rigid.py                 all cases, some minutes on two threads
    python benchmarks/rigid.py --only float    those whose names begin so
    python benchmarks/rigid.py --write         and the table of docs/rigid.md

A case has bounds (design/rigid.md says where they come from); one that is missed is marked. One
JSON line a case goes to benchmarks/results/rigid.jsonl.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import contact_heave
from result_pages import append, chosen, filled, load, markdown

import libmpm
from libmpm import contacts, materials, sensors
from libmpm._src.cli import bench
from support import rigid_scenes as scenes

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/rigid.jsonl"
PAGE = ROOT / "docs/rigid.md"
MARKS = "<!-- table: benchmarks/rigid.py --write -->", "<!-- end of rigid -->"

#: (quantity, at most): the absolute value of a deviation, or of a share.
Bound = tuple[str, float]
Values = dict[str, float]

G = 9.81


def _run(scene: libmpm.Scene, until: float, **options: Any) -> libmpm.Simulation:
    chosen: dict[str, Any] = {"device": "cpu", "precision": "double"} | options
    simulation = libmpm.Simulation(scene, **chosen)
    simulation.run(until=until)
    return simulation


def _solid(density: float, youngs_modulus: float) -> Any:
    return materials.NeoHookean(density=density, youngs_modulus=youngs_modulus, poissons_ratio=0.3)


def slope(friction: float, wall: bool, shape: str = "block", degrees: float = 30.0) -> Values:
    """Return the errors of the acceleration, parts of g, and of the rate of turn, of its own."""
    simulation = _run(scenes.incline(2, friction, degrees, shape, cells=24, wall=wall), 0.4)
    found = simulation.sensors["motion"]
    after = found.time > 0.1
    a = -np.polyfit(found.time[after], found["velocity_x"][after], 1)[0]
    turn = np.polyfit(found.time[after], found["angular_velocity"][after], 1)[0]
    g, angle = 10.0, math.radians(degrees)
    slides = g * (math.sin(angle) - friction * math.cos(angle))
    if shape == "block":
        return {"acceleration": abs(a - max(slides, 0.0)) / g}
    rolls = friction >= math.tan(angle) / 3
    expected = g * math.sin(angle) / 1.5 if rolls else slides
    spins = expected / 0.5 if rolls else 4 * friction * g * math.cos(angle)
    return {"acceleration": abs(a - expected) / g, "turn": abs(turn / spins - 1)}


def floats(density: float, stiff: float | None = None, cells: int = 8) -> Values:
    """Return how far the mean place after a second is from Archimedes', cells, and its cost."""
    material = None if stiff is None else _solid(density, stiff)
    scene = scenes.floating(density, material, cells)
    scene.add_sensor(name="place", sensor=sensors.BodyTracker(body="block", interval=0.02))
    began = time.process_time()
    simulation = _run(scene, 3.0)
    place = simulation.sensors["place"]
    height = place["centroid_y"][place.time > 1.0]
    return {
        "draught": float(abs(height.mean() - place["centroid_y"][0]) * cells),
        "spread": float(height.std() * cells),
        "steps": float(simulation.steps),
        "processor": round(time.process_time() - began, 2),
    }


def heave(density: float, stiff: float | None = None, cells: int = 8, lift: float = 2.0) -> Values:
    """Return the time from a release `lift` cells above rest to the lowest place, s.

    And what that is by linear potential flow in the same tank (`contact_heave.py`). `overshoot`:
    how far the lowest place is below rest, parts of the lift.
    """
    material = None if stiff is None else _solid(density, stiff)
    scene = scenes.floating(density, material, cells, lift=lift)
    scene.add_sensor(name="place", sensor=sensors.BodyTracker(body="block", interval=0.005))
    simulation = _run(scene, 1.6)
    place = simulation.sensors["place"]
    k = int(np.argmin(place["centroid_y"]))
    c = np.polyfit(place.time[k - 6 : k + 7], place["centroid_y"][k - 6 : k + 7], 2)
    # The tank is four blocks wide: what the block leaves when it is lifted raises the water.
    rest = place["centroid_y"][0] - lift / cells * 0.75
    half_period = float(-c[1] / (2 * c[0]))
    theory = contact_heave.heave(density / 1000.0, lift / cells)
    return {
        "half_period": half_period,
        "theory": theory["half_period"],
        "error": half_period / theory["half_period"] - 1,
        "overshoot": float((rest - place["centroid_y"][k]) * cells / lift),
        "overshoot_theory": theory["overshoot"],
        "steps": float(simulation.steps),
    }


def capsizes(stiff: float | None = None, cells: int = 8) -> Values:
    """Return how long a tall block afloat at 5 degrees takes to 40 degrees, and how far it goes.

    Half as wide as high and of density 0.5 it is unstable: GM = b²/(12 d) - (h - d)/2 < 0.
    """
    material = None if stiff is None else _solid(500.0, stiff)
    scene = scenes.floating(500.0, material, cells, degrees=5.0, wide=0.5)
    scene.add_sensor(name="place", sensor=sensors.BodyTracker(body="block", interval=0.01))
    simulation = _run(scene, 4.0)
    place = simulation.sensors["place"]
    angle = np.abs(place["angle"])
    quarter = math.radians(40.0)
    return {
        "time": float(place.time[np.argmax(angle > quarter)])
        if angle.max() > quarter
        else math.nan,
        "furthest": float(np.degrees(angle.max())),
        "steps": float(simulation.steps),
    }


def momentum(law: bool) -> Values:
    """Return the largest change of momentum of a block and water without walls, by its own."""
    scene = scenes.tub(contacts.Fluid() if law else None)
    simulation = libmpm.Simulation(scene, device="cpu", precision="double")
    kept = []
    for until in (0.02, 0.06, 0.1, 0.14):
        simulation.run(until=until)
        kept.append(
            sum(
                (np.asarray(p["mass"])[:, None] * np.asarray(p["velocity"])).sum(axis=0)
                for p in (simulation.particles[name] for name in ("water", "block"))
            )
        )
    start = 45.0 * np.array([0.3, -2.0])
    return {"momentum": float(np.abs(np.array(kept) - start).max() / np.abs(start).max())}


def strikes(
    stiff: float | None, short: bool, column: float = 1e7, cells: int = 4, density: float = 2000.0
) -> Values:
    """Return the force of a bar on a column over that of a rigid one, and the impulse over M v.

    On a long column the mean from 2 to 8 ms over that of ρ c A v exp(-ρ c A t / M); on a short one
    of stiffness k = E A / L the peak over v √(k M) and the time that they touch over π √(M / k),
    which leave out the column's own mass, a fifth of the bar's.
    """
    debris: Any = (
        materials.Rigid(density=density)
        if stiff is None
        else materials.NeoHookean(density=density, youngs_modulus=stiff, poissons_ratio=0.0)
    )
    area, mass, length = 0.1, density * 0.06, 0.25 if short else 1.0
    began = time.process_time()
    simulation = _run(scenes.column(debris, column, length, cells), 0.04 if short else 0.016)
    load = simulation.sensors["blow"]
    normal, at = load["normal"], load.time
    wave = math.sqrt(1000.0 * column) * area
    first = at[np.argmax(normal > 0.05 * wave)]
    values = {"steps": float(simulation.steps)}
    if short:
        stiffness = column * area / length
        touching = at[normal > 0.05 * normal.max()]
        values |= {
            "peak": float(normal.max() / math.sqrt(stiffness * mass)),
            "time": float(np.ptp(touching) / (math.pi * math.sqrt(mass / stiffness))),
            "impulse": float(normal.sum() * 2e-4 / mass),
        }
    else:
        seen = (at > first + 2e-3) & (at < first + 8e-3)
        expected = wave * np.exp(-wave / mass * (at[seen] - first))
        values["force"] = float(normal[seen].mean() / expected.mean())
    return values | {"processor": round(time.process_time() - began, 2)}


Case = tuple[Callable[..., Values], dict[str, Any], list[Bound]]


def _named(stiff: float | None) -> str:
    return "rigid" if stiff is None else f"E {stiff:.0e} Pa"


def _cases() -> dict[str, Case]:
    out: dict[str, Case] = {}
    for wall, on in ((True, "a wall"), (False, "a held rigid slab")):
        for friction in (0.0, 0.3, 0.8):
            bound = 1e-3 if wall else 0.02
            out[f"slope 30°, block on {on}, μ {friction:g}"] = (
                slope, {"friction": friction, "wall": wall}, [("acceleration", bound)],
            )  # fmt: skip
    for degrees, friction, what in ((20.0, 0.6, "rolls"), (30.0, 0.05, "slips")):
        out[f"slope {degrees:g}°, disc of 24 cells {what} on a wall, μ {friction:g}"] = (
            slope,
            {"friction": friction, "wall": True, "shape": "disc", "degrees": degrees},
            [("acceleration", 0.02), ("turn", 0.1)],
        )
    for law, what in ((True, "by contact"), (False, "as one")):
        out[f"momentum with water, {what}"] = (momentum, {"law": law}, [("momentum", 1e-12)])
    for density in (0.3, 0.5, 0.8, 0.9):
        for stiff in (None, 1e6):
            given = {"density": 1000 * density, "stiff": stiff}
            name = f"density {density:g}, {_named(stiff)}"
            out[f"float, {name}"] = (floats, given, [("draught", 0.15)])
    for density, stiff, cells in (
        *((d, e, n) for n in (8, 12, 16) for d in (0.3, 0.5, 0.8, 0.9) for e in (None, 1e6)),
        (0.5, 1e7, 8), (0.5, 1e7, 12),
    ):  # fmt: skip
        out[f"heave, density {density:g}, {cells} cells, {_named(stiff)}"] = (
            heave,
            {"density": 1000 * density, "stiff": stiff, "cells": cells, "lift": cells / 4},
            [("error", 0.15)],
        )
    for density, stiff in itertools.product((0.3, 0.5, 0.8, 0.9), (None, 1e6)):
        out[f"heave from one cell, density {density:g}, 12 cells, {_named(stiff)}"] = (
            heave,
            {"density": 1000 * density, "stiff": stiff, "cells": 12, "lift": 1.0},
            [("error", 0.15)],
        )
    for stiff in (None, 1e6):
        out[f"capsize, {_named(stiff)}"] = (capsizes, {"stiff": stiff}, [])
    for short in (False, True):
        for stiff in (None, 1e10, 1e9, 1e8):
            name = f"bar strikes a {'short' if short else 'long'} column, {_named(stiff)}"
            out[name] = (strikes, {"stiff": stiff, "short": short}, [])
    return out


CASES = _cases()


def table(lines: list[dict[str, Any]]) -> str:
    """Return the newest line of each case as a Markdown table."""
    newest = {x["case"]: x for x in lines}
    rows = [["case", "measured", "bound"]]
    for name, (_, _, bounds) in CASES.items():
        if name not in newest:
            continue
        values = newest[name]["values"]
        said = "; ".join(f"{k} {v:.3g}" for k, v in values.items() if k not in ("seconds",))
        missed = "" if all(newest[name]["met"]) else " (missed)"
        rows.append([name, said, "; ".join(f"{k} ≤ {b:g}" for k, b in bounds) + missed])
    return "\n".join(markdown(rows))


def main() -> int:
    """Do what the command line says."""
    arguments, names = chosen(__doc__, RESULTS, CASES)
    missed = 0
    for name in names:
        case, given, bounds = CASES[name]
        began = time.time()
        values = case(**given) | {"seconds": round(time.time() - began, 1)}
        met = [bool(abs(values[k]) <= b) for k, b in bounds]
        missed += met.count(False)
        line = {"case": name, "values": values, "bounds": [f"{k} at most {b:g}" for k, b in bounds],
                "met": met, "hardware": "CPU", "commit": bench.commit(),
                "version": libmpm.__version__}  # fmt: skip
        append(arguments.output, line)
        print(name, values, met, flush=True)
    if arguments.write:
        PAGE.write_text(filled(PAGE, *MARKS, table(load(arguments.output))), encoding="utf-8")
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
