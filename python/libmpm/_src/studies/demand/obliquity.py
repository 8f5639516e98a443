"""The obliquity of a field, typed in degrees: its law and its reduction as formulas have them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from libmpm._src.base.arguments import shown
from libmpm._src.base.values import Checker
from libmpm._src.studies.demand.laws import Discrete, Law, law_of
from libmpm._src.studies.demand.ordered import ANGLE, Reduction
from libmpm._src.studies.design.arrays import Floats

__all__ = ["in_radians"]

#: Largest obliquity, degrees.
_MOST = 90.0
#: Part of the range that rounding of its ends may make.
_ROUNDING = 1e-9


class _InRadians(Law):
    """A law of an angle in degrees, read in radians."""

    def __init__(self, law: Law) -> None:
        self._law = law

    @property
    def support(self) -> tuple[float, float]:
        """Least and largest angle, rad."""
        low, high = np.radians(self._law.support).tolist()
        return low, high

    def expect(self, function: Callable[[Any], Any], breaks: Sequence[float] = ()) -> float:
        """Return ∫ f(θ) P(θ) dθ of a function of θ in rad."""
        cuts = np.degrees(breaks).tolist()
        return self._law.expect(lambda x: function(np.radians(x)), cuts)

    def sample(self, random: np.random.Generator, size: int) -> Floats:
        """Return `size` independent draws, rad."""
        return np.radians(self._law.sample(random, size))


def in_radians(check: Checker, degrees: Any, angle: Any, reduction: Any) -> tuple[Any, Any]:
    """Return law and reduction of the angle in radians; reports to `check`.

    `degrees` is the law of the obliquity in degrees, and a function R(θ) that comes with it takes
    degrees; a `Reduction` takes what it reaches to, 90 degrees or π/2. `angle` is the law in
    radians as in version 0.1, which warns.
    """
    if degrees is None:
        if angle is not None:
            warnings.warn(
                f"{check.label}: angle, in radians, is degrees=... since libmpm 0.2; the old name "
                "goes in 0.3",
                DeprecationWarning,
                stacklevel=4,
            )
        elif reduction is not None:
            check.fail("degrees is missing for angle_reduction; expected a law, or 0.0 for order")
            return None, None
        return angle, reduction
    before = len(check.problems)
    if angle is not None:
        check.fail(f"degrees is {shown(degrees, 60)} and angle {shown(angle, 60)}; expected one")
    remedy = "fold by symmetry: min(θ, 180 − θ)"
    law = law_of(check, "degrees", degrees, lower=0, upper=_MOST, unit="degrees", remedy=remedy)
    if reduction is None:
        check.fail("angle_reduction is missing for degrees; expected a demand.Reduction")
    elif isinstance(reduction, Reduction) and reduction.upper <= ANGLE[1] * (1 + _ROUNDING):
        pass  # of radians, as `Reduction.three_point` is
    elif callable(reduction):
        breaks = np.radians(getattr(reduction, "breaks", ())).tolist()
        least, most = getattr(reduction, "lower", 0.0), getattr(reduction, "upper", _MOST)
        if least > 0 or most < _MOST * (1 - _ROUNDING):
            check.fail(
                f"angle_reduction is defined from {least:g} to {most:g}; expected 0 to 90 degrees "
                "or to π/2"
            )
        else:
            of_degrees = reduction
            reduction = Reduction(
                lambda x: of_degrees(np.degrees(x)), upper=ANGLE[1], breaks=breaks
            )
    if len(check.problems) > before:
        return None, None
    if isinstance(law, Discrete):
        return Discrete(np.radians(law.value), law.probability), reduction
    return _InRadians(law), reduction
