"""The table of a trade-off: what each row got wrong, what it cost, and which rows are best."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from libmpm._src.advice.tradeoff.front import front, is_rated, least
from libmpm._src.advice.tradeoff.labels import label_of, short
from libmpm._src.base.tables import html_table, text_table
from libmpm._src.base.values import Checker, from_plain, keywords_only, plain
from libmpm._src.errors import OutputError, SceneError
from libmpm._src.output.atomic_files import write_json
from libmpm._src.studies.study.table import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLUMNS", "FILE", "TradeOff"]

#: Columns of every table after the parameters, the metrics and their errors.
COLUMNS = (
    "error",
    "time",
    "front",
    "reference",
    "wall_time",
    "processor_time",
    "spread",
    "steps",
    "time_step",
    "particles",
    "memory",
    "bytes_per_particle",
    "energy_drift",
    "device",
    "precision",
    "pipeline",
    "threads",
    "case",
    "failure",
)
#: What a printed table shows of them.
_PRINTED = ("error", "time", "steps", "particles", "memory", "energy_drift", "front")
#: Rows of a printed table.
_MOST = 30
#: In the folder of a trade-off.
FILE = "tradeoff.json"
_FORMAT = 1


class _Table(StudyResult):
    """The same arrays and files as of a study, of other columns."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns, in order."""
        return tuple(dict.fromkeys((*self.parameters, *self.responses, *COLUMNS)))


