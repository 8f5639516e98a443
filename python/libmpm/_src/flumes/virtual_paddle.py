"""Pistons that send a measured wave (`stroke_of_gauge`) or move with a recorded flow."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, keywords_only

__all__ = ["piston_of_flow", "stroke_of_gauge"]

#: Share of the still depth below which a level counts as still.
_STILL = 0.01


@keywords_only("stroke_of_gauge", 2, method=False)
def stroke_of_gauge(
    time: Sequence[float] | npt.NDArray[Any],
    level: Sequence[float] | npt.NDArray[Any],
    *,
    depth: float,
    distance: float,
    gravity: float = 9.81,
    until: float | None = None,
    smooth: float = 0.06,
) -> tuple[TimeTable, float]:
    """Return the places (m) of a piston whose wave is a measured one at a distance, and its start.

    =========  ====  ===========  ===============================================================
    parameter  unit  range        meaning
    =========  ====  ===========  ===============================================================
    time       s     rising (n,)  of the readings
    level      m     (n,)         change η of the level from that at rest
    depth      m     > 0          h, of the still water, the same from piston to gauge
    distance   m     > 0          from the piston's place at the start to the gauge
    gravity    m/s²  > 0          g
    until      s     in time      readings after that are left out; None = none
    smooth     s     ≥ 0          length of the centred mean taken of the readings first
    =========  ====  ===========  ===============================================================

    The second number is the time of the readings at which the piston begins, s: the clock of a run
    that starts with it. A simple wave carries η with 3 √(g (h + η)) - 2 √(g h) and moves its water
    with u = 2 (√(g (h + η)) - √(g h)); each reading is led back along its characteristic to the
    place where the piston then is, which must have moved with u. Falling levels whose
    characteristics would cross on the way back are left out. Levels must hold no wave that came
    back from beyond the gauge. The piston stops before it reaches the gauge. Raises `SceneError`.
    """
    check = Checker("stroke_of_gauge")
    when, rise = (np.asarray(x, np.float64) for x in (time, level))
    depth = check.number("depth", depth, lower=0, lower_open=True, unit="m")
    distance = check.number("distance", distance, lower=0, lower_open=True, unit="m")
    gravity = check.number("gravity", gravity, lower=0, lower_open=True, unit="m/s²")
    smooth = check.number("smooth", smooth, lower=0, unit="s")
    if when.ndim != 1 or when.shape != rise.shape or len(when) < 3 or np.any(np.diff(when) <= 0):
        check.fail(f"time has shape {when.shape} and level {rise.shape}; expected three or more "
                   "readings at rising times")  # fmt: skip
    elif not np.all(np.isfinite(rise)) or not np.all(np.isfinite(when)):
        check.fail("level has gaps; expected a number at each time; interpolate over them")
    elif np.any(rise <= -depth):
        check.fail(
            f"level falls to {rise.min():g} m with depth {depth:g} m; expected above the bed"
        )
    check.finish()
    if until is not None:
        rise, when = rise[when <= until], when[when <= until]
    width = max(1, round(smooth / float(np.median(np.diff(when)))) | 1)
    padded = np.pad(rise, width // 2, mode="edge")
    rise = np.convolve(padded, np.full(width, 1 / width), "valid")
    first = int(np.argmax(np.abs(rise) > _STILL * depth))
    still = math.sqrt(gravity * depth)
    start = float(when[max(first - 1, 0)]) - distance / still
    times, places, speed = [start], [0.0], 0.0
    for t, eta in zip(when[first:], rise[first:], strict=True):
        wave = math.sqrt(gravity * (depth + eta))
        u, c = 2 * (wave - still), 3 * wave - 2 * still
        # At once where and when: X = X₀ + ½ (u₀ + u) (τ - τ₀), τ = t - (x - X)/c.
        mean = 0.5 * (speed + u)
        left = distance - places[-1] + mean * times[-1]
        tau = (t * c - left) / (c - mean) if c > mean else math.inf
        place = places[-1] + mean * (tau - times[-1])
        if not times[-1] + 1e-3 < tau < math.inf:
            continue
        if place > 0.9 * distance:
            break
        times.append(tau)
        places.append(place)
        speed = u
    return TimeTable([t - start for t in times], places), start


@keywords_only("piston_of_flow", 3, method=False)
def piston_of_flow(
    time: Sequence[float] | npt.NDArray[Any],
    place: Sequence[float] | npt.NDArray[Any],
    velocity: npt.NDArray[Any] | Sequence[Sequence[float]],
    *,
    begin: float,
    at: float,
    until: float | None = None,
) -> TimeTable:
    """Return the places (m) of a piston that moves with the water of a run, as a `TimeTable`.

    =========  ====  ============  ==============================================================
    parameter  unit  range         meaning
    =========  ====  ============  ==============================================================
    time       s     rising (n,)   of the readings, in the run's clock
    place      m     rising (k,)   x of the stations along the flow, k ≥ 2
    velocity   m/s   (n, k)        mean over the depth of the water at each station
    begin      s     in time       when the piston begins to move
    at         m     in place      x at which it then stands
    until      s     > begin       end of the table; None = that of the readings
    =========  ====  ============  ==============================================================

    A vertical plane that moves with the mean velocity of the water in it, dX/dt = u(X, t), has the
    same water on each side for good: a wall in its place sends into a near field what the run sent
    there, and lets in nothing else. It is exact for long waves, whose velocity is the same at all
    depths. Places count from `at`, are 0 until `begin` and hold their end. Waves that come back
    from the near field in another way than in the run meet it as a wall.

    u is linear between stations and readings, X is found by steps of the readings (Heun). Raises
    `SceneError` where the plane leaves the stations.
    """
    check = Checker("piston_of_flow")
    when, x = np.asarray(time, np.float64), np.asarray(place, np.float64)
    u = np.asarray(velocity, np.float64)
    begin = check.number("begin", begin, unit="s")
    at = check.number("at", at, unit="m")
    if when.ndim != 1 or len(when) < 2 or np.any(np.diff(when) <= 0):
        check.fail(f"time has shape {when.shape}; expected two or more rising times")
    if x.ndim != 1 or len(x) < 2 or np.any(np.diff(x) <= 0):
        check.fail(f"place has shape {x.shape}; expected two or more stations at rising x")
    if u.shape != (*when.shape, *x.shape):
        check.fail(f"velocity has shape {u.shape}; expected {(*when.shape, *x.shape)}, a row a "
                   "reading and a column a station")  # fmt: skip
    elif not np.all(np.isfinite(u)):
        check.fail("velocity has gaps; expected a number at each station and time; leave out "
                   "stations that fall dry")  # fmt: skip
    check.finish()
    end = float(when[-1]) if until is None else check.number("until", until, unit="s")
    if not when[0] <= begin < end <= when[-1] + 1e-9:
        check.fail(f"begin is {begin:g} and until {end:g} s; expected rising, within the readings "
                   f"from {when[0]:g} to {when[-1]:g} s")  # fmt: skip
    if not x[0] <= at <= x[-1]:
        check.fail(f"at is {at:g} m; expected within the stations, {x[0]:g} to {x[-1]:g} m")
    check.finish()

    def speed(t: float, where: float) -> float:
        rows = [float(np.interp(t, when, column)) for column in u.T]
        return float(np.interp(where, x, rows))

    steps = [begin, *[float(t) for t in when if begin < t < end], end]
    places = [at]
    for t, later in itertools.pairwise(steps):
        first = speed(t, places[-1])
        second = speed(later, places[-1] + (later - t) * first)
        places.append(places[-1] + 0.5 * (later - t) * (first + second))
        if not x[0] <= places[-1] <= x[-1]:
            check.fail(f"the water at {at:g} m goes to {places[-1]:g} m by {later:g} s; expected "
                       f"within the stations, {x[0]:g} to {x[-1]:g} m; record more of them, or "
                       "end before")  # fmt: skip
            check.finish()
    head = [0.0] if begin > 0 else []
    return TimeTable([*head, *steps], [*head, *(p - at for p in places)])
