"""Progress of a study: one bar for all cases, or a custom callable."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from libmpm._src.run.progress import HandedOn, Silent, bar_class

__all__ = ["StudyProgress", "StudyState", "reporter"]

#: Seconds between two looks at the bar.
_PAUSE = 0.1
#: The same where nothing has changed and every look adds a line to a file.
_LONG_PAUSE = 10.0


@dataclass(frozen=True)
class StudyState:
    """Where a study stands, in numbers of simulations, trunks included.

    `running` is None where the executor does not tell; `rate` is particle-steps/s of all
    simulations that have ended in this run, per second of its wall time.
    """

    total: int
    done: int
    failed: int
    running: int | None
    rate: float


class StudyProgress(Protocol):
    """Receives the state several times a second."""

    def update(self, state: StudyState) -> None:
        """Take the present state."""

    def close(self) -> None:
        """End the report."""


class _Bar:
    def __init__(self, title: str, state: StudyState) -> None:
        # What an earlier run has finished counts as done, but not for the remaining time.
        self._bar: Any = bar_class()(
            total=state.total, initial=state.done + state.failed, desc=title, unit="case"
        )
        self._terminal = sys.stderr.isatty()
        self._shown = clock.monotonic()
        self._last = self._last_shown = state

    def update(self, state: StudyState) -> None:
        """Show the state."""
        now = clock.monotonic()
        same = _counts(state) == _counts(self._last_shown)
        pause = _LONG_PAUSE if same and not self._terminal else _PAUSE
        if now - self._shown < pause:
            self._last = state
            return
        self._shown = now
        self._show(state)

    def _show(self, state: StudyState) -> None:
        self._last = self._last_shown = state
        parts = [f"{state.failed} failed"] if state.failed else []
        parts += [] if state.running is None else [f"{state.running} running"]
        parts += [f"{state.rate:.2e} particle-steps/s"] if state.rate else []
        # A trunk that ends brings new cases.
        self._bar.total, self._bar.n = state.total, state.done + state.failed
        self._bar.set_postfix_str(", ".join(parts))

    def close(self) -> None:
        """Leave the bar as it stands."""
        self._show(self._last)
        self._bar.close()


def _counts(state: StudyState) -> tuple[int | None, ...]:
    return state.total, state.done, state.failed, state.running


def reporter(
    progress: bool | Callable[[StudyState], object], title: str, state: StudyState
) -> StudyProgress:
    """Return what `progress` asks for: True a bar, False nothing, a callable itself."""
    if callable(progress):
        return HandedOn(progress)
    return _Bar(title, state) if progress else Silent()
