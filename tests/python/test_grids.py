"""Grids of triangles and of splines, their functions and their mass matrices, as values."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import libmpm
from libmpm import grids
from libmpm._src.base.values import Value

MESH = grids.Mesh.blocks(columns=2, rows=1, lower=(10.0, 20.0), upper=(14.0, 21.0))
CENTROIDS = MESH.corners().mean(axis=1)
CONSISTENT = {
    "kind": "consistent",
    "solver": "direct",
    "tolerance": 1e-10,
    "iterations": 200,
    "deactivate_below": 0.0,
}
BOX: dict[str, Any] = {"lower": (1.0, 2.0), "upper": (5.0, 4.0)}

VALUES: list[Value] = [
    grids.Linear(),
    grids.Lagrange(degree=3),
    grids.PowellSabin(),
    grids.PowellSabin(split=CENTROIDS),
    grids.CubicPowellSabin(),
    grids.ConsistentMass(solver="cg", tolerance=1e-6, iterations=30, deactivate_below=1e-2),
    grids.LumpedMass(),
    grids.PartialMass(form="rows"),
    grids.TriangularGrid(mesh=MESH),
    grids.TriangularGrid(
        mesh=MESH, basis=grids.PowellSabin(split=CENTROIDS), mass=grids.PartialMass()
    ),
    grids.SplineGrid(**BOX, spans=(4, 2)),
    grids.SplineGrid(**BOX, degree=(1, 0), knots=[[1, 1, 3, 5, 5], [2, 4]]),
]


def refused(call: Callable[..., Any], *args: Any, **keywords: Any) -> list[str]:
    with pytest.raises(libmpm.SceneError) as caught:
        call(*args, **keywords)
    return caught.value.problems


@pytest.mark.parametrize("item", VALUES, ids=lambda item: type(item).__name__)
def test_round_trips(item: Value) -> None:
    assert type(item).from_dict(item.to_dict()) == item
    assert type(item).from_dict(json.loads(json.dumps(item.to_dict()))) == item
    assert pickle.loads(pickle.dumps(item)) == item
    assert hash(pickle.loads(pickle.dumps(item))) == hash(item)
    assert repr(item).strip("<").startswith(f"grids.{type(item).__name__}")


def test_public_names() -> None:
    for name in grids.__all__:
        item = getattr(grids, name)
        # A traction is given to a body of any scene with a grid, and was a name of libmpm itself.
        assert not isinstance(item, type) or item.label in (f"grids.{name}", "Traction")


# Triangles ---------------------------------------------------------------------------------


def test_triangular_grid() -> None:
    grid = grids.TriangularGrid(mesh=MESH)
    assert (grid.lower, grid.upper, grid.cells) == ((10.0, 20.0), (14.0, 21.0), 8)
    assert grid.spacing == MESH.shortest_edge == 1.0
    found = grid.specification()
    vertices, triangles = MESH.arrays()
    np.testing.assert_array_equal(found.pop("vertices"), vertices - (10.0, 20.0))
    assert found["triangles"].dtype == np.int32
    np.testing.assert_array_equal(found.pop("triangles"), triangles)
    assert found == {
        "kind": "triangular",
        "basis": "powell-sabin",
        "degree": 2,
        "split": None,
        "mass": CONSISTENT | {"kind": "partial-symmetric"},
    }
    # Functions that may be negative cannot be lumped, not even in part.
    other = grids.TriangularGrid(mesh=MESH, basis=grids.Lagrange(degree=3))
    assert other.mass == grids.ConsistentMass()


@pytest.mark.parametrize(
    ("basis", "name", "degree"),
    [
        (grids.Linear(), "linear", 1),
        (grids.Lagrange(), "lagrange", 2),
        (grids.Lagrange(degree=5), "lagrange", 5),
        (grids.PowellSabin(split=CENTROIDS), "powell-sabin", 2),
        (grids.CubicPowellSabin(), "cubic-powell-sabin", 3),
    ],
)
def test_bases(basis: Any, name: str, degree: int) -> None:
    found = grids.TriangularGrid(mesh=MESH, basis=basis).specification()
    assert (found["basis"], found["degree"]) == (name, degree)
    if isinstance(basis, grids.PowellSabin):
        np.testing.assert_array_equal(found["split"], CENTROIDS - (10.0, 20.0))
    else:
        assert found["split"] is None


@pytest.mark.parametrize(
    ("mass", "changes"),
    [
        (grids.ConsistentMass(), {}),
        (
            grids.ConsistentMass(solver="richardson", iterations=8, deactivate_below=1),
            {"solver": "richardson", "iterations": 8, "deactivate_below": 1.0},
        ),
        (grids.LumpedMass(), {"kind": "lumped"}),
        (grids.PartialMass(), {"kind": "partial-symmetric"}),
        (grids.PartialMass(form="rows"), {"kind": "partial-rows"}),
    ],
)
def test_masses(mass: Any, changes: dict[str, Any]) -> None:
    for grid in (
        grids.TriangularGrid(mesh=MESH, mass=mass),
        grids.SplineGrid(**BOX, spans=(1, 1), mass=mass),
    ):
        assert grid.specification()["mass"] == CONSISTENT | changes


def test_specification_does_not_depend_on_the_place() -> None:
    moved = grids.Mesh.blocks(columns=2, rows=1, lower=(0.0, 0.0), upper=(4.0, 1.0))
    one, two = (grids.TriangularGrid(mesh=m).specification() for m in (MESH, moved))
    np.testing.assert_array_equal(one["vertices"], two["vertices"])


def test_slivers_are_doubted() -> None:
    assert grids.TriangularGrid(mesh=MESH).doubts() == []
    assert grids.SplineGrid(**BOX, spans=(1, 1)).doubts() == []
    thin = grids.Mesh.blocks(columns=1, rows=1, lower=(0, 0), upper=(10, 0.5))
    assert "the smallest angle is 2.86 degrees" in grids.TriangularGrid(mesh=thin).doubts()[0]


@given(seed=st.integers(0, 1000))
def test_incentres_and_points_near_them_are_valid(seed: int) -> None:
    random = np.random.default_rng(seed)
    vertices, triangles = MESH.arrays()
    inner = np.ones(len(vertices), dtype=bool)
    inner[MESH.outline()] = False
    vertices[inner] += random.uniform(-0.3, 0.3, size=(int(inner.sum()), 2))
    mesh = grids.Mesh(vertices=vertices, triangles=triangles)
    corners = mesh.corners()
    length = np.linalg.norm(np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1), axis=2)
    split = (length[:, :, None] * corners).sum(axis=1) / length.sum(axis=1)[:, None]
    split += random.uniform(-1e-9, 1e-9, size=split.shape)
    grids.TriangularGrid(mesh=mesh, basis=grids.PowellSabin(split=split))


def test_split_points_are_checked() -> None:
    square = grids.Mesh.squares(columns=1, rows=1, lower=(0, 0), upper=(1, 1))

    def problems(*points: tuple[float, float]) -> list[str]:
        basis = grids.PowellSabin(split=points)
        return refused(grids.TriangularGrid, mesh=square, basis=basis)

    assert problems((0.6, 0.5)) == [
        "grids.TriangularGrid: basis.split has 1 points for 2 triangles; expected one for each; "
        'or use "incentre"'
    ]
    assert "points 1 outside the triangles" in problems((0.6, 0.5), (0.6, 0.5))[0]
    assert "points 0 outside the triangles" in problems((0.5, 0.5), (0.3, 0.5))[0]
    # In the first triangle of this kite a corner is blunt, and the line passes beyond it.
    kite = grids.Mesh(vertices=[(0, 0), (0, 1), (-4, 3), (4, 3)], triangles=[(0, 1, 2), (0, 3, 1)])
    far = grids.PowellSabin(split=[(-3.8, 2.88), (3.8, 2.88)])
    assert refused(grids.TriangularGrid, mesh=kite, basis=far) == [
        "grids.TriangularGrid: basis.split: the line between the points of triangles 0 and 1 "
        'misses their common side; expected to cross it; move the points, or use "incentre"'
    ]
    grids.TriangularGrid(mesh=kite, basis=grids.PowellSabin(split=[(-0.1, 0.5), (0.1, 0.5)]))


@pytest.mark.parametrize("mass", [grids.LumpedMass(), grids.PartialMass()])
def test_negative_functions_cannot_be_lumped(mass: Any) -> None:
    problem = refused(grids.TriangularGrid, mesh=MESH, basis=grids.Lagrange(), mass=mass)[0]
    assert "with grids.Lagrange(degree=2), whose functions have sums of mass that are" in problem
    grids.TriangularGrid(mesh=MESH, basis=grids.Lagrange(degree=1), mass=mass)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: grids.Lagrange(degree=0), "degree is 0; expected a whole number ≥ 1"),
        (lambda: grids.Lagrange(degree=6), "degree is 6; expected a whole number ≤ 5"),
        (lambda: grids.PowellSabin(split="incenter"), 'expected "incentre" or one point (x, y)'),
        (lambda: grids.PowellSabin(split=[(0, 0), (1,)]), "split[1] is (1,); expected 2 numbers"),
        (lambda: grids.PowellSabin(split=[]), "split is []; expected"),
        (lambda: grids.PowellSabin(split=3), "split is 3; expected"),
        (lambda: grids.ConsistentMass(solver="gc"), "solver is 'gc'; did you mean 'cg'?"),
        (lambda: grids.ConsistentMass(tolerance=0), "tolerance is 0; expected > 0 and < 1"),
        (lambda: grids.ConsistentMass(iterations=0), "iterations is 0; expected a whole number ≥"),
        (lambda: grids.ConsistentMass(deactivate_below=-1), "deactivate_below is -1; expected ≥ 0"),
        (lambda: grids.PartialMass(form="row"), "did you mean 'rows'?"),
        (lambda: grids.LumpedMass(solver="cg"), "unknown argument 'solver'"),
        (lambda: grids.TriangularGrid(), "argument 'mesh' is missing"),
        (lambda: grids.TriangularGrid(mesh=3), "mesh is 3; expected a grids.Mesh"),
        (lambda: grids.TriangularGrid(mesh=MESH, basis="P1"), "basis is 'P1'; expected a basis"),
        (lambda: grids.TriangularGrid(mesh=MESH, mass="lumped"), "mass is 'lumped'; expected"),
    ],
)
def test_refuses(call: Callable[[], Any], words: str) -> None:
    problems = refused(call)
    assert len(problems) == 1
    assert words in problems[0]
    assert problems[0].startswith("grids.")


# Splines -----------------------------------------------------------------------------------


def test_spline_grid() -> None:
    grid = grids.SplineGrid(**BOX, spans=(4, 2))
    assert grid.degree == (2, 2)
    assert (grid.lower, grid.upper, grid.cells, grid.spacing) == ((1.0, 2.0), (5.0, 4.0), 8, 1.0)
    found = grid.specification()
    x, y = found.pop("knots")
    assert x.tolist() == [0, 0, 0, 1, 2, 3, 4, 4, 4]
    assert y.tolist() == [0, 0, 0, 1, 2, 2, 2]
    assert found == {
        "kind": "splines",
        "degree": [2, 2],
        "mass": CONSISTENT | {"kind": "partial-symmetric"},
    }


@given(spans=st.tuples(st.integers(1, 9), st.integers(1, 9)), degree=st.integers(1, 5))
def test_equal_spans(spans: tuple[int, int], degree: int) -> None:
    grid = grids.SplineGrid(lower=(0, 0), upper=(1, 3), spans=spans, degree=degree)
    knots = grid.specification()["knots"]
    assert [len(k) for k in knots] == [n + 1 + 2 * degree for n in spans]
    assert grid.cells == spans[0] * spans[1]
    assert grid.spacing == pytest.approx(min(1 / spans[0], 3 / spans[1]))
    # The same knots, given, are the same grid to the engine.
    given_ = grids.SplineGrid(lower=(0, 0), upper=(1, 3), degree=degree, knots=knots)
    for one, two in zip(knots, given_.specification()["knots"], strict=True):
        np.testing.assert_array_equal(one, two)


def test_one_dimensional_method() -> None:
    grid = grids.SplineGrid(lower=(0, 0), upper=(25, 0.1), spans=(5, 1), degree=(3, 0))
    assert grid.spacing == 5.0
    assert grid.specification()["knots"][1].tolist() == [0.0, 0.1]


def test_given_knots() -> None:
    grid = grids.SplineGrid(**BOX, degree=(2, 1), knots=([1, 1, 1, 4, 4, 5, 5, 5], [2, 2, 4, 4]))
    assert grid.cells == 2
    assert grid.spacing == 1.0
    x, y = grid.specification()["knots"]
    assert x.tolist() == [0, 0, 0, 3, 3, 4, 4, 4]
    assert y.tolist() == [0, 0, 2, 2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "spans and knots: neither is given"),
        ({"spans": (1, 1), "knots": ([0], [0])}, "spans and knots: both are given"),
        ({"spans": 3}, "spans is 3; expected a pair"),
        ({"spans": (3, 0)}, "spans[1] is 0; expected a whole number ≥ 1"),
        ({"spans": (3, 3), "degree": (2, 0)}, "spans[1] is 3 with degree 0"),
        ({"spans": (1, 1), "degree": (0, 0)}, "degree is (0, 0), functions without slopes"),
        ({"spans": (1, 1), "degree": 0}, "degree is (0, 0), functions without slopes"),
        ({"spans": (1, 1), "degree": 6}, "degree[0] is 6; expected a whole number ≤ 5"),
        ({"spans": (1, 1), "degree": (1, 2, 3)}, "degree is (1, 2, 3); expected a whole number or"),
        ({"spans": (1, 1), "degree": 1.5}, "degree is 1.5; expected a whole number or (p_x, p_y)"),
        ({"spans": (1, 1), "upper": (0, 4)}, "upper[0] is 0 with lower[0] 1; expected upper >"),
        ({"knots": 3}, "knots is 3; expected a pair of knot vectors"),
        ({"knots": ([1, 5], [2, 2, 4, 4])}, "knots[0] is [1, 5]; expected at least 4 numbers"),
        ({"knots": ([1, 1, 5, 5], [2, 2, 3, 2, 4, 4])}, "knots[1][3] is 2 after 3; expected knots"),
        ({"knots": ([1, 1, 5, 5], [2, 2, 2, 4, 4])}, "knots[1] has its end 2 3 times; expected 2"),
        ({"knots": ([1, 1, 3, 3, 5, 5], [2, 2, 4, 4])}, "knots[0] has 3 2 times; expected at most"),
        ({"knots": ([1, 1, 6, 6], [2, 2, 4, 4])}, "knots[0] has the end 6 with upper 5 m"),
        ({"knots": ([1, 1, "a", 5, 5], [2, 2, 4, 4])}, "knots[0][2] is 'a'; expected a number"),
    ],
)
def test_spline_grid_refuses(changes: dict[str, Any], words: str) -> None:
    problems = refused(grids.SplineGrid, **({**BOX, "degree": 1} | changes))
    assert any(words in p for p in problems), problems
    assert all(p.startswith("grids.SplineGrid: ") for p in problems)


def test_all_problems_at_once() -> None:
    problems = refused(
        grids.SplineGrid, lower=(1, 1), upper=(0, 2), spans=(0, 2), degree=(2, 9), mass=1
    )
    assert len(problems) == 4
