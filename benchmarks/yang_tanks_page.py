"""Tables and figure of docs/anti-locking.md, "Tanks of Yang (2016)", from lines of `yang_tanks`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from result_pages import Line, filled, load, markdown
from yang_tanks import LONG, METHODS, REAL, SHORT, SOFT, WIDTH

ROOT = Path(__file__).resolve().parents[1]
PAGE, FIGURE = ROOT / "docs/anti-locking.md", ROOT / "docs/figures/yang_tanks.png"
MARKS = "<!-- {} of benchmarks/yang_tanks.py -->", "<!-- end of {} -->"
CELLS = (4, 8, 16)
#: Columns of the tables: particles, K and duration, by the number of cells.
ALONG = {f"{c} cells": (c, 3, SOFT, LONG) for c in CELLS}
ACROSS = {f"{c} cells": (c, 3, REAL, SHORT) for c in CELLS} | {"8, 6 x 6": (8, 6, REAL, SHORT)}
LASTING = {f"{c} cells": (c, 3, SOFT, LONG) for c in CELLS} | {
    "8 cells, K 2.2e9": (8, 3, REAL, LONG)
}
STYLES = "osv^D*x"
Column = tuple[int, int, float, float]


class Lines:
    """The newest lines, by what they are of."""

    def __init__(self, path: Path) -> None:
        """Read a file."""
        names = ("degrees", "cells", "per_axis", "bulk_modulus", "until", "method")
        self.by = {tuple(x[n] for n in names): x for x in load(path)}

    def get(self, degrees: int, column: Column, method: str) -> Line | None:
        """Return the line of a run, or None."""
        return self.by.get((degrees, *column, method))


def value_of(line: Line | None, error: bool) -> str:
    """Return loss of height and range of R_b, with its L² on demand, in words."""
    if line is None:
        return "not run"
    if "failed" in line:
        return f"ended at {line['reached']:.2g} s"
    v = line["values"]
    lost = 100 * (1 - v["h_eq"] / WIDTH)
    text = f"{lost:.3g} %" if abs(lost) >= 1e-3 else "< 0.001 %"
    text += f" · {v['R_b_least']:.2f} to {v['R_b_most']:.2f}"
    text += f" · {v['R_b_L2']:.3f}" if error else ""
    return text + (f" · {v['outside']:.0f} out" if v["outside"] else "")


def rows(
    lines: Lines, degrees: int, columns: dict[str, Column], error: bool = False
) -> Iterator[list[str]]:
    """Return a heading, then a row a method."""
    yield ["", *columns]
    for method in METHODS:
        own = [value_of(lines.get(degrees, c, method), error) for c in columns.values()]
        yield [method, *own]


def draw(lines: Lines) -> None:
    """Draw the loss of height and the error of R_b against the cells, by method."""
    figure = Figure(figsize=(8.5, 3.0), layout="constrained")
    axes: Any = figure.subplots(1, 3)
    panels: Sequence[tuple[str, dict[str, Column], str]] = (
        ("height lost in 0.3 s, %", ACROSS, "h_eq"),
        ("L² of R_b - 1, 0.3 s", ACROSS, "R_b_L2"),
        ("height lost in 3 s, K 2.2e7 Pa, %", LASTING, "h_eq"),
    )
    for ax, (title, columns, name) in zip(axes, panels, strict=True):
        for k, method in enumerate(METHODS):
            found = [(c, lines.get(45, columns[f"{c} cells"], method)) for c in CELLS]
            points = [(c, x["values"][name]) for c, x in found if x and "values" in x]
            x, y = [p[0] for p in points], [p[1] for p in points]
            if name == "h_eq":
                y = [max(100 * (1 - v / WIDTH), 1e-4) for v in y]
            ax.loglog(x, y, f"{STYLES[k]}-", color=f"C{k}", ms=4, linewidth=1, label=method)
        ax.set_xticks(CELLS, [str(c) for c in CELLS])
        ax.minorticks_off()
        ax.set_title(title, fontsize=8)
        ax.set_xlabel("cells a length", fontsize=7)
        ax.tick_params(labelsize=7)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, fontsize=7, ncols=len(names), loc="outside lower center")
    figure.savefig(FIGURE, dpi=80, metadata={"Software": None})


def write(results: Path) -> None:
    """Write the figure, and the tables into the page."""
    lines = Lines(results)
    tables = {
        "tanks along the grid": rows(lines, 0, ALONG),
        "tanks across the grid": rows(lines, 45, ACROSS, error=True),
        "tanks across the grid for 3 s": rows(lines, 45, LASTING),
    }
    for name, table in tables.items():
        begin, end = (m.format(name) for m in MARKS)
        PAGE.write_text(filled(PAGE, begin, end, "\n".join(markdown(table))), encoding="utf-8")
    draw(lines)
