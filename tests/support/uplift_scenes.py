"""A block that stands on the bed of a tank, with water beside it and in the gap below."""

from __future__ import annotations

import numpy as np

import libmpm
from libmpm import boundaries, flumes, materials, shapes
from libmpm._src.flumes.structures import add_contacts

K = 1e5
GRAVITY = 9.81
HIGH = 0.05
#: Half of the block's edges along the flow and across it, m.
HALF = 0.05
DENSITY = 987.0


def solid(density: float) -> materials.FixedCorotated:
    """A solid in which sound is as fast as in the water."""
    modulus = 0.4667 * density * K / 1000
    return materials.FixedCorotated(density=density, youngs_modulus=modulus, poissons_ratio=0.4)


def tank(
    cell: float = 0.0125,
    *,
    dimension: int = 2,
    density: float = DENSITY,
    depth: float = 0.045,
    uplift: bool = True,
    friction: float = 0.4,
    speed: float = 0.0,
    contact: bool = False,
    beside: tuple[float, float] = (-0.3, 0.3),
    surface: float | None = None,
    slope: float = 0.0,
) -> libmpm.Scene:
    """A block on the bed of a tank, water between two x beside it.

    `surface`: the bed is one, its plane so many cells above a face of the cells, and leans by
    `slope` about the block's middle, 1; else it is a box.
    """
    flat = dimension == 2
    wide = () if flat else (0.15,)

    def box(lower: tuple[float, ...], upper: tuple[float, ...]) -> shapes.Box:
        (x, z), (u, w) = (lower[0], lower[-1]), (upper[0], upper[-1])
        y = lower[1:-1] or tuple(-a for a in wide)
        v = upper[1:-1] or wide
        return shapes.Box(lower=(x, *y, z), upper=(u, *v, w))

    rise = cell * (surface or 0.0)
    below = rise + cell * (2 + np.ceil(0.3 * slope / cell))
    scene = libmpm.Scene(
        dimension=dimension, cell_size=cell, lower=(-0.3, *(-a for a in wide), -below),
        upper=(0.3, *wide, 0.15 - rise), gravity=(0.0,) * (dimension - 1) + (-GRAVITY,),
    )  # fmt: skip
    y = () if flat else (HALF,)
    bed: shapes.Solid = box((-1.0, *(-1.0 for _ in wide), -1.0), (1.0, *(1.0 for _ in wide), 0.0))
    block: shapes.Solid = box((-HALF, *(-a for a in y), 0.0), (HALF, *y, HIGH))
    water: shapes.Solid = box((beside[0], 0.0), (beside[1], depth))
    if surface is not None:
        origin = (0.0,) * dimension
        bed = shapes.HalfSpace(point=origin, normal=(-slope, *(0.0 for _ in wide), 1.0))
        deep = -0.3 * slope
        tall = box((-HALF, *(-a for a in y), deep), (HALF, *y, HIGH))
        block = shapes.Difference(whole=tall, without=bed) if slope else block
        water = shapes.Difference(whole=box((beside[0], deep), (beside[1], depth)), without=bed)
    scene.add_body(
        name="debris-1", shape=block, velocity=(speed,) + (0.0,) * (dimension - 1),
        material=solid(density),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Difference(whole=water, without=block), hydrostatic=depth,
        material=materials.TaitFluid(bulk_modulus=K),
        sampling="default" if surface is None else shapes.Columns(),
    )  # fmt: skip
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Separable(cell="held"))
    sides = ("x-", "x+") if flat else ("x-", "x+", "y-", "y+")
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=sides), response=boundaries.Slip()
    )
    flumes.add_bed_friction(scene, bed, {"debris-1": friction}, uplift=uplift)
    if contact:
        add_contacts(scene, 0.3)
    for name in ("bed", "bed-friction"):
        scene.add_sensor(name=name, sensor=libmpm.sensors.LoadCell(boundary=name, interval=0.002))
    return scene


def loads(sim: libmpm.Simulation, name: str, begin: float = 0.0) -> np.ndarray:
    """Mean force along the flow and down, N."""
    series = sim.sensors[name]
    last = "force_y" if "force_z" not in series.components else "force_z"
    rows = np.asarray(series.time) > begin
    return np.array([np.asarray(series[c])[rows].mean() for c in ("force_x", last)])


