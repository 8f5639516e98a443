"""Flows with a closed form between held and linear walls, by transfer, in finer and finer cells.

    python benchmarks/wall_flows.py [--cases dam tube wave run-up disc]    40 minutes on one thread
    python benchmarks/wall_flows.py --write              and the table of docs/boundaries.md

dam     a square of water breaks in a tank of twice its width: height of its middle after 10 s, of
        that of the same volume at rest, and pressure of the lowest cells over the weight above them
shifted, led  the same with FBar(shifting=True), FBar(density=True)
tube    water swings in a U-tube of square corners: period over 2π √(L / 2g), where a corner counts
        0.559 of its width (conformal mapping), and level after three periods, parts of its first
wave    a solitary wave of H/h 0.2 from Goring's piston: speed over √(g (h + H)), H as measured on
        the way, and height after 20 h of way, of what it was
run-up  the same up a slope of 1:2: height over 2.831 √(cot β) (H/h)^(5/4) h (Synolakis 1987)
disc    a disc of half the water's density let go under water: acceleration over g/3, that of
        potential flow (added mass as its own volume of water); `contact.py rise` has it with a
        contact, `docs/contact.md` shows it

All in the plane, single precision. One JSON line a run goes to benchmarks/results/wall_flows.jsonl;
what the file has is not run again.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from result_pages import Line, append, filled, load, markdown
from wall_loads import CELLS, GRAVITY, PAGE, WATER, run, scene_of, water
from wall_loads import TRANSFERS as BESIDE_WALLS

import libmpm
from libmpm import boundaries, contacts, materials, methods, sensors, shapes
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/wall_flows.jsonl"
MARKS = "<!-- table: benchmarks/wall_flows.py --write -->", "<!-- end of wall flows -->"

TRANSFERS = {name: BESIDE_WALLS[name] for name in ("APIC", "AFLIP 0.95")}
Values = dict[str, float]
Array = npt.NDArray[np.float64]


def stiff(depth: float) -> materials.TaitFluid:
    """Return water in which sound is 14 times as fast as long waves of a depth."""
    return water(200 * WATER * GRAVITY * depth)


def dam(cell: str, transfer: str, across: int, *, option: str | None = None) -> Values:
    """Return twice the height of the middle of 1 m x 1 m, over 0.5 m, and the load of the bed."""
    dx = 0.5 / across
    scene = scene_of((2.0, 2.0), dx, TRANSFERS[transfer])
    square = shapes.Box(lower=(0.0, 0.0), upper=(1.0, 1.0))
    scene.add_body(
        name="water", shape=square, material=stiff(1.0), hydrostatic=1.0,
        fbar=methods.FBar(shifting=option == "shifting", density=option == "density"),
    )  # fmt: skip
    response = boundaries.Slip(cell=cell)  # type: ignore[arg-type]
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    sim = run(scene)
    sim.run(until=9.0, progress=False)
    middle, bed = [], []
    for time in np.linspace(9.0, 10.0, 21):
        sim.run(until=float(time), progress=False)
        height = sim.particles["water"]["position"][:, 1]
        middle.append(height.mean())
        bed.append(sim.particles["water"]["pressure"][height < dx].mean())
    weight = WATER * GRAVITY * (0.5 - 0.5 * dx)  # half of the lowest cell lies below its middle
    return {"level": float(2 * np.mean(middle) / 0.5), "bed": float(np.mean(bed) / weight)}


def shifted(cell: str, transfer: str, across: int) -> Values:
    """Return the same of water whose particles are shifted."""
    return dam(cell, transfer, across, option="shifting")


def led(cell: str, transfer: str, across: int) -> Values:
    """Return the same of water whose volumes are led by its density."""
    return dam(cell, transfer, across, option="density")


def tube(cell: str, transfer: str, across: int) -> Values:
    """Return period and level of water that swings in legs 0.32 m wide."""
    wide = 0.32
    dx = wide / across
    high = 4 * wide  # of the water, three of them above the bottom's channel
    length = 2 * (high - wide) + wide + 2 * 0.5587 * wide
    rate = np.sqrt(2 * GRAVITY / length)
    speed = 0.2 * wide * rate
    scene = scene_of((3 * wide, high + wide), dx, TRANSFERS[transfer])
    legs = {
        "left": ((0.0, wide), (wide, high), (0.0, -speed)),
        "bottom": ((0.0, 0.0), (3 * wide, wide), (speed, 0.0)),
        "right": ((2 * wide, wide), (3 * wide, high), (0.0, speed)),
    }
    for name, (lower, upper, velocity) in legs.items():
        scene.add_body(
            name=name, shape=shapes.Box(lower=lower, upper=upper), material=stiff(high),
            velocity=velocity, hydrostatic=high,
        )  # fmt: skip
    response = boundaries.Slip(cell=cell)  # type: ignore[arg-type]
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    between = shapes.Box(lower=(wide, wide), upper=(2 * wide, high + wide))
    scene.add_boundary(name="between", shape=between, response=response)
    period = 2 * np.pi / rate
    for name, x in (("left", 0.5), ("right", 2.5)):
        gauge = sensors.WaveGauge(position=(x * wide,), interval=period / 200)
        scene.add_sensor(name=name, sensor=gauge)
    sim = run(scene)
    sim.run(until=3.3 * period, progress=False)
    left, right = (np.asarray(sim.sensors[name].values).ravel() for name in ("left", "right"))
    time = np.asarray(sim.sensors["left"].time)
    swing = right - left
    # It passes through the middle upwards at 0, 1, 2, 3 periods; the first is the start itself.
    at = [
        time[i] - swing[i] * (time[i + 1] - time[i]) / (swing[i + 1] - swing[i])
        for i in np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
        if time[i] > 0.5 * period
    ]
    first, last = (
        0.5 * (left + right)[(time > a * period) & (time < (a + 1) * period)].mean() for a in (0, 2)
    )
    found = (at[-1] - at[0]) / (len(at) - 1) / period if len(at) > 1 else float("nan")
    return {"period": float(found), "level": float(last / first)}


def goring(height: float, until: float) -> libmpm.TimeTable:
    """Return the way of a piston that sends a solitary wave into water 1 m deep (Goring 1978)."""
    rate, speed = np.sqrt(0.75 * height), np.sqrt(GRAVITY * (1 + height))
    half = (3.8 + height) / (rate * speed)
    time = np.linspace(0.0, until, 2000)
    way = np.zeros_like(time)
    for _ in range(60):
        way = height / rate * np.tanh(rate * (speed * (time - half) - way))
    way -= way[0]
    return libmpm.TimeTable(time=tuple(time), value=tuple((x, 0.0) for x in way), end="hold")


def channel(
    cell: str, transfer: str, across: int, length: float, until: float, bed: shapes.Solid | None
) -> libmpm.Scene:
    """Return water 1 m deep before a piston that sends a wave of H/h 0.2."""
    dx = 1.0 / across
    start = 8 * dx
    scene = scene_of((start + length, 2.2), dx, TRANSFERS[transfer])
    room = shapes.Box(lower=(start, 0.0), upper=(start + length, 1.0))
    shape = room if bed is None else shapes.basin(level=1.0, bed=bed, within=room)
    sampling = {} if bed is None else {"sampling": shapes.Columns()}
    scene.add_body(name="water", shape=shape, material=stiff(1.0), hydrostatic=1.0, **sampling)
    response = boundaries.Slip(cell=cell)  # type: ignore[arg-type]
    walls = shapes.DomainWalls(faces=("x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=response)
    scene.add_boundary(
        name="piston", shape=shapes.Box(lower=(-3.0, -1.0), upper=(start, 3.0)),
        response=response, motion=boundaries.Displacement(goring(0.2, until)),
    )  # fmt: skip
    if bed is not None:
        held = boundaries.Slip(cell="held")
        scene.add_boundary(name="bed", shape=bed, response=held)
    return scene


def crest(time: Array, level: Array) -> tuple[float, float]:
    """Return when and how high a record is highest, by the parabola through three samples."""
    i = int(np.argmax(level[1:-1])) + 1
    a, b, c = level[i - 1 : i + 2]
    off = 0.5 * (a - c) / (a - 2 * b + c)
    return time[i] + off * (time[i + 1] - time[i]), b - 0.25 * (a - c) * off


def wave(cell: str, transfer: str, across: int) -> Values:
    """Return speed and what is left of the height of a solitary wave after 20 depths."""
    until, places = 12.0, (6.0, 26.0)
    scene = channel(cell, transfer, across, 32.0, until, None)
    dx = scene.cell_size
    for i, x in enumerate(places):
        # Surfaces are found in cells: the mean of eight columns has less of their grain.
        for k in range(8):
            gauge = sensors.WaveGauge(position=(8 * dx + x + (k - 3.5) * dx,), interval=0.02)
            scene.add_sensor(name=f"{i}.{k}", sensor=gauge)
    sim = run(scene)
    sim.run(until=until, progress=False)
    crests = []
    for i, _ in enumerate(places):
        time = np.asarray(sim.sensors[f"{i}.0"].time)
        each = [np.asarray(sim.sensors[f"{i}.{k}"].values).ravel() for k in range(8)]
        level = np.mean(each, axis=0)
        # A mean over 0.1 s: the wave takes 2 s to pass.
        level = np.convolve(level, np.full(5, 0.2), "same")[2:-2]
        still = np.mean(level[:20])
        at, top = crest(time[2:-2], level)
        crests.append((at, top - still))
    (first, high), (last, low) = crests
    speed = (places[1] - places[0]) / (last - first)
    theory = np.sqrt(GRAVITY * (1 + 0.5 * (high + low)))
    return {"speed": speed / theory, "left": low / high, "height": high}


def run_up(cell: str, transfer: str, across: int) -> Values:
    """Return how high the wave runs up a slope of 1:2, of Synolakis' law for its own height."""
    until, toe = 9.0, 12.0
    start = 8.0 / across
    x = start + toe
    bed = shapes.HalfSpace(point=(x, 0.0), normal=tuple(np.array([-1.0, 2.0]) / np.sqrt(5.0)))
    scene = channel(cell, transfer, across, toe + 4.0, until, bed)
    for k in range(8):
        at = start + 7.0 + (k - 3.5) * scene.cell_size
        scene.add_sensor(name=f"{k}", sensor=sensors.WaveGauge(position=(at,), interval=0.02))
    sim, top = run(scene), 0.0
    for time in np.arange(4.0, until, 0.05):
        sim.run(until=float(time), progress=False)
        # The fifth highest: single drops are no run-up.
        top = max(top, float(np.sort(sim.particles["water"]["position"][:, 1])[-5]))
    level = np.mean([np.asarray(sim.sensors[f"{k}"].values).ravel() for k in range(8)], axis=0)
    passing = np.asarray(sim.sensors["0"].time) < 5.6  # before what the slope sends back
    level = np.convolve(level, np.full(5, 0.2), "same")
    height = float(level[passing][2:-2].max() - level[2:20].mean())
    return {"run-up": (top - 1.0) / (2.831 * np.sqrt(2.0) * height**1.25), "height": height}


