"""Laboratory flumes at a level, compared with what was measured there: a JSON line a run.

    python benchmarks/flumes.py lwf --level laptop [--device cuda] [--budget SECONDS] [--threads N]
                                [--cell-size M] [--debris LAYOUT] [--set NAME=VALUE ...]
                                [--with INGREDIENT=VALUE ...]
                                [--output FILE] [--figures FOLDER] [--near FOLDER [--trunk]]

`--set` changes any argument of the facility, such as structure=null. `--with` changes the scene
that it returns: bed=held|linear|auto and walls=... what these boundaries do, transfer=SCHEME[:FLIP]
of the scene, shifting=true|false or density=true|false of the water. Goes to
benchmarks/results/flumes.jsonl. A run that its budget ends is compared in what it reached.
`--near`: the near field of the Large Wave Flume, from a strip's run in that folder, which is run
first where it is not there; `--trunk` runs that alone. `--device cuda:0,cuda:1`: on several; a
strip on the first.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from result_pages import append

import libmpm
from libmpm import flumes
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/flumes.jsonl"


def _setting(text: str) -> tuple[str, Any]:
    """Return name and value of an argument; a value that is no JSON is a text."""
    name, _, said = text.partition("=")
    try:
        return name, json.loads(said)
    except json.JSONDecodeError:
        return name, said


def with_ingredients(scene: libmpm.Scene, ingredients: dict[str, Any]) -> libmpm.Scene:
    """Return the scene with other walls, another transfer, or water that is shifted or not."""
    if not ingredients:
        return scene
    known = scene.to_dict()
    for name, said in ingredients.items():
        if name in ("bed", "walls"):
            (found,) = (b for b in known["boundaries"] if b["name"] == name)
            found["response"]["cell"] = said
        elif name == "transfer":
            scheme, _, share = str(said).partition(":")
            one = libmpm.methods.Transfer(
                scheme=scheme, **({"flip": float(share)} if share else {})
            )
            known["method"]["transfer"] = one.to_dict()
        elif name in ("shifting", "density"):
            for body in known["bodies"]:
                if body["material"]["type"] == "TaitFluid":
                    body["fbar"] = libmpm.FBar(**{name: bool(said)}).to_dict()
        else:
            raise SystemExit(f"--with {name}: expected bed, walls, transfer, shifting or density")
    return libmpm.Scene.from_dict(known)


def levels_at_end(sim: libmpm.Simulation) -> dict[str, float]:
    """Return how far levels are from those at rest, m: means of the last 2 s of the gauges."""
    found = {}
    for placed in sim.scene.sensors:
        if isinstance(placed.sensor, (libmpm.sensors.WaveGauge, libmpm.sensors.ColumnGauge)):
            series = sim.sensors[placed.name]
            level = series.values[:, 0]
            last = level[series.time > series.time[-1] - 2.0] if len(level) else level
            if len(last) and np.isfinite(level[0]) and np.isfinite(last).any():
                found[placed.name] = round(float(np.nanmean(last) - level[0]), 4)
    return found


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("name", choices=flumes.names())
    parser.add_argument("--level", default="laptop")
    parser.add_argument("--cell-size", type=float, help="m; default: the level's")
    parser.add_argument("--debris")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="sets")
    parser.add_argument("--with", action="append", default=[], metavar="INGREDIENT=VALUE",
                        dest="ingredients")  # fmt: skip
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--budget", type=float, default=math.inf, help="of the clock, s")
    parser.add_argument("--near", type=Path, metavar="FOLDER", help="run of the strip")
    parser.add_argument("--trunk", action="store_true", help="with --near: no more than that run")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--figures", type=Path, help="folder for the figure and the table")
    given = parser.parse_args()
    changes = {"cell_size": given.cell_size, "debris": given.debris}
    changes = {k: v for k, v in changes.items() if v is not None}
    changes |= dict(_setting(text) for text in given.sets)
    flume = flumes.named(given.name).at_level(given.level, **changes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        devices = given.device.split(",")
        before = time.monotonic()
        if given.near is None:
            scene = flume.scene()
        else:
            assert isinstance(flume, flumes.LargeWaveFlume)
            scene = flume.near_field(given.near, device=devices[0])
        ingredients = dict(_setting(text) for text in given.ingredients)
        scene = with_ingredients(scene, ingredients)
        trunk = round(time.monotonic() - before, 1)
        if given.trunk:
            print(f"the strip: {trunk} s")
            return 0
        sim = libmpm.Simulation(
            scene, device=devices if len(devices) > 1 else devices[0], threads=given.threads
        )
        failed, begun, last = "", time.monotonic(), flume.until
        particles = sum(len(sim.particles[b.name]) for b in scene.bodies)
        try:
            while sim.time < last and time.monotonic() - begun < given.budget:
                sim.run(until=min(sim.time + last / 50, last), progress=False)
        except libmpm.Error as error:
            failed = str(error)
    wall = time.monotonic() - begun
    try:
        found = flume.compare(sim)
        rows, text = found.to_dict(), str(found)
    except libmpm.SceneError as error:
        found, rows, text = None, {}, str(error)
    line = {
        "facility": given.name, "level": given.level, "cell": flume.cell_size,
        "width": flume.width, "changes": changes, "with": ingredients, "device": given.device,
        "hardware": platform.processor() or platform.machine(), "threads": given.threads,
        "particles": particles, "steps": sim.steps, "reached": sim.time, "until": last,
        "failed": failed, "seconds": round(wall, 1), "rows": rows,
        "levels_at_end": levels_at_end(sim),
        **({"near": True, "seconds_before": trunk} if given.near else {}),
        "commit": bench.commit(), "version": libmpm.__version__,
    }  # fmt: skip
    append(given.output, line)
    if given.figures is not None and found is not None:
        given.figures.mkdir(parents=True, exist_ok=True)
        parts = [f"{v}" for v in (changes | ingredients).values()]
        stem = "-".join([given.name, given.level, *parts]).replace(":", "-")
        found.figure().savefig(given.figures / f"{stem}.png", dpi=110)
        flume.preview().savefig(given.figures / f"{stem}-preview.png", dpi=90)
        (given.figures / f"{stem}.txt").write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
