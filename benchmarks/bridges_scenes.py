"""Scenes of Yang (2016) 5.2 and 6.1: bores against decks, and blocks that dam the flow below one.

The source's drawings of flume and sections are not to hand. What is chosen here:

- x = 0 is the gauge, the deck begins 1 m behind it (captions: "1m-gauge"), the outlet is at 3 m.
- Decks are 0.5 m along the flow: two lanes, 10 m at the scale 1/20. Soffits are at 0.2 m, the
  height of the pier, which plane strain leaves out. "A" is a slab 5 cm deep, "B" four girders of
  4 cm by 6 cm under a slab 4 cm thick, "C" a box 10 cm deep.
- Cells are squares: 20 mm for those of 20 mm by 15 mm.
- "F1" to "F3" are the flumes of models 1 to 3 without a deck, 4 m behind the gauge.
- Outlets hold still water until the bore is due, then let out at the speed behind it.
- Blocks begin 0.2 m before the gauge. In model I all water moves from the start.

Per metre of thickness, which is the width of the flume.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import libmpm
from libmpm import boundaries, design, materials, sensors, shapes

GAUGE, FRONT, LENGTH, OUTLET, ROOF = 0.0, 1.0, 0.5, 3.0, 0.9  # m
SOFFIT, SHIFTED = 0.2, 0.225  # m: on the pier; one cell above the still water
GAUGES = {"gauge": 0.0, "gauge-1": 1.0, "gauge-2": 2.0, "gauge-3": 3.0}  # m; others than the
# first where there is no deck
INTERVAL = 0.01  # s, of the source's samples
SPEED = 0.8645  # m/s, of the damming runs
BLOCK = 0.15  # m, height of the blocks
START = -0.2  # m, of their fronts
DENSITY = 1000.0

#: Boxes of a deck from its front and its soffit: (x, y, length, height), m.
DECKS = {
    "": {},
    "A": {"deck": (0.0, 0.0, LENGTH, 0.05)},
    "B": {
        "slab": (0.0, 0.06, LENGTH, 0.04),
        **{f"girder-{k}": (0.02 + 0.14 * k, 0.0, 0.04, 0.06) for k in range(4)},
    },
    "C": {"deck": (0.0, 0.0, LENGTH, 0.1)},
}
DEPTHS = {"": 0.0, "A": 0.05, "B": 0.1, "C": 0.1}


@dataclass(frozen=True)
class Model:
    """A flume: deck, depths before the gate is opened in m, length before the gauge, cells."""

    deck: str
    reservoir: float
    flume: float
    inlet: float
    cell: float
    soffit: float = SOFFIT
    bore: bool = True
    outlet: float = OUTLET

    def state(self) -> boundaries.Bore:
        """Return velocity and depth at the inlet, and the speed of the front."""
        if self.bore:
            return boundaries.riemann_inlet(self.reservoir, self.flume)
        return boundaries.Bore(SPEED, self.flume, float("inf"))


MODELS = {
    "M1": Model("A", 0.518, 0.20, 0.5, 0.025),
    "M1-L": Model("A", 0.518, 0.20, 1.0, 0.025),
    "M1-R": Model("A", 0.518, 0.20, 0.5, 0.0125),
    "M2": Model("B", 0.617, 0.10, 0.5, 0.02),
    "M3": Model("B", 0.518, 0.15, 0.5, 0.02),
    "M4": Model("C", 0.617, 0.10, 0.5, 0.02),
    "M2-R": Model("B", 0.617, 0.10, 0.5, 0.01),
    "F1": Model("", 0.518, 0.20, 0.5, 0.025, outlet=4.0),
    "F2": Model("", 0.617, 0.10, 0.5, 0.02, outlet=4.0),
    "F3": Model("", 0.518, 0.15, 0.5, 0.02, outlet=4.0),
    "F1-R": Model("", 0.518, 0.20, 0.5, 0.0125, outlet=4.0),
    "I": Model("A", 0.518, 0.20, 1.0, 0.025, SHIFTED, bore=False),
    "II": Model("A", 0.518, 0.20, 1.0, 0.025, SHIFTED),
}

#: Length along the flow, m, and density, kg/m³ (table 6.1).
BLOCKS = {
    "B1": (0.15, 200.0), "B2": (0.15, 400.0), "B3": (0.15, 800.0),
    "B4": (0.30, 200.0), "B5": (0.30, 400.0), "B6": (0.60, 200.0),
}  # fmt: skip

#: Peak force without impact, kN, and net areas at the start and at the peak, m² (table 6.2).
TABLE = {
    ("I", "B1"): (1.45, 0.170, 0.129), ("I", "B2"): (0.73, 0.140, 0.115),
    ("I", "B4"): (1.42, 0.170, 0.124), ("I", "B5"): (0.85, 0.140, 0.111),
    ("I", "B6"): (1.01, 0.170, 0.112), ("II", "B2"): (4.83, 0.225, 0.183),
    ("II", "B3"): (3.60, 0.218, 0.144), ("II", "B5"): (3.42, 0.225, 0.124),
}  # fmt: skip


def youngs_modulus(bulk_modulus: float) -> float:
    """Return E of a block, Pa: the source's 0.03 GPa with 0.22 GPa, as much softer as the water."""
    return min(0.03e9, max(0.03e9 * bulk_modulus / 0.22e9, 1e6))


def net_area(model: Model, block: str) -> float:
    """Return what a floating block and the deck leave to the flow, m²."""
    found = design.net_area(
        density=BLOCKS[block][1], height=BLOCK, width=1.0, depth=model.state().depth,
        clearance=model.soffit,
    )  # fmt: skip
    return float(found)


