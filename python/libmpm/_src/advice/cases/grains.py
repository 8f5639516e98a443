"""Reference cases of grains: the collapse of a dry column of sand, and of a stack of soft discs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import Slab, advance, method_of, solid_choices
from libmpm._src.boundaries.responses import Separable, Sticky
from libmpm._src.materials.generated import DruckerPrager, FixedCorotated
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import DomainWalls

__all__ = ["CASES", "height_of", "runout"]

Parameters = Mapping[str, Any]
Floats = npt.NDArray[np.float64]

_GRAVITY = 9.81  # m/s²

# ---- column of sand -----------------------------------------------------------------------------

#: Density, kg/m³, and the column's width L0, m; the result depends on neither.
_SAND, _WIDTH = 1600.0, 0.1


def runout(aspect: float) -> float:
    """Return (L∞ - L0) / L0 of a dry column of height a L0 in plane strain.

    1.2 a for a ≤ 1.8 and 1.9 a^(2/3) for a ≥ 2.8 (Lube, Huppert, Sparks and Freundt 2005, for sand,
    sugar and rice alike; Lajeunesse, Monnier and Homsy 2005 found the same for glass beads).
    Between them, where the experiments change over, a straight line.
    """
    low, high = 1.8, 2.8
    if aspect <= low:
        return 1.2 * aspect
    if aspect >= high:
        return float(1.9 * aspect ** (2 / 3))
    share = (aspect - low) / (high - low)
    return (1 - share) * 1.2 * low + share * float(1.9 * high ** (2 / 3))


def height_of(aspect: float, source: str = "Lajeunesse") -> float:
    """Return H∞ / L0 of the same deposit: the column's own for small a, then a power of it.

    Lajeunesse et al. (2005): a^(1/3) from a = 0.7 on, with a jump there; Lube et al. (2005):
    1.1 a^(2/5) from a = 1.15 on. They part by 15 % at a = 2 and by a quarter at 7.
    """
    if source == "Lube":
        return aspect if aspect < 1.15 else float(1.1 * aspect**0.4)
    return aspect if aspect <= 0.7 else float(aspect ** (1 / 3))


def _column(p: Parameters, options: Options) -> Scene:
    """Stand a column against a smooth wall on a rough floor; it is let go at t = 0.

    Walls are `Separable`: one that material cannot come off (`Slip`) holds the sheet of sand in its
    own cell, which then stands as a tower 1.7 times as high as the heap beside it (a = 4).
    """
    height = p["aspect"] * _WIDTH
    dx = math.sqrt(_WIDTH * height) / p["cells"]
    slab = Slab(dx, p["slab"] * dx)
    # Twice the run-out, and a few cells of air over the column.
    across = math.ceil(_WIDTH * (1 + 2 * runout(p["aspect"])) / dx)
    up = math.ceil(height / dx) + 3
    upper = (across * dx, up * dx)
    method = method_of(options, 0.4, 0.95)
    scene = slab.scene("column collapse", (0.0, 0.0), upper, _GRAVITY, method)
    scene.add_body(
        name="sand",
        shape=slab.box((0.0, 0.0), (_WIDTH, height)),
        material=DruckerPrager(
            density=_SAND,
            youngs_modulus=_SAND * _GRAVITY * height / p["strain"],
            friction_angle=p["friction_angle"],
            cone="plane-strain",
        ),
        **solid_choices(options),
    )
    sides = DomainWalls(faces=slab.faces("x-", "x+"))
    scene.add_boundary(name="sides", shape=sides, response=Separable(cell="held"))
    scene.add_boundary(name="floor", shape=DomainWalls(faces=("y-",)), response=Sticky())
    return scene


def _measure_column(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Run for `duration` √(H/g) and find the heap's end and its greatest height.

    The heap ends where, going away from the wall, it first is thinner than 0.04 of the length
    √(L0 H): beyond lies what has rolled on alone. It is weighed in strips of 0.05 √(L0 H), on
    every grid the same.
    """
    height = p["aspect"] * _WIDTH
    simulation.run(until=p["duration"] * math.sqrt(height / _GRAVITY), progress=False)
    sand = simulation.particles["sand"].read(["position", "velocity"])
    x, size = sand["position"], math.sqrt(_WIDTH * height)
    strip, layer = 0.05 * size, 0.04 * size
    row = np.floor(x[:, 0] / strip).astype(int)
    count = np.bincount(row)
    thickness = np.append(count, 0) / len(x) * _WIDTH * height / strip
    k = int(np.argmax(thickness < layer))
    # Between the middles of the last strip that holds more and the first that does not.
    share = (thickness[k - 1] - layer) / (thickness[k - 1] - thickness[k])
    found = (float(k - 0.5 + share) * strip - _WIDTH) / _WIDTH
    # The highest place of the deposit: the sheet at the wall may be lower.
    top = max(float(np.quantile(x[row == i, 1], 0.99)) for i in range(len(count)) if count[i] > 20)
    speed = np.linalg.norm(sand["velocity"], axis=1).mean()
    return {
        "runout": found,
        "runout_ratio": found / runout(p["aspect"]),
        "runout_99_ratio": (np.quantile(x[:, 0], 0.99) - _WIDTH) / _WIDTH / runout(p["aspect"]),
        "height": top / _WIDTH,
        "height_ratio": top / _WIDTH / height_of(p["aspect"]),
        "height_lube_ratio": top / _WIDTH / height_of(p["aspect"], "Lube"),
        "speed": speed / math.sqrt(_GRAVITY * height),
    }


