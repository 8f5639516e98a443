"""Numbers of box plots, correlations, and simulated against measured loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.palette import CYCLE
from libmpm._src.base.tables import Tabled
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, sequence, shown
from libmpm._src.studies.analysis import plots
from libmpm._src.studies.analysis.layout import number
from libmpm._src.studies.analysis.record import Floats, numbers
from libmpm._src.studies.analysis.tables import Missing, Table, sample

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["BoxPlot", "Correlation", "Parity", "box_plot", "correlation", "parity"]


@dataclass(frozen=True, repr=False)
class BoxPlot(Tabled):
    """Numbers of a box plot, in the unit of its values; made by `box_plot`."""

    label: ClassVar[str] = "analysis.BoxPlot"

    count: int
    """Number of values."""
    minimum: float
    """Smallest value."""
    lower_bound: float
    """Q1 - reach (Q3 - Q1); values below are outliers."""
    lower_whisker: float
    """Smallest value that is no outlier."""
    q1: float
    """First quartile."""
    median: float
    """Second quartile."""
    q3: float
    """Third quartile."""
    upper_whisker: float
    """Largest value that is no outlier."""
    upper_bound: float
    """Q3 + reach (Q3 - Q1); values above are outliers."""
    maximum: float
    """Largest value."""
    outliers: tuple[float, ...]
    """Values outside the bounds, ascending."""
    reach: float
    """How many box heights the bounds are away from the box."""

    @property
    def iqr(self) -> float:
        """Interquartile range Q3 - Q1, the height of the box."""
        return self.q3 - self.q1

    def _rows(self) -> list[tuple[str, str]]:
        names = ["count", "minimum", "lower_bound", "lower_whisker", "q1", "median", "q3"]
        names += ["upper_whisker", "upper_bound", "maximum"]
        found = [(name.replace("_", " "), number(getattr(self, name))) for name in names]
        outliers = ", ".join(number(x) for x in self.outliers) or "none"
        return [("of a box plot", "value"), *found, ("outliers", outliers)]

    def plot(
        self, ax: Axes | None = None, *, position: float = 1.0, name: str = "", **style: Any
    ) -> Axes:
        """Draw the box at `position` into matplotlib axes and return them.

        The whiskers end at the last values inside the bounds. `style` goes to ``Axes.bxp``.
        """
        ax = plots.axes(ax, "", "")
        numbers_of = {
            "med": self.median,
            "q1": self.q1,
            "q3": self.q3,
            "whislo": self.lower_whisker,
            "whishi": self.upper_whisker,
            "fliers": list(self.outliers),
            "label": name,
        }
        ax.bxp([numbers_of], positions=[position], manage_ticks=bool(name), **style)
        return ax


@keywords_only("analysis.box_plot", 1, method=False)
def box_plot(values: npt.ArrayLike, *, reach: float = 1.5) -> BoxPlot:
    """Return the numbers of a box plot of values (n,), n ≥ 1, in any unit.

    Quartiles lie on straight lines between the sorted values, at (n - 1)/4, (n - 1)/2 and
    3(n - 1)/4 from the first. Outliers lie more than `reach` ≥ 0 times Q3 - Q1 from the box;
    Bonus (2023) 7.3 uses 1.5, and 1 in places. Raises `SceneError`.
    """
    check = Checker("analysis.box_plot")
    given = numbers(check, "values", values)
    reach = check.number("reach", reach, lower=0)
    check.finish()
    if not len(given):
        check.fail("there are no values; expected one or more")
    elif not np.isfinite(given).all():
        check.fail(f"values {marked(~np.isfinite(given))} are not finite; expected numbers")
    check.finish()
    x = np.sort(given)
    q1, median, q3 = np.quantile(x, [0.25, 0.5, 0.75]).tolist()
    low, high = q1 - reach * (q3 - q1), q3 + reach * (q3 - q1)
    inside = x[(x >= low) & (x <= high)]
    return BoxPlot(
        count=len(x),
        minimum=float(x[0]),
        lower_bound=low,
        lower_whisker=float(inside[0]),
        q1=q1,
        median=median,
        q3=q3,
        upper_whisker=float(inside[-1]),
        upper_bound=high,
        maximum=float(x[-1]),
        outliers=tuple(x[(x < low) | (x > high)].tolist()),
        reach=reach,
    )


@dataclass(frozen=True, eq=False, repr=False)
class Correlation(Tabled):
    """Correlations of columns; prints as a table. Made by `correlation`."""

    label: ClassVar[str] = "analysis.Correlation"

    names: tuple[str, ...]
    """The k terms."""
    matrix: Floats
    """Coefficients, (k, k)."""
    p: Floats
    """Two-sided probabilities of coefficients at least as large without correlation, (k, k)."""
    observations: int
    """Number of rows."""
    method: str
    """"pearson" or "spearman"."""

    def _rows(self) -> list[tuple[str, ...]]:
        body = [
            (name, *(f"{r:.3f} (p {p:.2g})" for r, p in zip(rows, ps, strict=True)))
            for name, rows, ps in zip(self.names, self.matrix, self.p, strict=True)
        ]
        return [(f"{self.observations} rows", *self.names), *body]

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the matrix in colours, with its numbers, and return the axes."""
        ax = plots.axes(ax, "", "")
        look: dict[str, Any] = {"vmin": -1.0, "vmax": 1.0, "cmap": "RdBu_r"} | style
        ax.figure.colorbar(ax.imshow(self.matrix, **look), ax=ax)
        places = range(len(self.names))
        ax.set_xticks(places, self.names, rotation=45, ha="right")
        ax.set_yticks(places, self.names)
        for i in places:
            for j in places:
                ax.text(j, i, f"{self.matrix[i, j]:.2f}", ha="center", va="center", fontsize=8)
        return ax


