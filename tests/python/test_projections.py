"""Projections of fields and of particles onto functions, and tables of their errors."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from libmpm import grids
from support.functions import UNIT, functions_on, refused, sines, splines, squares

pytest.importorskip("scipy")


# Projections of fields ---------------------------------------------------------------------


def test_convergence_of_powell_sabin_splines() -> None:
    """VAL-2, de Koster (2018) table 3.1.

    The digest's own errors (1.15343e-2 to 1.54677e-5) are 2 to 4 % lower: its seven points a piece
    integrate the square of the difference, of degree 6, too coarsely. The same coefficients
    measured with 16 times as many points give what is expected here.
    """
    table = grids.convergence(sines, lambda n: squares(n, grids.PowellSabin()), (3, 5, 9, 17))
    assert table.functions == (27, 75, 243, 867)
    assert table.spacing == (1 / 2, 1 / 4, 1 / 8, 1 / 16)
    exact = [1.178092e-2, 1.142749e-3, 1.316983e-4, 1.608266e-5]
    np.testing.assert_allclose(table.error, exact, rtol=1e-6)
    published = [1.18575e-2, 1.14331e-3, 1.31622e-4, 1.61689e-5]
    np.testing.assert_allclose(table.error, published, rtol=7e-3)
    assert math.isnan(table.order[0])
    np.testing.assert_allclose(table.order[1:], [3.37, 3.12, 3.03], atol=6e-3)  # as published


def test_convergence_of_linear_functions() -> None:
    """VAL-3; the errors printed in table 3.2 are 16 times too small."""
    meshes = [squares(n, grids.Linear()) for n in (5, 9, 17, 33)]
    table = grids.convergence(sines, meshes, (5, 9, 17, 33))
    np.testing.assert_allclose(
        table.error, [2.76813e-2, 6.59262e-3, 1.61785e-3, 4.02342e-4], rtol=1e-3
    )
    np.testing.assert_allclose(table.order[1:], 2, atol=0.08)
    # More points, or fields far from polynomials, change nothing that is seen.
    again = grids.convergence(sines, meshes[:2], points=9)
    assert again.n == (1, 2)
    np.testing.assert_allclose(again.error, table.error[:2], rtol=1e-6)


def test_convergence_of_cubic_powell_sabin_splines() -> None:
    """VAL-14, with exact integrals; the digest's rule gives up to 0.6 % less."""
    table = grids.convergence(sines, lambda n: squares(n, grids.CubicPowellSabin()), (3, 5, 9))
    np.testing.assert_allclose(table.error, [8.7782e-4, 7.5906e-5, 5.6357e-6], rtol=1e-5)
    assert table.order[2] > 3.7


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_convergence_of_splines(degree: int) -> None:
    def grid(n: int) -> grids.SplineGrid:
        return grids.SplineGrid(**UNIT, spans=(n, n), degree=degree)

    table = grids.convergence(sines, grid, (4, 8, 16))
    assert table.functions == tuple((n + degree) ** 2 for n in (4, 8, 16))
    assert table.order[2] == pytest.approx(degree + 1, abs=0.15)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    ("basis", "degree"),
    [(grids.Linear(), 1), (grids.PowellSabin(), 2), (grids.CubicPowellSabin(), 3)],
    ids=["linear", "powell-sabin", "cubic"],
)
def test_polynomials_are_reproduced(basis: Any, degree: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    powers = [(p, q) for p in range(degree + 1) for q in range(degree + 1 - p)]
    factor = random.standard_normal(len(powers))

    def field(x: Any, y: Any, shift: int = 0) -> Any:
        return sum(c * x**p * y ** (q + shift) for c, (p, q) in zip(factor, powers, strict=True))

    functions = functions_on(basis, seed)
    found = functions.project(field)
    position = random.random((200, 2))
    assert found.error() < 1e-11
    np.testing.assert_allclose(found.at(position), field(*position.T), atol=1e-11)
    # And those of a higher degree are not.
    assert functions.project(lambda x, y: field(x, y, 1)).relative_error() > 1e-6


def test_fields_of_several_columns() -> None:
    functions = functions_on(grids.PowellSabin())

    def field(x: Any, y: Any) -> Any:
        return np.stack([sines(x, y), x * y, 0 * x + 2], axis=1)

    found = functions.project(field)
    assert found.coefficients.shape == (functions.count, 3)
    alone = functions.project(sines)
    np.testing.assert_allclose(found.coefficients[:, 0], alone.coefficients, atol=1e-13)
    assert found.error() == pytest.approx(alone.error(), rel=1e-9)
    assert found.at([[0.2, 0.5]]).shape == (1, 3)
    np.testing.assert_allclose(
        found.gradient([[0.2, 0.5]])[0, 1:], [[0.5, 0.2], [0, 0]], atol=1e-10
    )
    np.testing.assert_allclose(alone.gradient([[0.2, 0.5]]), [[2.54, 0]], atol=0.1)
    whole = math.sqrt(1 / 4 + 1 / 9 + 4)
    assert found.relative_error() == pytest.approx(found.error() / whole, rel=1e-6)
    with pytest.raises(ValueError, match="read-only"):
        found.coefficients[0] = 0


def test_error_against_another_field() -> None:
    one = functions_on(grids.Linear()).project(lambda x, y: 1.0)
    assert one.error(lambda x, y: x) == pytest.approx(math.sqrt(1 / 3), rel=1e-12)
    assert one.relative_error(lambda x, y: 0 * x) == math.inf


@pytest.mark.parametrize(("n", "published"), [(9, 1.4e-2), (17, 7e-3)])
def test_lumped_projection_of_a_linear_field(n: int, published: float) -> None:
    """Digest 7.3: exact inside for linear functions, and not for Powell-Sabin splines."""
    h = 1 / (n - 1)
    inside = np.random.default_rng(0).uniform(2 * h, 1 - 2 * h, (4000, 2))

    def largest(basis: Any) -> float:
        functions = grids.Functions(squares(n, basis, "alternate"))
        found = functions.project(lambda x, y: x, mass="lumped")
        return float(np.abs(found.at(inside) - inside[:, 0]).max())

    assert largest(grids.Linear()) < 1e-13
    assert largest(grids.PowellSabin()) == pytest.approx(published, rel=0.1)


def test_lumping_keeps_the_integral() -> None:
    functions = functions_on(grids.PowellSabin())
    position, weight = functions.quadrature
    for mass in ("consistent", "lumped"):
        found = functions.project(sines, mass=mass)  # type: ignore[arg-type]
        assert (weight * found.at(position)).sum() == pytest.approx(4 / np.pi**2, rel=1e-9)


# Projections of particles ------------------------------------------------------------------


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize(
    "basis", [grids.Linear(), grids.PowellSabin(), grids.CubicPowellSabin()], ids=str
)
def test_particles_keep_their_sum(basis: Any, mass: Any) -> None:
    functions = functions_on(basis)
    random = np.random.default_rng(5)
    position, weight = random.random((6000, 2)), random.uniform(0.5, 1.5, 6000)
    value = np.column_stack([sines(*position.T), random.standard_normal(6000)])
    found = functions.project(value, position=position, weight=weight, mass=mass)
    have = (weight[:, None] * found.at(position)).sum(axis=0)
    np.testing.assert_allclose(have, (weight[:, None] * value).sum(axis=0), rtol=1e-10)
    alone = functions.project(value[:, 0], position=position, weight=weight, mass=mass)
    difference = alone.at(position) - value[:, 0]
    rms = math.sqrt((weight * difference**2).sum() / weight.sum())
    assert alone.particle_error == pytest.approx(rms, rel=1e-12)
    assert alone.error(sines) == pytest.approx(rms, rel=0.2)


def test_particles_reproduce_what_the_functions_can() -> None:
    functions = functions_on(grids.PowellSabin())
    position = np.random.default_rng(6).random((4000, 2))

    def field(x: Any, y: Any) -> Any:
        return 1 + 2 * x - y + x * y - 3 * y**2

    found = functions.project(field, position=position, weight=np.ones(4000))
    assert found.particle_error < 1e-11
    assert found.error(field) < 1e-9
    assert functions.project(field).coefficients == pytest.approx(found.coefficients, abs=1e-8)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_functions_without_particles_get_nothing(mass: Any) -> None:
    functions = grids.Functions(squares(9, grids.Linear()))
    position = np.random.default_rng(7).random((2000, 2)) * [0.5, 1]
    found = functions.project(lambda x, y: x, position=position, weight=np.ones(2000), mass=mass)
    beyond = functions.control_points[:, 0] > 0.51
    assert (found.coefficients[beyond] == 0).all()
    assert (found.coefficients[functions.control_points[:, 0] == 0.5] > 0.4).all()


def test_many_batches_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    functions = functions_on(grids.PowellSabin())
    whole = functions.project(sines)
    monkeypatch.setattr("libmpm._src.grids.functions._AT_ONCE", 77)
    parts = functions.project(sines)
    np.testing.assert_allclose(parts.coefficients, whole.coefficients, atol=1e-12)
    assert parts.error() == pytest.approx(whole.error(), rel=1e-9)


# Tables and texts --------------------------------------------------------------------------


def test_table() -> None:
    table = grids.convergence(sines, lambda n: squares(n, grids.PowellSabin()), (3, 5))
    assert repr(table) == (
        "n  functions  h (m)        error  order\n"
        "3         27    0.5  1.17809e-02\n"
        "5         75   0.25  1.14275e-03   3.37"
    )
    page = table._repr_html_()
    assert page.count("<tr>") == 3
    assert "<td>1.14275e-03</td><td>3.37</td>" in page
    found = table.to_dict()
    assert found["n"] == [3, 5]
    assert found["order"][0] is None
    assert found["order"][1] == pytest.approx(math.log2(found["error"][0] / found["error"][1]))


def test_short_descriptions() -> None:
    functions = splines(2)
    assert repr(functions) == "<grids.Functions: 16 of tensor-spline over 4 cells>"
    assert repr(functions.project(sines)) == f"<grids.Projection on {functions!r}>"
    assert functions.grid.spacing == 0.5


LINEAR = squares(3, grids.Linear())
ONES: dict[str, Any] = {"position": [[0.3, 0.4]], "weight": [1.0]}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f: grids.Functions(3), "grid is 3; expected a grids.TriangularGrid or"),
        (lambda f: grids.Functions(LINEAR, points=0), "points is 0; expected a whole number ≥ 1"),
        (lambda f: f.evaluate([0.5, 0.5]), "position has shape (2,); expected (n, 2) in m"),
        (lambda f: f.evaluate("here"), "position is not a table of numbers: 'here'"),
        (
            lambda f: f.evaluate([[0.5, 0.5], [2, 0.5], [np.nan, 0]]),
            "positions 1, 2 lie outside the grid, the first at (2, 0.5) m",
        ),
        (lambda f: f.project(sines, mass="lump"), "mass is 'lump'; did you mean 'lumped'?"),
        (lambda f: f.project([1.0]), "values are given without position and weight"),
        (lambda f: f.project([1.0], position=[[0.5, 0.5]]), "one is given; expected both"),
        (lambda f: f.project([1.0, 2.0], **ONES), "values have shape (2,) for 1 positions"),
        (lambda f: f.project([np.inf], **ONES), "values 0 are not finite"),
        (lambda f: f.project([1.0], **ONES | {"weight": [-1]}), "weight has entries that are neg"),
        (lambda f: f.project([1.0], **ONES | {"weight": 1}), "weight has shape () for 1 positions"),
        (
            lambda f: f.project([1.0], **ONES | {"position": [[3, 3]]}),
            "positions 0 lie outside the grid",
        ),
        (lambda f: f.project([1.0], **ONES), "do not determine the coefficients of the"),
        (lambda f: f.project(lambda x, y: x[:3]), "field(x, y) has shape (3,) for"),
        (lambda f: f.project(lambda x, y: 0 * x + np.nan), "is not finite; expected numbers"),
        (lambda f: f.project(sines).particle_error, "particle_error of a projected field"),
        (
            lambda f: f.project([1.0], mass="lumped", **ONES).error(),
            "error() without a field, of a projection of particles' values",
        ),
        (
            lambda f: f.project(sines).error(lambda x, y: np.stack([x, y], 1)),
            "expected that of the projection",
        ),
        (lambda f: grids.convergence(sines, lambda n: LINEAR), "ns is missing for a function"),
        (lambda f: grids.convergence(sines, [LINEAR], (1, 2)), "ns has 2 numbers for 1 grids"),
        (
            lambda f: functions_on(grids.Lagrange()).project(sines, mass="lumped"),
            "mass is 'lumped' with grids.Lagrange(degree=2), whose functions have sums",
        ),
        (lambda f: f.plot(9), "number is 9; expected 0 to 8"),
        (lambda f: f.plot_split(), "has no split and no control triangles"),
        (lambda f: splines(2).plot_control_triangles(), "has no split and no control triangles"),
        (lambda f: f.plot_particles([1.0]), "position has shape (1,); expected (n, 2) in m"),
        (lambda f: f.plot_particles([[1, 2]], [1, 2]), "values have shape (2,) for 1 particles"),
        (
            lambda f: f.project(lambda x, y: np.stack([x, y], 1)).plot(),
            "the field has 2 columns; expected one",
        ),
    ],
)
def test_refuses(call: Callable[[grids.Functions], Any], words: str) -> None:
    assert words in refused(lambda: call(grids.Functions(LINEAR)))


def test_without_scipy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.sparse", None)
    functions = grids.Functions(LINEAR)
    functions.evaluate([[0.5, 0.5]])
    problem = refused(lambda: functions.project(sines))
    assert "the package scipy is not installed" in problem
    assert "pip install libmpm[triangular]" in problem
