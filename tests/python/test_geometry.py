"""Solids: signed distances against brute force, volumes, bounds, and how they are written."""

from __future__ import annotations

import json
import math
import pickle
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from shapely import LineString, Point, Polygon

import libmpm
from libmpm import shapes
from libmpm._src.base.values import from_plain
from libmpm._src.shapes.volume import counted_volume

Array = npt.NDArray[np.float64]

PROFILE = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 0.4), (0.2, 1.2)]
HEIGHTS = np.random.default_rng(7).random((5, 4)).tolist()
BED_X, BED_Y = [0.0, 0.7, 1.0, 2.0, 2.5], [0.0, 0.5, 1.5, 2.0]
BALL = shapes.Sphere(centre=(0.3, -0.2, 1.0), radius=0.7)
BOX = shapes.Box(lower=(-0.4, -0.5, 0.2), upper=(0.6, 1.5, 1.4))
WEDGE = shapes.Wedge(lower=(0, 0), upper=(1, 2))

EXACT: dict[str, shapes.Solid] = {
    "box": BOX,
    "box in 2D": shapes.Box(lower=(0, 0), upper=(1, 2)),
    "turned box": shapes.OrientedBox(centre=(0, 0, 0), size=(1, 2, 0.5), angle=30, axis="x"),
    "sphere": BALL,
    "disc": shapes.Sphere(centre=(0, 1), radius=0.7),
    "cylinder": shapes.Cylinder(start=(0, 0, 0), end=(1, 1, 1), radius=0.4),
    "cone": shapes.Cone(start=(0, 0, 0), end=(1, 0.2, 1), radius=0.4),
    "truncated cone": shapes.Cone(start=(0, 0, 0), end=(1, 0, 1), radius=0.4, end_radius=0.9),
    "wedge": shapes.Wedge(lower=(0, 0, 0), upper=(1, 2, 3), high="y-"),
    "hanging wedge": shapes.Wedge(lower=(0, 0), upper=(1, 2), high="x-", up="y-"),
    "profile": shapes.Extrusion(profile=PROFILE),
    "extrusion": shapes.Extrusion(profile=PROFILE[::-1], axis="y", lower=-1, upper=1),
    "bed in 2D": shapes.HeightField(x=[0, 1, 2, 3], z=[0, 0.5, -0.2, 0.3], base=-1),
    "bed in 3D": shapes.HeightField(x=BED_X, y=BED_Y, z=HEIGHTS, base=-1),
    "moved": BALL.moved((1, 2, 3)),
    "turned": shapes.Cone(start=(0, 0, 0), end=(1, 0, 1), radius=0.4).turned(
        25, "y", about=(1, 0, 0)
    ),
    "repeated": WEDGE.repeated((3, 2), (1.5, 2.5)),
}
BOUNDED: dict[str, shapes.Solid] = EXACT | {
    "union": BALL | BOX,
    "intersection": BALL & BOX,
    "difference": BALL - BOX,
    "two apart": BALL | BALL.moved((5, 0, 0)),
}


def around(solid: shapes.Solid, n: int, margin: float = 0.5) -> Array:
    low, high = (np.array(end) for end in solid.bounds())
    rng = np.random.default_rng(3)
    return low - margin + (high - low + 2 * margin) * rng.random((n, solid.dimension))


def slope(solid: shapes.Solid, p: Array, step: float = 1e-6) -> Array:
    """The gradient of the distance by central differences."""
    moves = step * np.eye(solid.dimension)
    columns = [(solid.distance(p + m) - solid.distance(p - m)) / (2 * step) for m in moves]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", EXACT)
def test_distances_grow_by_one_a_metre(name: str) -> None:
    # But on the few points within a step of where the nearest place of the surface changes.
    size = np.linalg.norm(slope(EXACT[name], around(EXACT[name], 3000)), axis=1)
    assert np.mean(np.abs(size - 1.0) < 1e-6) > 0.999


@pytest.mark.parametrize("name", EXACT)
def test_a_step_down_the_distance_ends_on_the_surface(name: str) -> None:
    solid = EXACT[name]
    p = around(solid, 2000)
    far = solid.distance(p)
    foot = p - far[:, None] * slope(solid, p)
    assert np.mean(np.abs(solid.distance(foot)) < 1e-5) > 0.998