@keywords_only("analysis.correlation", 2, method=False)
def correlation(
    table: Table,
    names: Sequence[str],
    *,
    method: Literal["pearson", "spearman"] = "pearson",
    missing: Missing = "refuse",
) -> Correlation:
    """Return the correlations of terms over the rows of a table.

    ========  ===================  ======================================================
    argument  range                meaning
    ========  ===================  ======================================================
    table     a table              as in `regression`, 3 rows or more
    names     two terms or more    as in `regression`, for instance "sqrt theta15"
    method    "pearson"            of the values, which sees straight relations
              "spearman"           of their ranks, which sees all that rise or fall
    missing   "refuse", "drop"     as in `regression`
    ========  ===================  ======================================================

    Needs scipy. Raises `SceneError`, also for columns that do not vary.
    """
    check = Checker("analysis.correlation")
    check.choice("method", method, ("pearson", "spearman"))
    if isinstance(names, str) or len(sequence(names) or ()) < 2:
        check.fail(f"names is {shown(names, 80)}; expected a list of two terms or more")
    check.finish()
    terms, values, _ = sample(check, table, names, missing)
    if len(values) < 3:
        check.fail(f"there are {len(values)} rows; expected three or more")
    else:
        for term, column in zip(terms, values.T, strict=True):
            if np.ptp(column) == 0:
                check.fail(f"'{term.name}' is {column[0]:g} in every row; expected it to vary")
    check.finish()
    stats = need("scipy.stats", "analysis.correlation", "studies")
    measure = stats.pearsonr if method == "pearson" else stats.spearmanr
    k = len(terms)
    matrix, p = np.eye(k), np.zeros((k, k))
    for i in range(k):
        for j in range(i):
            found = measure(values[:, i], values[:, j])
            matrix[i, j] = matrix[j, i] = found.statistic
            p[i, j] = p[j, i] = found.pvalue
    return Correlation(tuple(term.name for term in terms), matrix, p, len(values), method)


@dataclass(frozen=True, eq=False, repr=False)
class Parity(Tabled):
    """Simulated = slope measured + intercept; made by `parity`."""

    label: ClassVar[str] = "analysis.Parity"

    slope: float
    """1 if the simulation is right."""
    intercept: float
    """In the unit of the loads; 0 if the simulation is right."""
    r_squared: float
    """R², square of the correlation."""
    slope_error: float
    """Standard error of the slope."""
    intercept_error: float
    """Standard error of the intercept."""
    measured: Floats
    """The n measured values."""
    simulated: Floats
    """The n simulated ones."""

    @property
    def observations(self) -> int:
        """Number n of pairs."""
        return len(self.measured)

    @property
    def deviations(self) -> Floats:
        """Simulated over measured minus 1, (n,); infinite or NaN where measured is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.simulated / self.measured - 1)

    def _rows(self) -> list[tuple[str, ...]]:
        return [
            (f"{self.observations} pairs", "value", "standard error"),
            ("slope", number(self.slope), number(self.slope_error)),
            ("intercept", number(self.intercept), number(self.intercept_error)),
            ("R²", number(self.r_squared, ".5f"), ""),
        ]

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the pairs, the line of equality and the fitted line, and return the axes."""
        ax = plots.axes(ax, "measured", "simulated")
        plots.diagonal(ax, self.measured, self.simulated)
        ends = np.array([self.measured.min(), self.measured.max()])
        ax.plot(ends, self.intercept + self.slope * ends, color=CYCLE[1], linewidth=1.0)
        ax.plot(self.measured, self.simulated, **(plots.POINTS | style))
        return ax


@keywords_only("analysis.parity", 2, method=False)
def parity(measured: npt.ArrayLike, simulated: npt.ArrayLike) -> Parity:
    """Return the straight line through simulated over measured values, (n,) each, n ≥ 3.

    Measured values are usually medians of trials. Needs scipy. Raises `SceneError`. Source: Bonus
    (2023) 7.3, whose first peaks give 0.933, 33.0 N and R² 0.973.
    """
    check = Checker("analysis.parity")
    x, y = numbers(check, "measured", measured), numbers(check, "simulated", simulated)
    check.finish()
    if len(x) != len(y) or len(x) < 3:
        check.fail(
            f"there are {len(x)} measured and {len(y)} simulated values; expected as many, 3 or "
            "more"
        )
    elif not (np.isfinite(x).all() and np.isfinite(y).all()):
        check.fail(f"pairs {marked(~(np.isfinite(x) & np.isfinite(y)))} are not finite numbers")
    elif np.ptp(x) == 0:
        check.fail(f"measured is {x[0]:g} throughout; expected it to vary")
    check.finish()
    fit = need("scipy.stats", "analysis.parity", "studies").linregress(x, y)
    return Parity(
        slope=float(fit.slope),
        intercept=float(fit.intercept),
        r_squared=float(fit.rvalue**2),
        slope_error=float(fit.stderr),
        intercept_error=float(fit.intercept_stderr),
        measured=x,
        simulated=y,
    )
