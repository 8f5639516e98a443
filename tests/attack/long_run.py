"""A long run of the demonstration, killed and resumed, against one that nobody stops.

``python tests/attack/long_run.py --device cuda --steps 1000000 --kills 8 --results FOLDER``

Both runs write frames, samples and checkpoints; both must end in the same bits, and the memory of
their processes may not grow. Results go to `long_run.json`, written as the runs go on.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

import libmpm
from attack.base import Defect
from attack.kills import compare
from attack.work import commit
from libmpm._src.cli.demo import load_demo
from libmpm._src.output.checkpoint import find_checkpoints

#: Frames and checkpoints of a run.
FRAMES, CHECKPOINTS = 20, 40
#: Seconds between two looks at a process, and at the start of one, which is no growth.
LOOK, START = 0.5, 10.0
#: Growth of the resident memory after the start that is called flat, beyond so many times the bytes
#: of the samples. These are kept, and copies of all of them go to checkpoints and, when it has to
#: grow, to their file; the allocator keeps room of those. 150,000 steps of a small tank with 40
#: checkpoints grow by 0.3 MB without sensors, by 30 MB with 9.6 MB of samples, and by the samples
#: alone without output. A leak of 100 bytes a step is 95 MiB in 1e6 steps.
FLAT, COPIES = 32 << 20, 3


def main() -> int:
    """Run both, compare, write; returns 1 for a defect."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--precision", default="single")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--kills", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=8.0, help="then it ends unfinished")
    parser.add_argument("--cells", type=float, default=0.1, help="cell size, m; the demo's is 0.05")
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--state", type=Path, help="folder of both runs: a call that ends "
                        "unfinished is gone on with by the next one")  # fmt: skip
    parser.add_argument("--child", nargs=2, metavar=("FOLDER", "UNTIL"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        _go_on(Path(given.child[0]), float(given.child[1]), given)
        return 0
    if given.state:
        given.state.mkdir(parents=True, exist_ok=True)
        return _both(given.state, given)
    with tempfile.TemporaryDirectory() as folder:
        return _both(Path(folder), given)


def _scene(cells: float) -> libmpm.Scene:
    document = load_demo().scene.to_dict()
    return libmpm.Scene.from_dict(document | {"cell_size": cells})


def _go_on(folder: Path, until: float, given: argparse.Namespace) -> None:
    """Run to the end, from the newest checkpoint where there is one."""
    settings: dict[str, Any] = {
        "frame_interval": until / FRAMES, "checkpoint_interval": until / CHECKPOINTS,
    }  # fmt: skip
    output = libmpm.Output(folder, **settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if find_checkpoints(folder / "checkpoints"):
            sim = libmpm.Simulation.resume(folder, output=output)
        else:
            output = libmpm.Output(folder, **settings, overwrite=True)
            sim = libmpm.Simulation(
                _scene(given.cells), device=given.device, precision=given.precision, output=output,
                threads=0 if given.device != "cpu" else 1,
            )  # fmt: skip
        with sim:
            sim.run(until=until, progress=False)
            sim.save_checkpoint(folder / "end.npz")
            (folder / "steps").write_text(str(sim.steps))


def _both(folder: Path, given: argparse.Namespace) -> int:
    end = time.monotonic() + 60 * given.minutes
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plan = _scene(given.cells).plan(device="cpu", until=1.0, precision=given.precision)
    until = given.steps * plan.time_step
    rng = random.Random(given.seed + time.time_ns())
    result: dict[str, Any] = {
        "device": given.device, "precision": given.precision, "cells": given.cells,
        "until": until, "kills": 0, "outcome": "not finished", "commit": commit(),
        "hardware": _hardware(given.device),
    }  # fmt: skip

    def save() -> None:
        given.results.mkdir(parents=True, exist_ok=True)
        path = given.results / "long_run.json"
        path.with_suffix(".part").write_text(json.dumps(result, indent=1) + "\n")
        path.with_suffix(".part").replace(path)

    # Of earlier calls: seconds of the run that nobody stops, kills of the other, and growth.
    kept = folder / "state.json"
    before = {"seconds": 0.0, "kills": 0, "growth": 0}
    if kept.exists():
        before |= json.loads(kept.read_text())
    result["kills"] = before["kills"]
    parts: list[dict[str, Any]] = []
    result["parts"] = parts
    try:
        if not (folder / "whole" / "steps").exists():
            began = time.monotonic()
            try:
                parts.append(_process(folder / "whole", until, given, end, None))
            finally:
                before["seconds"] += time.monotonic() - began
                before["growth"] = max([before["growth"], *(p["growth"] for p in parts)])
                kept.write_text(json.dumps(before))
        save()
        while not (folder / "killed" / "steps").exists():
            part = before["seconds"] / (given.kills + 1)
            due = before["kills"] < given.kills
            delay = max(rng.uniform(0.2, 1.8) * part, 1.0) if due else None
            parts.append(_process(folder / "killed", until, given, end, delay))
            before["kills"] += parts[-1]["killed"]
            before["growth"] = max(before["growth"], parts[-1]["growth"])
            result["kills"] = before["kills"]
            kept.write_text(json.dumps(before))
            save()
        compare(folder / "killed", folder / "whole")
        result["steps"] = int((folder / "whole" / "steps").read_text())
        growth = before["growth"]
        result["largest_growth"] = growth
        result["outcome"] = "the same bits"
        result["samples"] = samples = _samples(folder / "whole")
        if growth > FLAT + COPIES * samples:
            raise Defect(f"resident memory grows by {growth / 2**20:.0f} MiB")
    except Defect as defect:
        result["outcome"] = f"defect: {defect}"
    except TimeoutError:
        pass
    save()
    print(json.dumps({k: v for k, v in result.items() if k != "parts"}))
    return 1 if result["outcome"].startswith("defect") else 0


def _process(
    folder: Path, until: float, given: argparse.Namespace, end: float, delay: float | None
) -> dict[str, Any]:
    """Run in a process of its own, and kill it after a delay; return how its memory went."""
    call = [sys.executable, __file__, "--device", given.device, "--precision", given.precision,
            "--cells", str(given.cells), "--child", str(folder), str(until)]  # fmt: skip
    began = time.monotonic()
    memory: list[tuple[float, int]] = []
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True) as child:
        while child.poll() is None:
            now = time.monotonic()
            if now > end or (delay is not None and now - began > delay):
                child.kill()
                child.wait()
                break
            memory.append((round(now - began, 1), _resident(child.pid)))
            time.sleep(0.05 if delay is not None and delay < 5 else LOOK)
        said = child.stderr.read() if child.stderr else ""
    if time.monotonic() > end:
        raise TimeoutError
    killed = child.returncode == -9
    if child.returncode and not killed:
        raise Defect(f"exit code {child.returncode}: {said[-3000:]}")
    seconds = time.monotonic() - began
    later = [m for t, m in memory if t >= START and m > 0]
    thin = memory[:: max(1, len(memory) // 40)]
    return {
        "seconds": round(seconds, 2), "killed": killed, "resident": thin,
        "growth": _growth(later),
    }  # fmt: skip


def _hardware(device: str) -> str:
    """Return the name of the device that a run is on, and how many cores are beside it."""
    call = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
    name = "CPU"
    if device != "cpu":
        with contextlib.suppress(OSError):
            found = subprocess.run(call, capture_output=True, text=True, check=False)
            name = found.stdout.strip().splitlines()[0] if found.stdout.strip() else device
    return f"{name}, {len(os.sched_getaffinity(0))} cores"


def _samples(folder: Path) -> int:
    """Return the bytes of the samples of a run."""
    found = libmpm.load(folder).sensors.values()
    return sum(series.time.nbytes + series.values.nbytes for series in found)


def _growth(resident: list[int]) -> int:
    """Return how much more the last tenth of a run has than its first, in bytes."""
    if len(resident) < 10:
        return 0
    tenth = len(resident) // 10
    return int(np.median(resident[-tenth:]) - np.median(resident[:tenth]))


def _resident(pid: int) -> int:
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return 1024 * int(line.split()[1])
    except (OSError, IndexError):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
