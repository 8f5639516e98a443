"""`Criterion`: a number of a run with what was measured and the tolerance; `Signals` of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.arguments import keywords_only
from libmpm._src.flumes.laboratory import Instrument
from libmpm._src.flumes.records import Curve

__all__ = [
    "Criterion", "Signals", "arrival", "crest", "half_crest", "impulse", "mean_level", "mean_load",
    "mean_of", "near", "peak_load", "peak_time", "rms", "rms_of", "within",
]  # fmt: skip

Array = NDArray[np.float64]


class Signals:
    """Readings of a run by the laboratory's names, over the laboratory's time."""

    def __init__(
        self,
        sensors: Mapping[str, Any],
        clock: float,
        instruments: Sequence[Instrument],
        rest: float = 2.0,
        curves: Mapping[str, Curve] | None = None,
        still: float | None = None,
    ) -> None:
        """`sensors` are series by name, `clock` measured time less that of the run, s.

        `rest` s from its start on a run is still: levels are changes from their mean then.
        Where it begins later, as a near field does, they are changes from `still`, m, the level at
        rest, or on land from the bed; None = from the first reading. `curves` are measured curves
        by instrument that are not in the package.
        """
        self._still = still
        self._sensors, self._clock, self._rest = sensors, clock, rest
        self._known = {i.name: i for i in instruments}
        self.curves: Mapping[str, Curve] = {} if curves is None else curves

    @property
    def clock(self) -> float:
        """Measured time less that of the run, s."""
        return self._clock

    def __contains__(self, name: object) -> bool:
        """Tell whether the run has the instrument, with two samples or more."""
        known = isinstance(name, str) and name in self._sensors
        return known and len(self._sensors[str(name)].time) > 1

    def names(self) -> list[str]:
        """Return the names of all instruments with samples."""
        return [name for name in self._sensors if name in self]

    def begin(self, name: str) -> float:
        """Return the laboratory's time of the first sample, s."""
        return float(self._sensors[name].time[0]) + self._clock

    def end(self, name: str) -> float:
        """Return the laboratory's time of the last sample, s."""
        return float(self._sensors[name].time[-1]) + self._clock

    @keywords_only("flumes.Signals.column", 2)
    def column(self, name: str, component: str) -> tuple[Array, Array]:
        """Return times of the laboratory, s, and a column as it is."""
        series = self._sensors[name]
        time = np.asarray(series.time, np.float64)
        return time + self._clock, np.asarray(series[component], np.float64)

    def components(self, name: str) -> list[str]:
        """Return the names of an instrument's columns."""
        return list(self._sensors[name].components)

    def level(self, name: str) -> tuple[Array, Array]:
        """Return times of the laboratory, s, and changes of a level from that at rest, m.

        At rest it is the mean while the run is still; a run that begins later has that of the still
        water, or of the bed where that is higher. Where nothing is in reach of a gauge on land the
        level is that of the bed.
        """
        one = self._known[name]
        time, found = self.column(name, self._sensors[name].components[0])
        found = np.where(np.isfinite(found), found, one.z)
        rest = found[time - self._clock <= self._rest]
        if not len(rest):
            # On land the level at rest is that of the bed.
            still = float(found[0]) if self._still is None else max(self._still, one.z)
            return time, found - still
        return time, found - float(np.mean(rest))

    def depth(self, name: str) -> tuple[Array, Array]:
        """Return the depth over the bed at a gauge, `Instrument.z`, m; 0 where it is dry.

        Of a "height" how far up the highest particle is from there.
        """
        one = self._known[name]
        time, found = self.column(name, self._sensors[name].components[0])
        if one.kind == "depth":
            return time, np.nan_to_num(found) * one.scale
        if one.kind == "height":
            return time, np.maximum(np.nan_to_num(found - one.z) * one.scale, 0.0)
        return time, np.where(np.isfinite(found), np.maximum(found - one.z, 0.0), 0.0)

    @keywords_only("flumes.Signals.load", 1)
    def load(self, name: str) -> tuple[Array, Array]:
        """Return the force along the flow on the whole structure, N."""
        time, found = self.column(name, "force_x")
        return time, found * self._known[name].scale


@dataclass(frozen=True)
class Criterion:
    """A row of the comparison.

    `measure` takes the `Signals` of a run that reaches the end of `window`, in the laboratory's
    time, and has the instruments in `needs`. It passes from `low` to `high`. `measured` is None
    where there is no number at hand, `published` what the published simulation got. `gates` says
    whether it decides; rows that are `held_out` are produced and not judged. A row with a `curve`
    needs the measured curve of that instrument, which is not in the package: `compare` takes it.
    """

    id: str
    quantity: str
    unit: str
    needs: tuple[str, ...]
    window: tuple[float, float]
    measure: Callable[[Signals], float]
    measured: float | None = None
    low: float = -math.inf
    high: float = math.inf
    tolerance: str = ""
    published: str = ""
    gates: bool = True
    held_out: bool = False
    curve: str = ""


