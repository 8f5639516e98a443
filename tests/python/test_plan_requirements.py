"""A scene pays only for what it uses: what the compiled plan says, and that the engine agrees."""

from __future__ import annotations

from typing import Any

import pytest

import libmpm

pytest.importorskip("libmpm._core")

WATER = libmpm.materials.TaitFluid(bulk_modulus=2e6)
WOOD = libmpm.materials.FixedCorotated(density=600.0, youngs_modulus=1e6)


def build(*, fbar: Any = "default", solid: bool = False, dimension: int = 3) -> libmpm.Scene:
    """A puddle of water, with a block beside it if asked."""
    scene = libmpm.Scene(
        dimension=dimension,
        cell_size=0.1,
        lower=(0.0,) * dimension,
        upper=(2.0,) * dimension,
        gravity=(0.0,) * (dimension - 1) + (-9.81,),
    )
    scene.add_body(
        name="water",
        shape=libmpm.shapes.Box(lower=(0.0,) * dimension, upper=(0.8,) * dimension),
        material=WATER,
        fbar=fbar,
    )
    if solid:
        scene.add_body(
            name="block",
            shape=libmpm.shapes.Box(lower=(1.2,) * dimension, upper=(1.6,) * dimension),
            material=WOOD,
        )
    scene.add_boundary(
        name="walls", shape=libmpm.shapes.DomainWalls(), response=libmpm.boundaries.Slip()
    )
    return scene


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_fluid_stores_no_deformation_gradient(dimension: int) -> None:
    plan = build(solid=True, dimension=dimension).plan(device="cpu")
    assert plan.columns("water") == ["position", "j", "id"]
    assert plan.columns("block") == ["position", "H", "id"]
    assert plan.bytes_per_particle("water") == 4 * (dimension + 1 + 1)
    assert plan.bytes_per_particle("block") == 4 * (dimension + dimension**2 + 1)


def test_a_viscous_body_limits_the_time_step_and_is_named() -> None:
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.0, 1.0))
    scene.add_body(
        name="mud",
        shape=libmpm.shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6)),
        material=libmpm.materials.TaitFluid(bulk_modulus=1e5, viscosity=1e3),
    )
    plan = scene.plan(device="cpu")
    assert plan.time_step == pytest.approx(0.1**2 / 8)
    assert plan.limited_by == "body 'mud': viscosity 1000 Pa·s"


def test_without_fbar_there_are_no_volume_channels() -> None:
    plain, smoothed = build(fbar=None).plan(device="cpu"), build().plan(device="cpu")
    assert plain.channels == ["mass", "momentum_x", "momentum_y", "momentum_z"]
    assert smoothed.channels == [*plain.channels, "mass*j:water"]
    # Two copies of the sums and one of the velocities, four bytes each.
    assert plain.bytes_per_node == 4 * (2 * 4 + 3)
    assert smoothed.bytes_per_node == 4 * (2 * 5 + 4)
    assert plain.bytes_per_particle("water") == smoothed.bytes_per_particle("water")


def test_the_volume_has_a_weight_of_its_own_only_beside_other_bodies() -> None:
    assert "mass:water" not in build().plan(device="cpu").channels
    assert "mass:water" in build(solid=True).plan(device="cpu").channels
    assert "mass:water" not in build(solid=True, fbar=None).plan(device="cpu").channels


def test_only_the_form_with_two_volumes_stores_two() -> None:
    two = build(fbar=libmpm.FBar(form="two-volume", length=0.1)).plan(device="cpu")
    assert two.columns("water") == ["position", "j", "j_smoothed", "id"]
    for form in ("one-volume", "one-volume-gradient"):
        plan = build(fbar=libmpm.FBar(form=form)).plan(device="cpu")
        assert plan.columns("water") == ["position", "j", "id"]


def test_velocity_is_stored_by_neither_pipeline_and_deposits_only_by_one() -> None:
    fused = build().plan(device="cpu", pipeline="fused")
    halves = build().plan(device="cpu", pipeline="two-pass")
    assert "velocity" not in fused.columns("water") + halves.columns("water")
    assert set(halves.columns("water")) - set(fused.columns("water")) == {"deposit"}
    assert fused.channels == halves.channels
    assert fused.time_step == halves.time_step


