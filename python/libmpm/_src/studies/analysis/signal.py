"""Signals: a quantity over time, filtered, and reduced to numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, keywords_only, shown
from libmpm._src.errors import SceneError
from libmpm._src.studies.analysis.peaks import Peak, local_maxima
from libmpm._src.studies.analysis.record import Floats, Record, crossing, from_series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from libmpm._src.output.series import Series

__all__ = ["Signal", "responses"]

#: Share of the largest value at which a load is said to have arrived.
_ARRIVAL = 0.05
#: Shares of the largest value that a first peak must reach, and by which it must stand out.
_HEIGHT, _PROMINENCE = 0.2, 0.1
#: Part of an interval by which evenly spaced samples may differ.
_EVEN = 1e-3
#: Part of an interval by which rounding may make a record longer than a whole number of them.
_ROUNDING = 1e-6


class Signal(Record):
    """A quantity over time, usually the force on a structure: ``Signal(time, value)``.

    ============  ====  =========  ========================================================
    parameter     unit  shape      meaning
    ============  ====  =========  ========================================================
    time          s     (n,)       times of the samples, increasing, in any spacing; n ≥ 1
    value         any   (n,)       the samples
    unit          -     text       unit of `value`, "N" by default
    sampling      -     a name     "point": a sample is the value at its time, with straight
                                   lines between them; "mean": it is the mean since the
                                   sample before, as those of load cells are
    start         s     < time[0]  beginning of the first mean; None = as long before the
                                   first sample as the second is after it
    missing       any   a number   stands for samples that are NaN, for instance the
                                   level of the bed under a dry gauge; None refuses them
    name          -     text       for tables and pictures
    filtered_at   Hz    > 0        cut-off of a filter that the samples went through
    filter_order  -     ≥ 1        its order
    ============  ====  =========  ========================================================

    Integrals of means are exact; those of points follow the straight lines. Peaks and arrivals are
    those of positive values: ``-signal`` looks at the other direction. Signals are immutable.
    Raises `SceneError`. Source: Bonus (2023) 7.3 and 10.
    """

    @classmethod
    @keywords_only("analysis.Signal.from_series", 2)
    def from_series(
        cls,
        series: Series,
        component: str | None = None,
        *,
        start: float | None = None,
        missing: float | None = None,
    ) -> Signal:
        """Return one component of a sensor's series, as ``sim.sensors["wall"]`` gives it.

        =========  ====  ===============================================================
        argument   unit  meaning
        =========  ====  ===============================================================
        series     -     the series of a sensor
        component  -     name of a column, "force_x" for instance; "-force_x" takes the
                         opposite of its values. None takes the only column, or the
                         force with the largest impulse, with the sign that makes the
                         impulse positive
        start      s     beginning of the first mean of a load cell, by default 0
        missing    any   as in `Signal`
        =========  ====  ===============================================================

        Raises `SceneError`.
        """
        return cls(**from_series(cls.label, series, component, start), missing=missing)

    def __neg__(self) -> Signal:
        """Return the signal with the other sign."""
        return self._like(self.time, -self.value)

    def _like(self, time: Floats, value: Floats, **changes: Any) -> Signal:
        """Return a signal of other samples that is described like this one."""
        kept = ("unit", "sampling", "name", "filtered_at", "filter_order")
        fields = {key: getattr(self, key) for key in kept}
        if self.sampling == "mean":
            fields["start"] = self.start
        return Signal(time, value, **(fields | changes))

    # Other signals ----------------------------------------------------------------------------

    @keywords_only("analysis.Signal.window", 2)
    def window(self, start: float | None = None, end: float | None = None) -> Signal:
        """Return the part between two times in the record, s; raises `SceneError`."""
        first, last = self._between("window", start, end)
        inside = (self.time > first) & (self.time < last)
        time = np.append(self.time[inside], last)
        if self.sampling == "mean":
            # A mean holds over its whole interval, so also over the part that is left of it.
            return self._like(time, self.value[np.searchsorted(self.time, time)], start=first)
        time = np.unique(np.append(first, time))
        return self._like(time, np.interp(time, self.time, self.value))

    @keywords_only("analysis.Signal.resampled", 1)
    def resampled(self, interval: float | None = None) -> Signal:
        """Return means over equal intervals, of `interval` s or of the median spacing.

        The record is cut into equal intervals, as few as are not longer than that. Each mean is
        the change of the integral over its interval divided by its length: the impulse is kept,
        and what is faster than an interval is averaged, not folded back. Raises `SceneError`.
        """
        label = f"{self.label}.resampled"
        check = Checker(label)
        length = self._length(label)
        if interval is not None:
            interval = check.number(
                "interval", interval, lower=0, upper=length, lower_open=True, unit="s"
            )
        check.finish()
        count = math.ceil(length / (self.interval if interval is None else interval) - _ROUNDING)
        ends = np.linspace(self.start, self.end, count + 1)
        value = np.diff(self._integral(ends)) / np.diff(ends)
        return self._like(ends[1:], value, sampling="mean", start=self.start)

    def _length(self, label: str) -> float:
        """Return the length of the record in s, which is not zero."""
        check = Checker(label)
        if self.end <= self.start:
            check.fail("the record is the value at one time; expected more than one; record longer")
        check.finish()
        return self.end - self.start

    @keywords_only("analysis.Signal.low_pass", 1)
    def low_pass(self, cutoff: float, *, order: int = 4) -> Signal:
        """Return the signal without what is faster than `cutoff`, Hz, as equal means.

        A Butterworth filter of `order` ≥ 1, forwards and backwards: no delay, and the amplitude at
        f is multiplied by 1/(1 + (tan(πfh)/tan(πfₑh))^(2 order)), half at the cut-off fₑ, with
        the spacing h. Inside the record that is ``scipy.signal.sosfiltfilt`` of `resampled`; at
        its ends the record continues as its mirror image, and the impulse is kept exactly. The
        result states `filtered_at` and `filter_order`.

        The cut-off must be less than half the sample rate in the longest interval, and the record
        at least as long as one period of it. Needs scipy. Raises `SceneError`.
        """
        label = f"{self.label}.low_pass"
        check = Checker(label)
        cutoff = check.number("cutoff", cutoff, lower=0, lower_open=True, unit="Hz")
        order = check.integer("order", order, lower=1)
        check.finish()
        length = self._length(label)
        k = int(np.argmax(self._steps))
        fastest = 0.5 / float(self._steps[k])
        if cutoff >= fastest:
            check.fail(
                f"cutoff is {cutoff:g} Hz; expected < {fastest:g} Hz, half the sample rate in the "
                f"longest interval, {self._steps[k]:g} s after {self._ends[k]:g} s; sample more "
                "often or lower the cut-off"
            )
        if length * cutoff < 1:
            check.fail(
                f"the record is {length:g} s long; expected at least one period of the cut-off, "
                f"{1 / cutoff:g} s; record longer or raise the cut-off"
            )
        check.finish()
        fft = need("scipy.fft", label, "studies")
        even = self.resampled()
        h = length / len(even)
        # The transform's cosines are mirrored at both ends, and such a filter only scales them.
        half = 0.5 * np.pi * np.arange(len(even)) / len(even)
        with np.errstate(over="ignore"):  # an infinite power leaves nothing, as it should
            gain = 1 / (1 + (np.tan(half) / math.tan(math.pi * cutoff * h)) ** (2 * order))
        value = fft.idct(fft.dct(even.value) * gain)
        stated: dict[str, Any] = {}
        if self.filtered_at is None or cutoff <= self.filtered_at:
            stated = {"filtered_at": cutoff, "filter_order": order}
        return even._like(even.time, value, **stated)

    @keywords_only("analysis.Signal.moving_mean", 1)
    def moving_mean(self, count: int, *, trim: int = 0) -> Signal:
        """Return means of `count` ≥ 1 samples in a row, the `trim` largest and smallest left out.

        Each stands at the middle of its samples, and there are count - 1 fewer of them. Samples
        must be evenly spaced: take `resampled` first. Yang (2016) has ``moving_mean(11, trim=1)``
        of samples 0.01 s apart for reactions of boundaries (5.2), ``moving_mean(10)`` for loads
        of debris (6.1.3). 0 ≤ trim < count / 2. Raises `SceneError`.
        """
        check = Checker(f"{self.label}.moving_mean")
        count = check.integer("count", count, lower=1)
        trim = check.integer("trim", trim)
        if not check.problems and 2 * trim >= count:
            check.fail(
                f"trim is {trim} of {count} samples; expected less than half of them at each end"
            )
        if not check.problems and count > len(self):
            check.fail(f"count is {count}; expected ≤ {len(self)}, the samples that there are")
        steps = np.diff(self._middle)
        if count > 1 and len(steps) and np.ptp(steps) > _EVEN * float(np.median(steps)):
            check.fail(
                f"samples are {steps.min():g} to {steps.max():g} s apart; expected even spacing; "
                f"take resampled({self.interval:g}).moving_mean(...)"
            )
        check.finish()
        view = np.lib.stride_tricks.sliding_window_view
        kept = np.sort(view(self.value, count), axis=1)[:, trim : count - trim]
        return Signal(
            view(self._middle, count).mean(axis=1), kept.mean(axis=1), unit=self.unit,
            name=self.name,
        )  # fmt: skip

    @keywords_only("analysis.Signal.l2_error", 3)
    def l2_error(
        self, exact: float | Signal, start: float | None = None, end: float | None = None
    ) -> float:
        """Return √(∫ (f - g)² dt / T) between two times, s, by default over the record.

        `exact` g is a number in the signal's unit, or a signal that covers the times; T is their
        distance. Of means g is averaged over the same intervals. Divide by a scale of g for a
        relative error: the reaction of a tank's bed over its weight has g = 1. Raises `SceneError`.
        """
        first, last = self._between("l2_error", start, end)
        own = self.window(first, last)
        if not isinstance(exact, Signal):
            check = Checker(f"{self.label}.l2_error")
            level = check.number("exact", exact, unit=self.unit)
            check.finish()
            away = own._like(own.time, own.value - level)
        elif self.sampling == "mean":
            ends = own._ends
            exact._between("l2_error", first, last)
            away = own._like(own.time, own.value - np.diff(exact._integral(ends)) / np.diff(ends))
        else:
            exact._between("l2_error", first, last)
            if exact.sampling == "mean":
                raise SceneError(
                    f"{self.label}.l2_error: exact has means and the signal has points; expected "
                    "both alike; take resampled() of the signal"
                )
            times = exact.time[(exact.time > first) & (exact.time < last)]
            time = np.union1d(own.time, times)
            value = np.interp(time, own.time, own.value) - np.interp(time, exact.time, exact.value)
            away = own._like(time, value)
        return math.sqrt(float(away._sums(2)[-1]) / (last - first))

    @keywords_only("analysis.Signal.normalised", 1)
    def normalised(self, by: float) -> Signal:
        """Return the signal divided by `by` > 0 in its unit, for instance one debris' load."""
        check = Checker(f"{self.label}.normalised")
        by = check.number("by", by, lower=0, lower_open=True, unit=self.unit)
        check.finish()
        return self._like(self.time, self.value / by, unit="1")

    def cumulative_impulse(self) -> Signal:
        """Return I(t) = ∫ f dt from the beginning, in the unit times s."""
        return self._cumulative(self._sums(1), f"{self.unit}·s")

    @keywords_only("analysis.Signal.cumulative_arias", 1)
    def cumulative_arias(self, reference_mass: float, *, gravity: float = 9.81) -> Signal:
        """Return I_A(t) from the beginning, in m/s; see `arias_intensity`."""
        check = Checker(f"{self.label}.arias_intensity")
        mass = check.number("reference_mass", reference_mass, lower=0, lower_open=True, unit="kg")
        g = check.number("gravity", gravity, lower=0, lower_open=True, unit="m/s²")
        check.finish()
        return self._cumulative(math.pi / (2 * g) * self._sums(2) / mass**2, "m/s")

    def _cumulative(self, value: Floats, unit: str) -> Signal:
        described = {key: getattr(self, key) for key in ("name", "filtered_at", "filter_order")}
        return Signal(self._ends, value, unit=unit, **described)

    # Numbers ----------------------------------------------------------------------------------

    @keywords_only("analysis.Signal.peaks")
    def peaks(self, *, threshold: float = _HEIGHT, prominence: float = _PROMINENCE) -> list[Peak]:
        """Return the local maxima (time in s, value) in the order of time.

        ==========  ======  =================================================================
        argument    range   meaning
        ==========  ======  =================================================================
        threshold   [0, 1]  share of the largest sample that a maximum must reach
        prominence  [0, 1]  share of the largest sample by which the signal must fall between
                            the maximum and the nearest higher value, before it and after it
        ==========  ======  =================================================================

        A maximum is the vertex of the parabola that has the values, or the means, of its sample
        and of the two beside it, so it does not depend on how often samples are taken. At a front,
        where the curvature changes sign beside it, it is the sample itself; equal samples beside
        each other are one maximum at their middle. Empty without positive values. Needs scipy.
        Raises `SceneError`.
        """
        label = f"{self.label}.peaks"
        check = Checker(label)
        threshold = check.number("threshold", threshold, lower=0, upper=1)
        prominence = check.number("prominence", prominence, lower=0, upper=1)
        check.finish()
        largest = float(self.value.max())
        if largest <= 0:
            return []
        height, stand = threshold * largest, prominence * largest
        return local_maxima(label, self._middle, self._width, self.value, height, stand)

    @keywords_only("analysis.Signal.first_peak")
    def first_peak(self, *, threshold: float = _HEIGHT, prominence: float = _PROMINENCE) -> Peak:
        """Return the first of `peaks`, the first impact; (nan, 0) without positive values."""
        found = self.peaks(threshold=threshold, prominence=prominence)
        return found[0] if found else Peak(math.nan, 0.0)

    def largest_peak(self) -> Peak:
        """Return the largest of all local maxima; (nan, 0) without positive values."""
        found = self.peaks(threshold=0.0, prominence=0.0)
        return max(found, key=lambda peak: peak.value) if found else Peak(math.nan, 0.0)

    @keywords_only("analysis.Signal.arrival")
    def arrival(self, *, share: float = _ARRIVAL, level: float | None = None) -> float:
        """Return when the signal first reaches `level`, by default `share` of its largest peak.

        In s, between samples on a straight line; NaN if it never does, or without
        positive values. `share` is in (0, 1], `level` > 0 in the signal's unit. Raises
        `SceneError`.
        """
        check = Checker(f"{self.label}.arrival")
        share = check.number("share", share, lower=0, upper=1, lower_open=True)
        if level is not None:
            level = check.number("level", level, lower=0, lower_open=True, unit=self.unit)
        check.finish()
        if level is None:
            # A vertex lies above all samples; the whole of it is reached at the highest one.
            level = min(share * self.largest_peak().value, float(self.value.max()))
        reached = self.value >= level
        if not level > 0 or not reached.any():
            return math.nan
        k = int(np.argmax(reached))
        return float(self._middle[0]) if k == 0 else crossing(self._middle, self.value, k, level)

    @keywords_only("analysis.Signal.impulse", 2)
    def impulse(self, start: float | None = None, end: float | None = None) -> float:
        """Return ∫ f dt between two times, s, by default over the record; unit times s."""
        ends = np.array(self._between("impulse", start, end))
        return float(np.diff(self._integral(ends))[0])

    @keywords_only("analysis.Signal.plateau", 2)
    def plateau(self, start: float, end: float) -> float:
        """Return the mean between two times in the record, s: a sustained load."""
        first, last = self._between("plateau", start, end)
        return self.impulse(first, last) / (last - first)

    @keywords_only("analysis.Signal.arias_intensity", 1)
    def arias_intensity(self, reference_mass: float, *, gravity: float = 9.81) -> float:
        """Return I_A = π/(2g) ∫ a² dt in m/s with a = f / m.

        `reference_mass` m > 0 in kg (kg/m for a load in N/m), `gravity` g > 0 in m/s². A rigid
        wall has no acceleration, so m stands for the structure that it belongs to. Of means the
        squares are taken: what is faster than their interval does not count. Raises `SceneError`.
        """
        return float(self.cumulative_arias(reference_mass, gravity=gravity).value[-1])

    @keywords_only("analysis.Signal.significant_interval")
    def significant_interval(self, *, low: float = 0.10, high: float = 0.90) -> tuple[float, float]:
        """Return the times, s, at which ∫ f² dt reaches two shares of its last value.

        0 < low < high < 1; NaN where f is zero throughout. Raises `SceneError`.
        """
        check = Checker(f"{self.label}.significant_duration")
        ends: dict[str, Any] = {"lower": 0, "upper": 1, "lower_open": True, "upper_open": True}
        low, high = check.number("low", low, **ends), check.number("high", high, **ends)
        if low >= high:
            check.fail(f"low is {low:g} and high {high:g}; expected low < high")
        check.finish()
        sums = self._sums(2)
        if not sums[-1] > 0:
            return math.nan, math.nan
        part = sums / sums[-1]
        first, last = (
            crossing(self._ends, part, int(np.searchsorted(part, s)), s) for s in (low, high)
        )
        return first, last

    @keywords_only("analysis.Signal.significant_duration")
    def significant_duration(self, *, low: float = 0.10, high: float = 0.90) -> float:
        """Return the time, s, in which ∫ f² dt grows from `low` to `high` of its last value.

        With a = f / m that is the duration of the Arias intensity, whatever m. See
        `significant_interval`.
        """
        first, last = self.significant_interval(low=low, high=high)
        return last - first

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the signal into matplotlib axes and return them; `style` goes to the line."""
        from libmpm._src.studies.analysis.plots import axes

        ax = axes(ax, "time (s)", self.unit)
        look = ({"label": self.name} if self.name else {}) | style
        if self.sampling == "mean":
            ax.stairs(self.value, self._ends, baseline=None, **look)
        else:
            ax.plot(self.time, self.value, **look)
        return ax


@keywords_only("analysis.responses", 1, method=False)
def responses(
    source: Signal | Series,
    *,
    component: str | None = None,
    cutoff: float | None = None,
    order: int = 4,
    threshold: float = _HEIGHT,
    prominence: float = _PROMINENCE,
    reference_mass: float | None = None,
    prefix: str = "",
) -> dict[str, float]:
    """Return the numbers that studies and regressions take, from a load over time.

    ==============  ====  ==============================================================
    argument        unit  meaning
    ==============  ====  ==============================================================
    source          -     a `Signal`, or the series of a sensor
    component       -     of a series, as in `Signal.from_series`
    cutoff          Hz    of `Signal.low_pass`, with `order`; None = no filter
    threshold       -     of `Signal.first_peak`, like `prominence`
    reference_mass  kg    of `Signal.arias_intensity`; None leaves "arias" out
    prefix          -     goes before every name
    ==============  ====  ==============================================================

    ==========  =====  ==================================================================
    name        unit   meaning
    ==========  =====  ==================================================================
    f_max       f      largest peak, 0 without positive values
    t_max       s      its time
    f_first     f      first peak
    t_first     s      its time
    impulse     f·s    over the record
    duration    s      of 10 to 90 % of ∫ f² dt
    arrival     s      first time at 5 % of the largest peak
    arias       m/s    Arias intensity
    cutoff      Hz     lowest cut-off that the signal went through
    interval    s      median time between the samples that were given
    ==========  =====  ==================================================================

    Times that do not exist, and the cut-off without a filter, are NaN. Impulse and
    duration are those of the filtered signal too. Raises `SceneError`.
    """
    label = "analysis.responses"
    if not isinstance(source, Signal):
        signal = Signal.from_series(source, component)
    else:
        check = Checker(label)
        if component is not None:
            check.fail(f"component is {shown(component)} of a Signal, which has one; leave it out")
        check.finish()
        signal = source
    interval = signal.interval
    if cutoff is not None:
        signal = signal.low_pass(cutoff, order=order)
    largest = signal.largest_peak()
    first = signal.first_peak(threshold=threshold, prominence=prominence)
    found = {
        "f_max": largest.value,
        "t_max": largest.time,
        "f_first": first.value,
        "t_first": first.time,
        "impulse": signal.impulse(),
        "duration": signal.significant_duration(),
        "arrival": signal.arrival(),
        "cutoff": math.nan if signal.filtered_at is None else signal.filtered_at,
        "interval": interval,
    }
    if reference_mass is not None:
        found["arias"] = signal.arias_intensity(reference_mass)
    return {prefix + name: value for name, value in found.items()}
