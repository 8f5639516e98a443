"""Curves of exceedance of debris fields, and whether their bands cover."""

from __future__ import annotations

import csv
import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import analysis, demand
from support.demand import ANGULAR, POROUS, RARE, UNIFORM, dkw, fitted, stats
from support.functions import refused


def exact(load: Any, whole: float = 1000.0, minimum: float = 0.4) -> Any:
    """P(F > f) for F = whole R(θ) with θ uniform: R > y where |1 − 4θ/π| > √(1 − (1 − y)/a)."""
    t = np.clip((1 - np.asarray(load) / whole) / (1 - minimum), 0, 1)
    return 1 - np.sqrt(1 - t)


def simple(**changes: Any) -> demand.Exceedance:
    arguments: dict[str, Any] = {"degrees": UNIFORM, "angle_reduction": ANGULAR, "samples": 400}
    return demand.exceedance(1000.0, **(arguments | changes))


# Curves of exceedance ----------------------------------------------------------------------


def test_curve_against_closed_form() -> None:
    samples = 20_000
    curve = simple(samples=samples, load=np.linspace(300, 1100, 400))
    error = np.abs(curve.probability - exact(curve.load))
    assert error.max() < dkw(samples)
    assert error.max() > 0
    # ∫ P(F > f) df is the mean, and the law has no load below 400 N.
    mean = 400 + np.trapezoid(curve.probability[curve.load >= 400], curve.load[curve.load >= 400])
    wanted = demand.expected_load(1000.0, degrees=UNIFORM, angle_reduction=ANGULAR)
    assert wanted == pytest.approx(600)
    assert mean == pytest.approx(wanted, abs=600 * dkw(samples) + 2)


def test_every_debris_with_an_angle_of_its_own() -> None:
    """The mean stays, the variance of the mean of c independent R is that of one over c."""
    load, samples = np.linspace(0, 1000, 2001), 4000
    found = {}
    for angles in ("field", "debris"):
        curve = simple(count=8, samples=samples, load=load, angles=angles)
        density = -np.diff(curve.probability)
        middle = (load[1:] + load[:-1]) / 2
        mean = (density * middle).sum()
        found[angles] = mean, (density * (middle - mean) ** 2).sum()
    variance = 600**2 * (8 / 15 - 4 / 9)  # of 4 u (1 − u)
    assert found["field"][0] == pytest.approx(600, abs=5 * math.sqrt(variance / samples))
    assert found["debris"][0] == pytest.approx(600, abs=5 * math.sqrt(variance / 8 / samples))
    assert found["field"][1] == pytest.approx(variance, rel=0.1)
    assert found["debris"][1] == pytest.approx(variance / 8, rel=0.15)


@pytest.mark.parametrize("interval", ["wilson", "clopper-pearson"])
def test_bands_cover(interval: Any) -> None:
    """Over seeds, each load's band holds the exact probability as often as its interval does."""
    size, seeds = 100, 200
    load = np.array([410.0, 500, 700, 850, 980])
    truth = exact(load)
    held = np.zeros(len(load))
    for seed in range(seeds):
        curve = simple(samples=size, seed=seed, load=load, interval=interval)
        held += (curve.lower <= truth) & (truth <= curve.upper)
    method = "wilson" if interval == "wilson" else "exact"
    for p, times in zip(truth, held, strict=True):
        hits = np.arange(size + 1)
        ends = [stats.binomtest(k, size).proportion_ci(0.95, method) for k in hits.tolist()]
        inside = np.array([e.low <= p <= e.high for e in ends])
        coverage = float(stats.binom.pmf(hits, size, p)[inside].sum())
        if interval == "clopper-pearson":
            assert coverage >= 0.95
        low, high = stats.binom.ppf([RARE, 1 - RARE], seeds, coverage)
        assert low <= times <= high


def test_bands_cover_with_uncertain_parameters() -> None:
    """Fits to new data each time; the band must hold the true curve at least 95 % often."""
    seeds, load = 150, np.array([1500.0, 2000, 2400])
    truth = exact(load, whole=50 + 300 * 8)
    held = np.zeros(len(load))
    for seed in range(seeds):
        curve = demand.exceedance(
            fitted(np.random.default_rng(seed), noise=300.0),
            count=8,
            degrees=UNIFORM,
            angle_reduction=ANGULAR,
            samples=200,
            seed=seed,
            load=load,
        )
        held += (curve.lower <= truth) & (truth <= curve.upper)
    assert (held >= stats.binom.ppf(RARE, seeds, 0.95)).all()