def disc(
    cell: str, transfer: str, across: int, *,
    touching: bool = False, rigid: bool = False, stiffer: float = 1.0,
) -> Values:  # fmt: skip
    """Return how a disc 0.16 m wide starts to rise, over g/3, in a tank of 8 by 6 of its width.

    `stiffer` is the factor of the water's bulk modulus. `touching` gives the disc a field of
    its own: those rows are of `contact.py`. `early` is by the first 0.04 s, in which a disc that
    rises by g/3 moves by 0.016 of its width, `acceleration` by the first 0.1 s (0.10 of it).
    """
    dx = 0.16 / across
    scene = scene_of((1.28, 1.12), dx, transfer)
    ball = shapes.Sphere(centre=(0.64, 0.48), radius=0.08)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(1.28, 0.96)),
        material=stiff(stiffer), hydrostatic=0.96,
    )  # fmt: skip
    law = (
        materials.Rigid(density=500.0)
        if rigid
        else materials.FixedCorotated(density=500.0, youngs_modulus=2e6, poissons_ratio=0.3)
    )
    scene.add_body(name="disc", shape=ball, material=law, subtract_from=("water",))
    response = boundaries.Slip(cell=cell)  # type: ignore[arg-type]
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    if touching:
        scene.add_contact(name="wet", between=("disc", "water"), law=contacts.Fluid())
    sim = run(scene)
    times, rise = np.linspace(0.0, 0.1, 26), []
    for time in times:
        sim.run(until=float(time), progress=False)
        rise.append(sim.particles["disc"]["position"][:, 1].mean())
    half, way = 0.5 * times**2, np.array(rise, dtype=float) - rise[0]
    found = {}
    for key, until in (("acceleration", 0.1), ("early", 0.04)):
        seen = times < until + 1e-9
        share = half[seen] @ way[seen] / (half[seen] @ half[seen])
        found[key] = float(share / GRAVITY * 3)
    return found