@dataclass(frozen=True, repr=False)
class TradeOff:
    """What numerical choices cost and what they gain: one row a combination; made by `tradeoff`.

    Columns are the parameters, the metrics, ``<metric>_error`` of those with a reference, and

    =======================  ====  ===============================================================
    column                   unit  meaning
    =======================  ====  ===============================================================
    error                    1     largest magnitude of the errors; None where the row failed, and
                                   of the row that the others are compared with
    time                     1     s of the `clock` for a simulated second, the least of `repeats`
    front                    -     True where no row is as fast and more accurate, or as accurate
                                   and faster
    reference                -     True of the row that the others are compared with
    wall_time                1     s of wall time in the engine for a simulated second
    processor_time           1     s of processor time in it, of all threads, for a simulated second
    spread                   1     largest `time` of the repeats over the least, less 1
    steps                    1     of the whole run
    time_step                s     at its end
    particles                1     at its end
    memory                   byte  what the plan says in all
    bytes_per_particle       byte  the largest of any body
    energy_drift             1     change of the energy as a part of its largest; see `tradeoff`
    device, precision,       -     what it ran on and with
    pipeline, threads
    case                     -     name of its folder in ``cases``
    failure                  -     why the row has no error; empty if it has
    =======================  ====  ===============================================================

    Errors of metrics are relative and signed, in the metric's unit where the reference is 0.
    ``table["error"]`` is one column as an array; `len` is the number of rows.
    """

    rows: tuple[Mapping[str, Any], ...]
    """One mapping a row: column -> value, or None where there is none."""
    parameters: tuple[str, ...]
    """Names of the columns that were varied."""
    metrics: tuple[str, ...]
    """Names of the columns that were measured."""
    clock: str = "wall"
    """What `time` is of: "wall" or "processor"."""
    reference: str = ""
    """What the results are compared with, in words."""
    name: str = ""
    """Name for titles."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns, in order."""
        return self._table.columns

    @property
    def _table(self) -> _Table:
        named = [f"{m}_error" for m in self.metrics if any(f"{m}_error" in r for r in self.rows)]
        return _Table(self.rows, self.parameters, (*self.metrics, *named), self.name)

    @property
    def failed(self) -> tuple[Mapping[str, Any], ...]:
        """The rows that broke, or gave no number to compare; each says why in its `failure`."""
        return tuple(row for row in self.rows if row["failure"])

    @property
    def pareto(self) -> tuple[Mapping[str, Any], ...]:
        """The rows that no other one beats, from the fastest to the most accurate.

        One row beats another if it is better in error or time and no worse in the other.
        """
        return tuple(self.rows[i] for i in front(self.rows))

    @keywords_only("TradeOff.cheapest", 1)
    def cheapest(self, error: float) -> Mapping[str, Any]:
        """Return the fastest row with an error of at most `error`, > 0, a part of the reference.

        Raises `SceneError` with the nearest row if there is none.
        """
        return self._least("cheapest", "time", "error", error)

    @keywords_only("TradeOff.most_accurate", 1)
    def most_accurate(self, time: float) -> Mapping[str, Any]:
        """Return the row of the least error of those that take at most `time`, > 0.

        `time` is in s of the `clock` for a simulated second. Raises `SceneError` with the nearest
        row if there is none.
        """
        return self._least("most_accurate", "error", "time", time)

    def _least(self, label: str, wanted: str, bounded: str, most: Any) -> Mapping[str, Any]:
        check = Checker(f"TradeOff.{label}")
        most = check.number(bounded, most, lower=0, lower_open=True)
        check.finish()
        found, nearest = least(self.rows, wanted, bounded, most)
        if found is not None:
            return found
        if nearest is None:
            check.fail(f"no row has an error and a time; {self._why()}")
        else:
            check.fail(
                f"no row has {bounded} ≤ {most:g}; the nearest is {label_of(nearest, self)} with "
                f"error {nearest['error']:.4g} and time {nearest['time']:.4g}; allow more, or give "
                "the axes other values"
            )
        raise SceneError(check.problems)

    def _why(self) -> str:
        if self.failed:
            first = str(self.failed[0]["failure"]).splitlines()[0]
            return f"{len(self.failed)} of {len(self)} rows failed, the first: {first}"
        return "with one row alone nothing is left to compare; give the axes more values"

    # Arrays and files ---------------------------------------------------------------------------

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.rows)

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """Return one column (n,): numbers with NaN where there is none, or texts."""
        return self._table[column]

    def to_records(self) -> npt.NDArray[Any]:
        """Return a structured array (n,) with a field for every column."""
        return self._table.to_records()

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame; needs pandas: ``pip install libmpm[studies]``."""
        return self._table.to_pandas()

    @keywords_only("advice.TradeOff.to_csv", 1)
    def to_csv(self, path: str | Path) -> None:
        """Write the table as CSV, atomically; numbers keep all their digits.

        Raises `OutputError`.
        """
        self._table.save_csv(path)

    @keywords_only("advice.TradeOff.save", 1)
    def save(self, path: str | Path) -> None:
        """Write everything to a JSON file, or to ``tradeoff.json`` in a folder that exists.

        Raises `OutputError`.
        """
        target = Path(path)
        content = {
            "tradeoff": _FORMAT,
            "name": self.name,
            "clock": self.clock,
            "reference": self.reference,
            "parameters": list(self.parameters),
            "metrics": list(self.metrics),
            "rows": [plain(dict(row)) for row in self.rows],
        }
        write_json(target / FILE if target.is_dir() else target, content)

    @classmethod
    @keywords_only("advice.TradeOff.load", 1)
    def load(cls, path: str | Path) -> TradeOff:
        """Read what `save` wrote: a file, or the folder of a `tradeoff`.

        Raises `OutputError` for what is none.
        """
        target = Path(path)
        target = target / FILE if target.is_dir() else target
        try:
            content = json.loads(target.read_text(encoding="utf-8"))
            if content["tradeoff"] != _FORMAT:
                raise ValueError(f"its format is {content['tradeoff']!r}")
            rows = tuple(
                {k: v if k in COLUMNS else from_plain(v) for k, v in row.items()}
                for row in content["rows"]
            )
            parameters, metrics = tuple(content["parameters"]), tuple(content["metrics"])
            words = content["clock"], content["reference"], content["name"]
        except (
            OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, MemoryError
        ) as error:  # fmt: skip
            raise OutputError(
                f"{target}: {type(error).__name__}: {error}; expected a file of TradeOff.save, "
                f"format {_FORMAT}, or the folder of a tradeoff that has ended"
            ) from error
        return cls(rows, parameters, metrics, *words)

    # Looking --------------------------------------------------------------------------------------

    @keywords_only("TradeOff.plot")
    def plot(self, *, by: str | None = None, axes: Any = None) -> Figure:
        """Return a figure of error over time, both logarithmic, with the front.

        `by` names a parameter whose values get colours of their own; None = the first one with
        several values. `axes` are matplotlib's, to draw into. Raises `SceneError`.
        """
        from libmpm._src.advice.tradeoff.plot import plot

        return plot(self, by=by, axes=axes)

    def summary(self) -> str:
        """Return how many rows there are, what they are compared with, and what failed."""
        rated = sum(map(is_rated, self.rows))
        lines = [f"{len(self)} rows, {rated} with an error, {len(self.pareto)} on the front (*)"]
        lines.append(f"time: s of {self.clock} time a simulated second")
        spreads = [row["spread"] for row in self.rows if row.get("spread") is not None]
        if spreads:
            lines[-1] += f"; repeats differ by up to {100 * max(spreads):.0f} %"
        lines.append(f"error: against {self.reference}")
        for row in self.failed[:3]:
            first = str(row["failure"]).splitlines()[0]
            lines.append(f"failed: {label_of(row, self)}: {first}")
        if len(self.failed) > 3:
            lines.append(f"failed: {len(self.failed) - 3} more")
        return "\n".join(lines)

    def _cells(self) -> list[list[str]]:
        shown = list(dict.fromkeys((*self.parameters, *self.metrics, *_PRINTED)))
        cells = [shown]
        for row in self.rows[:_MOST]:
            texts = {k: short(row.get(k)) for k in shown}
            mark = "reference" if row["reference"] else "failed" if row["failure"] else ""
            texts["front"] = "*" if row["front"] else mark
            cells.append([texts[k] for k in shown])
        return cells

    def _said(self) -> str:
        more = len(self) - _MOST
        return (f"... {more} more rows\n" if more > 0 else "") + self.summary()

    def __repr__(self) -> str:
        """Return the first rows as text, and the summary."""
        return f"{text_table(self._cells())}\n{self._said()}"

    def _repr_html_(self) -> str:
        """Return the first rows and the summary for Jupyter."""
        head, *rows = self._cells()
        return f"{html_table(rows, head)}<pre>{html.escape(self._said())}</pre>"
