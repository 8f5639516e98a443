"""What a study adds to its cases: a thousand scenes of 16 particles and one step each.

`seconds` is the whole of `Study.run`, from planning to the saved table; `simulating` is what the
logs of the cases say, from the opening of their folder to the end of the run, added up and divided
by the workers; `overhead` is the rest. `again` is a second run that finds everything finished, and
`collect` reads all cases and computes their responses.

Run:  python benchmarks/study_overhead.py --cases 1000 --workers 2 --json FILE
"""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import libmpm
from libmpm._src.cli.bench import commit


def speck(bulk_modulus: float) -> libmpm.Scene:
    """A drop of 16 particles."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81), name="speck"
    )
    scene.add_body(
        name="water",
        shape=libmpm.shapes.Box(lower=(0.4, 0.4), upper=(0.6, 0.6)),
        material=libmpm.materials.TaitFluid(bulk_modulus=bulk_modulus),
    )
    scene.add_boundary(
        name="walls", shape=libmpm.shapes.DomainWalls(), response=libmpm.boundaries.Slip()
    )
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy())
    return scene


def kinetic(case: libmpm.studies.StudyCase) -> dict[str, float]:
    """The last kinetic energy, J/m."""
    return {"kinetic": case.sensors["energy"].values[-1, 0]}


def simulated(result: libmpm.studies.StudyResult, folder: Path) -> float:
    """Return the seconds that the engines and their output took, added up over the cases."""
    logs = (folder / "cases" / name / "log.json" for name in result["case"])
    return math.fsum(json.loads(log.read_text(encoding="utf-8"))["wall_time"] for log in logs)


def measure(cases: int, workers: int | None, folder: Path) -> dict[str, Any]:
    """Return the line that is recorded."""
    rows = [{"bulk_modulus": 1e6 + 1e3 * i} for i in range(cases)]
    study = libmpm.Study(folder, speck, rows, until=1e-3, response=kinetic)
    spent = {}
    for key in ("seconds", "again"):
        began = time.perf_counter()
        result = study.run(workers=workers, device="cpu", progress=False)
        spent[key] = time.perf_counter() - began
    began = time.perf_counter()
    collected = study.collect()
    spent["collect"] = time.perf_counter() - began
    if result.failed or collected["kinetic"].tolist() != result["kinetic"].tolist():
        raise SystemExit(f"the study went wrong: {result.summary()}")
    pids = {case.record["pid"] for case in study.cases}
    simulating = simulated(result, folder) / len(pids)
    return {
        "case": "study of trivial cases",
        "cases": cases,
        "workers": len(pids),
        **spent,
        "simulating": simulating,
        "overhead": spent["seconds"] - simulating,
        "overhead_per_case": (spent["seconds"] - simulating) / cases,
        "commit": commit(),
        "command": shlex.join(["python", *sys.argv]),
    }


def main() -> None:
    """Measure, print the line and append it to a file if asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--workers", type=int, help="processes; default: the cores")
    parser.add_argument("--json", type=Path)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        line = json.dumps(measure(a.cases, a.workers, Path(folder) / "study"))
    print(line)
    if a.json is not None:
        with a.json.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


if __name__ == "__main__":
    main()
