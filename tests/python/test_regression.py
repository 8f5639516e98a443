"""Regression of responses, tests of residuals, and statistics, against known answers."""

from __future__ import annotations

import contextlib
import io
import math
import pickle
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import analysis
from libmpm._src.studies.study.table import StudyResult

pytest.importorskip("statsmodels")

Table = dict[str, Any]


def refused(call: Callable[[], Any]) -> list[str]:
    with pytest.raises(libmpm.SceneError) as caught:
        call()
    return caught.value.problems


def fields(seed: int = 1, rows: int = 34, noise: float = 10.0) -> Table:
    """Return debris fields with f_max = 100 + 12 c + 80 √theta15 - 60 log n + noise."""
    random = np.random.default_rng(seed)
    table: Table = {
        "c": random.integers(4, 25, rows).astype(float),
        "theta15": random.uniform(0.05, 0.9, rows),
        "n": random.uniform(0.2, 0.9, rows),
    }
    exact = 100 + 12 * table["c"] + 80 * np.sqrt(table["theta15"]) - 60 * np.log(table["n"])
    return table | {"f_max": exact + noise * random.standard_normal(rows)}


def design_of(table: Table) -> Any:
    """Return the design matrix of the model "multi"."""
    one = np.ones(len(table["c"]))
    return np.column_stack([one, table["c"], np.sqrt(table["theta15"]), np.log(table["n"])])


# White's test ------------------------------------------------------------------------------

#: Bonus (2023) 10.4: model, variable, LM, its p, F, its p. The p of F in the second row is printed
#: as 0.686, that of a later row.
PUBLISHED = [
    ("linear", "c", 1.4, 0.497, 0.666, 0.521),
    ("linear", "log n", 2.379, 0.304, 1.166, 0.325),
    ("linear", "sqrt theta15", 4.081, 0.13, 2.114, 0.138),
    ("dual", "c", 3.519, 0.172, 1.79, 0.184),
    ("dual", "log n", 0.816, 0.665, 0.381, 0.686),
    ("dual", "sqrt theta15", 4.459, 0.108, 2.34, 0.113),
    ("multi", "c", 0.266, 0.876, 0.122, 0.886),
    ("multi", "log n", 1.629, 0.443, 0.78, 0.467),
    ("multi", "sqrt theta15", 0.577, 0.75, 0.267, 0.767),
]


@pytest.mark.parametrize(("model", "variable", "lm", "lm_p", "f", "f_p"), PUBLISHED)
def test_published_table_of_white_tests(
    model: str, variable: str, lm: float, lm_p: float, f: float, f_p: float
) -> None:
    """V4: with 34 observations, LM gives the other three columns."""
    found = analysis.WhiteTest.from_statistic(lm, 34, threshold=0.2)
    assert found.lm_p == pytest.approx(lm_p, abs=2e-3)
    assert found.f == pytest.approx(f, abs=2e-3)
    assert found.f_p == pytest.approx(f_p, abs=2e-3)
    # The decisions are those of a threshold of 0.2; none is made at 0.05.
    uneven = {("linear", "sqrt theta15"), ("dual", "c"), ("dual", "sqrt theta15")}
    assert found.heteroscedastic == ((model, variable) in uneven)
    assert not analysis.WhiteTest.from_statistic(lm, 34).heteroscedastic


