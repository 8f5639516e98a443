"""Small scenes for tests, built with the public interface, and how to run them.

Their walls hold nodes by name, as the naive reference does and as what is derived for them in the
validation tests takes for granted (`design/walls.md`, 2); what walls do by default has tests of its
own (`test_wall_cells.py`, `test_linear_walls.py`, `test_walls_in_flow.py`).
"""

from __future__ import annotations

import math

import numpy as np

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.boundaries.wall_cells import with_held_cells

WATER = 1000.0  # kg/m³
GRAVITY = 9.81  # m/s²


def stiffness(depth, gravity=GRAVITY):
    """Bulk modulus with which the wave speed is ten times the speed of a fall over `depth`."""
    return WATER * 100 * 2 * gravity * depth


def held(scene):
    """The same scene with walls that hold nodes where it leaves that to libmpm."""
    return libmpm.Scene.from_dict(with_held_cells(scene.to_dict(), auto=True))


def bar(density, *, cell_size=0.01, scale=1.0, cfl=0.5, modulus=1e6, lower=(0.0, 0.0),
        origin=(0.0, 0.0)):  # fmt: skip
    """A bar of 0.5 x 0.1 m, ν = 0, two cells from the wall x- at 1 m/s, no gravity."""
    dx, length, height = cell_size * scale, 0.5 * scale, 0.1 * scale
    cells = (round(length / dx) + 12, round(height / dx) + 8)
    corner = tuple(a + 0.0 for a in lower)
    place = (corner[0] + 2 * dx, corner[1] + 4 * dx)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=corner, origin=origin, gravity=(0.0, 0.0),
        upper=tuple(a + n * dx for a, n in zip(corner, cells, strict=True)),
        method=libmpm.Method(cfl=cfl, transfer="APIC"),
    )  # fmt: skip
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=place, upper=(place[0] + length, place[1] + height)),
        material=materials.FixedCorotated(
            density=density, youngs_modulus=modulus, poissons_ratio=0.0
        ),
        particles_per_cell=9,
        velocity=(-1.0, 0.0),
    )
    scene.add_boundary(
        name="wall",
        shape=shapes.DomainWalls(faces=("x-",)),
        response=boundaries.Separable(cell="held"),
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="wall"))
    return scene


def tank(*, cells, cell_size, modulus, fbar="default", gravity=10.0, cfl=0.3, at_rest=False,
         viscosity=1e-3, interval=0.0, lower=(0.0, 0.0), origin=(0.0, 0.0),
         response=None):  # fmt: skip
    """Water over the whole width, `cells` = (width, depth) in cells, eight cells of air above."""
    dx = cell_size
    width, depth = (n * dx for n in cells)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=lower, origin=origin, gravity=(0.0, -gravity),
        upper=(lower[0] + width, lower[1] + depth + 8 * dx),
        method=libmpm.Method(cfl=cfl, transfer="APIC"),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=lower, upper=(lower[0] + width, lower[1] + depth)),
        material=materials.TaitFluid(density=WATER, bulk_modulus=modulus, viscosity=viscosity),
        particles_per_cell=4,
        fbar=fbar,
        hydrostatic=lower[1] + depth if at_rest else None,
    )
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response=response or boundaries.Separable(cell="held"),
    )
    scene.add_sensor(
        name="load", sensor=sensors.LoadCell(boundary="walls", faces=("x-",), interval=interval)
    )
    return scene


def floating(ratio, *, offset=0.0, cell_size=0.05, basin=(24, 12), block=(10, 6)):
    """A block of `ratio` times the density of water at its draft, released `offset` cells higher.

    Returns the scene and the height in cells at which the block comes to rest: the water that a
    higher block leaves below itself lifts the level by offset · block width / basin width.
    """
    dx = cell_size
    depth = basin[1] * dx
    left = (basin[0] - block[0]) / 2 * dx
    bottom = depth + (offset - ratio * block[1]) * dx
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), gravity=(0.0, -GRAVITY),
        upper=(basin[0] * dx, (basin[1] + block[1] + 4) * dx),
        method=libmpm.Method(cfl=0.3, transfer="APIC"),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(basin[0] * dx, depth)),
        material=materials.TaitFluid(density=WATER, bulk_modulus=stiffness(depth), viscosity=0.0),
        hydrostatic=depth,
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(
            lower=(left, bottom), upper=(left + block[0] * dx, bottom + block[1] * dx)
        ),
        material=materials.FixedCorotated(
            density=ratio * WATER, youngs_modulus=1e6, poissons_ratio=0.0
        ),
        subtract_from=("water",),
    )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces="all"), response=boundaries.Slip(cell="held")
    )
    return scene, offset * block[0] / basin[0]


