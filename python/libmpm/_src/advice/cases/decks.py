"""A floating block that hits a deck, as its source has it: Yang (2016) 6.2.4 (V13).

Plane strain, SI units, per metre of thickness. Reduced level on one core: 1 s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from libmpm._src.advice.cases.case import Bound, Case, Options
from libmpm._src.advice.cases.choices import advance
from libmpm._src.boundaries.flows import Inflow, Outflow
from libmpm._src.boundaries.responses import Slip
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.methods.method import FBar, Method
from libmpm._src.methods.smoothing import Smoothing
from libmpm._src.methods.transfer import Kernel
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.studies.design.blocks import (
    block_force_partial,
    plane_strain_modulus,
    spread_height,
)

__all__ = ["CASES"]

Parameters = Mapping[str, Any]

_HIGH, _DECK, _ALONG = 3.0, 1.0, 5.0  # m: of the block, of the deck, of it along the flow
_FACE, _WATER = 16.0, 1000.0  # m, where the deck begins; kg/m³
_MIDDLE = (0.3, 0.7)  # of the pulse


def _low(p: Parameters) -> float:
    """Return the lower face of the block afloat, m."""
    return float(p["depth"] - _HIGH * p["density"] / _WATER)


def _modulus(p: Parameters) -> float:
    how = {"youngs_modulus": p["youngs_modulus"], "poissons_ratio": p["poissons_ratio"]}
    return float(plane_strain_modulus(**how))


def _build(p: Parameters, options: Options) -> Scene:
    """The deck stands still one cell of 0.5 m above the water, however the block floats.

    Linear functions (A.4, A.5), FLIP and F0AL1 are the source's. The block touches at the start:
    one that comes from afar is slowed down by a node whose share of it grows over a cell.
    """
    dx, depth, v, low = p["cell_size"], p["depth"], p["velocity"], _low(p)
    own = Method(transfer="FLIP", cfl=0.1, kernel=Kernel(name="linear", modified=True))
    scene = Scene(
        name="debris-at-deck",
        dimension=2,
        cell_size=dx,
        lower=(0.0, 0.0),
        upper=(2 * _FACE, math.ceil((depth + 2 * _HIGH) / dx) * dx),
        gravity=(0.0, -9.81),
        method=options.method or own,
    )
    smoothed = options.fbar == "case"
    scene.add_body(
        name="flow",
        shape=Box(lower=(0.0, 0.0), upper=(2 * _FACE, depth)),
        material=TaitFluid(density=_WATER, bulk_modulus=p["bulk_modulus"], viscosity=1e-3),
        particles_per_cell=9,
        hydrostatic=depth,
        velocity=(v, 0.0),
        fbar=options.fbar if isinstance(options.fbar, FBar) else None,
        smoothing=Smoothing(method="F0AL1") if smoothed else None,
    )
    scene.add_body(
        name="block",
        shape=Box(lower=(_FACE - p["length"], low), upper=(_FACE, low + _HIGH)),
        material=FixedCorotated(
            density=p["density"],
            youngs_modulus=p["youngs_modulus"],
            poissons_ratio=p["poissons_ratio"],
        ),
        particles_per_cell=9,
        velocity=(v, 0.0),
        subtract_from=("flow",),
    )
    soffit = depth + p["clearance"]
    deck = Box(lower=(_FACE, soffit), upper=(_FACE + _ALONG, soffit + _DECK))
    scene.add_boundary(name="deck", shape=deck, response=Slip(cell="held"))
    scene.add_boundary(name="bed", shape=DomainWalls(faces=("y-",)), response=Slip(cell="held"))
    scene.add_sensor(name="deck", sensor=LoadCell(boundary="deck", interval=0))
    scene.add_flow(name="inlet", flow=Inflow(body="flow", face="x-", velocity=v, level=depth))
    scene.add_flow(name="outlet", flow=Outflow(face="x+", velocity=v))
    return scene


def _measure(simulation: Simulation, p: Parameters) -> dict[str, float]:
    """Plateau of the deck's load over (6.10), whose area spreads the contact by 1 in 5."""
    modulus, low = _modulus(p), _low(p)
    pulse = 2 * p["length"] / math.sqrt(modulus / p["density"])
    for _ in advance(simulation, (pulse,)):
        pass
    series = simulation.sensors["deck"]
    step = np.diff(series.time, prepend=0.0)
    inside = (series.time > _MIDDLE[0] * pulse) & (series.time < _MIDDLE[1] * pulse)
    plateau = float(series.values[inside, 0] @ step[inside] / step[inside].sum())
    bottom = max(p["depth"] + p["clearance"], low)
    top = min(p["depth"] + p["clearance"] + _DECK, low + _HIGH)
    height = spread_height(
        contact=top - bottom,
        height=_HIGH,
        length=p["length"],
        eccentricity=0.5 * (top + bottom) - (low + 0.5 * _HIGH),
    )
    formula = block_force_partial(
        velocity=p["velocity"], effective_area=height, density=p["density"], modulus=modulus
    )
    return {"ratio": plateau / float(formula), "plateau": plateau, "contact": top - bottom}


_FLOATING = {
    "velocity": 6.0, "density": 400.0, "youngs_modulus": 1e9, "poissons_ratio": 0.2,
    "length": 6.0, "depth": 6.0, "bulk_modulus": 2.2e9, "clearance": 0.5,
}  # fmt: skip
_BAND = "Yang (2016) 6.2.4: 25 to 35 % above (6.10), with cells of 0.5 m"
_FINER = "this package's own with half the cells: 1.17 to 1.23 by length, below the source's band"

_DEBRIS_AT_DECK = Case(
    name="debris-at-deck",
    title="A floating block that hits a deck one cell above still water",
    source="Yang (2016), 6.2.4 (V13)",
    levels={
        # 5,900 particles, 200 steps.
        "reduced": _FLOATING | {"cell_size": 0.5},
        "full": _FLOATING | {"cell_size": 0.25},
    },
    bounds={
        "reduced": {"ratio": Bound(1.25, 1.35, "1", _BAND)},
        "full": {"ratio": Bound(1.15, 1.35, "1", _FINER)},
    },
    build=_build,
    measure=_measure,
)

CASES: tuple[Case, ...] = (_DEBRIS_AT_DECK,)
