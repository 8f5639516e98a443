"""Reference cases of wave makers: a piston, a gate, a pump, and water at rest above a slope.

Scenes are planes x, y with gravity along -y, in SI units, per metre of thickness. Levels come from
the mass that stands in columns, not from the highest particle.
Reduced level on one core: piston 6 s, gate 9 s, pump 6 s, slope 4 s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import Slab, advance, fluid_fbar, method_of
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.flows import Inflow, Outflow
from libmpm._src.boundaries.responses import Displacement, Mirror, Prescribed, Separable, Slip
from libmpm._src.boundaries.wave_makers import piston_stroke
from libmpm._src.materials.generated import TaitFluid
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.basin import basin
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.particle_placement import Columns
from libmpm._src.shapes.primitives import HalfSpace

__all__ = ["CASES"]

Parameters = Mapping[str, Any]
Floats = npt.NDArray[np.float64]

_WATER, _GRAVITY = 1000.0, 9.81  # kg/m³, m/s²


def _water(p: Parameters, depth: float) -> TaitFluid:
    """Return water whose sound is `sound` times as fast as the long wave √(g depth)."""
    modulus = _WATER * p["sound"] ** 2 * _GRAVITY * depth
    return TaitFluid(density=_WATER, bulk_modulus=modulus)


def _depths(sim: Simulation, places: Floats) -> Floats:
    """Return the depth of the water at equally spaced places, m.

    A particle counts for the two places beside it, by its nearness: columns of particles that stand
    a few to a place, as in a lattice, would otherwise come and go with their whole mass.
    """
    water = sim.particles["water"]
    width = places[1] - places[0]
    at = (water["position"][:, 0].astype(np.float64) - places[0]) / width + 1.0
    left = np.floor(np.clip(at, 0.0, len(places))).astype(np.int64)
    share = np.clip(at - left, 0.0, 1.0)
    mass, count = water["mass"], len(places) + 2
    total = np.bincount(left, mass * (1.0 - share), count)
    total += np.bincount(left + 1, mass * share, count)
    return np.asarray(total[1:-1] / (_WATER * width))


# ---- piston -------------------------------------------------------------------------------------

_STILL = 2.0  # m, of water in the flume
_STROKE, _RATE, _DELAY = 4.0, 0.2, 9.9303  # m, 1/s, s
_FASTEST = _STROKE * _RATE / math.sqrt(math.pi)  # m/s, of the piston
_CREST = (math.sqrt(_GRAVITY * _STILL) + _FASTEST / 2) ** 2 / _GRAVITY - _STILL
_SPEED = math.sqrt(_GRAVITY * _STILL) + 1.5 * _FASTEST


def _piston(p: Parameters, options: Options) -> Scene:
    """A flume 2 m deep with a piston at x = 0 and a mirrored wall at the other end."""
    dx = p["cell_size"]
    slab = Slab(dx)
    method = method_of(options, 0.4)
    scene = slab.scene("piston-flume", (-dx, 0.0), (p["length"], 3.0), _GRAVITY, method)
    scene.add_body(
        name="water",
        shape=slab.box((0.0, 0.0), (p["length"], _STILL)),
        material=_water(p, _STILL),
        fbar=fluid_fbar(options),
        hydrostatic=_STILL,
    )
    stroke = piston_stroke(_STROKE, _RATE, _DELAY, until=p["until"])
    begun = float(stroke.at(0.0)[0])  # so far the stroke has come at time 0
    scene.add_boundary(
        name="piston",
        shape=slab.box((-_STROKE - 1.0, -1.0), (-begun, 4.0)),
        response=Slip(cell="held"),
        motion=Displacement(stroke),
    )
    scene.add_boundary(name="flume", shape=DomainWalls(faces=("x+", "y-")), response=Mirror())
    return scene


def _read_piston(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Height, m, and speed, m/s, of the crest between two places of the flume.

    The surface at every metre, less what it is at rest; the crest of a polynomial of
    fourth degree through what is within `around` of where the simple wave has it. The height is the
    mean over the way, the speed the slope of the crest's places.
    """
    x = np.arange(1.0, p["length"])
    rest = _depths(sim, x)
    begin, end = p["between"]
    # The crest leaves the piston, half-way through its stroke, when that is fastest.
    times = _DELAY + (np.linspace(begin, end, 41) - _STROKE / 2) / _SPEED
    places, heights = [], []
    for now in advance(sim, times):
        piston = _STROKE / 2 * (1 + math.erf(_RATE * (now - _DELAY)))
        middle = _STROKE / 2 + _SPEED * (now - _DELAY)
        near = (np.abs(x - middle) < p["around"]) & (x > piston + 1.0)
        rise = _depths(sim, x)[near] - rest[near]
        fit = np.polynomial.Polynomial.fit(x[near] - middle, rise, 4)
        fine = np.linspace(x[near][0], x[near][-1], 2001) - middle
        best = int(np.argmax(fit(fine)))
        places.append(middle + float(fine[best]))
        heights.append(float(fit(fine[best])))
    return {
        "crest": float(np.mean(heights)),
        "speed": float(np.polyfit(times, places, 1)[0]),
        "crest_first": heights[0],
        "crest_last": heights[-1],
        "place_last": places[-1],
    }


