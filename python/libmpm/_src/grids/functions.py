"""The functions of a grid as NumPy sees them: values, gradients, integrals and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, keywords_only, shown
from libmpm._src.errors import SceneError
from libmpm._src.grids import plots
from libmpm._src.grids.grid import SplineGrid, TriangularGrid
from libmpm._src.run import backends

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from libmpm._core import Basis
    from libmpm._src.grids.projection import Projection

__all__ = ["Evaluation", "Field", "Functions", "places", "sampled"]

Floats = npt.NDArray[np.float64]
#: A field f(x, y) of coordinates (n,) in m: an array (n,) or (n, k), or one number for all.
Field: TypeAlias = Callable[[Floats, Floats], npt.ArrayLike]

#: Points evaluated at a time, which bounds the memory of an integral.
_AT_ONCE = 1 << 16
#: Points a direction beyond the degree: the product of two functions and of a field that is nearly
#: a polynomial of degree 6 on a piece.
_MORE_POINTS = 4


class Evaluation(NamedTuple):
    """The functions that live at n points; a row with fewer than k is filled up with -1 and 0."""

    function: npt.NDArray[np.int32]
    """Their numbers, (n, k)."""
    value: Floats
    """Their values, (n, k)."""
    gradient: Floats
    """Their gradients, (n, k, 2) in 1/m."""


class Functions:
    """The functions φ_i of a `TriangularGrid` or a `SplineGrid`, with Σ φ_i = 1.

    =========  ====  ======  ===========================================================
    parameter  unit  range   meaning
    =========  ====  ======  ===========================================================
    grid       -     -       the grid; its `mass` plays no part here
    points     -     ≥ 1     Gauss points a direction on each piece of a cell, by default
                             the functions' degree + 4; integrals of polynomials of degree
                             2 points - 2 are exact
    =========  ====  ======  ===========================================================

    Positions are those of the grid, in m. Raises `SceneError`. Source: de Koster (2018) 3.
    """

    label: ClassVar[str] = "grids.Functions"

    @keywords_only("grids.Functions", 1)
    def __init__(self, grid: TriangularGrid | SplineGrid, *, points: int | None = None) -> None:
        check = Checker(self.label)
        wanted = "a grids.TriangularGrid or a grids.SplineGrid"
        check.instance("grid", grid, (TriangularGrid, SplineGrid), wanted)
        if points is not None:
            points = check.integer("points", points, lower=1, remedy="leave it out")
        check.finish()
        self._grid = grid
        self._lower = np.array(grid.lower)
        self._points = self._basis.degree + _MORE_POINTS if points is None else points

    @cached_property
    def _basis(self) -> Basis:
        found: Basis = backends.core().Basis(self._grid.specification())
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is compiled; it is made again when first asked for."""
        kept = ("_grid", "_lower", "_points")
        return {key: self.__dict__[key] for key in kept}

    def __repr__(self) -> str:
        """Return a short description."""
        cells = self._basis.cells
        return f"<{self.label}: {self.count} of {self._basis.name} over {cells} cells>"

    @property
    def grid(self) -> TriangularGrid | SplineGrid:
        """The grid."""
        return self._grid

    @property
    def count(self) -> int:
        """Number of functions."""
        return int(self._basis.functions)

    @property
    def control_points(self) -> Floats:
        """Points Q_i with Σ Q_i φ_i(x) = x, (count, 2) in m.

        A coefficient belongs there: c_i = f(Q_i) reproduces every linear f. An axis of degree 0 has
        no such points; its middles of spans stand for them.
        """
        return np.asarray(self._basis.control_points() + self._lower)

    @property
    def control_triangles(self) -> Floats | None:
        """Control triangles of the vertices, (v, 3, 2) in m; None if not Powell-Sabin."""
        found = self._basis.control_triangles()
        return None if found is None else np.asarray(found + self._lower)

    @property
    def split(self) -> tuple[Floats, Floats] | None:
        """Inner points (m, 2) of the triangles and points on their sides (m, 3, 2), in m.

        None if not Powell-Sabin. Side k leads from corner k to corner k + 1.
        """
        found = self._basis.split()
        return None if found is None else (found[0] + self._lower, found[1] + self._lower)

    @property
    def outline(self) -> Floats:
        """Start and end of the pieces of the outline, (k, 2, 2) in m."""
        return np.asarray(self._basis.outline() + self._lower)

    def locate(self, position: npt.ArrayLike) -> npt.NDArray[np.int32]:
        """Return the cells (n,) of positions (n, 2) in m, -1 for those outside."""
        return self._basis.locate(places(self.label, position) - self._lower)

    @keywords_only("grids.Functions.evaluate", 1)
    def evaluate(self, position: npt.ArrayLike) -> Evaluation:
        """Return the functions that live at positions (n, 2) in m; see `Evaluation`.

        On an edge across which gradients jump, those of one side are returned. Raises `SceneError`
        for positions outside.
        """
        given = places(self.label, position)
        outside = self._basis.locate(given - self._lower) < 0
        if outside.any():
            x, y = given[int(np.argmax(outside))].tolist()
            raise SceneError(
                f"{self.label}: positions {marked(outside)} lie outside the grid, the first at "
                f"({x:g}, {y:g}) m; expected all inside; remove them or enlarge the grid"
            )
        return self._evaluate(given - self._lower)

    def _evaluate(self, relative: Floats) -> Evaluation:
        """Return the functions at positions relative to `lower`, all inside."""
        return Evaluation(*self._basis.evaluate(relative))

    @cached_property
    def quadrature(self) -> tuple[Floats, Floats]:
        """Positions (q, 2) in m and weights (q,) in m² for integrals over the domain."""
        position, weight = self._basis.quadrature(self._points)
        return position + self._lower, weight

    def batches(self, position: Floats) -> Iterator[tuple[slice, Evaluation]]:
        """Evaluate at positions (n, 2) in m, all inside, some rows at a time."""
        for first in range(0, len(position), _AT_ONCE):
            rows = slice(first, min(first + _AT_ONCE, len(position)))
            yield rows, self._evaluate(position[rows] - self._lower)

    @keywords_only("grids.Functions.project", 1)
    def project(
        self,
        field: Field | npt.ArrayLike,
        *,
        position: npt.ArrayLike | None = None,
        weight: npt.ArrayLike | None = None,
        mass: Literal["consistent", "lumped"] = "consistent",
    ) -> Projection:
        """Return the field Σ c_i φ_i that is closest to a field or to particles' values.

        =========  =======  =============  =================================================
        argument   unit     shape          meaning
        =========  =======  =============  =================================================
        field      any      (n,) (n, k)    f(x, y) of arrays x, y (q,) in m, or the values
                                           of n particles
        position   m        (n, 2)         places of the particles, if they are projected
        weight     any      (n,), ≥ 0      their weights, with `position`: volumes, masses
        mass       -        -              "consistent" or "lumped"
        =========  =======  =============  =================================================

        "consistent" solves M c = b with M_ij = ∫ φ_i φ_j and b_i = ∫ f φ_i, over particles with
        M_ij = Σ_p w_p φ_i φ_j and b_i = Σ_p w_p f_p φ_i: the least squares of the difference.
        "lumped" takes c_i = b_i / Σ_j M_ij, which for Powell-Sabin splines is not even exact for
        linear fields. Either keeps Σ_p w_p f_p. Functions that no particle sees get c_i = 0. Needs
        scipy: ``pip install libmpm[triangular]``. Raises `SceneError`, also for particles that do
        not determine the coefficients. Source: de Koster (2018) 2.3, 3.6 and A.2.
        """
        from libmpm._src.grids.projection import project

        return project(self, field, position, weight, mass)

    def plot(self, number: int, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw one function as filled contours into matplotlib axes, and return the axes.

        `number` is 0 to count - 1; `style` goes to ``Axes.tricontourf`` or ``contourf``. New axes
        are made by default, here as in the other plots. Raises `SceneError`.
        """
        return plots.plot_function(self, number, ax, **style)

    def plot_mesh(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the cells' edges; `style` goes to ``LineCollection``."""
        return plots.plot_mesh(self, ax, **style)

    def plot_split(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the triangles and their six pieces; raises `SceneError` if not Powell-Sabin."""
        return plots.plot_split(self, ax, **style)

    def plot_control_triangles(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the vertices' control triangles; raises `SceneError` if not Powell-Sabin."""
        return plots.plot_control_triangles(self, ax, **style)

    @keywords_only("grids.Functions.plot_particles", 3)
    def plot_particles(
        self, position: npt.ArrayLike, values: npt.ArrayLike | None = None, ax: Axes | None = None
    ) -> Axes:
        """Draw the cells and particles (n, 2) in m, coloured by their values (n,) if given."""
        return plots.plot_particles(position, values, self.plot_mesh(ax))


def places(label: str, position: npt.ArrayLike) -> Floats:
    """Return positions as an array (n, 2); raises `SceneError`."""
    try:
        array = np.asarray(position, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise SceneError(
            f"{label}: position is not a table of numbers: {shown(position, 80)}; expected "
            "(n, 2) in m"
        ) from None
    if array.ndim != 2 or array.shape[1] != 2:
        raise SceneError(f"{label}: position has shape {array.shape}; expected (n, 2) in m")
    return array


def sampled(label: str, field: Field, position: Floats) -> Floats:
    """Return the values (n,) or (n, k) of a field at positions (n, 2) in m."""
    found = np.asarray(field(position[:, 0], position[:, 1]), dtype=np.float64)
    if found.ndim == 0:
        found = np.full(len(position), found)
    if found.ndim > 2 or len(found) != len(position):
        raise SceneError(
            f"{label}: field(x, y) has shape {found.shape} for {len(position)} points; expected "
            "(n,) or (n, k); write it with NumPy's functions of arrays"
        )
    wrong = ~np.isfinite(found.reshape(len(found), -1)).all(axis=1)
    if wrong.any():
        x, y = position[int(np.argmax(wrong))].tolist()
        raise SceneError(f"{label}: field({x:g}, {y:g}) is not finite; expected numbers everywhere")
    return found
