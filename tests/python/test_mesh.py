"""Meshes of triangles, and particles placed in them."""

from __future__ import annotations

import json
import math
import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import libmpm
from libmpm._src.grids.particles import subdivide, voronoi_areas
from libmpm.grids import Mesh

CORNERS = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
PLACES = st.tuples(*[st.floats(-1e3, 1e3)] * 2)


def refused(call: Callable[..., Any], *args: Any, **keywords: Any) -> list[str]:
    with pytest.raises(libmpm.SceneError) as caught:
        call(*args, **keywords)
    return caught.value.problems


def notched() -> Mesh:
    """Return a square without its lower right quarter."""
    vertices = [(0, 0), (1, 1), (0, 1), (0.5, 0.5), (0.5, 0), (1, 0.5)]
    triangles = [(0, 4, 3), (0, 3, 2), (3, 1, 2), (3, 5, 1)]
    return Mesh(vertices=vertices, triangles=triangles)


def random_points(n: int, seed: int = 0) -> npt.NDArray[np.float64]:
    return np.random.default_rng(seed).random((n, 2))


# Regular meshes ----------------------------------------------------------------------------


@given(columns=st.integers(1, 6), rows=st.integers(1, 6))
def test_counts_and_areas_of_blocks(columns: int, rows: int) -> None:
    mesh = Mesh.blocks(columns=columns, rows=rows, lower=(-1.0, 2.0), upper=(24.0, 4.0))
    assert len(mesh.vertices) == (columns + 1) * (rows + 1) + columns * rows
    assert len(mesh.triangles) == 4 * columns * rows
    np.testing.assert_allclose(mesh.areas(), 50.0 / (4 * columns * rows), rtol=1e-13)
    assert mesh.area == pytest.approx(50.0, rel=1e-14)
    assert (mesh.lower, mesh.upper) == ((-1.0, 2.0), (24.0, 4.0))
    half = math.hypot(25.0 / columns, 2.0 / rows) / 2
    assert mesh.shortest_edge == pytest.approx(min(half, 25.0 / columns, 2.0 / rows))


def test_one_block() -> None:
    mesh = Mesh.blocks(columns=1, rows=1, lower=(0, 0), upper=(1, 1))
    assert mesh.vertices == ((0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0.5))
    assert mesh.triangles == ((0, 1, 4), (1, 3, 4), (3, 2, 4), (2, 0, 4))
    assert mesh.smallest_angle == pytest.approx(45.0)


def test_squares() -> None:
    same = Mesh.squares(columns=2, rows=1, lower=(0, 0), upper=(2, 1))
    assert same.triangles == ((0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4))
    other = Mesh.squares(columns=2, rows=1, lower=(0, 0), upper=(2, 1), diagonal="alternate")
    assert other.triangles == ((0, 1, 4), (0, 4, 3), (1, 2, 4), (2, 5, 4))
    assert same.area == other.area == 2.0
    assert same.shortest_edge == 1.0


def test_regular_meshes_refuse() -> None:
    problems = refused(Mesh.blocks, columns=0, rows=1.5, lower=(0, 0), upper=(1, -1))
    assert len(problems) == 3
    assert all(p.startswith("grids.Mesh.blocks: ") for p in problems)
    assert "columns is 0; expected a whole number ≥ 1" in problems[0]
    assert "upper[1] is -1 with lower[1] 0; expected upper > lower" in problems[2]
    keywords = {"columns": 1, "rows": 1, "lower": (0, 0), "upper": (1, 1)}
    assert "did you mean 'same'?" in refused(Mesh.squares, **keywords, diagonal="sane")[0]
    assert "unknown argument 'colums'" in refused(Mesh.squares, colums=1)[0]


# The value ---------------------------------------------------------------------------------