_SIMPLE = "simple wave of the piston's fastest motion u"
_PISTON_BOUNDS = {
    "crest": Bound(0.95 * _CREST, 1.05 * _CREST, "m", f"{_SIMPLE}: (√(gh) + u/2)²/g - h"),
    "speed": Bound(0.98 * _SPEED, 1.02 * _SPEED, "m/s", f"{_SIMPLE}: √(gh) + 3u/2"),
}
_FLUME: dict[str, Any] = {
    "length": 72.0,  # m; what the far wall sends back is not there in time
    "until": 20.0,
    "between": (20.0, 50.0),
    "around": 10.0,
}

# "full" is 2880 x 80 cells of 4 particles, 9.2e5, and 1.3e5 steps: 1.2e11 particle-steps.
_PISTON = Case(
    name="piston-flume",
    title="Error-function stroke in 2 m of water: height and speed of the crest",
    source="Bonus (2023), 7.3",
    levels={
        "reduced": {"cell_size": 0.25, "sound": 10.0} | _FLUME,
        "full": {"cell_size": 0.025, "sound": 15.0} | _FLUME,
    },
    bounds={"reduced": _PISTON_BOUNDS, "full": _PISTON_BOUNDS},
    build=_piston,
    measure=_read_piston,
)


# ---- gate ---------------------------------------------------------------------------------------


def _gate(p: Parameters, options: Options) -> Scene:
    """Water 1 m deep behind a gate at x = 0 that is gone at time `held`, in √(H/g)."""
    dx = 1.0 / p["cells"]
    slab = Slab(dx)
    method = method_of(options, 0.4)
    low, high = (-p["reservoir"], 0.0), (p["flat"], 1.2)
    scene = slab.scene("ritter", low, high, _GRAVITY, method)
    scene.add_body(
        name="water",
        shape=slab.box((low[0], 0.0), (0.0, 1.0)),
        material=_water(p, 1.0),
        fbar=fluid_fbar(options),
        hydrostatic=1.0,
    )
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Separable(cell="held"))
    if p["held"] > 0:
        scene.add_boundary(
            name="gate",
            shape=slab.box((0.0, 0.0), (4 * dx, high[1])),
            response=Slip(cell="held"),
            time=(0.0, p["held"] / math.sqrt(_GRAVITY)),
        )
    return scene


