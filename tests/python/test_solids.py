"""Solids in motion, on the CPU and, where there is one, on a CUDA device."""

# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from support import scenes
from support.devices import device  # noqa: F401

DENSITY, YOUNG, POISSON = 800.0, 1e6, 0.3
ELASTIC = {"density": DENSITY, "youngs_modulus": YOUNG, "poissons_ratio": POISSON}
STRONG = 1e9  # Pa: nothing flows
STEPS = 60
SOLIDS = {
    "fixed-corotated": materials.FixedCorotated(**ELASTIC),
    "neo-hookean": materials.NeoHookean(**ELASTIC),
    "hencky": materials.StVenantKirchhoffHencky(**ELASTIC),
    "von-mises": materials.VonMises(**ELASTIC, yield_stress=STRONG),
    "drucker-prager": materials.DruckerPrager(**ELASTIC, cohesion=STRONG, tension_cutoff=STRONG),
    "hypoelastic": materials.Hypoelastic(**ELASTIC),
}


def vibrating(material, dimension, precision, device, speed=0.01):
    """A free block whose ends move apart at `speed`, m/s: how far its particles come, m."""
    scene = scenes.free_body(dimension)
    body = scene.bodies[0]
    other = libmpm.Scene(
        dimension=dimension, cell_size=scene.cell_size, lower=scene.lower, upper=scene.upper,
        gravity=(0.0,) * dimension, method=libmpm.Method(transfer="APIC"),
    )  # fmt: skip
    other.add_body(name="solid", shape=body.shape, material=material)
    spec = scenes.specification(other, precision=precision)
    spec["time_step"] = 1e-4
    x = spec["bodies"][0]["position"]
    middle = x.mean(axis=0)
    velocity = np.zeros_like(x)
    velocity[:, 0] = speed * np.sin(np.pi * (x[:, 0] - middle[0]) / 0.5)
    velocity[:, 1] = speed * np.sin(np.pi * (x[:, 0] - middle[0]) / 0.5)
    spec["bodies"][0]["velocity"] = velocity
    machine = scenes.engine(spec, device)
    scenes.advance(machine, STEPS)
    return scenes.by_id(machine, 0, "position") - x


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", SOLIDS)
def test_small_strains_are_hookes(name, dimension, device):
    """Strains of 1e-3: all laws have Hooke's tangent, and differ by parts of the strain."""
    expected = vibrating(materials.LinearElastic(**ELASTIC), dimension, "double", device)
    found = vibrating(SOLIDS[name], dimension, "double", device)
    size = np.abs(expected).max()
    assert size > 3e-5
    assert 0 < np.abs(found - expected).max() < 5e-3 * size
    single = vibrating(SOLIDS[name], dimension, "single", device)
    # Every step rounds a particle's place in its cell.
    assert np.abs(single - found).max() < 4 * np.sqrt(STEPS) * 2.0**-25 * 0.1


def energies(sim):
    return np.asarray(sim.sensors["energy"].values)


def test_a_metal_bar_flows_against_a_wall(device):
    """Taylor's bar in plane strain: its length falls to L exp(-ρ v² / 2 σ), σ = 2 σ_y / √3.

    Taylor's estimate neglects the elastic strain and takes the front of the flow for thin: it is
    good to a tenth (Taylor 1948, Wilkins and Guinan 1973). Energy is only ever lost.
    """
    length, yield_stress, share = 0.4, 1e6, 0.15
    strength = 2 / np.sqrt(3) * yield_stress
    speed = np.sqrt(2 * strength * share / DENSITY)
    dx = 0.01
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(0.6, 0.4), gravity=(0.0, 0.0)
    )
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=(0.0, 0.16), upper=(length, 0.24)),
        material=materials.VonMises(
            density=DENSITY, youngs_modulus=4e8, poissons_ratio=0.3, yield_stress=yield_stress
        ),
        velocity=(-speed, 0.0),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy(interval=1e-4))
    sim = libmpm.Simulation(scene, device=device, precision="double")
    sim.run(until=2.2 * length / speed, progress=False)
    bar = sim.particles["bar"]
    x = bar["position"][:, 0]
    shortened = (x.max() - x.min() + dx / 2) / length
    assert shortened == pytest.approx(np.exp(-share), rel=0.1)
    plastic = bar["plastic_strain"]
    assert plastic.min() >= 0
    assert 0.1 < plastic.max() < 5
    assert set(np.unique(bar["yields"])) <= {0.0, 1.0}
    # The head has flowed, the tail has not.
    assert plastic[x < 0.05].mean() > 10 * plastic[x > x.max() - 0.05].mean()
    sums = energies(sim)[:, :3].sum(axis=1)
    assert sums[-1] < 0.05 * sums[0]
    assert np.diff(sums).max() < 2e-3 * sums[0]


@pytest.mark.parametrize("angle", [0.0, 35.0])
def test_sand_comes_to_rest_as_its_friction_has_it(angle, device):
    """A column collapses: with friction it stops as a heap, without it runs flat."""
    n, side = 12, 0.2
    dx = side / n
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(4 * side, 1.25 * side),
        gravity=(0.0, -9.81),
    )  # fmt: skip
    scene.add_body(
        name="sand",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(side, side)),
        material=materials.DruckerPrager(density=1600.0, youngs_modulus=1e6, friction_angle=angle),
    )
    slip, sticky = boundaries.Slip(), boundaries.Sticky()
    scene.add_boundary(name="sides", shape=shapes.DomainWalls(faces=("x-", "x+")), response=slip)
    scene.add_boundary(name="floor", shape=shapes.DomainWalls(faces=("y-",)), response=sticky)
    sim = libmpm.Simulation(scene, device=device, precision="single")
    sim.run(until=3.5 * np.sqrt(side / 9.81), progress=False)
    sand = sim.particles["sand"]
    reach = (np.quantile(sand["position"][:, 0], 0.99) - side) / side
    fall = np.sqrt(2 * 9.81 * side)
    assert sand["plastic_strain"].min() >= 0
    # No stress in tension: what is thrown up is not pulled back.
    assert sand["pressure"].min() > -1e-3 * 1600 * 9.81 * side
    if angle:
        assert 0.3 < reach < 1.2
        assert np.abs(sand["velocity"]).mean() < 0.02 * fall
        assert sand["position"][sand["position"][:, 0] < 2 * dx, 1].max() > 0.8 * side
    else:
        assert reach > 1.8
