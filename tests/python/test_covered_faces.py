"""Faces of surfaces that lie on walls: what stands on a floor is as if it went on below.

Expected duration: 8 s.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import libmpm
from libmpm import Scene, Simulation, TimeTable
from libmpm._src.boundaries import distance_field
from libmpm.boundaries import Displacement, Rotation, Separable, Slip, Travel
from libmpm.materials import TaitFluid
from libmpm.shapes import Box, Cylinder, DomainWalls, Extrusion, HalfSpace

WATER = TaitFluid(density=1000.0, bulk_modulus=2e5)


def strokes(count, period, way, rows=40):
    """A smooth motion there and back, `count` times."""
    time = np.linspace(0.0, count * period, count * rows + 1)
    return TimeTable(time, [(0.5 * way * (1 - np.cos(2 * np.pi * t / period)), 0) for t in time])


@pytest.mark.parametrize("wall", [Slip(), Separable()])
@pytest.mark.parametrize("floor", ["wall", "box", "plane"])
def test_nothing_gets_behind_a_piston_that_ends_on_the_floor(floor, wall):
    """The wave maker of docs/boundaries.md: 20 strokes of 4 cells."""
    dx, way, period = 0.25, 1.0, 2.0
    low = -2 * dx if floor != "wall" else 0.0
    path = strokes(20, period, way)
    scene = Scene(dimension=2, cell_size=dx, lower=(-1, low), upper=(4, 3), gravity=(0, -9.81))
    water = Box(lower=(0, 0), upper=(4, 1))
    scene.add_body(name="water", shape=water, material=WATER, hydrostatic=1.0)
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
    if floor == "box":
        step = Box(lower=(-1, low), upper=(4, 0))
        scene.add_boundary(name="step", shape=step, response=Slip())
    elif floor == "plane":
        plane = HalfSpace(point=(0, 0), normal=(0, 1))
        scene.add_boundary(name="bed", shape=plane, response=Slip())
    scene.add_boundary(
        name="piston",
        shape=Box(lower=(-4, 0), upper=(0, 3)),
        response=wall,
        motion=Displacement(path),
    )
    sim = Simulation(scene, device="cpu", threads=1)
    for k in range(1, 81):
        sim.run(until=k * period / 4, progress=False)
        position = np.asarray(sim.particles["water"]["position"])
        front = float(path.at(sim.time)[0])
        assert len(position) == sim.particle_count(0)
        assert position[:, 0].min() > front - 0.05 * dx, f"behind at {sim.time:.2f} s"


def fields(scene, boundary):
    """Distances at the nodes of a scene, m; those beyond the field are far outside."""
    field = distance_field.distance_field(scene, boundary)
    known = {tuple(k): p for k, p in zip(field.keys.tolist(), field.place.tolist(), strict=True)}
    edge, d = distance_field.FIELD_EDGE, scene.dimension

    def at(index):
        block, inside = np.divmod(index, edge)
        place = known.get(tuple(block.tolist()))
        if place is None:
            return 9.0
        if place < 0:
            return -9.0
        number = np.ravel_multi_index(tuple(inside), (edge + 1,) * d)
        return float(field.values[place, number]) * field.spacing / scene.cell_size

    return at


def compare(scene, short, long, where):
    """Both shapes have the same distances, cells, at these lattice points, up to 3 cells deep."""
    one, two = (
        fields(scene, libmpm._src.scene.parts.Boundary(name=n, shape=s, response=Slip(), **more))
        for n, s, more in (("short", *short), ("long", *long))
    )
    seen = 0
    for index in where:
        a, b = one(index), two(index)
        if abs(b) > 3:
            continue
        seen += 1
        assert abs(a - b) < 0.02, (index.tolist(), a, b)
    assert seen > 10


def tank(dimension, long=4):
    dx = 0.125
    scene = Scene(dimension=dimension, cell_size=dx, lower=(0,) * dimension,
                  upper=(long, 2, 2)[:dimension])  # fmt: skip
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
    return scene


def grid_points(*ranges):
    return np.stack(np.meshgrid(*(np.arange(*r) for r in ranges), indexing="ij"), -1).reshape(
        -1, len(ranges)
    )


def test_a_box_on_the_floor_is_as_one_through_it():
    scene = tank(2)
    layer = {"layer": libmpm.boundaries.DecayLayer()}
    compare(
        scene,
        (Box(lower=(1, 0), upper=(3, 1.5)), layer),
        (Box(lower=(1, -2), upper=(3, 1.5)), layer),
        grid_points((5, 28), (-2, 14)),
    )


def test_a_box_in_a_corner_is_as_one_through_both_walls():
    scene = tank(3)
    way = {"motion": Travel((0.5, 0, 0))}
    compare(
        scene,
        (Box(lower=(0.5, 0, 0), upper=(1, 1.5, 1.5)), way),
        (Box(lower=(0.5, -2, -2), upper=(1, 1.5, 1.5)), way),
        grid_points((1, 12), (-2, 14, 3), (-2, 14, 3)),
    )


def test_a_post_on_the_floor_is_as_one_through_it():
    scene = tank(3)
    compare(
        scene,
        (Cylinder(start=(2, 1, 0), end=(2, 1, 2), radius=0.5), {}),
        (Cylinder(start=(2, 1, -2), end=(2, 1, 4), radius=0.5), {}),
        grid_points((10, 23, 2), (2, 15, 2), (-2, 18, 2)),
    )


def bed_from(corner, *above):
    """A bed that lies on the floor up to x = corner, and on from there."""
    return Extrusion(profile=[(-2, 0), (corner, 0), *above, (90, -3), (-2, -3)])


@pytest.mark.parametrize("height", [0.06, 0.125, 0.5, 1.9])
def test_a_bed_that_lies_on_the_floor_has_no_face_but_its_step(height):
    """However low the step, nothing stands where the bed is flat."""
    scene = tank(2)
    compare(
        scene,
        (bed_from(2.01, (2.01, height), (90, height)), {}),
        (Box(lower=(2.01, -3), upper=(90, height)), {"layer": libmpm.boundaries.DecayLayer()}),
        grid_points((-2, 20), (-1, 16)),
    )


@pytest.mark.parametrize("slope", [0.02, 1 / 12, 0.5, 2.0])
def test_a_bed_that_rises_from_the_floor_goes_on_below_it(slope):
    scene = tank(2, 60)
    normal = (-slope, 1.0)
    compare(
        scene,
        (bed_from(2.01, (90, (90 - 2.01) * slope)), {}),
        (HalfSpace(point=(2.01, 0), normal=normal), {}),
        grid_points((2, 30), (-1, 6)),
    )


def test_distances_from_the_bed_of_a_flume_have_no_jumps():
    """The Large Wave Flume's bed: flat on the floor, a step, slopes that get milder, a plateau."""
    scene = Scene(dimension=2, cell_size=0.1, lower=(-1, 0), upper=(71, 3), gravity=(0, -9.81))
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
    bed = bed_from(14.275, (14.28, 0.226), (17.933, 0.226), (28.906, 1.1404), (43.536, 1.75),
                   (90, 1.75))  # fmt: skip
    at = fields(scene, libmpm._src.scene.parts.Boundary(name="bed", shape=bed, response=Slip()))
    values = np.array([[at(np.array((i, j))) for j in range(-2, 12)] for i in range(-2, 600)])
    for a in (0, 1):
        one, two = (np.take(values, range(k, values.shape[a] - 1 + k), axis=a) for k in (0, 1))
        low, high = np.minimum(one, two), np.maximum(one, two)
        # Deeper inside the step the nearest face changes below the floor.
        near = (low < 2.5) & (high > -1.25) & (high < 9)
        assert near.sum() > 500
        assert abs(one - two)[near].max() < 1.05
    assert (values[:148] > 3).all()  # nothing stands before the step


