"""Water in the gap below what stands on a bed: weight, friction, flotation, and what has none.

Expected duration: 40 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, flumes, materials, shapes
from support.branches import assert_same
from support.devices import device  # noqa: F401
from support.uplift_scenes import DENSITY, GRAVITY, HALF, HIGH, loads, stream, tank


def area(dimension: int) -> float:
    return (2 * HALF) ** (dimension - 1)


@pytest.mark.parametrize(
    ("dimension", "cell", "contact"),
    [(2, 0.0125, False), (2, 0.00625, False), (2, 0.025, False), (3, 0.0125, False),
     (2, 0.0125, True)],
)  # fmt: skip
def test_water_takes_its_part_of_the_weight(dimension, cell, contact, device):
    """Uplift is p A of the water's depth, and bed and gap together bear all of the weight."""
    given: dict[str, Any] = {"dimension": dimension, "contact": contact, "density": 1500.0}
    depth = 0.045
    sim = libmpm.Simulation(tank(cell, depth=depth, **given), device=device, threads=1)
    sim.run(until=0.8, progress=False)
    lifted = -loads(sim, "bed-friction", 0.6)[1]
    # Water beside solids with velocities of their own is not at rest yet.
    bound = 0.05 if contact else 0.02
    assert lifted == pytest.approx(1000 * GRAVITY * depth * area(dimension), rel=bound)
    weight = GRAVITY * sum(float(np.sum(sim.particles[b]["mass"])) for b in sim.particles)
    borne = -loads(sim, "bed", 0.6)[1]
    assert borne + lifted == pytest.approx(weight, rel=2e-3)
    # As sealed as it was.
    sim = libmpm.Simulation(tank(cell, uplift=False, **given), device=device, threads=1)
    sim.run(until=0.8, progress=False)
    assert loads(sim, "bed-friction", 0.6)[1] == pytest.approx(0.0, abs=1e-3 * weight)


@pytest.mark.parametrize("cell", [0.0125, 0.00625])
@pytest.mark.parametrize("place", [0.0, 0.25, 0.5, 0.75, 0.9])
def test_it_is_the_same_wherever_a_surface_is_in_its_cell(cell, place, device):
    """A bed of any shape, its plane at any height in the cells."""
    depth = 0.045
    scene = tank(cell, density=1500.0, depth=depth, surface=place)
    sim = libmpm.Simulation(scene, device=device, threads=1)
    sim.run(until=0.5, progress=False)
    lifted = -loads(sim, "bed-friction", 0.35)[1]
    assert lifted == pytest.approx(1000 * GRAVITY * depth * area(2), rel=0.015)


@pytest.mark.parametrize("slope", [0.05, 0.2])
@pytest.mark.parametrize("place", [0.3, 0.75])
def test_it_presses_across_a_bed_that_leans(place, slope, device):
    """Across it p of the mean depth, and a block that friction holds stays."""
    depth = 0.045
    scene = tank(density=1500.0, depth=depth, surface=place, slope=slope, friction=2.0)
    sim = libmpm.Simulation(scene, device=device, threads=1)
    before = sim.particles["debris-1"]["position"].mean(axis=0)
    sim.run(until=0.5, progress=False)
    across = np.array([-slope, 1.0]) / np.hypot(1.0, slope)
    lifted = -loads(sim, "bed-friction", 0.35) @ across
    full = 1000 * GRAVITY * depth * area(2) * np.hypot(1.0, slope)
    assert lifted == pytest.approx(full, rel=0.08)
    moved = sim.particles["debris-1"]["position"].mean(axis=0) - before
    assert np.abs(moved).max() < 2e-4