def test_uncertain_parameters_widen_the_band() -> None:
    ordered = fitted(np.random.default_rng(1), noise=300.0)
    load = np.linspace(0, 4000, 101)
    arguments: dict[str, Any] = {"count": 8, "degrees": UNIFORM, "load": load}
    known = demand.exceedance(ordered, **arguments, angle_reduction=ANGULAR, draws=0)
    fit = demand.exceedance(ordered, **arguments, angle_reduction=ANGULAR)
    both = demand.exceedance(
        ordered, **arguments, angle_reduction=demand.Reduction.three_point(0.4, deviation=0.1)
    )
    # The curve is that of the estimates; only the band changes.
    np.testing.assert_array_equal(known.probability, fit.probability)
    np.testing.assert_array_equal(known.probability, both.probability)
    for narrow, wide in ((known, fit), (fit, both)):
        assert (wide.upper - wide.lower).mean() > 1.2 * (narrow.upper - narrow.lower).mean()
    assert (fit.lower <= known.lower).all() and (fit.upper >= known.upper).all()


def test_scatter_of_the_fit_joins_the_load() -> None:
    ordered = fitted(np.random.default_rng(5))
    load = ordered(4) + ordered.scatter * np.array([-2.0, -1, 0, 1, 2])
    curve = demand.exceedance(ordered, count=4, scatter=True, draws=0, load=load)
    error = np.abs(curve.probability - stats.norm.sf([-2, -1, 0, 1, 2]))
    assert error.max() < dkw(10_000)


@pytest.mark.parametrize("interval", ["wilson", "clopper-pearson"])
def test_curves_fall_within_their_bands(interval: Any) -> None:
    curve = demand.exceedance(
        fitted(np.random.default_rng(1)),
        count=stats.randint(1, 17),
        degrees=UNIFORM,
        angle_reduction=demand.Reduction.three_point(0.5, deviation=0.05),
        porosity=stats.beta(2, 5),
        porosity_reduction=POROUS,
        samples=500,
        hazard=[(0.01, 1.0), (0.002, 1.8)],
        interval=interval,
    )
    for k in (curve.rate, curve.rate_lower, curve.rate_upper):
        assert (np.diff(k) <= 0).all()
    assert (curve.rate_lower <= curve.rate).all() and (curve.rate <= curve.rate_upper).all()
    assert curve.rate[0] <= 0.012 + 1e-15 and curve.rate[-1] == 0
    assert (np.diff(curve.load) > 0).all() and curve.load[0] == 0


def test_same_seed_same_curve() -> None:
    ordered = fitted(np.random.default_rng(1))
    arguments: dict[str, Any] = {"count": stats.poisson(6), "samples": 300, "load": [800, 1600]}
    arguments |= {"degrees": UNIFORM, "angle_reduction": ANGULAR}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Poisson counts go beyond the data
        one, same, other, more = (
            demand.exceedance(ordered, **arguments, seed=seed, draws=draws)
            for seed, draws in [(4, 80), (4, 80), (5, 80), (4, 200)]
        )
    for name in ("probability", "lower", "upper"):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
    assert (one.probability != other.probability).any()
    np.testing.assert_array_equal(one.probability, more.probability)
    assert (one.upper != more.upper).any()


def test_counts_without_debris_have_no_load() -> None:
    curve = demand.exceedance(
        500.0, count=demand.Discrete([0, 3], [0.75, 0.25]), samples=4000, load=[0.0, 499.0, 500.0]
    )
    assert curve.probability[0] == curve.probability[1] == pytest.approx(0.25, abs=dkw(4000))
    assert curve.probability[2] == 0


def test_real_fields_stay_together() -> None:
    """With joint=True the rows are used as they are, each once."""
    random = np.random.default_rng(8)
    count = random.integers(1, 20, 60)
    porosity = 1 - count / 25  # the more debris, the denser
    ordered = lambda c: 100.0 * c  # noqa: E731
    columns: dict[str, Any] = {"count": count, "porosity": porosity}
    columns |= {"porosity_reduction": POROUS, "load": np.linspace(0, 2000, 50)}
    rows = demand.exceedance(ordered, joint=True, **columns)
    loads = 100.0 * count * POROUS(porosity)
    np.testing.assert_allclose(rows.probability, [np.mean(loads > f) for f in rows.load])
    assert rows.fields == 60
    # Drawn apart, dense fields lose what sparse ones should: the tail is shorter.
    apart = demand.exceedance(ordered, **columns)
    assert (apart.upper < rows.probability).any()
    assert (rows.upper - rows.lower).max() > 5 * (apart.upper - apart.lower).max()


