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
from libmpm import boundaries, cases, design, materials, sensors, shapes
from libmpm.methods import FBar, Kernel, Method, Smoothing, Transfer

Values = dict[str, float]
Made = Callable[[libmpm.Scene], libmpm.Simulation]
Parameters = Mapping[str, Any]

HIGH, DECK, ALONG, FACE = 3.0, 1.0, 5.0, 16.0  # m: block, deck, deck along the flow, its face
MIDDLE = (0.3, 0.7)  # of the pulse, as in the case "block-impact"


def block_in_water(made: Made, p: Parameters) -> Values:
    """V13: plateau of the deck's load over formula (6.10). Yang (2016) 6.2.4.

    The deck's soffit is one cell of 0.5 m above still water whatever the block floats like.
    """
    dx, depth, v = p["cell_size"], p["depth"], p["velocity"]
    density, length = p["density"], p["length"]
    low = depth - HIGH * density / 1000.0
    block = shapes.Box(lower=(FACE - length, low), upper=(FACE, low + HIGH))
    soffit = depth + p.get("clearance", 0.5)
    deck = shapes.Box(lower=(FACE, soffit), upper=(FACE + ALONG, soffit + DECK))
    linear = p.get("kernel", "linear") == "linear"
    made_of = libmpm.Scene(
        dimension=2,
        cell_size=dx,
        lower=(0.0, 0.0),
        upper=(2 * FACE, math.ceil((depth + 2 * HIGH) / dx) * dx),
        gravity=(0.0, -9.81),
        method=Method(
            transfer="FLIP",
            cfl=p.get("cfl", 0.1),
            kernel=Kernel(name="linear", modified=True) if linear else "quadratic",
        ),
    )
    made_of.add_body(
        name="flow",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(2 * FACE, depth)),
        material=materials.TaitFluid(
            density=1000.0, bulk_modulus=p["bulk_modulus"], viscosity=1e-3
        ),
        particles_per_cell=9,
        hydrostatic=depth,
        velocity=(v, 0.0),
        fbar=None,
        smoothing=Smoothing(method="F0AL1"),
    )
    made_of.add_body(
        name="block",
        shape=block,
        material=materials.FixedCorotated(
            density=density, youngs_modulus=p["youngs_modulus"], poissons_ratio=p["poissons_ratio"]
        ),
        particles_per_cell=9,
        velocity=(v, 0.0),
        subtract_from=("flow",),
    )
    made_of.add_boundary(name="deck", shape=deck, response=boundaries.Slip())
    bed = shapes.DomainWalls(faces=("y-",))
    made_of.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
    made_of.add_sensor(name="deck", sensor=sensors.LoadCell(boundary="deck", interval=0))
    inlet = boundaries.Inflow(body="flow", face="x-", velocity=v, level=depth)
    made_of.add_flow(name="inlet", flow=inlet)
    made_of.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=v))
    modulus = float(
        design.plane_strain_modulus(
            youngs_modulus=p["youngs_modulus"], poissons_ratio=p["poissons_ratio"]
        )
    )
    pulse = 2 * length / math.sqrt(modulus / density)
    sim = made(made_of)
    sim.run(until=pulse, progress=False)
    series = sim.sensors["deck"]
    step = np.diff(series.time, prepend=0.0)
    inside = (series.time > MIDDLE[0] * pulse) & (series.time < MIDDLE[1] * pulse)
    plateau = float(series.values[inside, 0] @ step[inside] / step[inside].sum())
    top = min(soffit + DECK, low + HIGH)
    contact = top - max(soffit, low)
    off = 0.5 * (top + max(soffit, low)) - (low + 0.5 * HIGH)
    height = design.spread_height(contact=contact, height=HIGH, length=length, eccentricity=off)
    formula = design.block_force_partial(
        velocity=v, effective_area=height, density=density, modulus=modulus
    )
    return {"ratio": plateau / float(formula), "contact": contact, "plateau": plateau}


def bridge(made: Made, p: Parameters) -> Values:
    """V7 to V9: decks in bores and blocks that dam, with linear functions. Yang (2016) 5.2, 6.1.

    The source modifies its functions near the nodes (A.4, A.5), which only the CPU has; the plain
    ones end within 200 steps.
    """
    model = MODELS[p["model"]]
    block = p.get("block")
    sim = made(flume(model, p["method"], p["bulk_modulus"], block, linear=True))
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
    full = case.parameters("full", p)
    method = Method(cfl=0.3, transfer=Transfer(scheme="AFLIP", flip=0.25))
    fbar = FBar(form="two-volume", ratio=0.25)
    scene = case.build(full, cases.Options(method=method, fbar=fbar))
    sim = made(_unpressed(scene))
    return dict(case.measure(sim, full))


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
    options = cases.Options(fbar=None, solid_fbar=None)
    return dict(case.measure(made(case.build(full, options)), full))


def buoyancy(made: Made, p: Parameters) -> Values:
    """Cubes under water of K 2.2e9 Pa that starts without pressure. Bonus (2023) 6.8."""
    case = cases.case("buoyancy")
    full = case.parameters("full", p)
    scene = case.build(full, cases.Options())
    return dict(case.measure(made(_unpressed(scene)), full))


RUNS: dict[str, Callable[[Made, Parameters], Values]] = {
    "V13": block_in_water,
    "bridges": bridge,
    "dominoes": dominoes,
    "sloshing": sloshing,
    "elastic-column": elastic_column,
    "buoyancy": buoyancy,
}