#: Profiles in cells whose corners lie on corners of the lattice.
PROFILES = {
    "step": [(0, 0), (8, 0), (8, 4), (16, 4)],
    "step that leans": [(0, 0), (8, 0), (8.1, 4.5), (16, 4.5)],
    "trench": [(0, 4), (4, 4), (4, 0), (10, 0), (10, 4), (16, 4)],
    "ridge": [(0, 0), (6, 0), (6, 3), (9, 3), (9, 0), (16, 0)],
    "slope": [(0, 0), (6, 0), (14, 4), (16, 4)],
}


def stepped(name, cell, wide, cell_response="auto"):
    """Water over a bed between two walls, `wide` cells apart, that stand on it."""
    profile = [(x * cell, z * cell) for x, z in PROFILES[name]]
    profile = [(-9, profile[0][1]), *profile, (9, profile[-1][1]), (9, -9), (-9, -9)]
    bed = Extrusion(axis="y", lower=-1.0, upper=5.0, profile=profile)
    upper = (16 * cell, wide * cell, 16 * cell)
    scene = Scene(
        dimension=3, cell_size=cell, lower=(0, 0, -2 * cell), upper=upper, gravity=(0, 0, -9.81)
    )
    sea = libmpm.shapes.basin(level=12 * cell, bed=bed, within=Box(lower=(0, 0, -1), upper=upper))
    scene.add_body(name="water", shape=sea, material=WATER, hydrostatic=12 * cell,
                   sampling=libmpm.shapes.Columns())  # fmt: skip
    scene.add_boundary(name="bed", shape=bed, response=Slip(cell=cell_response))
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
    return scene, bed


