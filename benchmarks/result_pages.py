"""Lines of results in files, and the pages of the documentation that hold their tables."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Line = dict[str, Any]


def chosen(
    doc: str | None, results: Path, cases: Iterable[str], figures: bool = False
) -> tuple[Namespace, list[str]]:
    """Return what a command line says, and the cases that it asks for and the file lacks.

    With `figures` it may name a folder for these, and then runs no case without `--only`.
    """
    parser = ArgumentParser(description=doc, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=results)
    parser.add_argument("--only", default="", help="cases whose names begin so")
    parser.add_argument("--again", action="store_true", help="cases that are in the file too")
    parser.add_argument("--write", action="store_true", help="the table of the page")
    if figures:
        parser.add_argument("--figures", type=Path, help="draw into this folder, run nothing")
    arguments = parser.parse_args()
    if figures and arguments.figures and not arguments.only:
        return arguments, []
    done = set() if arguments.again else {x["case"] for x in load(arguments.output)}
    return arguments, [c for c in cases if c.startswith(arguments.only) and c not in done]


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


def setting(text: str) -> tuple[str, Any]:
    """Return name and value of an argument; a value that is no JSON is a text."""
    name, _, said = text.partition("=")
    try:
        return name, json.loads(said)
    except json.JSONDecodeError:
        return name, said
