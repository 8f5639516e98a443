"""What a run says at its end: a table of loads and a picture."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.output.frames import list_frames, read_frame, read_series
from libmpm._src.output.sensor_file import Series, read_sensors

__all__ = ["LoadSummary", "draw", "moving_mean", "summarise", "table"]

Array = NDArray[np.float64]

#: Share of the largest force at which the load is said to have arrived.
ARRIVAL = 0.05
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


def moving_mean(time: Array, values: Array, length: float) -> Array:
    """Return the mean of `values` over the last `length` s at each sample, (n,)."""
    if length <= 0 or len(time) < 2:
        return values.copy()
    spacing = float(np.median(np.diff(time)))
    width = max(1, round(length / spacing))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(0, last - width)
    return (sums[last] - sums[first]) / (last - first)


def _durations(time: Array) -> Array:
    """Return the interval that each sample is the mean of, s; the run starts at 0."""
    return np.diff(time, prepend=0.0)


def force_component(series: Series) -> int:
    """Return the column of the force component with the largest impulse."""
    forces = [i for i, c in enumerate(series.components) if c.startswith("force")]
    impulses = [abs(float(_durations(series.time) @ series.values[:, i])) for i in forces]
    return forces[int(np.argmax(impulses))] if forces else 0


def summarise(series: Series, length: float) -> LoadSummary | None:
    """Return the summary of one load cell; None without samples."""
    if len(series) < 2:
        return None
    time = series.time
    column = force_component(series)
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
        impulse=float(_durations(time) @ raw),
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
        rows += [
            (f"{title}: arrival", f"{load.arrival:.3f} s ({ARRIVAL:.0%} of the largest force)"),
            (
                f"{title}: first peak",
                f"{load.first_peak:,.1f} {load.unit} at {load.first_peak_time:.3f} s",
            ),
            (f"{title}: largest peak", f"{load.peak:,.1f} {load.unit} at {load.peak_time:.3f} s"),
            (f"{title}: impulse", f"{load.impulse:,.1f} {load.unit}·s"),
            ("   samples and filter", f"{sampled}; peaks of the {smooth}"
             if load.filter else f"{sampled}; {smooth}"),
        ]  # fmt: skip
    rows.append(("speed", f"{speed:.3g} particle-steps/s, {steps:,} steps in {wall:.1f} s"))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {text}" for name, text in rows)


def _boxes(scene: Mapping[str, Any]) -> list[tuple[Array, Array]]:
    """Return (lower, upper) in the world of every rigid box, m."""
    origin = np.asarray(scene.get("origin") or 0.0, float)
    found = []
    for boundary in scene["boundaries"]:
        shape = boundary["shape"]
        if isinstance(shape, Mapping) and "lower" in shape:
            found.append((np.array(shape["lower"]) + origin, np.array(shape["upper"]) + origin))
    return found


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
    from matplotlib.figure import Figure

    scene = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    sensors = read_sensors(folder / "sensors.h5")
    loads = summaries(sensors, length)
    frames = list_frames(folder / "frames")
    bodies = [b["name"] for b in scene["bodies"] if b["name"] in frames]
    times = read_series(folder / "frames", bodies[0]) if bodies else {}
    picks: list[int] = []
    if times:
        arrival = loads[0].arrival if loads else 0.5 * max(times.values())
        peak = loads[0].peak_time if loads else 0.75 * max(times.values())
        picks = _choose(times, [0.0, 0.5 * arrival, arrival, peak, max(times.values())])
    deep = scene["dimension"] == 3
    figure = Figure(figsize=(13, 4.2 + 2.0 * len(picks)), layout="constrained")
    heights = [2.2, *([1.0] * len(picks))]
    grid = figure.add_gridspec(1 + len(picks), 2, height_ratios=heights)
    _draw_forces(figure.add_subplot(grid[0, 0]), sensors, loads, length)
    _draw_levels(figure.add_subplot(grid[0, 1]), sensors)
    snapshots = _Snapshots(scene, bodies, frames, picks)
    for row, index in enumerate(picks, 1):
        side = figure.add_subplot(grid[row, 0] if deep else grid[row, :])
        image = snapshots.draw(side, index, (0, scene["dimension"] - 1), times[index])
        if deep:
            image = snapshots.draw(figure.add_subplot(grid[row, 1]), index, (0, 1), times[index])
        if image is not None:
            figure.colorbar(image, ax=figure.axes[-2:] if deep else side, label="speed [m/s]",
                            shrink=0.8, pad=0.01)  # fmt: skip
    path = folder / "report.png"
    figure.savefig(path, dpi=110)
    return path


def _draw_forces(
    axes: Any, sensors: Mapping[str, Series], loads: Sequence[LoadSummary], length: float
) -> None:
    for load in loads:
        series = sensors[load.name]
        force = series.values[:, series.components.index(load.component)]
        label = f"{load.name}, {load.component}"
        if length:
            axes.plot(series.time, force, lw=0.5, alpha=0.4, color="tab:blue", label=f"{label}")
            label += f", mean over {1e3 * length:g} ms"
        smooth = moving_mean(series.time, force, length)
        axes.plot(series.time, smooth, lw=1.2, color="tab:red", label=label)
        axes.axvline(load.arrival, color="0.6", lw=0.8, ls=":")
        axes.plot([load.peak_time], [load.peak], "v", color="tab:red")
    unit = loads[0].unit if loads else "N"
    axes.set(xlabel="time [s]", ylabel=f"force [{unit}]", title="Load on the structure")
    if loads:
        axes.legend(fontsize=8)


def _draw_levels(axes: Any, sensors: Mapping[str, Series]) -> None:
    for series in sensors.values():
        if series.attributes.get("kind") == "wave-gauge" and len(series):
            axes.plot(series.time, series.values[:, 0], lw=1.0, label=series.name)
    axes.set(xlabel="time [s]", ylabel="surface [m]", title="Wave gauge")
    if axes.lines:
        axes.legend(fontsize=8)


def _speed(arrays: Mapping[str, NDArray[Any]]) -> NDArray[Any] | None:
    """Return the speeds in a frame, m/s, if it has them or the velocities."""
    if "speed" in arrays:
        return arrays["speed"]
    return np.linalg.norm(arrays["velocity"], axis=1) if "velocity" in arrays else None


def _corners(scene: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of a scene's domain; those of a grid of functions are its own."""
    domain: Any = scene
    if "grid" in scene:
        from libmpm._src.scene import Scene

        grid = Scene.from_dict(scene).grid
        assert grid is not None
        domain = {"lower": grid.lower, "upper": grid.upper}
    return np.asarray(domain["lower"], float), np.asarray(domain["upper"], float)


