"""Tractions on bodies of elements, driven ends, and what is refused of them."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import Scene, SceneError, boundaries, materials, shapes
from libmpm._src.shapes.element_surface import areas, chosen_faces, shares
from libmpm.grids import Traction
from support import element_cases as cases
from support import element_load_cases as loads
from support.sagging_beam import sunk_exactly

FAST: dict[str, Any] = {"device": "cpu", "precision": "double"}


def block(d: int, **body: Any) -> Scene:
    """Return a free block in the middle of a room."""
    scene = Scene(dimension=d, cell_size=0.1, lower=(0,) * d, upper=(1.6,) * d)
    scene.add_body(**({
        "name": "block", "shape": cases.mesh_of((0.5,) * d, (1.0,) * d, 0.05),
        "material": cases.solid("NeoHookean", 1000.0, 1e6, 0.3),
    } | body))  # fmt: skip
    return scene


@pytest.mark.parametrize("d", [2, 3])
def test_faces_and_what_vertices_have_of_them(d: int) -> None:
    mesh = cases.mesh_of((0.5, 0.5, 0.5)[:d], (1.0, 0.8, 0.7)[:d], 0.05)
    size = np.array([0.5, 0.3, 0.2][:d])
    for axis, sign in itertools.product(range(d), "-+"):
        faces = chosen_faces(mesh, "xyz"[axis] + sign, None)
        expected = np.prod(np.delete(size, axis))
        assert areas(mesh, faces).sum() == pytest.approx(expected, rel=1e-12)
        which, area = shares(mesh, faces)
        assert area.sum() == pytest.approx(expected, rel=1e-12)
        end = (mesh.vertices.min if sign == "-" else mesh.vertices.max)(axis=0)[axis]
        assert np.allclose(mesh.vertices[which, axis], end)
        # The load of a plane field of pressure acts in its middle.
        middle = (area @ mesh.vertices[which]) / area.sum()
        assert np.delete(middle, axis) == pytest.approx(np.delete([0.75, 0.65, 0.6][:d], axis))
    part = shapes.Box(lower=(0.7, 0.75, 0.4)[:d], upper=(0.9, 0.85, 0.8)[:d])
    faces = chosen_faces(mesh, None, part)
    assert areas(mesh, faces).sum() == pytest.approx(
        0.2 * (0.2 if d == 3 else 1) + (2 * 0.2 * 0.05 if d == 3 else 0)
    )  # the upper face, and strips of those at z- and z+
    both = chosen_faces(mesh, "y+", part)
    assert areas(mesh, both).sum() == pytest.approx(0.2 * (0.2 if d == 3 else 1))


@pytest.mark.parametrize("d", [2, 3])
def test_a_force_moves_the_middle_of_a_free_body(d: int) -> None:
    """Momentum is the integral of the force, to rounding: a table that grows and stays."""
    value = [0.0] * d, [30.0, -20.0, 10.0][:d]
    load = Traction(face="y+", value=libmpm.TimeTable([0.0, 0.004], value, end="hold"))
    side = shapes.Box(lower=(0.49,) * d, upper=(0.51, *(1.0,) * (d - 1)))
    more = Traction(within=side, value=(5.0, 0.0, 0.0)[:d])
    scene = block(d, tractions=(load, more))
    sim = libmpm.Simulation(scene, **FAST, time_step=2e-4)
    sim.step(100)
    body = sim.particles["block"].read(["mass", "velocity"])
    # A step's force is that of its beginning; velocities that are read have the coming step's.
    area, times = 0.5 ** (d - 1), 2e-4 * np.arange(101)
    share = np.minimum(times / 0.004, 1.0).sum() * 2e-4
    expected = np.array(value[1]) * share
    expected[0] += 5.0 * 101 * 2e-4
    got = (body["mass"][:, None] * body["velocity"]).sum(axis=0)
    assert got == pytest.approx(area * expected, rel=1e-9, abs=1e-9)


def test_a_patch_under_tractions_is_stretched_evenly() -> None:
    """Opposite faces of an irregular mesh pulled alike: one stress, σ = t, in the mean."""
    rng = np.random.default_rng(1)
    mesh = cases.mesh_of((0.5, 0.5), (1.0, 0.9), 0.05)
    inner = np.setdiff1d(np.arange(mesh.count), np.unique(mesh.surface))
    places = mesh.vertices.copy()
    places[inner] += rng.uniform(-0.008, 0.008, (len(inner), 2))
    mesh = type(mesh)(vertices=places, elements=mesh.elements)
    law = cases.solid("NeoHookean", 1000.0, 1e6, 0.0)
    wave, pull, grows = 1000**0.5, 1000.0, 0.25
    ends = tuple(Traction(face=f, value=loads.ramp((s * pull, 0.0), grows))
                 for f, s in (("x-", -1), ("x+", 1)))  # fmt: skip
    scene = block(2, shape=mesh, material=law, tractions=ends)
    sim = libmpm.Simulation(scene, **FAST)
    sim.run(until=grows, progress=False)
    found, period = [], 2 * 0.5 / wave
    for k in range(1, 21):
        sim.run(until=grows + k * period / 20, progress=False)
        found.append(sim.particles["block"]["element_stress"])
    stress = np.mean(found, axis=0)
    far = np.abs(mesh.vertices[mesh.elements].mean(axis=1)[:, 0] - 0.75) < 0.15
    assert stress[far, 0, 0] == pytest.approx(pull, rel=0.02)
    assert np.abs(stress[far, 1, 1]).max() < 0.02 * pull
    assert np.abs(stress[far, 0, 1]).max() < 0.02 * pull


def test_bits_under_tractions(tmp_path: Path) -> None:
    scene = block(2, tractions=(Traction(face="x+", value=loads.ramp((500.0, 100.0), 0.02)),))
    whole = cases.after(scene, 200, precision="single", threads=1)
    two = cases.after(scene, 200, precision="single", threads=2)
    sim = libmpm.Simulation(scene, device="cpu", precision="single")
    sim.step(110)
    sim.save_checkpoint(tmp_path / "half.npz")
    again = libmpm.Simulation.resume(tmp_path / "half.npz", device="cpu")
    again.step(90)
    for key, array in cases.state_of(again).items():
        assert np.array_equal(array, whole[key]) and np.array_equal(array, two[key]), key


def test_copies_of_a_mesh_have_loads_of_their_own() -> None:
    """Bodies alike are stepped as one, but not with tractions."""
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(3, 1.6))
    for k, loaded in enumerate((False, True, False)):
        low = (0.3 + 0.9 * k, 0.5)
        scene.add_body(
            name=f"b{k}", shape=cases.mesh_of(low, (low[0] + 0.5, 0.9), 0.05),
            material=cases.solid("NeoHookean", 1000.0, 1e6, 0.3),
            tractions=(Traction(face="y+", value=(0.0, 10.0)),) if loaded else (),
        )  # fmt: skip
    sim = libmpm.Simulation(scene, **FAST)
    sim.step(50)
    speed = [sim.particles[f"b{k}"]["velocity"][:, 1].mean() for k in range(3)]
    assert speed[0] == speed[2] == 0 and speed[1] > 0


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ({"face": "z+", "value": (0, 1)}, r"face is 'z\+' in 2D; expected x-, x\+, y-, y\+"),
        ({"face": "x+", "value": (0, 1, 0)}, "value has 3 numbers; expected 2, in Pa"),
        ({"within": shapes.Box(lower=(0, 0), upper=(0.1, 0.1)), "value": (0, 1)},
         "no outer face of the mesh has all its vertices there"),
        ({"within": shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1)), "value": (0, 1)},
         "within is a box in 3D; expected 2D"),
    ],
)  # fmt: skip
def test_loads_that_are_refused(load: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=f"body 'block': tractions.0.: {said}"):
        block(2, tractions=(Traction(**load),)).validate()


def test_a_traction_of_nothing_or_of_particles_is_refused() -> None:
    with pytest.raises(SceneError, match="face and within are missing"):
        Traction(value=(0, 1))
    scene = block(2, shape=shapes.Box(lower=(0.5, 0.5), upper=(1, 1)),
                  tractions=(Traction(face="x+", value=(0, 1)),))  # fmt: skip
    with pytest.raises(SceneError, match=r"body 'block': tractions on a grid of square cells; .*"
                                         "Tetrahedra"):  # fmt: skip
        scene.validate()


def test_a_traction_goes_through_a_scene_file_and_is_scaled() -> None:
    box = shapes.Box(lower=(0.9, 0.4), upper=(1.1, 0.8))
    scene = block(2, tractions=(Traction(within=box, value=(3.0, 4.0)),))
    assert Scene.from_dict(scene.to_dict()).bodies[0].tractions == scene.bodies[0].tractions
    small = scene.scaled(0.5).bodies[0].tractions[0]
    assert small.value == pytest.approx((1.5, 2.0))
    assert small.within.lower == pytest.approx((0.45, 0.2))
    assert small.within.upper == pytest.approx((0.55, 0.4))


@pytest.mark.validation
@pytest.mark.parametrize("cells", [2, 4])
def test_a_bar_pulled_by_its_end(cells: int) -> None:
    found = loads.end_pull(cells=cells)
    assert found["stretch"] == pytest.approx(1, abs=0.02)
    assert found["reaction"] == pytest.approx(1, abs=0.01)


@pytest.mark.slow
@pytest.mark.validation
@pytest.mark.parametrize("cells", [4, 6])
def test_a_cantilever_under_a_force_at_its_end(cells: int) -> None:
    """With 2 cells it is 10 % too stiff (docs/elements.md)."""
    found = loads.end_load(cells=cells)
    assert found["tip"] == pytest.approx(1, abs=0.04)
    assert found["reaction"] == pytest.approx(1, abs=0.01)


@pytest.mark.validation
@pytest.mark.parametrize("cells", [2, 4])
def test_a_bar_between_driven_nodes(cells: int) -> None:
    """The force is that of a bar longer by a quarter of a cell at each end, at any resolution."""
    found = loads.driven_bar(cells=cells)
    assert found["give"] == pytest.approx(0.25, abs=0.05)
    assert found["force at drive"] == pytest.approx(found["force at clamp"], rel=0.005)


def test_a_wall_feels_a_weight_of_traction() -> None:
    """Pressed on a wall by a traction on its other face, a block gives the wall that force."""
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1.6, 1.6))
    load = Traction(face="y+", value=loads.ramp((0.0, -200.0), 0.2))
    scene.add_body(name="block", shape=cases.mesh_of((0.5, 0.0), (1.0, 0.5), 0.05),
                   material=materials.NeoHookean(density=1000, youngs_modulus=1e6,
                                                 poissons_ratio=0.0),
                   tractions=(load,))  # fmt: skip
    scene.add_boundary(name="floor", shape=shapes.DomainWalls(faces=("y-",)),
                       response=boundaries.Slip())  # fmt: skip
    scene.add_sensor(name="force", sensor=libmpm.sensors.LoadCell(boundary="floor", interval=1e-3))
    sim = libmpm.Simulation(scene, **FAST)
    period = 4 * 0.5 / 1000**0.5
    sim.run(until=0.2 + 2 * period, progress=False)
    series = sim.sensors["force"]
    mean = series.values[series.time > 0.2, list(series.components).index("force_y")].mean()
    assert abs(mean) == pytest.approx(100.0, rel=0.02)


@pytest.mark.validation
def test_dominoes_of_elements_fall_as_those_of_particles() -> None:
    """Three of them, 3 cells thick; the guide's bound is 12 %."""
    found = [loads.dominoes(edge=edge, count=4) for edge in (np.inf, 1.0)]
    assert [f["fallen"] for f in found] == [4, 4]
    assert found[1]["interval"] == pytest.approx(found[0]["interval"], rel=0.12)


