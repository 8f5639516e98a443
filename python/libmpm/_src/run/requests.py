"""What `Simulation` is asked to do, checked before anything moves."""

from __future__ import annotations

import contextlib
import numbers
from collections.abc import Callable
from typing import Any

import numpy as np

from libmpm._src.base.arguments import shown
from libmpm._src.base.values import Checker
from libmpm._src.errors import SceneError
from libmpm._src.run.progress import State

__all__ = ["body_number", "run_request", "step_count"]


def step_count(n: Any) -> int:
    """Return a number of steps, ≥ 0; raises `SceneError`."""
    check = Checker("Simulation.step")
    n = check.integer("n", n, remedy="a number of steps")
    check.finish()
    return int(n)


def run_request(
    until: Any, progress: Any, wall_limit: Any
) -> tuple[float, bool | Callable[[State], object], float | None]:
    """Return the arguments of a run: times in s, which may be infinite; raises `SceneError`."""
    check = Checker("Simulation.run")
    if not isinstance(until, numbers.Real | str | bytes | np.bool_) and hasattr(until, "__float__"):
        with contextlib.suppress(OverflowError, TypeError, ValueError):
            until = float(until)  # arrays and decimal fractions that are one number
    until = check.number("until", until, unit="s", infinite=True)
    if wall_limit is not None:
        wall_limit = check.number("wall_limit", wall_limit, lower=0, unit="s", infinite=True)
    if not isinstance(progress, bool | np.bool_) and not callable(progress):
        check.fail(f"progress is {shown(progress)}; expected True, False or a callable")
    check.finish()
    return until, progress, wall_limit


def body_number(body: Any, bodies: int) -> int:
    """Return the number of one of so many bodies; raises `SceneError`."""
    number = isinstance(body, int | np.integer) and not isinstance(body, bool)
    if not (number and 0 <= body < bodies):
        raise SceneError(f"body is {shown(body, 80)}; expected a number below {bodies}")
    return int(body)