@pytest.mark.parametrize("n", [4, 5, 34, 500])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_identities_of_white_tests(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    x, e = random.uniform(1, 3, n), random.standard_normal(n)
    found = analysis.white_test(e, x)
    assert found.observations == n
    assert found.lm_p == pytest.approx(math.exp(-found.lm / 2), rel=1e-10)
    assert found.f == pytest.approx(found.lm / 2 * (n - 3) / (n - found.lm), rel=1e-10)
    tail = (1 + 2 * found.f / (n - 3)) ** (-(n - 3) / 2)
    assert found.f_p == pytest.approx(tail, rel=1e-10)
    again = analysis.WhiteTest.from_statistic(found.lm, n)
    for key in ("lm_p", "f", "f_p"):
        assert getattr(again, key) == pytest.approx(getattr(found, key), rel=1e-10)
    # LM is n R² of the squares on 1, x, x².
    square = e**2
    powers = np.column_stack([np.ones(n), x, x**2])
    rest = square - powers @ np.linalg.lstsq(powers, square)[0]
    share = 1 - (rest @ rest) / ((square - square.mean()) ** 2).sum()
    assert found.lm == pytest.approx(n * share, rel=1e-9)


def test_white_test_does_not_depend_on_units() -> None:
    random = np.random.default_rng(4)
    x, e = random.uniform(1, 3, 34), random.standard_normal(34)
    lm = analysis.white_test(e, x).lm
    assert analysis.white_test(1e6 * e, 1e-3 * x).lm == pytest.approx(lm, rel=1e-9)
    assert analysis.white_test(e, x + 1e6).lm == pytest.approx(lm, rel=1e-6)


def test_white_test_sees_uneven_variance() -> None:
    random = np.random.default_rng(5)
    x = random.uniform(1, 10, 200)
    even = random.standard_normal(200)
    assert not analysis.white_test(even, x).heteroscedastic
    assert analysis.white_test(even * x, x).heteroscedastic


def test_level_of_white_tests() -> None:
    """Of tests on residuals without any pattern, the share of the threshold is significant."""
    random = np.random.default_rng(6)
    x = random.uniform(1, 10, 100)
    tests = [analysis.white_test(random.standard_normal(100), x) for _ in range(400)]
    share = np.mean([t.f_p < 0.2 for t in tests])
    assert share == pytest.approx(0.2, abs=4 * math.sqrt(0.2 * 0.8 / 400))


def test_white_tests_that_are_refused() -> None:
    e = [1.0, -2.0, 0.5, 0.3]
    cases = [
        ((e, [1.0, 2.0]), "there are 4 residuals and 2 values of the variable"),
        ((e[:3], e[:3]), "expected as many, 4 or more"),
        ((e, [0.0, 1.0, 0.0, 1.0]), "the variable has 2 different value(s); expected three"),
        ((e, [0.0, 1.0, math.nan, 1.0]), "rows 2 are not finite"),
        (([1.0, -1.0, 1.0, 1.0], [1.0, 2.0, 3.0, 4.0]), "the residuals have all the same size"),
    ]
    for arguments, words in cases:
        (problem,) = refused(lambda a=arguments: analysis.white_test(*a))
        assert problem.startswith("analysis.white_test: ") and words in problem
    assert (
        "lm is 34; expected ≥ 0 and < 34"
        in refused(lambda: analysis.WhiteTest.from_statistic(34.0, 34))[0]
    )


# Regression --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "terms"),
    [
        ("linear", ["c"]),
        ("dual", ["sqrt theta15", "log n"]),
        ("multi", ["c", "sqrt theta15", "log n"]),
        (["sqrt c", "inverse n", "inverse sqrt theta15", "square  c"], None),
    ],
)
def test_fit_is_least_squares(model: Any, terms: Any) -> None:
    table = fields()
    found = analysis.regression(table, "f_max", model)
    values = {
        "c": table["c"],
        "sqrt c": table["c"] ** 0.5,
        "square c": table["c"] ** 2,
        "inverse n": 1 / table["n"],
        "inverse sqrt theta15": table["theta15"] ** -0.5,
        "sqrt theta15": table["theta15"] ** 0.5,
        "log n": np.log(table["n"]),
    }
    names = terms or ["sqrt c", "inverse n", "inverse sqrt theta15", "square c"]
    assert found.terms == ("constant", *names)
    y, n, k = table["f_max"], 34, 1 + len(names)
    x = np.column_stack([np.ones(n), *(values[name] for name in names)])
    np.testing.assert_allclose(found.design, x, rtol=1e-12)
    b = np.linalg.lstsq(x, y)[0]
    np.testing.assert_allclose(list(found.coefficients.values()), b, rtol=1e-8)
    e = y - x @ b
    np.testing.assert_allclose(found.residuals, e, atol=1e-8)
    np.testing.assert_allclose(found.fitted, x @ b, rtol=1e-8)
    variance = e @ e / (n - k)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(x.T @ x)))
    np.testing.assert_allclose(list(found.standard_errors.values()), errors, rtol=1e-6)
    np.testing.assert_allclose(list(found.t.values()), b / errors, rtol=1e-6)
    assert found.residual_error == pytest.approx(math.sqrt(variance))
    share = 1 - e @ e / ((y - y.mean()) ** 2).sum()
    assert found.r_squared == pytest.approx(share)
    assert found.adjusted_r_squared == pytest.approx(1 - (1 - share) * (n - 1) / (n - k))
    assert found.f == pytest.approx(share / (1 - share) * (n - k) / (k - 1))
    if k == 2:  # F is the square of t
        assert found.f == pytest.approx(found.t["c"] ** 2)
        assert found.f_p == pytest.approx(found.p["c"], rel=1e-6)


