"""A box in water at rest: what load cells and probes on its faces are held to."""

from __future__ import annotations

import numpy as np

import libmpm
from libmpm import materials, shapes

WATER, GRAVITY = 1000.0, 9.81


def faces_of(dimension):
    """Names of all faces of a box, "x-" to "z+"."""
    return [f"{a}{end}" for a in "xyz"[:dimension] for end in "-+"]


def box_in_still_water(low, high, basin, cell, response):
    """Return the scene, and the corners of its box, m.

    Corners and basin in cells; `response` is that of the box and of all walls but the lid.
    """
    d, depth = len(basin), basin[-1] * cell
    scene = libmpm.Scene(
        dimension=d, cell_size=cell, lower=(0.0,) * d,
        upper=tuple((n + 4 * (a == d - 1)) * cell for a, n in enumerate(basin)),
        gravity=(*(0.0,) * (d - 1), -GRAVITY), method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    lower, upper = np.array(low) * cell, np.array(high) * cell
    box = shapes.Box(lower=tuple(lower), upper=tuple(upper))
    sea = shapes.Box(lower=(0.0,) * d, upper=tuple(n * cell for n in basin))
    scene.add_body(
        name="water", shape=shapes.Difference(whole=sea, without=box), hydrostatic=depth,
        material=materials.TaitFluid(
            density=WATER, bulk_modulus=200 * WATER * GRAVITY * depth, viscosity=0.0
        ),
    )  # fmt: skip
    walls = shapes.DomainWalls(faces=faces_of(d)[:-1])
    scene.add_boundary(name="walls", shape=walls, response=response)
    scene.add_boundary(name="box", shape=box, response=response)
    return scene, lower, upper