# Rates, hazards and scenarios ---------------------------------------------------------------


def test_rate_of_fields() -> None:
    load = np.linspace(0, 1000, 11)
    bare, rated = simple(load=load), simple(load=load, rate=12.0)
    np.testing.assert_allclose(rated.rate, 12 * bare.probability)
    np.testing.assert_allclose(rated.rate_upper, 12 * bare.upper)
    np.testing.assert_allclose(rated.probability, 1 - np.exp(-12 * bare.probability))
    np.testing.assert_allclose(rated.lower, 1 - np.exp(-rated.rate_lower), atol=1e-15)


def test_hazard_of_waves() -> None:
    """A field of one load: the rate is that of the waves strong enough."""
    hazard = [(1 / 50, 1.0), (1 / 200, 1.5), (1 / 1000, 2.5)]
    load = np.array([0.0, 999, 1000, 1499, 1500, 2499, 2500])
    curve = demand.exceedance(1000.0, hazard=hazard, load=load, samples=100)
    wanted = [0.026, 0.026, 0.006, 0.006, 0.001, 0.001, 0.0]
    np.testing.assert_allclose(curve.rate, wanted, rtol=1e-12)
    assert curve.at(rate=1 / 475).load == 1500
    assert demand.exceedance(1000.0, hazard=hazard, samples=100).at(rate=0.01).load == 1000
    with pytest.raises(libmpm.SceneError, match="has no rate; expected one"):
        _ = simple().rate


def test_scenarios_add_up() -> None:
    """Total probability: the curve of waves of two strengths, made in both ways."""
    load = np.linspace(0, 2500, 251)
    calm = simple(load=load)
    storm = demand.exceedance(
        2000.0, degrees=UNIFORM, angle_reduction=ANGULAR, samples=400, load=load
    )
    together = demand.combine([(0.01, calm), (0.002, storm)])
    hazard = simple(load=load, hazard=[(0.01, 1.0), (0.002, 2.0)])
    for name in ("rate", "rate_lower", "rate_upper"):
        np.testing.assert_allclose(getattr(together, name), getattr(hazard, name), rtol=1e-12)
    truth = 0.01 * exact(load) + 0.002 * exact(load, whole=2000.0)
    assert np.abs(together.rate - truth).max() < 0.012 * dkw(400)
    # Between the loads of a curve the band takes the less favourable neighbour.
    between = demand.combine([(0.01, calm)], load=[704.0])
    k = int(np.searchsorted(load, 704.0))
    assert between.rate_upper[0] == pytest.approx(0.01 * calm.upper[k - 1])
    assert between.rate_lower[0] == pytest.approx(0.01 * calm.lower[k])
    assert calm.probability[k] <= between.rate[0] / 0.01 <= calm.probability[k - 1]


def test_load_of_a_probability() -> None:
    samples = 20_000
    curve = simple(samples=samples)
    spacing = np.diff(curve.load).max()
    for p in (0.5, 0.1, 0.01):
        found = curve.at(p)
        wanted = 1000 * (1 - 0.6 * (1 - (1 - p) ** 2))
        slope = (1 - p) * 1200  # df/dp
        assert found.load == pytest.approx(wanted, abs=slope * dkw(samples) + spacing)
        assert found.lower <= found.load <= found.upper < 1000
    assert curve.at(1 / samples).upper == math.inf  # so few fields bound nothing
    assert refused(lambda: curve.at(1e-5)) == (
        "demand.Exceedance.at: 1e-05 is below 5e-05, the least that 20000 fields can tell; use "
        "more fields, or a larger probability"
    )
    part = simple(load=[700.0, 800.0])
    assert "is exceeded at all loads up to 800 N" in refused(lambda: part.at(0.1))
    assert "is met from 700 N on" in refused(lambda: part.at(0.9))
    assert "expected either a probability or rate" in refused(curve.at)