def test_coefficients_are_recovered() -> None:
    exact = analysis.regression(fields(noise=0.0))
    known = {"constant": 100.0, "c": 12.0, "sqrt theta15": 80.0, "log n": -60.0}
    assert exact.coefficients == pytest.approx(known, rel=1e-10)
    assert exact.r_squared == pytest.approx(1.0, abs=1e-12)
    noisy = analysis.regression(fields(rows=2000, noise=10.0))
    for name, value in known.items():
        assert abs(noisy.coefficients[name] - value) < 4 * noisy.standard_errors[name]
        low, high = noisy.confidence(0.9999)[name]
        assert low < value < high
    assert noisy.residual_error == pytest.approx(10.0, rel=0.06)


def test_bands_cover_what_they_say() -> None:
    place = {"c": 10.0, "theta15": 0.3, "n": 0.5}
    truth = 100 + 12 * 10 + 80 * math.sqrt(0.3) - 60 * math.log(0.5)
    random = np.random.default_rng(8)
    inside = [0, 0]
    for seed in range(300):
        found = analysis.regression(fields(seed)).predict(place, level=0.8)
        assert found.mean.shape == (1,)
        inside[0] += int(found.lower[0] < truth < found.upper[0])
        new = truth + 10 * random.standard_normal()
        inside[1] += int(found.observation_lower[0] < new < found.observation_upper[0])
    for count in inside:
        assert count / 300 == pytest.approx(0.8, abs=4 * math.sqrt(0.8 * 0.2 / 300))


def test_predictions() -> None:
    table = fields()
    found = analysis.regression(table)
    rows = found.predict(table)
    np.testing.assert_allclose(rows.mean, found.fitted, rtol=1e-12)
    x, inverse = found.design, np.linalg.inv(found.design.T @ found.design)
    from scipy.stats import t

    half = t.ppf(0.975, 30) * found.residual_error
    spread = np.einsum("ij,jk,ik->i", x, inverse, x)
    np.testing.assert_allclose(rows.upper - rows.mean, half * np.sqrt(spread), rtol=1e-9)
    np.testing.assert_allclose(
        rows.mean - rows.observation_lower, half * np.sqrt(1 + spread), rtol=1e-9
    )
    wider = found.predict(table, level=0.99)
    assert (wider.upper > rows.upper).all()
    assert refused(lambda: found.predict({"c": 1.0, "theta15": 0.2, "N": 0.5})) == [
        "analysis.Regression.predict: no column 'n' for the term 'log n'; choose from c, theta15, N"
    ]
    assert (
        "'log n' of 0 does not exist, rows 0;"
        in refused(lambda: found.predict({"c": 1.0, "theta15": 0.2, "n": 0.0}))[0]
    )
    assert "level is 1; expected > 0 and < 1" in refused(lambda: found.predict(table, 1.0))[0]


def test_what_may_hold_a_table() -> None:
    pandas = pytest.importorskip("pandas")
    table = fields() | {"name": [f"run {k}" for k in range(34)]}
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    frame = pandas.DataFrame(table)
    records = frame.drop(columns="name").to_records()
    expected = analysis.regression(table)
    for other in (rows, frame, records, tuple(rows)):
        found = analysis.regression(other)
        assert found.coefficients == pytest.approx(expected.coefficients, rel=1e-12)
        assert found.residual_tests(["c", "n"]).white["n"].lm == pytest.approx(
            expected.residual_tests(["n"]).white["n"].lm
        )
    result = StudyResult(rows=tuple(rows), parameters=("c", "n"), responses=("f_max", "theta15"))
    found = analysis.regression(result)
    assert found.coefficients == pytest.approx(expected.coefficients, rel=1e-12)
    spaced = {"debris count": table["c"], "f": table["f_max"]}
    assert analysis.regression(spaced, "log f", ["sqrt debris count"]).response == "log f"


