"""Records: samples of a quantity over time, and their integrals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, keywords_only, nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.sensors.engine_sensors import MEANS

if TYPE_CHECKING:
    from libmpm._src.output.series import Series

__all__ = ["Floats", "Record", "crossing", "from_series", "numbers"]

Floats = npt.NDArray[np.float64]

#: Part of a record by which an end of a window may lie outside it, for rounding.
_ROUNDING = 1e-9


class Record:
    """Samples over time, what is between them, and integrals of that; see `Signal`."""

    label: ClassVar[str] = "analysis.Signal"

    @keywords_only("analysis.Signal", 2)
    def __init__(
        self,
        time: npt.ArrayLike,
        value: npt.ArrayLike,
        *,
        unit: str = "N",
        sampling: Literal["point", "mean"] = "point",
        start: float | None = None,
        missing: float | None = None,
        name: str = "",
        filtered_at: float | None = None,
        filter_order: int | None = None,
    ) -> None:
        """See `Signal`."""
        check = Checker(
            self.label + (f" {shown(name, 80)}" if isinstance(name, str) and name else "")
        )
        self._time, self._value = numbers(check, "time", time), numbers(check, "value", value)
        self._sampling = check.choice("sampling", sampling, ("point", "mean"))
        check.finish()
        self._check_times(check)
        check.finish()
        if missing is not None:
            missing = check.number("missing", missing)
            self._value[np.isnan(self._value)] = missing
        wrong = ~np.isfinite(self._value)
        if wrong.any() and not check.problems:
            check.fail(
                f"value is not a finite number at samples {marked(wrong)}; expected numbers; give "
                "missing= for samples without a value, such as those of a dry gauge"
            )
        self._start = self._begins(check, start)
        check.finish()
        check.instance("unit", unit, (str,), "a text")
        check.instance("name", name, (str,), "a text")
        check.finish()
        self._unit, self._name = str(unit), str(name)
        self._filter = self._filters(check, filtered_at, filter_order)
        check.finish()
        for array in (self._time, self._value):
            array.flags.writeable = False

    def _check_times(self, check: Checker) -> None:
        time, value = self._time, self._value
        if len(time) != len(value):
            check.fail(f"time has {len(time)} samples and value {len(value)}; expected as many")
        elif not len(time):
            check.fail(_NO_SAMPLES)
        elif not np.isfinite(time).all():
            check.fail(f"time is not finite at samples {marked(~np.isfinite(time))}; expected s")
        elif (np.diff(time) <= 0).any():
            rows = np.append(False, np.diff(time) <= 0)
            check.fail(
                f"time does not increase at samples {marked(rows)}; expected each later than the "
                "one before; sort them and remove doubles"
            )

    def _begins(self, check: Checker, start: float | None) -> float:
        """Return where the record begins, s."""
        first = float(self._time[0])
        if self._sampling == "point":
            if start is not None:
                check.fail('start is for sampling="mean"; leave it out')
            return first
        if start is not None:
            remedy = "it is where the first mean begins"
            return check.number(
                "start", start, upper=first, upper_open=True, unit="s", remedy=remedy
            )
        if len(self._time) < 2:
            check.fail("start is missing for a single mean; expected where it begins, in s")
            return first
        return 2 * first - float(self._time[1])

    @staticmethod
    def _filters(
        check: Checker, cutoff: float | None, order: int | None
    ) -> tuple[float | None, int | None]:
        if cutoff is not None:
            cutoff = check.number("filtered_at", cutoff, lower=0, lower_open=True, unit="Hz")
        if order is not None:
            order = check.integer("filter_order", order, lower=1)
        return cutoff, order

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._time)

    def __repr__(self) -> str:
        """Return a short description."""
        name = f" '{self.name}'" if self.name else ""
        kind = {"mean": "means", "point": "values"}[self.sampling]
        text = f"{len(self)} {kind} in {self.unit} from {self.start:g} to {self.end:g} s"
        if self.filtered_at is not None:
            text += f", below {self.filtered_at:g} Hz"
        return f"<{self.label}{name}: {text}>"

    @property
    def time(self) -> Floats:
        """Times of the samples, (n,) s; read-only."""
        return self._time

    @property
    def value(self) -> Floats:
        """The samples, (n,) in `unit`; read-only."""
        return self._value

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self._unit

    @property
    def sampling(self) -> str:
        """Whether samples are values at their times, "point", or means up to them, "mean"."""
        return self._sampling

    @property
    def name(self) -> str:
        """Name for tables and pictures."""
        return self._name

    @property
    def filtered_at(self) -> float | None:
        """Lowest cut-off of the filters that the signal went through, Hz; None without any."""
        return self._filter[0]

    @property
    def filter_order(self) -> int | None:
        """Order of that filter."""
        return self._filter[1]

    @property
    def start(self) -> float:
        """Where the record begins, s: that of the first mean, or the first time of points."""
        return self._start

    @property
    def end(self) -> float:
        """Where the record ends, s."""
        return float(self._time[-1])

    @property
    def interval(self) -> float:
        """Median of the times between samples, s; NaN for a single point."""
        return float(np.median(self._steps)) if len(self._steps) else math.nan

    @property
    def _ends(self) -> Floats:
        """Ends of the pieces between which the signal is known, s."""
        if self._sampling == "point":
            return self._time
        return np.concatenate([[self._start], self._time])

    @property
    def _steps(self) -> Floats:
        """Lengths of those pieces, s."""
        return np.diff(self._ends)

    @property
    def _width(self) -> Floats:
        """Lengths that the samples are means over, (n,) s."""
        return self._steps if self._sampling == "mean" else np.zeros(len(self))

    @property
    def _middle(self) -> Floats:
        """Times at which the samples belong, (n,) s: a mean to the middle of its interval."""
        return self._time - 0.5 * self._width

    def _sums(self, power: int) -> Floats:
        """Return ∫ f^power dt, power 1 or 2, from the beginning to each of `_ends`."""
        f = self._value
        if self._sampling == "mean":
            pieces = f**power
        elif power == 1:
            pieces = 0.5 * (f[1:] + f[:-1])
        else:
            pieces = (f[1:] ** 2 + f[1:] * f[:-1] + f[:-1] ** 2) / 3
        return np.concatenate([[0.0], np.cumsum(pieces * self._steps)])

    def _integral(self, time: Floats) -> Floats:
        """Return ∫ f dt from the beginning to times inside the record."""
        sums, ends = self._sums(1), self._ends
        if self._sampling == "mean" or len(self) < 2:
            return np.asarray(np.interp(time, ends, sums))
        k = np.clip(np.searchsorted(ends, time, side="right") - 1, 0, len(ends) - 2)
        x, slope = time - ends[k], np.diff(self._value)[k] / self._steps[k]
        return np.asarray(sums[k] + x * (self._value[k] + 0.5 * slope * x))

    def _between(self, what: str, start: float | None, end: float | None) -> tuple[float, float]:
        """Return the ends of a part of the record, s, by default of all of it."""
        if start is None and end is None:
            return self.start, self.end
        check = Checker(f"{self.label}.{what}")
        allowance = _ROUNDING * (self.end - self.start)
        found = []
        for key, given, default in (("start", start, self.start), ("end", end, self.end)):
            where = default if given is None else check.number(key, given, unit="s")
            if where < self.start - allowance or where > self.end + allowance:
                check.fail(
                    f"{key} is {where:g}; expected a time in the record, {self.start:g} to "
                    f"{self.end:g} s"
                )
            found.append(min(max(where, self.start), self.end))
        if not check.problems and found[0] >= found[1]:
            check.fail(f"start is {found[0]:g} and end {found[1]:g}; expected start < end")
        check.finish()
        return found[0], found[1]


#: What is wrong with a record of no length.
_NO_SAMPLES = "there are no samples; expected at least one; run longer than the sensor's interval"


def numbers(check: Checker, name: str, given: Any) -> Floats:
    """Return a copy of a column of numbers (n,), which may be not finite."""
    try:
        array = np.array(given, dtype=np.float64)
    except (OverflowError, RecursionError, TypeError, ValueError):
        check.fail(f"{name} is {shown(given, 80)}; expected numbers (n,)")
        return np.empty(0)
    if array.ndim != 1:
        check.fail(f"{name} has shape {array.shape}; expected (n,)")
        return np.empty(0)
    return array


def from_series(
    label: str, series: Series, component: str | None, start: float | None
) -> dict[str, Any]:
    """Return what a `Record` takes, for one component of a sensor's series."""
    for key in ("name", "components", "units", "time", "values", "attributes"):
        if not hasattr(series, key):
            raise SceneError(
                f"{label}: series is {shown(series, 80)}; expected that of a sensor; use "
                "analysis.Signal(time, value) for arrays"
            )
    label = f"{label}: sensor '{series.name}'"
    if not len(series.time):
        raise SceneError(f"{label}: {_NO_SAMPLES}")
    means = series.attributes.get("kind") in MEANS
    sign, column = _component(label, series, component, means)
    found = {
        "time": series.time,
        "value": sign * series.values[:, column],
        "unit": series.units[column],
        "sampling": "mean" if means else "point",
        "name": f"{series.name} {'-' if sign < 0 else ''}{series.components[column]}",
        "start": start,
    }
    if means and start is None:
        found["start"] = 0.0  # a mean measures from the beginning of the run
    return found


def _component(label: str, series: Series, component: str | None, means: bool) -> tuple[float, int]:
    """Return sign and column of a component of a sensor's series."""
    names = series.components
    if component is None and means:
        column = series.column(series.main_component)
        steps = np.diff(series.time, prepend=0.0)
        return (-1.0 if steps @ series.values[:, column] < 0 else 1.0), column
    if component is None and len(names) == 1:
        return 1.0, 0
    if component is None:
        raise SceneError(f"{label}: component is missing; expected one of {', '.join(names)}")
    sign, plain = 1.0, component
    if isinstance(component, str) and component not in names and component.startswith("-"):
        sign, plain = -1.0, component[1:]
    if plain not in names:
        raise SceneError(f"{label}: component is {shown(component)}; {nearest(str(plain), names)}")
    return sign, names.index(plain)


def crossing(time: Floats, value: Floats, k: int, level: float) -> float:
    """Return when a straight line from sample k - 1 to k, which reaches `level`, does."""
    part = (level - value[k - 1]) / (value[k] - value[k - 1])
    return float(time[k - 1] + part * (time[k] - time[k - 1]))
