"""`Scene.copy`, `replace` and `remove`: what they change, what they leave, what they refuse."""

from __future__ import annotations

import copy

import pytest

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes


@pytest.fixture
def scene():
    made = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1), gravity=(0, -9.81), name="tank"
    )
    made.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.5)),
        material=materials.TaitFluid(),
    )
    made.add_body(
        name="block",
        shape=shapes.Box(lower=(1, 0), upper=(1.2, 0.2)),
        material=materials.NeoHookean(density=500, youngs_modulus=1e6, poissons_ratio=0.3),
    )
    pier = shapes.Box(lower=(1.5, 0), upper=(1.7, 0.4))
    for name, shape in (("walls", shapes.DomainWalls()), ("pier", pier)):
        made.add_boundary(name=name, shape=shape, response=boundaries.Slip())
    made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="pier", interval=1e-3))
    made.add_sensor(name="water", sensor=sensors.BodyTracker(body="water", interval=1e-3))
    made.add_flow(name="out", flow=boundaries.Outflow(face="x+"))
    made.add_contact(name="rub", between=("water", "block"), law=contacts.Fluid())
    return made


def test_a_copy_is_equal_and_its_own(scene):
    before = scene.to_dict()
    for made in (scene.copy(), copy.copy(scene), copy.deepcopy(scene)):
        assert made == scene and type(made) is libmpm.Scene
        made.add_boundary(
            name="more", shape=shapes.Box(lower=(0, 0.5), upper=(1, 1)), response=boundaries.Slip()
        )
        made.remove("load")
        made.replace("block", velocity=(1.0, 0.0))
        assert scene.to_dict() == before


def test_a_copy_with_other_arguments_is_what_writing_it_anew_gives(scene):
    made = scene.copy(cell_size=0.05, name="fine")
    data = scene.to_dict() | {"cell_size": 0.05, "name": "fine"}
    assert made == libmpm.Scene.from_dict(data) and made.cells == (40, 20)


def test_a_copy_onto_a_grid_of_functions(scene):
    mesh = libmpm.grids.Mesh.squares(columns=20, rows=10, lower=(0, 0), upper=(2, 1))
    grid = libmpm.grids.TriangularGrid(mesh=mesh)
    made = scene.copy(grid=grid)
    assert made.grid == grid and made.bodies == scene.bodies


def test_replaced_parts_keep_their_places_and_what_is_not_named(scene):
    old = scene.bodies
    scene.replace("block", velocity=(0.0, -1.0))
    assert [b.name for b in scene.bodies] == ["water", "block"]
    assert scene.bodies[0] is old[0] and scene.bodies[1].shape == old[1].shape
    assert scene.bodies[1].velocity == (0.0, -1.0)
    scene.replace("pier", response=boundaries.Sticky())
    assert isinstance(scene.boundaries[1].response, boundaries.Sticky)
    scene.replace("load", interval=0.01)
    assert scene.sensors[0].sensor == sensors.LoadCell(boundary="pier", interval=0.01)
    scene.replace("out", face="x-")
    assert scene.flows[0].flow.face == "x-"
    scene.replace("rub", law=contacts.Stick())
    assert scene.contacts[0].law == contacts.Stick() and scene.contacts[0].name == "rub"


def test_a_name_of_two_kinds_asks_which(scene):
    with pytest.raises(libmpm.SceneError, match=r"'water' is a body and a sensor; .*kind='body'"):
        scene.replace("water", velocity=(1.0, 0.0))
    scene.replace("water", kind="sensor", interval=0.5)
    scene.remove("water", kind="sensor")
    scene.replace("water", velocity=(1.0, 0.0))
    assert [s.name for s in scene.sensors] == ["load"] and scene.bodies[0].velocity == (1.0, 0.0)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda s: s.remove("watr"), "no part 'watr'; did you mean 'water'"),
        (lambda s: s.remove("water", kind="flow"), "no flow 'water'; choose from out"),
        (lambda s: s.remove("water", kind="bodi"), "kind is 'bodi'; did you mean 'body'"),
        (lambda s: s.replace("pier", respons=3), "unknown argument 'respons'; did you mean"),
        (lambda s: s.replace("pier", shape=3), "boundary 'pier': shape is 3"),
        (lambda s: s.copy(cellsize=3), "unknown argument 'cellsize'; did you mean 'cell_size'"),
        (lambda s: s.copy(cell_size=0.3), "the domain is 6.66667 cells wide"),
        (lambda s: s.copy(start=None), "start is what Scene.from_checkpoint sets"),
    ],
)
def test_a_wrong_change_is_refused_and_changes_nothing(scene, call, says):
    before = scene.to_dict()
    with pytest.raises(libmpm.SceneError, match=says):
        call(scene)
    assert scene.to_dict() == before


def test_what_names_a_removed_part_is_refused_by_validate(scene):
    scene.remove("out")
    scene.remove("rub")
    scene.remove("pier")
    with pytest.raises(libmpm.SceneError, match="sensor 'load': boundary 'pier' is unknown"):
        scene.validate()
    scene.remove("load")
    scene.validate()


def test_how_a_body_is_filled_by_default_follows_its_shape_and_gravity():
    dry = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1))
    box = shapes.Box(lower=(0, 0), upper=(2, 0.5))
    ramp = shapes.Wedge(lower=(1, 0), upper=(2, 0.3), high="x+")
    bed = shapes.basin(level=0.5, bed=ramp, within=box)
    dry.add_body(name="water", shape=bed, material=materials.TaitFluid())
    dry.add_body(name="flat", shape=box, material=materials.TaitFluid())
    jitter = shapes.Jitter(share=0.1, seed=1)
    dry.add_body(name="loose", shape=bed, material=materials.TaitFluid(), sampling=jitter)
    assert [b.sampling for b in dry.bodies] == [None, None, jitter]
    wet = dry.copy(gravity=(0, -9.81))
    assert [b.sampling for b in wet.bodies] == [shapes.Columns(), None, jitter]
    wet.replace("water", shape=box)
    wet.replace("flat", shape=bed)
    wet.replace("loose", shape=box)
    assert [b.sampling for b in wet.bodies] == [None, shapes.Columns(), jitter]
    wet.replace("flat", sampling=None)
    assert wet.bodies[1].sampling is None


def test_what_a_checkpoint_was_computed_with_stays(scene, tmp_path):
    for name in ("out", "rub", "block"):
        scene.remove(name)
    simulation = libmpm.Simulation(scene, device="cpu", threads=1)
    simulation.step(3)
    path = tmp_path / "trunk.npz"
    simulation.save_checkpoint(path)
    branch = libmpm.Scene.from_checkpoint(path)
    stone = shapes.Box(lower=(1, 0), upper=(1.2, 0.2))
    branch.add_body(name="stone", shape=stone, material=scene.bodies[0].material)
    branch.add_sensor(name="more", sensor=sensors.Energy())
    for name, kind in (("water", "body"), ("pier", None), ("load", None)):
        with pytest.raises(libmpm.SceneError, match="part of the run that the scene continues"):
            branch.remove(name, kind=kind)
    with pytest.raises(libmpm.SceneError, match="part of the run that the scene continues"):
        branch.replace("water", kind="body", material=materials.TaitFluid(density=900))
    with pytest.raises(libmpm.SceneError, match=r"Scene\.copy: cell_size of a scene that"):
        branch.copy(cell_size=0.05)
    other = branch.copy()
    assert other == branch
    other.replace("stone", velocity=(0.0, -1.0))
    other.remove("more")
    other.remove("stone")
    assert other == libmpm.Scene.from_checkpoint(path)
