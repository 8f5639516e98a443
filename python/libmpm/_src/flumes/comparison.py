"""`Comparison`: a run against what was measured: rows with verdicts, table, CSV, figure."""

from __future__ import annotations

import csv
import dataclasses
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.tables import html_table, text_table
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import Error, SceneError
from libmpm._src.flumes.criteria import Criterion, Signals
from libmpm._src.output.atomic_files import replacing

if TYPE_CHECKING:
    from libmpm._src.flumes.laboratory import Laboratory
    from libmpm._src.flumes.records import Curve
    from libmpm._src.pictures.figures import Picture

__all__ = ["HEAD", "Comparison", "Row", "Table", "blank", "compare", "verdict_of"]

#: Heads of the columns of a table.
HEAD = ("id", "quantity", "unit", "measured", "this run", "error", "tolerance", "published",
         "verdict")  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One number: measured, of this run, and the verdict.

    `verdict` is "passed" or "failed" of rows that decide, "reported" or "held out" of others,
    "begins late" where the run begins after the row's time, as a near field does, "not reached"
    where one that does not ends before, "no instrument" where the scene has none of it, "no
    record" where a measured curve is needed that `compare` was not given, and "not run" of a table
    without a run. `error` is the run less what was measured. `case` is the set-up that gives the
    row; `spread` the smallest and largest of several runs, of which `simulated` is the median.
    """

    id: str
    quantity: str
    unit: str
    measured: float | None
    simulated: float | None
    tolerance: str
    published: str
    verdict: str
    case: str = ""
    spread: tuple[float, float] | None = None
    runs: int = 1

    @property
    def error(self) -> float | None:
        """What the run gives less what was measured, in `unit`; None where one is missing."""
        if self.measured is None or self.simulated is None:
            return None
        return self.simulated - self.measured

    def texts(self) -> tuple[str, ...]:
        """Return the row as texts."""

        def number(x: float | None) -> str:
            return "" if x is None else f"{x:.4g}"

        shown = "held out" if self.verdict == "held out" else number(self.measured)
        found = number(self.simulated)
        if self.spread is not None:
            low, high = (number(x) for x in self.spread)
            found += f" ({low} to {high}, {self.runs} runs)"
        return (self.id, self.quantity, self.unit, shown, found, number(self.error),
                self.tolerance, self.published, self.verdict)  # fmt: skip


class Table:
    """Rows of a facility with what tables of one set-up and of all have in common."""

    rows: tuple[Row, ...]

    def _texts(self) -> list[tuple[str, ...]]:
        return [row.texts() for row in self.rows]

    def _head(self) -> tuple[str, ...]:
        return HEAD

    @property
    def passed(self) -> bool:
        """Whether a row has passed and none that decides has failed."""
        verdicts = [row.verdict for row in self.rows]
        return "failed" not in verdicts and "passed" in verdicts

    def __getitem__(self, which: str) -> Row:
        """Return a row by id and start of its quantity, such as "L1" or "L1 rms of WG2"."""
        for row in self.rows:
            if f"{row.id} {row.quantity}".startswith(which):
                return row
        raise KeyError(f"no row {which!r}; there are {', '.join(r.id for r in self.rows)}")

    def table(self) -> str:
        """Return all rows as a table in plain text."""
        return text_table([self._head(), *self._texts()], flush="left")

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        return html_table(self._texts(), self._head())

    @keywords_only("flumes.Comparison.to_csv", 1)
    def to_csv(self, path: str | Path) -> None:
        """Write all rows; the file appears whole or not at all. Raises `OutputError`."""
        with (
            replacing(Path(path)) as part,
            part.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
        ):
            writer = csv.writer(file)
            writer.writerow(self._head())
            writer.writerows(self._texts())


@dataclass(frozen=True, eq=False)
class Comparison(Table):
    """What `compare` of a facility returns; prints as a table."""

    facility: Laboratory
    rows: tuple[Row, ...]
    signals: Signals | None

    def __str__(self) -> str:
        """Return facility, table and verdict."""
        counts = {v: sum(r.verdict == v for r in self.rows) for v in ("passed", "failed")}
        said = f"{counts['passed']} passed, {counts['failed']} failed of {len(self.rows)} rows"
        return f"{self.facility.title}\n{self.table()}\n{said}"

    def to_dict(self) -> dict[str, Any]:
        """Return rows as plain numbers and texts, keyed by id and quantity."""
        return {
            f"{r.id} {r.quantity}": {
                "measured": None if r.verdict == "held out" else r.measured,
                "simulated": r.simulated, "unit": r.unit, "tolerance": r.tolerance,
                "verdict": r.verdict,
            }
            for r in self.rows
        }  # fmt: skip

    def figure(self) -> Picture:
        """Return curves: the experiment's band, the published simulation, this run."""
        from libmpm._src.pictures.flume_drawings import curves

        return curves(self)


@keywords_only("flumes.blank", 2, method=False)
def blank(facility: Laboratory, case: str = "") -> Comparison:
    """Return the table of a facility without a run."""
    rows = tuple(_row(one, None, "not run", case) for one in facility.criteria())
    return Comparison(facility, rows, None)