@pytest.mark.parametrize(("density", "depth"), [(1500.0, 0.045), (987.0, 0.03)])
def test_friction_is_that_of_what_is_left_of_the_weight(density, depth):
    """μ (W - U), U as measured: with μ 0.4 within a tenth while the block slides."""
    sim = libmpm.Simulation(tank(density=density, depth=depth, speed=0.2), device="cpu", threads=1)
    sim.run(until=0.05, progress=False)
    along, down = loads(sim, "bed-friction", 0.02)
    pressed = density * GRAVITY * HIGH * 2 * HALF + down
    assert pressed < 0.7 * density * GRAVITY * HIGH * 2 * HALF
    assert along / pressed == pytest.approx(0.4, rel=0.1)
    assert sim.particles["debris-1"]["velocity"][:, 0].mean() > 0


@pytest.mark.parametrize("depth", [0.025, 0.0375, 0.05])
@pytest.mark.parametrize("cell", [0.025, 0.0125])
def test_water_beside_a_base_does_not_rub(cell, depth, device):
    """In a stream of its own speed μ (W - U), to 0.06 of μ W: that of HDPE that floats is nothing.

    With the part of nodes' masses for what rubs it is 0.13 of μ W at 0.05 m in the coarse cells.
    """
    sim = libmpm.Simulation(stream(cell, depth=depth), device=device, threads=1)
    sim.run(until=0.1, progress=False)
    along, down = loads(sim, "bed-friction", 0.03)
    weight = DENSITY * GRAVITY * HIGH * 2 * HALF
    assert -down == pytest.approx(1000 * GRAVITY * depth * 2 * HALF, rel=0.03)
    assert along == pytest.approx(0.4 * max(0.0, weight + down), abs=0.06 * 0.4 * weight)


def way(scene: libmpm.Scene, until: float) -> tuple[float, float]:
    """How far the block has gone along the flow and up, m."""
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    before = sim.particles["debris-1"]["position"].mean(axis=0)
    sim.run(until=until, progress=False)
    x, z = sim.particles["debris-1"]["position"].mean(axis=0) - before
    return float(x), float(z)


@pytest.mark.parametrize("surface", [None, 0.4])
def test_what_is_lighter_than_water_comes_off_the_bed(surface):
    """Friction of 1 holds it where its base is sealed, and not where water is below it."""
    light: dict[str, Any] = {"density": 300.0, "friction": 1.0, "speed": 0.2, "surface": surface}
    free, sealed = (way(tank(uplift=u, **light), 0.3) for u in (True, False))
    assert free[0] > 2 * sealed[0]
    assert free[1] > 0.002 > 10 * abs(sealed[1])
    # What is heavier stays.
    assert abs(way(tank(density=1500.0), 0.3)[1]) < 5e-4


def test_one_dry_side_has_half_of_it():
    """Water held back on one side: p falls to nothing on the other, U = p A / 2."""
    lifted = []
    for end in (0.3, 0.0):
        scene = tank(density=3000.0, beside=(-0.3, end), friction=2.0)
        sim = libmpm.Simulation(scene, device="cpu", threads=1)
        sim.run(until=0.3, progress=False)
        lifted.append(-loads(sim, "bed-friction", 0.2)[1])
    assert lifted[1] == pytest.approx(0.5 * lifted[0], rel=0.02)


def test_where_the_bed_ends_a_dry_edge_has_nothing():
    """`within` ends beside the block: as on a bed that goes on."""
    lifted = []
    for end in (None, HALF + 0.005):
        scene = tank(density=3000.0, beside=(-0.3, 0.0), friction=2.0)
        if end is not None:
            here = shapes.Box(lower=(-1.0, -1.0), upper=(end, 1.0))
            scene.replace("bed-friction", kind="boundary", within=here)
        sim = libmpm.Simulation(scene, device="cpu", threads=1)
        sim.run(until=0.3, progress=False)
        lifted.append(-loads(sim, "bed-friction", 0.2)[1])
    assert lifted[1] == pytest.approx(lifted[0], rel=0.02)


