"""Tables of the errors of projections onto finer and finer grids."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.tables import Tabled
from libmpm._src.base.values import Checker
from libmpm._src.grids.functions import Field, Functions
from libmpm._src.grids.grid import SplineGrid, TriangularGrid

__all__ = ["Convergence", "convergence"]

Grid = TriangularGrid | SplineGrid


@dataclass(frozen=True, repr=False)
class Convergence(Tabled):
    """Errors on finer and finer grids; prints as a table, in Jupyter too.

    Made by `convergence`. Entry k of each tuple belongs to the k-th grid.
    """

    label: ClassVar[str] = "grids.Convergence"

    n: tuple[int, ...]
    """What the caller counts grids by, for instance vertices a side."""
    functions: tuple[int, ...]
    """Numbers of functions."""
    spacing: tuple[float, ...]
    """Shortest edges or spans h of the grids, m."""
    error: tuple[float, ...]
    """L² errors E, unit of the field times m."""

    @property
    def order(self) -> tuple[float, ...]:
        """log(E' / E) / log(h' / h) with E', h' of the grid before; NaN at the first."""
        found = [math.nan]
        for k in range(1, len(self.n)):
            errors, spacings = self.error[k - 1 : k + 1], self.spacing[k - 1 : k + 1]
            if min(errors) > 0 and spacings[0] != spacings[1]:
                found.append(math.log(errors[0] / errors[1]) / math.log(spacings[0] / spacings[1]))
            else:
                found.append(math.nan)
        return tuple(found)

    def to_dict(self) -> dict[str, list[Any]]:
        """Return the columns as lists; a NaN order becomes None."""
        return {
            "n": list(self.n),
            "functions": list(self.functions),
            "spacing": list(self.spacing),
            "error": list(self.error),
            "order": [None if math.isnan(p) else p for p in self.order],
        }

    def _rows(self) -> list[tuple[str, ...]]:
        columns = zip(self.n, self.functions, self.spacing, self.error, self.order, strict=True)
        head: tuple[str, ...] = ("n", "functions", "h (m)", "error", "order")
        return [
            head,
            *(
                (str(n), str(f), f"{h:.5g}", f"{e:.5e}", "" if math.isnan(p) else f"{p:.2f}")
                for n, f, h, e, p in columns
            ),
        ]


@keywords_only("grids.convergence", 3, method=False)
def convergence(
    field: Field,
    grids: Sequence[Grid] | Callable[[int], Grid],
    ns: Sequence[int] | None = None,
    *,
    mass: Literal["consistent", "lumped"] = "consistent",
    points: int | None = None,
) -> Convergence:
    """Project a field onto grids, and return a table of the errors.

    ========  ============  ==============================================================
    argument  default       meaning
    ========  ============  ==============================================================
    field     -             f(x, y) of arrays x, y (q,) in m
    grids     -             grids from coarse to fine, or a function that makes grid n
    ns        1, 2, 3, ...  numbers to tell the grids by, needed with a function
    mass      "consistent"  or "lumped", as in `Functions.project`
    points    degree + 4    Gauss points a direction, as in `Functions`
    ========  ============  ==============================================================

    Raises `SceneError`. Source: de Koster (2018) 3.6, tables 3.1 and 3.2.
    """
    check = Checker("grids.convergence")
    if callable(grids):
        numbers = list(ns) if ns is not None else []
        if not numbers:
            check.fail("ns is missing for a function that makes grids; expected one n a grid")
    else:
        numbers = list(ns) if ns is not None else list(range(1, len(grids) + 1))
        if len(numbers) != len(grids) or not numbers:
            check.fail(f"ns has {len(numbers)} numbers for {len(grids)} grids; expected one a grid")
    check.finish()
    found = []
    for k, n in enumerate(numbers):
        functions = Functions(grids(n) if callable(grids) else grids[k], points=points)
        error = functions.project(field, mass=mass).error()
        found.append((functions.count, functions.grid.spacing, error))
    counts, spacings, errors = zip(*found, strict=True)
    return Convergence(tuple(numbers), counts, spacings, errors)
