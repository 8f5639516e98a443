"""Laboratory flumes at a level, compared with what was measured there: a JSON line a run.

    python benchmarks/flumes.py lwf --level laptop [--device cuda] [--budget SECONDS] [--threads N]
                                [--cell-size M] [--debris LAYOUT] [--set NAME=VALUE ...]
                                [--with INGREDIENT=VALUE ...]
                                [--until S] [--output FILE] [--figures FOLDER]
                                [--near FOLDER [--begin S] [--lower X] [--trunk]]

`--set` changes any argument of the facility, such as structure=null. `--with` changes the scene
that it returns: bed=held|linear|auto and walls=... what these boundaries do, transfer=SCHEME[:FLIP]
of the scene, shifting=true|false or density=true|false of the water. Goes to
benchmarks/results/flumes.jsonl. A run that its budget or `--until`, a time of the laboratory, ends
is compared in what it reached; where a row of a load asks for more, the line has the largest mean
of 0.1 s and the impulse so far. `--figures` keeps all readings there too.
`--near`: the near field, of lwf and dwb, from a strip's run in that folder, which is run first
where it is not there, from `--begin` on, a time of the laboratory, and from x `--lower` on;
`--trunk` runs that alone. `--device cuda:0,cuda:1`: on several; a strip on the first.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from result_pages import append, setting

import libmpm
from libmpm import flumes
from libmpm._src.cli import bench
from libmpm._src.flumes import criteria

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/flumes.jsonl"


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


def loads_so_far(flume: flumes.Facility, sim: libmpm.Simulation) -> dict[str, dict[str, float]]:
    """Return of each load the largest mean of 0.1 s, N, and the impulse, N s.

    Times are the laboratory's, from where the facility's rows of it begin on to the run's end.
    """
    known = flume.instruments()
    signals = criteria.Signals(sim.sensors, flume.clock, known)
    found = {}
    for one in known:
        begins = [c.window[0] for c in flume.criteria() if one.name in c.needs]
        if one.kind != "load" or one.name not in signals or not begins:
            continue
        window = (max(min(begins), signals.begin(one.name)), signals.end(one.name))
        if window[1] > window[0]:
            found[one.name] = {
                "from": round(window[0], 3), "to": round(window[1], 3),
                "peak_N": criteria.peak_load(one.name, window)(signals),
                "impulse_Ns": criteria.impulse(one.name, window)(signals),
            }  # fmt: skip
    return found


def keep_readings(sim: libmpm.Simulation, file: Path) -> None:
    """Write all series of a run: NAME.time, s of the run, and NAME.values, a column each."""
    arrays = {}
    for name in sim.sensors:
        series = sim.sensors[name]
        arrays |= {f"{name}.time": series.time, f"{name}.values": series.values}
    np.savez_compressed(file, **arrays)


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
    parser.add_argument("--until", type=float, help="end of the run, s of the laboratory's clock")
    parser.add_argument("--near", type=Path, metavar="FOLDER", help="run of the strip")
    parser.add_argument("--begin", type=float, help="of a near field, s of the laboratory's clock")
    parser.add_argument("--lower", type=float, help="where it begins, x in m")
    parser.add_argument("--trunk", action="store_true", help="with --near: no more than that run")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--figures", type=Path, help="folder for the figure and the table")
    given = parser.parse_args()
    if given.near is None and (given.trunk, given.begin, given.lower) != (False, None, None):
        parser.error("--begin, --lower and --trunk are of a near field; expected --near FOLDER")
    changes = {"cell_size": given.cell_size, "debris": given.debris}
    changes = {k: v for k, v in changes.items() if v is not None}
    changes |= dict(setting(text) for text in given.sets)
    flume = flumes.named(given.name).at_level(given.level, **changes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        devices = given.device.split(",")
        before = time.monotonic()
        if given.near is None:
            scene = flume.scene()
        else:
            if not isinstance(flume, flumes.FacilityOfStrips):
                parser.error(f"--near with {given.name}, which has no strip; expected lwf or dwb")
            options = {"begin": given.begin, "lower": given.lower}
            options = {k: v for k, v in options.items() if v is not None}
            scene = flume.near_field(given.near, until=given.until, device=devices[0], **options)
        ingredients = dict(setting(text) for text in given.ingredients)
        scene = with_ingredients(scene, ingredients)
        trunk = round(time.monotonic() - before, 1)
        if given.trunk:
            print(f"the strip: {trunk} s")
            return 0
        sim = libmpm.Simulation(
            scene, device=devices if len(devices) > 1 else devices[0], threads=given.threads
        )
        last = flume.until
        if given.until is not None:
            last = min(last, given.until - flume.clock)
        if not sim.time < last:
            parser.error(f"--until is {given.until:g} s; expected a time after the run begins, "
                         f"{sim.time + flume.clock:g} s of the laboratory")  # fmt: skip
        failed, begun = "", time.monotonic()
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
        "levels_at_end": levels_at_end(sim), "loads_so_far": loads_so_far(flume, sim),
        **({"near": options or True, "seconds_before": trunk} if given.near else {}),
        "commit": bench.commit(), "version": libmpm.__version__,
    }  # fmt: skip
    append(given.output, line)
    parts = [f"{v}" for v in (changes | ingredients).values()]
    if given.near is not None:
        parts += ["near", *(f"{v:g}" for v in options.values())]
    stem = "-".join([given.name, given.level, *parts]).replace(":", "-")
    if given.figures is not None:
        given.figures.mkdir(parents=True, exist_ok=True)
        keep_readings(sim, given.figures / f"{stem}.npz")
    if given.figures is not None and found is not None:
        found.figure().savefig(given.figures / f"{stem}.png", dpi=110)
        flume.preview().savefig(given.figures / f"{stem}-preview.png", dpi=90)
        (given.figures / f"{stem}.txt").write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