def test_the_beam_under_level_water_is_the_formulas_where_these_hold() -> None:
    """Stiff: that of evenly spread water; at a deflection of 0.4 m nearly that with ponding."""
    load = 9.81 * (1000.0 * 0.5 + 100.0)
    for level in (True, False):
        stiff = sunk_exactly(5e8, level=level)
        assert stiff == pytest.approx(loads.membrane(5e8, load), rel=2e-3)
    ponding = loads.membrane(5e6, load, ponding=9810.0)
    assert sunk_exactly(5e6) == pytest.approx(ponding, rel=0.02)
    # And by half as many pieces.
    assert sunk_exactly(1e6, pieces=15) == pytest.approx(1.3501, rel=2e-3)


@pytest.mark.slow
@pytest.mark.validation
def test_a_beam_under_water_sinks_as_theory_says() -> None:
    """± 6 % of the membrane's formula, of which a quarter of a cell at each end is 5."""
    found = loads.beam_under_water(modulus=5e7)
    assert found["sinks"] == pytest.approx(1, abs=0.06)


@pytest.mark.slow
@pytest.mark.validation
def test_a_soft_beam_sinks_under_water_that_runs_to_its_middle() -> None:
    """± 6 %; where both share their nodes' velocity the water stays behind on the slopes."""
    runs = loads.beam_under_water(modulus=1e6, contact=True)
    assert runs["under_level_water"] == pytest.approx(1, abs=0.06)
    assert loads.beam_under_water(modulus=1e6)["under_level_water"] < 0.94
