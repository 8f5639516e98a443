"""Scenes of bodies that touch, with answers that are known, and what is read of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import libmpm
from libmpm import boundaries, contacts, materials, shapes

Numbers = NDArray[np.float64]

#: Makes a simulation of a scene on the device of a test.
Runner = Callable[..., libmpm.Simulation]

DENSITY = 1000.0


def solid(
    youngs_modulus: float = 1e6, poissons_ratio: float = 0.3, density: float = DENSITY
) -> Any:
    """Return the material of the blocks."""
    return materials.NeoHookean(
        density=density, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio
    )


def sound_speed(youngs_modulus: float, poissons_ratio: float, density: float = DENSITY) -> float:
    """Return the speed of pressure waves, m/s."""
    e, nu = youngs_modulus, poissons_ratio
    return math.sqrt(e * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / density)


def mean(simulation: libmpm.Simulation, body: str, attribute: str) -> Numbers:
    """Return the mean of an attribute over a body's particles, which weigh the same."""
    found: Numbers = np.asarray(simulation.particles[body][attribute], dtype=np.float64)
    return np.asarray(found.mean(axis=0))


def by_id(simulation: libmpm.Simulation, body: str, attribute: str) -> Numbers:
    """Return an attribute of a body's particles in the order of their ids."""
    particles = simulation.particles[body]
    return np.asarray(particles[attribute])[np.argsort(np.asarray(particles["id"]))]


def each_step(
    simulation: libmpm.Simulation, until: float, see: Callable[[libmpm.Simulation], bool | None]
) -> None:
    """Call `see` after each step; it may end the run."""
    while simulation.time < until:
        simulation.step(1)
        if see(simulation):
            return


def approaching(offset: float, degrees: float, speed: float, gap: float) -> libmpm.Scene:
    """Return two blocks of 16 × 8 cells that come together, their faces turned and shifted.

    `offset` and `gap` in cells, `speed` in m/s, of each half the approach.
    """
    n, dx = 16, 1 / 16
    turn = math.radians(degrees)
    along = np.array([-math.sin(turn), math.cos(turn)])
    middle = np.array([1.5, 1.5]) + offset * dx * np.array([0.0, 1.0])
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(3, 3))
    for name, side in (("low", -1.0), ("high", 1.0)):
        half = np.array([n * dx / 2, n * dx / 4])
        centre = middle + side * along * (half[1] + gap * dx / 2)
        if degrees == 0:
            shape: Any = shapes.Box(lower=centre - half, upper=centre + half)
        else:
            shape = shapes.OrientedBox(centre=tuple(centre), size=tuple(2 * half), angle=degrees)
        scene.add_body(
            name=name, shape=shape, material=solid(1e6, 0.0),
            velocity=tuple(-side * 0.5 * speed * along),
        )  # fmt: skip
    scene.add_contact(name="faces", between=("low", "high"), law=contacts.Friction())
    return scene


def slope(dimension: int, friction: float, cells: int = 12, degrees: float = 30.0) -> libmpm.Scene:
    """Return a block on a slab that is held below, under gravity that turns by the slope.

    Gravity first presses the block on, then has its part along the slope too.
    """
    dx, g, angle = 1 / cells, 10.0, math.radians(degrees)
    d = dimension
    high, depth = cells // 2, 0.5  # across the slope
    lower = (0.0,) * d
    pull = [0.0] * d
    pull[-1] = -g * math.cos(angle)
    along = list(pull)
    along[0] = -g * math.sin(angle)
    upper = (3.0, *(depth,) * (d - 2), 1.5)
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=lower, upper=upper,
        gravity=libmpm.TimeTable(
            time=[0.0, 0.3, 0.5, 0.501, 10.0],
            value=[[0.0] * d, [1.1 * p for p in pull], pull, along, along],
        ),
    )  # fmt: skip
    floor = high * dx
    side = (depth,) * (d - 2)
    scene.add_body(
        name="slab", shape=shapes.Box(lower=lower, upper=(3.0, *side, floor)), material=solid(),
    )  # fmt: skip
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(1.5, *lower[1:-1], floor), upper=(2.5, *side, floor + high * dx)),
        material=solid(),
    )
    response: dict[str, Any] = {f"{'xyz'[d - 1]}-": boundaries.Sticky()}
    for axis in "xyz"[: d - 1]:
        response |= {f"{axis}-": boundaries.Slip(), f"{axis}+": boundaries.Slip()}
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=tuple(response)),
        response=response,
    )
    scene.add_contact(
        name="sole", between=("block", "slab"), law=contacts.Friction(static=friction)
    )
    return scene


def acceleration(scene: libmpm.Scene, start: float, until: float, **options: Any) -> float:
    """Return the acceleration of the block down the slope by a line through its velocities."""
    simulation = libmpm.Simulation(scene, **({"device": "cpu"} | options))
    simulation.run(until=start)
    times, speeds = [], []

    def see(s: libmpm.Simulation) -> None:
        times.append(s.time)
        speeds.append(-mean(s, "block", "velocity")[0])

    each_step(simulation, until, see)
    return float(np.polyfit(times, speeds, 1)[0])


def discs(radius: float, speed: float, impact: float = 0.0, friction: float = 0.0) -> libmpm.Scene:
    """Return two discs of `radius` cells that meet head on, each at `speed` m/s.

    `impact`: distance between the lines of their centres, parts of 2 R.
    """
    dx, r = 0.01, radius * 0.01
    centre = 2.6 * r
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0),
        upper=(dx * math.ceil(5.2 * radius), dx * math.ceil(5.2 * radius)),
    )  # fmt: skip
    apart = 2 * r * math.sqrt(1 - impact**2) + dx
    for name, side in (("left", -1.0), ("right", 1.0)):
        scene.add_body(
            name=name,
            shape=shapes.Sphere(centre=(centre + side * apart / 2, centre + side * impact * r),
                                radius=r),
            material=solid(),
            velocity=(-side * speed, 0.0),
            particles_per_cell=9,
        )  # fmt: skip
    scene.add_contact(
        name="discs", between=("left", "right"), law=contacts.Friction(static=friction)
    )
    return scene


