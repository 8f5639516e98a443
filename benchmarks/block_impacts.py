"""Blocks of debris against a wall in air: a sample of the 26,250 runs of Yang (2016), 6.2.3.

Plane-strain blocks 3 m high, with all combinations of five lengths, speeds and densities, seven
moduli, three Poisson's ratios and ten contacts (height, eccentricity); cells of 0.5 m, 3 x 3
particles a cell, fixed corotated, APIC, walls that blocks may leave, for the time 4 L / c_d. The
sample is drawn by a seed and goes through the study engine; what has run is not run again.

`plateau` is the mean force over 20 to 80 % of 2 L / c_d over t_d v h_d √(ρ E_l) (eq. 6.9), and
`ratio` over eq. 6.10 with the height of `design.spread_height`.

Run:  python benchmarks/block_impacts.py --runs 525 --folder build/blocks --json FILE \
          --figure docs/figures/block_impacts.png
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

import libmpm
from libmpm import design
from libmpm._src.advice.cases.bridges import block_impact, block_pulse
from libmpm._src.cli.bench import commit

LENGTHS = SPEEDS = (3.0, 6.0, 9.0, 12.0, 15.0)  # m, m/s
DENSITIES = (200.0, 400.0, 600.0, 800.0, 1000.0)
MODULI = (10e9, 5e9, 3e9, 1e9, 0.5e9, 0.3e9, 0.1e9)
RATIOS = (0.1, 0.2, 0.3)
CONTACTS = (
    (3.0, 0.0), (1.5, 0.75), (1.5, 0.0), (1.0, 1.0), (1.0, 0.75), (1.0, 0.0),
    (0.5, 1.25), (0.5, 1.0), (0.5, 0.75), (0.5, 0.0),
)  # fmt: skip
HEIGHT, CELL = 3.0, 0.5


def sample(runs: int, seed: int, whole: float) -> list[dict[str, float]]:
    """Return rows without repetition, the part `whole` of them with the whole front in contact."""
    axes = (LENGTHS, SPEEDS, DENSITIES, MODULI, RATIOS, CONTACTS)
    every = list(itertools.product(*axes))
    assert len(every) == 26250
    full = [row for row in every if row[5][0] == HEIGHT]
    part = [row for row in every if row[5][0] < HEIGHT]
    rng = np.random.default_rng(seed)
    n = round(runs * whole)
    chosen = [full[i] for i in rng.choice(len(full), n, replace=False)]
    chosen += [part[i] for i in rng.choice(len(part), runs - n, replace=False)]
    names = ("length", "velocity", "density", "youngs_modulus", "poissons_ratio")
    return [
        dict(zip(names, row[:5], strict=True)) | {"contact": row[5][0], "eccentricity": row[5][1]}
        for row in chosen
    ]


def scene(length: float, contact: float, eccentricity: float, **p: float) -> libmpm.Scene:
    """Return the scene of a row."""
    return block_impact(p | {"cell_size": CELL}, (length,), None, contact, eccentricity)


def until(
    length: float, density: float, youngs_modulus: float, poissons_ratio: float, **_: float
) -> float:
    """Return 4 L / c_d, s."""
    modulus = design.plane_strain_modulus(
        youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio
    )
    return 4 * length / math.sqrt(modulus / density)


def response(case: libmpm.studies.StudyCase) -> dict[str, float]:
    """Return plateau, impulse and the force over (6.10)."""
    p = dict(case.parameters)
    found = block_pulse(case, p, p["length"])  # type: ignore[arg-type]  # reads sensors alone
    spread = design.spread_height(
        contact=p["contact"], height=HEIGHT, length=p["length"], eccentricity=p["eccentricity"]
    )
    return found | {"spread": spread / HEIGHT, "ratio": found["plateau"] * HEIGHT / spread}


def summary(table: Any) -> dict[str, Any]:
    """Return statistics of plateau and ratio by length, for whole and partial contacts."""
    length, contact = np.asarray(table["length"]), np.asarray(table["contact"])
    found: dict[str, Any] = {}
    for name, part, column in (
        ("whole", contact == HEIGHT, "plateau"), ("partial", contact < HEIGHT, "ratio"),
    ):  # fmt: skip
        values = np.asarray(table[column])
        for L in LENGTHS:
            one = values[part & (length == L)]
            if len(one):
                numbers = (len(one), one.mean(), one.std(), one.min(), one.max())
                found[f"{name} {L:g}"] = [round(float(x), 4) for x in numbers]
    return found


def draw(table: Any, path: Path) -> None:
    """Draw the mean forces of all runs over (6.9) and over (6.10)."""
    from matplotlib.figure import Figure

    length, contact = np.asarray(table["length"]), np.asarray(table["contact"])
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    offset = np.random.default_rng(1).uniform(-0.9, 0.9, len(length))  # runs side by side
    whole = contact == HEIGHT
    left.plot((length + offset)[whole], np.asarray(table["plateau"])[whole], ".", ms=4)
    left.set_title("whole front: over (6.9)")
    for h in sorted(set(contact[~whole])):
        one = contact == h
        places = (length + offset)[one]
        right.plot(places, np.asarray(table["ratio"])[one], ".", ms=4, label=f"{h:g} m of 3 m")
    right.set_title("part of the front: over (6.10)")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.axhline(1, color="0.6", lw=0.8, zorder=0)
        axes.set_xlabel("length of the block [m]")
        axes.set_xticks(LENGTHS)
    left.set_ylabel("mean force over the formula's")
    figure.savefig(path, dpi=130)


def main() -> None:
    """Run the sample, print the statistics and append them to a file if asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=525)
    parser.add_argument("--seed", type=int, default=2016)
    parser.add_argument("--whole", type=float, default=0.4, help="part with the whole front")
    parser.add_argument("--folder", type=Path, default=Path("build/block_impacts"))
    parser.add_argument("--workers", type=int)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--figure", type=Path)
    a = parser.parse_args()
    study = libmpm.Study(
        a.folder, scene, sample(a.runs, a.seed, a.whole), until=until, response=response
    )
    began = time.perf_counter()
    table = study.run(workers=a.workers, device="cpu", progress=False)
    line = {
        "case": "blocks against a wall in air",
        "runs": a.runs,
        "failed": len(table.failed),
        "columns": ["runs", "mean", "deviation", "least", "most"],
        **summary(table),
        "seconds": time.perf_counter() - began,
        "commit": commit(),
    }
    print(json.dumps(line, indent=1))
    if a.json:
        with a.json.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
    if a.figure:
        draw(table, a.figure)


if __name__ == "__main__":
    main()
