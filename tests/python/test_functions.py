"""The functions of a grid: their values, integrals and pictures."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import libmpm
from libmpm import grids
from support.functions import ALL, functions_on, sines, splines, squares

pytest.importorskip("scipy")


# Values ------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", ALL)
def test_sum_control_points_and_slopes(make: Callable[[], grids.Functions]) -> None:
    functions = make()
    random = np.random.default_rng(3)
    position = 0.02 + 0.96 * random.random((500, 2))
    here = functions.evaluate(position)
    assert here.gradient.shape == (*here.value.shape, 2)
    np.testing.assert_allclose(here.value.sum(axis=1), 1, atol=2e-13)
    np.testing.assert_allclose(here.gradient.sum(axis=1), 0, atol=1e-11)
    at_control = (functions.control_points[here.function] * here.value[..., None]).sum(axis=1)
    np.testing.assert_allclose(at_control, position, atol=1e-13)
    # The gradient is that of the values, where a step does not leave the piece.
    coefficients = random.standard_normal(functions.count)

    def field(x: npt.NDArray[np.float64]) -> Any:
        f, value, _ = functions.evaluate(x)
        return (coefficients[f] * value).sum(axis=1)

    slope = (coefficients[here.function][..., None] * here.gradient).sum(axis=1)
    for axis, step in enumerate(1e-6 * np.eye(2)):
        found = (field(position + step) - field(position - step)) / 2e-6
        assert np.median(np.abs(found - slope[:, axis])) < 1e-7


@pytest.mark.parametrize("make", ALL)
def test_quadrature_is_exact(make: Callable[[], grids.Functions]) -> None:
    functions = make()
    (x, y), weight = functions.quadrature[0].T, functions.quadrature[1]
    assert (weight > 0).all()
    for p, q in ((0, 0), (3, 2), (0, 7), (4, 4)):
        assert (weight * x**p * y**q).sum() == pytest.approx(1 / (p + 1) / (q + 1), rel=1e-13)
    assert (functions.locate(functions.quadrature[0]) >= 0).all()


@pytest.mark.parametrize("points", [1, 2, 3, 4, 7])
def test_number_of_gauss_points(points: int) -> None:
    functions = grids.Functions(squares(2, grids.Linear()), points=points)
    (x, _), weight = functions.quadrature[0].T, functions.quadrature[1]
    assert len(x) == functions.grid.cells * points**2

    def wrong(p: int) -> float:
        return abs(float((weight * x**p).sum()) * (p + 1) - 1)

    assert max(wrong(p) for p in range(2 * points - 1)) < 1e-13
    assert wrong(2 * points) > 1e-8


def test_rows_are_filled_up() -> None:
    # A corner that lies in one triangle only has other functions than the middle of the mesh; what
    # is left over of a row is marked.
    functions = functions_on(grids.CubicPowellSabin())
    here = functions.evaluate(functions.quadrature[0])
    assert here.function.dtype == np.int32
    assert here.function.max() == functions.count - 1
    empty = here.function < 0
    assert (here.function[empty] == -1).all()
    assert (here.value[empty] == 0).all()
    assert (here.gradient[empty] == 0).all()


@pytest.mark.parametrize("lower", [(0.0, 0.0), (4.5e5, -5.6e6)])
def test_positions_are_those_of_the_grid(lower: tuple[float, float]) -> None:
    functions = functions_on(grids.PowellSabin(), lower=lower)
    low = np.array(lower)
    np.testing.assert_allclose(functions.outline.min(axis=(0, 1)), low)
    np.testing.assert_allclose(functions.outline.max(axis=(0, 1)), low + 1)
    inner, sides = functions.split or (np.empty(0), np.empty(0))
    assert inner.shape == (54, 2) or len(inner) == functions.grid.cells
    assert sides.shape == (len(inner), 3, 2)
    np.testing.assert_array_equal(functions.locate(inner), np.arange(len(inner)))
    triangles = functions.control_triangles
    assert triangles is not None
    np.testing.assert_array_equal(triangles.reshape(-1, 2), functions.control_points)
    found = functions.project(lambda x, y: (x - low[0]) * (y - low[1]))
    assert found.error() < 1e-11
    np.testing.assert_allclose(found.at([(low[0] + 0.25, low[1] + 0.5)]), 0.125, atol=1e-8)


def test_control_triangles_of_cubics_and_others() -> None:
    functions = functions_on(grids.CubicPowellSabin())
    triangles = functions.control_triangles
    assert triangles is not None
    assert isinstance(functions.grid, grids.TriangularGrid)
    vertices = functions.grid.mesh.arrays()[0]
    assert triangles.shape == (len(vertices), 3, 2)
    # Every vertex lies in its triangle.
    edges = np.roll(triangles, -1, axis=1) - triangles
    to = vertices[:, None] - triangles
    side = edges[..., 0] * to[..., 1] - edges[..., 1] * to[..., 0]
    assert ((side > -1e-12).all(axis=1) | (side < 1e-12).all(axis=1)).all()
    for other in (functions_on(grids.Linear()), splines(2)):
        assert other.split is None
        assert other.control_triangles is None


# Grid crossing -----------------------------------------------------------------------------


def hat(functions: grids.Functions, x: list[float]) -> tuple[Any, Any]:
    """Return the function of height 1 at x = 0 and its slope, at points of the strip."""
    middle = np.flatnonzero(functions.control_points[:, 0] == 0)
    here = functions.evaluate([(a, 0.3) for a in x])
    mine = np.isin(here.function, middle)
    slope = (here.gradient[..., 0] * mine).sum(axis=1)
    return (here.value * mine).sum(axis=1), slope


STRIP: dict[str, Any] = {"lower": (-1.0, 0.0), "upper": (1.0, 1.0)}


@pytest.mark.parametrize(
    "grid",
    [
        grids.TriangularGrid(
            mesh=grids.Mesh.squares(columns=2, rows=1, **STRIP), basis=grids.Linear()
        ),
        grids.SplineGrid(**STRIP, spans=(2, 1), degree=(1, 0)),
    ],
    ids=["triangles", "line"],
)
def test_force_of_a_grid_crossing(grid: Any) -> None:
    """VAL-5: one of four equal particles crosses, and a force of -2 V σ appears."""
    functions = grids.Functions(grid)
    volume, stress = 0.5, 3.0
    for second, force in ((-0.01, 0.0), (0.01, -2 * volume * stress)):
        x = [-0.6, second, 0.4, 0.8]
        value, slope = hat(functions, x)
        np.testing.assert_allclose(value, 1 - np.abs(x), atol=1e-14)
        assert (volume * slope * stress).sum() == pytest.approx(force, abs=1e-13)


@pytest.mark.parametrize(
    ("basis", "low", "high"),
    [
        (grids.Linear(), 0.1, 100.0),
        (grids.PowellSabin(), 0.0, 1e-2),
        (grids.CubicPowellSabin(), 0.0, 1e-2),
    ],
    ids=["linear", "powell-sabin", "cubic"],
)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gradients_across_edges(basis: Any, low: float, high: float, seed: int) -> None:
    functions = functions_on(basis, seed)
    assert isinstance(functions.grid, grids.TriangularGrid)
    corners = functions.grid.mesh.corners()
    start, end = corners[:, 0], corners[:, 1]
    middle = 0.6 * start + 0.4 * end
    across = 1e-6 * (end - start)[:, ::-1] * [1, -1]
    inside = functions.locate(middle + across) >= 0
    both = [functions.project(sines).gradient((middle + s * across)[inside]) for s in (1, -1)]
    jump = float(np.abs(both[0] - both[1]).max())
    assert low <= jump <= high


# The compiled module -----------------------------------------------------------------------


def test_the_module_checks_what_it_is_given() -> None:
    from libmpm import _core

    basis = _core.Basis(squares(3, grids.Linear()).specification())
    assert (basis.functions, basis.cells, basis.degree, basis.name) == (9, 8, 1, "linear")
    for call in (
        lambda: basis.evaluate(np.array([[0.5, 0.5], [1.5, 0.25]])),
        lambda: basis.evaluate(np.zeros(2)),
        lambda: basis.quadrature(0),
    ):
        with pytest.raises(libmpm.SceneError):
            call()
    with pytest.raises(libmpm.SceneError, match=r"number 1 at \(1.5, 0.25\) m is outside"):
        basis.evaluate(np.array([[0.5, 0.5], [1.5, 0.25]]))
    assert basis.locate(np.array([[0.5, 0.5], [1.5, 0.25]])).tolist()[1] == -1


# Pictures ----------------------------------------------------------------------------------


@pytest.fixture
def ax() -> Any:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    return figure.subplots()


def test_pictures(ax: Any) -> None:
    functions = functions_on(grids.PowellSabin(), lower=(4.5e5, -5.6e6))
    assert isinstance(functions.grid, grids.TriangularGrid)
    cells = functions.grid.cells
    assert functions.plot_mesh(ax, color="r") is ax
    edges = {
        tuple(sorted(e))
        for t in functions.grid.mesh.triangles
        for e in zip(t, t[1:] + t[:1], strict=True)
    }
    assert len(ax.collections[0].get_segments()) == len(edges)
    functions.plot_split(ax)
    assert len(ax.collections) == 3
    assert len(ax.collections[2].get_segments()) == 6 * cells
    functions.plot_control_triangles(ax)
    assert len(ax.collections) == 5
    assert len(ax.collections[4].get_paths()) == len(functions.grid.mesh.vertices)
    functions.plot_particles(functions.quadrature[0][:10], np.arange(10.0), ax)
    assert len(ax.collections) == 7
    assert len(ax.collections[6].get_offsets()) == 10
    ax.figure.draw_without_rendering()


@pytest.mark.parametrize("make", ALL)
def test_pictures_of_functions(make: Callable[[], grids.Functions], ax: Any) -> None:
    functions = make()
    assert functions.plot(functions.count // 2, ax) is ax
    assert len(ax.collections) == 2  # contours and mesh
    assert any(len(path.vertices) for path in ax.collections[0].get_paths())
    assert len(ax.figure.axes) == 2  # with a scale of colours
    functions.project(sines).plot(ax, levels=5)
    low, high = ax.collections[2].get_clim()
    assert -0.3 < low < 0.1
    assert 0.7 < high < 1.3
    ax.figure.draw_without_rendering()


def test_new_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    found = splines(3).plot_mesh()
    assert found.get_xlabel() == "x [m]"
    assert len(found.collections[0].get_segments()) == 8
    plt.close(found.figure)


def test_pickles() -> None:
    functions = grids.Functions(grids.SplineGrid(lower=(0.0, 0.0), upper=(1.0, 1.0), spans=(2, 2)))
    assert functions.count == 16
    copy = pickle.loads(pickle.dumps(functions))
    assert copy.grid == functions.grid
    np.testing.assert_array_equal(copy.control_points, functions.control_points)
