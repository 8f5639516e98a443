"""The one table of a study: what was varied, what came out, what it cost."""

from __future__ import annotations

import csv
import html
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.tables import html_table, text_table
from libmpm._src.base.values import nearest
from libmpm._src.output.atomic_files import file_name, replacing, writing
from libmpm._src.output.hdf5_image import new_file, storable_text
from libmpm._src.studies.study.rows import canonical

__all__ = ["COLUMNS", "StudyResult", "TrunkCost"]

#: Columns of every table after the parameters and responses.
COLUMNS = (
    "status",
    "case",
    "trunk",
    "wall_time",
    "steps",
    "particles",
    "particle_steps_per_s",
    "displaced",
    "device",
    "precision",
    "version",
    "error",
)
#: What a printed table leaves out of them.
_UNPRINTED = ("trunk", "displaced", "precision", "version", "error")
#: Rows of a printed table.
_PRINTED = 20


@dataclass(frozen=True)
class TrunkCost:
    """What a trunk cost, s of wall time, and how many cases shared it."""

    wall_time: float
    cases: int

    @property
    def saved(self) -> float:
        """Wall time, s, that its cases would have spent on it one by one."""
        return max(0, self.cases - 1) * self.wall_time


@dataclass(frozen=True, repr=False)
class StudyResult:
    """The table of a study, one row a row of parameters; prints as text, in Jupyter too.

    Columns are the parameters, the responses, and

    ====================  ==========  ====================================================
    column                unit        meaning
    ====================  ==========  ====================================================
    status                -           planned, running, interrupted, finished or failed
    case, trunk           -           names of the folders in ``cases`` and ``trunks``
    wall_time             s           of the case alone, not of its trunk
    steps                 1           of the case alone, not of its trunk
    particles             1           at its end
    particle_steps_per_s  1/s         speed
    displaced             1           particles of the trunk whose place new bodies took
    device, precision     -           what it ran on
    version               -           of the libmpm that ran it
    error                 -           why it failed, or its response did
    ====================  ==========  ====================================================

    ``result["wall_time"]`` is one column as an array; `len` is the number of rows. Made by
    `Study.run` and `Study.collect`.
    """

    rows: tuple[Mapping[str, Any], ...]
    """One mapping a row: column -> value, or None where there is none."""
    parameters: tuple[str, ...]
    """Names of the columns that were varied."""
    responses: tuple[str, ...]
    """Names of the columns that came out."""
    name: str = ""
    """Name of the study."""
    trunks: Mapping[str, TrunkCost] = field(default_factory=dict)
    """Trunk -> what it cost."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns, in order."""
        return tuple(dict.fromkeys((*self.parameters, *self.responses, *COLUMNS)))

    @property
    def failed(self) -> tuple[Mapping[str, Any], ...]:
        """The rows whose case, trunk or response failed."""
        return tuple(row for row in self.rows if row["status"] == "failed" or row["error"])

    @property
    def versions(self) -> tuple[str, ...]:
        """Versions of libmpm that ran the cases."""
        return tuple(sorted({row["version"] for row in self.rows if row["version"]}))

    @property
    def trunk_wall_time(self) -> float:
        """Wall time of all trunks, s."""
        return math.fsum(cost.wall_time for cost in self.trunks.values())

    @property
    def time_saved(self) -> float:
        """Wall time, s, that sharing has saved: (cases - 1) times its own, over all trunks."""
        return math.fsum(cost.saved for cost in self.trunks.values())

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.rows)

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """Return one column (n,): numbers with NaN where there is none, or texts.

        Whole numbers that no type of NumPy holds are texts too.
        """
        if column not in self.columns:
            raise KeyError(f"the table has no column '{column}'; {nearest(column, self.columns)}")
        values = [row.get(column) for row in self.rows]
        if all(isinstance(v, bool) for v in values):
            return np.array(values, dtype=bool)
        whole = np.array(values) if all(isinstance(v, int) for v in values) else None
        if whole is not None and whole.dtype.kind in "iu":
            return whole
        if whole is None and all(v is None or isinstance(v, int | float) for v in values):
            return np.array([math.nan if v is None else v for v in values], dtype=np.float64)
        return np.array([_text(v) for v in values], dtype=str)

    def to_records(self) -> npt.NDArray[Any]:
        """Return a structured array (n,) with a field for every column."""
        columns = {name: self[name] for name in self.columns}
        result = np.empty(len(self), dtype=[(name, c.dtype) for name, c in columns.items()])
        for name, column in columns.items():
            result[name] = column
        return result

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame; needs pandas: ``pip install libmpm[studies]``."""
        pandas = need("pandas", "StudyResult.to_pandas", "studies")
        return pandas.DataFrame({name: self[name] for name in self.columns})

    @keywords_only("studies.StudyResult.save_csv", 1)
    def save_csv(self, path: str | Path) -> None:
        """Write the table as CSV, atomically; numbers keep all their digits.

        Raises `OutputError`.
        """
        target = Path(path)
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        with (
            replacing(target) as part,
            part.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
        ):
            table = csv.writer(file)
            table.writerow(self.columns)
            table.writerows([_text(row.get(c)) for c in self.columns] for row in self.rows)

    @keywords_only("studies.StudyResult.save_hdf5", 1)
    def save_hdf5(self, path: str | Path) -> None:
        """Write the table as HDF5, atomically: a dataset (n,) a column, versions as attributes.

        Raises `OutputError`.
        """
        from h5py import string_dtype

        target = Path(path)
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        with new_file(target) as file:
            file.attrs["generator"] = "libmpm"
            file.attrs["name"] = storable_text(self.name)
            file.attrs["trunk_wall_time"] = self.trunk_wall_time
            file.attrs["time_saved"] = self.time_saved
            for key in ("versions", "columns", "parameters", "responses"):
                names = [storable_text(name) for name in getattr(self, key)]
                file.attrs.create(key, names, dtype=string_dtype())
            for name in self.columns:
                column = self[name]
                texts = column.dtype.kind == "U"
                if texts:
                    column = np.array([storable_text(x) for x in column.tolist()], dtype=object)
                data = file.create_dataset(
                    file_name(name),
                    data=column,
                    dtype=string_dtype() if texts else None,
                )
                data.attrs["name"] = storable_text(name)

    # Printing ---------------------------------------------------------------------------------

    def summary(self) -> str:
        """Return how many cases ended how, and what sharing a trunk has saved."""
        statuses = Counter(row["status"] for row in self.rows)
        counted = ", ".join(f"{n} {status}" for status, n in statuses.items())
        wrong = sum(bool(row["error"]) and row["status"] == "finished" for row in self.rows)
        if wrong:
            counted += f"; {wrong} responses failed"
        lines = [f"{len(self)} rows" + (f": {counted}" if counted else "")]
        for row in self.failed[:3]:
            first = str(row["error"]).splitlines()[0] if row["error"] else ""
            lines.append(f"failed: {row['case'] or 'without a folder'}: {first}")
        if len(self.failed) > 3:
            lines.append(f"failed: {len(self.failed) - 3} more")
        if statuses["failed"]:
            lines.append("failed cases run again with run(retry_failed=True)")
        for trunk, cost in self.trunks.items():
            lines.append(
                f"trunk {trunk}: {cost.wall_time:.1f} s, shared by {cost.cases} cases, saved "
                f"{cost.saved:.1f} s"
            )
        if len(self.versions) > 1:
            lines.append(f"run by different versions of libmpm: {', '.join(self.versions)}")
        return "\n".join(lines)

    def _cells(self, rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
        shown = [c for c in self.columns if c not in _UNPRINTED or c in self.parameters]
        return [shown, *([_short(row.get(c)) for c in shown] for row in rows)]

    def __repr__(self) -> str:
        """Return the first rows as text, and the summary."""
        lines = [text_table(self._cells(self.rows[:_PRINTED]))]
        if len(self) > _PRINTED:
            lines.append(f"... {len(self) - _PRINTED} more rows")
        return "\n".join([*lines, self.summary()])

    def _repr_html_(self) -> str:
        """Return the first rows and the summary for Jupyter."""
        said = [self.summary()]
        if len(self) > _PRINTED:
            said.insert(0, f"... {len(self) - _PRINTED} more rows")
        head, *rows = self._cells(self.rows[:_PRINTED])
        table = html_table(rows, head)
        return f"{table}<pre>{html.escape(chr(10).join(said))}</pre>"


def _text(item: Any) -> str:
    """Return a value as a table's text; lists and values of libmpm as JSON."""
    if item is None:
        return ""
    if isinstance(item, bool | int | float | str):
        return str(item)
    return canonical(item)


def _short(item: Any) -> str:
    if isinstance(item, float):
        return f"{item:.5g}"
    return _text(item)