def test_rows_without_numbers() -> None:
    table = fields()
    whole = analysis.regression({k: np.delete(v, [3, 5]) for k, v in table.items()})
    table["f_max"][3] = math.nan
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    del rows[5]["n"]
    assert refused(lambda: analysis.regression(rows)) == [
        "analysis.regression: 'f_max' is not a finite number in rows 3; expected numbers; repeat "
        'what failed, or leave such rows out with missing="drop"',
        "analysis.regression: 'log n' is not a finite number in rows 5; expected numbers; repeat "
        'what failed, or leave such rows out with missing="drop"',
    ]
    found = analysis.regression(rows, missing="drop")
    assert found.dropped == (3, 5)
    assert found.coefficients == pytest.approx(whole.coefficients, rel=1e-12)
    assert "2 rows left out" in found.summary()
    tests = found.residual_tests(["theta15"])
    assert tests.white["theta15"].lm == pytest.approx(
        whole.residual_tests(["theta15"]).white["theta15"].lm
    )
    some = analysis.regression(rows, model="linear", missing="drop")
    assert some.dropped == (3,)
    assert (
        "'n' is not a finite number in rows 5; expected one in every row of the regression"
        in (refused(lambda: some.residual_tests(["n"]))[0])
    )


def test_the_table_is_kept_as_it_was() -> None:
    table = fields()
    found = analysis.regression(table, model="linear")
    before = found.residual_tests(["log n"]).white["log n"].lm
    table["n"][:] = 0.5
    assert found.residual_tests(["log n"]).white["log n"].lm == before
    with pytest.raises(ValueError, match="read-only"):
        found.observed[0] = 0.0
    again = pickle.loads(pickle.dumps(found))
    assert again.coefficients == found.coefficients


@pytest.mark.parametrize(
    ("change", "arguments", "words"),
    [
        ({}, {"model": "mult"}, "model is 'mult'; did you mean 'multi'?"),
        ({}, {"model": []}, "model is []; expected a list of terms"),
        ({}, {"model": 3}, "model is 3; expected a list of terms"),
        ({}, {"model": ["c", 3]}, "term is 3; expected a text such as 'c' or 'log n'"),
        ({}, {"model": ["log m"]}, "no column 'm' for the term 'log m'; choose from c, theta15"),
        ({}, {"model": ["lg n"]}, "term 'lg n' begins with no known function; expected sqrt, log,"),
        ({}, {"response": "f_maxi"}, "no column 'f_maxi' for the term 'f_maxi'; did you mean"),
        ({}, {"model": ["c", "c"]}, "terms occur twice in f_max, c, c"),
        ({}, {"model": ["c", "f_max"]}, "terms occur twice in f_max, c, f_max"),
        ({}, {"missing": "skip"}, "missing is 'skip'; choose from refuse, drop"),
        ({"c": ["a"] * 34}, {}, "column 'c' holds ['a', 'a', 'a']; expected numbers (n,)"),
        ({"c": np.ones((34, 2))}, {}, "column 'c' holds"),
        ({"c": np.ones(3)}, {}, "columns have different lengths (f_max 34, c 3,"),
        ({"n": np.arange(34.0)}, {}, "'log n' of 0 does not exist, rows 0; expected values > 0"),
        ({"theta15": -np.arange(34.0)}, {}, "'sqrt theta15' of -1 does not exist, rows 1, 2, 3,"),
        ({"n": np.arange(34.0)}, {"model": ["inverse n"]}, "expected values other than 0"),
        ({"n": np.full(34, 0.5)}, {}, "term 'log n' is a constant or a combination of the terms"),
        ({"d": 3 - 2 * fields()["c"]}, {"model": ["c", "d"]}, "term 'd' is a constant or a"),
    ],
)
def test_regressions_that_are_refused(change: Table, arguments: Table, words: str) -> None:
    (problem,) = refused(lambda: analysis.regression(fields() | change, **arguments))
    assert problem.startswith("analysis.regression: ") and words in problem