def test_value_semantics() -> None:
    mesh = notched()
    vertices, triangles = mesh.arrays()
    assert vertices.dtype == np.float64
    assert triangles.dtype == np.int64
    same = Mesh(vertices=vertices, triangles=triangles.astype(np.int32))
    assert same == mesh
    assert hash(same) == hash(mesh)
    assert mesh.area == 0.75
    assert pickle.loads(pickle.dumps(mesh)) == mesh
    assert Mesh.from_dict(json.loads(json.dumps(mesh.to_dict()))) == mesh
    assert repr(mesh) == "<grids.Mesh: 6 vertices, 4 triangles>"
    vertices[:] = 0.0
    assert same == mesh
    with pytest.raises(AttributeError):
        mesh.vertices = ()  # type: ignore[misc]


def test_clockwise_triangles_are_turned() -> None:
    mesh = Mesh(vertices=CORNERS, triangles=[(0, 1, 2), (0, 3, 2)])
    assert mesh.triangles == ((0, 1, 2), (0, 2, 3))
    assert (mesh.areas() > 0).all()


def test_outline_has_the_region_on_its_left() -> None:
    mesh = notched()
    outline = mesh.outline()
    ring = [(0, 4), (1, 2), (2, 0), (3, 5), (4, 3), (5, 1)]
    assert sorted(map(tuple, outline.tolist())) == ring
    x, y = mesh.arrays()[0][outline].transpose(2, 1, 0)
    assert (x[0] * y[1] - x[1] * y[0]).sum() / 2 == pytest.approx(mesh.area)
    blocks = Mesh.blocks(columns=3, rows=2, lower=(0, 0), upper=(1, 1))
    assert len(blocks.outline()) == 10


def test_contains() -> None:
    mesh = notched()
    inside = [(0.25, 0.25), (0.75, 0.75), (0.0, 0.0), (0.5, 0.25), (0.5, 0.5), (1.0, 0.7)]
    outside = [(0.75, 0.25), (0.51, 0.49), (-0.1, 0.5), (5.0, 5.0), (0.5 + 1e-6, 0.25)]
    assert mesh.contains(inside).all()
    assert not mesh.contains(outside).any()


def test_contains_points_of_an_outline_with_holes_and_corners() -> None:
    """Against every edge for every point, on outlines with holes, and beside them."""
    vertices, triangles = Mesh.blocks(columns=6, rows=5, lower=(0.3, -1), upper=(2, 1.7)).arrays()
    rng = np.random.default_rng(0)
    kept = triangles[rng.random(len(triangles)) > 0.3]
    used = np.unique(kept)
    mesh = Mesh(vertices=vertices[used], triangles=np.searchsorted(used, kept))
    corners = mesh.arrays()[0]
    start, end = corners[mesh.outline()].transpose(1, 0, 2)
    share = rng.random((20, len(start), 1))
    on = (start + share * (end - start)).reshape(-1, 2)
    assert mesh.contains(on).all() and mesh.contains(corners).all()
    points = np.concatenate([rng.uniform((0.2, -1.1), (2.1, 1.8), (2000, 2)), on + 1e-6, on - 1e-6])
    a, b, c = (mesh.corners()[:, k] for k in range(3))
    sides = [
        (q[:, 0] - p[:, 0]) * (points[:, None, 1] - p[:, 1])
        - (q[:, 1] - p[:, 1]) * (points[:, None, 0] - p[:, 0])
        for p, q in ((a, b), (b, c), (c, a))
    ]
    expected = np.logical_and.reduce([side >= 0 for side in sides]).any(axis=1)
    assert 0 < expected.sum() < len(points)
    np.testing.assert_array_equal(mesh.contains(points), expected)


def test_many_points_beside_a_mesh_cost_little() -> None:
    """A forged scene had hundreds of thousands: each was compared with every edge in turn."""
    mesh = Mesh(vertices=[(0, 0), (1, 0), (0, 1)], triangles=[(0, 1, 2)])
    points = np.random.default_rng(0).uniform(0.6, 1.0, (1_000_000, 2))
    began = time.process_time()
    assert not mesh.contains(points).any()
    assert time.process_time() - began < 10  # 0.5 s; one by one 34 s


