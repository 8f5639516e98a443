"""Columns of tables, whatever holds them, and terms made of columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.studies.analysis.record import Floats

__all__ = ["Missing", "Table", "Term", "columns", "evaluate", "parse", "sample"]

#: Result of a study, mapping of arrays, pandas frame, NumPy records, or list of dictionaries.
Table = Any
Missing = Literal["refuse", "drop"]


@dataclass(frozen=True)
class _Transform:
    """A function of a column, and where it has values."""

    function: Callable[[Floats], Floats]
    defined: Callable[[Floats], npt.NDArray[np.bool_]]
    domain: str


_ALL = _Transform(np.asarray, np.isfinite, "numbers")
#: What a term may begin with; Bonus (2023) 7.3 and 10.4 use the first three.
_TRANSFORMS = {
    "sqrt": _Transform(np.sqrt, lambda x: x >= 0, "values ≥ 0"),
    "log": _Transform(np.log, lambda x: x > 0, "values > 0"),
    "inverse sqrt": _Transform(lambda x: 1 / np.sqrt(x), lambda x: x > 0, "values > 0"),
    "inverse": _Transform(lambda x: 1 / x, lambda x: x != 0, "values other than 0"),
    "square": _Transform(np.square, np.isfinite, "numbers"),
}


@dataclass(frozen=True)
class Term:
    """A column or a function of one: "c", "sqrt theta15", "log n", "inverse sqrt L_x"."""

    name: str
    column: str
    transform: str = ""


def columns(check: Checker, table: Table, name: str = "table") -> dict[str, Any]:
    """Return the columns of a table by name, not yet converted."""
    found: dict[str, Any] | None = None
    if isinstance(table, Mapping):
        found = {str(key): item for key, item in table.items()}
    elif hasattr(table, "columns") and hasattr(table, "__getitem__"):
        # A pandas frame, or the result of a study.
        found = {str(key): np.asarray(table[key]) for key in table.columns}
    elif isinstance(table, np.ndarray) and table.dtype.names:
        found = {key: np.atleast_1d(table)[key] for key in table.dtype.names}
    elif isinstance(table, list | tuple) and all(isinstance(row, Mapping) for row in table):
        keys = dict.fromkeys(key for row in table for key in row)
        found = {str(key): [row.get(key) for row in table] for key in keys}
    if not found:
        check.fail(
            f"{name} is {shown(table, 80)}; expected the result of a study, a mapping of "
            "columns, a "
            "pandas frame, NumPy records or a list of dictionaries, with one row or more"
        )
    return found or {}


def parse(check: Checker, text: Any, names: Iterable[str]) -> Term | None:
    """Return the term that a text means, for a table with columns `names`."""
    names = list(names)
    if not isinstance(text, str) or not text.strip():
        check.fail(f"term is {shown(text)}; expected a text such as 'c' or 'log n'")
        return None
    name = " ".join(text.split())
    if name in names:
        return Term(name, name)
    # The longest first: "inverse sqrt x" is no inverse of a column "sqrt x".
    for transform in sorted(_TRANSFORMS, key=len, reverse=True):
        column = name.removeprefix(transform + " ")
        if column != name and column in names:
            return Term(name, column, transform)
    column = name.rpartition(" ")[2]
    known = f"{', '.join(_TRANSFORMS)} or nothing before a column"
    if column in names:
        check.fail(f"term '{name}' begins with no known function; expected {known}")
    else:
        check.fail(f"no column '{column}' for the term '{name}'; {nearest(column, names)}")
    return None


def evaluate(check: Checker, found: Mapping[str, Any], term: Term) -> Floats:
    """Return the values of a term, (n,); NaN in rows without a number."""
    given = np.atleast_1d(np.asarray(found[term.column]))
    try:
        if given.ndim != 1 or given.dtype.kind in "SUmM":
            raise TypeError
        values = given.astype(np.float64)
    except (TypeError, ValueError):
        check.fail(
            f"column '{term.column}' holds {given.ravel()[:3].tolist()!r:.60}; expected numbers "
            "(n,); leave it out"
        )
        return np.empty(0)
    transform = _TRANSFORMS.get(term.transform, _ALL)
    outside = ~transform.defined(values) & np.isfinite(values)
    if outside.any():
        worst = values[outside][0]
        check.fail(
            f"'{term.name}' of {worst:g} does not exist, rows {marked(outside)}; expected "
            f"{transform.domain} in column '{term.column}'; leave these rows out or choose another "
            "term"
        )
        values = np.where(outside, np.nan, values)
    return np.asarray(transform.function(values))


def sample(
    check: Checker, table: Table, terms: Sequence[str], missing: Missing = "refuse"
) -> tuple[list[Term], Floats, npt.NDArray[np.bool_]]:
    """Return terms, their values (rows, terms), and which rows of the table those are.

    Rows in which a term is not a finite number are refused, or dropped. Raises `SceneError`.
    """
    check.choice("missing", missing, ("refuse", "drop"))
    found = columns(check, table)
    check.finish()
    parsed = [term for text in terms if (term := parse(check, text, found)) is not None]
    check.finish()
    values = [evaluate(check, found, term) for term in parsed]
    check.finish()
    lengths = {term.name: len(v) for term, v in zip(parsed, values, strict=True)}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"{name} {n}" for name, n in lengths.items())
        check.fail(f"columns have different lengths ({text}); expected one value a row in each")
        check.finish()
    matrix = np.column_stack(values)
    whole = np.asarray(np.isfinite(matrix).all(axis=1))
    if missing == "refuse":
        for term, row in zip(parsed, matrix.T, strict=True):
            if not np.isfinite(row).all():
                check.fail(
                    f"'{term.name}' is not a finite number in rows {marked(~np.isfinite(row))}; "
                    "expected numbers; repeat what failed, or leave such rows out with "
                    'missing="drop"'
                )
        check.finish()
    return parsed, matrix[whole], whole