def _read_gate(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Profile and depth at the gate at T = t √(g/H), in parts of H and √(gH); H = 1 m.

    Ritter (1892), with s = x / (t √(gH)): h/H = (2 - s)²/9 from -1 to 2, h = 4/9 H and
    q = (8/27) H √(gH) at the gate. The tip is that of the tenth particle from the front.
    """
    dx, c = 1.0 / p["cells"], math.sqrt(_GRAVITY)
    x = np.arange(round(-p["reservoir"] / dx) + 1, round(p["flat"] / dx)) * dx
    middle = np.abs(x) < 4.5 * dx
    values: dict[str, float] = {}
    passed: list[float] = []
    for now in advance(sim, (p["held"] + np.array([2.5, 5.0])) / c):
        way = now * c - p["held"]
        depth = _depths(sim, x)
        water = sim.particles["water"]
        passed.append(float(water["mass"][water["position"][:, 0] > 0].sum()) / _WATER)
        if len(passed) == 1:
            s = x / way
            within = (s > -1) & (s < 1.5)
            off = (depth - (2 - s) ** 2 / 9)[within]
            thin = int(np.flatnonzero(depth > 0.05)[-1])
            ends = slice(thin, thin + 2)
            edge = np.interp(-0.05, -depth[ends], x[ends])
            values["profile"] = float(np.sqrt(np.mean(off**2)))
            values["gate_early"] = float(np.mean(depth[middle]))
            values["edge"] = float(edge) / way
            values["tip"] = float(np.sort(water["position"][:, 0])[-10]) / way
    return values | {
        "gate": float(np.mean(depth[middle])),
        "outflow": (passed[1] - passed[0]) / 2.5,
    }


_RITTER = "Ritter (1892), dry bed without friction"
_EDGE = 2 - 3 * math.sqrt(0.05)
# At T = 2.5 the water near the gate still falls: the equations of Serre, Green and Naghdi, which
# have what shallow water leaves out to first order, give 0.498 there (0.466 at 5), Ritter 0.444.
_SERRE = 0.4983
_GATE_BOUNDS = {
    "profile": Bound(0.0, 0.06, "H", f"{_RITTER}; rms over -1 < x/(t√(gH)) < 1.5 at T = 2.5"),
    "edge": Bound(0.94 * _EDGE, 1.06 * _EDGE, "t√(gH)", f"{_RITTER}; h = 0.05 H at T = 2.5"),
    "gate_early": Bound(4 / 9, _SERRE, "H", "Ritter's and Serre's depth at T = 2.5"),
    "gate": Bound(0.95 * 4 / 9, 1.05 * 4 / 9, "H", f"{_RITTER}; 4/9, at T = 5"),
    "outflow": Bound(0.95 * 8 / 27, 1.05 * 8 / 27, "H√(gH)", f"{_RITTER}; 8/27, T = 2.5 to 5"),
}

# "full" is 5.6e5 particles and 3.2e4 steps: 1.8e10 particle-steps.
_GATE = Case(
    name="ritter",
    title="Dam-break gate on a dry bed: profile, depth and discharge at the gate",
    source="Ritter (1892); Castro-Orgaz and Chanson (2017) on the first stage",
    levels={
        "reduced": {"cells": 40, "reservoir": 5.5, "flat": 10.5, "sound": 10.0, "held": 0.25},
        "full": {"cells": 160, "reservoir": 5.5, "flat": 10.5, "sound": 15.0, "held": 0.25},
    },
    bounds={"reduced": _GATE_BOUNDS, "full": _GATE_BOUNDS},
    build=_gate,
    measure=_read_gate,
)


# ---- pump ---------------------------------------------------------------------------------------

_CURRENT = 0.5  # m/s


def _pump(p: Parameters, options: Options) -> Scene:
    """A flume 0.2 m deep with a current that a pump keeps up, fed and drained at its ends.

    It runs from the start: between ends of given velocity the waves of a current that begins go to
    and fro for longer than the case lasts.
    """
    depth, length = 0.2, p["length"]
    dx = depth / p["cells"]
    slab = Slab(dx)
    scene = slab.scene("pump-flume", (0.0, 0.0), (length, 0.4), _GRAVITY, method_of(options, 0.4))
    scene.add_body(
        name="water",
        shape=slab.box((0.0, 0.0), (length, depth)),
        material=_water(p, depth),
        fbar=fluid_fbar(options),
        hydrostatic=depth,
        velocity=(_CURRENT, 0.0),
    )
    scene.add_boundary(
        name="pump",
        shape=slab.box((0.0, 0.0), (p["pump"], 0.4)),
        response=Prescribed(components=("x",)),
        motion=TimeTable((0.0,), ((_CURRENT, 0.0),)),
    )
    scene.add_boundary(name="bed", shape=DomainWalls(faces=("y-",)), response=Slip(cell="held"))
    inlet = Inflow(body="water", face="x-", velocity=_CURRENT, level=depth)
    scene.add_flow(name="feed", flow=inlet)
    scene.add_flow(name="drain", flow=Outflow(face="x+", velocity=_CURRENT))
    return scene


def _read_pump(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Level and mean velocity between pump and drain, means over the last seconds.

    Levels in cells off the still one: the mean, and the column that is furthest off. Velocities in
    parts of the pump's: `pump` is how far a particle in it is off, `shear` the range of the layers'
    means.
    """
    depth, length = 0.2, p["length"]
    dx = depth / p["cells"]
    begin, end = p["pump"] + 2 * depth, length - 2 * depth
    places = np.linspace(begin, end, round((end - begin) / depth) + 1)
    levels, speeds, layers, missed = [], [], [], 0.0
    for _ in advance(sim, p["until"] + np.linspace(-4.0, 0.0, 41)):
        levels.append(_depths(sim, places))
        water = sim.particles["water"]
        x, v = water["position"], water["velocity"][:, 0]
        inner = (x[:, 0] > begin) & (x[:, 0] < end)
        speeds.append(float(np.mean(v[inner])))
        led = (x[:, 0] > 2 * dx) & (x[:, 0] < p["pump"] - 2 * dx)
        missed = max(missed, float(np.abs(v[led] / _CURRENT - 1).max()))
        layer = np.clip((x[inner, 1] / depth * 5).astype(int), 0, 4)
        layers.append(np.bincount(layer, weights=v[inner], minlength=5) / np.bincount(layer))
    off = np.mean(levels, axis=0) - depth
    return {
        "level": float(np.mean(off)) / dx,
        "level_furthest": float(off[np.argmax(np.abs(off))]) / dx,
        "velocity": float(np.mean(speeds)) / _CURRENT,
        "unsteady": float(np.std(speeds)) / _CURRENT,
        "pump": missed,
        "shear": float(np.ptp(np.mean(layers, axis=0))) / _CURRENT,
    }


_PUMP_BOUNDS = {
    "level": Bound(-0.5, 0.5, "Δx", "what is fed is drained"),
    "level_furthest": Bound(-0.5, 0.5, "Δx", "uniform flow without friction is level"),
    "velocity": Bound(0.98, 1.02, "of the pump's", "continuity"),
    "unsteady": Bound(0.0, 0.02, "of the pump's", "steady flow"),
    "pump": Bound(0.0, 0.001, "of the pump's", "the velocity of its nodes is prescribed"),
}

# "full" is 2.5e5 particles and 2.7e5 steps: 6.6e10 particle-steps.
_PUMP = Case(
    name="pump-current",
    title="Steady current of a pump in a flume fed and drained at its ends: level and velocity",
    source="continuity; a pump-driven flume as in Bonus (2023), 9.3",
    levels={
        "reduced": {"cells": 8, "length": 4.0, "pump": 0.5, "sound": 8.0, "until": 16.0},
        "full": {"cells": 32, "length": 12.0, "pump": 2.0, "sound": 12.0, "until": 40.0},
    },
    bounds={"reduced": _PUMP_BOUNDS, "full": _PUMP_BOUNDS},
    build=_pump,
    measure=_read_pump,
)


# ---- slope --------------------------------------------------------------------------------------


def _slope(p: Parameters, options: Options) -> Scene:
    """Water 1 m deep that ends above a plane bed rising to the left."""
    dx, angle = 1.0 / p["cells"], math.radians(p["angle"])
    slab = Slab(dx)
    length = math.ceil((1.0 / math.tan(angle) + 4 * dx) / dx) * dx
    top = math.ceil(1.5 / dx) * dx
    method = method_of(options, 0.4)
    scene = slab.scene("slope-basin", (0.0, 0.0), (length, top), _GRAVITY, method)
    bed = HalfSpace(point=(length, 0.0), normal=(math.sin(angle), math.cos(angle)))
    # The box begins below the bed, whose foot is in its corner.
    room = Box(lower=(0.0, -1.0), upper=(length, top))
    scene.add_body(
        name="water",
        shape=basin(level=1.0, bed=bed, within=room),
        material=_water(p, 1.0),
        fbar=fluid_fbar(options),
        hydrostatic=1.0,
        sampling=Columns(),
    )
    scene.add_boundary(name="bed", shape=bed, response=Slip(cell="held"), layer=options.layer)
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip(cell="held"))
    return scene


