"""Time that something had: what waits for a processor that others use is not hanging.

On a machine whose processors are busy a second of work may take minutes of wall time. Limits for
what may wait for ever (a lock, a message, a child) are of wall time, so the time in which a process
was ready to run and got no processor is taken off, as Linux counts it (`/proc/PID/schedstat`).
"""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

__all__ = ["Patience", "queued"]


def queued(pid: int | str = "self") -> float:
    """Return the seconds for which a process has waited for a processor; 0 where nobody counts."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) * 1e-9
    return 0.0


def _queued_in(group: int) -> dict[int, float]:
    """Return process -> seconds for which it has waited, of a process group."""
    found = {}
    for entry in os.listdir("/proc") if os.path.isdir("/proc") else ():
        if entry.isdigit():
            with contextlib.suppress(OSError, ValueError):
                if os.getpgid(int(entry)) == group:
                    found[int(entry)] = queued(entry)
    return found


class Patience:
    """A limit of the time that a group of processes had; looked at now and then."""

    def __init__(self, seconds: float, group: int) -> None:
        """Begin to count; `group` is the process that leads it."""
        self.seconds, self.group = seconds, group
        self.again()

    def again(self) -> None:
        """Begin again."""
        self._had, self._seen = 0.0, time.monotonic()
        self._before = _queued_in(self.group)

    def left(self) -> float:
        """Return the seconds that are left; to be asked every few seconds."""
        now, waited = time.monotonic(), _queued_in(self.group)
        past = now - self._seen
        ready = max((t - self._before.get(p, 0.0) for p, t in waited.items()), default=0.0)
        self._had += max(0.0, past - ready)
        self._seen, self._before = now, waited
        return self.seconds - self._had