@pytest.mark.parametrize("name", BOUNDED)
def test_magnitudes_bound_the_way_to_the_surface(name: str) -> None:
    """Within its magnitude of a point no sign changes: distances change by no more than a way."""
    solid = BOUNDED[name]
    one, two = around(solid, 4000), around(solid, 4000)[::-1]
    two = one + 0.1 * (two - one)
    change = np.abs(solid.distance(one) - solid.distance(two))
    crossed = np.sign(solid.distance(one)) != np.sign(solid.distance(two))
    way = np.linalg.norm(two - one, axis=1)
    assert np.any(crossed)
    assert np.all(change[crossed] <= way[crossed] * (1 + 1e-9) + 1e-12)


@pytest.mark.parametrize("name", BOUNDED)
def test_volumes_are_what_is_counted(name: str) -> None:
    """A plain count of points in the bounds, to four standard deviations."""
    solid = BOUNDED[name]
    low, high = (np.array(end) for end in solid.bounds())
    n = 100_000
    inside = solid.distance(low + (high - low) * np.random.default_rng(5).random((n, len(low)))) < 0
    room, share = float(np.prod(high - low)), float(np.mean(inside))
    counted = room * share
    spread = room * math.sqrt(max(share * (1 - share), 1e-12) / n)
    found = solid.volume()
    if found is not None:
        assert found == pytest.approx(counted, abs=4 * spread + 1e-9 * room)
        assert counted_volume(solid) == pytest.approx(found, rel=5e-4)
    assert counted_volume(solid) == pytest.approx(counted, abs=4 * spread + 1e-9 * room)


@pytest.mark.parametrize("name", BOUNDED)
def test_nothing_lies_outside_the_bounds(name: str) -> None:
    solid = BOUNDED[name]
    low, high = (np.array(end) for end in solid.bounds())
    p = around(solid, 20_000, 1.0)
    outside = np.any((p < low - 1e-9) | (p > high + 1e-9), axis=1)
    assert np.all(solid.distance(p[outside]) > 0)


@pytest.mark.parametrize("name", [n for n in EXACT if n != "turned"])
def test_bounds_of_primitives_are_tight(name: str) -> None:
    solid = EXACT[name]
    low, high = (np.array(end) for end in solid.bounds())
    for a in range(len(low)):
        for end, inward in ((low, 1.0), (high, -1.0)):
            p = low + (high - low) * np.random.default_rng(a).random((4000, len(low)))
            p[:, a] = end[a]
            # The nearest place of the surface to some point of the face lies on the face.
            p[:, a] += inward * 1e-4
            assert np.min(solid.distance(p)) < 0.03


@pytest.mark.parametrize("name", BOUNDED)
def test_solids_survive_files_and_pickles(name: str) -> None:
    solid = BOUNDED[name]
    again = from_plain(json.loads(json.dumps(solid.to_dict())))
    assert again == solid
    assert hash(again) == hash(solid)
    assert pickle.loads(pickle.dumps(solid)) == solid
    assert eval(repr(solid), {"shapes": shapes}) == solid


@pytest.mark.parametrize("name", BOUNDED)
def test_bits_do_not_depend_on_the_company(name: str) -> None:
    solid = BOUNDED[name]
    p = around(solid, 10_000)
    whole = solid.distance(p)
    assert np.array_equal(solid.distance(p[137:2611]), whole[137:2611])
    assert np.array_equal(solid.distance(p[5000:5001]), whole[5000:5001])


def test_a_polygon_is_shapelys() -> None:
    solid, polygon = shapes.Extrusion(profile=PROFILE), Polygon(PROFILE)
    p = around(solid, 2000)
    points = [Point(x) for x in p]
    expected = [polygon.exterior.distance(q) * (-1 if polygon.contains(q) else 1) for q in points]
    assert solid.distance(p) == pytest.approx(np.array(expected), abs=1e-12)


def test_a_long_bed_is_shapelys() -> None:
    """Pieces of neighbours along the bed, and the level ends beyond it."""
    rng = np.random.default_rng(0)
    x = np.cumsum(0.01 + 0.1 * rng.random(300))
    z = rng.random(300)
    bed = shapes.HeightField(x=x, z=z)
    line = LineString([(-100.0, z[0]), *zip(x, z, strict=True), (200.0, z[-1])])
    p = np.stack([rng.uniform(-2, x[-1] + 2, 9000), rng.normal(0.5, 1.0, 9000)], axis=1)
    expected = line.distance([Point(q) for q in p])
    found = bed.distance(p)
    assert np.abs(found) == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(found < 0, p[:, 1] < np.interp(p[:, 0], x, z))
    assert bed.bounds() == ((-math.inf,) * 2, (math.inf, z.max()))


