"""Loads of ordered fields, and what disorder takes from them: `OrderedLoad`, `Reduction`."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, shown, warn
from libmpm._src.studies.analysis.regression import Regression, regression
from libmpm._src.studies.demand.laws import Law, law_of
from libmpm._src.studies.design.arrays import Floats, numbers

__all__ = [
    "ANGLE",
    "POROSITY",
    "OrderedLoad",
    "Reduction",
    "capacity",
    "field_law",
    "ordered_load",
    "reduction_of",
]

#: The ranges of the obliquity θ in radians and of the porosity n.
ANGLE, POROSITY = (0.0, math.pi / 2), (0.0, 1.0)

#: Places where a reduction is looked at, and by how much it may leave 0 to 1 for rounding.
_PLACES, _ROUNDING = 2001, 1e-9
#: Observations that the covariance of two coefficients needs at least.
_LEAST = 3
#: Terms of the regressions.
_COUNT, _ROOT = "c", "sqrt c"


class Reduction:
    """R(x): the share of the ordered load that a field with disorder x still exerts.

    =========  ====  ==============================================================================
    parameter  unit  meaning
    =========  ====  ==============================================================================
    function   1     R(x) of an array, 0 ≤ R ≤ 1, smooth between `breaks`
    lower      any   least x, 0 for an angle or a porosity
    upper      any   largest x: 90 of an angle in degrees, π/2 of one in radians, 1 of a porosity
    breaks     any   where R bends
    =========  ====  ==============================================================================

    `three_point`, `linear` and `through` make the usual ones. Raises `SceneError` where R leaves 0
    to 1: disorder reduces the load. Source: Bonus (2023) 11.2, axiom 3.
    """

    label: ClassVar[str] = "demand.Reduction"

    @keywords_only("demand.Reduction", 1)
    def __init__(
        self,
        function: Callable[[Floats], Any],
        *,
        lower: float = 0.0,
        upper: float,
        breaks: Sequence[float] = (),
    ) -> None:
        check = Checker(self.label)
        if not callable(function):
            check.fail(f"function is {shown(function)}; expected a callable of an array")
        self.lower, self.upper = check.number("lower", lower), check.number("upper", upper)
        if self.upper <= self.lower:
            check.fail(f"upper is {self.upper:g} with lower {self.lower:g}; expected upper > lower")
        check.finish()
        self.breaks = tuple(numbers(check, "breaks", breaks).ravel().tolist())
        check.finish()
        self._function = function
        self._make: Callable[[float], Reduction] | None = None
        self._end, self._deviation = math.nan, 0.0
        places = np.union1d(np.linspace(self.lower, self.upper, _PLACES), self.breaks)

        def values(x: Floats) -> Floats:
            return np.broadcast_to(np.asarray(function(x), dtype=np.float64), x.shape)

        found = check.called("function", values, places)
        bad = ~((found >= -_ROUNDING) & (found <= 1 + _ROUNDING))
        if bad.any():
            at = int(np.argmax(bad))
            check.fail(
                f"R is {found[at]:.6g} at {places[at]:.6g}; expected 0 to 1 from {self.lower:g} to "
                f"{self.upper:g}, since disorder reduces the load"
            )
        check.finish()

    def __call__(self, x: npt.ArrayLike) -> Any:
        """Return R(x), shape of x; raises `SceneError` for x outside `lower` to `upper`."""
        check = Checker(self.label)
        array = numbers(check, "x", x)
        slack = _ROUNDING * (self.upper - self.lower)
        outside = array[(array < self.lower - slack) | (array > self.upper + slack)]
        if outside.size:
            check.fail(f"x is {outside[0]:g}; expected {self.lower:g} to {self.upper:g}")
        check.finish()
        found = np.asarray(self._function(np.clip(array, self.lower, self.upper)))
        found = np.broadcast_to(np.clip(found, 0.0, 1.0), array.shape)
        return found.item() if array.ndim == 0 else np.array(found)

    @classmethod
    @keywords_only("demand.Reduction.three_point", 1)
    def three_point(cls, minimum: float, *, deviation: float = 0.0) -> Reduction:
        """Return R(θ), 1 head-on at 0 and π/2 and `minimum` at π/4, a parabola between.

        `minimum` is from 0 to 1; `deviation` ≥ 0 is its standard error, which `exceedance` draws
        from (a drawn minimum outside 0 to 1 counts as the nearer end). Source: the curve of the
        in-air study of ordered fields, Bonus (2023) 10.3 and 11.2; its minimum is not printed.
        """

        def make(end: float) -> Reduction:
            most = 4 * (1 - end) / ANGLE[1] ** 2
            return cls(lambda x: 1 - most * x * (ANGLE[1] - x), upper=ANGLE[1])

        return cls._uncertain(make, "minimum", minimum, deviation)

    @classmethod
    @keywords_only("demand.Reduction.linear", 1)
    def linear(cls, end: float, *, deviation: float = 0.0) -> Reduction:
        """Return R(n) = 1 − (1 − end) n, which falls from 1 at n = 0 to `end` at n = 1.

        `end` is from 0 to 1; `deviation` ≥ 0 is its standard error, as in `three_point`. The source
        asks for a decreasing function and prints none.
        """

        def make(end: float) -> Reduction:
            return cls(lambda x: 1 - (1 - end) * x, upper=POROSITY[1])

        return cls._uncertain(make, "end", end, deviation)

    @classmethod
    @keywords_only("demand.Reduction.through", 2)
    def through(cls, x: npt.ArrayLike, value: npt.ArrayLike) -> Reduction:
        """Return R through points x (n,), increasing, with values (n,) from 0 to 1; n ≥ 2.

        Two points give a line and three a parabola; more give piecewise cubics that are monotone
        between the points (PCHIP), so that R stays within the values. R is defined from the first
        point to the last.
        """
        check = Checker(f"{cls.label}.through")
        place = numbers(check, "x", x)
        height = numbers(check, "value", value, lower=0, upper=1)
        if place.ndim != 1 or place.size < 2 or (np.diff(place) <= 0).any():
            check.fail(f"x is {shown(x, 80)}; expected two or more increasing numbers")
        elif height.shape != place.shape and not check.problems:
            check.fail(f"value has shape {height.shape}; expected {place.shape}, as x")
        check.finish()
        ends: dict[str, Any] = {"lower": float(place[0]), "upper": float(place[-1])}
        if len(place) > 3:
            interpolate = need("scipy.interpolate", check.label, "studies")
            curve = interpolate.PchipInterpolator(place, height)
            return cls(curve, breaks=place[1:-1].tolist(), **ends)
        return cls(np.polynomial.Polynomial.fit(place, height, len(place) - 1), **ends)

    @classmethod
    def _uncertain(
        cls, make: Callable[[float], Reduction], name: str, end: float, deviation: float
    ) -> Reduction:
        check = Checker(cls.label)
        end = check.number(name, end, lower=0, upper=1)
        deviation = check.number("deviation", deviation, lower=0)
        check.finish()
        found = make(end)
        found._make, found._end, found._deviation = make, end, deviation
        return found

    @property
    def uncertain(self) -> bool:
        """True if `draws` differ."""
        return self._deviation > 0

    def draws(self, random: np.random.Generator, size: int) -> list[Reduction]:
        """Return reductions whose parameter is drawn from its normal law."""
        if self._make is None or not self.uncertain:
            return [self] * size
        ends = np.clip(random.normal(self._end, self._deviation, size), 0.0, 1.0)
        return [self._make(end) for end in ends.tolist()]


class OrderedLoad:
    """C(c), the load of a perfectly ordered field of c debris, fitted to data.

    Made by `ordered_load`. C(0) = 0: no debris, no load.
    """

    label: ClassVar[str] = "demand.OrderedLoad"

    def __init__(self, fit: Regression, counts: tuple[float, float]) -> None:
        """Take the regression on c or √c, and the least and largest count among its data."""
        self._fit, self._counts = fit, counts

    @property
    def form(self) -> str:
        """The text "linear" for a0 + a1 c, "sqrt" for a0 + a1 √c."""
        return "sqrt" if self._fit.terms[1] == _ROOT else "linear"

    @property
    def regression(self) -> Regression:
        """The fit with its statistics, an `analysis.Regression`."""
        return self._fit

    @property
    def coefficients(self) -> tuple[float, float]:
        """The coefficients a0 and a1, N."""
        a0, a1 = self._fit.coefficients.values()
        return a0, a1

    @property
    def covariance(self) -> Floats:
        """Covariance of a0 and a1, (2, 2) N²."""
        return np.asarray(self._fit.statsmodels.cov_params())

    @property
    def scatter(self) -> float:
        """Standard deviation of the data about the fit, N, with n − 2 degrees of freedom."""
        return self._fit.residual_error

    @property
    def counts(self) -> tuple[float, float]:
        """Least and largest count among the data; outside, C is extrapolated."""
        return self._counts

    def __call__(self, count: npt.ArrayLike) -> Any:
        """Return C(c) in N, shape of `count`; warns (`ModelWarning`) where it extrapolates."""
        check = Checker(self.label)
        array = numbers(check, "count", count, lower=0, whole=True)
        check.finish()
        self.warn_beyond(array)
        found = self.estimate(array)
        return found.item() if array.ndim == 0 else found

    @keywords_only("demand.OrderedLoad.estimate", 1)
    def estimate(self, count: Floats) -> Floats:
        """Return C(c) in N like a call, without checks and without a warning."""
        return self._at(count, self.coefficients)

    def warn_beyond(self, count: Floats) -> None:
        """Warn if C is extrapolated to any of the counts."""
        low, high = self.counts
        beyond = count[(count > 0) & ((count < low) | (count > high))]
        if beyond.size:
            warn(
                [
                    f"{self.label}: count is {beyond.flat[0]:g}; the data reach from {low:g} to "
                    f"{high:g}, so the load is extrapolated"
                ]
            )

    @property
    def uncertain(self) -> bool:
        """True if `draws` differ."""
        return bool(self.covariance.any())

    def draws(
        self, random: np.random.Generator, size: int
    ) -> list[Callable[[npt.ArrayLike], Floats]]:
        """Return functions C(c) with coefficients drawn from their law.

        That is the multivariate t law with n − 2 degrees of freedom around the estimates, since the
        scatter is estimated too. A drawn load below zero counts as zero.
        """
        freedom = self._fit.observations - 2
        normal = random.multivariate_normal(np.zeros(2), self.covariance, size, "ignore")
        spread = np.sqrt(random.chisquare(freedom, size) / freedom)
        drawn = np.asarray(self.coefficients) + normal / spread[:, None]

        def curve(pair: tuple[float, float]) -> Callable[[npt.ArrayLike], Floats]:
            return lambda count: np.maximum(self._at(np.asarray(count), pair), 0.0)

        return [curve((a0, a1)) for a0, a1 in drawn.tolist()]

    def _at(self, count: Floats, coefficients: tuple[float, float]) -> Floats:
        variable = np.sqrt(count) if self.form == "sqrt" else count
        load = coefficients[0] + coefficients[1] * variable
        return np.where(count > 0, load, 0.0)

    def __repr__(self) -> str:
        """Return the fit in a line."""
        (a0, a1), (s0, s1) = self.coefficients, self._fit.standard_errors.values()
        variable = "√c" if self.form == "sqrt" else "c"
        return (
            f"{self.label}(C = {a0:.5g} ± {s0:.2g} + ({a1:.5g} ± {s1:.2g}) {variable} N, R² "
            f"{self._fit.r_squared:.4f}, n {self._fit.observations})"
        )


@keywords_only("demand.ordered_load", 2, method=False)
def ordered_load(
    count: npt.ArrayLike, load: npt.ArrayLike, *, form: Literal["linear", "sqrt"] = "linear"
) -> OrderedLoad:
    """Fit C(c) to loads of ordered fields by least squares.

    ========  ====  =====  =====================================================================
    argument  unit  shape  meaning
    ========  ====  =====  =====================================================================
    count     1     (n,)   numbers of debris, whole, ≥ 1, of two or more kinds; n ≥ 3
    load      N     (n,)   loads of the fields, for instance the largest of each run
    form      -     -      "linear" C = a0 + a1 c, the trend of longitudinal fields, or "sqrt"
                           C = a0 + a1 √c, that of transverse fields
    ========  ====  =====  =====================================================================

    Raises `SceneError`. Source: Bonus (2023) 7.5 and 11.2; no coefficients are printed.
    """
    check = Checker("demand.ordered_load")
    counts = numbers(check, "count", count, lower=1, whole=True)
    loads = numbers(check, "load", load, unit="N")
    check.choice("form", form, ("linear", "sqrt"))
    check.finish()
    if counts.ndim != 1 or loads.shape != counts.shape or counts.size < _LEAST:
        check.fail(
            f"count has shape {counts.shape} and load {loads.shape}; expected (n,) for both, n ≥ 3"
        )
    elif (counts == counts[0]).all():
        check.fail(f"count is {counts[0]:g} throughout; expected two or more different counts")
    check.finish()
    term = _ROOT if form == "sqrt" else _COUNT
    fit = regression({_COUNT: counts, "load": loads}, "load", [term])
    return OrderedLoad(fit, (float(counts.min()), float(counts.max())))


def field_law(check: Checker, name: Literal["count", "angle", "porosity"], item: Any) -> Law:
    """Return the law of a variable of the field within its range; reports to `check`."""
    if name == "count":
        return law_of(check, name, item, lower=0, whole=True)
    if name == "angle":
        remedy = "use radians, and fold by symmetry: min(θ, π − θ)"
        return law_of(check, name, item, lower=0, upper=ANGLE[1], unit="rad", remedy=remedy)
    return law_of(check, name, item, lower=0, upper=1)


def reduction_of(
    check: Checker, name: Literal["angle", "porosity"], item: Any, law: Any
) -> Reduction:
    """Return the reduction that goes with the law of a variable, R = 1 if there is neither.

    One without the other is a mistake, which is reported to `check`.
    """
    upper = (ANGLE if name == "angle" else POROSITY)[1]
    none = Reduction(np.ones_like, upper=upper)
    if item is None:
        if law is not None:
            check.fail(f"{name}_reduction is missing for {name}; expected a demand.Reduction")
        return none
    if law is None:
        check.fail(f"{name} is missing for {name}_reduction; expected a law, or 0.0 for order")
        return none
    if not isinstance(item, Reduction):
        if not callable(item):
            check.fail(f"{name}_reduction is {shown(item, 60)}; expected a demand.Reduction")
            return none
        item = Reduction(item, upper=upper)
    if item.lower > 0 or item.upper < upper * (1 - _ROUNDING):
        check.fail(
            f"{name}_reduction is defined from {item.lower:g} to {item.upper:g}; expected 0 to "
            f"{upper:g}"
        )
        return none
    if name == "porosity" and (np.diff(item(np.linspace(0, 1, _PLACES))) > _ROUNDING).any():
        text = f"{check.label}: porosity_reduction rises somewhere; the source has it fall with n"
        warn([text])
    found: Reduction = item
    return found


def capacity(check: Checker, ordered: Any, count: Floats) -> Floats:
    """Return C at counts (n,), 0 where there are none; reports to `check`, and does not warn."""
    kinds, which = np.unique(count, return_inverse=True)
    if isinstance(ordered, bool) or not (callable(ordered) or np.isscalar(ordered)):
        check.fail(
            f"ordered is {shown(ordered, 60)}; expected C(c), a function of counts or a number"
        )
        return np.zeros_like(count)
    if isinstance(ordered, OrderedLoad):
        ordered = ordered.estimate
    found = check.called("ordered", ordered, kinds) if callable(ordered) else ordered
    load = numbers(check, "ordered", found, unit="N")
    if load.shape not in ((), kinds.shape):
        check.fail(f"ordered returns shape {load.shape} for {kinds.shape} counts; expected as many")
        return np.zeros_like(count)
    load = np.where(kinds > 0, np.broadcast_to(load, kinds.shape), 0.0)
    if (load < 0).any():
        at = int(np.argmax(load < 0))
        check.fail(f"ordered is {load[at]:g} N at count {kinds[at]:g}; expected C(c) ≥ 0")
    return np.asarray(load[which])


def __getattr__(name: str) -> Any:
    """Give the functions that this module had in version 0.1, for pickles that name them here."""
    if name in ("expected_load", "rate_weighted_load"):
        return getattr(importlib.import_module("libmpm._src.studies.demand.expected"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
