"""Bores against decks, and blocks that dam the flow below one: Yang (2016) 5.2 and 6.1.

    python benchmarks/bridges.py                           all on the GPU
    python benchmarks/bridges.py --cases V9 --workers 8    some, eight at once
    python benchmarks/bridges.py --list                    what there is, and its size
    python benchmarks/bridges.py --device cpu --bulk-modulus 1e6 --budget 900
    python benchmarks/bridges.py --page                    figures and tables of docs/bridges.md

V7: the models of table 5.3 with F-bar, F0AL1 and NB, all with FLIP, and with F-bar and APIC. V8:
the deck a cell above the still water, without debris, and a tenth of the modulus of water against
all of it. V9: blocks of table 6.1. K: loads of M1 until 1.5 s by modulus, cells and transfer, on
one core: --cases K --device cpu.

One JSON line a run is appended to --output; what it has for the same kind of device and modulus is
left out, so that a stopped command goes on when it is given again; `--again` measures anew. No
run begins after --budget seconds of wall time, and one that has not ended by then is given up.
Histories are means over 0.05 s. What is chosen where the source has drawings: `bridges_scenes`.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from bridges_scenes import (
    BLOCKS,
    DECKS,
    DEPTHS,
    FRONT,
    GAUGES,
    INTERVAL,
    LENGTH,
    MODELS,
    Model,
    net_area,
    scene,
)  # fmt: skip
from result_pages import append, load

import libmpm
from libmpm._src.cli import bench
from libmpm.analysis import Signal

RESULTS = Path(__file__).resolve().parent / "results" / "bridges.jsonl"
#: Those with linear functions, apart: the page tells of quadratic ones.
LINEAR = RESULTS.with_name("bridges_linear.jsonl")
KEPT = 0.05  # s, of histories

#: Of water, in the source's damming runs and as it is, Pa.
SOFT, REAL = 0.22e9, 2.2e9
METHODS = ("FLIP NB", "FLIP F0AL1", "FLIP fbar", "fbar")
#: Those of V8 and V9; those of K, with the moduli of each, Pa.
FEW = ("FLIP NB", "FLIP fbar")
LADDER = {
    "M1": dict.fromkeys(("fbar", "NB", *METHODS[:3]), (1e6, 1e7, 1e8)),
    "M1-R": dict.fromkeys(("fbar", "NB", *FEW), (1e6, 1e7)),
}


@dataclass(frozen=True)
class Job:
    """A run: what it is about, its model, block, method, modulus in Pa and duration in s."""

    case: str
    model: str
    method: str
    bulk_modulus: float
    until: float
    block: str = ""
    linear: bool = False  # modified linear functions, as the source's, in place of quadratic ones

    @property
    def name(self) -> str:
        """What tells runs of a device apart."""
        parts = (self.case, self.model, self.block, self.method, f"K={self.bulk_modulus:g}")
        return " ".join(p for p in (*parts, "linear" if self.linear else "") if p)


def jobs(cases: Sequence[str], modulus: float) -> list[Job]:
    """Return the runs of some cases, the cheap ones first."""
    found = []
    if "V9" in cases:
        for method in FEW:
            for model, blocks in (("I", tuple(BLOCKS)), ("II", ("B1", "B2", "B3", "B5"))):
                found += [Job("V9", model, method, modulus, 3.0, b) for b in ("", *blocks)]
    if "V8" in cases:
        found += [Job("V8", "II", m, modulus, 6.0) for m in FEW]
    if "V7" in cases:
        for model in ("F1", "F2", "F3", "F1-R"):
            found += [Job("V7", model, m, modulus, 2.0) for m in METHODS]
        for model in ("M1", "M1-L", "M2", "M3", "M4", "M1-R", "M2-R"):
            found += [Job("V7", model, m, modulus, 6.0) for m in METHODS]
    # Ten times the modulus: what it changes.
    if "V8" in cases:
        found += [Job("V8", "II", m, 10 * modulus, 6.0) for m in FEW]
    if "V7" in cases:
        found += [Job("V7", "M1-L", m, 10 * modulus, 6.0) for m in METHODS]
    if "K" in cases:
        rungs = [
            Job("K", model, m, k, 1.5)
            for model, ladder in LADDER.items()
            for m, some in ladder.items()
            for k in some
        ]
        found += sorted(rungs, key=steps)
    return found


def steps(job: Job) -> float:
    """Return about how many steps a run takes."""
    sound = math.sqrt(job.bulk_modulus / 1000.0) + 3.0
    return job.until * sound / (0.4 * MODELS[job.model].cell)


# ---- measures -----------------------------------------------------------------------------------


def total(sim: libmpm.Simulation, model: Model, kind: str, column: str) -> Signal:
    """Return the force on all parts of a deck, N: means over the interval of the samples."""
    parts = [
        Signal.from_series(sim.sensors[f"{kind} {name}"], column).resampled(INTERVAL)
        for name in DECKS[model.deck]
    ]
    every = np.sum([p.value for p in parts], axis=0)
    return Signal(parts[0].time, every, sampling="mean", start=0.0)


def smooth(signal: Signal) -> Signal:
    """Return the source's mean of eleven samples without the largest and the smallest."""
    return signal.moving_mean(11, trim=1)