def test_mixed_precision_keeps_the_grid_single() -> None:
    """Twice the bytes a particle, the grid and what goes to it as in single; on CUDA alone."""
    single, mixed, double = (
        build().plan(device="cuda", precision=p, pipeline="two-pass")
        for p in ("single", "mixed", "double")
    )
    assert single.bytes_per_node == mixed.bytes_per_node == double.bytes_per_node / 2
    # Position and volume; the deposit of four channels with their slopes; id and home cell.
    assert single.bytes_per_particle("water") == 4 * 4 + 4 * 16 + 5
    assert mixed.bytes_per_particle("water") == 8 * 4 + 4 * 16 + 5
    assert double.bytes_per_particle("water") == 8 * 4 + 8 * 16 + 5
    assert build().plan(device="cuda", precision="mixed").pipeline == "two-pass"
    with pytest.raises(libmpm.SceneError, match="use precision='double' there"):
        build().plan(device="cpu", precision="mixed")
    with pytest.raises(libmpm.SceneError, match="use precision='double' there"):
        libmpm.Simulation(build(), device="cpu", precision="mixed")


def test_a_sensor_adds_a_kernel_and_no_column() -> None:
    scene = build(solid=True)
    before = scene.plan(device="cpu")
    scene.add_sensor(name="load", sensor=libmpm.sensors.LoadCell(boundary="walls", interval=0.01))
    scene.add_sensor(name="level", sensor=libmpm.sensors.WaveGauge(position=(0.4, 0.4)))
    scene.add_sensor(name="probe", sensor=libmpm.sensors.VelocityProbe(position=(0.4, 0.4, 0.4)))
    scene.add_sensor(name="track", sensor=libmpm.sensors.ParticleTracker(body="water", ids=[0, 7]))
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy())
    after = scene.plan(device="cpu")
    for body in ("water", "block"):
        assert after.columns(body) == before.columns(body)
    assert after.channels == before.channels
    assert after.memory_total == before.memory_total
    assert {k for k in after.kernels if k not in before.kernels} == {
        "sample:load",
        "sample:level",
        "sample:probe",
        "sample:track",
        "sample:energy",
        "measure_loads",
    }


def test_the_stiffest_body_limits_the_time_step_and_is_named() -> None:
    soft, both = build().plan(device="cpu"), build(solid=True).plan(device="cpu")
    assert soft.time_step == pytest.approx(0.4 * 0.1 / (2e6 / 1000) ** 0.5)
    assert "water" in soft.limited_by
    assert "block" in both.limited_by
    wave = (1e6 * (1 - 0.3) / ((1 + 0.3) * (1 - 2 * 0.3)) / 600) ** 0.5
    assert both.time_step == pytest.approx(0.4 * 0.1 / wave)


def test_a_solid_faster_than_the_water_is_a_warning_with_its_price() -> None:
    soft, both = build().plan(device="cpu"), build(solid=True).plan(device="cpu")
    assert not soft.warnings
    (told,) = both.warnings
    steps = soft.time_step / both.time_step
    assert "'block'" in told and f"the time step {steps:.2g}-fold" in told
    assert f"youngs_modulus × {steps**-2:.2g} would not" in told
    assert f"warning: {told}" in str(both)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_engine_holds_what_the_plan_said(precision: str) -> None:
    simulation = libmpm.Simulation(build(solid=True), device="cpu", precision=precision)
    plan = simulation.plan
    simulation.step(1)
    held = simulation.statistics["bytes"]
    # Bodies close to each other share blocks that the plan counts for each.
    assert held == pytest.approx(plan.memory_total - plan.memory["sort"], rel=0.15)


def test_a_missing_combination_says_which_exist() -> None:
    with pytest.raises(libmpm.SceneError, match=r"single.*double|double.*single"):
        build().plan(device="cpu", precision="half")
    with pytest.raises(libmpm.SceneError, match="two-pass"):
        build().plan(device="cpu", pipeline="sideways")
