"""Motion on grids of triangles and splines: momentum, invariance, sides, loads, materials."""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from support import triangular as t
from support.function_scenes import ELASTIC, block, square


@pytest.mark.parametrize(
    "grid",
    [
        grids.TriangularGrid(mesh=grids.Mesh.squares(
            columns=3, rows=3, lower=(0.0, 0.0), upper=(1.0, 1.0)), basis=basis, mass=mass)
        for basis in (grids.Linear(), grids.PowellSabin(), grids.CubicPowellSabin())
        for mass in (grids.ConsistentMass(), grids.ConsistentMass(solver="cg", tolerance=1e-13,
                                                                   iterations=1000))
    ]
    + [
        grids.SplineGrid(lower=(0.0, 0.0), upper=(1.0, 1.0), spans=(3, 3), degree=2),
        grids.TriangularGrid(mesh=grids.Mesh.squares(
            columns=3, rows=3, lower=(0.0, 0.0), upper=(1.0, 1.0)), mass=grids.LumpedMass()),
    ],
    ids=str,
)  # fmt: skip
def test_free_fall_and_momentum(grid):
    scene = libmpm.Scene(grid=grid, gravity=(1.0, -9.81))
    block(scene, lattice=(36, 36), velocity=(0.3, 0.5))
    simulation = libmpm.Simulation(scene)
    simulation.step(10)
    time = simulation.time
    body = simulation.particles["block"]
    expected = np.array([0.3, 0.5]) + time * np.array([1.0, -9.81])
    # Lumped masses smooth the field of a constant to itself; every form keeps a uniform motion.
    assert body["velocity"] == pytest.approx(np.tile(expected, (36**2, 1)), abs=1e-8)
    assert body["stress"] == pytest.approx(0, abs=1e-3)
    assert body["mass"].sum() == pytest.approx(1000.0)


def test_moving_the_scene_changes_no_number():
    runs = []
    for lower in ((0.0, 0.0), (1e4, -3e3)):
        scene = square(gravity=(0.0, -9.81), lower=lower, method=libmpm.Method(time_step=1e-4),
                       mass=grids.LumpedMass())  # fmt: skip
        block(scene, low=0.1, high=0.7, lattice=(8, 8), velocity=(0.1, 0.0))
        simulation = libmpm.Simulation(scene)
        simulation.step(50)
        runs.append(simulation.particles["block"]["displacement"])
    # Coordinates at 1e4 m carry errors of 1e-12 m; nothing else may change.
    assert runs[0] == pytest.approx(runs[1], abs=1e-11)


def test_rotated_scene_gives_rotated_motion():
    # The same triangles turned by an angle: nothing of the method may prefer an axis.
    angle = 0.6
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    base = grids.Mesh.blocks(columns=3, rows=3, lower=(0.0, 0.0), upper=(1.0, 1.0))
    vertices, triangles = base.arrays()
    found = []
    rng = np.random.default_rng(3)
    inside = 0.2 + 0.6 * rng.random((300, 2))
    pull = np.array([0.0, -9.81])
    for rotation in (np.eye(2), turn):
        mesh = grids.Mesh(vertices=vertices @ rotation.T, triangles=triangles)
        scene = libmpm.Scene(
            grid=grids.TriangularGrid(mesh=mesh), gravity=rotation @ pull,
            method=libmpm.Method(time_step=2e-5),
        )  # fmt: skip
        block(scene, shape=shapes.Points(position=inside @ rotation.T,
                                         volume=np.full(300, 0.36 / 300)),
              velocity=rotation @ np.array([0.2, 0.1]))  # fmt: skip
        simulation = libmpm.Simulation(scene)
        simulation.step(60)
        found.append(simulation.particles["block"]["displacement"] @ rotation)
    assert np.abs(found[0] - found[1]).max() < 1e-9 * np.abs(found[0]).max()


