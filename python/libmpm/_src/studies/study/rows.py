"""Rows of parameters from whatever table they come in, and the digest that names a case."""

from __future__ import annotations

import hashlib
import inspect
import json
import math
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from libmpm._src.base.values import Value, nearest, plain, shown
from libmpm._src.errors import SceneError
from libmpm._src.studies.study.record import is_row

__all__ = ["accepts", "call_with", "canonical", "describe", "digest", "lacking", "take_rows"]

#: Hexadecimal digits of a digest: 64 bits, so that 10 million cases meet with a chance of 3e-6.
_DIGITS = 16
#: Kinds of arguments that can be given by name.
_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
#: The folder of libmpm.
_PACKAGE = Path(__file__).parents[3]
#: The folder of Python's own modules.
_PYTHON = Path(inspect.__file__).parent


def take_rows(label: str, rows: Any) -> list[dict[str, Any]]:
    """Return a table as one dictionary of plain Python values a row.

    `rows` is a sequence of mappings, a NumPy array with named columns, or a data frame of pandas
    or polars. Raises `SceneError` with all problems; `label` names the object in them.
    """
    if isinstance(rows, Mapping):
        raise SceneError(
            f"{label}: rows is one mapping; expected a sequence of mappings, one a case; write "
            "[row], or studies.full_factorial(...) for all combinations of lists"
        )
    problems: list[str] = []
    taken = []
    for number, row in enumerate(_records(label, rows)):
        if not isinstance(row, Mapping):
            problems.append(
                f"{label}: row {number} is {shown(row, 60)}; expected a mapping of names to values"
            )
            continue
        if not is_row(dict(row)):
            problems.append(f"{label}: row {number} is nested too deep; expected plain values")
            continue
        made = {}
        for name, item in row.items():
            where = f"{label}: row {number}: {name}"
            if not isinstance(name, str) or not name:
                problems.append(
                    f"{label}: row {number} has the name {shown(name)}; expected a text"
                )
                continue
            made[name] = _value(where, item, problems)
        taken.append(made)
    if problems:
        raise SceneError(problems)
    return taken


def _records(label: str, rows: Any) -> Iterable[Any]:
    """Return the rows of a table as an iterable of mappings."""
    names = getattr(getattr(rows, "dtype", None), "names", None)
    if names:
        return [dict(zip(names, row.tolist(), strict=True)) for row in rows.reshape(-1)]
    if hasattr(rows, "to_dicts"):  # polars
        return list(rows.to_dicts())
    if hasattr(rows, "columns") and hasattr(rows, "to_dict"):  # pandas
        return list(rows.to_dict("records"))
    if isinstance(rows, str) or not isinstance(rows, Iterable):
        raise SceneError(
            f"{label}: rows is {shown(rows, 60)}; expected mappings, a NumPy array with "
            "named columns, "
            "or a data frame"
        )
    return rows


def _value(where: str, item: Any, problems: list[str]) -> Any:
    """Return `item` without NumPy's types; report what a file could not hold."""
    if hasattr(item, "tolist") and hasattr(item, "dtype"):
        item = item.tolist()
    if item is None or isinstance(item, bool | int | str | Value):
        return item
    if isinstance(item, float):
        if not math.isfinite(item):
            problems.append(
                f"{where} is {item}; expected a finite number; leave the name out of the row to "
                "take the factory's default"
            )
        return item
    if isinstance(item, tuple | list):
        made = [_value(f"{where}[{i}]", x, problems) for i, x in enumerate(item)]
        return made if isinstance(item, list) else tuple(made)
    if isinstance(item, Mapping):
        return {str(k): _value(f"{where}[{k!r}]", x, problems) for k, x in item.items()}
    problems.append(
        f"{where} is {shown(item, 60)}; expected numbers, texts, lists of them or values of "
        "libmpm, "
        "which files can hold; let the factory make the object from them"
    )
    return None


def canonical(content: Any, what: str = "the case") -> str:
    """Return the one JSON text of `content`; raises `SceneError` for what JSON cannot hold."""
    made = plain(content)
    try:
        return json.dumps(made, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        problems: list[str] = []
        _refuse(made, what, problems)
        raise SceneError(problems or f"{what}: {error}; expected what JSON can hold") from error


def _refuse(item: Any, where: str, problems: list[str]) -> None:
    """Name the parts of `item` that JSON cannot hold."""
    if isinstance(item, dict):
        for key, part in item.items():
            _refuse(part, f"{where}: {key}", problems)
    elif isinstance(item, list):
        for i, part in enumerate(item):
            _refuse(part, f"{where}[{i}]", problems)
    elif isinstance(item, float) and not math.isfinite(item):
        problems.append(f"{where} is {item}; expected a finite number")
    elif item is not None and not isinstance(item, bool | int | float | str):
        problems.append(
            f"{where} is {shown(item, 60)}, which no file can hold and no digest can name; "
            "give it as "
            "plain values, for instance a libmpm.Field of formulas or a libmpm.TimeTable"
        )


def digest(content: Any, what: str = "the case") -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of the canonical JSON."""
    return hashlib.sha256(canonical(content, what).encode()).hexdigest()[:_DIGITS]


def accepts(function: Callable[..., Any], names: Iterable[str], label: str) -> list[str]:
    """Return what keeps `function` from being called with keywords `names`."""
    known = _keywords(function)
    if known is None:
        return []
    return [
        f"{label}: takes no argument '{name}', which a row has; {nearest(name, known)}"
        for name in names
        if name not in known
    ]


def lacking(function: Callable[..., Any], names: Collection[str]) -> list[str]:
    """Return the arguments of `function` without default that are not among `names`."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    return [
        p.name
        for p in parameters
        if p.kind in _NAMED and p.default is p.empty and p.name not in names
    ]


def describe(error: BaseException) -> str:
    """Return kind, text and place of an error: the innermost line not of libmpm or Python."""
    text = f"{type(error).__name__}: {error}"
    places = [
        f" ({Path(frame.filename).name}:{frame.lineno} in {frame.name})"
        for frame in traceback.extract_tb(error.__traceback__)
        if not _is_library(Path(frame.filename))
    ]
    first, *others = text.split("\n")
    return "\n".join([first + (places[-1] if places else ""), *others])


def _is_library(path: Path) -> bool:
    # Dataclasses make their methods of strings.
    if path.is_relative_to(_PACKAGE) or path.name.startswith(("<frozen", "<string")):
        return True
    return path.is_relative_to(_PYTHON) and not {"site-packages", "dist-packages"} & {*path.parts}


def call_with(function: Callable[..., Any], row: Mapping[str, Any]) -> Any:
    """Call `function` with those parameters of `row` that it names, or with all (``**row``)."""
    known = _keywords(function)
    return function(**{k: v for k, v in row.items() if known is None or k in known})


def _keywords(function: Callable[..., Any]) -> list[str] | None:
    """Return the keywords of a callable; None where it takes any or cannot tell."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return None
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        return None
    return [p.name for p in parameters if p.kind in _NAMED]