@pytest.mark.parametrize("wide", [1, 4])
@pytest.mark.parametrize("name", PROFILES)
def test_corners_of_a_bed_on_corners_of_the_lattice_are_as_stated(name, wide):
    """On the walls beside it too, where both faces of a corner are equally near and in the open."""
    cell = 0.25
    scene, bed = stepped(name, cell, wide)
    found = fields(scene, scene.boundaries[0])
    points = grid_points((2, 15), (0, wide + 1), (1, 14))
    stated = bed.distance(np.asarray(scene.lower) + cell * points) / cell
    near = np.abs(stated) < 3
    assert near.sum() > 100
    for index, expected in zip(points[near], stated[near], strict=True):
        assert found(index) == pytest.approx(expected, abs=0.02), index


@pytest.mark.parametrize("cell_response", ["held", "auto"])
@pytest.mark.parametrize("name", ["step", "step that leans", "trench"])
def test_water_rests_before_a_step_on_corners_of_the_lattice(name, cell_response):
    """In a strip one cell wide it ran into the corner at 2 m/s, and the run ended."""
    cell = 0.05
    scene, bed = stepped(name, cell, 1, cell_response)
    sim = Simulation(scene, device="cpu", threads=1)
    sim.run(until=0.15, progress=False)
    x = np.asarray(sim.particles["water"]["position"])
    speed = np.linalg.norm(np.asarray(sim.particles["water"]["velocity"]), axis=1)
    assert bed.distance(x).min() > -0.3 * cell
    assert speed.max() < 0.1 * np.sqrt(9.81 * 12 * cell)


def test_what_lies_in_the_open_is_as_stated():
    """Near faces that no wall covers distances are the shape's own, to the bit."""
    scene = tank(2)
    boundary = libmpm._src.scene.parts.Boundary(
        name="ball", shape=libmpm.shapes.Sphere(centre=(2, 1), radius=0.4), response=Slip()
    )
    at = fields(scene, boundary)
    for index in grid_points((10, 22), (2, 15)):
        point = index * scene.cell_size
        exact = np.hypot(*(point - (2, 1))) - 0.4
        if abs(exact) < 0.3:
            assert at(index) == np.float32(exact / scene.cell_size)


@pytest.mark.parametrize(
    "more",
    [
        {"motion": Displacement(TimeTable((0, 1, 2), ((0, 0), (0, 0), (0, 1))))},
        {"rotation": Rotation(about=(2.25, 0), rate=1.0)},
    ],
)
def test_what_leaves_the_wall_that_it_stands_on_is_warned_of(more):
    for low, doubted in ((0.0, True), (-0.25, False)):
        scene = tank(2)
        box = Box(lower=(0, 0), upper=(1, 1))
        scene.add_body(name="water", shape=box, material=WATER)
        gate = Box(lower=(2, low), upper=(2.5, 1.5))
        scene.add_boundary(name="gate", shape=gate, response=Slip(), **more)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", libmpm.ModelWarning)
            doubts = [d for d in scene.plan(device="cpu").warnings if "'gate'" in d]
        assert bool(doubts) == doubted
        if doubted:
            assert "wall y-" in doubts[0]
            assert "0.25 m longer" in doubts[0]


