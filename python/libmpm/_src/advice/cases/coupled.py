"""Reference cases of water and solids: a loaded beam, a column in a dam break, and buoyancy.

Sources are sections of Bonus (2023) unless a case says otherwise. Scenes are planes x, y with
gravity along -y; on level "full" some are slabs. All are in SI units, per metre of thickness in 2D.
Reduced level on one core: beam 2 s, column 20 s and the light one 25 s, buoyancy 15 s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import Slab, advance, fluid_fbar, method_of, solid_choices
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Separable, Slip, Sticky
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.methods.method import FBar
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.boxes import DomainWalls

__all__ = ["CASES"]

Parameters = Mapping[str, Any]
Floats = npt.NDArray[np.float64]

_WATER = 1000.0  # kg/m³


# ---- loaded beam --------------------------------------------------------------------------------

_SPAN, _DEPTH, _POOL = 10.0, 1.0, 0.5  # m: of the beam, of its section, of the water on it
_BEAM, _GRAVITY = 100.0, 9.81  # kg/m³, m/s²


def _deflections(modulus: float) -> tuple[float, float, float]:
    """Return deflections of the middle, m: linear, with membrane force, with ponding as well.

    Both ends clamped, ν = 0, section A = 1 m² a metre of width under water and its own weight w,
    with shear. The one-term shape δ (1 - cos 2πx/L)/2 gives w L⁴/E = 384 I δ + (π⁴/4) A δ³ for the
    second. What sags gathers water: its level stays flat and its volume as it is, so that the load
    grows by -ρ g (δ/2) cos 2πx/L, which does the work of a uniform ρ g δ/4; that makes the source's
    beams of 1 to 6 % of their span sag further than the linear theory says. Membrane force bears
    its share of the load without shear. From δ = 1 m on the ends are dry and this is an estimate.
    """
    w = (_WATER * _POOL + _BEAM * _DEPTH) * _GRAVITY
    inertia, area = _DEPTH**3 / 12, _DEPTH
    bending, membrane, load = 384 * inertia, math.pi**4 / 4 * area, w * _SPAN**4 / modulus
    resistance = 5 / 6 * area * (modulus / 2)  # against shear, N

    def middle(ponding: float) -> float:
        roots = np.roots([membrane, 0.0, bending - ponding, -load])
        return float(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real.max())

    shear = w * _SPAN**2 / (8 * resistance)
    sagged = middle(_WATER * _GRAVITY / 4 * _SPAN**4 / modulus)
    share = bending * sagged / (bending * sagged + membrane * sagged**3)
    gathered = _WATER * _GRAVITY * sagged * _SPAN**2 / (4 * math.pi**2 * resistance)
    ponded = sagged + share * (shear + gathered)
    return load / bending + shear, middle(0.0) + shear, ponded


def _loaded_beam(p: Parameters, options: Options) -> Scene:
    """Water on a beam between two blocks that hold its ends and let the water slip.

    The blocks stand half a cell off the ends, so that the held nodes are at the ends: a beam that
    meets them on the plane of the walls bends as if it were 0.69 cells shorter.
    """
    dx = p["cell_size"]
    slab = Slab(dx, p["thickness"])
    ramp = np.linspace(0.0, 1.0, 101)
    gravity = TimeTable(p["ramp"] * ramp, _GRAVITY * ramp**2)
    inner = (-0.5 * dx, _SPAN + 0.5 * dx)
    low, high = (inner[0] - 2 * dx, -2.5), (inner[1] + 2 * dx, 1.0)
    scene = slab.scene("loaded-beam", low, high, gravity, method_of(options, 0.4))
    scene.add_body(
        name="water",
        shape=slab.box((0.0, 0.0), (_SPAN, _POOL)),
        material=TaitFluid(density=_WATER, bulk_modulus=p["bulk_modulus"]),
        fbar=fluid_fbar(options),
    )
    scene.add_body(
        name="beam",
        shape=slab.box((0.0, -_DEPTH), (_SPAN, 0.0)),
        material=FixedCorotated(
            density=_BEAM, youngs_modulus=p["youngs_modulus"], poissons_ratio=0.0
        ),
        **solid_choices(options),
    )
    for side, (a, b) in {"left": (low[0], inner[0]), "right": (inner[1], high[0])}.items():
        clamp, wall = slab.box((a, low[1]), (b, 0.0)), slab.box((a, 0.0), (b, high[1]))
        scene.add_boundary(name=f"{side}-clamp", shape=clamp, response=Sticky())
        scene.add_boundary(name=f"{side}-wall", shape=wall, response=Slip(cell="held"))
    if p["thickness"]:
        sides = DomainWalls(faces=("z-", "z+"))
        scene.add_boundary(name="sides", shape=sides, response=Slip(cell="held"))
    return scene


def _read_loaded_beam(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Deflection of the middle, the mean over the last `hold` seconds, at full gravity."""
    start = sim.particles["beam"]["position"]
    middle = np.abs(start[:, 0] - _SPAN / 2) < p["cell_size"]
    level, found = np.mean(start[middle, 1]), []
    for _ in advance(sim, p["ramp"] + np.linspace(0.0, 1.0, 41) * p["hold"]):
        found.append(level - np.mean(sim.particles["beam"]["position"][middle, 1]))
    linear, stiffened, ponded = _deflections(p["youngs_modulus"])
    deflection = float(np.mean(found))
    return {
        "deflection": deflection,
        "ratio": deflection / stiffened,
        "ponded_ratio": deflection / ponded,
        "stiffening": deflection / linear,
        "swing": float(np.ptp(found) / 2 / deflection),
    }


