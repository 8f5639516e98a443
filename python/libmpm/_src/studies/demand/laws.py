"""Laws of one variable of a debris field: numbers, samples, histograms, densities, scipy laws."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, shown
from libmpm._src.studies.design.arrays import Floats, numbers

__all__ = ["Density", "Discrete", "Histogram", "Law", "integral", "law_of"]

#: By how much probabilities may miss 1.
_ROUNDING = 1e-9
#: By how much an integrated density may miss 1.
_INTEGRAL = 1e-6
#: Parts that the interval of a `Density` is cut into, so that no narrow peak is overlooked.
_PARTS = 32
#: Values of a law of whole numbers that are listed at most, and the probability left out.
_LISTED, _TAIL = 1_000_000, 1e-15


class Law:
    """Base of the laws; `expect` is exact or quadrature, `sample` draws."""

    @property
    def support(self) -> tuple[float, float]:
        """Least and largest value."""
        raise NotImplementedError

    def expect(self, function: Callable[[Any], Any], breaks: Sequence[float] = ()) -> float:
        """Return ∫ f(x) P(x) dx; f is smooth between `breaks` and takes numbers and arrays."""
        raise NotImplementedError

    def sample(self, random: np.random.Generator, size: int) -> Floats:
        """Return `size` independent draws."""
        raise NotImplementedError


class Discrete(Law):
    """Values with probabilities; a Dirac delta if there is one value.

    ===========  ====  =====  ==========================================================
    parameter    unit  shape  meaning
    ===========  ====  =====  ==========================================================
    value        any   (n,)   the values, n ≥ 1
    probability  1     (n,)   theirs, ≥ 0 with sum 1; by default all the same
    ===========  ====  =====  ==========================================================

    Expectations are exact sums. Raises `SceneError`.
    """

    label: ClassVar[str] = "demand.Discrete"

    @keywords_only("demand.Discrete", 2)
    def __init__(self, value: npt.ArrayLike, probability: npt.ArrayLike | None = None) -> None:
        check = Checker(self.label)
        self.value = numbers(check, "value", value)
        if self.value.ndim != 1 or self.value.size == 0:
            check.fail(f"value has shape {self.value.shape}; expected (n,) with n ≥ 1")
        check.finish()
        if probability is None:
            self.probability = np.full(len(self.value), 1 / len(self.value))
            return
        self.probability = _shares(check, "probability", probability, len(self.value))
        total = float(self.probability.sum())
        if abs(total - 1) > _ROUNDING:
            check.fail(f"probability adds up to {total:g}; expected 1; divide it by its sum")
        check.finish()

    @property
    def support(self) -> tuple[float, float]:
        """Least and largest value."""
        return float(self.value.min()), float(self.value.max())

    def expect(self, function: Callable[[Any], Any], breaks: Sequence[float] = ()) -> float:
        """Return Σ f(x) P(x)."""
        return float(self.probability @ np.asarray(function(self.value)))

    def sample(self, random: np.random.Generator, size: int) -> Floats:
        """Return `size` independent draws."""
        return np.asarray(random.choice(self.value, size, p=self.probability))


class Histogram(Law):
    """A density that is constant in bins, for instance from ``numpy.histogram``.

    =========  =======  =======  ======================================================
    parameter  unit     shape    meaning
    =========  =======  =======  ======================================================
    weight     1        (n,)     counts or shares of the bins, ≥ 0; their sum becomes 1
    edges      any      (n+1,)   increasing edges of the bins
    =========  =======  =======  ======================================================

    Raises `SceneError`.
    """

    label: ClassVar[str] = "demand.Histogram"

    @keywords_only("demand.Histogram", 2)
    def __init__(self, weight: npt.ArrayLike, edges: npt.ArrayLike) -> None:
        check = Checker(self.label)
        self.edges = numbers(check, "edges", edges)
        if self.edges.ndim != 1 or self.edges.size < 2 or (np.diff(self.edges) <= 0).any():
            check.fail(f"edges are {shown(edges, 80)}; expected two or more increasing numbers")
        check.finish()
        weights = _shares(check, "weight", weight, len(self.edges) - 1)
        if not weights.sum() > 0:
            check.fail("weight is zero in all bins; expected some above zero")
        check.finish()
        self.probability = weights / weights.sum()

    @property
    def support(self) -> tuple[float, float]:
        """First and last edge."""
        return float(self.edges[0]), float(self.edges[-1])

    def expect(self, function: Callable[[Any], Any], breaks: Sequence[float] = ()) -> float:
        """Return ∫ f(x) P(x) dx, bin by bin."""
        density = self.probability / np.diff(self.edges)
        bins = zip(density.tolist(), pairwise(self.edges.tolist()), strict=True)
        return math.fsum(p * integral(function, ends, breaks) for p, ends in bins if p > 0)

    def sample(self, random: np.random.Generator, size: int) -> Floats:
        """Return `size` independent draws."""
        bins = random.choice(len(self.probability), size, p=self.probability)
        return np.asarray(self.edges[bins] + random.random(size) * np.diff(self.edges)[bins])


class Density(Law):
    """A density P(x) given as a function of one number.

    =========  ========  ==========================================================
    parameter  unit      meaning
    =========  ========  ==========================================================
    function   1 / unit  P(x) ≥ 0, bounded, of integral 1 from `lower` to `upper`
               of x
    lower      any       lower end
    upper      any       upper end, above `lower`
    =========  ========  ==========================================================

    Raises `SceneError`. Needs SciPy.
    """

    label: ClassVar[str] = "demand.Density"

    @keywords_only("demand.Density", 3)
    def __init__(self, function: Callable[[float], float], lower: float, upper: float) -> None:
        check = Checker(self.label)
        if not callable(function):
            check.fail(f"function is {shown(function)}; expected a callable of one number")
        self.lower, self.upper = check.number("lower", lower), check.number("upper", upper)
        if self.upper <= self.lower:
            check.fail(f"upper is {self.upper:g} with lower {self.lower:g}; expected upper > lower")
        check.finish()
        self.function = function
        places = np.linspace(self.lower, self.upper, 8 * _PARTS + 1)[1:-1]
        least = min(
            (check.called("function", lambda x: float(function(x)), x), x) for x in places.tolist()
        )
        if not least[0] >= 0:
            check.fail(f"the density is {least[0]:g} at {least[1]:g}; expected ≥ 0")
        check.finish()
        total = self.expect(lambda _: 1.0)
        if not abs(total - 1) <= _INTEGRAL:
            check.fail(f"the density has the integral {total:.7g}; expected 1; divide it by that")
        check.finish()

    @property
    def support(self) -> tuple[float, float]:
        """Both ends."""
        return self.lower, self.upper

    def expect(self, function: Callable[[Any], Any], breaks: Sequence[float] = ()) -> float:
        """Return ∫ f(x) P(x) dx."""
        cuts = (*breaks, *np.linspace(self.lower, self.upper, _PARTS + 1)[1:-1].tolist())
        weighted = lambda x: function(x) * self.function(x)  # noqa: E731
        return integral(weighted, self.support, cuts)

    def sample(self, random: np.random.Generator, size: int) -> Floats:
        """Return `size` independent draws."""
        sampling = need("scipy.stats.sampling", self.label, "studies")
        inverse = sampling.NumericalInversePolynomial(
            _Pdf(self.function), domain=self.support, random_state=random
        )
        found: Floats = np.clip(inverse.rvs(size), self.lower, self.upper)
        return found


class _Pdf:
    """A density as ``scipy.stats.sampling`` wants it."""

    def __init__(self, function: Callable[[float], float]) -> None:
        self.pdf = function


class _Continuous(Law):
    """A continuous law of scipy.stats."""

    def __init__(self, law: Any) -> None:
        self.law = law

    @property
    def support(self) -> tuple[float, float]:
        low, high = self.law.support()
        return float(low), float(high)

    def expect(self, function: Callable[[Any], Any], breaks: Sequence[float] = ()) -> float:
        # ∫ f(x) P(x) dx = ∫ f(x(u)) du over probabilities u: no density that peaks or is infinite.
        cuts = np.asarray(self.law.cdf(np.asarray(breaks))).tolist() if breaks else ()
        return integral(lambda u: function(self.law.ppf(u)), (0.0, 1.0), cuts)

    def sample(self, random: np.random.Generator, size: int) -> Floats:
        return np.asarray(self.law.rvs(size=size, random_state=random), dtype=np.float64)


def law_of(
    check: Checker,
    name: str,
    item: Any,
    *,
    lower: float,
    upper: float = math.inf,
    whole: bool = False,
    unit: str = "",
    remedy: str = "",
) -> Law:
    """Return what the caller gave as a law within [lower, upper]; reports to `check`."""
    law = _converted(check, name, item)
    if law is None:
        return Discrete([lower])
    low, high = law.support
    slack = _ROUNDING * (upper - lower) if upper < math.inf else 0.0
    if low < lower - slack or high > upper + slack:
        rule = f"{lower:g} to {upper:g}" if upper < math.inf else f"{lower:g} or more"
        check.fail(
            f"{name} reaches from {low:g} to {high:g}; expected {rule}{' ' if unit else ''}{unit}; "
            f"{remedy or 'truncate its law, for instance with scipy.stats.truncnorm'}"
        )
    elif whole and not isinstance(law, Discrete):
        check.fail(
            f"{name} is a continuous law, {shown(item, 60)}; expected whole numbers; use a "
            "discrete law "
            "such as scipy.stats.poisson, scipy.stats.randint or demand.Discrete"
        )
    elif whole and isinstance(law, Discrete):
        numbers(check, name, law.value if len(law.value) > 1 else law.value[0], whole=True)
    return law


def _converted(check: Checker, name: str, item: Any) -> Law | None:
    if isinstance(item, Law):
        return item
    if hasattr(item, "pmf") and hasattr(item, "ppf"):
        return _listed(check, name, item)
    if all(hasattr(item, method) for method in ("cdf", "ppf", "rvs", "support")):
        return _Continuous(item)
    before = len(check.problems)
    if callable(item):
        check.fail(f"{name} is a function; expected a law; write demand.Density(function, a, b)")
        return None
    array = numbers(check, name, item)
    if array.ndim > 1 or array.size == 0:
        check.fail(f"{name} has shape {array.shape}; expected a number, (n,) samples or a law")
    return Discrete(np.atleast_1d(array)) if len(check.problems) == before else None


def _listed(check: Checker, name: str, law: Any) -> Law | None:
    """Return a law of whole numbers of scipy.stats as a list, but for a tail below 1e-15."""
    low, high = law.support()
    low = low if math.isfinite(low) else law.ppf(_TAIL)
    high = high if math.isfinite(high) else law.isf(_TAIL)
    if not high - low < _LISTED:
        check.fail(f"{name} takes more than {_LISTED:,} values; expected a law of fewer")
        return None
    value = np.arange(low, high + 1, dtype=np.float64)
    probability = np.asarray(law.pmf(value))
    if abs(probability.sum() - 1) > _ROUNDING:
        check.fail(f"{name} takes values that are not whole; write it as a demand.Discrete")
        return None
    return Discrete(value, probability / probability.sum())


def _shares(check: Checker, name: str, item: Any, count: int) -> Floats:
    """Return `count` numbers ≥ 0; raises `SceneError`."""
    array = numbers(check, name, item, lower=0)
    check.finish()
    if array.shape != (count,):
        check.fail(f"{name} has shape {array.shape}; expected ({count},)")
    check.finish()
    return array


def integral(
    function: Callable[[Any], Any], ends: tuple[float, float], cuts: Sequence[float]
) -> float:
    """Return ∫ f between the ends, piece by piece between the cuts."""
    integrate = need("scipy.integrate", "demand", "studies")
    low, high = ends
    inside = sorted({x for x in cuts if low < x < high})
    pieces = pairwise([low, *inside, high])
    quad = integrate.quad
    return math.fsum(quad(function, a, b, epsabs=1e-13, epsrel=1e-11)[0] for a, b in pieces)