def test_slivers_are_doubted() -> None:
    assert notched().doubts() == []
    thin = Mesh(vertices=[(0, 0), (1, 0), (0.5, 0.05)], triangles=[(0, 1, 2)])
    angle = math.degrees(math.atan2(0.05, 0.5))
    assert thin.smallest_angle == pytest.approx(angle)
    assert thin.doubts() == [
        f"grids.Mesh: the smallest angle is {angle:.3g} degrees; expected 10 or more, since "
        "slivers make the method unstable; move or remove vertices"
    ]


@pytest.mark.parametrize(
    ("vertices", "triangles", "words"),
    [
        ([(0, 0), (1, math.nan), (0, 1)], [(0, 1, 2)], "vertices 1 are not finite"),
        ([(0, 0), (1, 0)], [(0, 1, 1)], "vertices has shape (2, 2); expected (n, 2) in m with n ≥"),
        ([(0, 0), (1,)], [(0, 1, 2)], "vertices is not a table of numbers"),
        (CORNERS, [(0, 1, 2), (0, 2, 4)], "numbers outside 0 to 3 in rows 1"),
        (CORNERS, [(0, 1, 2), (0, 2, -1)], "numbers outside 0 to 3 in rows 1"),
        (CORNERS, [(0.0, 1.0, 2.0)], "expected (m, 3) whole numbers"),
        (CORNERS, [(0, 1, 2, 3)], "triangles has shape (1, 4)"),
        (CORNERS, [], "with m ≥ 1"),
        (CORNERS, [(0, 1, 2)], "vertices 3 belong to no triangle"),
        (CORNERS, [(0, 1, 2), (0, 2, 2), (0, 2, 3)], "triangles 1 have no area"),
        ([*CORNERS, (1, 0)], [(0, 1, 2), (0, 2, 3), (4, 2, 0)], "vertices 1, 4 are all at (1, 0)"),
        (
            [*CORNERS, (0.2, 0.9)],
            [(0, 1, 2), (0, 2, 3), (0, 2, 4)],
            "edge of vertices 0 and 2 belongs to more than two",
        ),
        (CORNERS, [(0, 1, 2), (0, 1, 3)], "edge of vertices 0 and 1 lie on the same side"),
    ],
)
def test_refuses(vertices: Any, triangles: Any, words: str) -> None:
    problems = refused(Mesh, vertices=vertices, triangles=triangles)
    assert any(words in p for p in problems), problems
    assert all(p.startswith("grids.Mesh: ") for p in problems)


def test_all_problems_at_once() -> None:
    vertices = [*CORNERS, (1.0, 1e-14), (2.0, 2.0)]
    problems = refused(Mesh, vertices=vertices, triangles=[(0, 1, 2), (0, 2, 2), (0, 3, 4)])
    assert len(problems) == 3
    many = refused(Mesh, vertices=random_points(20), triangles=[(0, 1, 2)])
    assert "vertices 3, 4, 5, 6, 7 and 12 more belong to no triangle" in many[0]


def test_triangle_thin_but_with_area() -> None:
    for height, good in ((2e-9, True), (5e-10, False)):
        vertices = [(1e3, 0), (1e3 + 1, 0), (1e3 + 0.5, height)]
        if good:
            assert Mesh(vertices=vertices, triangles=[(0, 1, 2)]).area > 0
        else:
            assert "no area" in refused(Mesh, vertices=vertices, triangles=[(0, 1, 2)])[0]


def test_plot() -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    ax = figure.subplots()
    assert notched().plot(ax, color="k") is ax
    assert len(ax.lines) == 2
    assert ax.lines[0].get_color() == "k"


# Point clouds and files --------------------------------------------------------------------


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_delaunay_covers_the_hull(shift: float) -> None:
    spatial = pytest.importorskip("scipy.spatial")
    points = random_points(200) + shift
    mesh = Mesh.delaunay(points)
    assert len(mesh.vertices) == 200
    assert mesh.area == pytest.approx(spatial.ConvexHull(points - shift).volume, rel=1e-9)
    assert len(mesh.triangles) == 2 * 200 - 2 - len(mesh.outline())