# Water of two cells hardly flows to where the beam sags: coarse runs are held to the theory without
# ponding, fine ones to that with it (of 5 MPa: 0.936, 0.943 and 1.016 of it at Δx 0.25, 0.125 and,
# with water 25 times as stiff, 0.025).
_BEAM_BOUNDS = {
    "reduced": {
        "ratio": Bound(0.94, 1.06, "1", "beam with membrane stiffening, Bonus (2023), 6.6"),
    },
    "full": {
        "ponded_ratio": Bound(0.94, 1.06, "1", "beam with membrane force under water it gathers"),
    },
}

# "full" is 768,000 particles and 2.7e5 steps at E ≤ 5e6: 2.0e11 particle-steps, 1.5 minutes; at
# 5e7 three times as many.
_LOADED_BEAM = Case(
    name="loaded-beam",
    title="Water on an elastic beam with clamped ends: deflection of the middle",
    source="Bonus (2023), 6.6",
    levels={
        "reduced": {
            "cell_size": 0.25,
            "thickness": 0.0,
            "youngs_modulus": 5e6,
            "bulk_modulus": 2e6,
            "ramp": 6.0,
            "hold": 2.0,
        },
        "full": {
            "cell_size": 0.025,
            "thickness": 0.1,
            "youngs_modulus": 5e6,
            "bulk_modulus": 5e7,
            "ramp": 8.0,
            "hold": 4.0,
        },
    },
    bounds=_BEAM_BOUNDS,
    build=_loaded_beam,
    measure=_read_loaded_beam,
)


# ---- elastic column in a dam break --------------------------------------------------------------

_TANK, _RESERVOIR, _COLUMN = 0.584, (0.146, 0.292), ((0.286, 0.0), (0.298, 0.08))  # m


def _elastic_column(p: Parameters, options: Options) -> Scene:
    """Water released at the left of a tank, an elastic column on its bed.

    Walls, bed and clamp stand half a cell off water and column, so that the nodes that they hold
    are where the published geometry has them (see `_loaded_beam`).
    """
    dx = p["cell_size"]
    slab = Slab(dx, p["thickness"])
    bed, left, right = -0.5 * dx, -0.5 * dx, _TANK + 0.5 * dx
    base = bed - 2 * dx
    top = base + dx * math.ceil(0.4 / dx)
    method = method_of(options, 0.3, p["flip"])
    scene = slab.scene("elastic-column", (left, base), (right, top), 9.81, method)
    scene.add_body(
        name="water",
        shape=slab.box((0.0, 0.0), _RESERVOIR),
        material=TaitFluid(density=_WATER, bulk_modulus=p["bulk_modulus"]),
        fbar=fluid_fbar(options),
    )
    scene.add_body(
        name="column",
        shape=slab.box(*_COLUMN),
        material=FixedCorotated(
            density=p["density"], youngs_modulus=1e6, poissons_ratio=p["poissons_ratio"]
        ),
        **solid_choices(options),
    )
    # Faces of cells that enclose every node of the column.
    low = (math.floor(_COLUMN[0][0] / dx - 0.5 + 1e-6) - 0.5) * dx
    high = (math.ceil(_COLUMN[1][0] / dx + 0.5 - 1e-6) + 0.5) * dx
    for name, a, b, response in (
        ("bed-left", left, low, Separable(cell="held")),
        ("bed-right", high, right, Separable(cell="held")),
        ("clamp", low, high, Sticky()),
    ):
        box = slab.box((a, base), (b, bed))
        scene.add_boundary(name=name, shape=box, response=response)
    walls = DomainWalls(faces=("x-", "x+", "y+"))
    scene.add_boundary(name="walls", shape=walls, response=Separable(cell="held"))
    if p["thickness"]:
        sides = DomainWalls(faces=("z-", "z+"))
        scene.add_boundary(name="sides", shape=sides, response=Slip(cell="held"))
    return scene


