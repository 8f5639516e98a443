"""Boxes at any angle as bodies: filling, subtraction, overlaps, and motion."""

from __future__ import annotations

import itertools
import json
import math
import pickle
import tracemalloc
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely.geometry import Polygon

import libmpm
from libmpm import Scene, boundaries, grids, materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm._src.shapes import lattices
from libmpm._src.shapes.oriented_boxes import TurnedBox, depth, rotation
from support.scenes import with_arrays

Make = Callable[..., Scene]
Array = npt.NDArray[np.float64]
HDPE = materials.FixedCorotated(density=981.0, youngs_modulus=1e6, poissons_ratio=0.4)
WATER = materials.TaitFluid(bulk_modulus=1e6)
CELL = 0.1


def oriented(
    centre: tuple[float, ...], size: tuple[float, ...], angle: float, axis: str | None = None
) -> shapes.OrientedBox:
    return shapes.OrientedBox(centre=centre, size=size, angle=angle, axis=axis)


def turned(
    centre: tuple[float, ...], size: tuple[float, ...], angle: float, axis: str | None = None
) -> TurnedBox:
    return oriented(centre, size, angle, axis).turned_box()


def turn(box: TurnedBox) -> Array:
    return np.array(box.axes)


def inside(points: Array, box: TurnedBox, allowance: float = 1e-9 * CELL) -> npt.NDArray[np.bool_]:
    """The plain test, in the own frame of the box."""
    own = (points - np.array(box.centre)) @ turn(box)
    half = 0.5 * np.array(box.size)
    return np.all((own >= -half - allowance) & (own < half - allowance), axis=1)


def doubtful(points: Array, box: TurnedBox) -> bool:
    """Whether rounding decides about a point."""
    own = (points - np.array(box.centre)) @ turn(box)
    away = np.abs(np.abs(own) - 0.5 * np.array(box.size))
    return bool(np.any((away > 1e-12) & (away < 1e-8)))


def refused(call: Callable[..., Any], *args: Any, **keywords: Any) -> list[str]:
    with warnings.catch_warnings(), pytest.raises(libmpm.SceneError) as caught:
        warnings.simplefilter("ignore")
        call(*args, **keywords)
    return caught.value.problems


def box_scene(dimension: int = 3, **changes: Any) -> Scene:
    arguments: dict[str, Any] = {
        "dimension": dimension,
        "cell_size": CELL,
        "lower": (0.0,) * dimension,
        "upper": (2.0,) * dimension,
    }
    return Scene(**(arguments | changes))


# The value ---------------------------------------------------------------------------------


def test_round_trips() -> None:
    flat = oriented((1, 2), (0.5, 0.1), 30)
    solid = oriented((1, 2, 3), (0.5, 0.1, 0.2), -400.5, "x")
    for one in (flat, solid):
        data = json.loads(json.dumps(one.to_dict()))
        assert shapes.OrientedBox.from_dict(data) == one
        assert pickle.loads(pickle.dumps(one)) == one
    assert flat.axis is None
    assert oriented((1, 2, 3), (1, 1, 1), 0).axis == "z"
    scene = box_scene()
    scene.add_body(name="log", shape=oriented((1, 1, 1), (0.5, 0.2, 0.2), 30), material=HDPE)
    assert Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"size": (0.5, 0)}, "size[1] is 0; expected > 0 m"),
        ({"size": (0.5, 1, 1)}, "centre has 2 and size 3 numbers"),
        ({"angle": math.inf}, "angle is inf; expected a finite number in degrees"),
        ({"axis": "z"}, "axis is 'z' in 2D, where the angle is in the plane; leave it out"),
        ({"centre": (1, 2, 3), "size": (1, 1, 1), "axis": "w"}, "axis is 'w'; choose from x, y, z"),
    ],
)
def test_refused_values(changes: dict[str, Any], words: str) -> None:
    good: dict[str, Any] = {"centre": (1, 2), "size": (0.5, 0.1), "angle": 0.0}
    found = refused(shapes.OrientedBox, **(good | changes))
    assert any(p.startswith("shapes.OrientedBox: ") and words in p for p in found), found


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("angle", [-730.0, -45.0, 10.0, 44.9, 45.1, 90.0, 135.0, 300.0])
def test_rotation_is_right_handed(axis: str, angle: float) -> None:
    expected = Rotation.from_euler(axis, angle, degrees=True).as_matrix()
    np.testing.assert_allclose(rotation(3, angle, axis), expected, atol=1e-14)
    if axis == "z":
        np.testing.assert_allclose(rotation(2, angle), expected[:2, :2], atol=1e-14)


