"""Which walls strain the cells beside them linearly when nobody says so."""

import json

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, contacts, materials, methods, shapes
from libmpm._src.run.engine_spec import lower
from libmpm._src.scene.old_defaults import with_old_defaults

WATER = materials.TaitFluid(density=1000.0, bulk_modulus=2e5)
AFLIP = methods.Transfer(scheme="AFLIP", flip=0.99)
BLOCK = materials.FixedCorotated(density=800.0, youngs_modulus=1e6, poissons_ratio=0.3)


def basin(
    *, material=WATER, response=None, method=None, box=None, fbar="default", more=None, **boundary
):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1.6, 1.2), gravity=(0, -9.81),
        **({} if method is None else {"method": method}),
    )  # fmt: skip
    pool = shapes.Box(lower=(0, 0), upper=(1.6, 0.6))
    scene.add_body(name="body", shape=pool, material=material, fbar=fbar)
    shape = boundary.pop("shape", None) or shapes.DomainWalls()
    scene.add_boundary(
        name="walls", shape=shape, response=response or boundaries.Slip(), **boundary
    )
    if box is not None:
        scene.add_boundary(name="box", shape=box, response=boundaries.Separable())
    if more is not None:
        more(scene)
    return scene


def linear(scene, name="walls"):
    """Whether all faces, or none, of a boundary are linear in what the engine is told."""
    for boundary in lower(scene, with_particles=False)["boundaries"]:
        if boundary["name"] == name:
            (found,) = {face["linear"] for face in boundary["faces"].values()}
            return found
    raise AssertionError(name)


@pytest.mark.parametrize("response", [boundaries.Slip(), boundaries.Separable()])
def test_walls_beside_water_strain_linearly(response):
    scene = basin(response=response, box=shapes.Box(lower=(0.8, 0.8), upper=(1.2, 1.0)))
    assert linear(scene) and linear(scene, "box")
    cells = {plane.boundary: plane.cell for plane in scene.plan().boundaries}
    assert cells == {"walls": "linear", "box": "linear"}
    assert "linear" in str(scene.plan())


def test_those_of_solids_alone_hold_their_nodes():
    assert not linear(basin(material=BLOCK))


@pytest.mark.parametrize(
    "change",
    [
        {"method": methods.Method(kernel="cubic")},
        {"method": methods.Method(transfer=methods.Transfer(scheme="XPIC", order=3))},
        {"method": methods.Method(transfer="FLIP")},
        {"fbar": methods.FBar(form="split", length=0.1)},
        {
            "shape": shapes.HalfSpace(point=(0, 0.02), normal=(0, 1)),
            "layer": boundaries.DecayLayer(thickness=1.5),
        },
        {"within": shapes.Box(lower=(0, 0), upper=(0.8, 1.2))},
        {"bodies": ("body",)},
        {"response": boundaries.Sticky()},
    ],
    ids=lambda change: str(next(iter(change))),
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_where_lines_are_unknown_nodes_are_held(change):
    assert not linear(basin(**change))


def test_a_mirror_holds_all_other_walls():
    sides = {"x-": boundaries.Mirror(), "x+": boundaries.Slip()}
    scene = basin(response=sides | {"y-": boundaries.Slip(), "y+": boundaries.Slip()})
    assert not linear(scene)
    assert {plane.cell for plane in scene.plan().boundaries} == {"mirror", "held"}


def test_contacts_leave_walls_linear():
    def contact(scene):
        block = shapes.Box(lower=(0.4, 0.8), upper=(0.8, 1.0))
        scene.add_body(name="block", shape=block, material=BLOCK)
        scene.add_contact(name="rub", between=("block", "body"), law=contacts.Fluid())

    assert linear(basin(more=contact))


def test_rigid_bodies_hold_walls():
    def rigid(scene):
        block = shapes.Box(lower=(0.4, 0.8), upper=(0.8, 1.0))
        scene.add_body(name="block", shape=block, material=materials.Rigid(density=500.0))

    assert not linear(basin(more=rigid))


def states(scene, cell, steps=60):
    """Return the particles of a scene after some steps with all cells that are "auto" so."""
    data = scene.to_dict()
    for boundary in data["boundaries"]:
        if boundary["motion"] is None and boundary["response"]["cell"] == "auto":
            boundary["response"]["cell"] = cell
    sim = libmpm.Simulation(libmpm.Scene.from_dict(data), device="cpu", threads=1)
    sim.step(steps)
    found = sim.particles["body"]
    order = np.argsort(found["id"])
    return np.asarray(found["position"])[order], np.asarray(found["velocity"])[order]


def on_a_bed(slope):
    """Return water that falls over on a plane through the lower left corner of a basin."""
    bed = shapes.HalfSpace(point=(0.0, 0.13), normal=(-slope, 1.0))
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1.6, 1.2), gravity=(0, -9.81)
    )
    scene.add_body(
        name="body", shape=shapes.Box(lower=(0, 0.13), upper=(0.6, 0.83)) - bed, material=WATER
    )
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
    held = boundaries.Slip(cell="held")
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=held)
    return scene


