"""Dry columns of sand against the experiments, by aspect ratio, resolution and ingredient.

    python benchmarks/column_collapse.py                     what is missing, on the CPU
    python benchmarks/column_collapse.py --cells 40 --aspect 4 7
    python benchmarks/column_collapse.py --ingredients       what the missed ones depend on
    python benchmarks/column_collapse.py --flip 0.95         with AFLIP instead of APIC
    python benchmarks/column_collapse.py --table             the table of docs/reference-cases.md

One JSON line for each run is appended to benchmarks/results/column_collapse.jsonl; what is there is
left out. `cells` are in √(L0 H).
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from pathlib import Path
from typing import Any

from result_pages import append, load, markdown

import libmpm
from libmpm import cases
from libmpm._src.advice.cases.grains import height_of, runout
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parent / "results" / "column_collapse.jsonl"

ASPECTS = (0.7, 1.0, 2.0, 4.0, 7.0, 20.0)
CELLS = (20, 40)

#: What is changed from the case, at the aspect ratios that miss a bound.
INGREDIENTS: tuple[dict[str, Any], ...] = (
    {"friction_angle": 31.0},
    {"friction_angle": 39.0},
    {"strain": 5e-4},
)


def options_of(changes: dict[str, Any]) -> cases.Options:
    """Return the choices of a run: AFLIP of the share `flip`, which the case has, or APIC."""
    transfer = libmpm.methods.Transfer()
    if "flip" in changes:
        transfer = libmpm.methods.Transfer(scheme="AFLIP", flip=changes["flip"])
    return cases.Options(method=libmpm.Method(transfer=transfer, cfl=0.4))


def key(line: dict[str, Any]) -> tuple[Any, ...]:
    """Return what a line was measured with."""
    return tuple(sorted(line["changes"].items()))


def table(lines: list[dict[str, Any]]) -> str:
    """Return run-out and height by aspect ratio and cells, over those of both experiments."""
    rows = [["a", "cells", "transfer", "run-out / L₀", "over Lube et al.", "height / L₀",
             "over Lajeunesse et al.", "over Lube et al."]]  # fmt: skip
    order = ("aspect", "cells", "flip")
    for line in sorted(lines, key=lambda x: [x["changes"].get(name, 0.0) for name in order]):
        given, value = line["changes"], line["values"]
        if set(given) - {"flip"} != {"aspect", "cells"}:
            continue
        a = given["aspect"]
        ratios = [value["runout"] / runout(a), value["height"] / height_of(a),
                  value["height"] / height_of(a, "Lube")]  # fmt: skip
        bounds = (0.15, 0.1, 0.1)
        marked = [f"{r:.2f}" if abs(r - 1) <= b else f"**{r:.2f}**"
                  for r, b in zip(ratios, bounds, strict=True)]  # fmt: skip
        transfer = f"AFLIP {given['flip']:g}" if "flip" in given else "APIC"
        rows.append([f"{a:g}", str(given["cells"]), transfer, f"{value['runout']:.2f}", marked[0],
                     f"{value['height']:.2f}", marked[1], marked[2]])  # fmt: skip
    return "\n".join(markdown(rows))


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--aspect", type=float, nargs="*", default=ASPECTS)
    parser.add_argument("--cells", type=int, nargs="*", default=CELLS)
    parser.add_argument("--ingredients", action="store_true", help="runs with one change each")
    parser.add_argument("--flip", type=float, help="share of FLIP in AFLIP, instead of APIC")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--table", action="store_true", help="run nothing, print the table")
    arguments = parser.parse_args()
    if arguments.table:
        print(table(load(arguments.output)))
        return 0
    for cells in arguments.cells:
        for aspect in arguments.aspect:
            for more in INGREDIENTS if arguments.ingredients else ({},):
                changes = {"aspect": aspect, "cells": cells, **more}
                if arguments.flip is not None:
                    changes["flip"] = arguments.flip
                if any(key(x) == key({"changes": changes}) for x in load(arguments.output)):
                    continue
                given = {name: value for name, value in changes.items() if name != "flip"}
                result = cases.run("column-collapse", device=arguments.device,
                                   threads=arguments.threads, options=options_of(changes),
                                   **given)  # fmt: skip
                line = {
                    "case": "column-collapse", "changes": changes, "device": arguments.device,
                    "particles": result.particles, "wall_s": round(result.wall_s, 1),
                    "values": {k: v if math.isfinite(v) else None
                               for k, v in result.values.items()},
                    "commit": bench.commit(), "version": libmpm.__version__,
                    "command": shlex.join(["python", "benchmarks/column_collapse.py",
                                           *sys.argv[1:]]),
                }  # fmt: skip
                append(arguments.output, line)
                print(changes, {k: round(v, 3) for k, v in result.values.items()}, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
