"""Debris fields: values, ordered arrays and random fields."""

from __future__ import annotations

import hashlib
import json
import math
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from libmpm import debris, materials
from libmpm._src.studies.debris.laws import Stream, counts_of
from libmpm._src.studies.debris.rectangles import Rectangles, gaps, obliquity
from support.debris_fields import BAR, BOXES, HDPE, WOOD, distances, polygon, polygons, refused

# Geometry ----------------------------------------------------------------------------------

numbers = st.floats(-1, 1)
edges = st.floats(0.05, 1.5)
angles = st.floats(-400, 400)
rectangles = st.tuples(numbers, numbers, angles, edges, edges)


@settings(max_examples=200, deadline=None)
@given(st.lists(rectangles, min_size=1, max_size=4), st.lists(rectangles, min_size=1, max_size=4))
def test_gaps_against_shapely(one: list[Any], two: list[Any]) -> None:
    found = gaps(*(Rectangles(*np.array(rows).T) for rows in (one, two)))
    for i, first in enumerate(one):
        for j, second in enumerate(two):
            expected = polygon(*first).distance(polygon(*second))
            assert found[i, j] == pytest.approx(expected, abs=1e-9)


def test_a_cross_overlaps_though_no_corner_is_inside() -> None:
    cross = Rectangles(*np.array([(0, 0, 0, 1, 0.1), (0, 0, 90, 1, 0.1)]).T)
    np.testing.assert_array_equal(gaps(cross, cross), np.zeros((2, 2)))


def test_obliquity_knows_that_a_rectangle_is_symmetric() -> None:
    given_angles = [0, 30, -30, 90, -90, 120, 180, 210, 345, -725, 89.5, 90.5]
    expected = [0, 30, 30, 90, 90, 60, 0, 30, 15, 5, 89.5, 89.5]
    np.testing.assert_array_equal(obliquity(given_angles), expected)


# Values ------------------------------------------------------------------------------------


def test_prototypes() -> None:
    assert BAR.plan_area == pytest.approx(0.05)
    assert BAR.mass == pytest.approx(981 * 0.5 * 0.1 * 0.05)
    found = refused(debris.Prototype, length=0, width=-1, height=1, material="HDPE")
    assert len(found) == 3
    assert "debris.Prototype: length is 0; expected > 0 m" in found
    assert debris.Prototype.from_dict(json.loads(json.dumps(BAR.to_dict()))) == BAR


def test_fields_round_trip(tmp_path: Path) -> None:
    law = debris.SpreadAngles(mean=(0, 20), spread=30)
    field = debris.random(BOXES, count=8, footprint=(1, 0.8), clearance=0.02, seed=5, angles=law)
    for one in (field, debris.ordered(BAR, rows=2, columns=3, clearance=0.1, rotation=10)):
        assert debris.DebrisField.from_dict(one.to_dict()) == one
        one.save(tmp_path / "field.json")
        assert debris.DebrisField.load(tmp_path / "field.json") == one
        assert pickle.loads(pickle.dumps(one)) == one
    assert field.placement.angles == law
    (tmp_path / "field.json").write_text("{")
    assert "not JSON" in refused(debris.DebrisField.load, tmp_path / "field.json")[0]
    assert 'expected "type": "DebrisField"' in refused(debris.DebrisField.from_dict, {})[0]


def test_pieces_of_your_own() -> None:
    pieces = [debris.Piece(x=0, y=0, angle=30), debris.Piece(x=0.3, y=0.4), debris.Piece(x=2, y=2)]
    field = debris.DebrisField(prototypes=BAR, pieces=pieces, footprint=(4, 4), corner=(-1, -1))
    assert len(field) == 3
    assert field.placement.kind == "given"
    found = refused(
        debris.DebrisField,
        prototypes=[BAR],
        footprint=(3, 3),
        pieces=[pieces[0], debris.Piece(x=0.1, y=0.02, angle=-30)],
    )
    assert found[0].startswith("debris.DebrisField: pieces 0 and 1 overlap by 0.")
    wrong = debris.Piece(prototype=1, x=0, y=0)
    found = refused(debris.DebrisField, prototypes=BAR, footprint=(3, 0), pieces=[wrong])
    assert "footprint[1] is 0; expected > 0 m" in found[0]
    assert "pieces[0].prototype is 1; expected 0 to 0" in found[1]
    # One above the other is no overlap.
    stack = [debris.Piece(x=0, y=0), debris.Piece(x=0.1, y=0, elevation=0.05)]
    debris.DebrisField(
        prototypes=BAR, pieces=stack, footprint=(1, 1), corner=(-0.5, -0.5), clearance=0.1
    )