@pytest.mark.parametrize("digits", [16, 9, 8])
def test_slip_on_a_slanted_side_lets_slide_and_holds_across(digits):
    # A block rests against a slope and falls along it, as gravity along the slope says. Vertices as
    # files have them, rounded, must not make corners of a straight side.
    angle = np.radians(30)
    along = np.array([np.cos(angle), -np.sin(angle)])
    across = np.array([np.sin(angle), np.cos(angle)])
    corners = [(0, 0), (3, 0), (3, 1.5), (0, 1.5)]
    place = np.array([a * along + b * across for a, b in corners])
    inner = np.array(
        [a * along + b * across for a in np.linspace(0, 3, 9) for b in np.linspace(0, 1.5, 5)]
    )
    mesh = grids.Mesh.delaunay(inner.round(digits))
    place = place.round(digits)
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh), gravity=(0.0, -10.0))
    points = np.array(
        [
            a * along + b * across
            for a in np.linspace(0.5, 1.5, 20, endpoint=False) + 0.025
            for b in np.linspace(0, 0.5, 10, endpoint=False) + 0.025
        ]
    )
    weight = 1000 * 0.5 * 10
    scene.add_body(
        name="block",
        shape=shapes.Points(position=points, volume=np.full(200, 0.5 / 200)),
        material=materials.Hypoelastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.0),
    )
    scene.add_boundary(
        name="slope", shape=shapes.Outline(points=place[:2]), response=boundaries.Slip()
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="slope", interval=0.05))
    simulation = libmpm.Simulation(scene)
    simulation.run(until=0.3, progress=False)
    body = simulation.particles["block"]
    speed = np.average(body["velocity"], axis=0)
    free = 10 * np.sin(angle) * simulation.time
    assert speed @ along == pytest.approx(free, rel=1e-6 if digits > 9 else 1e-3)
    # It bounces on the slope, by no more than a sound wave through it gathers: g cos(angle) H / c.
    assert abs(speed @ across) < 10 * np.cos(angle) * 0.5 / np.sqrt(1e6 / 1000)
    load = simulation.sensors["load"].values[:, :2].mean(axis=0)
    # Its mean load is its weight across the slope, and none along it.
    assert load @ across == pytest.approx(-weight * np.cos(angle), rel=0.1)
    assert abs(load @ along) < (1e-6 if digits > 9 else 1e-3) * weight


def test_tractions_stretch_a_bar_to_their_stress():
    # A pull that grows slowly over three periods: the strain that its stress has, σ = E (1 - 1/F).
    young, pull = 1e6, 2e4
    mesh = grids.Mesh.blocks(columns=5, rows=1, lower=(0.0, 0.0), upper=(1.25, 0.2))
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh))
    scene.add_body(
        name="bar", shape=shapes.Box(lower=(0, 0), upper=(1.0, 0.2)), lattice=(48, 10),
        material=materials.Hypoelastic(density=1000.0, youngs_modulus=young, poissons_ratio=0.0),
        tractions=(libmpm.grids.Traction(face="x+", value=libmpm.TimeTable(
            (0.0, 0.38), ((0.0, 0.0), (pull, 0.0)))),),
    )  # fmt: skip
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=("x-", "y-", "y+")), response=boundaries.Slip()
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", faces=("x-",),
                                                         interval=0.01))  # fmt: skip
    simulation = libmpm.Simulation(scene)
    simulation.run(until=0.38, progress=False)
    body = simulation.particles["bar"]
    stress = np.average(body["stress"][:, 0, 0], weights=body["volume"])
    assert stress == pytest.approx(pull, rel=0.05)
    end = body["displacement"][body["position"][:, 0].argmax(), 0]
    assert end == pytest.approx(1 / (1 - pull / young) - 1, rel=0.05)
    load = simulation.sensors["load"]
    assert load.values[-4:, 0].mean() == pytest.approx(pull * 0.2 * 0.95, rel=0.1)


