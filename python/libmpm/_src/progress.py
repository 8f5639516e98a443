"""Progress of a run: a bar in the terminal or notebook, or a callable of one's own."""

from __future__ import annotations

import math
import time as clock
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

__all__ = ["HandedOn", "Progress", "Silent", "State", "bar_class", "reporter"]


@dataclass(frozen=True)
class State:
    """Where a run stands: `time` and `until` in s, `steps` done, `rate` in particle-steps/s."""

    time: float
    until: float
    steps: int
    rate: float


class Progress(Protocol):
    """Receives the state after each slice of a run, at least several times a second."""

    def update(self, state: State) -> None:
        """Take the present state."""

    def close(self) -> None:
        """End the report."""


def bar_class() -> Any:
    """Return tqdm's bar for the terminal or notebook at hand."""
    with warnings.catch_warnings():
        # Without ipywidgets tqdm warns at import and falls back to text, which is fine.
        warnings.simplefilter("ignore")
        from tqdm.auto import tqdm
    return tqdm


class Silent:
    """Reports nothing."""

    def update(self, state: Any) -> None:
        """Ignore it."""

    def close(self) -> None:
        """Do nothing."""


class HandedOn:
    """Hands every state to a callable."""

    def __init__(self, function: Callable[[Any], object]) -> None:
        """Take the callable."""
        self._function = function

    def update(self, state: Any) -> None:
        """Hand the state on."""
        self._function(state)

    def close(self) -> None:
        """Do nothing."""


class _Bar:
    """Elapsed and remaining wall time, simulated time and speed."""

    def __init__(self, start: float, until: float, title: str) -> None:
        self._start = start
        self._bar: Any = bar_class()(
            total=until - start,
            desc=title,
            bar_format=(
                "{desc} {percentage:3.0f}%|{bar}| {n:.3f}/{total:.3f} s "
                "[{elapsed}<{remaining}{postfix}]"
            ),
        )
        self._shown = 0.0

    def update(self, state: State) -> None:
        """Show the state."""
        done = min(state.time, state.until) - self._start
        now = clock.monotonic()
        if now - self._shown > 0.1 or done >= self._bar.total:
            self._shown = now
            self._bar.set_postfix_str(f"{state.rate:.2e} particle-steps/s", refresh=False)
            self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Leave the bar as it stands."""
        self._bar.close()


def reporter(
    progress: bool | Callable[[State], object], start: float, until: float, title: str
) -> Progress:
    """Return what `progress` asks for: True a bar, False nothing, a callable itself."""
    if callable(progress):
        return HandedOn(progress)
    if progress and math.isfinite(until) and until > start:
        return _Bar(start, until, title)
    return Silent()
