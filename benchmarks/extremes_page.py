"""The map of the extremes as Markdown: a table for each group, then what the program says."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from result_pages import Line, filled

PAGE = Path(__file__).resolve().parents[1] / "docs/extremes.md"
BEGIN, END = "<!-- map: begin -->", "<!-- map: end -->"

#: Headings by group; "{kind}" is where it was measured.
TITLES = {
    "water": "Water",
    "solid": "Solids",
    "contact": "Contact",
    "geometry": "Geometry and index widths",
    "pairs of water": "Pairs, water",
    "pairs of solids": "Pairs, solids",
}

#: What the page calls the outcomes of the lines.
WORDS = {
    "holds": "passed", "refused": "rejected", "named": "detected", "warned": "warning",
    "wrong": "silent error",
}  # fmt: skip

#: Words of lines that say an axis' meaning in another way than the page.
_SAID = {
    "J outside 0.05 to 20 is named as crushed, inverted or torn":
        "J outside 0.05 to 20 is detected as compression or tension",
}  # fmt: skip

#: What differs from probe to probe in one and the same message.
_NUMBERS = re.compile(r"[-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")

#: Longest message that is shown whole.
_SHOWN = 330


def number(value: float | None) -> str:
    """Return a number in few digits."""
    return "–" if value is None else f"{value:.3g}"


def word(outcome: str) -> str:
    """Return what the page calls an outcome."""
    return WORDS.get(outcome, outcome)


def beyond(line: Line) -> str:
    """Return the furthest of the single values beyond an axis, where all of them hold."""
    if line["side"] != "upper" or line["holds_to"] is None:
        return ""
    more = [(v, outcome) for v, outcome, *_ in line["probes"] if v > line["holds_to"]]
    if not more or any(outcome != "holds" for _, outcome in more):
        return ""
    return f", also at {max(v for v, _ in more):.5g}"


def span(line: Line | None) -> str:
    """Return how far a side holds, and how it breaks."""
    if line is None:
        return "–"
    if line["breaks_at"] is None:
        held = number(line["holds_to"]) + beyond(line)
        worst = f"; {word(line['worst'])} at {line['worst_at']:.3g}"
        return held if line["worst"] == "holds" else held + worst
    text = f"{number(line['holds_to'])}, then {word(line['outcome'])}"
    if line["worst"] not in ("holds", line["outcome"], "refused", "named"):
        text += f"; {word(line['worst'])} at {line['worst_at']:.3g}"
    return text


def both(lines: dict[str, Line]) -> str:
    """Return a side of all precisions, once where they say the same."""
    texts = {precision: span(line) for precision, line in lines.items()}
    if len(set(texts.values())) <= 1:
        return next(iter(texts.values()), "–")
    return "; ".join(f"{precision}: {text}" for precision, text in texts.items())


def table(lines: Sequence[Line]) -> list[str]:
    """Return the rows of one group."""
    rows = [
        "| axis | base | promised | passes down to | passes up to |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name in dict.fromkeys(line["axis"] for line in lines):
        own = [line for line in lines if line["axis"] == name]
        one = own[0]
        found = {
            side: {x["precision"]: x for x in own if x["side"] == side}
            for side in ("lower", "upper")
        }
        promised = "–"
        if one["envelope"] is not None:
            promised = " to ".join(number(v) for v in one["envelope"])
        says = f"; {_SAID.get(one['says'], one['says'])}" if one["says"] else ""
        unit = "" if one["unit"] == "1" else f" [{one['unit']}]"
        rows.append(
            f"| **{name}**{unit}: {one['meaning']}{says} | {number(one['base'])} | {promised} | "
            f"{both(found['lower'])} | {both(found['upper'])} |"
        )
    return rows


def messages(lines: Sequence[Line]) -> list[str]:
    """Return each kind of message of those that did not hold, with the axes that gave it."""
    found: dict[str, tuple[str, str, list[str]]] = {}
    for line in lines:
        for value, outcome, message, _ in line["probes"]:
            if outcome == "holds":
                continue
            # What the numbers leave is the rule; trees of problems are shown by their first.
            text = re.sub(r"^\d+ problems:\s+1\. ", "", message).split("\n")[0]
            kind = outcome + _NUMBERS.sub("#", text)[:120]
            where = f"{line['axis']} {value:.3g}"
            if kind not in found:
                found[kind] = (outcome, text, [where])
            elif not any(w.rpartition(" ")[0] == line["axis"] for w in found[kind][2]):
                found[kind][2].append(where)
    rows = []
    for outcome, text, where in found.values():
        shown = text if len(text) <= _SHOWN else text[:_SHOWN].rsplit(" ", 1)[0] + " ..."
        more = f" and {len(where) - 4} more axes" if len(where) > 4 else ""
        shown = shown.replace("`", "'")
        rows.append(f"- {word(outcome)} ({', '.join(where[:4])}{more}): `{shown}`")
    return rows


def tables(lines: Sequence[Line]) -> str:
    """Return everything between the marks."""
    text: list[str] = []
    for kind in dict.fromkeys(line["device_kind"] for line in lines):
        here = [line for line in lines if line["device_kind"] == kind]
        groups = dict.fromkeys(line["group"] for line in here)
        for group in sorted(groups, key=lambda g: list(TITLES).index(g) if g in TITLES else 99):
            some = [line for line in here if line["group"] == group]
            text += [f"### {TITLES.get(group, group)}, on {kind}", "", *table(some), ""]
        text += [f"### What the program says, on {kind}", "", *messages(here), ""]
        probes = sum(len(line["probes"]) for line in here)
        commits = ", ".join(dict.fromkeys(str(line["commit"])[:12] for line in here))
        text += [f"{probes} probes on {kind}, at {commits}.", ""]
    return "\n".join(text).rstrip()


def page(lines: Sequence[Line]) -> str:
    """Return the documentation page with the map of the lines in it."""
    return filled(PAGE, BEGIN, END, tables(lines))
