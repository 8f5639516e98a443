"""Figures of docs/elements.md: beams under water by their modulus, the tip of a column in time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from result_pages import Line, append, load

from libmpm._src.cli import bench
from support import element_load_cases as loads
from support.sagging_beam import sunk_exactly

ROOT = Path(__file__).resolve().parents[1]
#: A line a column: time (s) and how far its tip has gone (mm).
COLUMNS = ROOT / "benchmarks/results/elastic_column.jsonl"
#: Weight of water and beam, N/m; weight of water, N/m³; cells of 0.25 m.
_LOAD, _WATER, _CELL = 9.81 * 600.0, 9810.0, 0.25
#: Beams: (label, a case's name before and after the modulus, marker).
BEAMS = (
    ("particles", "beam under water, E = ", " Pa, 4 cells, particles", "o"),
    ("elements, h = Δx/2", "beam under water, E = ", " Pa, 4 cells, h = Δx/2", "s"),
    ("elements, with a contact", "beam under water that runs along it, E = ",
     " Pa, 4 cells, h = Δx/2", "^"),
)  # fmt: skip
#: Columns in cells of 4 mm: label -> arguments of `column_motion`.
TIPS: dict[str, dict[str, Any]] = {
    "particles": {"edge": None},
    "elements, h = Δx/2, on held nodes": {},
    "elements, h = Δx/2, pinned": {"pinned": True},
    "elements, h = Δx, pinned": {"edge": 1.0, "pinned": True},
}


def draw_beams(lines: list[Line], path: Path) -> None:
    """Draw how far the middle of a beam under water sinks, and that over level water's, by E."""
    newest = {line["case"]: line["values"] for line in lines}
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    moduli = np.geomspace(2e5, 5e8, 30)
    plain = np.array([loads.membrane(e, _LOAD) for e in moduli])
    ponds = np.array([loads.membrane(e, _LOAD, ponding=_WATER) for e in moduli])
    exact = np.array([sunk_exactly(e, _CELL) for e in moduli])
    wet = ponds < 1.0  # no end falls dry
    for axes, over in ((left, np.ones_like(exact)), (right, exact)):
        axes.plot(moduli, exact / over, "k-", lw=1, label="level water, any deflection")
        axes.plot(moduli, plain / over, "0.5", lw=1, ls="--", label="formula")
        axes.plot(moduli[wet], (ponds / over)[wet], "0.5", lw=1, ls=":", label="with ponding")
    for k, (label, before, after, marker) in enumerate(BEAMS):
        cases = [c for c in newest if c.startswith(before) and c.endswith(after)]
        points = sorted(
            (float(c[len(before) : len(c) - len(after)]), newest[c]["metres"]) for c in cases
        )
        e, metres = np.array(points).T
        style: dict[str, Any] = {"marker": marker, "ls": "", "ms": 5, "mfc": "none"}
        left.plot(e, metres, color=f"C{k}", label=label, **style)
        level = np.array([sunk_exactly(x, _CELL) for x in e])
        right.plot(e, metres / level, color=f"C{k}", **style)
    right.axhspan(0.94, 1.06, color="0.93", zorder=0)
    right.set_ylim(0.8, 1.2)
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("modulus [Pa]")
    left.set_yscale("log")
    left.set_ylabel("deflection of the middle [m]")
    right.set_ylabel("over that under level water")
    left.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def draw_columns(path: Path) -> None:
    """Draw the tip of a column in a dam break over time; columns that the file lacks are run."""
    newest = {line["case"]: line for line in load(COLUMNS)}
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    for k, (label, given) in enumerate(TIPS.items()):
        if label not in newest:
            _, series = loads.column_motion(**given)
            newest[label] = {
                "case": label, "time": series[:, 0].round(5).tolist(),
                "tip": series[:, 1].round(3).tolist(), "commit": bench.commit(),
            }  # fmt: skip
            append(COLUMNS, newest[label])
        line = newest[label]
        axes.plot(line["time"], line["tip"], color=f"C{k}", lw=1.2, label=label)
    # What the guide bounds the peak by.
    axes.add_patch(Rectangle((0.2, 42), 0.07, 8, color="0.9", zorder=0, label="bound of the peak"))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tip [mm]")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110, metadata={"Software": None})