# Studies -----------------------------------------------------------------------------------

LOADS = np.array([120.0, 80, 300, 150, 150, 90, 220, 410])


def test_curve_of_a_study() -> None:
    table = {"c": np.arange(8), "f_max": LOADS}
    for interval, method in [("wilson", "wilson"), ("clopper-pearson", "exact")]:
        curve = demand.from_study(
            table, "f_max", load=[0, 100, 150, 410], interval=interval, confidence=0.9
        )
        np.testing.assert_allclose(curve.probability, [1, 6 / 8, 3 / 8, 0])
        for k, hits in enumerate([8, 6, 3, 0]):
            low, high = stats.binomtest(hits, 8).proportion_ci(0.9, method)
            assert curve.lower[k] == pytest.approx(low, abs=1e-12)
            assert curve.upper[k] == pytest.approx(high, abs=1e-12)
    whole = demand.from_study(table, "f_max", rate=2.0)
    assert set(LOADS) <= set(whole.load)
    assert whole.rate[0] == 2
    assert "rate at" in repr(whole) and "8 fields" in repr(whole)


def test_tables_of_studies() -> None:
    pandas = pytest.importorskip("pandas")
    table = {"f_max": LOADS.tolist()}
    wanted = demand.from_study(table, "f_max")
    rows = [{"f_max": load} for load in LOADS.tolist()]
    for other in (pandas.DataFrame(table), rows):
        np.testing.assert_array_equal(demand.from_study(other, "f_max").upper, wanted.upper)
    table["f_max"][2] = math.nan
    assert "'f_max' is not a finite number" in refused(lambda: demand.from_study(table, "f_max"))
    assert demand.from_study(table, "f_max", missing="drop").fields == 7
    assert "peak" in refused(lambda: demand.from_study(table, "peak"))


class Doubled:
    """A fitted model: twice the first column."""

    def predict(self, table: Any) -> Any:
        return 2.0 * np.asarray(table)[:, 0]


def test_curve_of_a_fitted_model() -> None:
    fields = np.column_stack([np.arange(1.0, 101), np.zeros(100)])
    curve = demand.from_study(fields, model=Doubled(), load=[0, 100, 200])
    np.testing.assert_allclose(curve.probability, [1, 0.5, 0])
    wide = demand.from_study(fields, model=Doubled(), load=[200.0], scatter=50.0, seed=3)
    assert 0 < wide.probability[0] < 0.3


def test_curve_of_a_regression() -> None:
    count = np.array([1, 2, 3, 5, 8, 13])
    fit = analysis.regression({"c": count, "f_max": 20 + 7.0 * count}, "f_max", ["c"])
    new = {"c": np.arange(1, 11)}
    curve = demand.from_study(new, model=fit, load=[20 + 7 * 4.5, 20 + 7 * 9.5])
    np.testing.assert_allclose(curve.probability, [0.6, 0.1])


# Files and pictures ------------------------------------------------------------------------


def test_csv(tmp_path: Path) -> None:
    bare, rated = simple(), simple(hazard=[(0.01, 1.0), (0.003, 2.0)])
    for curve, columns in ((bare, 4), (rated, 7)):
        curve.save_csv(tmp_path / "curve.csv")
        with open(tmp_path / "curve.csv", newline="", encoding="utf-8") as file:
            head, *rows = csv.reader(file)
        assert head[:4] == ["load_N", "probability", "probability_lower", "probability_upper"]
        table = np.array(rows, dtype=float)
        assert table.shape == (len(curve.load), columns)
        wanted = [curve.load, curve.probability, curve.lower, curve.upper]
        np.testing.assert_array_equal(table[:, :4].T, wanted)
    assert [p.name for p in tmp_path.iterdir()] == ["curve.csv"]
    with pytest.raises(libmpm.OutputError, match=r"curve\.csv"):
        bare.save_csv(tmp_path / "curve.csv" / "curve.csv")


def test_picture() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure, ax = pyplot.subplots()
    curve = simple(rate=3.0)
    assert curve.plot(ax, color="k", label="fields") is ax
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("load f [N]", "exceedances per period")
    assert ax.get_yscale() == "log"
    drawn = ax.lines[0].get_ydata()
    np.testing.assert_array_equal(drawn[curve.rate > 0], curve.rate[curve.rate > 0])
    assert ax.lines[0].get_label() == "fields" and len(ax.collections) == 1
    figure.canvas.draw()
    pyplot.close(figure)


