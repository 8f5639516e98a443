"""`Tally`: the rows that an engine's sums over particles leave, as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from libmpm._src.sensors.reductions import Array

__all__ = ["Tally", "added", "split"]

#: Numbers of a tally in a row of the engine: sums, counts, halves of sums of ids, extremes.
_SUMS, _COUNTS, _IDS, _LOW, _HIGH, _SIZE = 0, 6, 9, 13, 16, 19


@dataclass(frozen=True)
class Tally:
    """What a tally has found in n samples.

    sums    (n, 6)  of values, or moments (`TallyOf`)
    count   (n, 3)  of values
    ids     (n, 4)  whole numbers that tell whether the particles are the same
    low     (n, 3)  smallest values, 0 without any
    high    (n, 3)  largest values, 0 without any
    """

    sums: Array
    count: Array
    ids: Array
    low: Array
    high: Array

    def of(self, chosen: NDArray[np.bool_]) -> Tally:
        """Return what it has in chosen samples."""
        return Tally(
            self.sums[chosen], self.count[chosen], self.ids[chosen], self.low[chosen],
            self.high[chosen],
        )  # fmt: skip


def split(rows: Array) -> tuple[list[Tally], Array]:
    """Return the tallies of an engine's rows (n, 19 k + 1), and its time steps, (n,) s."""
    parts = np.split(rows[:, :-1], max(1, (rows.shape[1] - 1) // _SIZE), axis=1)
    return [
        Tally(
            p[:, _SUMS:_COUNTS], p[:, _COUNTS:_IDS], p[:, _IDS:_LOW], p[:, _LOW:_HIGH],
            p[:, _HIGH:],
        )
        for p in parts
    ], rows[:, -1]  # fmt: skip


def added(tallies: Sequence[Tally]) -> Tally:
    """Return the tally of all particles of several."""
    if len(tallies) == 1:
        return tallies[0]
    low, high = (np.stack([getattr(t, n) for t in tallies]) for n in ("low", "high"))
    none = np.stack([t.count for t in tallies]) == 0
    low, high = np.where(none, np.inf, low), np.where(none, -np.inf, high)
    return Tally(
        np.sum([t.sums for t in tallies], axis=0), np.sum([t.count for t in tallies], axis=0),
        np.sum([t.ids for t in tallies], axis=0), low.min(axis=0), high.max(axis=0),
    )  # fmt: skip
