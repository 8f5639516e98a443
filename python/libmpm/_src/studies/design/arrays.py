"""Numbers and arrays of numbers from callers, checked against one rule."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.values import Checker, shown

__all__ = ["Floats", "numbers"]

Floats = npt.NDArray[np.float64]


def numbers(
    check: Checker,
    name: str,
    value: Any,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    lower_open: bool = False,
    whole: bool = False,
    unit: str = "",
    remedy: str = "",
) -> Floats:
    """Return a number or a table of numbers as float64, shape () or its own; all within the range.

    What is wrong with the first bad entry is reported to `check`; the result is then NaN.
    """
    try:
        array = np.asarray(value)
    except (OverflowError, RecursionError, ValueError):  # rows of different lengths, deep nests
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "iuf":
        tail = f" in {unit}" if unit and unit != "1" else ""
        check.fail(f"{name} is {shown(value, 80)}; expected a number or an array of numbers{tail}")
        return np.array(np.nan)
    array = array.astype(np.float64)
    bad = ~np.isfinite(array) | (array > upper)
    bad |= (array <= lower) if lower_open else (array < lower)
    if bad.any():
        place, entry = _first(name, array, bad)
        rule: dict[str, Any] = {"lower": lower, "upper": upper, "lower_open": lower_open}
        check.number(place, entry, **rule, unit=unit, remedy=remedy)
        return np.array(np.nan)
    if whole and (array != np.round(array)).any():
        place, entry = _first(name, array, array != np.round(array))
        check.fail(f"{place} is {entry:g}; expected a whole number{'; ' if remedy else ''}{remedy}")
        return np.array(np.nan)
    return array


def _first(name: str, array: Floats, bad: npt.NDArray[np.bool_]) -> tuple[str, float]:
    """Return the first bad entry and its name, ``name`` or ``name[2, 0]``."""
    place = np.unravel_index(int(np.argmax(bad)), array.shape)
    indices = ", ".join(str(int(i)) for i in place)
    return (f"{name}[{indices}]" if indices else name), float(array[place])
