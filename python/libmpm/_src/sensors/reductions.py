"""From many values to one number: the operations of sensors and their directions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["DIRECTIONS", "OPERATIONS", "along", "of_sums", "reduce"]

Array = NDArray[np.float64]

#: Name -> the operation over values (n,), n > 0. Deviation and variance are those of the values
#: themselves (divided by n).
OPERATIONS: dict[str, Callable[[Array], float]] = {
    "sum": lambda v: float(v.sum()),
    "mean": lambda v: float(v.mean()),
    "min": lambda v: float(v.min()),
    "max": lambda v: float(v.max()),
    "std": lambda v: float(v.std()),
    "variance": lambda v: float(v.var()),
    "range": lambda v: float(v.max() - v.min()),
    "count": lambda v: float(len(v)),
}

#: A component, or those of its values that have one sign.
DIRECTIONS = ("x", "x+", "x-", "y", "y+", "y-", "z", "z+", "z-")


def reduce(values: Array, operation: str) -> float:
    """Return one number of values (n,); of none a count or sum is 0, all others NaN."""
    if len(values) == 0:
        return 0.0 if operation in ("sum", "count") else float("nan")
    return OPERATIONS[operation](values)


def of_sums(sums: Array, count: Array, low: Array, high: Array, operation: str) -> Array:
    """Return what `reduce` does of values whose sums and extremes are known, of any shape.

    NaN, too, where a value is NaN, which its extremes tell. Not for "std" and "variance".
    """
    none = count == 0
    if operation == "count":
        return count.copy()
    if operation == "sum":
        return np.asarray(np.where(none, 0.0, sums + 0 * low))
    with np.errstate(invalid="ignore", divide="ignore"):
        found = {"mean": sums / count, "min": low, "max": high, "range": high - low}[operation]
        return np.asarray(np.where(none, np.nan, found + 0 * low))


def along(values: Array, direction: str) -> Array:
    """Return a component of vectors (n, d): all of it, or the values above or below zero only."""
    component = values[:, "xyz".index(direction[0])]
    if direction.endswith("+"):
        return component[component > 0]
    if direction.endswith("-"):
        return component[component < 0]
    return component
