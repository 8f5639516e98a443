"""Says what a build has cost: processor time by group of units, and the slowest units.

usage: build_cost.py launch COMMAND...
       build_cost.py report BUILD [--jsonl FILE] [--note TEXT]

`launch` is a compiler launcher: it runs COMMAND and writes what it took to `unit_costs.jsonl` in
the build folder. A build takes it from the environment:

    export CMAKE_CXX_COMPILER_LAUNCHER="python3;$PWD/tools/build_cost.py;launch"
    export CMAKE_CUDA_COMPILER_LAUNCHER=$CMAKE_CXX_COMPILER_LAUNCHER

`report` prints the costs of a build, and appends them as one line with `--jsonl`. Without the
launcher's file it takes the times in `.ninja_log`, which are wall time: on a machine that does
other things too they are too long. The wall time of the whole is that of a build in one go.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

COSTS = "unit_costs.jsonl"
# The first that matches the path of an object.
GROUPS = {
    "tests": r"tests/cpp/",
    "bindings": r"bindings/",
    "triangular": r"triangular/|unity_(solver_)?triangular",
    "materials, cuda": r"instantiate_cuda",
    "materials, cpu": r"instantiate_cpu",
    "domain, cuda": r"solver/cuda/",
    "domain, cpu": r"solver/cpu/|unity_solver_cpu",
    "phases, cuda": r"kernels/cuda/(cell_)?phases",
    "phases, cpu": r"kernels/cpu/(cell_)?phases",
    "kernels": r"/kernels/",
    "executors": r"/exec/",
    "common": r"mpm_common",
}


def group(unit: str) -> str:
    return next((name for name, path in GROUPS.items() if re.search(path, unit)), "other")


def launch(command: list[str]) -> int:
    start = time.time()
    done = subprocess.run(command)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode == 0 and "-o" in command[:-1]:
        row = {
            "unit": command[command.index("-o") + 1],
            "processor_s": round(used.ru_utime + used.ru_stime, 2),
            "wall_s": round(time.time() - start, 2),
            "megabytes": used.ru_maxrss // 1024,
        }
        with Path(COSTS).open("a", encoding="utf-8") as file:  # ninja runs in the build folder
            file.write(json.dumps(row) + "\n")
    return done.returncode


def logged(build: Path) -> dict[str, float]:
    """Seconds from the start to the end of each object of the last builds, from `.ninja_log`."""
    seconds = {}
    for line in (build / ".ninja_log").read_text(encoding="utf-8").splitlines()[1:]:
        start, end, _, output, *_ = line.split("\t")
        if output.endswith(".o"):
            seconds[output] = (int(end) - int(start)) / 1000
    return seconds


def whole_wall(build: Path) -> float:
    rows = (build / ".ninja_log").read_text(encoding="utf-8").splitlines()[1:]
    return max((int(row.split("\t")[1]) for row in rows), default=0) / 1000


def measured(build: Path) -> dict[str, float] | None:
    """Processor seconds of each object, as the launcher saw it last."""
    if not (build / COSTS).exists():
        return None
    rows = map(json.loads, (build / COSTS).read_text(encoding="utf-8").splitlines())
    return {row["unit"]: row["processor_s"] for row in rows}


def sizes(build: Path) -> dict[str, float]:
    """MB of the modules: in the build folder, or where an in-place build puts them."""
    places = [build, Path(__file__).parents[1] / "python" / "libmpm"]
    found = {}
    for name in ("_core", "_cuda"):
        files = [file for place in places for file in place.rglob(f"{name}.*.so")]
        if files:
            found[name] = round(max(files, key=lambda f: f.stat().st_mtime).stat().st_size / 1e6, 1)
    return found


def commit() -> str:
    done = subprocess.run(
        ["git", "-C", Path(__file__).parent, "rev-parse", "--short=12", "HEAD"],
        capture_output=True,
        text=True,
    )
    return done.stdout.strip() or "unknown"


def report(build: Path, note: str) -> dict:
    seconds = measured(build)
    kind = "processor" if seconds else "wall"
    seconds = seconds or logged(build)
    groups: dict[str, float] = {}
    for unit, took in seconds.items():
        groups[group(unit)] = groups.get(group(unit), 0) + took
    slowest = sorted(seconds.items(), key=lambda item: -item[1])[:8]
    row = {
        "commit": commit(),
        "cores": os.cpu_count(),
        "wall_s": round(whole_wall(build)),
        "time": kind,
        "units_s": round(sum(seconds.values())),
        "without_tests_s": round(sum(seconds.values()) - groups.get("tests", 0)),
        "groups": {name: round(groups[name]) for name in GROUPS if name in groups},
        "slowest": {Path(unit).name: round(took) for unit, took in slowest},
        "megabytes": sizes(build),
    }
    if "other" in groups:
        row["groups"]["other"] = round(groups["other"])
    return {**row, "note": note} if note else row


def text(row: dict) -> str:
    lines = [
        f"{row['units_s']} s of {row['time']} time in units, {row['without_tests_s']} s of them "
        f"without tests; {row['wall_s']} s from first to last on {row['cores']} cores"
    ]
    for title in ("groups", "slowest"):
        named = sorted(row[title].items(), key=lambda item: -item[1])
        lines += [f"{took:7d} s  {name}" for name, took in named] + [""]
    return "\n".join(lines + [f"{size:7.1f} MB  {name}" for name, size in row["megabytes"].items()])


def main() -> int:
    if sys.argv[1:2] == ["launch"]:
        return launch(sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("report", choices=["report"])
    parser.add_argument("build", type=Path, help="build folder")
    parser.add_argument("--jsonl", type=Path, help="append a line to this file")
    parser.add_argument("--note", default="", help="what else there is to know of the measurement")
    options = parser.parse_args()
    row = report(options.build, options.note)
    print(text(row))
    if options.jsonl:
        with options.jsonl.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
