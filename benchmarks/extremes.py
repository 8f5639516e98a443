"""The extremes: one number of a scene at a time is pushed until the run fails or becomes wrong.

    python benchmarks/extremes.py run [--axes "cell size" film] [--device cuda] [--again]
                                      [--workers 4] [--seconds 600]
    python benchmarks/extremes.py write      makes docs/extremes.md of the lines in --output
    python benchmarks/extremes.py check      exit 1 if the page is out of date, or a promise broken
    python benchmarks/extremes.py list       names all axes

One JSON line for every axis (`extremes_water` and its like), side and precision. A side is tried
at the base, at the end of its envelope and outwards by equal factors to the end of its reach,
all of them whatever comes of it; then bisection narrows the gap between the last value that holds
and the first that does not. Probes run beside this process (`extremes_workers`) with a time limit,
so a crash or a hang is a result. A run goes on where an earlier one of the same device and version
stopped; `--again` measures anew what is chosen. So many sides as `--workers` are pushed at the same
time; after `--seconds` none is begun any more.
"""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
import time
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import extremes_contact
import extremes_motion
import extremes_solids
import extremes_water
import extremes_widths
from extremes_axis import FORBIDDEN, OUTCOMES, Axis, Outcome
from extremes_page import PAGE, page
from extremes_workers import DeviceLostError, Task, Worker, together
from result_pages import Line, load

import libmpm
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parent / "results" / "extremes.jsonl"
AXES: tuple[Axis, ...] = (
    extremes_water.AXES
    + extremes_solids.AXES
    + extremes_motion.AXES
    + extremes_widths.AXES
    + extremes_contact.AXES
)

#: Values from the base to the end of the reach, and halvings of the gap that is found.
OUTWARD = 6
HALVINGS = 5

#: Values of axes that are tried within their envelopes only.
INWARD = 3

# ---- values -------------------------------------------------------------------------------------


def between(axis: Axis, a: float, b: float, part: float) -> float:
    """Return the value at `part` of the way from a to b on the axis's own scale."""
    if axis.scale == "linear" or min(a, b) <= 0:
        value = a + (b - a) * part
    else:
        value = math.exp(math.log(a) + (math.log(b) - math.log(a)) * part)
    if part in (0.0, 1.0):
        value = (a, b)[int(part)]
    return float(round(value)) if axis.scale == "integer" else value


def outward(axis: Axis, side: str) -> list[float]:
    """Return the values of a side in the order in which they are tried, the base first."""
    at = 0 if side == "lower" else 1
    end = axis.reach[at]
    parts = OUTWARD if axis.reach != axis.envelope else INWARD
    values = {between(axis, axis.base, end, k / parts) for k in range(parts + 1)}
    if axis.envelope is not None:
        values.add(float(axis.envelope[at]))
    inside = min(axis.base, end), max(axis.base, end)
    kept = {v for v in values if inside[0] <= v <= inside[1]} | {axis.base}
    return sorted(kept, reverse=side == "lower")


# ---- one side of an axis ------------------------------------------------------------------------


def push(axis: Axis, side: str) -> Generator[float, Outcome, Line]:
    """Push an axis to one side: yields values, is sent their outcomes, returns what was found."""
    tried: dict[float, Outcome] = {}
    values = outward(axis, side)
    for value in values:
        tried[value] = yield value
    last = next((i for i, v in enumerate(values) if not tried[v].holds), len(values))
    holds_to = values[last - 1] if last > 0 else None
    breaks_at = values[last] if last < len(values) else None
    for _ in range(HALVINGS):
        if holds_to is None or breaks_at is None:
            break
        middle = between(axis, holds_to, breaks_at, 0.5)
        if middle in (holds_to, breaks_at):
            break
        if middle not in tried:
            tried[middle] = yield middle
        if tried[middle].holds:
            holds_to = middle
        else:
            breaks_at = middle
    if side == "upper":
        for value in axis.also:
            if value not in tried:
                tried[value] = yield value
    shown = tried[values[-1] if breaks_at is None else breaks_at]
    worst = max(tried, key=lambda v: OUTCOMES.index(tried[v].outcome))
    inner = [] if holds_to is None else [v for v in tried if tried[v].holds]
    return {
        "axis": axis.name, "group": axis.group, "unit": axis.unit, "meaning": axis.meaning,
        "says": axis.says, "side": side, "base": axis.base, "envelope": axis.envelope,
        "reach": axis.reach, "holds_to": holds_to, "breaks_at": breaks_at,
        "outcome": shown.outcome, "message": shown.message,
        "warnings": sorted({w for v in inner for w in tried[v].warnings})[:4],
        "worst": tried[worst].outcome, "worst_at": worst, "worst_message": tried[worst].message,
        "probes": [[v, o.outcome, o.message, o.steps] for v, o in sorted(tried.items())],
        "steps": sum(o.steps for o in tried.values()),
        "wall_s": sum(o.wall_s for o in tried.values()),
    }  # fmt: skip


def sides(axis: Axis) -> Iterator[str]:
    """Yield the sides on which an axis has anything to try."""
    if axis.reach[0] < axis.base:
        yield "lower"
    if axis.reach[1] > axis.base or axis.also:
        yield "upper"


