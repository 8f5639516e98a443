"""How often the load of a debris field is larger than f: Monte Carlo, and results of studies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import Checker, shown
from libmpm._src.studies.analysis.regression import Prediction
from libmpm._src.studies.analysis.tables import Missing, Table, sample
from libmpm._src.studies.demand.curves import (
    METHODS,
    Exceedance,
    Hits,
    Interval,
    band,
    enough,
    level_of,
    loads_of,
)
from libmpm._src.studies.demand.laws import Discrete, Law
from libmpm._src.studies.demand.obliquity import in_radians
from libmpm._src.studies.demand.ordered import (
    OrderedLoad,
    Reduction,
    capacity,
    field_law,
    reduction_of,
)
from libmpm._src.studies.design.arrays import Floats, numbers

__all__ = ["exceedance", "from_study"]

#: Fields that are drawn where the caller does not say how many.
_SAMPLES = 10_000
#: Samples beyond which no memory holds them.
_MOST_SAMPLES = 100_000_000
#: Loads of a curve: evenly spaced ones, and as many at evenly spaced logarithms of probability.
_LOADS = 200
#: Loads beyond the largest, where only drawn parameters lead.
_BEYOND = 50


@keywords_only("demand.exceedance", 1, method=False)
def exceedance(
    ordered: float | Callable[[Any], Any],
    *,
    count: Any = 1,
    degrees: Any = None,
    angle: Any = None,
    angle_reduction: Reduction | Callable[[Floats], Any] | None = None,
    porosity: Any = None,
    porosity_reduction: Reduction | Callable[[Floats], Any] | None = None,
    angles: Literal["field", "debris"] = "field",
    joint: bool = False,
    samples: int | None = None,
    draws: int | None = None,
    scatter: bool = False,
    rate: float | None = None,
    hazard: Iterable[tuple[float, float]] | None = None,
    load: npt.ArrayLike | None = None,
    confidence: float = 0.95,
    interval: Interval = "wilson",
    seed: int = 0,
) -> Exceedance:
    """Return how often the load F = C(c) R(θ) R(n) of random fields exceeds f, by Monte Carlo.

    ====================  ===========  ==========================================================
    argument              default      meaning
    ====================  ===========  ==========================================================
    ordered, count,       1, order     as in `expected_load`
    degrees, porosity
    and the reductions
    angles                "field"      one angle a field; "debris": every debris draws its own and
                                       their R(θ) are averaged (the same mean, less spread)
    joint                 False        True: count, degrees and porosity are columns (n,) of n real
                                       fields, each used once, so that what depends on each other
                                       stays together and the band knows how few they are
    samples               10,000       fields drawn, ≥ 2; not with `joint`
    draws                 enough       drawn sets of the parameters of `ordered` and the
                                       reductions; 0 leaves their uncertainty out of the band
    scatter               False        True: adds the normal scatter of an `OrderedLoad` to C(c)
    rate                  -            fields per period, > 0
    hazard                -            waves as pairs (rate per period, factor): the rate Δλ of a
                                       class of waves and the factor ≥ 0 on the load in it, for
                                       instance its speed over the speed of `ordered`
    load                  from 0 to    loads f of the curve, (m,) N, increasing, ≥ 0
                          the largest
    confidence            0.95         level of the band at each load, between 0 and 1
    interval              "wilson"     or "clopper-pearson", which never covers less than stated
    seed                  0            ≥ 0; the same seed gives the same curve
    ====================  ===========  ==========================================================

    With `hazard` the rate of exceedance is Σ Δλ_k P(s_k F > f). A wave that finds no debris is a
    count of 0, with F = 0. With uncertain parameters half of 1 − confidence is spent on the
    sampling and half on the parameters; several waves share the sampling's half. Both err to the
    wide side.

    Arrays of samples without `joint` are laws like others: the band then tells the error of the
    Monte Carlo, not how well so few samples stand for all fields.

    Raises `SceneError`. Needs SciPy and statsmodels. Source: Bonus (2023) 11.2, eq. 11.5 for each
    field instead of on average.
    """
    check = Checker("demand.exceedance")
    check.choice("angles", angles, ("field", "debris"))
    seed = check.integer("seed", seed)
    angle, angle_reduction = in_radians(check, degrees, angle, angle_reduction)
    request = _Request.checked(check, rate, hazard, load, confidence, interval)
    check.instance("joint", joint, (bool, np.bool_), "True or False")
    check.instance("scatter", scatter, (bool, np.bool_), "True or False")
    check.finish()
    models: list[Any] = [
        ordered,
        reduction_of(check, "angle", angle_reduction, angle),
        reduction_of(check, "porosity", porosity_reduction, porosity),
    ]
    laws = {
        "count": field_law(check, "count", count),
        "angle": field_law(check, "angle", 0.0 if angle is None else angle),
        "porosity": field_law(check, "porosity", 0.0 if porosity is None else porosity),
    }
    if scatter and not isinstance(ordered, OrderedLoad):
        check.fail("scatter is True for a load that was not fitted; expected a demand.OrderedLoad")
    uncertain = [getattr(model, "uncertain", False) for model in models]
    least = request.draws
    draws = check.integer("draws", 2 * least if draws is None else draws)
    if any(uncertain) and 0 < draws < least:
        check.fail(f"draws is {draws}; expected 0 or at least {least} at this confidence")
    # Streams of their own: more draws or another scatter leave the fields as they are.
    streams = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(3))
    of_fields, of_parameters, of_scatter = streams
    check.finish()
    if joint:
        fields = _rows(check, laws, angles, samples)
        check.finish()
    else:
        size = check.integer("samples", _SAMPLES if samples is None else samples, lower=2)
        if size > _MOST_SAMPLES:
            check.fail(f"samples is {size:g}; expected at most {_MOST_SAMPLES:g}, some GB")
        check.finish()
        fields = _Fields.drawn(of_fields, laws, size, angles == "debris")
    if isinstance(ordered, OrderedLoad):
        ordered.warn_beyond(fields.count)
    noise = np.zeros(len(fields.count))
    if scatter and isinstance(ordered, OrderedLoad):
        noise = ordered.scatter * of_scatter.standard_normal(len(noise))

    def loads(of_count: Any, of_angle: Reduction, of_porosity: Reduction) -> Floats:
        whole = np.maximum(capacity(check, of_count, fields.count) + noise, 0.0)
        check.finish()
        whole = np.where(fields.count > 0, whole, 0.0)
        return np.asarray(whole * fields.reduced(of_angle) * of_porosity(fields.porosity))

    sets = [tuple(models)]
    if any(uncertain):
        columns = [
            model.draws(of_parameters, draws) if drawn else [model] * draws
            for model, drawn in zip(models, uncertain, strict=True)
        ]
        sets += zip(*columns, strict=True)
    return request.curve([partial(loads, *one) for one in sets])


@keywords_only("demand.from_study", 2, method=False)
def from_study(
    table: Table,
    response: str | None = None,
    *,
    model: Any = None,
    scatter: float = 0.0,
    missing: Missing = "refuse",
    rate: float | None = None,
    hazard: Iterable[tuple[float, float]] | None = None,
    load: npt.ArrayLike | None = None,
    confidence: float = 0.95,
    interval: Interval = "wilson",
    seed: int = 0,
) -> Exceedance:
    """Return the curve of exceedance of a study, from its results or from a model fitted to some.

    ==========  =========  ======================================================================
    argument    default    meaning
    ==========  =========  ======================================================================
    table       -          one row a field, n ≥ 2: a mapping of columns, NumPy records, a pandas
                           frame, a list of dictionaries; with `model` what its ``predict`` takes
    response    -          column of the loads, N, for instance "f_max"
    model       -          instead of `response`: an `analysis.Regression` or another fitted model;
                           ``model.predict(table)`` gives the load of each field in N
    scatter     0          with `model`: standard deviation, N, of normal scatter about it, for
                           instance ``regression.residual_error``
    missing     "refuse"   rows without a load, as of failed runs: an error, or "drop" them
    ==========  =========  ======================================================================

    The remaining arguments are those of `exceedance`. The rows are taken as independent draws of
    fields; the band covers how few they are, not the model's error. Raises `SceneError`.
    """
    check = Checker("demand.from_study")
    request = _Request.checked(check, rate, hazard, load, confidence, interval)
    scatter = check.number("scatter", scatter, lower=0, unit="N")
    seed = check.integer("seed", seed)
    if (response is None) == (model is None):
        check.fail("expected either the response's column or a model")
    elif model is not None and not hasattr(model, "predict"):
        check.fail(f"model is {shown(model, 60)}; expected an object with predict(table)")
    elif scatter > 0 and model is None:
        check.fail(f"scatter is {scatter:g} without a model; expected 0, as results scatter anyway")
    check.finish()
    if response is not None:
        loads = sample(check, table, [response], missing)[1][:, 0]
    else:
        found = model.predict(table)
        mean = found.mean if isinstance(found, Prediction) else found
        loads = numbers(check, "the model's load", np.asarray(mean), unit="N")
    if not check.problems and (loads.ndim != 1 or len(loads) < 2):
        check.fail(f"the loads have shape {loads.shape}; expected (n,) with n ≥ 2 fields")
    check.finish()
    if scatter:
        loads = loads + scatter * np.random.default_rng(seed).standard_normal(len(loads))
    return request.curve([lambda: loads])


# What is asked of a curve -------------------------------------------------------------------


@dataclass(frozen=True)
class _Request:
    """Checked arguments that all curves from samples share."""

    waves: tuple[tuple[float, float], ...]
    rated: bool
    load: Floats | None
    confidence: float
    interval: Interval

    @classmethod
    def checked(
        cls,
        check: Checker,
        rate: float | None,
        hazard: Iterable[tuple[float, float]] | None,
        load: npt.ArrayLike | None,
        confidence: float,
        interval: str,
    ) -> _Request:
        """Return the arguments; reports what is wrong with them to `check`."""
        confidence = level_of(check, confidence)
        check.choice("interval", interval, tuple(METHODS))
        waves = [(1.0, 1.0)]
        positive: dict[str, Any] = {"lower": 0, "lower_open": True, "unit": "per period"}
        if rate is not None and hazard is not None:
            check.fail(
                "rate and hazard are both given; expected one: waves have rates of their own"
            )
        elif rate is not None:
            waves = [(check.number("rate", rate, **positive), 1.0)]
        elif hazard is not None:
            waves = []
            for k, pair in enumerate(check.items("hazard", hazard, "pairs (rate, factor)")):
                if not isinstance(pair, tuple | list | np.ndarray) or len(pair) != 2:
                    check.fail(
                        f"hazard[{k}] is {shown(pair, 60)}; expected (rate per period, factor)"
                    )
                    continue
                number = check.number(f"hazard[{k}] rate", pair[0], **positive)
                waves.append((number, check.number(f"hazard[{k}] factor", pair[1], lower=0)))
            if not waves and not check.problems:
                check.fail("hazard is empty; expected pairs (rate per period, factor)")
        rated = rate is not None or hazard is not None
        places = loads_of(check, load)
        return cls(tuple(waves), rated, places, confidence, interval)  # type: ignore[arg-type]

    @property
    def draws(self) -> int:
        """Draws of the parameters that the band needs at least."""
        return enough(1 - self.confidence)

    def curve(self, samples: Sequence[Callable[[], Floats]]) -> Exceedance:
        """Return the curve of loads (n,) with the estimates and with each set of parameters."""
        places = self.load
        if places is None:
            drawn = max((float(found().max()) for found in samples[1:]), default=0.0)
            places = _places(np.sort(samples[0]()), drawn, [factor for _, factor in self.waves])
        counts: list[list[npt.NDArray[np.int64]]] = [[] for _ in self.waves]
        fields = 0
        for found in samples:
            ordered = np.sort(found())
            fields = len(ordered)
            for rows, (_, factor) in zip(counts, self.waves, strict=True):
                rows.append(fields - np.searchsorted(ordered * factor, places, side="right"))
        strata = [
            (number, Hits(np.array(rows), fields, self.interval))
            for (number, _), rows in zip(self.waves, counts, strict=True)
        ]
        middle = np.sum([number * (hits.count[0] / fields) for number, hits in strata], axis=0)
        low, high = band(strata, 1 - self.confidence)
        hits = None if self.rated else strata[0][1]
        finest = min(number for number, _ in self.waves) / fields
        curves = (middle, low, high)
        return Exceedance(places, self.confidence, fields, self.rated, curves, finest, hits)


def _places(ordered: Floats, drawn: float, factors: Sequence[float]) -> Floats:
    """Return loads for a curve of sorted samples: evenly spaced, and dense in the tail.

    Every wave has its own tail. The loads extend to `drawn`, the largest with drawn parameters, for
    the band.
    """
    count, strongest = len(ordered), max(factors)
    largest, beyond = (max(float(end) * strongest, 0.0) for end in (ordered[-1], drawn))
    each = max(_LOADS // len(factors), 2)
    above = np.unique(np.geomspace(1, count, each).astype(np.int64))
    tails = [np.maximum(ordered[count - above] * factor, 0.0) for factor in factors]
    more = np.geomspace(largest, beyond, _BEYOND) if beyond > largest > 0 else np.empty(0)
    return np.unique(np.concatenate([np.linspace(0.0, largest or 1.0, _LOADS), *tails, more]))


# Fields -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Fields:
    """Drawn or real fields."""

    count: Floats
    """Debris of each field, (n,)."""
    angle: Floats
    """One angle a field, (n,), or the angles of all debris one field after the other."""
    porosity: Floats
    """Porosity of each field, (n,)."""
    each: bool
    """True if `angle` has one entry a debris."""

    @classmethod
    def drawn(
        cls, random: np.random.Generator, laws: dict[str, Law], size: int, each: bool
    ) -> _Fields:
        """Draw `size` fields, with an angle for `each` debris or one a field."""
        count = laws["count"].sample(random, size)
        porosity = laws["porosity"].sample(random, size)
        angles = int(count.sum()) if each else size
        return cls(count, laws["angle"].sample(random, angles), porosity, each)

    def reduced(self, reduction: Reduction) -> Floats:
        """Return R(θ) of each field, averaged over its debris."""
        found = reduction(self.angle)
        if not self.each:
            return np.asarray(found)
        owner = np.repeat(np.arange(len(self.count)), self.count.astype(np.int64))
        total = np.bincount(owner, found, minlength=len(self.count))
        return np.asarray(total / np.maximum(self.count, 1.0))


def _rows(check: Checker, laws: dict[str, Law], angles: str, samples: Any) -> _Fields:
    """Return real fields, whose variables came as columns of equal length."""
    columns = {}
    for name, law in laws.items():
        if isinstance(law, Discrete) and np.ptp(law.probability) == 0:
            columns[name] = law.value
        else:
            check.fail(f"{name} is a law with joint=True; expected a column (n,) of real fields")
    size = max((len(c) for c in columns.values()), default=0)
    for name, column in columns.items():
        if len(column) not in (1, size):
            check.fail(f"{name} has {len(column)} entries and another {size}; expected as many")
    if size < 2:
        check.fail(f"joint is True with {size} fields; expected columns of 2 or more")
    if angles != "field":
        check.fail("angles is 'debris' with joint=True; expected 'field': one angle a row")
    if samples is not None:
        check.fail(
            f"samples is {shown(samples)} with joint=True; leave it out: each row is used once"
        )
    if check.problems:
        return _Fields(np.ones(1), np.zeros(1), np.zeros(1), False)
    spread = {name: np.broadcast_to(c, (size,)) for name, c in columns.items()}
    return _Fields(**spread, each=False)