def _tip(sim: Simulation, until: float) -> tuple[float, float, float]:
    """Return the column's largest displacement, m, its time, s, and when it has moved by 1 mm, s.

    The displacement is that of the upper left corner along x.
    """
    column = sim.particles["column"]
    start = column["position"]
    left = np.flatnonzero(start[:, 0] < start[:, 0].min() + 1e-9)
    last, top = left[np.argsort(start[left, 1])][-2:]
    time, moved = [0.0], [0.0]
    for now in advance(sim, np.arange(1, round(until / 1e-3) + 1) * 1e-3):
        away = column["position"][[last, top], 0] - start[[last, top], 0]
        time.append(now)
        # The corner lies half a distance of particles beyond the last of them.
        moved.append(1.5 * away[1] - 0.5 * away[0])
    return peak_of_tip(np.array(time), np.array(moved))


def peak_of_tip(t: Floats, u: Floats) -> tuple[float, float, float]:
    """Return the largest of the displacements u, m, its time, s, and when they passed 1 mm, s."""
    peak = int(np.argmax(u))
    near = slice(max(peak - 5, 0), peak + 6)
    fit = np.polyfit(t[near] - t[peak], u[near], 2)
    best = float(np.clip(-fit[1] / (2 * fit[0]), -0.003, 0.003)) if fit[0] < 0 else 0.0
    arrival = float(t[np.argmax(u > 1e-3)])
    return float(np.polyval(fit, best)), float(t[peak] + best), arrival