def test_pieces_of_your_own_lie_in_the_footprint() -> None:
    frame: dict[str, Any] = {"prototypes": BAR, "footprint": (0.5, 0.3)}
    touching = [debris.Piece(x=0.25, y=0.05), debris.Piece(x=0.25, y=0.25)]
    field = debris.DebrisField(pieces=touching, clearance=0.1, **frame)
    assert field.metadata()["n"] == pytest.approx(1 - 0.1 / 0.15)
    # Its footprint goes with it.
    assert len(field.moved((3, -4)).turned(37.3).moved((1e3, 0))) == 2
    out = [debris.Piece(x=0.25, y=0.03), debris.Piece(x=0.25, y=0.25, angle=0.0)]
    found = refused(debris.DebrisField, pieces=out, **frame)
    assert found == [
        "debris.DebrisField: pieces[0] reaches 0.02 m out of the footprint; expected all of it "
        "inside, or the porosity is wrong; move it, or give another corner or a larger footprint"
    ]
    found = refused(debris.DebrisField, pieces=touching, rotation=90, **frame)
    assert [p.partition(" out of")[0] for p in found] == [
        f"debris.DebrisField: pieces[{i}] reaches 0.1 m" for i in (0, 1)
    ]
    found = refused(debris.DebrisField, pieces=touching, clearance=0.11, **frame)
    assert found == [
        "debris.DebrisField: pieces 0 and 1 are 0.1 m apart; expected ≥ 0.11 m, the clearance; "
        "move one of them, or give a smaller clearance"
    ]


def test_seeds_of_numpy_can_be_saved(tmp_path: Path) -> None:
    for seed in np.arange(2):
        for field in (
            debris.random(BAR, count=3, footprint=(2, 2), clearance=0.1, seed=seed),
            debris.ordered(BOXES, rows=2, columns=2, clearance=0.1, seed=seed, shares=(1, 1)),
        ):
            field.save(tmp_path / "field.json")
            assert debris.DebrisField.load(tmp_path / "field.json") == field
            assert type(field.placement.seed) is int
    assert type(debris.Placement(seed=np.int64(3)).seed) is int


def test_24_bars_of_the_flume_at_random() -> None:
    """D = 0.3: with half the clearance of the ordered field they fit, with all of it they jam."""
    flume: dict[str, Any] = {"count": 24, "footprint": (2, 2), "seed": 1}
    field = debris.random(BAR, clearance=0.05, **flume)
    assert field.metadata()["D"] == pytest.approx(0.3)
    assert distances(field).min() >= 0.05
    with pytest.raises(debris.PlacementError) as caught:
        debris.random(BAR, clearance=0.1, restarts=2, **flume)
    assert 15 <= len(caught.value.densest) < 24


# Ordered fields ----------------------------------------------------------------------------


def test_the_frame_of_the_wave_basin() -> None:
    """5 across × 4 along, edges of 10.2 cm, gaps of 5.1 cm: a frame of 71.4 × 56.1 cm."""
    field = debris.ordered(BOXES[0], rows=4, columns=5, clearance=0.051, centre=(31.5, 2.0))
    assert field.footprint == (0.561, 0.714)
    assert field.middle == pytest.approx((31.5, 2.0))
    nearest = distances(field).min(axis=1)
    np.testing.assert_allclose(nearest, 0.051, rtol=1e-9)
    measured = field.metadata(width=1.016)
    assert measured["c"] == 20
    assert (measured["L_x"], measured["L_y"]) == pytest.approx((0.561, 0.714))
    assert measured["n"] == pytest.approx(1 - 20 * 0.102**2 / (0.561 * 0.714))
    assert measured["s"] == pytest.approx(0.051)
    assert measured["L_x_over_W"] == pytest.approx(0.561 / 1.016)


