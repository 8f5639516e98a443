"""Pictures of meshes, splits, control triangles, functions and particles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.palette import CYCLE
from libmpm._src.base.values import Checker
from libmpm._src.errors import SceneError
from libmpm._src.grids.grid import TriangularGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import ContourSet

    from libmpm._src.grids.functions import Functions

__all__ = [
    "plot_control_triangles",
    "plot_field",
    "plot_function",
    "plot_mesh",
    "plot_particles",
    "plot_split",
]

Floats = npt.NDArray[np.float64]

#: Points of a picture, about; each triangle is cut at most this often into four.
_POINTS, _CUTS = 100_000, 4
#: Points a span of a picture of splines, at most.
_A_SPAN = 16
_THIN = {"color": "0.6", "linewidth": 0.5}


def plot_mesh(functions: Functions, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw the edges of all cells and return the axes; `style` goes to ``LineCollection``."""
    grid = functions.grid
    if isinstance(grid, TriangularGrid):
        vertices, triangles = grid.mesh.arrays()
        edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
        lines = vertices[np.unique(np.sort(edges, axis=1), axis=0)]
    else:
        x, y = _breaks(functions)
        upright = np.stack([np.column_stack([x, np.full_like(x, end)]) for end in y[[0, -1]]], 1)
        level = np.stack([np.column_stack([np.full_like(y, end), y]) for end in x[[0, -1]]], 1)
        lines = np.concatenate([upright, level])
    return _draw_lines(ax, lines, _THIN | style)


def plot_split(functions: Functions, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw the triangles and the lines that cut each into six, de Koster (2018) 3.5.1."""
    inner, sides = _powell_sabin(functions, functions.split)
    assert isinstance(functions.grid, TriangularGrid)  # others have no split
    ends = np.concatenate([functions.grid.mesh.corners(), sides], axis=1)
    lines = np.stack([np.broadcast_to(inner[:, None], ends.shape), ends], axis=2)
    ax = plot_mesh(functions, ax, color="k", linewidth=1.0)
    dashed = {"color": CYCLE[0], "linewidth": 0.5, "linestyle": "--"}
    return _draw_lines(ax, lines.reshape(-1, 2, 2), dashed | style)


def plot_control_triangles(functions: Functions, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw the mesh and the control triangle of each vertex; `style` goes to ``PolyCollection``."""
    from matplotlib.collections import PolyCollection

    corners = _powell_sabin(functions, functions.control_triangles)
    ax = plot_mesh(functions, ax)
    look: dict[str, Any] = {"facecolor": "none", "edgecolor": CYCLE[1], "linewidth": 1.0} | style
    ax.add_collection(PolyCollection(list(corners), **look))
    ax.autoscale_view()
    return ax


def plot_function(functions: Functions, number: int, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw function `number`, 0 to count - 1, over the mesh and return the axes."""
    check = Checker("grids.Functions.plot")
    number = check.integer("number", number)
    if number >= functions.count:
        check.fail(f"number is {number}; expected 0 to {functions.count - 1}")
    check.finish()
    coefficients = np.zeros(functions.count)
    coefficients[number] = 1
    return plot_field(functions, coefficients, ax, **style)


def plot_field(
    functions: Functions, coefficients: Floats, ax: Axes | None = None, **style: Any
) -> Axes:
    """Draw Σ c_i φ_i as filled contours over the mesh and return the axes.

    `coefficients` (count,); `style` goes to ``Axes.tricontourf`` or ``contourf``.
    """
    if coefficients.ndim != 1:
        raise SceneError(
            f"grids.Projection.plot: the field has {coefficients.shape[1]} columns; expected one; "
            "project it alone"
        )
    ax = _axes(ax)
    look: dict[str, Any] = {"levels": 16, "cmap": "viridis"} | style

    def values(position: Floats) -> Floats:
        here = functions.evaluate(position)
        return np.asarray((coefficients[here.function] * here.value).sum(axis=1))

    if isinstance(functions.grid, TriangularGrid):
        from matplotlib.tri import Triangulation, UniformTriRefiner

        vertices, triangles = functions.grid.mesh.arrays()
        often = np.log(_POINTS / len(triangles)) / np.log(4)
        cuts = int(np.clip(often, 0, _CUTS))
        # Far from the origin, rounding of the halved edges would put points outside.
        low = np.array(functions.grid.lower)
        x, y = (vertices - low).T
        fine = UniformTriRefiner(Triangulation(x, y, triangles))
        found = fine.refine_triangulation(subdiv=cuts)
        position = np.column_stack([found.x, found.y]) + low
        drawn: ContourSet = ax.tricontourf(
            position[:, 0], position[:, 1], found.triangles, values(position), **look
        )
    else:
        each = int(np.clip(np.sqrt(_POINTS / functions.grid.cells), 1, _A_SPAN))
        x, y = (_finer(breaks, each) for breaks in _breaks(functions))
        position = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
        drawn = ax.contourf(x, y, values(position).reshape(len(y), len(x)), **look)
    ax.figure.colorbar(drawn, ax=ax)
    return plot_mesh(functions, ax)


def plot_particles(
    position: npt.ArrayLike, values: npt.ArrayLike | None = None, ax: Axes | None = None
) -> Axes:
    """Draw particles (n, 2) in m, coloured by values (n,) if given, and return the axes."""
    places = np.asarray(position, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 2:
        raise SceneError(f"plot_particles: position has shape {places.shape}; expected (n, 2) in m")
    if values is not None and np.shape(values) != (len(places),):
        raise SceneError(
            f"plot_particles: values have shape {np.shape(values)} for {len(places)} particles; "
            f"expected ({len(places)},)"
        )
    ax = _axes(ax)
    drawn = ax.scatter(places[:, 0], places[:, 1], c=CYCLE[0] if values is None else values, s=4)
    if values is not None:
        ax.figure.colorbar(drawn, ax=ax)
    return ax


def _axes(ax: Axes | None) -> Axes:
    """Return the given axes, or new ones with equal scales."""
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.subplots()[1]
        ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    return ax


def _draw_lines(ax: Axes | None, lines: Floats, style: dict[str, Any]) -> Axes:
    from matplotlib.collections import LineCollection

    ax = _axes(ax)
    ax.add_collection(LineCollection(list(lines), **style))
    ax.autoscale_view()
    return ax


def _powell_sabin(functions: Functions, found: Any) -> Any:
    if found is None:
        raise SceneError(
            f"{functions.label}: {functions!r} has no split and no control triangles; expected "
            "those of grids.PowellSabin or grids.CubicPowellSabin"
        )
    return found


def _breaks(functions: Functions) -> list[Floats]:
    """Return the knots of a spline grid on each axis without repetition, m."""
    knots = functions.grid.specification()["knots"]
    return [np.unique(k) + low for k, low in zip(knots, functions.grid.lower, strict=True)]


def _finer(breaks: Floats, each: int) -> Floats:
    """Return `each` equal parts of every span."""
    parts = np.linspace(0, 1, each, endpoint=False)
    inside = breaks[:-1, None] + parts * np.diff(breaks)[:, None]
    return np.append(inside.ravel(), breaks[-1])
