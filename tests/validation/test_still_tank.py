"""Water at rest in a tank by smoothing over cells: Yang (2016) 5.1, T4 of the digest's section 10.

Expected duration: 10 s.
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm.analysis import Signal

pytestmark = pytest.mark.validation

DEPTH = WIDTH = 3.2
SIZE = 0.4
WEIGHT = 1000 * 10 * WIDTH * DEPTH


def tank(method, over="cell", until=3.0):
    """Eight spans of water along each axis, 3 x 3 particles a span, walls on nodes."""
    low, up = (-1.0, -1.0), (4.2, 7.4)
    scene = libmpm.Scene(
        dimension=2, cell_size=SIZE, lower=low, upper=up, gravity=(0.0, -10.0),
        method=libmpm.Method(
            transfer="FLIP", kernel=libmpm.methods.Kernel(name="linear", modified=True),
            time_step=0.1 * SIZE / 1483.2,
        ),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(WIDTH, DEPTH)),
        lattice=(24, 24),
        material=materials.TaitFluid(density=1000, bulk_modulus=2.2e9, viscosity=1e-3),
        hydrostatic=DEPTH,
        smoothing=libmpm.methods.Smoothing(method=method),
        assumed=libmpm.methods.AssumedFields(over=over),
    )
    # Nodes are the centres of the scene's cells: the last that a wall holds lie on its plane.
    walls = {
        "floor": (low, (up[0], 0.5 * SIZE), "y"),
        "left": (low, (0.5 * SIZE, up[1]), "x"),
        "right": ((WIDTH - 0.5 * SIZE, low[1]), up, "x"),
    }
    still = libmpm.TimeTable((0.0,), ((0.0, 0.0),))
    for name, (lower, upper, normal) in walls.items():
        scene.add_boundary(
            name=name, shape=shapes.Box(lower=lower, upper=upper), motion=still,
            response=boundaries.Prescribed(components=normal),
        )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="floor", interval=until / 60))
    scene.add_sensor(name="level", sensor=sensors.ColumnGauge(bed=0.0, interval=until / 60))
    sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
    sim.run(until=until, progress=False)
    return sim


def found(sim):
    """h_eq of (5.1), the last half of R_b of (5.2), pressures in the lowest spans."""
    water = sim.particles["water"]
    lowest = water["position"][:, 1] < SIZE
    load = sim.sensors["load"]
    ratio = Signal.from_series(load, "-force_y").value[load.time > 0.5 * sim.time] / WEIGHT
    column = np.floor(water["position"][lowest, 0] / SIZE).astype(int)
    pressure = np.bincount(column, water["pressure"][lowest]) / np.bincount(column)
    return sim.sensors["level"].values[:, 0], ratio, pressure


@pytest.mark.parametrize("method", ["C0", "F0AL1"])
def test_means_of_cells_hold_water_still(method):
    level, ratio, pressure = found(tank(method, until=0.1))
    assert level == pytest.approx(DEPTH, rel=1e-3)
    assert ratio == pytest.approx(1, rel=0.01)
    assert pressure == pytest.approx(30e3, rel=0.01)


def test_means_at_nodes_let_it_sink():
    sunk, _, _ = found(tank("NB", "node", until=0.15))
    held, _, _ = found(tank("F0AL1", until=0.15))
    assert sunk[-1] < held[-1] - 1e-3


@pytest.mark.parametrize("method", ["C0", "F0AL1"])
def test_for_three_seconds(method, full):
    level, ratio, pressure = found(tank(method))
    assert level == pytest.approx(DEPTH, rel=1e-3)
    assert ratio == pytest.approx(1, rel=0.01)
    assert pressure == pytest.approx(30e3, rel=0.01)
