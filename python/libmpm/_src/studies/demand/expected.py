"""The expected load of a field of debris, from the laws of its count, obliquity and porosity."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from libmpm._src.base.arguments import keywords_only, shown
from libmpm._src.base.values import Checker
from libmpm._src.studies.demand.laws import Discrete, integral
from libmpm._src.studies.demand.obliquity import in_radians
from libmpm._src.studies.demand.ordered import (
    POROSITY,
    OrderedLoad,
    Reduction,
    capacity,
    field_law,
    reduction_of,
)  # fmt: skip
from libmpm._src.studies.design.arrays import Floats

__all__ = ["expected_load", "rate_weighted_load"]

#: Places where a rate is looked at, and parts that it is integrated in.
_PLACES, _PARTS = 2001, 32


@keywords_only("demand.expected_load", 1, method=False)
def expected_load(
    ordered: float | Callable[[Any], Any],
    *,
    count: Any = 1,
    degrees: Any = None,
    angle: Any = None,
    angle_reduction: Reduction | Callable[[Floats], Any] | None = None,
    porosity: Any = None,
    porosity_reduction: Reduction | Callable[[Floats], Any] | None = None,
) -> float:
    """Return the expected load of a debris field, C(c) ∫ R(θ) P(θ) dθ ∫ R(n) P(n) dn, in N.

    ==================  ====  ================================================================
    argument            unit  meaning
    ==================  ====  ================================================================
    ordered             N     C(c): an `OrderedLoad`, a function of an array of counts, or one
                              number
    count               1     law of the number of debris, whole numbers ≥ 0
    degrees             °     law P(θ) of the obliquity, within 0 to 90
    angle               rad   the same in radians, as in version 0.1; warns, and goes in 0.3
    angle_reduction     1     R(θ), a `Reduction` (over 0 to 90 degrees, or to π/2) or a function of
                              an array of degrees; goes with `degrees`
    porosity            1     law P(n) of the porosity, within 0 to 1
    porosity_reduction  1     R(n), falls with n; goes with `porosity`
    ==================  ====  ================================================================

    A law is a number (a Dirac delta), samples (n,), a `Discrete`, `Histogram` or `Density`, or a
    law of ``scipy.stats``. Left out, angle and porosity are those of perfect order, with R = 1. A
    law of counts gives the mean of C(c). The three are taken as independent; `exceedance` need not.

    Raises `SceneError`. Source: Bonus (2023) eq. 11.5.
    """
    check = Checker("demand.expected_load")
    angle, angle_reduction = in_radians(check, degrees, angle, angle_reduction)
    counts = _counts(check, count)
    theta = _averaged(check, "angle", angle, angle_reduction)
    porous = _averaged(check, "porosity", porosity, porosity_reduction)
    check.finish()
    if isinstance(ordered, OrderedLoad):
        ordered.warn_beyond(counts.value)
    load = counts.expect(lambda c: capacity(check, ordered, c))
    check.finish()
    return load * theta * porous


@keywords_only("demand.rate_weighted_load", 1, method=False)
def rate_weighted_load(
    ordered: float | Callable[[Any], Any],
    *,
    rate: Callable[[Any], Any],
    count: Any = 1,
    degrees: Any = None,
    angle: Any = None,
    angle_reduction: Reduction | Callable[[Floats], Any] | None = None,
    porosity_reduction: Reduction | Callable[[Floats], Any] | None = None,
) -> float:
    """Return C(c) ∫ R(θ) P(θ) dθ ∫ R(n) λ(n) dn, in N per period.

    `rate` is λ(n) ≥ 0 in 1 / period, a function of the porosity from 0 to 1; the period is the one
    it is stated for. The other arguments are those of `expected_load`.

    The source writes the left side as a probability of exceedance. Its dimension says otherwise: it
    is a load weighted with a rate, N per period. If λ(n) dn is the rate of fields with porosities
    in dn, it is the sum of the expected loads of the fields of a period, and λ(n) = ν P(n) makes it
    ν times `expected_load`. If λ(n) is a rate of exceedance, pass −dλ/dn. For probabilities and
    rates of loads use `exceedance`.

    Raises `SceneError`. Source: Bonus (2023) eq. 11.6.
    """
    check = Checker("demand.rate_weighted_load")
    angle, angle_reduction = in_radians(check, degrees, angle, angle_reduction)
    counts = _counts(check, count)
    theta = _averaged(check, "angle", angle, angle_reduction)
    reduced = reduction_of(check, "porosity", porosity_reduction, rate)
    if not callable(rate):
        check.fail(f"rate is {shown(rate, 60)}; expected a function of the porosity in 1 / period")
    check.finish()
    if isinstance(ordered, OrderedLoad):
        ordered.warn_beyond(counts.value)
    places = np.linspace(*POROSITY, _PLACES)[1:-1].tolist()
    least = min((float(rate(n)), n) for n in places)
    if not least[0] >= 0:
        check.fail(f"rate is {least[0]:g} at porosity {least[1]:g}; expected ≥ 0 per period")
    check.finish()
    cuts = (*reduced.breaks, *np.linspace(*POROSITY, _PARTS + 1)[1:-1].tolist())
    weighted = integral(lambda n: reduced(n) * rate(n), POROSITY, cuts)
    load = counts.expect(lambda c: capacity(check, ordered, c))
    check.finish()
    return load * theta * weighted


def _counts(check: Checker, count: Any) -> Discrete:
    """Return the law of the counts, which has to be a list of whole numbers."""
    law = field_law(check, "count", count)
    return law if isinstance(law, Discrete) else Discrete([0.0])  # that it is none is reported


def _averaged(
    check: Checker, name: Literal["angle", "porosity"], item: Any, reduction: Any
) -> float:
    """Return ∫ R(x) P(x) dx, 1 if there is neither law nor reduction."""
    before = len(check.problems)
    reduced = reduction_of(check, name, reduction, item)
    law = field_law(check, name, 0.0 if item is None else item)
    return law.expect(reduced, reduced.breaks) if len(check.problems) == before else math.nan