@pytest.mark.parametrize(("slope", "as_if"), [(0.0, "linear"), (0.005, "linear"), (0.05, "held")])
def test_level_surfaces_are_linear_and_slopes_are_held(slope, as_if):
    """To the bit: a degree is the difference."""
    scene = on_a_bed(slope)
    assert linear(scene, "bed")
    own = states(scene, "auto")
    for cell in ("linear", "held"):
        other = states(scene, cell)
        same = all(np.array_equal(a, b) for a, b in zip(own, other, strict=True))
        assert same is (cell == as_if), cell


@pytest.mark.parametrize(("left", "as_if"), [(0.0, "held"), (0.8, "linear")])
def test_walls_are_held_where_something_moving_may_come(left, as_if):
    """Water within reach of a piston, and water further off than three cells and what it wets."""
    way = libmpm.TimeTable(time=(0.0, 1.0), value=((0.0, 0.0), (0.1, 0.0)))
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(3.2, 1.2), gravity=(0, -9.81)
    )
    scene.add_body(
        name="body", material=WATER,
        shape=shapes.Box(lower=(2 * left, 0), upper=(2 * left + 0.3, 0.6)),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_boundary(
        name="piston", shape=shapes.Box(lower=(-0.4, -0.2), upper=(0.0, 0.9)),
        response=boundaries.Slip(), motion=boundaries.Displacement(way),
    )  # fmt: skip
    own = states(scene, "auto", steps=12)
    for cell in ("linear", "held"):
        other = states(scene, cell, steps=12)
        same = all(np.array_equal(a, b) for a, b in zip(own, other, strict=True))
        assert same is (cell == as_if), cell


def test_a_blend_that_forgets_is_beside_linear_cells():
    blend = methods.Transfer(scheme="AFLIP", flip=0.95)
    scene = basin(method=methods.Method(transfer=blend))
    assert linear(scene)
    # One body that forgets nothing is enough to hold them.
    scene.add_body(
        name="drop", shape=shapes.Box(lower=(0.4, 0.8), upper=(0.8, 1.0)), material=WATER,
        transfer=methods.Transfer(scheme="AFLIP", flip=1.0),
    )  # fmt: skip
    assert not linear(scene)


@pytest.mark.parametrize("cell", ["held", "linear"])
def test_what_is_asked_for_is_done(cell):
    assert linear(basin(response=boundaries.Slip(cell=cell))) is (cell == "linear")


def test_the_default_runs_as_the_named_one():
    found = {}
    for cell in ("auto", "linear", "held"):
        scene = basin(response=boundaries.Slip(cell=cell))
        sim = libmpm.Simulation(scene, device="cpu", threads=1)
        sim.step(40)
        found[cell] = np.asarray(sim.particles["body"]["position"])
    assert np.array_equal(found["auto"], found["linear"])
    assert not np.array_equal(found["auto"], found["held"])


def test_a_run_of_the_first_version_keeps_its_walls():
    """Its walls name no cell and hold nodes; a scene file that names none leaves it to us."""
    scene = basin(box=shapes.Box(lower=(0.8, 0.8), upper=(1.2, 1.0)))
    plain = json.loads(json.dumps(scene.to_dict()))
    for boundary in plain["boundaries"]:
        del boundary["response"]["cell"]
    faces = {face: dict(plain["boundaries"][0]["response"]) for face in ("x-", "x+", "y-", "y+")}
    plain["boundaries"][0]["response"] = faces
    assert linear(libmpm.Scene.from_dict(plain))
    assert not linear(libmpm.Scene.from_dict(with_old_defaults(plain)))
    assert not linear(libmpm.Scene.from_dict(with_old_defaults(plain)), "box")


def test_unknown_cell():
    with pytest.raises(libmpm.SceneError, match=r"cell.*auto.*held.*linear"):
        boundaries.Slip(cell="bent")


def test_walls_one_cell_apart_are_held():
    """Between linear ones water on a slope went from rest to 250 m/s in 48 steps."""
    cells = {}
    for across in (1, 2):
        scene = libmpm.Scene(
            dimension=3, cell_size=0.1, lower=(0, 0, -0.2), upper=(4, 0.1 * across, 0.8),
            gravity=(0, 0, -9.81), method=methods.Method(transfer=AFLIP),
        )  # fmt: skip
        profile = [(-1, -0.1), (5, 0.3), (5, -1), (-1, -1)]
        bed = shapes.Extrusion(profile=profile, axis="y", lower=-1, upper=1)
        pool = shapes.Box(lower=(0, 0, -0.2), upper=(4, 0.1 * across, 0.5))
        scene.add_body(name="water", shape=pool - bed, material=WATER, hydrostatic=0.5)
        scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
        cells[across] = {p.face: p.cell for p in scene.plan().boundaries}
        if across == 1:
            sim = libmpm.Simulation(scene, device="cpu", threads=1)
            sim.step(200)
            assert np.abs(np.asarray(sim.particles["water"]["velocity"])).max() < 0.5
    assert cells[1] == cells[2] | {"y-": "held", "y+": "held"}
    assert set(cells[2].values()) == {"linear"}