class _Snapshots:
    """Draws frames: the largest body coloured by speed, the others in plain colours."""

    def __init__(
        self,
        scene: Mapping[str, Any],
        bodies: Sequence[str],
        frames: Mapping[str, Mapping[int, Path]],
        picks: Sequence[int],
    ) -> None:
        self._parts = {
            index: {n: read_frame(frames[n][index])[0] for n in bodies if index in frames[n]}
            for index in picks
        }
        first = self._parts[picks[0]] if picks else {}
        self._largest = max(first, key=lambda n: len(first[n]["position"]), default="")
        speeds = [_speed(p[self._largest]) for p in self._parts.values() if self._largest in p]
        # One scale for all pictures; the fastest drops of spray would fade everything else.
        known = [np.percentile(s, 99.5) for s in speeds if s is not None and len(s)]
        self._fastest = max([float(v) for v in known], default=1.0) or 1.0
        origin = np.asarray(scene.get("origin") or np.zeros(scene["dimension"]), float)
        lower, upper = _corners(scene)
        self._lower, self._upper = lower + origin, upper + origin
        self._boxes = _boxes(scene)
        self._axes = "xyz" if scene["dimension"] == 3 else "xy"

    def draw(self, axes: Any, index: int, plane: tuple[int, int], time: float) -> Any:
        """Draw frame `index` seen along the third axis; return the coloured dots."""
        from matplotlib.patches import Rectangle

        a, b = plane
        image = None
        hidden = 3 - a - b
        for name, arrays in self._parts[index].items():
            position = arrays["position"]
            order = np.argsort(position[:, 2] if hidden == 2 else -position[:, hidden])
            dots = position[order]
            if name == self._largest:
                speed = _speed(arrays)
                style: dict[str, Any] = {"s": 0.4, "lw": 0, "rasterized": True}
                if speed is None:
                    axes.scatter(dots[:, a], dots[:, b], color="tab:blue", **style)
                else:
                    image = axes.scatter(
                        dots[:, a], dots[:, b], c=speed[order], cmap="viridis", vmin=0.0,
                        vmax=self._fastest, **style,
                    )  # fmt: skip
            else:
                axes.scatter(dots[:, a], dots[:, b], s=1.2, lw=0, color="tab:orange", zorder=3,
                             rasterized=True)  # fmt: skip
        for low, high in self._boxes:
            size = (high - low)[[a, b]]
            axes.add_patch(Rectangle((low[a], low[b]), *size, fc="0.35", ec="k", zorder=2,
                                     alpha=0.6))  # fmt: skip
        axes.set_xlim(self._lower[a], self._upper[a])
        axes.set_ylim(self._lower[b], self._upper[b])
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7)
        axes.set_title(f"{time:.2f} s, {self._axes[a]}-{self._axes[b]}", fontsize=8, loc="left")
        return image
