"""Bodies filled by columns: evenly between surfaces, exact mass, pieces of one whole."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from libmpm import Scene, SceneError, TimeTable, materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm._src.shapes import filling
from support.scenes import with_arrays

WATER = materials.TaitFluid(density=1000.0, bulk_modulus=1e6)
CELL = 0.05
STEP = CELL / 2
COLUMNS = shapes.Columns()
BED = shapes.HeightField(x=[0, 0.4, 1], z=[0.2, 0.5, 0.1])
ROOM = shapes.Box(lower=(0, 0), upper=(1, 1))
BALL = shapes.Sphere(centre=(0.5, 0.5, 0.5), radius=0.3)


def room(dimension: int = 2, **changes: Any) -> Scene:
    arguments: dict[str, Any] = {
        "dimension": dimension,
        "cell_size": CELL,
        "lower": (0.0,) * dimension,
        "upper": (1.0,) * dimension,
        "gravity": (0.0,) * (dimension - 1) + (-9.81,),
    }
    return Scene(**(arguments | changes))


def filled(shape: shapes.Solid, how: Any = COLUMNS, **changes: Any) -> dict[str, Any]:
    scene = room(shape.dimension, **changes)
    scene.add_body(name="body", shape=shape, material=WATER, sampling=how)
    return with_arrays(lower(scene))["bodies"][0]


def by_line(position: np.ndarray, axis: int = 1) -> dict[float, np.ndarray]:
    """Return heights in order by place of the line, of a figure in the plane."""
    across = position[:, 1 - axis]
    return {x: np.sort(position[across == x, axis]) for x in np.unique(across)}


def in_order(position: np.ndarray) -> np.ndarray:
    return position[np.lexsort(position.T.round(6))]


def test_columns_reach_evenly_from_bed_to_level() -> None:
    found = filled(shapes.basin(level=0.7, bed=BED, within=ROOM))
    lines = by_line(found["position"])
    assert list(lines) == pytest.approx((np.arange(40) + 0.5) * STEP)
    for x, heights in lines.items():
        bed = float(np.interp(x, BED.x, BED.z))
        n = round((0.7 - bed) / STEP)
        expected = bed + (0.7 - bed) * (np.arange(n) + 0.5) / n
        assert heights == pytest.approx(expected, abs=1e-8)
    area = 0.7 - (0.4 * 0.35 + 0.6 * 0.3)
    assert found["particle_mass"] * found["count"] == pytest.approx(1000 * area, rel=5e-4)


def test_lines_are_cut_by_every_surface_they_cross() -> None:
    """A hole within leaves two columns on a line; ends shorter than half a spacing are empty."""
    slab = shapes.Box(lower=(0.3, 0.4), upper=(0.6, 0.5))
    thin = shapes.Box(lower=(0, 0.1), upper=(0.2, 0.1 + 0.4 * STEP))
    found = filled((shapes.Box(lower=(0.3, 0.103), upper=(0.6, 0.8)) - slab) | thin)
    lines = by_line(found["position"])
    assert min(lines) > 0.3
    for heights in lines.values():
        low, high = heights[heights < 0.4], heights[heights > 0.5]
        assert len(low) == round(0.297 / STEP)
        assert len(low) + len(high) == len(heights)
        assert np.diff(low) == pytest.approx(0.297 / len(low), abs=1e-8)
        assert high == pytest.approx(0.5 + 0.3 * (np.arange(12) + 0.5) / 12, abs=1e-8)


def test_a_box_that_fits_the_cells_is_the_lattice() -> None:
    box = shapes.Box(lower=(0.1, 0.1), upper=(0.6, 0.4))
    plain, columns = filled(box, None)["position"], filled(box)["position"]
    assert in_order(columns) == pytest.approx(in_order(plain), abs=1e-8)


@pytest.mark.parametrize("gravity", [(-9.81, 0.0), TimeTable((0.0, 1.0), ((0.0, 0.0), (5.0, 0.0)))])
def test_columns_stand_along_gravity_or_the_axis_given(gravity: Any) -> None:
    ramp = shapes.Extrusion(profile=[(0.1, 0.1), (0.9, 0.1), (0.1, 0.7)])
    for position in (
        filled(ramp, gravity=gravity)["position"],
        filled(ramp, shapes.Columns(axis="x"))["position"],
    ):
        for y, places in by_line(position, axis=0).items():
            length = 0.8 * (0.7 - y) / 0.6
            n = len(places)
            assert n == max(1, round(length / STEP))
            assert places == pytest.approx(0.1 + length * (np.arange(n) + 0.5) / n, abs=1e-8)


def test_pieces_are_of_one_whole() -> None:
    scene = room(3)
    scene.add_body(name="body", shape=BALL, material=WATER, sampling=COLUMNS)
    body = lower(scene)["bodies"][0]
    n = body["count"]
    whole = body["position"](0, n)
    volume = 4 / 3 * math.pi * 0.027
    assert body["particle_mass"] * n == pytest.approx(1000 * volume, rel=1e-12)
    assert n == pytest.approx(volume / STEP**3, rel=0.03)
    assert np.all(BALL.distance(whole) < 0)
    for first, last in ((0, 1), (n // 2, n // 2 + 777), (n - 1, n), (5, 5)):
        assert np.array_equal(body["position"](first, last), whole[first:last])
    with pytest.raises(IndexError):
        body["position"](0, n + 1)
    filling._columns.cache_clear()
    assert np.array_equal(lower(scene)["bodies"][0]["position"](0, n), whole)


def test_long_steps_find_what_short_ones_do() -> None:
    """Distances that bound the true one are stepped along; the surfaces found are the same."""

    class Unsure(shapes.Difference):
        bounding = False

    parts = {"whole": BALL, "without": shapes.Sphere(centre=(0.5, 0.4, 0.6), radius=0.1)}
    sure = filled(shapes.Difference(**parts), gravity=(0, -9.81, 0))["position"]
    wary = filled(Unsure(**parts), gravity=(0, -9.81, 0))["position"]
    assert sure == pytest.approx(wary, abs=1e-8)  # in the same order


def test_bodies_beside_columns_take_their_place() -> None:
    scene = room(3)
    box = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 0.5))
    scene.add_body(name="water", shape=box, material=WATER, sampling=COLUMNS)
    scene.add_body(name="ball", shape=BALL, material=WATER, subtract_from="water")
    water = with_arrays(lower(scene))["bodies"][0]
    assert BALL.distance(water["position"]).min() > 0
    # Just above the ball's lower half lies nothing, and its mass is gone.
    left = 0.5 - 2 / 3 * math.pi * 0.027
    assert water["particle_mass"] * water["count"] == pytest.approx(1000 * left, rel=5e-4)


def test_an_axis_that_is_not_there_is_refused() -> None:
    scene = room()
    scene.add_body(name="body", shape=ROOM, material=WATER, sampling=shapes.Columns(axis="z"))
    with pytest.raises(SceneError, match="columns along 'z' in 2D"):
        scene.validate()
    with pytest.raises(SceneError, match="axis is 'up'"):
        shapes.Columns(axis="up")


def test_columns_are_kept_in_files() -> None:
    scene = room()
    scene.add_body(name="body", shape=ROOM, material=WATER, sampling=shapes.Columns(axis="y"))
    assert Scene.from_dict(scene.to_dict()) == scene