def test_a_bed_that_walls_cover_whole_acts_where_they_do():
    scene = tank(2)
    bed = Box(lower=(-1, -1), upper=(5, 0))
    boundary = libmpm._src.scene.parts.Boundary(
        name="bed", shape=bed, response=Slip(), layer=libmpm.boundaries.DecayLayer()
    )
    at = fields(scene, boundary)
    assert at(np.array((8, 2))) == pytest.approx(2)


def rough_for_a_block(bed, rough):
    """A bed for all, and a boundary in its place for a block alone."""
    scene = Scene(dimension=2, cell_size=0.05, lower=(-1, -1), upper=(1, 1), gravity=(0, -9.81))
    scene.add_body(name="block", shape=Box(lower=(-0.2, 0.1), upper=(0.2, 0.4)), material=WATER)
    scene.add_boundary(name="bed", shape=bed, response=Separable(cell="held"))
    scene.add_boundary(
        name="rough", shape=rough, response=Separable(cell="held"), bodies=("block",)
    )
    return scene


@pytest.mark.parametrize("slope", [0.0, 0.02, 0.05, 0.2])
@pytest.mark.parametrize("far", [0.0, 2.0])
def test_a_plane_with_friction_for_some_is_not_covered_by_the_bed_in_its_place(slope, far):
    """Both act there: its distances are those of the plane, whatever point of it names it."""
    bed = HalfSpace(point=(0, 0.013), normal=(-slope, 1))
    same = HalfSpace(point=(far, 0.013 + slope * far), normal=(-2 * slope, 2))
    scene = rough_for_a_block(bed, same)
    fields = [distance_field.distance_field(scene, b) for b in scene.boundaries]
    assert np.array_equal(fields[0].keys, fields[1].keys)
    np.testing.assert_allclose(fields[0].values, fields[1].values, atol=1e-5)


LEANS = HalfSpace(point=(0, 0), normal=(-0.1, 1))
LEVEL = HalfSpace(point=(0, 0), normal=(0, 1))
AROUND = Box(lower=(-0.5, -1.5), upper=(0.5, 1))


@pytest.mark.parametrize(
    ("bed", "rough", "plane"),
    [(LEANS, LEANS & AROUND, LEANS),
     (LEANS, LEANS - Box(lower=(0.4, -1.5), upper=(2, 1)), LEANS),
     (Box(lower=(-1, -1), upper=(1, 0)), LEVEL, LEVEL),
     (Box(lower=(-1, -1), upper=(1, 0)), LEVEL & AROUND, LEVEL),
     (LEVEL, Extrusion(profile=((-0.6, -1), (-0.6, 0), (0.6, 0), (0.6, -1))), LEVEL)],
)  # fmt: skip
def test_friction_for_some_is_there_whatever_names_the_beds_face(bed, rough, plane):
    """Above the bed distances are those of its plane, whatever else bounds the shape."""
    scene = rough_for_a_block(bed, rough)
    cell, boundary = scene.cell_size, next(b for b in scene.boundaries if b.name == "rough")
    field = distance_field.distance_field(scene, boundary)
    for x in (-0.3, 0.0, 0.2):
        from_corner = np.array([x, 0.05]) + 1
        block = np.floor(from_corner / (8 * cell)).astype(int)
        (k,) = np.flatnonzero((field.keys == block).all(axis=1))
        at = np.round(from_corner / cell - 8 * block).astype(int)
        value = field.values[field.place[k]].reshape(9, 9)[tuple(at)] * cell
        point = (block * 8 + at) * cell - 1
        assert value == pytest.approx(plane.distance(point[None])[0], abs=1e-6), x
