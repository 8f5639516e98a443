"""Tait-Murnaghan pressure near zero: no staircase in either precision (Bonus 2023, 5.12.5).

The reference uses 50 digits. Expected duration: 1 s.
"""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from libmpm import _core
from support.tolerances import EQUATION_OF_STATE

pytestmark = pytest.mark.validation

K, GAMMA = 2.2e9, 7.15
FLOAT = {"single": np.float32, "double": np.float64}


def exact(j):
    """(K/γ) ((1 - j)^-γ - 1) with 50 digits, of the very numbers given, as strings of digits."""
    with localcontext() as context:
        context.prec = 50
        k, gamma = Decimal(K), Decimal(GAMMA)
        return np.array([
            float(k / gamma * ((-gamma * (1 - Decimal(float(x))).ln()).exp() - 1)) for x in j
        ])  # fmt: skip


def points(largest, kind, n=1000):
    size = np.logspace(np.log10(largest) - 6, np.log10(largest), n // 2)
    return np.concatenate([-size[::-1], size]).astype(kind)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("largest", [1e-15, 1e-7, 1e-2])
def test_relative_error(precision, largest, figure):
    j = points(largest, FLOAT[precision])
    # The law of the constants as the number type holds them: K = 2.2e9 is exact in both.
    found = np.asarray(_core.equation_of_state(j, K, GAMMA))
    assert found.dtype == FLOAT[precision]
    error = np.abs(found.astype(float) - exact(j)) / np.abs(exact(j))
    bound = EQUATION_OF_STATE[precision]
    _, axes = figure.new()
    axes.loglog(np.abs(j), np.maximum(error, 1e-18), ".", ms=2)
    axes.axhline(bound, color="r", label="bound")
    axes.set(xlabel="|j|", ylabel="relative error", title=f"Tait-Murnaghan, {precision}")
    axes.legend()
    assert error.max() <= bound


def test_the_usual_form_fails():
    """Negative control: 1 - j and pow in single precision are wrong by more than 60 Pa."""
    j = points(1e-7, np.float32)
    one, gamma = np.float32(1), np.float32(GAMMA)
    usual = np.float32(K) / gamma * ((one - j) ** -gamma - one)
    assert np.abs(usual - exact(j)).max() > 60.0


def test_increments_below_the_rounding_of_one():
    """16 kPa builds up from 853 increments of 8.5e-9 each, all lost where J itself is stored."""
    target = 16036.289
    j_end = -np.expm1(-np.log1p(GAMMA * target / K) / GAMMA)
    rate = np.float32(np.log1p(-j_end) / 853)
    assert abs(rate) < 3e-8
    j, volume = np.float32(0), np.float32(1)
    for _ in range(853):
        j = j * (1 + rate) - rate
        volume = volume * (1 + rate)
    assert volume == 1
    pressure = float(_core.equation_of_state(np.array([j]), K, GAMMA)[0])
    assert pressure == pytest.approx(target, rel=1e-5)
