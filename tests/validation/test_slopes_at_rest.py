"""Water at rest over slopes stays at rest, with the cells that a bed has by default.

Expected duration: 60 s (three resolutions, steep ones and AFLIP over seven seconds).
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, methods, shapes

pytestmark = pytest.mark.validation

WATER, GRAVITY = 1000.0, 9.81


def over(bed, dx, lower, upper, transfer="APIC", walls=True):
    """Water of level 1 m over a bed, by default in a tank."""
    scene = libmpm.Scene(
        dimension=len(lower), cell_size=dx, lower=lower, upper=upper,
        gravity=(*(0.0,) * (len(lower) - 1), -GRAVITY), method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    room = shapes.Box(lower=lower, upper=upper)
    water = materials.TaitFluid(density=WATER, bulk_modulus=200 * WATER * GRAVITY, viscosity=0.0)
    scene.add_body(
        name="water", shape=shapes.basin(level=1.0, bed=bed, within=room), hydrostatic=1.0,
        material=water, sampling=shapes.Columns(),
    )  # fmt: skip
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
    if walls:
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


def basin(degrees, cells, transfer="APIC"):
    """Between two slopes that meet, which the water's surface ends on."""
    dx, rise = 1.0 / cells, np.tan(np.deg2rad(degrees))
    half = np.ceil(1 / rise / dx + 4) * dx
    sides = [shapes.HalfSpace(point=(0.0, 0.0), normal=(s * rise, 1.0)) for s in (-1.0, 1.0)]
    bed = shapes.Union(parts=tuple(sides))
    return over(bed, dx, (-half, -4 * dx), (half, 1 + 6 * dx), transfer, walls=False)


def stirred(sim):
    """Root mean square speed of the nodes, over the speed of a wave, 1."""
    return float(np.sqrt((sim.grid["velocity"] ** 2).sum(axis=1).mean() / GRAVITY))


def run(scene, device, steps):
    sim = libmpm.Simulation(scene, device=device, precision="single", threads=1)
    sim.step(steps)
    return sim


@pytest.mark.parametrize("cells", [8, 16, 32])
def test_at_ten_degrees(cells, device):
    """Held nodes stir it by 0.0058, free nodes of lines that do not move as one by 0.0063."""
    sim = run(basin(10.0, cells), device, 250 * cells)
    assert stirred(sim) <= 1e-3
    assert sim.particles["water"]["position"][:, 1].max() <= 1.0


@pytest.mark.parametrize("degrees", [20.0, 30.0])
def test_on_steep_slopes(degrees, device):
    """Held nodes stir it by 0.005."""
    assert stirred(run(basin(degrees, 16), device, 12_000)) <= 2.5e-3


def test_with_a_transfer_that_keeps_velocities(device):
    """It keeps what stirs it too: held nodes 0.0067 by now, and rising."""
    transfer = methods.Transfer(scheme="AFLIP", flip=0.95)
    assert stirred(run(basin(10.0, 16, transfer), device, 12_000)) <= 1e-3


@pytest.mark.parametrize("across", ["x", "y"])
def test_in_space_between_side_walls(across, device):
    """A slope of one in three between walls along it, along either axis."""
    along = 0 if across == "y" else 1
    size, normal, point = [4.0, 4.0, 1.5], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]
    size[1 - along], normal[along], point[along] = 1.0, -1.0 / 3, 0.5
    bed = shapes.HalfSpace(point=tuple(point), normal=tuple(normal))
    scene = over(bed, 1.0 / 8, (0.0, 0.0, 0.0), tuple(size))
    sim = run(scene, device, 1_000)
    water = sim.particles["water"]
    place, speed = water["position"], water["velocity"] / np.sqrt(GRAVITY)
    assert np.abs(speed[:, 1 - along]).max() <= 1e-3  # nothing sets it in motion across
    # Away from the slope's foot, where the floor has lines of its own; between held nodes 0.003.
    away = place[:, along] > 1.2
    assert np.sqrt((speed[away] ** 2).sum(axis=1).mean()) <= 2.5e-3


def test_beside_a_wall_that_the_slope_runs_to(device):
    """Held nodes stir it by 0.0058, lines up to the wall start a roller of 0.02 to 0.1 there.

    Where those of the bed are held and those of the wall lead, neither opens the other's plane: a
    bed that changed velocities across the wall let water creep through it by 4 mm/s.
    """
    dx, rise = 1.0 / 16, np.tan(np.deg2rad(2.386))
    bed = shapes.HalfSpace(point=(0.0, 0.3), normal=(-rise, 1.0))
    scene = over(bed, dx, (-8.0, -4 * dx), (8.0, 1 + 6 * dx))
    sim = run(scene, device, 8_000)
    water = sim.particles["water"]
    assert stirred(sim) <= 3e-3
    assert water["position"][:, 0].min() >= -8.0
    corner = (water["position"] < (-7.0, 0.25)).all(axis=1)
    assert np.abs(water["velocity"][corner, 0].mean()) / np.sqrt(GRAVITY) <= 4e-3
