"""Claims of sources, each in its source's own set-up, all in one budget of wall time.

    python benchmarks/claims.py                            all on the GPU and the CPU's cores
    python benchmarks/claims.py V13 bridges --list         some; what there is
    python benchmarks/claims.py --device cuda --workers 8 --budget 330 --output FILE
    python benchmarks/claims.py --merge FILE ...           lines of other files into --output

V13 (some seconds each) and the bridges, whose modified functions devices do not have, run in
`--processes` processes on the CPU, the rest on the device, `--workers` at once in threads that
share it, the most wanted first. One JSON line a run goes to --output as soon as it ends: what was
measured, what the source says. A run that has not ended within its limit or the budget leaves a
line with "complete": false and what it had until then; given the same command again, such runs are
begun anew, or go on from a checkpoint in --keep (all but V13). Complete runs in --output are left
out. The scenes, and what is not the source's in them: `claims_scenes`.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import time
import warnings
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import claims_scenes
from bridges_scenes import TABLE
from result_pages import append, load, markdown

import libmpm
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parent / "results" / "claims.jsonl"


@dataclass(frozen=True)
class Job:
    """A run: its scene and parameters, what the source says, and the wall time it may take."""

    scene: str
    name: str
    parameters: Mapping[str, Any]
    source: str
    band: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    limit: float = 1e9  # s of wall time
    on_device: bool = True
    goes_on: bool = False  # from a checkpoint


_V13 = {
    "cell_size": 0.5, "depth": 6.0, "velocity": 6.0, "youngs_modulus": 1e9, "poissons_ratio": 0.2,
    "bulk_modulus": 2.2e9, "length": 6.0, "density": 400.0,
}  # fmt: skip
#: From the middle of the source's table 6.6, one at a time.
_ALONE = {
    "velocity": (3.0, 9.0, 12.0, 15.0),
    "depth": (4.0, 8.0),
    "youngs_modulus": (1e10, 5e9, 3e9, 5e8, 3e8, 1e8),
    "poissons_ratio": (0.1, 0.3),
    "kernel": ("quadratic",),
}
_SAID = "Yang (2016) 6.2.4: 25 to 35 % above formula (6.10)"


def _blocks() -> list[Job]:
    changes: list[dict[str, Any]] = [
        {"length": length, "density": density}
        for length in (3.0, 6.0, 9.0)
        for density in (200.0, 400.0, 600.0)
    ]
    changes += [{name: value} for name, values in _ALONE.items() for value in values]
    changes += [{"cell_size": 0.25, "length": length} for length in (3.0, 6.0, 9.0)]
    return [
        Job(
            "V13",
            "V13 " + " ".join(f"{k}={v}" for k, v in one.items()),
            _V13 | one,
            _SAID,
            {"ratio": (1.25, 1.35)},
            on_device=False,
        )
        for one in changes
    ]


def _bridges() -> list[Job]:
    """Return V9 with its peaks, V7, V8 at a hundredth, a tenth and all of the source's 0.22 GPa."""
    found = []
    for (model, block), (peak, *_) in TABLE.items():
        one = {"model": model, "block": block, "method": "FLIP F0AL1", "until": 3.0}
        said = f"Yang (2016) table 6.2: peak without impact {peak:g} kN (with NB)"
        found.append((f"V9 {model} {block}", one, said, {"peak": (800 * peak, 1200 * peak)}))
    for model in ("M1", "M2", "M3", "M4"):
        one = {"model": model, "method": "FLIP F0AL1", "until": 3.0}
        found.append((f"V7 {model}", one, "Yang (2016) 5.2: curves alone", {}))
    one = {"model": "II", "method": "FLIP F0AL1", "until": 3.0}
    found.append(("V8 II", one, "Yang (2016) 6.1.2: curves alone", {}))
    made = [
        (f"{name} linear K={modulus:g}", one | {"bulk_modulus": modulus}, said, band)
        for modulus in (2.2e6, 2.2e7, 2.2e8)
        for name, one, said, band in found
    ]
    # The source's own way against locking, which ends within 200 steps at a Courant number of 0.1.
    small = {"method": "FLIP NB", "cfl": 0.05, "bulk_modulus": 2.2e6}
    made += [
        (f"{name} linear NB K=2.2e+06 Courant 0.05", one | small, said, band)
        for name, one, said, band in found
        if not name.startswith("V7")
    ]
    return [
        Job("bridges", name, one, said, band, on_device=False, goes_on=True)
        for name, one, said, band in made
    ]