@pytest.mark.parametrize("surface", [None, 0.25, 0.6])
def test_a_boundary_limited_from_its_bed_on_has_all_of_it(surface):
    """Rows below the plane bear what stands on it, though `within` ends there."""
    scene = tank(density=1500.0, surface=surface)
    here = shapes.Box(lower=(-0.25, 0.0), upper=(0.25, 0.12))
    scene.replace("bed-friction", kind="boundary", within=here)
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    sim.run(until=0.3, progress=False)
    lifted = -loads(sim, "bed-friction", 0.2)[1]
    assert lifted == pytest.approx(1000 * GRAVITY * 0.045 * area(2), rel=0.03)


def test_a_box_beside_a_base_closes_it():
    """Water on one side and a structure at the other: p of the open side, not half of it."""
    scene = tank(density=1500.0, beside=(-0.3, -HALF))
    block = shapes.Box(lower=(HALF, -1.0), upper=(0.2, 1.0))
    scene.add_boundary(name="box", shape=block, response=boundaries.Slip(cell="held"))
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    sim.run(until=0.3, progress=False)
    lifted = -loads(sim, "bed-friction", 0.2)[1]
    assert lifted == pytest.approx(1000 * GRAVITY * 0.045 * area(2), rel=0.03)


def test_a_load_cell_hears_of_the_face_that_it_is_of():
    scene = tank(density=3000.0)
    for name, face in (("top", "y+"), ("side", "x-")):
        cell = libmpm.sensors.LoadCell(boundary="bed-friction", faces=(face,), interval=0.002)
        scene.add_sensor(name=name, sensor=cell)
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    sim.run(until=0.1, progress=False)
    assert loads(sim, "side")[1] == 0.0
    assert loads(sim, "top")[1] == loads(sim, "bed-friction")[1] < -30


def test_a_dry_bed_has_the_bits_of_one_without(device):
    """Where no water is near, nothing changes; where it is, it does."""
    made = []
    for uplift in (True, False):
        scene = tank(beside=(-0.3, -0.2), depth=0.02, uplift=uplift)
        made.append(libmpm.Simulation(scene, device=device, threads=1))
        made[-1].step(20)
    assert_same(*made)
    wet = [libmpm.Simulation(tank(uplift=u), device=device, threads=1) for u in (True, False)]
    for sim in wet:
        sim.step(20)
    a, b = (sim.particles["debris-1"]["position"] for sim in wet)
    assert np.abs(a - b).max() > 1e-6


@pytest.mark.parametrize("scheme", ["APIC", "AFLIP"])
def test_readers_and_checkpoints_change_no_bit(tmp_path, device, scheme):
    """What the gap adds is not in the sums that a reader or a checkpoint sees."""
    scene = tank()
    data = scene.to_dict()
    told: dict[str, Any] = {"scheme": scheme} | ({"flip": 0.95} if scheme == "AFLIP" else {})
    data["method"]["transfer"] = libmpm.methods.Transfer(**told).to_dict()
    scene = libmpm.Scene.from_dict(data)
    plain, read = (libmpm.Simulation(scene, device=device, threads=1) for _ in range(2))
    plain.step(60)
    for _ in range(30):
        read.step(1)
        assert np.isfinite(read.particles["debris-1"]["velocity"]).all()
    read.save_checkpoint(tmp_path / "half.npz")
    read.step(30)
    resumed = libmpm.Simulation.resume(tmp_path / "half.npz", device=device)
    resumed.step(30)
    assert_same(plain, read)
    assert_same(plain, resumed)


@pytest.mark.parametrize("cells", [5, 6])
@pytest.mark.parametrize("spacing", [None, 0.05])
def test_linear_cells_in_the_beds_place_are_found_wherever_it_is(cells, spacing):
    """Points of a lattice stand on the plane's rows, or between them."""
    scene = tank(0.025, surface=0.0)
    corner = -0.05
    bed = shapes.HalfSpace(point=(0.0, corner + 0.025 * cells), normal=(0.0, 1.0))
    scene.replace("bed", kind="boundary", shape=bed, spacing=spacing,
                  response=boundaries.Separable(cell="linear"))  # fmt: skip
    refused_of(scene, "beside boundary 'bed', a surface in its place", shape=bed)


