"""Measured curves and tables of the facilities, shipped with the package: `load`, `names`.

One schema, `data/flumes/records.json`: for each record its file, title, facility, citation,
licence, how it was read, the unit of every column, and its curves: instrument, quantity, columns
of the measured middle, of its band and of published simulations, uncertainties of value and time.
Times are those of the laboratory's clock; an empty cell is what was not drawn.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import SceneError

__all__ = ["Curve", "Record", "curve", "load", "names", "read", "table"]

Array = NDArray[np.float64]

#: Version of the schema.
SCHEMA = 1

#: Units that a column may have; "text" is no number.
UNITS = ("s", "m", "m/s", "N", "degrees", "1", "block widths", "text")

_FACILITIES = (
    "LargeWaveFlume", "DirectionalWaveBasin", "WasedaBasin", "DebrisFlowFlume", "WASIRF",
)  # fmt: skip
_TEXTS = ("file", "title", "facility", "citation", "licence", "how")
_CURVE = ("instrument", "quantity", "unit", "uncertainty", "time_uncertainty")


@dataclass(frozen=True, eq=False)
class Curve:
    """What one instrument measured, over the laboratory's time.

    `time` (n,) s; `value` (n,) is the middle of the trials in `unit`; `low` and `high` (n,) bound
    them, equal to `value` where there is one trial; `published` are simulations by name;
    `uncertainty` is that of reading a value, `time_uncertainty` that of reading a time, s.
    """

    instrument: str
    quantity: str
    unit: str
    time: Array
    value: Array
    low: Array
    high: Array
    published: Mapping[str, Array]
    trials: tuple[Array, ...]
    uncertainty: float
    time_uncertainty: float

    def change(self, values: Array | None = None) -> Array:
        """Return values (default: the middle) less the first that is a number."""
        found = self.value if values is None else values
        known = found[np.isfinite(found)]
        return found - (known[0] if len(known) else 0.0)


@dataclass(frozen=True, eq=False)
class Record:
    """One file of measured numbers: columns with units, curves, citation and licence."""

    name: str
    title: str
    facility: str
    citation: str
    licence: str
    how: str
    units: Mapping[str, str]
    columns: Mapping[str, Any]
    curves: tuple[Curve, ...]

    def __getitem__(self, column: str) -> Any:
        """Return a column: an array of numbers, or a list of texts. Raises `KeyError`."""
        if column not in self.columns:
            hint = nearest(column, self.columns)
            raise KeyError(f"record '{self.name}' has no column {column!r}; {hint}")
        return self.columns[column]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values())))

    def __repr__(self) -> str:
        """Return a line with the record's size."""
        return f"<record '{self.name}': {self.title}; {len(self)} rows, {len(self.units)} columns>"

    def curve(self, instrument: str) -> Curve:
        """Return what an instrument measured; raises `SceneError` naming those there are."""
        for one in self.curves:
            if one.instrument == instrument:
                return one
        hint = nearest(instrument, [c.instrument for c in self.curves])
        raise SceneError(f"record '{self.name}': has no curve of {shown(instrument)}; {hint}")

    def row(self, column: str, value: str) -> dict[str, Any]:
        """Return the first row whose text in a column is `value`; raises `SceneError`."""
        texts = list(self[column])
        if value not in texts:
            raise SceneError(f"record '{self.name}': {column} is {shown(value)}; "
                             f"{nearest(value, texts)}")  # fmt: skip
        return {key: items[texts.index(value)] for key, items in self.columns.items()}


def curve(
    instrument: str,
    time: Sequence[float] | NDArray[Any],
    value: Sequence[float] | NDArray[Any],
    *,
    quantity: str = "level",
    unit: str = "m",
    uncertainty: float = 0.0,
    time_uncertainty: float = 0.0,
) -> Curve:
    """Return a measured curve of the caller's, for `compare(run, curves={instrument: ...})`.

    `time` (n,) s of the laboratory's clock, rising; `value` (n,) in `unit`, NaN where there is
    none. Raises `SceneError`.
    """
    when, what = (np.asarray(x, np.float64) for x in (time, value))
    label = f"records.curve({shown(instrument)})"
    if when.ndim != 1 or when.shape != what.shape or len(when) < 2:
        raise SceneError(f"{label}: time has shape {when.shape} and value {what.shape}; expected "
                         "two or more readings of each")  # fmt: skip
    if not np.all(np.diff(when) > 0):
        raise SceneError(f"{label}: times do not rise; expected seconds in order")
    if not np.any(np.isfinite(what)):
        raise SceneError(f"{label}: value has no number; expected readings in {unit}")
    return Curve(instrument, quantity, unit, when, what, what, what, {}, (), uncertainty,
                 time_uncertainty)  # fmt: skip


def _folder() -> Path:
    return Path(str(resources.files("libmpm") / "data" / "flumes"))


@cache
def _listed() -> dict[str, Any]:
    document = json.loads((_folder() / "records.json").read_text(encoding="utf-8"))
    found: dict[str, Any] = document["records"]
    return found


def names(facility: str | None = None) -> list[str]:
    """Return the names of all records, or of those of one facility, such as "LargeWaveFlume"."""
    found = _listed()
    return [n for n, one in found.items() if facility in (None, one["facility"])]