def jobs() -> list[Job]:
    """Return all runs, the most wanted of the device first."""
    wave = "Bonus (2023) 6.9: all fall, 0.53 m/s (0.42 on a table, 0.53 to 0.60 by finite elements)"
    row = {
        "count": 24, "cells": 12, "slab": 0, "youngs_modulus": 2e8, "particles_per_cell": 9,
        "duration": 1.5, "steady": 7, "flip": 0.999, "shift": 0.025,
    }  # fmt: skip
    fall = {"fallen": (24.0, 24.0), "speed": (0.42, 0.60)}
    coarse = {"cells": 4, "slab": 16, "youngs_modulus": 2e7, "particles_per_cell": 27}
    real = {"youngs_modulus": 2e9}
    slosh = {
        "cell_size": 0.025, "thickness": 0.0, "bulk_modulus": 2.2e9, "mirror": False, "gap": 0.0,
        "until": 5.6,
    }  # fmt: skip
    period = {"period": (0.98 * 2.0031, 1.02 * 2.0031)}
    said = "Bonus (2023) 6.5: period 2.003 s; no number of the amplitude"
    tip = "Bonus (2023) 6.7: curves alone (Walhorn et al. 2005 and others)"
    sink = {"author_1500": (0.0, 0.17), "author_3000": (0.0, 0.13)}
    follow = "Bonus (2023) 6.8: follow the model reasonably; the band is that of added mass"
    cube = {"bulk_modulus": 2.2e9, "flip": 0.3, "until": 2.0}
    column = {"bulk_modulus": 2.2e9, "flip": 0.8, "until": 0.3}

    def swings(name: str, more: Mapping[str, Any], on_device: bool = True) -> Job:
        return Job("sloshing", f"sloshing {name}", slosh | more, said, period, on_device=on_device,
                   goes_on=True)  # fmt: skip

    def bends(name: str, more: Mapping[str, Any]) -> Job:
        return Job("elastic-column", f"elastic column {name}", column | more, tip, goes_on=True)

    def sinks(name: str, more: Mapping[str, Any]) -> Job:
        return Job("buoyancy", f"buoyancy {name}", cube | more, follow, sink, goes_on=True)

    def falls(name: str, more: Mapping[str, Any]) -> Job:
        return Job("dominoes", f"dominoes {name}", row | more, wave, fall, goes_on=True)

    # The source's thicknesses: 0.4 m of water, 12 mm of the column's tank (from its particles).
    first = [
        falls("plane ASFLIP", {}),
        *(
            swings(f"plane slip {1000 * cell:g} mm, {gap:g} cells off",
                   {"gap": gap, "cell_size": cell}, False)
            for cell in (0.2, 0.1)
            for gap in (0.0, 0.5)
        ),
        *(
            swings(f"plane slip {1000 * cell:g} mm K=2.2e+07",
                   {"cell_size": cell, "bulk_modulus": 2.2e7}, False)
            for cell in (0.2, 0.1, 0.05)
        ),
        swings("plane slip", {}),
        swings("plane slip 50 mm", {"cell_size": 0.05}),
        bends("2 mm", {"cell_size": 0.002}),
        bends("4 mm", {"cell_size": 0.004}),
        sinks("plane 25 mm", {"cell_size": 0.025}),
        bends("1 mm", {"cell_size": 0.001}),
        falls("plane ASFLIP 6 cells", {"cells": 6}),
        falls("plane ASFLIP 6 cells E=2e+09", real | {"cells": 6}),
        swings("0.4 m wide", {"cell_size": 0.05, "thickness": 0.4}),
        swings("0.4 m wide 25 mm", {"thickness": 0.4, "until": 3.0}),
        bends("in space 4 mm", {"cell_size": 0.004, "thickness": 0.012}),
        bends("in space 2 mm", {"cell_size": 0.002, "thickness": 0.012}),
        sinks("plane 50 mm", {"cell_size": 0.05}),
        sinks("in space 50 mm", {"cell_size": 0.05, "thickness": 0.4}),
        falls("ASFLIP 4 cells 24 mm wide", coarse),
        sinks("plane 12.5 mm", {"cell_size": 0.0125}),
        falls("plane ASFLIP E=2e+09", real),
        sinks("in space 25 mm", {"cell_size": 0.025, "thickness": 0.4}),
        bends("in space 1 mm", {"cell_size": 0.001, "thickness": 0.012, "until": 0.26}),
    ]  # fmt: skip
    return [*_blocks(), *_bridges(), *first]