def _read_slope(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Level in cells off the still one, speeds in parts of √(gH).

    The level is the highest particle of each column of cells, and half a spacing, where the water
    is eight cells deep or more; speeds are rms over nodes by mass, the largest of the last half.
    The current is the way of the water in layers a quarter of the depth thick, all through the run.
    """
    dx, c = 1.0 / p["cells"], math.sqrt(_GRAVITY)
    rise = math.tan(math.radians(p["angle"]))
    water = sim.particles["water"]
    start = water["position"]
    speeds = []
    for _ in advance(sim, p["until"] * np.linspace(0.5, 1.0, 21)):
        v, m = sim.grid["velocity"], sim.grid["mass"]
        speeds.append(math.sqrt(float(np.average(np.sum(v**2, axis=1), weights=m))))
    place = water["position"]
    length = sim.scene.upper[0]
    deep = [k for k in range(round(length / dx)) if (length - k * dx) * rise < 1 - 8 * dx]
    column = np.floor(place[:, 0] / dx).astype(int)
    levels = np.array([place[column == k, 1].max() + dx / 4 - 1.0 for k in deep]) / dx
    layer = np.clip((start[:, 1] * 4).astype(int), 0, 3)
    moved = np.bincount(layer, weights=place[:, 0] - start[:, 0]) / np.bincount(layer)
    return {
        "level_low": float(levels.min()),
        "level_high": float(levels.max()),
        "speed": max(speeds) / c,
        "current": float(np.abs(moved).max()) / (p["until"] * c),
        "drift": float(abs(np.mean(place[:, 0] - start[:, 0]))) / (p["until"] * c),
    }


_SLOPE_BOUNDS = {
    "level_low": Bound(-0.5, 0.5, "Δx", "water at rest"),
    "level_high": Bound(-0.5, 0.5, "Δx", "water at rest"),
    "speed": Bound(0.0, 0.01, "√(gH)", "water at rest"),
    "current": Bound(0.0, 0.001, "√(gH)", "water at rest; a tenth of the speed that is let pass"),
}

# "full" is 4.6e4 particles and 7e4 steps: 3e9 particle-steps, so that the launches count.
_SLOPE = Case(
    name="slope-basin",
    title="Water at rest above a slope: level, speed and current after 10 s",
    source="hydrostatics",
    levels={
        "reduced": {"cells": 16, "angle": 10.0, "sound": 14.0, "until": 10.0},
        "full": {"cells": 64, "angle": 10.0, "sound": 14.0, "until": 10.0},
    },
    bounds={"reduced": _SLOPE_BOUNDS, "full": _SLOPE_BOUNDS},
    build=_slope,
    measure=_read_slope,
)

CASES: tuple[Case, ...] = (_PISTON, _GATE, _PUMP, _SLOPE)