def _read_elastic_column(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Largest displacement of the tip; with `coarser` cell sizes also what it tends to.

    Two coarser sizes, each a fixed ratio from the next, give the observed order, Richardson's
    limit and the grid convergence index (safety 1.25) as its uncertainty; without an order
    between 0.5 and 3 the uncertainty is the range of the three.
    """
    peak, time, arrival = _tip(sim, p["until"])
    values = {"tip": peak, "time": time, "arrival": arrival}
    if not p["coarser"]:
        return values
    bodies = {body.name: body for body in sim.scene.bodies}
    same = Options(
        method=sim.scene.method,
        fbar=_as_option(bodies["water"].fbar),
        solid_fbar=_as_option(bodies["column"].fbar),
    )
    found = [(peak, time)]
    for cell_size in p["coarser"]:
        scene = _elastic_column({**p, "cell_size": cell_size}, same)
        other = type(sim)(scene, device=sim.device, precision=sim.precision, pipeline=sim.pipeline)
        found.append(_tip(other, p["until"])[:2])
        values |= {f"tip_{1e3 * cell_size:g}mm": found[-1][0]}
        values |= {f"time_{1e3 * cell_size:g}mm": found[-1][1]}
    fine, middle, coarse = (tip for tip, _ in found)
    ratio = p["coarser"][0] / p["cell_size"]
    steps = (coarse - middle) / (middle - fine) if middle != fine else math.inf
    order = math.log(steps) / math.log(ratio) if steps > 0 else math.nan
    if 0.5 <= order <= 3:
        correction = (fine - middle) / (ratio**order - 1)
        uncertainty = 1.25 * abs(correction)
    else:
        correction, uncertainty = 0.0, max(fine, middle, coarse) - min(fine, middle, coarse)
    return values | {"order": order, "limit": fine + correction, "uncertainty": uncertainty}


def _as_option(fbar: FBar | Literal["default"] | None) -> FBar | Literal["case"] | None:
    """Return the option that gave a body its F-bar; the case's own is the default."""
    return "case" if isinstance(fbar, str) else fbar


def _column_case(name: str, density: float, ratio: float, tip: float, time: float) -> Case:
    """Return the case of one column with the tip, m, and its time, s, of the reduced level."""
    column = {"density": density, "poissons_ratio": ratio, "flip": 0.8}
    source = "a prototype of Bonus (2023), 6.7, at Δx 4 mm, K 1e6, AFLIP 0.8; the source has curves"
    return Case(
        name=name,
        title=f"Dam break on an elastic column of {density:g} kg/m³, ν {ratio:g}: tip",
        source="Walhorn et al. (2005); Bonus (2023), 6.7",
        levels={
            "reduced": {
                "cell_size": 0.004, "thickness": 0.0, "coarser": (), "bulk_modulus": 1e6,
                "until": 0.26, **column,
            },
            # 170,000 particles and 1.4e5 steps on the finest: 3e10 particle-steps with all three.
            "full": {
                "cell_size": 0.001, "thickness": 0.0, "coarser": (0.002, 0.004),
                "bulk_modulus": 1e7, "until": 0.35, **column,
            },
        },
        bounds={
            "reduced": {
                "tip": Bound(0.9 * tip, 1.1 * tip, "m", source),
                "time": Bound(time - 0.01, time + 0.01, "s", source),
            },
        },
        build=_elastic_column,
        measure=_read_elastic_column,
    )  # fmt: skip


_COLUMNS = (
    _column_case("elastic-column", 2500.0, 0.0, 0.051, 0.230),
    _column_case("elastic-column-light", 1000.0, 0.3, 0.044, 0.219),
)


# ---- buoyancy -----------------------------------------------------------------------------------

_EDGE, _BASIN, _LEVEL, _BASE = 0.4, 3.2, 6.4, 5.0  # m
_CUBES = (750.0, 1500.0, 3000.0)  # kg/m³, one in each basin


def _buoyancy(p: Parameters, options: Options) -> Scene:
    """Three basins side by side, in each a square block released at rest under water."""
    dx = p["cell_size"]
    slab = Slab(dx, p["thickness"])
    apart = _BASIN + 2 * dx
    top = dx * round(7.4 / dx)
    size = (3 * _BASIN + 4 * dx, top)
    method = method_of(options, 0.45, p["flip"])
    scene = slab.scene("buoyancy", (0.0, 0.0), size, 10.0, method)
    fbar = fluid_fbar(options, FBar(form="two-volume", ratio=0.99))
    for n, density in enumerate(_CUBES):
        left = n * apart
        scene.add_body(
            name=f"water-{n}",
            shape=slab.box((left, 0.0), (left + _BASIN, _LEVEL)),
            material=TaitFluid(density=_WATER, bulk_modulus=p["bulk_modulus"]),
            fbar=fbar,
            hydrostatic=_LEVEL,
        )
        corner = (left + (_BASIN - _EDGE) / 2, _BASE)
        scene.add_body(
            name=f"cube-{density:g}",
            shape=slab.box(corner, (corner[0] + _EDGE, corner[1] + _EDGE)),
            material=FixedCorotated(density=density, youngs_modulus=1e7, poissons_ratio=0.4),
            subtract_from=(f"water-{n}",),
            **solid_choices(options),
        )
        if n:
            between = slab.box((left - 2 * dx, 0.0), (left, top))
            scene.add_boundary(name=f"wall-{n}", shape=between, response=Separable(cell="held"))
    walls = DomainWalls(faces=slab.faces("x-", "x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=Separable(cell="held"))
    return scene


def _falls(density: float, times: Floats, area: float, volume: float, added: float) -> Floats:
    """Return base elevations, m, of a block that weight, buoyancy and drag (2.1) move.

    `area` is across the motion, m², `volume` what it displaces, m³, and `added` the mass of water
    that it takes along, kg. The block fills a slab 0.4 m thick.
    """
    weight = density * _EDGE**3
    y, v, steps, out = _BASE, 0.0, 200, []
    for dt in np.diff(times, prepend=0.0) / steps:
        for _ in range(steps):
            push = 10.0 * (_WATER * volume - weight) - 1.05 * _WATER * area * v * abs(v)
            v += dt * push / (weight + added)
            y += dt * v
        out.append(y)
    return np.array(out)


def _read_buoyancy(sim: Simulation, p: Parameters) -> dict[str, float]:
    """Base elevation of each cube after 2 s, and its largest distance from two models until then.

    "author": the model of the source, without added mass and with the displaced volume of an edge
    2.5 cm longer. "model": the true volume, and the added mass of a square, 1.51 π a² ρ. Both are
    for open water, so that a cube counts until it comes to the surface or the bed by an edge.
    """
    times = np.linspace(0.0, p["until"], 21)[1:]
    place: dict[float, list[float]] = {density: [] for density in _CUBES}
    reached = []
    for now in advance(sim, times):
        reached.append(now)
        for density, found in place.items():
            centre = np.mean(sim.particles[f"cube-{density:g}"]["position"][:, 1])
            found.append(float(centre) - _EDGE / 2)
    return away_from_models(np.array(reached), {k: np.array(v) for k, v in place.items()})


def away_from_models(t: Floats, place: Mapping[float, Floats]) -> dict[str, float]:
    """Return last elevations and distances from both models, m, of bases that were at `place`."""
    wide = _EDGE + 2 * 0.0125
    models = {
        "author": (wide**2, wide**2 * _EDGE, 0.0),
        "model": (_EDGE**2, _EDGE**3, 1.51 * math.pi * (_EDGE / 2) ** 2 * _EDGE * _WATER),
    }
    values = {}
    for density, found in place.items():
        values[f"y_{density:g}"] = float(found[-1])
        for name, (area, volume, added) in models.items():
            expected = _falls(density, t, area, volume, added)
            free = (expected > _EDGE) & (expected < _LEVEL - 2 * _EDGE)
            away = np.abs(found - expected)[free]
            values[f"{name}_{density:g}"] = float(away.max())
    return values | {"sinks_faster": values["y_1500"] - values["y_3000"]}


_ORDER = "Archimedes: light rises, heavy sinks faster"
# The source says that they "follow reasonably" and has no number. What its model leaves out, added
# mass with the true volume, is worth 0.168 m (1500) and 0.128 m (3000) of it over 2 s in open water
# (`_falls`; tests/python/test_case_bounds.py): a run that is right lies within that of its model.
_AWAY = "the model of Bonus (2023), 6.12 to 6.15, to what added mass and true volume change of it"
_OWN = "this package's own; the model with added mass and true volume"

# "full" is three basins of 256 x 512 cells of 4 particles, 1.6e6, 6e4 steps (K 2.2e7): 9.4e10
# particle-steps, 20 s; at K 2.2e9 ten times as many steps.
_BUOYANCY = Case(
    name="buoyancy",
    title="Cubes of three densities released under water: rise and fall",
    source="Bonus (2023), 6.8",
    levels={
        "reduced": {
            "cell_size": 0.1,
            "thickness": 0.0,
            "bulk_modulus": 2.2e7,
            "flip": 0.0,
            "until": 2.0,
        },
        "full": {
            "cell_size": 0.0125,
            "thickness": 0.0,
            "bulk_modulus": 2.2e8,
            "flip": 0.3,
            "until": 2.0,
        },
    },
    bounds={
        "reduced": {
            "y_750": Bound(_BASE, _LEVEL, "m", _ORDER),
            "y_1500": Bound(0.0, _BASE, "m", _ORDER),
            "sinks_faster": Bound(0.0, _BASE, "m", _ORDER),
        },
        # The author's model has no added mass: a light cube starts four times as fast in it as in
        # any ideal fluid, and is 0.44 m ahead after 1 s. For it the model with added mass counts.
        "full": {
            "model_750": Bound(0.0, 0.15, "m", _OWN),
            "author_1500": Bound(0.0, 0.17, "m", _AWAY),
            "author_3000": Bound(0.0, 0.13, "m", _AWAY),
        },
    },
    build=_buoyancy,
    measure=_read_buoyancy,
)

CASES: tuple[Case, ...] = (_LOADED_BEAM, *_COLUMNS, _BUOYANCY)