def refused_of(scene: libmpm.Scene, message: str, **changes: Any) -> None:
    with pytest.raises(libmpm.SceneError, match=message):
        scene.replace("bed-friction", kind="boundary", **changes)
        scene.validate()


def refused(message: str, **changes: Any) -> None:
    refused_of(tank(), message, **changes)


def test_refusals():
    refused("uplift is 1; expected True or False", uplift=1)
    refused("uplift is True for all bodies; expected solids alone", bodies=())
    refused("uplift is True with body 'water', a fluid", bodies=("water",))
    moving = libmpm.boundaries.Displacement(libmpm.TimeTable([0, 1], [(0, 0), (0.1, 0)]))
    refused("uplift is True of a boundary that moves; expected one at rest", motion=moving)
    scene = tank()
    scene.replace("water", kind="body", fbar=None)
    with pytest.raises(libmpm.SceneError, match="fluids whose volumes are averaged"):
        scene.validate()
    refused("uplift is True of a Sticky boundary", response=boundaries.Sticky())
    plane = shapes.HalfSpace(point=(0.0, 0.0), normal=(0.0, 1.0))
    lined = boundaries.Separable(cell="linear")
    refused("beside boundary 'bed-friction', a surface in its place, or that", shape=plane,
            response=lined)  # fmt: skip
    scene = tank(surface=0.5)
    scene.replace("bed", kind="boundary", response=lined)
    with pytest.raises(libmpm.SceneError, match="beside boundary 'bed', a surface in its place"):
        scene.validate()
    scene.replace("bed", kind="boundary", response=boundaries.Slip(cell="held"),
                  layer=boundaries.DecayLayer(function="linear", thickness=3.0))  # fmt: skip
    with pytest.raises(libmpm.SceneError, match="whose layer holds nodes by parts"):
        scene.validate()
    scene = tank()
    ramp = shapes.HalfSpace(point=(-0.1, 0.0), normal=(-0.05, 1.0))
    flumes.add_bed_friction(scene, ramp, {"debris-1": 0.4}, "ramp", uplift=True)
    with pytest.raises(libmpm.SceneError, match="body 'debris-1', which boundary 'ramp' lifts too"):
        scene.validate()
    refused("uplift is True with a layer", shape=plane, layer=boundaries.DecayLayer())
    with pytest.raises(libmpm.SceneError, match="uplift on boundary 'bed-friction'"):
        libmpm.Simulation(tank(), device=["cpu", "cpu"]).step(1)


def test_bodies_of_one_friction_and_two_densities_have_two_boundaries():
    scene = tank()
    scene.add_body(
        name="wood", shape=shapes.Box(lower=(0.2, 0.0), upper=(0.25, 0.05)),
        material=materials.FixedCorotated(density=648.0, youngs_modulus=3e4, poissons_ratio=0.4),
    )  # fmt: skip
    bed = next(b.shape for b in scene.boundaries if b.name == "bed")
    both = {"debris-1": 0.4, "wood": 0.4}
    names = flumes.add_bed_friction(scene, bed, both, "rough", uplift=True)
    assert names == ("rough-1", "rough-2")
    assert flumes.add_bed_friction(scene, bed, both, "one") == ("one",)
    with pytest.raises(libmpm.SceneError, match="expected one density; give a boundary for each"):
        scene.replace("bed-friction", kind="boundary", bodies=("debris-1", "wood"))
        scene.validate()


@pytest.mark.parametrize(
    ("changes", "warned"),
    [({"uplift": False}, True), ({}, False), ({"uplift": False, "contact": True}, False),
     ({"uplift": False, "density": 1500.0}, False)],
)  # fmt: skip
def test_a_sealed_base_is_warned_of(changes, warned):
    """Of what is lighter than the water, and shares its velocity."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        tank(**changes).validate()
    sealed = [str(w.message) for w in said if "its base is sealed" in str(w.message)]
    assert bool(sealed) == warned
    if warned:
        (one,) = sealed
        assert "body 'debris-1': stands on boundary 'bed'" in one and "uplift=True" in one
