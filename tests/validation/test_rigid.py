"""Rigid bodies in water and against structures, beside elastic ones (`docs/rigid.md`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import materials, sensors
from support import rigid_scenes as cases


def solid(density: float, youngs_modulus: float, poissons_ratio: float = 0.3) -> Any:
    """Return the elastic material beside the rigid one."""
    return materials.NeoHookean(
        density=density, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio
    )


def followed(scene: libmpm.Scene, until: float, interval: float, **options: Any) -> Any:
    """Return the samples of a BodyTracker on the block."""
    scene.add_sensor(name="place", sensor=sensors.BodyTracker(body="block", interval=interval))
    simulation = libmpm.Simulation(scene, device="cpu", **({"precision": "double"} | options))
    simulation.run(until=until)
    return simulation.sensors["place"]


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("density", [300.0, 500.0, 800.0])
def test_draught(density: float, precision: str) -> None:
    """Archimedes' draught within 0.15 cells, at rest and upright."""
    place = followed(cases.floating(density), 3.0, 0.02, precision=precision)
    height = place["centroid_y"]
    assert abs(height[place.time > 1].mean() - height[0]) * 8 < 0.15
    assert height[place.time > 1].std() * 8 < 0.05
    assert np.abs(place["angle"]).max() < 0.01


def test_draught_in_space() -> None:
    """A cube of 6 cells: within 0.15 cells, upright, carried by its weight."""
    scene = cases.pool(500.0)
    scene.add_sensor(name="motion", sensor=sensors.RigidMotion(body="block", interval=0.01))
    place = followed(scene, 0.5, 0.01, precision="single")
    height = place["centroid_z"]
    assert abs(height[place.time > 0.2].mean() - height[0]) * 60 < 0.15
    simulation = libmpm.Simulation(scene, device="cpu", precision="single")
    simulation.run(until=0.5)
    found = simulation.sensors["motion"]
    assert found["quaternion_w"].min() > 1 - 1e-6
    assert found["force_z"][found.time > 0.2].mean() == pytest.approx(0.5 * 9.81, rel=0.02)


def test_pile_comes_to_rest() -> None:
    """Turned squares fall on each other and on the floor: none leaves, energy only falls."""
    simulation = libmpm.Simulation(cases.pile(), device="cpu", precision="double")
    simulation.run(until=2.5)
    energy = simulation.sensors["energy"]
    total = energy["kinetic"] + energy["potential"]
    assert np.diff(total).max() < 1e-3 * total[0]
    assert energy["kinetic"][-1] < 1e-5 * energy["kinetic"].max()
    for body in simulation.scene.bodies:
        position = np.asarray(simulation.particles[body.name]["position"])
        assert position.min() > 0
        # A square of 0.1 m still.
        assert (
            np.ptp(position @ np.linalg.svd(position - position.mean(0))[2].T, axis=0).max() < 0.13
        )


def half_period(place: Any) -> float:
    """Return the time of the lowest place after a release."""
    height = place["centroid_y"]
    k = int(np.argmin(height))
    c = np.polyfit(place.time[k - 6 : k + 7], height[k - 6 : k + 7], 2)
    return float(-c[1] / (2 * c[0]))


def test_heave_beside_an_elastic_body() -> None:
    """The half period of a release from two cells: within 6 % of the elastic block's."""
    found = [
        half_period(followed(cases.floating(500.0, material, lift=2.0), 1.5, 0.005))
        for material in (None, solid(500.0, 1e6))
    ]
    assert found[0] == pytest.approx(found[1], rel=0.06)


def test_capsizing_block() -> None:
    """A tall block at 5 degrees falls over in water, in the time that an elastic one takes."""
    times = []
    for material in (None, solid(500.0, 1e6)):
        place = followed(cases.floating(500.0, material, degrees=5.0, wide=0.5), 3.0, 0.01)
        angle = np.degrees(np.abs(place["angle"]))
        assert angle.max() > 75
        times.append(float(place.time[np.argmax(angle > 40)]))
    assert times[0] == pytest.approx(times[1], rel=0.05)


def test_impact_on_an_elastic_column() -> None:
    """F = v √(k M) of a rigid body on a spring; stiffer elastic bars come near the rigid one.

    The column's own mass, a fifth of the bar's, is left out of the formula.
    """
    stiffness, mass = 1e7 * 0.1 / 0.25, 120.0
    peaks, steps = {}, {}
    for modulus in (None, 1e8, 1e9):
        debris = materials.Rigid(density=2000.0) if modulus is None else solid(2000.0, modulus, 0.0)
        simulation = libmpm.Simulation(
            cases.column(debris, 1e7, 0.25, 4), device="cpu", precision="double"
        )
        simulation.run(until=0.04)
        load = simulation.sensors["blow"]["normal"]
        peaks[modulus] = float(load.max() / math.sqrt(stiffness * mass))
        steps[modulus] = simulation.steps
        # It comes back with most of its speed: the impulse is nearly 2 M v.
        assert 1.85 < load.sum() * 2e-4 / mass < 2.0
    assert 0.9 < peaks[None] < 1.0
    assert abs(peaks[1e9] - peaks[None]) < 0.08
    assert abs(peaks[1e9] - peaks[None]) < abs(peaks[1e8] - peaks[None])
    assert steps[None] * 6 < steps[1e9]