#: What is varied beside wall and transfer, by case.
CASES: Mapping[str, tuple[Callable[..., Values], list[int]]] = {
    "dam": (dam, [8, 16, 32]),
    "shifted": (shifted, [8, 16, 32]),
    "led": (led, [8, 16, 32]),
    "tube": (tube, [8, 16]),
    "wave": (wave, [10, 20]),
    "run-up": (run_up, [10, 20]),
    "disc": (disc, [8, 16, 32]),
}
#: What is shown of a case, and in what its cells are counted.
SHOWN = {
    "dam": (("level", "level of a dam at rest"), "depth at rest"),
    "shifted": (("level", "the same, shifting"), "depth at rest"),
    "shifted ": (("bed", "pressure of its lowest cells, shifting"), "depth at rest"),
    "led": (("level", "the same, density"), "depth at rest"),
    "led ": (("bed", "pressure of its lowest cells, density"), "depth at rest"),
    "tube": (("period", "period of a U-tube"), "width"),
    "tube ": (("level", "its level after three periods"), "width"),
    "wave": (("speed", "speed of a solitary wave"), "depth"),
    "wave ": (("left", "its height after 20 depths"), "depth"),
    "run-up": (("run-up", "its run-up, 1:2"), "depth"),
    "disc": (("acceleration", "start of a disc of half the density"), "width"),
}


