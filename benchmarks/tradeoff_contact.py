"""The table of docs/contact.md: bodies that meet with one field and with one each, same cases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from atlas_page import percent
from result_pages import Line, filled, markdown
from tradeoff_cases import MEASURED
from tradeoff_options import BASELINE
from tradeoff_table import ROOT, newest

CONTACT = ROOT / "docs/contact.md"
BEGIN, END = "<!-- contact: benchmarks/tradeoff.py write -->", "<!-- end of contact -->"
METHODS = {
    "APIC": (BASELINE, ""),
    "AFLIP 0.95": ("AFLIP 0.95", ", AFLIP 0.95"),
    "APIC, linear walls": ("linear walls", ", linear walls"),
}


def error(line: Line, value: str) -> str:
    """Return the error of a value in words."""
    if line["failed"]:
        return "breaks"
    found = line["errors"].get(value)
    return "–" if found is None else percent(found)


def rows_of(lines: Mapping[tuple[str, str], Line]) -> Iterator[list[str]]:
    """Return a heading, then a row for each value of each case and method."""
    yield ["case", "law", "value", "method", "error, one field", "error, contact", "time"]
    for measured in (m for m in MEASURED if m.meeting is not None):
        for value in measured.expected:
            for method, (one, more) in METHODS.items():
                with_contact = f"contact {measured.contact_law}{more}"
                own = [lines.get((name, measured.name)) for name in (one, with_contact)]
                if own[0] is None or own[1] is None:
                    continue
                costs = [line["cost"] for line in own if line]
                time = "–" if None in costs else f"{costs[1] / costs[0]:.2f}"
                told = [error(line, value) for line in own if line]
                law = measured.contact_law
                yield [measured.name, law, value.replace("_", " "), method, *told, time]


def contact_page(lines: Sequence[Line]) -> str:
    """Return the page with the table of the lines of a CPU in it."""
    found = newest(line for line in lines if line["device_kind"] == "cpu")
    return filled(CONTACT, BEGIN, END, "\n".join(markdown(rows_of(found))))
