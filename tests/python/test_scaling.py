"""Froude and Froude-Cauchy scaling: units of every field, there and back, the same motion."""

from __future__ import annotations

import importlib
import json
import math
import pkgutil
import typing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from python.conftest import make_scene

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.base.declarations import FIXED, OWNER, TEXT, declared
from libmpm._src.base.values import registry
from libmpm._src.cli.commands import main
from libmpm._src.materials.material import Material
from libmpm._src.scene import scaling
from libmpm._src.scene.run_file import RunFile, RunSettings, scale_run_file
from libmpm._src.scene.scaling import HALF_POWERS, OUTSIDE, VOLUME, Scaling
from libmpm._src.scene.scene import HEAD

# Units --------------------------------------------------------------------------------------------


def scene_kinds():
    """Return every value of libmpm that may be part of a scene, but the materials."""
    package = importlib.import_module("libmpm._src")
    for module in pkgutil.walk_packages(package.__path__, "libmpm._src."):
        importlib.import_module(module.name)
    return {
        name: kind
        for name, kind in registry.items()
        if kind.__module__.startswith("libmpm.")
        and name not in OUTSIDE
        and not issubclass(kind, Material)
    }


def test_every_unit_is_known_and_no_number_goes_without():
    for name, kind in scene_kinds().items():
        hints = typing.get_type_hints(kind)
        for field, says in declared(kind).items():
            unit = says.scaled_as
            assert unit in (*HALF_POWERS, OWNER, VOLUME, FIXED), f"{name}.{field}: {unit}"
            if unit == TEXT:
                assert "float" not in str(hints[field]), f"{name}.{field} is a number: its unit?"
    for says in (*HEAD.values(), *declared(RunSettings).values()):
        assert says.scaled_as in (*HALF_POWERS, FIXED)


def test_every_unit_of_a_material_scales():
    for kind in registry.values():
        if issubclass(kind, Material) and kind.__module__.startswith("libmpm."):
            for parameter in kind.table.parameters:
                assert Scaling(4.0, True, True).material(parameter.unit) > 0


@pytest.mark.parametrize(
    ("unit", "length", "time", "mass"),
    [
        ("m", 1, 0, 0), ("m²", 2, 0, 0), ("m³", 3, 0, 0), ("m³/s", 3, -1, 0), ("m²/s", 2, -1, 0),
        ("1/m", -1, 0, 0), ("s", 0, 1, 0), ("1/s", 0, -1, 0), ("rad/s", 0, -1, 0),
        ("m/s", 1, -1, 0), ("m/s²", 1, -2, 0), ("rad/s²", 0, -2, 0), ("kg", 0, 0, 1),
        ("kg/m", -1, 0, 1), ("kg/m³", -3, 0, 1), ("N", 1, -2, 1), ("N/m", 0, -2, 1),
        ("J", 2, -2, 1), ("Pa", -1, -2, 1), ("Pa/s", -1, -3, 1), ("1", 0, 0, 0), ("%", 0, 0, 0),
    ],
)  # fmt: skip
def test_powers_follow_from_those_of_m_s_and_kg(unit, length, time, mass):
    """Gravity and density kept give m → λ, s → λ^½, kg → λ³; Bonus (2023) 7.2."""
    assert HALF_POWERS[unit] / 2 == length + time / 2 + 3 * mass
    assert Scaling(10.0).factor(unit) == pytest.approx(10 ** (length + time / 2 + 3 * mass))


def test_ratios_are_those_of_similitude():
    froude = libmpm.design.Froude(40.0)
    ratios = Scaling(40.0).ratios()
    for name in ("length", "velocity", "time", "mass", "force", "pressure"):
        assert ratios[name] == pytest.approx(getattr(froude, name))
    assert ratios["Cauchy number"] == pytest.approx(40)
    assert ratios["Reynolds number"] == pytest.approx(40**1.5)
    both = Scaling(40.0, True, True).ratios()
    assert both["moduli and strengths"] == pytest.approx(froude.stiffness)
    for group in ("Froude", "Cauchy", "Reynolds"):
        assert both[f"{group} number"] == pytest.approx(1)


# There and back -----------------------------------------------------------------------------------