def submerged(*, cell_size=0.05, basin=(32, 20), lower=(8, 5), upper=(24, 13), interval=0.0):
    """A fixed box under water; returns the scene and the weight of the water it displaces."""
    dx = cell_size
    depth = basin[1] * dx
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), gravity=(0.0, -GRAVITY),
        upper=(basin[0] * dx, (basin[1] + 4) * dx), method=libmpm.Method(cfl=0.3, transfer="APIC"),
    )  # fmt: skip
    box = shapes.Box(lower=tuple(i * dx for i in lower), upper=tuple(i * dx for i in upper))
    low, high = np.array(lower), np.array(upper)
    water = materials.TaitFluid(density=WATER, bulk_modulus=stiffness(depth), viscosity=0.0)
    # Four boxes of water around the box, each on the same lattice.
    pieces = {
        "below": ((0, 0), (basin[0], lower[1])),
        "left": ((0, lower[1]), (lower[0], upper[1])),
        "right": ((upper[0], lower[1]), (basin[0], upper[1])),
        "above": ((0, upper[1]), (basin[0], basin[1])),
    }
    for name, (a, b) in pieces.items():
        scene.add_body(
            name=name,
            shape=shapes.Box(lower=tuple(i * dx for i in a), upper=tuple(i * dx for i in b)),
            material=water,
            hydrostatic=depth,
        )
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response=boundaries.Slip(cell="held"),
    )
    scene.add_boundary(name="box", shape=box, response=boundaries.Slip(cell="held"))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="box", interval=interval))
    weight = WATER * GRAVITY * float(np.prod((high - low) * dx))
    return scene, weight


def sinking(density, *, cell_size, width=1.6, depth=3.2, edge=0.4, base=2.2, modulus=2.2e6,
            fbar="default", block_modulus=1e6, gravity=10.0):  # fmt: skip
    """A square block released at rest under water, `base` above the bed."""
    dx, left = cell_size, (width - edge) / 2
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(width, depth + 2 * edge),
        gravity=(0.0, -gravity), method=libmpm.Method(cfl=0.4, transfer="APIC"),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(width, depth)),
        material=materials.TaitFluid(density=WATER, bulk_modulus=modulus),
        hydrostatic=depth,
        fbar=fbar,
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(left, base), upper=(left + edge, base + edge)),
        material=materials.FixedCorotated(
            density=density, youngs_modulus=block_modulus, poissons_ratio=0.3
        ),
        subtract_from=("water",),
    )
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response=boundaries.Slip(cell="held"),
    )
    return scene


def free_body(dimension, *, velocity=None, gravity=0.0, cells=16):
    """A solid box in the middle of an empty domain without walls."""
    dx = 0.1
    low = tuple(0.35 * cells * dx + 0.013 * a for a in range(dimension))
    size = (0.5, 0.3, 0.4)[:dimension]
    down = (0.0,) * (dimension - 1) + (-gravity,)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx, lower=(0.0,) * dimension,
        upper=(cells * dx,) * dimension, gravity=down,
    )  # fmt: skip
    scene.add_body(
        name="solid",
        shape=shapes.Box(lower=low, upper=tuple(a + s for a, s in zip(low, size, strict=True))),
        material=materials.FixedCorotated(density=800.0, youngs_modulus=1e5, poissons_ratio=0.3),
        velocity=velocity,
    )
    return scene


def crowded(dimension, *, fbar="default", moving=False, solid=None, solid_fbar=None, method=None):
    """Below 1,000 particles with everything at once: two materials, walls, box, friction.

    With `moving` gravity turns and the box slides under the water. `solid` replaces the block's
    material.
    """
    dx, n = 0.1, 12 if dimension == 2 else 8
    side, depth = (0.8, 0.6) if dimension == 2 else (0.4, 0.4)
    down = (0.0, -GRAVITY, 0.0)[:dimension]
    turned = (2.0, -GRAVITY, 1.0)[:dimension]
    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx, lower=(0.0,) * dimension,
        upper=(n * dx,) * dimension,
        method=method or libmpm.Method(cfl=0.3, transfer="APIC"),
        gravity=libmpm.TimeTable((0.0, 0.1), (down, turned)) if moving else down,
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0.0,) * dimension, upper=(side, depth, side)[:dimension]),
        material=materials.TaitFluid(bulk_modulus=2e5, viscosity=0.5),
        velocity=(0.9, -0.4, 0.5)[:dimension],
        hydrostatic=depth,
        fbar=fbar,
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(
            lower=(0.12, depth + 0.02, 0.11)[:dimension],
            upper=(0.36, depth + 0.24, 0.34)[:dimension],
        ),
        material=solid
        or materials.FixedCorotated(density=600.0, youngs_modulus=2e5, poissons_ratio=0.3),
        velocity=(0.5, -1.0, 0.2)[:dimension],
        fbar=solid_fbar,
    )
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces="all"),
        response=boundaries.Separable(static_friction=0.4, dynamic_friction=0.3, cell="held"),
    )
    slide = ((0.0,) * dimension, (0.3, 0.1, -0.2)[:dimension])
    scene.add_boundary(
        name="step",
        shape=shapes.Box(
            lower=(side, 0.0, 0.0)[:dimension], upper=(side + 0.2, 0.3, n * dx)[:dimension]
        ),
        response=boundaries.Sticky() if moving else boundaries.Slip(cell="held"),
        motion=libmpm.TimeTable((0.0, 0.1), slide) if moving else None,
    )
    for name in ("walls", "step"):
        scene.add_sensor(name=name, sensor=sensors.LoadCell(boundary=name))
    return scene


