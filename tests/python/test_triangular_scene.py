"""Scenes on grids of triangles and splines: what they accept, and that they run like any other."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.cli.commands import main
from support.function_scenes import ELASTIC, block, column, square


def test_scene_takes_its_domain_from_the_grid():
    scene = square(size=2.0)
    assert scene.dimension == 2
    assert (scene.lower, scene.upper) == ((0.0, 0.0), (2.0, 2.0))
    assert scene.cells == (16,)
    assert scene.cell_size == pytest.approx(np.sqrt(0.5))
    with pytest.raises(libmpm.SceneError, match=r"cell_size is 0\.1 with a grid"):
        libmpm.Scene(grid=scene.grid, cell_size=0.1)
    with pytest.raises(libmpm.SceneError, match="dimension is 3"):
        libmpm.Scene(grid=scene.grid, dimension=3)
    with pytest.raises(libmpm.SceneError, match="argument 'cell_size' is missing"):
        libmpm.Scene(lower=(0, 0), upper=(1, 1))


def test_scenes_round_trip():
    scene = column()
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
    for copy in (
        libmpm.Scene.from_dict(scene.to_dict()),
        pickle.loads(pickle.dumps(scene)),
    ):
        assert copy == scene
        assert copy.plan().to_dict() == scene.plan().to_dict()


def test_scene_file(tmp_path):
    scene = column()
    scene.save(tmp_path / "column.json")
    assert libmpm.Scene.load(tmp_path / "column.json") == scene


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: block(s, "b", fbar=libmpm.FBar()), "fbar is .* on a grid of functions"),
        (lambda s: block(s, "b", stress=(0, 0, 0, 0), material=materials.NeoHookean(
            density=1.0, youngs_modulus=1.0)), "stress is given for NeoHookean"),
        (lambda s: block(s, "b", shape=shapes.Cells(), particles_per_cell=5), "square number"),
        (lambda s: block(s, "b", shape=shapes.Cells(within=((5, 5), (6, 5), (6, 6)))),
         "centre of no triangle"),
        (lambda s: block(s, "b", high=1.5), "expected inside the domain"),
        (lambda s: block(s, "b", shape=shapes.Cells(),
                         tractions=(libmpm.grids.Traction(face="y+", value=(0, -1)),)),
         "tractions act on faces of a shapes.Box"),
        (lambda s: s.add_boundary(name="w", shape=shapes.Box(lower=(0, 0), upper=(1, 1)),
                                  response=boundaries.Slip()), "a Box cannot lie in a grid"),
        (lambda s: s.add_boundary(name="w", shape=shapes.DomainWalls(),
                                  response=boundaries.Separable()), "Separable.* is not built"),
        (lambda s: s.add_sensor(name="g", sensor=sensors.WaveGauge(position=(0.5,))),
         "a WaveGauge is not built"),
    ],
)  # fmt: skip
def test_refusals_name_object_and_remedy(change, message):
    scene = block(square())
    with pytest.raises(libmpm.SceneError, match=message):
        change(scene)
        scene.validate()


def test_bodies_share_no_room():
    mesh = grids.Mesh.blocks(columns=2, rows=1, lower=(0.0, 0.0), upper=(2.0, 1.0))
    left = ((-1, -1), (1, -1), (1, 2), (-1, 2))
    for first, second, message in (
        (shapes.Cells(), shapes.Cells(within=left), "both fill 4 triangles"),
        (shapes.Cells(), shapes.Box(lower=(0, 0), upper=(1, 1)), "the bodies have 3 m² in all"),
        (shapes.Points(position=((1, 0.5),), volume=(5.0,)), None, "the bodies have 5 m² in all"),
    ):
        scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh))
        for name, shape in (("a", first), ("b", second)):
            if shape is not None:
                scene.add_body(name=name, shape=shape, material=ELASTIC)
        with pytest.raises(libmpm.SceneError, match=message):
            scene.validate()


def test_sensors_fit_the_grid():
    scene = block(libmpm.Scene(grid=grids.TriangularGrid(
        mesh=grids.Mesh(vertices=((0, 0), (1, 0), (0, 1)), triangles=((0, 1, 2),)))),
        shape=shapes.Cells())  # fmt: skip
    scene.add_boundary(
        name="slope", shape=shapes.Outline(points=((1, 0), (0, 1))), response=boundaries.Slip()
    )
    scene.add_sensor(name="far", sensor=sensors.VelocityProbe(position=(0.9, 0.9)))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="slope", faces=("x-",)))
    with pytest.raises(libmpm.SceneError) as error:
        scene.validate()
    assert "sensor 'far': position (0.9, 0.9) m lies outside" in str(error.value)
    assert "'slope' is an Outline, which has none" in str(error.value)


def test_outlines_lie_on_edges_all_along():
    for points, message in ((((0, 0), (3, 0)), "on 1.000000 m of its 3.000000"),
                            (((0, 0), (0.3, 0)), "no edge of the grid's outline lies on it"),
                            (((0, 0), (1, 0.5)), "no edge")):  # fmt: skip
        scene = block(square())
        scene.add_boundary(
            name="w", shape=shapes.Outline(points=points), response=boundaries.Slip()
        )
        with pytest.raises(libmpm.SceneError, match=message):
            libmpm.Simulation(scene).step()
    mesh = grids.Mesh(vertices=((0, 0), (1, 0), (0, 1)), triangles=((0, 1, 2),))
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh))
    scene.add_body(name="b", shape=shapes.Cells(), particles_per_cell=16, material=ELASTIC)
    scene.add_boundary(name="w", shape=shapes.DomainWalls(), response=boundaries.Slip())
    with pytest.raises(libmpm.SceneError, match=r"lies on face x\+"):
        libmpm.Simulation(scene).step()


def test_a_scene_that_cannot_move_is_refused():
    mesh = grids.Mesh(vertices=((0, 0), (1, 0), (0, 1)), triangles=((0, 1, 2),))
    grid = grids.TriangularGrid(mesh=mesh, basis=grids.Linear())
    scene = libmpm.Scene(grid=grid)
    scene.add_body(name="b", shape=shapes.Cells(), particles_per_cell=16, material=ELASTIC)
    scene.add_boundary(name="all", shape=shapes.Outline(
        points=((0, 0), (1, 0), (0, 1), (0, 0))), response=boundaries.Sticky())  # fmt: skip
    with pytest.raises(libmpm.SceneError, match="no function is free to move"):
        libmpm.Simulation(scene).step()


def test_what_a_grid_of_functions_lacks_is_refused():
    scene = block(square(method=libmpm.Method(leaving="freeze")))
    with pytest.raises(libmpm.SceneError, match="'freeze'"):
        scene.validate()
    scene = block(square())
    for options, message in (
        ({"precision": "single"}, "built in double alone"),
        ({"device": "cuda"}, "built for the CPU alone"),
        ({"pipeline": "fused"}, "expected 'auto'"),
    ):
        with pytest.raises(libmpm.SceneError, match=message):
            libmpm.Simulation(scene, **options)


def test_what_square_cells_lack_is_refused():
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_body(name="a", shape=shapes.Cells(), material=ELASTIC)
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0, 0), upper=(1, 1)), material=ELASTIC,
        tractions=libmpm.grids.Traction(face="x+", value=(1, 0)), lattice=(2, 2, 2),
    )  # fmt: skip
    scene.add_boundary(
        name="c", shape=shapes.Outline(points=((0, 0), (1, 0))), response=boundaries.Slip()
    )
    with pytest.raises(libmpm.SceneError) as error:
        scene.validate()
    for text in ("body 'a': shapes.Cells", "body 'b': tractions", "lattice has 3", "boundary 'c'"):
        assert text in str(error.value)


def test_lattice_and_field_on_square_cells():
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(-1, 2), upper=(0, 3))
    scene.add_body(
        name="b", shape=shapes.Box(lower=(-0.8, 2.2), upper=(-0.2, 2.8)), material=ELASTIC,
        lattice=(5, 7), velocity=libmpm.Field(components=("x", "2 * y")),
    )  # fmt: skip
    body = libmpm.Simulation(scene, device="cpu", precision="double").particles["b"]
    assert len(body) == 35
    # A linear field stays itself when gathered from the grid, but for the outermost nodes.
    assert np.ptp(body["position"][:, 0]) == pytest.approx(0.6 * 4 / 5)
    momentum = (body["mass"][:, None] * body["velocity"]).sum(axis=0)
    position = body["position"]
    expected = body["mass"].sum() * np.array([position[:, 0].mean(), 2 * position[:, 1].mean()])
    assert momentum == pytest.approx(expected, rel=1e-6)


def test_field_evaluates_arithmetic_alone():
    field = libmpm.Field(components=("where(x > 0.5, 1, -x ** 2)", "max(y, 0) + cos(pi)"))
    found = field.at([(1.0, 2.0), (0.5, -3.0)])
    assert found.tolist() == [[1.0, 1.0], [-0.25, -1.0]]
    for formula in (
        "sin(x, y)",
        "max(x)",
        "+".join("x" * 20000),
        "__import__('os')",
        "x.real",
        "[x]",
        "open('f')",
        "x if y else 0",
        "'a'",
        "w",
    ):
        with pytest.raises(libmpm.SceneError, match=r"components\[0\]"):
            libmpm.Field(components=(formula,))
    assert libmpm.Field(components=("x * y",))([1.0, 2.0], [3.0, 4.0]).tolist() == [3.0, 8.0]


@pytest.mark.parametrize(
    "formula", ["1 / (0 * x)", "log(x - 9)", "10 ** 1000", "9 ** 9 ** 9", "(-1) ** 0.5", "z"]
)
def test_fields_that_are_not_finite_are_refused_with_the_body(formula):
    for scene in (square(), libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))):
        block(scene, low=0.1, high=0.9, velocity=libmpm.Field(components=(formula, "0")))
        with pytest.raises(libmpm.SceneError, match="body 'block': velocity: component 0"):
            scene.validate()


def test_runs_do_not_depend_on_threads_portions_or_reading(tmp_path):
    def run(threads, portions, read, until=0.05):
        scene = column()
        scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
        simulation = libmpm.Simulation(scene, threads=threads)
        for k in range(portions):
            simulation.run(until=until * (k + 1) / portions, progress=False)
            if read:
                _ = simulation.grid["velocity"], simulation.particles["soil"]["stress"]
        body = simulation.particles["soil"]
        return body["position"], body["velocity"], simulation.sensors["energy"].values

    first = run(1, 1, False)
    for other in (run(2, 1, False), run(2, 5, True)):
        for a, b in zip(first, other, strict=True):
            assert np.array_equal(a, b)


def test_checkpoints_continue_bit_for_bit(tmp_path):
    whole = libmpm.Simulation(column())
    whole.step(60)
    half = libmpm.Simulation(column())
    half.step(27)  # not where the largest frequency is looked at
    half.save_checkpoint(tmp_path / "half.npz")
    resumed = libmpm.Simulation.resume(tmp_path / "half.npz")
    resumed.step(33)
    assert resumed.time == whole.time
    for name in ("position", "velocity", "stress", "displacement"):
        assert np.array_equal(resumed.particles["soil"][name], whole.particles["soil"][name]), name
    assert np.array_equal(resumed.sensors["middle"].values, whole.sensors["middle"].values)


def test_frames_and_sensor_files(tmp_path):
    scene = column()
    output = libmpm.Output(tmp_path / "out", frame_interval=0.01, checkpoint_interval=0.02)
    with libmpm.Simulation(scene, output=output) as simulation:
        simulation.run(until=0.03, progress=False)
    written = {path.suffix for path in (tmp_path / "out").rglob("*")}
    assert ".vtkhdf" in written and ".npz" in written and ".h5" in written


def test_leaving_particles_are_named_or_deleted():
    for policy in ("stop", "delete"):
        scene = square(method=libmpm.Method(leaving=policy), mass=grids.LumpedMass())
        block(scene, low=0.6, high=0.9, lattice=(6, 6), velocity=(3.0, 0.0))
        simulation = libmpm.Simulation(scene)
        if policy == "stop":
            with pytest.raises(libmpm.NumericalError, match="left the domain"):
                simulation.run(until=0.2, progress=False)
            continue
        with pytest.warns(libmpm.ModelWarning, match="policy delete"):
            simulation.run(until=0.08, progress=False)
        assert 0 < len(simulation.particles["block"]) < 36
        assert len(simulation.particles["block"]["id"]) == len(simulation.particles["block"])
        with pytest.warns(libmpm.ModelWarning):
            simulation.run(until=0.5, progress=False)
        assert len(simulation.particles["block"]) == 0
        assert simulation.time >= 0.5  # an empty scene goes on


def test_particles_outside_the_mesh_are_refused():
    mesh = grids.Mesh(vertices=((0, 0), (1, 0), (0, 1)), triangles=((0, 1, 2),))
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh))
    scene.add_body(name="b", shape=shapes.Box(lower=(0, 0), upper=(0.9, 0.9)), lattice=(4, 4),
                   material=ELASTIC)  # fmt: skip
    with pytest.raises(libmpm.SceneError, match="of its 16 particles lie outside of the mesh"):
        scene.validate()


def test_cells_and_points_fill_exactly():
    mesh = grids.Mesh.delaunay(np.random.default_rng(5).random((40, 2)))
    grid = grids.TriangularGrid(mesh=mesh)
    for shape, ppc in ((shapes.Cells(), 9), (shapes.Points(
            position=mesh.corners().mean(axis=1)), 1)):  # fmt: skip
        scene = libmpm.Scene(grid=grid)
        scene.add_body(name="b", shape=shape, material=ELASTIC, particles_per_cell=ppc)
        mass = libmpm.Simulation(scene).particles["b"]["mass"]
        assert mass.sum() == pytest.approx(1000 * mesh.area, rel=1e-12)
        assert len(mass) == ppc * len(mesh.areas())


def test_plan_tells_what_runs():
    plan = column().plan(until=0.1)
    assert plan.pipeline == "modified update"
    assert "factorise" in plan.kernels
    assert plan.precision == "double" and plan.device == "cpu"
    simulation = libmpm.Simulation(column())
    simulation.step()
    # With what building the matrices takes for a moment.
    assert 1 < plan.memory_total / simulation.statistics["bytes"] < 2.5
    # The estimate of the step is a safe one, and the run's own is not far from it.
    assert 0.5 < plan.time_step / simulation.dt < 1.5
    assert "TriangularGrid" in str(plan) and "TriangularGrid" in plan._repr_html_()


def test_command_line_runs_and_plans_such_a_scene(tmp_path, capsys):
    scene = column(interval=0.001)
    file, out = tmp_path / "column.json", tmp_path / "out"
    scene.save(file)
    quiet = ["--quiet"]
    assert main(["check", str(file)]) == 0
    assert main(["plan", str(file)]) == 0
    assert "modified update" in capsys.readouterr().out
    assert main(["run", str(file), "-o", str(out), "--until", "0.01", *quiet]) == 0
    assert (out / "report.png").exists()
    assert main(["run", str(file), "-o", str(tmp_path / "b"), "--precision", "single"]) == 2