def test_delaunay_drops_the_slivers_of_the_hull() -> None:
    pytest.importorskip("scipy")
    # Points in a row along slanted sides, where rounding puts some behind and some before it.
    side = np.linspace(0, 1, 41)[:, None]
    ends = np.array([(0.0, 0.0), (1.0, 0.3), (0.8, 1.1), (-0.1, 0.7)])
    ring = np.concatenate(
        [a + side[:-1] * (b - a) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
    )
    mesh = Mesh.delaunay(np.concatenate([ring, 0.2 + 0.4 * random_points(100)]))
    x, y = ends.T
    area = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
    assert mesh.area == pytest.approx(area, rel=1e-12)
    assert len(mesh.outline()) == len(ring)


def test_delaunay_refuses() -> None:
    pytest.importorskip("scipy")
    assert "lie on a line" in refused(Mesh.delaunay, [(0, 0), (1, 1), (2, 2), (3, 3)])[0]
    assert "(n, 2) numbers in m" in refused(Mesh.delaunay, [(0, 0, 0)] * 4)[0]
    assert "vertices[1] is not finite" in refused(Mesh.delaunay, [(0, 0), (1, math.inf), (0, 1)])[0]
    twice = refused(Mesh.delaunay, [*CORNERS, CORNERS[0]])
    assert any("are all at (0, 0)" in p for p in twice)


@pytest.mark.parametrize("module", ["scipy.spatial", "meshio", "shapely"])
def test_missing_packages_are_named(
    module: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    calls: dict[str, Callable[[], Any]] = {
        "scipy.spatial": lambda: Mesh.delaunay(CORNERS),
        "meshio": lambda: Mesh.load(tmp_path / "a.msh"),
        "shapely": lambda: voronoi_areas([(0.2, 0.2)], notched()),
    }
    problem = refused(calls[module])[0]
    assert f"the package {module.split('.')[0]} is not installed" in problem
    assert "pip install libmpm[triangular]" in problem


@pytest.mark.parametrize("name", ["a.msh", "a.vtk", "a.vtu"])
def test_files(name: str, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    mesh = Mesh.blocks(columns=2, rows=3, lower=(0, 1), upper=(2, 5))
    vertices, triangles = mesh.arrays()
    # An unused vertex in front, and lines along a side, as mesh generators write them.
    points = np.column_stack([np.vstack([(9, 9), vertices]), np.full(len(vertices) + 1, 2.5)])
    cells = [("line", np.array([(1, 2), (2, 3)])), ("triangle", triangles + 1)]
    kind = {"file_format": "gmsh22"} if name == "a.msh" else {}
    meshio.write(tmp_path / name, meshio.Mesh(points, cells), **kind)
    assert Mesh.load(tmp_path / name) == mesh


@pytest.mark.parametrize(
    ("cells", "lift", "words"),
    [
        ([("quad", [[0, 1, 2, 3]])], 0.0, "has 1 cells of type 'quad'; expected 'triangle' only"),
        ([("triangle6", [[0, 1, 2, 3, 4, 5]])], 0.0, "cells of type 'triangle6'"),
        ([("tetra", [[0, 1, 2, 3]])], 0.0, "cells of type 'tetra'"),
        ([("line", [[0, 1]])], 0.0, "has no cells of type 'triangle'"),
        ([("triangle", [[0, 1, 2], [0, 2, 3]])], 0.1, "has z from 0 to 0.1 m; expected one value"),
    ],
)
def test_files_refused(cells: Any, lift: float, words: str, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.array([(*p, 0.0) for p in [*CORNERS, (0.5, 0.5), (0.2, 0.5)]])
    points[2, 2] = lift
    meshio.write(tmp_path / "a.vtk", meshio.Mesh(points, [(k, np.array(c)) for k, c in cells]))
    problems = refused(Mesh.load, tmp_path / "a.vtk")
    assert any(words in p for p in problems)
    assert all("a.vtk" in p for p in problems)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    assert "does not exist" in refused(Mesh.load, tmp_path / "none.msh")[0]
    for name in ("a.msh", "a.vtk", "a.unknown"):
        (tmp_path / name).write_text("nothing\n")
        assert "cannot be read (" in refused(Mesh.load, tmp_path / name)[0]


# Particles ---------------------------------------------------------------------------------


@given(a=PLACES, b=PLACES, c=PLACES, k=st.integers(1, 6))
def test_subdivide_sums(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], k: int
) -> None:
    corners = np.array([[a, b, c], [a, c, b]])
    centroids, areas = subdivide(corners, k)
    assert centroids.shape == (2 * k * k, 2)
    assert len(set(areas[: k * k])) == 1
    sides = corners[:, 1:] - corners[:, :1]
    exact = abs(np.linalg.det(sides)) / 2
    np.testing.assert_allclose(areas.reshape(2, -1).sum(axis=1), exact, rtol=1e-12, atol=1e-9)
    mean = centroids.reshape(2, -1, 2).mean(axis=1)
    np.testing.assert_allclose(mean, corners.mean(axis=1), rtol=1e-12, atol=1e-9)


def test_subdivide_places() -> None:
    centroids, areas = subdivide([[(0, 0), (6, 0), (0, 6)]], 2)
    assert centroids.tolist() == [[1, 1], [2, 2], [4, 1], [1, 4]]
    assert areas.tolist() == [4.5] * 4
    mesh = notched()
    centroids, areas = subdivide(mesh.corners(), 3)
    assert areas.sum() == pytest.approx(mesh.area, rel=1e-14)
    assert mesh.contains(centroids).all()


def test_subdivide_refuses() -> None:
    problems = refused(subdivide, np.zeros((4, 2)), 0)
    assert len(problems) == 2
    assert "k is 0" in problems[0]
    assert "(4, 2); expected (m, 3, 2)" in problems[1]


def test_voronoi_areas_of_a_lattice_are_its_cells() -> None:
    pytest.importorskip("shapely")
    x, y = (np.arange(16) + 0.5) / 16 * 25, (np.arange(14) + 0.5) / 14 * 2
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    mesh = Mesh.blocks(columns=3, rows=1, lower=(0, 0), upper=(25, 2))
    np.testing.assert_allclose(voronoi_areas(points, mesh), 50 / (16 * 14), rtol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 500])
def test_voronoi_areas_add_up(n: int) -> None:
    pytest.importorskip("shapely")
    mesh = notched()
    points = random_points(10 * n, seed=n)
    points = points[mesh.contains(points)][:n]
    areas = voronoi_areas(points, mesh)
    assert areas.shape == (n,)
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(mesh.area, rel=1e-12)


def test_voronoi_areas_of_two_points_in_a_notched_square() -> None:
    pytest.importorskip("shapely")
    # The diagonal halves the figure; both points are equally far from it.
    areas = voronoi_areas([(0.25, 0.25), (0.75, 0.75)], notched())
    np.testing.assert_allclose(areas, 0.375, rtol=1e-14)


def test_voronoi_areas_refuse() -> None:
    pytest.importorskip("shapely")
    points = [(0.2, 0.2), (0.8, 0.2), (math.nan, 0.0)]
    assert "points 1, 2 lie outside the mesh" in refused(voronoi_areas, points, notched())[0]
    points = [(0.2, 0.2), (0.3, 0.2), (0.2, 0.2)]
    assert "points 0, 2 have the place of another" in refused(voronoi_areas, points, notched())[0]
    assert "shape (2,)" in refused(voronoi_areas, (0.0, 0.0), notched())[0]


def test_problems_of_a_mesh_file_name_the_file(tmp_path):
    pytest.importorskip("meshio")
    path = tmp_path / "dyke.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n")
    with pytest.raises(libmpm.SceneError, match=r"dyke\.off.*not finite"):
        Mesh.load(path)