def stream(
    cell: float,
    *,
    depth: float,
    dimension: int = 2,
    density: float = DENSITY,
    friction: float = 0.4,
    speed: float = 1.0,
) -> libmpm.Scene:
    """A block that is carried along by water of its own speed, in a channel 1.2 m long."""
    wide = () if dimension == 2 else (0.15,)
    y = () if dimension == 2 else (HALF,)
    along = (speed,) + (0.0,) * (dimension - 1)
    low = tuple(-a for a in wide)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=cell, lower=(0.0, *low, -2 * cell), upper=(1.2, *wide, 0.15),
        gravity=(0.0,) * (dimension - 1) + (-GRAVITY,),
    )  # fmt: skip
    bed = shapes.Box(lower=(-1.0,) * dimension, upper=(2.0, *(1.0 for _ in wide), 0.0))
    block = shapes.Box(lower=(0.4 - HALF, *(-a for a in y), 0.0), upper=(0.4 + HALF, *y, HIGH))
    scene.add_body(
        name="debris-1", shape=block, velocity=along,
        material=solid(density),
    )  # fmt: skip
    water = shapes.Box(lower=(0.0, *low, 0.0), upper=(1.2, *wide, depth))
    scene.add_body(
        name="water", shape=shapes.Difference(whole=water, without=block), hydrostatic=depth,
        material=materials.TaitFluid(bulk_modulus=K), velocity=along,
    )  # fmt: skip
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Separable(cell="held"))
    if wide:
        sides = shapes.DomainWalls(faces=("y-", "y+"))
        scene.add_boundary(name="sides", shape=sides, response=boundaries.Slip())
    inlet = boundaries.Inflow(body="water", face="x-", velocity=speed, level=depth, bed=bed)
    scene.add_flow(name="inlet", flow=inlet)
    scene.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=speed))
    flumes.add_bed_friction(scene, bed, {"debris-1": friction}, uplift=True)
    load = libmpm.sensors.LoadCell(boundary="bed-friction", interval=0.002)
    scene.add_sensor(name="bed-friction", sensor=load)
    return scene


def afloat(
    cell: float,
    *,
    off: float,
    dimension: int = 2,
    density: float = 648.0,
    friction: float = 0.7,
    speed: float = 1.0,
    surface: float | None = None,
    response: boundaries.Response | None = None,
) -> libmpm.Scene:
    """A block with contact that floats so many m above a bed, carried along by water of its speed.

    `surface` as in `tank`; `response` is the bed's, which the block meets too.
    """
    wide = () if dimension == 2 else (0.1,)
    y = () if dimension == 2 else (HALF,)
    along = (speed,) + (0.0,) * (dimension - 1)
    low = tuple(-a for a in wide)
    depth = off + density / 1000 * HIGH
    rise = cell * (surface or 0.0)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=cell, lower=(-1.0, *low, -2 * cell - rise),
        upper=(1.2, *wide, 0.3 - rise), gravity=(0.0,) * (dimension - 1) + (-GRAVITY,),
    )  # fmt: skip
    bed: shapes.Solid = shapes.Box(
        lower=(-2.0, *(-1.0 for _ in wide), -1.0), upper=(2.0, *(1.0 for _ in wide), 0.0)
    )
    if surface is not None:
        up = (0.0,) * (dimension - 1) + (1.0,)
        bed = shapes.HalfSpace(point=(0.0,) * dimension, normal=up)
    block = shapes.Box(lower=(-HALF, *(-a for a in y), off), upper=(HALF, *y, off + HIGH))
    scene.add_body(name="debris-1", shape=block, velocity=along, material=solid(density))
    water = shapes.Box(lower=(-1.0, *low, 0.0), upper=(1.0, *wide, depth))
    scene.add_body(
        name="water", shape=shapes.Difference(whole=water, without=block), hydrostatic=depth,
        material=materials.TaitFluid(bulk_modulus=K), velocity=along,
        sampling="default" if surface is None else shapes.Columns(),
    )  # fmt: skip
    scene.add_boundary(
        name="bed", shape=bed, response=response or boundaries.Separable(cell="held")
    )
    sides = ("x-", "x+") if dimension == 2 else ("x-", "x+", "y-", "y+")
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=sides), response=boundaries.Slip()
    )
    flumes.add_bed_friction(scene, bed, {"debris-1": friction})
    add_contacts(scene, 0.3)
    load = libmpm.sensors.LoadCell(boundary="bed-friction", interval=0.002)
    scene.add_sensor(name="bed-friction", sensor=load)
    return scene
