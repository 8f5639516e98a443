"""``study.json``: the rows that a folder has ever been asked for, and the cases they became."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from libmpm._src.errors import OutputError, SceneError
from libmpm._src.study.files import STUDY, read_object, write_shared
from libmpm._src.study.locks import locked
from libmpm._src.study.plan import Plan
from libmpm._src.study.rows import canonical
from libmpm._src.values import plain

__all__ = ["read_ledger", "update_ledger"]

#: Number of the layout of ``study.json``.
_FORMAT = 1


def update_ledger(folder: Path, name: str, run_axes: Sequence[str], plans: Sequence[Plan]) -> None:
    """Add rows to the ledger of a folder, or renew what it says of them.

    Raises `OutputError` if there is a ledger that this version cannot read.
    """
    path = folder / STUDY
    with locked(folder / f"{STUDY}.lock"):
        found = read_object(path)
        if path.exists() and found.get("study") != _FORMAT:
            raise OutputError(
                f"{path} {_layout(found)}; expected format {_FORMAT}. It is not replaced: it names "
                "the rows of the cases; restore it, move it away, or choose another folder"
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
    if found.get("study") != _FORMAT:
        raise SceneError(
            f"Study.open: {folder / STUDY} {_layout(found)}; expected the folder of a study that "
            f"has run, of format {_FORMAT}"
        )
    plans = [
        Plan(row["parameters"], hash=row["case"], trunk=row["trunk"], error=row["error"])
        for row in found["rows"]
    ]
    return found["name"], found["run_axes"], plans


def _layout(found: Mapping[str, Any]) -> str:
    """Return in words what is wrong with a ledger of another format."""
    return f"has format {found['study']!r}" if "study" in found else "is no whole study.json"


def _numbered(rows: Iterable[Any]) -> Iterable[tuple[tuple[str, int], Any]]:
    """Yield each row with a key: its parameters, and how often they came before."""
    before: Counter[str] = Counter()
    for row in rows:
        text = canonical(row.row if isinstance(row, Plan) else row["parameters"], "the row")
        yield (text, before[text]), row
        before[text] += 1