def narrow(dimension, *, separable=False, gap=3, thin=False, walls_last=False):
    """Water stirred between linear walls, a box on the floor and one above: edges and gaps.

    `gap` cells between the box on the floor and the wall beside it; a `thin` one is one cell thick.
    With `walls_last` the box is asked before the floor on which it stands.
    """
    dx, n = 0.1, 12 if dimension == 2 else 9
    floor, width = (0.0,) * dimension, 1 if thin else 2
    rub = {"static_friction": 0.4, "dynamic_friction": 0.3}
    response = (
        boundaries.Separable(cell="linear", **rub) if separable else boundaries.Slip(cell="linear")
    )
    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx, lower=floor, upper=(n * dx,) * dimension,
        method=libmpm.Method(cfl=0.3, transfer="APIC"), gravity=(0.0, -GRAVITY, 0.0)[:dimension],
    )  # fmt: skip
    left = n - gap - width
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=floor, upper=(left * dx, 0.5, 0.4)[:dimension]),
        material=materials.TaitFluid(bulk_modulus=2e5, viscosity=0.5),
        velocity=(0.9, -0.4, 0.5)[:dimension],
        hydrostatic=0.5,
    )
    scene.add_body(
        name="gap",
        shape=shapes.Box(
            lower=((n - gap) * dx, 0.0, 0.0)[:dimension],
            upper=(n * dx, 0.3, 0.3)[:dimension],
        ),
        material=materials.TaitFluid(bulk_modulus=2e5, viscosity=0.5),
        velocity=(-0.3, 0.6, 0.2)[:dimension],
    )
    walls = {"name": "walls", "shape": shapes.DomainWalls(faces="all"), "response": response}
    if not walls_last:
        scene.add_boundary(**walls)
    for name, low, high in (
        ("post", (left * dx, 0.0, 0.2), ((n - gap) * dx, 0.5, n * dx)),
        ("deck", (0.2, 0.5, 0.1), (0.5, 0.7, 0.3)),
    ):
        shape = shapes.Box(lower=low[:dimension], upper=high[:dimension])
        scene.add_boundary(name=name, shape=shape, response=response)
    if walls_last:
        scene.add_boundary(**walls)
    for name in ("walls", "post", "deck"):
        scene.add_sensor(name=name, sensor=sensors.LoadCell(boundary=name))
    return scene


# ---- running ------------------------------------------------------------------------------------


def with_arrays(spec):
    """The specification with whole arrays of what is given in rows, to be read or changed."""
    for body in spec["bodies"]:
        for name in ("position", "pressure"):
            if body[name] is not None:
                body[name] = body[name](0, body["count"])
    return spec


def specification(scene, *, precision="double", pipeline="auto", threads=1):
    """The dictionary that the engine takes; one thread, the scenes are too small for more."""
    from libmpm._src.run.engine_spec import lower

    return with_arrays(lower(scene, precision=precision, pipeline=pipeline, threads=threads))


def engine(spec, device="cpu"):
    """An engine for a specification that a test has changed by hand."""
    from libmpm._src.run.backends import select

    return select(device).module.Engine(spec)


def advance(machine, steps):
    """Run an engine for whole steps; returns its time."""
    while steps > 0:
        report = machine.run(steps, math.inf, 60.0)
        assert report["reason"] in ("steps", "wall"), report
        steps -= report["steps"]
    return machine.time


def by_id(machine, body, name):
    """An attribute of an engine in the order of the ids."""
    order = np.argsort(machine.attribute(body, "id"))
    return machine.attribute(body, name)[order]


def force(sim, name="load"):
    """Times at which samples end, their lengths and the mean forces (n, d) of a load cell."""
    series = sim.sensors[name]
    time, values = np.asarray(series.time), np.asarray(series.values)
    length = np.diff(time, prepend=0.0)
    keep = length > 0
    return time[keep], length[keep], values[keep, : sim.scene.dimension]