def rich_scene():
    """Return a scene with tables, formulas, windows, levels, friction and every older sensor."""
    scene = make_scene(
        origin=(1.0, 2.0, -0.5),
        gravity=libmpm.TimeTable((0, 2), ((0, 0, -9.81), (0, 1, -9.0))),
        method=libmpm.Method(time_step=1e-5, transfer="FLIP"),
    )
    scene.add_body(
        name="mud",
        shape=shapes.OrientedBox(centre=(1.6, 0.4, 0.6), size=(0.3, 0.2, 0.2), angle=30, axis="z"),
        material=materials.HerschelBulkleyFluid(
            density=1500, yield_stress=30, consistency=5, index=0.6, largest_viscosity=200
        ),
        velocity=libmpm.Field(components=("0.1 * sin(pi * x / 25)", "where(z > 0.5, -y, 0)", "2")),
        fbar=libmpm.FBar(time=0.01),
    )
    scene.add_body(
        name="sand",
        shape=shapes.Box(lower=(2.6, 0.2, 0.2), upper=(3.0, 0.4, 0.4)),
        material=materials.DruckerPrager(
            density=1800, youngs_modulus=1e6, poissons_ratio=0.3, cohesion=100, friction_angle=30
        ),
        velocity=(-1, 0, 0),
    )
    scene.add_boundary(
        name="gate",
        shape=shapes.Box(lower=(1.2, 0, 0), upper=(1.3, 0.8, 0.4)),
        response=boundaries.Separable(static_friction=0.3, dynamic_friction=0.2),
        motion=libmpm.TimeTable((0, 1, 3), ((0, 0, 0), (0, 0, 0.5), (0, 0, 0)), "zero"),
        time=(0.5, math.inf),
    )
    return scene


def plane_scene():
    """Return a scene on triangles, with tractions and a split of its own."""
    mesh = grids.Mesh.blocks(columns=2, rows=2, lower=(0, 0), upper=(1, 1))
    scene = libmpm.Scene(
        grid=grids.TriangularGrid(mesh=mesh, mass=grids.ConsistentMass(deactivate_below=1e-9)),
        gravity=(0, -9.81),
    )
    scene.add_body(
        name="bar", shape=shapes.Box(lower=(0.1, 0.1), upper=(0.6, 0.6)),
        material=materials.Hypoelastic(density=1000, youngs_modulus=1e6, poissons_ratio=0.3),
        stress=libmpm.Field(components=("-1000 * y", "x / 3", "0", "1")),
        tractions=(
            libmpm.grids.Traction(face="x+", value=libmpm.TimeTable((0, 1), ((0, 0), (5, 1)))),
        ),
        particles_per_cell=4,
    )  # fmt: skip
    return scene


