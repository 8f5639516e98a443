"""The register of formulas: one declaration checks arguments, documents and tabulates them."""

from __future__ import annotations

import functools
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, ParamSpec, TypeAlias, TypeVar

import numpy as np

from libmpm._src.base.arguments import wrong_arguments
from libmpm._src.base.tables import text_table
from libmpm._src.base.values import Checker, warn
from libmpm._src.errors import ArgumentError, SceneError
from libmpm._src.studies.design.arrays import Floats, numbers

__all__ = ["Example", "Formula", "Numbers", "Symbol", "formula", "formula_table", "formulas"]

P = ParamSpec("P")
T = TypeVar("T")

#: What a formula takes: a number, or an array that broadcasts with its other arguments.
Numbers: TypeAlias = float | Floats

_registered: dict[str, Formula] = {}


@dataclass(frozen=True)
class Symbol:
    """An argument of a formula."""

    symbol: str
    """How the expression writes it."""
    unit: str
    """SI unit, "1" for a pure number."""
    meaning: str
    """What it is, in words."""
    lower: float = -math.inf
    """Least possible value; less raises `SceneError`."""
    upper: float = math.inf
    """Largest possible value; more raises `SceneError`."""
    lower_open: bool = False
    """True if `lower` itself is impossible."""
    whole: bool = False
    """True for counts."""
    stated: tuple[float, float] = (-math.inf, math.inf)
    """Range that the source speaks of; outside a `ModelWarning` is issued."""

    @property
    def range(self) -> str:
        """The possible values in words, for instance "> 0"."""
        rules = []
        if self.lower > -math.inf:
            rules.append(f"{'>' if self.lower_open else '≥'} {self.lower:g}")
        if self.upper < math.inf:
            rules.append(f"≤ {self.upper:g}")
        if self.whole:
            rules.append("whole")
        return ", ".join(rules) or "any"


@dataclass(frozen=True)
class Example:
    """A worked number."""

    arguments: Mapping[str, float]
    """What goes in, SI units."""
    result: str
    """What comes out, rounded to the digits written here."""
    derived: bool = False
    """True if worked out here, False if the source prints it or its digest has checked it."""

    @property
    def tolerance(self) -> float:
        """Half a unit of the last digit of `result`."""
        exponent = Decimal(self.result).as_tuple().exponent
        assert isinstance(exponent, int)  # only infinities and their like have none
        return 0.5 * 10.0**exponent


@dataclass(frozen=True)
class Formula:
    """A design formula as the register holds it; see `formulas`."""

    name: str
    """Name of the function in `libmpm.design`."""
    expression: str
    """The formula."""
    unit: str
    """SI unit of the result."""
    symbols: Mapping[str, Symbol]
    """The function's arguments."""
    validity: str
    """Where the formula holds."""
    source: str
    """Where it is from."""
    examples: tuple[Example, ...]
    """Worked numbers; tests compare the function with them."""
    function: Callable[..., Any]
    """The function itself."""