#: Parameters for seconds on a core: that every run works and leaves its line.
SMALL: Mapping[str, Mapping[str, Any]] = {
    "V13": {},
    "bridges": {"bulk_modulus": 1e5, "until": 0.4},
    "dominoes": {"count": 3, "cells": 4, "slab": 0, "youngs_modulus": 1e6, "duration": 0.05},
    "sloshing": {"cell_size": 0.2, "thickness": 0.0, "bulk_modulus": 2.2e5, "until": 2.0},
    "elastic-column": {"cell_size": 0.004, "bulk_modulus": 1e5, "until": 0.2, "thickness": 0.0},
    "buoyancy": {"cell_size": 0.1, "bulk_modulus": 2.2e5, "until": 0.5, "thickness": 0.0},
}


class Timed:
    """Makes simulations that end at a time of the clock; knows whether one did."""

    def __init__(
        self, device: str, deadline: float, checkpoint: Path | None, threads: int = 1
    ) -> None:
        """`deadline` as of `time.time`; with a checkpoint the run goes on from it."""
        self.device, self.deadline, self.checkpoint = device, deadline, checkpoint
        self.threads = threads
        self.late = False
        self.sim: Any = None

    def __call__(self, scene: libmpm.Scene) -> libmpm.Simulation:
        """Return the simulation of a scene."""
        timed = self

        class Ending(libmpm.Simulation):
            def run(self, *, until: float, **_: Any) -> bool:
                left = timed.deadline - time.time()
                timed.late = timed.late or left <= 0
                done = not timed.late and super().run(until=until, progress=False, wall_limit=left)
                if not done and not timed.late and timed.checkpoint is not None:
                    timed.checkpoint.parent.mkdir(parents=True, exist_ok=True)
                    self.save_checkpoint(timed.checkpoint)
                timed.late = timed.late or not done
                return True

        on_cpu = self.device == "cpu"
        how: dict[str, Any] = {"threads": self.threads} if on_cpu else {"shared_device": True}
        self.sim = None
        if self.checkpoint is not None and self.checkpoint.exists():
            self.sim = Ending.resume(self.checkpoint)
            if self.sim.scene.to_dict() != scene.to_dict():
                self.sim = None
        if self.sim is None:
            self.sim = Ending(scene, device=self.device, **how)
        return self.sim  # type: ignore[no-any-return]


def measure(job: Job, device: str, until: float, keep: Path | None, threads: int) -> dict[str, Any]:
    """Run a job until a time of the clock at most, and return its line."""
    warnings.simplefilter("ignore")  # partial histories, and what the source's scenes are like
    began = time.time()
    if began >= until:
        return {"name": job.name, "claim": job.scene, "complete": False, "reached": 0.0}
    checkpoint = keep / f"{job.name.replace(' ', '-')}.npz" if keep and job.goes_on else None
    deadline = min(until, began + job.limit)
    timed = Timed(device if job.on_device else "cpu", deadline, checkpoint, threads)
    line: dict[str, Any] = {
        "name": job.name, "claim": job.scene, "parameters": dict(job.parameters),
        "source": job.source, "band": {k: list(v) for k, v in job.band.items()},
    }  # fmt: skip
    try:
        values = claims_scenes.RUNS[job.scene](timed, job.parameters)
        line["values"] = {
            k: float(f"{v:.6g}") if math.isfinite(v) else None for k, v in values.items()
        }
        line["within"] = {
            k: bool(low <= values[k] <= high) for k, (low, high) in job.band.items() if k in values
        }
        line["complete"] = not timed.late
    except Exception as error:
        # A measure of a history cut short may fail in any way: its line says so, others go on.
        line |= {"complete": False, "error": f"{type(error).__name__}: {error}"[:2000]}
    if timed.sim is not None:
        line |= {
            "device": bench._device(timed.sim).partition(",")[0], "reached": timed.sim.time,
            "steps": timed.sim.steps, "precision": timed.sim.precision,
            "pipeline": timed.sim.pipeline, "particles": timed.sim.plan.particles,
        }  # fmt: skip
    return line | {
        "seconds": round(time.time() - began, 2), "commit": bench.commit(),
        "version": libmpm.__version__,
    }  # fmt: skip