def test_tables_that_are_refused() -> None:
    for table in ({}, [], [1.0, 2.0], "f_max", None, np.zeros((3, 2))):
        assert (
            "expected the result of a study, a mapping of columns, a pandas frame, NumPy"
            in (refused(lambda t=table: analysis.regression(t))[0])
        )
    few = {key: value[:4] for key, value in fields().items()}
    assert (
        "there are 4 rows for 4 coefficients; expected more rows"
        in (refused(lambda: analysis.regression(few))[0])
    )


def test_summary() -> None:
    found = analysis.regression(fields())
    text = found.summary()
    assert repr(found) == text
    head, titles, *rows = text.splitlines()
    assert head.startswith(f"f_max: 34 rows, R² {found.r_squared:.4f}, adjusted")
    assert titles.split()[:2] == ["term", "coefficient"]
    assert [row[:12].strip() for row in rows] == ["constant", "c", "sqrt theta15", "log n"]
    assert f"{found.coefficients['c']:.4g}" in rows[1]
    page = found._repr_html_()
    assert page.count("<tr>") == 5 and "sqrt theta15" in page and "<p>f_max" in page
    assert found.statsmodels.rsquared == found.r_squared


@pytest.mark.parametrize("unit", [1e-12, 1e-3, 1e9, 1e40])
def test_units_of_terms_do_not_matter(unit: float) -> None:
    """A modulus in Pa, squared, is 1e18 times the constant beside it."""
    random = np.random.default_rng(8)
    c, modulus = random.integers(4, 25, 24).astype(float), np.linspace(0.5, 3, 24)
    load = 100 + 12 * c + 30 * modulus**2 + random.standard_normal(24)
    one, other = (
        analysis.regression({"c": c, "E": modulus * by, "y": load}, "y", ["c", "square E"])
        for by in (1.0, unit)
    )
    assert one.r_squared > 0.999
    for key in ("r_squared", "adjusted_r_squared", "f", "f_p", "residual_error"):
        assert getattr(other, key) == pytest.approx(getattr(one, key), rel=1e-9)
    scale = {"constant": 1.0, "c": 1.0, "square E": unit**2}
    for name, by in scale.items():
        for key in ("coefficients", "standard_errors"):
            expected = getattr(one, key)[name]
            assert getattr(other, key)[name] * by == pytest.approx(expected, rel=1e-9)
        assert other.t[name] == pytest.approx(one.t[name], rel=1e-9)
        assert np.multiply(other.confidence()[name], by) == pytest.approx(one.confidence()[name])
    rows = [fit.predict({"c": 10, "E": 2.0 * by}) for fit, by in ((one, 1.0), (other, unit))]
    for mine, theirs in zip(*rows, strict=True):
        np.testing.assert_allclose(theirs, mine, rtol=1e-9)
    tests, again = one.residual_tests(), other.residual_tests()
    assert again.breusch_pagan.p == pytest.approx(tests.breusch_pagan.p, rel=1e-6)
    assert again.white["square E"].lm == pytest.approx(tests.white["square E"].lm, rel=1e-6)
    # What statsmodels goes on to compute from its own result is that of a plain fit.
    plain = pytest.importorskip("statsmodels.api").OLS(load, np.array(one.design)).fit()
    hats = (fit.get_influence().hat_matrix_diag for fit in (plain, other.statsmodels))
    np.testing.assert_allclose(*hats, rtol=1e-9)
    assert other.statsmodels.aic == pytest.approx(plain.aic)
    assert other.statsmodels.HC3_se[1] == pytest.approx(plain.HC3_se[1])