def test_examples_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).parents[2] / "docs" / "demand.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    first, second, third = blocks
    names: dict[str, Any] = {}
    exec(first, names)
    pyplot.close("all")
    assert (tmp_path / "demand.csv").is_file()
    found = names["curve"].at(rate=1 / 475)
    assert 0 < found.lower < found.load < found.upper < names["ordered"](24) * 1.6
    exec(second, names)
    assert names["fit"].coefficients["c"] == pytest.approx(300, abs=15)
    exec(third, names)
    # Of each field C(c) R(θ) R(n), with θ in radians.
    measured = names["measured"]
    angle = np.radians([row["theta_mean"] for row in measured])
    assert (angle > 0.1).all() and (angle < np.pi / 2).all()
    reductions = (
        demand.Reduction.three_point(0.5)(angle),
        [demand.Reduction.linear(0.2)(row["n"]) for row in measured],
    )
    whole = names["ordered"](np.array([row["c"] for row in measured]))
    largest = (whole * reductions[0] * reductions[1]).max()
    curve = names["curve"]
    assert curve.probability[curve.load < largest * (1 - 1e-9)].min() > 0
    assert (curve.probability[curve.load >= largest * (1 + 1e-9)] == 0).all()


# What is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": 2.5}, "count is 2.5; expected a whole number"),
        ({"count": [1, 2.5]}, "count[1] is 2.5; expected a whole number"),
        ({"count": -1}, "count reaches from -1 to -1; expected 0 or more"),
        ({"count": stats.norm(5)}, "count reaches from -inf to inf; expected 0 or more"),
        ({"count": stats.gamma(2)}, "count is a continuous law"),
        ({"count": stats.rv_discrete(values=([1, 1.5], [0.5, 0.5]))}, "not whole; write it as"),
        ({"degrees": 120.0}, "degrees reaches from 120 to 120; expected 0 to 90 degrees; fold"),
        (
            {"degrees": lambda x: 1.0},
            "degrees is a function; expected a law; write demand.Density(",
        ),
        (
            {"degrees": np.zeros((2, 2))},
            "degrees has shape (2, 2); expected a number, (n,) samples",
        ),
        ({"degrees": "steep"}, "degrees is 'steep'; expected a number or an array of numbers"),
        ({"degrees": None}, "degrees is missing for angle_reduction; expected a law, or 0.0"),
        ({"angle_reduction": None}, "angle_reduction is missing for degrees; expected a"),
        ({"angle_reduction": 0.5}, "angle_reduction is 0.5; expected a demand.Reduction"),
        (
            {"angle_reduction": POROUS},
            "angle_reduction is defined from 0 to 1; expected 0 to 1.5708",
        ),
        (
            {"porosity": stats.norm(0.4, 0.1), "porosity_reduction": POROUS},
            "porosity reaches from -inf to inf; expected 0 to 1; truncate its law, for instance",
        ),
        ({"samples": 1}, "samples is 1; expected a whole number ≥ 2"),
        ({"seed": -1}, "seed is -1; expected a whole number ≥ 0"),
        ({"confidence": 95}, "confidence is 95; expected > 0 and < 1"),
        ({"interval": "wald"}, "interval is 'wald'; choose from wilson, clopper-pearson"),
        ({"angles": "all"}, "angles is 'all'; choose from field, debris"),
        ({"load": [2.0, 1.0]}, "load is [2.0, 1.0]; expected increasing loads (m,) in N"),
        ({"rate": 0}, "rate is 0; expected > 0 per period"),
        ({"rate": 1.0, "hazard": [(1.0, 1.0)]}, "rate and hazard are both given; expected one"),
        ({"hazard": [0.1, 0.2]}, "hazard[0] is 0.1; expected (rate per period, factor)"),
        ({"hazard": [(0.1, -1)]}, "hazard[0] factor is -1; expected ≥ 0"),
        ({"hazard": []}, "hazard is empty; expected pairs (rate per period, factor)"),
        ({"scatter": True}, "scatter is True for a load that was not fitted"),
        ({"joint": True}, "angle is a law with joint=True; expected a column (n,)"),
        (
            {"angle_reduction": demand.Reduction.three_point(0.4, deviation=0.1), "draws": 20},
            "draws is 20; expected 0 or at least 80 at this confidence",
        ),
    ],
)
def test_wrong_arguments_are_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        simple(**changes)
    text = caught.value.problems
    assert all(problem.startswith("demand.exceedance: ") for problem in text)
    assert any(message in problem for problem in text), text


