"""What keeps water from flowing through a slot of two and four cells.

    python benchmarks/slot_choke.py              what is missing, ten minutes on one thread
    python benchmarks/slot_choke.py --write      the table of docs/tradeoff.md

The reference case "slot" by the transfer, the time in which F-bar relaxes volumes (in Δx/c₀), and
the stiffness of the water: bulk modulus over 200 ρ g d. One JSON line a run goes to
benchmarks/results/slot_choke.jsonl.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

from result_pages import Line, append, chosen, filled, load, markdown

import libmpm
from libmpm import boundaries, cases
from libmpm._src.cli import bench
from libmpm.methods import Method, Transfer

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/slot_choke.jsonl"
PAGE = ROOT / "docs/tradeoff.md"
MARKS = "<!-- table: benchmarks/slot_choke.py --write -->", "<!-- end of slots -->"

#: Cells in the slot, and stiffness.
COLUMNS = ((2, 1.0), (2, 10.0), (2, 100.0), (4, 1.0), (4, 10.0))
#: Transfer, share of velocity kept, time of F-bar (None: no F-bar), what keeps water from packing.
ROWS: dict[str, tuple[str, float, float | None, str]] = {
    "APIC, 35": ("APIC", 0.0, 35.0, ""),
    "AFLIP 0.95, 35": ("AFLIP", 0.95, 35.0, ""),
    "AFLIP 0.98, 35": ("AFLIP", 0.98, 35.0, ""),
    "AFLIP 0.99, 35": ("AFLIP", 0.99, 35.0, ""),
    "FLIP, 35": ("FLIP", 1.0, 35.0, ""),
    "FLIP, 10": ("FLIP", 1.0, 10.0, ""),
    "FLIP, 3": ("FLIP", 1.0, 3.0, ""),
    "FLIP, no F-bar": ("FLIP", 1.0, None, ""),
    "AFLIP 0.95, 3": ("AFLIP", 0.95, 3.0, ""),
    "AFLIP 0.99, 3": ("AFLIP", 0.99, 3.0, ""),
    "AFLIP 0.99, 10, shifting": ("AFLIP", 0.99, 10.0, "shifting"),
    "AFLIP 0.99, 35, density": ("AFLIP", 0.99, 35.0, "density"),
    "AFLIP 0.99, 10, density": ("AFLIP", 0.99, 10.0, "density"),
    "AFLIP 0.99, 3, density": ("AFLIP", 0.99, 3.0, "density"),
    "FLIP, 3, density": ("FLIP", 1.0, 3.0, "density"),
}
NAMES = {f"{row}; {n} cells; K x {k:g}": (row, n, k) for row in ROWS for n, k in COLUMNS}
#: The case's deeper basin and the slot, m.
DEPTH, OPENING, GRAVITY = 0.9, 0.1, 9.81


def measure(row: str, cells: int, stiffness: float) -> Line:
    """Return the line of a run."""
    scheme, share, time, packing = ROWS[row]
    flip = {"flip": share} if scheme == "AFLIP" else {}
    unit = OPENING / cells / math.sqrt(200 * GRAVITY * DEPTH * stiffness)
    fbar = (
        None
        if time is None
        else libmpm.FBar(
            time=time * unit, shifting=packing == "shifting", density=packing == "density"
        )
    )
    options = cases.Options(
        method=Method(cfl=0.3, transfer=Transfer(scheme=scheme, **flip)),  # type: ignore[arg-type]
        walls=boundaries.Separable(cell="linear"),
        fbar=fbar,
    )
    parameters: dict[str, Any] = {"cells": cells, "stiffness": stiffness}
    result = cases.run("slot", "reduced", options, device="cpu", threads=1, **parameters)
    return {
        "values": dict(result.values), "particles": result.particles, "steps": result.steps,
        "commit": bench.commit(), "version": libmpm.__version__,
    }  # fmt: skip


def table(lines: list[Line]) -> str:
    """Return the discharge of what it should be, a row for each method."""
    found = {x["case"]: x["values"]["discharge"] for x in lines}
    rows = [["transfer, time of F-bar", *(f"{n} cells, K × {k:g}" for n, k in COLUMNS)]]
    for row in ROWS:
        of_row = [found.get(name) for name, (own, _, _) in NAMES.items() if own == row]
        rows.append([row, *("" if x is None else f"{x:.2f}" for x in of_row)])
    return "\n".join(markdown(rows))


def main() -> int:
    """Run what is missing, or write the table."""
    a, wanted = chosen(__doc__, RESULTS, NAMES)
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    if a.write:
        PAGE.write_text(filled(PAGE, *MARKS, table(load(RESULTS))), encoding="utf-8")
        return 0
    for name in wanted:
        line = {"case": name} | measure(*NAMES[name])
        append(a.output, line)
        print(name, line["values"], flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
