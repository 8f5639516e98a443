"""Cases whose numbers were measured in another set-up than their source's, here in the source's.

Each function builds and runs one of them and returns what was measured. `made` makes a simulation
that may end before its time (`claims.Timed`): what is measured then is of the time reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import bridges
import numpy as np
from bridges_scenes import MODELS
from bridges_scenes import scene as flume

import libmpm
from libmpm import cases
from libmpm._src.advice.cases.coupled import away_from_models, peak_of_tip
from libmpm._src.advice.cases.fluids import swing
from libmpm.methods import FBar, Method, Transfer
from libmpm.sensors import BodyTracker, ParticleTracker

Values = dict[str, float]
Made = Callable[[libmpm.Scene], libmpm.Simulation]
Parameters = Mapping[str, Any]


def block_in_water(made: Made, p: Parameters) -> Values:
    """V13: plateau of the deck's load over formula (6.10). Yang (2016) 6.2.4."""
    case = cases.case("debris-at-deck")
    full = case.parameters("reduced", {k: v for k, v in p.items() if k != "kernel"})
    sim = made(
        case.build(full, cases.Options(method=p.get("kernel") and Method(transfer="FLIP", cfl=0.1)))
    )
    return dict(case.measure(sim, full))


def bridge(made: Made, p: Parameters) -> Values:
    """V7 to V9: decks in bores and blocks that dam, with linear functions. Yang (2016) 5.2, 6.1.

    The source modifies its functions near the nodes (A.4, A.5), which only the CPU has; the plain
    ones end within 200 steps.
    """
    model = MODELS[p["model"]]
    block = p.get("block")
    sim = made(flume(model, p["method"], p["bulk_modulus"], block, linear=True, cfl=p.get("cfl")))
    sim.run(until=p["until"], progress=False)
    values = bridges.deck_values(sim, model) if model.deck else bridges.front(sim, model)
    return values | (bridges.block_values(sim, model, block) if block else {})


def dominoes(made: Made, p: Parameters) -> Values:
    """Row of 24, ASFLIP as published: how many fall, and the speed of the wave. Bonus (2023) 6.9.

    "last" is the last one that has left the upright by more than 12 degrees.
    """
    case = cases.case("dominoes")
    full = case.parameters("full", {k: v for k, v in p.items() if k != "particles_per_cell"})
    scene = case.build(full, cases.Options())
    ids = full["cells"], p["particles_per_cell"]
    sim = made(_finer(scene, *ids, full["slab"]))
    sim.run(until=full["duration"], progress=False)
    free, leaning = [], 0
    for k in range(full["count"]):
        series = sim.sensors[f"top-{k}"]
        named = {
            a: [i for i, n in enumerate(series.components) if n.startswith(f"position_{a}")]
            for a in "xy"
        }
        up, across = series.values[:, named["y"]], series.values[:, named["x"]]
        below = np.flatnonzero(up.max(axis=1) + scene.cell_size / 4 < full["beam"] * (1 - 1e-3))
        free.append(float(series.time[below[0]]) if len(below) else math.inf)
        moved = across.mean(axis=1) - (across[0].mean() if k else 0.0)
        leaning = (
            k + 1 if len(moved) and moved[-1] > 0.048 * math.sin(math.radians(12)) else leaning
        )
    fallen, first = int(np.isfinite(free).sum()), full["steady"]
    speed = math.nan
    if fallen > first + 1:
        speed = (fallen - 1 - first) * 0.030 / (free[fallen - 1] - free[first])
    return {"fallen": float(fallen), "last_leaning": float(leaning), "speed": speed}


def _finer(scene: libmpm.Scene, cells: int, each: int, slab: int) -> libmpm.Scene:
    """Return the row with other particles a cell, trackers at the upper ones of both ends."""
    told = scene.to_dict()
    side = round(each ** (1 / scene.dimension))
    across, up, deep = side * cells, side * 8 * cells, side * slab or 1
    for body in told["bodies"]:
        body["particles_per_cell"] = side**scene.dimension
    sizes = {b["name"]: k for k, b in enumerate(told["bodies"])}
    for entry in told["sensors"]:
        k = sizes[entry["name"].replace("top", "domino")]
        first = k * across * up * deep
        entry["sensor"]["ids"] = [first + (i * up + up - 1) * deep for i in (0, across - 1)]
    return libmpm.Scene.from_dict(told)