def test_a_raster_of_a_plane_is_a_half_space() -> None:
    x, y = np.linspace(0, 10, 40), np.linspace(0, 5, 21)
    z = 0.3 * x[:, None] - 0.2 * y[None, :] + 0.1
    bed = shapes.HeightField(x=x, y=y, z=z)
    plane = shapes.HalfSpace(point=(0, 0, 0.1), normal=(-0.3, 0.2, 1.0))
    p = np.random.default_rng(1).uniform((2, 1, -1), (8, 4, 4), (5000, 3))
    assert bed.distance(p) == pytest.approx(plane.distance(p), abs=1e-12)


def test_a_smooth_raster_is_the_ball_through_its_points() -> None:
    """A cap of a ball of 10 m, below which chords of a cell lie, by their sagitta."""
    radius, cell = 10.0, 0.025
    axis = np.arange(-150, 151) * cell
    z = np.sqrt(radius**2 - axis[:, None] ** 2 - axis[None, :] ** 2)
    bed = shapes.HeightField(x=axis, y=axis, z=z)
    rng = np.random.default_rng(2)
    direction = np.concatenate([rng.uniform(-0.2, 0.2, (500, 2)), np.ones((500, 1))], axis=1)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    steepest = 2 * 0.2**2  # tan² of the widest direction
    sagitta = 2 * cell**2 / (8 * radius) * (1 + steepest) ** 1.5
    for away in (-0.4, -0.05, 0.05, 0.4, 2.0):
        found = bed.distance(direction * (radius + away))
        assert np.all(found - away >= -1e-12)
        assert np.all(found - away <= sagitta)


def test_rasters_from_esri_files(tmp_path: Any) -> None:
    path = tmp_path / "bed.asc"
    head = "ncols 3\nnrows 2\nxllcorner 100\nyllcorner 200\ncellsize 10\nNODATA_value -9999\n"
    path.write_text(head + "1 2 3\n4 5 6\n")
    bed = shapes.HeightField.from_esri(path, origin=(100, 200))
    assert bed.x == (5.0, 15.0, 25.0)
    assert bed.y == (5.0, 15.0)
    # The first row of the file is the north one.
    assert bed.z == ((4.0, 1.0), (5.0, 2.0), (6.0, 3.0))
    assert bed.height([(15, 10), (0, 0), (20, 15)]) == pytest.approx([3.5, 4.0, 2.5])
    path.write_text(head.replace("corner", "center") + "1 2 -9999\n4 5 6\n")
    assert shapes.HeightField.from_esri(path, fill=0.0).x == (100.0, 110.0, 120.0)
    with pytest.raises(libmpm.SceneError, match="1 of 6 heights have no data"):
        shapes.HeightField.from_esri(path)
    path.write_text(head + "1 2 3\n4 5\n")
    with pytest.raises(libmpm.SceneError, match=r"expected 2 rows of 3|cannot be read"):
        shapes.HeightField.from_esri(path)


def test_boxes_that_are_moved_and_turned_stay_boxes() -> None:
    box = shapes.Box(lower=(0, 0), upper=(2, 1))
    assert box.moved((1, 2)) == shapes.Box(lower=(1, 2), upper=(3, 3))
    assert box.turned(30) == shapes.OrientedBox(centre=(1, 0.5), size=(2, 1), angle=30)
    about = box.turned(90, about=(0, 0))
    assert isinstance(about, shapes.OrientedBox)
    assert about.bounds() == ((-1, 0), (0, 2))
    again = about.turned(-90, about=(0, 0))
    p = around(box, 100)
    assert again.distance(p) == pytest.approx(box.distance(p), abs=1e-15)
    slab = shapes.Box(lower=(0, 0, 0), upper=(1, 2, 3)).turned(20, "x").turned(30, "z")
    assert isinstance(slab, shapes.Turned)
    assert slab.volume() == pytest.approx(6.0)


