"""Ordinary least squares of responses of studies."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.tables import html_table, text_table
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.studies.analysis import plots
from libmpm._src.studies.analysis.layout import number
from libmpm._src.studies.analysis.record import Floats
from libmpm._src.studies.analysis.residuals import LEAST_VALUES, ResidualTests, residual_tests
from libmpm._src.studies.analysis.tables import Missing, Table, columns, sample

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["MODELS", "Prediction", "Regression", "regression"]

#: Bonus (2023) 10.4: f_max from the count c, the share θ15 of debris within 15° of the structure's
#: normal, and the porosity n.
MODELS: dict[str, tuple[str, ...]] = {
    "linear": ("c",),
    "dual": ("sqrt theta15", "log n"),
    "multi": ("c", "sqrt theta15", "log n"),
}
CONSTANT = "constant"
#: Condition number of terms brought to the same size from which a fit keeps few digits.
_CONDITION = 1e10


class Prediction(NamedTuple):
    """What a regression expects for rows, with bands at one level of confidence; (rows,) each."""

    mean: Floats
    """Expected response."""
    lower: Floats
    """Lower end of the band of the expected response."""
    upper: Floats
    """Upper end of it."""
    observation_lower: Floats
    """Lower end of the band of a single observation."""
    observation_upper: Floats
    """Upper end of it."""


class Regression:
    """An ordinary least squares fit y = Xb, made by `regression`; prints as a table."""

    label: ClassVar[str] = "analysis.Regression"

    def __init__(
        self, response: str, terms: Sequence[str], observed: Floats, design: Floats, extra: Any
    ) -> None:
        """Fit `observed` (n,) by `design` (n, k), whose first column is the constant.

        `extra` is the table's columns, and which of its rows are used.
        """
        model = need("statsmodels.regression.linear_model", "analysis.regression", "studies")
        self._response, self._terms = response, (CONSTANT, *terms)
        self._table, self._used = extra
        self._design, self._observed = design, observed
        for array in (design, observed):
            array.flags.writeable = False
        self._fit = _fitted(model, observed, design)

    @property
    def response(self) -> str:
        """Name of the response y."""
        return self._response

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the coefficients, "constant" first."""
        return self._terms

    @property
    def observations(self) -> int:
        """Number n of rows."""
        return len(self._observed)

    @property
    def dropped(self) -> tuple[int, ...]:
        """Rows of the table that were left out, because they hold no number."""
        return tuple(np.flatnonzero(~self._used).tolist())

    @property
    def observed(self) -> Floats:
        """Responses y, (n,); read-only."""
        return self._observed

    @property
    def design(self) -> Floats:
        """Design matrix X, (n, k); read-only."""
        return self._design

    def _named(self, values: Any) -> dict[str, float]:
        return dict(zip(self._terms, np.asarray(values).tolist(), strict=True))

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients b by term, in units of the response over those of the term."""
        return self._named(self._fit.params)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors of the coefficients."""
        return self._named(self._fit.bse)

    @property
    def t(self) -> dict[str, float]:
        """Coefficients over their standard errors."""
        return self._named(self._fit.tvalues)

    @property
    def p(self) -> dict[str, float]:
        """Two-sided p of t with n - k degrees of freedom."""
        return self._named(self._fit.pvalues)

    @property
    def r_squared(self) -> float:
        """R², share of the variance that is explained."""
        return float(self._fit.rsquared)

    @property
    def adjusted_r_squared(self) -> float:
        """1 - (1 - R²)(n - 1)/(n - k)."""
        return float(self._fit.rsquared_adj)

    @property
    def f(self) -> float:
        """F of all terms against the constant alone."""
        return float(self._fit.fvalue)

    @property
    def f_p(self) -> float:
        """p of F with k - 1 and n - k degrees of freedom."""
        return float(self._fit.f_pvalue)

    @property
    def residual_error(self) -> float:
        """√(Σ e² / (n - k)), the standard error of a residual, in the response's unit."""
        return float(np.sqrt(self._fit.mse_resid))

    @property
    def fitted(self) -> Floats:
        """Fitted responses Xb, (n,)."""
        return np.asarray(self._fit.fittedvalues)

    @property
    def residuals(self) -> Floats:
        """Residuals e = y - Xb, (n,)."""
        return np.asarray(self._fit.resid)

    @property
    def statsmodels(self) -> Any:
        """The fit as statsmodels has it, for everything else."""
        return self._fit

    @keywords_only("analysis.Regression.confidence", 1)
    def confidence(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return the ends of the confidence interval of each coefficient; 0 < level < 1."""
        ends = self._fit.conf_int(1 - _level(f"{self.label}.confidence", level))
        rows = np.asarray(ends).tolist()
        return {name: (row[0], row[1]) for name, row in zip(self._terms, rows, strict=True)}

    @keywords_only("analysis.Regression.predict", 2)
    def predict(self, rows: Table, level: float = 0.95) -> Prediction:
        """Return what is expected for rows with the model's columns; see `Prediction`.

        `rows` is a table like that of `regression`, or a dictionary of single values; 0 < level
        < 1. Raises `SceneError`.
        """
        label = f"{self.label}.predict"
        level = _level(label, level)
        values = sample(Checker(label), rows, self._terms[1:])[1]
        design = np.column_stack([np.ones(len(values)), values])
        found = self._fit.get_prediction(design)
        mean, single = (found.conf_int(obs=obs, alpha=1 - level).T for obs in (False, True))
        return Prediction(np.asarray(found.predicted), *mean, *single)

    @keywords_only("analysis.Regression.residual_tests", 1)
    def residual_tests(
        self, variables: Sequence[str] | None = None, *, threshold: float = 0.05
    ) -> ResidualTests:
        """Return the tests of the residuals.

        =========  =======  =================================================================
        argument   range    meaning
        =========  =======  =================================================================
        variables  terms    what White's test looks at, also terms that the model lacks; by
                            default the model's own that have three or more different values
        threshold  [0, 1]   a test is significant below this p; Bonus (2023) 10.4 calls a
                            variance uneven below about 0.2
        =========  =======  =================================================================

        Raises `SceneError`, also for an exact fit.
        """
        label = f"{self.label}.residual_tests"
        if variables is None:
            own = zip(self._terms[1:], self._design.T[1:], strict=True)
            found = {name: x for name, x in own if len(np.unique(x)) >= LEAST_VALUES}
        else:
            check = Checker(label)
            names = _texts(check, "variables", variables)
            check.finish()
            found = {}
            for name in names:
                terms, values, whole = sample(check, self._table, [name], "drop")
                lost = self._used & ~whole
                if lost.any():
                    check.fail(
                        f"'{name}' is not a finite number in rows {marked(lost)}; expected one in "
                        "every row of the regression"
                    )
                    continue
                found[terms[0].name] = values[self._used[whole], 0]
            check.finish()
        return residual_tests(self, found, threshold)

    # Tables and pictures ----------------------------------------------------------------------

    def _rows(self) -> list[tuple[str, ...]]:
        ends = self.confidence()
        head = ("term", "coefficient", "standard error", "t", "p", "95 % from", "to")
        columns = (self.coefficients, self.standard_errors, self.t, self.p)
        return [
            head,
            *(
                (name, *(number(c[name]) for c in columns), *(number(end) for end in ends[name]))
                for name in self._terms
            ),
        ]

    def _caption(self) -> str:
        text = (
            f"{self.response}: {self.observations} rows, R² {self.r_squared:.4f}, "
            f"adjusted {self.adjusted_r_squared:.4f}, F {self.f:.4g} (p {self.f_p:.3g}), "
            f"residual error {self.residual_error:.4g}"
        )
        return text + (f", {len(self.dropped)} rows left out" if self.dropped else "")

    def summary(self) -> str:
        """Return the table as text for a terminal."""
        return f"{self._caption()}\n{text_table(self._rows())}"

    __repr__ = summary

    def _repr_html_(self) -> str:
        """Return the table for Jupyter."""
        head, *rows = self._rows()
        return f"<p>{html.escape(self._caption())}</p>{html_table(rows, head)}"

    def plot_residuals(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw residuals over fitted responses and return the axes; `style` goes to the points."""
        ax = plots.axes(ax, f"fitted {self.response}", "residual")
        ax.axhline(0.0, **plots.THIN)
        ax.plot(self.fitted, self.residuals, **(plots.POINTS | style))
        return ax

    def plot_qq(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw sorted residuals over normal quantiles, which follow the line if normal."""
        stats = need("scipy.stats", f"{self.label}.plot_qq", "studies")
        (quantile, value), (slope, middle, _) = stats.probplot(self.residuals)
        ax = plots.axes(ax, "quantile of the normal distribution", "residual")
        ax.plot(quantile, middle + slope * quantile, **plots.THIN)
        ax.plot(quantile, value, **(plots.POINTS | style))
        return ax

    def plot_parity(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw fitted over observed responses, with the line on which they are equal."""
        ax = plots.axes(ax, f"observed {self.response}", f"fitted {self.response}")
        plots.diagonal(ax, self.observed, self.fitted)
        ax.plot(self.observed, self.fitted, **(plots.POINTS | style))
        return ax


@keywords_only("analysis.regression", 3, method=False)
def regression(
    table: Table,
    response: str = "f_max",
    model: str | Sequence[str] = "multi",
    *,
    missing: Missing = "refuse",
) -> Regression:
    """Fit a response by ordinary least squares.

    =========  =============  ============================================================
    argument   range          meaning
    =========  =============  ============================================================
    table      a table        the result of a study, a mapping of columns (n,), a pandas
                              frame, NumPy records, or a list of dictionaries
    response   a term         what is fitted
    model      terms          a name below, or a list of terms; a constant is always there
    missing    "refuse",      what happens to rows without a number: an error, or they are
               "drop"         left out and listed in `Regression.dropped`
    =========  =============  ============================================================

    ========  ==========================================
    model     response
    ========  ==========================================
    "linear"  a0 + a1 c
    "dual"    a0 + a2 √theta15 + a3 log n
    "multi"   a0 + a1 c + a2 √theta15 + a3 log n
    ========  ==========================================

    c is the number of debris, theta15 the share that lies within 15° of the structure's normal, n
    the porosity, all columns of the table. A term is a column, or "sqrt", "log" (natural),
    "square", "inverse" or "inverse sqrt" and a column: "inverse sqrt L_x". Needs statsmodels:
    ``pip install libmpm[studies]``. Raises `SceneError`, also for values without a logarithm or
    root and for terms that are combinations of others. Source: Bonus (2023) 7.3 and 10.4.
    """
    check = Checker("analysis.regression")
    if isinstance(model, str):
        if model not in MODELS:
            hint = nearest(model, MODELS)
            check.fail(
                f"model is {shown(model)}; {hint} Or give a list of terms, such as ['sqrt c']"
            )
        terms = MODELS.get(model, ())
    else:
        terms = tuple(_texts(check, "model", model))
    check.finish()
    parsed, values, used = sample(check, table, [response, *terms], missing)
    names = [term.name for term in parsed]
    if len(set(names)) < len(names):
        check.fail(f"terms occur twice in {', '.join(names)}; expected each once")
    check.finish()
    design = np.column_stack([np.ones(len(values)), values[:, 1:]])
    _check_design(check, names[1:], design)
    check.finish()
    # White's test may want other columns later, as they are now.
    kept = {name: np.array(column) for name, column in columns(check, table).items()}
    return Regression(names[0], names[1:], values[:, 0].copy(), design, (kept, used))


def _check_design(check: Checker, names: Sequence[str], design: Floats) -> None:
    """Refuse designs that do not determine their coefficients, or leave no residuals."""
    rows, count = design.shape
    if rows <= count:
        check.fail(
            f"there are {rows} rows for {count} coefficients; expected more rows than "
            "coefficients; add rows or leave terms out"
        )
        return
    size = np.linalg.norm(design, axis=0)
    have = design / np.where(size > 0, size, 1.0)
    for k, name in enumerate(names, 1):
        if np.linalg.matrix_rank(have[:, : k + 1]) <= k:
            check.fail(
                f"term '{name}' is a constant or a combination of the terms before it; expected "
                "terms that differ; leave one out, or vary it in the study"
            )
            return
    condition = float(np.linalg.cond(have))
    if condition > _CONDITION:
        check.fail(
            "the terms differ too little from each other, or too little from a constant, for "
            f"double precision (condition number {condition:.2g} at the same size); expected < "
            f"{_CONDITION:g}; give columns less their mean, or leave terms out"
        )


def _fitted(models: Any, observed: Floats, design: Floats) -> Any:
    """Return statsmodels' ordinary least squares, whatever the units of the terms.

    statsmodels drops singular values below 1e-15 of the largest without a word, which a constant
    beside squares in Pa² is, so the fit is made with columns of length 1 and scaled back.
    """
    size = np.linalg.norm(design, axis=0)
    scaled = models.OLS(observed, design / size).fit()
    model = models.OLS(observed, design)
    # What model.fit() would have set, and the diagnostics of statsmodels read.
    model.rank = scaled.model.rank
    model.df_model, model.df_resid = scaled.model.df_model, scaled.model.df_resid
    model.pinv_wexog = scaled.model.pinv_wexog / size[:, None]
    model.normalized_cov_params = scaled.normalized_cov_params / np.outer(size, size)
    model.wexog_singular_values = np.linalg.svd(design, compute_uv=False)
    results = models.OLSResults(
        model, scaled.params / size, model.normalized_cov_params, scaled.scale
    )
    return models.RegressionResultsWrapper(results)


def _level(label: str, level: Any) -> float:
    check = Checker(label)
    level = check.number("level", level, lower=0, upper=1, lower_open=True, upper_open=True)
    check.finish()
    return float(level)


def _texts(check: Checker, name: str, given: Any) -> list[str]:
    """Return a list of terms; at least one."""
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        check.fail(
            f"{name} is {shown(given, 80)}; expected a list of terms, such as ['c', 'log n']"
        )
        return []
    return list(given)