@pytest.mark.parametrize("quarter", range(-5, 6))
def test_quarter_turns_are_exact(quarter: int) -> None:
    matrix = np.array(rotation(2, 90.0 * quarter))
    np.testing.assert_array_equal(matrix, np.linalg.matrix_power([[0, -1], [1, 0]], quarter % 4))
    box = oriented((1.0, 0.5), (0.5, 0.25), 90.0 * quarter)
    across = quarter % 2 == 1
    assert box.lower == ((0.875, 0.25) if across else (0.75, 0.375))
    assert box.upper == ((1.125, 0.75) if across else (1.25, 0.625))


# Filling -----------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 90.0, -180.0, 17.0, 45.0, 123.4])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("per_cell", [1, 5, 8, 27])
def test_positions_are_those_of_the_box_turned(angle: float, axis: str, per_cell: int) -> None:
    centre, size = (0.9, 1.1, 1.0), (0.5, 0.33, 0.21)
    scene = box_scene()
    scene.add_body(
        name="log", shape=oriented(centre, size, angle, axis), material=HDPE,
        particles_per_cell=per_cell,
    )  # fmt: skip
    flat = box_scene()
    flat.add_body(
        name="log", material=HDPE, particles_per_cell=per_cell,
        shape=shapes.Box(
            lower=[c - s / 2 for c, s in zip(centre, size, strict=True)],
            upper=[c + s / 2 for c, s in zip(centre, size, strict=True)],
        ),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (body,), (straight,) = (with_arrays(lower(s))["bodies"] for s in (scene, flat))
    matrix = Rotation.from_euler(axis, angle, degrees=True).as_matrix()
    expected = np.array(centre) + (straight["position"] - np.array(centre)) @ matrix.T
    assert body["count"] == straight["count"]
    np.testing.assert_allclose(body["position"], expected, atol=1e-14)
    mass = body["particle_mass"] * body["count"]
    assert mass == pytest.approx(981.0 * math.prod(size), rel=1e-15)
    np.testing.assert_allclose(body["bounds"], [scene.bodies[0].shape.lower,
                                                scene.bodies[0].shape.upper])  # fmt: skip
    assert np.all(body["position"] > body["bounds"][0])
    assert np.all(body["position"] < body["bounds"][1])


def test_quarter_turn_of_binary_numbers_is_exact() -> None:
    grid = lattices.turned_lattice(turned((1.0, 0.5), (0.5, 0.25), 90.0), 0.125, 4)
    points = lattices.points(grid, [], 0.125)
    found = points.rows(0, points.count)
    x, y = np.arange(0.90625, 1.125, 0.0625), np.arange(0.28125, 0.75, 0.0625)
    expected = np.array([(a, b) for b in y for a in x[::-1]])
    np.testing.assert_array_equal(found, expected)


def test_lattice_counts_along_own_axes() -> None:
    scene = box_scene(2)
    scene.add_body(
        name="log", shape=oriented((1, 1), (0.8, 0.2), 40), material=HDPE, lattice=(3, 2)
    )
    (body,) = with_arrays(lower(scene))["bodies"]
    c, s = math.cos(math.radians(40)), math.sin(math.radians(40))
    own = (body["position"] - 1.0) @ np.array([[c, -s], [s, c]])
    expected = [(a, b) for a in (-0.8 / 3, 0, 0.8 / 3) for b in (-0.05, 0.05)]
    np.testing.assert_allclose(own, expected, atol=1e-15)
    assert body["particle_mass"] == pytest.approx(981 * 0.16 / 6, rel=1e-15)


def test_origin_and_pieces() -> None:
    near, far = box_scene(), box_scene(origin=(1e6, -3e5, 7.0))
    for scene in (near, far):
        scene.add_body(name="log", shape=oriented((1, 1, 1), (0.6, 0.3, 0.2), 33), material=HDPE)
    one, two = (lower(s)["bodies"][0] for s in (near, far))
    whole = one["position"](0, one["count"])
    np.testing.assert_array_equal(whole, two["position"](0, two["count"]))
    pieces = [one["position"](a, b) for a, b in pairwise([*range(0, one["count"], 7), len(whole)])]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_hydrostatic_and_velocity_field(tank: Make) -> None:
    scene = tank()
    scene.add_body(
        name="pool", shape=oriented((0.5, 0.5), (0.4, 0.3), 30), material=WATER, hydrostatic=0.9,
        velocity=libmpm.Field(components=("y", "0 - x")),
    )  # fmt: skip
    (body,) = with_arrays(lower(scene))["bodies"]
    x, y = body["position"].T
    np.testing.assert_allclose(body["pressure"], 1000 * 9.81 * (0.9 - y))
    np.testing.assert_allclose(body["velocity"], np.column_stack([y, -x]))


# Subtraction -------------------------------------------------------------------------------


def test_debris_takes_its_water_away() -> None:
    scene = box_scene(gravity=(0, 0, -9.81))
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0, 0), upper=(2, 2, 1)), material=WATER)
    boxes = [oriented((0.7, 0.8, 0.95), (0.8, 0.4, 0.3), 27.0, "z"),
             oriented((1.4, 1.2, 0.6), (0.5, 0.4, 0.3), -50.0, "x")]  # fmt: skip
    for i, shape in enumerate(boxes):
        scene.add_body(name=f"log {i}", shape=shape, material=HDPE, subtract_from=("water",))
    spec = with_arrays(lower(scene))["bodies"]
    alone = box_scene()
    alone.add_body(name="water", shape=shapes.Box(lower=(0, 0, 0), upper=(2, 2, 1)), material=WATER)
    full = with_arrays(lower(alone))["bodies"][0]
    taken = np.any([inside(full["position"], b.turned_box()) for b in boxes], axis=0)
    np.testing.assert_array_equal(spec[0]["position"], full["position"][~taken])
    assert spec[0]["particle_mass"] == full["particle_mass"]
    # The part of the first log below the surface, and all of the second one.
    volume = 0.8 * 0.4 * 0.2 + 0.5 * 0.4 * 0.3
    assert taken.sum() * CELL**3 / 8 == pytest.approx(volume, rel=0.03)
    assert scene.plan(device="cpu").particles == sum(b["count"] for b in spec)


