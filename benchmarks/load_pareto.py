"""Error of loads and discharges against cost, by cells, transfer and wall.

    python benchmarks/load_pareto.py [--budget SECONDS]     a quarter of an hour on one thread
    python benchmarks/load_pareto.py --draw                 docs/figures/load_pareto.png and the
                                                            table of docs/tradeoff.md

The reference cases "surge-load", "gate" and "slot". Cost is processor time for a simulated second,
on one thread. One JSON line a run goes to benchmarks/results/load_pareto.jsonl; what the file has
is not run again.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path
from typing import Any

from result_pages import Line, append, filled, load, markdown

import libmpm
from libmpm import boundaries, cases
from libmpm._src.cli import bench
from libmpm.methods import Method, Transfer

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/load_pareto.jsonl"
FIGURE = ROOT / "docs/figures/load_pareto.png"
PAGE = ROOT / "docs/tradeoff.md"
MARKS = "<!-- table: benchmarks/load_pareto.py --draw -->", "<!-- end of loads -->"

#: What is measured, and the cells in the length that matters.
CASES = {
    "surge-load": ("load", "cells a depth", (4, 8, 16)),
    "gate": ("discharge", "cells in the opening", (2, 4)),
    "slot": ("discharge", "cells in the slot", (2, 4)),
}
TRANSFERS = {
    "APIC": "APIC",
    "AFLIP 0.95": Transfer(scheme="AFLIP", flip=0.95),
    "AFLIP 0.99": Transfer(scheme="AFLIP", flip=0.99),
    "FLIP": "FLIP",
}
WALLS = ("linear", "held")


def measure(case: str, cells: int, transfer: str, wall: str) -> Line:
    """Return the line of a run."""
    kind = boundaries.Slip if case == "surge-load" else boundaries.Separable
    options = cases.Options(
        method=Method(cfl=0.3, transfer=TRANSFERS[transfer]),  # type: ignore[arg-type]
        walls=kind(cell=wall),
    )
    began = time.process_time()
    line: dict[str, Any] = {"case": case, "cells": cells, "transfer": transfer, "walls": wall}
    result = cases.run(case, "reduced", options, device="cpu", threads=1, cells=cells)
    return line | {
        "values": dict(result.values), "cost": (time.process_time() - began) / result.simulated_s,
        "particles": result.particles, "steps": result.steps, "commit": bench.commit(),
        "version": libmpm.__version__,
    }  # fmt: skip


def table(lines: list[Line]) -> str:
    """Return values by case and cells, a row for each transfer and wall."""
    found = {(x["case"], x["cells"], x["transfer"], x["walls"]): x for x in lines}
    head = [f"{case}, {n}" for case, (_, _, some) in CASES.items() for n in some]
    rows = [["transfer, walls", *head]]
    for transfer in TRANSFERS:
        for wall in WALLS:
            row = [f"{transfer}, {wall}"]
            for case, (value, _, some) in CASES.items():
                for n in some:
                    line = found.get((case, n, transfer, wall))
                    row.append("" if line is None else f"{line['values'][value]:.3g}")
            rows.append(row)
    return "\n".join(markdown(rows))


def draw(lines: list[Line]) -> None:
    """Draw error against cost, a panel a case: colours are transfers, full marks linear walls."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(10, 3.6), layout="constrained")
    panels = figure.subplots(1, len(CASES), sharey=True)
    colours = dict(zip(TRANSFERS, ("#0072b2", "#d55e00", "#cc79a7", "#009e73"), strict=True))
    for panel, (case, (value, what, _)) in zip(panels, CASES.items(), strict=True):
        for transfer, colour in colours.items():
            for wall in WALLS:
                own = [x for x in lines if (x["case"], x["transfer"], x["walls"]) == (
                    case, transfer, wall)]  # fmt: skip
                own.sort(key=lambda x: x["cells"])
                panel.loglog(
                    [x["cost"] for x in own],
                    [max(abs(x["values"][value] - 1), 1e-3) for x in own],
                    "o-" if wall == "linear" else "o--",
                    color=colour, mfc=colour if wall == "linear" else "white", ms=5, lw=1,
                    label=f"{transfer}, {wall}",
                )  # fmt: skip
                for x in own:
                    place = (x["cost"], max(abs(x["values"][value] - 1), 1e-3))
                    panel.annotate(str(x["cells"]), place, fontsize=6, xytext=(3, 3),
                                   textcoords="offset points")  # fmt: skip
        panel.axhline(0.05, color="0.7", lw=0.8)
        panel.set_title(f"{case}: {value}, by {what}", fontsize=9)
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_xlim(panel.get_xlim()[0] / 1.5, panel.get_xlim()[1] * 1.5)
        panel.set_xlabel("processor s for a simulated s")
    panels[0].set_ylabel("error, parts")
    panels[-1].legend(frameon=False, fontsize=7)
    figure.savefig(FIGURE, dpi=130)


def main() -> int:
    """Run what is missing, or draw."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--budget", type=float, default=1e9, help="s of wall time")
    parser.add_argument("--draw", action="store_true")
    a = parser.parse_args()
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    if a.draw:
        lines = load(RESULTS)
        draw(lines)
        PAGE.write_text(filled(PAGE, *MARKS, table(lines)), encoding="utf-8")
        return 0
    done = {(x["case"], x["cells"], x["transfer"], x["walls"]) for x in load(RESULTS)}
    until = time.time() + a.budget
    finest = max(len(some) for _, _, some in CASES.values())
    wanted = [
        (case, some[k], transfer, wall)
        for k in range(finest)
        for case, (_, _, some) in CASES.items()
        if k < len(some)
        for transfer in TRANSFERS
        for wall in WALLS
    ]
    for one in wanted:
        if one in done or time.time() > until:
            continue
        line = measure(*one)
        append(RESULTS, line)
        print(*one, line["values"], f"{line['cost']:.2f}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