_RUNOUT = {
    "runout_ratio": Bound(0.85, 1.15, "1", "Lube et al. (2005), ±15 %"),
    "speed": Bound(0.0, 0.01, "√(gH)", "the heap is at rest"),
}

_HEIGHT = {
    # Held up to a = 4; benchmarks/column_collapse.py has the others and what they hang on.
    "height_ratio": Bound(0.9, 1.1, "1", "Lajeunesse et al. (2005), ±10 %"),
}

_COLUMN = Case(
    name="column-collapse",
    title="Run-out of a dry granular column in plane strain",
    source="Lube, Huppert, Sparks and Freundt (2005), Physical Review E 72, 041301",
    # `aspect` a = H/L0; `cells` in √(L0 H); `friction_angle` that acts in plane strain, degrees:
    # 1.12 times (Kulhawy and Mayne 1990) the 31° of loose sand in triaxial compression. `strain` is
    # ρ g H / E; `duration` in √(H/g), longer than the flow lasts (3.3).
    levels={
        # 6,400 particles, 1.3e4 steps, 8.3e7 particle-steps at a = 1, √a times as many at others:
        # 8 s at a = 1.
        "reduced": {
            "aspect": 1.0, "cells": 40, "slab": 0, "friction_angle": 34.7, "strain": 2e-3,
            "duration": 5.0,
        },
        # 64 x 64 x 16 cells, 5.2e5 particles, 2.1e4 √a steps: 1.1e10 particle-steps at a = 1.
        "full": {
            "aspect": 1.0, "cells": 64, "slab": 16, "friction_angle": 34.7, "strain": 2e-3,
            "duration": 5.0,
        },
    },
    bounds={"reduced": _RUNOUT | _HEIGHT, "full": _RUNOUT},
    build=_column,
    measure=_measure_column,
)  # fmt: skip

# ---- soft discs ---------------------------------------------------------------------------------

_DISC_DENSITY = 1000.0
#: Part of the run while the stack falls freely and bears nothing.
_FALL = 0.3


