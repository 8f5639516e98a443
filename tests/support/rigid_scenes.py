"""Scenes of rigid bodies for tests and benchmarks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes


def motion(
    centre: Sequence[float], velocity: Sequence[float], spin: Sequence[float]
) -> libmpm.Field:
    """Return the velocity of a rigid motion; `spin` is (ω,) in 2D, (ω_x, ω_y, ω_z) in 3D."""
    r = [f"({axis} - {c!r})" for axis, c in zip("xyz", centre, strict=False)]
    if len(centre) == 2:
        w = float(spin[0])
        parts = [f"{-w!r} * {r[1]}", f"{w!r} * {r[0]}"]
    else:
        w_x, w_y, w_z = (float(w) for w in spin)
        parts = [
            f"{w_y!r} * {r[2]} - {w_z!r} * {r[1]}",
            f"{w_z!r} * {r[0]} - {w_x!r} * {r[2]}",
            f"{w_x!r} * {r[1]} - {w_y!r} * {r[0]}",
        ]
    return libmpm.Field(
        components=tuple(f"{float(v)!r} + {p}" for v, p in zip(velocity, parts, strict=True))
    )


def flying(
    size: Sequence[float],
    velocity: Sequence[float],
    spin: Sequence[float],
    gravity: float = 0.0,
    time_step: float = 1e-3,
    cell_size: float = 0.05,
    **rigid: Any,
) -> libmpm.Scene:
    """Return a box of `size` metres alone in a domain of 3 m a side, in its middle."""
    d = len(size)
    scene = libmpm.Scene(
        dimension=d, cell_size=cell_size, lower=(0.0,) * d, upper=(3.0,) * d,
        gravity=(*(0.0,) * (d - 1), -gravity), method=libmpm.Method(time_step=time_step),
    )  # fmt: skip
    scene.add_body(
        name="box",
        shape=shapes.Box(lower=[1.5 - s / 2 for s in size], upper=[1.5 + s / 2 for s in size]),
        material=materials.Rigid(**({"density": 500.0} | rigid)),
        velocity=motion((1.5,) * d, velocity, spin),
    )
    scene.add_sensor(name="motion", sensor=sensors.RigidMotion(body="box"))
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    return scene


def incline(
    dimension: int,
    friction: float,
    degrees: float,
    shape: str = "block",
    cells: int = 12,
    wall: bool = True,
    time_step: float = 5e-4,
) -> libmpm.Scene:
    """Return a body on a plane under gravity that is turned by the slope, on a wall or a slab.

    The block is `cells` long and half as high, the disc `cells` across.
    """
    dx, g, angle, d = 1 / cells, 10.0, math.radians(degrees), dimension
    side = (0.5,) * (d - 2)
    zero = (0.0,) * (d - 2)
    scene = libmpm.Scene(
        dimension=d, cell_size=dx, lower=(0.0,) * d, upper=(4.0, *side, 2.0),
        gravity=(-g * math.sin(angle), *zero, -g * math.cos(angle)),
        method=libmpm.Method(time_step=time_step),
    )  # fmt: skip
    floor = 0.5
    rigid = materials.Rigid(density=1000.0)
    if shape == "disc":
        body: Any = shapes.Sphere(centre=(3.0, floor + 0.5), radius=0.5)
    else:
        body = shapes.Box(lower=(2.5, *zero, floor), upper=(3.5, *side, floor + 0.5))
    scene.add_body(name="body", shape=body, material=rigid, particles_per_cell=16 if d == 2 else 8)
    if wall:
        scene.add_boundary(
            name="plane",
            shape=shapes.Box(lower=(0.0, *zero, 0.0), upper=(4.0, *side, floor)),
            response=boundaries.Separable(static_friction=friction, dynamic_friction=friction),
        )
    else:
        scene.add_body(
            name="slab", shape=shapes.Box(lower=(0.0, *zero, 0.0), upper=(4.0, *side, floor)),
            material=materials.Rigid(
                density=1000.0, held=("x", *("y",) * (d - 2), "y" if d == 2 else "z", "rotation")
            ),
        )  # fmt: skip
        scene.add_contact(
            name="sole", between=("body", "slab"), law=contacts.Friction(static=friction)
        )
    scene.add_sensor(name="motion", sensor=sensors.RigidMotion(body="body"))
    return scene


def discs(radius: float = 16.0, speed: float = 0.5, impact: float = 0.0) -> libmpm.Scene:
    """Return two rigid discs of `radius` cells that meet, each at `speed` m/s.

    `impact`: distance between the lines of their centres, parts of 2 R.
    """
    dx, r = 0.01, radius * 0.01
    centre = 2.6 * r
    size = dx * math.ceil(5.2 * radius)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(size, size),
        method=libmpm.Method(time_step=2e-4),
    )  # fmt: skip
    apart = 2 * r * math.sqrt(1 - impact**2) + dx
    for name, side in (("left", -1.0), ("right", 1.0)):
        scene.add_body(
            name=name,
            shape=shapes.Sphere(
                centre=(centre + side * apart / 2, centre + side * impact * r), radius=r
            ),
            material=materials.Rigid(density=1000.0 if side < 0 else 2000.0),
            velocity=(-side * speed, 0.0),
            particles_per_cell=9,
        )
        scene.add_sensor(name=name, sensor=sensors.RigidMotion(body=name))
    scene.add_contact(name="discs", between=("left", "right"), law=contacts.Friction())
    return scene


def floating(
    density: float,
    material: Any = None,
    cells: int = 8,
    lift: float = 0.0,
    damped: bool = False,
    degrees: float = 0.0,
    wide: float = 1.0,
) -> libmpm.Scene:
    """Return a block of `cells` in water, as deep as it floats plus `lift` cells.

    The tank is four blocks wide and two and a half deep.
    """
    dx, g = 1 / cells, 9.81
    ratio = density / 1000.0
    width, depth = 4.0, 2.5
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(width, depth + 1.5), gravity=(0, -g)
    )
    bottom = depth - ratio + lift * dx
    half = 0.5 * wide
    if degrees:
        shape: Any = shapes.OrientedBox(
            centre=(width / 2, bottom + 0.5), size=(2 * half, 1.0), angle=degrees
        )
    else:
        shape = shapes.Box(lower=(width / 2 - half, bottom), upper=(width / 2 + half, bottom + 1.0))
    # Celerity of ten times the fastest fall that there can be.
    bulk = 1000.0 * 100 * 2 * g * 1.0
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(width, depth)),
        material=materials.TaitFluid(bulk_modulus=bulk), hydrostatic=depth,
        subtract_from=(),
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shape, material=material or materials.Rigid(density=density),
        subtract_from=("water",),
    )  # fmt: skip
    scene.add_boundary(name="tank", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_contact(name="wet", between=("block", "water"), law=contacts.Fluid())
    return scene


def tub(law: contacts.ContactLaw | None, density: float = 500.0) -> libmpm.Scene:
    """Return water without walls or gravity, and a block that runs into it."""
    scene = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(2, 2))
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.6, 0.6), upper=(1.4, 1.0)),
        material=materials.TaitFluid(bulk_modulus=1e5, viscosity=0.0),
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shapes.Box(lower=(0.8, 1.05), upper=(1.1, 1.35)),
        material=materials.Rigid(density=density), velocity=(0.3, -2.0),
    )  # fmt: skip
    scene.add_sensor(name="motion", sensor=sensors.RigidMotion(body="block"))
    if law is not None:
        scene.add_contact(name="wet", between=("block", "water"), law=law)
        scene.add_sensor(name="load", sensor=sensors.ContactLoad(contact="wet", interval=0.02))
    return scene


def column(debris: Any, modulus: float, length: float, cells: int) -> libmpm.Scene:
    """Return a bar of 0.6 m at 1 m/s before the end of an elastic one, which a wall holds."""
    dx = 0.1 / cells
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(2.6, 0.4))
    scene.add_body(
        name="column", shape=shapes.Box(lower=(2.6 - length, 0.1), upper=(2.6, 0.2)),
        material=materials.NeoHookean(density=1000.0, youngs_modulus=modulus, poissons_ratio=0.0),
    )  # fmt: skip
    near = 2.6 - length - 0.1 * dx
    scene.add_body(
        name="debris", shape=shapes.Box(lower=(near - 0.6, 0.1), upper=(near, 0.2)),
        material=debris, velocity=(1.0, 0.0),
    )  # fmt: skip
    scene.add_contact(name="blow", between=("debris", "column"), law=contacts.Friction())
    scene.add_boundary(
        name="end", shape=shapes.DomainWalls(faces=("x+",)), response=boundaries.Sticky()
    )
    scene.add_sensor(name="blow", sensor=sensors.ContactLoad(contact="blow", interval=2e-4))
    return scene


def pile(count: int = 12, cells: int = 5, friction: float = 0.4) -> libmpm.Scene:
    """Return rigid squares of `cells`, each turned by another angle, that fall on each other."""
    dx = 0.1 / cells
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(0.8, 1.2), gravity=(0, -9.81),
        method=libmpm.Method(time_step=5e-4),
    )  # fmt: skip
    for k in range(count):
        scene.add_body(
            name=f"block {k}",
            shape=shapes.OrientedBox(
                centre=(0.2 + 0.2 * (k % 3) + 0.013 * (k % 2), 0.15 + 0.18 * (k // 3)),
                size=(0.1, 0.1), angle=(37.0 * k) % 90,
            ),
            material=materials.Rigid(density=500.0),
        )  # fmt: skip
    response = boundaries.Separable(static_friction=friction, dynamic_friction=friction)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    scene.add_contact(
        name="pile", between=("block *", "block *"), law=contacts.Friction(static=friction)
    )
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.02))
    return scene


def pool(density: float, material: Any = None, cells: int = 6) -> libmpm.Scene:
    """Return a cube of 0.1 m in water in space, as deep as it floats."""
    dx, side, level = 0.1 / cells, 0.3, 0.2
    low = level - density / 1000.0 * 0.1
    scene = libmpm.Scene(
        dimension=3, cell_size=dx, lower=(0, 0, 0), upper=(side,) * 3, gravity=(0, 0, -9.81)
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0, 0), upper=(side, side, level)),
        material=materials.TaitFluid(bulk_modulus=1e5), hydrostatic=level,
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shapes.Box(lower=(0.1, 0.1, low), upper=(0.2, 0.2, low + 0.1)),
        material=material or materials.Rigid(density=density), subtract_from=("water",),
    )  # fmt: skip
    scene.add_boundary(name="tank", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_contact(name="wet", between=("block", "water"), law=contacts.Fluid())
    return scene
