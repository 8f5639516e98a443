"""The report of a run: a table of loads and a picture."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.tables import pair_table
from libmpm._src.output.sensor_file import read_sensors
from libmpm._src.output.series import Series, durations, moving_mean

__all__ = ["LoadSummary", "draw", "summarise", "table"]

Array = NDArray[np.float64]

#: Share of the largest force at which the load is said to have arrived.
ARRIVAL = 0.05
#: Sensors whose series are levels.
_GAUGES = ("wave-gauge", "elevation-gauge")
#: A first peak ends where the force has fallen to this share of it.
FALLEN = 0.5


@dataclass(frozen=True)
class LoadSummary:
    """One load cell: `component` is the force component with the largest impulse.

    Forces in N (N/m in 2D), times in s, impulse in N·s; peaks are of the moving mean over
    `filter` s of samples that are themselves means over `interval` s.
    """

    name: str
    component: str
    unit: str
    interval: float
    filter: float
    arrival: float
    first_peak: float
    first_peak_time: float
    peak: float
    peak_time: float
    impulse: float


def summarise(series: Series, length: float) -> LoadSummary | None:
    """Return the summary of one load cell; None without samples."""
    if len(series) < 2:
        return None
    time = series.time
    column = series.column(series.main_component)
    raw = series.values[:, column]
    force = moving_mean(time, raw, length)
    strongest = int(np.argmax(np.abs(force)))
    sign = 1.0 if force[strongest] >= 0 else -1.0
    towards = sign * force
    arrived = int(np.argmax(towards >= ARRIVAL * towards[strongest]))
    first = arrived
    for i in range(arrived, len(towards)):
        if towards[i] > towards[first]:
            first = i
        elif towards[i] < FALLEN * towards[first]:
            break
    return LoadSummary(
        name=series.name,
        component=series.components[column],
        unit=series.units[column],
        interval=float(series.attributes.get("interval", 0.0)),
        filter=length,
        arrival=float(time[arrived]),
        first_peak=float(force[first]),
        first_peak_time=float(time[first]),
        peak=float(force[strongest]),
        peak_time=float(time[strongest]),
        impulse=float(durations(time) @ raw),
    )


def summaries(sensors: Mapping[str, Series], length: float) -> list[LoadSummary]:
    """Return the summaries of all load cells."""
    cells = [s for s in sensors.values() if s.attributes.get("kind") == "load-cell"]
    return [found for s in cells if (found := summarise(s, length)) is not None]


def table(loads: Sequence[LoadSummary], speed: float, wall: float, steps: int) -> str:
    """Return the closing table of a run as text."""
    rows: list[tuple[str, str]] = []
    for load in loads:
        title = f"{load.name}, {load.component}"
        sampled = "every step" if load.interval == 0 else f"means over {1e3 * load.interval:g} ms"
        smooth = f"moving mean over {1e3 * load.filter:g} ms" if load.filter else "no filter"
        if load.peak == 0.0:
            rows += [(f"{title}: load", f"none, no sample differs from 0 {load.unit}"),
                     ("   samples and filter", f"{sampled}; {smooth}")]  # fmt: skip
            continue
        rows += [
            (f"{title}: arrival", f"{load.arrival:.3f} s ({ARRIVAL:.0%} of the largest force)"),
            (
                f"{title}: first peak",
                f"{load.first_peak:,.1f} {load.unit} at {load.first_peak_time:.3f} s",
            ),
            (f"{title}: largest peak", f"{load.peak:,.1f} {load.unit} at {load.peak_time:.3f} s"),
            (f"{title}: impulse", f"{load.impulse:,.1f} {load.unit.replace('N', 'N·s', 1)}"),
            ("   samples and filter", f"{sampled}; peaks of the {smooth}"
             if load.filter else f"{sampled}; {smooth}"),
        ]  # fmt: skip
    rows.append(("speed", f"{speed:.3g} particle-steps/s, {steps:,} steps in {wall:.1f} s"))
    return pair_table(rows, 1 + max(len(name) for name, _ in rows))


def _choose(times: Mapping[int, float], wanted: Sequence[float]) -> list[int]:
    """Return the frames nearest to the wanted times, each once, in order."""
    chosen: list[int] = []
    for moment in wanted:
        index = min(times, key=lambda k: abs(times[k] - moment))
        if index not in chosen:
            chosen.append(index)
    return sorted(chosen)


def draw(folder: Path, *, length: float = 0.0) -> Path | None:
    """Draw forces, surface levels and snapshots of the run in `folder` into ``report.png``."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    from matplotlib.colors import Normalize

    from libmpm._src.pictures.animate import RunFrames
    from libmpm._src.pictures.figures import Picture, label_of, limits_of, note, planes_of
    from libmpm._src.pictures.panel import Panel, height_of, legend_of, middle_of
    from libmpm._src.pictures.preview import vertical_of

    sensors = read_sensors(folder / "sensors.h5")
    loads = summaries(sensors, length)
    run = RunFrames.of(folder)
    picks: list[int] = []
    if run is not None:
        times = {i: run.time(i) for i in run.indices}
        arrival = loads[0].arrival if loads else 0.5 * max(times.values())
        peak = loads[0].peak_time if loads else 0.75 * max(times.values())
        picks = _choose(times, [0.0, 0.5 * arrival, arrival, peak, max(times.values())])
    heights = [2.8]
    planes: list[str] = []
    if run is not None:
        vertical = vertical_of(run.scene)
        planes = planes_of(run.scene.dimension, None, vertical)
        # Two panels a row: the planes of a moment in space, or two moments in the plane.
        rows = math.ceil(len(picks) * len(planes) / 2)
        heights += [max(height_of(run.scene, p, 6.0) for p in planes)] * rows
    figure = Picture(figsize=(13, sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    shown = [run.time(i) for i in picks] if run is not None else []
    gauges = [s for s in sensors.values() if s.attributes.get("kind") in _GAUGES and len(s)]
    curves = figure.add_subplot(grid[0, 0] if gauges else grid[0, :])
    _draw_forces(curves, sensors, loads, length, shown)
    if gauges:
        _draw_levels(figure.add_subplot(grid[0, 1], sharex=curves), gauges, shown)
    if run is not None and picks:
        moments = {i: run.dots(i, "speed") for i in picks}
        found = [d.colour for dots, _ in moments.values() for d in dots.values()]
        norm = Normalize(0.0, limits_of([c for c in found if c is not None])[1])
        image = None
        snapshots = []
        middle = middle_of(run.scene)
        for number, (index, plane) in enumerate(itertools.product(picks, planes)):
            dots, count = moments[index]
            first = plane == planes[0]
            panel = Panel(
                figure.add_subplot(grid[1 + number // 2, number % 2]), run.scene, plane, vertical,
                bodies=run.bodies, norm=norm, later=run.time(index) > 0, sensors=index == picks[0],
                cut=middle if first and len(planes) > 1 else None,
            )  # fmt: skip
            image = panel.show(dots) or image
            snapshots.append(panel.axes)
            if first:
                drawn = note(sum(map(len, dots.values())), count)
                said = (f"{run.time(index):.2f} s", drawn, panel.place if number == 0 else "")
                title = ", ".join(x for x in said if x)
                panel.axes.set_title(title, fontsize=9, loc="left")
            if number == 0 and (plain := panel.plain(dots)):
                panel.axes.legend(*legend_of(plain), fontsize=7, framealpha=0.8)
        if image is not None:
            figure.colorbar(image, ax=snapshots, label=label_of("speed"), aspect=40, pad=0.01,
                            extend="max")  # fmt: skip
    path = folder / "report.png"
    figure.savefig(path, dpi=110)
    return path


def _draw_forces(
    axes: Any,
    sensors: Mapping[str, Series],
    loads: Sequence[LoadSummary],
    length: float,
    shown: Sequence[float],
) -> None:
    """Draw the force of every load cell, its peak, and the times of the snapshots."""
    for load in loads:
        series = sensors[load.name]
        series.plot(load.component, filter=length, axes=axes)
        colour = axes.lines[-1].get_color()
        if load.peak:
            axes.plot([load.peak_time], [load.peak], "v", color=colour, label="_peak")
    unit = loads[0].unit if loads else "N"
    axes.set(xlabel="time [s]", ylabel=f"force [{unit}]", title="Load on the structure")
    _mark(axes, shown)


def _draw_levels(axes: Any, gauges: Sequence[Series], shown: Sequence[float]) -> None:
    """Draw the level at every gauge, over the same times as the forces."""
    for series in gauges:
        series.plot(axes=axes, label=series.name)
    axes.set(xlabel="time [s]", ylabel="surface [m]", title="Gauges")
    _mark(axes, shown)


def _mark(axes: Any, shown: Sequence[float]) -> None:
    """Mark the times of the snapshots."""
    for time in shown:
        axes.axvline(time, color="0.6", lw=0.8, ls=":")
    if shown:
        axes.set_xlim(0.0, max(shown) or 1.0)