def _strips(across: int) -> list[tuple[int, float]]:
    """Return the strips, two cells high, of a disc `across` cells wide: lower end, half width."""
    radius = across / 2
    middle = [2 * k + 1 - radius for k in range(across // 2)]
    half = [round(2 * math.sqrt(radius**2 - y * y)) / 2 for y in middle]
    return list(zip(range(0, across, 2), half, strict=True))


def _names(p: Parameters) -> list[list[str]]:
    """Return the bodies that each disc is made of."""
    strips = [low for low, _ in _strips(p["across"])]
    discs = [(i, j) for j in range(p["rows"]) for i in range(p["columns"])]
    return [[f"disc-{i}-{j}-{low}" for low in strips] for i, j in discs]


def _discs(p: Parameters, options: Options) -> Scene:
    """Stack discs in columns at one side of a rigid tank of twice their width.

    A disc is built of strips two cells high; bodies that are alike are stepped as one. Between
    discs are 1.5 cells, or neighbours would stick from the start.
    """
    radius = p["radius"]
    dx = 2 * radius / p["across"]
    pitch = 2 * radius + 1.5 * dx
    upper = (
        math.ceil(2 * p["columns"] * pitch / dx) * dx,
        (math.ceil(p["rows"] * pitch / dx) + 4) * dx,
    )
    slab = Slab(dx)
    scene = slab.scene("discs", (0.0, 0.0), upper, _GRAVITY, method_of(options, p["cfl"]))
    rubber = FixedCorotated(density=_DISC_DENSITY, youngs_modulus=1e5, poissons_ratio=0.3)
    names = iter(_names(p))
    for j in range(p["rows"]):
        for i in range(p["columns"]):
            x, y = 0.75 * dx + radius + i * pitch, j * pitch
            for name, (low, half) in zip(next(names), _strips(p["across"]), strict=True):
                bottom = y + low * dx
                scene.add_body(
                    name=name,
                    shape=slab.box((x - half * dx, bottom), (x + half * dx, bottom + 2 * dx)),
                    material=rubber,
                    lattice=(round(4 * half), 4),
                    **solid_choices(options),
                )
    tank = DomainWalls(faces=("x-", "x+", "y-"))
    scene.add_boundary(name="tank", shape=tank, response=Separable(cell="held"))
    scene.add_sensor(name="tank", sensor=LoadCell(boundary="tank"))
    return scene


def _depths(discs: Sequence[Floats], cell_size: float) -> Floats:
    """Return how far each two discs reach into each other, m (n, n), from their convex hulls.

    The depth is the least over 36 directions; particles stand for half their spacing around them.
    """
    angle = np.linspace(0, np.pi, 36, endpoint=False)
    normal = np.stack([np.cos(angle), np.sin(angle)])
    places = [x @ normal for x in discs]
    low = np.array([s.min(axis=0) for s in places])
    high = np.array([s.max(axis=0) for s in places])
    depth = np.full((len(discs), len(discs)), -np.inf)
    for i in range(len(discs)):
        both = np.minimum(high[i] - low, high - low[i]).min(axis=1) + cell_size / 2
        depth[i] = np.where(np.arange(len(discs)) == i, -np.inf, both)
    return depth


def _chain(
    discs: Sequence[Floats], pressure: Floats, depth: Floats, radius: float, cell_size: float
) -> float:
    """Return how high the highest chain reaches that stands on the floor, parts of the heap.

    Links are discs that touch (nearer than a cell) and bear more than the mean of the discs around
    their own height: the mean of all is exceeded nowhere near the top, where the weight above ends.
    """
    y = np.array([x[:, 1].mean() for x in discs])
    level = [pressure[np.abs(y - h) < radius].mean() for h in y]
    strong = pressure >= level
    touch = (depth > -cell_size) & strong[:, None] & strong
    held = strong & (y < 1.6 * radius)
    while True:
        more = held | touch[held].any(axis=0)
        if (more == held).all():
            break
        held = more
    return float((y[held].max() if held.any() else 0.0) / y.max())


def _measure_discs(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Follow the collapse; the chain's reach is the median over frames once the stack has fallen.

    Momentum is compared with that of weight and walls, in parts of the whole weight times the time
    of a fall over the stack.
    """
    names, dx = _names(p), simulation.scene.cell_size
    first = [simulation.particles[name].read(["mass"])["mass"] for n in names for name in n]
    total, each = sum(len(m) for m in first), float(first[0][0])
    mass = total * each
    scale = mass * math.sqrt(_GRAVITY * p["rows"] * 2 * p["radius"])
    overlap, error, chains, inside = -math.inf, 0.0, [], 1.0
    for time in advance(simulation, np.linspace(0, p["duration"], p["frames"] + 1)[1:]):
        wanted = ["position", "velocity", "pressure"]
        read = [[simulation.particles[name].read(wanted) for name in n] for n in names]
        discs = [np.concatenate([r["position"] for r in n]) for n in read]
        pressure = np.array([np.concatenate([r["pressure"] for r in n]).mean() for n in read])
        velocity = np.concatenate([r["velocity"] for n in read for r in n])
        inside = min(inside, len(velocity) / total)
        depth = _depths(discs, dx)
        overlap = max(overlap, float(depth.max()))
        series = simulation.sensors["tank"]
        length = np.diff(np.asarray(series.time), prepend=0.0)
        pushed = (np.asarray(series.values)[:, :2] * length[:, None]).sum(axis=0)
        expected = np.array([0.0, -mass * _GRAVITY * time]) - pushed
        momentum = velocity.sum(axis=0) * each
        error = max(error, float(np.abs(momentum - expected).max()) / scale)
        if time > _FALL * p["duration"]:
            chains.append(_chain(discs, pressure, depth, p["radius"], dx))
    return {
        "kept": inside,
        "momentum_error": error,
        "overlap": overlap / dx,
        "chain_reach": float(np.median(chains)),
        "chain_share": float(np.mean(np.array(chains) > 0.95)),
    }


_DISC_BOUNDS = {
    "kept": Bound(1.0, 1.0, "1", "no particle escapes"),
    # Velocities are those before the impulse of the last step: g dt is 1e-3 of the scale.
    "momentum_error": Bound(0.0, 5e-3, "M √(gH)", "conservation, within a step's impulse"),
    "overlap": Bound(-math.inf, 2.0, "cells", "no interpenetration"),
    "chain_reach": Bound(0.9, 1.0, "1", "a chain from the floor to the top layer"),
}

_DISCS = Case(
    name="discs",
    title="Collapse of a stack of soft discs in a rigid tank; chains of pressure",
    source="Bonus (2023), 6.10",
    levels={
        # 14,976 particles, 7,600 steps, 1.1e8 particle-steps: 15 s.
        "reduced": {
            "columns": 6, "rows": 12, "across": 8, "radius": 0.02, "cfl": 0.4, "duration": 1.3,
            "frames": 10,
        },
        # 648 discs of about 1,000 particles, 6.6e5, 1.0e5 steps: 6.8e10 particle-steps. Thirty-six
        # rows of a third of the radius bear what twelve do at the reduced level: ρgH/E = 0.047. At
        # three times that (radius 0.02 m) contacts crush particles to 0.06 of their volume and
        # stretch others to 2.4, and at a CFL of 0.4 nearly empty nodes beside them cross a cell in
        # a step. The law stiffens when it is stretched, not when it is pressed: a particle alone,
        # stable up to a CFL of 0.84 at rest, is so up to a stretch of 2.4 at 0.4 and of 4.9 at 0.2.
        "full": {
            "columns": 18, "rows": 36, "across": 18, "radius": 0.02 / 3, "cfl": 0.2,
            "duration": 1.3, "frames": 6,
        },
    },
    bounds={"reduced": _DISC_BOUNDS, "full": _DISC_BOUNDS},
    build=_discs,
    measure=_measure_discs,
)  # fmt: skip

CASES: tuple[Case, ...] = (_COLUMN, _DISCS)