def assert_close(one, two, path="scene"):
    """Compare what `to_dict` gives, numbers to 1e-12 of themselves, formulas by their values."""
    assert type(one) is type(two), path
    if isinstance(one, dict):
        assert one.keys() == two.keys(), path
        if one.get("type") == "Field":
            points = np.random.default_rng(0).uniform(-2, 2, (50, 3))
            a, b = (libmpm.Field(components=f["components"]).at(points) for f in (one, two))
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)
            return
        for key in one:
            assert_close(one[key], two[key], f"{path}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(two), path
        for i, (a, b) in enumerate(zip(one, two, strict=True)):
            assert_close(a, b, f"{path}[{i}]")
    elif isinstance(one, float):
        assert one == pytest.approx(two, rel=1e-12, abs=0), path
    else:
        assert one == two, path


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize("make", [rich_scene, plane_scene])
@settings(max_examples=12, deadline=None)
@given(ratio=st.floats(1e-3, 1e3), cauchy=st.booleans(), reynolds=st.booleans())
def test_there_and_back_is_the_same_scene(make, ratio, cauchy, reynolds):
    scene = make()
    there = scene.scaled(ratio, cauchy=cauchy, reynolds=reynolds)
    back = there.scaled(1 / ratio, cauchy=cauchy, reynolds=reynolds)
    assert_close(back.to_dict(), scene.to_dict())
    assert there.cells == scene.cells


def other_values():
    """Return values with the unit of their owner, of the kinds that `rich_scene` has not."""
    table = libmpm.TimeTable((0, 2), ((0, 0, 0), (1, 0, 0.5)))
    rates = libmpm.TimeTable((0, 1), (0.0, 3.0))
    ball = shapes.Sphere(centre=(1, 2, 3), radius=0.5)
    post = shapes.Cylinder(start=(0, 0, 0), end=(0, 0, 2), radius=0.1)
    bed = shapes.HeightField(x=(-4, 1, 6), z=(0, 0.2, 0.5))
    return [
        (ball | post.moved((1, 0, 0)), TEXT),
        ((ball - post).turned(30, axis="y", about=(1, 0, 0)), TEXT),
        ((ball & post).repeated((2, 1, 1), (3, 1, 1)), TEXT),
        (bed, TEXT),
        (shapes.HalfSpace(point=(0, 0, 1), normal=(0, 1, 1)), TEXT),
        (shapes.Cone(start=(0, 0, 0), end=(0, 0, 2), radius=0.4, end_radius=0.1), TEXT),
        (boundaries.Displacement(table), "m/s"),
        (boundaries.Travel((1, 2, 3)), "m/s"),
        (boundaries.Travel(table), "m/s"),
        (boundaries.Rotation(about=(1, 2, 3), rate=rates), TEXT),
        (boundaries.Rotation(about=(1, 2, 3), degrees=rates, axis=(0, 1, 1)), TEXT),
        (boundaries.DecayLayer(thickness=2.0), TEXT),
        (boundaries.Inflow(body="water", face="x-", velocity=rates, level=0.4), TEXT),
        (boundaries.Outflow(face="x+", velocity=0.4), TEXT),
        (sensors.PressureProbe(position=(1, 1, 1), radius=0.1, interval=0.01), TEXT),
        (sensors.GridSensor(attribute="force", operation="sum", region=ball), TEXT),
    ]


@pytest.mark.parametrize("ratio", [0.04, 7.0])
def test_other_values_go_there_and_back_too(ratio):
    for item, unit in other_values():
        there = Scaling(ratio).value(item, unit)
        assert type(there) is type(item)
        assert_close(Scaling(1 / ratio).value(there, unit).to_dict(), item.to_dict())


def test_shapes_scale_as_shapes_do():
    """The distance to a shape λ times as large, at a point λ times as far, is λ times as large."""
    points = np.random.default_rng(1).uniform(-3, 5, (200, 3))
    for item, unit in other_values():
        if isinstance(item, shapes.Solid):
            made = Scaling(7.0).value(item, unit)
            places = points[:, : item.dimension]
            wanted = 7 * item.distance(places)
            np.testing.assert_allclose(made.distance(7 * places), wanted, rtol=1e-12, atol=1e-13)


def test_motions_scale_by_what_they_are_tables_of():
    table = libmpm.TimeTable((0, 2), ((0, 0, 0), (1, 0, 0.5)))
    made = Scaling(4.0).value(boundaries.Displacement(table), "m/s").table
    assert (made.time, made.value) == ((0, 4), ((0, 0, 0), (4, 0, 2)))
    made = Scaling(4.0).value(boundaries.Travel(table), "m/s").velocity
    assert (made.time, made.value) == ((0, 4), ((0, 0, 0), (2, 0, 1)))
    turn = boundaries.Rotation(about=(1, 0, 0), rate=3.0)
    assert Scaling(4.0).value(turn) == boundaries.Rotation(about=(4, 0, 0), rate=1.5)


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_a_power_of_four_is_exact():
    scene = rich_scene()
    twice = scene.scaled(0.25, cauchy=True).scaled(4, cauchy=True)
    assert twice.scaled(16).scaled(1 / 16) == twice
    assert_close(twice.to_dict(), scene.to_dict())


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_numbers_of_a_scaled_scene():
    scene, made = rich_scene(), rich_scene().scaled(0.25)
    assert made.cell_size == 0.25 * scene.cell_size
    assert made.origin == (0.25, 0.5, -0.125)
    assert made.method.time_step == 0.5e-5
    assert made.gravity.time == (0, 1)
    assert made.gravity.value == scene.gravity.value
    water, _, mud, sand = made.bodies
    assert water.hydrostatic == pytest.approx(0.1)
    assert sand.velocity == (-0.5, 0, 0)
    assert sand.material == scene.bodies[3].material
    assert mud.fbar.time == 0.005
    assert mud.shape.angle == 30
    gate = made.boundaries[2]
    assert gate.time == (0.25, math.inf)
    assert gate.motion == libmpm.TimeTable((0, 0.5, 1.5), ((0, 0, 0), (0, 0, 0.25), (0, 0, 0)),
                                           "zero")  # fmt: skip
    assert gate.response == scene.boundaries[2].response
    for one, two in zip(made.sensors, scene.sensors, strict=True):
        assert one.sensor.interval == 0.5 * two.sensor.interval
    # A velocity at a point of the small scene is half of that at the same point of the large one.
    points = np.array([[1.5, 0.4, 0.6], [1.7, 0.3, 0.45]])
    np.testing.assert_allclose(
        mud.velocity.at(points / 4), 0.5 * scene.bodies[2].velocity.at(points), rtol=1e-14
    )


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_materials_scale_by_what_is_asked_to_be_kept():
    mud = rich_scene().bodies[2].material
    kept = Scaling(4.0).value(mud)
    assert kept == mud
    stiff = Scaling(4.0, cauchy=True).value(mud)
    assert (stiff.bulk_modulus, stiff.yield_stress) == (4 * mud.bulk_modulus, 120)
    assert (stiff.consistency, stiff.density, stiff.index) == (5, mud.density, 0.6)
    full = Scaling(4.0, True, True).value(mud)
    assert full.consistency == pytest.approx(5 * 4 ** (1 + 0.6 / 2))
    water = materials.TaitFluid(viscosity=1e-3)
    assert Scaling(4.0, reynolds=True).value(water).viscosity == pytest.approx(8e-3)


def test_loads_scale_whatever_the_material():
    made = plane_scene().scaled(4)
    traction = made.bodies[0].tractions[0].value
    assert traction.value == ((0, 0), (20, 4))
    assert made.bodies[0].material == plane_scene().bodies[0].material
    # A mass per metre of thickness: kg/m.
    assert made.grid.mass.deactivate_below == pytest.approx(16e-9)
    np.testing.assert_allclose(
        made.grid.mesh.vertices, 4 * np.array(plane_scene().grid.mesh.vertices)
    )


def test_formulas_stay_short():
    field = libmpm.Field(components=("x / 3 + y", "0.1 * exp(-z)", "5"))
    there = Scaling(10.0).value(field, "m/s")
    assert Scaling(0.1).value(there, "m/s").components[0] == "x / 3.0 + y"
    assert len(there.components[1]) < 50


@pytest.mark.parametrize("ratio", [0, -1, math.nan, math.inf, "small", True])
def test_a_ratio_that_is_none_is_refused(ratio):
    with pytest.raises(libmpm.SceneError, match="length_ratio"):
        make_scene().scaled(ratio)


def test_a_value_without_units_is_refused(monkeypatch):
    monkeypatch.setattr(scaling, "declared", lambda kind: {})
    with pytest.raises(libmpm.SceneError, match=r"unit of TaitFluid|unit of \w+\.\w+ is not known"):
        make_scene().scaled(2)


# The same motion ----------------------------------------------------------------------------------


def sloshing(viscosity=0.0):
    """Return a tilted tank of water with a jelly block in it, in the plane."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(1, 0.6), gravity=(1.0, -9.81),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(1, 0.3)),
        material=materials.TaitFluid(bulk_modulus=2e5, viscosity=viscosity), hydrostatic=0.3,
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shapes.Box(lower=(0.4, 0.35), upper=(0.6, 0.5)),
        material=materials.NeoHookean(density=600, youngs_modulus=1e5, poissons_ratio=0.3),
        velocity=(0.0, -1.0),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", faces=("x+",)))
    return scene


def motion(scene, until, precision):
    """Return positions, loads, times and steps of a run."""
    sim = libmpm.Simulation(scene, device="cpu", precision=precision, threads=1)
    sim.run(until=until, progress=False)
    where = np.concatenate([sim.particles[b]["position"] for b in ("water", "block")])
    load = sim.sensors["load"]
    return where, load.values, load.time, sim.steps


@pytest.mark.parametrize(("precision", "bound"), [("single", 1e-5), ("double", 1e-12)])
@pytest.mark.parametrize("ratio", [10.0, 0.1, 4.0])
def test_with_froude_and_cauchy_kept_the_motion_is_the_same(precision, bound, ratio):
    """1-1 and 10-10 agree to rounding where viscosity is zero; Bonus (2023) 7.7, V7."""
    until = 0.2
    scene = sloshing()
    scaled = scene.scaled(ratio, cauchy=True)
    where, load, time, steps = motion(scene, until, precision)
    there, force, when, count = motion(scaled, until * math.sqrt(ratio), precision)
    assert count == steps > 100
    np.testing.assert_allclose(there / ratio, where, atol=bound)
    np.testing.assert_allclose(when / math.sqrt(ratio), time, rtol=1e-6)
    # Per metre of thickness forces go as λ², moments as λ³.
    wanted = load * [ratio**2, ratio**2, ratio**3]
    assert np.all(np.abs(force - wanted).max(0) <= bound * np.abs(wanted).max(0))
    if ratio == 4:
        # Every factor is a power of two: no rounding is different.
        np.testing.assert_array_equal(there / 4, where)
    assert np.abs(where[:, 1]).max() > 0.3


def test_with_reynolds_kept_a_viscous_fluid_moves_the_same_too():
    until, ratio = 0.05, 0.1
    where, *_ = motion(sloshing(viscosity=5.0), until, "double")
    scaled = sloshing(viscosity=5.0).scaled(ratio, cauchy=True, reynolds=True)
    there, *_ = motion(scaled, until * math.sqrt(ratio), "double")
    np.testing.assert_allclose(there / ratio, where, atol=1e-12)
    # Without it viscosity is sqrt(1000) times too large for the small one, which shows.
    scaled = sloshing(viscosity=5.0).scaled(ratio, cauchy=True)
    thick, *_ = motion(scaled, until * math.sqrt(ratio), "double")
    assert np.abs(thick / ratio - where).max() > 1e-4


def test_without_cauchy_the_number_of_steps_changes():
    """The sound speed stays while velocities scale: steps over the same flow go as λ^-½."""
    one = sloshing().plan(device="cpu", until=1.0)
    two = sloshing().scaled(0.04).plan(device="cpu", until=0.2)
    assert two.steps / one.steps == pytest.approx(5, rel=0.05)


# The command line ---------------------------------------------------------------------------------


def test_the_plan_of_a_scaled_scene_is_shown(tmp_path, capsys):
    path = tmp_path / "scene.json"
    settings_of = RunSettings(until=2.0, frame_interval=0.1, filter=0.02)
    path.write_text(json.dumps(RunFile(sloshing(), settings_of).to_dict()))
    assert main(["plan", str(path), "--device", "cpu", "--scale", "0.25", "--cauchy"]) == 0
    text = capsys.readouterr().out
    for part in ("Froude-Cauchy scaling by 0.25", "cells of 0.0125 m", "to 1 s"):
        assert part in text
    force = next(line for line in text.splitlines() if line.strip().startswith("force"))
    assert float(force.split()[-1]) == 0.0625
    steps = [line for line in text.splitlines() if line.startswith("steps")]
    assert main(["plan", str(path), "--device", "cpu"]) == 0
    assert steps[0].split()[1] in capsys.readouterr().out
    assert main(["plan", str(path), "--cauchy"]) == 2
    assert "--scale" in capsys.readouterr().err


def test_the_settings_of_a_file_scale_too():
    source = RunFile(sloshing(), RunSettings(until=2.0, frame_interval=0.1, filter=0.02,
                                             debris=["block"]))  # fmt: skip
    made = scale_run_file(source, Scaling(4.0))
    assert made.settings == RunSettings(until=4.0, frame_interval=0.2, filter=0.04,
                                        debris=["block"])  # fmt: skip
    assert made.scene == source.scene.scaled(4)
