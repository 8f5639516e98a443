"""Lists of numbers in messages, cut where they are long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["listed", "marked"]


def listed(numbers: Sequence[int], most: int = 5) -> str:
    """Return numbers as a text, the first `most` of many."""
    text = ", ".join(str(int(i)) for i in numbers[:most])
    more = len(numbers) - most
    return f"{text} and {more} more" if more > 0 else text


def marked(which: npt.ArrayLike) -> str:
    """Return the numbers of the marked rows (n,) as a text, the first five of many."""
    return listed(np.flatnonzero(np.asarray(which)).tolist())
