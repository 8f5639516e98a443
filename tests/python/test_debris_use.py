"""What debris fields are good for: measures, bodies, meshes, tables and pictures."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import shapely

import libmpm
from libmpm import Scene, debris, materials, shapes
from libmpm._src.run.engine_spec import lower
from support.debris_fields import BAR, BOXES, HDPE, WOOD, distances, polygons, refused
from support.scenes import with_arrays


@pytest.fixture(autouse=True)
def closed_figures() -> Any:
    yield
    plt.close("all")


# Measures ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2])
def test_measures_against_direct_recomputation(seed: int) -> None:
    field = debris.random(BAR, count=15, footprint=(2, 2), clearance=0.05, seed=seed)
    measured = field.metadata(width=1.016)
    shapes_of = polygons(field)
    union = shapely.union_all(shapes_of)
    n = 1 - union.area / 4
    assert measured["n"] == pytest.approx(n)
    assert measured["D"] == pytest.approx(1 - n)
    assert measured["log_n"] == pytest.approx(math.log(n))
    assert measured["e"] == pytest.approx(n / (1 - n))
    assert measured["sqrt_c"] == pytest.approx(math.sqrt(15))
    assert measured["s"] == pytest.approx(distances(field).min(axis=1).mean())
    x0, y0, x1, y1 = union.bounds
    assert measured["L_x"] == pytest.approx(x1 - x0)
    assert measured["L_y_over_W"] == pytest.approx((y1 - y0) / 1.016)
    assert (measured["x"], measured["y"]) == pytest.approx(union.centroid.coords[0])
    # Angles from the corners, without folding: the long edge of each polygon against x.
    slopes = []
    for p in shapes_of:
        corners = np.array(p.exterior.coords)
        ways = np.diff(corners, axis=0)
        way = ways[np.argmax(np.linalg.norm(ways, axis=1))]
        slopes.append(math.degrees(math.atan2(abs(way[1]), abs(way[0]))))
    theta = np.sort(slopes)
    assert measured["theta_mean"] == pytest.approx(theta.mean())
    assert measured["theta_std"] == pytest.approx(math.sqrt(((theta - theta.mean()) ** 2).mean()))
    for part in (10, 30, 60):
        expected = next(t for t in theta if np.mean(theta <= t) >= part / 100 - 1e-12)
        assert measured[f"D{part}"] == pytest.approx(expected)
    d10, d30, d60 = (measured[f"D{part}"] for part in (10, 30, 60))
    assert measured["C_u"] == pytest.approx(d60 / d10)
    assert measured["C_c"] == pytest.approx(d30**2 / (d60 * d10))
    assert measured["theta15"] == pytest.approx(np.mean(theta < 15))
    assert measured["sqrt_theta15"] == pytest.approx(math.sqrt(np.mean(theta < 15)))
    assert measured["D_theta_45"] == pytest.approx(np.mean(theta >= 45))
    assert measured["mass"] == pytest.approx(15 * BAR.mass)
    json.dumps(measured, allow_nan=False)


def test_the_debris_set_is_among_the_measures(tmp_path: Path) -> None:
    small = debris.Prototype(length=0.2, width=0.1, height=0.05, material=WOOD, name="wood")
    law = debris.UniformAngles(low=-20, high=10)
    field = debris.random((BAR, small), count=4, shares=(3, 1), footprint=(2, 2), clearance=0.1,
                          seed=2, angles=law)  # fmt: skip
    found = field.metadata()
    assert [(k["name"], k["count"]) for k in found["prototypes"]] == [("bar", 3), ("wood", 1)]
    assert found["prototypes"][1]["youngs_modulus"] == 2e9
    assert found["mean_density"] == pytest.approx((3 * 981 + 648) / 4)
    assert found["mean_youngs_modulus"] == pytest.approx((3 * 8e8 + 2e9) / 4)
    assert found["mean_length"] == pytest.approx((3 * 0.5 + 0.2) / 4)
    assert found["mean_plan_area"] == pytest.approx(found["covered_area"] / 4)
    assert found["mean_cross_section"] == pytest.approx(0.1 * 0.05)
    assert (found["kind"], found["interval"]) == ("random", [-20, 10])
    assert found["angles"] == law.to_dict()
    field.save(tmp_path / "field.json")
    assert json.loads((tmp_path / "field.json").read_text())["metadata"] == found
    assert debris.DebrisField.load(tmp_path / "field.json") == field
    debris.save_metadata([field], tmp_path / "fields.csv")
    with (tmp_path / "fields.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert json.loads(row["prototypes"]) == found["prototypes"]
    ice = materials.TaitFluid()
    fluid = debris.Prototype(length=0.2, width=0.1, height=0.05, material=ice)
    assert (
        debris.ordered(fluid, rows=1, columns=1, clearance=0).metadata()["mean_youngs_modulus"]
        is None
    )


def test_report(tmp_path: Path) -> None:
    field = debris.random(BOXES, count=6, footprint=(1, 1), clearance=0.05, seed=1)
    paths = field.report(tmp_path / "new" / "field", width=0.4, flow=10, bins=9)
    assert sorted(p.name for p in (tmp_path / "new" / "field").iterdir()) == sorted(
        p.name for p in paths.values()
    )
    assert debris.DebrisField.load(paths["field"]) == field
    read = json.loads(paths["metadata"].read_text())
    assert read == field.metadata(width=0.4, flow=10)
    assert json.loads(paths["angles"].read_text()) == field.angle_data(bins=9, flow=10)
    assert len(paths["pieces"].read_text().splitlines()) == 7
    assert plt.imread(paths["figure"]).ndim == 3
    assert not plt.get_fignums()


def test_wrong_arguments_of_measures(tmp_path: Path) -> None:
    field = debris.ordered(BAR, rows=1, columns=2, clearance=0.1)
    assert refused(field.share_below, "15") == [
        "debris.DebrisField.share_below: theta is '15'; expected a number in degrees"
    ]
    assert "theta is nan" in refused(field.share_above, math.nan)[0]
    assert "thetas is 15; expected several angles" in refused(field.metadata, thetas=15)[0]
    pytest.importorskip("meshio")
    found = refused(field.save_mesh, tmp_path / "a.foo")
    assert "meshio knows no files of the kind '.foo' of a.foo" in found[0]
    assert not list(tmp_path.iterdir())
    arguments: dict[str, Any] = {"footprint": (1, 1), "clearance": 0, "seed": 1}
    assert len(refused(debris.random, BAR, count=0, **arguments)) == 1


def test_the_page_runs(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "debris-fields.md"
    first, second = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    scene = Scene(cell_size=0.1, lower=(38, 0, 0), upper=(44, 4, 3), gravity=(0, 0, -9.81))
    scene.add_body(name="water", shape=shapes.Box(lower=(38, 0, 0), upper=(44, 4, 2)),
                   material=materials.TaitFluid(), hydrostatic=2.0)  # fmt: skip
    names: dict[str, Any] = {"scene": scene}
    exec(first, names)
    assert names["field"].metadata()["n"] == pytest.approx(0.8)
    assert len(scene.bodies) == 17
    exec(second, names)
    assert [len(names[key]) for key in ("packed", "in_order")] == [24, 24]
    assert names["in_order"].footprint == pytest.approx((2.0, 1.5))


def test_the_mean_gap_of_layers_is_one_in_space() -> None:
    layers: dict[str, Any] = {"rows": 2, "columns": 1, "layers": 2}
    for up, expected in ((0, 0), (0.04, 0.04), (0.5, 0.2)):
        field = debris.ordered(BAR, clearance=(0.2, 0.2, up), **layers)
        assert field.metadata()["s"] == pytest.approx(expected, abs=1e-9)


def test_shares_of_angles_are_complementary() -> None:
    field = debris.random(BAR, count=12, footprint=(2, 2), clearance=0.05, seed=3)
    for theta in (0, 15, 40.5, 90, 91):
        assert field.share_below(theta) + field.share_above(theta) == pytest.approx(1)
    straight = debris.ordered(BAR, rows=1, columns=2, clearance=0.1, rotation=15)
    assert (straight.share_below(15), straight.share_above(15)) == (0, 1)


def test_footprints_of_the_porosity() -> None:
    field = debris.ordered(BAR, rows=2, columns=2, clearance=0.1)  # 1.1 m × 0.3 m
    area = 4 * 0.05
    for footprint, total in (
        (None, 0.33), ("square", 1.21), (2.0, 4.0), ((2.0, 1.5), 3.0),
    ):  # fmt: skip
        measured = field.metadata(footprint=footprint)
        assert measured["footprint_area"] == pytest.approx(total)
        assert measured["n"] == pytest.approx(1 - area / total)
    assert "expected no more than it has" in refused(field.metadata, footprint=0.3)[0]
    assert 'expected None, "square"' in refused(field.metadata, footprint="frame")[0]


# Bodies ------------------------------------------------------------------------------------


def flume() -> Scene:
    return Scene(cell_size=0.05, lower=(0, 0, 0), upper=(3, 2.5, 1), gravity=(0, 0, -9.81))


def test_bodies_of_a_scene_in_space() -> None:
    scene = flume()
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0, 0), upper=(3, 2.5, 0.5)),
        material=materials.TaitFluid(), hydrostatic=0.5,
    )  # fmt: skip
    tall = debris.Prototype(length=0.5, width=0.2, height=0.15, material=WOOD, name="beam")
    cube = debris.Prototype(
        length=0.2, width=0.2, height=0.1, material=HDPE, name="cube", particles_per_cell=27
    )
    field = debris.random((tall, cube), count=8, footprint=(2, 2), corner=(0.5, 0.25),
                          clearance=0.1, seed=1)  # fmt: skip
    names = field.add_to(scene, elevation=0.4, velocity=(1, 0, 0), subtract_from=("water",))
    assert names == tuple(f"debris-{i}" for i in range(1, 9))
    scene.validate(strict=True)
    water, *bodies = with_arrays(lower(scene))["bodies"]
    for piece, body in zip(field.pieces, bodies, strict=True):
        kind = field.prototypes[piece.prototype]
        assert body["count"] * body["particle_mass"] == pytest.approx(kind.mass)
        centre = body["position"].mean(axis=0)
        np.testing.assert_allclose(centre, [piece.x, piece.y, 0.4 + kind.height / 2])
        np.testing.assert_array_equal(body["velocity"], [1, 0, 0])
        counts = {"beam": 20 * 8 * 6, "cube": 12 * 12 * 6}
        assert body["count"] == counts[kind.name]
    removed = 120 * 100 * 20 - water["count"]
    # Each piece reaches 0.1 m into the water.
    below = sum(field.prototypes[p.prototype].plan_area * 0.1 for p in field.pieces)
    assert removed * 0.025**3 == pytest.approx(below, rel=0.02)
    assert scene.plan(device="cpu").particles == water["count"] + sum(b["count"] for b in bodies)


def test_layers_stand_on_each_other() -> None:
    scene = flume()
    kind = debris.Prototype(length=0.5, width=0.2, height=0.1, material=HDPE)
    field = debris.ordered(
        kind, rows=2, columns=2, layers=2, clearance=0.1, centre=(1.5, 1.2), rotation=30
    )
    names = field.add_to(scene, name="log", elevation=0.2)
    assert len(names) == 8
    scene.validate(strict=True)
    low = [body.shape.lower[2] for body in scene.bodies]
    assert low == pytest.approx([0.2] * 4 + [0.4] * 4)


def test_the_plan_as_a_scene() -> None:
    scene = Scene(dimension=2, cell_size=0.025, lower=(0, 0), upper=(3, 2))
    field = debris.random(BAR, count=10, footprint=(2, 1.9), clearance=0.05, seed=1)
    field.add_to(scene, velocity=libmpm.Field(components=("1 + y", "0")))
    scene.validate(strict=True)
    bodies = with_arrays(lower(scene))["bodies"]
    assert [b["count"] for b in bodies] == [40 * 8] * 10
    total = sum(b["count"] * b["particle_mass"] for b in bodies)
    assert total == pytest.approx(10 * 0.05 * 981)  # of unit thickness
    # Momentum of ten rigid bars in a linear field: mass × speed at their middles.
    momentum = sum(b["particle_mass"] * b["velocity"].sum(axis=0) for b in bodies)
    expected = 0.05 * 981 * sum(1 + p.y for p in field.pieces)
    np.testing.assert_allclose(momentum, [expected, 0], atol=1e-9)


def test_bodies_that_cannot_be_added() -> None:
    field = debris.ordered(BAR, rows=1, columns=2, layers=2, clearance=0.1, centre=(1, 1))
    flat = Scene(dimension=2, cell_size=0.025, lower=(0, 0), upper=(2, 2))
    found = refused(field.add_to, flat, elevation=0.2)
    assert "elevation is 0.2 in 2D, where the scene is the plan itself" in found[0]
    assert "the field has several layers; expected one in 2D" in found[1]
    tilted = Scene(cell_size=0.05, lower=(0, 0, 0), upper=(2, 2, 2), gravity=(0, -9.81, 0))
    assert "gravity points along y; expected z" in refused(field.add_to, tilted)[0]
    scene = flume()
    scene.add_body(name="debris-3", shape=shapes.Box(lower=(0, 0, 0), upper=(1, 1, 0.2)),
                   material=WOOD)  # fmt: skip
    assert "body 'debris-3' is there already" in refused(field.add_to, scene)[0]
    assert "velocity" in refused(field.add_to, scene, name="log", velocity=(1, "a", 0))[0]
    assert [b.name for b in scene.bodies] == ["debris-3"]


def test_tetrahedra_fill_the_pieces(tmp_path: Path) -> None:
    field = debris.random((BAR, BOXES[0]), count=4, footprint=(2, 2), clearance=0.1, seed=1)
    for edge, bricks in ((None, (1, 1)), (0.05, (10 * 2 * 1, 3 * 3 * 2))):
        points, cells, piece = field.mesh(edge=edge, elevation=2.0)
        a, b, c, d = np.moveaxis(points[cells], 1, 0)
        volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
        assert np.all(volume > 0)
        for i, one in enumerate(field.pieces):
            kind = field.prototypes[one.prototype]
            mine = piece == i
            assert mine.sum() == 6 * bricks[one.prototype]
            assert volume[mine].sum() == pytest.approx(kind.plan_area * kind.height)
            used = points[np.unique(cells[mine])]
            np.testing.assert_allclose(used.mean(axis=0), [one.x, one.y, 2 + kind.height / 2])
        # A face inside belongs to two tetrahedra, one of the surface to one.
        faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3))
        _, often = np.unique(faces, axis=0, return_counts=True)
        n = {None: [(1, 1, 1)] * 2, 0.05: [(10, 2, 1), (3, 3, 2)]}[edge]
        outside = sum(
            4 * (i * j + j * k + k * i) for i, j, k in (n[p.prototype] for p in field.pieces)
        )
        assert (often == 1).sum() == outside
        assert often.max() == 2
    meshio = pytest.importorskip("meshio")
    field.save_mesh(tmp_path / "debris.vtu", edge=0.05, elevation=2.0)
    read = meshio.read(tmp_path / "debris.vtu")
    np.testing.assert_array_equal(read.cells[0].data, cells)
    np.testing.assert_array_equal(read.cell_data["piece"][0], piece)


# Tables and pictures -----------------------------------------------------------------------


def test_tables(tmp_path: Path) -> None:
    field = debris.random(BOXES, count=6, footprint=(1, 1), clearance=0.05, seed=1)
    rows = field.table()
    assert len(rows) == 6
    assert rows["name"].tolist() == [BOXES[p.prototype].name for p in field.pieces]
    np.testing.assert_allclose(rows["gap"], distances(field).min(axis=1), atol=1e-12)
    np.testing.assert_allclose(rows["mass"], [BOXES[p.prototype].mass for p in field.pieces])
    field.save_table(tmp_path / "pieces.csv")
    with (tmp_path / "pieces.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(r["x"]) for r in read] == rows["x"].tolist()
    single = debris.ordered(BAR, rows=1, columns=1, clearance=0)
    assert single.table()["gap"][0] == math.inf
    assert single.metadata()["s"] is None


def test_metadata_of_many_fields(tmp_path: Path) -> None:
    arguments: dict[str, Any] = {"count": (4, 9), "footprint": (2, 2), "clearance": 0.05}
    laws = [debris.UniformAngles(low=0, high=s) for s in range(4)]
    fields = [debris.random(BAR, seed=s, angles=law, **arguments) for s, law in enumerate(laws)]
    debris.save_metadata(fields, tmp_path / "fields.csv", width=1.016)
    debris.save_metadata(fields, tmp_path / "fields.json", width=1.016)
    rows = json.loads((tmp_path / "fields.json").read_text())
    assert rows == [f.metadata(width=1.016) for f in fields]
    with (tmp_path / "fields.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(r["n"]) for r in read] == [r["n"] for r in rows]
    assert read[0]["C_u"] == ""  # all angles 0: undefined
    assert "there are no fields" in refused(debris.save_metadata, [], tmp_path / "x.csv")[0]


def test_numbers_behind_the_pictures() -> None:
    field = debris.random(BAR, count=12, footprint=(2, 2), clearance=0.05, seed=6)
    data = field.angle_data(bins=9)
    json.dumps(data, allow_nan=False)
    theta = np.sort(field.obliquity())
    assert data["edges"] == pytest.approx(np.arange(0, 91, 10))
    expected = [np.sum((theta >= e) & (theta < e + 10)) for e in range(0, 90, 10)]
    assert data["counts"] == expected
    assert sum(data["shares"]) == pytest.approx(1)
    assert data["obliquity"] == theta.tolist()
    assert data["cumulative"] == pytest.approx([np.mean(theta <= t) for t in theta])
    assert data["D30"] == field.metadata()["D30"]


def test_the_plan_is_drawn() -> None:
    field = debris.random(BOXES, count=9, footprint=(1.2, 1.0), clearance=0.05, seed=1)
    ax = field.draw()
    pieces = [p for p in ax.patches if p.get_gid() == "piece"]
    assert len(pieces) == 9
    for patch, polygon in zip(pieces, polygons(field), strict=True):
        assert shapely.Polygon(patch.get_xy()).symmetric_difference(polygon).area < 1e-12
    assert len(ax.patches) == 10
    assert ax.get_aspect() == 1.0
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["HDPE", "wood"]
    low, high = np.array(ax.get_xlim()), np.array(ax.get_ylim())
    assert low[0] < 0 and low[1] > 1.2 and high[0] < 0 and high[1] > 1.0
    _, mine = plt.subplots()
    assert debris.ordered(BAR, rows=1, columns=2, clearance=0.1).draw(mine) is mine
    assert mine.get_legend() is None


def test_angles_are_drawn() -> None:
    field = debris.random(BAR, count=12, footprint=(2, 2), clearance=0.05, seed=6)
    data = field.angle_data(bins=9)
    rose, histogram, cumulative = field.rose(bins=9), field.histogram(bins=9), field.cumulative()
    assert [p.get_height() for p in rose.patches] == pytest.approx(data["shares"])
    assert [p.get_x() for p in rose.patches] == pytest.approx(np.radians(data["edges"][:-1]))
    assert [p.get_height() for p in histogram.patches] == data["counts"]
    steps, *marks = cumulative.lines
    assert steps.get_xdata()[1:-1] == pytest.approx(data["obliquity"])
    assert [m.get_xdata()[1] for m in marks] == [data["D10"], data["D30"], data["D60"]]
    assert [m.get_ydata()[1] for m in marks] == [0.1, 0.3, 0.6]
    _, straight = plt.subplots()
    assert "expected polar ones" in refused(field.rose, straight)[0]
    figure = field.figure()
    assert len(figure.axes) == 4
    figure.canvas.draw()
    assert sum(len(ax.patches) for ax in figure.axes) == 13 + 6 + 6