@pytest.mark.parametrize("orientation", [0, 90])
def test_the_flume_holds_24_bars_in_its_frame(orientation: int) -> None:
    rows, columns = (3, 8) if orientation == 0 else (8, 3)
    field = debris.ordered(
        BAR,
        rows=rows,
        columns=columns,
        clearance=0.1,
        orientation=orientation,
        centre=(40.8, 1.825),
    )
    assert len(field) == 24
    assert sorted(field.footprint) == pytest.approx([1.5, 1.7])
    assert max(field.footprint) <= 2.0
    inside = shapely.Polygon(field.outline()).buffer(1e-9)
    assert all(inside.contains(p) for p in polygons(field))
    assert distances(field).min() == pytest.approx(0.1)
    assert set(field.obliquity()) == {float(orientation)}


def test_rows_lie_along_the_flow_and_clearances_have_their_directions() -> None:
    field = debris.ordered(BAR, rows=2, columns=3, layers=2, clearance=(0.3, 0.2, 0.01))
    place = np.array([(p.x, p.y, p.elevation) for p in field.pieces]).reshape(2, 2, 3, 3)
    np.testing.assert_allclose(np.diff(place[..., 0], axis=1), 0.8)
    np.testing.assert_allclose(np.diff(place[..., 1], axis=2), 0.3)
    np.testing.assert_allclose(np.diff(place[..., 2], axis=0), 0.06)
    assert field.clearance == 0.2
    # Two layers cover their plan once; the nearest neighbour is the one above or below.
    measured = field.metadata()
    assert measured["covered_area"] == pytest.approx(6 * 0.05)
    assert measured["s"] == pytest.approx(0.01)


def test_tight_packing_has_no_porosity() -> None:
    measured = debris.ordered(BAR, rows=3, columns=4, clearance=0).metadata()
    assert measured["n"] == 0
    assert measured["e"] == 0
    assert measured["D"] == 1
    assert measured["log_n"] is None
    assert (measured["theta_std"], measured["s"]) == (0, pytest.approx(0, abs=1e-12))
    assert measured["C_u"] is None and measured["C_c"] is None  # D10 is 0


def test_materials_take_turns_or_are_mixed_by_a_seed() -> None:
    arguments: dict[str, Any] = {"rows": 4, "columns": 5, "clearance": 0.051}
    turns = debris.ordered(BOXES, **arguments)
    assert [p.prototype for p in turns.pieces] == [0, 1] * 10
    mixed = debris.ordered(BOXES, seed=1, **arguments)
    kinds = [p.prototype for p in mixed.pieces]
    assert sorted(kinds) == [0] * 10 + [1] * 10
    assert kinds != [0, 1] * 10
    assert mixed == debris.ordered(BOXES, seed=1, **arguments)
    assert mixed != debris.ordered(BOXES, seed=2, **arguments)
    few = debris.ordered(BOXES, seed=1, shares=(1, 3), **arguments)
    assert sum(p.prototype for p in few.pieces) == 15
    mass = 10 * (981 + 648) * 0.102**2 * 0.051
    assert mixed.metadata()["mass"] == pytest.approx(mass)


def test_turning_the_whole_keeps_what_lies_between() -> None:
    straight = debris.ordered(BAR, rows=3, columns=2, clearance=0.1, centre=(3, 1))
    turned = debris.ordered(BAR, rows=3, columns=2, clearance=0.1, centre=(3, 1), rotation=25)
    np.testing.assert_allclose(distances(turned), distances(straight), atol=3e-9)
    assert turned.rotation == 25
    assert set(turned.obliquity()) == {25.0}
    assert set(turned.obliquity(flow=25)) == {0.0}
    one, two = straight.metadata(), turned.metadata()
    for key in ("c", "n", "s", "covered_area", "mass", "x", "y"):
        assert one[key] == pytest.approx(two[key], abs=1e-8), key
    # Along its own direction it is as long as before; along the flow it is not.
    assert turned.metadata(flow=25)["L_x"] == pytest.approx(one["L_x"], abs=1e-8)
    c, s = math.cos(math.radians(25)), math.sin(math.radians(25))
    length, width = straight.footprint
    assert two["L_x"] == pytest.approx(length * c + width * s, abs=1e-8)
    assert two["L_y"] == pytest.approx(length * s + width * c, abs=1e-8)
    quarter = straight.turned(90)
    assert (quarter.metadata()["L_x"], quarter.metadata()["L_y"]) == pytest.approx(
        (width, length), abs=1e-9
    )