def test_wrong_ordered_loads_are_named() -> None:
    for ordered, message in [
        (-5.0, "ordered is -5 N at count 1; expected C(c) ≥ 0"),
        (lambda c: 10 - 3 * c, "ordered is -2 N at count 4; expected C(c) ≥ 0"),
        (lambda c: np.ones(3), "ordered returns shape (3,) for (1,) counts; expected as many"),
        (None, "ordered is None; expected C(c), a function of counts or a number"),
    ]:
        found = refused(
            lambda ordered=ordered: demand.exceedance(ordered, count=4 if callable(ordered) else 1)
        )
        assert found == f"demand.exceedance: {message}"


def test_wrong_scenarios_and_studies_are_named() -> None:
    rated = simple(rate=1.0)
    for call, message in [
        (lambda: demand.combine([]), "scenarios are empty"),
        (lambda: demand.combine([(0.1, rated)]), "expected (rate, curve without rates)"),
        (lambda: demand.combine([simple()]), "scenarios[0] is"),
        (lambda: demand.combine([(-0.1, simple())]), "scenarios[0] rate is -0.1; expected > 0"),
        (lambda: demand.from_study({"f": LOADS}), "either the response's column or a model"),
        (lambda: demand.from_study({"f": LOADS}, model=3), "model is 3; expected an object with"),
        (lambda: demand.from_study({"f": LOADS}, "f", scatter=1), "scatter is 1 without a model"),
        (lambda: demand.from_study({"f": LOADS[:1]}, "f"), "expected (n,) with n ≥ 2 fields"),
    ]:
        assert message in refused(call)


def test_angles_in_degrees_are_those_in_radians() -> None:
    folded = demand.Reduction.through([0, 30, 60, 90], [1.0, 0.5, 0.6, 1.0])
    laws = (30.0, [10.0, 40.0, 80.0], demand.Histogram([1, 3], [0, 30, 90]), stats.uniform(0, 90))
    scale = math.pi / 180
    radians = (
        30 * scale, np.radians([10.0, 40.0, 80.0]),
        demand.Histogram([1, 3], np.radians([0, 30, 90])), stats.uniform(0, math.pi / 2),
    )  # fmt: skip
    for law, before in zip(laws, radians, strict=True):
        for reduction in (ANGULAR, folded, lambda x: 1 - 0.004 * x):
            here = demand.expected_load(500.0, degrees=law, angle_reduction=reduction)
            there = (
                reduction if reduction is ANGULAR
                else (lambda x, of=reduction: of(np.degrees(x)))
            )  # fmt: skip
            with pytest.warns(DeprecationWarning, match="angle, in radians, is degrees=") as seen:
                old = demand.expected_load(500.0, angle=before, angle_reduction=there)
            assert seen[0].filename == __file__
            assert here == pytest.approx(old, rel=1e-9)
    arguments: dict[str, Any] = {"angle_reduction": ANGULAR, "samples": 200}
    one = demand.exceedance(500.0, degrees=stats.uniform(0, 90), **arguments)
    with pytest.warns(DeprecationWarning):
        two = demand.exceedance(500.0, angle=stats.uniform(0, math.pi / 2), **arguments)
    assert one.probability == pytest.approx(two.probability, abs=1e-12)


def test_angles_in_degrees_out_of_range() -> None:
    for wrong, said in (
        ({"degrees": 120.0}, "degrees reaches from 120 to 120; expected 0 to 90 degrees; fold"),
        ({"degrees": 10.0, "angle": 0.1}, "degrees is 10.0 and angle 0.1; expected one"),
        ({"degrees": 10.0, "angle_reduction": None}, "angle_reduction is missing for degrees"),
        (
            {"degrees": 10.0, "angle_reduction": demand.Reduction(np.ones_like, upper=45)},
            "angle_reduction is defined from 0 to 45; expected 0 to 90 degrees",
        ),
    ):
        arguments: dict[str, Any] = {"angle_reduction": ANGULAR} | wrong
        with pytest.raises(libmpm.SceneError, match=said):
            demand.expected_load(1.0, **arguments)