def tables(lines: list[Line]) -> str:
    """Return one table: rows by case, wall and cells, a column for each wall and transfer."""
    newest = {(x["case"], x["cell"], x["transfer"], x["cells"]): x["values"] for x in lines}
    ways = list(itertools.product(TRANSFERS, CELLS))
    rows = [["of the closed form", "cells", *(f"{t}, {c}" for t, c in ways)]]
    for case, ((key, name), unit) in SHOWN.items():
        for cells in CASES[case.strip()][1]:
            found = [newest.get((case.strip(), c, t, cells)) for t, c in ways]
            if any(found):
                shown = ["" if v is None else f"{v[key]:.3f}" for v in found]
                rows.append([name, f"{cells} a {unit}", *shown])
    return "\n".join(markdown(rows))


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--cases", nargs="*", choices=[*CASES], default=[*CASES])
    parser.add_argument("--cells", nargs="*", type=int, help="only these")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--write", action="store_true", help="the table of the page too")
    arguments = parser.parse_args()
    done = {(x["case"], x["cell"], x["transfer"], x["cells"]) for x in load(arguments.output)}
    for case in arguments.cases:
        measure, choices = CASES[case]
        for cells, transfer, cell in itertools.product(choices, TRANSFERS, CELLS):
            if (case, cell, transfer, cells) in done:
                continue
            if arguments.cells and cells not in arguments.cells:
                continue
            values = {k: float(v) for k, v in measure(cell, transfer, cells).items()}
            line = {"case": case, "cell": cell, "transfer": transfer, "cells": cells,
                    "values": values, "commit": bench.commit(),
                    "version": libmpm.__version__}  # fmt: skip
            append(arguments.output, line)
            print(case, cell, transfer, cells, values, flush=True)
    if arguments.write:
        PAGE.write_text(filled(PAGE, *MARKS, tables(load(arguments.output))), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