def test_initial_stress_holds_a_column_at_rest():
    weight = "-9810 * (1 - y)"
    scene = libmpm.Scene(grid=t.blocks(1, 4, 0.25, 1.0, grids.PowellSabin()), gravity=(0.0, -9.81))
    scene.add_body(
        name="soil", shape=shapes.Box(lower=(0, 0), upper=(0.25, 1.0)), lattice=(8, 32),
        material=materials.Hypoelastic(density=1000.0, youngs_modulus=1e7, poissons_ratio=0.3),
        stress=libmpm.Field(components=(f"3 / 7 * ({weight})", weight, "0", f"3 / 7 * ({weight})")),
    )  # fmt: skip
    scene.add_boundary(
        name="box", shape=shapes.DomainWalls(faces=("x-", "x+", "y-")), response=boundaries.Slip()
    )
    simulation = libmpm.Simulation(scene)
    simulation.run(until=0.05, progress=False)
    free = 9.81 * 0.05**2 / 2
    body = simulation.particles["soil"]
    # What moves is what the quadrature by particles leaves of the balance.
    assert np.abs(body["displacement"]).max() < 1e-2 * free
    assert body["pressure"].max() == pytest.approx((1 + 6 / 7) / 3 * 9810 * (1 - 1 / 64), rel=0.02)


def test_library_materials_agree_for_small_strains():
    found = {}
    for material in (ELASTIC, materials.NeoHookean(density=1000.0, youngs_modulus=1e6),
                     materials.FixedCorotated(density=1000.0, youngs_modulus=1e6),
                     materials.StVenantKirchhoffHencky(density=1000.0, youngs_modulus=1e6),
                     materials.LinearElastic(density=1000.0, youngs_modulus=1e6),
                     materials.VonMises(density=1000.0, youngs_modulus=1e6, yield_stress=1e9),
                     ):  # fmt: skip
        scene = square(method=libmpm.Method(time_step=1e-4))
        block(
            scene,
            low=0.0,
            high=1.0,
            lattice=(12, 12),
            material=material,
            velocity=libmpm.Field(components=("1e-4 * sin(pi * x)", "1e-4 * cos(pi * y)")),
        )
        simulation = libmpm.Simulation(scene)
        simulation.run(until=0.02, progress=False)
        found[material.table.name] = simulation.particles["block"]["displacement"]
    expected = found.pop("LinearElastic")
    for name, displacement in found.items():
        assert np.abs(displacement - expected).max() < 1e-4 * np.abs(expected).max(), name


def test_water_column_carries_its_weight():
    scene = square(gravity=(0.0, -9.81), n=3)
    block(scene, material=materials.TaitFluid(bulk_modulus=2e6), hydrostatic=1.0, lattice=(24, 24))
    scene.add_boundary(
        name="tank", shape=shapes.DomainWalls(faces=("x-", "x+", "y-")), response=boundaries.Slip()
    )
    scene.add_sensor(name="bed", sensor=sensors.LoadCell(boundary="tank", faces=("y-",),
                                                        interval=0.01))  # fmt: skip
    simulation = libmpm.Simulation(scene)
    simulation.run(until=0.2, progress=False)
    load = simulation.sensors["bed"].values[:, 1].mean()
    assert load == pytest.approx(-9810.0, rel=0.02)


def test_every_body_s_starvation_is_seen():
    # A stiff block far away decides the largest frequency while a soft one comes to starve.
    mesh = grids.Mesh.blocks(columns=12, rows=1, lower=(0.0, 0.0), upper=(12.0, 1.0))
    for stiff in (None, 1e6, 1e7):
        grid = grids.TriangularGrid(mesh=mesh, basis=grids.Linear(), mass=grids.ConsistentMass())
        scene = libmpm.Scene(grid=grid)
        for name, place, young, speed in (("soft", 0.0, 1e4, 0.05), ("stiff", 6.0, stiff, 0.0)):
            if young is None:
                continue
            scene.add_body(
                name=name, shape=shapes.Box(lower=(place, 0), upper=(place + 2, 1)),
                lattice=(12, 6), velocity=(speed, 0),
                material=materials.Hypoelastic(density=1000.0, youngs_modulus=young),
            )  # fmt: skip
        simulation = libmpm.Simulation(scene)
        with pytest.raises(libmpm.NumericalError) as error:
            simulation.run(until=20.0, progress=False)
        assert "grid: the stable time step has shrunk" in str(error.value), stiff
        speeds = simulation.particles["soft"]["speed"]
        assert speeds.max() < 1.0  # nothing has blown up before
        with pytest.raises(libmpm.NumericalError):
            simulation.step()
        with pytest.raises(libmpm.NumericalError, match="a run that failed is not saved"):
            simulation.save_checkpoint("unused.npz")


