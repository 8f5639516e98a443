"""Random debris fields against a wall in air, in space: blocks of particles and of elements.

    python benchmarks/debris_elements.py [--output FOLDER] [--fields 100] [--cell-size 0.025]
                                         [--blocks 8] [--device cpu] [--workers N]
                                         [--threads-pool N]
                                         [--columns FILE] [--write]

Disordered fields of Bonus (2023), 10.4, as examples/debris_study/in_air.py draws them: blocks of
0.5 x 0.1 x 0.05 m, E 1e6 Pa, nu 0, 1 m/s, no gravity. Each field runs as particles (eight a cell)
and as tetrahedra, h = dx/2; a study that was stopped continues from its folder. On one GPU many
small scenes share it best from threads of one process, `--threads-pool 12`. Printed, and
written into docs/elements.md with --write: the regressions of the source with both, and the largest
load of each field as elements over that as particles. One JSON line goes to
benchmarks/results/debris_elements.jsonl. `--columns`: what was found goes to a file instead, and
where that is there, nothing runs and the tables are made of it. `--json FILE`: where the line goes
instead.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from result_pages import append, filled

import libmpm
from libmpm import analysis
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "examples/debris_study"))

import record  # noqa: E402
from in_air import MEASURES, InAir, regressions  # noqa: E402

RESULTS = ROOT / "benchmarks/results/debris_elements.jsonl"
PAGE = ROOT / "docs/elements.md"
MARKS = "<!-- table: benchmarks/debris_elements.py --write -->", "<!-- end of fields -->"
KINDS: dict[str, float | None] = {"particles": None, "elements": 0.5}
#: Response -> what it is called.
LOADS = {"f_max": "largest load", "f_first": "first peak", "impulse": "impulse"}


def run(given: argparse.Namespace) -> dict[str, Any]:
    """Return what both studies have found, by columns, and what they cost."""
    found: dict[str, Any] = {
        "fields": given.fields, "blocks": given.blocks, "cell": given.cell_size,
        "device": given.device, "seconds": {}, "columns": {},
        "commit": bench.commit(), "version": libmpm.__version__,
    }  # fmt: skip
    for kind, edge in KINDS.items():
        made = InAir(cell_size=given.cell_size, blocks=given.blocks, dimension=3, edge=edge)
        study = made.random(given.output / kind, given.fields, **record.sharing(given))
        result, seconds = record.run(study, given)
        found["seconds"][kind] = round(seconds, 1)
        found["columns"][kind] = {
            name: [float(x) for x in result[name]]
            for name in (*MEASURES, *LOADS, "particles", "steps")
        }
    return found


def numbers(fit: analysis.Regression) -> dict[str, Any]:
    """Return what a regression says, as JSON has it."""
    return {"terms": {n: float(c) for n, c in fit.coefficients.items()}, "r2": float(fit.r_squared)}


def spread(ratio: np.ndarray[Any, Any]) -> str:
    """Return median and the middle four fifths."""
    low, middle, high = np.quantile(ratio, (0.1, 0.5, 0.9))
    return f"{middle:.3f} ({low:.2f} to {high:.2f})"


def table(line: dict[str, Any]) -> str:
    """Return the tables of a line, in Markdown."""
    rows = ["| elements over particles, by field | median (10 to 90 %) |", "| --- | --- |"]
    rows += [f"| {LOADS[name]} | {said} |" for name, said in line["ratios"].items()]
    rows += ["", "| largest load, N | particles | R² | elements | R² |", "| --- " * 5 + "|"]
    for name in line["fits"]["particles"]:
        cells = [name]
        for kind in KINDS:
            fit = line["fits"][kind][name]
            cells += [
                " ".join(f"{c:+.1f} {t}" for t, c in fit["terms"].items()), f"{fit['r2']:.2f}"
            ]  # fmt: skip
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--fields", type=int, default=100)
    parser.add_argument("--blocks", type=int, default=8, help="most blocks of a field")
    parser.add_argument("--cell-size", type=float, default=0.025, help="m")
    record.add_arguments(parser, "debris-elements")
    parser.add_argument("--columns", type=Path, help="file of what was found")
    parser.add_argument("--write", action="store_true", help="the tables of docs/elements.md")
    given = parser.parse_args()
    if given.columns and given.columns.is_file():
        found = json.loads(given.columns.read_text(encoding="utf-8"))
    else:
        found = run(given)
    if given.columns and not given.columns.is_file():
        given.columns.write_text(json.dumps(found), encoding="utf-8")
        print(found["seconds"])
        return 0
    columns = {
        kind: {name: np.array(values) for name, values in of.items()}
        for kind, of in found.pop("columns").items()
    }
    line = {"case": "random fields in air, in space"} | found | {
        "ratios": {n: spread(columns["elements"][n] / columns["particles"][n]) for n in LOADS},
        "fits": {
            kind: {name: numbers(fit) for name, fit in regressions(of).items()}
            for kind, of in columns.items()
        },
        "particles": {k: round(float(of["particles"].mean())) for k, of in columns.items()},
        "steps": {k: round(float(of["steps"].mean())) for k, of in columns.items()},
    }  # fmt: skip
    append(given.json or RESULTS, line)
    print(table(line))
    if given.write:
        PAGE.write_text(filled(PAGE, *MARKS, table(line)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
