"""Laws of chance for debris fields, and the numbers that they are drawn with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.errors import SceneError

__all__ = ["Angles", "SpreadAngles", "Stream", "UniformAngles", "counts_of", "span"]

#: Uniform numbers made at a time.
_BLOCK = 1024


class Stream:
    """Uniform numbers in [0, 1) from a seed, the same with every NumPy and on every machine.

    The 53 upper bits of the words of PCG64, whose sequence NumPy keeps; its distributions it may
    change.
    """

    def __init__(self, seed: int) -> None:
        """`seed` is a whole number ≥ 0."""
        self._words = np.random.PCG64(seed)
        self._ahead = np.empty(0)

    def peek(self, n: int) -> npt.NDArray[np.float64]:
        """Return the next n numbers without using them up."""
        missing = n - len(self._ahead)
        if missing > 0:
            words = self._words.random_raw(max(missing, _BLOCK))
            more = (words >> np.uint64(11)).astype(np.float64) * 2.0**-53
            self._ahead = np.append(self._ahead, more)
        return self._ahead[:n]

    def drop(self, n: int) -> None:
        """Use up n numbers."""
        self._ahead = self._ahead[n:]

    def uniform(self, low: float, high: float) -> float:
        """Return a number between two others, with one draw even if they are equal."""
        u = float(self.peek(1)[0])
        self.drop(1)
        return low + u * (high - low)

    def integer(self, low: int, high: int) -> int:
        """Return a whole number low ≤ k ≤ high."""
        return min(high, low + int(self.uniform(0.0, float(high - low + 1))))

    def shuffle(self, items: Sequence[int]) -> list[int]:
        """Return the items in random order, by exchanging from the last one down."""
        mixed = list(items)
        for k in range(len(mixed) - 1, 0, -1):
            other = self.integer(0, k)
            mixed[k], mixed[other] = mixed[other], mixed[k]
        return mixed


def span(
    check: Checker, name: str, given: Any, *, unit: str = "", **limits: Any
) -> tuple[float, float]:
    """Return a number or (low, high) as (low, high)."""
    items = sequence(given)
    if items is None:
        number = check.number(name, given, unit=unit, **limits)
        return number, number
    if len(items) != 2:
        check.fail(f"{name} is {shown(given)}; expected a number or (low, high)")
        return 0.0, 0.0
    low, high = (check.number(f"{name}[{i}]", x, unit=unit, **limits) for i, x in enumerate(items))
    if low > high:
        check.fail(f"{name} is ({low:g}, {high:g}); expected low ≤ high; swap them")
    return low, high


class Angles(Value):
    """Base of the laws of angles."""

    @keywords_only("debris.Angles.draw", 1)
    def draw(self, stream: Stream) -> tuple[float, float]:
        """Return the interval, degrees, in which the pieces of one field are uniform."""
        raise NotImplementedError


@value
class UniformAngles(Angles):
    """Angles uniform between `low` and `high`, degrees against the flow, low ≤ high.

    {fields}

    The default is every angle that a rectangle has. Raises `SceneError`.
    """

    label: ClassVar[str] = "debris.UniformAngles"

    low: float = given("smallest angle, against the flow", default=-90.0, unit="degrees")
    high: float = given("largest angle, not below `low`", default=90.0, unit="degrees")

    def _check(self, check: Checker) -> dict[str, Any]:
        low, high = span(check, "(low, high)", (self.low, self.high), unit="degrees")
        return {"low": low, "high": high}

    @keywords_only("debris.UniformAngles.draw", 1)
    def draw(self, stream: Stream) -> tuple[float, float]:
        """Return the interval, degrees, in which the pieces of one field are uniform."""
        return self.low, self.high


@value
class SpreadAngles(Angles):
    """Angles uniform within `mean` ± `spread`, degrees against the flow.

    {fields}

    Each is a number, or (low, high) from which one is drawn, uniform, for the whole field; spread
    ≥ 0. The standard deviation of the angles tends to spread / √3. Raises `SceneError`.
    """

    label: ClassVar[str] = "debris.SpreadAngles"

    mean: float | tuple[float, float] = given(
        "middle of the angles, against the flow: a number, or (low, high) from which one is "
        "drawn for the whole field",
        unit="degrees",
    )
    spread: float | tuple[float, float] = given(
        "half of their width: a number, or (low, high) from which one is drawn for the whole field",
        unit="degrees",
        low=0,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "mean": span(check, "mean", self.mean, unit="degrees"),
            "spread": span(check, "spread", self.spread, unit="degrees", lower=0),
        }

    @keywords_only("debris.SpreadAngles.draw", 1)
    def draw(self, stream: Stream) -> tuple[float, float]:
        """Return the interval, degrees, in which the pieces of one field are uniform."""
        assert isinstance(self.mean, tuple) and isinstance(self.spread, tuple)
        mean, spread = stream.uniform(*self.mean), stream.uniform(*self.spread)
        return mean - spread, mean + spread


def counts_of(label: str, shares: Any, kinds: int, count: int) -> list[int]:
    """Return how many of `count` pieces are of each kind: the largest remainders go up.

    `shares` are numbers ≥ 0 in any unit; None = equal ones. Raises `SceneError`.
    """
    check = Checker(label)
    items = [1.0] * kinds if shares is None else sequence(shares)
    if items is None or len(items) != kinds:
        check.fail(f"shares is {shown(shares)}; expected {kinds} numbers, one a prototype")
        check.finish()
        return []
    parts = [check.number(f"shares[{i}]", x, lower=0) for i, x in enumerate(items)]
    check.finish()
    if sum(parts) <= 0:
        raise SceneError(f"{label}: shares is {shown(shares)}; expected one above 0")
    exact = [count * part / sum(parts) for part in parts]
    # The allowance keeps 10 of 20 from becoming 9 by rounding.
    found = [int(x + 1e-9) for x in exact]
    order = sorted(range(kinds), key=lambda k: (found[k] - exact[k], k))
    for k in order[: count - sum(found)]:
        found[k] += 1
    return found
