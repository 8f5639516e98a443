"""The page of the atlas: the cheapest settings, what each axis does, where it was measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from atlas_data import CASES, LOSS, entries, finer, judged, latest
from result_pages import Line, filled, markdown
from tradeoff_options import BASELINE, OPTIONS, Option
from tradeoff_table import ROOT, broken, number, seconds

ATLAS = ROOT / "docs/atlas.md"
BEGIN, END = "<!-- atlas: benchmarks/tradeoff.py write -->", "<!-- end of atlas -->"
WITHIN = (0.05, 0.01)
#: Costs that differ by no more than what the baseline differs from itself are the same.
SAME = 1.15

#: Largest ρgH/K of a setting that may be chosen: beyond, water is no longer nearly incompressible.
STRAIN = 0.05

Entry = Mapping[str, Any]
#: Tables of the axes: heading, groups of options in it.
AXES = (
    ("Cells", ("cells",)),
    ("Particles per cell", ("particles",)),
    ("Bulk modulus", ("bulk modulus",)),
    ("Time step", ("step",)),
    ("Dimension", ("dimension",)),
    ("Precision and pipeline", ("precision", "pipeline")),
    ("Transfer", ("transfer",)),
    ("Kernel", ("kernel",)),
    ("F-bar", ("F-bar", "solid", "F-bar size")),
    ("Smoothing over cells", ("smoothing",)),
    ("Walls and layers", ("boundary",)),
    ("Contact", ("contact",)),
    ("Choices together", ("together",)),
)


def percent(value: float) -> str:
    """Return an error in percent, with two digits that count and at most three decimals."""
    size = abs(100 * value)
    decimals = 0 if size >= 10 else 1 if size >= 1 else 2 if size >= 0.1 else 3
    return number(100 * value, f"+.{decimals}f") + " %"


def times(cost: float) -> str:
    """Return a cost in words."""
    return f"{cost:.0f}" if cost >= 10 else f"{cost:.1f}" if cost >= 1 else f"{cost:.2f}"


def settled(entry: Entry, some: Sequence[Entry], value: str, error: float) -> bool:
    """Return whether an entry and what was measured of it with more cells are within an error."""
    return all(
        counts(e) and abs(e["errors"].get(value, math.inf)) <= error
        for e in (entry, *finer(entry, some))
    )


def choose(some: Sequence[Entry], value: str, error: float) -> Entry | None:
    """Return the cheapest entry that is within an error; of those that cost the same, the first."""
    good = [e for e in some if settled(e, some, value, error)]
    least = min((e["cost"] for e in good), default=0.0)
    return next((e for e in good if e["cost"] <= SAME * least), None)


def most_accurate(some: Sequence[Entry], value: str) -> Entry | None:
    """Return the entry with the least error that more cells do not make larger by a half."""
    sound = [e for e in some if value in e["errors"]]
    kept = [e for e in sound if settled(e, some, value, 1.5 * abs(e["errors"][value]) + 1e-4)]
    return min(kept, key=lambda e: abs(e["errors"][value]), default=None)


def counts(entry: Entry) -> bool:
    """Return whether a setting may be chosen.

    An error that is small because motion has died or because water gives way is small by accident,
    and laws are no settings.
    """
    strained = (entry["range"]["compression"] or 0.0) > STRAIN
    law = entry["choices"]["material"] != Option.material
    return not (entry["dissipates"] or strained or law)


def told(entry: Entry | None, value: str) -> str:
    """Return a setting with its cost and error in words."""
    if entry is None:
        return "none"
    return f"{entry['option']}: {times(entry['cost'])} ({percent(entry['errors'][value])})"


def cheapest(some: Sequence[Entry]) -> list[list[str]]:
    """Return the table of the cheapest settings of each value of each case."""
    rows = [
        ["case", "value", "baseline's error", *(f"within {100 * e:g} %" for e in WITHIN), "best"]
    ]
    for name, measured in CASES.items():
        own = [e for e in some if e["case"] == name]
        base = next((e for e in own if e["option"] == BASELINE), None)
        if base is None:
            continue
        for value in (k for k in measured.expected if k not in measured.apart):
            best = most_accurate(own, value)
            mark = "" if value in judged(measured) else " *"
            rows.append([
                name, value.replace("_", " ") + mark,
                percent(base["errors"][value]) if value in base["errors"] else "–",
                *(told(choose(own, value, error), value) for error in WITHIN), told(best, value),
            ])  # fmt: skip
    return rows


def effects(some: Sequence[Entry], groups: Sequence[str], rows: Mapping[Any, Line]) -> list[str]:
    """Return the tables of some groups of options, for water and for solids.

    Each cell has the error of the first judged value and the cost.
    """
    found = {(e["option"], e["case"]): e for e in some}
    text = []
    for kind, title in (("water", "Water"), ("solid", "Solids")):
        chosen = [
            o for o in OPTIONS
            if o.group in groups and any((o.name, n) in rows for n in CASES if _is(n, kind))
        ]  # fmt: skip
        if not chosen:
            continue
        beside = dict.fromkeys([*(o.beside for o in chosen), *(o.name for o in chosen)])
        names = [n for n in CASES if _is(n, kind) and any((o.name, n) in rows for o in chosen)]
        table = [[title, *(f"{n}: {judged(CASES[n])[0].replace('_', ' ')}" for n in names)]]
        for option in beside:
            line = [option]
            for n in names:
                if (option, n) in found:
                    e, value = found[option, n], judged(CASES[n])[0]
                    error = percent(e["errors"][value]) if value in e["errors"] else "–"
                    line.append(f"{error} · {times(e['cost'])}")
                else:
                    line.append("breaks" if (option, n) in rows else "")
            table.append(line)
        text += [*markdown(table), ""]
    return text


def _is(name: str, kind: str) -> bool:
    return CASES[name].kind == kind


def ranges(some: Sequence[Entry]) -> list[list[str]]:
    """Return the table of the ranges of each case."""

    def span(values: Iterable[float | None], how: str) -> str:
        own = sorted({v for v in values if v is not None})
        if not own:
            return ""
        low, high = (format(v, how) for v in (own[0], own[-1]))
        return low if low == high else f"{low} to {high}"

    columns = {
        "cells across": ("cells_across", "g"), "particles per cell": ("particles_per_cell", "g"),
        "ρgH/K": ("compression", ".1g"), "speed, parts of waves'": ("mach", ".1g"),
        "dimensions": ("dimension", "g"),
    }  # fmt: skip
    rows = [["case", "state", *columns, "CFL", "settings"]]
    for name, measured in CASES.items():
        own = [e for e in some if e["case"] == name]
        if own:
            rows.append([
                name, measured.state,
                *(span((e["range"][k] for e in own), how) for k, how in columns.values()),
                span((e["choices"]["cfl"] for e in own), ".2g"), str(len(own)),
            ])  # fmt: skip
    return rows


def duration(rows: Mapping[Any, Line]) -> float:
    """Return how long the runs of these lines take, s."""
    ran = [line for line in rows.values() if "simulated_s" in line]
    return sum(seconds(line) * line["simulated_s"] for line in ran)


def atlas(lines: Sequence[Line]) -> str:
    """Return all tables as Markdown, for each size and kind of device."""
    text = []
    for (level, kind), rows in latest(lines).items():
        some = entries(rows)
        device = next(line["device"] for line in rows.values() if "device" in line)
        own = [line for line in lines if (line["level"], line["device_kind"]) == (level, kind)]
        spreads = [line["baseline_spread"] for line in own if line["option"]["name"] == BASELINE]
        text += [
            f"## On a {'CPU' if kind == 'cpu' else 'GPU'}, size {level}",
            "",
            f"Measured on {device}: {len(rows)} runs, {duration(rows):.0f} s without the runs of "
            "the baseline between them. The baseline beside itself differs in time by "
            f"{median(spreads):.0%} in the median.",
            "",
            "### The cheapest setting",
            "",
            f"A setting counts if it loses at most {100 * LOSS:g} percentage points more of the "
            f"mechanical energy than the baseline, strains water by at most {100 * STRAIN:g} % and "
            "has the case's elastic law, and if what was measured of it with more cells does so "
            f"too; costs within {100 * (SAME - 1):.0f} % are the same.",
            "",
            *markdown(cheapest(some)),
            "",
        ]
        for title, groups in AXES:
            if made := effects(some, groups, rows):
                text += [f"### {title}", "", *made]
        if failed := broken(rows.values()):
            text += ["### What broke", "", *failed, ""]
        text += ["### Where it was measured", "", *markdown(ranges(some)), ""]
    return "\n".join(text).rstrip()


def atlas_page(lines: Sequence[Line], path: Path = ATLAS) -> str:
    """Return the page with the tables of the lines in it."""
    return filled(path, BEGIN, END, atlas(lines))
