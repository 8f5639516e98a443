"""Curves of exceedance with confidence bands, and their combination over scenarios."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, shown
from libmpm._src.errors import SceneError
from libmpm._src.output.atomic_files import replacing
from libmpm._src.studies.analysis import plots
from libmpm._src.studies.design.arrays import Floats, numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "METHODS",
    "Exceedance",
    "Hits",
    "Interval",
    "LoadAt",
    "band",
    "combine",
    "enough",
    "level_of",
    "loads_of",
]

Interval = Literal["wilson", "clopper-pearson"]
#: Names of the intervals in statsmodels.
METHODS = {"wilson": "wilson", "clopper-pearson": "beta"}
#: Part by which rounding may move a probability.
_ROUNDING = 1e-9


class LoadAt(NamedTuple):
    """A load of stated probability, N, with the band read across at that probability."""

    load: float
    """The load that is exceeded with that probability."""
    lower: float
    """Where the lower curve has it."""
    upper: float
    """Where the upper curve has it; infinite where the data cannot bound it."""


@dataclass(frozen=True, eq=False, repr=False)
class Hits:
    """Numbers of fields above each load: what a band is made of."""

    count: npt.NDArray[np.int64]
    """(1 + draws, m): first with the parameters' estimates, then with drawn parameters."""
    fields: int
    """Fields behind every number."""
    interval: Interval

    def bands(self, level: float) -> tuple[Floats, Floats]:
        """Return bounds of the probability for the sampling alone, each (1 + draws, m)."""
        proportion = need("statsmodels.stats.proportion", "demand", "studies")
        kinds, which = np.unique(self.count, return_inverse=True)
        method = METHODS[self.interval]
        low, high = proportion.proportion_confint(kinds, self.fields, level, method)
        # None and all bound exactly; rounding would put a bound inside the estimate.
        low, high = np.where(kinds == 0, 0.0, low), np.where(kinds == self.fields, 1.0, high)
        shape = self.count.shape
        return np.asarray(low)[which].reshape(shape), np.asarray(high)[which].reshape(shape)


