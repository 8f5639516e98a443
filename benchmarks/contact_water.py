"""Rows of `contact.py` of bodies in water: discs that sink, rise and turn, an elastic column."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from contact_faces import simulate
from wall_flows import disc

import libmpm
from libmpm import boundaries, contacts, materials, shapes

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support import contact_scenes as cases

Values = dict[str, float]


def in_water(
    density: float, size: float, pull: float, bulk_modulus: float, touching: bool = True,
    material: Any = None, heavy: float = 0.0,
) -> libmpm.Scene:  # fmt: skip
    """Return a disc of 8 cells in the middle of a closed box of water, `size` radii wide.

    `pull` is on the disc alone, m/s² downwards: its weight less its buoyancy, so that the water
    has no pressure to begin with. Without it the disc turns by 1 rad/s. With `heavy`, m/s², gravity
    pulls both instead, and the water has the pressure of that from the lid down.
    """
    scene = libmpm.Scene(
        dimension=2, cell_size=1 / 8, lower=(0, 0), upper=(size, size), gravity=(0, -heavy)
    )
    centre = (size / 2, size / 2)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(size, size)),
        material=materials.TaitFluid(bulk_modulus=bulk_modulus),
        hydrostatic=size if heavy else None,
    )  # fmt: skip
    weight = boundaries.PlacedForce(axis="x", place=[0.0], value=[[0.0, -pull]])
    turning = libmpm.Field(components=(f"-(y - {centre[1]!r})", f"x - {centre[0]!r}"))
    scene.add_body(
        name="disc", shape=shapes.Sphere(centre=centre, radius=1.0),
        material=material or cases.solid(5e5, 0.3, density), subtract_from=("water",),
        velocity=(0.0, 0.0) if pull or heavy else turning, force=weight if pull else None,
    )  # fmt: skip
    walls = boundaries.Slip(cell="held")
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    if touching:
        scene.add_contact(name="wet", between=("disc", "water"), law=contacts.Fluid())
    return scene


def sink(bulk_modulus: float, touching: bool = True, material: Any = None) -> Values:
    """A cylinder of twice the water's density starts to sink: potential flow has added mass 1.

    With a material gravity pulls the water too, which has its pressure then.
    """
    g = 10.0
    simulation = simulate(
        in_water(2000.0, 12.0, g / 2, bulk_modulus, touching)
        if material is None
        else in_water(2000.0, 12.0, 0.0, bulk_modulus, touching, material, g)
    )
    values = {}
    for at in (0.25, 0.375):
        simulation.run(until=at)
        speed = -cases.mean(simulation, "disc", "velocity")[1]
        values[f"speed_at_{at:g}_s"] = float(speed / (g / 3 * at))
    return values


def sinks() -> Iterator[tuple[str, Callable[[], Values]]]:
    """Rows of cylinders that sink."""
    for k, on in ((2e5, True), (2e6, True), (2e6, False), (2e7, True)):
        name = f"density 2, R 8, K {k:g} Pa{'' if on else ', one field'}"
        yield name, lambda k=k, on=on: sink(k, on)
    for k in (2e6, 2e7):
        for body, material in (
            ("E 5 MPa", cases.solid(5e6, 0.3, 2000.0)), ("rigid", materials.Rigid(density=2000.0))
        ):  # fmt: skip
            name = f"density 2, R 8, K {k:g} Pa, {body}, water with pressure"
            yield name, lambda k=k, m=material: sink(k, True, m)


def rise(transfer: str, cells: int, stiffer: float, rigid: bool) -> Values:
    """A disc of half the density let go under water, of g/3: `wall_flows.disc`, with contact."""
    return disc("held", transfer, cells, touching=True, rigid=rigid, stiffer=stiffer)


def rises() -> Iterator[tuple[str, Callable[[], Values]]]:
    """Rows of discs that rise: cells, then stiffness of the water at 16 cells, then transfers."""
    chosen = [
        *(("APIC", n, 1, rigid) for n in (8, 16, 32) for rigid in (False, True)),
        *(("APIC", 16, k, rigid) for k in (4, 16) for rigid in (False, True)),
        *((t, n, 1, r) for t in ("AFLIP 0.95", "FLIP") for n in (8, 16, 32) for r in (False, True)),
        *((t, 16, k, True) for t in ("AFLIP 0.95", "FLIP") for k in (4, 16)),
        *((t, 32, 16, True) for t in ("APIC", "FLIP")),
    ]
    for transfer, cells, stiffer, rigid in chosen:
        body = "rigid" if rigid else "E 2 MPa"
        name = f"{cells} cells, {transfer}, K {2 * stiffer} MPa, {body}, single"
        yield name, lambda t=transfer, n=cells, k=stiffer, r=rigid: rise(t, n, float(k), r)


def spin() -> Values:
    """A disc that turns in water at rest: what is left after a radian."""
    simulation = simulate(in_water(1000.0, 6.0, 0.0, 2e5))

    def rate() -> float:
        x, v = (np.asarray(simulation.particles["disc"][a]) for a in ("position", "velocity"))
        x, v = x - x.mean(axis=0), v - v.mean(axis=0)
        return float((x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]).sum() / (x**2).sum())

    start = rate()
    simulation.run(until=1.0)
    return {"left": rate() / start}


def column(touching: bool) -> Values:
    """Water on an elastic column (Walhorn), 3 cells across: the reduced case, with contact."""
    from libmpm._src.advice.cases.case import Options
    from libmpm._src.advice.cases.coupled import _elastic_column, _tip

    parameters = {
        "cell_size": 0.004, "thickness": 0.0, "coarser": (), "bulk_modulus": 1e6, "until": 0.26,
        "density": 2500.0, "poissons_ratio": 0.0, "flip": 0.8,
    }  # fmt: skip
    scene = _elastic_column(parameters, Options())
    if touching:
        scene.add_contact(name="wet", between=("column", "water"), law=contacts.Fluid())
    peak, time, arrival = _tip(simulate(scene, precision="single"), parameters["until"])
    return {"tip_mm": 1e3 * peak, "time": time, "arrival": arrival}