@cache
def load(name: str) -> Record:
    """Return a record of the package. Raises `SceneError` naming the nearest one."""
    if name not in _listed():
        raise SceneError(f"record is {shown(name)}; {nearest(name, names())}")
    return read(name, _listed()[name], _folder())


def table() -> str:
    """Return all records as a table: name, rows, what, uncertainty, citation."""
    from libmpm._src.base.tables import text_table

    rows = [("record", "rows", "what", "uncertainty", "citation")]
    for name in names():
        one = load(name)
        said = {f"{c.uncertainty:g} {c.unit}, {c.time_uncertainty:g} s" for c in one.curves}
        rows.append((name, str(len(one)), one.title, "; ".join(sorted(said)), one.citation))
    return text_table(rows, flush="left")


def read(name: str, about: Mapping[str, Any], folder: Path) -> Record:
    """Return a record as the schema describes it; raises `SceneError` with all problems.

    `about` is an entry of records.json, `folder` where its file lies. Checked are texts and units,
    that file and description have the same columns, that numbers are numbers, that times of a curve
    rise and that its band holds its middle.
    """
    problems = [f"{key} is {shown(about.get(key))}; expected a text" for key in _TEXTS
                if not isinstance(about.get(key), str) or not about.get(key)]  # fmt: skip
    if not problems and about["facility"] not in _FACILITIES:
        hint = nearest(about["facility"], _FACILITIES)
        problems.append(f"facility is {shown(about['facility'])}; {hint}")
    units = dict(about.get("columns", {}))
    problems += [f"column '{c}' has unit {shown(u)}; expected one of {', '.join(UNITS)}"
                 for c, u in units.items() if u not in UNITS]  # fmt: skip
    columns: dict[str, Any] = {}
    curves: list[Curve] = []
    if not problems:
        columns = _columns(folder / about["file"], units, problems)
    if not problems:
        for one in about.get("curves", ()):
            curve = _curve(one, str(about.get("time")), columns, units, problems)
            curves += [curve] if curve is not None else []
    if problems:
        raise SceneError([f"record '{name}': {p}" for p in problems])
    texts = {key: about[key] for key in _TEXTS if key != "file"}
    return Record(name=name, units=units, columns=columns, curves=tuple(curves), **texts)


def _columns(path: Path, units: Mapping[str, str], problems: list[str]) -> dict[str, Any]:
    """Read a file of rows separated by commas."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
    except (OSError, ValueError) as error:
        problems.append(f"file {path.name} cannot be read: {error}; expected a head and rows")
        return {}
    if head != list(units):
        odd = sorted(set(head) ^ set(units)) or ["their order"]
        problems.append(f"file {path.name} and its description differ in {', '.join(odd)}; "
                        "expected the same columns in the same order")  # fmt: skip
        return {}
    found: dict[str, Any] = {}
    for i, (name, unit) in enumerate(units.items()):
        cells = [row[i] if i < len(row) else "" for row in rows]
        if unit == "text":
            found[name] = cells
            continue
        try:
            found[name] = np.array([float(c) if c else np.nan for c in cells], np.float64)
        except ValueError as error:
            problems.append(f"column '{name}': {error}; expected numbers or nothing")
    return found


def _curve(
    one: Mapping[str, Any],
    time: str,
    columns: Mapping[str, Any],
    units: Mapping[str, str],
    problems: list[str],
) -> Curve | None:
    """Return one curve of a record."""
    label = f"curve of {shown(one.get('instrument'))}"
    published: Mapping[str, str] = one.get("published", {})
    trials: Sequence[str] = one.get("trials", ())
    used = [one.get(k) for k in ("measured", "low", "high")]
    columns_of = [time, *(c for c in used if c is not None), *published.values(), *trials]
    unknown = [c for c in columns_of if c not in columns]
    missing = [k for k in _CURVE if one.get(k) is None]
    if unknown or missing or len(columns_of) < 2:
        said = [f"unknown columns {unknown}"] * bool(unknown) + [f"no {m}" for m in missing]
        problems.append(f"{label} has {', '.join(said) or 'no values'}; expected both")
        return None
    if min(one["uncertainty"], one["time_uncertainty"]) <= 0:
        problems.append(f"{label} has uncertainties that are not > 0; expected those of reading")
    if any(units[c] != one["unit"] for c in columns_of[1:]):
        problems.append(f"{label} is in {one['unit']}, one of its columns not; expected one unit")
    keep = np.ones(len(columns[time]), dtype=bool)
    for column, wanted in one.get("select", {}).items():
        keep &= np.array([x == wanted for x in columns[column]])

    def of(column: str) -> Array:
        return np.asarray(columns[column], np.float64)[keep]

    when = of(time)
    if not len(when) or np.any(np.diff(when) <= 0):
        problems.append(f"{label} has times that do not rise; expected seconds in order")
    if "measured" in one:
        value = of(one["measured"])
        low, high = (of(one.get(k, one["measured"])) for k in ("low", "high"))
    else:
        low, high = of(one["low"]), of(one["high"])
        value = 0.5 * (low + high)
    slack = one["uncertainty"]
    if np.any(low > value + slack) or np.any(high < value - slack):
        problems.append(f"{label} leaves its own band; expected low ≤ middle ≤ high")
    return Curve(
        one["instrument"], one["quantity"], one["unit"], when, value, low, high,
        {n: of(c) for n, c in published.items()}, tuple(of(c) for c in trials),
        float(slack), float(one["time_uncertainty"]),
    )  # fmt: skip
