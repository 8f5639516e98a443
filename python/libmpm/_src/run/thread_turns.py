"""Several threads with one simulation: one advances it, others read between its slices."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from libmpm._src.errors import Error

__all__ = ["Turns"]


class Turns:
    """Whose turn it is. One thread at a time is inside a ``with turns:`` block, as often as it
    wants; those that wait come before a thread that has just left and enters again.

    The engine has a lock of its own for each call. This one holds together what belongs to one
    moment: a slice with the samples, frames and checkpoints behind it, and what a reader asks.
    """

    def __init__(self) -> None:
        """Make one that nobody has."""
        self._inside = threading.Lock()
        # Whoever waits for `_inside` has it, so that one who leaves waits here, behind them.
        self._next = threading.Lock()
        self._owner = 0
        self._depth = 0
        self._advance = threading.RLock()
        self._advances: list[str] = []  # threads that run it, by name: one, as often as nested

    def __enter__(self) -> None:
        """Wait for the turn, unless this thread has it."""
        if self._owner == threading.get_ident():
            self._depth += 1
            return
        with self._next:
            self._inside.acquire()
        self._owner, self._depth = threading.get_ident(), 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let the next one in."""
        self._depth -= 1
        if self._depth == 0:
            self._owner = 0
            self._inside.release()

    @property
    def advanced(self) -> bool:
        """Whether a thread runs or steps the simulation now."""
        return bool(self._advances)

    @contextmanager
    def advancing(self, scene: str) -> Iterator[None]:
        """Refuse a second thread that would run or step the simulation of `scene`.

        Raises `Error`.
        """
        if not self._advance.acquire(blocking=False):
            name = next(iter(self._advances), "that has just begun")
            raise Error(
                f"simulation '{scene}' is run by thread '{name}' at this moment; expected one "
                "thread at a time to run, step or close it, while others read; wait for that "
                "thread's end, or make a Simulation for each"
            )
        self._advances.append(threading.current_thread().name)
        try:
            yield
        finally:
            self._advances.pop()
            self._advance.release()
