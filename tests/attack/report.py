"""What the attacks have found so far, as a table and as a page of the documentation."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from attack.bars import AIMS, GOALS, done
from attack.catalogue import ATTACKS

__all__ = ["counted", "defects", "table", "write"]

#: Lines of results: attack, seed, commit -> counts.
LINES = Path(__file__).parents[2] / "benchmarks" / "results" / "attacks.jsonl"
#: Those of long runs (`attack.long_run`).
LONG = LINES.with_name("long_run.jsonl")
PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
_BEGIN, _END = "<!-- written by python -m tests.attack --write -->", "<!-- end -->"

Counts = list[dict[str, Any]]


def counted(folder: Path) -> Counts:
    """Return the records of all workers that have used a folder."""
    files = sorted(folder.glob("counts/*.json"))
    return [json.loads(p.read_text()) | {"file": p.stem} for p in files]


def defects(found: Counts) -> list[str]:
    """Return all defects, each with how to see it again."""
    return [
        f"{one['attack']}, seed {one['seed']}, case {defect['number']}: {defect['defect']}\n"
        f"  again: python -m tests.attack --replay .../kept/{one['attack']}-{one['seed']}-"
        f"{defect['number']}"
        for one in found
        for defect in one["defects"]
    ]


def table(found: Counts) -> str:
    """Return the outcomes by attack as text."""
    lines = []
    for name in dict.fromkeys(one["attack"] for one in found):
        mine = [one for one in found if one["attack"] == name]
        outcomes: Counter[str] = Counter()
        for one in mine:
            outcomes.update(one["outcomes"])
        cases, seconds = sum(o["cases"] for o in mine), sum(o["seconds"] for o in mine)
        lines.append(f"{name}: {cases} cases in {seconds:.0f} s")
        lines += [f"  {count:8d}  {outcome}" for outcome, count in sorted(outcomes.items())]
    return "\n".join(lines)


def write(folder: Path, collected: Sequence[Path] = ()) -> None:
    """Add what was counted to the lines of results, and write the tables of the page.

    `collected` are files of records (`attacks.json`, `long_run.json`) of other machines.
    """
    lines = _lines(LINES)
    found = [json.loads(path.read_text()) for path in collected]
    others = [one for records in found if isinstance(records, list) for one in records]
    long = _lines(LONG)
    long += [one for one in found if isinstance(one, dict) and one not in long]
    _store(LONG, long)
    for one in [*counted(folder), *others]:
        key = {k: one[k] for k in ("attack", "seed", "commit")}
        same = [line for line in lines if key.items() <= line.items()]
        if not same or one.get("file") not in same[0]["files"]:
            line = same[0] if same else key | {
                "cases": 0, "seconds": 0.0, "outcomes": {}, "defects": [], "files": [],
            }  # fmt: skip
            line["cases"] += one["cases"]
            line["seconds"] = round(line["seconds"] + one["seconds"], 1)
            line["outcomes"] = dict(Counter(line["outcomes"]) + Counter(one["outcomes"]))
            said = [d["defect"].splitlines()[0][:160] for d in one["defects"]]
            line["defects"] = sorted({*line["defects"], *said})
            line["files"].append(one["file"])
            if not same:
                lines.append(line)
    _store(LINES, lines)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(_BEGIN)
    _, _, after = rest.partition(_END)
    text = f"{_aims(lines)}\n\n{_tables(lines)}"
    PAGE.write_text(f"{before}{_BEGIN}\n\n{text}\n\n{_END}{after}", encoding="utf-8")


def _lines(path: Path) -> Counts:
    return [json.loads(x) for x in path.read_text().splitlines()] if path.exists() else []


def _store(path: Path, lines: Counts) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if lines:
        path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")


def _aims(lines: Counts) -> str:
    """Return a row an aim: what was counted over all commits, and of the latest sources alone."""
    rows = [
        "| aim | all commits | defects among them | the latest commit alone | defects |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name in AIMS:
        mine = [line for line in lines if line["attack"] == name]
        latest = [line for line in mine if line["commit"] == mine[-1]["commit"]]
        cells = []
        for some in (mine, latest):
            wrong = sum(_short(line["outcomes"])["defect"] for line in some)
            cells += [f"{done(some)[name]:,}", f"{wrong:,}"]
        if mine:
            cells[2] += f" ({latest[0]['commit']})"
        rows.append(f"| {GOALS[name]:,} {ATTACKS[name].unit} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _tables(lines: Counts) -> str:
    """Return a row an attack and commit; of commits with defects the latest and the largest."""
    rows = ["| attack | commit | cases | outcomes | defects |", "| --- | --- | --- | --- | --- |"]
    whats = {name: kind.what for name, kind in ATTACKS.items()}
    seen: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for line in lines:
        seen.setdefault((line["attack"], line["commit"]), []).append(line)
    latest = dict(list(seen))  # attack -> its last commit
    size = {key: sum(line["cases"] for line in mine) for key, mine in seen.items()}
    largest = {name: max(n for (of, _), n in size.items() if of == name) for name in latest}
    for (name, commit), mine in seen.items():
        # Defects of earlier sources stand in the lines of results alone.
        shown = latest[name] == commit or size[name, commit] == largest[name]
        if not shown and any(line["defects"] for line in mine):
            continue
        outcomes: Counter[str] = Counter()
        for line in mine:
            outcomes.update(_short(line["outcomes"]))
        wrong = outcomes.pop("defect", 0)
        said = ", ".join(f"{n:,} {what}" for what, n in sorted(outcomes.items()))
        cases = f"{size[name, commit]:,}"
        rows.append(f"| {name}: {whats[name]} | {commit} | {cases} | {said} | {wrong:,} |")
    return "\n".join(rows)


def _short(outcomes: dict[str, int]) -> Counter[str]:
    """Return the outcomes without the reader or scene that they are of."""
    found: Counter[str] = Counter()
    for outcome, count in outcomes.items():
        first, _, rest = outcome.partition(": ")
        found["defect" if first == "defect" else first if first == "chains" else rest or first] += (
            count
        )
    return found
