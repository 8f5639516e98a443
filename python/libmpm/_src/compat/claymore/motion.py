"""Motion files of ClaymoreUW: time in s, position in m and velocity in m/s, without a head."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.compat.claymore.reader import Context

__all__ = ["read_motion"]

#: Share of rows in which a column's differences must be the other column to tell them apart.
_AGREE = 0.05


def read_motion(
    context: Context, where: str, path: Path, start: float, until: float
) -> TimeTable | None:
    """Return the displacement along x, m, by time since `start`; None and a problem if unusable.

    Rows are kept as far as `until` s of the run needs them.
    """
    try:
        rows = np.genfromtxt(path, delimiter=",", dtype=np.float64, invalid_raise=True)
    except (OSError, ValueError) as error:
        context.fail(where, f"names the motion file {path}, which cannot be read: {error}")
        return None
    rows = np.atleast_2d(rows)
    if len(rows) > 1 and np.all(np.isnan(rows[0])):
        rows = rows[1:]  # a head of names
    if (
        rows.shape[0] < 2
        or rows.shape[1] < 2
        or not np.all(np.isfinite(rows[:, : min(3, rows.shape[1])]))
    ):
        context.fail(
            where,
            f"names the motion file {path}, which has {rows.shape[0]} × {rows.shape[1]} numbers "
            "or gaps; expected rows of time s, position m, velocity m/s",
        )
        return None
    time, position = rows[:, 0] - start, rows[:, 1]
    if np.any(np.diff(time) <= 0):
        k = int(np.argmax(np.diff(time) <= 0)) + 1
        context.fail(
            where, f"names the motion file {path}, whose time in row {k + 1} does not rise"
        )
        return None
    if rows.shape[1] > 2 and _swapped(time, position, rows[:, 2]):
        position = rows[:, 2]
        context.note(
            f"{where}: columns 2 and 3 of {path.name} are velocity and position, as their "
            "differences show; ClaymoreUW's other files have them in the opposite order"
        )
    first = max(0, int(np.searchsorted(time, 0.0, side="right")) - 1)
    last = min(len(time), int(np.searchsorted(time, until, side="left")) + 2)
    if time[0] > 0:
        context.note(f"{where}: {path.name} begins at {time[0]:g} s of the run; at rest before")
    if time[-1] < until * (1 - 1e-9):
        context.note(f"{where}: {path.name} ends at {time[-1]:g} s of the run; at rest after")
    time, position = time[first:last], position[first:last]
    still = np.zeros_like(position)
    return TimeTable(time, np.stack([position, still, still], axis=1))


def _swapped(
    time: npt.NDArray[np.float64], second: npt.NDArray[np.float64], third: npt.NDArray[np.float64]
) -> bool:
    """Return whether the second column is the slope of the third, and not the reverse."""

    def misses(position: npt.NDArray[np.float64], velocity: npt.NDArray[np.float64]) -> float:
        slope = np.diff(position) / np.diff(time)
        mean = 0.5 * (velocity[1:] + velocity[:-1])
        size = math.sqrt(float(np.mean(slope**2))) + math.sqrt(float(np.mean(mean**2)))
        return math.sqrt(float(np.mean((slope - mean) ** 2))) / size if size > 0 else 0.0

    return misses(third, second) < _AGREE < misses(second, third)
