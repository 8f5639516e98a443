"""Energies of the grid: against closed forms and those of the particles.

Expected duration: 2 s.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import libmpm
from libmpm import sensors, shapes
from support.sensing_scenes import G, add_block, busy_scene, open_scene, simulate

STIFFNESS, EXPONENT = 2e6, 7.15


def pressure(j):
    """Return that of the volume law, Pa."""
    return STIFFNESS / EXPONENT * (j**-EXPONENT - 1)


def energies(scene, steps):
    """Sums over all nodes of each energy, and what `Energy` has, of the last sample."""
    names = ("kinetic_energy", "kinetic_energy_before", "potential_energy", "volume_energy")
    for name in names:
        sensor = sensors.GridSensor(attribute=name, operation="sum")
        scene.add_sensor(name=name, sensor=sensor)
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    sim = simulate(scene)
    sim.step(steps)
    row = dict(zip(sim.sensors["energy"].components, sim.sensors["energy"].values[-1], strict=True))
    return {name: sim.sensors[name].values[-1, 0] for name in names}, row, sim


def still_block(velocity=(0.0, 0.0)):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(-1.0, -2.0), upper=(1.0, 2.0), gravity=(0.0, -G)
    )
    material = libmpm.materials.TaitFluid(
        density=1000.0, bulk_modulus=STIFFNESS, exponent=EXPONENT, viscosity=0.0
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(-0.3, -0.2), upper=(0.2, 0.4)), material=material,
        particles_per_cell=9, velocity=velocity,
    )  # fmt: skip
    return scene


def test_energies_of_the_grid_in_rigid_motion_are_those_of_the_particles():
    """Splines add up to one and to the place: no energy is hidden from the grid."""
    found, row, sim = energies(still_block(velocity=(2.0, -1.0)), 1)
    mass = sim.particles["water"]["mass"].sum()
    before, after = 0.5 * mass * 5.0, 0.5 * mass * (4.0 + (1.0 + G * sim.dt) ** 2)
    assert sim.sensors["kinetic_energy_before"].values[0, 0] == pytest.approx(before, rel=1e-12)
    assert sim.sensors["kinetic_energy"].values[0, 0] == pytest.approx(after, rel=1e-12)
    assert found["kinetic_energy"] == pytest.approx(row["kinetic"], rel=1e-9)
    assert found["potential_energy"] == pytest.approx(row["potential"], rel=1e-12)


@pytest.mark.parametrize("ratio", [0.999, 0.9, 1.0004])
def test_energy_of_averaged_volumes_is_that_of_an_even_one(ratio):
    scene = still_block()
    scene.add_sensor(
        name="e", sensor=sensors.GridSensor(attribute="volume_energy", operation="sum")
    )
    scene.add_sensor(name="all", sensor=sensors.Energy())
    sim = simulate(scene)
    water = sim.particles["water"]
    water["pressure"] = np.full(len(water["id"]), pressure(ratio))
    sim.step(1)
    want = quad(pressure, ratio, 1.0)[0] * 0.3  # m², its first volume
    assert sim.sensors["e"].values[0, 0] == pytest.approx(want, rel=1e-6)
    elastic = sim.sensors["all"]["elastic"][0]
    assert sim.sensors["e"].values[0, 0] == pytest.approx(elastic, rel=1e-6)


def test_means_have_less_energy_than_what_they_are_of():
    """Velocities of particles are means over nodes, volumes of nodes are means over particles."""
    scene = busy_scene()
    scene.add_sensor(name="fluid", sensor=sensors.Energy(body="water"))
    found, row, sim = energies(scene, 40)
    assert 0.5 * found["kinetic_energy"] < row["kinetic"] < found["kinetic_energy"]
    elastic = sim.sensors["fluid"]["elastic"][-1]
    assert 0.5 * elastic < found["volume_energy"] < elastic


def test_scenes_without_a_fluid_have_no_energy_of_averaged_volumes():
    scene = open_scene()
    add_block(scene, lower=(0.6, 1.0), upper=(1.0, 1.6))
    with pytest.raises(libmpm.SceneError, match="no body is a fluid"):
        scene.add_sensor(name="e", sensor=sensors.GridSensor(attribute="volume_energy"))
        scene.validate()