@pytest.mark.parametrize("both", [False, True])
def test_a_straight_box_out_of_a_turned_one(both: bool) -> None:
    scene = box_scene(2)
    log = oriented((1, 1), (1.2, 0.5), 30)
    scene.add_body(name="log", shape=log, material=HDPE)
    cut = oriented((1, 1), (0.4, 0.3), 75) if both else shapes.Box(lower=(0.8, 0.9), upper=(1.3, 2))
    scene.add_body(name="cut", shape=cut, material=HDPE, subtract_from=("log",))
    spec = with_arrays(lower(scene))["bodies"]
    grid = lattices.turned_lattice(log.turned_box(), CELL, 4)
    points = lattices.points(grid, [], CELL)
    full = points.rows(0, points.count)
    taken = inside(full, cut.turned_box())
    assert 0 < taken.sum() < len(full)
    np.testing.assert_array_equal(spec[0]["position"], full[~taken])


@pytest.mark.parametrize("angle", [-90.0, 90.0, 180.0])
def test_quarter_turned_holes_are_straight_holes(angle: float) -> None:
    grid = lattices.lattice((0.0, 0.0), (1.0, 1.0), CELL, 4)
    size = (0.3, 0.5) if angle == 180.0 else (0.5, 0.3)
    hole = turned((0.45, 0.55), size, angle)
    one, two = (lattices.points(grid, [h], CELL) for h in (hole, ((0.3, 0.3), (0.6, 0.8))))
    np.testing.assert_array_equal(one.rows(0, one.count), two.rows(0, two.count))
    assert one.count == 400 - 6 * 10


def test_equal_angles_cut_along_the_lattice() -> None:
    """A box out of a larger one at the same angle: as if neither were turned."""
    axes = (turned((0.3, -2.0), (1.0, 0.6), 31.7), turned((0.3, -2.0), (0.5, 0.2), 31.7))
    points = lattices.points(lattices.turned_lattice(axes[0], CELL, 4), [axes[1]], CELL)
    assert points.count == 20 * 12 - 10 * 4


lengths = st.floats(0.12, 1.4)
places = st.floats(-0.2, 1.2)
angles = st.floats(-200.0, 200.0)


