"""Lines of results in files, and the pages of the documentation that hold their tables."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Line = dict[str, Any]


def load(path: Path) -> list[Line]:
    """Return the lines of a file; none where there is no file."""
    if not path.exists():
        return []
    return [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines() if text]


def append(path: Path, line: Line) -> None:
    """Add a line to a file, in a folder that is made where it is not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")


def markdown(rows: Iterable[list[str]]) -> list[str]:
    """Return rows as a table."""
    head, *rest = rows
    return [f"| {' | '.join(r)} |" for r in (head, ["---"] * len(head), *rest)]


def filled(path: Path, begin: str, end: str, tables: str) -> str:
    """Return the text of a page with tables in place of what stands between two marks."""
    before, _, rest = path.read_text(encoding="utf-8").partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n\n{tables}\n\n{end}{after}"
