"""What both studies share: where their cases run, and the line that records what they cost."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import libmpm
from libmpm import studies
from libmpm._src.cli.bench import commit


def add_arguments(parser: argparse.ArgumentParser, output: str) -> None:
    """Add the arguments that say where cases run and where results go."""
    parser.add_argument("--output", type=Path, default=Path(output), help=f"default: {output}")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--workers", type=int, help="processes; default: one a GPU, or the cores")
    parser.add_argument(
        "--threads-pool", type=int, default=0, metavar="N",
        help="N cases at a time in threads of this process: many small scenes on one GPU",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.add_argument("--json", type=Path, help="append the line of costs to this file")


def sharing(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of cases that have their device for themselves, or share it."""
    return {"shared_device": arguments.threads_pool > 1}


def run(study: libmpm.Study, arguments: argparse.Namespace) -> tuple[studies.StudyResult, float]:
    """Run a study as the arguments say; return its result and the seconds that it took."""
    began = time.perf_counter()
    how: dict[str, Any] = {"device": arguments.device, "progress": not arguments.quiet}
    if arguments.threads_pool:
        with ThreadPoolExecutor(arguments.threads_pool) as executor:
            result = study.run(executor, **how)
    else:
        result = study.run(workers=arguments.workers, **how)
    seconds = time.perf_counter() - began
    if result.failed:
        raise SystemExit(f"{study.name}: {result.summary()}")
    return result, seconds


def costs(
    case: str, result: studies.StudyResult, seconds: float, arguments: argparse.Namespace
) -> dict[str, Any]:
    """Return the line of costs: means over the cases, s of wall time, rates of all together."""
    work = float((result["particles"] * result["steps"]).sum())
    shared = {}
    if result.trunks:
        shared = {"trunk_wall_time": result.trunk_wall_time, "time_saved": result.time_saved}
    return {
        "case": case,
        "cases": len(result),
        "particles": round(float(result["particles"].mean())),
        "steps": round(float(result["steps"].mean())),
        "wall_time": float(result["wall_time"].mean()),
        "seconds": seconds,
        "particle_steps_per_s": work / seconds,
        **shared,
        "threads_pool": arguments.threads_pool,
        "workers": arguments.workers,
        "device": sorted(set(result["device"].tolist())),
        "precision": sorted(set(result["precision"].tolist())),
        "version": libmpm.__version__,
        "commit": commit(),
        "command": shlex.join(["python", *sys.argv]),
    }


def tell(line: dict[str, Any], path: Path | None) -> None:
    """Print a line of costs and append it to a file if there is one."""
    text = json.dumps(line)
    print(text)
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.write(text + "\n")