def stack(size: int = 6, count: int = 3) -> libmpm.Scene:
    """Return blocks on each other, on a floor with friction."""
    dx = 0.1 / size
    wide = 3 * size
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(dx * wide, dx * (size * count + 6)),
        gravity=(0, -9.81),
    )  # fmt: skip
    for k in range(count):
        scene.add_body(
            name=f"block {k}",
            shape=shapes.Box(lower=(0.1, 0.1 * k), upper=(0.2, 0.1 * (k + 1))),
            material=solid(1e6, 0.3),
        )
    scene.add_boundary(
        name="floor",
        shape=shapes.DomainWalls(faces=["y-"]),
        response=boundaries.Separable(static_friction=0.5, dynamic_friction=0.5),
    )
    scene.add_contact(
        name="stack", between=("block *", "block *"), law=contacts.Friction(static=0.5)
    )
    return scene


THICK, HIGH, PITCH = 0.006, 0.048, 0.030


def dominoes(
    count: int, cells: int = 3, friction: float = 0.3, floor: float = 0.3, modulus: float = 3e6
) -> libmpm.Scene:
    """Return a row of dominoes, of which the first tips over; van Leeuwen (2004) for the measures.

    The rate of the first is that of a rigid one as it falls in a row.
    """
    dx = THICK / cells
    first = 0.018
    width = first + (count - 1) * PITCH + 1.3 * HIGH + 0.012
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0),
        upper=(dx * math.ceil(width / dx), dx * math.ceil(1.3 * HIGH / dx)), gravity=(0, -9.81),
    )  # fmt: skip
    start, spin = math.radians(12), 20.8
    for k in range(count):
        angle = start if k == 0 else 0.0
        edge = np.array([first + k * PITCH, 0.0])
        up, across = (np.array([math.sin(angle), math.cos(angle)]),
                      np.array([math.cos(angle), -math.sin(angle)]))  # fmt: skip
        centre = edge + up * HIGH / 2 - across * THICK / 2
        half = np.array([THICK, HIGH]) / 2
        shape: Any = shapes.Box(lower=centre - half, upper=centre + half)
        velocity: Any = (0.0, 0.0)
        if k == 0:
            shape = shapes.OrientedBox(
                centre=tuple(centre), size=(THICK, HIGH), angle=-math.degrees(angle)
            )
            velocity = libmpm.Field(
                components=(f"{spin} * y", f"-{spin} * (x - {float(edge[0])!r})")
            )
        scene.add_body(
            name=f"domino {k:02d}", shape=shape, velocity=velocity,
            material=solid(modulus, 0.3, 1400.0),
        )  # fmt: skip
    scene.add_boundary(
        name="floor",
        shape=shapes.DomainWalls(faces=["y-", "x-", "x+"]),
        response=boundaries.Separable(static_friction=floor, dynamic_friction=floor),
    )
    scene.add_contact(
        name="tips", between=("domino*", "domino*"), law=contacts.Friction(static=friction)
    )
    return scene


def pile() -> libmpm.Scene:
    """Return twenty soft discs of 5 cells that fall into a box, squeezed to half by the blow."""
    n, across, rows = 5, 5, 4
    dx, r = 1.0 / n, 1.0
    place = np.random.default_rng(7)
    size = (math.ceil((2.2 * across + 1) * n) * dx, math.ceil((2.2 * rows + 3) * n) * dx)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=size, gravity=(0, -10.0)
    )  # fmt: skip
    for j in range(rows):
        for i in range(across):
            shift = place.uniform(-0.1, 0.1, 2)
            centre = (1.15 + 2.2 * i + (0.5 if j % 2 else 0) + shift[0], 1.3 + 2.2 * j + shift[1])
            scene.add_body(
                name=f"disc {j * across + i:02d}",
                shape=shapes.Sphere(centre=centre, radius=r), material=solid(1e5, 0.3),
            )  # fmt: skip
    wall = boundaries.Separable(static_friction=0.3, dynamic_friction=0.3)
    scene.add_boundary(name="box", shape=shapes.DomainWalls(), response=wall)
    scene.add_contact(name="pile", between=("disc *", "disc *"), law=contacts.Friction(static=0.3))
    return scene


def tilt(simulation: libmpm.Simulation, body: str, upper: Numbers, lower: Numbers) -> float:
    """Return the angle of a domino by the means of its upper and lower quarter, rad."""
    place = by_id(simulation, body, "position")
    up = place[upper].mean(axis=0) - place[lower].mean(axis=0)
    return math.atan2(up[0], up[1])


def floating(density: float, cells: int = 8, cell: Any = "held") -> libmpm.Scene:
    """Return a block in water that is as deep as it floats."""
    dx = 0.1 / cells
    depth, side = 0.2, 0.1
    draught = density / 1000.0 * side
    wide = 3 * side
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(wide, depth + side), gravity=(0, -9.81)
    )
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(wide, depth)),
        material=materials.TaitFluid(bulk_modulus=1e5),
        hydrostatic=depth,
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(
            lower=(wide / 2 - side / 2, depth - draught),
            upper=(wide / 2 + side / 2, depth - draught + side),
        ),
        material=solid(1e5, 0.3, density),
        subtract_from=("water",),
    )
    walls = boundaries.Slip(cell=cell)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    scene.add_contact(name="wet", between=("block", "water"), law=contacts.Fluid())
    return scene
