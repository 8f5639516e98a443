"""Reference cases at their full level, one after another: values, what misses its bound, time.

    python benchmarks/reference_cases.py                   all of them on the GPU
    python benchmarks/reference_cases.py sloshing discs    some
    python benchmarks/reference_cases.py --list            what there is, how long it takes
    python benchmarks/reference_cases.py --level reduced --device cpu --output FILE

One JSON line for each run is appended to --output. What the file has for the same kind of device
and level is left out, so that a stopped command goes on when it is given again; `--again` measures
anew. A run is given up after --limit seconds of wall time (480). The row of dominoes, the longest,
keeps a checkpoint every minute and goes on from there when it is given up or stopped.

`elastic-column` runs three cell sizes and gives the limit of fine cells with its uncertainty;
`loaded-beam` is here with four moduli. Times are estimated from earlier lines, else by what an H200
does; while a run goes on its time left is that of its steps at the pace so far.
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from result_pages import Line, append, load

import libmpm
from libmpm import cases
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parent / "results" / "reference_cases.jsonl"

#: Seconds of an H200 for a step, whatever is in it, and for a particle-step.
STEP_S, PARTICLE_STEP_S = 1.5e-5, 2.5e-10

#: Seconds between two lines of progress, and between two checkpoints.
TELL, KEEP = 10.0, 60.0


@dataclass(frozen=True)
class Job:
    """A run of a case: `changes` of its parameters, and what it has to do at the full level."""

    case: str
    particles: float
    steps: float
    changes: Mapping[str, Any] = field(default_factory=dict)
    precision: str = "auto"
    #: All that is measured is in a checkpoint.
    goes_on: bool = False

    @property
    def name(self) -> str:
        """The case, with what is changed."""
        return " ".join([self.case, *(f"{k}={v:g}" for k, v in self.changes.items())])


JOBS = (
    Job("tank", 480, 4.0e5),
    Job("sloshing", 2.1e6, 1.1e5),
    Job("dam-break", 6.6e6, 1.3e4),
    Job("vortex", 1.05e6, 5.1e4),
    *(
        Job("loaded-beam", 7.7e5, steps, {"youngs_modulus": modulus})
        for modulus, steps in ((5e7, 8.5e5), (5e6, 2.7e5), (2e6, 2.7e5), (1e6, 2.7e5))
    ),
    Job("elastic-column", 1.74e5, 2.0e5),
    Job("elastic-column-light", 1.74e5, 2.0e5),
    Job("buoyancy", 1.57e6, 1.7e5),
    Job("incline", 6.6e5, 2.9e4),
    Job("beam", 1.28e5, 3.4e5),
    Job("column-collapse", 5.2e5, 2.1e4),
    Job("cook", 4e3, 8.6e4, precision="double"),
    Job("domino-tip", 4.4e5, 1.1e5),
    Job("two-dominoes", 8.8e5, 5e4),
    # Contacts of soft discs are chaotic: in single precision the deepest overlap is by chance.
    Job("discs", 6.6e5, 1.02e5, precision="double"),
    Job("piston-flume", 9.2e5, 1.3e5),
    Job("ritter", 5.7e5, 3.2e4),
    Job("pump-current", 2.5e5, 2.7e5),
    Job("slope-basin", 4.6e4, 7.0e4),
    Job("dominoes", 1.11e5, 3.3e6, goes_on=True),
)

#: Sizes for a level that a case lacks: three dominoes of soft rubber for seconds.
SMALL = {"dominoes": {"count": 3, "cells": 4, "youngs_modulus": 1e6, "duration": 0.1, "steady": 1}}


class GivenUp(Exception):
    """A run that is not done within its limit."""


class Watch:
    """What the simulations of one run share: how far they are, checkpoints, the limit."""

    def __init__(self, expected: float, limit: float, checkpoint: Path | None) -> None:
        """`expected` steps in all, or not-a-number; `limit` in s of wall time."""
        self.expected = expected
        self.checkpoint = checkpoint
        self.began = self.told = self.kept = time.monotonic()
        self.deadline = self.began + limit
        self.seen: list[tuple[int, int]] = []  # first and last step of each simulation
        self.device = self.precision = ""

    def slice(self) -> float:
        """Wall time to run on before the next look, s."""
        return max(0.0, min(TELL, self.deadline - time.monotonic()))

    def look(self, simulation: libmpm.Simulation, number: int) -> None:
        """Tell, keep and give up as it is time to."""
        now = time.monotonic()
        late = now > self.deadline
        self.seen[number] = self.seen[number][0], simulation.steps
        if self.checkpoint is not None and (late or now - self.kept > KEEP):
            simulation.save_checkpoint(self.checkpoint)
            self.kept = now
        if now - self.told > TELL:
            self.told = now
            print(f"  {simulation.time:.4g} s simulated, {self.pace(now)}", flush=True)
        if late:
            raise GivenUp(f"{simulation.time:.4g} s were simulated, {self.pace(now)}")

    def pace(self, now: float) -> str:
        """Tell steps and the time left."""
        steps = sum(last for _, last in self.seen)
        gone = sum(last - first for first, last in self.seen)
        if math.isnan(self.expected) or gone <= 0:
            return f"{steps:,} steps"
        left = max(self.expected - steps, 0) * (now - self.began) / gone
        return f"{steps:,} of about {self.expected:,.0f} steps, {left:.0f} s left"

    def simulate(self, scene: libmpm.Scene, **how: Any) -> libmpm.Simulation:
        """Return a simulation under watch, from the checkpoint if there is one of this scene."""
        watch = self

        class Watched(libmpm.Simulation):
            def __init__(self, *a: Any, **k: Any) -> None:
                super().__init__(*a, **k)
                self.number = len(watch.seen)
                watch.seen.append((0, 0))

            def run(self, *, until: float, **_: Any) -> bool:
                """Advance in slices of wall time; no bit depends on where they end."""
                while not super().run(until=until, progress=False, wall_limit=watch.slice()):
                    watch.look(self, self.number)
                watch.look(self, self.number)
                return True

            def step(self, n: int = 1) -> None:
                """Advance in parts of a thousand steps."""
                for k in range(0, n, 1000):
                    super().step(min(1000, n - k))
                    watch.look(self, self.number)

        if watch.checkpoint is not None and watch.checkpoint.exists():
            resumed = Watched.resume(watch.checkpoint)
            if resumed.scene.to_dict() == scene.to_dict():
                print(f"  goes on from {resumed.time:.4g} s", flush=True)
                watch.seen[0] = (resumed.steps, resumed.steps)
                return watch.note(resumed)
            watch.seen.clear()
        return watch.note(Watched(scene, **how))

    def note(self, simulation: libmpm.Simulation) -> libmpm.Simulation:
        """Keep what a simulation runs on."""
        self.device, self.precision = bench._device(simulation), simulation.precision
        return simulation


def kind(line: Line) -> str:
    """Return "cpu" or "cuda" of the device that a line names."""
    return "cpu" if "threads" in line["device"] else "cuda"


def lines_of(job: Job, level: str, device: str, lines: Sequence[Line]) -> list[Line]:
    """Return the lines of a job on one level and kind of device."""
    return [
        line for line in lines
        if line["case"] == job.case and line["level"] == level and kind(line) == device
        and (line.get("changes") or {}) == changes_of(job, level)
    ]  # fmt: skip


def changes_of(job: Job, level: str) -> dict[str, Any]:
    """Return what a job changes; the sizes of a level that the case lacks are among it."""
    missing = level not in cases.case(job.case).levels
    return dict(job.changes) | (SMALL[job.case] if missing else {})


def estimate(job: Job, level: str, before: Sequence[Line]) -> tuple[float, float]:
    """Return steps and seconds; not-a-number where nothing is known."""
    if before:
        return before[-1]["steps"], before[-1]["wall_s"]
    if level != "full":
        return math.nan, math.nan
    return job.steps, job.steps * (STEP_S + job.particles * PARTICLE_STEP_S)


def run(job: Job, steps: float, arguments: argparse.Namespace) -> Line:
    """Run a job; raises `GivenUp`."""
    checkpoint = None
    if job.goes_on:
        name = f"libmpm-{job.case}-{arguments.level}-{arguments.device.replace(':', '-')}.npz"
        checkpoint = arguments.keep / name
    watch = Watch(steps, arguments.limit, checkpoint)
    case, level = cases.case(job.case), arguments.level
    result = case.run(
        level if level in case.levels else "full", device=arguments.device,
        precision=job.precision, threads=arguments.threads, simulate=watch.simulate,
        **changes_of(job, level),
    )  # fmt: skip
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    # Bounds belong to a level as it is.
    failures = list(result.failures) if level in case.levels else []
    return {
        "case": job.case, "level": level, "changes": changes_of(job, level),
        "device": watch.device, "precision": watch.precision, "particles": result.particles,
        "steps": sum(last for _, last in watch.seen), "wall_s": round(result.wall_s, 1),
        "values": {k: v if math.isfinite(v) else None for k, v in result.values.items()},
        "failures": failures, "commit": bench.commit(), "version": libmpm.__version__,
        "command": shlex.join(["python", "benchmarks/reference_cases.py", *sys.argv[1:]]),
    }  # fmt: skip


def main() -> int:
    """Do what the command line says; 1 if a bound is missed or a run given up."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    names = sorted({job.case for job in JOBS})
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(names))
    parser.add_argument("--level", choices=("full", "reduced"), default="full")
    parser.add_argument("--device", default="cuda", help="cpu, cuda or cuda:N")
    parser.add_argument("--threads", type=int, default=0, help="CPU threads; 0 = default")
    parser.add_argument("--limit", type=float, default=480.0, help="wall time of a run, s")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument(
        "--keep", type=Path, default=Path(tempfile.gettempdir()), help="folder of checkpoints"
    )
    parser.add_argument("--again", action="store_true", help="also what the file has")
    parser.add_argument("--list", action="store_true", help="run nothing")
    arguments = parser.parse_args()
    if unknown := sorted(set(arguments.cases) - set(names)):
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(names)}")
    lines, device = load(arguments.output), arguments.device.partition(":")[0]
    wanted, missed = [], 0
    for job in JOBS:
        if arguments.cases and job.case not in arguments.cases:
            continue
        before = lines_of(job, arguments.level, device, lines)
        steps, seconds = estimate(job, arguments.level, before)
        told = "unknown time" if math.isnan(seconds) else f"about {seconds:.0f} s"
        if before and not arguments.again:
            told = f"done at {before[-1]['commit']}"
        else:
            wanted.append((job, steps))
        print(f"{job.name:<36} {told}", flush=True)
    for number, (job, steps) in enumerate([] if arguments.list else wanted, 1):
        print(f"{number}/{len(wanted)} {job.name}", flush=True)
        try:
            line = run(job, steps, arguments)
        except (GivenUp, libmpm.Error) as error:
            more = "; the same command goes on" if job.goes_on else ""
            print(f"  not done: {error}{more}", flush=True)
            missed += 1
            continue
        append(arguments.output, line)
        values = ", ".join(f"{k} {v:.4g}" for k, v in line["values"].items() if v is not None)
        print(f"  {line['wall_s']:.1f} s, {line['steps']:,} steps: {values}", flush=True)
        for failure in line["failures"]:
            print(f"  MISSED {failure}", flush=True)
        missed += bool(line["failures"])
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