@st.composite
def scenes_of_holes(draw: st.DrawFn) -> tuple[lattices.Lattice, list[Any]]:
    d = draw(st.sampled_from([2, 3]))

    def box() -> TurnedBox:
        axis = draw(st.sampled_from("xyz")) if d == 3 else None
        at, size = (tuple(draw(x) for _ in range(d)) for x in (places, lengths))
        return turned(at, size, draw(angles), axis)

    if draw(st.booleans()):
        grid = lattices.lattice((0.0,) * d, (1.0, 0.8, 0.6)[:d], CELL, 2**d)
    else:
        grid = lattices.turned_lattice(box(), CELL, 2**d)
    holes: list[Any] = [box() for _ in range(draw(st.integers(1, 3)))]
    if draw(st.booleans()):
        holes.append(((0.2, 0.1, 0.0)[:d], (0.5, 0.4, 0.3)[:d]))
    return grid, holes


@settings(max_examples=250, deadline=None)
@given(scenes_of_holes(), st.randoms(use_true_random=False))
def test_holes_against_the_plain_test(case: tuple[lattices.Lattice, list[Any]], rng: Any) -> None:
    grid, holes = case
    everything = lattices.points(grid, [], CELL)
    full = everything.rows(0, everything.count)
    boxes = [b if isinstance(b, TurnedBox) else TurnedBox.straight(*b) for b in holes]
    assume(not any(doubtful(full, b) for b in boxes))
    taken = np.any([inside(full, b) for b in boxes], axis=0)
    points = lattices.points(grid, holes, CELL)
    whole = points.rows(0, points.count)
    np.testing.assert_array_equal(whole, full[~taken])
    for _ in range(5):
        first, last = sorted(rng.randint(0, points.count) for _ in range(2))
        np.testing.assert_array_equal(points.rows(first, last), whole[first:last])
    with pytest.raises(IndexError, match=f"of {points.count} points"):
        points.rows(0, points.count + 1)


