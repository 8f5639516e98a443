"""The Pareto front of rows that have an error and a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

__all__ = ["front", "is_rated", "least"]

Row = Mapping[str, Any]


def is_rated(row: Row) -> bool:
    """Tell whether a row has a finite error and a finite time, so that it can be compared."""
    return all(
        isinstance(row.get(k), int | float) and math.isfinite(row[k]) for k in ("error", "time")
    )


def front(rows: Sequence[Row]) -> list[int]:
    """Return the numbers of the rows that no other one beats, from the fastest on.

    One row beats another if it is better in error or time and no worse in the other. Rows that are
    equal in both do not beat each other. Rows without error or time are left out.
    """
    order = sorted(
        (i for i, row in enumerate(rows) if is_rated(row)),
        key=lambda i: (rows[i]["time"], rows[i]["error"], i),
    )
    found: list[int] = []
    best, at = math.inf, math.nan
    for i in order:
        error, time = rows[i]["error"], rows[i]["time"]
        if error < best or (error == best and time == at):
            found.append(i)
            best, at = error, time
    return found


def least(
    rows: Sequence[Row], wanted: str, bounded: str, most: float
) -> tuple[Row | None, Row | None]:
    """Return the row of the least `wanted` among those with `bounded` ≤ `most`, and the nearest.

    The first is None where no row is within; the second is then the row of the least `bounded`, or
    None where no row is rated at all.
    """
    rated = [row for row in rows if is_rated(row)]
    within = [row for row in rated if row[bounded] <= most]
    key: Callable[[Row], tuple[float, float]] = lambda row: (row[wanted], row[bounded])  # noqa: E731
    if within:
        return min(within, key=key), None
    return None, min(rated, key=lambda row: (row[bounded], row[wanted]), default=None)
