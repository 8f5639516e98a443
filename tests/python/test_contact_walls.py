"""Bodies that touch beside walls with linear cells: each field of velocities follows its own lines.

Closed forms and balances of momentum; on ranks: test_contact_ranks.py. Expected duration: 30 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes
from support import contact_scenes as cases
from support.contact_scenes import Runner
from support.devices import device  # noqa: F401
from support.uplift_scenes import HALF, HIGH, afloat, loads, tank

GRAVITY, WATER = 9.81, 1000.0


@pytest.fixture
def run(device: str) -> Runner:
    """Return what makes a simulation on a device, in double precision on one thread unless said."""

    def made(scene: libmpm.Scene, **options: Any) -> libmpm.Simulation:
        given = {"precision": "double", "threads": 1} | options
        return libmpm.Simulation(scene, device=device, **given)

    return made


def response(cell: str, separable: bool = True, **rub: float) -> boundaries.Response:
    kind = boundaries.Separable if separable else boundaries.Slip
    return kind(cell=cell, **rub)  # type: ignore[arg-type]


def pushed_water(cell: str, block: float | None) -> libmpm.Scene:
    """Return water 8 cells deep that a piston drives as a bore, with a block that floats on it.

    `block`: distance of its side from the piston, m.
    """
    dx, speed, start = 1 / 8, 0.1 * np.sqrt(GRAVITY), 1.0
    time = np.linspace(0.0, 3.0, 301)
    rise = np.clip(time * np.sqrt(GRAVITY) / 2, 0, 1)
    velocity = speed * rise**2 * (3 - 2 * rise)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    path = libmpm.TimeTable(time=tuple(time), value=tuple((x, 0.0) for x in way), end="hold")
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(8.0, 2.0), gravity=(0, -GRAVITY),
        method=libmpm.Method(cfl=0.3, transfer="APIC", leaving="delete"),
    )  # fmt: skip
    sea: shapes.Shape = shapes.Box(lower=(start, 0.0), upper=(8.0, 1.0))
    if block is not None:
        place = start + block
        hull = shapes.Box(lower=(place, 0.5), upper=(place + 0.5, 1.5))
        sea = shapes.Difference(whole=sea, without=hull)
        scene.add_body(name="block", shape=hull, material=cases.solid(1e6, 0.3, 0.5 * WATER))
        scene.add_contact(name="wet", between=("block", "water"), law=contacts.Fluid())
    scene.add_body(
        name="water", shape=sea, hydrostatic=1.0,
        material=materials.TaitFluid(bulk_modulus=200 * WATER * GRAVITY, viscosity=0.0),
    )  # fmt: skip
    slip = response(cell, separable=False)
    walls = shapes.DomainWalls(faces=("x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=slip)
    scene.add_boundary(
        name="piston", shape=shapes.Box(lower=(-3.0, -1.0), upper=(start, 3.0)), response=slip,
        motion=boundaries.Displacement(path),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="piston", interval=0.01))
    return scene


def thrust(run: Runner, scene: libmpm.Scene) -> float:
    """Return the mean force on the piston of a bore that has formed, of ½ ρ g h₂²."""
    speed, low, high = 0.1 * np.sqrt(GRAVITY), 1.0, 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        found = (middle - 1) * np.sqrt(GRAVITY / 2 * (1 + 1 / middle))
        low, high = (middle, high) if found < speed else (low, middle)
    simulation = run(scene, precision="single")
    simulation.run(until=2.25, progress=False)
    load = simulation.sensors["load"]
    late = np.asarray(load.time) > 1.5
    return float(-np.asarray(load["force_x"])[late].mean() / (0.5 * WATER * GRAVITY * low**2))


def test_the_load_of_a_bore_is_that_without_contact(run: Runner) -> None:
    """Far off, a block that floats changes nothing of what linear cells are for."""
    assert abs(thrust(run, pushed_water("linear", None)) - 1) < 0.02
    assert abs(thrust(run, pushed_water("linear", 4.0)) - 1) < 0.02
    assert thrust(run, pushed_water("held", 4.0)) > 1.2


def test_a_floating_block_before_the_piston_carries_its_part(run: Runner) -> None:
    """In still water what floats presses on a wall beside it as the water that it stands for."""
    assert abs(thrust(run, pushed_water("linear", 0.0)) - 1) < 0.06


def thrown(law: contacts.ContactLaw) -> libmpm.Scene:
    """Return a block that flies against one that stands before a wall, and a drop beside them.

    Velocities are stored by particles, so that their momentum stands at the step of the impulse.
    """
    method = libmpm.Method(transfer=libmpm.methods.Transfer(scheme="AFLIP", flip=0.95))
    scene = libmpm.Scene(dimension=2, cell_size=1 / 16, lower=(0, 0), upper=(3, 2), method=method)
    scene.add_body(
        name="stands", shape=shapes.Box(lower=(2.5, 0.75), upper=(3.0, 1.25)),
        material=cases.solid(1e6, 0.3),
    )  # fmt: skip
    scene.add_body(
        name="flies", shape=shapes.Box(lower=(1.9, 0.8), upper=(2.4, 1.4)),
        material=cases.solid(1e6, 0.3), velocity=(2.0, -0.3),
    )  # fmt: skip
    scene.add_body(
        name="drop", shape=shapes.Box(lower=(2.5, 0.25), upper=(3.0, 0.75)),
        material=materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    scene.add_boundary(
        name="wall", shape=shapes.DomainWalls(faces=("x+",)),
        response=response("linear", static_friction=0.3, dynamic_friction=0.2),
    )  # fmt: skip
    sticks = isinstance(law, contacts.Stick)
    scene.add_contact(name="blow", between=("stands", "flies"), law=law)
    scene.add_contact(name="wet", between=("drop", "*"), law=law if sticks else contacts.Fluid())
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="wall", interval=1e-3))
    return scene


@pytest.mark.parametrize("law", [contacts.Friction(static=0.3), contacts.Stick()], ids=str)
def test_momentum_goes_to_the_wall_and_nowhere_else(run: Runner, law: contacts.ContactLaw) -> None:
    simulation = run(thrown(law))

    def momentum() -> Any:
        found: Any = 0.0
        for name in ("stands", "flies", "drop"):
            p = simulation.particles[name]
            found = found + np.asarray(p["mass"]) @ np.asarray(p["velocity"])
        return found

    start = momentum()
    simulation.run(until=0.08, progress=False)
    assert simulation.engine.statistics()["contact_blocks"] > 0
    load = simulation.sensors["load"]
    assert load.time[-1] == simulation.time
    length = np.diff(np.concatenate([[0.0], np.asarray(load.time)]))
    given = length @ np.asarray(load.values)[:, :2]
    assert given[0] > 0.5 * start[0]  # the blow has come through
    np.testing.assert_allclose(start - momentum(), given, rtol=0, atol=1e-11 * np.abs(start).max())


def test_blocks_on_a_linear_floor_stand_and_weigh_what_they_weigh(run: Runner) -> None:
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1 / 6, lower=(0, 0), upper=(0.5, 0.4), gravity=(0, -GRAVITY)
    )
    for k in range(2):
        scene.add_body(
            name=f"block {k}", material=cases.solid(1e6, 0.3),
            shape=shapes.Box(lower=(0.05, 0.1 * k), upper=(0.15, 0.1 * (k + 1))),
        )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.25, 0.0), upper=(0.5, 0.1)), hydrostatic=0.1,
        material=materials.TaitFluid(bulk_modulus=1e5),
    )  # fmt: skip
    scene.add_boundary(
        name="dam",
        shape=shapes.Box(lower=(0.2, 0.0), upper=(0.25, 0.4)),
        response=response("linear"),
    )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(),
        response=response("linear", static_friction=0.5, dynamic_friction=0.5),
    )  # fmt: skip
    scene.add_contact(name="pile", between=("block*", "block*"), law=contacts.Friction(static=0.5))
    scene.add_contact(name="wet", between=("block*", "water"), law=contacts.Fluid())
    scene.add_sensor(
        name="scale", sensor=sensors.LoadCell(boundary="walls", faces=("y-",), interval=1e-3)
    )
    simulation = run(scene)
    simulation.run(until=0.6, progress=False)
    low, high = (cases.mean(simulation, f"block {k}", "position") for k in range(2))
    dx = 0.1 / 6
    assert abs(high[1] - low[1] - 0.1) < 0.05 * dx
    assert abs(high[0] - low[0]) < 0.05 * dx
    load = simulation.sensors["scale"]
    late = np.asarray(load.time) > 0.3
    weight = (2 * 0.01 * cases.DENSITY + 0.025 * WATER) * GRAVITY
    assert abs(-np.asarray(load["force_y"])[late].mean() / weight - 1) < 0.01


def dam_on_bars(cell: str, rows: int = 8) -> libmpm.Scene:
    """Return a column of water that falls against bars of 3 cells, so many high."""
    dx, length = 1 / 30, 0.3
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(4, 2), gravity=(0, -GRAVITY)
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(2, 1)), hydrostatic=1.0,
        material=materials.TaitFluid(bulk_modulus=2e6),
    )  # fmt: skip
    for row in range(rows):
        bar = shapes.Box(lower=(3, 3 * dx * row), upper=(3 + length, 3 * dx * (row + 1)))
        scene.add_body(name=f"bar {row}", shape=bar, material=cases.solid(1e6, 0.3, 700.0))
    walls = response(cell, static_friction=0.3, dynamic_friction=0.3)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    scene.add_contact(name="rub", between=("bar*", "bar*"), law=contacts.Friction(static=0.4))
    scene.add_contact(name="wet", between=("bar*", "water"), law=contacts.Fluid())
    return scene


def test_solids_are_held_where_water_has_linear_cells(run: Runner) -> None:
    """Before they meet bars are those of held walls, to rounding, and water that of linear ones."""
    found = {}
    for cell in ("auto", "held", "linear"):
        scene = dam_on_bars(cell, rows=2)
        simulation = run(scene)
        simulation.run(until=0.05, progress=False)
        found[cell] = {
            name: np.array(simulation.particles[name]["position"]) for name in ("bar 0", "water")
        }

    def apart(one: str, other: str, name: str) -> float:
        return float(np.abs(found[one][name] - found[other][name]).max())

    assert apart("auto", "held", "bar 0") < 1e-12 < 1e-6 < apart("auto", "linear", "bar 0")
    assert apart("auto", "linear", "water") < 1e-12


def test_bars_eight_high_are_not_sheared_by_the_floor(run: Runner) -> None:
    """Elastic energy settles: linear cells fed the lowest bar until the guard ended such runs."""
    scene = dam_on_bars("auto")
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.05))
    simulation = run(scene, precision="single", threads=0)
    simulation.run(until=4.0, progress=False)
    off = [np.abs(simulation.particles[f"bar {row}"]["volume_ratio"] - 1).max() for row in range(8)]
    assert max(off) < 0.2


@pytest.mark.parametrize(
    ("degrees", "left", "density", "rub"),
    [(1.0, -0.25, 2500.0, 0.0), (10.0, -0.25, 500.0, 0.0), (30.0, -0.25, 2500.0, 0.5),
     (40.0, -0.5, 1200.0, 0.0)],
)  # fmt: skip
def test_a_block_under_water_on_a_slope_gains_no_energy(
    run: Runner, degrees: float, left: float, density: float, rub: float
) -> None:
    """Lines that move as one along the slope shear it, and threw it off (`design/contact.md`)."""
    dx, rise, side = 1 / 16, float(np.tan(np.deg2rad(degrees))), 0.25
    lower, upper = (-1.0, -8 * dx), (1.0, 1 + 4 * dx)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=lower, upper=upper, gravity=(0.0, -GRAVITY)
    )
    bed = shapes.HalfSpace(point=(0.0, 0.2), normal=(-rise, 1.0))
    foot = 0.2 + rise * (left + side)
    block = shapes.Box(lower=(left, foot), upper=(left + side, foot + side))
    tank = shapes.basin(level=0.9, bed=bed, within=shapes.Box(lower=lower, upper=upper))
    scene.add_body(
        name="water", shape=tank - block, hydrostatic=0.9, sampling=shapes.Columns(),
        material=materials.TaitFluid(density=WATER, bulk_modulus=2e6),
    )  # fmt: skip
    scene.add_body(
        name="block", shape=block, particles_per_cell=4,
        material=materials.FixedCorotated(density=density, youngs_modulus=2e6, poissons_ratio=0.3),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_boundary(name="bed", shape=bed, response=response("auto", rub > 0, **_rubs(rub)))
    scene.add_contact(name="wet", between=("block", "water"), law=contacts.Fluid())
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.05))
    sim = run(scene)
    sim.run(until=1.4, progress=False)
    energy = sim.sensors["energy"]
    at = {name: energy.values[:, k] for k, name in enumerate(energy.components)}
    # What falls gives; waves of the start's jolt carry 5 J/m between the parts.
    every = at["kinetic"] + at["elastic"] + at["potential"]
    assert every.max() - every[0] < 8.0
    assert at["elastic"].max() < 30.0


def _rubs(friction: float) -> dict[str, float]:
    return {"static_friction": friction, "dynamic_friction": friction} if friction else {}


BEDS: dict[str, dict[str, Any]] = {
    "held box": {},
    "linear box": {"response": boundaries.Separable()},
    "surface, a quarter of a cell above a face": {"surface": 0.25},
    "surface, seven tenths": {"surface": 0.7},
}


@pytest.mark.parametrize("bed", BEDS)
@pytest.mark.parametrize(
    ("dimension", "cell", "off"),
    [(2, 0.025, 0.025), (2, 0.0125, 0.0125), (2, 0.00625, 0.00625), (2, 0.0125, 0.006),
     (3, 0.0125, 0.0125)],
)  # fmt: skip
def test_a_bed_does_not_touch_what_floats_above_it(
    device: str, dimension: int, cell: float, off: float, bed: str
) -> None:
    scene = afloat(cell, off=off, dimension=dimension, **BEDS[bed])
    sim = libmpm.Simulation(scene, device=device, threads=1)
    rest = sim.particles["debris-1"]["position"][:, -1].mean()
    sim.run(until=0.2, progress=False)
    weight = 648 * GRAVITY * HIGH * (2 * HALF) ** (dimension - 1)
    along, _ = loads(sim, "bed-friction", 0.02)
    assert abs(along) < 0.03 * 0.7 * weight
    end = sim.particles["debris-1"]
    assert end["velocity"][:, 0].mean() > 0.95
    # What pushes in place of a gap, contact where both fill a node by 0.7, asks for more than two
    # cells in height.
    assert abs(end["position"][:, -1].mean() - rest) < (0.2 if cell < 0.02 else 0.35) * cell


@pytest.mark.parametrize("uplift", [False, True])
@pytest.mark.parametrize("place", [0.2, 0.3])
def test_what_is_nearly_as_heavy_as_water_stays_on_a_surface_off_faces(
    device: str, place: float, uplift: bool
) -> None:
    cell = 0.0125
    scene = tank(cell, density=987.0, contact=True, surface=place, uplift=uplift)
    sim = libmpm.Simulation(scene, device=device, threads=1)
    rest = sim.particles["debris-1"]["position"][:, -1].mean()
    sim.run(until=1.0, progress=False)
    assert abs(sim.particles["debris-1"]["position"][:, -1].mean() - rest) < 0.05 * cell
