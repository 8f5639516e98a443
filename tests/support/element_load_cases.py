"""Loaded bodies of elements with closed forms: tractions, driven ends, yield, beams under water.

Each returns numbers over what theory says. Shared by tests and `benchmarks/elements.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from support.element_cases import (
    SHEAR,
    Array,
    Numbers,
    at_rest,
    cantilever_scene,
    mesh_of,
    timoshenko,
)
from support.sagging_beam import sunk_exactly

#: Density and modulus of bars, kg/m³ and Pa.
DENSITY, MODULUS = 1000.0, 1e6
#: Samples of what is averaged over two periods.
_SAMPLES = 40


def ramp(value: Sequence[float], grows: float) -> libmpm.TimeTable:
    """Return a load that grows over half a cosine and stays."""
    time = np.linspace(0, grows, 65)
    share = 0.5 * (1 - np.cos(math.pi * time / grows))
    return libmpm.TimeTable(
        time.tolist(), (share[:, None] * np.asarray(value)).tolist(), end="hold"
    )


def _mean_force(sim: Any, sensor: str, axis: str, since: float) -> float:
    """Return the mean of what a load cell has taken since a time, N."""
    series = sim.sensors[sensor]
    column = list(series.components).index(f"force_{axis}")
    late = series.time > since
    return float(series.values[late, column].mean())


def _end_of_cantilever(
    value: tuple[float, float], period: float, edge: float, cells: int, ratio: float,
) -> tuple[Array, Array, float]:  # fmt: skip
    """Return how a loaded end moves in the mean, and the reaction of the clamp, N/m."""
    grows = 4 * period
    load = libmpm.grids.Traction(face="x+", value=ramp(value, grows))
    scene, _ = cantilever_scene(edge, cells, 2, ratio, None, "NeoHookean", 0.2, tractions=(load,))
    cell = sensors.LoadCell(boundary="clamp", interval=period / 200)
    scene.add_sensor(name="reaction", sensor=cell)
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    beam = sim.particles["beam"]
    position = beam["position"]
    tip = position[:, 0] > position[:, 0].max() - 1e-6
    rest = position[tip].mean(axis=0)
    sim.run(until=grows, progress=False)
    moved = []
    for k in range(1, _SAMPLES + 1):
        sim.run(until=grows + k * 2 * period / _SAMPLES, progress=False)
        moved.append(beam["position"][tip].mean(axis=0) - rest)
    reaction = np.array([_mean_force(sim, "reaction", axis, grows) for axis in "xy"])
    return np.mean(moved, axis=0), reaction, 0.1


def end_load(edge: float = 0.5, cells: int = 4, ratio: float = 0.3) -> Numbers:
    """Return the tip of a cantilever under a force at its end over P L³/3E'I + P L/kGA, plane.

    The force is a traction along the face at the end; the reaction is that of the nodes' region.
    """
    long, high, pull = 1.0, 0.1, 14.0
    period = 1 / timoshenko(long, high, MODULUS, ratio, DENSITY, True)
    moved, reaction, area = _end_of_cantilever((0.0, -pull), period, edge, cells, ratio)
    stiff, shear = MODULUS / (1 - ratio**2), MODULUS / (2 * (1 + ratio))
    force = pull * area
    expected = force * long**3 / (3 * stiff * high**3 / 12) + force * long / (SHEAR * high * shear)
    return {"tip": -float(moved[1]) / expected, "reaction": float(reaction[1]) / -force}


def end_pull(edge: float = 0.5, cells: int = 4) -> Numbers:
    """Return how far a bar is stretched by a traction at its end over σ L / E, ν = 0, plane.

    L counts from the last node that is held, half a cell before the region's face.
    """
    pull, long = 1000.0, 1.0 + 0.05 / cells
    period = 4 * long / math.sqrt(MODULUS / DENSITY)
    moved, reaction, area = _end_of_cantilever((pull, 0.0), period, edge, cells, 0.0)
    return {"stretch": float(moved[0]) / (pull * long / MODULUS),
            "reaction": float(reaction[0]) / (pull * area)}  # fmt: skip


# Bars between two regions ------------------------------------------------------------------------


def bar_scene(
    material: Any, cells: int, edge: float, dimension: int, strain: float, crossings: float,
    volumes: str | None = None, across: bool = False,
) -> tuple[libmpm.Scene, float, float]:  # fmt: skip
    """Return a bar 0.1 m thick that one end's region holds and the other's pulls.

    `across`: the other moves it along y alone, and holds as much of it as it is thick, so that it
    does not turn.

    Also its length between the last nodes that are held, m, and when the pull is over, s. The
    pull is a velocity that grows and falls over half a sine; the region stays where it is.
    """
    high, d = 0.1, dimension
    dx = high / cells
    shift = cells if across else 0
    n = 5 * cells  # cells between the faces of the regions; to the last held nodes one more
    free = (n + 1) * dx
    room = (
        n + 14 + 2 * shift,
        cells + 12 + math.ceil(strain * free / dx) * int(across),
        cells + 12,
    )[:d]
    wave = math.sqrt(material.youngs_modulus / material.density)
    lasts = crossings * free / wave
    time = np.linspace(0, lasts, 65)
    speed = strain * free * 0.5 * math.pi / lasts * np.sin(math.pi * time / lasts)
    pull = np.zeros((65, d))
    pull[:, 1 if across else 0] = speed
    pull[-1] = 0
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0,) * d, upper=[k * dx for k in room],
        method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    left, right, deep = 7 + shift, n + 7 + shift, 2 + shift
    low = np.array([left - deep, 6.2, 6.2][:d]) * dx
    top = np.array([(right + deep) * dx, low[1] + high, low[1] + high][:d])
    scene.add_body(name="bar", shape=mesh_of(low, top, edge * dx, volumes=volumes),
                   material=material)  # fmt: skip
    ends = [k * dx for k in room]
    scene.add_boundary(
        name="clamp", shape=shapes.Box(lower=(0,) * d, upper=[left * dx, *ends[1:]]),
        response=boundaries.Prescribed(), motion=at_rest(d),
    )  # fmt: skip
    scene.add_boundary(
        name="drive", shape=shapes.Box(lower=[right * dx, *([0] * (d - 1))], upper=ends),
        response=boundaries.Prescribed(components=("y",) if across else "all"),
        motion=libmpm.TimeTable(time.tolist(), pull.tolist(), end="hold"),
    )  # fmt: skip
    for name in ("clamp", "drive"):
        cell = sensors.LoadCell(boundary=name, interval=lasts / 400)
        scene.add_sensor(name=f"force at {name}", sensor=cell)
    return scene, free, lasts


def driven_bar(edge: float = 0.5, cells: int = 4, strain: float = 2e-3) -> Numbers:
    """Return the forces at both ends of a stretched bar over E A ε, ν = 0, plane strain.

    ε is over the length between the last nodes that are held. `give`: what the bar seems longer by
    at each end, cells. Splines bend beside the last node that is held.
    """
    law = materials.NeoHookean(density=DENSITY, youngs_modulus=MODULUS, poissons_ratio=0.0)
    scene, free, lasts = bar_scene(law, cells, edge, 2, strain, 8)
    period = 2 * free / math.sqrt(MODULUS / DENSITY)
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    sim.run(until=lasts + 2 * period, progress=False)
    # Stress of a neo-Hookean bar without lateral strain: E (λ - 1/λ) / 2, here ≈ E ε.
    expected = MODULUS * 0.1 * ((1 + strain) - 1 / (1 + strain)) / 2
    found = {
        f"force at {name}": sign * _mean_force(sim, f"force at {name}", "x", lasts) / expected
        for name, sign in (("clamp", 1), ("drive", -1))
    }
    return found | {"give": 0.5 * (1 / found["force at clamp"] - 1) * free * cells / 0.1}


def yielding_bar(
    edge: float = 1.0, cells: int = 4, hardening: float = 0.2, strain: float = 0.04,
    volumes: str | None = None, precision: str = "double",
) -> Numbers:  # fmt: skip
    """Return the force on a bar that yields over (σ_y + H a) A / λ, and its plastic strain.

    Uniaxial stress in space, von Mises: τ = (σ_y + H ln λ) / (1 + H/E) and a = ln λ - τ/E, with λ
    the stretch of the middle third and A the section at rest. σ_y is a hundredth of E, `hardening`
    H in parts of E.
    """
    yields, h = 0.01 * MODULUS, hardening * MODULUS
    law = materials.VonMises(density=DENSITY, youngs_modulus=MODULUS, poissons_ratio=0.3,
                             yield_stress=yields, hardening_modulus=h)  # fmt: skip
    scene, free, lasts = bar_scene(law, cells, edge, 3, strain, 24, volumes)
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    bar = sim.particles["bar"]
    rest = bar["position"]
    middle = 0.5 * (rest[:, 0].min() + rest[:, 0].max())
    planes = [float(rest[np.argmin(np.abs(rest[:, 0] - x)), 0])
              for x in (middle - free / 6, middle + free / 6)]  # fmt: skip
    sections = [np.abs(rest[:, 0] - x) < 1e-6 for x in planes]
    mesh: Any = scene.bodies[0].shape
    places, name = rest, "plastic_strain"
    if not math.isinf(edge):
        places, name = mesh.vertices[mesh.elements].mean(axis=1), "element_plastic_strain"
    inner = np.abs(places[:, 0] - middle) < free / 6
    period = 2 * free / math.sqrt(MODULUS / DENSITY)
    sim.run(until=0.8 * lasts, progress=False)
    stretch, flowed, begun = [], [], sim.time
    for k in range(1, 11):
        sim.run(until=begun + 0.1 * k * period, progress=False)
        now = bar["position"]
        a, b = (float(now[s, 0].mean()) for s in sections)
        c, d = (float(rest[s, 0].mean()) for s in sections)
        stretch.append((b - a) / (d - c))
        flowed.append(float(bar[name][inner].mean()))
    along = math.log(float(np.mean(stretch)))
    stress = (yields + h * along) / (1 + hardening)
    expected = stress * 0.01 / math.exp(along)
    force = _mean_force(sim, "force at clamp", "x", begun)
    return {"force": force / expected,
            "plastic_strain": float(np.mean(flowed)) / (along - stress / MODULUS),
            "along": along}  # fmt: skip


def plastic_hinges(edge: float = 0.5, cells: int = 4, volumes: str | None = None) -> Numbers:
    """Return the force that moves one end of a beam across, once it yields, over 2 M_p / L.

    Both ends are kept from turning. Plane strain, M_p = 2/√3 σ_y h²/4, without hardening, ν 0.3; L
    between the last nodes that are held. σ_y is 0.002 E, the way 0.05 L, five times that at which
    the outer fibres yield.
    """
    yields, high = 0.002 * MODULUS, 0.1
    law = materials.VonMises(density=DENSITY, youngs_modulus=MODULUS, poissons_ratio=0.3,
                             yield_stress=yields)  # fmt: skip
    scene, free, lasts = bar_scene(law, cells, edge, 2, 0.05, 150, volumes, across=True)
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    sim.run(until=0.9 * lasts, progress=False)
    moment = 2 / math.sqrt(3) * yields * high**2 / 4
    force = abs(_mean_force(sim, "force at clamp", "y", 0.75 * lasts))
    return {"force": force * free / (2 * moment), "steps": float(sim.steps)}


# Water on a beam ---------------------------------------------------------------------------------


def membrane(
    modulus: float, load: float, long: float = 10.0, high: float = 1.0, ponding: float = 0.0
) -> float:
    """Return how far the middle of a beam with both ends held sinks, m.

    w L⁴ / E = 384 I δ + (π⁴/4) A δ³ (one term of the clamped shape) and shear, w L² / (8 k A G),
    ν = 0; `load` w in N/m. `ponding`: weight ρ g of water whose surface stays level, N/m³: what
    the shape δ (1 - cos 2πx/L) / 2 gathers in the middle and takes from the ends bends the beam by
    ρ g L⁴ / (16 π⁴ E I) of δ more, as long as no end falls dry.
    """
    inertia, area = high**3 / 12, high
    stiff = 384 * inertia - 24 * ponding * long**4 / (math.pi**4 * modulus)
    roots = np.roots([math.pi**4 / 4 * area, 0, stiff, -load * long**4 / modulus])
    bent = float(max(r.real for r in roots if abs(r.imag) < 1e-9 * abs(r)))
    return bent + load * long**2 / (8 * SHEAR * area * modulus / 2)


def beam_under_water(
    modulus: float = 5e7, cells: int = 4, edge: float | None = 0.5, grows: float = 6.0,
    holds: float = 4.0, contact: bool = False,
) -> Numbers:  # fmt: skip
    """Return how far a beam 10 x 1 m sinks under 0.5 m of water over `membrane`, plane strain.

    Density 100 kg/m³, ν 0, its weight counts; gravity grows as t² and stays at 9.81 m/s². `edge`
    in cells; None = particles. Ends are held at the last nodes of two regions, 10 m apart. The
    mean of the second half of `holds`. `contact`: the water has a field of velocities of its own
    and runs along the beam; else both share one, where they share nodes.
    """
    dx, long, high, deep, gravity = 1.0 / cells, 10.0, 1.0, 0.5, 9.81
    n = round(long / dx) - 1  # cells between the faces of the regions
    left, right = 3 * dx, (n + 3) * dx
    base, top = 3.0 + 4 * dx, 3.0 + 4 * dx + high
    ends = ((n + 6) * dx, math.ceil((top + 2 * deep + 1) / dx) * dx)
    time = np.linspace(0, grows, 49)
    pull = gravity * (time / grows) ** 2
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=ends, method=libmpm.Method(cfl=0.4),
        gravity=libmpm.TimeTable(time.tolist(), [[0.0, -float(g)] for g in pull], end="hold"),
    )  # fmt: skip
    low, up = (left - 2 * dx, base), (right + 2 * dx, top)
    scene.add_body(
        name="beam",
        shape=shapes.Box(lower=low, upper=up) if edge is None else mesh_of(low, up, edge * dx),
        material=materials.NeoHookean(density=100.0, youngs_modulus=modulus, poissons_ratio=0.0),
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(left, top), upper=(right, top + deep)),
        material=materials.TaitFluid(density=1000.0, bulk_modulus=2e6),
    )  # fmt: skip
    for name, span in (("left", (0.0, left)), ("right", (right, ends[0]))):
        block = shapes.Box(lower=(span[0], 0), upper=(span[1], ends[1]))
        scene.add_boundary(name=f"held {name}", shape=block, response=boundaries.Prescribed(),
                           motion=at_rest(2), bodies=("beam",))  # fmt: skip
        scene.add_boundary(name=f"wall {name}", shape=block, response=boundaries.Slip(),
                           bodies=("water",))  # fmt: skip
    if contact:
        scene.add_contact(name="wet", between=("beam", "water"), law=libmpm.contacts.Fluid())
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    beam = sim.particles["beam"]
    rest = beam["position"]
    near = np.abs(rest[:, 0] - 0.5 * (left + right)) < 0.51 * dx
    sim.run(until=grows + 0.5 * holds, progress=False)
    sunk = []
    for k in range(1, _SAMPLES + 1):
        sim.run(until=grows + (0.5 + 0.5 * k / _SAMPLES) * holds, progress=False)
        sunk.append(float((rest[near, 1] - beam["position"][near, 1]).mean()))
    return sunk_by(modulus, float(np.mean(sunk)), dx) | {"steps": float(sim.steps)}


def sunk_by(modulus: float, metres: float, dx: float) -> Numbers:
    """Return how far the beam under water sinks over theory.

    Over the formula, whose water is spread evenly; with ponding where no end is dry; over the
    beam under level water at any deflection.
    """
    load = 9.81 * (1000.0 * 0.5 + 100.0)
    found = {"sinks": metres / membrane(modulus, load), "metres": metres,
             "under_level_water": metres / sunk_exactly(modulus, dx)}  # fmt: skip
    if metres / 2 < 0.5:
        found["with_ponding"] = metres / membrane(modulus, load, ponding=9810.0)
    return found


def elastic_column(
    edge: float | None = 0.5, dx: float = 0.004, density: float = 2500.0, until: float = 0.4,
    modulus: float = 1e6, pinned: bool = False,
) -> Numbers:  # fmt: skip
    """Return when a dam break meets an elastic column, and how far its tip goes and when.

    In mm and s, of `column_motion`.
    """
    return column_motion(edge, dx, density, until, modulus, pinned)[0]


def column_motion(
    edge: float | None = 0.5, dx: float = 0.004, density: float = 2500.0, until: float = 0.4,
    modulus: float = 1e6, pinned: bool = False,
) -> tuple[Numbers, Array]:  # fmt: skip
    """Return `elastic_column`'s numbers, and times (s) with how far the tip has gone (mm), (n, 2).

    Walhorn et al. (2005): water 0.146 x 0.292 m, column 0.012 x 0.08 m from x = 0.286 m, tank
    0.584 m; E 1 MPa, ν 0. Bulk modulus of the water 1 MPa. `edge` in cells; None = particles. It
    stands two cells deep in a region of nodes, or is `pinned` by its foot.
    """
    gravity, deep = 9.81, 2
    n = round(0.584 / dx)
    floor = deep * dx
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(n * dx, math.ceil(0.42 / dx) * dx),
        gravity=(0, -gravity),
        method=libmpm.Method(cfl=0.4, leaving="delete"),  # drops
    )  # fmt: skip
    left = round(0.286 / dx) * dx
    # Free from the last node that is held, half a cell below the floor; pins hold it where it is.
    low, up = (left, floor - deep * dx), (left + 0.012, floor - 0.5 * dx + 0.08)
    if pinned:
        low, up = (left, floor), (left + 0.012, floor + 0.08)
    scene.add_body(
        name="column",
        shape=shapes.Box(lower=low, upper=up) if edge is None else mesh_of(low, up, edge * dx),
        material=materials.NeoHookean(density=density, youngs_modulus=modulus, poissons_ratio=0.0),
        pins=libmpm.grids.Pin(face="y-") if pinned else (),
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, floor), upper=(0.146, floor + 0.292)),
        material=materials.TaitFluid(density=1000.0, bulk_modulus=1e6),
        hydrostatic=floor + 0.292,
    )  # fmt: skip
    base = shapes.Box(lower=(0, 0), upper=(n * dx, floor))
    if not pinned:
        scene.add_boundary(name="foot", shape=base, response=boundaries.Prescribed(),
                           motion=at_rest(2), bodies=("column",))  # fmt: skip
    scene.add_boundary(name="floor", shape=base, response=boundaries.Slip(), bodies=("water",))
    scene.add_boundary(name="tank", shape=shapes.DomainWalls(faces=("x-", "x+")),
                       response=boundaries.Slip(), bodies=("water",))  # fmt: skip
    scene.add_contact(name="wet", between=("column", "water"), law=libmpm.contacts.Fluid())
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    column, water = sim.particles["column"], sim.particles["water"]
    rest = column["position"]
    tip = int(np.argmin(np.abs(rest - np.array([low[0], up[1]])).sum(axis=1)))
    time: list[float] = []
    moved: list[float] = []
    front: list[float] = []
    while sim.time < until:
        sim.run(until=0.002 * (len(time) + 1), progress=False)
        time.append(sim.time)
        moved.append(1e3 * float(column["position"][tip, 0] - rest[tip, 0]))
        front.append(float(water["position"][:, 0].max()))
    peak = int(np.argmax(moved))
    arrives = next((t for t, x in zip(time, front, strict=True) if x > left - 0.5 * dx), math.nan)
    found = {"arrives": arrives, "peak": moved[peak], "peak_time": time[peak]}
    return found, np.array([time, moved]).T


# Dominoes ----------------------------------------------------------------------------------------


def dominoes(
    edge: float = 0.5, cells: int = 3, count: int = 5, friction: float = 0.3, modulus: float = 3e6,
) -> Numbers:  # fmt: skip
    """Return the mean time between falls of neighbours in a row of dominoes, ms, and how many fell.

    Of Bonus (2023), 6.9: 6 mm thick, 48 mm high, 30 mm apart, 1400 kg/m³; the first begins at 12
    degrees and 20.8 rad/s. A domino falls when it has turned by 5 degrees. `edge` in cells;
    infinite = particles. Friction between them and on the floor.
    """
    thick, high, pitch, begins = 0.006, 0.048, 0.030, 12.0
    dx = thick / cells
    feet = [0.018 + k * pitch for k in range(count)]
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), gravity=(0, -9.81),
        upper=(math.ceil((feet[-1] + 1.3 * high) / dx) * dx, math.ceil(1.3 * high / dx) * dx),
        method=libmpm.Method(cfl=0.4),
    )  # fmt: skip
    material = materials.FixedCorotated(density=1400.0, youngs_modulus=modulus, poissons_ratio=0.3)
    turn = math.radians(begins)
    for k, foot in enumerate(feet):
        shape: Any = mesh_of((foot - thick, 0.0), (foot, high), edge * dx)
        spin = None
        if k == 0:
            spin = libmpm.Field(components=("20.8 * y", f"-20.8 * (x - {foot})"))
            if math.isinf(edge):
                c, s = math.cos(turn), math.sin(turn)
                middle = (foot + (high * s - thick * c) / 2, (high * c + thick * s) / 2)
                shape = shapes.OrientedBox(centre=middle, size=(thick, high), angle=-begins)
            else:
                shape = shape.turned(-begins, about=(foot, 0.0))
        scene.add_body(name=f"d{k}", shape=shape, material=material, velocity=spin)
    rough = boundaries.Separable(static_friction=friction, dynamic_friction=friction)
    scene.add_boundary(name="floor", shape=shapes.DomainWalls(faces=("y-",)), response=rough)
    law = libmpm.contacts.Friction(static=friction, dynamic=friction)
    for k in range(count - 1):
        scene.add_contact(name=f"c{k}", between=(f"d{k}", f"d{k + 1}"), law=law)
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    rest = [sim.particles[f"d{k}"]["position"] for k in range(count)]
    upper = [x[:, 1] > 0.75 * x[:, 1].max() for x in rest]
    lower = [x[:, 1] < 0.25 * x[:, 1].max() for x in rest]
    falls: dict[int, float] = {}
    while sim.time < 0.09 * count and len(falls) < count - 1:
        sim.run(until=sim.time + 5e-4, progress=False)
        k = len(falls) + 1
        x = sim.particles[f"d{k}"]["position"]
        a, b = x[upper[k]].mean(axis=0) - x[lower[k]].mean(axis=0)
        if math.degrees(math.atan2(a, b)) > 5:
            falls[k] = sim.time
    times = np.array(list(falls.values()))
    return {"interval": 1e3 * float(np.diff(times).mean()) if len(times) > 1 else math.nan,
            "fallen": float(1 + len(times)), "steps": float(sim.steps)}  # fmt: skip
