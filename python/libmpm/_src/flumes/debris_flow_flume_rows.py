"""Rows U1 to U8 of the USGS debris-flow flume: what a run is held to, and by how much."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.flumes import criteria as measures
from libmpm._src.flumes import records
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris_flow_flume_shape import END, SLOPE, along_bed
from libmpm._src.flumes.facility import GRAVITY

if TYPE_CHECKING:
    from libmpm._src.flumes.debris_flow_flume import DebrisFlowFlume

__all__ = ["criteria"]

#: Run-up above which the mixture has come to the wall, m.
_ARRIVED = 0.05
#: Middle of the sliding block of row U1 at the start, m.
_BLOCK_AT = -2.5
#: Share of the mass that may be lost.
_LOST = 1e-6

_HELD: dict[str, Any] = {"gates": False, "held_out": True}


def criteria(flume: DebrisFlowFlume) -> tuple[Criterion, ...]:
    """Return row U1 of the block, or U2 to U8 of the mixture with its mass balance."""
    if flume.release == "block":
        return (Criterion(
            "U1", "v² over 2 g s (sin 31° - μ cos 31°)", "1", ("block",), (0.0, 3.0),
            _slides(flume.frictions()[0]), **measures.within(1.0, 0.03),
        ),)  # fmt: skip
    last = END if flume.end is None else flume.end
    found = [*_release(flume), *_stations(flume, last)]
    if flume.obstacle is not None:
        return (*found, *_run_up(flume.obstacle))
    if flume.end is None:
        found += [_deposit(flume), Criterion(
            "U2", "mass at the end over that at the start", "1", ("mass",), (0.0, 20.0), _kept,
            1.0, 1.0 - _LOST, 1.0 + _LOST, f"± {_LOST:g}",
        )]  # fmt: skip
    return tuple(found)


def _release(flume: DebrisFlowFlume) -> list[Criterion]:
    """Return row U2 of the tests on the rough bed."""
    if flume.bed != "rough":
        return []
    gates, window, name = flume.mixture == "equivalent", (0.0, 4.0), "depth 2 m"
    return [
        Criterion("U2", "largest depth, 2 m", "m", (name,), window,
                  measures.crest(name, window, True), published="0.48 m (D-Claw)", gates=gates,
                  **measures.within(0.60, 0.30)),
        Criterion("U2", "time of the largest depth, 2 m", "s", (name,), window,
                  measures.peak_time(name, window), published="1.6 s (D-Claw)", gates=gates,
                  **measures.near(1.65, 0.3, "s")),
    ]  # fmt: skip


def _stations(flume: DebrisFlowFlume, last: float) -> list[Criterion]:
    """Return rows U3 and U4 of the rough bed, U5 of the smooth one."""
    rough, found = flume.bed == "rough", []
    for s, until, front, by, rival, depth, other in (
        (32, 10.0, 3.95, 0.6, "3.75 s (D-Claw)", 0.17, "0.19 m (D-Claw)"),
        (66, 15.0, 7.0, 1.0, "6.2 s (D-Claw)", 0.15, "0.12 m (D-Claw)"),
    ):  # fmt: skip
        if s > last - 0.5:
            continue
        name, window = f"depth {s} m", (0.0, until)
        arrives: dict[str, Any] = {"gates": False, "published": rival,
                                   **measures.near(front, by, "s")}  # fmt: skip
        largest: dict[str, Any] = {"gates": False, "published": other,
                                   **measures.within(depth, 0.40)}  # fmt: skip
        if not rough:
            arrives = {"tolerance": "± 1 s", **_HELD}
            largest = {"tolerance": "± 50 %", **_HELD}
        bed = "" if rough else ", smooth bed"
        found += [
            Criterion("U3" if rough else "U5", f"front, {s} m{bed}", "s", (name,), window,
                      _front(name, window), **arrives),
            Criterion("U4" if rough else "U5", f"largest depth, means of 0.2 s, {s} m{bed}", "m",
                      (name,), window, _largest(name, window), **largest),
        ]  # fmt: skip
    return found


def _run_up(test: str) -> list[Criterion]:
    """Return row U6 of the test of 1994-06-21, U7 of that of 1994-06-23."""
    window = (0.0, 16.0)
    first: dict[str, Any] = {"tolerance": "± 1 s", **_HELD}
    largest: dict[str, Any] = {"tolerance": "± 40 %", **_HELD}
    row = "U7"
    if test == "1994-06-21":
        height = np.nanmax(records.load("usgs-run-up").curve("run-up").value)
        first = {"gates": False, **measures.near(8.0, 1.0, "s")}
        largest = {"gates": False, "published": "up to 70 % too small (D-Claw)",
                   **measures.within(round(float(height), 2), 0.40)}  # fmt: skip
        row = "U6"
    return [
        Criterion(row, f"start of the run-up, {test}", "s", ("run-up",), window,
                  _arrives("run-up", window), **first),
        Criterion(row, f"largest run-up, {test}", "m", ("run-up",), window,
                  measures.crest("run-up", window, True), **largest),
    ]  # fmt: skip


def _deposit(flume: DebrisFlowFlume) -> Criterion:
    """Return row U8."""
    kind = "SGM" if flume.bed == "rough" else "SG"
    deposits = records.load("usgs-deposits")
    places = [float(x) for x, k in zip(deposits["front_x_m"], deposits["set"], strict=True)
              if k == kind]  # fmt: skip
    return Criterion(
        "U8", f"farthest of the deposit along the bed, {kind}", "m", ("mixture",), (0.0, 20.0),
        _farthest, gates=False, published="112 m (D-Claw)" if kind == "SGM" else "",
        **measures.near(round(float(np.mean(places)), 1), 6.0, "m"),
    )  # fmt: skip


def _slides(friction: float) -> Callable[[measures.Signals], float]:
    """Return what measures v² of the block over that of the law, a mean over its third second."""

    def measure(signals: measures.Signals) -> float:
        time, x = signals.column("block", "centroid_x")
        _, speed = signals.column("block", "velocity_x")
        law = GRAVITY * (math.sin(SLOPE) - friction * math.cos(SLOPE))
        keep = (time >= 2.0) & (time <= 3.0)
        if law <= 0:
            # It does not slide; the law's speed is 0.
            return 1.0 if float(np.abs(speed[keep]).max()) < 1e-2 else math.nan
        return float(np.mean(speed[keep] ** 2 / (2 * law * (x[keep] - _BLOCK_AT))))

    return measure


def _front(name: str, window: tuple[float, float]) -> Callable[[measures.Signals], float]:
    """Return what measures when half of the largest depth has come, s."""

    def measure(signals: measures.Signals) -> float:
        time, depth = signals.depth(name)
        keep = (time >= window[0]) & (time <= window[1])
        mean = measures.smooth(time, depth, 0.2)
        above = mean[keep] >= 0.5 * float(mean[keep].max())
        reached = float(mean[keep].max()) > 0
        return float(time[keep][int(np.argmax(above))]) if reached else math.nan

    return measure


def _largest(name: str, window: tuple[float, float]) -> Callable[[measures.Signals], float]:
    """Return what measures the largest mean of a depth over 0.2 s, m."""

    def measure(signals: measures.Signals) -> float:
        time, depth = signals.depth(name)
        keep = (time >= window[0]) & (time <= window[1])
        return float(measures.smooth(time, depth, 0.2)[keep].max())

    return measure


def _arrives(name: str, window: tuple[float, float]) -> Callable[[measures.Signals], float]:
    """Return what measures when a height has first risen by 5 cm, s."""

    def measure(signals: measures.Signals) -> float:
        time, height = signals.depth(name)
        above = (height >= _ARRIVED) & (time >= window[0]) & (time <= window[1])
        return float(time[int(np.argmax(above))]) if above.any() else math.nan

    return measure


def _farthest(signals: measures.Signals) -> float:
    """Return the way along the bed of the farthest particle at the end of the run, m."""
    return along_bed(float(signals.column("mixture", "upper_x")[1][-1]))


def _kept(signals: measures.Signals) -> float:
    """Return the mass at the end over that at the start."""
    mass = signals.column("mass", signals.components("mass")[0])[1]
    return float(mass[-1] / mass[0])