def test_moving_and_timed_boundaries():
    # A side that pushes at a set speed for a while: its particles follow, and go on when it stops.
    scene = square(n=2, size=1.0)
    block(
        scene,
        low=0.0,
        high=1.0,
        lattice=(12, 12),
        material=materials.Hypoelastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.0),
        shape=shapes.Box(lower=(0.0, 0.0), upper=(0.8, 1.0)),
    )
    scene.add_boundary(
        name="piston", shape=shapes.DomainWalls(faces=("x-",)), response=boundaries.Slip(),
        motion=libmpm.TimeTable((0.0, 1.0), ((0.05, 0.0), (0.05, 0.0))), time=(0.0, 0.02),
    )  # fmt: skip
    scene.add_boundary(
        name="sides", shape=shapes.DomainWalls(faces=("y-", "y+")), response=boundaries.Slip()
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="piston"))
    scene.add_sensor(name="probe", sensor=sensors.VelocityProbe(position=(0.02, 0.5)))
    simulation = libmpm.Simulation(scene)
    simulation.run(until=0.04, progress=False)
    load, probe = simulation.sensors["load"], simulation.sensors["probe"]
    pushing = (load.time > 0.005) & (load.time < 0.02)
    # ρ c v A while the wave has not come back.
    impedance = np.sqrt(1000.0 * 1e6) * 0.05
    assert load.values[pushing, 0].mean() == pytest.approx(-impedance, rel=0.05)
    assert np.all(load.values[load.time > 0.021, 0] == 0)
    held = (probe.time > 0.005) & (probe.time < 0.02)
    assert probe.values[held, 0].mean() == pytest.approx(0.05, rel=0.05)
    assert probe.values[held, 0] == pytest.approx(0.05, rel=0.12)  # nothing damps its ringing


def test_one_dimensional_splines_are_the_bar():
    # Degree 0 across: the method on a line with B-splines.
    case = t.SMALL_BAR
    errors = []
    for spans in (4, 8):
        grid = grids.SplineGrid(
            lower=(0.0, 0.0), upper=(case.length, case.height), spans=(spans, 1), degree=(2, 0)
        )
        scene = libmpm.Scene(grid=grid, method=libmpm.Method(time_step=1e-4))
        formula = "0.1 * sin(pi * x / 25)"
        scene.add_body(
            name="bar", shape=shapes.Box(lower=(0, 0), upper=(case.length, case.height)),
            lattice=(40 * spans, 1), velocity=libmpm.Field(components=(formula, "0")),
            material=materials.Hypoelastic(density=1.0, youngs_modulus=100.0, poissons_ratio=0.0),
        )  # fmt: skip
        scene.add_boundary(
            name="ends", shape=shapes.DomainWalls(faces=("x-", "x+")), response=boundaries.Sticky()
        )
        simulation = libmpm.Simulation(scene)
        simulation.run(until=0.02, progress=False)
        body = simulation.particles["bar"]
        start = (body["position"] - body["displacement"])[:, 0]
        u, _ = case.linear(start, simulation.time)
        errors.append(np.sqrt(np.mean((body["displacement"][:, 0] - u) ** 2)))
        assert np.all(body["displacement"][:, 1] == 0)
    assert np.log2(errors[0] / errors[1]) > 2.8  # third order
