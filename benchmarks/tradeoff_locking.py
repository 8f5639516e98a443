"""The table of docs/anti-locking.md: what relaxes or smooths a body's state, on the same cases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from atlas_data import CASES
from atlas_page import percent, times
from result_pages import Line, filled, markdown
from tradeoff_options import BASELINE, OPTIONS
from tradeoff_table import ROOT, newest, number

LOCKING = ROOT / "docs/anti-locking.md"
BEGIN, END = "<!-- anti-locking: benchmarks/tradeoff.py write -->", "<!-- end of anti-locking -->"

#: Of each kind: the rows beside those of the group "smoothing", and the value of each case.
ROWS = {
    "water": (
        (BASELINE, "FLIP", "linear, PIC-FLIP 0.95", "F-bar one-volume-gradient",
         "F-bar two-volume", "F-bar split"),
        {
            "hydrostatic": "bed", "sloshing": "amplitude", "dam-break": "front_speed",
            "ritter": "profile", "vortex": "kinetic_left", "floating-block": "swing",
        },
    ),
    "solid": (
        (BASELINE, "LinearElastic", "solid F-bar one-volume-gradient", "solid F-bar two-volume",
         "solid F-bar split"),
        {"mode": "period", "bar": "period", "mode-incompressible": "period", "spin": "angle"},
    ),
}  # fmt: skip


def told(line: Line | None, value: str) -> str:
    """Return error, change of energy and cost in words."""
    if line is None:
        return ""
    if line["failed"]:
        return "breaks"
    error = line["errors"].get(value)
    text = "–" if error is None else percent(error)
    drift = line.get("energy_drift")
    energy = "" if drift is None else f" · {number(drift, '+.1%')}"
    return f"{text}{energy} · {times(line['cost'])}"


def rows_of(kind: str, lines: Mapping[tuple[str, str], Line]) -> Iterator[list[str]]:
    """Return a heading, then a row for each option."""
    beside, values = ROWS[kind]
    yield [kind, *(f"{c}: {v.replace('_', ' ')}" for c, v in values.items())]
    chosen = [o for o in OPTIONS if o.name in beside or o.group == "smoothing"]
    for option in chosen:
        own = [told(lines.get((option.name, c)), v) for c, v in values.items()]
        if any(own):
            yield [option.name, *own]


def locking_page(lines: Sequence[Line]) -> str:
    """Return the page with the tables of the lines of a CPU in it."""
    found = newest(line for line in lines if line["device_kind"] == "cpu")
    assert all(CASES[c] for _, values in ROWS.values() for c in values)
    text = []
    for kind in ROWS:
        text += [*markdown(rows_of(kind, found)), ""]
    return filled(LOCKING, BEGIN, END, "\n".join(text).rstrip())