def merged(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one line a run, in the order in which they came: the one that got furthest."""
    found: dict[str, dict[str, Any]] = {}
    for line in lines:
        have = found.get(line["name"])
        rank = line["complete"], line.get("reached", 0.0)
        if have is None or rank >= (have["complete"], have.get("reached", 0.0)):
            found[line["name"]] = line
    return list(found.values())


def table(lines: list[dict[str, Any]]) -> str:
    """Return what was measured, a row a run, as a table of a page."""
    rows = [["run", "particles, steps", "until", "measured", "the source"]]
    for line in lines:
        values = {k: f"{v:.4g}" for k, v in line.get("values", {}).items() if v is not None}
        said = ", ".join(f"{k} {v}" for k, v in values.items()) or line.get("error", "-")
        rows.append([
            line["name"], f"{line.get('particles', '-')}, {line.get('steps', '-')}",
            f"{line.get('reached', 0.0):.3g} s{'' if line['complete'] else ' (partial)'}", said,
            line.get("source", "-"),
        ])  # fmt: skip
    return "\n".join(markdown(rows))


def main() -> int:
    """Run what is wanted and not there yet; 1 if a run failed or did not end."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("claims", nargs="*", help=", ".join(claims_scenes.RUNS))
    parser.add_argument("--only", default="", help="part of the names of runs")
    parser.add_argument("--named", nargs="*", default=[], help="whole names of runs")
    parser.add_argument("--device", default="cuda", help="cpu, cuda or cuda:N")
    parser.add_argument("--workers", type=int, default=8, help="runs at once on the device")
    parser.add_argument("--processes", type=int, default=12, help="at once on the CPU")
    parser.add_argument("--threads", type=int, default=1, help="of each run on the CPU")
    parser.add_argument("--budget", type=float, default=330.0, help="s of wall time")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--keep", type=Path, help="folder of checkpoints")
    parser.add_argument("--small", action="store_true", help="sizes of seconds, to try it")
    parser.add_argument("--again", action="store_true", help="also what the file has")
    parser.add_argument("--list", action="store_true", help="run nothing")
    parser.add_argument("--table", action="store_true", help="run nothing, print what there is")
    parser.add_argument(
        "--merge", type=Path, nargs="+", help="run nothing, take over lines of other files"
    )
    a = parser.parse_args()
    if unknown := sorted(set(a.claims) - set(claims_scenes.RUNS)):
        parser.error(f"no claim {', '.join(unknown)}; there are {', '.join(claims_scenes.RUNS)}")
    if a.merge:
        lines = merged([x for path in (a.output, *a.merge) for x in load(path)])
        a.output.write_text("".join(json.dumps(x) + "\n" for x in lines), encoding="utf-8")
        return 0
    if a.table:
        some = [x for x in load(a.output) if a.only in x["name"]]
        print(table([x for x in some if not a.claims or x["claim"] in a.claims]))
        return 0
    have = set() if a.again else {x["name"] for x in load(a.output) if x.get("complete")}
    chosen = [
        Job(**(vars(job) | {"parameters": dict(job.parameters) | dict(SMALL[job.scene])}))
        if a.small
        else job
        for job in jobs()
        if job.scene in (a.claims or claims_scenes.RUNS)
        and a.only in job.name
        and (not a.named or job.name in a.named)
        and job.name not in have
    ]
    if missing := sorted(set(a.named) - {job.name for job in jobs()}):
        parser.error(f"no run {', '.join(missing)}; --list names them")
    if a.list:
        print("\n".join(job.name for job in chosen))
        return 0
    until, bad = time.time() + a.budget, 0
    spawn = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(a.processes, mp_context=spawn) as cores,
        # Threads share a device at once, processes by turns.
        ThreadPoolExecutor(a.workers) as device,
    ):
        on_cores = cores if a.device != "cpu" else None
        waiting = [
            (device if job.on_device and on_cores else cores).submit(
                measure, job, a.device, until, a.keep, a.threads
            )
            for job in chosen
        ]
        for future in as_completed(waiting):
            line = future.result()
            append(a.output, line)
            bad += not line["complete"]
            shown = {k: v for k, v in line.get("values", {}).items() if k in line["band"]}
            end = "complete" if line["complete"] else f"PARTIAL at {line.get('reached', 0.0):.4g} s"
            print(f"{line['name']:44} {end:10} {line.get('seconds', 0):7.1f} s "
                  f"{shown or line.get('error', '')}", flush=True)  # fmt: skip
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
