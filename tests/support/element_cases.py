"""Cases with closed forms for bodies of elements: spin, bar against a wall, cantilevers, Cook.

Each returns numbers over what theory says. Shared by tests and `benchmarks/elements.py`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import libmpm
from libmpm import boundaries, materials, sensors, shapes

Array = NDArray[np.float64]
Numbers = dict[str, float]

#: Of the first mode of a cantilever: β L and the share of shear and rotary inertia.
BETA, MODE = 1.8751041, 4.65
SHEAR = 5 / 6
#: Steps that are made between two looks at the tip, of a period.
_LOOKS = 100


def mesh_of(lower: Any, upper: Any, edge: float, pattern: str = "alternating",
            volumes: str | None = None) -> Any:  # fmt: skip
    """Return a box of elements in 2D or 3D; of particles where the edge is infinite."""
    if math.isinf(edge):
        return shapes.Box(lower=lower, upper=upper)
    kind: Any = shapes.Triangles if len(lower) == 2 else shapes.Tetrahedra
    return kind.box(lower=lower, upper=upper, edge=edge, pattern=pattern, volumes=volumes)


def solid(law: str, density: float, modulus: float, ratio: float) -> Any:
    """Return a material by the name of its law."""
    return getattr(materials, law)(density=density, youngs_modulus=modulus, poissons_ratio=ratio)


def at_rest(dimension: int) -> libmpm.TimeTable:
    """Return the velocity of a region that holds what lies in it."""
    return libmpm.TimeTable([0.0, 1.0], [[0.0] * dimension] * 2)


def elastic_energy(sim: Any, body: str) -> float:
    """Return the energy in all elements, J."""
    view = sim.particles[body]
    name = "element_energy" if "element_energy" in view.names else "elastic_energy"
    return float(view[name].sum())


def grid_motion(sim: Any, centre: Array) -> tuple[float, float]:
    """Return kinetic energy and angular momentum about a point of what the nodes carry."""
    mass, v, x = sim.grid["mass"], sim.grid["velocity"], sim.grid["position"] - centre
    momentum = x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]
    return float((0.5 * mass * (v * v).sum(axis=1)).sum()), float((mass * momentum).sum())


# Spin --------------------------------------------------------------------------------------------


def spin(
    edge: float = 0.5, cells: int = 16, turns: float = 3.0, law: str = "NeoHookean",
    precision: str = "double", dimension: int = 2, transfer: Any = None,
) -> Numbers:  # fmt: skip
    """Return what a free square (a cube) keeps of angular momentum and energy in so many turns."""
    dx, omega, d = 1.0 / cells, 2.0, dimension
    n = 2 * cells + 10
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0,) * d,
        upper=(n * dx, n * dx, (cells // 2 + 8) * dx)[:d],
        method=libmpm.Method(cfl=0.3) if transfer is None
        else libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    centre = np.array([n / 2 + 0.13, n / 2 + 0.29, cells / 4 + 4.17][:d]) * dx
    size = np.array([1.0, 1.0, 0.5][:d])
    low, high = centre - size / 2, centre + size / 2
    turning = libmpm.Field(
        components=(
            f"{-omega} * (y - {float(centre[1])!r})",
            f"{omega} * (x - {float(centre[0])!r})",
            "0",
        )[:d]
    )
    scene.add_body(
        name="block", shape=mesh_of(low, high, edge * dx), material=solid(law, 1e3, 1e6, 0.3),
        velocity=turning,
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    kinetic, momentum = grid_motion(sim, centre)
    sim.run(until=turns * 2 * math.pi / omega, progress=False)
    after, kept = grid_motion(sim, centre)
    return {
        "momentum": kept / momentum,
        "energy": (after + elastic_energy(sim, "block")) / kinetic,
        "steps": float(sim.steps),
    }


# Bar against a wall ------------------------------------------------------------------------------


def bar_impact(
    edge: float = 0.5, dx: float = 0.01, dimension: int = 2, law: str = "NeoHookean",
    precision: str = "double", transfer: Any = None,
) -> Numbers:  # fmt: skip
    """Return force and speed after impact of a bar, over v A √(ρE) and the speed before."""
    long, high, modulus, density, speed, d = 0.5, 0.1, 1e6, 1000.0, 1.0, dimension
    wave = math.sqrt(modulus / density)
    wide = max(16 * dx, 0.16)
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0,) * d,
        upper=(round(0.7 / dx) * dx, wide, wide)[:d],
        method=libmpm.Method(cfl=0.3) if transfer is None
        else libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    low = np.array([2 * dx, wide / 2 - high / 2, wide / 2 - high / 2][:d])
    top = low + np.array([long, high, high][:d])
    scene.add_body(
        name="bar", shape=mesh_of(low, top, edge * dx),
        material=solid(law, density, modulus, 0.0), velocity=(-speed, 0, 0)[:d],
    )  # fmt: skip
    scene.add_boundary(name="wall", shape=shapes.DomainWalls(faces=("x-",)),
                       response=boundaries.Separable())  # fmt: skip
    step = dx / wave
    scene.add_sensor(name="force", sensor=sensors.LoadCell(boundary="wall", interval=2 * step))
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    lasts = 2 * long / wave
    sim.run(until=2 * dx / speed + 1.6 * lasts, progress=False)
    area = high ** (d - 1)
    expected = speed * area * wave * density
    series = sim.sensors["force"]
    column = list(series.components).index("force_x")
    force, time = np.abs(series.values[:, column]), series.time
    begun = float(time[np.argmax(force > 0.5 * expected)])
    middle = (time > begun + 0.25 * lasts) & (time < begun + 0.75 * lasts)
    body = sim.particles["bar"].read(["mass", "velocity"])
    after = float((body["mass"] * body["velocity"][:, 0]).sum() / body["mass"].sum())
    loaded = time[force > 0.5 * expected]
    return {
        "force": float(force[middle].mean() / expected),
        "rebound": after / speed,
        "duration": float((loaded[-1] - begun) / lasts),
    }


# Cantilevers -------------------------------------------------------------------------------------


def timoshenko(long: float, high: float, modulus: float, ratio: float, density: float,
               plane: bool) -> float:  # fmt: skip
    """Return the first frequency of a cantilever, Hz, with shear and rotary inertia."""
    stiff = modulus / (1 - ratio * ratio) if plane else modulus
    square = high * high / 12
    thin = BETA**2 / (2 * math.pi) * math.sqrt(stiff * square / (density * long**4))
    shear = modulus / (2 * (1 + ratio))
    return thin / math.sqrt(1 + MODE * square / long**2 * (1 + stiff / (SHEAR * shear)))


def cantilever_scene(
    edge: float, cells: int, dimension: int, ratio: float, volumes: str | None, law: str,
    place: float = 0.2, gravity: Any = None, pattern: str = "alternating", tractions: Any = (),
    **method: Any,
) -> tuple[libmpm.Scene, float]:  # fmt: skip
    """Return a beam 1 × 0.1 m, held two cells deep by the nodes of a region, and where it ends."""
    long, high, d = 1.0, 0.1, dimension
    dx = high / cells
    held = 8 * dx
    room = (math.ceil(1.4 * long / dx) + 12, math.ceil(0.6 * long / dx) + 16, cells + 12)[:d]
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0,) * d, upper=[n * dx for n in room],
        method=libmpm.Method(**({"cfl": 0.3} | method)), gravity=gravity,
    )  # fmt: skip
    low = np.array([held - 2 * dx, room[1] * dx / 2 - high / 2 + place * dx, (6 + place) * dx][:d])
    top = np.array([held + long, low[1] + high, (6 + place) * dx + high][:d])
    scene.add_body(
        name="beam", shape=mesh_of(low, top, edge * dx, pattern, volumes),
        material=solid(law, 1000.0, 1e6, ratio), tractions=tractions,
    )  # fmt: skip
    block = shapes.Box(lower=(0,) * d, upper=[held, *(n * dx for n in room[1:])])
    scene.add_boundary(
        name="clamp", shape=block, response=boundaries.Prescribed(), motion=at_rest(d)
    )
    return scene, held


def vibration(
    edge: float = 0.5, cells: int = 4, dimension: int = 2, ratio: float = 0.3,
    volumes: str | None = None, law: str = "NeoHookean", cycles: float = 4.0,
    precision: str = "double", place: float = 0.2, pattern: str = "alternating", **method: Any,
) -> Numbers:  # fmt: skip
    """Return the frequency of a cantilever over Timoshenko's, and what a cycle leaves of it.

    It starts with speeds in the shape of its static deflection, 0.05 m/s at the tip. In space the
    section is square, and the beam's modulus that of the bar.
    """
    scene, held = cantilever_scene(
        edge, cells, dimension, ratio, volumes, law, place, None, pattern, **method
    )
    long, fast = 1.0, 0.05
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    beam = sim.particles["beam"]
    position = beam["position"]
    along = np.maximum(0.0, (position[:, 0] - held) / long)
    velocity = np.zeros_like(position)
    velocity[:, 1] = fast * along**2 * (3 - along) / 2
    slope = np.zeros((len(position), dimension, dimension))
    slope[:, 1, 0] = fast * (3 * along - 1.5 * along**2) / long
    beam["velocity"], beam["velocity_gradient"] = velocity, slope
    expected = timoshenko(long, 0.1, 1e6, ratio, 1000.0, dimension == 2)
    tip = position[:, 0] > position[:, 0].max() - 1e-6
    rest = float(position[tip, 1].mean())
    time, moved = [0.0], [0.0]
    period = 1 / expected
    while time[-1] < cycles * period:
        sim.run(until=(len(time)) * period / _LOOKS, progress=False)
        time.append(sim.time)
        moved.append(float(beam["position"][tip, 1].mean()) - rest)
    return of_wave(np.array(time), np.array(moved), expected)


def of_wave(time: Array, moved: Array, expected: float) -> Numbers:
    """Return the frequency by upward crossings, and the decay of peaks between them."""
    up = np.flatnonzero((moved[:-1] < 0) & (moved[1:] >= 0))
    share = -moved[up] / (moved[up + 1] - moved[up])
    zeros = time[up] + share * (time[up + 1] - time[up])
    peaks = [float(np.abs(moved[a:b]).max()) for a, b in itertools.pairwise(up)]
    found = {"frequency": float((len(zeros) - 1) / (zeros[-1] - zeros[0])) / expected}
    if len(peaks) > 1:
        found["kept_per_cycle"] = (peaks[-1] / peaks[0]) ** (1 / (len(peaks) - 1))
    return found


def static_tip(
    edge: float = 0.5, cells: int = 4, ratio: float = 0.3, volumes: str | None = None,
    law: str = "NeoHookean", precision: str = "double", pull: float = 0.05,
) -> Numbers:  # fmt: skip
    """Return how far the tip of a cantilever sinks under its weight, over theory with shear.

    Gravity grows over four periods as half a cosine and stays for two, over whose whole number
    what is left of the oscillation averages out. Plane strain.
    """
    long, high, modulus, density = 1.0, 0.1, 1e6, 1000.0
    period = 1 / timoshenko(long, high, modulus, ratio, density, True)
    grows = 4 * period
    time = np.linspace(0, grows, 65)
    strength = 0.5 * pull * (1 - np.cos(math.pi * time / grows))
    gravity = libmpm.TimeTable(time.tolist(), [[0.0, -g] for g in strength.tolist()], end="hold")
    scene, _ = cantilever_scene(edge, cells, 2, ratio, volumes, law, 0.2, gravity)
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    beam = sim.particles["beam"]
    position = beam["position"]
    tip = position[:, 0] > position[:, 0].max() - 1e-6
    rest = float(position[tip, 1].mean())
    sim.run(until=grows, progress=False)
    moved = []
    for k in range(1, 41):
        sim.run(until=grows + k * period / 20, progress=False)
        moved.append(float(beam["position"][tip, 1].mean()) - rest)
    stiff = modulus / (1 - ratio**2)
    shear = modulus / (2 * (1 + ratio))
    load = density * pull * high
    expected = load * long**4 / (8 * stiff * high**3 / 12) + load * long**2 / (
        2 * SHEAR * high * shear
    )
    return {"tip": -float(np.mean(moved)) / expected}


# Cook's membrane ---------------------------------------------------------------------------------


def cook(
    cells: int = 16, edge: float = 1.0, ratio: float = 0.3, volumes: str | None = None,
    pattern: str = "alternating", law: str = "NeoHookean", share: float = 1e-3,
) -> Numbers:  # fmt: skip
    """Return how far the middle of the loaded side of Cook's membrane rises, E = F = 1.

    Corners (0, 0), (48, 44), (48, 60), (0, 44), plane strain; the left side is held, and lies on
    the last nodes that are: half a cell before the face of the region. The right one is loaded
    upwards. Cells are 48 / `cells`, elements `edge` of these along x. The load is a `share` of F,
    so that strains are small, ramped over four periods and averaged over two.
    """
    dx = 48.0 / cells
    columns, rows = round(cells / edge), max(2, round(44 / (edge * dx)))
    square = shapes.Triangles.box(
        lower=(0, 0),
        upper=(columns, rows),
        edge=1.0,
        pattern=pattern,  # type: ignore[arg-type]
    )
    deep = 2 * dx
    x = square.vertices[:, 0] / columns
    y = square.vertices[:, 1] / rows
    places = np.column_stack([48 * x, 44 * x + y * (44 - 28 * x)])
    # What is held reaches two cells further to the left.
    further = round(2 / edge)
    strip = np.column_stack([
        np.repeat(np.arange(-further, 0) * edge * dx, rows + 1),
        np.tile(np.linspace(0, 44, rows + 1), further),
    ])  # fmt: skip
    whole = shapes.Triangles.box(
        lower=(0, 0), upper=(columns + further, rows), edge=1.0, pattern=pattern,  # type: ignore[arg-type]
    )  # fmt: skip
    points = np.concatenate([strip, places]) + np.array([5.5 * dx, 4 * dx])
    mesh = shapes.Triangles(vertices=points, elements=whole.elements, volumes=volumes)  # type: ignore[arg-type]
    density = 1.0
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0),
        upper=((cells + 12) * dx, (math.ceil(70 / dx) + 10) * dx), method=libmpm.Method(cfl=0.4),
    )  # fmt: skip
    scene.add_body(name="plate", shape=mesh, material=solid(law, density, 1.0, ratio))
    block = shapes.Box(lower=(0, 0), upper=(6 * dx, scene.upper[1]))
    scene.add_boundary(
        name="clamp", shape=block, response=boundaries.Prescribed(), motion=at_rest(2)
    )
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    plate = sim.particles["plate"]
    position, mass = plate["position"], plate["mass"]
    side = position[:, 0] > position[:, 0].max() - 1e-6
    order = np.argsort(position[side, 1])
    height = position[side, 1][order]
    weight = np.zeros(len(height))
    weight[:-1] += 0.5 * np.diff(height)
    weight[1:] += 0.5 * np.diff(height)
    load = np.zeros(len(position))
    load[np.flatnonzero(side)[order]] = share * weight / weight.sum()
    period = 600.0  # of the first mode, about 2 π √(ρ A w / F)
    grows = 4 * period

    def force(arrays: Any) -> Array:
        ramp = 0.5 * (1 - math.cos(math.pi * min(1.0, arrays.time / grows)))
        found = np.zeros((len(load), 2))
        found[:, 1] = ramp * load / mass
        return found

    sim.add_force("load", "plate", force, interval=period / 600)
    middle = np.flatnonzero(side)[order][len(height) // 2]
    rest = position[middle, 1]
    sim.run(until=grows, progress=False)
    risen = []
    for k in range(1, 41):
        sim.run(until=grows + k * period / 20, progress=False)
        risen.append(float(plate["position"][middle, 1] - rest))
    return {"lift": float(np.mean(risen)) / share, "deep": deep}


# Bits --------------------------------------------------------------------------------------------


def small_scene(dimension: int = 2, **body: Any) -> libmpm.Scene:
    """Return a soft block that flies into a corner, beside one of particles."""
    d, dx = dimension, 0.1
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0,) * d, upper=(2.0, 1.0, 1.0)[:d],
        gravity=(0,) * (d - 1) + (-9.81,),
    )  # fmt: skip
    low, high = np.array((0.2, 0.15, 0.15)[:d]), np.array((0.8, 0.45, 0.45)[:d])
    scene.add_body(**({
        "name": "block", "shape": mesh_of(low, high, 0.5 * dx),
        "material": solid("NeoHookean", 1000.0, 1e5, 0.3), "velocity": (-2.0, 0, 0)[:d],
    } | body))  # fmt: skip
    scene.add_body(
        name="other", shape=shapes.Box(lower=(1.2, 0.1, 0.1)[:d], upper=(1.6, 0.5, 0.5)[:d]),
        material=solid("FixedCorotated", 1000.0, 1e5, 0.3), velocity=(-1.0, 0, 0)[:d],
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    return scene


def after(scene: libmpm.Scene, steps: int, **options: Any) -> dict[str, Array]:
    """Return positions and velocities of all bodies after so many steps."""
    sim = libmpm.Simulation(scene, device="cpu", **options)
    sim.step(steps)
    return state_of(sim)


def state_of(sim: Any) -> dict[str, Array]:
    """Return positions and velocities of all bodies, and what elements hold."""
    found = {}
    for name, body in sim.particles.items():
        names = ["position", "velocity"]
        names += [n for n in body.names if n.startswith("element_")]
        found |= {f"{name}/{key}": array for key, array in body.read(names).items()}
    return found


Case = Callable[..., Numbers]
