"""Progress of a run: a bar in the terminal or notebook, or a custom callable."""

from __future__ import annotations

import math
import time as clock
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

__all__ = ["HandedOn", "Pace", "Progress", "Silent", "State", "bar_class", "duration", "reporter"]


@dataclass(frozen=True)
class State:
    """Where a run stands: `time` and `until` in s, `steps` done, `rate` in particle-steps/s.

    `elapsed` is the wall time since the run began, s; `pace` how many seconds are simulated in a
    second of it, and `remaining` the wall time to `until` at that pace, s. Both are NaN
    before there is anything to measure.
    """

    time: float
    until: float
    steps: int
    rate: float
    elapsed: float = math.nan
    pace: float = math.nan

    @property
    def remaining(self) -> float:
        """Wall time to `until` at the present pace, s."""
        left = max(self.until - self.time, 0.0)
        return 0.0 if left == 0 else (left / self.pace if self.pace > 0 else math.nan)


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


class Pace:
    """Simulated time per wall time over the last while: runs slow down when water breaks up."""

    #: Wall time that is looked back on, s, and the least before an estimate is given.
    WINDOW, LEAST = 30.0, 0.2

    def __init__(self, time: float) -> None:
        """Begin at a simulated time, s."""
        self._begun = clock.monotonic()
        self._seen = deque([(self._begun, time)])

    def see(self, state: State) -> State:
        """Return the state with elapsed time and pace."""
        now = clock.monotonic()
        self._seen.append((now, state.time))
        while len(self._seen) > 2 and now - self._seen[1][0] >= self.WINDOW:
            self._seen.popleft()
        (then, before) = self._seen[0]
        pace = (state.time - before) / (now - then) if now - then >= self.LEAST else math.nan
        return replace(state, elapsed=now - self._begun, pace=pace)


def duration(seconds: float) -> str:
    """Return a wall time as m:ss or h:mm:ss, "?" where it is not known."""
    if not math.isfinite(seconds):
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


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


class _Call:
    """Hands every state to a callable, with elapsed time and pace."""

    def __init__(self, function: Callable[[State], object], start: float) -> None:
        self._function = function
        self._pace = Pace(start)

    def update(self, state: State) -> None:
        """Hand the state on."""
        self._function(self._pace.see(state))

    def close(self) -> None:
        """Do nothing."""


class _Bar:
    """Elapsed and remaining wall time, simulated time, its pace and the speed of the engine."""

    def __init__(self, start: float, until: float, title: str) -> None:
        self._start = start
        self._pace = Pace(start)
        self._bar: Any = bar_class()(
            total=until - start,
            desc=title,
            bar_format=(
                "{desc} {percentage:3.0f}%|{bar}| {n:.3f}/{total:.3f} s [{elapsed}{postfix}]"
            ),
        )
        self._shown = 0.0

    def update(self, state: State) -> None:
        """Show the state."""
        state = self._pace.see(state)
        done = min(state.time, state.until) - self._start
        now = clock.monotonic()
        if now - self._shown > 0.1 or done >= self._bar.total:
            self._shown = now
            known = "" if math.isnan(state.pace) else f"{state.pace:.2e} s/s, "
            self._bar.set_postfix_str(
                f"{duration(state.remaining)} left, {known}{state.rate:.2e} particle-steps/s",
                refresh=False,
            )
            self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Leave the bar as it stands."""
        self._bar.close()


def reporter(
    progress: bool | Callable[[State], object], start: float, until: float, title: str
) -> Progress:
    """Return what `progress` asks for: True a bar, False nothing, a callable itself."""
    if callable(progress):
        return _Call(progress, start)
    if progress and math.isfinite(until) and until > start:
        return _Bar(start, until, title)
    return Silent()