def test_terms_far_from_zero() -> None:
    steps = np.tile([0.0, 1.0, 2.0, 3.0], 6)
    load = 5 + 2 * steps + 0.1 * np.random.default_rng(9).standard_normal(24)
    slope = np.polyfit(steps, load, 1)[0]
    found = analysis.regression({"x": 1e6 + steps, "y": load}, "y", ["x"])
    assert found.coefficients["x"] == pytest.approx(slope, rel=1e-7)
    far = {"x": 1e12 + steps, "y": load}
    (problem,) = refused(lambda: analysis.regression(far, "y", ["x"]))
    assert "too little from a constant, for double precision (condition number" in problem
    assert problem.endswith("expected < 1e+10; give columns less their mean, or leave terms out")


def test_two_valued_terms_leave_the_other_tests() -> None:
    table = fields() | {"wood": np.arange(34) % 2}
    fit = analysis.regression(table, model=["c", "wood"])
    tests = fit.residual_tests()
    assert list(tests.white) == ["c"]
    assert 0 < tests.shapiro.p < 1
    (problem,) = refused(lambda: fit.residual_tests(["wood"]))
    assert problem.startswith("analysis.Regression.residual_tests: 'wood' has 2 different value")


# Tests of residuals ------------------------------------------------------------------------


def test_residual_tests() -> None:
    from scipy import stats

    found = analysis.regression(fields())
    e, n = found.residuals, 34
    tests = found.residual_tests()
    w, p = stats.shapiro(e)
    assert (tests.shapiro.statistic, tests.shapiro.p) == pytest.approx((w, p))
    assert tests.durbin_watson == pytest.approx((np.diff(e) ** 2).sum() / (e @ e))
    assert tests.skew == pytest.approx((e**3).mean() / (e**2).mean() ** 1.5)
    assert tests.kurtosis == pytest.approx((e**4).mean() / (e**2).mean() ** 2)
    moments = n / 6 * (tests.skew**2 + (tests.kurtosis - 3) ** 2 / 4)
    assert tests.jarque_bera.statistic == pytest.approx(moments)
    assert tests.jarque_bera.p == pytest.approx(math.exp(-moments / 2))
    assert tests.omnibus.p == pytest.approx(math.exp(-tests.omnibus.statistic / 2))
    # n R² of the squares on the terms
    x, square = found.design, e**2
    rest = square - x @ np.linalg.lstsq(x, square)[0]
    share = 1 - (rest @ rest) / ((square - square.mean()) ** 2).sum()
    assert tests.breusch_pagan.statistic == pytest.approx(n * share)
    assert tests.breusch_pagan.p == pytest.approx(stats.chi2.sf(n * share, 3))
    size = np.linalg.svd(x)[1]
    assert tests.condition_number == pytest.approx(size[0] / size[-1])
    assert list(tests.white) == ["c", "sqrt theta15", "log n"]
    alone = analysis.white_test(e, np.log(fields()["n"]))
    assert tests.white["log n"] == alone
    rows = tests.rows()
    assert len(rows) == 1 + 4 + 2 * 3 + 4
    assert rows[0][3] == "at p < 0.05"
    assert repr(tests).splitlines()[5].strip().startswith("White, c, LM")
    assert tests._repr_html_().count("<tr>") == len(rows)


def test_residual_tests_see_what_is_there() -> None:
    random = np.random.default_rng(9)
    c = np.linspace(1, 10, 300)
    table = {"c": c, "f": c + c * random.standard_normal(300)}
    growing = analysis.regression(table, "f", ["c"]).residual_tests()
    assert growing.breusch_pagan.significant and growing.white["c"].heteroscedastic
    table["f"] = c + random.exponential(size=300)
    skewed = analysis.regression(table, "f", ["c"]).residual_tests()
    for test in (skewed.shapiro, skewed.omnibus, skewed.jarque_bera):
        assert test.significant
    assert skewed.skew > 1 and skewed.kurtosis > 4
    table["f"] = c + np.sin(c)
    waves = analysis.regression(table, "f", ["c"]).residual_tests()
    assert waves.durbin_watson < 0.1
    assert (
        "Durbin-Watson",
        f"{waves.durbin_watson:.4g}",
        "",
        "neighbours are alike (1.5-2.5)",
    ) in (waves.rows())