def test_turning_follows_the_right_hand() -> None:
    spot = shapes.Sphere(centre=(1, 0, 0), radius=0.1)
    for axis, place in (("z", (0, 1, 0)), ("y", (0, 0, -1)), ("x", (1, 0, 0))):
        turned = spot.turned(90, axis, about=(0, 0, 0))
        assert turned.distance([place])[0] == pytest.approx(-0.1)


def test_unions_flatten_and_compare() -> None:
    a, b, c = (shapes.Sphere(centre=(x, 0), radius=1.0) for x in (0, 1, 2))
    assert (a | b) | c == shapes.Union(parts=(a, b, c)) == a | (b | c)
    with pytest.raises(TypeError):
        a | 3  # type: ignore[operator]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: shapes.Sphere(centre=(0, 0), radius=-1), "radius is -1; expected > 0 m"),
        (
            lambda: shapes.Cylinder(start=(0, 0), end=(1, 1), radius=1),
            "in 2D; expected 3 numbers in m; in 2D use a Sphere",
        ),
        (lambda: shapes.Cone(start=(0, 0, 0), end=(0, 0, 0), radius=1), "expected apart"),
        (lambda: shapes.HalfSpace(point=(0, 0), normal=(0, 0)), "normal is zero"),
        (lambda: shapes.HalfSpace(point=(0, 0), normal=(0, 0, 1)), "in both"),
        (lambda: shapes.Wedge(lower=(0, 0), upper=(1, 1), high="y+"), "two different axes"),
        (lambda: shapes.Wedge(lower=(0, 0), upper=(1, 1), high="z+"), "did you mean"),
        (
            lambda: shapes.Extrusion(profile=[(0, 0), (1, 1), (1, 0), (0, 1)]),
            "cross or touch; expected a polygon that does not cross itself",
        ),
        (lambda: shapes.Extrusion(profile=PROFILE, axis="y"), "axis without lower and upper"),
        (lambda: shapes.Extrusion(profile=[(0, 0), (1, 1)]), "three or more corners"),
        (lambda: shapes.HeightField(x=[0, 0], z=[1, 2]), "expected rising numbers"),
        (lambda: shapes.HeightField(x=[0, 1], z=[1, 2, 3]), r"expected \(2,\)"),
        (lambda: shapes.HeightField(x=[0, 1], z=[1, math.nan]), "1 heights that are no finite"),
        (lambda: shapes.HeightField(x=[0, 1], z=[1, 2], base=1.5), "expected below it"),
        (lambda: BALL | WEDGE, r"parts\[1\] is 2D with parts\[0\] 3D"),
        (lambda: BALL - WEDGE, "without is 2D with whole 3D"),
        (lambda: BALL.moved((1, 2)), "by has 2 numbers for a solid in 3D"),
        (lambda: BOX.moved((1, 2)), "expected 3 numbers in m"),
        (lambda: WEDGE.turned(30, "z"), "axis is 'z' in 2D"),
        (
            lambda: shapes.HalfSpace(point=(0, 0), normal=(0, 1)).turned(30),
            "which has no end and so no middle; give about",
        ),
        (lambda: BALL.repeated((2, 0, 1), (1, 1, 1)), r"counts\[1\] is 0"),
        (lambda: BALL.repeated((2, 1, 1), (1, 1, 0)), r"spacing\[2\] is 0; expected > 0 m"),
        (lambda: BALL.distance([(0, 0)]), r"expected \(n, 3\)"),
    ],
)
def test_wrong_shapes_say_what_is_expected(make: Any, words: str) -> None:
    with pytest.raises(libmpm.SceneError, match=words):
        make()


def test_copies_that_touch_no_other_have_a_volume() -> None:
    disc = shapes.Sphere(centre=(0, 0), radius=0.5)
    assert disc.repeated((3, 2), (1.0, 1.5)).volume() == pytest.approx(6 * math.pi / 4)
    overlapping = disc.repeated((3, 2), (0.8, 1.5))
    assert overlapping.volume() is None
    # Two circles at 0.8 of their diameter share 2 r² acos(0.8) - 0.4 √(1 - 0.64) in m².
    lens = 0.5 * math.acos(0.8) - 0.4 * math.sqrt(1 - 0.64)
    assert counted_volume(overlapping) == pytest.approx(6 * math.pi / 4 - 4 * lens, rel=1e-5)
