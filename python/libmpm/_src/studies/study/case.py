"""One case of a study as its files show it."""

from __future__ import annotations

import contextlib
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from libmpm._src.base.values import plain, shown
from libmpm._src.errors import SceneError
from libmpm._src.output.locks import is_held
from libmpm._src.output.sensor_file import read_sensors
from libmpm._src.output.series import Series
from libmpm._src.scene.scene import Scene
from libmpm._src.studies.study.record import glance_record, glance_responses, read_responses
from libmpm._src.studies.study.rows import canonical, describe
from libmpm._src.studies.study.shared_files import LOCK, RESPONSE, sweep_shared, write_shared
from libmpm._src.studies.study.table import COLUMNS

__all__ = [
    "Found",
    "Response",
    "StudyCase",
    "compute_response",
    "recorded_responses",
    "status_of",
    "store_responses",
]

Response = Callable[["StudyCase"], Mapping[str, Any]]
#: Name -> number or None, and what went wrong.
Found = tuple[dict[str, Any], str]


class StudyCase:
    """One row of a study and what its simulation has left in its folder.

    Made by `Study.cases`, and handed to a study's `response`. Rows that describe the same
    simulation share a folder; each has its own `parameters`.
    """

    def __init__(
        self, parameters: dict[str, Any], hash: str, folder: Path | None, error: str = ""
    ) -> None:
        """Take what the plan says; files are read when asked for."""
        #: The row: name -> value.
        self.parameters = parameters
        #: The name of its folder: 16 digits; empty while its trunk has not run.
        self.hash = hash
        #: The folder with ``status.json``, ``scene.json``, ``sensors.h5`` and the like, or None.
        self.folder = folder
        self._error = error

    @cached_property
    def record(self) -> dict[str, Any]:
        """The content of ``status.json``; empty while the case has not begun. Read once.

        A damaged one counts as none: the case will run again.
        """
        return {} if self.folder is None else glance_record(self.folder)

    @property
    def status(self) -> str:
        """One of planned, running, interrupted, finished, failed; as of the first look."""
        if self._error:
            return "failed"
        return "planned" if self.folder is None else status_of(self.folder, self.record)

    @property
    def error(self) -> str:
        """Why it failed; empty if it did not."""
        return self._error or str(self.record.get("error") or "")

    @cached_property
    def sensors(self) -> dict[str, Series]:
        """Sensor name -> series with `time` (n,) in s, `values` (n, k), components and units."""
        return {} if self.folder is None else read_sensors(self.folder / "sensors.h5")

    @cached_property
    def scene(self) -> Scene:
        """The scene that ran."""
        if self.folder is None:
            raise FileNotFoundError("the case has no folder: its scene is not known yet")
        return Scene.load(self.folder / "scene.json")

    def __repr__(self) -> str:
        """Return the row and how it stands."""
        inside = ", ".join(f"{k}={v!r}" for k, v in self.parameters.items())
        return f"<StudyCase {self.hash or '?'} {self.status}: {inside}>"


def status_of(folder: Path, record: Mapping[str, Any]) -> str:
    """Return the status of a folder whose ``status.json`` holds `record`."""
    status = str(record.get("status", "planned"))
    if status == "running" and not is_held(folder / LOCK):
        return "interrupted"
    return status


def compute_response(case: StudyCase, response: Response) -> Found:
    """Return the numbers of a finished case, and what went wrong if anything did."""
    label = "response"
    taken = {*case.parameters, *COLUMNS}
    try:
        found = response(case)
    except Exception as error:
        return {}, f"{label}: {describe(error)}"
    if not isinstance(found, Mapping):
        return {}, f"{label}: returned {shown(found, 60)}; expected a mapping of names to numbers"
    numbers_, problems = {}, []
    for name, item in found.items():
        item = item.item() if hasattr(item, "item") and getattr(item, "size", 1) == 1 else item
        if not isinstance(name, str) or not isinstance(item, numbers.Real | None):
            problems.append(
                f"{label}: {name!r} is {shown(item, 60)}; expected a name and a number, or "
                "None where "
                "there is none"
            )
        elif name in taken:
            what = "a parameter" if name in case.parameters else "another column of the table"
            problems.append(
                f"{label}: '{name}' is the name of {what} too; give the result another name, for "
                f"instance '{name}_found'"
            )
        else:
            numbers_[name] = item if isinstance(item, bool | int | None) else float(item)
    return numbers_, "; ".join(problems)


def store_responses(folder: Path, found: Sequence[tuple[StudyCase, Found]]) -> None:
    """Keep the responses of rows in ``response.json``, beside those of others that share it."""
    sweep_shared(folder / RESPONSE)
    before = _entries(read_responses(folder))
    after = dict(before)
    for case, (numbers_, error) in found:
        # JSON has no word for what is not finite.
        values = {k: v if v is None or math.isfinite(v) else str(v) for k, v in numbers_.items()}
        made = {"parameters": plain(case.parameters), "response": values, "error": error}
        after[canonical(case.parameters)] = made
    if after != before:
        write_shared(folder / RESPONSE, {"rows": list(after.values())})


def recorded_responses(folder: Path) -> dict[str, Found]:
    """Return the responses that an earlier run computed in a folder, by canonical row."""
    found = {}
    for row, entry in _entries(glance_responses(folder)).items():
        values = entry["response"].items()
        numbers_ = {k: float(v) if isinstance(v, str) else v for k, v in values}
        found[row] = numbers_, str(entry.get("error", ""))
    return found


def _entries(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the responses of a ``response.json`` by row."""
    found = {}
    for row in rows:
        # No row of a study has what is not finite; a file that has it is damaged.
        with contextlib.suppress(SceneError):
            found[canonical(row["parameters"])] = row
    return found