def test_moving() -> None:
    field = debris.random(BAR, count=5, footprint=(2, 2), clearance=0.1, seed=2)
    moved = field.moved((10.25, -1.5))
    assert moved.corner == (10.25, -1.5)
    np.testing.assert_allclose(distances(moved), distances(field), atol=1e-12)
    again = moved.moved((-10.25, 1.5))
    assert again == field


def test_unequal_layers_cover_their_union() -> None:
    small = debris.Prototype(length=0.2, width=0.1, height=0.05, material=WOOD)
    pieces = [
        debris.Piece(x=0, y=0),
        debris.Piece(prototype=1, x=0.25, y=0, angle=30, elevation=0.05),
    ]
    field = debris.DebrisField(
        prototypes=(BAR, small), pieces=pieces, footprint=(1, 1), corner=(-0.3, -0.3)
    )
    expected = shapely.union_all(polygons(field)).area
    assert 0.05 < expected < 0.07
    assert field.metadata()["covered_area"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rows": 0}, "rows is 0; expected a whole number ≥ 1"),
        ({"clearance": -1}, "clearance is -1; expected ≥ 0 m"),
        ({"clearance": (0, 1)}, "expected a number or (along, across, up) in m"),
        ({"orientation": 45}, "orientation is 45; expected 0, long edges along the flow, or 90"),
        ({"shares": (1, 1)}, "shares are given without a seed"),
        ({"seed": 1, "shares": (1, 1, 1)}, "expected 2 numbers, one a prototype"),
        ({"prototypes": "bar"}, "expected a debris.Prototype, or several"),
    ],
)
def test_refused_arrays(changes: dict[str, Any], words: str) -> None:
    good: dict[str, Any] = {"prototypes": BOXES, "rows": 2, "columns": 2, "clearance": 0.1}
    found = refused(debris.ordered, **(good | changes))
    assert len(found) == 1
    assert found[0].startswith("debris.ordered: ") and words in found[0]


# Numbers -----------------------------------------------------------------------------------


def test_the_stream_is_the_upper_bits_of_pcg64() -> None:
    words = np.random.PCG64(7).random_raw(3000).tolist()
    stream = Stream(7)
    found: list[float] = []
    for n in (1, 5, 2000, 3, 991):
        found += stream.peek(n).tolist()
        stream.drop(n)
    assert found == [(w >> 11) / 2**53 for w in words]
    assert all(0 <= u < 1 for u in found)
    drawn = [Stream(seed).integer(3, 5) for seed in range(300)]
    assert set(drawn) == {3, 4, 5}
    assert sorted(Stream(1).shuffle(range(10))) == list(range(10))


def test_shares_are_met_to_the_piece() -> None:
    assert counts_of("x", None, 2, 20) == [10, 10]
    assert counts_of("x", (0.1, 0.2, 0.7), 3, 10) == [1, 2, 7]
    assert counts_of("x", (1, 1, 1), 3, 20) == [7, 7, 6]
    assert counts_of("x", (0, 5), 2, 3) == [0, 3]
    assert sum(counts_of("x", (3, 5, 9, 11), 4, 17)) == 17


# Random fields -----------------------------------------------------------------------------


def test_golden_field() -> None:
    """Every NumPy and every machine gives these bits."""
    law = debris.SpreadAngles(mean=(-20, 20), spread=(5, 40))
    field = debris.random(
        BOXES, count=(14, 20), side=(0.7, 0.8), clearance=0.025, seed=20231121, angles=law,
        corner=(31.29, 0.5),
    )  # fmt: skip
    rows = [(p.prototype, p.x, p.y, p.angle) for p in field.pieces]
    text = json.dumps([rows, field.footprint])
    assert (len(field), field.placement.attempts, field.placement.restarts) == (15, 5799, 1)
    expected = "de57439bab58409f18c19addc7ba6daed326c9731f70c48119d7b6b5982ba1c2"
    assert hashlib.sha256(text.encode()).hexdigest() == expected


