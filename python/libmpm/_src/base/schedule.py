"""When number k of something that repeats falls due, whatever the rounding of its interval."""

from __future__ import annotations

__all__ = ["due_index", "due_time"]


def due_time(index: int, interval: float) -> float:
    """Return when number `index` falls due, s: a rounding error early.

    3 * 0.1 is above 0.3 in binary, and a run until 0.3 s shall have its frame there.
    """
    return index * interval * (1 - 1e-12)


def due_index(time: float, interval: float) -> int:
    """Return the largest index that is due at `time`."""
    k = max(0, int(time / (interval * (1 - 1e-12))))
    while due_time(k + 1, interval) <= time:
        k += 1
    while k > 0 and due_time(k, interval) > time:
        k -= 1
    return k