@dataclass(frozen=True, eq=False, repr=False)
class Exceedance:
    """A curve of exceedance with its confidence band.

    Made by `exceedance`, `from_study` and `combine`. Without rates, `probability` is P(F > f) of
    one field. With rates it is the probability of at least one exceedance in one period,
    1 − exp(−rate) for events that come independently, and `rate` is the mean number of exceedances
    in it.
    """

    label: ClassVar[str] = "demand.Exceedance"

    load: Floats
    """Loads f, (m,) N, increasing."""
    confidence: float
    """Level of the band at each load."""
    fields: int
    """Number of fields behind the curve; the smallest of those combined."""
    rated: bool
    """True if the curve has rates."""
    _curves: tuple[Floats, Floats, Floats]
    _finest: float
    _hits: Hits | None = None

    @property
    def probability(self) -> Floats:
        """P(F > f), (m,); with rates, in one period."""
        return self._probability(0)

    @property
    def lower(self) -> Floats:
        """Lower bound of `probability`, (m,)."""
        return self._probability(1)

    @property
    def upper(self) -> Floats:
        """Upper bound of `probability`, (m,)."""
        return self._probability(2)

    @property
    def rate(self) -> Floats:
        """Mean number of exceedances in a period, (m,); raises `SceneError` without rates."""
        return self._rate(0)

    @property
    def rate_lower(self) -> Floats:
        """Lower bound of `rate`, (m,)."""
        return self._rate(1)

    @property
    def rate_upper(self) -> Floats:
        """Upper bound of `rate`, (m,)."""
        return self._rate(2)

    @keywords_only("demand.Exceedance.at", 1)
    def at(self, probability: float | None = None, *, rate: float | None = None) -> LoadAt:
        """Return the load that is exceeded with a probability, or at a rate such as 1/475.

        That is the smallest load of the curve with no more than it; in the band `upper` is read
        likewise, and `lower` is the largest load with more than it, so both lie on the wide side by
        up to the distance of the curve's loads. Raises `SceneError` where the fields are too few
        for so rare a load, or the curve does not reach it.
        """
        check = Checker(f"{self.label}.at")
        if (probability is None) == (rate is None):
            check.fail("expected either a probability or rate=...")
            check.finish()
        positive: dict[str, Any] = {"lower": 0, "lower_open": True}
        if rate is not None:
            wanted = check.number("rate", rate, unit="per period", **positive)
            self._rate(0)
        else:
            wanted = check.number("probability", probability, upper=1, **positive)
            if self.rated:
                wanted = -math.log1p(-wanted) if wanted < 1 else math.inf
        check.finish()
        middle, low, high = self._curves
        if wanted < self._finest * (1 - _ROUNDING):
            check.fail(
                f"{wanted:g} is below {self._finest:.3g}, the least that {self.fields} fields can "
                "tell; use more fields, or a larger probability"
            )
        elif wanted < middle[-1]:
            check.fail(
                f"{wanted:g} is exceeded at all loads up to {self.load[-1]:g} N, the last of the "
                "curve; give larger loads"
            )
        elif wanted >= middle[0] and self.load[0] > 0:
            check.fail(
                f"{wanted:g} is met from {self.load[0]:g} N on, the first load of the curve; give "
                "smaller loads"
            )
        check.finish()
        loads = [0.0, *self.load.tolist(), math.inf]
        # Entry k + 1 is the first of at most `wanted`, entry k the last of more.
        first = [int(np.sum(curve > wanted)) for curve in (middle, low, high)]
        return LoadAt(loads[first[0] + 1], loads[first[1]], loads[first[2] + 1])

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the rate, or without rates the probability, with its band and return the axes.

        `style` goes to ``Axes.plot``.
        """
        ax = plots.axes(ax, "load f [N]", "exceedances per period" if self.rated else "P(F > f)")
        middle, low, high = self._curves
        (line,) = ax.plot(self.load, np.where(middle > 0, middle, np.nan), **style)
        shown = middle[middle > 0]
        floor = 0.5 * float(shown.min()) if shown.size else 1e-3
        ax.fill_between(
            self.load, np.maximum(low, floor), high, color=line.get_color(), alpha=0.2, linewidth=0
        )
        ax.set_yscale("log")
        return ax

    @keywords_only("demand.Exceedance.save_csv", 1)
    def save_csv(self, path: str | Path) -> None:
        """Write load, probability and band, and the rates if there are any, as CSV.

        Either the whole file appears or nothing changes; raises `OutputError`.
        """
        columns = {
            "load_N": self.load,
            "probability": self.probability,
            "probability_lower": self.lower,
            "probability_upper": self.upper,
        }
        if self.rated:
            columns |= {
                "rate_per_period": self.rate,
                "rate_lower": self.rate_lower,
                "rate_upper": self.rate_upper,
            }
        rows = np.column_stack(list(columns.values())).tolist()
        lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
        with replacing(Path(path)) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def __repr__(self) -> str:
        """Return the curve in a line."""
        kind = "rate" if self.rated else "probability"
        return (
            f"{self.label}({kind} at {len(self.load)} loads from {self.load[0]:.5g} to "
            f"{self.load[-1]:.5g} N, {self.fields} fields, {self.confidence:.0%} band)"
        )

    def _probability(self, k: int) -> Floats:
        return -np.expm1(-self._curves[k]) if self.rated else self._curves[k]

    def _rate(self, k: int) -> Floats:
        if not self.rated:
            raise SceneError(
                f"{self.label}: the curve has no rate; expected one; give rate= or hazard= when it "
                "is made, or combine it"
            )
        return self._curves[k]


@keywords_only("demand.combine", 1, method=False)
def combine(
    scenarios: Iterable[tuple[float, Exceedance]],
    *,
    load: npt.ArrayLike | None = None,
    confidence: float = 0.95,
) -> Exceedance:
    """Return the rate of exceedance of several scenarios, Σ Δλ_k P(F > f | k).

    `scenarios` are pairs of a rate Δλ > 0 per period and the curve, without rates, of the fields in
    that scenario. `load` (m,) N are the loads of the result, by default those of all curves.
    Between the loads of a curve its probability is linear and its band that of the less favourable
    neighbour; beyond its last load it keeps the last probability. The band shares 1 − confidence
    among the scenarios, so it errs to the wide side.

    Raises `SceneError`. Source: Bonus (2023) 11.1, p(EDP) = Σ p(EDP | IM) Δλ.
    """
    check = Checker("demand.combine")
    pairs = check.items("scenarios", scenarios, "pairs of a rate and a curve")
    check.finish()
    confidence = level_of(check, confidence)
    if not pairs:
        check.fail("scenarios are empty; expected pairs of a rate and a curve")
    found: list[tuple[float, Exceedance, Hits]] = []
    for k, pair in enumerate(pairs):
        number, curve = pair if isinstance(pair, tuple | list) and len(pair) == 2 else (pair, None)
        if not isinstance(curve, Exceedance) or curve._hits is None:
            check.fail(f"scenarios[{k}] is {shown(pair)}; expected (rate, curve without rates)")
            continue
        positive: dict[str, Any] = {"lower": 0, "lower_open": True, "unit": "per period"}
        each = check.number(f"scenarios[{k}] rate", number, **positive)
        found.append((each, curve, curve._hits))
        drawn, least = len(curve._hits.count) - 1, enough((1 - confidence) / len(pairs))
        if 0 < drawn < least:
            check.fail(
                f"scenarios[{k}] has {drawn} draws; expected {least} for {len(pairs)} scenarios; "
                f"make it with draws={least}"
            )
    check.finish()
    places = loads_of(check, load)
    check.finish()
    if places is None:
        places = np.unique(np.concatenate([curve.load for _, curve, _ in found]))
    total = np.zeros((3, len(places)))
    for each, curve, hits in found:
        low, high = band([(1.0, hits)], (1 - confidence) / len(pairs))
        right = np.searchsorted(curve.load, places, side="left")
        left = np.searchsorted(curve.load, places, side="right")
        # The probability falls: at the next load it is no larger, at the one before no smaller.
        total[0] += each * np.interp(places, curve.load, curve._curves[0])
        total[1] += each * np.append(low, 0.0)[right]
        total[2] += each * np.insert(high, 0, 1.0)[left]
    fewest = min(curve.fields for _, curve, _ in found)
    finest = min(each * curve._finest for each, curve, _ in found)
    return Exceedance(places, confidence, fewest, True, (total[0], total[1], total[2]), finest)


def band(strata: Sequence[tuple[float, Hits]], level: float) -> tuple[Floats, Floats]:
    """Return bounds of Σ rate × probability that fail together with probability `level`."""
    drawn = len(strata[0][1].count) > 1
    sampling = (level / 2 if drawn else level) / len(strata)
    bounds = [(number, *hits.bands(sampling)) for number, hits in strata]
    low = np.sum([number * lowest for number, lowest, _ in bounds], axis=0)
    high = np.sum([number * highest for number, _, highest in bounds], axis=0)
    if not drawn:
        return low[0], high[0]
    return (
        np.minimum(low[0], np.quantile(low[1:], level / 4, axis=0)),
        np.maximum(high[0], np.quantile(high[1:], 1 - level / 4, axis=0)),
    )


def enough(level: float) -> int:
    """Return the draws of which `level` / 4, the share beyond a bound, is one."""
    return math.ceil(4 / level * (1 - 1e-9)) if level > 0 else 0


def level_of(check: Checker, confidence: Any) -> float:
    """Return a level of confidence between 0 and 1; reports to `check`."""
    ends: dict[str, Any] = {"lower": 0, "upper": 1, "lower_open": True, "upper_open": True}
    return check.number("confidence", confidence, **ends)


def loads_of(check: Checker, load: npt.ArrayLike | None) -> Floats | None:
    """Return the loads of a curve that the caller asks for, if any; reports to `check`."""
    if load is None:
        return None
    places = numbers(check, "load", load, lower=0, unit="N")
    if not check.problems and (
        places.ndim != 1 or places.size == 0 or (np.diff(places) <= 0).any()
    ):
        check.fail(f"load is {shown(load)}; expected increasing loads (m,) in N")
    return places
