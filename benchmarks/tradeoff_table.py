"""The trade-off table as Markdown, and the documentation page that holds it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median

from result_pages import Line, filled, markdown
from tradeoff_cases import CHANGING, MEASURED
from tradeoff_options import BASELINE, OPTIONS

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/tradeoff.jsonl"
PAGE = ROOT / "docs/method-tables.md"
BEGIN, END = "<!-- table: benchmarks/tradeoff.py write -->", "<!-- end of table -->"


def seconds(line: Line) -> float:
    """Return the time that a simulated second takes, s."""
    own = line["device_kind"] == "cpu" and line["threads"] == 1
    return float(line["processor_s" if own else "wall_s"] / line["simulated_s"])


def newest(lines: Iterable[Line]) -> dict[tuple[str, str], Line]:
    """Return the last line of each option and case; of the baseline, which runs again and again,
    the one with the median time of its last commit."""
    found: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        found.setdefault((line["option"]["name"], line["case"]), []).append(line)
    rows = {k: some[-1] for k, some in found.items()}
    for k, some in found.items():
        last = [line for line in some if line["commit"] == some[-1]["commit"]]
        if k[0] == BASELINE and (ran := [line for line in last if not line["failed"]]):
            rows[k] = sorted(ran, key=seconds)[len(ran) // 2] | {"cost": 1.0}
    return rows


def cell(line: Line | None, name: str, how: str, expected: Mapping[str, float]) -> str:
    """Return a value, or its error where the format has a sign."""
    if line is None:
        return ""
    if line["failed"]:
        return line["failed"].partition(":")[0]
    value = line["errors" if how.startswith("+") else "values"].get(name)
    return "–" if value is None else number(value, how)


def number(value: float, how: str) -> str:
    """Return a number in words, zero without a sign."""
    text = format(value, how)
    return text if any(c in text for c in "123456789") else text.lstrip("+-")


def rows_of(kind: str, lines: Mapping[tuple[str, str], Line]) -> Iterator[list[str]]:
    """Return the rows of the table of one kind: a heading, then an option each."""
    used = [m for m in MEASURED if m.kind == kind and m.shown]
    yield [
        "option", "bytes a particle", "a node", "cost",
        *(head for m in used for head, _ in m.shown.values()),
        *(f"{m.name}: energy" for m in used if m.energy is not None),
    ]  # fmt: skip
    for option in OPTIONS:
        own = {m.name: lines[option.name, m.name] for m in used if (option.name, m.name) in lines}
        if not own:
            continue
        ran = [line for line in own.values() if line.get("cost") is not None]
        sizes = ran or [line for line in own.values() if "bytes_per_node" in line]
        row = [option.name, "", "", ""]
        if sizes:
            row[1:3] = [
                f"{max(s[k] for s in sizes)}" for k in ("bytes_per_particle", "bytes_per_node")
            ]
        if ran:
            row[3] = f"{median(line['cost'] for line in ran):.1f}"
        for m in used:
            row += [cell(own.get(m.name), k, how, m.expected) for k, (_, how) in m.shown.items()]
        for m in used:
            if m.energy is not None:
                line = own.get(m.name)
                drift = None if line is None else line.get("energy_drift")
                row.append("" if drift is None else number(drift, "+.1%"))
        yield row


def broken(lines: Iterable[Line]) -> list[str]:
    """Return what failed, an entry for each option and message."""
    found: dict[tuple[str, str], list[str]] = {}
    order = [o.name for o in OPTIONS]
    for line in sorted(lines, key=lambda line: order.index(line["option"]["name"])):
        if line["failed"]:
            kind, _, text = line["failed"].partition(": ")
            # Step, time and particle differ from case to case.
            text = text.partition(" at step ")[0]
            text = text.partition(": ")[2] if ": " in text else text
            found.setdefault((line["option"]["name"], f"{kind}, {text}"), []).append(line["case"])
    return [f"- {name}, on {', '.join(some)}: {text}" for (name, text), some in found.items()]


def spread(lines: Iterable[Line]) -> str:
    """Return the spread of the baseline's runs in words, by case."""
    found: dict[str, list[float]] = {}
    for line in lines:
        if line["option"]["name"] == BASELINE:
            found.setdefault(line["case"], []).append(line["baseline_spread"])
    return ", ".join(f"{case} {median(s):.0%} (at most {max(s):.0%})" for case, s in found.items())


def of_methods(line: Line) -> bool:
    """Return whether a line belongs into these tables: the others are the atlas's."""
    shown = any(m.name == line["case"] and m.shown for m in MEASURED)
    return shown and line["option"]["group"] not in (*CHANGING, "F-bar size")


def tables(lines: Sequence[Line]) -> str:
    """Return the tables of each size and device as Markdown."""
    text = []
    lines = [line for line in lines if of_methods(line)]
    places = dict.fromkeys((line["level"], line["device_kind"]) for line in lines)
    for level, kind in places:
        some = [line for line in lines if (line["level"], line["device_kind"]) == (level, kind)]
        rows = newest(some)
        device = next(line["device"] for line in some if "device" in line)
        for what in ("water", "solid"):
            title = {"water": "Water", "solid": "Solids"}[what]
            text += [f"### {title}, size {level}", "", *markdown(rows_of(what, rows)), ""]
        if failed := broken(rows.values()):
            text += ["What broke:", "", *failed, ""]
        particles = {k[1]: line["particles"] for k, line in rows.items() if "particles" in line}
        text += [
            f"Measured on {device}. Particles: "
            + ", ".join(f"{case} {n:,}" for case, n in particles.items())
            + f". The baseline beside itself differs in time by: {spread(some)}.",
            "",
        ]
    return "\n".join(text).rstrip()


def page(lines: Sequence[Line]) -> str:
    """Return the documentation page with the table of the lines in it."""
    return filled(PAGE, BEGIN, END, tables(lines))