def formula(
    expression: str,
    *,
    unit: str,
    symbols: Mapping[str, Symbol],
    validity: str,
    source: str,
    examples: Sequence[Example],
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Register a function of keyword arguments as a formula.

    It receives float64 arrays that have been checked; its callers get a float where all arguments
    are plain numbers, otherwise an array of the common shape.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        name = function.__name__
        plain: Callable[..., Any] = function
        signature = inspect.signature(function)
        names = list(signature.parameters)
        required = [k for k, p in signature.parameters.items() if p.default is p.empty]
        assert names == list(symbols), name

        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> T:
            problems = wrong_arguments(f"design.{name}", names, required, len(args), 0, kwargs)
            if problems:
                raise ArgumentError(problems)
            given = signature.bind(*args, **kwargs)
            given.apply_defaults()
            arrays = _checked(name, given.arguments, symbols)
            result = plain(**arrays)
            found: T = result.item() if result.ndim == 0 else result
            return found

        found = Formula(
            name, expression, unit, dict(symbols), validity, source, tuple(examples), checked
        )
        checked.__doc__ = _described(inspect.cleandoc(function.__doc__ or ""), found)
        _registered[name] = found
        return checked

    return decorate


def formulas() -> dict[str, Formula]:
    """Return every formula of `libmpm.design` by the name of its function.

    Each entry has `expression`, `unit`, `symbols`, `validity`, `source`, `examples` and
    `function`.
    """
    return dict(_registered)


def _checked(
    name: str, arguments: Mapping[str, Any], symbols: Mapping[str, Symbol]
) -> dict[str, Floats]:
    """Return the arguments as arrays; raises `SceneError` with every impossible value."""
    check = Checker(f"design.{name}")
    arrays: dict[str, Floats] = {}
    for key, symbol in symbols.items():
        rule: dict[str, Any] = {"lower": symbol.lower, "upper": symbol.upper}
        rule |= {"lower_open": symbol.lower_open, "whole": symbol.whole, "unit": symbol.unit}
        arrays[key] = numbers(check, key, arguments[key], **rule)
    check.finish()
    try:
        np.broadcast_shapes(*(a.shape for a in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{key} {a.shape}" for key, a in arrays.items())
        raise SceneError(
            f"design.{name}: the arguments have shapes {shapes}; expected shapes that broadcast"
        ) from None
    for key, symbol in symbols.items():
        low, high = symbol.stated
        outside = (arrays[key] < low) | (arrays[key] > high)
        if outside.any():
            entry = float(arrays[key][outside].flat[0])
            stated = f"{low:g} to {high:g}" if low > symbol.lower else f"up to {high:g}"
            warn([f"design.{name}: {key} is {entry:g}; the source speaks of {stated}"])
    return arrays


def _described(summary: str, entry: Formula) -> str:
    """Return the docstring: the summary, the arguments, and what the register knows."""
    rows = [("argument", "symbol", "unit", "range", "meaning")]
    rows += [(k, s.symbol, s.unit, s.range, s.meaning) for k, s in entry.symbols.items()]
    worked = "; ".join(_worked(entry, example) for example in entry.examples)
    unit = "a pure number" if entry.unit == "1" else f"a float in {entry.unit}"
    return "\n".join(
        [
            summary,
            "",
            f"    {entry.expression}",
            "",
            text_table(rows, flush="left", ruled=True),
            "",
            *_filled(
                f"Returns {unit}, or an array of the arguments' common shape. Raises `SceneError`.",
                f"Valid: {entry.validity}.",
                f"Source: {entry.source}.",
                f"Worked: {worked}.",
            ),
        ]
    )


def _filled(*paragraphs: str) -> list[str]:
    return [line for p in paragraphs for line in textwrap.wrap(p, 96)]


def _worked(entry: Formula, example: Example) -> str:
    """Return the example as text, for instance "m 2.4525, k 8e+06: 1.107e-3 s"."""
    given = ", ".join(f"{entry.symbols[k].symbol} {v:.7g}" for k, v in example.arguments.items())
    unit = "" if entry.unit == "1" else f" {entry.unit}"
    return f"{given}: {example.result}{unit}{' (derived)' if example.derived else ''}"


def formula_table() -> str:
    """Return the register as a table in Markdown, the one of the documentation."""
    lines = [
        "| function | formula | symbols | validity | source | worked number |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for entry in _registered.values():
        symbols = "; ".join(
            f"{s.symbol} {s.meaning}{'' if s.unit == '1' else f' [{s.unit}]'}, `{key}`"
            for key, s in entry.symbols.items()
        )
        unit = "" if entry.unit == "1" else f" [{entry.unit}]"
        worked = "; ".join(_worked(entry, example) for example in entry.examples)
        cells = (f"`{entry.name}`", entry.expression + unit, symbols, entry.validity)
        text = (c.replace("|", "\\|") for c in (*cells, entry.source, worked))
        lines.append(f"| {' | '.join(text)} |")
    return "\n".join(lines) + "\n"