def test_the_same_seed_gives_the_same_field_in_another_process() -> None:
    code = (
        "from libmpm import debris, materials; import json;"
        "m = materials.TaitFluid();"
        "p = debris.Prototype(length=0.5, width=0.1, height=0.05, material=m);"
        "f = debris.random(p, count=16, footprint=(2, 2), clearance=0.05, seed=11);"
        "print(json.dumps(f.to_dict()))"
    )
    runs = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    }
    assert len(runs) == 1
    kind = debris.Prototype(length=0.5, width=0.1, height=0.05, material=materials.TaitFluid())
    arguments: dict[str, Any] = {"count": 16, "footprint": (2, 2), "clearance": 0.05}
    assert debris.random(kind, seed=11, **arguments).to_dict() == json.loads(runs.pop())
    assert debris.random(kind, seed=12, **arguments) != debris.random(kind, seed=11, **arguments)


@pytest.mark.parametrize("seed", range(6))
def test_no_overlap_and_clearance_and_footprint(seed: int) -> None:
    field = debris.random(
        [BAR, *BOXES], count=(14, 18), footprint=(2.0, 1.6), corner=(40, -1), clearance=0.05,
        seed=seed, shares=(1, 1, 2),
    )  # fmt: skip
    assert 14 <= len(field) <= 18
    apart = distances(field)
    assert apart.min() >= 0.05
    np.testing.assert_allclose(field.gaps(), apart, atol=1e-12)
    frame = shapely.box(40, -1, 42, 0.6)
    assert all(frame.contains(p) for p in polygons(field))
    made = field.placement
    assert made.kind == "random" and made.seed == seed
    assert made.attempts == made.outside + made.too_close + len(field)  # no restart was needed
    assert made.restarts == 0
    assert field.metadata()["acceptance"] == pytest.approx(len(field) / made.attempts)


@pytest.mark.parametrize(
    ("kind", "count", "side", "clearance"),
    [(BAR, 24, math.sqrt(24 * 0.05 / 0.4), 0.0), (BOXES[0], 20, 0.7213, 0.008)],
)
def test_up_to_two_fifths_of_the_frame(
    kind: Any, count: int, side: float, clearance: float
) -> None:
    field = debris.random(kind, count=count, side=side, clearance=clearance, seed=1)
    measured = field.metadata()
    assert measured["D"] == pytest.approx(0.4, abs=1e-3)
    assert distances(field).min() >= clearance
    assert shapely.union_all(polygons(field)).area == pytest.approx(count * kind.plan_area)


def test_laws_of_angles() -> None:
    inside = debris.random(BAR, count=10, footprint=(4, 4), clearance=0, seed=1,
                           angles=debris.UniformAngles(low=10, high=12))  # fmt: skip
    assert all(10 <= p.angle <= 12 for p in inside.pieces)
    assert inside.placement.interval == (10, 12)
    law = debris.SpreadAngles(mean=(0, 60), spread=(5, 10))
    means, widths = [], []
    for seed in range(40):
        field = debris.random(BAR, count=3, footprint=(4, 4), clearance=0, seed=seed, angles=law)
        low, high = field.placement.interval
        assert all(low <= p.angle <= high for p in field.pieces)
        means.append((low + high) / 2)
        widths.append((high - low) / 2)
    assert 0 <= min(means) < 15 and 45 < max(means) <= 60
    assert 5 <= min(widths) < 6.5 and 8.5 < max(widths) <= 10
    # Uniform over all angles: obliquities of many pieces have the moments of U(0, 90).
    many = debris.random(
        debris.Prototype(length=0.02, width=0.01, height=0.01, material=HDPE),
        count=400, footprint=(4, 4), clearance=0, seed=1,
    )  # fmt: skip
    theta = many.obliquity()
    assert theta.mean() == pytest.approx(45, abs=3 * 26 / 20)
    assert theta.std() == pytest.approx(90 / math.sqrt(12), rel=0.1)
    x = np.array([p.x for p in many.pieces])
    assert x.mean() == pytest.approx(2, abs=3 * 4 / math.sqrt(12) / 20)