def between(time: Any, value: Any, start: float, end: float) -> float:
    """Return the mean of the samples between two times; not-a-number without any."""
    inside = (np.asarray(time) > start) & (np.asarray(time) <= end)
    found = np.asarray(value)[inside]
    found = found[np.isfinite(found)]
    return float(found.mean()) if len(found) else math.nan


def arrival(time: Any, level: Any, height: float) -> float:
    """Return when a level first passes a height, s, between samples."""
    level = np.nan_to_num(np.asarray(level))
    over = np.flatnonzero(level >= height)
    if not len(over) or over[0] == 0:
        return math.nan
    k = int(over[0])
    share = (height - level[k - 1]) / (level[k] - level[k - 1])
    return float(time[k - 1] + share * (time[k] - time[k - 1]))


def front(sim: libmpm.Simulation, model: Model) -> dict[str, float]:
    """Return speed of the bore and state behind it, over those of the shallow-water equations."""
    bore, half = model.state(), 0.5 * (model.state().depth + model.flume)
    places, times = [], []
    for name, x in GAUGES.items():
        series = sim.sensors[name]
        if x > 0:
            places.append(x)
            times.append(arrival(series.time, series.values[:, 0], half))
    speed = float(np.polyfit(times, places, 1)[0]) if np.all(np.isfinite(times)) else math.nan
    # Behind the front at 2 m, until it is at the outlet.
    series = sim.sensors["gauge-2"]
    window = (2.0 / bore.speed + 0.3, model.outlet / bore.speed)
    level, flow = (between(series.time, series.values[:, k], *window) for k in (0, 1))
    return {
        "front_speed": speed / bore.speed,
        "depth_behind": level / bore.depth,
        "velocity_behind": flow / bore.velocity,
    }


def deck_values(sim: libmpm.Simulation, model: Model) -> dict[str, float]:
    """Return forces of a deck in N, and what the text of the source speaks about.

    "first" is until 0.5 s after the front is due at the deck, "middle" from 0.8 to 1.45 s, "late"
    from 2 s on.
    """
    bore = model.state()
    due = FRONT / bore.speed if model.bore else 0.0
    end = sim.time
    across, up = (smooth(total(sim, model, "load", f"force_{a}")) for a in "xy")
    found: dict[str, float] = {}
    for name, force in (("x", across), ("y", up)):
        first = (force.time > 0.1) & (force.time < due + 0.5)
        late = force.time > 2.0
        found[f"middle_{name}"] = between(force.time, force.value, 0.8, 1.45)
        if first.any():
            found[f"first_{name}"] = float(force.value[first].max())
        if late.any():
            values = force.value[late]
            found[f"late_{name}"] = float(values.mean())
            found[f"late_{name}_deviation"] = float(values.std())
            found[f"late_{name}_least"] = float(values.min())
            found[f"late_{name}_most"] = float(values.max())
    gauge = sim.sensors["gauge"]
    for name, begin, stop in (("second", 0.1, 1.0), ("second_2", 1.0, 2.0), ("rest", 2.0, end)):
        found[f"gauge_level_{name}"] = between(gauge.time, gauge.values[:, 0], begin, stop)
        found[f"gauge_velocity_{name}"] = between(gauge.time, gauge.values[:, 1], begin, stop)
    level = gauge.values[gauge.time > 1.0, 0]
    found["gauge_level_deviation"] = float(np.std(level)) if len(level) else math.nan
    below = sim.sensors["below"]
    filled = below.values[:, 0] / ((LENGTH - 0.2) * model.cell)
    found["below_filled"] = between(below.time, filled, 2.0, end)
    found["fastest"] = float(np.nanmax(sim.sensors["fastest"].values))
    return found


