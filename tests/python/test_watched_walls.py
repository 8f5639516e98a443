"""Nodes that a moving boundary may come near use what is known of them until it has come.

Expected duration: 5 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from support.devices import device  # noqa: F401

BACKENDS = pytest.mark.parametrize(
    ("device", "precision"),
    [("cpu", "single"), ("cpu", "double"), pytest.param("cuda", "single", marks=pytest.mark.gpu)],
    indirect=["device"],
)


def flume(dimension: int, shape: str, *, searches: bool) -> libmpm.Scene:
    """A piston that moves in by 20 of 100 cells, over a bed with a slope; a load cell on the bed.

    With `searches` it acts for a time that does not end, so that nodes in its way always search.
    """
    dx, flat = 0.05, dimension == 2

    def point(x: float, y: float, z: float) -> tuple[float, ...]:
        return (x, z) if flat else (x, y, z)

    def prism(profile: tuple[tuple[float, float], ...]) -> shapes.Extrusion:
        if flat:
            return shapes.Extrusion(profile=profile)
        return shapes.Extrusion(profile=profile, axis="y", lower=-1.0, upper=1.0)

    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx, lower=point(-0.2, 0.0, -0.1), upper=point(5.0, 0.2, 0.8),
        gravity=point(0.0, 0.0, -9.81),
    )  # fmt: skip
    bed = prism(((-1.0, 0.0), (3.0, 0.0), (4.0, 0.2), (6.0, 0.2), (6.0, -1.0), (-1.0, -1.0)))
    water = shapes.Box(lower=point(0.0, 0.0, 0.0), upper=point(3.0, 0.2, 0.4))
    scene.add_body(name="water", shape=water, material=materials.TaitFluid(bulk_modulus=2e5))
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip(cell="linear"))
    low, high = point(-2.0, -1.0, -1.0), point(0.0, 1.0, 1.0)
    piston: libmpm.shapes.Solid = shapes.Box(lower=low, upper=high)
    if shape == "prism":
        piston = prism(((-2.0, -1.0), (0.0, -1.0), (0.1, 1.0), (-2.0, 1.0)))
    way = [point(0.0, 0.0, 0.0), point(1.0, 0.0, 0.0), point(0.7, 0.0, 0.0)]
    scene.add_boundary(
        name="piston", shape=piston, response=boundaries.Slip(cell="linear"),
        motion=boundaries.Displacement(libmpm.TimeTable([0.0, 0.7, 1.0], way)),
        time=(0.0, 1e6) if searches else None,
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="bed", interval=0.05))
    return scene


@BACKENDS
@pytest.mark.parametrize(("dimension", "shape"), [(2, "box"), (2, "prism"), (3, "box")])
def test_what_is_known_has_the_bits_of_what_is_searched(dimension, shape, device, precision):  # noqa: F811
    runs = []
    for searches in (False, True):
        scene = flume(dimension, shape, searches=searches)
        runs.append(libmpm.Simulation(scene, device=device, precision=precision, threads=1))
        runs[-1].run(until=0.9, progress=False)
    known, searched = runs
    # The piston has driven the water on, past where its nodes were known.
    assert np.asarray(known.particles["water"]["position"])[:, 0].min() > 0.7
    for name in ("id", "position", "velocity"):
        a, b = (np.asarray(s.particles["water"][name]) for s in (known, searched))
        np.testing.assert_array_equal(a, b, name)
    np.testing.assert_array_equal(known.sensors["load"].values, searched.sensors["load"].values)