def test_rows_beside_a_hole_that_is_larger_than_they_are() -> None:
    """A hole of whole sections is one interval; a few rows on both sides of it stay a few."""
    grid = lattices.lattice((0.0, 0.0, 0.0), (40.0, 10.0, 10.0), CELL, 8)
    hole = turned((20.0, 5.0, 5.0), (30.0, 20.0, 20.0), 1.0, "x")
    points = lattices.points(grid, [hole], CELL)
    assert points.count == grid.count // 4
    tracemalloc.start()
    found = points.rows(points.count // 2 - 2, points.count // 2 + 2)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_allclose(found[:, 0], [4.975, 4.975, 35.025, 35.025])
    assert peak < 100_000


def test_two_billion_points_with_turned_holes() -> None:
    """Counting looks at the lines that a hole cuts, not at the points."""
    grid = lattices.lattice((0.0,) * 3, (63.0,) * 3, CELL, 8)
    hole = turned((30.0, 20.0, 62.9), (5.0, 1.0, 0.6), 30.0)
    points = lattices.points(grid, [hole], CELL)
    # 5 m × 1 m × 0.4 m below the surface, and eight points in a cube of 0.1 m.
    taken = grid.count - points.count
    assert taken == pytest.approx(5 * 1 * 0.4 * 8000, rel=0.01)
    np.testing.assert_allclose(points.rows(points.count - 1, points.count), [[62.975] * 3])
    found = points.rows(points.count // 2 - 5, points.count // 2 + 5)
    assert len(np.unique(found, axis=0)) == 10


# Overlaps ----------------------------------------------------------------------------------


flat_boxes = st.builds(turned, st.tuples(places, places), st.tuples(lengths, lengths), angles)
solid_boxes = st.builds(
    turned, st.tuples(*[places] * 3), st.tuples(*[lengths] * 3), angles, st.sampled_from("xyz")
)


@settings(max_examples=200, deadline=None)
@given(flat_boxes, flat_boxes)
def test_plane_overlaps_against_shapely(first: TurnedBox, second: TurnedBox) -> None:
    deep = depth(first, second)
    assert deep == pytest.approx(depth(second, first), abs=1e-12)
    polygons = [Polygon([box.corners()[i] for i in (0, 1, 3, 2)]) for box in (first, second)]
    if abs(deep) > 1e-9:
        assert polygons[0].intersects(polygons[1]) == (deep > 0)
    # Moved apart by its depth along the right direction, they touch; none does it with less.
    if deep > 1e-3:
        ways = [box.own(k) for box in (first, second) for k in (0, 1)]
        apart = [depth(first, second.moved([s * (deep + 1e-9) * w for w in way]))
                 for way in ways for s in (1, -1)]  # fmt: skip
        less = [depth(first, second.moved([s * (deep - 1e-6) * w for w in way]))
                for way in ways for s in (1, -1)]  # fmt: skip
        assert min(apart) <= 0 < min(less)


@settings(max_examples=60, deadline=None)
@given(solid_boxes, solid_boxes)
def test_overlaps_in_space_against_a_linear_programme(first: TurnedBox, second: TurnedBox) -> None:
    """Two boxes share a point if and only if their twelve inequalities have a solution."""
    from scipy.optimize import linprog

    deep = depth(first, second)
    assume(abs(deep) > 1e-6)
    rows, limits = [], []
    for box in (first, second):
        for k, sign in itertools.product(range(3), (1, -1)):
            normal = sign * np.array(box.own(k))
            rows.append(normal)
            limits.append(normal @ np.array(box.centre) + 0.5 * box.size[k])
    found = linprog(np.zeros(3), A_ub=rows, b_ub=limits, bounds=(None, None))
    assert (found.status == 0) == (deep > 0)


def test_edges_alone_can_separate() -> None:
    """Two bars crossed like a roof: no face between them, but the direction across two edges."""
    first = turned((0, 0, 0), (4, 1, 1), 45, "x")
    # Turned about x by 45°, then lying along y with its own edge down.
    matrix = Rotation.from_euler("z", 90, degrees=True) * Rotation.from_euler("x", 45, degrees=True)
    axes = tuple(tuple(row) for row in matrix.as_matrix().tolist())
    for height, apart in ((math.sqrt(2) + 0.01, True), (math.sqrt(2) - 0.01, False)):
        second = TurnedBox((0.0, 0.0, height), (4.0, 1.0, 1.0), axes)
        assert (depth(first, second) < 0) == apart
        for one, two in ((first, second), (second, first)):
            shadow = [np.dot(np.array(c) - one.centre, turn(one)) for c in two.corners()]
            nearest = np.min(np.abs(shadow), axis=0) - 0.5 * np.array(one.size)
            assert np.all(nearest < 0)  # no face stands between them


def test_bodies_that_overlap_are_refused() -> None:
    scene = box_scene(2)
    scene.add_body(name="a", shape=oriented((0.8, 1.0), (0.8, 0.3), 45), material=HDPE)
    scene.add_body(name="b", shape=oriented((1.15, 1.0), (0.8, 0.3), 45), material=HDPE)
    found = refused(scene.validate)
    # √½ × 0.35 m between the middles, 0.3 m wide.
    assert found == [
        "body 'a': with body 'b': the bodies overlap by 0.0525 m; expected apart, or an order: "
        "subtract_from=('a',) on 'b' keeps 'b' whole"
    ]
    fine = box_scene(2)
    fine.add_body(name="a", shape=oriented((0.8, 1.0), (0.8, 0.3), 45), material=HDPE)
    fine.add_body(name="b", shape=oriented((1.3, 1.0), (0.8, 0.3), 45), material=HDPE)
    # The straight boxes around them do overlap.
    assert fine.bodies[0].shape.upper[0] > fine.bodies[1].shape.lower[0]
    fine.validate(strict=True)


# The scene's checks ------------------------------------------------------------------------


def test_corners_must_lie_in_the_domain() -> None:
    scene = box_scene(2)
    scene.add_body(name="log", shape=oriented((0.3, 1), (0.8, 0.2), 0), material=HDPE)
    assert "spans -0.1 to 0.7 m on axis 0; expected inside" in refused(scene.validate)[0]
    standing = box_scene(2)
    standing.add_body(name="log", shape=oriented((0.3, 1), (0.8, 0.2), 60), material=HDPE)
    standing.validate(strict=True)


def test_thin_on_its_own_axis() -> None:
    scene = box_scene(2)
    scene.add_body(name="log", shape=oriented((1, 1), (0.8, 0.15), 30), material=HDPE)
    with pytest.warns(libmpm.ModelWarning, match="0.15 m thick on its own axis 1, that is 1.5"):
        scene.validate()


def test_bodies_inside_boundaries_are_refused() -> None:
    scene = box_scene(2)
    scene.add_body(name="log", shape=oriented((0.8, 1), (0.8, 0.2), 45), material=HDPE)
    pier = shapes.Box(lower=(1.0, 0.5), upper=(1.5, 1.5))
    scene.add_boundary(name="pier", shape=pier, response=boundaries.Slip())
    found = refused(scene.validate)
    assert "body 'log': reaches" in found[0] and "into boundary 'pier', which blocks" in found[0]
    beside = box_scene(2)
    # In the corner of the straight box around the log, which the log itself leaves free.
    beside.add_body(name="log", shape=oriented((0.8, 1), (0.8, 0.2), 45), material=HDPE)
    low = shapes.Box(lower=(0.9, 0.5), upper=(1.5, 0.9))
    beside.add_boundary(name="pier", shape=low, response=boundaries.Slip())
    beside.validate(strict=True)


def test_a_turned_boundary_is_a_surface() -> None:
    scene = box_scene()
    ramp = oriented((1, 1, 1), (1, 1, 1), 10)
    scene.add_boundary(name="ramp", shape=ramp, response=boundaries.Slip())
    assert scene.boundaries[-1].is_surface


def test_other_dimensions_and_grids_of_functions_are_refused() -> None:
    scene = box_scene(3)
    scene.add_body(name="log", shape=oriented((1, 1), (0.8, 0.2), 45), material=HDPE)
    assert "shape has 2 numbers; expected 3" in refused(scene.validate)[0]
    mesh = grids.Mesh.blocks(columns=4, rows=4, lower=(0, 0), upper=(2, 2))
    flat = Scene(grid=grids.TriangularGrid(mesh=mesh))
    flat.add_body(name="log", shape=oriented((1, 1), (0.8, 0.2), 45), material=HDPE)
    found = refused(flat.validate)
    assert found == [
        "body 'log': shapes.OrientedBox is not built for grids of functions; expected a "
        "shapes.Box, or shapes.Cells or Points on triangles"
    ]


# Motion ------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_a_turned_body_moves_like_a_rigid_one(angle: float) -> None:
    """Mass, momentum and moment of inertia are those of the rectangle, at any angle."""
    length, width, spin, launch = 0.8, 0.2, 0.5, (0.3, -0.2)
    scene = Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(2, 2))
    x, y = f"(x - {1.0})", f"(y - {1.0})"
    scene.add_body(
        name="log",
        shape=oriented((1, 1), (length, width), angle),
        material=materials.FixedCorotated(density=500.0, youngs_modulus=1e6),
        velocity=libmpm.Field(
            components=(f"{launch[0]} - {spin} * {y}", f"{launch[1]} + {spin} * {x}")
        ),
    )
    sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
    mass = 500.0 * length * width
    # A lattice of n points has 1 - 1/n² of the second moment of its length.
    n, m = 32, 8
    inertia = mass / 12 * (length**2 * (1 - 1 / n**2) + width**2 * (1 - 1 / m**2))
    # An affine deposit turns about its own particle too: m Δx²/4 (C_yx - C_xy), quadratic splines.
    inertia += mass * scene.cell_size**2 / 2

    def angular() -> float:
        momentum = sim.grid["mass"][:, None] * sim.grid["velocity"]
        arm = sim.grid["position"] - sim.particles["log"]["position"].mean(axis=0)
        return float(np.sum(arm[:, 0] * momentum[:, 1] - arm[:, 1] * momentum[:, 0]))

    assert sim.particle_count(0) == n * m
    assert angular() == pytest.approx(inertia * spin, rel=1e-10)
    sim.step(50)
    assert angular() == pytest.approx(inertia * spin, rel=1e-10)
    total = np.sum(sim.grid["mass"][:, None] * sim.grid["velocity"], axis=0)
    np.testing.assert_allclose(total, mass * np.array(launch), rtol=1e-10)
    middle = sim.particles["log"]["position"].mean(axis=0)
    np.testing.assert_allclose(middle, 1.0 + sim.time * np.array(launch), rtol=1e-10)
    # The long axis has turned by ω t.
    own = sim.particles["log"]["position"] - middle
    direction = np.linalg.eigh(own.T @ own)[1][:, -1]
    turned_by = np.degrees(np.arctan2(direction[1], direction[0])) % 180
    expected = (angle + np.degrees(spin * sim.time)) % 180
    assert turned_by == pytest.approx(expected, abs=0.02)