def test_threshold_of_residual_tests() -> None:
    found = analysis.regression(fields())
    p = found.residual_tests().shapiro.p
    assert not found.residual_tests(threshold=p - 1e-6).shapiro.significant
    strict = found.residual_tests(["c"], threshold=p + 1e-6)
    assert strict.shapiro.significant
    assert strict.white["c"].threshold == strict.threshold == p + 1e-6
    assert strict.rows()[1][3] == "not normal"


def test_residuals_that_say_nothing() -> None:
    exact = analysis.regression(fields(noise=0.0))
    assert "the residuals are rounding of an exact fit" in refused(exact.residual_tests)[0]
    few = {key: value[:7] for key, value in fields().items()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tests = analysis.regression(few, model="linear").residual_tests()
    assert math.isnan(tests.omnibus.p) and not tests.omnibus.significant
    assert ("Omnibus", "", "", "") in tests.rows()
    assert (
        "variables is 'c'; expected a list of terms"
        in refused(lambda: analysis.regression(fields()).residual_tests("c"))[0]
    )


# Correlation, parity, box plots ------------------------------------------------------------


def test_correlation() -> None:
    from scipy import stats

    table = fields()
    found = analysis.correlation(table, ["c", "sqrt theta15", "f_max"])
    assert found.names == ("c", "sqrt theta15", "f_max")
    values = np.stack([table["c"], np.sqrt(table["theta15"]), table["f_max"]])
    np.testing.assert_allclose(found.matrix, np.corrcoef(values), rtol=1e-12)
    r = found.matrix[0, 2]
    t = r * math.sqrt(32 / (1 - r**2))
    assert found.p[0, 2] == pytest.approx(2 * stats.t.sf(t, 32), rel=1e-6)
    np.testing.assert_array_equal(found.p, found.p.T)
    ranks = analysis.correlation(
        {"a": values[0], "b": np.exp(values[0])}, ["a", "b"], method="spearman"
    )
    assert ranks.matrix[0, 1] == pytest.approx(1.0)
    assert len(repr(found).splitlines()) == found._repr_html_().count("<tr>") == 4
    assert (
        "'b' is 1 in every row; expected it to vary"
        in refused(lambda: analysis.correlation({"a": [1, 2, 3], "b": [1, 1, 1]}, ["a", "b"]))[0]
    )
    assert (
        "names is ['c']; expected a list of two terms"
        in refused(lambda: analysis.correlation(table, ["c"]))[0]
    )
    assert (
        "there are 2 rows; expected three or more"
        in refused(lambda: analysis.correlation({"a": [1, 2], "b": [1, 3]}, ["a", "b"]))[0]
    )
    assert (
        "method is 'kendall'; choose from"
        in refused(
            lambda: analysis.correlation(table, ["c", "n"], method="kendall")  # type: ignore[arg-type]
        )[0]
    )


def test_deviations_from_nothing_do_not_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = analysis.parity([0.0, 0.0, 2.0, 4.0], [0.0, 1.0, 3.0, 4.0]).deviations
    np.testing.assert_array_equal(found, [np.nan, np.inf, 0.5, 0.0])


def test_parity() -> None:
    """The line of Bonus (2023) 7.3 for first peaks comes back, and R² is that of the pairs."""
    measured = np.linspace(200.0, 1500.0, 16)
    exact = analysis.parity(measured, 0.933 * measured + 33.0)
    assert (exact.slope, exact.intercept) == pytest.approx((0.933, 33.0))
    assert exact.r_squared == pytest.approx(1.0)
    noise = 50 * np.random.default_rng(3).standard_normal(16)
    found = analysis.parity(measured, 0.933 * measured + 33.0 + noise)
    fit = analysis.regression({"x": measured, "y": found.simulated}, "y", ["x"])
    assert found.slope == pytest.approx(fit.coefficients["x"])
    assert found.intercept == pytest.approx(fit.coefficients["constant"])
    assert found.r_squared == pytest.approx(fit.r_squared)
    assert found.slope_error == pytest.approx(fit.standard_errors["x"])
    assert found.intercept_error == pytest.approx(fit.standard_errors["constant"])
    assert found.observations == 16
    np.testing.assert_allclose(found.deviations, found.simulated / measured - 1)
    assert "slope" in repr(found) and "<td>R²</td>" in found._repr_html_()
    assert (
        "there are 2 measured and 3 simulated values"
        in refused(lambda: analysis.parity([1, 2], [1, 2, 3]))[0]
    )
    assert "measured is 1 throughout" in refused(lambda: analysis.parity([1] * 3, [1, 2, 3]))[0]
    assert (
        "pairs 1 are not finite" in refused(lambda: analysis.parity([1, math.nan, 2], [1, 2, 3]))[0]
    )


def test_box_plot() -> None:
    found = analysis.box_plot([4, 1, 2, 3, 5, 100, 6, 7, 8])
    assert (found.q1, found.median, found.q3, found.iqr) == (3, 5, 7, 4)
    assert (found.lower_bound, found.upper_bound) == (-3, 13)
    assert (found.lower_whisker, found.upper_whisker) == (1, 8)
    assert (found.minimum, found.maximum, found.outliers, found.count) == (1, 100, (100,), 9)
    narrow = analysis.box_plot([4, 1, 2, 3, 5, 100, 6, 7, 8], reach=0.25)
    assert (narrow.lower_whisker, narrow.upper_whisker) == (2, 8)
    assert narrow.outliers == (1, 100)
    one = analysis.box_plot([2.5])
    assert one.q1 == one.median == one.q3 == one.upper_whisker == 2.5
    assert "outliers" in repr(found) and "<td>100</td>" in found._repr_html_()
    assert "there are no values" in refused(lambda: analysis.box_plot([]))[0]
    assert "values 1 are not finite" in refused(lambda: analysis.box_plot([1, math.nan]))[0]
    assert "reach is -1; expected ≥ 0" in refused(lambda: analysis.box_plot([1], reach=-1))[0]


@pytest.mark.parametrize("seed", range(5))
def test_box_plots_are_those_of_matplotlib(seed: int) -> None:
    from matplotlib.cbook import boxplot_stats

    values = np.random.default_rng(seed).standard_cauchy(40)
    found, (other,) = analysis.box_plot(values), boxplot_stats(values)
    names = {"q1": "q1", "median": "med", "q3": "q3", "lower_whisker": "whislo"}
    for ours, theirs in (names | {"upper_whisker": "whishi"}).items():
        assert getattr(found, ours) == pytest.approx(other[theirs], rel=1e-12)
    np.testing.assert_allclose(found.outliers, np.sort(other["fliers"]))


# The page, pictures and packages -----------------------------------------------------------


def test_the_page_prints_what_it_says() -> None:
    page = Path(__file__).parents[2] / "docs" / "analysis.md"
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", text, re.DOTALL)
    names: dict[str, Any] = {}
    compared = 0
    for code, expected in blocks:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(code, names)
        if expected:
            assert printed.getvalue() == expected
            compared += 1
    assert compared >= 3


def test_plots() -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    found = analysis.regression(fields())
    ax = found.plot_residuals()
    np.testing.assert_array_equal(ax.lines[1].get_ydata(), found.residuals)
    ax = found.plot_qq()
    np.testing.assert_array_equal(ax.lines[1].get_ydata(), np.sort(found.residuals))
    ax = found.plot_parity(color="k")
    np.testing.assert_array_equal(ax.lines[1].get_xdata(), found.observed)
    line = analysis.parity(found.observed, found.fitted)
    assert line.plot(ax) is ax
    ax = analysis.correlation(fields(), ["c", "theta15", "n", "f_max"]).plot()
    assert [t.get_text() for t in ax.get_xticklabels()] == ["c", "theta15", "n", "f_max"]
    box = analysis.box_plot([1, 2, 3, 30])
    ax = box.plot(name="16L")
    assert box.plot(ax, position=2, name="16T") is ax
    assert [t.get_text() for t in ax.get_xticklabels()] == ["16L", "16T"]
    plt.close("all")


def test_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels.regression.linear_model", None)
    (problem,) = refused(lambda: analysis.regression(fields()))
    assert "the package statsmodels is not installed" in problem
    assert problem.endswith("run `pip install libmpm[studies]`")
