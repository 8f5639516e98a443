"""Reference cases of dominoes: one that tips over, one that hits another, and a row of 24.

Dominoes of Bonus (2023), 6.9: 6 mm thick, 48 mm high, 24 mm wide and 30 mm apart. Angles are from
upright, positive towards +x, the way they fall about their lower right edge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import Slab, advance, method_of, solid_choices
from libmpm._src.base.formulas import Field
from libmpm._src.boundaries.responses import Separable
from libmpm._src.materials.generated import FixedCorotated
from libmpm._src.methods.method import Method
from libmpm._src.methods.transfer import Transfer
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell, ParticleTracker
from libmpm._src.shapes.boxes import DomainWalls, OrientedBox

__all__ = ["CASES"]

Parameters = Mapping[str, Any]
Floats = npt.NDArray[np.float64]

_GRAVITY = 9.81  # m/s²
_THICK, _HIGH, _PITCH, _DENSITY = 0.006, 0.048, 0.030, 1400.0
#: Lower right edge of the first domino, m: room on its left for what slides back.
_FIRST = 0.018
#: Where the centre of gravity stands over the edge: θ_c = atan(t / h).
_CRITICAL = math.degrees(math.atan2(_THICK, _HIGH))
#: Rate of the rigid fall, 1/s²: θ'' = k sin(θ - θ_c), k = 3 g / (2 √(t² + h²)).
_RATE = 1.5 * _GRAVITY / math.hypot(_THICK, _HIGH)


def _edge(k: int) -> float:
    return _FIRST + k * _PITCH


def _empty(
    p: Parameters, options: Options, count: int, method: Method | None = None
) -> tuple[Scene, Slab]:
    """Return a scene with a floor for so many dominoes, `cells` cells to a thickness."""
    dx = _THICK / p["cells"]
    slab = Slab(dx, p["slab"] * dx)
    upper = (
        math.ceil((_edge(count - 1) + 1.25 * _HIGH) / dx) * dx,
        math.ceil(1.2 * _HIGH / dx) * dx,
    )
    own = options.method or method or method_of(options, 0.4)
    scene = slab.scene("dominoes", (0.0, 0.0), upper, _GRAVITY, own)
    rough = Separable(static_friction=p["friction"], dynamic_friction=p["friction"])
    scene.add_boundary(name="floor", shape=DomainWalls(faces=("y-",)), response=rough)
    sides = DomainWalls(faces=slab.faces("x-", "x+"))
    scene.add_boundary(name="sides", shape=sides, response=Separable(cell="held"))
    return scene, slab


def _add(
    scene: Scene, slab: Slab, k: int, angle: float, spin: float, p: Parameters, options: Options
) -> None:
    """Add domino k on its lower right edge, turned by `angle` degrees, falling at `spin` rad/s."""
    turn = math.radians(angle)
    c, s = math.cos(turn), math.sin(turn)
    x = _edge(k) + (_HIGH * s - _THICK * c) / 2
    y = (_HIGH * c + _THICK * s) / 2
    centre, size = (x, y, slab.thickness / 2), (_THICK, _HIGH, slab.thickness)
    still = ("0",) if slab.thickness else ()
    velocity = Field(components=(f"{spin} * y", f"-{spin} * (x - {_edge(k)})", *still))
    scene.add_body(
        name=f"domino-{k}",
        shape=OrientedBox(
            centre=centre[: slab.dimension], size=size[: slab.dimension], angle=-angle
        ),
        material=FixedCorotated(
            density=_DENSITY, youngs_modulus=p["youngs_modulus"], poissons_ratio=0.3
        ),
        velocity=velocity if spin else None,
        **solid_choices(options),
    )


def _plane(simulation: Simulation, k: int) -> Floats:
    """Return the particles of a domino in the plane, (n, 2) m."""
    return simulation.particles[f"domino-{k}"]["position"][:, :2]


def _ends(x: Floats) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Return which particles belong to the lower and the upper quarter of a domino."""
    middle = x - x.mean(axis=0)
    _, _, axes = np.linalg.svd(middle[:: max(1, len(x) // 4096)], full_matrices=False)
    along = middle @ (axes[0] * np.sign(axes[0, 1]))
    return along < -_HIGH / 4, along > _HIGH / 4


def _angle(x: Floats, ends: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]) -> float:
    """Return the tilt, degrees, of the line between the middles of the two quarters."""
    dx, dy = x[ends[1]].mean(axis=0) - x[ends[0]].mean(axis=0)
    return math.degrees(math.atan2(dx, dy))


def _rigid_time(start: float, end: float) -> float:
    """Return how long the rigid fall from rest at `start` takes to `end`, degrees -> s."""
    if start <= _CRITICAL:
        return math.inf
    first, last = math.radians(start - _CRITICAL), math.radians(end - _CRITICAL)
    # With θ = θ₀ + u² the integrand of dt = dθ / √(2 k (cos θ₀ - cos θ)) is smooth.
    u = (np.arange(4000) + 0.5) * math.sqrt(last - first) / 4000
    speed = np.sqrt(2 * _RATE * (math.cos(first) - np.cos(first + u**2)))
    return float((2 * u / speed).sum() * math.sqrt(last - first) / 4000)


# ---- one domino ---------------------------------------------------------------------------------


def _tip(p: Parameters, options: Options) -> Scene:
    scene, slab = _empty(p, options, 1)
    _add(scene, slab, 0, p["start"], 0.0, p, options)
    return scene


def _measure_tip(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Time until the angle `end`, and the spin there, against the rigid fall about the edge."""
    ends = _ends(_plane(simulation, 0))
    expected = _rigid_time(p["start"], p["end"])
    time, angle = [0.0], [p["start"]]
    for t in advance(simulation, np.linspace(0, min(1.5 * expected, 0.5), 151)[1:]):
        time.append(t)
        angle.append(_angle(_plane(simulation, 0), ends))
        if angle[-1] > p["end"] + 3:
            break
    if not angle[-1] > p["end"]:
        return {"time": math.inf, "time_ratio": math.inf, "spin_ratio": math.nan}
    reached = float(np.interp(p["end"], angle, time))
    spin = float(np.interp(p["end"], angle, np.gradient(np.radians(angle), time)))
    first, last = (math.radians(p[key] - _CRITICAL) for key in ("start", "end"))
    rigid = math.sqrt(2 * _RATE * (math.cos(first) - math.cos(last)))
    return {"time": reached, "time_ratio": reached / expected, "spin_ratio": spin / rigid}


_TIP_BOUNDS = {"time_ratio": Bound(0.95, 1.05, "1", "rigid fall about the edge, ±5 %")}

_TIP = Case(
    name="domino-tip",
    title="A domino falls over: time from 15 to 60 degrees",
    source="Bonus (2023), 6.9; rigid body about its edge, 149.8 ms",
    # Friction 2: the edge stays where it is, as the closed form has it.
    levels={
        # 1,152 particles, 2.1e4 steps: 2.4e7 particle-steps, 4 s.
        "reduced": {
            "cells": 6, "slab": 0, "youngs_modulus": 3e6, "friction": 2.0, "start": 15.0,
            "end": 60.0,
        },
        # The whole width of 24 mm: 4.4e5 particles, 1.1e5 steps, 5e10 particle-steps.
        "full": {
            "cells": 12, "slab": 48, "youngs_modulus": 2e7, "friction": 2.0, "start": 15.0,
            "end": 60.0,
        },
    },
    bounds={"reduced": _TIP_BOUNDS, "full": _TIP_BOUNDS},
    build=_tip,
    measure=_measure_tip,
)  # fmt: skip

# ---- two dominoes -------------------------------------------------------------------------------


def _two(p: Parameters, options: Options) -> Scene:
    """One domino at 12 degrees and 20.8 rad/s, as the push of the row leaves it; one upright."""
    scene, slab = _empty(p, options, 2)
    _add(scene, slab, 0, p["start"], p["spin"], p, options)
    _add(scene, slab, 1, 0.0, 0.0, p, options)
    for wall in ("floor", "sides"):
        scene.add_sensor(name=wall, sensor=LoadCell(boundary=wall))
    return scene


def _inside(x: Floats, centre: Floats, angle: float) -> float:
    """Return how deep the deepest of the points lies in a rigid domino, m; negative: outside."""
    turn = math.radians(angle)
    d = x - centre
    across = np.abs(d[:, 0] * math.cos(turn) - d[:, 1] * math.sin(turn))
    along = np.abs(d[:, 0] * math.sin(turn) + d[:, 1] * math.cos(turn))
    return float(np.minimum(_THICK / 2 - across, _HIGH / 2 - along).max())


def _measure_two(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Follow both through the blow until the second has fallen to 12 degrees.

    `transfer` is ω₂ / (ω₁ + ω₂) when the second first spins fastest: without friction between them
    the impulse has the same arm about both edges, so it is (1 + e) / 2, e the restitution.
    """
    bodies = [simulation.particles[f"domino-{k}"] for k in (0, 1)]
    ends = [_ends(_plane(simulation, k)) for k in (0, 1)]
    mass = [float(b["mass"].sum()) for b in bodies]
    before = sum(m * b["velocity"][:, 0].mean() for m, b in zip(mass, bodies, strict=True))
    rows, deepest, error = [], -math.inf, 0.0
    for time in advance(simulation, np.arange(1, 161) * 5e-4):
        x = [_plane(simulation, k) for k in (0, 1)]
        angle = [_angle(a, e) for a, e in zip(x, ends, strict=True)]
        centre = [a.mean(axis=0) for a in x]
        for k in (0, 1):
            deepest = max(deepest, _inside(x[1 - k], centre[k], angle[k]))
        momentum = sum(m * b["velocity"][:, 0].mean() for m, b in zip(mass, bodies, strict=True))
        error = max(error, abs(momentum - before + _pushed(simulation)) / before)
        rows.append((time, *angle))
        if angle[1] > 12.0:
            break
    found = np.array(rows)
    spin = np.gradient(np.radians(found[:, 1:]), found[:, 0], axis=0)
    hit = int(np.argmax(spin[:, 1] > 0.05 * p["spin"]))
    # The first time that it spins no faster than a sample before.
    peak = hit + int(np.argmax(np.diff(spin[hit:, 1]) < 0))
    incoming = spin[max(hit - 2, 0), 0]
    return {
        "hit_time": found[hit, 0],
        "transfer": spin[peak, 1] / spin[peak].sum(),
        "angular_momentum_ratio": spin[peak].sum() / incoming,
        "momentum_error": error,
        "overlap": deepest / simulation.scene.cell_size,
        "second_angle": found[-1, 2],
    }


def _pushed(simulation: Simulation) -> float:
    """Return the horizontal momentum that floor and sides have taken, N·s."""
    total = 0.0
    for name in ("floor", "sides"):
        series = simulation.sensors[name]
        length = np.diff(np.asarray(series.time), prepend=0.0)
        total += float((np.asarray(series.values)[:, 0] * length).sum())
    return total


_TWO_BOUNDS = {
    "transfer": Bound(0.5, 1.0, "1", "restitution 0 to 1"),
    "momentum_error": Bound(0.0, 5e-3, "1", "conservation, floor and sides included"),
    "overlap": Bound(-math.inf, 1.0, "cells", "no interpenetration"),
    "second_angle": Bound(_CRITICAL, 90.0, "degrees", "the second tips over its edge"),
}

_TWO = Case(
    name="two-dominoes",
    title="A falling domino hits a standing one",
    source="Bonus (2023), 6.9, the row's first blow",
    levels={
        # 2,304 particles, 5e3 to 1e4 steps: 2e7 particle-steps, 4 s.
        "reduced": {
            "cells": 6, "slab": 0, "youngs_modulus": 3e6, "friction": 0.3, "start": 12.0,
            "spin": 20.8,
        },
        # 24 mm wide: 8.8e5 particles, 3e4 to 5e4 steps, 4e10 particle-steps.
        "full": {
            "cells": 12, "slab": 48, "youngs_modulus": 2e7, "friction": 0.3, "start": 12.0,
            "spin": 20.8,
        },
    },
    bounds={"reduced": _TWO_BOUNDS, "full": _TWO_BOUNDS},
    build=_two,
    measure=_measure_two,
)  # fmt: skip

# ---- the row ------------------------------------------------------------------------------------


def _row(p: Parameters, options: Options) -> Scene:
    """A row of dominoes, the first as the push of 1 m/s for 0.01 s leaves it.

    The transfer is the source's. All bodies share one velocity at a node, so dominoes that lean on
    each other do not slide: each blow passes on enough, but what leans then turns as one linkage,
    whose feet must slide. With softer dominoes (3 MPa) and 3 to 8 cells to a thickness the wave
    dies at the fourth with either transfer; with APIC, 12 cells and 0.2 GPa after three of 24.

    Trackers follow the upper row of particles of each: they are in checkpoints, so that a run which
    was stopped and resumed with `Simulation.resume` can be measured.
    """
    blend = Transfer(scheme="ASFLIP", flip=p["flip"], shift_max=p["shift"])
    scene, slab = _empty(p, options, p["count"], Method(cfl=0.4, transfer=blend))
    for k in range(p["count"]):
        start, spin = (p["start"], p["spin"]) if k == 0 else (0.0, 0.0)
        _add(scene, slab, k, start, spin, p, options)
    across, up, deep = 2 * p["cells"], round(2 * p["cells"] * _HIGH / _THICK), 2 * p["slab"] or 1
    each = across * up * deep
    # Lattices run with the last axis fastest: the upper particles of the first and last column.
    for k in range(p["count"]):
        ids = [k * each + (i * up + up - 1) * deep for i in (0, across - 1)]
        tracker = ParticleTracker(body=f"domino-{k}", ids=ids, interval=2e-4)
        scene.add_sensor(name=f"top-{k}", sensor=tracker)
    return scene


def _measure_row(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Times at which each domino leaves a beam of light at `beam`, its height upright, m.

    The beam lies along the width of the row at every domino's place, and is free once both upper
    edges are below it. The speed is that from domino `steady` on.
    """
    beam = p["beam"]
    simulation.run(until=p["duration"], progress=False)
    free = []
    for k in range(p["count"]):
        series = simulation.sensors[f"top-{k}"]
        names = list(series.components)
        columns = [i for i, name in enumerate(names) if name.startswith("position_y")]
        top = np.asarray(series.values)[:, columns].max(axis=1)
        # Particles lie a quarter of a cell below the edge that they stand for.
        below = np.flatnonzero(top + simulation.scene.cell_size / 4 < beam * (1 - 1e-3))
        free.append(float(np.asarray(series.time)[below[0]]) if len(below) else math.inf)
    fallen = int(np.isfinite(free).sum())
    first = p["steady"]
    speed = math.nan
    if fallen > first + 1:
        speed = (fallen - 1 - first) * _PITCH / (free[fallen - 1] - free[first])
    return {"fallen": float(fallen), "speed": speed}


_ROW_BOUNDS = {
    "fallen": Bound(24, 24, "dominoes", "all fall"),
    "speed": Bound(0.42, 0.60, "m/s", "table-top 0.42; Sun (2020), Song (2021) 0.532, 0.598"),
}

_ROW = Case(
    name="dominoes",
    title="A row of 24 dominoes falls: speed of the wave",
    source="Bonus (2023), 6.9; Sun (2020); Song (2021)",
    # In the plane, with a modulus of a tenth of the original: √10 fewer steps. 1.1e5 particles,
    # 3.3e6 steps, 3.7e11 particle-steps; some 3 to 6 minutes on a GPU.
    levels={
        "full": {
            "count": 24, "cells": 12, "slab": 0, "youngs_modulus": 2e8, "friction": 0.3,
            "start": 12.0, "spin": 20.8, "beam": 0.048, "steady": 7, "duration": 1.5,
            "flip": 0.999, "shift": 0.025,
        },
    },
    bounds={"full": _ROW_BOUNDS},
    build=_row,
    measure=_measure_row,
)  # fmt: skip

CASES: tuple[Case, ...] = (_TIP, _TWO, _ROW)