def compare(
    facility: Laboratory,
    run: Any,
    curves: Mapping[str, Curve] | None = None,
    case: str = "",
    strict: bool = True,
) -> Comparison:
    """Return the comparison of a run, a `Simulation` or `Results`; see `Facility.compare`.

    A run of which nothing can be compared is an error if `strict`, else a table that says why.
    """
    sensors: Mapping[str, Any] = run.sensors
    known = facility.instruments()
    for name in curves or {}:
        if name not in [i.name for i in known]:
            hint = nearest(name, [i.name for i in known])
            raise SceneError(f"{facility.label}.compare: curves has {shown(name)}; {hint}")
    signals = Signals(sensors, facility.clock, known, facility.rest, curves, facility.still_water)
    rows = tuple(_judged(one, signals, case) for one in facility.criteria())
    if strict and not any(row.simulated is not None for row in rows):
        raise SceneError(f"{facility.label}.compare: {_nothing(facility, rows, signals, sensors)}")
    return Comparison(facility, rows, signals)


def _nothing(
    facility: Laboratory, rows: Sequence[Row], signals: Signals, sensors: Iterable[str]
) -> str:
    """Return why no row of a run can be compared, and what gives the first of them."""
    if not rows:
        return ("this set-up has no rows; expected one that was measured; cases are "
                + ", ".join(facility.cases))  # fmt: skip
    found: dict[str, list[Criterion]] = {}
    for one, row in zip(facility.criteria(), rows, strict=True):
        found.setdefault(row.verdict, []).append(one)
    said = "; ".join(f"{verdict}: {', '.join(dict.fromkeys(one.id for one in ones))}"
                     for verdict, ones in found.items())  # fmt: skip
    if "not reached" in found:
        ends = max(signals.end(name) for name in signals.names())
        first = min(one.window[1] for one in found["not reached"])
        return (f"the run has reached {ends:.4g} s of the laboratory's time ({said}); expected "
                f"{first:.4g} s or more; continue it")  # fmt: skip
    if "no record" in found:
        needed = ", ".join(dict.fromkeys(one.curve for one in found["no record"]))
        return (f"no row can be compared without measured curves ({said}); expected one of "
                f"{needed}; give it in curves")  # fmt: skip
    if "begins late" in found:
        late = [(max(map(signals.begin, one.needs)), max(one.window[0], signals.clock))
                for one in found["begins late"]]  # fmt: skip
        begins, due = min(late, key=lambda pair: pair[0] - pair[1])
        sooner = "begin the near field earlier, or " if due > signals.clock else ""
        return (
            f"the run begins at {begins:.4g} s of the laboratory's time, after its rows do ({said})"
            f"; expected {due:.4g} s or before; {sooner}compare a run of scene()"
        )
    return f"the run has sensors {', '.join(sensors) or 'none'}; expected those of scene()"


def _row(one: Criterion, simulated: float | None, verdict: str, case: str) -> Row:
    measured = None if one.held_out else one.measured
    return Row(one.id, one.quantity, one.unit, measured, simulated, one.tolerance, one.published,
               verdict, case)  # fmt: skip


def _judged(one: Criterion, signals: Signals, case: str) -> Row:
    """Return a criterion with its verdict."""
    if not all(name in signals for name in one.needs):
        return _row(one, None, "no instrument", case)
    slack = 1e-3 + 0.1  # a sample short of the window's begin or end
    # First, since no run that begins late is of use for the row, however far it goes.
    if any(signals.begin(name) > max(one.window[0], signals.clock) + slack for name in one.needs):
        return _row(one, None, "begins late", case)
    if any(signals.end(name) < one.window[1] - slack for name in one.needs):
        return _row(one, None, "not reached", case)
    if one.curve and one.curve not in signals.curves:
        return _row(one, None, "no record", case)
    try:
        found = one.measure(signals)
    except (Error, KeyError, ValueError) as error:
        raise SceneError(f"{one.id}, {one.quantity}: cannot be measured: {error}") from error
    if one.held_out:
        return _row(one, found, "held out", case)
    return _row(one, found, verdict_of(one, found), case)


def verdict_of(one: Criterion, found: float) -> str:
    """Return the verdict on a number."""
    if not one.gates:
        return "reported"
    return "passed" if math.isfinite(found) and one.low <= found <= one.high else "failed"


def median_of(comparisons: Sequence[Comparison]) -> Comparison:
    """Return the rows of several runs of one set-up: medians, with smallest and largest.

    Rows that some of them lack are of those that have them. Debris is chaotic: five runs that
    differ in `seed` alone. Raises `SceneError` where there is none.
    """
    if not comparisons:
        raise SceneError("flumes.median_of: there is no comparison; expected one or more")
    first = comparisons[0]
    if len(comparisons) == 1:
        return first
    criteria = {(c.id, c.quantity): c for c in first.facility.criteria()}
    rows = []
    for row in first.rows:
        key = (row.id, row.quantity)
        same = [r for c in comparisons for r in c.rows if (r.id, r.quantity) == key]
        values = [r.simulated for r in same if r.simulated is not None]
        if not values:
            rows.append(row)
            continue
        known = [v for v in values if math.isfinite(v)]
        middle = statistics.median(known) if known else math.nan
        limits = (min(known), max(known)) if known else (math.nan, math.nan)
        verdict = next(r.verdict for r in same if r.simulated is not None)
        if verdict in ("passed", "failed"):
            # A run without a number counts: it fails the row.
            finite = middle if len(known) == len(values) else math.nan
            verdict = verdict_of(criteria[key], finite)
        rows.append(dataclasses.replace(row, simulated=middle, verdict=verdict, spread=limits,
                                        runs=len(values)))  # fmt: skip
    return Comparison(first.facility, tuple(rows), first.signals)
