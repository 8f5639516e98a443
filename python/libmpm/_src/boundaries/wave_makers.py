"""Wave makers: strokes of pistons, as tables of places for `boundaries.Displacement`."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, sequence, shown
from libmpm._src.errors import SceneError

__all__ = ["piston_stroke", "stroke_from_file"]

#: Part of the rms velocity by which a file's velocities may miss the slope of its places.
_AGREE = 0.05

#: Orders that the columns of a file may have.
_COLUMNS: tuple[tuple[str, ...], ...] = (
    ("time", "position"),
    ("time", "position", "velocity"),
    ("time", "velocity", "position"),
)

Array = npt.NDArray[np.float64]


@keywords_only("boundaries.piston_stroke", 4, method=False)
def piston_stroke(
    amplitude: float,
    rate: float,
    delay: float,
    until: float,
    *,
    dt: float = 1 / 120,
    direction: Sequence[float] = (1.0, 0.0),
) -> TimeTable:
    """Return the error-function stroke of a piston, x(t) = (A/2) (1 + erf(k (t - t₀))), in m.

    =========  ====  ======  =================================================================
    parameter  unit  range   meaning
    =========  ====  ======  =================================================================
    amplitude  m     finite  A, the whole way
    rate       1/s   > 0     k; the fastest is A k / √π, at t₀
    delay      s     finite  t₀
    until      s     ≥ 0     end of the table, which holds its last place
    dt         s     > 0     between rows; it is linear between them
    direction  -     (d,)    of the stroke, in the scene's dimension; its length does not matter
    =========  ====  ======  =================================================================

    The first row is x(0) and not 0: shape and water begin that far from where the piston is stated,
    so state it x(0) further back. In still water of depth h the crest follows from the simple wave,
    (√(g h) + A k / (2 √π))² / g. Raises `SceneError`.

    Source: stroke of the Large Wave Flume, Bonus (2023), 7.3.

    >>> table = piston_stroke(4.0, 0.2, 9.9303, until=40.0)
    >>> [round(float(table.at(t)[0]), 5) for t in (0.0, 40.0)]
    [0.00995, 4.0]
    """
    check = Checker("piston_stroke")
    amplitude = check.number("amplitude", amplitude, unit="m")
    rate = check.number("rate", rate, lower=0, lower_open=True, unit="1/s")
    delay = check.number("delay", delay, unit="s")
    along = _direction(check, direction)
    check.finish()
    if not math.isfinite(rate * delay):
        check.fail(f"rate is {rate:g} with delay {delay:g}; expected a finite product")
        check.finish()

    def place(time: float) -> Array:
        return 0.5 * amplitude * (1 + math.erf(rate * (time - delay))) * along

    return TimeTable.sample(place, dt, until)


@keywords_only("boundaries.stroke_from_file", 1, method=False)
def stroke_from_file(
    path: str | Path,
    *,
    columns: Sequence[str] = ("time", "position", "velocity"),
    start: float = 0.0,
    until: float | None = None,
    direction: Sequence[float] = (1.0, 0.0),
) -> TimeTable:
    """Return the stroke that a file of rows separated by commas describes, in m.

    Rows have the time in s, the position in m and, if there is a third column, the velocity in m/s,
    in that order; a header line of names is skipped. The velocities must be the slope of the
    positions, to 5 % rms of the fastest motion's own: columns in another order are found out.

    =========  ====  ==========  ============================================================
    parameter  unit  range       meaning
    =========  ====  ==========  ============================================================
    path       -     a file      of a recorder, at 1200 Hz for instance
    columns    -     names       order of the columns; "velocity" may be missing from the file
    start      s     finite      time in the file at which the run begins
    until      s     > 0         time of the run that the table has to reach; None = all rows
    direction  -     (d,)        of the stroke, in the scene's dimension
    =========  ====  ==========  ============================================================

    Before its first row and after its last one the piston rests. Raises `SceneError`.
    """
    check = Checker(f"stroke_from_file: {path if isinstance(path, str | os.PathLike) else ''}")
    names = tuple(sequence(columns) or ())
    if names not in _COLUMNS:
        known = " or ".join(", ".join(c) for c in _COLUMNS)
        check.fail(f"columns is {shown(columns)}; expected {known}")
    if not isinstance(path, str | os.PathLike):
        check.fail(f"path is {shown(path, 80)}; expected the name of a file")
    start = check.number("start", start, unit="s")
    if until is not None:
        until = check.number("until", until, lower=0, lower_open=True, unit="s")
    along = _direction(check, direction)
    check.finish()
    rows = _rows(check, Path(path), names)
    time = rows[:, 0] - start
    position = rows[:, names.index("position")]
    if "velocity" in names and rows.shape[1] > 2:
        _compare(check, time, position, rows[:, names.index("velocity")])
    first = max(0, int(np.searchsorted(time, 0.0, side="right")) - 1)
    last = len(time)
    if until is not None:
        last = min(last, int(np.searchsorted(time, until, side="left")) + 1)
    if time[-1] < 0:
        check.fail(f"its rows end at {time[-1] + start:g} s, before start {start:g} s; expected "
                   "rows of the run; give an earlier start")  # fmt: skip
    check.finish()
    return TimeTable(time[first:last], position[first:last, None] * along)


def _direction(check: Checker, given: Sequence[float]) -> Array:
    """Return a direction of length 1."""
    vector = np.array(check.vector("direction", given), dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if len(vector) and length == 0:
        check.fail("direction has no length; expected the way of the stroke, such as (1, 0)")
    return vector / (length or 1.0)


def _rows(check: Checker, path: Path, names: tuple[str, ...]) -> Array:
    """Return the rows of a file, times rising; raises `SceneError`."""
    try:
        rows = np.atleast_2d(np.genfromtxt(path, delimiter=",", dtype=np.float64))
    except (OSError, ValueError, IndexError, MemoryError) as error:
        raise SceneError(f"{check.label}: cannot be read: {error}") from error
    if len(rows) > 1 and np.all(np.isnan(rows[0])):
        rows = rows[1:]
    rows = rows[:, : len(names)]
    needed = names.index("position") + 1
    if len(rows) < 2 or rows.shape[1] < needed:
        check.fail(f"has {rows.shape[0]} × {rows.shape[1]} numbers; expected two rows or more of "
                   f"{', '.join(names)}")  # fmt: skip
    elif not np.all(np.isfinite(rows)):
        row = int(np.argmin(np.all(np.isfinite(rows), axis=1)))
        check.fail(f"row {row + 1} has gaps or texts; expected numbers")
    elif np.any(np.diff(rows[:, 0]) <= 0):
        row = int(np.argmax(np.diff(rows[:, 0]) <= 0)) + 1
        check.fail(f"the time of row {row + 1} is {rows[row, 0]:g} s after {rows[row - 1, 0]:g} s; "
                   "expected rising times")  # fmt: skip
    check.finish()
    return np.asarray(rows)


def _compare(check: Checker, time: Array, position: Array, velocity: Array) -> None:
    """Refuse velocities that are not the slope of the positions."""

    def misses(x: Array, v: Array) -> float:
        mean = 0.5 * (v[1:] + v[:-1])
        slope = np.diff(x) / np.diff(time)
        size = max(float(np.sqrt(np.mean(u**2))) for u in (mean, slope))
        return float(np.sqrt(np.mean((slope - mean) ** 2))) / size if size > 0 else 0.0

    off = misses(position, velocity)
    if off <= _AGREE:
        return
    remedy = "give columns=('time', 'position'), which leaves the velocities out"
    if misses(velocity, position) <= _AGREE:
        remedy = "the columns are swapped; give columns with the two names exchanged"
    check.fail(
        f"the slope of the positions misses the velocities by {100 * off:.3g} % rms; expected "
        f"≤ {100 * _AGREE:g} %; {remedy}"
    )