def scene(
    model: Model,
    method: str,
    bulk_modulus: float,
    block: str | None = None,
    linear: bool = False,
    cfl: float | None = None,
) -> libmpm.Scene:
    """Return a flume with a deck and perhaps a block; `linear` functions are the source's.

    `method` is "fbar" or one of smoothing, with APIC, or with FLIP where that word comes first.
    """
    bore, dx = model.state(), model.cell
    transfer, _, locking = method.rpartition(" ")
    made = libmpm.Scene(
        dimension=2,
        cell_size=dx,
        lower=(-model.inlet, 0.0),
        upper=(model.outlet, ROOF),
        gravity=(0.0, -9.81),
        # What splashes over the roof is gone.
        method=libmpm.Method(
            leaving="delete",
            transfer=transfer or "APIC",
            # Nodes of linear functions that hold little are fast.
            cfl=cfl or (0.1 if linear else 0.4),
            kernel=libmpm.methods.Kernel(name="linear", modified=True) if linear else "quadratic",
        ),
    )
    # One body: smoothing over cells is within a body.
    water: shapes.Solid = shapes.Box(lower=(-model.inlet, 0.0), upper=(GAUGE, bore.depth))
    water = water | shapes.Box(lower=(GAUGE, 0.0), upper=(model.outlet, model.flume))
    speed = f"where(x < 0, {bore.velocity!r}, 0)" if model.bore else f"{bore.velocity!r}"
    how: dict[str, Any] = {}
    if locking != "fbar":
        smoothing = libmpm.methods.Smoothing(method=locking)  # type: ignore[arg-type]
        how = {"fbar": None, "smoothing": smoothing}
    made.add_body(
        name="water",
        shape=water,
        material=materials.TaitFluid(density=DENSITY, bulk_modulus=bulk_modulus),
        particles_per_cell=9,
        velocity=libmpm.Field(components=(speed, "0")),
        # Still water that touches a deck is in balance, else what carries a block.
        hydrostatic=bore.depth if model.soffit > model.flume + 0.5 * dx else model.flume,
        **how,
    )
    made.add_boundary(
        name="bed", shape=shapes.DomainWalls(faces=("y-",)), response=boundaries.Slip(cell="held")
    )
    for name, (x, y, length, height) in DECKS[model.deck].items():
        low = (FRONT + x, model.soffit + y)
        part = shapes.Box(lower=low, upper=(low[0] + length, low[1] + height))
        made.add_boundary(name=name, shape=part, response=boundaries.Separable(cell="held"))
        load = sensors.LoadCell(boundary=name, interval=INTERVAL)
        made.add_sensor(name=f"load {name}", sensor=load)
        front = sensors.LoadCell(boundary=name, faces=("x-",), interval=INTERVAL)
        made.add_sensor(name=f"front {name}", sensor=front)
    inlet = boundaries.Inflow(body="water", face="x-", velocity=bore.velocity, level=bore.depth)
    made.add_flow(name="inlet", flow=inlet)
    leaves: Any = bore.velocity
    if model.bore:
        due = model.outlet / bore.speed
        leaves = libmpm.TimeTable((due - INTERVAL, due + INTERVAL), (0.0, bore.velocity))
    made.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=leaves))
    _watch(made, model)
    if block is not None:
        _float(made, model, bulk_modulus, block)
    return made


def _watch(made: libmpm.Scene, model: Model) -> None:
    """Add gauges; with a deck probes a cell from it, and what fills the layer below it."""
    for name, x in GAUGES.items():
        if x == 0 or not model.deck:
            gauge = sensors.ColumnGauge(position=(x,), body="water", interval=INTERVAL)
            made.add_sensor(name=name, sensor=gauge)
    fastest = sensors.ParticleSensor(
        attribute="Velocity_Magnitude", operation="max", body="water", interval=2 * INTERVAL
    )
    made.add_sensor(name="fastest", sensor=fastest)
    if not model.deck:
        return
    dx, middle = model.cell, model.soffit + 0.5 * DEPTHS[model.deck]
    # Hardly a particle comes nearer than a cell: lines drawn on to the wall itself are of no use.
    for name, place in (
        ("front pressure", (FRONT - dx, middle)),
        ("soffit pressure", (FRONT + 0.5 * LENGTH, model.soffit - dx)),
    ):
        probe = sensors.PressureProbe(position=place, order=0, body="water", interval=INTERVAL)
        made.add_sensor(name=name, sensor=probe)
    low = (FRONT + 0.1, model.soffit - dx)
    below = shapes.Box(lower=low, upper=(FRONT + LENGTH - 0.1, model.soffit))
    volume = sensors.ParticleSensor(
        attribute="Volume", operation="sum", body="water", region=below, interval=2 * INTERVAL
    )
    made.add_sensor(name="below", sensor=volume)


def _float(made: libmpm.Scene, model: Model, bulk_modulus: float, block: str) -> None:
    """Add a block at floating equilibrium, with the speed of the flow."""
    length, density = BLOCKS[block]
    box = shapes.Box(lower=(START - length, 0.0), upper=(START, BLOCK))
    floats = shapes.afloat(shape=box, density=density, level=model.state().depth, bed=0.0)
    made.add_body(
        name="block",
        shape=floats.shape,
        material=materials.FixedCorotated(
            density=density, youngs_modulus=youngs_modulus(bulk_modulus), poissons_ratio=0.2
        ),
        particles_per_cell=9,
        velocity=(SPEED, 0.0),
        subtract_from=("water",),
    )
    tracker = sensors.BodyTracker(
        body="block", quantities=("centroid", "orientation", "extent", "boundary_force"),
        interval=INTERVAL,
    )  # fmt: skip
    made.add_sensor(name="block", sensor=tracker)
