"""Tests of the residuals of a regression."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.tables import html_table, text_table
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker
from libmpm._src.errors import SceneError
from libmpm._src.studies.analysis.layout import number
from libmpm._src.studies.analysis.record import Floats, numbers

if TYPE_CHECKING:
    from libmpm._src.studies.analysis.regression import Regression

__all__ = [
    "LEAST_VALUES",
    "HypothesisTest",
    "ResidualTests",
    "WhiteTest",
    "residual_tests",
    "white_test",
]

#: Residuals whose squares are this part of those of the response are rounding.
_EXACT = 1e-20
#: Fewest residuals for the omnibus test, which scipy approximates from there on.
_OMNIBUS = 8
#: Durbin-Watson statistics from neighbours that are no more like each other than others.
_INDEPENDENT = (1.5, 2.5)
#: Fewest different values of a variable for White's test: of two, x² says no more than x.
LEAST_VALUES = 3
#: Condition number from which statsmodels warns that terms are nearly combinations of others.
_CONDITION = 1000.0


@dataclass(frozen=True)
class HypothesisTest:
    """A test: small p speaks against what it supposes."""

    statistic: float
    """The value of its statistic."""
    p: float
    """Probability of a statistic at least as large, if what is supposed holds."""
    threshold: float = 0.05
    """Smallest p that is not significant."""

    @property
    def significant(self) -> bool:
        """Whether p is below the threshold."""
        return self.p < self.threshold


@dataclass(frozen=True)
class WhiteTest:
    """White's test of one variable x: do squared residuals follow 1, x and x²?

    LM = n R² of that regression, and F = (LM/2)(n - 3)/(n - LM) compares it with a constant.
    """

    lm: float
    """Lagrange multiplier statistic."""
    lm_p: float
    """Its p in the χ² distribution with 2 degrees of freedom, exp(-LM/2)."""
    f: float
    """F statistic."""
    f_p: float
    """Its p with 2 and n - 3 degrees of freedom, (1 + 2F/(n - 3))^(-(n - 3)/2)."""
    observations: int
    """Number n of residuals."""
    threshold: float = 0.05
    """Smallest p of LM at which the variance is taken for constant."""

    @property
    def heteroscedastic(self) -> bool:
        """Whether the variance changes with the variable: p of LM is below the threshold."""
        return self.lm_p < self.threshold

    @classmethod
    @keywords_only("analysis.WhiteTest.from_statistic", 2)
    def from_statistic(cls, lm: float, observations: int, *, threshold: float = 0.05) -> WhiteTest:
        """Return the test that has this LM, 0 ≤ LM < n, over n > 3 residuals.

        It completes and checks published tables. Raises `SceneError`.
        """
        check = Checker("analysis.WhiteTest")
        n = check.integer("observations", observations, lower=4)
        lm = check.number("lm", lm, lower=0, upper=n, upper_open=True)
        threshold = check.number("threshold", threshold, lower=0, upper=1)
        check.finish()
        stats = need("scipy.stats", "analysis.WhiteTest", "studies")
        f = lm / 2 * (n - 3) / (n - lm)
        p = float(stats.chi2.sf(lm, 2)), float(stats.f.sf(f, 2, n - 3))
        return cls(lm, p[0], f, p[1], n, threshold)


@keywords_only("analysis.white_test", 2, method=False)
def white_test(
    residuals: npt.ArrayLike, variable: npt.ArrayLike, *, threshold: float = 0.05
) -> WhiteTest:
    """Return White's test of residuals (n,) against one variable (n,), n > 3.

    `variable` has at least three different values; the test does not depend on its unit or zero.
    Needs statsmodels. Raises `SceneError`. Source: Bonus (2023) 10.4, `WhiteTest`.
    """
    return _white(Checker("analysis.white_test"), residuals, variable, threshold, "the variable")


def _white(
    check: Checker, residuals: npt.ArrayLike, variable: npt.ArrayLike, threshold: float, name: str
) -> WhiteTest:
    """Carry out `white_test`; messages call the variable `name`."""
    e, x = numbers(check, "residuals", residuals), numbers(check, "variable", variable)
    threshold = check.number("threshold", threshold, lower=0, upper=1)
    check.finish()
    if len(e) != len(x) or len(e) < 4:
        check.fail(
            f"there are {len(e)} residuals and {len(x)} values of {name}; expected as many, 4 or "
            "more"
        )
    elif not (np.isfinite(e).all() and np.isfinite(x).all()):
        wrong = ~(np.isfinite(e) & np.isfinite(x))
        check.fail(f"rows {marked(wrong)} are not finite; expected numbers")
    elif len(np.unique(x)) < LEAST_VALUES:
        check.fail(
            f"{name} has {len(np.unique(x))} different value(s); expected three or more, "
            "or its square says nothing that it does not"
        )
    elif np.ptp(e**2) == 0:
        check.fail("the residuals have all the same size; expected sizes that differ")
    check.finish()
    diagnostic = need("statsmodels.stats.diagnostic", "analysis.white_test", "studies")
    # Its square spans the same with the variable scaled, but would lose digits far from zero.
    scaled = (x - x.mean()) / x.std()
    design = np.column_stack([np.ones_like(scaled), scaled])
    lm, lm_p, f, f_p = map(float, diagnostic.het_white(e / np.abs(e).max(), design))
    return WhiteTest(lm, lm_p, f, f_p, len(e), threshold)


@dataclass(frozen=True, repr=False)
class ResidualTests:
    """What tests say about residuals; prints as a table. Made by `Regression.residual_tests`."""

    threshold: float
    """Smallest p that is not significant, for every test."""
    shapiro: HypothesisTest
    """Shapiro-Wilk: supposes a normal distribution."""
    omnibus: HypothesisTest
    """D'Agostino and Pearson: supposes the skew and kurtosis of one; nan below 8 residuals."""
    jarque_bera: HypothesisTest
    """Jarque-Bera: the same for many residuals."""
    breusch_pagan: HypothesisTest
    """Breusch-Pagan in Koenker's form: supposes that no term changes the variance."""
    white: dict[str, WhiteTest]
    """White's test for each variable: supposes that it and its square do not."""
    durbin_watson: float
    """Σ (e_k - e_(k-1))² / Σ e_k² in the order of the rows; 2 for independent neighbours."""
    skew: float
    """Third moment over that of the variance; 0 if symmetric."""
    kurtosis: float
    """Fourth moment; 3 if normal, more with thick tails."""
    condition_number: float
    """Largest over smallest singular value of the design matrix, in its own units."""

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Return test, statistic, p and what follows as texts, after a head."""

        def line(name: str, test: HypothesisTest, no: str, yes: str) -> tuple[str, str, str, str]:
            told = "" if math.isnan(test.p) else yes if test.significant else no
            return name, number(test.statistic), number(test.p), told

        found = [("test", "statistic", "p", f"at p < {self.threshold:g}")]
        normal = ("normal", "not normal")
        found.append(line("Shapiro-Wilk", self.shapiro, *normal))
        found.append(line("Omnibus", self.omnibus, *normal))
        found.append(line("Jarque-Bera", self.jarque_bera, *normal))
        even = ("even variance", "uneven variance")
        found.append(line("Breusch-Pagan", self.breusch_pagan, *even))
        for name, white in self.white.items():
            for kind, statistic, p in (("LM", white.lm, white.lm_p), ("F", white.f, white.f_p)):
                test = HypothesisTest(statistic, p, self.threshold)
                found.append(line(f"White, {name}, {kind}", test, *even))
        low, high = _INDEPENDENT
        told = "independent" if low <= self.durbin_watson <= high else "neighbours are alike"
        if self.durbin_watson > high:
            told = "neighbours are opposite"
        found.append(("Durbin-Watson", number(self.durbin_watson), "", f"{told} ({low}-{high})"))
        found.append(("skew", number(self.skew), "", ""))
        found.append(("kurtosis", number(self.kurtosis), "", ""))
        told = (
            "distinct terms"
            if self.condition_number < _CONDITION
            else "terms combine, or differ in size"
        )
        rule = f"{told} (< {_CONDITION:g})"
        found.append(("condition number", number(self.condition_number), "", rule))
        return found

    def __repr__(self) -> str:
        """Return the table as text for a terminal."""
        return text_table(self.rows())

    def _repr_html_(self) -> str:
        """Return the table for Jupyter."""
        head, *rows = self.rows()
        return html_table(rows, head)


def residual_tests(
    regression: Regression, variables: dict[str, Floats], threshold: float
) -> ResidualTests:
    """Carry out `Regression.residual_tests`."""
    label = "analysis.Regression.residual_tests"
    check = Checker(label)
    threshold = check.number("threshold", threshold, lower=0, upper=1)
    check.finish()
    e, y = regression.residuals, regression.observed
    if float(e @ e) <= _EXACT * float(y @ y):
        raise SceneError(
            f"{label}: the residuals are rounding of an exact fit, largest {np.abs(e).max():.3g}; "
            "expected some that mean something; test a regression with more rows than it explains"
        )
    stats = need("scipy.stats", label, "studies")
    tools = need("statsmodels.stats.stattools", label, "studies")
    diagnostic = need("statsmodels.stats.diagnostic", label, "studies")

    def test(found: Any) -> HypothesisTest:
        return HypothesisTest(float(found[0]), float(found[1]), threshold)

    white = {
        name: _white(Checker(label), e, x, threshold, f"'{name}'") for name, x in variables.items()
    }
    # Not in its own units, of which statsmodels would drop the small; see `regression._fitted`.
    design = regression.design / np.linalg.norm(regression.design, axis=0)
    moments = tools.jarque_bera(e)
    few = len(e) < _OMNIBUS
    return ResidualTests(
        threshold=threshold,
        shapiro=test(stats.shapiro(e)),
        omnibus=test((math.nan, math.nan) if few else stats.normaltest(e)),
        jarque_bera=test(moments),
        breusch_pagan=test(diagnostic.het_breuschpagan(e, design)),
        white=white,
        durbin_watson=float(tools.durbin_watson(e)),
        skew=float(moments[2]),
        kurtosis=float(moments[3]),
        condition_number=float(np.linalg.cond(regression.design)),
    )
