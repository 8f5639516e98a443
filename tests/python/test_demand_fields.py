"""Laws of debris fields, reductions, ordered loads, and the expected load of a field."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import demand
from support.demand import ANGULAR, POROUS, QUARTER, UNIFORM, dkw, fitted, stats
from support.functions import refused

#: A peak that a quadrature over the whole range would not see.
PEAK = stats.truncnorm(-4, 4, QUARTER / 2, 1e-4)


# The expected load, eq. 11.5 and 11.6 -------------------------------------------------------


@pytest.mark.parametrize(
    "zero",
    [0.0, demand.Discrete([0.0]), [0.0], np.zeros(7), demand.Discrete([0.0, 1.0], [1.0, 0.0])],
    ids=["number", "discrete", "sample", "samples", "impossible value"],
)
def test_perfect_order_has_the_ordered_load(zero: Any) -> None:
    """Validation row V5: P(θ) = δ(0), P(n) = δ(0) and R(0) = 1 give C(c)."""
    ordered = fitted(np.random.default_rng(3))
    disorder = {"angle": zero, "angle_reduction": ANGULAR}
    disorder |= {"porosity": zero, "porosity_reduction": POROUS}
    for count in (1, 5, 16):
        found = demand.expected_load(ordered, count=count, **disorder)
        assert found == pytest.approx(ordered(count), rel=1e-12)
        assert demand.expected_load(ordered, count=count) == pytest.approx(found, rel=1e-14)
        curve = demand.exceedance(ordered, count=count, samples=50, draws=0, **disorder)
        np.testing.assert_array_equal(curve.probability, curve.load < found * (1 - 1e-12))


@pytest.mark.parametrize(
    ("law", "mean"),
    [
        (stats.uniform(0, QUARTER), 1 - 0.6 * 2 / 3),
        (demand.Histogram([2, 2, 2], [0, 0.3, 0.6, 0.9]), None),
        (demand.Histogram([1.0], [0, QUARTER]), 1 - 0.6 * 2 / 3),
        (demand.Density(lambda x: 1 / QUARTER, 0, QUARTER), 1 - 0.6 * 2 / 3),
        (demand.Discrete([0, QUARTER / 2, QUARTER], [0.5, 0.25, 0.25]), 0.75 + 0.25 * 0.4),
        (np.array([0, QUARTER / 2]), 0.7),
        (stats.triang(0.5, 0, QUARTER), 1 - 0.6 * 5 / 6),
        (PEAK, 0.4 + 0.6 * PEAK.var() / (QUARTER / 2) ** 2),
    ],
    ids=["uniform", "histogram", "bin", "density", "discrete", "samples", "triangle", "peak"],
)
def test_expected_load_of_laws_of_the_angle(law: Any, mean: float | None) -> None:
    if mean is None:  # uniform to 0.9: the mean of 1 − 0.6 (4 u (1 − u)), u = 2 θ / π
        end = 0.9 / QUARTER
        mean = 1 - 0.6 * 4 * (end / 2 - end**2 / 3)
    found = demand.expected_load(250.0, angle=law, angle_reduction=ANGULAR)
    assert found == pytest.approx(250 * mean, rel=1e-8)


@pytest.mark.parametrize(("a", "b"), [(2, 5), (0.5, 0.5), (1, 1)])
def test_expected_load_of_laws_of_porosity_and_count(a: float, b: float) -> None:
    found = demand.expected_load(
        lambda c: 70 * c,
        count=stats.poisson(7),
        porosity=stats.beta(a, b),
        porosity_reduction=POROUS,
    )
    assert found == pytest.approx(70 * 7 * (1 - 0.7 * a / (a + b)), rel=1e-9)
    root = demand.expected_load(np.sqrt, count=demand.Discrete([4, 9], [0.25, 0.75]))
    assert root == pytest.approx(0.25 * 2 + 0.75 * 3)


def test_load_weighted_with_a_rate() -> None:
    """Eq. 11.6 with λ(n) = ν P(n) is ν times eq. 11.5: N per period, not a probability."""
    law = stats.beta(2, 5)
    disorder = {"degrees": UNIFORM, "angle_reduction": ANGULAR, "porosity_reduction": POROUS}
    expected = demand.expected_load(900.0, porosity=law, **disorder)
    for per_year in (12.0, 1.0):
        found = demand.rate_weighted_load(
            900.0, rate=lambda n, nu=per_year: nu * law.pdf(n), **disorder
        )
        assert found == pytest.approx(per_year * expected, rel=1e-9)
    assert "N per period" in (demand.rate_weighted_load.__doc__ or "")


# Reductions --------------------------------------------------------------------------------


def test_three_point_reduction() -> None:
    found = ANGULAR([0, QUARTER / 4, QUARTER / 2, QUARTER])
    np.testing.assert_allclose(found, [1, 1 - 0.6 * 0.75, 0.4, 1], atol=1e-15)
    assert isinstance(ANGULAR(0.3), float)
    same = demand.Reduction.through([0, QUARTER / 2, QUARTER], [1, 0.4, 1])
    angle = np.linspace(0, QUARTER, 50)
    np.testing.assert_allclose(same(angle), ANGULAR(angle), atol=1e-14)


def test_reduction_through_points() -> None:
    line = demand.Reduction.through([0, 1], [1, 0.3])
    n = np.linspace(0, 1, 101)
    np.testing.assert_allclose(line(n), POROUS(n), atol=1e-15)
    points = [0, 0.1, 0.5, 0.9, 1], [1, 0.5, 0.45, 0.1, 0.1]
    curve = demand.Reduction.through(*points)
    np.testing.assert_allclose(curve(points[0]), points[1], atol=1e-15)
    assert (np.diff(curve(n)) <= 0).all()  # cubics that do not swing over
    mean = demand.expected_load(1.0, porosity=stats.uniform(0, 1), porosity_reduction=curve)
    middle = np.mean(curve((np.arange(100_000) + 0.5) / 100_000))
    assert mean == pytest.approx(middle, abs=1e-9)


def test_reductions_keep_to_their_range() -> None:
    # The parabola through these points rises above them: 1 + x/4 − 5x²/4.
    assert refused(lambda: demand.Reduction.through([0, 0.2, 1], [1, 1, 0])) == (
        "demand.Reduction: R is 1.00012 at 0.0005; expected 0 to 1 from 0 to 1, since disorder "
        "reduces the load"
    )
    assert refused(lambda: demand.Reduction(lambda x: 1 - 2 * x, upper=1)).startswith(
        "demand.Reduction: R is -0.001 at 0.5005; expected 0 to 1 from 0 to 1"
    )
    assert refused(lambda: ANGULAR(45.0)) == ("demand.Reduction: x is 45; expected 0 to 1.5708")
    assert refused(lambda: demand.Reduction.three_point(1.2)) == (
        "demand.Reduction: minimum is 1.2; expected ≥ 0 and ≤ 1"
    )
    for call in (demand.expected_load, demand.exceedance):
        with pytest.warns(libmpm.ModelWarning, match="porosity_reduction rises") as seen:
            call(1.0, porosity=0.5, porosity_reduction=lambda n: 0.5 + 0.2 * n)
        assert seen[0].filename == __file__


# Ordered fields ----------------------------------------------------------------------------


@pytest.mark.parametrize(("form", "variable"), [("linear", np.asarray), ("sqrt", np.sqrt)])
def test_ordered_load(form: Any, variable: Callable[[Any], Any]) -> None:
    count = np.array([1, 2, 4, 8, 12, 16])
    clean = demand.ordered_load(count, 33 + 410 * variable(count), form=form)
    assert clean.coefficients == pytest.approx((33, 410))
    assert clean.form == form and clean.counts == (1, 16)
    assert clean(9) == pytest.approx(33 + 410 * float(variable(9)))
    np.testing.assert_allclose(clean([0, 4]), [0, 33 + 410 * float(variable(4))])
    rest = np.array([3.0, -5, 1, 4, -6, 2])
    noisy = demand.ordered_load(count, 33 + 410 * variable(count) + rest, form=form)
    design = np.column_stack([np.ones(6), variable(count)])
    projected = rest - design @ np.linalg.lstsq(design, rest, rcond=None)[0]
    scatter = math.sqrt(projected @ projected / 4)
    assert noisy.scatter == pytest.approx(scatter)
    inverse = np.linalg.inv(design.T @ design)
    np.testing.assert_allclose(noisy.covariance, scatter**2 * inverse, rtol=1e-9)
    for call in (
        lambda: noisy(20),
        lambda: demand.expected_load(noisy, count=20),
        lambda: demand.exceedance(noisy, count=20, samples=10),
    ):
        with pytest.warns(libmpm.ModelWarning, match="is 20; the data reach from 1 to 16") as seen:
            call()
        assert [warning.filename for warning in seen] == [__file__]


def test_drawn_coefficients_follow_their_law() -> None:
    """Differences over their standard error are Student t with n − 2 degrees of freedom."""
    ordered = fitted(np.random.default_rng(1))
    size = 4000
    drawn = ordered.draws(np.random.default_rng(2), size)
    for count in (1, 5, 16):
        place = np.array([1, count])
        error = math.sqrt(place @ ordered.covariance @ place)
        t = (np.array([curve(count) for curve in drawn]) - ordered(count)) / error
        assert stats.kstest(t, stats.t(13).cdf).statistic < dkw(size)


# Laws ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "law",
    [
        demand.Histogram([1, 3, 0, 2], [0, 0.2, 0.3, 0.5, 1.0]),
        demand.Density(lambda n: 6 * n * (1 - n), 0, 1),
        demand.Discrete([0.2, 0.6, 0.9], [0.2, 0.5, 0.3]),
    ],
    ids=["histogram", "density", "discrete"],
)
def test_samples_follow_their_law(law: demand.Law) -> None:
    drawn = law.sample(np.random.default_rng(4), 20_000)
    low, high = law.support
    assert (drawn >= low).all() and (drawn <= high).all()
    for x in (0.15, 0.25, 0.4, 0.75):
        if isinstance(law, demand.Discrete):
            below = law.expect(lambda v, x=x: v <= x)
        else:
            below = law.expect(lambda v, x=x: np.asarray(v <= x, float), breaks=(x,))
        assert np.mean(drawn <= x) == pytest.approx(below, abs=dkw(20_000))


def test_wrong_laws_are_named() -> None:
    for call, message in [
        (lambda: demand.Discrete([1, 2], [0.5, 0.4]), "probability adds up to 0.9; expected 1"),
        (lambda: demand.Discrete([1, 2], [0.5]), "probability has shape (1,); expected (2,)"),
        (lambda: demand.Discrete([]), "value has shape (0,); expected (n,) with n ≥ 1"),
        (lambda: demand.Histogram([1, -1], [0, 1, 2]), "weight[1] is -1; expected ≥ 0"),
        (lambda: demand.Histogram([1], [2, 1]), "expected two or more increasing numbers"),
        (lambda: demand.Histogram([0, 0], [0, 1, 2]), "weight is zero in all bins"),
        (lambda: demand.Density(lambda x: 2.0, 0, 1), "has the integral 2; expected 1"),
        (lambda: demand.Density(lambda x: 1 - 2 * x, 0, 1), "the density is -0.99"),
        (lambda: demand.Density(lambda x: 1.0, 1, 0), "upper is 0 with lower 1"),
    ]:
        assert message in refused(call)


def test_wrong_data_are_named() -> None:
    assert "expected (n,) for both, n ≥ 3" in refused(lambda: demand.ordered_load([1, 2], [3, 4]))
    assert "count is 2 throughout" in refused(lambda: demand.ordered_load([2, 2, 2], [3, 4, 5]))
    assert "count[0] is 0; expected ≥ 1" in refused(
        lambda: demand.ordered_load([0, 1, 2], [1, 2, 3])
    )
    assert "rate is -1 at porosity" in refused(
        lambda: demand.rate_weighted_load(1.0, rate=lambda n: -1.0, porosity_reduction=POROUS)
    )
