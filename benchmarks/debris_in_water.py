"""A floating block against a deck, beside its twin in air: what the water adds to the load (V13).

The case "debris-in-water" (Yang 2016, 6.2.4) over densities and lengths of the block, and from its
middle over speed, depth, stiffness and cell size. `deck_ratio` is the mean load of the deck in
water over that in air, `block_ratio` the block's own share of it.

Run:  python benchmarks/debris_in_water.py --json benchmarks/results/debris_in_water.jsonl \\
          --figure docs/figures/debris_in_water.png
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from libmpm import cases
from libmpm._src.cli.bench import commit

CASE = "debris-in-water"
LENGTHS, DENSITIES = (3.0, 6.0, 9.0), (200.0, 400.0, 600.0, 800.0)
#: One at a time, the rest as in the case.
ALONE = {
    "velocity": (3.0, 9.0, 15.0),
    "depth": (4.0, 8.0),
    "youngs_modulus": (1e10, 1e8),
}
CELLS = (0.25, 0.125)  # m, of three lengths and of the middle one


def runs() -> Iterator[dict[str, float]]:
    """Yield what each run changes."""
    for length in LENGTHS:
        for density in DENSITIES:
            yield {"length": length, "density": density}
    for name, values in ALONE.items():
        for value in values:
            yield {name: value}
    for length in LENGTHS:
        yield {"length": length, "cell_size": CELLS[0]}
    yield {"cell_size": CELLS[1]}


def measure(changes: dict[str, float]) -> dict[str, Any]:
    """Return the line of a run."""
    began = time.perf_counter()
    result = cases.run(CASE, device="cpu", **changes)
    return {
        "case": CASE,
        "parameters": dict(result.parameters),
        "values": dict(result.values),
        "wall_s": time.perf_counter() - began,
        "commit": commit(),
    }


def draw(lines: list[dict[str, Any]], path: Path) -> None:
    """Draw the ratios against the block's density, a line a length, and the source's band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for panel, value, title in zip(
        axes, ("deck_ratio", "block_ratio"), ("load of the deck", "the block's share"), strict=True
    ):
        panel.axhspan(1.25, 1.35, color="0.9", label="Yang (2016)")
        for length in LENGTHS:
            rows = [
                (x["parameters"]["density"], x["values"][value])
                for x in lines[: len(LENGTHS) * len(DENSITIES)]
                if x["parameters"]["length"] == length
            ]
            panel.plot(*zip(*rows, strict=True), "o-", ms=4, label=f"L = {length:g} m")
        panel.set_title(f"{title}, in water over in air")
        panel.set_xlabel("density of the block [kg/m³]")
    axes[0].set_ylabel("ratio of the mean forces")
    axes[0].legend(frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Run all, print them, write lines and figure if asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--figure", type=Path)
    a = parser.parse_args()
    lines = []
    for changes in runs():
        lines.append(measure(changes))
        ratios = {k: round(v, 3) for k, v in lines[-1]["values"].items() if k.endswith("ratio")}
        print(changes, ratios, flush=True)
    if a.json:
        a.json.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    if a.figure:
        draw(lines, a.figure)


if __name__ == "__main__":
    main()
