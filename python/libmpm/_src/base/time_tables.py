"""`TimeTable`: quantities that change with time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.arrays import real_array
from libmpm._src.base.declarations import OWNER, given
from libmpm._src.base.values import MOST, Checker, Value, shown, value
from libmpm._src.errors import SceneError

__all__ = ["TimeTable", "check_vector_table", "constant", "engine_table", "largest"]

#: Rows that a function may be sampled at.
_MOST_ROWS = 1_000_000


@value(kw_only=False)
class TimeTable(Value):
    """A number or vector that is linear between the rows of a table.

    Before the first time the first value holds. After the last time, `end` decides: "hold" keeps
    the last value, "repeat" starts again at the first row (period = last time - first time),
    "zero" returns zero.

    A table is stored in the scene, a function is not: use `sample` to convert one.

    {fields}

    Raises `SceneError` with every broken rule.
    """

    label: ClassVar[str] = "TimeTable"

    time: Sequence[float] | npt.NDArray[Any] = given(
        'strictly increasing, n ≥ 1 (n ≥ 2 for "repeat")', unit="s", shape="(n,)"
    )
    value: Sequence[float] | Sequence[Sequence[float]] | npt.NDArray[Any] = given(
        "numbers or vectors, finite", unit="its own", shape="(n,) or (n, k)", scales=OWNER
    )
    end: Literal["hold", "repeat", "zero"] = given('"hold", "repeat" or "zero"', default="hold")

    def _check(self, check: Checker) -> dict[str, Any]:
        time = _array(check, "time", self.time)
        values = _array(check, "value", self.value)
        end = check.choice("end", self.end, ("hold", "repeat", "zero"))
        if time is None or values is None:
            return {}
        if time.ndim != 1 or len(time) == 0:
            check.fail(f"time has shape {time.shape}; expected (n,) with n ≥ 1")
        elif np.any(np.diff(time) <= 0):
            row = int(np.argmax(np.diff(time) <= 0)) + 1
            check.fail(
                f"time[{row}] is {time[row]:g} after {time[row - 1]:g}; expected strictly "
                "increasing seconds; write a jump as two rows a short time apart"
            )
        elif end == "repeat" and len(time) < 2:
            check.fail("end is 'repeat' with one row; expected two or more, or end='hold'")
        if values.ndim not in (1, 2) or (values.ndim == 2 and values.shape[1] == 0):
            check.fail(f"value has shape {values.shape}; expected (n,) or (n, components)")
        elif time.ndim == 1 and len(values) != len(time):
            check.fail(f"value has {len(values)} rows, time has {len(time)}; expected as many")
        if check.problems:
            return {}
        rows = values.tolist()
        return {
            "time": tuple(time.tolist()),
            "value": tuple(tuple(row) if isinstance(row, list) else row for row in rows),
        }

    @classmethod
    @keywords_only("TimeTable.sample", 4)
    def sample(
        cls,
        function: Callable[[float], Any],
        dt: float,
        until: float,
        end: Literal["hold", "repeat", "zero"] = "hold",
    ) -> TimeTable:
        """Tabulate ``function(seconds)`` at 0, dt, 2 dt, ... up to the first time ≥ `until`.

        `dt` > 0 and `until` ≥ 0 are in seconds; raises `SceneError` otherwise.
        """
        check = Checker("TimeTable.sample")
        dt = check.number("dt", dt, lower=0, lower_open=True, unit="s")
        until = check.number("until", until, lower=0, unit="s")
        if not callable(function):
            check.fail(f"function is {shown(function)}; expected a callable of the time in seconds")
        if not check.problems and until / dt > _MOST_ROWS:
            check.fail(
                f"dt is {dt:g} s for {until:g} s, {until / dt:.3g} rows; expected ≤ {_MOST_ROWS} "
                f"rows; use dt ≥ {until / _MOST_ROWS:.3g} s"
            )
        check.finish()
        # The small allowance keeps 0.3 / 0.1 = 2.9999999999999996 and its like at the exact row.
        rows = math.ceil(until / dt - 1e-9) + 1
        times = [i * dt for i in range(max(rows, 1))]
        rows_of = []
        for t in times:
            try:
                rows_of.append(np.asarray(function(t), dtype=float).tolist())
            except Exception as error:
                check.fail(
                    f"function({t:g}) gives {type(error).__name__}: {error}; expected a number or "
                    "a row of numbers at each time; correct the function"
                )
                raise SceneError(check.problems) from error
        return cls(times, rows_of, end)

    @property
    def components(self) -> int:
        """Number of components of a row; 0 for a table of plain numbers."""
        first = self.value[0]
        return len(first) if isinstance(first, tuple) else 0

    def arrays(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return time (n,) in seconds and value (n,) or (n, k) as new float64 arrays."""
        return np.array(self.time, dtype=np.float64), np.array(self.value, dtype=np.float64)

    @keywords_only("TimeTable.at", 1)
    def at(self, time: float) -> npt.NDArray[np.float64]:
        """Return the value at `time` seconds, shape () or (k,)."""
        times, values = self.arrays()
        first, last = float(times[0]), float(times[-1])
        if time > last:
            if self.end == "zero":
                return np.zeros_like(values[0])
            if self.end == "repeat":
                time = first + math.fmod(time - first, last - first)
        columns = values.reshape(len(times), -1).T
        result = np.array([np.interp(time, times, column) for column in columns])
        return result.reshape(values.shape[1:])


def engine_table(table: TimeTable) -> dict[str, Any]:
    """Return a table as the engine takes it, values (n, k)."""
    time, value = table.arrays()
    return {"time": time, "value": value.reshape(len(time), -1), "end": table.end}


def constant(vector: Sequence[float]) -> TimeTable:
    """Return the table of a vector that never changes."""
    return TimeTable((0.0,), (tuple(vector),))


def largest(table: TimeTable, of_places: bool = False) -> float:
    """Return the largest magnitude of a table's rows, or of the slopes between rows of places."""
    time, value = table.arrays()
    value = value.reshape(len(time), -1)
    if of_places:
        if len(time) < 2:
            return 0.0
        value = np.diff(value, axis=0) / np.diff(time)[:, None]
    return max(math.hypot(*row) for row in value.tolist())


def _array(check: Checker, name: str, item: Any) -> npt.NDArray[np.float64] | None:
    try:
        array = real_array(item, name)
    except (OverflowError, TypeError, ValueError):
        check.fail(f"{name} is not a regular table of numbers: {shown(item, 80)}")
        return None
    if not np.all(np.isfinite(array)):
        check.fail(f"{name} has an entry that is not finite; remove it or interpolate over it")
        return None
    most = np.abs(array).max(initial=0.0)
    if not most < MOST:
        check.fail(f"{name} has an entry of {most:g}; expected numbers below {MOST:g}")
        return None
    return array


def check_vector_table(
    check: Checker, name: str, item: TimeTable, dimension: int, unit: str
) -> None:
    """Report a table whose rows are not vectors of the scene's dimension."""
    if item.components != dimension:
        have = f"{item.components} numbers" if item.components else "plain numbers"
        check.fail(f"{name} has rows of {have}; expected vectors of {dimension} in {unit}")
