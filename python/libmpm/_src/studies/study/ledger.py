"""``study.json``: the rows that a folder has ever been asked for, and the cases they became."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from libmpm._src.base.values import plain, shown
from libmpm._src.errors import OutputError, SceneError
from libmpm._src.output.locks import locked
from libmpm._src.studies.study.plan import Plan
from libmpm._src.studies.study.record import is_row
from libmpm._src.studies.study.rows import canonical
from libmpm._src.studies.study.shared_files import STUDY, read_object, sweep_shared, write_shared

__all__ = ["read_ledger", "update_ledger"]

#: Number of the layout of ``study.json``.
_FORMAT = 1


def update_ledger(folder: Path, name: str, run_axes: Sequence[str], plans: Sequence[Plan]) -> None:
    """Add rows to the ledger of a folder, or renew what it says of them.

    Raises `OutputError` if there is a ledger that this version cannot read.
    """
    path = folder / STUDY
    with locked(folder / f"{STUDY}.lock"):
        sweep_shared(path)
        found = read_object(path)
        if path.exists() and (problem := _problem(found)):
            raise OutputError(
                f"{path} {problem}; expected format {_FORMAT}. It is not replaced: it names the "
                "rows of the cases; restore it, move it away, or choose another folder"
            )
        entries = dict(_numbered(found.get("rows", [])))
        for key, plan in _numbered(plans):
            known = entries.get(key, {})
            before = known["case"] if known.get("trunk") == plan.trunk else ""
            entries[key] = {
                "parameters": plain(plan.row),
                # What is known of a row stays known while its trunk's checkpoint is away.
                "case": plan.hash or before,
                "trunk": plan.trunk,
                "error": plan.error,
            }
        axes = list(dict.fromkeys([*found.get("run_axes", []), *run_axes]))
        content = {
            "study": _FORMAT,
            "name": name or found.get("name", ""),
            "run_axes": axes,
            "rows": list(entries.values()),
        }
        if content != found:
            write_shared(path, content)


def read_ledger(folder: Path) -> tuple[str, list[str], list[Plan]]:
    """Return name, run axes and rows of a folder; raises `SceneError` if it holds no study."""
    found = read_object(folder / STUDY)
    if problem := _problem(found):
        raise SceneError(
            f"Study.open: {folder / STUDY} {problem}; expected the folder of a study that has run, "
            f"of format {_FORMAT}; a study that is run again from its script writes the file again "
            "once it is moved away"
        )
    plans = [
        Plan(row["parameters"], hash=row["case"], trunk=row["trunk"], error=row["error"])
        for row in found["rows"]
    ]
    return found["name"], found["run_axes"], plans


def _problem(found: Mapping[str, Any]) -> str:
    """Return in words what is wrong with a ledger; empty if nothing is."""
    if "study" not in found:
        return "is no whole study.json"
    if type(found["study"]) is not int or found["study"] != _FORMAT:
        return f"has format {shown(found['study'])}"
    rows, axes = found.get("rows"), found.get("run_axes")
    if not isinstance(found.get("name"), str):
        return f"is damaged: name is {shown(found.get('name'))}, not a text"
    if not isinstance(axes, list) or not all(isinstance(axis, str) for axis in axes):
        return f"is damaged: run_axes is {shown(axes)}, not a list of texts"
    if not isinstance(rows, list):
        return f"is damaged: rows is {shown(rows)}, not a list"
    for number, row in enumerate(rows):
        if wrong := _wrong(row):
            return f"is damaged: rows[{number}] {wrong}"
    return ""


def _wrong(row: Any) -> str:
    """Return in words what is wrong with a row of a ledger; empty if nothing is."""
    if not isinstance(row, dict):
        return f"is {shown(row)}, not an object"
    if not is_row(row.get("parameters")):
        return f"has the parameters {shown(row.get('parameters'))}, not names and values"
    for key in ("case", "trunk"):
        # It becomes part of a path.
        if not isinstance(row.get(key), str) or not re.fullmatch("([0-9a-f]{16})?", row[key]):
            return f"has {key} = {shown(row.get(key))}, not the 16 digits of a folder's name"
    if not isinstance(row.get("error"), str):
        return f"has error = {shown(row.get('error'))}, not a text"
    try:
        canonical(row["parameters"], "parameters")
    except SceneError as error:
        return f"has {error}"
    return ""


def _numbered(rows: Iterable[Any]) -> Iterable[tuple[tuple[str, int], Any]]:
    """Yield each row with a key: its parameters, and how often they came before."""
    before: Counter[str] = Counter()
    for row in rows:
        text = canonical(row.row if isinstance(row, Plan) else row["parameters"], "the row")
        yield (text, before[text]), row
        before[text] += 1