def test_two_of_count_size_and_porosity() -> None:
    free = {"clearance": 0.01, "seed": 4}
    follows = debris.random(BAR, count=10, porosity=0.8, **free)
    assert follows.footprint[0] == pytest.approx(math.sqrt(10 * 0.05 / 0.2))
    assert follows.metadata()["n"] == pytest.approx(0.8)
    counted = debris.random(BAR, footprint=(2, 1.5), porosity=(0.8, 0.9), **free)
    assert 6 <= len(counted) <= 12
    limited = debris.random(BAR, count=(1, 60), side=(1, 3), porosity=(0.8, 0.85), **free)
    assert 0.8 <= limited.metadata()["n"] <= 0.85
    assert limited.placement.skipped > 0
    crowded = debris.random(
        BAR, count=(1, 2000), footprint=(2, 2), samples=99, restarts=0, attempts=200, **free
    )
    assert len(crowded) <= 80  # more cannot fit, and were passed over
    assert crowded.placement.skipped > 5


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"footprint": None}, "expected two of count, size (footprint or side) and porosity"),
        ({"side": 1.0}, "footprint and side are given; expected one of them"),
        ({"count": (5, 3)}, "count is (5, 3); expected low ≤ high; swap them"),
        ({"count": 2.5}, "count is 2.5; expected a whole number ≥ 1"),
        ({"porosity": 1.0}, "porosity is 1; expected ≥ 0 and < 1"),
        ({"porosity": 0.99}, "last of 10000 combinations of count (5, 5)"),
        ({"clearance": -0.1}, "clearance is -0.1; expected ≥ 0 m"),
        ({"angles": (0, 90)}, "expected debris.UniformAngles or debris.SpreadAngles"),
        ({"seed": -1}, "seed is -1; expected a whole number ≥ 0"),
        ({"shares": (0,)}, "expected one above 0"),
        ({"footprint": (1, 0)}, "footprint[1] is 0; expected > 0 m"),
    ],
)
def test_refused_laws(changes: dict[str, Any], words: str) -> None:
    good: dict[str, Any] = {"count": 5, "footprint": (2, 2), "clearance": 0.1, "seed": 1}
    found = refused(debris.random, BAR, **(good | changes))
    assert any(p.startswith("debris.random: ") and words in p for p in found), found


def test_what_cannot_be_placed_says_why() -> None:
    arguments: dict[str, Any] = {
        "count": 24, "footprint": (2, 2), "clearance": 0.1, "seed": 1, "attempts": 300,
        "restarts": 2,
    }  # fmt: skip
    with pytest.raises(debris.PlacementError) as caught:
        debris.random(BAR, **arguments)
    error = caught.value
    best = error.densest
    assert 10 <= len(best) < 24
    assert distances(best).min() >= 0.1
    made = best.placement
    free = 1 - len(best) * 0.05 / 4
    assert str(error) == (
        "debris.random: 24 pieces with a clearance of 0.1 m could not be placed in a footprint of "
        f"2 × 2 m. Of {made.attempts} places drawn, up to 300 for a piece, {made.outside} were "
        f"outside and {made.too_close} too close (restarts: 2, samples: 1). The densest attempt, "
        f"`densest` of this error, has {len(best)} of 24 pieces and a porosity of "
        f"{free:.3g}. Use fewer pieces, a larger footprint, a smaller clearance, angles that "
        "differ less, more attempts or restarts, or debris.ordered"
    )
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) and again.densest == best
    # A piece that no place holds.
    with pytest.raises(debris.PlacementError, match="has 0 of 1 pieces") as caught:
        debris.random(BAR, count=1, footprint=(0.3, 0.3), clearance=0, seed=1, attempts=20)
    assert "there are no pieces" in refused(caught.value.densest.metadata)[0]


def test_restarts_and_samples_are_counted() -> None:
    arguments: dict[str, Any] = {"footprint": (1.2, 1.2), "clearance": 0.05, "attempts": 30}
    restarted = [debris.random(BAR, count=6, seed=s, restarts=50, **arguments) for s in range(4)]
    assert max(f.placement.restarts for f in restarted) > 0
    for field in restarted:
        made = field.placement
        # Draws accepted in abandoned attempts are neither outside nor too close.
        assert made.attempts >= made.outside + made.too_close + 6
    found = debris.random(BAR, count=(3, 20), seed=1, restarts=1, samples=50, **arguments)
    assert found.placement.rejected > 0
    assert distances(found).min() >= 0.05
