"""`Series`: the samples of one sensor: named columns, peaks, impulses, a plot, a DataFrame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.arguments import is_number, known, nearest, quoted, shown
from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import MOST, Checker
from libmpm._src.errors import Error
from libmpm._src.sensors.engine_sensors import MEANS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Peak", "Series", "durations", "moving_mean"]

Array = NDArray[np.float64]

#: Units of what an impulse can be taken of: forces, and moments in 2D and 3D.
_FORCES = ("N", "N/m", "N m")


class Peak(NamedTuple):
    """The sample of a series with the largest magnitude, with its sign."""

    #: In the unit of the component.
    value: float
    #: Time of the sample, s.
    time: float
    #: Name of the column.
    component: str


def moving_mean(time: Array, values: Array, length: float) -> Array:
    """Return the mean of `values` (n,) over the last `length` s at each sample, (n,)."""
    if length <= 0 or len(time) < 2:
        return values.copy()
    spacing = float(np.median(np.diff(time)))
    # Samples of one time, or of times that are no numbers, are all of them within.
    width = max(1, round(min(length / spacing, len(time)))) if spacing > 0 else len(time)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(0, last - width)
    found: Array = (sums[last] - sums[first]) / (last - first)
    return found


def durations(time: Array) -> Array:
    """Return the interval (n,) s that each sample of a mean stands for; the run starts at 0."""
    return np.diff(time, prepend=0.0)


@dataclass(eq=False)
class Series:
    """The samples of one sensor.

    `time` is (samples,) s and `values` (samples, components); `components` names the columns,
    `units` gives their SI units, and ``series["force_x"]`` is one column. `attributes` (kind,
    interval, ...) goes to the file.
    """

    name: str
    components: tuple[str, ...]
    units: tuple[str, ...]
    attributes: dict[str, Any] = field(default_factory=dict)
    _time: Array = field(default_factory=lambda: np.empty(0), init=False, repr=False)
    _values: Array = field(init=False, repr=False)
    _count: int = field(default=0, init=False, repr=False)

    def __post_init__(self) -> None:
        """Take no space yet."""
        self._values = np.empty((0, len(self.components)))

    def __len__(self) -> int:
        """Return the number of samples."""
        return self._count

    def __repr__(self) -> str:
        """Return name, number of samples, span of time and columns."""
        span = f", {self._time[0]:g} to {self._time[self._count - 1]:g} s" if self._count else ""
        columns = ", ".join(
            f"{c} [{u}]" for c, u in zip(self.components[:6], self.units[:6], strict=True)
        )
        more = f", … {len(self.components) - 6} more" if len(self.components) > 6 else ""
        return f"<series '{self.name}': {self._count} samples{span}; {columns}{more}>"

    @property
    def time(self) -> Array:
        """Times of the samples, s, (samples,); a copy."""
        return self._time[: self._count].copy()

    @property
    def values(self) -> Array:
        """Samples, (samples, components), in `units`; a copy."""
        return self._values[: self._count].copy()

    def column(self, component: str) -> int:
        """Return the number of a column; raises `KeyError` that names those there are."""
        if known(component, self.components):
            return self.components.index(component)
        raise KeyError(
            f"series '{self.name}' has no component {quoted(component)}; "
            f"{nearest(component, self.components)}"
        )

    def __getitem__(self, component: str) -> Array:
        """Return the samples (samples,) of one component, in its unit; a copy.

        ``series["force_x"]``. Raises `KeyError` that names the components there are.
        """
        return self._values[: self._count, self.column(component)].copy()

    def __contains__(self, component: object) -> bool:
        """Tell whether there is a component of this name."""
        return known(component, self.components)

    def append(self, time: Array, values: Array) -> None:
        """Add samples; space doubles, so that many small additions stay cheap."""
        required = self._count + len(time)
        if required > len(self._time):
            space = max(required, 2 * len(self._time), 64)
            times, rows = np.empty(space), np.empty((space, len(self.components)))
            times[: self._count] = self._time[: self._count]
            rows[: self._count] = self._values[: self._count]
            self._time, self._values = times, rows
        self._time[self._count : required] = time
        self._values[self._count : required] = values
        self._count = required

    def since(self, first: int) -> tuple[Array, Array]:
        """Return (time, values) of the samples from index `first` on, a whole number."""
        return self._time[first : self._count], self._values[first : self._count]

    def peak(self, component: str | None = None, *, filter: float = 0.0) -> Peak:
        """Return the sample with the largest magnitude.

        =========  ====  ============  ========================================================
        parameter  unit  range         meaning
        =========  ====  ============  ========================================================
        component  -     a component   None = the force with the largest impulse of a load cell,
                                       the first column of any other sensor
        filter     s     ≥ 0           length of a moving mean that is taken before; peaks of
                                       impacts depend on it, so state it with the number
        =========  ====  ============  ========================================================

        Samples that are NaN (a gauge at a dry place) do not count. Raises `Error` where there is
        no sample and `KeyError` for an unknown component.
        """
        column = self.column(self.main_component if component is None else component)
        filter = self.filter_length(filter)
        time, rows = self.since(0)
        known = np.isfinite(rows[:, column])
        if not known.any():
            raise Error(
                f"series '{self.name}' has no sample of {self.components[column]}; run the "
                "simulation past the sensor's first interval"
            )
        time, values = time[known], rows[known, column]
        values = moving_mean(time, values, float(filter))
        index = int(np.argmax(np.abs(values)))
        return Peak(float(values[index]), float(time[index]), self.components[column])

    def filter_length(self, filter: Any) -> float:
        """Return the length of a moving mean, s; raises `Error` for what is none."""
        if not (is_number(filter) and 0 <= filter < MOST):
            raise Error(f"series '{self.name}': filter is {shown(filter)}; expected a length ≥ 0 s")
        return float(filter)

    def impulse(
        self, component: str | None = None, *, start: float = 0.0, end: float | None = None
    ) -> float:
        """Return the time integral of a force, N·s (N·s/m in 2D), or of a moment, N·m·s.

        Samples of a load cell or of a contact's load with an interval are means since the sample
        before, so the sum of samples times durations is the impulse itself, whatever the interval;
        samples at instants (other sensors) are joined by straight lines.

        =========  ====  ===========  =========================================================
        parameter  unit  range        meaning
        =========  ====  ===========  =========================================================
        component  -     a component  None = the force with the largest impulse
        start      s     ≥ 0          samples with start < time are counted; a mean that begins
                                      before counts with its part after
        end        s     > start      None = the last sample
        =========  ====  ===========  =========================================================

        Raises `Error` for a component that is no force or moment and for an empty span, `KeyError`
        for an unknown one.
        """
        name = self.main_component if component is None else component
        column = self.column(name)
        if self.units[column] not in _FORCES:
            forces = [c for c, u in zip(self.components, self.units, strict=True) if u in _FORCES]
            raise Error(
                f"series '{self.name}': an impulse of {name} [{self.units[column]}] has no meaning;"
                f" expected a force or a moment ({', '.join(forces) or 'this sensor has none'})"
            )
        time, rows = self.since(0)
        check = Checker(f"series '{self.name}'")
        start = check.number("start", start, unit="s")
        end = None if end is None else check.number("end", end, unit="s")
        check.finish()
        last = float(time[-1]) if end is None and len(time) else end
        if last is None or not start < last:
            raise Error(
                f"series '{self.name}': impulse from {start:g} to "
                f"{'no sample' if last is None else format(last, 'g')} s; expected samples and "
                "start < end"
            )
        force = rows[:, column]
        if self.attributes.get("kind") in MEANS:
            ends = np.clip(time, start, last)
            begins = np.clip(time - durations(time), start, last)
            return float(np.sum((ends - begins) * force))
        inside = np.unique(np.clip(np.concatenate([time, [start, last]]), time[0], time[-1]))
        inside = inside[(inside >= start) & (inside <= last)]
        return float(np.trapezoid(np.interp(inside, time, force), inside))

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`: a column per component, indexed by "time [s]".

        ``frame.attrs`` has the name of the series and the units. Raises `Error` without pandas,
        which ``libmpm[studies]`` brings.
        """
        pandas = need("pandas", "a table of a series", "studies")
        time, rows = self.since(0)
        index = pandas.Index(time.copy(), name="time [s]")
        frame = pandas.DataFrame(rows.copy(), index=index, columns=list(self.components))
        frame.attrs = {
            "name": self.name,
            "units": dict(zip(self.components, self.units, strict=True)),
        }
        return frame

    def plot(
        self,
        components: Sequence[str] | str | None = None,
        *,
        filter: float = 0.0,
        axes: Any = None,
        label: str | None = None,
    ) -> Figure:
        """Return a matplotlib figure of the samples over time, with units.

        =========  ====  ============  ========================================================
        parameter  unit  range         meaning
        =========  ====  ============  ========================================================
        components -     components    None = those with the first column's unit (the forces of
                                       a load cell, the level of a gauge), at most six
        filter     s     ≥ 0           length of a moving mean drawn over the samples
        axes       -     matplotlib    to draw into, for several series in one picture; None =
                                       a figure of its own
        label      -     text          of the legend; None = the component, with the name of the
                                       series where `axes` are given
        =========  ====  ============  ========================================================

        Raises `KeyError` for an unknown component, `Error` for components of several units.
        """
        from libmpm._src.pictures.series import plot_series

        return plot_series(self, components, filter=filter, axes=axes, label=label)

    def _repr_html_(self) -> str:
        """Return its first and last samples as a table for Jupyter."""
        from libmpm._src.output.html import series_html

        return series_html(self)

    @property
    def main_component(self) -> str:
        """The component of a load cell with the largest impulse; of others the first."""
        time, rows = self.since(0)
        forces = [i for i, c in enumerate(self.components) if c.startswith("force")]
        if not forces or not len(time):
            return self.components[0]
        impulses = [abs(float(durations(time) @ rows[:, i])) for i in forces]
        return self.components[forces[int(np.argmax(impulses))]]
