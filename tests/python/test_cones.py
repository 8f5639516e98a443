"""Friction angles mean what they say: element tests through the engine, and old files."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import libmpm
from libmpm import boundaries, cases, materials, shapes

Array = npt.NDArray[np.float64]

SOIL: dict[str, Any] = {"density": 1000.0, "youngs_modulus": 1e4, "poissons_ratio": 0.25}
PLANE_SHEAR = ((-0.005, 0.5), (0.0, -0.005))


def principal_stresses(
    material: materials.Material, gradient: tuple[tuple[float, ...], ...]
) -> Array:
    """Deform the middle of a block at a constant velocity gradient, by `gradient` in all.

    So fast that no wave from its sides arrives: what is there is a test of one element. Returns
    the principal stresses of the middle, Pa, ascending: of those in the plane in 2D.
    """
    d = len(gradient)
    n, steps, dt = (20 if d == 2 else 12), 40, 1e-4
    half = n / 2
    scene = libmpm.Scene(
        dimension=d, cell_size=1.0, lower=(-1.5 * n,) * d, upper=(1.5 * n,) * d,
        method=libmpm.Method(time_step=dt),
    )  # fmt: skip
    formulas = [
        " + ".join(f"({float(g) / (steps * dt)!r}) * {x}" for g, x in zip(row, "xyz", strict=False))
        for row in gradient
    ]
    scene.add_body(
        name="soil", shape=shapes.Box(lower=(-half,) * d, upper=(half,) * d), material=material,
        velocity=libmpm.Field(components=formulas),
    )  # fmt: skip
    simulation = libmpm.Simulation(scene, device="cpu", precision="double")
    simulation.step(steps)
    particles = simulation.particles["soil"]
    middle = np.abs(particles["position"]).max(axis=1) < 1.0
    stress = particles["stress"][middle]
    assert middle.sum() >= 4
    return np.linalg.eigvalsh(stress).mean(axis=0)


def acting_angle(stress: Array) -> float:
    """The angle of the Mohr circle through the least and the greatest principal stress."""
    low, high = float(stress[0]), float(stress[-1])
    return math.degrees(math.asin((high - low) / -(high + low)))


@pytest.mark.parametrize(
    ("cone", "wanted"), [(None, 30.0), ("plane-strain", 30.0), ("compression", 43.9)]
)
def test_sand_in_the_plane_acts_as_its_cone_says(cone: Any, wanted: float) -> None:
    sand = materials.DruckerPrager(**SOIL, friction_angle=30, cone=cone)
    # Pressure grows by 1 % of the modulus on the way, which keeps s_zz a little off its end.
    assert acting_angle(principal_stresses(sand, PLANE_SHEAR)) == pytest.approx(wanted, abs=0.35)


@pytest.mark.parametrize(("cone", "sign"), [(None, 1.0), ("compression", 1.0), ("extension", -1.0)])
def test_sand_in_space_acts_as_its_cone_says(cone: Any, sign: float) -> None:
    sand = materials.DruckerPrager(**SOIL, friction_angle=30, cone=cone)
    part = sign * 0.15
    path = ((part, 0.0, 0.0), (0.0, part, 0.0), (0.0, 0.0, -2 * part))
    assert acting_angle(principal_stresses(sand, path)) == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize("dilatancy", [0.0, 10.0, 29.0])
def test_cohesion_and_dilatancy_in_the_plane_are_mohr_and_coulombs(dilatancy: float) -> None:
    """J t = J P sin φ + c cos φ, with the volume growing as plastic flow has it: sin ψ of shear."""
    soil = materials.DruckerPrager(
        **SOIL, friction_angle=30, dilatancy_angle=dilatancy, cohesion=50, tension_cutoff=1e6
    )
    wide = 0.125 * math.sin(math.radians(dilatancy)) - 0.005
    low, high = principal_stresses(soil, ((wide, 0.25), (0.0, wide)))
    pressure, shear, volume = -0.5 * (low + high), 0.5 * (high - low), (1.0 + wide) ** 2
    wanted = volume * pressure * 0.5 + 50.0 * math.cos(math.radians(30.0))
    assert volume * shear == pytest.approx(wanted, rel=0.02)


def test_clay_in_the_plane_acts_as_its_cone_says() -> None:
    clay = materials.CamClay(
        **SOIL, friction_angle=30, log_plastic_volume=-0.02, hardening_factor=1, cohesion_ratio=0,
        hardens=0,
    )  # fmt: skip
    assert acting_angle(principal_stresses(clay, PLANE_SHEAR)) == pytest.approx(30.0, abs=0.5)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 22.0, 45.0, 89.0])
@pytest.mark.parametrize("cone", ["compression", "extension", "plane-strain"])
def test_cones_keep_their_apex(cone: Any, angle: float) -> None:
    soil = materials.DruckerPrager(**SOIL, friction_angle=angle, cohesion=10, cone=cone)
    core = soil.core_parameters(2)
    assert 0 <= core["friction_angle"] <= angle
    named, kept = (math.tan(math.radians(a)) for a in (angle, core["friction_angle"]))
    assert core["cohesion"] * named == pytest.approx(soil.cohesion * kept, rel=1e-6, abs=1e-12)
    assert 0 < core["cohesion"] <= 10


def test_a_file_without_a_cone_is_warned_of_where_its_meaning_changed() -> None:
    document = sand_scene().to_dict()
    assert document["bodies"][0]["material"].pop("cone") is None
    with pytest.warns(libmpm.ModelWarning, match="43.9 degrees"):
        read = libmpm.Scene.from_dict(document)
    assert read == sand_scene()
    document["bodies"][0]["material"]["cone"] = "compression"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert libmpm.Scene.from_dict(document).bodies[0].material.cone == "compression"
        assert libmpm.Scene.from_dict(sand_scene(3).to_dict()) == sand_scene(3)


def test_a_checkpoint_without_a_cone_continues_with_that_of_its_run(tmp_path: Path) -> None:
    simulation = libmpm.Simulation(sand_scene(cone="compression"), device="cpu")
    simulation.step(2)
    path = tmp_path / "before.npz"
    simulation.save_checkpoint(path)
    with np.load(path) as stored:
        entries = dict(stored)
    header = json.loads(entries["header"].tobytes().decode())
    del header["scene"]["bodies"][0]["material"]["cone"]
    entries["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **entries)
    resumed = libmpm.Simulation.resume(path, device="cpu")
    assert resumed.scene.bodies[0].material.cone == "compression"


@pytest.mark.parametrize("aspect", [1.0, 2.0])
def test_a_column_spreads_as_far_as_sand_does(aspect: float) -> None:
    """The reference case on half its cells: run-out ± 15 %, height ± 10 %, at rest."""
    result = cases.run("column-collapse", device="cpu", aspect=aspect, cells=20)
    assert not result.failures, result.failures


def sand_scene(dimension: int = 2, cone: Any = None) -> libmpm.Scene:
    d = dimension
    scene = libmpm.Scene(dimension=d, cell_size=0.1, lower=(0,) * d, upper=(1,) * d)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    scene.add_body(
        name="sand", shape=shapes.Box(lower=(0,) * d, upper=(0.5,) * d),
        material=materials.DruckerPrager(**SOIL, cone=cone),
    )  # fmt: skip
    return scene