def block_values(sim: libmpm.Simulation, model: Model, block: str) -> dict[str, float]:
    """Return the peak of the force without impact, with the net area then, and when it meets.

    Means of 10 samples. A block meets the deck when it is within one and a half cells; windows that
    begin less than 0.1 s after that count as impact.
    """
    series = sim.sensors["block"]
    column = {name: series.values[:, k] for k, name in enumerate(series.components)}
    force = total(sim, model, "load", "force_x").moving_mean(10)
    meets = np.flatnonzero(column["upper_x"] >= FRONT - 1.5 * model.cell)
    met = float(series.time[meets[0]]) if len(meets) else math.nan
    # Particles lie inside the surface.
    inside = column["lower_y"][0] - (model.state().depth - 0.15 * BLOCKS[block][1] / 1000.0)
    bottom = np.minimum(column["lower_y"] - inside, model.soffit)
    found = {
        "met": met,
        "net_area_start": net_area(model, block),
        "least_bottom": float(bottom.min()),
        "end_centroid_x": float(column["centroid_x"][-1]),
        "end_centroid_y": float(column["centroid_y"][-1]),
        "largest_turn": float(np.abs(column["angle"]).max()),
    }
    if math.isnan(met):
        return found | {"peak": math.nan, "peak_impact": math.nan}
    near = (force.time > met - 0.1) & (force.time < met + 0.15)
    after = force.time > met + 0.15
    if near.any():
        found["peak_impact"] = float(force.value[near].max())
    if after.any():
        k = int(np.flatnonzero(after)[np.argmax(force.value[after])])
        found["peak"] = float(force.value[k])
        found["peak_time"] = float(force.time[k])
        found["net_area_peak"] = float(np.interp(force.time[k], series.time, bottom))
        found["mean_after"] = float(force.value[after].mean())
    return found


def history(sim: libmpm.Simulation, model: Model, block: str) -> dict[str, list[float | None]]:
    """Return means over `KEPT` s of what the figures show."""
    edges = np.arange(0.0, sim.time + 1e-9, KEPT)
    found: dict[str, Any] = {"time": (edges[1:] - 0.5 * KEPT).round(4).tolist()}

    def keep(name: str, time: Any, value: Any, digits: int) -> None:
        rows = [between(time, value, a - 1e-9, b) for a, b in pairwise(edges)]
        found[name] = [None if math.isnan(x) else round(x, digits) for x in rows]

    gauge = sim.sensors["gauge"]
    keep("level", gauge.time, gauge.values[:, 0], 4)
    keep("velocity", gauge.time, gauge.values[:, 1], 3)
    if not model.deck:
        return found
    for name, kind, axis in (("force_x", "load", "x"), ("force_y", "load", "y")):
        signal = smooth(total(sim, model, kind, f"force_{axis}"))
        keep(name, signal.time, signal.value, 1)
    pushed = smooth(total(sim, model, "front", "force_x"))
    keep("front_force", pushed.time, pushed.value, 1)
    for name in ("front pressure", "soffit pressure"):
        series = sim.sensors[name]
        keep(name.replace(" ", "_"), series.time, series.values[:, 0], 0)
    below = sim.sensors["below"]
    keep("below", below.time, below.values[:, 0] / ((LENGTH - 0.2) * model.cell), 3)
    if block:
        series = sim.sensors["block"]
        for name in ("centroid_x", "lower_y", "angle", "boundary_force_x"):
            values = series.values[:, series.components.index(name)]
            keep(name, series.time, values, 1 if "force" in name else 4)
    return found


# ---- runs ---------------------------------------------------------------------------------------


