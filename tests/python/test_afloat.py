"""Bodies at floating equilibrium against closed forms, and one that stays where it is put."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes


def place(shape, density, level=2.0, **more):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return shapes.afloat(shape=shape, density=density, level=level, **more)


@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.5, 0.95])
@pytest.mark.parametrize("dimension", [2, 3])
def test_box(dimension, ratio):
    """d = ρ/ρ_f h, and GM = ρ_f b²/(12 ρ h) - h (1 - ρ/ρ_f)/2 of the flat box."""
    size = (1.2, 0.15) if dimension == 2 else (1.2, 0.6, 0.15)
    lower = (*(3.0, -1.0, 5.0)[: dimension - 1], 7.0)
    box = shapes.Box(lower=lower, upper=tuple(a + s for a, s in zip(lower, size, strict=True)))
    found = place(box, 1000 * ratio)
    assert isinstance(found.shape, shapes.Box)
    assert found.draught == pytest.approx(0.15 * ratio, rel=1e-12)
    assert found.shape.lower[-1] == pytest.approx(2.0 - 0.15 * ratio, abs=1e-12)
    assert found.shape.lower[:-1] == pytest.approx(lower[:-1])
    assert found.displaced == pytest.approx(ratio * math.prod(size))
    assert found.centre_of_gravity[-1] == pytest.approx(2.0 + 0.15 * (0.5 - ratio))
    assert found.centre_of_buoyancy[-1] == pytest.approx(2.0 - 0.15 * ratio / 2)
    widths = [1.2] if dimension == 2 else [0.6, 1.2]  # about x the width along y counts
    expected = [b**2 / (12 * 0.15 * ratio) - 0.15 * (1 - ratio) / 2 for b in widths]
    assert found.metacentric_height == pytest.approx(expected, rel=1e-4)
    assert found.stable
    assert found.offset == pytest.approx(0.0, abs=1e-9)


def test_upright_and_lying_cylinder():
    """Upright as a box; lying, the wet segment R² (θ - sin θ)/2 has the share of the density."""
    upright = shapes.Cylinder(start=(0, 0, 0), end=(0, 0, 0.1), radius=0.3)
    found = place(upright, 400.0)
    assert found.draught == pytest.approx(0.04, rel=1e-9)
    moment = math.pi * 0.3**4 / 4
    expected = moment / (math.pi * 0.3**2 * 0.04) - 0.03
    assert found.metacentric_height == pytest.approx([expected] * 2, rel=2e-3)

    theta = 2.0
    share = (theta - math.sin(theta)) / (2 * math.pi)
    depth = 0.3 * (1 - math.cos(theta / 2))
    lying = shapes.Cylinder(start=(0, 0, 0), end=(2.0, 0, 0), radius=0.3)
    disc = shapes.Sphere(centre=(0, 0), radius=0.3)
    for shape, bound in ((lying, 1e-3), (disc, 2e-4)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", libmpm.ModelWarning)
            found = shapes.afloat(shape=shape, density=1000 * share, level=2.0)
        assert found.draught == pytest.approx(depth, abs=bound * 0.6)
        # A circle's buoyancy passes through its middle at any angle.
        assert found.metacentric_height[0] == pytest.approx(0.0, abs=4e-3 * 0.6)
    assert place(shapes.Sphere(centre=(0, 0, 0), radius=1.0) - shapes.Box(
        lower=(-1, -1, 0.5), upper=(1, 1, 1)), 500.0).stable  # fmt: skip


def test_half_of_a_sphere_is_at_its_equator():
    found = shapes.afloat(shape=shapes.Sphere(centre=(1, 2, 3), radius=0.4), density=512, level=0,
                          fluid_density=1024)  # fmt: skip
    assert found.draught == pytest.approx(0.4, abs=1e-4)
    assert found.centre_of_buoyancy[2] == pytest.approx(-3 / 8 * 0.4, abs=1e-3)
    assert found.shape.bounds()[0][2] == pytest.approx(-0.4, abs=1e-4)


def test_other_axes_and_densities_of_water():
    box = shapes.Box(lower=(0, 0, 0), upper=(0.2, 1, 1))
    found = place(box, 205.0, level=-1.0, fluid_density=1025.0, axis="x")
    assert found.draught == pytest.approx(0.04)
    assert found.shape.lower == pytest.approx((-1.04, 0, 0))


def test_tall_and_lopsided_bodies_are_remarked_upon():
    tall = shapes.Box(lower=(0, 0), upper=(0.1, 1.0))
    with pytest.warns(
        libmpm.ModelWarning, match=r"metacentric height is -0\.2\d+ m; .* turns over"
    ):
        found = shapes.afloat(shape=tall, density=500, level=0)
    assert not found.stable
    wedge = shapes.Extrusion(profile=((0, 0), (1, 0), (1, 0.3)))
    with pytest.warns(libmpm.ModelWarning, match="beside that of gravity"):
        assert shapes.afloat(shape=wedge, density=500, level=0).offset > 0.01


def test_bodies_that_do_not_float_are_refused():
    box = shapes.Box(lower=(0, 0), upper=(1, 1))
    with pytest.raises(libmpm.SceneError, match=r"density is 1200 in a fluid of 1000.*it sinks"):
        shapes.afloat(shape=box, density=1200, level=0)
    with pytest.raises(libmpm.SceneError, match=r"draught is 0\.5 m above a bed 0\.3 m below"):
        shapes.afloat(shape=box, density=500, level=1.0, bed=0.7)
    with pytest.raises(libmpm.SceneError, match="expected a body"):
        shapes.afloat(shape=shapes.HalfSpace(point=(0, 0), normal=(0, 1)), density=500, level=0)
    with pytest.raises(libmpm.SceneError, match="axis is 'z'"):
        shapes.afloat(shape=box, density=500, level=0, axis="z")


def test_debris_that_is_put_afloat_starts_at_rest():
    """Its centre keeps within 1/100 of a cell for 1 s; half a cell higher it does not."""
    cell, level = 0.05, 0.6

    def travel(lift):
        scene = libmpm.Scene(
            dimension=2, cell_size=cell, lower=(0, 0), upper=(1.2, 1.0), gravity=(0, -9.81)
        )
        water = materials.TaitFluid(density=1000, bulk_modulus=1e6, viscosity=0.0)
        tank = shapes.Box(lower=(0, 0), upper=(1.2, level))
        scene.add_body(name="water", shape=tank, material=water, hydrostatic=level)
        block = shapes.Box(lower=(0.35, 0), upper=(0.85, 0.3))
        found = place(block, 500.0, level, bed=0.0)
        scene.add_body(
            name="block", shape=found.shape.moved((0, lift)), subtract_from=("water",),
            material=materials.FixedCorotated(
                density=500, youngs_modulus=1e6, poissons_ratio=0.0
            ),
        )  # fmt: skip
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
        tracker = sensors.BodyTracker(body="block", quantities=("centroid",), interval=0.02)
        scene.add_sensor(name="block", sensor=tracker)
        sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
        sim.run(until=1.0, progress=False)
        height = sim.sensors["block"].values[:, 1]
        return np.abs(height - height[0]).max() / cell

    assert travel(0.0) < 0.01
    assert travel(0.5 * cell) > 0.1