def key(line: Line) -> tuple[Any, ...]:
    """Return what a line belongs to."""
    return line["axis"], line["side"], line["precision"], line["device_kind"], line["version"]


def newest(path: Path) -> list[Line]:
    """Return the lines of a file, of each key the last one."""
    return list({key(line): line for line in load(path)}.values())


def chosen(names: Sequence[str]) -> list[Axis]:
    """Return the axes by name, or all that do not run on demand only."""
    if not names:
        return [a for a in AXES if not a.on_demand]
    found = [a for a in AXES if a.name in names or (a.group in names and not a.on_demand)]
    missing = set(names) - {a.name for a in found} - {a.group for a in found}
    if missing:
        raise SystemExit(f"no axis or group {', '.join(sorted(missing))}; see `list`")
    return found


def tidy(path: Path) -> None:
    """Write the lines of a file anew: of each key the last one, in the order of the axes."""
    lines = newest(path)
    order = {a.name: i for i, a in enumerate(AXES)}
    lines.sort(key=lambda x: (x["device_kind"], order.get(x["axis"], len(order)), x["precision"],
                              x["side"]))  # fmt: skip
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    path.write_text(text, encoding="utf-8")


def missing(arguments: argparse.Namespace, until: float) -> Iterator[Task]:
    """Yield the sides that have no line yet, none after the time `until`."""
    kind = arguments.device.partition(":")[0]
    done = set() if arguments.again else {key(line) for line in load(arguments.output)}
    of_run = {
        "device_kind": kind, "version": libmpm.__version__, "commit": bench.commit(),
        "command": shlex.join(["python", "benchmarks/extremes.py", *sys.argv[1:]]),
    }  # fmt: skip
    for axis in chosen(arguments.axes):
        for precision in arguments.precision:
            for side in sides(axis):
                if time.monotonic() > until:
                    return
                head = {"precision": precision, **of_run}
                if key({"axis": axis.name, "side": side, **head}) in done:
                    continue
                options = {"device": arguments.device, "precision": precision}
                if kind == "cpu":
                    options["threads"] = arguments.threads
                limit = arguments.limit or axis.limit
                yield Task(axis.name, push(axis, side), limit, options, head)


def run(arguments: argparse.Namespace) -> int:
    """Measure what is missing, and keep each result as soon as it is there."""
    path: Path = arguments.output
    path.parent.mkdir(parents=True, exist_ok=True)
    workers = [Worker({a.name: a for a in AXES}) for _ in range(arguments.workers)]
    try:
        for task, found in together(
            missing(arguments, time.monotonic() + arguments.seconds), workers
        ):
            line = found | task.head
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line, ensure_ascii=False) + "\n")
            print(
                f"{line['axis']} ({line['side']}, {line['precision']}): "
                f"holds to {line['holds_to']}, then {line['breaks_at']}: {line['outcome']}; "
                f"worst: {line['worst']}",
                flush=True,
            )
    except DeviceLostError as error:
        print(f"{error}\nnothing is kept of the sides that were being pushed; run this again")
        return 1
    return 0


# ---- what is promised ---------------------------------------------------------------------------


def broken(lines: Sequence[Line]) -> list[str]:
    """Return what breaks within an envelope, and what ends as no run may end."""
    found = []
    for line in lines:
        where = f"{line['axis']} ({line['device_kind']}, {line['precision']})"
        for value, outcome, message, _ in line["probes"]:
            low, high = line["envelope"] or (math.inf, -math.inf)
            if outcome != "holds" and low <= value <= high:
                found.append(f"{where}: {value:g} is promised and {outcome}: {message}")
            elif outcome in FORBIDDEN:
                found.append(f"{where}: {value:g} is {outcome}: {message}")
    return found


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=("run", "write", "check", "list"))
    parser.add_argument("--axes", nargs="*", default=[], help="names of axes or groups")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--precision", nargs="*", default=["single", "double"])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--limit", type=float, default=None, help="seconds for each probe")
    parser.add_argument("--workers", type=int, default=1, help="sides pushed at the same time")
    parser.add_argument(
        "--seconds", type=float, default=math.inf, help="after these no further side is begun"
    )
    parser.add_argument("--again", action="store_true", help="measure anew what is chosen")
    parser.add_argument("--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    if arguments.action == "run":
        return run(arguments)
    if arguments.action == "list":
        for axis in AXES:
            print(f"{axis.group}: {axis.name} [{axis.unit}], base {axis.base:g}")
        return 0
    if arguments.action == "write":
        tidy(arguments.output)
    lines = newest(arguments.output)
    if arguments.action == "write":
        PAGE.write_text(page(lines), encoding="utf-8")
        return 0
    said = broken(lines)
    print("\n".join(said))
    stale = not PAGE.exists() or PAGE.read_text(encoding="utf-8") != page(lines)
    if stale:
        print(f"{PAGE.name} is out of date; run: python benchmarks/extremes.py write")
    return 1 if said or stale else 0


if __name__ == "__main__":
    raise SystemExit(main())