def sloshing(made: Made, p: Parameters) -> Values:
    """Period and decay: slip walls, water's K, no pressure at the start. Bonus (2023) 6.5."""
    case = cases.case("sloshing")
    full = case.parameters("full", {k: v for k, v in p.items() if k != "until"})
    method = Method(cfl=0.3, transfer=Transfer(scheme="AFLIP", flip=0.25))
    fbar = FBar(form="two-volume", ratio=0.25)
    scene = _unpressed(case.build(full, cases.Options(method=method, fbar=fbar)))
    mass = [math.prod(body.shape.size) for body in scene.bodies]
    for body in scene.bodies:
        scene.add_sensor(name=body.name, sensor=_centre_of(body.name, 0.02))
    sim = made(scene)
    sim.run(until=p["until"], progress=False)
    every = [sim.sensors[body.name] for body in sim.scene.bodies]
    time = np.asarray(every[0].time)
    x = np.average([_column(s, "centroid_x") for s in every], axis=0, weights=mass)
    # Without a period it has not swung through the middle, for want of time or of life.
    away = x - 1.6
    left = {"left_of_the_start": float(away[-1] / away[0]), "until": sim.time}
    return dict(swing(time, away)) | left


def _centre_of(body: str, interval: float) -> BodyTracker:
    return BodyTracker(body=body, quantities=("centroid",), interval=interval)


def _column(series: Any, name: str) -> Any:
    """Return the samples of one component."""
    return np.asarray(series.values)[:, list(series.components).index(name)]


def _unpressed(scene: libmpm.Scene) -> libmpm.Scene:
    """Return the scene with water that starts without pressure."""
    told = scene.to_dict()
    for body in told["bodies"]:
        body["hydrostatic"] = None
    return libmpm.Scene.from_dict(told)


def elastic_column(made: Made, p: Parameters) -> Values:
    """Largest displacement of the tip, m, and its time, s, without F-bar. Bonus (2023) 6.7."""
    case = cases.case("elastic-column-light")
    full = case.parameters("full", {"coarser": (), **p})
    scene = case.build(full, cases.Options(fbar=None, solid_fbar=None))
    # The upper two particles of the left face, in the middle of the width: lattices have two a
    # cell, the last axis fastest, and ids go on from body to body.
    water, column = (
        [round(2 * size / scene.cell_size) for size in body.shape.size] for body in scene.bodies
    )
    deep = column[2] if len(column) == 3 else 1
    ids = [math.prod(water) + j * deep + deep // 2 for j in (column[1] - 2, column[1] - 1)]
    tracker = ParticleTracker(body="column", ids=ids, interval=1e-3)
    scene.add_sensor(name="tip", sensor=tracker)
    sim = made(scene)
    sim.run(until=p["until"], progress=False)
    series = sim.sensors["tip"]
    names = [n for n in series.components if n.startswith("position_x")]
    low, high = (_column(series, name) for name in names)
    moved = 1.5 * (high - high[0]) - 0.5 * (low - low[0])
    tip, at, arrival = peak_of_tip(np.asarray(series.time), moved)
    return {"tip": tip, "time": at, "arrival": arrival}


def buoyancy(made: Made, p: Parameters) -> Values:
    """Cubes under water of K 2.2e9 Pa that starts without pressure. Bonus (2023) 6.8."""
    case = cases.case("buoyancy")
    full = case.parameters("full", p)
    scene = _unpressed(case.build(full, cases.Options()))
    cubes = {float(b.name[5:]): b.name for b in scene.bodies if b.name.startswith("cube-")}
    for name in cubes.values():
        scene.add_sensor(name=name, sensor=_centre_of(name, 0.1))
    sim = made(scene)
    sim.run(until=p["until"], progress=False)
    time = np.asarray(sim.sensors["cube-750"].time)
    place = {k: _column(sim.sensors[name], "centroid_y") - 0.2 for k, name in cubes.items()}
    return dict(away_from_models(time, place))


RUNS: dict[str, Callable[[Made, Parameters], Values]] = {
    "V13": block_in_water,
    "bridges": bridge,
    "dominoes": dominoes,
    "sloshing": sloshing,
    "elastic-column": elastic_column,
    "buoyancy": buoyancy,
}