def within(measured: float, share: float) -> dict[str, Any]:
    """Return the bounds of a value within a share of what was measured."""
    low, high = sorted((measured * (1 - share), measured * (1 + share)))
    return {"measured": measured, "low": low, "high": high, "tolerance": f"± {100 * share:g} %"}


def near(measured: float, by: float, unit: str) -> dict[str, Any]:
    """Return the bounds of a value no farther off than `by`."""
    return {"measured": measured, "low": measured - by, "high": measured + by,
            "tolerance": f"± {by:g} {unit}"}  # fmt: skip


def _cut(time: Array, values: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    keep = (time >= window[0]) & (time <= window[1])
    return time[keep], values[keep]


def rms(name: str, curve: Curve, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures the rms distance of a level from a curve at the measured times.

    Both are changes: the run from its rest, the record from its first reading.
    """

    def measure(signals: Signals) -> float:
        time, level = signals.level(name)
        when, wanted = _cut(curve.time, curve.change(), window)
        known = np.isfinite(wanted)
        off = np.interp(when[known], time, level) - wanted[known]
        return float(np.sqrt(np.mean(off**2)))

    return measure


def rms_of(
    name: str, window: tuple[float, float], load: bool = False
) -> Callable[[Signals], float]:
    """Return what measures the rms distance from a curve that the caller has given.

    Of a level in m, as `rms`; of a `load`, in means of 0.1 s, as a share of the curve's peak.
    """

    def measure(signals: Signals) -> float:
        curve = signals.curves[name]
        if not load:
            return rms(name, curve, window)(signals)
        time, force = signals.load(name)
        when, wanted = _cut(curve.time, smooth(curve.time, curve.value, 0.1), window)
        known = np.isfinite(wanted)
        off = np.interp(when[known], time, smooth(time, force, 0.1)) - wanted[known]
        return float(np.sqrt(np.mean(off**2)) / np.max(np.abs(wanted[known])))

    return measure


def crest(
    name: str, window: tuple[float, float], depth: bool = False
) -> Callable[[Signals], float]:
    """Return what measures the largest change of a level in a window, m, or its largest depth."""

    def measure(signals: Signals) -> float:
        series = signals.depth(name) if depth else signals.level(name)
        _, level = _cut(*series, window)
        return float(level.max()) if len(level) else math.nan

    return measure


def peak_time(name: str, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures when a depth is largest, s."""

    def measure(signals: Signals) -> float:
        time, depth = _cut(*signals.depth(name), window)
        return float(time[int(np.argmax(depth))]) if len(time) else math.nan

    return measure


def arrival(name: str, rise: float, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures when a level has first risen by so many m, s."""

    def measure(signals: Signals) -> float:
        return _first(*_cut(*signals.level(name), window), rise)

    return measure


def half_crest(name: str, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures when half of the crest in a window has come, s."""

    def measure(signals: Signals) -> float:
        time, level = _cut(*signals.level(name), window)
        return _first(time, level, 0.5 * float(level.max())) if len(level) else math.nan

    return measure


def _first(time: Array, values: Array, level: float) -> float:
    """Return when values first reach a level, linear between samples; NaN if never."""
    above = values >= level
    if not above.any():
        return math.nan
    i = int(np.argmax(above))
    if i == 0:
        return float(time[0])
    share = (level - values[i - 1]) / (values[i] - values[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))


def smooth(time: Array, values: Array, length: float) -> Array:
    """Return centred means over a length of time, s."""
    if len(time) < 2 or length <= 0:
        return values
    width = max(1, round(length / float(np.median(np.diff(time)))))
    found: Array = np.convolve(values, np.full(width, 1.0 / width), "same")
    return found


def peak_load(
    name: str, window: tuple[float, float], length: float = 0.1
) -> Callable[[Signals], float]:
    """Return what measures the largest mean over `length` s of a load, N."""

    def measure(signals: Signals) -> float:
        time, force = signals.load(name)
        _, found = _cut(time, smooth(time, force, length), window)
        return float(found.max()) if len(found) else math.nan

    return measure


def impulse(name: str, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures the integral of a load over a window, N s."""

    def measure(signals: Signals) -> float:
        time, force = _cut(*signals.load(name), window)
        return float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(time)))

    return measure


def mean_load(name: str, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures the mean load in a window, N."""

    def measure(signals: Signals) -> float:
        _, force = _cut(*signals.load(name), window)
        return float(np.mean(force)) if len(force) else math.nan

    return measure


def mean_level(name: str, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures the mean depth of water over the bed at a gauge in a window, m."""

    def measure(signals: Signals) -> float:
        _, found = _cut(*signals.depth(name), window)
        return float(np.mean(found)) if len(found) else math.nan

    return measure


def mean_of(name: str, component: str, window: tuple[float, float]) -> Callable[[Signals], float]:
    """Return what measures the mean of a column in a window."""

    def measure(signals: Signals) -> float:
        _, found = _cut(*signals.column(name, component), window)
        return float(np.nanmean(found)) if np.isfinite(found).any() else math.nan

    return measure