def measure(job: Job, device: str, limit: float) -> dict[str, Any]:
    """Run a job on one thread, or on the device, and return its line; "values" only if it ended."""
    # What leaves is counted: "lost". A square block of 400 kg/m³ turns over; the source has it.
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    model = MODELS[job.model]
    made = scene(model, job.method, job.bulk_modulus, job.block or None, job.linear)
    began = time.perf_counter()
    how: dict[str, Any] = {"threads": 1} if device == "cpu" else {"shared_device": True}
    sim = libmpm.Simulation(made, device=device, **how)
    particles = sum(len(body) for body in sim.particles.values())
    done = sim.run(until=job.until, progress=False, wall_limit=max(limit, 0.0))
    line: dict[str, Any] = {"name": job.name, **asdict(job), "device": device.partition(":")[0]}
    if not done:
        return line | {"reached": sim.time}
    values = deck_values(sim, model) if model.deck else front(sim, model)
    if job.block:
        values |= block_values(sim, model, job.block)
    now = sum(len(body) for body in sim.particles.values())
    came, went = (
        float(x.values[-1, 0]) if len(x.time) else 0.0
        for x in (sim.inflow["inlet"], sim.outflow["outlet"])
    )
    values["lost"] = particles + came - went - now
    return line | {
        "particles": particles,
        "steps": sim.steps,
        "precision": sim.precision,
        "pipeline": sim.pipeline,
        "depth": DEPTHS[model.deck],
        "seconds": round(time.perf_counter() - began, 2),
        "values": {
            k: None if math.isnan(x) else float(f"{x:.5g}") for k, x in sorted(values.items())
        },
        "history": history(sim, model, job.block),
        "commit": bench.commit(),
        "version": sim.version,
    }


def attempt(job: Job, device: str, until: float) -> dict[str, Any]:
    """Return the line of a run, or what went wrong; `until` is a time of the wall clock."""
    left = until - time.time()
    if left <= 0:
        return {"name": job.name, "reached": 0.0}
    try:
        return measure(job, device, left)
    except libmpm.Error as error:
        return {"name": job.name, "error": str(error)}


def run_all(chosen: Sequence[Job], a: argparse.Namespace) -> int:
    """Run what is left, append the lines, and return how many runs failed."""
    until = time.time() + a.budget
    failed = 0
    # Threads share a device at once, processes by turns.
    pool: Executor = ThreadPoolExecutor(a.workers)
    if a.device == "cpu":
        pool = ProcessPoolExecutor(a.workers, mp_context=multiprocessing.get_context("spawn"))
    with pool:
        waiting = [pool.submit(attempt, job, a.device, until) for job in chosen]
        for future in as_completed(waiting):
            line = future.result()
            if "values" in line:
                append(a.output, line)
                told = f"{line['steps']:,} steps in {line['seconds']:.0f} s"
            elif "error" in line:
                failed += 1
                told = line["error"].splitlines()[0]
            else:
                told = f"no time left, at {line['reached']:.3g} s; give the command again"
            print(f"{line['name']:36} {told}", flush=True)
    return failed


def main() -> int:
    """Run the cases, or write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", default=["V7", "V8", "V9"])
    parser.add_argument("--device", default="cuda", help="cpu or cuda:N")
    parser.add_argument("--methods", nargs="+", help=", ".join((*METHODS, "NB")))
    parser.add_argument("--only", default="", help="part of the names of runs")
    parser.add_argument("--bulk-modulus", type=float, default=SOFT, help="Pa")
    parser.add_argument("--linear", action="store_true", help=f"the source's functions: {LINEAR}")
    parser.add_argument("--until", type=float, help="s simulated, in place of 3 or 6")
    parser.add_argument("--workers", type=int, default=1, help="runs at once")
    parser.add_argument("--budget", type=float, default=540.0, help="s of wall time")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--page", action="store_true", help="write figures and tables")
    a = parser.parse_args()
    if a.page:
        import bridges_page

        bridges_page.write(a.output)
        return 0
    chosen = [
        j
        for j in jobs(a.cases, a.bulk_modulus)
        if a.only in j.name and j.method in (a.methods or [j.method])
    ]
    if a.until is not None:
        chosen = [Job(**{**asdict(j), "until": a.until}) for j in chosen]
    if a.linear:
        # Affine transfers divide by a second moment that is zero at nodes. Devices lack them.
        if a.device.partition(":")[0] != "cpu":
            parser.error("--linear takes modified functions, which devices lack; --device cpu")
        chosen = [Job(**{**asdict(j), "linear": True}) for j in chosen if "FLIP" in j.method]
        a.output = LINEAR if a.output == RESULTS else a.output
    kind = a.device.partition(":")[0]
    have = {(x["name"], x["device"], x["until"]) for x in load(a.output)}
    if not a.again:
        chosen = [j for j in chosen if (j.name, kind, j.until) not in have]
    if a.list:
        for job in chosen:
            print(f"{job.name:36} {job.until:g} s, {steps(job):,.0f} steps")
        return 0
    return 1 if run_all(chosen, a) else 0


if __name__ == "__main__":
    raise SystemExit(main())
